"""Pages: well formed, escaped and always the same; their tables, figures and colours."""

import base64
import json
import re
import sys
import zlib
from pathlib import Path
from typing import get_args

import mujoco
import numba
import numpy as np
import pytest
import scipy
from jinja2 import UndefinedError
from plotly.graph_objects import Figure

from reports import figures, page, style
from reports.figures import Line
from reports.page import (
    Code,
    Figures,
    Notice,
    Page,
    PageSection,
    PageTable,
    TableCell,
    Text,
    number,
    words,
)
from reports.style import ESTIMATE, FOLLOWER, LEADER, SERIES, TRANSMITTERS
from tests.reports.markup import require_well_formed


def drawing(**settings):
    x = np.linspace(0, 100, 5000)
    options = {"x_label": "time [s]", "y_label": "y [m]", "title": "T2 <&>"} | settings
    return figures.panel([Line(x=x, y=np.sin(x), name="sine")], **options)


def sample_page(**changes):
    blocks = [
        Text(text="E_P with `code <b>` and <i>text</i>"),
        Code(text="a < b"),
        Notice(text="it failed", tone="failure"),
        PageTable(
            heads=["name", "E_P [m]"],
            rows=[[words("T2"), number(1.234)], [words("T3"), number(None)]],
        ),
        Figures(panels=[drawing(), drawing()], caption="Both", legend=[(SERIES[0], "y")]),
    ]
    content = {
        "title": "Title & more",
        "summary": "s",
        "facts": [("seed", "1")],
        "sections": [PageSection(title="A section", blocks=blocks)],
    }
    return Page(**(content | changes))


def test_a_page_is_well_formed_escaped_and_always_the_same():
    html = page.render(sample_page())
    assert html == page.render(sample_page())
    checker = require_well_formed(html)
    assert "<i>text</i>" not in html
    assert "&lt;i&gt;text&lt;/i&gt;" in html
    assert "Title & more" in checker.text
    assert "prefers-color-scheme: dark" in html


def test_the_template_draws_each_kind_of_block():
    template = Path(page.__file__).with_name("templates") / "page.html"
    drawn = re.findall(r'block.kind == "(\w+)"', template.read_text("utf-8"))
    assert sorted(drawn) == sorted(block.kind for block in get_args(page.Block))


def test_a_page_lists_its_software_versions():
    """Against the versions that the packages state themselves."""
    [footer] = re.findall(r"<footer>(.*?)</footer>", page.render(sample_page()))
    packages = {"MuJoCo": mujoco, "NumPy": np, "SciPy": scipy, "Numba": numba}
    expected = [
        f"Python {sys.version.split()[0]}",
        *(f"{name} {p.__version__}" for name, p in packages.items()),
    ]
    assert footer.startswith(f"Made with {', '.join(expected)}.")


def embedded_figures(html):
    """Figures of a page, as its script reads them."""
    (text,) = re.findall(
        r'<script type="application/octet-stream" id="figure-data">(.*?)</script>', html
    )
    figures_of_page = json.loads(zlib.decompress(base64.b64decode(text), -15))
    assert [int(n) for n in re.findall('data-figure="([0-9]+)"', html)] == [
        *range(len(figures_of_page))
    ]
    return figures_of_page


def test_a_page_holds_the_script_that_draws_its_figures():
    """Without a library of megabytes; the script stands once, and on no page without figures."""
    html = page.render(sample_page())
    assert "plotly.js" not in html
    assert html.count("class Drawing") == 1
    assert len(html.encode()) < 200_000
    assert "class Drawing" not in page.render(sample_page(sections=[]))


@pytest.mark.parametrize(
    ("values", "labels"), [((0.04, 30.0), ["0.2", "0.5"]), ((0.04, 900.0), ["0.1", "1", "10"])]
)
def test_logarithmic_axes_of_many_decades_have_fewer_numbers(values, labels):
    line = Line(x=np.array([*values, np.nan, 0.0]), y=np.arange(4.0), marker="o")
    axis = figures.panel([line], x_label="off [m]", y_label="", x_log=True).figure["layout"][
        "xaxis"
    ]
    shown = [
        text
        for text, at in zip(axis["ticktext"], axis["tickvals"], strict=True)
        if 0.1 <= at <= 10.0
    ]
    assert set(labels) <= set(shown)
    assert ("0.2" in shown) == ("0.2" in labels)


def test_figures_are_valid_and_take_their_colours_from_the_page():
    """Against Plotly's schema, and the variables of the page's style sheet."""
    line = Line(
        x=np.arange(3.0),
        y=np.arange(3.0),
        marker="o",
        interval=(np.zeros(3), np.full(3, 4.0)),
        text="end",
    )
    subplot = figures.Subplot(
        lines=[line, Line(x=np.arange(3.0), y=np.ones(3), dash=":")], y_label="E_P", shaded=[(0, 1)]
    )
    panel = figures.Panel(
        parts=[subplot, subplot],
        x_label="D_front",
        title="a",
        x_log=True,
        x_limits=(1.0, None),
        link="a",
    )
    html = page.render(
        sample_page(sections=[PageSection(title="A", blocks=[Figures(panels=[drawing(), panel])])])
    )
    style_of = html.partition("<style>")[2].partition("</style>")[0]
    first, second = embedded_figures(html)
    assert (first, second) == (drawing().figure, panel.figure)
    for figure in (drawing(), panel):
        Figure(figures.light(figure.figure))
        used_variables = set(re.findall(r"var\((--[a-z0-9]+)\)", figure.json))
        assert {"--ink", "--grid", "--frame", SERIES[0].variable} <= used_variables
        assert all(re.search(rf"{variable}:", style_of) for variable in used_variables)
    assert 'aria-label="T2 &lt;&amp;&gt;: y [m] over time [s]"' in html
    assert "T2 &lt;&amp;&gt;" in first["layout"]["title"]["text"]
    assert 'data-link="a"' in html
    marks = second["data"][0]
    assert (marks["error_y"]["array"], marks["error_y"]["arrayminus"]) == (
        [4.0, 3.0, 2.0],
        [0.0, 1.0, 2.0],
    )
    assert second["layout"]["xaxis"]["range"] == pytest.approx([0.0, np.log10(2.08)])
    assert second["data"][2]["yaxis"] == "y2"


def test_numbers_of_figures_have_five_digits_and_gaps():
    assert figures.rounded_numbers(np.array([1234.5678, np.nan, 1e-7 / 3, np.inf])) == [
        1234.6,
        None,
        3.3333e-08,
        None,
    ]


def test_every_colour_has_a_light_and_a_dark_value():
    sheet = page.render(sample_page()).partition("<style>")[2].partition("</style>")[0]
    for colour in style.COLOURS:
        assert re.findall(rf"{colour.variable}: (#[0-9a-f]+)", sheet) == [colour.light, colour.dark]


def contrast(a, b):
    """Contrast of two colours, as WCAG 2.2 defines it."""

    def luminance(colour):
        channels = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        linear = np.where(
            channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4
        )
        return linear @ [0.2126, 0.7152, 0.0722]

    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("colour", [*style.SERIES, LEADER, FOLLOWER, ESTIMATE, *TRANSMITTERS])
def test_lines_stand_out_from_light_and_dark_paper(colour):
    """WCAG 2.2, success criterion 1.4.11: at least 3 to 1."""
    assert contrast(colour.light, "#ffffff") > 3
    assert contrast(colour.dark, "#12181e") > 3


def test_ratios_are_coloured_evenly_either_way():
    assert [page.ratio_tone(r) for r in (1.0, 1.19, 1.3, 1.7, 3.0)] == [
        "ratio-even",
        "ratio-even",
        "ratio-high1",
        "ratio-high2",
        "ratio-high3",
    ]
    assert [page.ratio_tone(1 / r) for r in (1.3, 1.7, 3.0)] == [
        "ratio-low1",
        "ratio-low2",
        "ratio-low3",
    ]
    assert page.ratio_tone(np.nan) == ""


def test_every_kind_of_block_is_shown_and_another_one_refused():
    class Other(Text):
        kind = "other"

    html = page.render(sample_page())
    for element in (
        "<code>code &lt;b&gt;</code>",
        "<pre>a &lt; b</pre>",
        'role="note"',
        "<table>",
        'class="plot"',
    ):
        assert element in html
    with pytest.raises(UndefinedError, match="kind_that_no_branch_draws"):
        page.render(sample_page(sections=[PageSection(title="A", blocks=[Other(text="lost")])]))


@pytest.mark.parametrize(("count", "scrolls"), [(40, False), (41, True), (200, True)])
def test_a_table_of_very_many_rows_scrolls_under_its_heads(count, scrolls):
    """All rows are there; the page is not as long as them, and paper has them all."""
    table = PageTable(heads=["follower"], rows=[[TableCell(text=f"f{i}")] for i in range(count)])
    html = page.render(sample_page(sections=[PageSection(title="A", blocks=[table])]))
    assert [f">f{i}</td>" in html for i in range(count)] == [True] * count
    assert ('<div class="scroll window"' in html) is scrolls
    assert ('<div class="scroll"' in html) is not scrolls
    on_paper = html[html.index("@media print") :]
    assert re.search(r"\.scroll, pre \{[^}]*max-height: none", on_paper)


def test_rows_must_fit_their_table():
    with pytest.raises(ValueError, match="a row of 1 cells in a table of 2 columns"):
        PageTable(heads=["a", "b"], rows=[[TableCell(text="x")]])


@pytest.mark.parametrize(
    ("value", "text"),
    [(-0.004, "0.00"), (-0.006, "−0.01"), (-3, "−3"), (0, "0"), (1.005, "1.00"), (None, "–")],
)
def test_numbers_in_tables_have_no_minus_where_they_are_rounded_to_zero(value, text):
    cell = page.number(value)
    assert cell.text == text
    assert cell.sort == (np.inf if value is None else value)


def test_numbers_stand_to_the_right_under_their_heads():
    html = page.render(sample_page())
    assert '<th scope="col"><button type="button">name' in html
    assert '<th scope="col" class="n"><button type="button"><i>E</i><sub>P</sub> [m]' in html


def test_three_panels_of_one_width_make_a_grid_and_others_share_a_row():
    narrow, wide = drawing(), drawing(width=8.0)
    for panels, layout in (
        ([narrow] * 3, "grid"),
        ([narrow] * 2, "row"),
        ([narrow, narrow, wide], "row"),
    ):
        html = page.render(
            sample_page(sections=[PageSection(title="A", blocks=[Figures(panels=panels)])])
        )
        assert re.findall('<div class="(grid|row)">', html) == [layout]
    html = page.render(
        sample_page(sections=[PageSection(title="A", blocks=[Figures(panels=[wide])])])
    )
    assert 'style="--w: 576; height: 240px"' in html


def test_symbols_in_drawings_carry_their_index_below_the_line():
    axes = drawing(x_label="D_front, UPPER_CASE", y_label="E_P, 2σ [m]").figure["layout"]
    assert axes["yaxis"]["title"]["text"] == "<i>E</i><sub>P</sub>, 2σ [m]"
    assert axes["xaxis"]["title"]["text"] == "<i>D</i><sub>front</sub>, UPPER_CASE"

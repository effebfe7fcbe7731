"""Reports: self-contained, the same bytes for the same content, nothing that escapes its place."""

import re
import sys
from html.parser import HTMLParser
from xml.etree import ElementTree

import mujoco
import numba
import numpy as np
import pytest
import scipy

from experiments.pages import figures, page
from experiments.pages.figures import SERIES, Line
from experiments.pages.flight_report import error_lines, flight_report, without_wraps
from experiments.pages.page import Cell, Code, Figures, Film, Notice, Page, Section, Table, Text, number, words
from sim.flight import Outcome
from tests.synthetic import make_flight

VOID = {"meta", "link", "br", "img", "hr", "input", "source"}


class Checker(HTMLParser):
    """Notes unbalanced tags, ids and addresses."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.addresses, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if "id" in values:
            self.ids.append(values["id"])
        self.addresses += [values[name] for name in ("src", "href") if name in values]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def checked(html):
    checker = Checker()
    checker.feed(html)
    assert not checker.open
    assert len(set(checker.ids)) == len(checker.ids)
    targets = {a[1:] for a in checker.addresses if a.startswith("#")}
    assert targets <= set(checker.ids)
    assert not [a for a in checker.addresses if re.match(r"(https?:)?//", a)]
    return checker


def drawing(name="one"):
    x = np.linspace(0, 100, 5000)
    return figures.svg(
        figures.panel([Line(x=x, y=np.sin(x))], x_label="time [s]", y_label="y [m]", title="T2 <&>"), name, 'a "label"'
    )


def sample_page(**changes):
    blocks = [
        Text(text="E_P with `code <b>` and <i>text</i>"),
        Code(text="a < b"),
        Notice(text="it failed", tone="failure"),
        Table(heads=["name", "E_P [m]"], rows=[[words("T2"), number(1.234)], [words("T3"), number(None)]]),
        Figures(panels=[drawing("one"), drawing("two")], caption="Both", legend=[("--c1", "y")]),
    ]
    content = {"title": "Title & more", "summary": "s", "facts": [("seed", "1")], "sections": [
        Section(title="A section", blocks=blocks)
    ]}  # fmt: skip
    return Page(**(content | changes))


def test_a_page_is_whole_escaped_and_always_the_same():
    html = page.render(sample_page())
    assert html == page.render(sample_page())
    checker = checked(html)
    assert "<i>text</i>" not in html
    assert "&lt;i&gt;text&lt;/i&gt;" in html
    assert "Title & more" in checker.text
    assert "prefers-color-scheme: dark" in html


def test_a_page_says_what_it_was_made_with():
    """The packages' own words are the judge."""
    [footer] = re.findall(r"<footer>(.*?)</footer>", page.render(sample_page()))
    packages = {"MuJoCo": mujoco, "NumPy": np, "SciPy": scipy, "Numba": numba}
    expected = [f"Python {sys.version.split()[0]}", *(f"{name} {p.__version__}" for name, p in packages.items())]
    assert footer == f"Made with {', '.join(expected)}."


def test_figures_are_well_formed_and_take_their_colours_from_the_page():
    text = drawing()
    root = ElementTree.fromstring(text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1))
    assert root.get("aria-label") == 'a "label"'
    assert not re.search(r"#0101", text)
    used = set(re.findall(r"var\((--[a-z0-9]+),", text))
    assert {"--ink", "--grid", "--frame", SERIES[0].variable} <= used
    style = page.render(sample_page()).partition("<style>")[2].partition("</style>")[0]
    assert all(re.search(rf"{variable}:", style) for variable in used)
    assert all(i.startswith("one-") for i in re.findall(r'id="([^"]*)"', text))


def test_every_colour_has_a_light_and_a_dark_value():
    style = page.render(sample_page()).partition("<style>")[2].partition("</style>")[0]
    for colour in figures.COLOURS:
        values = re.findall(rf"{colour.variable}: (#[0-9a-f]+)", style)
        assert len(values) == 2
        assert values[0] == colour.light


def test_decimation_keeps_ends_and_extremes():
    x = np.arange(10_000.0)
    y = np.random.default_rng(3).normal(size=x.size)
    y[4321], y[8765] = 50.0, -60.0
    kept_x, kept_y = figures.decimate(x, y, 200)
    assert kept_x.size <= 202
    assert (kept_x[0], kept_x[-1]) == (0.0, 9999.0)
    assert (kept_y.max(), kept_y.min()) == (50.0, -60.0)
    assert np.all(np.diff(kept_x) > 0)
    np.testing.assert_array_equal(kept_y, y[kept_x.astype(int)])


def test_decimation_keeps_gaps():
    x, y = np.arange(1000.0), np.ones(1000)
    y[300:700] = np.nan
    kept_x, kept_y = figures.decimate(x, y, 100)
    assert np.isnan(kept_y[(kept_x > 320) & (kept_x < 680)]).all()
    assert np.isfinite(kept_y[(kept_x < 300) | (kept_x >= 720)]).all()


def test_bearing_is_scaled_as_the_paper_says():
    given = np.deg2rad([0.0, 180.0, 359.999, 90.0, 540.0])
    np.testing.assert_allclose(figures.scaled_bearing(given), [-10, 0, 10, -5, 0], atol=1e-4)


def test_a_wrap_leaves_a_gap():
    broken = without_wraps(np.array([9.0, 9.9, -9.9, -9.0]))
    assert np.isnan(broken).tolist() == [False, False, True, False]


def test_errors_are_drawn_in_metres_and_degrees():
    lines = error_lines(np.arange(3.0), np.array([1.0, 2, 3]), np.deg2rad([4.0, 5, 6]), np.full(3, np.pi))
    assert [line.y.tolist() for line in lines[1:]] == [pytest.approx([4, 5, 6]), [1, 2, 3]]


def test_ratios_are_coloured_evenly_either_way():
    assert [page.ratio_tone(r) for r in (1.0, 1.19, 1.3, 1.7, 3.0)] == [
        "ratio-even", "ratio-even", "ratio-high1", "ratio-high2", "ratio-high3",
    ]  # fmt: skip
    assert [page.ratio_tone(1 / r) for r in (1.3, 1.7, 3.0)] == ["ratio-low1", "ratio-low2", "ratio-low3"]
    assert page.ratio_tone(np.nan) == ""


def test_rows_must_fit_their_table():
    with pytest.raises(ValueError, match="a row of 1 cells in a table of 2 columns"):
        Table(heads=["a", "b"], rows=[[Cell(text="x")]])


@pytest.mark.parametrize(
    ("value", "text"), [(-0.004, "0.00"), (-0.006, "−0.01"), (-3, "−3"), (0, "0"), (1.005, "1.00"), (None, "–")]
)
def test_numbers_in_tables_have_a_minus_only_where_one_can_see_why(value, text):
    cell = page.number(value)
    assert cell.text == text
    assert cell.sort == (np.inf if value is None else value)


def test_small_films_are_embedded_and_large_ones_linked(tmp_path):
    small, large = tmp_path / "small.mp4", tmp_path / "large.mp4"
    small.write_bytes(b"film")
    large.write_bytes(bytes(page.EMBEDDED_FILM_BYTES + 1))
    assert Film(path=small).source == "data:video/mp4;base64,ZmlsbQ=="
    assert Film(path=large).source == "large.mp4"


def flight_page(tmp_path, flight, name="report.html"):
    errors = []
    for i, found in enumerate(flight.estimates):
        away = found.state[:, :2] - flight.hydrophone(i)[:, :2]
        errors.append((np.hypot(*away.T), np.abs(away[:, 0]) / 20))
    figures_of = {"e_p_max_m": 1.0, "e_p_mean_m": 0.5, "e_p_std_m": 0.1, "e_b_max_deg": 2.0, "e_b_mean_deg": 1.0,
                  "e_b_std_deg": 0.3, "fixes": {"two_points": 20, "gated": 0}}  # fmt: skip
    summary = {"followers": dict.fromkeys(flight.trajectory.names[1:], figures_of), "versions": {"laisn-sim": "0.1.0"}}
    flight_report(flight, errors, summary, tmp_path / name, None)
    return (tmp_path / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("followers", [1, 8])
def test_the_report_of_a_flight(tmp_path, followers):
    flight = make_flight(60.0, followers)
    html = flight_page(tmp_path, flight)
    checker = checked(html)
    text = " ".join(checker.text)
    assert "laisn fly scenario.toml" in text
    assert 'name = "synthetic"' in text
    assert all(name in text for name in flight.trajectory.names)
    assert len(html) < 5_000_000
    assert html == flight_page(tmp_path, flight, "again.html")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.html", "report.html"]


def test_a_flight_that_failed_says_so(tmp_path):
    flight = make_flight(30.0)
    broken = type(flight)(**{**vars(flight), "outcome": Outcome.DIVERGED})
    html = flight_page(tmp_path, broken)
    assert 'class="notice failure"' in html
    assert Outcome.DIVERGED.value in html

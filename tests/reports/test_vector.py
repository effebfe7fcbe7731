"""Figures of pages as vector graphics: what is drawn, and the files."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from reports.figures import Line, Panel, Subplot, panel
from reports.page import Figures, Page, PageSection, render
from reports.style import PAPER, SERIES
from reports.vector import DrawnFigure, chosen, draw, figures_of, formula


def page_with(panels: list[Panel], path: Path) -> Path:
    blocks = [Figures(panels=panels)]
    page = Page(title="T", summary="s", facts=[], sections=[PageSection(title="A", blocks=blocks)])
    path.write_text(render(page), encoding="utf-8")
    return path


X = np.array([1.0, 2.0, 3.0, 4.0])


@pytest.fixture
def page(tmp_path: Path) -> Path:
    errors = Panel(
        parts=(
            Subplot(
                lines=[
                    Line(x=X, y=np.array([1.0, np.nan, 10.0, 100.0]), name="E_P"),
                    Line(x=X, y=X, colour=SERIES[1], dash="--", name="2σ by the filter"),
                ],
                y_label="E_P [m]",
                y_limits=(0.5, 200.0),
                y_log=True,
            ),
            Subplot(
                lines=[
                    Line(x=X, y=X**2, marker="o", interval=(X**2 - 0.5, X**2 + 1.0), name="mean"),
                ],
                y_label="depth [m]",
                y_limits=(20.0, 0.0),
                shaded=[(5.0, 7.0)],
            ),
        ),
        x_label="time [s]",
    )
    route = panel(
        [Line(x=X, y=3 * X, name="leader")],
        x_label="east [m]",
        y_label="north [m]",
        equal_scales=True,
    )
    heatmap = panel(
        [],
        x_label="speed",
        y_label="pitch",
        title="In the sea",
        traces=[
            {
                "type": "heatmap",
                "zmin": 1.0,
                "zmax": 4.0,
                "colorscale": [[0, PAPER.css], [1, SERIES[1].css]],
                "colorbar": {"thickness": 10},
                "z": [[1.0, 2.0], [3.0, None]],
                "text": [["1", "2"], ["3", "–"]],
            }
        ],
        x_ticks={0: "slow", 1: "fast"},
        y_ticks={0: "0", 1: "5"},
    )
    return page_with([errors, route, heatmap], tmp_path / "page.html")


def test_a_figure_has_the_lines_limits_and_labels_of_the_page(page: Path) -> None:
    figures = figures_of(page)
    assert [figure.name for figure in figures] == ["errors", "map", "in-the-sea"]
    drawn = draw(figures[0], 3.5)
    above, below = drawn.axes
    np.testing.assert_array_equal(above.lines[0].get_xdata(), X)
    np.testing.assert_array_equal(above.lines[0].get_ydata(), [1.0, np.nan, 10.0, 100.0])
    assert above.get_yscale() == "log"
    assert above.get_ylim() == pytest.approx((0.5, 200.0))
    assert below.get_ylim() == pytest.approx((20.0, 0.0))
    assert (above.get_ylabel(), below.get_xlabel()) == (r"$E_{\mathrm{P}}$ [m]", "time [s]")
    bars = below.collections[0].get_segments()
    np.testing.assert_allclose([bar[:, 1] for bar in bars], np.column_stack([X**2 - 0.5, X**2 + 1]))
    (legend,) = drawn.legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts == [r"$E_{\mathrm{P}}$", "2σ by the filter", "mean"]
    assert drawn.get_figwidth() == 3.5
    assert draw(figures[1], 3.5).axes[0].get_aspect() == 1.0


def test_a_map_of_cells_has_its_values_and_words(page: Path) -> None:
    axes = draw(figures_of(page)[2], 3.5).axes[0]
    (image,) = axes.images
    np.testing.assert_array_equal(image.get_array().filled(-1), [[1, 2], [3, -1]])
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3", "–"]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["slow", "fast"]


def test_the_command_lists_and_writes_vectors_alone(page: Path, tmp_path: Path) -> None:
    listed = CliRunner().invoke(app, ["figure", str(page)])
    assert listed.exit_code == 0, listed.output
    assert re.search(r"^errors +time \[s\], EP \[m\], depth \[m\]$", listed.stdout, re.M)
    out = tmp_path / "o"
    for format_ in ("pdf", "svg"):
        arguments = ["figure", str(page), "map", "errors", "--format", format_, "--out", str(out)]
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.iterdir()) == [
        "errors.pdf",
        "errors.svg",
        "map.pdf",
        "map.svg",
    ]
    pdf = (out / "errors.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert b"/Subtype /Image" not in pdf
    (box,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", pdf)
    assert float(box) == pytest.approx(7.0 * 72)
    svg = (out / "errors.svg").read_text(encoding="utf-8")
    assert "time [s]" in svg
    assert "<image" not in svg


def test_unknown_figures_and_pages_without_figures_are_reported(page: Path, tmp_path: Path) -> None:
    with pytest.raises(LaisnError, match="figure nix: expected one of errors, map, in-the-sea"):
        chosen(figures_of(page), ["nix"])
    other = tmp_path / "other.html"
    other.write_text("<p>none</p>")
    with pytest.raises(LaisnError, match="expected a page of laisn with figures"):
        figures_of(other)


def test_texts_of_pages_lose_what_html_needs() -> None:
    assert (
        formula("follower 1&#39;s depth &lt; 3 &amp; more [m]")
        == "follower 1's depth < 3 & more [m]"
    )
    axis = {"title": {"text": "follower 1&#39;s depth [m]"}}
    figure = DrawnFigure(name="a", data=(), layout={"xaxis": axis, "yaxis": axis})
    assert figure.labels == "follower 1's depth [m], follower 1's depth [m]"


def test_symbols_become_formulas() -> None:
    assert (
        formula("<b>In <i>D</i><sub>front</sub> for 3 $</b>") == r"In $D_{\mathrm{front}}$ for 3 \$"
    )

"""Figures as SVG that take their colours from the page: one drawing reads on paper, on white and in dark mode.

Matplotlib draws with placeholder colours; `svg` turns them into CSS variables with the light theme as fallback.
A figure is one small panel; pages lay panels side by side, so that nothing shrinks on a narrow screen.
"""

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from laisn.arrays import Floats

WIDTH, HEIGHT = 4.4, 2.5
"""Size of a panel [inch]; 72 units of the drawing to an inch."""
DRAWN_POINTS = 600
"""Most points of a line; more cannot be seen at this size."""


class Colour(NamedTuple):
    """A colour of the page."""

    placeholder: str
    variable: str
    light: str


INK = Colour("#010101", "--ink", "#1c2733")
FRAME = Colour("#010102", "--frame", "#8894a0")
GRID = Colour("#010103", "--grid", "#e3e7eb")
MUTED = Colour("#010104", "--muted", "#9aa5b0")
SERIES = (
    Colour("#010111", "--c1", "#0b62a8"),
    Colour("#010112", "--c2", "#c8501e"),
    Colour("#010113", "--c3", "#0a7d5a"),
    Colour("#010114", "--c4", "#8a4a9e"),
    Colour("#010115", "--c5", "#9a6b00"),
    Colour("#010116", "--c6", "#b03060"),
)
"""Told apart with the common kinds of colour blindness; in dark mode the page lightens them."""
COLOURS = (INK, FRAME, GRID, MUTED, *SERIES)

_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "laisn-sim",
    "font.size": 8.5,
    "text.color": INK.placeholder,
    "axes.labelcolor": INK.placeholder,
    "axes.edgecolor": FRAME.placeholder,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID.placeholder,
    "grid.linewidth": 0.6,
    "xtick.color": FRAME.placeholder,
    "ytick.color": FRAME.placeholder,
    "xtick.labelcolor": INK.placeholder,
    "ytick.labelcolor": INK.placeholder,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
}


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of a panel, or marks where `marker` is given."""

    x: Floats
    y: Floats
    colour: Colour = SERIES[0]
    width: float = 1.0
    dash: str = "-"
    marker: str = ""


def decimate(x: Floats, y: Floats, points: int = DRAWN_POINTS) -> tuple[Floats, Floats]:
    """Smallest and largest value of each of points/2 stretches, in their order, so that no peak is lost.

    Args:
        x: shape (n,).
        y: shape (n,).
        points: most points to keep.

    Returns:
        Both at the same at most `points` + 2 places, the first and last included.
    """
    n = y.size
    if n <= points:
        return x, y
    stretches = points // 2
    length = -(-n // stretches)
    padded = np.full(stretches * length, np.nan)
    padded[:n] = y
    table = padded.reshape(stretches, length)
    missing = np.isnan(table)
    # NaN (nothing to draw) does not win over a number, but a stretch without numbers stays a gap.
    lowest, highest = np.where(missing, np.inf, table), np.where(missing, -np.inf, table)
    start = np.arange(stretches) * length
    kept = np.concatenate([[0, n - 1], start + lowest.argmin(axis=1), start + highest.argmax(axis=1)])
    index = np.unique(np.minimum(kept, n - 1))
    return x[index], y[index]


def panel(
    lines: Iterable[Line],
    *,
    x_label: str,
    y_label: str,
    title: str = "",
    equal: bool = False,
    y_limits: tuple[float | None, float | None] = (None, None),
    height: float = HEIGHT,
) -> Figure:
    """A panel of lines.

    Args:
        lines: what is drawn; lines longer than `DRAWN_POINTS` are decimated unless axes are equal.
        x_label: with unit.
        y_label: with unit.
        title: set above the panel, on the left.
        equal: both axes to one scale, for maps.
        y_limits: bottom and top; None leaves one to the data.
        height: [inch].

    Returns:
        The figure, to be turned into SVG by `svg`.
    """
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH, height))
        axes: Axes = figure.add_axes((0.135, 0.44 / height, 0.845, 1 - 0.72 / height))
        for line in lines:
            x, y = (line.x, line.y) if equal or line.marker else decimate(line.x, line.y)
            edge = 0.7 if line.marker == "|" else 0.0
            style = {
                "linestyle": "none",
                "marker": line.marker,
                "markersize": 5.0 if line.marker == "|" else 2.4,
                "markeredgewidth": edge,
            }
            drawn = style if line.marker else {"linestyle": line.dash, "linewidth": line.width}
            axes.plot(x, y, color=line.colour.placeholder, **drawn)  # type: ignore[arg-type]
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
        axes.margins(x=0.05 if equal else 0.0)
        axes.set_xlabel(x_label, labelpad=2)
        axes.set_ylabel(y_label, labelpad=3)
        if not equal:
            axes.set_ylim(*y_limits)
        if title:
            axes.set_title(title, loc="left", fontsize=8.5, fontweight="bold", pad=5)
    return figure


def timeline(marks: Sequence[Line], rows: Sequence[str], title: str = "") -> Figure:
    """A panel with a named row for each line of marks; x in seconds.

    Args:
        marks: one line for each row, its y being the number of the row from 0.
        rows: names, from below.
        title: set above the panel.
    """
    figure = panel(
        marks,
        x_label="time [s]",
        y_label="",
        title=title,
        height=1.1 + 0.2 * len(rows),
        y_limits=(-0.6, len(rows) - 0.4),
    )
    axes = figure.axes[0]
    left, bottom, width, height = axes.get_position().bounds
    axes.set_position((left + 0.05, bottom, width - 0.05, height))
    axes.set_yticks(range(len(rows)), rows)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    return figure


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")


def svg(figure: Figure, name: str, label: str = "") -> str:
    """SVG text of a figure for use inside a page.

    Args:
        figure: drawn with the placeholder colours.
        name: unique on the page; it prefixes every id.
        label: what is to be seen, for readers who cannot see it.

    Returns:
        One `<svg>` element; the same figure gives the same text.
    """
    with mpl.rc_context(_STYLE):
        stream = io.StringIO()
        figure.set_canvas(FigureCanvasSVG(figure))
        figure.savefig(stream, format="svg", metadata={"Date": None}, transparent=True)
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # The style that matplotlib adds would reach the whole page; the page sets the same for its figures alone.
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = text.replace("xlink:href", "href")
    used = set(re.findall(r"(?:url\(|href=\")#([^)\"]+)", text))
    text = re.sub(r' id="([^"]*)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", text)
    text = re.sub(r"(url\(|href=\")#", rf"\g<1>#{name}-", text)
    text = re.sub(r"(\.\d\d)\d+", r"\1", text)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    text = text.replace("font-weight: 700", "font-weight: 600")
    for colour in COLOURS:
        text = text.replace(colour.placeholder, f"var({colour.variable}, {colour.light})")
    box = re.search(r'viewBox="([^"]*)"', text)
    head = f'<svg viewBox="{box[1] if box else ""}" role="img" aria-label="{_escape(label)}">'
    text = re.sub(r"^<svg.*?>", lambda _: head, text, flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", "\n", text).strip()


def scaled_bearing(bearing: Floats) -> Floats:
    """B as the paper draws it beside the errors: 0 at −10, 180° at 0, 360° at 10 (Section 3.2.1); [rad] in."""
    return np.asarray(np.mod(bearing, 2 * np.pi) / (2 * np.pi) * 20.0 - 10.0)

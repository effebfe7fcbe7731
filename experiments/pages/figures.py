"""Figures as SVG that take their colours from the page: one drawing reads on paper, on white and in dark mode.

Matplotlib draws with placeholder colours; `svg` turns them into CSS variables with the light theme as fallback.
Pages lay panels side by side as far as there is room, so that little shrinks on a narrow screen.
"""

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from experiments.pages.style import COLOURS, FRAME, GRID, HEIGHT, INK, SERIES, WIDTH, Colour
from laisn.arrays import Floats

DRAWN_POINTS = 600
"""Most points of a line in a panel of the usual width; more cannot be seen at this size."""

Limits = tuple[float | None, float | None]
"""Bottom and top of an axis; None leaves one to the data."""
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
    size: float = 2.4
    """Size of a mark [pt]."""
    opacity: float = 1.0


def decimate(x: Floats, y: Floats, points: int = DRAWN_POINTS) -> tuple[Floats, Floats]:
    """Smallest and largest value of each of points/2 stretches, in their order, so that no peak is lost.

    Returns:
        x and y, of shape (n,), at the same at most `points` + 2 places, the first and last included.
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


@dataclass(frozen=True, kw_only=True)
class Part:
    """One of several panels above one another, with an axis of its own."""

    lines: Sequence[Line]
    y_label: str
    """With unit."""
    y_limits: Limits = (None, None)
    ticks: Sequence[float] = ()
    """Where the axis has numbers; none leaves that to the drawing."""
    shaded: Sequence[tuple[float, float]] = ()
    """Stretches of the axis on a darker ground."""


def _axes(figure: Figure, bottom: float, height: float) -> Axes:
    """Axes over the width of a figure, with room for numbers at the left; places in inches."""
    wide, high = figure.get_size_inches()
    left, right = 0.595, 0.09
    return figure.add_axes((left / wide, bottom / high, (wide - left - right) / wide, height / high))


def _draw(axes: Axes, lines: Iterable[Line], width: float, *, whole: bool = False) -> None:
    """Lines and marks; a line of more points than a panel of this width [inch] shows is decimated unless whole."""
    points = round(DRAWN_POINTS * max(1.0, width / WIDTH))
    for line in lines:
        x, y = (line.x, line.y) if whole or line.marker else decimate(line.x, line.y, points)
        size, edge = (5.0, 0.7) if line.marker == "|" else (line.size, 0.0)
        axes.plot(
            x, y, linestyle="none" if line.marker else line.dash, linewidth=line.width, marker=line.marker,
            markersize=size, markeredgewidth=edge, color=line.colour.placeholder, alpha=line.opacity,
        )  # fmt: skip


def _title(axes: Axes, title: str) -> None:
    if title:
        axes.set_title(title, loc="left", fontsize=8.5, fontweight="bold", pad=5)


def panel(
    lines: Iterable[Line],
    *,
    x_label: str,
    y_label: str,
    title: str = "",
    equal: bool = False,
    y_limits: Limits = (None, None),
    width: float = WIDTH,
    height: float = HEIGHT,
) -> Figure:
    """A panel of lines.

    Args:
        lines: what is drawn; lines longer than `DRAWN_POINTS` are decimated unless axes are equal.
        x_label: with unit.
        y_label: with unit.
        title: set above the panel, on the left.
        equal: both axes to one scale, for maps.
        y_limits: of the axis.
        width: [inch]; wider panels keep more points.
        height: [inch].
    """
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width, height))
        axes = _axes(figure, 0.44, height - 0.72)
        _draw(axes, lines, width, whole=equal)
        if equal:
            axes.set_aspect("equal", adjustable="datalim")
        axes.margins(x=0.05 if equal else 0.0)
        axes.set_xlabel(x_label, labelpad=2)
        axes.set_ylabel(y_label, labelpad=3)
        if not equal:
            axes.set_ylim(*y_limits)
        _title(axes, title)
    return figure


def stack(
    parts: Sequence[Part], *, x_label: str, title: str = "", width: float = WIDTH, height: float = HEIGHT
) -> Figure:
    """Panels above one another, listed from above, that share the axis at their foot; arguments as of `panel`."""
    gap = 0.14
    each = (height - 0.72 - gap * (len(parts) - 1)) / len(parts)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width, height))
        for number, part in enumerate(reversed(parts)):
            axes = _axes(figure, 0.44 + number * (each + gap), each)
            for low, high in part.shaded:
                axes.axhspan(low, high, color=GRID.placeholder, linewidth=0.0)
            _draw(axes, part.lines, width)
            axes.margins(x=0.0)
            axes.set_ylabel(part.y_label, labelpad=3)
            axes.set_ylim(*part.y_limits)
            if part.ticks:
                axes.set_yticks(part.ticks)
            if number == 0:
                axes.set_xlabel(x_label, labelpad=2)
            else:
                axes.tick_params(axis="x", labelbottom=False, length=0)
        figure.align_ylabels()
        _title(figure.axes[-1], title)
    return figure


_SYMBOL = re.compile(r"(?<=[> ,])([EDHσ])_([A-Za-z]+)(?=[^<>\"]*</text>)")
"""A symbol with an index, such as E_P, in the words of a drawing."""


def with_subscripts(text: str) -> str:
    """The text of a drawing with the indices of symbols below the line."""
    return _SYMBOL.sub(r'\1<tspan dy="2" font-size="70%">\2</tspan><tspan dy="-2">&#8203;</tspan>', text)


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
    # of places alone: what is written on a figure keeps its digits
    text = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\.\d\d)\d+", r"\1", tag[0]), text)
    text = re.sub(r"font-family: [^;\"]*;? ?", "", text)
    text = text.replace("font-weight: 700", "font-weight: 600")
    text = with_subscripts(text)
    for colour in COLOURS:
        text = text.replace(colour.placeholder, f"var({colour.variable}, {colour.light})")
    box = re.search(r'viewBox="([^"]*)"', text)
    wide, label = round(72 * figure.get_size_inches()[0]), escape(label, {'"': "&quot;"})
    head = f'<svg viewBox="{box[1] if box else ""}" style="--w: {wide}" role="img" aria-label="{label}">'
    text = re.sub(r"^<svg.*?>", lambda _: head, text, flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", "\n", text).strip()

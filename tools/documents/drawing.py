"""Pictures of the documents by matplotlib, from the same lines and panels as the figures of
pages.
"""

import re
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from laisn.arrays import Floats
from reports import figures
from reports.figures import DRAWN_POINTS, Line, Panel, Subplot, Ticks, decimate
from reports.style import ERROR_COLOURS, ERROR_LEVELS_M, FRAME, GRID, INK, WIDTH

_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "laisn-sim",
    "font.size": 8.5,
    "text.color": INK.light,
    "axes.labelcolor": INK.light,
    "axes.edgecolor": FRAME.light,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID.light,
    "grid.linewidth": 0.6,
    "xtick.color": FRAME.light,
    "ytick.color": FRAME.light,
    "xtick.labelcolor": INK.light,
    "ytick.labelcolor": INK.light,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
}
_ALL_POINTS = 10**9  # maps are not decimated
_SYMBOL = re.compile(r"(?<=[> ,])([EDHσ])_([A-Za-z]+)(?=[^<>\"]*</text>)")
"""A symbol with an index, such as E_P, in the words of a drawing."""


def with_subscripts(text: str) -> str:
    """The text of a drawing with the indices of symbols below the line."""
    # the zero-width space raises the line again
    return _SYMBOL.sub(
        r'\1<tspan dy="2" font-size="70%">\2</tspan><tspan dy="-2">&#8203;</tspan>', text
    )


def _axes(figure: Figure, bottom: float, height: float) -> Axes:
    """Axes over the width of a figure, with room for numbers at the left; places in inches."""
    width_in, height_in = figure.get_size_inches()
    left = 0.595
    right = 0.09
    return figure.add_axes(
        (
            left / width_in,
            bottom / height_in,
            (width_in - left - right) / width_in,
            height / height_in,
        )
    )


def _draw(axes: Axes, subplot: Subplot, points: int) -> None:
    """Lines, marks and darker ground of a part, its lines decimated to this number of points."""
    for low, high in subplot.shaded:
        axes.axhspan(low, high, color=GRID.light, linewidth=0.0)
    for line in subplot.lines:
        x, y = (line.x, line.y) if line.marker else decimate(line.x, line.y, points)
        size, edge = (5.0, 0.7) if line.marker == "|" else (line.size, 0.0)
        axes.plot(
            x,
            y,
            linestyle="none" if line.marker else line.dash,
            linewidth=line.width,
            marker=line.marker,
            markersize=size,
            markeredgewidth=edge,
            color=line.colour.light,
            alpha=line.opacity,
        )
        for k, (low, high) in enumerate(zip(*line.interval, strict=True) if line.interval else ()):
            if line.horizontal:
                ends = [low, high], [line.y[k]] * 2
            else:
                ends = [line.x[k]] * 2, [low, high]
            axes.plot(*ends, color=line.colour.light, linewidth=1.4)


def _ticks(set_ticks: Callable[..., object], ticks: Ticks) -> None:
    if isinstance(ticks, dict):
        set_ticks(list(ticks), list(ticks.values()))
    elif ticks:
        set_ticks(ticks)


def draw(panel: Panel) -> Figure:
    """A panel of a page as a figure of matplotlib; its parts are listed from above, its axes
    from below.
    """
    points = round(DRAWN_POINTS * max(1.0, panel.width / WIDTH))
    # lengths in inches, but for the heights of parts, which are relative
    gap = 0.14
    room = panel.height - 0.72 - gap * (len(panel.parts) - 1)
    total_height = sum(subplot.height for subplot in panel.parts)
    bottom = 0.44
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(panel.width, panel.height))
        for subplot in reversed(panel.parts):
            subplot_height = room * subplot.height / total_height
            axes = _axes(figure, bottom, subplot_height)
            bottom += subplot_height + gap
            _draw(axes, subplot, _ALL_POINTS if panel.equal_scales else points)
            if panel.equal_scales:
                axes.set_aspect("equal", adjustable="datalim")
            axes.margins(x=0.05 if panel.equal_scales else 0.0)
            axes.set_ylabel(subplot.y_label, labelpad=3)
            axes.set_xscale("log" if panel.x_log else "linear")
            axes.set_yscale("log" if subplot.y_log else "linear")
            if not panel.equal_scales:
                axes.set_ylim(*subplot.y_limits)
                axes.set_xlim(*panel.x_limits)
            _ticks(axes.set_yticks, subplot.ticks)
            _ticks(axes.set_xticks, panel.x_ticks)
            if subplot is panel.parts[-1]:
                axes.set_xlabel(panel.x_label, labelpad=2)
            else:
                axes.tick_params(axis="x", labelbottom=False, length=0)
        figure.align_ylabels()
        if panel.title:
            # the last axes drawn are the topmost
            axes.set_title(panel.title, loc="left", fontsize=8.5, fontweight="bold", pad=5)
    return figure


def draw_lines(lines: Sequence[Line], **settings: Any) -> Figure:
    """Lines as a figure of one panel; settings as of `figures.panel`."""
    return draw(figures.panel(lines, **settings))


def heat_map(bearing_deg: Floats, range_m: Floats, error: Floats, title: str) -> Figure:
    """Position error of a fix over bearing and horizontal range.

    Args:
        bearing_deg: shape (b,).
        range_m: shape (r,).
        error: shape (r, b), [m].
        title: of the panel.
    """
    figure = draw_lines(
        [], x_label="bearing B of the follower [°]", y_label="range [m]", title=title, height=2.6
    )
    (axes,) = figure.axes
    angles_deg = np.append(bearing_deg, bearing_deg[0] + 360.0)
    closed = np.concatenate([error, error[:, :1]], axis=1)
    contours = axes.contourf(
        angles_deg, range_m, closed, levels=ERROR_LEVELS_M, colors=ERROR_COLOURS, extend="max"
    )
    axes.set_yscale("log")
    axes.set_ylim(float(range_m[0]), float(range_m[-1]))
    axes.set_yticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlim(0, 360)
    axes.set_xticks(range(0, 361, 45))
    axes.grid(visible=False)
    left, bottom, _, height = axes.get_position().bounds
    axes.set_position((left, bottom, 0.72, height))
    colour_bar = figure.add_axes((left + 0.75, bottom, 0.03, height))
    figure.colorbar(
        contours,
        cax=colour_bar,
        ticks=ERROR_LEVELS_M,
        extendrect=True,
        extendfrac="auto",
        format="%g",
    )
    colour_bar.set_title("[m]", fontsize=8, loc="left", pad=5, color=INK.light)
    colour_bar.tick_params(length=0, labelcolor=INK.light, labelsize=8)
    colour_bar.grid(visible=False)
    colour_bar.spines[:].set_visible(False)
    return figure

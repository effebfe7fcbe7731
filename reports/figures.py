"""Figures as data: lines and marks over axes, drawn by Plotly in the browser in colours of the
page's CSS.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from laisn.arrays import Floats
from reports.style import (
    COLOURS,
    ERROR_COLOURS,
    FRAME,
    GRID,
    HEIGHT,
    INK,
    PAPER,
    SERIES,
    WIDTH,
    Colour,
    symbols,
)

if TYPE_CHECKING:
    # its special functions take a tenth of a second to import, and a figure needs none
    from reports.findings import Finding

# most points of a line in a panel of the usual width; more cannot be seen at this size
DRAWN_POINTS = 600
PIXELS_PER_INCH = 96
_KEPT_POINTS = 20_000  # most points that a line keeps; panels take fewer of them
# lines of a panel with all their points; of more, each has fewer, so that a page of many vehicles
# stays small
_MAX_LINES = 14
_FEWEST_POINTS = 200  # that each line keeps in any case

Limits = tuple[float | None, float | None]  # bottom and top of an axis; None leaves one to the data
# where an axis has numbers, or words; none leaves that to the drawing
Ticks = Sequence[float] | Mapping[float, str]
_DASHES = {"-": "solid", "--": "dash", ":": "dot"}
_SYMBOLS = {
    "o": "circle",
    "^": "triangle-up",
    "|": "line-ns-open",
    "P": "cross",
    "s": "square",
    "X": "x",
    "D": "diamond",
}


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of a panel, or marks where `marker` is given."""

    x: Floats
    y: Floats
    colour: Colour = SERIES[0]
    width: float = 1.0  # [pt]
    dash: str = "-"  # a key of `_DASHES`
    marker: str = ""  # a key of `_SYMBOLS`; empty: a line
    size: float = 2.4  # of marks [pt]
    opacity: float = 1.0
    name: str = ""  # what it is, shown with its values under the pointer
    # lower and upper limits of y, or of x if `horizontal`, drawn as bars
    interval: tuple[Floats, Floats] | None = None
    horizontal: bool = False
    text: str = ""  # beside the last point
    text_position: str = "middle right"
    # of each point of a map, shape (n,), [s]: where the time cursor of linked panels stands
    time: Floats | None = None

    def __post_init__(self) -> None:
        # until the page is written, a long mission's arrays would be kept once for each line
        if (
            self.y.size > _KEPT_POINTS
            and not self.marker
            and self.time is None
            and self.interval is None
        ):
            for name, values in zip(
                ("x", "y"), decimate(self.x, self.y, _KEPT_POINTS), strict=True
            ):
                object.__setattr__(self, name, values)


@dataclass(frozen=True, kw_only=True)
class Subplot:
    """One of several panels above one another, with an axis of its own."""

    lines: Sequence[Line]
    y_label: str
    y_limits: Limits = (None, None)
    y_log: bool = False
    ticks: Ticks = ()
    shaded: Sequence[tuple[float, float]] = ()  # stretches of the y axis on a darker ground
    # what is no line, such as a map of colours, as Plotly describes it
    traces: Sequence[Mapping[str, Any]] = ()
    height: float = 1.0  # relative to the other parts


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Parts above one another, listed from above, that share the axis at their foot."""

    parts: Sequence[Subplot]
    x_label: str
    title: str = ""
    # x and y are positions [m], at equal scales; lines keep all their points
    equal_scales: bool = False
    x_limits: Limits = (None, None)
    x_log: bool = False
    x_ticks: Ticks = ()
    width: float = WIDTH  # [inch]; wider panels keep more points
    height: float = HEIGHT  # [inch]
    points: int = DRAWN_POINTS  # most of a line, in a panel of the usual width with few lines
    link: str = ""  # panels of a page with the same name share a time cursor

    @property
    def figure(self) -> dict[str, Any]:
        """Plotly's `data` and `layout`; colours are CSS variables of the page."""
        data = list[dict[str, Any]]()
        layout = self._layout()
        lines = sum(len(subplot.lines) for subplot in self.parts)
        point_factor = min(max(1.0, self.width / WIDTH), _MAX_LINES / max(lines, 1))
        points = max(round(self.points * point_factor), _FEWEST_POINTS)
        for number, subplot in enumerate(self.parts):
            axis = {"yaxis": f"y{number + 1}"} if number else {}
            data += [
                _trace(line, None if self.equal_scales else points, self.equal_scales) | axis
                for line in subplot.lines
            ]
            data += [dict(trace) | axis for trace in subplot.traces]
        return {"data": data, "layout": layout}

    @property
    def json(self) -> str:
        return json.dumps(self.figure, separators=(",", ":"), ensure_ascii=False).replace(
            "<", "\\u003c"
        )

    def _layout(self) -> dict[str, Any]:
        count = len(self.parts)
        gap = 0.03
        total_height = sum(subplot.height for subplot in self.parts)
        low = 1.0
        values = [line.x for subplot in self.parts for line in subplot.lines]
        x_axis = _axis(self.x_label, self.x_limits, self.x_log, self.x_ticks, values)
        x_axis |= {
            "showspikes": not self.equal_scales,
            "spikemode": "across",
            "spikethickness": 1,
            "spikedash": "solid",
            "spikecolor": FRAME.css,
            "spikesnap": "hovered data",
        }
        layout: dict[str, Any] = {
            "xaxis": x_axis | {"anchor": f"y{count}" if count > 1 else "y"},
            "shapes": [],
        }
        for number, subplot in enumerate(self.parts):
            suffix = str(number + 1) if number else ""
            top = low - (gap if number else 0.0)
            low = max(top - (1.0 - gap * (count - 1)) * subplot.height / total_height, 0.0)
            axis = _axis(
                subplot.y_label,
                subplot.y_limits,
                subplot.y_log,
                subplot.ticks,
                _y_values(subplot.lines),
            )
            layout[f"yaxis{suffix}"] = axis | {"domain": [round(low, 4), round(top, 4)]}
            layout["shapes"] += [
                {
                    "type": "rect",
                    "xref": "x domain",
                    "yref": f"y{suffix}",
                    "x0": 0,
                    "x1": 1,
                    "y0": bottom,
                    "y1": end,
                    "fillcolor": GRID.css,
                    "line": {"width": 0},
                    "layer": "below",
                }
                for bottom, end in subplot.shaded
            ]
        if self.equal_scales:
            layout["yaxis"] |= {"scaleanchor": "x"}
        lines = wrap(self.title, round(11 * self.width))  # eleven characters in an inch
        if lines:
            bold = {
                "text": "<br>".join(f"<b>{symbols(line)}</b>" for line in lines),
                "font": {"size": 13},
            }
            layout["title"] = bold | {
                "x": 0,
                "xref": "paper",
                "y": 1,
                "yanchor": "top",
                "pad": {"t": 6},
            }
        return layout | {
            "height": round(PIXELS_PER_INCH * self.height),
            "showlegend": False,
            "margin": {"l": 52, "r": 8, "t": 10 + 18 * len(lines), "b": 40},
            "font": {"size": 12, "color": INK.css, "family": "system-ui, sans-serif"},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "hovermode": "closest" if self.equal_scales else "x",
            "hoversubplots": "axis",
            "hoverlabel": {"bgcolor": PAPER.css, "font": {"color": INK.css}},
        }


def panel(
    lines: Sequence[Line],
    *,
    y_label: str,
    y_limits: Limits = (None, None),
    y_log: bool = False,
    y_ticks: Ticks = (),
    traces: Sequence[Mapping[str, Any]] = (),
    **settings: Any,
) -> Panel:
    """A panel of one part; further settings as of `Panel`."""
    subplot = Subplot(
        lines=lines, y_label=y_label, y_limits=y_limits, y_log=y_log, ticks=y_ticks, traces=traces
    )
    return Panel(parts=(subplot,), **settings)


def marks(
    findings: Sequence["Finding"], places: Floats, *, horizontal: bool = False, **settings: Any
) -> Line:
    """Marks of n findings, with bars of their intervals: the finding is y over the places on the x
    axis, shape (n,), or, if `horizontal`, x beside the places on the y axis.
    """
    value, low, high = np.array(
        [[np.nan if end is None else end for end in (f.number, f.low, f.high)] for f in findings],
        dtype=np.float64,
    ).T
    x, y = (value, places) if horizontal else (places, value)
    return Line(x=x, y=y, size=4.5, interval=(low, high), horizontal=horizontal, **settings)


def decimate(x: Floats, y: Floats, points: int = DRAWN_POINTS) -> tuple[Floats, Floats]:
    """Smallest and largest value of each of points/2 stretches, in their order, and both ends:
    no peak is lost.
    """
    n = y.size
    if n <= points:
        return x, y
    stretches = points // 2
    length = math.ceil(n / stretches)
    padded = np.full(stretches * length, np.nan)
    padded[:n] = y
    table = padded.reshape(stretches, length)
    missing = np.isnan(table)
    # NaN (nothing to draw) does not win over a number, but a stretch without numbers stays a gap.
    lowest = np.where(missing, np.inf, table)
    highest = np.where(missing, -np.inf, table)
    start = np.arange(stretches) * length
    indices = np.concatenate(
        [[0, n - 1], start + lowest.argmin(axis=1), start + highest.argmax(axis=1)]
    )
    index = np.unique(np.minimum(indices, n - 1))
    return x[index], y[index]


def rounded_numbers(values: Floats) -> list[float | None]:
    """Values with five digits, which no screen exceeds; None where there is nothing to draw."""
    array = np.asarray(values, dtype=float)
    # one text of all takes a third of the time of a text of each
    texts = " ".join(["%.5g"] * array.size) % tuple(array.tolist())
    rounded: list[float | None] = [*map(float, texts.split())]
    for missing in np.flatnonzero(~np.isfinite(array)).tolist():
        rounded[missing] = None
    return rounded


_LOG_TICKS = [float(f"{digit}e{power}") for power in range(-6, 7) for digit in (1, 2, 5)]
"""Plotly itself labels 0.5 on a logarithmic axis as 5. Axes of more than three decades have 0.1,
1, 10 … alone.
"""


def error_bands(
    x: Floats, y: Floats, errors: Floats, levels: Sequence[float], hover: str
) -> dict[str, Any]:
    """A trace of a map of errors in bands of equal colour, whatever their widths.

    Args:
        x: Columns of the map, shape (n,).
        y: Its rows, shape (m,).
        errors: At each place, shape (m, n), [m].
        levels: Lower limits of the seven bands, the first 0 [m].
        hover: What is told of a place, with %{x}, %{y} and %{customdata}.
    """
    last = len(levels) - 1
    band = np.interp(errors, [*levels, 2.0 * levels[-1]], np.arange(len(levels) + 1))
    return {
        "type": "contour",
        "x": rounded_numbers(x),
        "y": rounded_numbers(y),
        "z": [rounded_numbers(row) for row in band],
        "customdata": [rounded_numbers(row) for row in errors],
        "hovertemplate": f"{hover}<extra></extra>",
        "contours": {"start": 1, "end": last, "size": 1, "showlines": False},
        "line": {"width": 0},
        "colorscale": [[i / last, colour] for i, colour in enumerate(ERROR_COLOURS)],
        "colorbar": {
            "title": {"text": "[m]"},
            "thickness": 10,
            "tickvals": [*range(1, last + 1)],
            "ticktext": [f"{level:g}" for level in levels[1:]],
        },
    }


def _y_values(lines: Sequence[Line]) -> list[Floats]:
    """Values of lines along the y axis, with the ends of their intervals."""
    values = [line.y for line in lines]
    for line in lines:
        if line.interval is not None and not line.horizontal:
            values += line.interval
    return values


def _axis(
    label: str, limits: Limits, log: bool, ticks: Ticks, values: Sequence[Floats]
) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "title": {"text": str(symbols(label)), "standoff": 6},
        "gridcolor": GRID.css,
        "zeroline": False,
        "showline": True,
        "linecolor": FRAME.css,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": FRAME.css,
        "automargin": True,
    }
    if log:
        axis["type"] = "log"
        ticks = ticks or _log_ticks(values)
    if limits != (None, None):
        ends = _ends(limits, values)
        axis["range"] = [float(np.log10(end)) if log else float(end) for end in ends]
    if ticks:
        words = [*ticks.values()] if isinstance(ticks, Mapping) else [f"{tick:g}" for tick in ticks]
        axis |= {"tickvals": [float(tick) for tick in ticks], "ticktext": words}
    return axis


def _log_ticks(values: Sequence[Floats]) -> list[float]:
    """Ticks of a logarithmic axis: over more than three decades those of whole decades alone."""
    positive = np.concatenate([np.empty(0), *(v[v > 0.0] for v in values)])
    if positive.size and positive.max() > 1000.0 * positive.min():
        return _LOG_TICKS[::3]
    return _LOG_TICKS


def _ends(limits: Limits, values: Sequence[Floats]) -> tuple[float, float]:
    """Ends of an axis: the limits, and for one that is None the values with a margin."""
    bottom, top = limits
    numbers_shown = np.concatenate([*values, np.array([end for end in limits if end is not None])])
    low = float(np.nanmin(numbers_shown))
    high = float(np.nanmax(numbers_shown))
    margin = 0.04 * (high - low) or 1.0
    return low - margin if bottom is None else bottom, high + margin if top is None else top


def _trace(line: Line, points: int | None, is_position: bool) -> dict[str, Any]:
    x, y = (line.x, line.y) if line.marker or points is None else decimate(line.x, line.y, points)
    hover = "%{x:.1f} m, %{y:.1f} m" if is_position else "%{y:.4~g}"
    trace: dict[str, Any] = {
        "type": "scatter",
        "x": rounded_numbers(x),
        "y": rounded_numbers(y),
        "mode": "markers" if line.marker else "lines",
        "opacity": line.opacity,
    }
    if line.marker:
        # from [pt] to [px], somewhat larger than on paper
        size = 9 if line.marker == "|" else round(1.7 * line.size, 1)
        trace["marker"] = {"symbol": _SYMBOLS[line.marker], "size": size, "color": line.colour.css}
    else:
        trace["line"] = {
            "color": line.colour.css,
            "width": round(1.4 * line.width, 2),  # from [pt] to [px]
            "dash": _DASHES[line.dash],
        }
    if line.text:
        trace |= {
            "mode": trace["mode"] + "+text",
            "text": [""] * (len(trace["x"]) - 1) + [line.text],
            "textposition": line.text_position,
            "textfont": {"color": line.colour.css},
        }
    if line.time is not None:
        trace["customdata"] = rounded_numbers(line.time)
        hover += ", %{customdata:.0f} s"
    trace |= (
        {"hovertemplate": f"{hover}<extra>{symbols(line.name)}</extra>"}
        if line.name
        else {"hoverinfo": "skip"}
    )
    if line.interval is not None:
        centre = line.x if line.horizontal else line.y
        low, high = (np.abs(limit - centre) for limit in line.interval)
        trace["error_x" if line.horizontal else "error_y"] = {
            "type": "data",
            "symmetric": False,
            "array": rounded_numbers(high),
            "arrayminus": rounded_numbers(low),
            "width": 0,
            "thickness": 1.2,
            "color": line.colour.css,
        }
    return trace


def plotly(panel: Panel) -> Any:
    """The panel as a `plotly.graph_objects.Figure`, for notebooks."""
    # it takes a second to import, and pages need text alone
    from plotly.graph_objects import Figure  # type: ignore[import-untyped]

    return Figure(light(panel.figure))


def light(value: object) -> Any:
    """A figure with the colours of light pages in place of CSS variables, for use outside a
    page.
    """
    if isinstance(value, Mapping):
        return {key: light(item) for key, item in value.items()}
    if isinstance(value, list):
        return [light(item) for item in value]
    return (
        {colour.css: colour.light for colour in COLOURS}.get(value, value)
        if isinstance(value, str)
        else value
    )

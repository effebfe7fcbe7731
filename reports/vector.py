"""Figures of pages as vector graphics for a paper, drawn from what the pages hold."""

import base64
import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure

from laisn.arrays import Floats
from laisn.errors import LaisnError
from reports.figures import Panel, light
from sim.system import atomic_write, read_text

FORMATS = ("pdf", "svg", "png")
_DPI = 200  # of pictures of pixels
_MAX_PAGE_BYTES = 30_000_000
_DATA = re.compile(r'<script type="application/octet-stream" id="figure-data">([^<]*)</script>')
_SYMBOL = re.compile(r"<i>(.+?)</i>(?:<sub>(.+?)</sub>)?")
_TRACE_NAME = re.compile(r"<extra>(.*)</extra>")  # in a hover template
_DASHES = {"solid": "-", "dash": (0, (4, 2.5)), "dot": (0, (1, 1.5))}
_MARKERS = {
    "circle": "o",
    "triangle-up": "^",
    "line-ns-open": "|",
    "cross": "P",
    "square": "s",
    "x": "X",
    "diamond": "D",
}
_POINTS_PER_PIXEL = 0.75  # points to a pixel of the page
_PART_INCH = 1.15  # height of one of several axes
_ALONE_INCH = 2.3  # and of one that stands alone, of the usual width
_USUAL_INCH = 3.5  # width, that of a column of a paper
_MAX_LABELS = 4  # words beside a y axis in the usual font; more are smaller
_SMALL_FONT = 5.5  # [pt]
_TITLE_INCH = 0.75  # height of the x axis' label, legend and margins
_STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "font.family": "sans-serif",
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#e3e7eb",
    "axes.axisbelow": True,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 7.0,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "svg.hashsalt": "laisn-sim",
}


def formula(text: str) -> str:
    """Text of a page with its symbols as formulas of matplotlib."""
    markup = text.replace("$", r"\$").replace("<b>", "").replace("</b>", "").replace("<br>", " ")

    def symbol(match: re.Match[str]) -> str:
        index = f"_{{\\mathrm{{{match[2]}}}}}" if match[2] else ""
        return f"${match[1]}{index}$"

    return unescape(_SYMBOL.sub(symbol, markup))


def _slug(text: str) -> str:
    """Words of a text as a name of a file."""
    spoken = unescape(re.sub(r"\[.*?\]|<.*?>", "", text)).lower()
    return re.sub(r"[^a-z0-9]+", "-", spoken).strip("-")


@dataclass(frozen=True, kw_only=True)
class DrawnFigure:
    """A figure of a page: Plotly's data and layout in light colours, and its name."""

    name: str
    data: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]

    @property
    def labels(self) -> str:
        """What its axes show, in words."""
        texts = [self.layout["xaxis"]["title"]["text"], *(a["title"]["text"] for a in self.axes)]
        return unescape(re.sub(r"</?\w+>", "", ", ".join(filter(None, texts))))

    @property
    def axes(self) -> list[Mapping[str, Any]]:
        """Axes that go up, from above."""
        return [axis for key, axis in self.layout.items() if key.startswith("yaxis")]


def _name_of(layout: Mapping[str, Any], is_first_map: bool) -> str:
    """A figure's name: map, errors, or that of its title or first axis."""
    labels = [axis["title"]["text"] for key, axis in layout.items() if key.startswith("yaxis")]
    if is_first_map:
        return "map"
    if any(re.match(r"<i>E</i><sub>P</sub>|(position )?error", label) for label in labels):
        return "errors"
    title = layout.get("title", {}).get("text", "")
    return _slug(title) or _slug(labels[0]) or "figure"


def figures_of(page: Path) -> list[DrawnFigure]:
    """Figures of a page of this project, or of the report in a folder; LaisnError: it has none."""
    path = page / "report.html" if page.is_dir() else page
    try:
        match = _DATA.search(read_text(path, _MAX_PAGE_BYTES))
        figures = json.loads(zlib.decompress(base64.b64decode(match[1]), -15)) if match else []
    except (ValueError, zlib.error) as error:
        raise LaisnError(f"{path}: {error}") from None
    if not figures:
        raise LaisnError(f"{path}: expected a page of laisn with figures")
    drawn = []
    counts: dict[str, int] = {}
    for figure in map(light, figures):
        layout = figure["layout"]
        is_first_map = "scaleanchor" in layout["yaxis"] and "map" not in counts
        name = _name_of(layout, is_first_map)
        counts[name] = counts.get(name, 0) + 1
        if counts[name] > 1:
            name = f"{name}-{counts[name]}"
        drawn.append(DrawnFigure(name=name, data=figure["data"], layout=layout))
    return drawn


def chosen(figures: Sequence[DrawnFigure], names: Sequence[str]) -> list[DrawnFigure]:
    """Figures by name; LaisnError naming one that there is not."""
    by_name = {figure.name: figure for figure in figures}
    for name in names:
        if name not in by_name:
            raise LaisnError(f"figure {name}: expected one of {', '.join(by_name)}")
    return [by_name[name] for name in names]


def _values(values: Sequence[float | None]) -> Floats:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _trace_name(trace: Mapping[str, Any]) -> str:
    match = _TRACE_NAME.search(trace.get("hovertemplate", ""))
    return formula(match[1]) if match else ""


def _scatter(axes: Axes, trace: Mapping[str, Any]) -> None:
    x, y = _values(trace["x"]), _values(trace["y"])
    settings: dict[str, Any] = {"alpha": trace.get("opacity", 1.0)}
    if "marker" in trace:
        marker = trace["marker"]
        colour = marker["color"]
        settings |= {
            "linestyle": "none",
            "marker": _MARKERS[marker["symbol"]],
            "markersize": _POINTS_PER_PIXEL * marker["size"],
            "markeredgewidth": 0.6 if marker["symbol"].endswith("open") else 0.0,
        }
    else:
        line = trace["line"]
        colour = line["color"]
        settings |= {
            "linestyle": _DASHES[line["dash"]],
            "linewidth": _POINTS_PER_PIXEL * line["width"],
        }
    axes.plot(x, y, color=colour, label=_trace_name(trace) or "_", **settings)
    for direction in ("x", "y"):
        bars = trace.get(f"error_{direction}")
        if bars:
            ends = np.abs([_values(bars["arrayminus"]), _values(bars["array"])])
            width = _POINTS_PER_PIXEL * bars["thickness"]
            error: dict[str, Any] = {f"{direction}err": ends}
            axes.errorbar(x, y, fmt="none", ecolor=bars["color"], elinewidth=width, **error)
    for index, text in enumerate(trace.get("text", ())):
        if text:
            axes.annotate(formula(text), (x[index], y[index]), (3, 0), textcoords="offset points")


def _colour_map(figure: Figure, axes: Axes, trace: Mapping[str, Any]) -> None:
    """Draw a map of bands, or of cells with their values, and its colour bar."""
    z = np.array([_values(row) for row in trace["z"]])
    bar = trace["colorbar"]
    axes.grid(visible=False)
    if trace["type"] == "contour":
        colours = [colour for _, colour in trace["colorscale"]]
        bands = np.arange(len(colours) + 1)
        norm = BoundaryNorm(bands, len(colours))
        contours = axes.contourf(
            trace["x"], trace["y"], z, levels=bands, cmap=ListedColormap(colours), norm=norm
        )
        legend = figure.colorbar(contours, ax=axes, ticks=bar["tickvals"], pad=0.02)
        legend.set_ticklabels(bar["ticktext"])
    else:
        scale = LinearSegmentedColormap.from_list("scale", [tuple(s) for s in trace["colorscale"]])
        limits = {"vmin": trace["zmin"], "vmax": trace["zmax"]}
        image = axes.imshow(z, cmap=scale, aspect="auto", origin="lower", **limits)
        legend = figure.colorbar(image, ax=axes, pad=0.02)
        for i, row in enumerate(trace.get("text", ())):
            for j, text in enumerate(row):
                axes.text(j, i, text, ha="center", va="center")
    legend.ax.set_title(bar.get("title", {}).get("text", ""), fontsize=7.0)


def _style_axis(axes: Axes, direction: Literal["x", "y"], axis: Mapping[str, Any]) -> None:
    """Label, limits and ticks of an axis."""
    axes.set(**{f"{direction}label": formula(axis["title"]["text"])})
    is_log = axis.get("type") == "log"
    if is_log:
        axes.set(**{f"{direction}scale": "log"})
    if "range" in axis:
        ends = [10.0**end if is_log else end for end in axis["range"]]
        axes.set(**{f"{direction}lim": ends})
    if "tickvals" in axis:
        limits = axes.get_xlim() if direction == "x" else axes.get_ylim()
        visible = [
            (value, text)
            for value, text in zip(axis["tickvals"], axis["ticktext"], strict=True)
            if min(limits) <= value <= max(limits)
        ]
        axes.set(**{f"{direction}ticks": [value for value, _ in visible]})
        axes.set(**{f"{direction}ticklabels": [formula(text) for _, text in visible]})
        if direction == "y" and len(visible) > _MAX_LABELS and visible[0][1][:1].isalpha():
            axes.tick_params(axis="y", labelsize=_SMALL_FONT)
        axes.tick_params(
            axis=direction, which="minor", length=0, labelleft=False, labelbottom=False
        )


def _legend(figure: Figure, parts: Sequence[Axes]) -> None:
    """Names of all lines, each once, above the figure, if there is more than one."""
    entries = {
        text: handle
        for axes in parts
        for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if len(entries) > 1:
        columns = max(1, round(figure.get_figwidth() / 1.2))
        figure.legend([*entries.values()], [*entries], loc="outside upper center", ncols=columns)


def _height_ratios(axes: Sequence[Mapping[str, Any]]) -> list[float]:
    return [axis["domain"][1] - axis["domain"][0] for axis in axes]


def draw(drawing: DrawnFigure, width: float) -> Figure:
    """A figure of a width [inch]."""
    count = len(drawing.axes)
    height = count * _PART_INCH if count > 1 else _ALONE_INCH * (width / _USUAL_INCH) ** 0.5
    figure = Figure(figsize=(width, height + _TITLE_INCH), layout="constrained")
    ratios = _height_ratios(drawing.axes)
    grid = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=ratios)
    parts: list[Axes] = grid.ravel().tolist()
    for number, (axes, axis) in enumerate(zip(parts, drawing.axes, strict=True)):
        name = f"y{number + 1}" if number else "y"
        for shape in drawing.layout["shapes"]:
            if shape["yref"] == name:
                axes.axhspan(shape["y0"], shape["y1"], color=shape["fillcolor"], linewidth=0)
        traces = [trace for trace in drawing.data if trace.get("yaxis", "y") == name]
        for trace in sorted(traces, key=lambda trace: "z" not in trace):
            if "z" in trace:
                _colour_map(figure, axes, trace)
            else:
                _scatter(axes, trace)
        if "scaleanchor" in axis:
            axes.set_aspect("equal", adjustable="datalim")
        _style_axis(axes, "y", axis)
    _style_axis(parts[-1], "x", drawing.layout["xaxis"])
    title = drawing.layout.get("title", {}).get("text", "")
    if title:
        parts[0].set_title(formula(title), loc="left", fontsize=8.0)
    _legend(figure, parts)
    figure.align_ylabels(parts)
    return figure


def _save(drawing: DrawnFigure, path: Path, width: float) -> None:
    format_ = path.suffix.removeprefix(".")
    with rc_context(_STYLE), atomic_write(path) as temporary:
        # without the time, equal figures are equal files
        metadata = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(format_, {})
        draw(drawing, width).savefig(temporary, format=format_, dpi=_DPI, metadata=metadata)


def write_panel(panel: Panel, path: Path, width: float) -> None:
    """Write a panel of a width [inch] as PDF, SVG or PNG, by the suffix of the file; LaisnError:
    another suffix; OSError if writing fails.
    """
    if path.suffix.removeprefix(".") not in FORMATS:
        raise LaisnError(f"{path}: expected a name that ends in .{', .'.join(FORMATS)}")
    figure = light(panel.figure)
    _save(DrawnFigure(name="", data=figure["data"], layout=figure["layout"]), path, width)


def write_figures(
    figures: Sequence[DrawnFigure], folder: Path, format_: str, width: float
) -> Iterator[Path]:
    """Write figures into a folder, each as NAME.FORMAT; OSError if that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    for drawing in figures:
        path = folder / f"{drawing.name}.{format_}"
        _save(drawing, path, width)
        yield path

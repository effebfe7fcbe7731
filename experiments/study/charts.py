"""Figures of a study: a metric over its factors with intervals, over two of them as a map, and over its seas."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.intervals import Interval
from experiments.pages.figures import Line, panel, svg
from experiments.pages.style import FRAME, FULL, INK, SERIES, Colour, Legend
from experiments.study.estimate import Results, digits
from experiments.study.metrics import METRICS, without_unit
from experiments.study.plan import ARM, FOLLOWER, Plan, levels

MOST_PANELS = 12
MOST_LINES = len(SERIES)

_OWNERS = re.compile(r"^(leader|followers\.(\d+))\.")


def _words(name: str) -> tuple[str, str]:
    """A key of the scenario in words, and its unit."""
    owner = _OWNERS.match(name)
    text, unit = without_unit(name.rpartition(".")[2])
    words = text.replace("_", " ")
    if owner:
        words = f"{'leader' if owner[2] is None else f'follower {int(owner[2]) + 1}'}'s {words}"
    return words, unit


def label_of(name: str) -> str:
    """A key of the scenario in words with its unit: "leader's excess buoyancy [N]" of leader.excess_buoyancy_n."""
    words, unit = _words(name)
    return f"{words} [{unit}]" if unit else words


def setting_text(name: str, value: object) -> str:
    """A key and its value in words: "leader's excess buoyancy 12 N"."""
    words, unit = _words(name)
    return f"{words} {value_text(value)} {unit}".rstrip().replace(" °", "°")


class Axis(NamedTuple):
    """The values of a factor along an axis, and where they stand."""

    name: str
    values: list[Any]
    places: list[float]
    numeric: bool
    log: bool = False


class Layout(NamedTuple):
    """What the main figure shows along x, by lines and by panels; empty names: nothing."""

    against: str
    lines: str
    panels: tuple[str, ...]


def axis_of(plan: Plan, name: str) -> Axis:
    """An axis for a factor; what is no number stands side by side."""
    values = levels(plan, name)
    numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if not numeric:
        return Axis(name, values, [float(i) for i in range(len(values))], False)
    values.sort()
    log = next((factor.log for factor in plan.study.factors if factor.key == name), False)
    return Axis(name, values, [float(v) for v in values], True, log)


def layout_of(plan: Plan) -> Layout:
    """What goes where: as the study says, and the rest by itself."""
    report, free = plan.study.report, [f.key for f in plan.study.factors]
    if len(plan.arms) > 1:
        free.append(ARM)
    if len(plan.followers) > 1:
        free.append(FOLLOWER)
    free = [name for name in free if len(levels(plan, name)) > 1 or name in (report.against, report.lines)]

    def taken(wish: str, fits: Callable[[str], bool]) -> str:
        name = wish if wish in free else next(filter(fits, free), "")
        if name:
            free.remove(name)
        return name

    for wish in (report.lines, report.panels):
        if wish in free:
            free.append(free.pop(free.index(wish)))
    others = {report.lines, report.panels} - {""}
    against = taken(report.against, lambda n: n not in others and axis_of(plan, n).numeric)
    against = against or taken("", lambda n: n not in others)
    lines = taken(report.lines, lambda n: n == ARM and n != report.panels)
    lines = lines or taken("", lambda n: n != report.panels and len(levels(plan, n)) <= MOST_LINES)
    return Layout(against, lines, tuple(sorted(free, key=lambda n: n != report.panels)))


def value_text(value: object) -> str:
    """A value of a factor as text."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _mark(axes: Axes, x: float, interval: Interval, colour: Colour) -> None:
    if not math.isnan(interval.low):
        axes.vlines(x, interval.low, interval.high, color=colour.placeholder, linewidth=0.9)


def _dress(figure: Figure, axis: Axis) -> None:
    axes = figure.axes[0]
    if axis.log:
        axes.set_xscale("log")
    axes.autoscale(enable=True, axis="y")
    axes.margins(x=0.06, y=0.08)
    if axes.dataLim.y0 >= 0:
        axes.set_ylim(bottom=0.0)
    if not axis.numeric:
        axes.set_xticks(axis.places, [value_text(v)[:18] for v in axis.values])
        axes.set_xlim(-0.6, len(axis.values) - 0.4)


def _share_scale(panels: Sequence[Axes]) -> None:
    """Give all panels one y scale, so that they can be compared."""
    limits = [axes.get_ylim() for axes in panels]
    for axes in panels:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))


_TITLE = 48
"""Characters that a panel has room for in a line of its title."""
Valued = Callable[[dict[str, Any]], Interval | None]
"""Gives the interval at a place, told by its names and values; None if nothing was flown there."""


def over_factor(plan: Plan, layout: Layout, valued: Valued, label: str, name: str, *, zero: bool) -> tuple[
    list[str], Legend
]:  # fmt: skip
    """Panels of a value over a factor, and the legend of their lines.

    `label` is that of the y axis, `name` the prefix of ids on the page; `zero` draws the line of no difference.
    """
    axis = axis_of(plan, layout.against)
    kinds = levels(plan, layout.lines) if layout.lines else [None]
    drawn: list[tuple[Figure, str]] = []
    legend: list[tuple[Colour, str]] = []
    for chosen in combinations(plan, layout.panels)[:MOST_PANELS]:
        lines, marks = [], []
        if zero:
            ends = (min(axis.places), max(axis.places)) if axis.numeric else (-0.6, len(axis.values) - 0.4)
            lines.append(Line(x=np.array(ends), y=np.zeros(2), colour=FRAME, dash="--", width=0.7))
        for i, kind in enumerate(kinds[:MOST_LINES]):
            here = chosen | ({layout.lines: kind} if layout.lines else {})
            found = [(p, valued(here | {axis.name: v})) for p, v in zip(axis.places, axis.values, strict=True)]
            shift = 0.0 if axis.numeric else 0.12 * (i - (len(kinds) - 1) / 2)
            known = [(p + shift, v) for p, v in found if v is not None and not math.isnan(v.value)]
            if not known:
                continue
            x, y = np.array([p for p, _ in known]), np.array([v.value for _, v in known])
            if axis.numeric and plan.study.design == "factorial":
                lines.append(Line(x=x, y=y, colour=SERIES[i]))
            lines.append(Line(x=x, y=y, colour=SERIES[i], marker="o"))
            marks += [(p, v, SERIES[i]) for p, v in known]
            if (SERIES[i], value_text(kind)) not in legend and layout.lines:
                legend.append((SERIES[i], value_text(kind)))
        if not marks:
            continue
        title = ", ".join(setting_text(key, value) for key, value in chosen.items())
        figure = panel(lines, x_label=label_of(axis.name), y_label=label, title=title)
        for p, v, colour in marks:
            _mark(figure.axes[0], p, v, colour)
        _dress(figure, axis)
        drawn.append((figure, title))
    _share_scale([figure.axes[0] for figure, _ in drawn])
    panels = [
        svg(figure, f"{name}{number}", f"{label} over {label_of(axis.name)} {title}")
        for number, (figure, title) in enumerate(drawn)
    ]
    return panels, legend


def combinations(plan: Plan, names: Sequence[str]) -> list[dict[str, Any]]:
    """Every combination of the values of some factors, by name."""
    found: list[dict[str, Any]] = [{}]
    for name in names:
        found = [chosen | {name: value} for chosen in found for value in levels(plan, name)]
    return found


def place_values(plan: Plan, results: Results, metric: str, base: str = "") -> Valued:
    """Values of a metric by place, whose factors have one value or single out a point; or differences from an arm."""
    indices: dict[tuple[str, ...], dict[tuple[str, ...], int]] = {}

    def valued(here: dict[str, Any]) -> Interval | None:
        keys = tuple(factor.key for factor in plan.study.factors if factor.key in here)
        if keys not in indices:
            points = reversed(list(enumerate(plan.points)))
            indices[keys] = {tuple(repr(point[key]) for key in keys): i for i, point in points}
        point = indices[keys].get(tuple(repr(here[key]) for key in keys))
        if point is None:
            return None
        place = (point, here.get(ARM, plan.arms[0]), here.get(FOLLOWER, plan.followers[0]))
        if place not in results.rows or (base and (point, base, place[2]) not in results.rows):
            return None
        return results.difference(place, base, metric) if base else results.estimate(place, metric)

    return valued


def heat_maps(plan: Plan, valued: Valued, names: tuple[str, str], chosen: Sequence[dict[str, Any]]) -> list[str]:
    """Panels of a metric over two factors, darker where it is larger in any of them, with its values."""
    across, up = axis_of(plan, names[0]), axis_of(plan, names[1])
    values = np.full((len(chosen), len(up.values), len(across.values)), np.nan)
    for (k, i, j), _ in np.ndenumerate(values):
        found = valued(chosen[k] | {across.name: across.values[j], up.name: up.values[i]})
        values[k, i, j] = math.nan if found is None else found.value
    low, high = np.nanmin(values), np.nanmax(values)
    panels = []
    for k, here in enumerate(chosen):
        title = ", ".join(setting_text(key, value) for key, value in here.items())
        figure = panel(
            [],
            x_label=label_of(across.name),
            y_label=label_of(up.name),
            title=title,
            height=1.2 + 0.26 * len(up.values),
        )
        axes = figure.axes[0]
        axes.grid(visible=False)
        for (i, j), value in np.ndenumerate(values[k]):
            share = 0.0 if math.isnan(value) or high == low else float((value - low) / (high - low))
            shade = 0.05 + 0.6 * share
            axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, facecolor=SERIES[1].placeholder, alpha=shade))
            if len(across.values) <= 12:
                axes.text(j, i, digits(value), ha="center", va="center", fontsize=7, color=INK.placeholder)
        axes.set_xticks(range(len(across.values)), [value_text(v) for v in across.values])
        axes.set_yticks(range(len(up.values)), [value_text(v) for v in up.values])
        axes.set_xlim(-0.5, len(across.values) - 0.5)
        axes.set_ylim(-0.5, len(up.values) - 0.5)
        panels.append(svg(figure, f"map{k}", f"map over {label_of(across.name)} and {label_of(up.name)} {title}"))
    return panels


def effect_bars(effects: Mapping[str, Interval]) -> str:
    """Bars of the share of variance of each factor, the largest at the top, with their intervals."""
    places = np.arange(len(effects), dtype=np.float64)[::-1]
    figure = panel(
        [
            Line(x=np.array([e.low, e.high]), y=np.repeat(y, 2), colour=INK)
            for y, e in zip(places, effects.values(), strict=True)
        ],
        x_label="share of variance",
        y_label="",
        width=FULL,
        height=0.8 + 0.3 * len(effects),
        y_limits=(-0.6, len(effects) - 0.4),
    )
    (axes,) = figure.axes
    axes.barh(places, [effect.value for effect in effects.values()], 0.6, color=SERIES[0].placeholder, alpha=0.6)
    axes.set_yticks(places, [fill(label_of(name), 30) for name in effects])
    left, bottom, across, height = axes.get_position().bounds
    axes.set_position((left + 0.25, bottom, across - 0.25, height))
    axes.set_xlim(0.0, 1.0)
    return svg(figure, "effects", "Share of the variance that each factor explains")


def over_seas(plan: Plan, results: Results, metric: str) -> tuple[list[str], Legend]:
    """Share of seas whose mean is below a value, a panel for each point and follower, a line for each arm."""
    panels, legend = [], []
    label, number = METRICS[metric].label, 0
    for point in range(len(plan.points)):
        for follower in plan.followers:
            lines = []
            for i, arm in enumerate(plan.arms[:MOST_LINES]):
                seas = np.sort(results.by_sea((point, arm, follower), metric))
                if seas.size < 2 or np.isnan(seas).any():
                    continue
                x, y = np.repeat(seas, 2), np.repeat(np.arange(seas.size + 1) / seas.size, 2)[1:-1]
                lines.append(Line(x=x, y=y, colour=SERIES[i]))
                if (SERIES[i], arm) not in legend and len(plan.arms) > 1:
                    legend.append((SERIES[i], arm))
            if lines and number < MOST_PANELS:
                title = fill(", ".join(f"{key} = {value_text(v)}" for key, v in plan.points[point].items()), _TITLE)
                figure = panel(lines, x_label=label, y_label="share of seas", title=title, y_limits=(0.0, 1.02))
                figure.axes[0].margins(x=0.04)
                panels.append(svg(figure, f"seas{number}", f"distribution of {label} over seas {title}"))
                number += 1
    return panels, legend


def over_draws(plan: Plan, results: Results, metric: str, point: int) -> list[str]:
    """The means of the seas of a point over each number that was drawn, a panel for each key."""
    panels = []
    for number, draw in enumerate(plan.study.draws[:MOST_PANELS]):
        lines = []
        for i, arm in enumerate(plan.arms[:MOST_LINES]):
            place = (point, arm, plan.followers[0])
            drawn = [row[draw.key] for row in results.rows.get(place, [])]
            if drawn and all(isinstance(v, int | float) and not isinstance(v, bool) for v in drawn):
                x, y = np.array(drawn, dtype=np.float64), results.by_sea(place, metric)
                lines.append(Line(x=x, y=y, colour=SERIES[i], marker="o"))
        if lines:
            figure = panel(lines, x_label=label_of(draw.key), y_label=METRICS[metric].label)
            figure.axes[0].margins(x=0.04, y=0.08)
            panels.append(svg(figure, f"draw{number}", f"{METRICS[metric].label} over {label_of(draw.key)}"))
    return panels

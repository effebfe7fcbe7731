"""Figures of a study: a metric over factors with intervals, over two of them as a map, and over realizations."""

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.intervals import Interval
from experiments.pages.figures import Line, panel, svg
from experiments.pages.page import Figures
from experiments.pages.style import FRAME, FULL, INK, SERIES, Legend
from experiments.study.design import is_number
from experiments.study.estimate import NOTHING, Results, digits
from experiments.study.metrics import METRICS, without_unit
from experiments.study.plan import ARM, FOLLOWER, Plan, levels, varied

MOST_PANELS = 12
MOST_LINES = len(SERIES)
_TITLE_WIDTH = 48
"""Characters that a panel has room for in a line of its title."""

_OWNERS = re.compile(r"^(leader|followers\.(\d+|\*))\.")


def _words(name: str) -> tuple[str, str]:
    """A key of the scenario in words, and its unit."""
    owner = _OWNERS.match(name)
    text, unit = without_unit(name[owner.end() :] if owner else name.partition(".")[2] or name)
    words = text.replace("_", " ").replace(".", " ")
    if owner:
        number = owner[2]
        whose = "leader's" if number is None else "followers'" if number == "*" else f"follower {int(number) + 1}'s"
        words = f"{whose} {words}"
    return words, unit


def label_of(name: str) -> str:
    """A key of the scenario in words with its unit: "leader's excess buoyancy [N]" of leader.excess_buoyancy_n."""
    words, unit = _words(name)
    return f"{words} [{unit}]" if unit else words


def setting_text(name: str, value: object) -> str:
    """A key and its value in words: "leader's excess buoyancy 12 N"."""
    words, unit = _words(name)
    return f"{words} {value_text(value)} {unit}".rstrip().replace(" °", "°")


def point_text(values: Mapping[str, object]) -> str:
    """Keys and their values in words, with commas between them."""
    return ", ".join(setting_text(key, value) for key, value in values.items())


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
    panels: tuple[str, ...] = ()


def axis_of(plan: Plan, name: str) -> Axis:
    """An axis for a factor; what is no number stands side by side."""
    values = levels(plan, name)
    if not all(map(is_number, values)):
        return Axis(name, values, [float(i) for i in range(len(values))], False)
    values.sort()
    log = any(factor.log for factor in plan.study.factors if factor.key == name)
    return Axis(name, values, [float(v) for v in values], True, log)


def layout_of(plan: Plan) -> Layout:
    """Layout: as the study states, otherwise chosen."""
    report, keys = plan.study.report, [factor.key for factor in plan.study.factors]
    free = [n for n in (*keys, ARM, FOLLOWER) if len(levels(plan, n)) > 1 or n in (report.against, report.lines)]

    def taken(*candidates: str) -> str:
        name = next((n for n in candidates if n in free), "")
        if name:
            free.remove(name)
        return name

    others = [n for n in free if n not in (report.lines, report.panels)]
    against = taken(report.against, *(n for n in others if axis_of(plan, n).numeric), *others)
    few = [n for n in free if n != report.panels and len(levels(plan, n)) <= MOST_LINES]
    lines = taken(report.lines, *(n for n in few if n == ARM), *few)
    return Layout(against, lines, tuple(sorted(free, key=lambda n: n != report.panels)))


def value_text(value: object) -> str:
    """A value of a factor as text."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _legend(values: Sequence[object]) -> Legend:
    """What the colours of lines stand for; nothing for a single line."""
    return [(colour, value_text(value)) for colour, value in zip(SERIES, values, strict=False) if len(values) > 1]


def combinations(plan: Plan, names: Sequence[str]) -> list[dict[str, Any]]:
    """Every combination of the values of some factors, by name."""
    every = itertools.product(*(levels(plan, name) for name in names))
    return [dict(zip(names, values, strict=True)) for values in every]


def _values(plan: Plan, results: Results, names: Iterable[str], base: str = "") -> Callable[..., Interval]:
    """The report's metric at a place, or its difference from an arm, by the values of factors with these names.

    Factors that are left out have one value, or those named single out a point.
    """
    keys, metric = [factor.key for factor in plan.study.factors if factor.key in names], plan.study.report.metric
    # the first point of those that have the same values
    points = {tuple(repr(point[key]) for key in keys): i for i, point in reversed([*enumerate(plan.points)])}
    apart = results.differences(base, metric) if base else {}

    def value_at(here: Mapping[str, Any]) -> Interval:
        point = points.get(tuple(repr(here[key]) for key in keys), -1)
        place = (point, here.get(ARM, plan.arms[0]), here.get(FOLLOWER, plan.followers[0]))
        return apart.get(place, NOTHING) if base else results.estimate(place, metric)

    return value_at


def over_factor(plan: Plan, results: Results, layout: Layout, name: str = "main", base: str = "") -> Figures:
    """Panels of the report's metric over a factor, with intervals.

    Args:
        plan: of the study.
        results: of the study.
        layout: of the panels; without a factor against which to draw there are none.
        name: prefix of ids on the page.
        base: arm from which paired differences are drawn, with a line at no difference.
    """
    if not layout.against:
        return Figures(panels=[])
    axis = axis_of(plan, layout.against)
    value_at = _values(plan, results, (layout.against, layout.lines, *layout.panels), base)
    kinds = levels(plan, layout.lines) if layout.lines else [None]
    label = METRICS[plan.study.report.metric].label
    label = f"difference: {label}" if base else label
    figures: dict[str, Figure] = {}
    for chosen in combinations(plan, layout.panels)[:MOST_PANELS]:
        lines, bars = list[Line](), list[Line]()
        for i, (kind, colour) in enumerate(zip(kinds, SERIES, strict=False)):
            shift = 0.0 if axis.numeric else 0.12 * (i - (len(kinds) - 1) / 2)
            here = chosen | {layout.lines: kind}
            found = zip(axis.places, (value_at(here | {axis.name: v}) for v in axis.values), strict=True)
            known = [(p + shift, v) for p, v in found if not math.isnan(v.value)]
            if not known:
                continue
            x, y = np.array([p for p, _ in known]), np.array([v.value for _, v in known])
            if axis.numeric and plan.study.design == "factorial":
                lines.append(Line(x=x, y=y, colour=colour))
            lines.append(Line(x=x, y=y, colour=colour, marker="o"))
            bars += [Line(x=np.array([p, p]), y=np.array(v[1:]), colour=colour, width=0.9) for p, v in known]
        if not bars:
            continue
        ends = [min(axis.places), max(axis.places)] if axis.numeric else [-0.6, len(axis.values) - 0.4]
        if base:
            lines.insert(0, Line(x=np.array(ends), y=np.zeros(2), colour=FRAME, dash="--", width=0.7))
        title = point_text(chosen)
        figures[title] = panel([*lines, *bars], x_label=label_of(axis.name), y_label=label, title=title)
        (axes,) = figures[title].axes
        axes.set_xscale("log" if axis.log else "linear")
        axes.autoscale(enable=True, axis="y")
        axes.margins(x=0.06, y=0.08)
        if axes.dataLim.y0 >= 0:
            axes.set_ylim(bottom=0.0)
        if not axis.numeric:
            axes.set_xticks(axis.places, [value_text(v)[:18] for v in axis.values])
            axes.set_xlim(*ends)
    # one scale, so that panels can be compared
    limits = [figure.axes[0].get_ylim() for figure in figures.values()]
    for figure in figures.values():
        figure.axes[0].set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
    panels = [
        svg(figure, f"{name}{number}", f"{label} over {label_of(axis.name)} {title}")
        for number, (title, figure) in enumerate(figures.items())
    ]
    return Figures(panels=panels, legend=[entry for entry in _legend(kinds) if entry[1] != base])


def differences(plan: Plan, results: Results) -> Figures:
    """Paired differences of all arms from the first one over a factor."""
    layout = layout_of(plan)
    names = [name for name in (layout.against, layout.lines, *layout.panels) if name not in ("", ARM)]
    return over_factor(plan, results, Layout("".join(names[:1]), ARM, tuple(names[1:])), "apart", plan.arms[0])


def scatter(plan: Plan, results: Results) -> Figures:
    """The report's metric over each factor of a sampled design, a mark for each point."""
    lines = ARM if len(plan.arms) > 1 else ""
    drawn = [
        over_factor(plan, results, Layout(factor.key, lines), f"scatter{i}-")
        for i, factor in enumerate(plan.study.factors[:MOST_PANELS])
    ]
    return Figures(panels=[panel for figures in drawn for panel in figures.panels], legend=_legend(plan.arms))


def heat_maps(plan: Plan, results: Results, names: Sequence[str]) -> Figures:
    """Panels of the report's metric over two factors, darker where it is larger in any of them, with its values."""
    across, up = axis_of(plan, names[0]), axis_of(plan, names[1])
    others = [n for n in (*varied(plan), ARM) if n not in names and len(levels(plan, n)) > 1]
    chosen, value_at = combinations(plan, others)[:MOST_PANELS], _values(plan, results, (*names, *others))
    values = np.full((len(chosen), len(up.values), len(across.values)), np.nan)
    for (k, i, j), _ in np.ndenumerate(values):
        values[k, i, j] = value_at(chosen[k] | {across.name: across.values[j], up.name: up.values[i]}).value
    low, high = np.nanmin(values), np.nanmax(values)
    panels = []
    for k, here in enumerate(chosen):
        title, height = point_text(here), 1.2 + 0.26 * len(up.values)
        figure = panel([], x_label=label_of(across.name), y_label=label_of(up.name), title=title, height=height)
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
    return Figures(panels=panels)


def effect_bars(effects: Mapping[str, Interval]) -> Figures:
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
    return Figures(panels=[svg(figure, "effects", "Share of the variance that each factor explains")])


def over_realizations(plan: Plan, results: Results) -> Figures:
    """Share of realizations whose mean is below a value, a panel for each point and follower, a line for each arm."""
    metric, panels = plan.study.report.metric, list[str]()
    label = METRICS[metric].label
    for point, follower in itertools.product(range(len(plan.points)), plan.followers):
        means = [np.sort(results.by_realization((point, arm, follower), metric)) for arm in plan.arms]
        lines = [
            Line(x=np.repeat(m, 2), y=np.repeat(np.arange(m.size + 1) / m.size, 2)[1:-1], colour=colour)
            for m, colour in zip(means, SERIES, strict=False) if m.size > 1 and not np.isnan(m).any()
        ]  # fmt: skip
        if lines and len(panels) < MOST_PANELS:
            title = fill(point_text(plan.points[point]), _TITLE_WIDTH)
            figure = panel(lines, x_label=label, y_label="share of realizations", title=title, y_limits=(0.0, 1.02))
            figure.axes[0].margins(x=0.04)
            panels.append(svg(figure, f"realizations{len(panels)}", f"distribution of {label} {title}"))
    return Figures(panels=panels, legend=_legend(plan.arms))


def over_draws(plan: Plan, results: Results, point: int) -> Figures:
    """The means of the realizations of a point over each number that was drawn, a panel for each key."""
    metric, panels = plan.study.report.metric, list[str]()
    label, places = METRICS[metric].label, [(point, arm, plan.followers[0]) for arm in plan.arms]
    for draw in plan.study.draws[:MOST_PANELS]:
        drawn = [[row[draw.key] for row in results.rows.get(place, [])] for place in places]
        lines = [
            Line(x=np.array(values), y=results.by_realization(place, metric), colour=colour, marker="o")
            for place, values, colour in zip(places, drawn, SERIES, strict=False)
            if values and all(map(is_number, values))
        ]
        if lines:
            figure = panel(lines, x_label=label_of(draw.key), y_label=label)
            figure.axes[0].margins(x=0.04, y=0.08)
            panels.append(svg(figure, f"draw{len(panels)}", f"{label} over {label_of(draw.key)}"))
    return Figures(panels=panels, legend=_legend(plan.arms))

"""Figures of a study: a metric over factors with intervals, over two of them as a map, and over
realizations.
"""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.study.design import is_number
from experiments.study.estimate import NOTHING, Condition, Results, digits
from experiments.study.measure import METRICS, without_unit
from experiments.study.plan import ARM, FOLLOWER, StudyPlan, levels, varied
from laisn.arrays import Floats
from reports.figures import Line, Panel, panel, plotly, rounded_numbers
from reports.intervals import Interval
from reports.page import Figures
from reports.style import FRAME, FULL, PAPER, SERIES, WIDTH, Legend
from reports.tables import Table

MAX_PANELS = 12
MAX_LINES = len(SERIES)
_MAX_TICKS = 8
_MAX_WRITTEN = 40  # characters across a map; cells of more are too narrow for their numbers
_MAX_BARS = 200  # points of a panel beyond which intervals would hide them


def _words(name: str) -> tuple[str, str]:
    """A key of the scenario in words, and its unit."""
    sensor = re.match(r"sensors\.custom\.(\d+)\.(.+)", name)
    if sensor:
        text, unit = without_unit(sensor[2])
        return f"sensor {int(sensor[1]) + 1}'s {text.replace('_', ' ')}", unit
    owner = re.match(r"(leader|followers\.(\d+|\*))\.", name)
    text, unit = without_unit(name[owner.end() :] if owner else name.partition(".")[2] or name)
    words = text.replace("_", " ").replace(".", " ")
    if not owner:
        return words, unit
    number = owner[2]
    if number is None:
        owner_text = "leader's"
    elif number == "*":
        owner_text = "followers'"
    else:
        owner_text = f"follower {int(number) + 1}'s"
    return f"{owner_text} {words}", unit


def label_of(name: str) -> str:
    """A key of the scenario in words with its unit: "leader's excess buoyancy [N]" of
    leader.excess_buoyancy_n.
    """
    words, unit = _words(name)
    return f"{words} [{unit}]" if unit else words


def value_text(value: object) -> str:
    """A value of a factor as text."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def point_text(values: Mapping[str, object]) -> str:
    """Keys and their values in words, with commas between them: "leader's excess buoyancy 12 N"."""
    entries = ((*_words(key), value_text(value)) for key, value in values.items())
    return ", ".join(
        f"{words} {value} {unit}".rstrip().replace(" °", "°") for words, unit, value in entries
    )


class Axis(NamedTuple):
    """The values of a factor along an axis, and where they stand."""

    name: str
    values: list[Any]
    positions: list[float]  # of the values along the axis: the numbers, or 0, 1, 2, …
    numeric: bool  # whether all values are numbers
    log: bool = False


class ChartLayout(NamedTuple):
    """Names of the factors, or of arms or followers, that the main figure shows along x, by lines
    and by panels; empty: none.
    """

    against: str
    lines: str
    panels: tuple[str, ...] = ()


def axis_of(plan: StudyPlan, name: str) -> Axis:
    """An axis for a factor; what is no number stands side by side."""
    values = levels(plan, name)
    if not all(map(is_number, values)):
        return Axis(name, values, [float(i) for i in range(len(values))], False)
    values.sort()
    log = any(factor.log for factor in plan.study.factors if factor.key == name)
    return Axis(name, values, [float(v) for v in values], True, log)


def layout_of(plan: StudyPlan) -> ChartLayout:
    """Layout: as the study states, otherwise chosen."""
    report = plan.study.file.report
    keys = [factor.key for factor in plan.study.factors]
    unassigned = [
        n
        for n in (*keys, ARM, FOLLOWER)
        if len(levels(plan, n)) > 1 or n in (report.against, report.lines)
    ]

    def take_first(*candidates: str) -> str:
        name = next((n for n in candidates if n in unassigned), "")
        if name:
            unassigned.remove(name)
        return name

    others = [n for n in unassigned if n not in (report.lines, report.panels)]
    x_factor = take_first(report.against, *(n for n in others if axis_of(plan, n).numeric), *others)
    line_candidates = [
        n for n in unassigned if n != report.panels and len(levels(plan, n)) <= MAX_LINES
    ]
    lines = take_first(report.lines, *(n for n in line_candidates if n == ARM), *line_candidates)
    return ChartLayout(x_factor, lines, tuple(sorted(unassigned, key=lambda n: n != report.panels)))


def _legend(values: Sequence[object]) -> Legend:
    """What the colours of lines stand for; nothing for a single line."""
    return [
        (colour, value_text(value))
        for colour, value in zip(SERIES, values, strict=False)
        if len(values) > 1
    ]


def _thinned(words: Mapping[float, str]) -> dict[float, str]:
    """So many of the words along an axis that they do not overlap."""
    return dict(itertools.islice(words.items(), None, None, max(1, -(-len(words) // _MAX_TICKS))))


def _factors_at(plan: StudyPlan, condition: Condition) -> dict[str, Any]:
    """The values of factors, arm and follower of a condition, by name."""
    return {**plan.points[condition.point], ARM: condition.arm, FOLLOWER: condition.follower}


Marks = dict[str, list[tuple[float, float, float, float]]]
"""x, value and its limits of the marks of each line of a panel, by the value of the factor that
lines stand for.
"""


def _marks(
    plan: StudyPlan, results: Results, layout: ChartLayout, axis: Axis, base: str
) -> dict[str, Marks]:
    """Marks of all conditions that have a value, by the titles of their panels; arguments as of
    `over_factor`.
    """
    metric = plan.study.file.report.metric
    differences = results.differences(base, metric) if base else {}
    x_of = {repr(value): x for value, x in zip(axis.values, axis.positions, strict=True)}
    panels: dict[str, Marks] = {}
    for condition in results.rows:
        values = _factors_at(plan, condition)
        if base:
            estimate = differences.get(condition, NOTHING)
        else:
            estimate = results.estimate(condition, metric)
        if math.isnan(estimate.value):
            continue
        title = point_text({name: values[name] for name in layout.panels})
        line = panels.setdefault(title, {}).setdefault(repr(values.get(layout.lines)), [])
        line.append((x_of[repr(values[axis.name])], *estimate))
    return dict(itertools.islice(panels.items(), MAX_PANELS))


def _y_limits(panels: Mapping[str, Marks], *, from_zero: bool) -> tuple[float, float]:
    """Limits that hold all marks and their intervals; with `from_zero` the axis begins at 0 where
    nothing is below.
    """
    lines = itertools.chain.from_iterable(marks.values() for marks in panels.values())
    rows = [mark[1:] for line in lines for mark in line]
    values: Floats = np.array(rows or [(0.0, 0.0, 1.0)])
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    margin = 0.08 * (high - low) or 0.08 * abs(high) or 1.0
    return 0.0 if from_zero and low >= 0 else low - margin, high + margin


def _marked_lines(
    marks: Marks,
    line_levels: Sequence[object],
    names: Sequence[str],
    axis: Axis,
    *,
    connected: bool,
) -> list[Line]:
    """A line for each value of the factor of lines that has marks; side by side where the axis has
    no numbers.
    """
    lines = []
    for i, (level, name, colour) in enumerate(zip(line_levels, names, SERIES, strict=False)):
        if repr(level) not in marks:
            continue
        x, y, low, high = np.array(sorted(marks[repr(level)])).T
        if not axis.numeric:
            x = x + 0.12 * (i - (len(line_levels) - 1) / 2)
        if axis.numeric and connected:
            lines.append(Line(x=x, y=y, colour=colour))
        bars = (low, high) if x.size <= _MAX_BARS else None
        lines.append(Line(x=x, y=y, colour=colour, marker="o", size=3.0, name=name, interval=bars))
    return lines


def over_factor(plan: StudyPlan, results: Results, layout: ChartLayout, base: str = "") -> Figures:
    """Panels of the report's metric over a factor, with intervals and one scale; none without a
    factor.

    `base` is the arm from which paired differences are drawn, with a line at no difference.
    """
    if not layout.against:
        return Figures(panels=[])
    axis = axis_of(plan, layout.against)
    label = METRICS[plan.study.file.report.metric].label
    line_levels: list[Any] = [None]
    names = [label]
    if layout.lines:
        line_levels = levels(plan, layout.lines)
        names = [value_text(level) for level in line_levels]
    marks_of = _marks(plan, results, layout, axis, base)
    settings: dict[str, Any] = {
        "x_label": label_of(axis.name),
        "y_label": f"difference: {label}" if base else label,
        "x_log": axis.log,
        "y_limits": _y_limits(marks_of, from_zero=not base),
        "width": WIDTH if len(marks_of) > 1 else 0.6 * FULL,
    }
    ends = np.array([min(axis.positions), max(axis.positions)])
    if not axis.numeric:
        ends = np.array([-0.6, len(axis.values) - 0.4])
        words = {x: value_text(v)[:18] for x, v in zip(axis.positions, axis.values, strict=True)}
        settings |= {"x_ticks": _thinned(words), "x_limits": tuple(ends.tolist())}
    connected = plan.study.file.design == "factorial"
    panels = []
    for title, marks in marks_of.items():
        lines = _marked_lines(marks, line_levels, names, axis, connected=connected)
        if base:
            lines.insert(0, Line(x=ends, y=np.zeros(2), colour=FRAME, dash="--", width=0.7))
        panels.append(panel(lines, title=title, **settings))
    return Figures(
        panels=panels, legend=[entry for entry in _legend(line_levels) if entry[1] != base]
    )


def differences(plan: StudyPlan, results: Results) -> Figures:
    """Paired differences of all arms from the first one over a factor."""
    x_factor, lines, panels = layout_of(plan)
    names = [name for name in (x_factor, lines, *panels) if name not in ("", ARM)]
    return over_factor(
        plan, results, ChartLayout("".join(names[:1]), ARM, tuple(names[1:])), plan.arms[0]
    )


def scatter(plan: StudyPlan, results: Results) -> Figures:
    """The report's metric over each factor of a sampled design, a mark for each point."""
    lines = ARM if len(plan.arms) > 1 else ""
    figures_of_factors = [
        over_factor(plan, results, ChartLayout(factor.key, lines))
        for factor in plan.study.factors[:MAX_PANELS]
    ]
    return Figures(
        panels=[panel for figures in figures_of_factors for panel in figures.panels],
        legend=_legend(plan.arms),
    )


def heat_maps(plan: StudyPlan, results: Results, names: Sequence[str]) -> Figures:
    """Panels of the report's metric over two factors, darker where it is larger in any of them,
    with its values.
    """
    across = axis_of(plan, names[0])
    up = axis_of(plan, names[1])
    column_of = {repr(value): i for i, value in enumerate(across.values)}
    row_of = {repr(value): i for i, value in enumerate(up.values)}
    others = [
        n for n in (*varied(plan), ARM, FOLLOWER) if n not in names and len(levels(plan, n)) > 1
    ]
    maps: dict[str, Floats] = {}
    for condition in results.rows:
        factors = _factors_at(plan, condition)
        title = point_text({name: factors[name] for name in others})
        if title in maps or len(maps) < MAX_PANELS:
            values = maps.setdefault(title, np.full((len(row_of), len(column_of)), np.nan))
            estimate = results.estimate(condition, plan.study.file.report.metric)
            row = row_of[repr(factors[up.name])]
            column = column_of[repr(factors[across.name])]
            values[row, column] = estimate.value
    all_values = np.array([*maps.values()])
    finite = all_values[~np.isnan(all_values)]
    scale = {
        "type": "heatmap",
        "zmin": float(finite.min(initial=np.inf)),
        "zmax": float(finite.max(initial=-np.inf)),
        "colorscale": [[0, PAPER.css], [1, SERIES[1].css]],
        "opacity": 0.8,
        "xgap": 1,
        "ygap": 1,
        "colorbar": {"thickness": 10, "outlinewidth": 0},
        "hovertemplate": "%{hovertext}<extra></extra>",
    }
    panels = [_heat_panel(title, values, scale, (across, up)) for title, values in maps.items()]
    return Figures(panels=panels)


def _heat_panel(
    title: str, values: Floats, scale: Mapping[str, Any], axes: tuple[Axis, Axis]
) -> Panel:
    """A map of values over two axes, shape (rows, columns), with the values in its cells where
    there is room.
    """
    across, up = axes
    x_labels = [value_text(value) for value in across.values]
    y_labels = [value_text(value) for value in up.values]
    x_title = label_of(across.name)
    y_title = label_of(up.name)
    texts = [[*map(digits, cells)] for cells in values.tolist()]
    hover = [
        [
            f"{x_title} {x_labels[j]}<br>{y_title} {y_labels[i]}<br>{cell}"
            for j, cell in enumerate(cells)
        ]
        for i, cells in enumerate(texts)
    ]
    trace = {**scale, "z": [rounded_numbers(cells) for cells in values], "hovertext": hover}
    longest = max((len(cell) for cells in texts for cell in cells), default=0)
    if longest * len(x_labels) <= _MAX_WRITTEN:
        trace |= {"text": texts, "texttemplate": "%{text}"}
    return panel(
        [],
        x_label=x_title,
        y_label=y_title,
        title=title,
        traces=[trace],
        height=max(1.4 + 0.26 * len(y_labels), 2.5),
        x_ticks=_thinned(dict(enumerate(x_labels))),
        y_ticks=_thinned(dict(enumerate(y_labels))),
    )


def effect_bars(effects: Mapping[str, Interval]) -> Figures:
    """The share of variance of each factor, the largest at the top, with their intervals."""
    places = np.arange(len(effects), dtype=np.float64)[::-1]
    value, low, high = np.array([*effects.values()]).T
    line = Line(
        x=value,
        y=places,
        marker="o",
        size=4.5,
        interval=(low, high),
        horizontal=True,
        name="share of variance",
    )
    words = [f"{label_of(name)}: {100 * effect.value:.0f} %" for name, effect in effects.items()]
    figure = panel(
        [line],
        x_label="share of variance",
        y_label="",
        width=FULL,
        height=0.9 + 0.3 * len(effects),
        # whole marks at the ends
        x_limits=(-0.01, 1.01),
        y_limits=(-0.6, len(effects) - 0.4),
        y_ticks=dict(zip(places.tolist(), words, strict=True)),
    )
    return Figures(panels=[figure])


def over_realizations(plan: StudyPlan, results: Results) -> Figures:
    """Share of realizations whose mean is below a value, a panel for each point and follower, a
    line for each arm.
    """
    metric = plan.study.file.report.metric
    lines_of = dict[str, list[Line]]()
    for point, follower in itertools.product(range(len(plan.points)), plan.followers):
        means = [
            np.sort(results.by_realization(Condition(point, arm, follower), metric))
            for arm in plan.arms
        ]
        lines = [
            Line(
                x=np.repeat(m, 2),
                y=np.repeat(np.arange(m.size + 1) / m.size, 2)[1:-1],
                colour=colour,
                name=arm,
            )
            for arm, m, colour in zip(plan.arms, means, SERIES, strict=False)
            if m.size > 1 and not np.isnan(m).any()
        ]
        owners = [point_text(plan.points[point])] if plan.points[point] else []
        owners += [follower] if len(plan.followers) > 1 else []
        if lines and len(lines_of) < MAX_PANELS:
            lines_of[", ".join(owners)] = lines
    ends = [end for lines in lines_of.values() for line in lines for end in (line.x[0], line.x[-1])]
    margin = 0.04 * (max(ends, default=1.0) - min(ends, default=0.0)) or 1.0
    limits = (min(ends, default=0.0) - margin, max(ends, default=1.0) + margin)
    label = METRICS[metric].label
    below = "share of realizations"
    panels = [
        panel(
            lines, x_label=label, y_label=below, title=title, x_limits=limits, y_limits=(0.0, 1.02)
        )
        for title, lines in lines_of.items()
    ]
    return Figures(panels=panels, legend=_legend(plan.arms))


def over_draws(plan: StudyPlan, results: Results, point: int) -> Figures:
    """The means of the realizations of a point over each number that was drawn, a panel for each
    key.
    """
    metric = plan.study.file.report.metric
    panels = list[Panel]()
    label = METRICS[metric].label
    conditions = [Condition(point, arm, plan.followers[0]) for arm in plan.arms]
    for draw in plan.study.draws[:MAX_PANELS]:
        draws = [
            [row[draw.key] for row in results.rows.get(condition, [])] for condition in conditions
        ]
        lines = [
            Line(
                x=np.array(values),
                y=results.by_realization(condition, metric),
                colour=colour,
                marker="o",
                name=condition.arm,
            )
            for condition, values, colour in zip(conditions, draws, SERIES, strict=False)
            if values and all(map(is_number, values))
        ]
        if lines:
            panels.append(panel(lines, x_label=label_of(draw.key), y_label=label))
    return Figures(panels=panels, legend=_legend(plan.arms))


def arms_over(table: Table, x: str, y: str) -> Any:
    """A metric of a table of results over a factor, as of `StudyFolder.plot`: a Plotly figure."""
    arm, across, metric = (table[name] for name in ("arm", x, y))
    lines = []
    for name, colour in zip(dict.fromkeys(arm), itertools.cycle(SERIES)):
        x_values = np.unique(across[arm == name])
        means = np.array(
            [np.nanmean(metric[(arm == name) & (across == value)]) for value in x_values]
        )
        lines.append(Line(x=x_values, y=means, colour=colour, name=name))
    label = METRICS[y].label if y in METRICS else y
    return plotly(panel(lines, x_label=label_of(x), y_label=label, width=FULL / 2, height=3.6))

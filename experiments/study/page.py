"""The page of a study: what was asked, how it was flown, what came of it, and the runs to look at."""

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.intervals import Interval
from experiments.pages.page import Block, Cell, Code, Figures, Film, Notice, Page, Section, Table, Text, number, words
from experiments.pages.style import Legend
from experiments.study import charts
from experiments.study.effects import INTERACTIONS, main_effects
from experiments.study.estimate import Place, Results, shown
from experiments.study.file import METRIC
from experiments.study.metrics import METRICS
from experiments.study.plan import ALONE, ARM, Entry, Plan, levels, many
from laisn.failure import LaisnError

_FEWEST_SEAS = 8
"""Fewest seas of a figure over what was drawn; with fewer there is nothing to see."""
_MOST_COMMANDS = 400


def point_text(plan: Plan, point: int) -> str:
    """A point's factors and values."""
    return ", ".join(charts.setting_text(key, value) for key, value in plan.points[point].items())


def place_text(plan: Plan, place: Place) -> str:
    """A place in words: its point, and arm and follower where there are several."""
    parts = [point_text(plan, place[0])] if plan.points[place[0]] else []
    parts += [f"arm {place[1]}"] if len(plan.arms) > 1 else []
    parts += [place[2]] if len(plan.followers) > 1 else []
    return ", ".join(parts) or "the study's only point"


def _cell(interval: Interval, tone: str = "") -> Cell:
    return Cell(text=shown(interval), sort=number(interval.value).sort, tone=tone)


def _verdict(apart: Interval) -> str:
    """Whether an arm is lower or higher than the first one, by the whole interval, or the question is open."""
    return "lower" if apart.high < 0 else "higher" if apart.low > 0 else "open"


def _differing(plan: Plan, results: Results) -> dict[Place, Interval]:
    """Differences from the first arm at all places that both have."""
    base, metric = plan.arms[0], plan.study.report.metric
    others = [place for place in results.rows if place[1] != base and (place[0], base, place[2]) in results.rows]
    return {place: results.difference(place, base, metric) for place in others}


def summary_of(plan: Plan, results: Results) -> str:
    """The answer in a few sentences: the extremes, and which arm wins where."""
    metric = plan.study.report.metric
    label = METRICS[metric].label.partition(" [")[0]
    found = [(place, results.estimate(place, metric)) for place in results.rows]
    known = sorted((pair for pair in found if not math.isnan(pair[1].value)), key=lambda pair: pair[1].value)
    if not known:
        return f"Nothing can be said of the {label}."
    unit = METRICS[metric].unit
    text = f"{label[0].upper()}{label[1:]}, with 95 % intervals: {shown(known[0][1], unit)}"
    if len(known) > 1:
        text += f" at best ({place_text(plan, known[0][0])}), {shown(known[-1][1], unit)} at most "
        text += f"({place_text(plan, known[-1][0])})"
    text += "."
    differing = _differing(plan, results)
    for arm in plan.arms[1:]:
        count = Counter(_verdict(apart) for place, apart in differing.items() if place[1] == arm)
        text += f" {arm} against {plan.arms[0]}: lower at {count['lower']}, higher at {count['higher']}, "
        text += f"undecided at {count['open']} places."
    return text


def _design(plan: Plan) -> list[Block]:
    study, rows = plan.study, []
    for factor in study.factors:
        values = ", ".join(map(charts.value_text, factor.values)) or f"{factor.low:g} to {factor.high:g}"
        rows.append([words(factor.key), words("varied"), words(values + (", logarithmic" if factor.log else ""))])
    rows += [[words(draw.key), words("drawn for each sea"), words(draw.law)] for draw in study.draws]
    rows += [[words(key), words("set"), words(charts.value_text(value))] for key, value in study.settings.items()]
    for arm in study.arms:
        changes = ", ".join(f"{key} = {charts.value_text(value)}" for key, value in arm.settings.items())
        rows.append([words(arm.name), words("arm"), words(changes or "as the scenario has it")])
    cells = sum(len(entry.scenario.followers) for entry in plan.entries)
    how = "every combination" if study.design == "factorial" else study.design
    text = (
        f"{many(len(plan.points), 'point')} ({how}), {many(len(plan.arms), 'arm')}, {many(study.seas, 'sea')} and "
        f"{many(study.runs, 'run')} of noise for each: {many(plan.flights, 'flight')}, "
        f"{many(cells * study.runs, 'run')}. "
    )
    text += "Arms fly on the same noise and the same seas. " if len(plan.arms) > 1 else ""
    text += (
        "Intervals are 95 %, for the mean over all seas that might have been drawn."
        if study.seas > 1
        else "Intervals are 95 %, for other noise on the same sea; what other seas would do they do not say."
    )
    blocks: list[Block] = [Text(text=text)]
    calm = all(entry.scenario.ocean.waves.kind == "none" for entry in plan.entries)
    idle = [draw.key for draw in study.draws if calm and draw.key.startswith("ocean.waves.")]
    if idle:
        blocks.append(Notice(text=f"{', '.join(idle)}: drawn, but no point has waves (ocean.waves.kind), so that it "
                             "changes nothing.", tone="warning"))  # fmt: skip
    return [*blocks, Table(heads=("key", "how", "values"), rows=rows)] if rows else blocks


def _varied(plan: Plan) -> list[str]:
    """Factors of more than one value."""
    return [factor.key for factor in plan.study.factors if len(levels(plan, factor.key)) > 1]


def _wants_lines(plan: Plan) -> bool:
    """Whether lines over a factor are drawn: of several factors only where the study asks for them."""
    report = plan.study.report
    return len(_varied(plan)) < 2 or any((report.against, report.lines, report.panels))


def _main(plan: Plan, results: Results) -> list[Block]:
    """Figures of the report's metric: main effects, maps over two factors or points of a sample, lines if asked for."""
    metric, blocks = plan.study.report.metric, list[Block]()
    label, what = METRICS[metric].label, METRICS[metric].what
    if effects := main_effects(plan, results, metric):
        rest = f"; {INTERACTIONS}: what no factor explains alone" if INTERACTIONS in effects else ""
        caption = f"Share of the variance of {label} over all points that each factor alone explains{rest}; bars: 95 %."
        blocks.append(Figures(panels=[charts.effect_bars(effects)], caption=caption))
    valued = charts.place_values(plan, results, metric)
    if plan.study.design != "factorial":
        panels: list[str] = []
        legend: Legend = []
        for i, factor in enumerate(plan.study.factors[: charts.MOST_PANELS]):
            over = charts.Layout(factor.key, ARM if len(plan.arms) > 1 else "", ())
            drawn, legend = charts.over_factor(plan, over, valued, label, f"scatter{i}-", zero=False)
            panels += drawn
        caption = f"{what}; a mark for each point of the design, with its interval."
        return [*blocks, Figures(panels=panels, caption=caption, legend=legend)]
    layout, varied = charts.layout_of(plan), _varied(plan)
    if not layout.against:
        return [Text(text=f"{label}: {shown(results.estimate(next(iter(results.rows)), metric))}.")]
    if len(varied) >= 2:
        across = layout.against if layout.against in varied else varied[0]
        up = next(key for key in varied if key != across)
        others = [key for key in varied if key not in (across, up)] + [ARM] * (len(plan.arms) > 1)
        maps = charts.heat_maps(plan, valued, (across, up), charts.combinations(plan, others)[: charts.MOST_PANELS])
        caption = f"{label} over {charts.label_of(across)} and {charts.label_of(up)}, one colour scale."
        blocks.append(Figures(panels=maps, caption=caption))
    if _wants_lines(plan):
        panels, legend = charts.over_factor(plan, layout, valued, label, "main", zero=False)
        caption = f"{what[0].upper()}{what[1:]} over {charts.label_of(layout.against)}"
        caption += f", a line for each {charts.label_of(layout.lines)}" if layout.lines else ""
        hidden = len(charts.combinations(plan, layout.panels)) - len(panels)
        caption += f"; {hidden} panels are left out" if hidden > 0 else ""
        if panels:
            blocks.append(Figures(panels=panels, caption=f"{caption}.", legend=legend))
    return blocks


def _differences(plan: Plan, results: Results) -> list[Block]:
    metric, base = plan.study.report.metric, plan.arms[0]
    layout, label = charts.layout_of(plan), METRICS[metric].label
    blocks: list[Block] = [
        Text(text=f"Each arm less {base}, run by run on the same noise and the same sea; below zero the arm is lower.")
    ]
    others = plan.arms[1:]
    places = [name for name in (layout.against, layout.lines, *layout.panels) if name and name != ARM]
    if places and plan.study.design == "factorial" and _wants_lines(plan):
        valued = charts.place_values(plan, results, metric, base)
        trimmed = charts.Layout(places[0], ARM, tuple(places[1:]))

        def of_others(here: dict[str, object]) -> Interval | None:
            return valued(here) if here[ARM] in others else None

        panels, legend = charts.over_factor(plan, trimmed, of_others, f"difference: {label}", "apart", zero=True)
        if panels:
            blocks.append(Figures(panels=panels, caption="Paired differences with 95 % intervals.", legend=legend))
    tones = {"lower": "yes", "higher": "no", "open": "maybe"}
    rows = [
        [*_labels(plan, place), _cell(apart), words(_verdict(apart), tones[_verdict(apart)])]
        for place, apart in _differing(plan, results).items()
    ]
    return [*blocks, Table(heads=[*_heads(plan), f"difference: {label}", "verdict"], rows=rows)]


def _heads(plan: Plan) -> list[str]:
    heads = ["point", *(charts.label_of(factor.key) for factor in plan.study.factors)]
    heads += ["arm"] if len(plan.arms) > 1 else []
    return heads + (["follower"] if len(plan.followers) > 1 else [])


def _labels(plan: Plan, place: Place) -> list[Cell]:
    cells = [number(place[0])]
    for value in plan.points[place[0]].values():
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        cells.append(Cell(text=charts.value_text(value), sort=value if numeric else ""))
    cells += [words(place[1])] if len(plan.arms) > 1 else []
    return cells + ([words(place[2])] if len(plan.followers) > 1 else [])


def _table(plan: Plan, results: Results) -> Table:
    metric = plan.study.report.metric
    columns = list(dict.fromkeys([metric, METRIC, "e_p_p95_m", "e_b_mean_deg", "captured", "off_place_rms_m",
                                  "depth_error_rms_m", "closest_approach_m", "energy_j"]))  # fmt: skip
    rows = [
        [*_labels(plan, place), *(_cell(results.estimate(place, column)) for column in columns)]
        for place in results.rows
    ]
    caption = "Means with 95 % intervals where there are any; columns sort by a click. All else is in results.parquet."
    return Table(heads=[*_heads(plan), *(METRICS[column].label for column in columns)], rows=rows, caption=caption)


def _failures(plan: Plan, failures: Mapping[str, list[Entry]]) -> list[Block]:
    blocks: list[Block] = []
    for what, entries in failures.items():
        first = entries[0]
        where = place_text(plan, (first.point, first.arm, plan.followers[0]))
        text = f"{what}: {len(entries)} scenarios, the first at {where}, sea {first.sea}"
        blocks.append(Notice(text=text, tone="failure"))
    return blocks


def notable(plan: Plan, results: Results, place: Place) -> tuple[tuple[int, int], tuple[int, int]]:
    """Sea and run of the worst and of the median run of a place, by the report's metric if single runs have it."""
    metric = plan.study.report.metric
    runs = results.by_run(place, metric) or results.by_run(place, METRIC)
    if runs is None:
        raise LaisnError(f"the runs of {place_text(plan, place)} have no {METRIC}")
    seas = [row["sea"] for row in results.rows[place]]
    # a run that contact ended has no value, and is the first to look at
    every = sorted(
        (math.inf if math.isnan(value) else value, sea, run)
        for sea, values in zip(seas, runs, strict=True)
        for run, value in enumerate(values.tolist())
    )
    worst, median = every[-1], every[(len(every) - 1) // 2]
    return worst[1:], median[1:]


def worst_entry(plan: Plan, results: Results) -> tuple[Entry, int, str]:
    """The scenario, run and follower of the worst run of the worst place."""

    def size(place: Place) -> float:
        value = results.estimate(place, plan.study.report.metric).value
        return -math.inf if math.isnan(value) else value

    place = max(results.rows, key=size)
    (sea, run), _ = notable(plan, results, place)
    return plan.by_place[place[0], place[1], sea], run, place[2]


def commands(plan: Plan, results: Results) -> str:
    """For every place the commands that fly its worst and its median run alone."""
    lines = []
    for place in list(results.rows)[:_MOST_COMMANDS]:
        for which, (sea, run) in zip(("worst", "median"), notable(plan, results, place), strict=True):
            sea_text = f" of sea {sea}" if plan.study.seas > 1 else ""
            lines.append(f"# {place_text(plan, place)}: {which} run, {run}{sea_text}")
            lines.append(plan.by_place[place[0], place[1], sea].command(plan.study.scenario, run))
    return "\n".join(lines)


def page_of(plan: Plan, results: Results, failures: Mapping[str, list[Entry]], film: Path | None = None) -> Page:
    """The page of a study; `failures` are entries that could not be flown, by what happened, `film` its worst run."""
    study, metric = plan.study, plan.study.report.metric
    asked = study.question or f"How does this metric depend on what is varied: {METRICS[metric].what}?"
    answer = [Text(text=asked), *_failures(plan, failures), *_main(plan, results)]
    sections = [Section(title="Question and answer", blocks=answer)]
    if len(plan.arms) > 1:
        sections.append(Section(title="Differences of arms", blocks=_differences(plan, results)))
    if study.seas > 1:
        panels, legend = charts.over_seas(plan, results, metric)
        blocks: list[Block] = []
        if panels:
            blocks.append(Figures(panels=panels, legend=legend, caption="Share of seas whose mean is below a value."))
        drawn = charts.over_draws(plan, results, metric, 0) if study.seas >= _FEWEST_SEAS else []
        if drawn:
            caption = f"Means of single seas over what they drew, at {place_text(plan, next(iter(results.rows)))}."
            blocks.append(Figures(panels=drawn, legend=legend, caption=caption))
        sections.append(Section(title="Seas", blocks=blocks))
    sections.append(Section(title="Table", blocks=[_table(plan, results)]))
    sections.append(Section(title="Design", blocks=_design(plan)))
    looking: list[Block] = [
        Text(text="Each line flies a run alone, with the very same noise, and films it."),
        Code(text=commands(plan, results), title="Worst and median run of every place", folded=len(results.rows) > 4),
    ]
    if film is not None:
        looking.insert(0, Film(path=film, caption="The worst run of the worst place."))
    sections.append(Section(title="Runs to look at", blocks=looking))
    rows = [row for rows in results.rows.values() for row in rows]
    facts = [
        ("scenario", study.scenario),
        ("seed", str(int(np.min([row["seed"] for row in rows])))),
        ("runs", str(study.runs)),
        ("seas", str(study.seas)),
        ("repeat it", "laisn study study.toml, the file in this folder"),
    ]
    if plan.arms != (ALONE,):
        facts.insert(1, ("arms", ", ".join(plan.arms)))
    return Page(title=study.name, summary=summary_of(plan, results), facts=facts, sections=sections)

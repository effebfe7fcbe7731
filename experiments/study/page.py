"""The page of a study: values, tables and figures of its template, `page.md.j2`, and the runs to
look at.
"""

import math
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from experiments.flight.library import fly_line
from experiments.study import charts
from experiments.study.design import is_number
from experiments.study.estimate import (
    INTERACTIONS,
    Condition,
    Results,
    interval_text,
    main_effects,
    verdict_of,
    verdicts_text,
)
from experiments.study.file import METRIC, Arm, Study
from experiments.study.measure import METRICS, Metric
from experiments.study.plan import PlanEntry, StudyPlan, engines_of, idle_keys, many, varied
from experiments.study.run import largest_half_width
from laisn.plugins import plugin_options
from reports import page as pages
from reports.intervals import FEWEST_RUNS, Interval
from reports.page import Code, Film, Page, Replay, TableCell, Tile, number, words
from sim.scenario.settings import Scenario

_MAX_COMMAND_PLACES = 400  # places whose runs have commands
_MAX_ANSWERS = 12  # places of the table on the terminal
_MAX_ARMS = 3  # arms with a key figure of their own
_DECIDES = 0.5  # least share of the variance of the factor that decides
_MAX_ROWS = 60  # places in a table; of more, those of the lowest and highest values are listed
_TONES = {"lower": "yes", "higher": "no", "undecided": "maybe", "same": ""}
_COLUMNS = (
    METRIC,
    "e_p_p95_m",
    "e_b_mean_deg",
    "mirror_locked",
    "track_error_rms_m",
    "depth_error_rms_m",
    "closest_approach_m",
    "energy_j",
)
"""Columns of the page's table beside the metric of the report."""


def _place_text(plan: StudyPlan, condition: Condition) -> str:
    """A place in words: its point, and arm and follower where there are several."""
    parts = []
    if plan.points[condition.point]:
        parts.append(charts.point_text(plan.points[condition.point]))
    if len(plan.arms) > 1:
        parts.append(f"arm {condition.arm}")
    if len(plan.followers) > 1:
        parts.append(condition.follower)
    return ", ".join(parts) or "the study's only point"


def _cell(interval: Interval) -> TableCell:
    return TableCell(text=interval_text(interval), sort=number(interval.value).sort)


def worst_and_median_run(
    plan: StudyPlan, results: Results, condition: Condition
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Realization and run of the worst and the median run of a place, by the report's metric if
    single runs have it.
    """
    runs = (
        results.by_run(condition, plan.study.file.report.metric)
        or results.by_run(condition, METRIC)
        or []
    )
    # a run that contact ended has no value, and is the first to look at
    ranked_runs = sorted(
        (math.inf if math.isnan(value) else value, row["realization"], int(run))
        for row, lists, values in zip(
            results.rows[condition], results.runs[condition], runs, strict=True
        )
        for run, value in zip(lists["run"], values.tolist(), strict=True)
    )
    return ranked_runs[-1][1:], ranked_runs[(len(ranked_runs) - 1) // 2][1:]


def _altered_by(plan: StudyPlan, entry: PlanEntry) -> str:
    """The key of a study that alters what is measured in an entry beside the scenario's keys; empty
    if there is none.
    """
    if plan.study.disturb_at(plan.points[entry.point], entry.arm):
        return "disturb"
    return "" if plan.study.arm(entry.arm).leader_pitch_deg is None else "leader_pitch_deg"


def _measured(results: Results, condition: Condition, entry: PlanEntry) -> dict[str, Any]:
    """Values that `measured` keys of an entry took of the mission."""
    rows = results.rows[condition]
    row = next(row for row in rows if row["realization"] == entry.realization)
    return {key: row[key] for key in entry.measured}


class WorstRun(NamedTuple):
    """The worst run of the worst place that a flight can repeat."""

    entry: PlanEntry
    run: int
    follower: str
    scenario: Scenario  # of the run


def worst_run(plan: StudyPlan, results: Results) -> WorstRun | None:
    """None if a flight can repeat no run."""

    def size(condition: Condition) -> float:
        value = results.estimate(condition, plan.study.file.report.metric).value
        return -math.inf if math.isnan(value) else value

    for condition in sorted(results.rows, key=size, reverse=True):
        (realization, run), _ = worst_and_median_run(plan, results, condition)
        entry = plan.by_design_key[condition.point, condition.arm, realization]
        if not _altered_by(plan, entry):
            scenario = entry.scenario_at(run, _measured(results, condition, entry))
            return WorstRun(entry, run, condition.follower, scenario)
    return None


def commands(plan: StudyPlan, results: Results) -> str:
    """For the first places the commands that fly the worst and the median run alone."""
    lines = []
    for condition in list(results.rows)[:_MAX_COMMAND_PLACES]:
        for extreme, (realization, run) in zip(
            ("worst", "median"), worst_and_median_run(plan, results, condition), strict=True
        ):
            realization_text = (
                f" of realization {realization}" if plan.study.file.realizations > 1 else ""
            )
            lines.append(
                f"# {_place_text(plan, condition)}: {extreme} run, {run}{realization_text}"
            )
            entry = plan.by_design_key[condition.point, condition.arm, realization]
            altered_by = _altered_by(plan, entry)
            if altered_by:
                lines.append(f"# laisn fly has no {altered_by}: only the study flies it")
                continue
            measured = _measured(results, condition, entry)
            options = plugin_options(entry.scenario.model_dump_json())
            lines.append(fly_line(entry.source, entry.settings_at(run) | measured, run, options))
    return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class StudyPage:
    """What the template of a study's page shows. A place is a `Condition` of its results."""

    plan: StudyPlan
    results: Results
    failures: Mapping[str, list[PlanEntry]]  # entries that could not be flown, by what happened
    looks: Sequence[Film | Replay] = ()  # the worst run of the study, in 3D, filmed or both

    @property
    def study(self) -> Study:
        return self.plan.study

    @property
    def metric(self) -> Metric:
        """The metric of the report."""
        return METRICS[self.study.file.report.metric]

    @property
    def columns(self) -> list[str]:
        """Metrics of the table beside that of the report."""
        return [name for name in _COLUMNS if name != self.study.file.report.metric]

    @property
    def question_text(self) -> str:
        """What the study asks."""
        question = " ".join(self.study.file.question.split())
        return question or f"How does the {self.metric.meaning} depend on what is varied?"

    @property
    def tiles(self) -> list[Tile]:
        """Lowest and highest value of the metric, the factor that decides, and where arms differ
        from the first one.
        """
        names = ("lowest", "highest") if len(self.extremes) > 1 else ("value",)
        tiles = [
            Tile(
                name=f"{name} {self.metric.label.partition(' [')[0]}",
                value=text,
                remark=self.place_text(condition),
            )
            for name, (condition, text) in zip(names, self.extremes, strict=True)
        ]
        name, effect = next(iter(self.effects.items()), ("", None))
        if effect is not None and effect.low > _DECIDES and name != INTERACTIONS:
            words_of_factor = charts.label_of(name).partition(" [")[0]
            remark = f"{100 * effect.value:.0f} % of the variance between places"
            tiles.append(Tile(name="what decides", value=words_of_factor, remark=remark))
        for arm, counts in list(self.verdict_counts.items())[:_MAX_ARMS]:
            total = counts.total()
            remark = f"of {total} places, " if total > 1 else ""
            remark += f"against {self.plan.arms[0]}"
            tiles.append(Tile(name=arm, value=verdicts_text(counts), remark=remark))
        return tiles

    @property
    def several_arms(self) -> bool:
        return len(self.plan.arms) > 1

    @property
    def several_followers(self) -> bool:
        return len(self.plan.followers) > 1

    @cached_property
    def factors(self) -> list[str]:
        """Factors of more than one value."""
        return varied(self.plan)

    @property
    def factorial(self) -> bool:
        return self.study.file.design == "factorial"

    @cached_property
    def layout(self) -> charts.ChartLayout:
        """Of the main figure."""
        return charts.layout_of(self.plan)

    @property
    def has_lines(self) -> bool:
        """Whether the metric is drawn over one factor."""
        report = self.study.file.report
        states_layout = any((report.against, report.lines, report.panels))
        return self.factorial and (states_layout or len(self.factors) < 2)

    @property
    def map_axes(self) -> list[str]:
        """The two factors over which the metric is drawn as a map, that of the main figure across;
        none of fewer.
        """
        if not self.factorial or len(self.factors) < 2:
            return []
        first = self.layout.against if self.layout.against in self.factors else self.factors[0]
        return [first, *(name for name in self.factors if name != first)][:2]

    @cached_property
    def estimates(self) -> dict[Condition, Interval]:
        """The metric of the report at all places."""
        metric = self.study.file.report.metric
        return {
            condition: self.results.estimate(condition, metric) for condition in self.results.rows
        }

    @cached_property
    def ranked(self) -> list[Condition]:
        """Places with a value, the lowest first."""
        measured = [
            condition
            for condition, estimate in self.estimates.items()
            if not math.isnan(estimate.value)
        ]
        return sorted(measured, key=lambda condition: self.estimates[condition].value)

    @property
    def has_intervals(self) -> bool:
        """Whether any value has limits."""
        return any(not math.isnan(estimate.low) for estimate in self.estimates.values())

    @property
    def interval_notes(self) -> list[str]:
        """Why there are no intervals, or wide ones."""
        file = self.study.file
        notes = []
        # findings of a built-in study, or `runs.until`, may have flown more runs than the file asks
        # for, and an arm with `every` has fewer
        runs = [sum(len(lists["run"]) for lists in of) for of in self.results.runs.values()]
        few = sorted({number for number in runs if number < FEWEST_RUNS})
        if file.realizations == 1 and few:
            count = sum(number < FEWEST_RUNS for number in runs)
            where = "" if count == len(runs) else f" at {count} of {len(runs)} places"
            numbers = " or ".join(map(str, few)) if len(few) < 3 else f"{few[0]} to {few[-1]}"
            notes.append(
                f"no intervals and no verdicts{where}: they need {FEWEST_RUNS} runs of a "
                f"realization, there are {numbers}"
            )
        until = self.study.until
        half_width = largest_half_width(self.results, until.metric) if until else 0.0
        if until and half_width > until.half_width:
            notes.append(
                f"after {until.most} runs, the most of runs.until, an interval of {until.metric} "
                f"has half a width of {half_width:.3g}, not {until.half_width:g}"
            )
        return notes

    @property
    def extremes(self) -> list[tuple[Condition, str]]:
        """The places of the lowest and the highest value, and these in words."""
        places = self.ranked if len(self.ranked) < 2 else [self.ranked[0], self.ranked[-1]]
        return [
            (condition, interval_text(self.estimates[condition], self.metric.unit))
            for condition in places
        ]

    @cached_property
    def listed_places(self) -> list[Condition]:
        """Places of the table: all, or of too many the lowest and the highest."""
        if len(self.results.rows) <= _MAX_ROWS:
            return list(self.results.rows)
        half_rows = _MAX_ROWS // 2
        return self.ranked[:half_rows] + self.ranked[-half_rows:]

    @cached_property
    def differences(self) -> dict[Condition, Interval]:
        """Paired differences from the first arm."""
        return self.results.differences(self.plan.arms[0], self.study.file.report.metric)

    @cached_property
    def verdicts(self) -> dict[Condition, str]:
        """What the differences decide."""
        verdicts = {}
        for condition, difference in self.differences.items():
            base = self.estimates[condition._replace(arm=self.plan.arms[0])]
            verdicts[condition] = verdict_of(
                difference, self.estimates[condition].value, base.value
            )
        return verdicts

    def verdict(self, condition: Condition) -> TableCell:
        """A verdict, coloured."""
        verdict = self.verdicts[condition]
        return words(verdict, _TONES[verdict])

    @property
    def verdict_counts(self) -> dict[str, Counter[str]]:
        """How often each verdict is that of an arm, of those that have any."""
        counts = {
            arm: Counter(
                verdict for condition, verdict in self.verdicts.items() if condition.arm == arm
            )
            for arm in self.plan.arms[1:]
        }
        return {arm: of_arm for arm, of_arm in counts.items() if of_arm}

    @cached_property
    def effects(self) -> dict[str, Interval]:
        """Main effects of the factors."""
        return main_effects(self.plan, self.results, self.study.file.report.metric)

    @property
    def effects_first(self) -> bool:
        """Whether they stand before the figures."""
        return bool(self.effects) and len(self.factors) > 2

    @property
    def idle_keys(self) -> dict[str, str]:
        """Keys of the study that have no effect in any mission, with the reasons."""
        return idle_keys(self.plan)

    @property
    def look_text(self) -> str:
        """What is shown of the worst run."""
        altered = any(_altered_by(self.plan, entry) for entry in self.plan.entries)
        which = " that a flight can repeat" if altered else ""
        return f"The worst run of the worst place{which}."

    @property
    def commands(self) -> Code:
        return Code(
            text=commands(self.plan, self.results),
            title="Worst and median run of every place",
            folded=len(self.results.rows) > 4,
        )

    def entry_text(self, entry: PlanEntry) -> str:
        """The place of an entry's first follower in words."""
        return self.place_text(Condition(entry.point, entry.arm, self.plan.followers[0]))

    def place_text(self, condition: Condition) -> str:
        """A place in words."""
        return _place_text(self.plan, condition)

    @property
    def facts(self) -> list[tuple[str, str]]:
        """What stands beside the title."""
        seeds = [row["seed"] for rows in self.results.rows.values() for row in rows]
        words = ["laisn", "study", "study.toml", *plugin_options(self.plan.text)]
        facts = [("scenario", ", ".join(self.study.scenarios))]
        if self.study.arms:
            facts.append(("arms", ", ".join(self.plan.arms)))
        return [
            *facts,
            ("seed", str(min(seeds))),
            ("runs", str(self.study.runs)),
            ("realizations", str(self.study.file.realizations)),
            ("engine", ", ".join(engines_of(self.plan))),
            ("repeat it", f"{shlex.join(words)}, the file in this folder"),
        ]


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The answer of a study as a small table of text."""

    question: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    remark: str  # which places are left out; empty: none


def answer(plan: StudyPlan, results: Results) -> Answer:
    """The metric of the report at every place, or at the lowest and highest of many, with
    differences of arms.
    """
    page = StudyPage(plan=plan, results=results, failures={})
    places = list(results.rows)
    if len(places) > _MAX_ANSWERS:
        half_answers = _MAX_ANSWERS // 2
        places = page.ranked[:half_answers] + page.ranked[-half_answers:]
    heads = ["where", page.metric.label]
    if page.several_arms:
        heads += [f"less {plan.arms[0]}", "verdict"]
    rows = []
    for condition in places:
        row = [page.place_text(condition), interval_text(page.estimates[condition])]
        if page.several_arms:
            is_compared = condition in page.differences
            row.append(interval_text(page.differences[condition]) if is_compared else "–")
            row.append(page.verdicts[condition] if is_compared else "")
        rows.append(tuple(row))
    remarks = page.interval_notes
    if len(places) < len(results.rows):
        remarks.append(f"the lowest and highest of {len(results.rows)} places")
    return Answer(
        question=page.question_text,
        heads=tuple(heads),
        rows=tuple(rows),
        remark="; ".join(remarks),
    )


def _factor_cell(value: Any) -> TableCell:
    return TableCell(text=charts.value_text(value), sort=value if is_number(value) else "")


def _listed(values: Iterable[Any]) -> str:
    return ", ".join(map(charts.value_text, values))


def _changes(arm: Arm) -> str:
    """What an arm sets, in words."""
    settings = dict(arm.settings)
    if arm.leader_pitch_deg is not None:
        settings["leader_pitch_deg"] = arm.leader_pitch_deg
    settings |= {f"disturb.{key}": value for key, value in arm.disturb.items()}
    return ", ".join(f"{key} = {charts.value_text(value)}" for key, value in settings.items())


_FORMATS: dict[str, Any] = {
    "charts": charts,
    "metrics": METRICS,
    "words": words,
    "verdicts_text": verdicts_text,
    "many": many,
    "cell": _cell,
    "factor_cell": _factor_cell,
    "listed": _listed,
    "changes": _changes,
}
"""Functions and tables with which the template writes, by their names there."""


def page_of(
    plan: StudyPlan,
    results: Results,
    failures: Mapping[str, list[PlanEntry]],
    looks: Sequence[Film | Replay] = (),
) -> Page:
    """The page of a study; arguments as of `StudyPage`."""
    page = StudyPage(plan=plan, results=results, failures=failures, looks=looks)
    values = {"page": page, "plan": plan, "study": plan.study, "results": results, **_FORMATS}
    return pages.page_of(
        "experiments.study", page.facts, values, tiles=page.tiles, question=page.question_text
    )

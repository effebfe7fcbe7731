"""Flying a study: missions in parallel, each once, then cells; all of it stored, and gone on
with after a kill.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import chain, compress
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, Self, Unpack

import numpy as np
import pyarrow as pa

from experiments.campaign import campaign
from experiments.campaign.campaign import (
    CampaignResults,
    ExecutionOptions,
    FlightCompilers,
    SideBySide,
    Task,
)
from experiments.campaign.plans import CellPlan
from experiments.campaign.store import Arrays, CampaignError, Record, Store, columns_of
from experiments.flight.fly import fly
from experiments.study.estimate import Results
from experiments.study.file import Until
from experiments.study.measure import facts_of, records_of_run, records_of_runs
from experiments.study.plan import PlanEntry, StudyPlan
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.simd import LANES
from sim.scenario.settings import CONTROL_STEP_S, Video
from sim.trajectory import Trajectory

# largest factor by which runs grow from one look at their intervals to the next
_MAX_GROWTH = 10.0
# states of vehicles that runs side by side keep at most: a quarter of a gigabyte
_MOST_STATES = 1_000_000
_TABLE_ROWS = 60_000  # of a part of runs.parquet, as of `run_tables`


class Cells(NamedTuple):
    """Rows of a study, one for each entry and follower, with their lists over runs and, where they
    are kept, errors over time.
    """

    rows: Sequence[Record]
    lists: Sequence[Mapping[str, Any]]  # values of the runs by column, shape (R,) each
    steps: Sequence[Arrays] = ()  # as of `StudyResults.steps`

    def where(self, **columns: object) -> "Cells":
        """Those whose rows have these values."""
        return self._take(
            [all(row.get(k) == value for k, value in columns.items()) for row in self.rows]
        )

    def by(self, *keys: str) -> dict[str, "Cells"]:
        """Cells by the values that they have of keys, as text with spaces between them."""
        names = [
            " ".join(f"{row[k]:g}" if isinstance(row[k], float) else str(row[k]) for k in keys)
            for row in self.rows
        ]
        return {
            name: self._take([other == name for other in names]) for name in dict.fromkeys(names)
        }

    def values_by_run(self, metric: str) -> Floats:
        """A metric run by run, shape (R, m) for m cells; where runs share the mission, that of the
        mission.
        """
        values_by_cell = [
            lists[metric] if metric in lists else [row.get(metric)] * len(lists["run"])
            for row, lists in zip(self.rows, self.lists, strict=True)
        ]
        return np.array(values_by_cell, dtype=np.float64).T

    def _take(self, mask: Sequence[bool]) -> "Cells":
        rows, lists, steps = ([*compress(column, mask)] for column in self)
        return Cells(rows, lists, steps)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class StudyResults:
    """All that came out of a study, one entry beside another."""

    plan: StudyPlan
    rows: list[Record]
    # one pair for each entry and follower: what it is, and lists over runs by name
    runs: list[tuple[Record, Record]]
    steps: list[Arrays]
    """Errors over time of each entry and follower, as of `steps_of`; empty where the study keeps
    none.
    """
    store: Store
    # entries that could not be flown, by what happened
    failures: dict[str, list[PlanEntry]] = field(default_factory=dict)

    @property
    def cells(self) -> Cells:
        """Rows with their lists."""
        return Cells(self.rows, [lists for _, lists in self.runs], self.steps)

    def motion(self, entry: PlanEntry) -> Trajectory:
        """The motion of the mission of an entry."""
        return campaign.mission(entry.scenario, self.store)

    @cached_property
    def results(self) -> Results:
        """Rows and runs by place."""
        return Results.of(self.rows, self.runs)


def _row_and_lists(
    entry: PlanEntry, follower: int, runs: Sequence[list[Record]]
) -> tuple[Record, Record]:
    """Row and lists over runs of a follower of a closed loop."""
    lists = columns_of([records[follower] for records in runs])
    row: Record = {
        "variant": entry.scenario.navigation_of(follower).variant,
        "seed": entry.scenario.seed,
        "runs": len(runs),
    }
    for name, values in lists.items():
        finite = np.array(values, dtype=np.float64)
        finite = finite[np.isfinite(finite)]
        if not finite.size:
            row[name] = None
        elif name.endswith(("_max_m", "_max_deg")):
            row[name] = float(finite.max())
        elif name.startswith("closest_"):
            row[name] = float(finite.min())
        elif "_rms_" in name:
            row[name] = float(np.sqrt(np.mean(finite**2)))
        elif name not in ("run", "mirror_locked", "gated"):
            row[name] = float(finite.mean())
    # `ended` stays as a share too
    for count, name in (
        ("mirror_locked_runs", "mirror_locked"),
        ("fixes_gated", "gated"),
        ("ended_runs", "ended"),
    ):
        row[count] = sum(int(value or 0) for value in lists[name])
    row["worst_run"] = int(
        lists["run"][int(np.argmax([value or 0.0 for value in lists["e_p_max_m"]]))]
    )
    return row, lists


def _labels(plan: StudyPlan, entry: PlanEntry, follower: int) -> Record:
    draws = {draw.key: entry.settings[draw.key] for draw in plan.study.draws}
    name = entry.scenario.followers[follower].name
    entry_labels = {"arm": entry.arm, "realization": entry.realization, "follower": name}
    point = plan.points[entry.point]
    return {
        "point": entry.point,
        **point,
        **plan.study.case_at(point).labels,
        **entry_labels,
        **draws,
    }


def _cells(plan: StudyPlan, entry: PlanEntry) -> list[CellPlan]:
    """The cells of an entry, one for each follower."""
    study = plan.study
    point = plan.points[entry.point]
    scenario = entry.scenario
    first = CellPlan(
        scenario=scenario,
        runs=study.runs,
        first_run=scenario.run,
        lag_s=study.file.bound_lag_s,
        keep_steps=study.file.steps or study.case_at(point).steps,
        leader_pitch_deg=study.arm(entry.arm).leader_pitch_deg,
        disturb=study.disturb_at(point, entry.arm),
        measured=entry.measured,
        facts=facts_of if entry.measured else None,
    )
    # `CellPlan` replaces its scenario by that of its follower's navigation, so pass the original
    # again
    return [replace(first, scenario=scenario, follower=i) for i in range(len(scenario.followers))]


def fly_studies(
    plans: Sequence[StudyPlan], folder: Path, **options: Unpack[ExecutionOptions]
) -> list[StudyResults]:
    """Fly studies, which share missions and cells, together, or what is missing of them; as of
    `campaign.fly`.

    Each has rows in the order of its plan: the same whatever the workers and interruptions.
    """
    flights = [
        _EntryFlight.of(study_index, plan, entry)
        for study_index, plan in enumerate(plans)
        for entry in plan.entries
    ]
    cells = [cell for flight in flights for cell in flight.cells]
    tasks = {name: task for flight in flights for name, task in flight.tasks.items()}
    campaign_results = campaign.fly(
        cells,
        tasks,
        folder,
        facts=facts_of,
        together=[flight.together for flight in flights if flight.tasks],
        compilers=_compilers(flights),
        tolerant=True,
        **options,
    )
    studies = [
        StudyResults(plan=plan, rows=[], runs=[], steps=[], store=campaign_results.store)
        for plan in plans
    ]
    for flight in flights:
        _add_results(studies[flight.study_index], flight, campaign_results)
    return studies


def _records_of_tasks(tasks: Sequence[Task]) -> list[list[Record] | None]:
    """Rows of tasks of closed loops, side by side."""
    return records_of_runs([task.args for task in tasks])


@dataclass(frozen=True, kw_only=True, slots=True)
class _EntryFlight:
    """What is flown for an entry of a study: cells of one mission, or tasks of a closed loop."""

    study_index: int  # of its plan among those flown together
    plan: StudyPlan
    entry: PlanEntry
    cells: Sequence[CellPlan]  # one for each follower
    tasks: Mapping[Any, Task]  # one for each run

    @classmethod
    def of(cls, study_index: int, plan: StudyPlan, entry: PlanEntry) -> Self:
        cells: list[CellPlan] = []
        tasks: dict[Any, Task] = {}
        if entry.closed_loop:
            for run in plan.runs_of(entry):
                # no number depends on the film
                scenario = entry.scenario_at(run).model_copy(update={"video": Video()})
                tasks[study_index, entry.design_key, run] = partial(records_of_run, scenario, run)
        else:
            cells = _cells(plan, entry)
        return cls(study_index=study_index, plan=plan, entry=entry, cells=cells, tasks=tasks)

    @property
    def together(self) -> SideBySide:
        """Its runs, as many side by side as there is memory for."""
        scenario = self.entry.scenario
        instants = round(scenario.duration_s / CONTROL_STEP_S)
        states = instants * (1 + len(scenario.followers))
        most = min(LANES, _MOST_STATES // states) if scenario.timing.engine == "direct" else 1
        return SideBySide(names=list(self.tasks), compute=_records_of_tasks, most=max(most, 1))

    def failure(self, campaign_results: CampaignResults) -> str | None:
        """Why it could not be flown."""
        names = list(self.tasks) or [self.entry.motion_key]
        return next(
            (
                campaign_results.failures[name]
                for name in names
                if name in campaign_results.failures
            ),
            None,
        )

    def result(
        self, follower: int, campaign_results: CampaignResults
    ) -> tuple[Record, Record, Arrays]:
        """Row, lists over runs, and errors over time of a follower."""
        if self.tasks:
            runs = [campaign_results.tasks[name] for name in self.tasks]
            row, lists = _row_and_lists(self.entry, follower, runs)
            return row, lists, {}
        cell = self.cells[follower]
        row, arrays = campaign_results.cell(cell)
        row |= {key: row[name] for key, name in self.entry.measured.items()}
        return row, arrays, campaign_results.steps(cell) if cell.keep_steps else {}


def _compilers(flights: Sequence[_EntryFlight]) -> FlightCompilers | None:
    """What compiles the runs of closed loops, and the flight that the page of a study looks at."""
    if not flights:
        return None
    first_with_tasks = next((flight for flight in flights if flight.tasks), None)
    short = (first_with_tasks or flights[0]).entry.scenario.first_messages
    runs = [(short, run) for run in range(1, LANES + 1)]
    side_by_side = partial(records_of_runs, runs) if first_with_tasks else None
    return FlightCompilers(partial(fly, short), side_by_side)


def _add_results(
    outcomes: StudyResults, flight: _EntryFlight, campaign_results: CampaignResults
) -> None:
    """Add what came of an entry to the outcomes of its study."""
    entry = flight.entry
    failure = flight.failure(campaign_results)
    if failure is not None:
        outcomes.failures.setdefault(failure, []).append(entry)
        return
    for follower in range(len(entry.scenario.followers)):
        row, lists, steps = flight.result(follower, campaign_results)
        labels = _labels(flight.plan, entry, follower)
        outcomes.rows.append(labels | row)
        outcomes.runs.append((labels, lists))
        outcomes.steps.append(steps)


def largest_half_width(results: Results, metric: str) -> float:
    """Half of the widest interval of a metric of runs; infinite where too few runs have it for
    an interval.
    """
    half_width = 0.0
    for condition in results.rows:
        runs = results.by_run(condition, metric)
        interval = results.estimate(condition, metric)
        if runs is None:
            raise LaisnError(f"runs.until.metric: {metric!r} is not a metric of single runs")
        # runs that are all alike have no limits either, and more would not give them any
        if not math.isnan(interval.low):
            half_width = max(half_width, (interval.high - interval.low) / 2)
        elif np.unique(runs[0][~np.isnan(runs[0])]).size > 1:
            half_width = math.inf
    return half_width


def runs_wanted(runs: int, half_width: float, until: Until, batch: int) -> int:
    """Total number of runs to fly before the next look at intervals, from the half-width of the
    widest so far; `runs` itself if no more are needed.

    Intervals narrow with the square root of their number (Stein, Ann. Math. Stat. 16, 1945).
    `tools.documents.coverage` measures how often the intervals then hold the truth.
    """
    if half_width <= until.half_width or runs >= until.most:
        return runs
    batches = math.ceil(runs * min((half_width / until.half_width) ** 2, _MAX_GROWTH) / batch)
    return min(batches * batch, until.most)


def _next_runs(outcomes: StudyResults) -> int:
    """Runs that a study has after a look at its intervals."""
    study = outcomes.plan.study
    if study.until is None:
        return study.runs
    half_width = largest_half_width(outcomes.results, study.until.metric)
    return runs_wanted(study.runs, half_width, study.until, study.file.batch)


def fly_until_narrow(
    plans: Sequence[StudyPlan], folder: Path, **options: Unpack[ExecutionOptions]
) -> list[StudyResults]:
    """Fly studies with as many runs as their files set: a number, or batches until all intervals
    are narrow enough.

    The number of runs after each look follows from the results alone. All places of a study have
    the same number, so that arms stay paired. The plans of the outcomes have the final numbers.

    Raises:
        LaisnError: as of `fly_studies`, or single runs do not have the metric.
    """
    while True:
        outcomes = fly_studies(plans, folder, **options)
        numbers = [_next_runs(study_results) for study_results in outcomes]
        if numbers == [plan.study.runs for plan in plans]:
            return outcomes
        plans = [plan.part(plan.entries, runs) for plan, runs in zip(plans, numbers, strict=True)]
        # only the first pass may discard stored results
        options |= {"force": False}


RunTotals = Mapping[tuple[int, str, int], int]
"""Total runs wanted, by point, arm and realization."""


def fly_further(
    outcomes: Mapping[str, StudyResults],
    choose: Callable[[Mapping[str, StudyResults]], Mapping[str, RunTotals]],
    folder: Path,
    **options: Unpack[ExecutionOptions],
) -> None:
    """Fly further runs until `choose`, given the outcomes, asks for none; it returns run totals by
    the names of outcomes.

    Changes the lists over runs of `outcomes` in place; rows stay those of the first runs.
    CampaignError: something cannot be flown.
    """
    place_of = itemgetter("point", "arm", "realization", "follower")
    options |= {"force": False}
    while True:
        totals_by_name = choose(outcomes)
        if not totals_by_name:
            return
        for name, totals in totals_by_name.items():
            plan = outcomes[name].plan
            lists_at = {place_of(labels): lists for labels, lists in outcomes[name].runs}
            # by the number of their further runs
            entries_by_runs = defaultdict[int, list[PlanEntry]](list)
            for design_key, total in totals.items():
                entry = plan.by_design_key[design_key]
                flown = len(lists_at[*design_key, entry.scenario.followers[0].name]["run"])
                scenario = entry.scenario.model_copy(update={"run": entry.scenario.run + flown})
                entries_by_runs[total - flown].append(replace(entry, scenario=scenario))
            plans = [plan.part(entries, runs) for runs, entries in entries_by_runs.items()]
            for results in fly_studies(plans, folder, **options):
                if results.failures:
                    raise CampaignError("; ".join(sorted(results.failures)))
                for labels, lists in results.runs:
                    lists_so_far = lists_at[place_of(labels)]
                    lists_so_far |= {
                        column: np.append(values, lists[column])
                        for column, values in lists_so_far.items()
                    }


def with_uniform_types(columns: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Columns of one type each: where a factor's values are of several, they stand as text."""
    for name, values in columns.items():
        kinds = {float if type(v) is int else type(v) for v in values if v is not None}
        if len(kinds) > 1:
            columns[name] = [None if v is None else str(v) for v in values]
    return columns


def run_tables(runs: Sequence[tuple[Record, Record]]) -> Iterator[pa.Table]:
    """Lists over runs as tables with a row for each run.

    Where all columns are arrays, several tables of about `_TABLE_ROWS` rows, to keep copies small;
    otherwise one. Where an entry lacks a column, its value is null.
    """
    label_table = pa.table(with_uniform_types(columns_of([labels for labels, _ in runs])))
    sample_columns = {name: values for _, lists in reversed(runs) for name, values in lists.items()}
    names = dict.fromkeys(name for _, lists in runs for name in lists)
    has_lists = not all(isinstance(values, np.ndarray) for values in sample_columns.values())
    sizes = np.array([len(next(iter(lists.values()))) for _, lists in runs])
    group = np.zeros_like(sizes) if has_lists else (sizes.cumsum() - sizes) // _TABLE_ROWS
    for number in np.unique(group):
        (indices,) = np.nonzero(group == number)
        columns: dict[str, Any] = {}
        values: Any
        for name in names:
            parts = [runs[i][1].get(name, [None] * sizes[i]) for i in indices.tolist()]
            if all(isinstance(column, np.ndarray) for column in parts):
                values = np.concatenate(parts)
            else:
                values = with_uniform_types({name: [*chain(*parts)]})[name]
            kind = None if has_lists else pa.from_numpy_dtype(sample_columns[name].dtype)
            columns[name] = pa.array(values, type=kind)
        rows = label_table.take(np.repeat(indices, sizes[indices]))
        yield pa.table(dict(zip(rows.column_names, rows.columns, strict=True)) | columns)

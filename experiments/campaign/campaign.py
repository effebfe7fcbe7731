"""Campaigns: a study's missions, cells and tasks, computed in parallel and stored one by one.

A design consists of cells, each a scenario with many runs of noise, and tasks, each a function whose rows are stored. A
mission is flown once and serves all its cells. A campaign that was killed goes on where it stopped and gives the same
results.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any, TypedDict, TypeVar, Unpack

from experiments.campaign import missions
from experiments.campaign.plans import CellPlan, compute
from experiments.campaign.processes import Pool
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import PER_RUN, PER_STEP, Arrays, CampaignError, Record, Store
from experiments.campaign.tasks import Task, compute_tasks, key_of, task_key
from laisn.failure import LaisnError
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory

T = TypeVar("T")
Facts = Callable[[Scenario, Trajectory], list[Record]]
"""What is measured of a mission besides: a record for each follower."""

_BATCH_STEPS = 20_000_000
"""Filter steps that a process computes before it reports: a third of a second."""


class ExecutionOptions(TypedDict, total=False):
    """How a campaign is computed; its results do not depend on it."""

    workers: int | None
    """Local processes, at most one for each mission, cell or task; None: one for each core."""
    cluster: str | None
    """Address of a Dask scheduler (tcp://…); its workers compute instead."""
    force: bool
    """Compute everything again."""
    quiet: bool
    """Show no progress."""


@dataclass(frozen=True, kw_only=True)
class Design:
    """What a study flies.

    Raises LaisnError if that is nothing.
    """

    cells: Sequence[CellPlan] = ()
    facts: Facts | None = None
    """Measured of every mission of the cells."""
    tasks: Mapping[Any, Task] = field(default_factory=dict)
    """Work of other kinds, by the names that the study knows it by."""
    what: str = "tasks"
    """What the tasks are called while they are waited for."""
    ahead: Callable[[], object] | None = None
    """Compiles in this process what each worker would else compile for itself before its first task."""

    def __post_init__(self) -> None:
        if not self.cells and not self.tasks:
            raise LaisnError("there is nothing to fly: the design has neither cells nor tasks")


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of a design."""

    design: Design
    store: Store
    tasks: Mapping[Any, list[Record]]
    """Rows of tasks by their names, in the order of the design; those that failed are missing."""
    failures: Mapping[Any, str]
    """What happened to missions that could not be flown, by the key of their motion, and to tasks, by their names."""

    def _present(self, key: str, found: T | None) -> T:
        if found is None:
            raise CampaignError(f"{self.store.folder}: result {key} vanished while the campaign ran")
        return found

    def row(self, plan: CellPlan) -> Record:
        """The row of a cell under the name that this plan gives it, its facts included; CampaignError if it is gone."""
        row: Record = self._present(plan.key, self.store.record(plan.key))
        if self.design.facts:
            key = key_of(self.design.facts, plan.motion)
            row = row | self._present(key, self.store.record(key))[plan.follower]
        return {"key": plan.key, "mission": plan.scenario.name} | row

    def runs(self, plan: CellPlan) -> Arrays:
        """The arrays over runs of a cell by name; CampaignError if it is gone."""
        return self._present(plan.key, self.store.arrays(plan.key, PER_RUN))

    @property
    def rows(self) -> list[Record]:
        """The rows of all cells, in the order of the design."""
        return [self.row(plan) for plan in self.design.cells]


def _batches(plans: Sequence[CellPlan], workers: int) -> Iterator[list[CellPlan]]:
    """Cells of one mission at a time, few enough for a steady progress and many enough to share the mission."""
    total = sum(plan.size for plan in plans)
    limit = min(_BATCH_STEPS, max(total // (4 * workers), 1))
    by_mission = sorted(plans, key=lambda plan: plan.motion)
    for _, mission in groupby(by_mission, key=lambda plan: plan.motion):
        batch: list[CellPlan] = []
        for plan in mission:
            if batch and sum(p.size for p in batch) + plan.size > limit:
                yield batch
                batch = []
            batch.append(plan)
        yield batch


def missing_cells(plans: Iterable[CellPlan], store: Store) -> list[CellPlan]:
    """Cells that are not stored; two plans of the same cell become one that keeps what either asks for."""
    merged: dict[str, CellPlan] = {}
    for plan in plans:
        if plan.key not in merged or plan.keep_steps:
            merged[plan.key] = plan
    return [
        plan
        for plan in merged.values()
        if store.record(plan.key) is None or (plan.keep_steps and store.arrays(plan.key, PER_STEP) is None)
    ]


def _fly(motion: str, scenario: Scenario, facts: Facts | None) -> tuple[str, Trajectory | str, list[Record]]:
    """Key of a mission, the mission or what kept it from being flown, and its facts."""
    try:
        trajectory = missions.simulate_mission(scenario)
    except CampaignError as error:
        return motion, str(error).splitlines()[0], []
    return motion, trajectory, facts(scenario, trajectory) if facts else []


def _store_flight(store: Store, scenario: Scenario, trajectory: Trajectory) -> None:
    """Store a mission; all scenarios that share its motion give the same bytes."""
    motion = missions.motion_of(scenario)
    store.write_flight(missions.motion_key(scenario), missions.sited(trajectory, motion.leader))


def fly_missions(
    scenarios: Mapping[str, Scenario], store: Store, pool: Pool, *, facts: Facts | None = None, quiet: bool = False
) -> dict[str, str]:
    """Fly missions in parallel, those that are not stored yet, and store each with its facts.

    Args:
        scenarios: by the key of their motion.
        store: for the missions.
        pool: entered.
        facts: to be measured of each.
        quiet: show no progress.

    Returns:
        What happened to those that cannot be flown, by the key of their motion.
    """

    def is_stored(item: tuple[str, Scenario, Facts | None]) -> bool:
        motion, _, facts = item
        return store.flight(motion) is not None and (facts is None or store.record(key_of(facts, motion)) is not None)

    wanted = [item for item in ((*given, facts) for given in scenarios.items()) if not is_stored(item)]
    failed = {}
    with progress("missions", len(wanted), quiet=quiet) as advance:
        for motion, flown, measured in pool.each(_fly, store.still_missing(wanted, is_stored, lambda _: advance())):
            if isinstance(flown, str):
                failed[motion] = flown
            else:
                _store_flight(store, scenarios[motion], flown)
                if facts:
                    store.write_record(key_of(facts, motion), measured)
            advance()
    return failed


def mission(scenario: Scenario, store: Store) -> Trajectory:
    """The stored flight of a scenario's mission, its transmitters placed; it is flown if it is not there."""
    trajectory = store.flight(missions.motion_key(scenario))
    if trajectory is None:
        trajectory = missions.simulate_mission(scenario)
        _store_flight(store, scenario, trajectory)
    return missions.sited(trajectory, scenario.leader)


def compile_ahead(plan: CellPlan) -> None:
    """Compile here, with a word, what each process would else compile for itself before its first result."""
    short = plan.scenario.first_messages
    with compiling_shown():
        compute(missions.simulate_mission(short), [replace(plan, scenario=short, runs=1)])


def compute_cells(plans: Sequence[CellPlan], store: Store, pool: Pool, *, quiet: bool = False) -> None:
    """Compute cells of stored missions in parallel, and store each as it is done."""
    with progress("cells", len(plans), quiet=quiet) as advance:
        missing = store.still_missing(
            _batches(plans, pool.size), lambda batch: not missing_cells(batch, store), lambda batch: advance(len(batch))
        )
        tasks = ((mission(batch[0].scenario, store), batch) for batch in missing)
        for done in pool.each(compute, tasks):
            for key, row, steps in done:
                store.write_record(key, row, steps)
                advance()


def fly(design: Design, folder: Path, *, tolerant: bool = False, **options: Unpack[ExecutionOptions]) -> Flown:
    """Compute a design, or what is missing of it.

    Args:
        design: the cells and tasks.
        folder: of the results; made if it does not exist.
        tolerant: go on without what cannot be flown.
        options: as of `ExecutionOptions`.

    Returns:
        Results that do not depend on workers and interruptions.

    Raises:
        LaisnError: the folder is of another version, the cluster cannot be used, or an estimate diverged.
        CampaignError: a process died, the sources changed, or, unless `tolerant`, something cannot be flown; what was
            computed is stored.
    """
    workers, cluster, quiet = options.get("workers"), options.get("cluster"), options.get("quiet", False)
    pool = Pool(len(os.sched_getaffinity(0)) if workers is None else workers, cluster)
    store, facts = Store(folder, force=options.get("force", False)), design.facts
    cells = missing_cells(design.cells, store)
    motions = {plan.motion: plan.scenario for plan in cells}
    if facts:
        unmeasured = [plan for plan in design.cells if store.record(key_of(facts, plan.motion)) is None]
        motions |= {plan.motion: plan.scenario for plan in unmeasured}
    tasks = {name: task for name, task in design.tasks.items() if store.record(task_key(task)) is None}
    pool.size = min(pool.size, max(len(cells), len(motions), len(tasks), 1))
    if cluster is None and not quiet:
        if cells:
            compile_ahead(cells[0])
        if tasks and design.ahead:
            with compiling_shown():
                design.ahead()
    with pool:
        failures: dict[Any, str] = {**fly_missions(motions, store, pool, facts=facts, quiet=quiet)}
        failures |= compute_tasks(tasks, store, pool, what=design.what, quiet=quiet)
        if failures and not tolerant:
            raise CampaignError("; ".join(sorted(set(failures.values()))))
        compute_cells([plan for plan in cells if plan.motion not in failures], store, pool, quiet=quiet)
    rows = {name: store.record(task_key(task)) for name, task in design.tasks.items()}
    return Flown(
        design=design, store=store, failures=failures,
        tasks={name: found for name, found in rows.items() if found is not None},
    )  # fmt: skip

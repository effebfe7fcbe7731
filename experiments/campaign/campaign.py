"""Campaigns: what a study flies, computed once, on as many processes as there are, and never lost.

A study is a design: cells, each a scenario with many runs of noise, and tasks, each a function whose rows are kept. A
mission is flown once and serves all its cells; cells and tasks go to disk one by one, so that a campaign that was
killed goes on where it stopped, and ends with the same bytes.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any, TypedDict, Unpack

from experiments.campaign import missions
from experiments.campaign.plans import CellPlan, compute
from experiments.campaign.processes import Pool
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import CampaignError, Record, Store
from experiments.campaign.tasks import Task, compute_tasks, key_of
from laisn.failure import LaisnError
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory

Facts = Callable[[Scenario, Trajectory], list[Record]]
"""What is measured of a mission besides: a record for each follower."""

_BATCH_STEPS = 20_000_000
"""Filter steps that a process computes before it reports: a third of a second."""


class Means(TypedDict, total=False):
    """How a campaign is flown, which changes nothing of what comes out."""

    workers: int | None
    """Local processes; None: one for each core."""
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
    """Compiles here what each process would else compile for itself before its first task."""

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

    def row(self, plan: CellPlan) -> Record:
        """The row of a cell under the name that this plan gives it, its facts included; CampaignError if it is gone."""
        facts = self.design.facts
        row = self.store.read(plan.key)
        measured = self.store.rows(key_of(facts, plan.motion)) if facts else [{}] * (plan.follower + 1)
        if row is None or measured is None:
            what = f"cell {plan.key} of {plan.scenario.name}"
            raise CampaignError(f"{self.store.folder}: {what} vanished while it was computed")
        return {"key": plan.key, "mission": plan.scenario.name} | row | measured[plan.follower]

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
        if store.read(plan.key) is None or (plan.keep_steps and store.read_steps(plan.key) is None)
    ]


def _fly(motion: str, scenario: Scenario, facts: Facts | None) -> tuple[str, Trajectory | str, list[Record]]:
    """Key of a mission, the mission or what kept it from being flown, and its facts."""
    try:
        trajectory = missions.simulate_mission(scenario)
    except CampaignError as error:
        return motion, str(error).splitlines()[0], []
    return motion, trajectory, facts(scenario, trajectory) if facts else []


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
    wanted = [
        (motion, scenario, facts)
        for motion, scenario in scenarios.items()
        if missions.read(store.flights, scenario) is None or (facts and store.rows(key_of(facts, motion)) is None)
    ]
    failed = {}
    with progress("missions", len(wanted), quiet=quiet) as advance:
        for motion, flown, measured in pool.each(_fly, wanted):
            if isinstance(flown, str):
                failed[motion] = flown
            else:
                missions.store(store.flights, scenarios[motion], flown)
                if facts:
                    store.write_rows(key_of(facts, motion), measured)
            advance()
    return failed


def mission(scenario: Scenario, store: Store) -> Trajectory:
    """The stored flight of a scenario's mission, its transmitters placed; it is flown if it is not there."""
    trajectory = missions.read(store.flights, scenario)
    if trajectory is None:
        trajectory = missions.simulate_mission(scenario)
        missions.store(store.flights, scenario, trajectory)
    return missions.sited(trajectory, scenario.leader)


def compile_ahead(plan: CellPlan) -> None:
    """Compile here, with a word, what each process would else compile for itself before its first result."""
    short = plan.scenario.first_messages
    with compiling_shown():
        compute(missions.simulate_mission(short), [replace(plan, scenario=short, runs=1)])


def compute_cells(plans: Sequence[CellPlan], store: Store, pool: Pool, *, quiet: bool = False) -> None:
    """Compute cells of stored missions in parallel, and store each as it is done."""
    tasks = ((mission(batch[0].scenario, store), batch) for batch in _batches(plans, pool.size))
    with progress("cells", len(plans), quiet=quiet) as advance:
        for done in pool.each(compute, tasks):
            for key, row, steps in done:
                store.write(key, row, steps)
                advance()


def fly(design: Design, folder: Path, *, tolerant: bool = False, **means: Unpack[Means]) -> Flown:
    """Fly a design, or what is missing of it.

    Args:
        design: the cells and tasks.
        folder: of the results; made if it is not there.
        tolerant: go on without what cannot be flown.
        means: as of `Means`.

    Returns:
        What came out: the same whatever the workers and interruptions.

    Raises:
        LaisnError: the folder is of another version, the cluster cannot be used, or an estimate diverged.
        CampaignError: a process died, the sources changed, or, unless `tolerant`, something cannot be flown; what was
            computed is stored.
    """
    workers, cluster, quiet = means.get("workers"), means.get("cluster"), means.get("quiet", False)
    processes = Pool(len(os.sched_getaffinity(0)) if workers is None else workers, cluster)
    store, facts = Store(folder, force=means.get("force", False)), design.facts
    compiling = cluster is None and not quiet
    cells = missing_cells(design.cells, store)
    motions = {plan.motion: plan.scenario for plan in cells}
    if facts:
        unmeasured = [plan for plan in design.cells if store.rows(key_of(facts, plan.motion)) is None]
        motions |= {plan.motion: plan.scenario for plan in unmeasured}
    if cells and compiling:
        compile_ahead(cells[0])
    with processes as pool:
        failures: dict[Any, str] = {**fly_missions(motions, store, pool, facts=facts, quiet=quiet)}
        ahead = design.ahead if compiling else None
        tasks, failed = compute_tasks(design.tasks, store, pool, what=design.what, quiet=quiet, ahead=ahead)
        failures |= failed
        if failures and not tolerant:
            raise CampaignError("; ".join(dict.fromkeys(failures.values())))
        compute_cells([plan for plan in cells if plan.motion not in failures], store, pool, quiet=quiet)
    return Flown(design=design, store=store, tasks=tasks, failures=failures)

"""Campaigns: a study's missions, cells and tasks, computed in parallel and stored one by one.

A design consists of cells, each a scenario with many runs of noise, and tasks, each a function whose rows are stored. A
mission is flown once and serves all its cells. A campaign that was killed goes on where it stopped and gives the same
results.
"""

import os
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, Unpack

from experiments.campaign import missions
from experiments.campaign.plans import CellPlan, Facts, compute
from experiments.campaign.processes import Pool
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import Arrays, CampaignError, Record, Result, Store, key_of
from laisn.compiled import FOLDER
from sim.scenario.settings import Scenario
from sim.system import background_process
from sim.trajectory import Trajectory

Task = partial[Any]
"""A function of a module with its arguments: data classes, scenarios, numbers and text.

It returns a list of records, stored as JSON values. It raises `CampaignError` if it cannot compute them."""
_Work = Callable[[], list[Result]]
BATCH_STEPS = 20_000_000
"""Filter steps that a process computes before it reports: a third of a second."""
_MANY_RUNS = 10_000
"""Cells of so many runs take seconds, in which threads use all cores."""


class ExecutionOptions(TypedDict, total=False):
    """How a campaign is computed; its results do not depend on it."""

    workers: int | None
    """Local processes, at most one for each mission, cell or task; None: one for each core."""
    cluster: str | None
    """Address of a Dask scheduler (tcp://…); its workers compute instead."""
    force: bool
    quiet: bool


@dataclass(frozen=True, kw_only=True)
class Design:
    """What a study flies."""

    cells: Sequence[CellPlan] = ()
    facts: Facts | None = None
    """Measured of every mission of the cells."""
    tasks: Mapping[Any, Task] = field(default_factory=dict)
    """Work of other kinds, by the study's names."""
    what: str = "tasks"
    """What the tasks are called while they are waited for."""
    ahead: Callable[[], object] | None = None
    """Compiles in this process what each worker would else compile for itself before its first task."""


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of a design."""

    design: Design
    store: Store
    tasks: Mapping[Any, list[Record]]
    """Rows of tasks by their names, in the order of the design; those that failed are missing."""
    failures: Mapping[Any, str]
    """What happened to missions that could not be flown, by the key of their motion, and to tasks, by their names."""

    def _stored(self, key: str) -> tuple[Any, Arrays]:
        found = self.store.get(key)
        if found is None:
            raise CampaignError(f"{self.store.folder}: result {key} vanished while the campaign ran")
        return found

    def cell(self, plan: CellPlan) -> tuple[Record, Arrays]:
        """The row of a cell under this plan's name, with its facts, and its arrays over runs; CampaignError: gone."""
        (row, arrays), facts = self._stored(plan.key), self.design.facts
        measured = self._stored(key_of(facts, plan.motion))[0][plan.follower] if facts else {}
        return {"key": plan.key, "mission": plan.scenario.name} | row | measured, arrays

    def steps(self, plan: CellPlan) -> Arrays:
        """The arrays over steps of a cell that keeps them, by name; CampaignError if it is gone."""
        return self._stored(plan.steps_key)[1]

    @property
    def rows(self) -> list[Record]:
        """The rows of all cells, in the order of the design."""
        return [self.cell(plan)[0] for plan in self.design.cells]


class _Job(NamedTuple):
    """Work for a process."""

    keys: Sequence[str]
    """Of its results."""
    work: Callable[[], _Work]
    """Makes what the process calls, just before it is handed out."""
    size: int = 1
    """How many items it counts for."""


def _batches(plans: Iterable[CellPlan], store: Store, workers: int) -> dict[int, _Job]:
    """Cells of one mission at a time, few enough for a steady progress and many enough to share the mission."""
    by_mission = sorted(plans, key=lambda plan: plan.motion)
    limit = min(BATCH_STEPS, sum(plan.size for plan in by_mission) // (4 * workers))
    batches, size = list[list[CellPlan]](), 0
    for plan in by_mission:
        if not batches or batches[-1][0].motion != plan.motion or size + plan.size > limit:
            batches.append([])
            size = 0
        batches[-1].append(plan)
        size += plan.size

    def job(batch: list[CellPlan]) -> _Job:
        keys = [key for plan in batch for key in plan.keys]
        return _Job(keys, lambda: partial(compute, mission(batch[0].scenario, store), batch), len(batch))

    return dict(enumerate(map(job, batches)))


def _attempt(name: Any, work: _Work) -> tuple[Any, list[Result] | str]:
    """Results of some work by its name, or why it has none."""
    try:
        return name, work()
    except CampaignError as error:
        return name, str(error).splitlines()[0]


def _compute(what: str, jobs: Mapping[Any, _Job], store: Store, pool: Pool, quiet: bool = False) -> dict[Any, str]:
    """Compute in parallel, and store each result as it is done; gives why jobs failed, by their names.

    The order is random, so that processes which share a folder share the work: a job whose results are stored meanwhile
    is left out.
    """
    failed = {}
    with progress(what, sum(job.size for job in jobs.values()), quiet=quiet) as advance:

        def missing() -> Iterator[tuple[Any, _Work]]:
            for name in random.sample([*jobs], len(jobs)):
                if store.has(*jobs[name].keys):
                    advance(jobs[name].size)
                else:
                    yield name, jobs[name].work()

        for name, found in pool.each(_attempt, missing()):
            if isinstance(found, str):
                failed[name] = found
            else:
                for result in found:
                    store.put(*result)
            advance(jobs[name].size)
    return failed


def _flight(scenario: Scenario, motion: str, trajectory: Trajectory) -> Result:
    """A mission as it is stored: all scenarios that share its motion give the same bytes."""
    return motion, None, missions.sited(trajectory, missions.motion_of(scenario).leader).arrays


def _fly(plan: CellPlan, facts: Facts | None) -> list[Result]:
    """The mission of a cell and its facts."""
    trajectory = missions.simulate_mission(plan.scenario)
    measured: list[Result] = [(key_of(facts, plan.motion), facts(plan.scenario, trajectory), {})] if facts else []
    return [_flight(plan.scenario, plan.motion, trajectory), *measured]


def _rows(key: str, task: Task) -> list[Result]:
    return [(key, task(), {})]


def mission(scenario: Scenario, store: Store) -> Trajectory:
    """The stored flight of a scenario's mission, its transmitters placed; it is flown if it is not there."""
    motion = missions.motion_key(scenario)
    found = store.get(motion)
    if found is not None:
        return missions.sited(Trajectory.of_arrays(found[1]), scenario.leader)
    trajectory = missions.simulate_mission(scenario)
    store.put(*_flight(scenario, motion, trajectory))
    return trajectory


def compile_ahead(plan: CellPlan) -> None:
    """Compile here, with a notice, what each process would else compile for itself before its first result."""
    short = plan.scenario.first_messages
    with compiling_shown():
        compute(missions.simulate_mission(short), [replace(plan, scenario=short, runs=1)])


def fly(design: Design, folder: Path, *, tolerant: bool = False, **options: Unpack[ExecutionOptions]) -> Flown:
    """Compute a design, or what is missing of it; results do not depend on workers and interruptions.

    Args:
        design: the cells and tasks.
        folder: of the results; made if it does not exist.
        tolerant: go on without what cannot be flown.
        options: as of `ExecutionOptions`.

    Raises:
        LaisnError: the folder is of another version, the cluster cannot be used, or an estimate diverged.
        CampaignError: a process died, the sources changed, or, unless `tolerant`, something cannot be flown; what was
            computed is stored.
    """
    workers, cluster, quiet = options.get("workers"), options.get("cluster"), options.get("quiet", False)
    pool = Pool(len(os.sched_getaffinity(0)) if workers is None else workers, cluster)
    store, facts = Store(folder, force=options.get("force", False)), design.facts
    # of plans of the same cell, one that keeps what any of them requests
    plans = {plan.key: plan for plan in sorted(design.cells, key=lambda plan: plan.keep_steps)}.values()
    cells = [plan for plan in plans if not store.has(*plan.keys)]
    measured = {plan.motion: [key_of(facts, plan.motion)] for plan in plans} if facts else {}
    unmeasured = [plan for plan in plans if not store.has(*measured.get(plan.motion, ()))]
    flights = {
        plan.motion: _Job([plan.motion, *measured.get(plan.motion, ())], partial(partial, _fly, plan, facts))
        for plan in (*cells, *unmeasured)
    }
    keys = {name: key_of(task) for name, task in design.tasks.items()}
    tasks = {n: _Job([key], partial(partial, _rows, key, design.tasks[n])) for n, key in keys.items()}
    flights, tasks = ({n: j for n, j in jobs.items() if not store.has(*j.keys)} for jobs in (flights, tasks))
    one_mission = len({plan.motion for plan in cells}) == 1 and cluster is None and not tasks
    if one_mission and all(plan.runs >= _MANY_RUNS and plan.in_lanes for plan in cells):
        # compiled lanes run side by side in threads, without the memory of processes
        cells, pool.size = [replace(plan, threads=pool.size) for plan in cells], 1
    pool.size = min(pool.size, max(len(cells), len(flights), len(tasks), 1))
    if cluster is None and not quiet:
        if cells and FOLDER:
            # the compiler's memory goes with its process
            with background_process() as apart:
                apart.submit(compile_ahead, cells[0]).result()
        if tasks and design.ahead:
            with compiling_shown():
                design.ahead()
    with pool:
        failures = _compute("missions", flights, store, pool, quiet) | _compute(design.what, tasks, store, pool, quiet)
        if failures and not tolerant:
            raise CampaignError("; ".join(sorted(set(failures.values()))))
        batches = _batches((cell for cell in cells if cell.motion not in failures), store, pool.size)
        _compute("cells", batches, store, pool, quiet)
    rows = {name: store.get(key) for name, key in keys.items()}
    found = {name: result[0] for name, result in rows.items() if result is not None}
    return Flown(design=design, store=store, failures=failures, tasks=found)

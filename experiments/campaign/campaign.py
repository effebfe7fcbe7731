"""Campaigns: a study's missions, cells and tasks, computed in parallel and stored one by one.

A motion is stored for cells that are computed later; one that was flown side by side, with all of
its cells, is not. Cells are scenarios with many runs of noise, tasks functions whose rows are
stored. A mission is flown once and serves all its cells. A campaign that was killed goes on where
it stopped and gives the same results.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple, Self, TypedDict, Unpack

from experiments.campaign import montecarlo
from experiments.campaign.jobs import Job, Work, run_jobs
from experiments.campaign.plans import CellPlan, Facts, compute, facts_key
from experiments.campaign.pool import Pool
from experiments.campaign.progress import compiling_shown
from experiments.campaign.store import Arrays, CampaignError, Record, Result, Store, key_of
from laisn.compiled import FOLDER
from laisn.errors import LaisnError
from laisn.navigators import find
from laisn.plugins import plugin_errors, plugins_version
from laisn.simd import LANES
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.side_by_side import groups_for_lanes
from sim.simulation import simulate_open_loop
from sim.system import background_process
from sim.trajectory import Trajectory

Task = partial[Any]
"""A function of a module with its arguments: data classes, scenarios, numbers and text.

It returns a list of records, stored as JSON values. It raises `CampaignError` if it cannot compute
them."""


@dataclass(frozen=True, kw_only=True)
class SideBySide:
    """Tasks that may be computed together, with the results that each has alone, in less time."""

    names: Sequence[Any]
    compute: Callable[[Sequence[Task]], list[list[Record] | None]]
    """A function of a module: rows of each task; None of one that is left to be computed alone."""
    most: int  # how many, at most, are computed together


# filter steps that a process computes before it reports: a third of a second
BATCH_STEPS = 20_000_000
# up to so many missions for each process are flown as jobs of their own, before their cells; if
# there are more, each is flown in one job with its first cells
FEW_MISSIONS = 4
# so many missing tasks take longer than to compile what computes them side by side
_MANY_TASKS = 64
_MANY_RUNS = 10_000  # cells of so many runs take seconds, in which threads use all cores


class ExecutionOptions(TypedDict, total=False):
    """How a campaign is computed; its results do not depend on it."""

    # local processes, at most one for each mission, cell or task; None: one for each core
    workers: int | None
    cluster: str | None  # address of a Dask scheduler (tcp://…); its workers compute instead
    force: bool  # stored results count as missing
    quiet: bool
    # version of the plugins of which keys were made; a later edit ends the campaign
    plugins: str


@dataclass(frozen=True, kw_only=True)
class CampaignResults:
    """What came of the cells and tasks of a campaign; cells are read from its store."""

    store: Store
    facts: Facts | None  # function that measured the facts of missions, which are in the store
    # rows of tasks by their names, in their order; those that failed are missing
    tasks: Mapping[Any, list[Record]]
    failures: Mapping[Any, str]
    """What happened to missions that could not be flown, by the key of their motion, and to
    tasks, by their names.
    """

    def _stored(self, key: str) -> tuple[Any, Arrays]:
        result = self.store.get(key)
        if result is None:
            raise CampaignError(
                f"{self.store.folder}: result {key} vanished while the campaign ran"
            )
        return result

    @cached_property
    def _facts_of(self) -> Callable[[str], list[Record]]:
        """Facts of a mission, which many cells share, by the key of its motion."""

        def read(motion_key: str) -> list[Record]:
            if self.facts is None:
                return []
            records: list[Record] = self._stored(facts_key(self.facts, motion_key))[0]
            return records

        return cache(read)

    def cell(self, plan: CellPlan) -> tuple[Record, Arrays]:
        """The row of a cell with the facts of its mission, and its arrays over runs;
        CampaignError if it is gone.
        """
        row, arrays = self._stored(plan.key)
        if self.facts:
            row = row | self._facts_of(plan.motion_key)[plan.follower]
        return row, arrays

    def steps(self, plan: CellPlan) -> Arrays:
        """The arrays over steps of a cell that keeps them, by name; CampaignError if it is gone."""
        return self._stored(plan.steps_key)[1]


def _batches(plans: Iterable[CellPlan], workers: int) -> list[list[CellPlan]]:
    """Cells of one mission at a time, few enough for a steady progress and many enough to share
    the mission.
    """
    by_mission = sorted(plans, key=lambda plan: plan.motion_key)
    limit = min(BATCH_STEPS, sum(plan.size for plan in by_mission) // (4 * workers))
    batches = list[list[CellPlan]]()
    size = 0
    for plan in by_mission:
        if not batches or batches[-1][0].motion_key != plan.motion_key or size + plan.size > limit:
            batches.append([])
            size = 0
        batches[-1].append(plan)
        size += plan.size
    return batches


def _fly(plan: CellPlan, facts: Facts | None, batch: Sequence[CellPlan]) -> list[Result]:
    """Fly the mission of a cell; results as of `_mission_results`."""
    trajectory = montecarlo.simulate_mission(plan.scenario)
    return _mission_results(trajectory, plan, facts, batch)


class _LaneMission(NamedTuple):
    """A mission that is flown beside others, with cells of it."""

    plan: CellPlan
    batch: Sequence[CellPlan]
    keep_motion: bool  # other cells need it, too; else to fly it again takes no longer than to read

    def keys(self, facts: Facts | None) -> list[str]:
        """Keys of its results."""
        keys = [self.plan.motion_key] if self.keep_motion else []
        if facts:
            keys.append(facts_key(facts, self.plan.motion_key))
        return keys + _result_keys(self.batch)


def _fly_side_by_side(missions: Sequence[_LaneMission], facts: Facts | None) -> list[Result]:
    """The same of missions in lanes; what ends early is left out, and tells why when it is flown
    alone.
    """
    motions = montecarlo.simulate_missions([mission.plan.scenario for mission in missions])
    results = list[Result]()
    for motion, mission in zip(motions, missions, strict=True):
        if motion is not None:
            of_mission = _mission_results(motion, mission.plan, facts, mission.batch)
            results += of_mission if mission.keep_motion else of_mission[1:]
    return results


def _mission_results(
    trajectory: Trajectory, plan: CellPlan, facts: Facts | None, batch: Sequence[CellPlan]
) -> list[Result]:
    """Results of a mission that was flown, that of the cell `plan`: first its motion, then its
    facts, if any are measured, and the cells of `batch`, which share it.
    """
    results: list[Result] = [(plan.motion_key, None, trajectory.arrays)]
    if facts:
        measured = facts(MotionSettings.of(plan.scenario), trajectory)
        results.append((facts_key(facts, plan.motion_key), measured, {}))
    return results + compute(trajectory, batch)


def mission(scenario: Scenario, store: Store) -> Trajectory:
    """The stored flight of a scenario's mission, with transmitters where the leader's hull has
    them; it is flown if it is not there.
    """
    key = key_of(MotionSettings.of(scenario))
    stored = store.get(key)
    if stored is not None:
        return Trajectory.of_arrays(stored[1])
    trajectory = montecarlo.simulate_mission(scenario)
    store.put(key, None, trajectory.arrays)
    return trajectory


def compile_motion(plan: CellPlan, facts: Facts | None, *, in_lanes: bool) -> None:
    """Compile what moves the mission of a cell, alone or beside others, and measures its facts."""
    short = plan.scenario.first_messages
    motion = montecarlo.simulate_missions([short])[0] if in_lanes else None
    motion = montecarlo.simulate_mission(short) if motion is None else motion
    if facts:
        facts(MotionSettings.of(short), motion)


def compile_cells(plans: Sequence[CellPlan]) -> None:
    """Compile what senses and navigates in cells, along the point motion of their missions, which
    needs nothing that `compile_motion` compiles.
    """
    for plan in plans:
        short = plan.scenario.first_messages
        points = replace(MotionSettings.of(short), kind="kinematic")
        compute(simulate_open_loop(points), [replace(plan, scenario=short, runs=1)])


@dataclass(frozen=True, kw_only=True)
class _Campaign:
    """The cells and tasks of a campaign, and what is missing of them in its store."""

    plans: Sequence[CellPlan]
    tasks: Mapping[Any, Task]
    facts: Facts | None
    store: Store
    task_keys: Mapping[Any, str]  # of their results

    @classmethod
    def of(
        cls,
        cells: Iterable[CellPlan],
        tasks: Mapping[Any, Task],
        facts: Facts | None,
        store: Store,
    ) -> Self:
        # of plans of the same cell, one that keeps what any of them requests
        by_key = {plan.key: plan for plan in sorted(cells, key=lambda plan: plan.keep_steps)}
        return cls(
            plans=list(by_key.values()),
            tasks=tasks,
            facts=facts,
            store=store,
            task_keys={name: key_of(task) for name, task in tasks.items()},
        )

    @cached_property
    def missing_cells(self) -> list[CellPlan]:
        return [plan for plan in self.plans if not self.store.has(*plan.keys)]

    @cached_property
    def missing_tasks(self) -> list[Any]:
        """Names of the tasks without a result."""
        return [name for name, key in self.task_keys.items() if not self.store.has(key)]

    @cached_property
    def missing_missions(self) -> dict[str, CellPlan]:
        """Cells whose missions, by the keys of their motions, have to be flown: for a missing
        cell, or for their facts.
        """
        of_cells = {plan.motion_key for plan in self.missing_cells}
        missions = {plan.motion_key: plan for plan in self.plans}
        missing = {}
        for motion_key, plan in missions.items():
            needed_keys = self.facts_keys(motion_key)
            if motion_key in of_cells:
                needed_keys.append(motion_key)
            if not self.store.has(*needed_keys):
                missing[motion_key] = plan
        return missing

    def facts_keys(self, motion_key: str) -> list[str]:
        """Key of the facts of a mission, by the key of its motion; none if none are measured."""
        return [facts_key(self.facts, motion_key)] if self.facts else []

    @property
    def is_one_long_mission(self) -> bool:
        """Whether many runs of one mission by compiled lanes are all that is missing."""
        if self.missing_tasks or len({plan.motion_key for plan in self.missing_cells}) != 1:
            return False
        return all(
            plan.runs >= _MANY_RUNS and find(plan.scenario.navigation.variant).lanes
            for plan in self.missing_cells
        )

    def jobs(self, pool: Pool, threads: int) -> list[Job]:
        """Jobs for all that is missing: missions, then cells, and tasks beside them.

        Of many missions, each is flown with its first cells, which then need not read it. Not of
        few: commands that share a folder would compute these cells twice.
        """
        cells = self.missing_cells
        if threads > 1:
            cells = [replace(plan, threads=threads) for plan in cells]
        batches = _batches(cells, pool.size)
        missions = self.missing_missions
        flown_with = self._flown_with(batches, pool)
        jobs = [
            self._mission_job(plan, flown_with.get(motion_key, []))
            for motion_key, plan in missions.items()
        ]
        jobs += [self._task_job(name) for name in self.missing_tasks]
        for batch in batches:
            if batch is not flown_with.get(batch[0].motion_key):
                jobs.append(_cells_job(batch, depends_on_mission=batch[0].motion_key in missions))
        return jobs

    def _flown_with(
        self, batches: Sequence[list[CellPlan]], pool: Pool
    ) -> dict[str, list[CellPlan]]:
        """The batch of cells that is computed in the job of each mission, by the key of its motion;
        none where there are few missions.
        """
        flown_with = dict[str, list[CellPlan]]()
        if len(self.missing_missions) > FEW_MISSIONS * pool.size:
            for batch in batches:
                if batch[0].motion_key in self.missing_missions:
                    flown_with.setdefault(batch[0].motion_key, batch)
        return flown_with

    def lane_groups(self, workers: int) -> list[list[CellPlan]]:
        """Missions that are missing and may be flown side by side, each by one of its cells; a list
        for each group that is flown together.
        """
        missions = [
            plan
            for plan in self.missing_missions.values()
            if not plan.scenario.keys_needing_closed_loop()
        ]
        group_size = min(LANES, -(-len(missions) // workers))
        motions = [MotionSettings.of(plan.scenario) for plan in missions]
        return [[missions[i] for i in group] for group in groups_for_lanes(motions, group_size)]

    def lane_jobs(self, pool: Pool) -> list[Job]:
        """Jobs for missions side by side, with first cells where these are flown with missions."""
        flown_with = self._flown_with(_batches(self.missing_cells, pool.size), pool)
        cells_of_mission = Counter(plan.motion_key for plan in self.missing_cells)
        jobs = list[Job]()
        for group in self.lane_groups(pool.size):
            missions = [
                _LaneMission(
                    plan, batch, keep_motion=len(batch) < cells_of_mission[plan.motion_key]
                )
                for plan in group
                for batch in [flown_with.get(plan.motion_key, [])]
            ]
            keys = [key for mission in missions for key in mission.keys(self.facts)]
            work = partial(_fly_side_by_side, missions, self.facts)
            jobs.append(
                Job(
                    key=("lanes", group[0].motion_key),
                    kind="missions",
                    result_keys=keys,
                    run=partial(_given, work),
                    size=len(group),
                )
            )
        return jobs

    def task_groups(self, together: Sequence[SideBySide], workers: int) -> list[list[Any]]:
        """Names of missing tasks that are computed together, where there are many."""
        if len(self.missing_tasks) < _MANY_TASKS:
            return []
        missing = set(self.missing_tasks)
        size = -(-len(missing) // workers)
        groups = list[list[Any]]()
        for group in together:
            names = [name for name in group.names if name in missing]
            most = min(group.most, size)
            groups += [names[first : first + most] for first in range(0, len(names), most)]
        return [group for group in groups if len(group) > 1]

    def task_group_jobs(self, together: Sequence[SideBySide], pool: Pool) -> list[Job]:
        """Jobs for tasks side by side."""
        compute_of = {name: group.compute for group in together for name in group.names}
        jobs = list[Job]()
        for names in self.task_groups(together, pool.size):
            keys = [self.task_keys[name] for name in names]
            tasks = [self.tasks[name] for name in names]
            work = partial(_rows_together, keys, tasks, compute_of[names[0]])
            jobs.append(
                Job(
                    key=("together", names[0]),
                    kind="runs",
                    result_keys=keys,
                    run=partial(_given, work),
                    size=len(names),
                )
            )
        return jobs

    def _mission_job(self, plan: CellPlan, batch: Sequence[CellPlan]) -> Job:
        return Job(
            key=plan.motion_key,
            kind="missions",
            result_keys=[plan.motion_key, *self.facts_keys(plan.motion_key), *_result_keys(batch)],
            run=lambda _: partial(_fly, plan, self.facts, batch),
        )

    def _task_job(self, name: Any) -> Job:
        key = self.task_keys[name]
        return Job(
            key=name,
            kind="runs",
            result_keys=[key],
            run=lambda _: partial(_rows, key, self.tasks[name]),
        )


def _given(work: Work, _: Store) -> Work:
    """Work that needs nothing of the store."""
    return work


def _rows(key: str, task: Task) -> list[Result]:
    return [(key, task(), {})]


def _rows_together(
    keys: Sequence[str],
    tasks: Sequence[Task],
    compute_together: Callable[[Sequence[Task]], list[list[Record] | None]],
) -> list[Result]:
    """Results of tasks side by side; what fails is left out, and tells why when it is computed
    alone.
    """
    rows = zip(keys, compute_together(tasks), strict=True)
    return [(key, of_task, {}) for key, of_task in rows if of_task is not None]


def _result_keys(batch: Iterable[CellPlan]) -> list[str]:
    return [key for plan in batch for key in plan.keys]


def _cells_job(batch: Sequence[CellPlan], *, depends_on_mission: bool) -> Job:
    """Computes cells of a mission, which is read from the store."""
    first = batch[0]
    return Job(
        key=("cells", first.key),
        kind="points and arms",
        result_keys=_result_keys(batch),
        run=lambda store: partial(compute, mission(first.scenario, store), batch),
        depends_on=[first.motion_key] if depends_on_mission else [],
        size=len(batch),
    )


class FlightCompilers(NamedTuple):
    """Functions of modules that compile what flies beside cells."""

    alone: Callable[[], object]  # a task, or a single flight that is looked at afterwards
    side_by_side: Callable[[], object] | None  # tasks together


def _compile_before(
    campaign: _Campaign,
    workers: int,
    compilers: FlightCompilers | None,
    together: Sequence[SideBySide],
) -> None:
    """Compile once what each worker would else compile for itself."""
    parts = list[Callable[[], object]]()
    missing_cells = campaign.missing_cells
    if missing_cells:
        groups = campaign.lane_groups(workers)
        first = groups[0][0] if groups else missing_cells[0]
        parts.append(partial(compile_motion, first, campaign.facts, in_lanes=bool(groups)))
        # lanes compile all navigators that fly in them at once
        by_navigator = dict[str, CellPlan]()
        for plan in missing_cells:
            variant = plan.scenario.navigation.variant
            by_navigator.setdefault("" if find(variant).lanes else variant, plan)
        parts.append(partial(compile_cells, list(by_navigator.values())))
    if compilers and (missing_cells or campaign.missing_tasks):
        parts.append(compilers.alone)
        if compilers.side_by_side and campaign.task_groups(together, workers):
            parts.append(compilers.side_by_side)
    _compile_in_processes(parts, workers)


def _compile(part: Callable[[], object]) -> None:
    """Compile a part as far as it can be flown: what cannot is told where results are computed."""
    with suppress(LaisnError), plugin_errors():
        part()


def _compile_in_processes(parts: Sequence[Callable[[], object]], workers: int) -> None:
    """Compile parts in `workers` processes at most, with a notice."""
    # the compiler's memory goes with its process; where that dies, the results are computed all the
    # same
    with ExitStack() as ending:
        processes = [
            ending.enter_context(background_process()) for _ in range(min(len(parts), workers))
        ]
        ending.enter_context(compiling_shown())
        compiling = [
            process.submit(_compile, part)
            for part, process in zip(parts, cycle(processes), strict=False)
        ]
        for result in compiling:
            with suppress(BrokenProcessPool):
                result.result()


def fly(
    cells: Sequence[CellPlan],
    tasks: Mapping[Any, Task],
    folder: Path,
    *,
    facts: Facts | None = None,
    together: Sequence[SideBySide] = (),
    compilers: FlightCompilers | None = None,
    tolerant: bool = False,
    **options: Unpack[ExecutionOptions],
) -> CampaignResults:
    """Compute cells and tasks, or what is missing of them; results do not depend on workers and
    interruptions.

    Args:
        cells: scenarios with their runs.
        tasks: work of other kinds, by names.
        folder: of the results; made if it does not exist.
        facts: measured of every mission of the cells.
        together: tasks that may be computed side by side.
        compilers: compile, beside what cells need, what each worker would else compile for itself.
        tolerant: go on without what cannot be flown.
        options: as of `ExecutionOptions`.

    Raises:
        LaisnError: the folder is of another version, the cluster cannot be used, or an estimate
            diverged.
        CampaignError: a process died, the sources changed, or, unless `tolerant`, something cannot
            be flown; what was computed is stored.
    """
    workers = options.get("workers")
    cluster = options.get("cluster")
    quiet = options.get("quiet", False)
    plugins = options.get("plugins") or plugins_version(refresh=True)
    pool = Pool(workers, cluster, plugins=plugins)
    store = Store(folder, force=options.get("force", False))
    campaign = _Campaign.of(cells, tasks, facts, store)
    threads = 1
    if cluster is None and campaign.is_one_long_mission:
        # compiled lanes run side by side in threads, without the memory of processes
        threads = pool.size
        pool.size = 1
    missing = campaign.missing_cells, campaign.missing_missions, campaign.missing_tasks
    pool.size = min(pool.size, max(1, *map(len, missing)))
    if cluster is None and not quiet and FOLDER:
        _compile_before(campaign, pool.size, compilers, together)
    with ExitStack() as ending:
        # workers are killed if something fails
        ending.callback(store.remove_unfinished)
        ending.enter_context(pool)
        lanes = campaign.lane_jobs(pool)
        if lanes:
            # what cannot be flown side by side is left, and flown alone below
            run_jobs(lanes, store, pool, tolerant=True, quiet=quiet)
            campaign = _Campaign.of(cells, tasks, facts, store)
        groups = campaign.task_group_jobs(together, pool)
        if groups:
            run_jobs(groups, store, pool, tolerant=True, quiet=quiet)
            campaign = _Campaign.of(cells, tasks, facts, store)
        jobs = campaign.jobs(pool, threads)
        failures = run_jobs(jobs, store, pool, tolerant=tolerant, quiet=quiet)
    results = {name: store.get(key) for name, key in campaign.task_keys.items()}
    rows = {name: result[0] for name, result in results.items() if result is not None}
    return CampaignResults(store=store, facts=facts, failures=failures, tasks=rows)

"""Campaigns: a study's missions, cells and tasks, computed in parallel and stored one by one.

Cells are scenarios with many runs of noise, tasks functions whose rows are stored. A mission is
flown once and serves all its cells. A campaign that was killed goes on where it stopped and gives
the same results.
"""

import multiprocessing
import os
import random
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Self, TypedDict, TypeVar, Unpack

import joblib
from joblib.externals.loky import get_reusable_executor

from experiments.campaign import montecarlo
from experiments.campaign.plans import CellPlan, Facts, compute
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import Arrays, CampaignError, Record, Result, Store, key_of
from experiments.campaign.version import code_version
from laisn.compiled import FOLDER
from laisn.failure import LaisnError
from laisn.navigators import find
from laisn.plugins import VARIABLE
from sim.scenario.settings import Scenario
from sim.system import background_process, exit_with_parent
from sim.trajectory import Trajectory

Task = partial[Any]
"""A function of a module with its arguments: data classes, scenarios, numbers and text.

It returns a list of records, stored as JSON values. It raises `CampaignError` if it cannot compute
them."""
_Work = Callable[[], list[Result]]
Made = TypeVar("Made")
_CONNECT_S = 3
# filter steps that a process computes before it reports: a third of a second
BATCH_STEPS = 20_000_000
# so many for each process are flown before their cells; of more each comes with its first cells
FEW_MISSIONS = 4
_MANY_RUNS = 10_000  # cells of so many runs take seconds, in which threads use all cores


class ExecutionOptions(TypedDict, total=False):
    """How a campaign is computed; its results do not depend on it."""

    # local processes, at most one for each mission, cell or task; None: one for each core
    workers: int | None
    cluster: str | None  # address of a Dask scheduler (tcp://…); its workers compute instead
    force: bool
    quiet: bool


def _with_version(function: Callable[..., Made], *arguments: Any) -> tuple[str, Made]:
    return code_version(), function(*arguments)


class Pool:
    """A pool of `size` local processes, or of the workers of the Dask scheduler at an address; use
    it as a context.

    With one local worker everything is computed in this process. LaisnError if there is no worker,
    or the cluster cannot be used.
    """

    def __init__(self, workers: int, cluster: str | None = None) -> None:
        if workers < 1:
            raise LaisnError(f"workers is {workers}, expected at least 1")
        self.size = workers
        self.cluster = cluster
        self._client: Any = None

    def __enter__(self) -> Self:
        if self.cluster is not None:
            self._client = _connect(self.cluster)
            self.size = sum(self._client.nthreads().values())
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # local processes end with this one, or at once if something failed
        if self._client is not None:
            self._client.close()
        elif kind is not None and self.size > 1:
            get_reusable_executor().shutdown(kill_workers=True)

    def each(
        self, function: Callable[..., Made], arguments: Iterable[tuple[Any, ...]]
    ) -> Iterator[Made]:
        """Results of a function in the order of completion; CampaignError if a process died or
        has other sources.
        """
        options: dict[str, Any] = {"backend": "sequential" if self._client is None else "dask"}
        if self._client is None and self.size > 1:
            # joblib starts new processes where the arguments differ from those before
            begin = os.getpid(), (VARIABLE, os.environ.get(VARIABLE, ""))
            options = {"backend": "loky", "initializer": exit_with_parent, "initargs": begin}
        calls = (joblib.delayed(_with_version)(function, *given) for given in arguments)
        with joblib.parallel_config(n_jobs=self.size, **options):
            parallel = joblib.Parallel(
                return_as="generator_unordered", batch_size=1, max_nbytes=None
            )
            try:
                for version, result in parallel(calls):
                    if version != code_version():
                        raise CampaignError(
                            f"a worker has version {version}, the campaign began with "
                            f"{code_version()}: "
                            "the sources changed while it ran; run it again"
                        )
                    yield result
            except Exception as error:
                # Dask is optional, so its exception goes by its name
                if isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker":
                    raise CampaignError(
                        "a worker process died, probably out of memory; every finished result is "
                        "stored, "
                        "and the same command goes on from there (fewer --workers need less memory)"
                    ) from error
                raise


def release_workers() -> None:
    """End local processes, so that drawing a page does not need memory beside theirs; a later
    pool starts others.
    """
    if multiprocessing.active_children():
        get_reusable_executor().shutdown()


def _connect(address: str) -> Any:
    """A client of a Dask cluster; LaisnError if it does not answer, or names workers that have
    not this version.
    """
    try:
        import distributed
    except ImportError:
        raise LaisnError("--cluster needs Dask: pip install laisn-sim[cluster]") from None
    dask: Any = distributed  # its types are incomplete
    try:
        client = dask.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:
        raise LaisnError(f"no Dask scheduler answers at {address}: {error}") from None

    def version_there() -> str:
        # sent by value: a worker without this package could not import a function of it
        return str(import_module("experiments.campaign.version").code_version())

    found = client.run(version_there, on_error="return")
    others = ", ".join(
        sorted(
            f"{name} ({version})" for name, version in found.items() if version != code_version()
        )
    )
    if others or not found:
        client.close()
        lacking = (
            f"laisn-sim {code_version()} is not installed on these workers of {address}: {others}"
        )
        raise LaisnError(lacking if others else f"the Dask scheduler at {address} has no workers")
    return client


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of cells and tasks."""

    store: Store
    facts: Facts | None
    # rows of tasks by their names, in their order; those that failed are missing
    tasks: Mapping[Any, list[Record]]
    failures: Mapping[Any, str]
    """What happened to missions that could not be flown, by the key of their motion, and to
    tasks, by their names.
    """

    def _stored(self, key: str) -> tuple[Any, Arrays]:
        found = self.store.get(key)
        if found is None:
            raise CampaignError(
                f"{self.store.folder}: result {key} vanished while the campaign ran"
            )
        return found

    @cached_property
    def _facts_of(self) -> Callable[[str], list[Record]]:
        """Facts of a mission, which many cells share, by the key of its motion."""
        return cache(lambda motion: self._stored(key_of(self.facts, motion))[0])

    def cell(self, plan: CellPlan) -> tuple[Record, Arrays]:
        """The row of a cell with the facts of its mission, and its arrays over runs;
        CampaignError if it is gone.
        """
        row, arrays = self._stored(plan.key)
        return row | (self._facts_of(plan.motion)[plan.follower] if self.facts else {}), arrays

    def steps(self, plan: CellPlan) -> Arrays:
        """The arrays over steps of a cell that keeps them, by name; CampaignError if it is gone."""
        return self._stored(plan.steps_key)[1]


class _Job(NamedTuple):
    """Work for a process: keys of its results, what makes it just before it is handed out, and
    the items it counts.
    """

    keys: Sequence[str]
    work: Callable[[], _Work]
    size: int = 1


def _batches(plans: Iterable[CellPlan], workers: int) -> list[list[CellPlan]]:
    """Cells of one mission at a time, few enough for a steady progress and many enough to share
    the mission.
    """
    by_mission = sorted(plans, key=lambda plan: plan.motion)
    limit = min(BATCH_STEPS, sum(plan.size for plan in by_mission) // (4 * workers))
    batches = list[list[CellPlan]]()
    size = 0
    for plan in by_mission:
        if not batches or batches[-1][0].motion != plan.motion or size + plan.size > limit:
            batches.append([])
            size = 0
        batches[-1].append(plan)
        size += plan.size
    return batches


def _keys(batch: Iterable[CellPlan]) -> list[str]:
    return [key for plan in batch for key in plan.keys]


def _cells_job(batch: Sequence[CellPlan], store: Store) -> _Job:
    return _Job(
        _keys(batch), lambda: partial(compute, mission(batch[0].scenario, store), batch), len(batch)
    )


def _attempt(name: Any, work: _Work, store: Store | None) -> tuple[Any, list[Result] | str]:
    """Results of some work by its name, or why it has none; if there is a store, they go there
    instead.
    """
    try:
        found = work()
    except CampaignError as error:
        return name, str(error).splitlines()[0]
    if store is None:
        return name, found
    for result in found:
        store.put(*result)
    return name, []


def _compute(
    what: str, jobs: Mapping[Any, _Job], store: Store, pool: Pool, quiet: bool = False
) -> dict[Any, str]:
    """Compute in parallel, and store each result as it is done; gives why jobs failed, by their
    names.

    The order is random, so that processes which share a folder share the work: a job whose results
    are stored meanwhile is left out.
    """
    failed = {}
    with progress(what, sum(job.size for job in jobs.values()), quiet=quiet) as advance:

        def missing() -> Iterator[tuple[Any, _Work, Store | None]]:
            for name in random.sample([*jobs], len(jobs)):
                if store.has(*jobs[name].keys):
                    advance(jobs[name].size)
                else:
                    yield name, jobs[name].work(), store if pool.cluster is None else None

        for name, found in pool.each(_attempt, missing()):
            if isinstance(found, str):
                failed[name] = found
            else:
                for result in found:
                    store.put(*result)
                store.written.update(jobs[name].keys)
            advance(jobs[name].size)
    return failed


def _flight(scenario: Scenario, motion: str, trajectory: Trajectory) -> Result:
    """A mission as it is stored: all scenarios that share its motion give the same bytes."""
    return motion, None, montecarlo.sited(trajectory, montecarlo.motion_of(scenario).leader).arrays


def _fly(plan: CellPlan, facts: Facts | None, batch: Sequence[CellPlan]) -> list[Result]:
    """The mission of a cell, its facts, and cells of the same mission."""
    trajectory = montecarlo.simulate_mission(plan.scenario)
    measured: list[Result] = (
        [(key_of(facts, plan.motion), facts(plan.scenario, trajectory), {})] if facts else []
    )
    return [_flight(plan.scenario, plan.motion, trajectory), *measured, *compute(trajectory, batch)]


def _rows(key: str, task: Task) -> list[Result]:
    return [(key, task(), {})]


def mission(scenario: Scenario, store: Store) -> Trajectory:
    """The stored flight of a scenario's mission, its transmitters placed; it is flown if it is
    not there.
    """
    motion = montecarlo.motion_key(scenario)
    found = store.get(motion)
    if found is not None:
        return montecarlo.sited(Trajectory.of_arrays(found[1]), scenario.leader)
    trajectory = montecarlo.simulate_mission(scenario)
    store.put(*_flight(scenario, motion, trajectory))
    return trajectory


def compile_ahead(plan: CellPlan) -> None:
    """Compile here, with a notice, what each process would else compile for itself before its
    first result.
    """
    short = plan.scenario.first_messages
    with compiling_shown():
        compute(montecarlo.simulate_mission(short), [replace(plan, scenario=short, runs=1)])


def fly(
    cells: Sequence[CellPlan],
    tasks: Mapping[Any, Task],
    folder: Path,
    *,
    facts: Facts | None = None,
    ahead: Callable[[], object] | None = None,
    tolerant: bool = False,
    **options: Unpack[ExecutionOptions],
) -> Flown:
    """Compute cells and tasks, or what is missing of them; results do not depend on workers and
    interruptions.

    Args:
        cells: scenarios with their runs.
        tasks: work of other kinds, by names.
        folder: of the results; made if it does not exist.
        facts: measured of every mission of the cells.
        ahead: compiles in this process what each worker would else compile for itself before its
            first task.
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
    pool = Pool(len(os.sched_getaffinity(0)) if workers is None else workers, cluster)
    store = Store(folder, force=options.get("force", False))
    # of plans of the same cell, one that keeps what any of them requests
    plans = {plan.key: plan for plan in sorted(cells, key=lambda plan: plan.keep_steps)}.values()
    missing = [plan for plan in plans if not store.has(*plan.keys)]
    by_motion = {plan.motion: plan for plan in plans}
    of_missing = {plan.motion for plan in missing}
    measured = {motion: [key_of(facts, motion)] if facts else [] for motion in by_motion}
    needed = {
        m for m, keys in measured.items() if not store.has(*keys, *[m] if m in of_missing else [])
    }
    keys = {name: key_of(task) for name, task in tasks.items()}
    runs = {
        n: _Job([key], partial(partial, _rows, key, tasks[n]))
        for n, key in keys.items()
        if not store.has(key)
    }
    one_mission = len({plan.motion for plan in missing}) == 1 and cluster is None and not runs
    if one_mission and all(
        p.runs >= _MANY_RUNS and find(p.scenario.navigation.variant).lanes for p in missing
    ):
        # compiled lanes run side by side in threads, without the memory of processes
        missing = [replace(plan, threads=pool.size) for plan in missing]
        pool.size = 1
    pool.size = min(pool.size, max(len(missing), len(needed), len(runs), 1))
    if cluster is None and not quiet:
        if missing and FOLDER:
            # the compiler's memory goes with its process
            with background_process() as apart:
                apart.submit(compile_ahead, missing[0]).result()
        if runs and ahead:
            with compiling_shown():
                ahead()
    with pool:
        batches = _batches(missing, pool.size)
        # so that they need not read it; commands that share a folder would compute the cells of few
        # missions twice
        many = len(needed) > FEW_MISSIONS * pool.size
        first = {
            batch[0].motion: batch
            for batch in reversed(batches)
            if many and batch[0].motion in needed
        }
        flights = {
            motion: _Job(
                [motion, *measured[motion], *_keys(batch)],
                partial(partial, _fly, plan, facts, batch),
            )
            for motion, plan, batch in ((m, by_motion[m], first.get(m, [])) for m in needed)
        }
        failures = _compute("missions", flights, store, pool, quiet) | _compute(
            "runs", runs, store, pool, quiet
        )
        if failures and not tolerant:
            raise CampaignError("; ".join(sorted(set(failures.values()))))
        later = (
            b for b in batches if b is not first.get(b[0].motion) and b[0].motion not in failures
        )
        _compute(
            "cells",
            {n: _cells_job(batch, store) for n, batch in enumerate(later)},
            store,
            pool,
            quiet,
        )
    found = {
        name: result[0] for name, key in keys.items() if (result := store.get(key)) is not None
    }
    return Flown(store=store, facts=facts, failures=failures, tasks=found)

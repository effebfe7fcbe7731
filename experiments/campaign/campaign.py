"""Campaigns: cells of runs, each computed once, on as many processes as there are, and never lost.

A cell is a scenario flown with the noise of runs 0 … R − 1. A mission is flown once and serves all its cells; cells go
to disk one by one, so that a campaign that was killed goes on where it stopped, and ends with the same bytes.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path

import numpy as np

from experiments.campaign import missions
from experiments.campaign.bound import geometry_of, least_rms, noise_of
from experiments.campaign.cells import PERCENTILES, Cell, CellResult
from experiments.campaign.montecarlo import histories, simulate_many
from experiments.campaign.processes import Pool
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import CampaignError, Record, Steps, Store
from experiments.campaign.version import code_version
from laisn import metrics
from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.lane_rows import LANES
from sim.scenario.settings import Scenario
from sim.sensing.hearing import Hearing
from sim.trajectory import Trajectory

_BATCH_STEPS = 20_000_000
"""Filter steps that a process computes before it reports: a third of a second."""


@dataclass(frozen=True, kw_only=True)
class CellPlan:
    """What a cell is to be: a scenario, the number of its runs and what to keep.

    Raises LaisnError if there is no run, or no such follower.
    """

    scenario: Scenario
    runs: int = 60
    follower: int = 0
    keep_steps: bool = False
    """Keep mean and maximum over the runs at each step, for figures."""

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise LaisnError(f"runs is {self.runs}, expected at least 1")
        if not 0 <= self.follower < len(self.scenario.followers):
            raise LaisnError(f"follower is {self.follower}, the scenario has {len(self.scenario.followers)}")

    @cached_property
    def content(self) -> Scenario:
        """What is computed of the scenario."""
        return missions.content_of(self.scenario)

    @cached_property
    def key(self) -> str:
        """Hash of all that is computed, of the number of runs and of the code version."""
        return missions.key_of(self.content, self.runs, self.follower)

    @property
    def size(self) -> int:
        """Filter steps to compute."""
        return self.runs * self.scenario.filter_steps


def _over_bound(plan: CellPlan, result: CellResult, mission: missions.Mission) -> Record:
    """RMS error of a cell beside the least possible; None for LAISN, which is nowhere near it."""
    if plan.content.navigation.variant != "tight":
        return {"bound_rms_m": None, "rms_over_bound": None}
    trajectory, _ = mission.seen(plan.content, plan.follower)
    least = least_rms(geometry_of(trajectory, Hearing.of(plan.content), plan.follower), noise_of(plan.content))
    bound = float(np.sqrt(np.mean(least**2)))
    rms = float(np.hypot(result.errors.e_p_mean_m, result.errors.e_p_std_m))
    return {"bound_rms_m": bound, "rms_over_bound": rms / bound if bound > 0.0 else None}


def _row(plan: CellPlan, result: CellResult, bound: Record) -> Record:
    """What is stored of a cell; plans of other names may share it."""
    row: Record = {
        "key": plan.key,
        "variant": plan.content.navigation.variant,
        "motion": plan.content.motion,
        "seed": plan.content.seed,
        "runs": plan.runs,
        "steps": result.steps,
        "version": code_version(),
    }
    row |= asdict(result.errors)
    for name, values in (("e_p_p{}_m", result.e_p_percentiles_m), ("e_b_p{}_deg", result.e_b_percentiles_deg)):
        row |= {name.format(p): float(value) for p, value in zip(PERCENTILES, values, strict=True)}
    row |= {"nees": result.nees, "nis": result.nis, "captured_runs": result.captured, "worst_run": result.worst_run}
    row |= bound
    row |= {f"fixes_{kind}": count for kind, count in result.fixes.items()}
    if result.table is not None:
        free = ~result.table.captured
        row["e_p_mean_uncaptured_m"] = float(result.table.e_p_mean_m[free].mean()) if free.any() else None
        row |= {f"run_{f.name}": getattr(result.table, f.name).tolist() for f in fields(result.table)}
    return row


def _few_runs(cell: Cell) -> Iterator[Floats]:
    """Estimated positions of one run after another, shape (n, 2), [m]; a few are held at a time."""
    for first in range(cell.runs.start, cell.runs.stop, LANES):
        states = histories(replace(cell, runs=range(first, min(first + LANES, cell.runs.stop))))
        yield from (states[:, :2, run] for run in range(states.shape[-1]))


def _steps(cell: Cell) -> Steps:
    """Errors at each step over all runs, and where the follower is, as the leader sees it."""
    truth, leader = cell.truth, cell.truth.leader_position
    total = {name: np.zeros(truth.speed.size) for name in ("e_p", "e_b")}
    largest = {name: np.zeros(truth.speed.size) for name in ("e_p", "e_b")}
    for found in _few_runs(cell):
        position = metrics.position_errors(found, truth.hydrophone)
        bearing = np.rad2deg(metrics.bearing_errors(found, truth.hydrophone, leader))
        for name, error in (("e_p", position), ("e_b", bearing)):
            total[name] += error
            np.maximum(largest[name], error, out=largest[name])
    away = truth.hydrophone - leader
    direction = np.arctan2(away[:, 0], away[:, 1]) - truth.leader_heading
    columns = {
        "time_s": truth.dt * np.arange(1, truth.speed.size + 1),
        "e_p_mean_m": total["e_p"] / len(cell.runs),
        "e_p_max_m": largest["e_p"],
        "e_b_mean_deg": total["e_b"] / len(cell.runs),
        "e_b_max_deg": largest["e_b"],
        "bearing_deg": np.rad2deg(np.mod(direction, 2 * np.pi)),
        "distance_m": np.hypot(*away.T),
        "speed_m_s": truth.speed,
    }
    # Single precision is a micrometre here, and halves what figures must read.
    return {name: np.asarray(values, dtype=np.float32) for name, values in columns.items()}


def compute(
    trajectory: Trajectory, plans: Sequence[CellPlan], threads: int = 1
) -> list[tuple[str, Record, Steps | None]]:
    """Compute cells of one mission: key, row and, where asked for, errors at each step."""
    mission = missions.Mission(plans[0].scenario, trajectory)
    cells = [Cell.of(plan.content, plan.follower, plan.runs, mission=mission) for plan in plans]
    results = simulate_many(cells, threads=threads, keep_runs=True)
    return [
        (plan.key, _row(plan, result, _over_bound(plan, result, mission)), _steps(cell) if plan.keep_steps else None)
        for plan, cell, result in zip(plans, cells, results, strict=True)
    ]


def _batches(plans: Sequence[CellPlan], workers: int) -> Iterator[list[CellPlan]]:
    """Cells of one mission at a time, few enough for a steady progress and many enough to share the mission."""
    total = sum(plan.size for plan in plans)
    limit = min(_BATCH_STEPS, max(total // (4 * workers), 1))
    by_mission = sorted(plans, key=lambda plan: missions.motion_key(plan.scenario))
    for _, mission in groupby(by_mission, key=lambda plan: missions.motion_key(plan.scenario)):
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


def _fly(scenario: Scenario) -> tuple[Scenario, Trajectory]:
    return scenario, missions.simulate_mission(scenario)


def fly_missions(scenarios: Iterable[Scenario], store: Store, pool: Pool, *, quiet: bool = False) -> None:
    """Fly every mission that is not stored yet, in parallel, and store it."""
    distinct = {missions.motion_key(scenario): scenario for scenario in scenarios}
    wanted = [s for s in distinct.values() if missions.read(store.flights, s) is None]
    with progress("missions", len(wanted), quiet=quiet) as advance:
        for scenario, trajectory in pool.each(_fly, ((scenario,) for scenario in wanted)):
            missions.store(store.flights, scenario, trajectory)
            advance()


def mission(scenario: Scenario, store: Store) -> Trajectory:
    """The stored flight of a scenario's mission, its transmitters placed; it is flown if it is not there."""
    trajectory = missions.read(store.flights, scenario)
    if trajectory is None:
        trajectory = missions.simulate_mission(scenario)
        missions.store(store.flights, scenario, trajectory)
    return missions.sited(trajectory, scenario.leader)


def compile_ahead(plan: CellPlan) -> None:
    """Compile here, with a word, what each process would else compile for itself before its first result."""
    two = min(2 * plan.scenario.timing.message_interval_s, plan.scenario.duration_s)
    short = plan.scenario.model_copy(update={"duration_s": two})
    with compiling_shown():
        compute(missions.simulate_mission(short), [replace(plan, scenario=short, runs=1)])


def compute_cells(plans: Sequence[CellPlan], store: Store, pool: Pool, *, quiet: bool = False) -> None:
    """Compute cells in parallel, missions that are not stored being flown first, and store each as it is done."""
    tasks = ((mission_of(batch, store), batch) for batch in _batches(plans, pool.size))
    with progress("cells", len(plans), quiet=quiet) as advance:
        for done in pool.each(compute, tasks):
            for key, row, steps in done:
                store.write(key, row, steps)
                advance()


def run(
    plans: Sequence[CellPlan],
    folder: Path,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    force: bool = False,
    quiet: bool = False,
) -> list[Record]:
    """Compute a campaign, or what is missing of it.

    Args:
        plans: the cells.
        folder: of the results; made if it is not there.
        workers: local processes; None: one for each core.
        cluster: address of a Dask scheduler (tcp://…); its workers compute instead.
        force: compute all cells again.
        quiet: show no progress.

    Returns:
        The rows of all cells, in the order of the plans: the same whatever the workers and interruptions.

    Raises:
        ValueError: there is no cell, the folder is of another version, or the cluster cannot be used.
        CampaignError: a process died, a mission diverged or the sources changed; what was computed is stored.
    """
    if not plans:
        raise ValueError("the campaign has no cells")
    processes = Pool(len(os.sched_getaffinity(0)) if workers is None else workers, cluster)
    store = Store(folder, force=force)
    missing = missing_cells(plans, store)
    if missing:
        if cluster is None and not quiet:
            compile_ahead(missing[0])
        with processes as pool:
            fly_missions((plan.scenario for plan in missing), store, pool, quiet=quiet)
            compute_cells(missing, store, pool, quiet=quiet)
    return [stored_row(plan, store) for plan in plans]


def mission_of(batch: Sequence[CellPlan], store: Store) -> Trajectory:
    """The flight that a batch shares."""
    return mission(batch[0].scenario, store)


def stored_row(plan: CellPlan, store: Store) -> Record:
    """The row of a cell that was computed, under the names that this plan gives it."""
    row = store.read(plan.key)
    if row is None:
        raise CampaignError(f"{store.folder}: cell {plan.key} of {plan.scenario.name} vanished while it was computed")
    return {"key": plan.key, "mission": plan.scenario.name} | row

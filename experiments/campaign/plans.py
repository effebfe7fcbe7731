"""Plans of cells: a scenario flown with the noise of runs 0 … R − 1, its key, and the row that comes of it."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property

import numpy as np

from experiments.campaign import missions
from experiments.campaign.bound import geometry_of, least_rms, noise_of
from experiments.campaign.cells import PERCENTILES, Cell, CellResult
from experiments.campaign.montecarlo import histories, simulate_many
from experiments.campaign.store import PER_RUN, PER_STEP, Arrays, Record
from experiments.campaign.version import code_version
from laisn import metrics
from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.lane_rows import LANES
from laisn.navigators import find
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory


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

    @cached_property
    def motion(self) -> str:
        """Key of its mission, which others may share."""
        return missions.motion_key(self.scenario)

    @property
    def size(self) -> int:
        """Filter steps to compute."""
        return self.runs * self.scenario.filter_steps


def _over_bound(plan: CellPlan, result: CellResult, mission: missions.Mission) -> Record:
    """RMS error of a cell beside the least possible; None for navigators that are nowhere near it."""
    if not find(plan.content.navigation.variant).near_bound:
        return {"bound_rms_m": None, "rms_over_bound": None}
    trajectory, _ = mission.seen(plan.content, plan.follower)
    least = least_rms(
        geometry_of(trajectory, plan.content, plan.follower),
        noise_of(plan.content, plan.follower),
    )
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
    row |= {
        "nees": result.nees,
        "nis": result.nis,
        "mirror_locked_runs": result.mirror_locked,
        "worst_run": result.worst_run,
    }
    row |= bound
    row |= {f"fixes_{kind}": count for kind, count in result.fixes.items()}
    if result.table is not None:
        free = ~result.table.mirror_locked
        row["e_p_mean_unlocked_m"] = float(result.table.e_p_mean_m[free].mean()) if free.any() else None
    return row


def _few_runs(cell: Cell) -> Iterator[Floats]:
    """Estimated positions of one run after another, shape (n, 2), [m]; a few are held at a time."""
    for first in range(cell.runs.start, cell.runs.stop, LANES):
        states = histories(replace(cell, runs=range(first, min(first + LANES, cell.runs.stop))))
        yield from (states[:, :2, run] for run in range(states.shape[-1]))


def steps_of(cell: Cell) -> Arrays:
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


def _arrays(plan: CellPlan, cell: Cell, result: CellResult) -> Arrays:
    table = result.table
    runs = {f"{PER_RUN}{f.name}": getattr(table, f.name) for f in fields(table)} if table else {}
    steps = steps_of(cell) if plan.keep_steps else {}
    return runs | {f"{PER_STEP}{name}": values for name, values in steps.items()}


def compute(trajectory: Trajectory, plans: Sequence[CellPlan], threads: int = 1) -> list[tuple[str, Record, Arrays]]:
    """Compute cells of one mission: key, row and arrays of each run and, where asked for, of each step."""
    mission = missions.Mission(plans[0].scenario, trajectory)
    cells = [Cell.of(plan.content, plan.follower, plan.runs, mission=mission) for plan in plans]
    results = simulate_many(cells, threads=threads, keep_runs=True)
    return [
        (plan.key, _row(plan, result, _over_bound(plan, result, mission)), _arrays(plan, cell, result))
        for plan, cell, result in zip(plans, cells, results, strict=True)
    ]

"""Plans of cells: a scenario flown with the noise of runs 0 … R − 1, its key, and the row that comes of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from experiments.campaign import missions
from experiments.campaign.bound import geometry_of, least_rms, noise_of
from experiments.campaign.cells import Cell, CellResult
from experiments.campaign.montecarlo import histories, simulate_many
from experiments.campaign.store import Arrays, Record, Result, key_of
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
        """Key of its row and of its arrays over runs."""
        return key_of(missions.nameless(self.content), self.runs, self.follower)

    @property
    def steps_key(self) -> str:
        """Key of errors at each step over all runs."""
        return key_of(self.key, "steps")

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of all its results."""
        return (self.key, self.steps_key) if self.keep_steps else (self.key,)

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
    least = least_rms(geometry_of(trajectory, plan.content, plan.follower), noise_of(plan.content, plan.follower))
    bound = float(np.sqrt(np.mean(least**2)))
    rms = float(np.hypot(result.row["e_p_mean_m"], result.row["e_p_std_m"]))
    return {"bound_rms_m": bound, "rms_over_bound": rms / bound if bound > 0.0 else None}


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


def compute(trajectory: Trajectory, plans: Sequence[CellPlan], threads: int = 1) -> list[Result]:
    """Compute cells of one mission: the row and the arrays over runs of each and, where asked for, over steps."""
    mission, results = missions.Mission(plans[0].scenario, trajectory), list[Result]()
    cells = [Cell.of(plan.content, plan.follower, plan.runs, mission=mission) for plan in plans]
    for plan, cell, result in zip(plans, cells, simulate_many(cells, threads=threads), strict=True):
        # plans of other names may share it
        what = {"key": plan.key, "variant": plan.content.navigation.variant, "motion": plan.content.motion}
        row = what | {"version": code_version()} | result.row | _over_bound(plan, result, mission)
        results.append((plan.key, row, result.runs))
        if plan.keep_steps:
            results.append((plan.steps_key, None, steps_of(cell)))
    return results

"""Plans of cells: a scenario flown with the noise of runs 0 … R − 1, its key, and the row of its result."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from experiments.campaign import missions
from experiments.campaign.bound import geometry_of, least_rms, noise_of
from experiments.campaign.cells import Cell, CellResult, Disturbance
from experiments.campaign.montecarlo import histories, simulate_many
from experiments.campaign.store import Arrays, Record, Result, key_of
from experiments.campaign.version import code_version
from laisn import metrics
from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.lane_passes import LANES
from laisn.navigators import find
from laisn.plugins import find_class
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory, leveled


@dataclass(frozen=True, kw_only=True)
class CellPlan:
    """What a cell is to be: a scenario, the number of its runs and what to keep.

    Raises LaisnError if there is no run, or no such follower.
    """

    scenario: Scenario
    runs: int = 60
    follower: int = 0
    first_run: int = 0
    keep_steps: bool = False
    """Keep mean and maximum over the runs at each step, for figures."""
    level_leader: bool = False
    """Sense and navigate behind a leader that keeps level on the same track."""
    disturb: Mapping[str, Any] = field(default_factory=dict)
    """`use`, a `Disturbance` by its name "module:Class" in a plugin or a built-in study, and its arguments; or none."""
    lag_s: float = 0.0
    """With a navigator near the bound: what smoothing with so much later messages could reach, beside the bound [s]."""

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
        others = self.runs, self.follower, self.first_run, self.level_leader, self.lag_s, dict(self.disturb)
        own = [_disturbing(name).disturb for name in [self.disturb.get("use", "")] if _OWN.fullmatch(name)]
        return key_of(missions.nameless(self.content), *others, *own)

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


_OWN = re.compile(r"(experiments\.studies\.[a-z_]+\.[a-z_]+):[A-Za-z]+")
"""Names of classes of the built-in studies, which study files may give as if they were in a plugin."""


def _disturbing(name: str) -> Any:
    """The class of a name; LaisnError if there is none, or it cannot disturb measurements."""
    own = _OWN.fullmatch(name)
    try:
        found = getattr(import_module(own[1]), name.partition(":")[2], None) if own else None
    except ImportError:
        found = None
    found = found if own else find_class("disturbance", name, "disturb")
    if not isinstance(found, type) or not hasattr(found, "disturb") or (own and found.__module__ != own[1]):
        raise LaisnError(f"disturb.use: {name!r:.100}: expected a class with `disturb(measurements, seed, run)`")
    return found


def disturbance_of(table: Mapping[str, Any]) -> Disturbance | None:
    """The disturbance of a table; None of an empty one.

    Raises:
        LaisnError: there is no such class, or it does not take these arguments.
    """
    if not table:
        return None
    name, given = str(table.get("use", "")), {key: value for key, value in table.items() if key != "use"}
    try:
        found: Disturbance = _disturbing(name)(**given)
    except (TypeError, ValueError) as error:
        raise LaisnError(f"disturb: {name}: {error}") from None
    return found


def _over_bound(plan: CellPlan, result: CellResult, mission: missions.Mission) -> Record:
    """RMS error of a cell beside the least possible; None for navigators that are nowhere near it."""
    if not find(plan.content.navigation.variant).near_bound:
        return {"bound_rms_m": None, "rms_over_bound": None}
    bound, smoothed = (float(np.sqrt(np.mean(_least(plan, mission, lag) ** 2))) for lag in (0.0, plan.lag_s))
    rms = float(np.hypot(result.row["e_p_mean_m"], result.row["e_p_std_m"]))
    row = {"bound_rms_m": bound, "rms_over_bound": rms / bound if bound > 0.0 else None}
    return row | ({"bound_smoothed_rms_m": smoothed} if plan.lag_s else {})


def _least(plan: CellPlan, mission: missions.Mission, lag: float = 0.0) -> Floats:
    """Cramér–Rao bound of the RMS position error after each step, shape (n,), [m]."""
    trajectory, _ = mission.seen(plan.content, plan.follower)
    geometry = geometry_of(trajectory, plan.content, plan.follower)
    return least_rms(geometry, noise_of(plan.content, plan.follower), lag)


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
    """Compute cells of one mission: the row and the arrays over runs of each and, on request, over steps."""
    results = list[Result]()
    behind = {level: missions.Mission(plans[0].scenario, leveled(trajectory) if level else trajectory)
              for level in {plan.level_leader for plan in plans}}  # fmt: skip
    cells = [
        Cell.of(plan.content, plan.follower, range(plan.first_run, plan.first_run + plan.runs),
                mission=behind[plan.level_leader], disturbance=disturbance_of(plan.disturb))
        for plan in plans
    ]  # fmt: skip
    for plan, cell, result in zip(plans, cells, simulate_many(cells, threads=threads), strict=True):
        # plans of other names may share it
        what = {"key": plan.key, "variant": plan.content.navigation.variant, "motion": plan.content.motion}
        row = what | {"version": code_version()} | result.row | _over_bound(plan, result, behind[plan.level_leader])
        results.append((plan.key, row, result.runs))
        if plan.keep_steps:
            near = find(plan.content.navigation.variant).near_bound
            bound = {"bound_m": _least(plan, behind[plan.level_leader]).astype(np.float32)} if near else {}
            results.append((plan.steps_key, None, steps_of(cell) | bound))
    return results

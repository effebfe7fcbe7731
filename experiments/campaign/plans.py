"""Plans of cells: a scenario flown with the noise of some runs, its key, and the row of its
result.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pkgutil import resolve_name
from typing import Any

import numpy as np

from experiments.campaign.montecarlo import (
    CampaignMission,
    Cell,
    CellSettings,
    Disturbance,
    histories,
    simulate,
)
from experiments.campaign.store import Arrays, Record, Result, derived_key, key_of
from laisn import metrics
from laisn.errors import LaisnError
from laisn.navigators import find
from laisn.plugins import find_class
from reports.bound import geometry_of, least_rms, noise_of
from sim.scenario.class_keys import class_arguments
from sim.scenario.file import assigned, validate
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory, tilted

Facts = Callable[[MotionSettings, Trajectory], list[Record]]
"""A function that measures the facts of a mission, figures of its motion beside those of cells: a
record for each follower.
"""


@lru_cache(maxsize=8)
def _version_of(facts: Facts) -> str:
    return key_of(facts)


def facts_key(facts: Facts, motion_key: str) -> str:
    """Key of the facts of a mission, by the key of its motion."""
    return derived_key(_version_of(facts), motion_key)


@dataclass(frozen=True, kw_only=True)
class CellPlan:
    """A scenario, the number of its runs and what to keep; LaisnError if there is no run, or no
    such follower.
    """

    scenario: Scenario
    runs: int = 60
    follower: int = 0
    first_run: int = 0
    keep_steps: bool = False  # keep mean and maximum over the runs at each step, for figures
    leader_pitch_deg: float | None = None
    """Sense and navigate behind a leader that keeps this pitch on the same track; None: its own."""
    measured: Mapping[str, str] = field(default_factory=dict)
    """Columns of `facts` by the keys of the scenario that take their values, such as the pitch that
    a navigator expects of the leader.
    """
    facts: Facts | None = None
    threads: int = 1  # number of threads that compute it; the result does not depend on them
    disturb: Mapping[str, Any] = field(default_factory=dict)
    """`use`, a `Disturbance` by its name "module:Class" in a plugin or a built-in study, and its
    arguments; or none.
    """
    lag_s: float = 0.0
    """By how much later messages may be that the bound of smoothing uses [s]; 0: it is not
    computed, nor for navigators that are not compared with the bound.
    """

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise LaisnError(f"runs is {self.runs}, expected at least 1")
        if not 0 <= self.follower < len(self.scenario.followers):
            raise LaisnError(
                f"follower is {self.follower}, the scenario has {len(self.scenario.followers)}"
            )
        # frozen: it is the scenario as this follower navigates
        object.__setattr__(self, "scenario", self.scenario.navigated_as(self.follower))

    @cached_property
    def key(self) -> str:
        """Key of its row and of its arrays over runs."""
        others: tuple[Any, ...] = (
            self.runs,
            self.follower,
            self.first_run,
            self.leader_pitch_deg,
            self.lag_s,
        )
        others += (dict(self.disturb), dict(self.measured), self.facts)
        name = self.disturb.get("use", "")
        functions = [_disturbing(name).disturb] if name.startswith(_BUILT_IN) else []
        return key_of(CellSettings.of(self.scenario), *others, *functions)

    @property
    def steps_key(self) -> str:
        return derived_key(self.key, "steps")

    @property
    def keys(self) -> tuple[str, ...]:
        return (self.key, self.steps_key) if self.keep_steps else (self.key,)

    @cached_property
    def motion_key(self) -> str:
        """Key of the motion of its mission, which others may share."""
        return key_of(MotionSettings.of(self.scenario))

    @property
    def size(self) -> int:
        """Filter steps to compute."""
        return self.runs * self.scenario.filter_steps


_BUILT_IN = "experiments.studies."
"""Start of names of classes of the built-in studies, which study files may give as if they were
in a plugin.
"""


def _disturbing(name: str) -> Any:
    """The class of a name; LaisnError if there is none, or it cannot disturb measurements."""
    kind = None
    if name.startswith(_BUILT_IN):
        with suppress(ImportError, AttributeError, ValueError):
            kind = resolve_name(name)
    else:
        kind = find_class("disturbance", name, "disturb")
    if not isinstance(kind, type) or not hasattr(kind, "disturb"):
        raise LaisnError(
            f"disturb.use: {name!r:.100}: expected a class with `disturb(measurements, seed, run)`"
        )
    return kind


def disturbance_of(table: Mapping[str, Any]) -> Disturbance | None:
    """The disturbance of a table, None of an empty one; LaisnError if the class, or an argument,
    does not exist, or an argument is of another type.
    """
    if not table:
        return None
    name = str(table.get("use", ""))
    keys = {key: value for key, value in table.items() if key != "use"}
    kind = _disturbing(name)
    arguments = class_arguments(kind, name, keys, "disturb")
    try:
        return kind(**arguments)
    except (TypeError, ValueError) as error:
        raise LaisnError(f"disturb: {name}: {error}") from None


def steps_of(cell: Cell) -> Arrays:
    """Mean and largest errors at each step over all runs, and bearing, distance and speed of the
    follower; shape (n,) each.
    """
    truth = cell.truth
    leader = cell.truth.leader_position
    total = np.zeros((2, truth.speed.size))
    largest = np.zeros((2, truth.speed.size))
    for runs in cell.blocks:
        for states in np.moveaxis(histories(replace(cell, runs=runs))[:, :2], -1, 0):
            bearing = metrics.bearing_errors(states, truth.hydrophone, leader)
            errors = np.stack(
                [metrics.position_errors(states, truth.hydrophone), np.rad2deg(bearing)]
            )
            total = total + errors
            largest = np.maximum(largest, errors)
    separation = truth.hydrophone - leader
    mean = total / len(cell.runs)
    direction = np.arctan2(separation[:, 0], separation[:, 1]) - truth.leader_heading
    columns = {
        "time_s": truth.dt * np.arange(1, truth.speed.size + 1),
        "e_p_mean_m": mean[0],
        "e_p_max_m": largest[0],
        "e_b_mean_deg": mean[1],
        "e_b_max_deg": largest[1],
        "bearing_deg": np.rad2deg(np.mod(direction, 2 * np.pi)),
        "distance_m": np.hypot(*separation.T),
        "speed_m_s": truth.speed,
    }
    # four bytes each: exact to micrometres at such values
    return {name: np.asarray(values, dtype=np.float32) for name, values in columns.items()}


def compute(trajectory: Trajectory, plans: Sequence[CellPlan]) -> list[Result]:
    """Compute cells of one mission: the row and the arrays over runs of each and, on request,
    over steps.
    """
    if not plans:
        return []
    mission_of_pitch = {}
    # alike of all cells of a mission
    motion_settings = MotionSettings.of(plans[0].scenario)
    for pitch in {plan.leader_pitch_deg for plan in plans}:
        motion = trajectory if pitch is None else tilted(trajectory, np.deg2rad(pitch))
        mission_of_pitch[pitch] = CampaignMission(motion_settings, motion)
    results = list[Result]()
    for plan in plans:
        runs = range(plan.first_run, plan.first_run + plan.runs)
        disturbance = disturbance_of(plan.disturb)
        scenario = plan.scenario
        mission = mission_of_pitch[plan.leader_pitch_deg]
        steps = Arrays()
        adjusted = scenario
        variant = scenario.navigation.variant
        if plan.measured and plan.facts:
            facts = plan.facts(motion_settings, trajectory)[plan.follower]
            values = {key: facts.get(name) for key, name in plan.measured.items()}
            adjusted = validate(assigned(scenario.model_dump(mode="json"), values), scenario.name)
        cell = Cell.of(adjusted, plan.follower, runs, mission=mission, disturbance=disturbance)
        result = simulate(cell, threads=plan.threads)
        # without the name, as plans of others may share it
        row: Record = {
            "variant": variant,
            **result.row,
            "bound_rms_m": None,
            "rms_over_bound": None,
        }
        settings = CellSettings.of(scenario)
        noise = noise_of(settings.sensing, settings.navigation, plan.follower)
        has_bound = noise.has_bound and not scenario.navigation.further_links
        if find(variant).compare_with_crlb and has_bound:
            seen_motion, _ = mission.motion_and_measurements(settings, plan.follower)
            geometry = geometry_of(seen_motion, settings.sensing, plan.follower)
            bound_rms = least_rms(geometry, noise)
            bound = float(np.sqrt(np.mean(bound_rms**2)))
            rms = float(np.hypot(row["e_p_mean_m"], row["e_p_std_m"]))
            row |= {"bound_rms_m": bound, "rms_over_bound": rms / bound if bound > 0.0 else None}
            if plan.lag_s:
                row["bound_smoothed_rms_m"] = float(
                    np.sqrt(np.mean(least_rms(geometry, noise, plan.lag_s) ** 2))
                )
            steps = {"bound_m": bound_rms.astype(np.float32)}
        results.append((plan.key, row, result.runs))
        if plan.keep_steps:
            results.append((plan.steps_key, None, steps_of(cell) | steps))
    return results

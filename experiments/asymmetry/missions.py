"""Missions of the pitch study: a leader and one follower in a condition, and the results of one arm on it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from experiments.asymmetry.conditions import OFFSETS_M, Condition, first_run, scenario
from experiments.asymmetry.map import fix_error
from experiments.asymmetry.remedies import STEADIED
from experiments.campaign.missions import Mission
from experiments.flight.library import ROUTES
from laisn.arrays import Floats
from laisn.settings import Variant
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.ahrs import apparent_tilt, measured_attitude, random_error
from sim.sensing.observation import SITES
from sim.trajectory import Trajectory, leveled, tilted


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much of the study is flown."""

    routes: tuple[str, ...] = ROUTES
    offsets_m: tuple[float, ...] = OFFSETS_M
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    looks: tuple[int, ...] = (64, 192, 512, 1280, 5120)
    """Numbers of runs after which verdicts are asked for: of every cell, then of those whose verdict is open."""
    duration_s: float = 1000.0

    @property
    def runs(self) -> int:
        """Runs of every cell."""
        return self.looks[0]


QUICK = Plan(
    routes=("T3", "T8"),
    offsets_m=(0.0, 5.0, 10.0),
    variants=("laisn-2",),
    looks=(64,),
    duration_s=200.0,
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """Result of one arm on one mission; errors are E_P and E_B of the paper over all steps of the first `runs` runs."""

    condition: str
    cause: str
    route: str
    depth_offset_m: float
    variant: str
    arm: str
    first_run: int
    """Number of the first of its runs, which no other mission has."""
    runs: int
    e_p_mean_m: float
    e_p_run_mean_m: tuple[float, ...]
    """Mean E_P of each run [m], also of those that were flown later because a verdict was open."""
    captured_run: tuple[bool, ...]
    """Whether each run was captured, also of those that were flown later because a verdict was open."""
    e_p_std_m: float
    e_p_95_m: float
    e_p_max_m: float
    e_b_mean_deg: float
    captured: int
    gated: int
    pitch_rms_deg: float
    """Root mean square of the leader's pitch."""
    pitch_max_deg: float
    range_mean_m: float
    depth_offset_rms_m: float
    """True root mean square of Δz."""
    fix_error_m: float
    """Mean over the messages of what pitch does to a noiseless fix of LAISN-2, in closed form."""
    inclinometer_rms_deg: float
    """Error of pitch as the AHRS's inclinometer reads it."""
    ahrs_rms_deg: float
    """Error of pitch as the AHRS gives it."""
    error_verdict: str = ""
    """Verdict on a remedy by errors in runs without capture; empty where none is given."""
    capture_verdict: str = ""
    """Verdict on a remedy by captures; empty where none is given."""


def _rms_deg(error: Floats, sigma: float) -> float:
    """Root mean square of an error over time and of an independent random one, both in [rad]."""
    return float(np.rad2deg(np.sqrt(np.mean(error**2) + sigma**2)))


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A leader and one follower on a mission."""

    motion: Trajectory
    condition: Condition
    route: str
    offset: float
    """Depth of the follower below the leader's mean depth [m]."""

    def scenario(self, settings: Mapping[str, Any] = MappingProxyType({})) -> Scenario:
        """The mission's scenario, with settings of an arm."""
        duration = round(float(self.motion.time[-1]), 6)
        return scenario(self.condition, self.route, self.offset, duration, settings)

    @property
    def first_run(self) -> int:
        """Number of its run 0."""
        return first_run(self.condition, self.route, self.offset)

    @cached_property
    def real(self) -> Mission:
        """Behind the leader as it moved."""
        return Mission(self.scenario(), self.motion)

    @cached_property
    def level(self) -> Mission:
        """Behind a leader that kept level on the same track."""
        return Mission(self.scenario(), leveled(self.motion))

    def tilted(self, pitch_deg: float) -> Mission:
        """Behind a leader that kept a constant pitch on the same track."""
        return Mission(self.scenario(), tilted(leveled(self.motion), np.deg2rad(pitch_deg)))

    @cached_property
    def facts(self) -> dict[str, float]:
        """Pitch and geometry of the mission: fields of `Row`."""
        both = self.motion
        ahrs = self.scenario(STEADIED.settings).sensors
        apart = both.position[:, 1] - both.position[:, 0]
        pitch = np.rad2deg(both.pitch[:, 0])
        steadied = measured_attitude(both, ahrs)
        reading, left = np.deg2rad(ahrs.leader_attitude_sigma_deg), random_error(ahrs).sigma
        _, truth = self.real.seen(self.scenario(), 0)
        sent = truth.emission_step * round(truth.dt / CONTROL_STEP_S)
        bearing = np.arctan2(apart[sent, 0], apart[sent, 1]) - both.heading[sent, 0]
        moved = fix_error(both.pitch[sent, 0], -apart[sent, 2], np.hypot(*apart[sent, :2].T), bearing)
        return {
            "pitch_rms_deg": float(np.sqrt(np.mean(pitch**2))),
            "pitch_max_deg": float(np.abs(pitch).max()),
            "range_mean_m": float(np.hypot(*apart[:, :2].T).mean()),
            "depth_offset_rms_m": float(np.sqrt(np.mean(apart[:, 2] ** 2))),
            "fix_error_m": float(moved.mean()),
            "inclinometer_rms_deg": _rms_deg(apparent_tilt(both)[:, 0] - both.pitch[:, 0], reading),
            "ahrs_rms_deg": _rms_deg(steadied[:, 0] - both.pitch[:, 0], left),
        }


def pair(fleet: Trajectory, follower: int, condition: Condition, route: str, offset: float) -> Pair:
    """Leader and one follower out of a fleet, with the sites that sensing needs."""
    motion = fleet.only((0, follower + 1), SITES)
    return Pair(motion=motion, condition=condition, route=route, offset=offset)

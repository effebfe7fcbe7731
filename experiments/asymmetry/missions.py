"""Missions of the pitch study: what one follower's sensors see of a condition, and the results of one arm on it."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.asymmetry.conditions import OFFSETS_M, Condition, scenario
from experiments.asymmetry.map import fix_error
from experiments.asymmetry.remedies import AHRS
from experiments.flight.library import ROUTES
from laisn.arrays import Floats
from laisn.settings import NavigationSettings, Variant
from sim.flight import laisn_settings
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing.ahrs import apparent_tilt, measured_attitude, random_error
from sim.sensing.hearing import Hearing
from sim.sensing.observation import SITES, observe
from sim.sensing.truth import MissionTruth
from sim.trajectory import Trajectory, leveled


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much of the study is flown."""

    routes: tuple[str, ...] = ROUTES
    offsets_m: tuple[float, ...] = OFFSETS_M
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    looks: tuple[int, ...] = (64, 192, 512, 1280)
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


def pair(trajectory: Trajectory, follower: int) -> Trajectory:
    """Leader and one follower out of a fleet, with the sites that sensing needs."""
    return trajectory.only((0, follower + 1), SITES)


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """What one follower's sensors see behind the real leader, behind a level one, and of the real one's AHRS."""

    real: MissionTruth
    level: MissionTruth
    ahrs: MissionTruth
    """What sensors see behind the real leader, which broadcasts the attitude that `AHRS` measures."""
    settings: NavigationSettings
    facts: dict[str, float]
    """Pitch and geometry of the mission: fields of `Row`."""


def _rms_deg(error: Floats, sigma: float) -> float:
    """Root mean square of an error over time and of an independent random one, both in [rad]."""
    return float(np.rad2deg(np.sqrt(np.mean(error**2) + sigma**2)))


def sense(both: Trajectory, condition: Condition, route: str, offset: float, duration: float) -> Sensed:
    """Observe a pair of vehicles twice."""
    one = scenario(condition, route, offset, duration)
    apart = both.position[:, 1] - both.position[:, 0]
    pitch = np.rad2deg(both.pitch[:, 0])
    steadied = measured_attitude(both, AHRS)
    reading, left = np.deg2rad(AHRS.leader_attitude_sigma_deg), random_error(AHRS).sigma
    real = observe(both, Hearing.of(one))
    sent = real.emission_step * round(real.dt / CONTROL_STEP_S)
    bearing = np.arctan2(apart[sent, 0], apart[sent, 1]) - both.heading[sent, 0]
    moved = fix_error(both.pitch[sent, 0], -apart[sent, 2], np.hypot(*apart[sent, :2].T), bearing)
    return Sensed(
        real=real,
        level=observe(leveled(both), Hearing.of(one)),
        ahrs=replace(real, sent_attitude=steadied[sent]),
        settings=laisn_settings(one, both, 0),
        facts={
            "pitch_rms_deg": float(np.sqrt(np.mean(pitch**2))),
            "pitch_max_deg": float(np.abs(pitch).max()),
            "range_mean_m": float(np.hypot(*apart[:, :2].T).mean()),
            "depth_offset_rms_m": float(np.sqrt(np.mean(apart[:, 2] ** 2))),
            "fix_error_m": float(moved.mean()),
            "inclinometer_rms_deg": _rms_deg(apparent_tilt(both)[:, 0] - both.pitch[:, 0], reading),
            "ahrs_rms_deg": _rms_deg(steadied[:, 0] - both.pitch[:, 0], left),
        },
    )

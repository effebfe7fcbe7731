"""The pitch study on missions: what each cause of pitch does to followers, and what each remedy is worth.

A condition is flown with followers on all routes in the water at once. Each of them then navigates 60 times with
the same noise behind the leader as it moved (real) and behind one that kept level, and with every remedy. What differs
between two arms of a condition is therefore the pitch, or the remedy, and nothing else.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from experiments.asymmetry.conditions import OFFSETS_M, SEED, Condition, fleet, scenario
from experiments.asymmetry.remedies import AHRS, ARMS, Arm
from experiments.campaign.cells import PERCENTILES, Cell, CellResult
from experiments.campaign.montecarlo import simulate
from experiments.flight.library import ROUTES
from laisn.settings import NavigationSettings, Variant
from sim.flight import navigation_settings
from sim.motion import move
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing.ahrs import apparent_tilt, measured_attitude, random_error
from sim.sensing.hearing import Hearing
from sim.sensing.observation import SITES, errors_of, observe
from sim.sensing.sensor_errors import SensorErrors
from sim.sensing.truth import MissionTruth
from sim.tilt import leveled
from sim.trajectory import Trajectory

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much of the study is flown."""

    routes: tuple[str, ...] = ROUTES
    offsets_m: tuple[float, ...] = OFFSETS_M
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-1", "laisn-3-2")
    runs: int = 60
    duration_s: float = 1000.0


QUICK = Plan(
    routes=("T3", "T8"),
    offsets_m=(0.0, 5.0, 10.0),
    variants=("laisn-2",),
    runs=20,
    duration_s=200.0,
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """Result of one arm on one mission; errors are E_P and E_B of the paper over all steps and runs."""

    condition: str
    cause: str
    route: str
    depth_offset_m: float
    variant: str
    arm: str
    runs: int
    e_p_mean_m: float
    e_p_run_mean_m: tuple[float, ...]
    """Of each run."""
    e_p_std_m: float
    e_p_95_m: float
    e_p_max_m: float
    e_b_mean_deg: float
    captured: int
    gated: int
    pitch_rms_deg: float
    """Of the leader."""
    pitch_max_deg: float
    range_mean_m: float
    depth_offset_rms_m: float
    """True root mean square of Δz."""
    inclinometer_rms_deg: float
    """Error of pitch as the AHRS's inclinometer reads it."""
    ahrs_rms_deg: float
    """Error of pitch as the AHRS gives it."""


def pair(trajectory: Trajectory, follower: int) -> Trajectory:
    """Leader and one follower out of a fleet, with the sites that sensing needs."""
    return trajectory.only((0, follower + 1), SITES)


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """What one follower's sensors see behind the real leader, behind a level one, and of the real one's AHRS."""

    real: MissionTruth
    level: MissionTruth
    ahrs: MissionTruth
    """As `real`, with the attitude that `AHRS` measures."""
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
    return Sensed(
        real=real,
        level=observe(leveled(both), Hearing.of(one)),
        ahrs=replace(real, sent_attitude=steadied[sent]),
        settings=navigation_settings(one, both, 0),
        facts={
            "pitch_rms_deg": float(np.sqrt(np.mean(pitch**2))),
            "pitch_max_deg": float(np.abs(pitch).max()),
            "range_mean_m": float(np.hypot(*apart[:, :2].T).mean()),
            "depth_offset_rms_m": float(np.sqrt(np.mean(apart[:, 2] ** 2))),
            "inclinometer_rms_deg": _rms_deg(apparent_tilt(both)[:, 0] - both.pitch[:, 0], reading),
            "ahrs_rms_deg": _rms_deg(steadied[:, 0] - both.pitch[:, 0], left),
        },
    )


def cell(sensed: Sensed, errors: SensorErrors, arm: Arm, variant: Variant, runs: int) -> Cell:
    """The runs of one arm and variant of a mission."""
    random = random_error(arm.sensors)
    expected = float(np.deg2rad(sensed.facts["pitch_rms_deg"])) if arm.expect_pitch else 0.0
    truth: MissionTruth = getattr(sensed, arm.seen)
    return Cell(
        truth=truth,
        errors=replace(
            errors,
            leader_pitch_sigma=random.sigma,
            leader_roll_sigma=random.sigma,
            leader_attitude_time=random.time,
            leader_attitude_offset_sigma=float(np.deg2rad(arm.sensors.leader_attitude_offset_sigma_deg)),
        ),
        settings=replace(
            sensed.settings, variant=variant, use_attitude=arm.use_attitude, expected_pitch=expected
        ),
        seed=SEED,
        runs=range(runs),
    )  # fmt: skip


def row_of(result: CellResult, **others: Any) -> Row:
    """A row of the table of results, which must hold each run; `others` are the fields that no result holds."""
    if result.table is None:
        raise ValueError("the result lacks its table of runs; simulate with keep_runs=True")
    return Row(
        **others,
        runs=result.runs,
        e_p_mean_m=result.errors.e_p_mean_m,
        e_p_run_mean_m=tuple(result.table.e_p_mean_m.tolist()),
        e_p_std_m=result.errors.e_p_std_m,
        e_p_95_m=result.e_p_percentiles_m[PERCENTILES.index(95)],
        e_p_max_m=result.errors.e_p_max_m,
        e_b_mean_deg=result.errors.e_b_mean_deg,
        captured=result.captured,
        gated=result.fixes["gated"],
    )


def fly_condition(condition: Condition, offset: float, plan: Plan) -> list[Row]:
    """Fly one condition with followers on all routes at a depth offset, and navigate each in every arm and variant.

    Fleets of this size are quickest: the price of a step grows faster than the number of vehicles.
    """
    trajectory = move(fleet(condition, plan.routes, (offset,), plan.duration_s))
    rows = []
    for follower, route in enumerate(plan.routes):
        sensed = sense(pair(trajectory, follower), condition, route, offset, plan.duration_s)
        errors = errors_of(scenario(condition, route, offset, plan.duration_s))
        for arm in ARMS:
            for variant in arm.variants:
                if variant not in plan.variants:
                    continue
                result = simulate(cell(sensed, errors, arm, variant, plan.runs), keep_runs=True)
                rows.append(
                    row_of(
                        result,
                        **sensed.facts,
                        condition=condition.key,
                        cause=condition.cause,
                        route=route,
                        depth_offset_m=offset,
                        variant=variant,
                        arm=arm.key,
                    )
                )
    return rows

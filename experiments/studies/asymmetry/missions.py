"""Missions of the pitch study: a leader and one follower in a condition, navigated in all arms on the same noise.

Two arms differ in the pitch, or the remedy, and in nothing else. No two missions share noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from experiments.campaign.missions import Mission
from experiments.campaign.montecarlo import Cell, simulate
from experiments.campaign.store import Record
from experiments.intervals import mean_over_missions
from experiments.studies.asymmetry.design import AHRS, ARMS, CALM, INFLATED, Arm, Condition, Plan
from experiments.studies.asymmetry.findings import INTERVALS_S, OF_RUNS, Curve, paired, undecided, with_verdicts
from experiments.studies.asymmetry.fix_map import fix_error
from laisn.arrays import Floats
from laisn.settings import Variant
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.errors import apparent_tilt, random_error, tilt_errors
from sim.sensing.observation import SITES
from sim.simulation import simulate_motion
from sim.trajectory import Trajectory, leveled, tilted

TAU_M = (0.01, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.6)
"""τ of the rear transmitter; the first is the paper's usual one, 0.03 and 0.06 are those of its Stage 4."""
PITCH_DEG = (0.0, -1.0, -2.0, -3.0, -5.0, -7.5, -10.0, -15.0)
"""Nose down, as excess buoyancy makes a leader swim; astern, where most followers are, the lever arm and foreshortening
then add up."""


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

    def scenario(self, settings: Mapping[str, Any] | None = None) -> Scenario:
        """The mission's scenario, with settings of an arm."""
        duration = round(float(self.motion.time[-1]), 6)
        return self.condition.scenario(self.route, self.offset, duration, settings)

    def runs(self, start: int, stop: int) -> range:
        """Numbers of the mission's runs from one to another."""
        first = self.condition.first_run(self.route, self.offset)
        return range(first + start, first + stop)

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

    def cell(self, arm: Arm, variant: Variant, runs: range) -> Cell:
        """Runs of one arm and variant."""
        settings = {**arm.set, "navigation.variant": variant}
        if arm is INFLATED:
            settings["navigation.expected_pitch_deg"] = self.facts["pitch_rms_deg"]
        return Cell.of(self.scenario(settings), 0, runs, mission=self.level if arm.level else self.real)

    @cached_property
    def facts(self) -> dict[str, float]:
        """Pitch of the leader and geometry of the mission: columns of its rows.

        `fix_error_m` is the mean over the messages of what pitch does to a noiseless fix of LAISN-2, in closed form;
        `inclinometer_rms_deg` and `ahrs_rms_deg` are errors of pitch by the AHRS's inclinometer, and by the AHRS.
        """
        both, pitch = self.motion, self.motion.pitch[:, 0]
        apart = both.position[:, 1] - both.position[:, 0]
        ahrs = self.scenario(AHRS.set).sensors
        _, truth = self.real.seen(self.scenario(), 0)
        sent = truth.emission_step * round(truth.dt / CONTROL_STEP_S)
        bearing = np.arctan2(apart[sent, 0], apart[sent, 1]) - both.heading[sent, 0]
        moved = fix_error(pitch[sent], -apart[sent, 2], np.hypot(*apart[sent, :2].T), bearing)
        reading = np.deg2rad(ahrs.leader_attitude_sigma_deg)
        return {
            "pitch_rms_deg": float(np.sqrt(np.mean(np.rad2deg(pitch) ** 2))),
            "pitch_max_deg": float(np.abs(np.rad2deg(pitch)).max()),
            "range_mean_m": float(np.hypot(*apart[:, :2].T).mean()),
            "depth_offset_rms_m": float(np.sqrt(np.mean(apart[:, 2] ** 2))),
            "fix_error_m": float(moved.mean()),
            "inclinometer_rms_deg": _rms_deg(apparent_tilt(both)[:, 0] - pitch, reading),
            "ahrs_rms_deg": _rms_deg(tilt_errors(both, ahrs)[:, 0], random_error(ahrs).sigma),
        }


def pairs(condition: Condition, offset: float, plan: Plan) -> list[Pair]:
    """Missions of a condition at a depth offset, simulated as one fleet of followers on all routes."""
    fleet = simulate_motion(condition.fleet(plan.routes, offset, plan.duration_s))
    return [
        Pair(motion=fleet.only((0, i + 1), SITES), condition=condition, route=route, offset=offset)
        for i, route in enumerate(plan.routes)
    ]


def _row(cell: Cell) -> Record:
    figures, runs = simulate(cell)
    outcomes = {OF_RUNS["error"]: runs["e_p_mean_m"], OF_RUNS["mirror_lock"]: runs["mirror_locked"]}
    return {"first_run": cell.runs[0], **figures, **outcomes}


def fly_mission(mission: Pair, plan: Plan) -> list[Record]:
    """Navigate a mission in every arm and variant: a row for each, figures of which are those of the first runs.

    Arms whose verdict is open after a look are flown on, unless even the last would hardly settle it. Only outcomes
    grow.
    """
    rows = []
    for variant in plan.variants:
        arms = {arm.key: arm for arm in ARMS if variant in arm.variants}
        where = {
            "condition": mission.condition.key, "cause": mission.condition.cause, "route": mission.route,
            "depth_offset_m": mission.offset, "variant": variant,
        }  # fmt: skip
        flown: dict[str, Record] = {}
        for key, arm in arms.items():
            found = _row(mission.cell(arm, variant, mission.runs(0, plan.runs)))
            flown[key] = {**where, "arm": key, **mission.facts, **found}
        for look, further in pairwise(plan.looks):
            (compared,) = paired(flown.values())
            for key in undecided(compared, plan.looks, look):
                more = _row(mission.cell(arms[key], variant, mission.runs(look, further)))
                flown[key] |= {name: np.append(flown[key][name], more[name]) for name in OF_RUNS.values()}
        (compared,) = paired(flown.values())
        rows += with_verdicts(compared, plan.looks)
    return rows


def fly_condition(condition: Condition, offset: float, plan: Plan) -> list[Record]:
    """Rows of all missions of a condition at a depth offset."""
    return [row for mission in pairs(condition, offset, plan) for row in fly_mission(mission, plan)]


def curve_of(cells: Mapping[float, Cell], route: str, interval_s: float, depth_offset_m: float | None = None) -> Curve:
    """The curve of cells by their values; what runs of the same number share of noise drops out of the excess."""
    results = [simulate(cell) for cell in cells.values()]
    means = [result.runs["e_p_mean_m"] for result in results]
    intervals = [mean_over_missions([mean - means[0]]) for mean in means]
    return Curve(
        route=route,
        interval_s=interval_s,
        depth_offset_m=depth_offset_m,
        value=tuple(cells),
        e_p_mean_m=tuple(result.row["e_p_mean_m"] for result in results),
        excess_half_m=tuple(interval.high - interval.value for interval in intervals),
    )


def fly_curves(plan: Plan) -> list[Curve]:
    """Simulate all routes of a plan in a calm sea: over τ, and over pitch at each depth offset but zero."""
    offsets = [offset for offset in plan.offsets_m if offset > 0.0]
    curves = []
    for offset in offsets:
        for flown in pairs(CALM, offset, plan):
            runs, level, route = flown.runs(0, plan.runs), flown.tilted(0.0), flown.route
            one = flown.scenario({"timing.message_interval_s": INTERVALS_S[1]})
            tilts = {degrees: Cell.of(one, 0, runs, mission=flown.tilted(degrees)) for degrees in PITCH_DEG}
            curves.append(curve_of(tilts, route, INTERVALS_S[1], offset))
            for interval in INTERVALS_S if offset == offsets[0] else ():
                settings = {"timing.message_interval_s": interval}
                wider = {tau: {"acoustics.range_tau_m": [tau, *one.acoustics.range_tau_m[1:]]} for tau in TAU_M}
                cells = {tau: Cell.of(flown.scenario(settings | w), 0, runs, mission=level) for tau, w in wider.items()}
                curves.append(curve_of(cells, route, interval))
    return curves

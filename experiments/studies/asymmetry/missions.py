"""Missions of the pitch study: a leader and one follower in a condition, simulated in all arms on the same noise.

A condition is simulated with followers on all routes in the water at once. Each of them then navigates many times with
the same noise behind the leader as it moved (real) and behind one that kept level, and with every remedy. Two arms of a
mission differ in the pitch, or the remedy, and in nothing else. No two missions share noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from experiments.campaign.cells import Cell
from experiments.campaign.missions import Mission
from experiments.campaign.montecarlo import simulate
from experiments.campaign.store import Record
from experiments.studies.asymmetry.comparison import OF_RUNS, paired, undecided, with_verdicts
from experiments.studies.asymmetry.design import AHRS, ARMS, INFLATED, Arm, Condition, Plan
from experiments.studies.asymmetry.fix_map import fix_error
from laisn.arrays import Floats
from laisn.settings import Variant
from sim.motion import simulate_motion
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.ahrs import apparent_tilt, random_error, tilt_errors
from sim.sensing.observation import SITES
from sim.trajectory import Trajectory, leveled, tilted


def _rms_deg(error: Floats, sigma: float = 0.0) -> float:
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
        """Pitch and geometry of the mission: columns of its rows.

        - `pitch_rms_deg`, `pitch_max_deg`: of the leader; `range_mean_m`: mean horizontal distance;
        - `depth_offset_rms_m`: true root mean square of Δz;
        - `fix_error_m`: mean over the messages of what pitch does to a noiseless fix of LAISN-2, in closed form;
        - `inclinometer_rms_deg`, `ahrs_rms_deg`: errors of pitch by the AHRS's inclinometer, and by the AHRS.
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


def pair(fleet: Trajectory, follower: int, condition: Condition, route: str, offset: float) -> Pair:
    """Leader and one follower out of a fleet, with the sites that sensing needs."""
    return Pair(motion=fleet.only((0, follower + 1), SITES), condition=condition, route=route, offset=offset)


def _row(cell: Cell) -> Record:
    """Figures of a cell by the columns of `CellResult.row`, and outcomes of its runs by `OF_RUNS`."""
    figures, runs = simulate(cell)
    outcomes = {OF_RUNS["error"]: runs["e_p_mean_m"], OF_RUNS["mirror_lock"]: runs["mirror_locked"]}
    return {"first_run": cell.runs[0], **figures, **outcomes}


def fly_mission(mission: Pair, plan: Plan) -> list[Record]:
    """Navigate a mission in every arm and variant: a row for each, figures of which are those of the first runs.

    Arms whose verdict is open after a look are flown on to the next, unless even the last would hardly settle it. Only
    outcomes of single runs grow: figures do not depend on what came out.
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
    """Simulate one condition with followers on all routes at a depth offset.

    Fleets of this size are quickest: the price of a step grows faster than the number of vehicles.
    """
    trajectory = simulate_motion(condition.fleet(plan.routes, offset, plan.duration_s))
    missions = [pair(trajectory, i, condition, route, offset) for i, route in enumerate(plan.routes)]
    return [row for mission in missions for row in fly_mission(mission, plan)]

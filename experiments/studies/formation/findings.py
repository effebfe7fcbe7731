"""What the study found, and limits of the acoustic channel and behind a weaving leader, which
need no simulation.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Self

import numpy as np

from experiments.study.run import Cells, StudyResults
from laisn.bound import BoundGeometry, TrueNoise, position_bound
from reports.findings import Finding, interval_finding, median_finding, plain_finding, share_finding
from reports.intervals import mean_interval
from sim.scenario.formation import Station
from sim.scenario.settings import Acoustics, Leader, Scenario
from sim.tracking import LOST_M

RATES = (80, 500, 5000)
"""Bit rates that modems of little, middling and much bandwidth offer [bit/s]; JANUS (STANAG
4748) has 80.
"""
CHECK_BITS = 16  # checksum of a message
_AREA_M = 20_000.0
_STEP_M = 0.01
"""Side of the square that positions lie in, and their resolution: far below any follower's
uncertainty.
"""
_STEP_RAD = math.radians(0.1)
_MAX_SPEED_M_S = 5.0
_STEP_M_S = 0.01
_TILT_RAD = math.radians(90.0)  # pitch and roll lie within half of this to either side
_DAY_S = 86_400.0


def _bits(span: float, step: float) -> int:
    """Bits that distinguish the steps of a span."""
    return math.ceil(math.log2(span / step))


@dataclass(frozen=True, kw_only=True)
class LeaderBroadcast:
    """A leader's broadcast to followers on stations, and what it takes of the channel."""

    leader: Leader
    stations: tuple[Station, ...]
    acoustics: Acoustics
    interval_s: float  # between messages
    floor_depth_m: float

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The broadcast of a scenario's leader."""
        return cls(
            leader=scenario.leader,
            stations=tuple(f.station for f in scenario.followers if f.station),
            acoustics=scenario.acoustics,
            interval_s=scenario.timing.message_interval_s,
            floor_depth_m=scenario.ocean.floor_depth_m,
        )

    @property
    def message_bits(self) -> int:
        """Length of a message: its number within a day, the leader's state, its next waypoints on
        request, a checksum.
        """
        position = 2 * _bits(_AREA_M, _STEP_M)
        leader = self.leader
        bits = _bits(_DAY_S, self.interval_s) + position + CHECK_BITS
        bits += _bits(2.0 * math.pi, _STEP_RAD) + _bits(_MAX_SPEED_M_S, _STEP_M_S)
        bits += _bits(self.floor_depth_m, _STEP_M)
        bits += leader.broadcast_waypoints * (_bits(_DAY_S, 1.0) + position)
        return bits + (2 * _bits(_TILT_RAD, _STEP_RAD) if leader.broadcast_attitude else 0)

    @property
    def reach_m(self) -> float:
        """Distance from the transmitter that is farther away to the farthest station [m]."""
        half_baseline = 0.5 * (self.leader.baseline_m or 0.0)
        depth = self.leader.held_depth_m
        return max(
            math.hypot(abs(s.behind_m) + half_baseline, s.port_m, s.depth_m - depth)
            for s in self.stations
        )

    @property
    def way_s(self) -> float:
        """Time of sound to the farthest follower [s]."""
        return self.reach_m / self.acoustics.sound_speed_m_s

    def shortest_interval_s(self, rate: float) -> float:
        """Time from one broadcast to the next at a bit rate: pings, message, and its way to the
        farthest follower [s].
        """
        return 3.0 * self.acoustics.ping_slot_s + self.message_bits / rate + self.way_s

    def asked_interval_s(self, rate: float, followers: int) -> float:
        """The same if every follower interrogates for its own range: there and back for each
        [s].
        """
        return followers * (self.message_bits / rate + 2.0 * self.way_s)


WEAVES = ((0.0, 40.0), (2.0, 40.0), (5.0, 20.0), (5.0, 40.0), (5.0, 80.0), (10.0, 40.0))
"""Amplitudes [°] and periods [s] of a weaving leader's heading."""
DISTANCES_BEHIND_M = (20, 40)
_SPEED = 1.0
_DEPTH_DIFFERENCE_M = 10.0
_HALF_BASELINE_M = 1.0
_STEP = 0.1
"""Of both vehicles [m/s]; the follower below the leader [m]; half the transmitters' distance
[m]; filter step [s].
"""
_SECONDS = 300


def geometry(amplitude_deg: float, period_s: float, behind_m: float) -> BoundGeometry:
    """The mission of a follower so far behind a leader that weaves [m], a message each second."""
    delay_steps = round(behind_m / _SPEED / _STEP)
    time = _STEP * np.arange(-delay_steps, round(_SECONDS / _STEP) + 1)
    heading = np.deg2rad(amplitude_deg) * np.sin(2.0 * np.pi * time / period_s)
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(_SPEED * _STEP * ahead[1:], axis=0)])
    n = time.size - delay_steps - 1
    step = np.arange(10, n + 1, 10)
    # the follower is where the leader was `delay_steps` before
    leader = path[delay_steps:]
    follower = path[: n + 1]
    axis = _HALF_BASELINE_M * ahead[delay_steps + step]
    arms = np.stack(
        [
            np.column_stack([end * axis, np.full(step.size, -_DEPTH_DIFFERENCE_M)])
            for end in (-1.0, 1.0)
        ],
        axis=1,
    )
    separation = follower[step] - leader[step]
    speed = np.full(n, _SPEED)
    return BoundGeometry(
        dt=_STEP,
        speed=speed,
        heading=heading[1 : n + 1],
        message_step=step,
        from_leader=separation,
        arms=arms,
    )


def extra_way(amplitude_deg: float) -> float:
    """Way that a weave costs, as a share of the way made good: 1 / mean cos θ − 1."""
    swing = np.deg2rad(amplitude_deg) * np.sin(2.0 * np.pi * (np.arange(720) + 0.5) / 720)
    return float(1.0 / np.mean(np.cos(swing)) - 1.0)


@cache
def least_error(amplitude_deg: float, period_s: float, behind_m: float) -> float:
    """Root of the mean square error that no estimator of these ranges can undercut, over a
    mission [m].
    """
    bound = position_bound(geometry(amplitude_deg, period_s, behind_m), TrueNoise(start=0.01))
    return float(np.sqrt(np.mean(np.trace(bound, axis1=1, axis2=2))))


def weave_findings() -> dict[str, Finding]:
    """Least errors by weave and station, and what each weave costs of way."""
    findings = {}
    for amplitude, period in WEAVES:
        name = f"weave {amplitude:g} {period:g}"
        for distance in DISTANCES_BEHIND_M:
            meaning = (
                f"least RMS error {distance} m behind, leader's heading swings by {amplitude:g}° "
                f"each {period:g} s"
            )
            findings[f"{name} {distance}"] = plain_finding(
                least_error(amplitude, period, float(distance)), meaning, "m"
            )
        findings[f"{name} way"] = plain_finding(
            extra_way(amplitude), "way that this weave costs, as a share of the way made good"
        )
    return findings


def condition_findings(name: str, followers: Cells) -> dict[str, Finding]:
    """Findings of one condition, from a cell for each follower; intervals are over runs."""
    column = followers.values_by_run
    rms = column("station_rms_m")
    layer = column("closest_in_layer_m")
    lost = column("lost")
    by_run = mean_interval(np.median(rms, axis=1))
    power = mean_interval(column("power_mean_w").mean(axis=1))
    findings = {
        "median": median_finding(rms, "RMS distance from the station, median of followers", "m"),
        "run-median": interval_finding(
            by_run, "median of a run's followers, mean of runs, 95 %", "m"
        ),
        "worst": plain_finding(
            float(rms.max()), "RMS distance from the station, worst follower", "m"
        ),
        "p95": median_finding(
            column("station_p95_m"), "95 % of the time within, median follower", "m"
        ),
        "max": plain_finding(
            float(column("station_max_m").max()), "largest distance from a station", "m"
        ),
        "turn": plain_finding(
            float(column("station_turn_max_m").max()), "largest distance in the turn", "m"
        ),
        "leg": median_finding(column("station_leg_rms_m"), "RMS on legs, median of followers", "m"),
        "error": interval_finding(
            mean_interval(column("e_p_mean_m").mean(axis=1)), "mean E_P, mean of runs, 95 %", "m"
        ),
        "lost-runs": plain_finding(int(lost.sum()), f"followers lost, of {rms.size}"),
        "lost": share_finding(lost, "share of followers lost, 95 %"),
        "away": share_finding(
            column("track_error_end_m") > LOST_M,
            "share of followers more than 10 m off at the end, 95 %",
        ),
        "closest": plain_finding(
            float(column("closest_horizontal_m").min()),
            "least horizontal distance of two vehicles",
            "m",
        ),
        # None where every vehicle has a layer of its own
        "within": plain_finding(
            None if np.isnan(layer).all() else float(np.nanmin(layer)),
            "least horizontal distance of two vehicles of one layer",
            "m",
        ),
        "contact": share_finding(column("touched").max(axis=1), "share of runs with contact"),
        "power": interval_finding(power, "mean power of a follower's thrusters, 95 %", "W"),
    }
    return {f"{key} {name}": finding for key, finding in findings.items()}


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Findings of all conditions, and of the bound behind a weaving leader."""
    cells = outcomes["study"].cells
    findings = {
        "runs": plain_finding(
            max(len(lists["run"]) for lists in cells.lists), "runs of most conditions"
        )
    }
    for name, followers in cells.by("arm").items():
        findings |= condition_findings(name, followers)
    return findings | weave_findings()

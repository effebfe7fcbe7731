"""Limits of a formation that need no simulation: the acoustic channel, the bound behind a weaving leader.

Two transmitters on the axis do not distinguish port from starboard, nor determine the lateral distance well. A leader
that weaves turns its axis away from them: its heading swings as a sine, the follower goes where the leader went.
"""

import math
from functools import cache

import numpy as np

from experiments.findings import Finding, plain
from laisn.bound import Geometry, TrueNoise, position_bound
from sim.scenario.settings import Scenario

RATES = (80, 500, 5000)
"""Bit rates that modems of little, middling and much bandwidth offer [bit/s]; JANUS (STANAG 4748) has 80."""
CHECK_BITS = 16
"""A checksum, so that what is damaged is not taken for a message."""
_AREA_M, _STEP_M = 20_000.0, 0.01
"""Side of the square that positions lie in, and their resolution: far below any follower's uncertainty."""
_STEP_RAD = math.radians(0.1)
_FASTEST_M_S, _STEP_M_S = 5.0, 0.01
_TILT_RAD = math.radians(90.0)
"""Pitch and roll lie within half of this to either side."""
_DAY_S = 86_400.0


def _bits(span: float, step: float) -> int:
    """Bits that distinguish the steps of a span."""
    return math.ceil(math.log2(span / step))


def message_bits(scenario: Scenario) -> int:
    """Length of a message: its number within a day, the leader's state, its next waypoints on request, a checksum."""
    place = 2 * _bits(_AREA_M, _STEP_M)
    bits = [
        _bits(_DAY_S, scenario.timing.message_interval_s),
        place,
        _bits(2.0 * math.pi, _STEP_RAD),
        _bits(_FASTEST_M_S, _STEP_M_S),
        _bits(scenario.ocean.floor_depth_m, _STEP_M),
        CHECK_BITS,
    ]
    if scenario.leader.broadcast_attitude:
        bits.append(2 * _bits(_TILT_RAD, _STEP_RAD))
    bits.append(scenario.leader.broadcast_waypoints * (_bits(_DAY_S, 1.0) + place))
    return sum(bits)


def reach_m(scenario: Scenario) -> float:
    """Distance from the transmitter that is farther away to the farthest station [m]."""
    half, depth = 0.5 * (scenario.leader.baseline_m or 0.0), scenario.leader.layer_m
    stations = [follower.station for follower in scenario.followers if follower.station]
    return max(math.hypot(abs(s.behind_m) + half, s.port_m, s.depth_m - depth) for s in stations)


def shortest_interval_s(scenario: Scenario, rate: float) -> float:
    """Time from one broadcast to the next: pings, message, and its way to the farthest follower.

    Args:
        scenario: of the formation.
        rate: of the modem [bit/s].
    """
    sound = scenario.acoustics
    way = reach_m(scenario) / sound.sound_speed_m_s
    return 3.0 * sound.ping_slot_s + message_bits(scenario) / rate + way


def asked_interval_s(scenario: Scenario, rate: float, followers: int) -> float:
    """The same if every follower interrogates for its own range: there and back for each [s]."""
    way = reach_m(scenario) / scenario.acoustics.sound_speed_m_s
    return followers * (message_bits(scenario) / rate + 2.0 * way)


WEAVES = ((0.0, 40.0), (2.0, 40.0), (5.0, 20.0), (5.0, 40.0), (5.0, 80.0), (10.0, 40.0))
"""Amplitudes [°] and periods [s] of a weaving leader's heading."""
BEHIND = (20, 40)
"""How far behind the follower is, in the leader's trail [m]."""
_SPEED, _DEEPER, _HALF, _STEP = 1.0, 10.0, 1.0, 0.1
"""Of both vehicles [m/s]; the follower below the leader [m]; half the transmitters' distance [m]; filter step [s]."""
_SECONDS = 300


def geometry(amplitude_deg: float, period_s: float, behind: float) -> Geometry:
    """The mission of a follower so far behind a leader that weaves [m], a message each second."""
    late = round(behind / _SPEED / _STEP)
    time = _STEP * np.arange(-late, round(_SECONDS / _STEP) + 1)
    heading = np.deg2rad(amplitude_deg) * np.sin(2.0 * np.pi * time / period_s)
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    way = np.concatenate([np.zeros((1, 2)), np.cumsum(_SPEED * _STEP * ahead[1:], axis=0)])
    n = time.size - late - 1
    step = np.arange(10, n + 1, 10)
    # vehicles that at the last instant are where the leader was `late` steps before
    leader, follower = way[late:], way[: n + 1]
    axis = _HALF * ahead[late + step]
    arms = np.stack([np.column_stack([end * axis, np.full(step.size, -_DEEPER)]) for end in (-1.0, 1.0)], axis=1)
    return Geometry(
        dt=_STEP,
        speed=np.full(n, _SPEED),
        heading=heading[1 : n + 1],
        message_step=step,
        from_leader=follower[step] - leader[step],
        arms=arms,
    )


def longer(amplitude_deg: float) -> float:
    """Way that a weave costs, as a share of the way made good: 1 / mean cos θ − 1."""
    swing = np.deg2rad(amplitude_deg) * np.sin(2.0 * np.pi * (np.arange(720) + 0.5) / 720)
    return float(1.0 / np.mean(np.cos(swing)) - 1.0)


@cache
def least_error(amplitude_deg: float, period_s: float, behind: float) -> float:
    """Root of the mean square error that no estimator of these ranges can undercut, over a mission [m]."""
    bound = position_bound(geometry(amplitude_deg, period_s, behind), TrueNoise(start=0.01))
    return float(np.sqrt(np.mean(np.trace(bound, axis1=1, axis2=2))))


def findings() -> dict[str, Finding]:
    """Least errors by weave and station, and what each weave costs of way."""
    named = {}
    for amplitude, period in WEAVES:
        name = f"weave {amplitude:g} {period:g}"
        for behind in BEHIND:
            what = f"least RMS error {behind} m behind, leader's heading swings by {amplitude:g}° each {period:g} s"
            named[f"{name} {behind}"] = plain(least_error(amplitude, period, float(behind)), what, "m")
        named[f"{name} way"] = plain(longer(amplitude), "way that this weave costs, as a share of the way made good")
    return named

"""What the leader's broadcasts ask of an acoustic modem: bits, time on the channel, range."""

import math

from sim.scenario.settings import Scenario

RATES = (80, 500, 5000)
"""Bit rates that modems of little, middling and much bandwidth offer [bit/s]; JANUS (STANAG 4748) has 80."""
CHECK_BITS = 16
"""A checksum, so that what is damaged is not taken for a message."""
_AREA_M, _STEP_M = 20_000.0, 0.01
"""Side of the square that positions lie in, and their resolution: far below what any follower knows of its place."""
_STEP_RAD = math.radians(0.1)
_FASTEST_M_S, _STEP_M_S = 5.0, 0.01
_TILT_RAD = math.radians(90.0)
"""Pitch and roll lie within half of this to either side."""
_DAY_S = 86_400.0


def _bits(span: float, step: float) -> int:
    """Bits that tell steps of a span apart."""
    return math.ceil(math.log2(span / step))


def message_bits(scenario: Scenario) -> int:
    """Length of a message: its number within a day, the leader's state, its next waypoints if asked for, a checksum."""
    place = 2 * _bits(_AREA_M, _STEP_M)
    told = [
        _bits(_DAY_S, scenario.timing.message_interval_s),
        place,
        _bits(2.0 * math.pi, _STEP_RAD),
        _bits(_FASTEST_M_S, _STEP_M_S),
        _bits(scenario.ocean.floor_depth_m, _STEP_M),
        CHECK_BITS,
    ]
    if scenario.leader.broadcast_attitude:
        told.append(2 * _bits(_TILT_RAD, _STEP_RAD))
    told.append(scenario.leader.broadcast_waypoints * (_bits(_DAY_S, 1.0) + place))
    return sum(told)


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
    """The same, were every follower to ask for its own range and be answered: there and back for each [s]."""
    way = reach_m(scenario) / scenario.acoustics.sound_speed_m_s
    return followers * (message_bits(scenario) / rate + 2.0 * way)

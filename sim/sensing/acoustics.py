"""How sound gets from the transmitters to a hydrophone, and what range a receiver without noise
would give.

A ping leaves its transmitter at t_e, where that site then is, and arrives at t_a, where the
hydrophone then is:

    t_a − t_e = |H(t_a) − P(t_e)| s,    s = mean of 1/c along the path,

solved for t_a itself, whatever the time step. The follower gets t_e from the message, reads t_a on
its own clock and assumes a constant speed of sound c_b: R = c_b (t_a + clock error − t_e).

Rays are straight: their mean slowness is the mean of 1/c over the depths they cross (Medwin & Clay,
Fundamentals of Acoustical Oceanography, 1998). A flat, level boundary sends an echo that seems to
come from the mirror image of its source (ibid.); taken for the direct arrival it is the gross error
of paper Section 2.4. Random errors come on top.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import formula, jitable
from sim.attitude import Vector, body_point_in_world
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.trajectory import StateHistory, Trajectory, pose_between, row

# smaller depth steps have the slowness of their middle: quotients of small differences round [m]
_LEVEL_M = 1e-3


class SoundProfile(NamedTuple):
    """Speed of sound, linear between n depths and constant above the first and below the last."""

    depth: Floats  # shape (n,), increasing, [m]
    speed: Floats  # speed of sound at each depth, shape (n,), [m/s]
    crossing: Floats  # time to cross vertically from the first depth to each, shape (n,), [s]

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, speed], …], shape (n, 2), [m] and [m/s]; one point is a constant
        speed.
        """
        depth, speed = np.array(points, dtype=np.float64).T.copy()
        delays = [_delay(growth) for growth in (np.diff(speed) / speed[:-1]).tolist()]
        layers = np.diff(depth) / speed[:-1] * np.array(delays)
        return cls(depth, speed, np.concatenate([[0.0], np.cumsum(layers)]))


@formula
def _delay(growth: float) -> float:
    """ln(1 + g) / g: time through a layer whose speed grows by a share g, in that at its first
    speed.
    """
    return math.log1p(growth) / growth if growth != 0.0 else 1.0


@jitable
def _layer(p: SoundProfile, depth: float) -> int:
    """Index of the last depth of the profile that is not below another one; 0, if that is above
    all.
    """
    i = 0
    while i + 1 < p.depth.size and p.depth[i + 1] <= depth:
        i += 1
    return i


@jitable
def speed_at(p: SoundProfile, depth: float) -> float:
    """Speed of sound at a depth [m/s]."""
    i = _layer(p, depth)
    if i + 1 == p.depth.size or depth <= p.depth[i]:
        return float(p.speed[i])
    share = (depth - p.depth[i]) / (p.depth[i + 1] - p.depth[i])
    return float(p.speed[i] + share * (p.speed[i + 1] - p.speed[i]))


@jitable
def _vertical_time(p: SoundProfile, depth: float) -> float:
    """Time of a vertical ray from the first depth of the profile down to another one [s]."""
    i = _layer(p, depth)
    growth = (speed_at(p, depth) - p.speed[i]) / p.speed[i]
    return float(p.crossing[i] + (depth - p.depth[i]) / p.speed[i] * _delay(growth))


@jitable
def mean_slowness(p: SoundProfile, upper: float, lower: float) -> float:
    """Mean of 1/c between two depths, in either order [s/m]."""
    if abs(lower - upper) < _LEVEL_M:
        return 1.0 / speed_at(p, 0.5 * (upper + lower))
    return (_vertical_time(p, lower) - _vertical_time(p, upper)) / (lower - upper)


TRANSMITTERS = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")  # sites of P1, P2 and P3

# for the arrival time: each gains a factor of c / speed of the hydrophone, some 500
_ITERATIONS = 6


class Path(IntEnum):
    """How the sound came; index into arrays over paths."""

    DIRECT = 0
    SURFACE = 1
    BOTTOM = 2


# compiled code holds numbers, not the members of an enum
_DIRECT, _SURFACE, _BOTTOM = map(int, Path)


class Sound(NamedTuple):
    """How sound gets to a follower, for compiled code too."""

    on_grid: bool  # all pings leave and arrive at an instant that is recorded
    travels: bool
    slot: float  # from one ping of a message to the next [s]
    paths: tuple[bool, bool, bool]  # whether each `Path` has a chance to be taken
    floor: float  # depth [m]
    max_range: float  # [m]
    transmitters: int  # how many pings of a message a follower waits for
    profile: SoundProfile
    varies: bool  # sound has another speed at another depth
    ratio: float  # range that the follower computes for a metre of path, where it has not
    assumed_speed: float  # speed of sound that the follower assumes, c_b [m/s]
    clock_offset: float  # [s]
    clock_drift: float  # [s/s]


def sound_of(scenario: Scenario) -> Sound:
    """How sound gets to the followers of a scenario."""
    a = scenario.acoustics
    assumed = a.sound_speed_m_s + a.sound_speed_bias_m_s
    return Sound(
        on_grid=not a.travel_time and a.ping_slot_s == 0.0,
        travels=a.travel_time,
        slot=float(a.ping_slot_s),
        paths=(True, a.surface_echo_probability > 0.0, a.bottom_echo_probability > 0.0),
        floor=float(scenario.ocean.floor_depth_m),
        max_range=float(a.max_range_m or np.inf),
        transmitters=scenario.navigation.transmitters,
        profile=SoundProfile.through(a.sound_speed_profile or ((0.0, a.sound_speed_m_s),)),
        varies=bool(a.sound_speed_profile),
        ratio=assumed / a.sound_speed_m_s,
        assumed_speed=assumed,
        clock_offset=float(a.clock_offset_s),
        clock_drift=1e-6 * a.clock_drift_ppm,
    )


class Motion(NamedTuple):
    """Motion of vehicles as far as it is known."""

    truth: StateHistory
    begin: float  # time of its first instant [s]
    last: int  # index of the last instant that is known; at least 1


class Arrival(NamedTuple):
    """How a ping arrives by one path; NaN if that has no chance to be taken."""

    time: float  # [s]
    length: float  # of the path [m]
    ratio: float  # range that the follower computes for a metre of path, c_b s
    clock_range: float  # what the clocks add to a range [m]


NO_ARRIVAL = Arrival(math.nan, math.nan, math.nan, math.nan)
Arrivals = tuple[Arrival, Arrival, Arrival]
"""Of a ping, by each `Path`."""
Ping = tuple[Vector, Arrivals]
"""Where it left, and how it arrives."""
Pings = tuple[Ping, Ping, Ping]
"""Of a message, from the rear, front and middle transmitter."""
NO_PINGS = (((0.0, 0.0, 0.0), (NO_ARRIVAL, NO_ARRIVAL, NO_ARRIVAL)),) * 3


@jitable
def site_at(s: Sound, known: Motion, vehicle: int, offset: Any, time: float) -> Vector:
    """East, north and up of a site at a time that is known; at a later one, where it is last
    known [m].
    """
    place = min(max((time - known.begin) / CONTROL_STEP_S, 0.0), float(known.last))
    pose = known.truth.pose
    twist = known.truth.twist
    if s.on_grid:
        return body_point_in_world(row(pose, round(place), vehicle), offset)  # type: ignore[no-any-return]
    i = min(int(place), known.last - 1)
    ends = row(pose, i, vehicle), row(pose, i + 1, vehicle)
    velocity = row(twist, i, vehicle), row(twist, i + 1, vehicle)
    return body_point_in_world(pose_between(place - i, CONTROL_STEP_S, ends, velocity), offset)  # type: ignore[no-any-return]


@jitable
def _distance(a: Vector, b: Vector) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)


@jitable
def image(source: Vector, path: int, floor_depth: float) -> Vector:
    """Place from which sound seems to come that takes a path [m]."""
    up = source[2]
    if path != _DIRECT:
        up = -up if path == _SURFACE else -2.0 * floor_depth - up
    return source[0], source[1], up


@jitable
def path_slowness(
    profile: SoundProfile, path: int, source: float, receiver: float, floor_depth: float
) -> float:
    """Mean of 1/c along a path that is straight but for its reflection, between two heights
    [s/m].
    """
    if path == _DIRECT:
        return mean_slowness(profile, -source, -receiver)
    turn = 0.0 if path == _SURFACE else floor_depth
    # Both legs have the same slope, so that they share the path in proportion to the depths they
    # cross.
    first = abs(-source - turn)
    second = abs(-receiver - turn)
    if first + second == 0.0:
        return 1.0 / speed_at(profile, turn)
    legs = first * mean_slowness(profile, -source, turn) + second * mean_slowness(
        profile, -receiver, turn
    )
    return legs / (first + second)


@jitable
def _arrive(
    s: Sound, known: Motion, receiver: tuple[int, Any], path: int, leaves: float, source: Vector
) -> Arrival:
    """How a ping arrives by one `Path` at a vehicle's hydrophone."""
    if not s.paths[path]:
        return NO_ARRIVAL
    vehicle, hydrophone = receiver
    there = site_at(s, known, vehicle, hydrophone, leaves)
    apparent = image(source, path, s.floor)
    time = leaves
    ratio = s.ratio
    if s.travels:
        for _ in range(_ITERATIONS):
            slowness = path_slowness(s.profile, path, source[2], there[2], s.floor)
            arrives = leaves + _distance(apparent, there) * slowness
            if arrives == time:
                break
            time = arrives
            there = site_at(s, known, vehicle, hydrophone, arrives)
    if s.varies:
        ratio = s.assumed_speed * path_slowness(s.profile, path, source[2], there[2], s.floor)
    return Arrival(
        time,
        _distance(apparent, there),
        ratio,
        s.assumed_speed * (s.clock_offset + s.clock_drift * time),
    )


@jitable
def _follow_ping(
    s: Sound, known: Motion, transmitter: Any, receiver: tuple[int, Any], leaves: float
) -> Ping:
    source = site_at(s, known, 0, transmitter, leaves)
    direct = _arrive(s, known, receiver, _DIRECT, leaves, source)
    surface = _arrive(s, known, receiver, _SURFACE, leaves, source)
    bottom = _arrive(s, known, receiver, _BOTTOM, leaves, source)
    return source, (direct, surface, bottom)


@jitable
def follow(
    s: Sound, known: Motion, sites: tuple[Any, Any], vehicle: int, sent: float
) -> tuple[float, Pings]:
    """Follow the pings of a message to a vehicle, as far as the motion is known.

    Args:
        s: how sound gets to the followers.
        known: motion of all vehicles.
        sites: offsets of the transmitters, shape (3, 3), and of the hydrophone, shape (3,), [m].
        vehicle: index of the receiver's.
        sent: when the message is sent [s].

    Returns:
        When the last ping that is waited for is in [s], right as soon as that is not later than
        what is known; and the pings of the rear, front and middle transmitter.
    """
    transmitters = sites[0]
    receiver = (vehicle, sites[1])
    rear = _follow_ping(s, known, transmitters[0], receiver, sent)
    front = _follow_ping(s, known, transmitters[1], receiver, sent + s.slot)
    middle = _follow_ping(s, known, transmitters[2], receiver, sent + s.slot * 2)
    complete = sent
    pings = (rear, front, middle)
    for i in range(s.transmitters):
        for arrival in pings[i][1]:
            # false for NaN
            if arrival.time > complete:
                complete = arrival.time
    return complete, pings


@jitable
def received_range(s: Sound, arrivals: Arrivals, path: int, step: int, dt: float) -> float:
    """Slant range before random errors [m] by one path of a ping; NaN where the step that takes its
    message up is too early, or the direct path longer than the farthest that is received.
    """
    taken = arrivals[path]
    if taken.time <= (step + 1e-6) * dt and arrivals[_DIRECT].length <= s.max_range:
        return taken.length * taken.ratio + taken.clock_range
    return math.nan


@jitable
def reception_step(complete: float, dt: float) -> int:
    """First filter step at which a message is in whose last ping arrives at a time [s]."""
    return math.ceil(complete / dt - 1e-6)


def motion_of(t: Trajectory) -> Motion:
    """Motion of all vehicles of a trajectory."""
    return Motion(
        StateHistory(t.pose, t.twist, t.water_velocity, t.thrust), float(t.time[0]), t.time.size - 1
    )

"""How sound gets from the transmitters to a hydrophone, and what range a receiver without noise would give.

A ping leaves its transmitter at t_e, where that site then is, and arrives at t_a, where the hydrophone then is:

    t_a − t_e = |H(t_a) − P(t_e)| s,    s = mean of 1/c along the path,

solved for t_a itself, whatever the time step. The follower gets t_e from the message, reads t_a on its own clock and
assumes a constant speed of sound c_b: R = c_b (t_a + clock error − t_e).

Rays are straight: their mean slowness is the mean of 1/c over the depths they cross (Medwin & Clay, Fundamentals of
Acoustical Oceanography, 1998). A flat, level boundary sends an echo that seems to come from the mirror image of its
source (ibid.); taken for the direct arrival it is the gross error of paper Section 2.4. Random errors come on top.
"""

from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints, Record, Records, records
from laisn.compiled import elementwise, select
from sim.attitude import carried
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.trajectory import Trajectory, Truth, pose_between

_LEVEL_M = 1e-3  # smaller depth steps have the slowness of their middle: quotients of small differences round [m]


class SoundProfile(NamedTuple):
    """Speed of sound, linear between n depths and constant above the first and below the last."""

    depth: Floats  # shape (n,), increasing, [m]
    speed: Floats  # speed of sound at each depth, shape (n,), [m/s]
    crossing: Floats  # time to cross vertically from the first depth to each, shape (n,), [s]

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, speed], …], shape (n, 2), [m] and [m/s]; one point is a constant speed."""
        depth, speed = np.array(points, dtype=np.float64).T.copy()
        layers = np.diff(depth) / speed[:-1] * _delay(np.diff(speed) / speed[:-1])
        return cls(depth, speed, np.concatenate([[0.0], np.cumsum(layers)]))


@elementwise
def _delay(growth: Any) -> Any:
    """ln(1 + g) / g: time through a layer whose speed grows by a share g, in that at its first speed."""
    constant = growth == 0.0
    return np.log1p(growth) / (growth + constant) + constant


@elementwise
def _layer(p: SoundProfile, depth: Any) -> Any:
    """Index of the last depth of the profile that is not below another one; 0, if that is above all."""
    i = 0
    for j in range(1, p.depth.size):
        i = i + (p.depth[j] <= depth)
    return i


@elementwise
def speed_at(p: SoundProfile, depth: Any) -> Any:
    """Speed of sound at a depth [m/s]."""
    i = _layer(p, depth)
    j = np.minimum(i + 1, p.depth.size - 1)
    step = p.depth[j] - p.depth[i]
    share = np.maximum(depth - p.depth[i], 0.0) / (step + (step == 0.0))
    return p.speed[i] + share * (p.speed[j] - p.speed[i])


@elementwise
def _vertical_time(p: SoundProfile, depth: Any) -> Any:
    """Time of a vertical ray from the first depth of the profile down to another one [s]."""
    i = _layer(p, depth)
    growth = (speed_at(p, depth) - p.speed[i]) / p.speed[i]
    return p.crossing[i] + (depth - p.depth[i]) / p.speed[i] * _delay(growth)


@elementwise
def mean_slowness(p: SoundProfile, upper: Any, lower: Any) -> Any:
    """Mean of 1/c between two depths, in either order [s/m]."""
    span = lower - upper
    level = np.abs(span) < _LEVEL_M
    mean = (_vertical_time(p, lower) - _vertical_time(p, upper)) / (span + level)
    return select(level, 1.0 / speed_at(p, 0.5 * (upper + lower)), mean)


TRANSMITTERS = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")  # sites of P1, P2 and P3

_ITERATIONS = 6  # for the arrival time: each gains a factor of c / speed of the hydrophone, some 500


class Path(IntEnum):
    """How the sound came; index into arrays over paths."""

    DIRECT = 0
    SURFACE = 1
    BOTTOM = 2


# compiled code holds numbers, not the members of an enum
_DIRECT, _SURFACE = int(Path.DIRECT), int(Path.SURFACE)


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

    truth: Truth
    begin: float  # time of its first instant [s]
    last: int  # index of the last instant that is known; at least 1


ARRIVAL = np.dtype(  # how a ping arrives by one path; its time is NaN if that has no chance to be taken
    [
        ("time", np.float64),  # [s]
        ("length", np.float64),  # of the path [m]
        ("ratio", np.float64),  # range that the follower computes for a metre of path, c_b s
        ("clock_range", np.float64),  # what the clocks add to a range [m]
        ("range", np.float64),  # slant range before random errors [m]; NaN out of range, by the direct path's length
    ]
)


@elementwise
def site_at(s: Sound, known: Motion, vehicle: int, offset: Floats, time: Any) -> Any:
    """East, north and up of a site at a time that is known; at a later one, where it is last known [m]."""
    place = np.minimum(np.maximum((time - known.begin) / CONTROL_STEP_S, 0.0), known.last)
    pose, twist = known.truth.pose, known.truth.twist
    if s.on_grid:
        return carried(pose[np.int64(np.rint(place)), vehicle].T, offset)
    i = np.minimum(np.int64(place), known.last - 1)
    ends = pose[i, vehicle].T, pose[i + 1, vehicle].T
    velocity = twist[i, vehicle].T, twist[i + 1, vehicle].T
    return carried(pose_between(place - i, CONTROL_STEP_S, ends, velocity), offset)


@elementwise
def _distance(a: Any, b: Any) -> Any:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return np.sqrt(x * x + y * y + z * z)


@elementwise
def image(source: Any, path: int, floor_depth: float) -> Any:
    """Place from which sound seems to come that takes a path [m]."""
    up = source[2]
    if path != _DIRECT:
        up = -up if path == _SURFACE else -2.0 * floor_depth - up
    return source[0], source[1], up


@elementwise
def path_slowness(profile: SoundProfile, path: int, source: Any, receiver: Any, floor_depth: float) -> Any:
    """Mean of 1/c along a path that is straight but for its reflection, between two heights [s/m]."""
    if path == _DIRECT:
        return mean_slowness(profile, -source, -receiver)
    turn = 0.0 if path == _SURFACE else floor_depth
    # Both legs have the same slope, so that they share the path in proportion to the depths they cross.
    first, second = np.abs(-source - turn), np.abs(-receiver - turn)
    level = first + second == 0.0
    legs = first * mean_slowness(profile, -source, turn) + second * mean_slowness(profile, -receiver, turn)
    return select(level, 1.0 / speed_at(profile, turn), legs / (first + second + level))


@elementwise
def _follow_ping(
    s: Sound, known: Motion, receiver: tuple[int, Floats], path: int, ping: tuple[Any, Any], arrival: Record
) -> None:
    """Follow a ping, when and from where it leaves, by one `Path` to a vehicle's hydrophone; writes an ARRIVAL."""
    (vehicle, hydrophone), (leaves, source) = receiver, ping
    there, apparent = site_at(s, known, vehicle, hydrophone, leaves), image(source, path, s.floor)
    time, ratio = leaves, s.ratio
    if s.travels:
        for _ in range(_ITERATIONS):
            time = leaves + _distance(apparent, there) * path_slowness(s.profile, path, source[2], there[2], s.floor)
            there = site_at(s, known, vehicle, hydrophone, time)
    if s.varies:
        ratio = s.assumed_speed * path_slowness(s.profile, path, source[2], there[2], s.floor)
    arrival.time, arrival.length, arrival.ratio = time, _distance(apparent, there), ratio
    arrival.clock_range = s.assumed_speed * (s.clock_offset + s.clock_drift * time)


@elementwise
def follow(s: Sound, known: Motion, sites: tuple[Floats, Floats], vehicle: int, sent: Any, arrivals: Records) -> Any:
    """Follow all pings of a message to a vehicle, as far as the motion is known; or those of many messages.

    Args:
        sites: offsets of the transmitters, shape (3, 3), and of the hydrophone, shape (3,), [m].
        vehicle: index of the receiver's.
        sent: when the message is sent [s]; shape () or (m,).
        arrivals: out: of ARRIVAL, shape (3 transmitters, 3 paths) or (3, 3, m).

    Returns:
        When the last ping that is waited for is in [s]; right as soon as that is not later than what is known.
    """
    transmitters, hydrophone = sites
    complete = sent
    for i in range(3):
        leaves = sent + s.slot * i
        source = site_at(s, known, 0, transmitters[i], leaves)
        for path in range(3):
            ping = arrivals[i, path]
            if not s.paths[path]:
                ping.time = np.nan
                continue
            _follow_ping(s, known, (vehicle, hydrophone), path, (leaves, source), ping)
            is_near = arrivals[i, _DIRECT].length <= s.max_range
            ping.range = select(is_near, ping.length * ping.ratio + ping.clock_range, np.nan)
            if i < s.transmitters:
                complete = np.maximum(complete, ping.time)
    return complete


@elementwise
def received_range(arrival: Record, step: Any, dt: float) -> Any:
    """Slant range before random errors [m]; NaN for a ping that is not in by the step that takes its message up."""
    return select(arrival.time <= (step + 1e-6) * dt, arrival.range, np.nan)


@elementwise
def reception_step(complete: Any, dt: float) -> Any:
    """First filter step at which a message is in whose last ping arrives at a time [s]."""
    return np.int64(np.ceil(complete / dt - 1e-6))


class Propagation(NamedTuple):
    """Sound of m messages: transmitters are rear, front and middle, paths in the order of `Path`."""

    emission_step: Ints  # filter step at which a message is sent, shape (m,)
    message_step: Ints  # filter step by which all pings that the follower may take are in, shape (m,)
    transmitter: Floats  # where each ping left, shape (m, 3, 3), the last axis in the world, [m]
    arrival: Records  # how each ping arrives by each path; of ARRIVAL, shape (m, 3 transmitters, 3 paths)

    @property
    def range(self) -> Floats:
        """Slant range before random errors, shape (m, 3 transmitters, 3 paths), [m]; not cut off at any distance."""
        return np.asarray(self.arrival.length * self.arrival.ratio + self.arrival.clock_range)


def motion_of(t: Trajectory) -> Motion:
    """Motion of all vehicles."""
    return Motion(Truth(t.pose, t.twist, t.water_velocity, t.thrust), float(t.time[0]), t.time.size - 1)


def propagate(trajectory: Trajectory, scenario: Scenario, follower: int = 0) -> Propagation:
    """Follow the sound of all messages sent in a trajectory to one follower, as far as they are in by its end."""
    dt, every = scenario.timing.filter_step_s, scenario.message_every
    s, known = sound_of(scenario), motion_of(trajectory)
    first = round(known.begin / dt)
    last = first + known.last // round(dt / CONTROL_STEP_S)
    # integers count messages: an accumulated time would drop some
    steps = np.arange(first // every + 1, last // every + 1) * every
    sent = steps[:, None] * dt + s.slot * np.arange(len(TRANSMITTERS))
    offsets = trajectory.site_offset[[trajectory.site(name) for name in TRANSMITTERS]]
    hydrophone = trajectory.site_offset[trajectory.site(f"{trajectory.names[follower + 1]}/hydrophone")]
    arrivals = records(ARRIVAL, 3, len(Path), steps.size)
    arrivals.fill(np.nan)
    message_step = reception_step(follow(s, known, (offsets, hydrophone), follower + 1, steps * dt, arrivals), dt)
    transmitter = [
        np.column_stack(site_at(s, known, 0, offset, at)) for offset, at in zip(offsets, sent.T, strict=True)
    ]
    # Two messages within one filter step: the follower keeps the first.
    kept = (message_step <= last) & (np.diff(message_step, prepend=0) > 0)
    return Propagation(
        emission_step=steps[kept],
        message_step=message_step[kept],
        transmitter=np.stack(transmitter, axis=1)[kept],
        arrival=np.moveaxis(arrivals, -1, 0)[kept],
    )

"""How sound gets from the transmitters to a hydrophone, and what range a receiver without noise
would give.

A ping leaves its transmitter at t_e, where that site then is, and arrives at t_a, where the
hydrophone then is:

    t_a − t_e = |H(t_a) − P(t_e)| s,    s = mean of 1/c along the path,

solved for t_a itself, whatever the time step. The follower gets t_e from the message, reads t_a on
its own clock and assumes a constant speed of sound c_b: R = c_b (t_a + clock error − t_e). One that
knows the profile divides by the mean slowness of the straight direct path, or of the ray, and by
c_b / c, which holds what it errs by.

A message takes a while. Pings at its end leave later than the time that it states, so that ends
that move shift the range by their radial speed times its length: the Doppler shift, summed up.

Lengths and slowness of paths are those of the sea (`sim.water.rays`). An echo that is taken for the
direct arrival is the gross error of paper Section 2.4. Random errors come on top.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import formula, jitable
from sim.attitude import Vector, body_point_in_world
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import CONTROL_STEP_S
from sim.trajectory import StateHistory, Trajectory, history_of, pose_between, row
from sim.water.assembly import rays_of
from sim.water.rays import Path, distance

TRANSMITTERS = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")  # sites of P1, P2 and P3

# for the arrival time: each gains a factor of c / speed of the hydrophone, some 500
_ITERATIONS = 6


# compiled code holds numbers, not the members of an enum
_DIRECT, _SURFACE, _BOTTOM = map(int, Path)


# `navigation.sound_speed` as compiled code takes it: receivers compute ranges by one constant
# speed, by the mean of the profile between both depths, or by rays through the profile
ASSUMED_SOUND = ("mean", "straight", "profile")
MEAN, STRAIGHT, PROFILE = range(3)


class Sound(NamedTuple):
    """How sound gets to a follower, for compiled code too."""

    on_grid: bool  # all pings leave and arrive at an instant that is recorded
    travels: bool  # sound takes its time; else it arrives at once
    slot: float  # from one ping of a message to the next [s]
    lead: float  # from the time that a message states to its first ping [s]
    tail: float  # from its last ping until all of the message is in [s]
    paths: tuple[bool, bool, bool]  # whether each `Path` has a chance to be taken
    max_range: float  # [m]
    rays: Any  # as `sim.water.rays.StraightRays`
    # range that the follower computes for a metre of path at the speed `acoustics.sound_speed_m_s`
    ratio: float
    assumed_speed: float  # speed of sound that the follower assumes, c_b [m/s]
    clock_offset: float  # of the follower's clock from the sender's at the start [s]
    clock_drift: float  # rate at which that grows [s/s]


class Sites(NamedTuple):
    """Acoustic devices in their hulls: offsets (forward, port, up) as arrays, or as lists where
    Python senses.
    """

    transmitters: Any  # rear, front and middle, shape (3, 3), [m]
    hydrophones: Any  # of the receivers, shape (f, 3), [m]


class Listener(NamedTuple):
    """A receiver of messages, for compiled code too."""

    vehicle: int  # its index
    hydrophone: Any  # its offset, shape (3,), [m]
    transmitters: int  # how many pings of a message it waits for
    assumed_sound: int  # how it makes ranges of times: MEAN, STRAIGHT or PROFILE


def sound_of(sensing: SensingSettings) -> Sound:
    """How sound gets to followers."""
    a = sensing.acoustics
    assumed = a.sound_speed_m_s + a.sound_speed_bias_m_s
    return Sound(
        on_grid=not a.travel_time and a.ping_slot_s == 0.0 and a.message_length_s == 0.0,
        travels=a.travel_time,
        slot=float(a.ping_slot_s),
        lead=a.message_length_s if a.ranging_pulse == "end" else 0.0,
        tail=a.message_length_s if a.ranging_pulse == "start" else 0.0,
        paths=(True, a.surface_echo_probability > 0.0, a.bottom_echo_probability > 0.0),
        max_range=float(a.max_range_m or np.inf),
        rays=rays_of(sensing.sound),
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


@formula
def site_at(
    on_grid: bool, motion: Motion, vehicle: int, offset: Vector | Floats, time: float
) -> Vector:
    """East, north and up of a site at a time that is known; at a later one, where it is last
    known [m].

    `on_grid` is as of `Sound`: to hand over the whole of that takes longer than the rest. As a
    `formula` this is inlined into compiled callers; a `jitable` is called.
    """
    if on_grid:
        i = round(_index_at(motion.begin, motion.last, time))
        return body_point_in_world(row(motion.truth.pose, i, vehicle), offset)  # type: ignore[no-any-return]
    return _site_between(motion, vehicle, offset, time)


@jitable
def _index_at(begin: float, last: int, time: float) -> float:
    """Index of the instant at a time, with a fraction between two of them."""
    return min(max((time - begin) / CONTROL_STEP_S, 0.0), float(last))


@jitable
def _site_between(motion: Motion, vehicle: int, offset: Vector | Floats, time: float) -> Vector:
    """`site_at` a time between two instants."""
    index = _index_at(motion.begin, motion.last, time)
    pose = motion.truth.pose
    twist = motion.truth.twist
    i = min(int(index), motion.last - 1)
    ends = row(pose, i, vehicle), row(pose, i + 1, vehicle)
    velocity = row(twist, i, vehicle), row(twist, i + 1, vehicle)
    return body_point_in_world(pose_between(index - i, CONTROL_STEP_S, ends, velocity), offset)  # type: ignore[no-any-return]


@jitable
def _arrive(
    s: Sound, motion: Motion, listener: Listener, path: int, departure_time: float, source: Vector
) -> Arrival:
    """How a ping that leaves a place in the world [m] at a time [s] arrives by one `Path` at a
    vehicle's hydrophone.
    """
    vehicle = listener.vehicle
    hydrophone = listener.hydrophone
    arrival_point = site_at(s.on_grid, motion, vehicle, hydrophone, departure_time)
    apparent = s.rays.apparent_source(path, source, arrival_point)
    time = departure_time
    ratio = s.ratio
    if s.travels:
        # while the receiver moves on by centimetres, the slowness of a bent ray stays
        first_slowness = s.rays.slowness(path, source, arrival_point) if s.rays.bends else 0.0
        for _ in range(_ITERATIONS):
            slowness = (
                first_slowness if s.rays.bends else s.rays.slowness(path, source, arrival_point)
            )
            arrival_time = departure_time + distance(apparent, arrival_point) * slowness
            if arrival_time == time:
                break
            time = arrival_time
            arrival_point = site_at(s.on_grid, motion, vehicle, hydrophone, arrival_time)
            apparent = s.rays.apparent_source(path, source, arrival_point)
    if s.rays.varies:
        slowness = s.rays.slowness(path, source, arrival_point)
        if s.travels and s.rays.bends:
            time = departure_time + distance(apparent, arrival_point) * slowness
        if listener.assumed_sound == MEAN:
            ratio = s.assumed_speed * slowness
        elif listener.assumed_sound == STRAIGHT:
            ratio = s.ratio * slowness / s.rays.straight_slowness(_DIRECT, source, arrival_point)
        elif path != _DIRECT:
            # an echo is taken for the direct ray
            ratio = s.ratio * slowness / s.rays.slowness(_DIRECT, source, arrival_point)
    return Arrival(
        time,
        distance(apparent, arrival_point),
        ratio,
        s.assumed_speed * (s.clock_offset + s.clock_drift * time),
    )


@jitable
def _follow_ping(
    s: Sound, motion: Motion, transmitter: Any, listener: Listener, departure_time: float
) -> Ping:
    """Follow the ping of one transmitter, by its offset, from its departure [s]."""
    source = site_at(s.on_grid, motion, 0, transmitter, departure_time)
    direct = _arrive(s, motion, listener, _DIRECT, departure_time, source)
    surface = NO_ARRIVAL
    if s.paths[_SURFACE]:
        surface = _arrive(s, motion, listener, _SURFACE, departure_time, source)
    bottom = NO_ARRIVAL
    if s.paths[_BOTTOM]:
        bottom = _arrive(s, motion, listener, _BOTTOM, departure_time, source)
    return source, (direct, surface, bottom)


@jitable
def follow(
    s: Sound, motion: Motion, transmitters: Any, listener: Listener, sent: float
) -> tuple[float, Pings]:
    """Follow the pings of a message to a vehicle, as far as the motion is known.

    Args:
        s: how sound gets to the followers.
        motion: of all vehicles.
        transmitters: their offsets, shape (3, 3), [m].
        listener: who receives the message.
        sent: when the message is sent [s].

    Returns:
        When the last ping that is waited for is in [s], right as soon as that is not later than
        what is known; and the pings of the rear, front and middle transmitter.
    """
    first = sent + s.lead
    rear = _follow_ping(s, motion, transmitters[0], listener, first)
    front = _follow_ping(s, motion, transmitters[1], listener, first + s.slot)
    middle = _follow_ping(s, motion, transmitters[2], listener, first + s.slot * 2)
    complete = sent
    pings = (rear, front, middle)
    for i in range(listener.transmitters):
        for arrival in pings[i][1]:
            # false for NaN
            if arrival.time > complete:
                complete = arrival.time
    return complete + s.tail, pings


@jitable
def received_range(s: Sound, arrivals: Arrivals, path: int, step: int, dt: float) -> float:
    """Slant range before random errors [m] by one path of a ping; NaN where the step that takes its
    message up is too early, or the direct path longer than the farthest that is received.
    """
    arrival = arrivals[path]
    if arrival.time <= (step + 1e-6) * dt and arrivals[_DIRECT].length <= s.max_range:
        return arrival.length * arrival.ratio + arrival.clock_range
    return math.nan


@jitable
def reception_step(complete: float, dt: float) -> int:
    """First filter step at which a message is in whose last ping arrives at a time [s]."""
    return math.ceil(complete / dt - 1e-6)


def motion_of(t: Trajectory) -> Motion:
    """Motion of all vehicles of a trajectory."""
    return Motion(history_of(t), float(t.time[0]), t.time.size - 1)

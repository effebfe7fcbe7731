"""What followers read and receive at one instant, in compiled code: for followers that steer by it.

Formulas and noise are those of `observe` and `measure`, which make the measurements of a finished mission.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the follower's vehicle is the one
after.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Record, Records
from laisn.compiled import compiled, inlined
from sim.geometry.attitude import carried, heading_of, pitch_of, roll_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing import ahrs
from sim.sensing.acoustics import Motion, Sound, arrival_of, is_in_time, range_of, reception_step, site_at, sound_of
from sim.sensing.drift import advanced, biased
from sim.sensing.errors import (
    ERRORS,
    errors_of,
    heading_reading,
    is_bad,
    is_lost,
    loses,
    path_taken,
    plain_reading,
    range_readings,
    speed_reading,
)
from sim.sensing.noise import STREAMS, Stream, two_normals, two_units, uniform, words
from sim.trajectory import speed_through_water

_U = np.uint64
# compiled code holds numbers, not the members of an enum
_OWN_MOTION, _DEPTH, _GYRO, _TILT = (int(s) for s in (Stream.OWN_MOTION, Stream.DEPTH, Stream.GYRO, Stream.TILT))
_RANGE_UNIFORM, _RANGE_SCALE, _ECHO, _LOSS = (
    int(s) for s in (Stream.RANGE_UNIFORM, Stream.RANGE_SCALE, Stream.ECHO, Stream.LOSS)
)
_LEADER_MOTION, _LEADER_DEPTH, _LEADER_ATTITUDE = (
    int(s) for s in (Stream.LEADER_MOTION, Stream.LEADER_DEPTH, Stream.LEADER_ATTITUDE)
)
MESSAGE = 8
"""Columns of a message: those of `LeaderMessage` from timestamp to roll."""

NO_MESSAGE, NO_RANGES, RECEIVED = range(3)
"""Outcome of a filter step: no message is in; one is, of which no ping was received; one with ranges is."""

Body = tuple[Floats, Floats, Floats]
"""Pose, twist and water velocity of a vehicle, shapes (7,), (6,) and (3,)."""


class SensorModel(NamedTuple):
    """Sensors and acoustics of a mission as compiled code takes them."""

    seed: np.uint64
    run: np.uint64
    errors: Records
    """Of each follower, of ERRORS, shape (f,)."""
    broadcast_attitude: bool
    senses_acceleration: bool
    """The leader takes accelerations for tilt."""
    tilt_share: float
    """`ahrs.gain` of the leader."""
    transmitters: int
    dt: float
    stride: int
    """Instants from one filter step to the next."""
    message_every: int
    """Filter steps from one message to the next."""
    sound: Sound


def sensor_model_of(scenario: Scenario) -> SensorModel:
    """Sensors and acoustics of a scenario as compiled code takes them."""
    leader, followers = scenario.leader, range(len(scenario.followers))
    return SensorModel(
        seed=_U(scenario.seed),
        run=_U(scenario.run),
        errors=np.array([tuple(errors_of(scenario, i)) for i in followers], ERRORS).view(np.recarray),
        broadcast_attitude=leader.broadcast_attitude,
        senses_acceleration=leader.broadcast_attitude and scenario.sensors.leader_attitude_senses_acceleration,
        tilt_share=ahrs.gain(scenario.sensors),
        transmitters=scenario.navigation.transmitters,
        dt=scenario.timing.filter_step_s,
        stride=round(scenario.timing.filter_step_s / CONTROL_STEP_S),
        message_every=scenario.message_every,
        sound=sound_of(scenario),
    )


@inlined
def _normals(s: SensorModel, stream: int, k: int) -> tuple[float, float]:
    """Two normals of a stream at filter step k."""
    w0, w1, w2, w3 = words(s.seed, s.run, _U(stream), _U(k))
    first, second = two_units(w0, w1, w2, w3)
    return two_normals(first, second)


@inlined
def _uniforms(s: SensorModel, stream: int, k: int) -> tuple[float, float, float]:
    """Three uniforms of a stream at filter step k."""
    w0, w1, w2, _ = words(s.seed, s.run, _U(stream), _U(k))
    return uniform(w0), uniform(w1), uniform(w2)


@compiled
def read_own(s: SensorModel, k: int, follower: int, body: Body, depth_sensor: Floats, reading: Record) -> None:
    """Read a follower's own sensors at filter step k.

    Args:
        depth_sensor: its offset, shape (3,), [m].
        reading: out: record of `laisn.swarm.READING`, those of `sensors.OWN`.
    """
    pose, twist, water = body
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    streams, e = STREAMS * follower, s.errors[follower]
    speed, heading = biased(e, follower, k * s.dt, speed_through_water(pose, twist, water), heading_of(w, x, y, z))
    first, second = _normals(s, streams + _OWN_MOTION, k)
    reading.speed = speed_reading(speed, e.speed_bias, e.speed_sigma, first)
    reading.heading = heading_reading(heading, e.heading_bias, e.heading_sigma, second)
    reading.depth = plain_reading(-carried(pose, depth_sensor)[2], e.depth_sigma, _normals(s, streams + _DEPTH, k)[0])
    reading.pitch = plain_reading(pitch_of(w, x, y, z), e.tilt_sigma, _normals(s, streams + _TILT, k)[0])
    turning, pitching = _normals(s, streams + _GYRO, k)
    reading.turning = plain_reading(twist[5], e.gyro_sigma, turning)
    reading.pitching = plain_reading(twist[4], e.gyro_sigma, pitching)


class Inbox(NamedTuple):
    """What f followers have received from the leader; brought forward by `receive`."""

    message: Floats
    """Last message of each, shape (f, MESSAGE)."""
    ranges: Floats
    """Its ranges to rear, front and middle transmitter, shape (f, 3), [m]; NaN where nothing was received."""
    over: Ints
    """How many messages each no longer waits for, shape (f,)."""
    last_sent: Ints
    """Filter step at which the last message was sent, shape (f,); 0: there is none."""
    bad: Floats
    """Whether each channel is in its bad state, shape (f,)."""
    fluctuation: Floats
    """Gauss–Markov errors of pitch and roll in the last message, of unit variance, shape (f, 2)."""
    outcome: Ints
    """NO_MESSAGE, NO_RANGES or RECEIVED at this filter step, shape (f,)."""


def new_inbox(followers: int) -> Inbox:
    """Nothing received yet."""
    f = followers
    counts = (np.zeros(f, dtype=np.int64) for _ in range(3))
    return Inbox(np.zeros((f, MESSAGE)), np.full((f, 3), np.nan), next(counts), next(counts), np.zeros(f),
                 np.zeros((f, 2)), next(counts))  # fmt: skip


@compiled
def broadcast(s: SensorModel, k: int, body: Body, tilt: Floats, fluctuation: Floats, message: Floats) -> None:
    """Make the message that the leader sends at filter step k.

    Args:
        tilt: what accelerations add to measured pitch and roll, shape (2,), [rad].
        fluctuation: Gauss–Markov errors of pitch and roll, of unit variance, shape (2,).
        message: out: columns of `LeaderMessage` from timestamp to roll, shape (MESSAGE,).
    """
    pose, twist, water = body
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    e = s.errors[0]
    _, second = _normals(s, _LEADER_MOTION, k)
    message[0] = k * s.dt
    message[1] = pose[0] + e.leader_drift_east * message[0]
    message[2] = pose[1] + e.leader_drift_north * message[0]
    message[3] = heading_reading(heading_of(w, x, y, z), e.leader_heading_bias, e.leader_heading_sigma, second)
    speed = speed_through_water(pose, twist, water)
    message[4] = speed_reading(speed, e.leader_speed_bias, 0.0, 0.0)
    message[5] = plain_reading(-pose[2], e.leader_depth_sigma, _normals(s, _LEADER_DEPTH, k)[0])
    message[6] = message[7] = np.nan
    if s.broadcast_attitude:
        offset, sigma = _normals(s, _LEADER_ATTITUDE, 0), e.leader_attitude_offset_sigma
        pitch = plain_reading(pitch_of(w, x, y, z) + tilt[0], sigma, offset[0])
        roll = plain_reading(roll_of(w, x, y, z) + tilt[1], sigma, offset[1])
        message[6] = plain_reading(pitch, e.leader_tilt_sigma, fluctuation[0])
        message[7] = plain_reading(roll, e.leader_tilt_sigma, fluctuation[1])


@compiled
def _fluctuate(s: SensorModel, k: int, since: int, fluctuation: Floats) -> None:
    """Bring errors of pitch and roll forward to filter step k from the message before, so many steps ago (0: none)."""
    kept, time = 0.0, s.errors[0].leader_tilt_time
    if since > 0 and time > 0.0:
        kept = np.exp(-since * (s.dt / time))
    fresh, drawn = np.sqrt(1.0 - kept * kept), _normals(s, _LEADER_ATTITUDE, k)
    fluctuation[0] = advanced(fluctuation[0], kept, fresh, drawn[0])
    fluctuation[1] = advanced(fluctuation[1], kept, fresh, drawn[1])


@compiled
def read_ranges(s: SensorModel, k: int, sent: int, follower: int, true: Floats, inbox: Inbox) -> int:
    """Read the ranges of a message that is in.

    Args:
        sent: filter step at which it was sent.
        true: range of each ping by each path, shape (3, 3), [m]; NaN for pings that are not received.
        inbox: ranges and state of the channel are brought forward.

    Returns:
        NO_RANGES or RECEIVED.
    """
    streams, ranges, e = STREAMS * follower, inbox.ranges[follower], s.errors[follower]
    taken = _uniforms(s, streams + _ECHO, sent)
    for i in range(3):
        ranges[i] = true[i, path_taken(taken[0 if e.common_echoes else i], e)]
    drawn, normal = _uniforms(s, streams + _RANGE_UNIFORM, k), _normals(s, streams + _RANGE_SCALE, k)[0]
    ranges[0], ranges[1], ranges[2] = range_readings(
        e, s.transmitters, (ranges[0], ranges[1], ranges[2]), drawn, normal
    )
    if loses(e):
        fate = _uniforms(s, streams + _LOSS, sent)
        in_burst = is_bad(inbox.bad[follower] > 0.0, fate[0], e)
        inbox.bad[follower] = 1.0 if in_burst else 0.0
        if is_lost(in_burst, fate[1], e):
            ranges[:] = np.nan
    return RECEIVED if ranges[0] == ranges[0] or ranges[1] == ranges[1] or ranges[2] == ranges[2] else NO_RANGES


@compiled
def _follow(s: SensorModel, known: Motion, sites: tuple[Floats, Floats], follower: int, sent: int, true: Floats) -> int:
    """Follow the sound of a message to one follower, as far as the motion is known.

    Args:
        known: the motion.
        sites: as of `receive`.
        sent: filter step at which it was sent.
        true: out: range of each ping by each path before random errors, shape (3, 3), [m]; NaN for pings that are not
            received.

    Returns:
        The filter step by which all pings that are waited for are in; right as soon as it is not later than what is
        known.
    """
    sound, hydrophone = s.sound, sites[1][follower]
    complete, direct, arrivals = sent * s.dt, np.empty(3), np.empty((3, 3))
    for i in range(3):
        leaves = sent * s.dt + sound.slot * i
        source = site_at(sound, known, 0, sites[0][i], leaves)
        for path in range(3):
            true[i, path] = np.nan
            if not sound.paths[path]:
                continue
            arrival = arrival_of(sound, known, follower + 1, hydrophone, path, leaves, source)
            if path == 0:
                direct[i] = arrival.length
            arrivals[i, path] = arrival.time
            true[i, path] = range_of(sound, direct[i], arrival)
            if i < s.transmitters:
                complete = max(complete, arrival.time)
    step = reception_step(complete, s.dt)
    for i in range(3):
        for path in range(3):
            if sound.paths[path] and not is_in_time(arrivals[i, path], step, s.dt):
                true[i, path] = np.nan
    return int(step)


@compiled
def is_under_way(k: int, follower: int, message_every: int, inbox: Inbox) -> bool:
    """Whether a message may come in at filter step k: one is sent that the follower still waits for."""
    return bool((inbox.over[follower] + 1) * message_every <= k)


@compiled
def receive(
    s: SensorModel, k: int, follower: int, sites: tuple[Floats, Floats], known: Motion, tilts: Floats, inbox: Inbox
) -> None:
    """Take up the message that is in at filter step k, if there is one.

    Args:
        sites: offsets of the transmitters, shape (3, 3), and of the followers' hydrophones, shape (f, 3), [m].
        known: the motion until now.
        tilts: what accelerations add to the leader's measured pitch and roll at each instant, shape (n, 2), [rad].
        inbox: brought forward.
    """
    inbox.outcome[follower] = NO_MESSAGE
    true, truth = np.empty((3, 3)), known.truth
    while is_under_way(k, follower, s.message_every, inbox):
        sent = (inbox.over[follower] + 1) * s.message_every
        if _follow(s, known, sites, follower, sent, true) > k:
            return
        inbox.over[follower] += 1
        # of two messages within one filter step the follower keeps the first
        if inbox.outcome[follower] == NO_MESSAGE:
            at, before, fluctuation = sent * s.stride, inbox.last_sent[follower], inbox.fluctuation[follower]
            _fluctuate(s, sent, sent - before if before > 0 else 0, fluctuation)
            inbox.last_sent[follower] = sent
            leader = truth.pose[at, 0], truth.twist[at, 0], truth.water[at, 0]
            broadcast(s, sent, leader, tilts[at], fluctuation, inbox.message[follower])
            inbox.outcome[follower] = read_ranges(s, k, sent, follower, true, inbox)

"""What followers read and receive at one instant, in compiled code: for followers that steer by it.

Sensors, sound and noise are those of `sim.sensing.sensors` and `sim.sensing.acoustics`; what the past has left of an
error is kept from instant to instant.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the follower's vehicle is the one
after.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Record, Records, records
from laisn.compiled import compiled
from laisn.swarm import MESSAGE
from sim.geometry.attitude import heading_of, pitch_of, roll_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import ARRIVAL, Motion, Sound, follow, received_range, reception_step, sound_of
from sim.sensing.ahrs import advanced, gain
from sim.sensing.errors import ERRORS, errors_of, is_bad, is_lost, loses
from sim.sensing.noise import Address, Stream, normals_at, uniforms_at
from sim.sensing.sensors import Carrier, read_follower, read_message, read_ranges, true_message, write_true_own
from sim.trajectory import Body

# compiled code holds numbers, not the members of an enum
_ATTITUDE, _LOSS = int(Stream.LEADER_ATTITUDE), int(Stream.LOSS)

NO_MESSAGE, NO_RANGES, RECEIVED = range(3)
"""Outcome of a filter step: no message is in; one is, of which no ping was received; one with ranges is."""

State = tuple[Floats, Floats, Floats]
"""Pose, twist and water velocity of a vehicle, shapes (7,), (6,) and (3,)."""


class SensorModel(NamedTuple):
    """Sensors and acoustics of a mission as compiled code takes them."""

    seed: np.uint64
    run: np.uint64
    errors: Records
    """Of each follower, of ERRORS, shape (f,)."""
    senses_acceleration: bool
    """The leader takes accelerations for tilt."""
    tilt_share: float
    """`sim.sensing.ahrs.gain` of the leader."""
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
        seed=np.uint64(scenario.seed),
        run=np.uint64(scenario.run),
        errors=np.array([tuple(errors_of(scenario, i)) for i in followers], ERRORS).view(np.recarray),
        senses_acceleration=leader.broadcast_attitude and scenario.sensors.leader_attitude_senses_acceleration,
        tilt_share=gain(scenario.sensors),
        dt=scenario.timing.filter_step_s,
        stride=round(scenario.timing.filter_step_s / CONTROL_STEP_S),
        message_every=scenario.message_every,
        sound=sound_of(scenario),
    )


@compiled
def body_of(state: State) -> Body:
    """The motion of a vehicle as sensors take it."""
    pose, twist, water = state
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    return Body(pose, twist, water, heading_of(w, x, y, z), pitch_of(w, x, y, z), roll_of(w, x, y, z))


@compiled
def read_instruments(
    s: SensorModel, k: int, follower: int, state: State, depth_sensor: Floats, reading: Record
) -> None:
    """Read a follower's own sensors at filter step k.

    Args:
        depth_sensor: its offset, shape (3,), [m].
        reading: out: record of `laisn.swarm.READING`.
    """
    e = s.errors[follower]
    write_true_own(e, Carrier(follower, k * s.dt, body_of(state), depth_sensor), reading)
    read_follower(e, Address(s.seed, s.run, follower, k), reading, reading)


class Inbox(NamedTuple):
    """What f followers have received from the leader; brought forward by `receive`."""

    message: Records
    """Last message of each, of MESSAGE, shape (f,)."""
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
    return Inbox(records(MESSAGE, f), np.full((f, 3), np.nan), next(counts), next(counts), np.zeros(f),
                 np.zeros((f, 2)), next(counts))  # fmt: skip


@compiled
def broadcast(s: SensorModel, k: int, state: State, tilt: Floats, fluctuation: Floats, message: Record) -> None:
    """Make the message that the leader sends at filter step k.

    Args:
        tilt: what accelerations add to measured pitch and roll, shape (2,), [rad]; NaN if these are not broadcast.
        fluctuation: Gauss–Markov errors of pitch and roll, of unit variance, shape (2,).
        message: out: of MESSAGE.
    """
    e, sent = s.errors[0], Address(s.seed, s.run, 0, k)
    true_message(e, k * s.dt, body_of(state), tilt, message)
    read_message(e, sent, message, normals_at(Address(s.seed, s.run, 0, 0), _ATTITUDE), fluctuation, message)


@compiled
def _fluctuate(s: SensorModel, k: int, since: int, fluctuation: Floats) -> None:
    """Bring errors of pitch and roll forward to filter step k from the message before, so many steps ago (0: none)."""
    kept, time = 0.0, s.errors[0].leader_tilt_time
    if since > 0 and time > 0.0:
        kept = np.exp(-since * (s.dt / time))
    fresh, drawn = np.sqrt(1.0 - kept * kept), normals_at(Address(s.seed, s.run, 0, k), _ATTITUDE)
    fluctuation[0] = advanced(fluctuation[0], kept, fresh, drawn[0])
    fluctuation[1] = advanced(fluctuation[1], kept, fresh, drawn[1])


@compiled
def _measure_ranges(s: SensorModel, k: int, sent: int, follower: int, arrivals: Records, inbox: Inbox) -> int:
    """Measure the ranges of a message that is in.

    Args:
        sent: filter step at which it was sent.
        arrivals: of its pings, as `sim.sensing.acoustics.follow` writes them.
        inbox: ranges and state of the channel are brought forward.

    Returns:
        NO_RANGES or RECEIVED.
    """
    ranges, e, true = inbox.ranges[follower], s.errors[follower], np.empty((3, 3))
    at, now = Address(s.seed, s.run, follower, sent), Address(s.seed, s.run, follower, k)
    for i in range(3):
        for path in range(3):
            true[i, path] = received_range(arrivals[i, path], k, s.dt)
    ranges[0], ranges[1], ranges[2] = read_ranges(e, s.sound.transmitters, at, now, true)
    if loses(e):
        fate = uniforms_at(at, _LOSS)
        in_burst = is_bad(inbox.bad[follower] > 0.0, fate[0], e)
        inbox.bad[follower] = 1.0 if in_burst else 0.0
        if is_lost(in_burst, fate[1], e):
            ranges[:] = np.nan
    return RECEIVED if ranges[0] == ranges[0] or ranges[1] == ranges[1] or ranges[2] == ranges[2] else NO_RANGES


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
    truth, arrivals, to_follower = known.truth, np.empty((3, 3), ARRIVAL), (sites[0], sites[1][follower])
    while is_under_way(k, follower, s.message_every, inbox):
        sent = (inbox.over[follower] + 1) * s.message_every
        complete = follow(s.sound, known, to_follower, follower + 1, sent * s.dt, arrivals)
        if reception_step(complete, s.dt) > k:
            return
        inbox.over[follower] += 1
        # of two messages within one filter step the follower keeps the first
        if inbox.outcome[follower] == NO_MESSAGE:
            at, before, fluctuation = sent * s.stride, inbox.last_sent[follower], inbox.fluctuation[follower]
            _fluctuate(s, sent, sent - before if before > 0 else 0, fluctuation)
            inbox.last_sent[follower] = sent
            leader = truth.pose[at, 0], truth.twist[at, 0], truth.water[at, 0]
            broadcast(s, sent, leader, tilts[at], fluctuation, inbox.message[follower])
            inbox.outcome[follower] = _measure_ranges(s, k, sent, follower, arrivals, inbox)

"""What a follower receives at a filter step: which message is in, what it says, and the ranges that
its pings show.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the
follower's vehicle is the one after.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll

from laisn.arrays import Bools, Floats, Ints, Record, Records, numbers_of, records
from laisn.compiled import compiled, jitable
from laisn.messages import LeaderMessage
from laisn.swarm import MESSAGE
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing import acoustics, noise, sensors
from sim.sensing.noise import Address
from sim.sensing.sensor_model import SensorModel
from sim.trajectory import StateHistory, row

# compiled code holds numbers, not the members of an enum
_ATTITUDE = int(noise.Stream.LEADER_ATTITUDE)
_POSITION = int(noise.Stream.LEADER_POSITION)
_POSITION_WALK = int(noise.Stream.LEADER_POSITION_WALK)
_LOSS = int(noise.Stream.LOSS)
_RANGE_UNIFORM = int(noise.Stream.RANGE_UNIFORM)
_RANGE_SCALE = int(noise.Stream.RANGE_SCALE)
_BROADCAST = (*sensors.LEADER, *sensors.LEADER_ATTITUDE)
_COLUMNS = (
    LeaderMessage._fields.index(name)
    for name in ("timestamp", "east", "north", "heading_sigma", "position_sigma")
)
_TIME, _EAST, _NORTH, _HEADING_SIGMA, _POSITION_SIGMA = _COLUMNS
CONTENT_SIZE = len(LeaderMessage._fields)  # numbers of a message
# outcome of a filter step; NO_RANGES: a message without a ping is in
NO_MESSAGE, NO_RANGES, RECEIVED = range(3)


class Inbox(NamedTuple):
    """What f followers have received from the leader."""

    message: Records  # last message of each, of MESSAGE, shape (f,)
    message_values: Floats  # the same memory as numbers, shape (f, 10)
    # to rear, front and middle transmitter, shape (f, 3), [m]; NaN where nothing was received
    ranges: Floats
    messages_done: Ints  # how many messages each no longer waits for, shape (f,)
    earliest_step: Ints  # filter step before which the next one cannot be in, shape (f,)
    last_sent: Ints  # filter step at which the last message was sent, shape (f,); 0: there is none
    channel_bad: Bools  # whether each channel is in its bad state, shape (f,)
    # Gauss–Markov errors of pitch and roll in the last message, of unit variance, shape (f, 2)
    fluctuation: Floats
    # of the leader's position in the last message, in steps of unit variance, shape (f, 2)
    walk: Floats
    outcome: Ints  # NO_MESSAGE, NO_RANGES or RECEIVED at this filter step, shape (f,)


def new_inbox(followers: int, message_every: int, sent_before: int = 0) -> Inbox:
    """Nothing received yet; `sent_before` messages were sent before the motion that is sensed
    begins.
    """
    message = records(MESSAGE, followers)
    zeros = np.zeros((3, followers), dtype=np.int64)
    return Inbox(
        message,
        numbers_of(message),
        np.full((followers, 3), np.nan),
        np.full(followers, sent_before),
        np.full(followers, (sent_before + 1) * message_every),
        zeros[0],
        np.zeros(followers, dtype=np.bool_),
        np.zeros((followers, 2)),
        np.zeros((followers, 2)),
        zeros[1],
    )


@jitable
def listener_of(s: SensorModel, receiver: int, hydrophone: Any) -> acoustics.Listener:
    """A receiver by its index, and the offset of its hydrophone, shape (3,), [m]."""
    return acoustics.Listener(
        receiver + 1, hydrophone, s.transmitters[receiver], s.assumed_sound[receiver]
    )


@jitable
def poll_reception(
    s: SensorModel,
    k: int,
    follower: int,
    sites: acoustics.Sites,
    motion: acoustics.Motion,
    inbox: Inbox,
) -> tuple[int, acoustics.Pings]:
    """Filter step at which the message was sent that is in at step k, and its pings; 0: there is
    none.
    """
    emission_step = 0
    pings = acoustics.NO_PINGS
    while inbox.earliest_step[follower] <= k:
        sent = (inbox.messages_done[follower] + 1) * s.message_every + s.message_offset
        listener = listener_of(s, follower, sites.hydrophones[follower])
        complete, candidate_pings = acoustics.follow(
            s.sound, motion, sites.transmitters, listener, sent * s.dt
        )
        step = acoustics.reception_step(complete, s.dt)
        if step > k:
            # later than what is known the arrival is not final
            final = complete <= motion.begin + motion.last * CONTROL_STEP_S
            inbox.earliest_step[follower] = step if final else k + 1
            break
        inbox.messages_done[follower] += 1
        inbox.earliest_step[follower] = (
            inbox.messages_done[follower] + 1
        ) * s.message_every + s.message_offset
        # of two messages within one filter step the follower keeps the first
        if emission_step == 0:
            emission_step = sent
            pings = candidate_pings
    return emission_step, pings


@jitable
def sender_at(
    s: SensorModel, step: int, i: int, truth: StateHistory, tilts: Floats
) -> tuple[tuple[float, float], sensors.Instant]:
    """East and north of the sender [m] at a filter step, which is instant i, and what its sensors
    see.
    """
    tilt = (tilts[i, 0], tilts[i, 1])
    origin = (0.0, 0.0, 0.0)
    pose = row(truth.pose, i, 0)
    twist = row(truth.twist, i, 0)
    water = row(truth.water, i, 0)
    instant = sensors.instant_of((step * s.dt, 0), (pose, twist, water), origin, tilt)
    return (pose[0], pose[1]), instant


@jitable
def true_reception(
    s: SensorModel,
    e: sensors.SensorErrors,
    leader: tuple[tuple[float, float], sensors.Instant],
    k: int,
    pings: acoustics.Pings,
    content: Floats,
    ranges: Floats,
) -> None:
    """Write what a message that is taken up at step k holds and shows without random errors and
    constant biases.

    `leader` are east and north of the leader [m], and what its sensors see; `content` is in the
    order of `LeaderMessage`, shape (10,), `ranges` slant ranges, shape (3 transmitters, 3 paths).
    """
    leader_position, instant = leader
    content[_TIME] = instant.time
    content[_HEADING_SIGMA] = np.nan
    content[_POSITION_SIGMA] = np.nan
    content[_EAST] = leader_position[0] + e.leader_drift_east * instant.time
    content[_NORTH] = leader_position[1] + e.leader_drift_north * instant.time
    for sensor in literal_unroll(_BROADCAST):
        sensors.write_channels(sensor.true(e, instant, None), sensor.column, content)
    for i in range(3):
        for path in range(3):
            ranges[i, path] = acoustics.received_range(s.sound, pings[i][1], path, k, s.dt)


def first_message(s: SensorModel, pose: Floats, twist: Floats, water: Floats) -> Record:
    """What the leader broadcasts of itself before the mission, as its sensors read it at step 0.

    Followers know it at the start: place, heading, speed and depth, a record of MESSAGE; NaN for
    the rest. Pose, twist and velocity of the water are the leader's, shapes (7,), (6,) and (3,).
    """
    e = s.errors[0]
    message = records(MESSAGE, 1)
    content = numbers_of(message)[0]
    content[:] = np.nan
    content[_TIME] = 0.0
    instant = sensors.instant_of((0.0, 0), (pose, twist, water), np.zeros(3), (0.0, 0.0))
    address = Address(s.seed, s.run, 0, 0)
    normals = noise.normals_at(address, _POSITION)
    content[_EAST] = sensors.read_leader_position(e, pose[0], normals[0], 0.0)
    content[_NORTH] = sensors.read_leader_position(e, pose[1], normals[1], 0.0)
    for sensor in sensors.LEADER:
        normals = noise.normals_at(address, sensor.stream)
        (content[sensor.column],) = sensor.read(e, sensor.true(e, instant, None), normals)
    return message[0]


@jitable
def _read_message(
    e: sensors.SensorErrors, dt: float, sent: Address, true: Any, inbox: Inbox, f: int
) -> None:
    """Read the content of a message, `true` of `true_reception`, with the noise at the address at
    which it was sent, into the inbox of follower f.
    """
    content = inbox.message_values[f]
    fluctuation = inbox.fluctuation[f]
    last = inbox.last_sent[f]
    for i in (_TIME, _EAST, _NORTH, _HEADING_SIGMA, _POSITION_SIGMA):
        content[i] = true[i]
    if sensors.position_errs(e):
        walk = inbox.walk[f]
        normals = noise.normals_at(sent, _POSITION)
        for k in range(last + 1, sent.step + 1):
            stepped = Address(sent.seed, sent.run, sent.follower, k)
            added = noise.normals_at(stepped, _POSITION_WALK)
            walk[0] += added[0]
            walk[1] += added[1]
        root = math.sqrt(dt)
        content[_EAST] = sensors.read_leader_position(e, true[_EAST], normals[0], root * walk[0])
        content[_NORTH] = sensors.read_leader_position(e, true[_NORTH], normals[1], root * walk[1])
    persistence, spread_weight = sensors.gauss_markov_weights(
        sent.step - last if last > 0 else 0, dt, e.leader_tilt_time
    )
    # step 0, at which nothing is measured, addresses errors that a run keeps
    kept_address = Address(sent.seed, sent.run, sent.follower, 0)
    offset = noise.normals_at(kept_address, _ATTITUDE)
    normals = noise.normals_at(sent, _ATTITUDE)
    for i in range(2):
        fluctuation[i] = sensors.gauss_markov_step(
            fluctuation[i], persistence, spread_weight, normals[i]
        )
    tilt_draws = (offset[0], offset[1], fluctuation[0], fluctuation[1])
    for sensor in literal_unroll(sensors.LEADER_ATTITUDE):
        sensors.write_channels(
            sensor.read(e, true[sensor.column :], tilt_draws), sensor.column, content
        )
    inbox.last_sent[f] = sent.step
    for sensor in literal_unroll(sensors.LEADER):
        draws = noise.normals_at(sent, sensor.stream)
        sensors.write_channels(sensor.read(e, true[sensor.column :], draws), sensor.column, content)


@jitable
def read_reception(
    e: sensors.SensorErrors,
    transmitters_and_dt: tuple[int, float],
    addresses: tuple[Address, Address],
    true: tuple[Any, Any],
    inbox: Inbox,
    f: int,
) -> None:
    """Read a message that is taken up and measure its ranges, with echoes and losses, into the
    inbox of follower f.

    Args:
        e: errors of the sensors.
        transmitters_and_dt: how many transmitters the follower uses, and its filter step [s].
        addresses: of the noise, when the message was sent and when it is taken up.
        true: content and ranges of `true_reception`.
        inbox: out.
        f: index of the follower in it.
    """
    sent, received = addresses
    transmitters, dt = transmitters_and_dt
    content, by_path = true
    ranges = inbox.ranges[f]
    _read_message(e, dt, sent, content, inbox, f)
    paths = sensors.paths_taken(e, sent)
    uniform = noise.uniforms_at(received, _RANGE_UNIFORM)
    received_ranges = by_path[0][paths[0]], by_path[1][paths[1]], by_path[2][paths[2]]
    psi = noise.normals_at(received, _RANGE_SCALE)[0]
    longest = sensors.longest_range(received_ranges, transmitters)
    scales = longest, longest, sensors.longest_range(received_ranges, 3)
    for i in range(3):
        ranges[i] = sensors.range_reading(
            e, e.range_tau[i], (received_ranges[i], scales[i]), (uniform[i], psi)
        )
    if sensors.loses(e):
        uniforms = noise.uniforms_at(sent, _LOSS)
        inbox.channel_bad[f] = sensors.is_bad(inbox.channel_bad[f], uniforms[0], e)
        is_heard = sensors.is_heard(uniforms[2], e, by_path[0][0], received.step * dt)
        if sensors.is_lost(inbox.channel_bad[f], uniforms[1], e) or not is_heard:
            ranges[0] = ranges[1] = ranges[2] = np.nan
    is_heard = ranges[0] == ranges[0] or ranges[1] == ranges[1] or ranges[2] == ranges[2]
    inbox.outcome[f] = RECEIVED if is_heard else NO_RANGES


@compiled
def receive(
    s: SensorModel,
    k: int,
    follower: int,
    sites: acoustics.Sites,
    motion: acoustics.Motion,
    tilts: Floats,
    inbox: Inbox,
) -> None:
    """Take up and read the message that is in at filter step k, if there is one.

    `tilts` are what accelerations add to the leader's measured pitch and roll at each instant,
    shape (n, 2), [rad].
    """
    inbox.outcome[follower] = NO_MESSAGE
    sent, pings = poll_reception(s, k, follower, sites, motion, inbox)
    if sent > 0:
        e = s.errors[follower]
        content = np.empty(CONTENT_SIZE)
        ranges = np.empty((3, 3))
        true_reception(
            s,
            e,
            sender_at(s, sent, sent * s.stride, motion.truth, tilts),
            k,
            pings,
            content,
            ranges,
        )
        number = s.noise_numbers[follower]
        addresses = Address(s.seed, s.run, number, sent), Address(s.seed, s.run, number, k)
        read_reception(
            e, (s.transmitters[follower], s.dt), addresses, (content, ranges), inbox, follower
        )

"""What followers read, receive and see nearby at one instant, in compiled code: for followers that steer by it.

Sensors, sound and noise are those of `sim.sensing.sensors` and `sim.sensing.acoustics`; what the past has left of an
error is kept from instant to instant. The proximity sensor looks all around in a level fan. It senses every vehicle
within its range and its fan, whatever lies between, and takes hulls for points at their middles; its errors are drawn
for each look of one follower at one vehicle.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the follower's vehicle is the one
after.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Record, Records, records
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from laisn.swarm import MESSAGE
from sim.attitude import heading_of, pitch_of, roll_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import ARRIVAL, Motion, Sound, follow, received_range, reception_step, sound_of
from sim.sensing.errors import ERRORS, advanced, errors_of, gain, is_bad, is_lost, loses
from sim.sensing.noise import STREAMS, Address, Stream, normals_at, two_normals, two_units, uniforms_at, words
from sim.sensing.sensors import read_message, read_own, read_ranges, read_steering, true_message, true_own
from sim.trajectory import Body, Trajectory

# compiled code holds numbers, not the members of an enum
_ATTITUDE, _LOSS = int(Stream.LEADER_ATTITUDE), int(Stream.LOSS)

NO_MESSAGE, NO_RANGES, RECEIVED = range(3)
"""Outcome of a filter step: no message is in; one is, of which no ping was received; one with ranges is."""

State = tuple[Floats, Floats, Floats]  # pose, twist and water velocity of a vehicle, shapes (7,), (6,) and (3,)


class SensorModel(NamedTuple):
    """Sensors and acoustics of a mission as compiled code takes them."""

    seed: np.uint64
    run: np.uint64
    errors: Records  # of each follower, of ERRORS, shape (f,)
    senses_acceleration: bool  # the leader takes accelerations for tilt
    tilt_share: float  # `sim.sensing.errors.gain` of the leader
    dt: float
    stride: int  # instants from one filter step to the next
    message_every: int  # filter steps from one message to the next
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
    """Read a follower's own sensors at filter step k into a record of `laisn.swarm.READING`."""
    e, address, body = s.errors[follower], Address(s.seed, s.run, follower, k), body_of(state)
    true_own(e, follower, k * s.dt, body, depth_sensor, reading)
    read_own(e, address, reading, reading)
    read_steering(e, address, body, reading)


class Inbox(NamedTuple):
    """What f followers have received from the leader; brought forward by `receive`."""

    message: Records  # last message of each, of MESSAGE, shape (f,)
    ranges: Floats
    """Its ranges to rear, front and middle transmitter, shape (f, 3), [m]; NaN where nothing was received."""
    over: Ints  # how many messages each no longer waits for, shape (f,)
    last_sent: Ints  # filter step at which the last message was sent, shape (f,); 0: there is none
    bad: Floats  # whether each channel is in its bad state, shape (f,)
    fluctuation: Floats  # Gauss–Markov errors of pitch and roll in the last message, of unit variance, shape (f, 2)
    outcome: Ints  # NO_MESSAGE, NO_RANGES or RECEIVED at this filter step, shape (f,)


def new_inbox(followers: int) -> Inbox:
    """Nothing received yet."""
    over, last_sent, outcome = np.zeros((3, followers), dtype=np.int64)
    ranges, fluctuation = np.full((followers, 3), np.nan), np.zeros((followers, 2))
    return Inbox(records(MESSAGE, followers), ranges, over, last_sent, np.zeros(followers), fluctuation, outcome)


@compiled
def broadcast(s: SensorModel, k: int, state: State, tilt: Floats, since: int, fluctuation: Floats, out: Record) -> None:
    """Make the message that the leader sends at filter step k, so many steps after the one before (0: there is none).

    Args:
        tilt: what accelerations add to measured pitch and roll, shape (2,), [rad]; NaN if these are not broadcast.
        fluctuation: Gauss–Markov errors of pitch and roll, of unit variance, shape (2,); brought forward.
        out: of MESSAGE.
    """
    e, sent, kept = s.errors[0], Address(s.seed, s.run, 0, k), 0.0
    if since > 0 and e.leader_tilt_time > 0.0:
        kept = np.exp(-since * (s.dt / e.leader_tilt_time))
    fresh, drawn = np.sqrt(1.0 - kept * kept), normals_at(sent, _ATTITUDE)
    fluctuation[0] = advanced(fluctuation[0], kept, fresh, drawn[0])
    fluctuation[1] = advanced(fluctuation[1], kept, fresh, drawn[1])
    true_message(e, k * s.dt, body_of(state), tilt, out)
    read_message(e, sent, out, normals_at(Address(s.seed, s.run, 0, 0), _ATTITUDE), fluctuation, out)


@compiled
def _measure_ranges(s: SensorModel, k: int, sent: int, follower: int, arrivals: Records, inbox: Inbox) -> int:
    """Measure the ranges of a message that is in, sent at filter step `sent`: NO_RANGES or RECEIVED."""
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
            since = sent - before if before > 0 else 0
            inbox.last_sent[follower] = sent
            leader = truth.pose[at, 0], truth.twist[at, 0], truth.water[at, 0]
            broadcast(s, sent, leader, tilts[at], since, fluctuation, inbox.message[follower])
            inbox.outcome[follower] = _measure_ranges(s, k, sent, follower, arrivals, inbox)


SIGHTING = np.dtype(
    [
        ("range", np.float64),  # [m]; NaN: nothing was sensed
        ("bearing", np.float64),  # to starboard of the own heading [rad]
    ]
)
"""What a look shows of one vehicle."""

_U = np.uint64
_NEARBY = int(Stream.NEARBY)


def look_interval(scenario: Scenario) -> int:
    """Ticks from one look of the followers to the next; 0: they have no sensor."""
    proximity = scenario.formation.proximity
    return round(proximity.period_s / CONTROL_STEP_S) if proximity else 0


@compiled
def look(address: tuple[np.uint64, np.uint64], p: Record, k: int, follower: int, poses: Floats, seen: Records) -> None:
    """Look around at tick k, from 1.

    Args:
        address: seed and run of the noise.
        p: record of `[formation.proximity]`.
        poses: of all vehicles, shape (v, 7).
        seen: out: of every vehicle, of SIGHTING, shape (v,).
    """
    own, steepest = follower + 1, np.sin(0.5 * p.aperture)
    heading = heading_of(poses[own, 3], poses[own, 4], poses[own, 5], poses[own, 6])
    for j in range(poses.shape[0]):
        seen[j].range = seen[j].bearing = np.nan
        x, y, z = poses[j, 0] - poses[own, 0], poses[j, 1] - poses[own, 1], poses[j, 2] - poses[own, 2]
        distance = np.sqrt(x * x + y * y + z * z)
        if j == own or distance > p.range or abs(z) > steepest * distance:
            continue
        w0, w1, w2, w3 = words(address[0], address[1], _U(STREAMS * follower + _NEARBY + j), _U(k))
        first, second = two_units(w0, w1, w2, w3)
        long, aside = two_normals(first, second)
        seen[j].range = max(distance + p.range_sigma * long, 0.0)
        seen[j].bearing = signed_angle(np.arctan2(x, y) - heading + p.bearing_sigma * aside)


class Sightings(NamedTuple):
    """What followers of a flight sensed nearby."""

    first_s: Floats  # when each follower first saw each vehicle, shape (f, v), [s]; NaN: never
    spent_s: Floats  # time for which each follower detected a vehicle, shape (f,), [s]


def sightings(scenario: Scenario, trajectory: Trajectory) -> Sightings:
    """What the followers' sensors showed on the way, which they steered by; nothing where they have none."""
    proximity, f, every = scenario.formation.proximity, len(scenario.followers), look_interval(scenario)
    first, spent = np.full((f, f + 1), np.nan), np.zeros(f)
    for i, follower in enumerate(scenario.followers):
        # followers on routes have no sensor
        if proximity is None or follower.station is None:
            continue
        apart = trajectory.position[every::every] - trajectory.position[every::every, [i + 1]]
        distance = np.sqrt(apart[..., 0] ** 2 + apart[..., 1] ** 2 + apart[..., 2] ** 2)
        steepest = np.sin(0.5 * np.deg2rad(proximity.aperture_deg))
        seen = (distance <= proximity.range_m) & (np.abs(apart[..., 2]) <= steepest * distance)
        seen[:, i + 1] = False
        first[i, seen.any(axis=0)] = (seen.argmax(axis=0)[seen.any(axis=0)] + 1) * every * CONTROL_STEP_S
        spent[i] = np.count_nonzero(seen.any(axis=1)) * every * CONTROL_STEP_S
    return Sightings(first, spent)

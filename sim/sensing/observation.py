"""The sensing driver: what followers read and receive, at one instant under way and of a finished mission.

Both uses call the same functions of `sim.sensing.sensors` and `sim.sensing.acoustics` with the same noise: compiled
code with numbers (`read_instruments`, `receive`), for followers that steer by it; Python with arrays over all filter
steps and messages, first without random errors (`observe`), then for a run (`measure`).

The proximity sensor looks all around in a level fan. It senses every vehicle within its range and its fan, whatever
lies between, and takes hulls for points at their middles; its errors are drawn for each look at one vehicle.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the follower's vehicle is the one
after.
"""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Record, Records, own_arrays, records
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from laisn.messages import LeaderMessage, Measurements
from laisn.swarm import MESSAGE, READING
from sim.attitude import heading_of, pitch_of, roll_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing import acoustics, sensors
from sim.sensing.noise import (
    STREAMS,
    Address,
    Stream,
    normals,
    normals_at,
    two_normals,
    two_units,
    uniforms,
    uniforms_at,
    words,
)
from sim.trajectory import Body, Trajectory

# compiled code holds numbers, not the members of an enum
_ATTITUDE, _LOSS = int(Stream.LEADER_ATTITUDE), int(Stream.LOSS)

NO_MESSAGE, NO_RANGES, RECEIVED = range(3)  # outcome of a filter step; NO_RANGES: a message without a ping is in

State = tuple[Floats, Floats, Floats]  # pose, twist and water velocity of a vehicle, shapes (7,), (6,) and (3,)


class SensorModel(NamedTuple):
    """Sensors and acoustics of a mission as compiled code takes them."""

    seed: np.uint64
    run: np.uint64
    errors: Records  # of each follower, of ERRORS, shape (f,)
    senses_acceleration: bool  # the leader takes accelerations for tilt
    tilt_share: float  # `sim.sensing.sensors.gain` of the leader
    dt: float
    stride: int  # instants from one filter step to the next
    message_every: int  # filter steps from one message to the next
    sound: acoustics.Sound


def sensor_model_of(scenario: Scenario) -> SensorModel:
    """Sensors and acoustics of a scenario as compiled code takes them."""
    leader, followers = scenario.leader, range(len(scenario.followers))
    return SensorModel(
        seed=np.uint64(scenario.seed),
        run=np.uint64(scenario.run),
        errors=np.array([tuple(sensors.errors_of(scenario, i)) for i in followers], sensors.ERRORS).view(np.recarray),
        senses_acceleration=leader.broadcast_attitude and scenario.sensors.leader_attitude_senses_acceleration,
        tilt_share=sensors.gain(scenario.sensors),
        dt=scenario.timing.filter_step_s,
        stride=round(scenario.timing.filter_step_s / CONTROL_STEP_S),
        message_every=scenario.message_every,
        sound=acoustics.sound_of(scenario),
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
    sensors.true_own(e, follower, k * s.dt, body, depth_sensor, reading)
    sensors.read_own(e, address, reading, reading)
    sensors.read_steering(e, address, body, reading)


class Inbox(NamedTuple):
    """What f followers have received from the leader; brought forward by `receive`."""

    message: Records  # last message of each, of MESSAGE, shape (f,)
    ranges: Floats  # to rear, front and middle transmitter, shape (f, 3), [m]; NaN where nothing was received
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

    `tilt` is what accelerations add to measured pitch and roll, shape (2,), [rad]; NaN if these are not broadcast.
    `fluctuation` are their Gauss–Markov errors, of unit variance, shape (2,), brought forward; `out` is of MESSAGE.
    """
    e, sent = s.errors[0], Address(s.seed, s.run, 0, k)
    (kept, fresh), drawn = sensors.weights(since, s.dt, e.leader_tilt_time), normals_at(sent, _ATTITUDE)
    fluctuation[0] = sensors.advanced(fluctuation[0], kept, fresh, drawn[0])
    fluctuation[1] = sensors.advanced(fluctuation[1], kept, fresh, drawn[1])
    sensors.true_message(e, k * s.dt, body_of(state), tilt, out)
    sensors.read_message(e, sent, out, normals_at(Address(s.seed, s.run, 0, 0), _ATTITUDE), fluctuation, out)


@compiled
def _measure_ranges(s: SensorModel, k: int, sent: int, follower: int, arrivals: Records, inbox: Inbox) -> int:
    """Measure the ranges of a message that is in, sent at filter step `sent`: NO_RANGES or RECEIVED."""
    ranges, e, true = inbox.ranges[follower], s.errors[follower], np.empty((3, 3))
    at, now = Address(s.seed, s.run, follower, sent), Address(s.seed, s.run, follower, k)
    for i in range(3):
        for path in range(3):
            true[i, path] = acoustics.received_range(arrivals[i, path], k, s.dt)
    ranges[0], ranges[1], ranges[2] = sensors.read_ranges(e, s.sound.transmitters, at, now, true)
    if sensors.loses(e):
        fate = uniforms_at(at, _LOSS)
        in_burst = sensors.is_bad(inbox.bad[follower] > 0.0, fate[0], e)
        inbox.bad[follower] = 1.0 if in_burst else 0.0
        if sensors.is_lost(in_burst, fate[1], e):
            ranges[:] = np.nan
    return RECEIVED if ranges[0] == ranges[0] or ranges[1] == ranges[1] or ranges[2] == ranges[2] else NO_RANGES


@compiled
def is_under_way(k: int, follower: int, message_every: int, inbox: Inbox) -> bool:
    """Whether a message may come in at filter step k: one is sent that the follower still waits for."""
    return bool((inbox.over[follower] + 1) * message_every <= k)


@compiled
def receive(
    s: SensorModel,
    k: int,
    follower: int,
    sites: tuple[Floats, Floats],
    known: acoustics.Motion,
    tilts: Floats,
    inbox: Inbox,
) -> None:
    """Take up the message that is in at filter step k, if there is one.

    `sites` are offsets of the transmitters, shape (3, 3), and of the followers' hydrophones, shape (f, 3), [m], `tilts`
    what accelerations add to the leader's measured pitch and roll at each instant, shape (n, 2), [rad]; the inbox is
    brought forward.
    """
    inbox.outcome[follower] = NO_MESSAGE
    truth, arrivals, to_follower = known.truth, np.empty((3, 3), acoustics.ARRIVAL), (sites[0], sites[1][follower])
    while is_under_way(k, follower, s.message_every, inbox):
        sent = (inbox.over[follower] + 1) * s.message_every
        complete = acoustics.follow(s.sound, known, to_follower, follower + 1, sent * s.dt, arrivals)
        if acoustics.reception_step(complete, s.dt) > k:
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


SIGHTING = np.dtype(  # what a look shows of one vehicle
    [
        ("range", np.float64),  # [m]; NaN: nothing was sensed
        ("bearing", np.float64),  # to starboard of the own heading [rad]
    ]
)

_U = np.uint64
_NEARBY = int(Stream.NEARBY)


def look_interval(scenario: Scenario) -> int:
    """Ticks from one look of the followers to the next; 0: they have no sensor."""
    proximity = scenario.formation.proximity
    return round(proximity.period_s / CONTROL_STEP_S) if proximity else 0


@compiled
def look(address: tuple[np.uint64, np.uint64], p: Record, k: int, follower: int, poses: Floats, seen: Records) -> None:
    """Look around at tick k, from 1, by seed and run of the noise and the record of `[formation.proximity]`.

    `poses` are of all vehicles, shape (v, 7); `seen`, out, is what is sensed of each, of SIGHTING, shape (v,).
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


SITES = ("tx_rear", "tx_front", "tx_middle", "depth_sensor", "hydrophone")  # that sensing needs


@dataclass(frozen=True, kw_only=True)
class MissionTruth:
    """What one follower's sensors see of a mission, without errors: n filter steps (k = 1 … n) and m messages."""

    dt: float  # filter step Δt [s]
    start: Floats  # state of the hydrophone at step 0: x, y [m] and velocity through the water [m/s], shape (4,)
    speed: Floats  # speed of the follower through the water, along its hull, shape (n,), [m/s]
    heading: Floats  # heading of the follower, shape (n,), [rad]
    depth: Floats  # depth of the follower's depth sensor, shape (n,), [m]
    hydrophone: Floats  # horizontal position that is estimated, shape (n, 2), [m]
    leader_position: Floats  # horizontal position of the leader's body origin, shape (n, 2), [m]
    leader_heading: Floats  # heading of the leader, shape (n,), [rad]
    message_step: Ints  # step k at which a message is available, shape (m,), increasing
    emission_step: Ints  # step at which the leader sent it, the address of its noise, shape (m,)
    sent: Records  # true content, of `laisn.swarm.MESSAGE`, shape (m,); pitch and roll are NaN if not broadcast
    slant_range: Floats  # to rear, front, middle transmitter, shape (m, 3), [m]; NaN where nothing is received
    echo_range: Floats | None = None  # by surface and bottom, shape (2, m, 3), [m]; None: no echoes
    own: tuple[tuple[sensors.OwnSensor, Floats], ...] = ()  # further sensors, and their true readings (n, …)

    def __post_init__(self) -> None:
        own_arrays(self)


def start_of(trajectory: Trajectory, follower: int = 0) -> Floats:
    """Initial position of a follower's hydrophone [m], and its velocity through the water [m/s], shape (4,)."""
    v, name = follower + 1, trajectory.names[follower + 1]
    hydrophone = trajectory.site_path(f"{name}/hydrophone", np.zeros(1, dtype=np.int64))[0]
    return np.concatenate([hydrophone[:2], trajectory.velocity[0, v, :2] - trajectory.water_velocity[0, v, :2]])


def observe(trajectory: Trajectory, scenario: Scenario, follower: int = 0) -> MissionTruth:
    """What the sensors of one follower see of a trajectory of a mission from its start, without errors.

    ValueError if the trajectory begins later, or is too short for one filter step.
    """
    dt, v, name = scenario.timing.filter_step_s, follower + 1, trajectory.names[follower + 1]
    stride = round(dt / CONTROL_STEP_S)
    n = (trajectory.time.size - 1) // stride
    if n < 1:
        raise ValueError(f"the trajectory ends at {trajectory.time[-1]:g} s, before the first filter step of {dt:g} s")
    if trajectory.time[0] != 0.0:
        raise ValueError(f"the trajectory begins at {trajectory.time[0]:g} s; what is sensed depends on all before")
    steps, grid = np.arange(1, n + 1), slice(stride, n * stride + 1, stride)
    errors, sound = sensors.errors_of(scenario, follower), acoustics.propagate(trajectory, scenario, follower)
    own, sent = records(READING, n), records(MESSAGE, sound.emission_step.size)
    depth_sensor = trajectory.site_offset[trajectory.site(f"{name}/depth_sensor")]
    sensors.true_own(errors, follower, steps * dt, trajectory.body(v, grid), depth_sensor, own)
    emitted, tilt = sound.emission_step * stride, np.full((2, sound.emission_step.size), np.nan)
    if scenario.leader.broadcast_attitude:
        tilt = sensors.tilt_errors(trajectory, scenario.sensors)[emitted].T
    sensors.true_message(errors, sound.emission_step * dt, trajectory.body(0, emitted), tilt, sent)
    hydrophone = trajectory.site_path(f"{name}/hydrophone", steps * stride)
    ranges = acoustics.received_range(sound.arrival, sound.message_step[:, None, None], dt)

    @cache
    def state() -> sensors.FollowerState:
        source = np.full((n, 3, 3), np.nan)
        source[sound.message_step - 1] = np.where(
            np.isnan(ranges[:, :, [acoustics.Path.DIRECT]]), np.nan, sound.transmitter
        )
        motion = trajectory.pose[grid, v], trajectory.twist[grid, v], trajectory.water_velocity[grid, v]
        return sensors.follower_state(trajectory.time[grid], motion, hydrophone, source)

    return MissionTruth(
        dt=dt,
        start=start_of(trajectory, follower),
        speed=own.speed,
        heading=own.heading,
        depth=own.depth,
        hydrophone=hydrophone[:, :2],
        leader_position=trajectory.position[grid, 0, :2],
        leader_heading=trajectory.heading[grid, 0],
        message_step=sound.message_step,
        emission_step=sound.emission_step,
        sent=sent,
        slant_range=ranges[:, :, acoustics.Path.DIRECT],
        echo_range=np.moveaxis(ranges[:, :, acoustics.Path.SURFACE :], 2, 0),
        own=tuple((sensor, sensor.true(state())) for sensor in sensors.own_sensors(scenario)),
    )


def fluctuation_weights(truth: MissionTruth, errors: sensors.SensorErrors) -> Floats:
    """`weights` of the errors of the leader's pitch and roll in each message, shape (m, 2)."""
    since, which = np.unique(np.diff(truth.emission_step, prepend=truth.emission_step[:1]), return_inverse=True)
    found = [sensors.weights(steps, truth.dt, errors.leader_tilt_time) for steps in since.tolist()]
    return np.array(found).reshape(-1, 2)[which]


def received(seed: int, run: int, follower: int, emission_step: Ints, e: sensors.SensorErrors) -> Bools:
    """Whether each message arrives, by the steps at which all until then were sent, (m,); the channel begins good."""
    drawn, bad = uniforms(seed, run, Stream.LOSS.number(follower), emission_step)[:, :2].tolist(), False
    fates = [(bad := sensors.is_bad(bad, change, e), fate) for change, fate in drawn]
    return np.array([not sensors.is_lost(was_bad, fate, e) for was_bad, fate in fates], dtype=np.bool_)


def measure(
    truth: MissionTruth, errors: sensors.SensorErrors, *, seed: int, run: int, follower: int = 0, transmitters: int = 3
) -> Measurements:
    """Everything that one follower measures in a run: exactly the noise of that run in a campaign.

    `transmitters` is N_T, how many of the leader's it uses, rear and front first. LaisnError if seed or run is too
    large.
    """
    every = Address(seed, run, follower, np.arange(1, truth.speed.size + 1))
    sent, taken_up = every._replace(step=truth.emission_step), every._replace(step=truth.message_step)
    own, message = records(READING, every.step.size), truth.sent.copy()
    sensors.read_own(errors, every, truth, own)
    # step 0, at which nothing is measured, addresses errors that a run keeps
    offset = normals_at(every._replace(step=0), Stream.LEADER_ATTITUDE)
    drawn = normals_at(sent, Stream.LEADER_ATTITUDE)
    fluctuation, last = np.empty_like(drawn), np.zeros(2)
    for i, (kept, fresh) in enumerate(fluctuation_weights(truth, errors).tolist()):
        last = fluctuation[:, i] = sensors.advanced(last, kept, fresh, drawn[:, i])
    sensors.read_message(errors, sent, truth.sent, offset, fluctuation, message)
    by_echo = np.full((2, *truth.slant_range.shape), np.nan) if truth.echo_range is None else truth.echo_range
    true = np.transpose([truth.slant_range, *by_echo], (2, 0, 1))
    ranges = np.column_stack(sensors.read_ranges(errors, transmitters, sent, taken_up, true))
    if sensors.loses(errors):
        ranges[~received(seed, run, follower, truth.emission_step, errors)] = np.nan
    lost = truth.message_step[np.isnan(ranges).all(axis=1)] - 1
    extra = {}
    for sensor, values in truth.own:
        found = sensor.read(values, normals(seed, run, STREAMS * follower + sensor.stream, every.step))
        if sensor.acoustic:
            found[lost] = np.nan
        extra[sensor.name] = found
    return Measurements(
        dt=truth.dt,
        speed=own.speed,
        heading=own.heading,
        depth=own.depth,
        message_step=truth.message_step,
        message=np.asarray(message).view((np.float64, len(LeaderMessage._fields))),
        ranges=ranges,
        own=extra,
    )

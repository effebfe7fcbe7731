"""The sensing driver: what followers read and receive, one instant after the other.

Closed loops call it under way, compiled (`read_instruments`, `receive`). A finished mission is
sensed first without random errors (`observe`), then with the noise of a run (`measure`), by the
same functions, in Python or compiled.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the
follower's vehicle is the one after.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
from numba import literal_unroll

from laisn.arrays import Bools, Floats, Ints, Record, Records, freeze_arrays, numbers_of, records
from laisn.compiled import compiled, copy_values, jitable
from laisn.held import borrowed_values
from laisn.messages import LeaderMessage, LinkMessages, Measurements, SensorHeader
from laisn.spilled import spillable_zeros
from laisn.swarm import MESSAGE
from sim.attitude import body_point_in_world, heading_angles
from sim.scenario.links import LEADER_LINK
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing import acoustics, noise, sensors
from sim.sensing.links import (
    Link,
    broadcast_offsets,
    named_link,
    navigated_link,
    navigated_motion,
    noise_base,
)
from sim.sensing.noise import Address
from sim.sensing.sensor import SensorDriver, VehicleState
from sim.trajectory import StateHistory, Trajectory, row
from sim.water.rays import Path

# compiled code holds numbers, not the members of an enum
_ATTITUDE = int(noise.Stream.LEADER_ATTITUDE)
_POSITION = int(noise.Stream.LEADER_POSITION)
_POSITION_WALK = int(noise.Stream.LEADER_POSITION_WALK)
_LOSS = int(noise.Stream.LOSS)
_RANGE_UNIFORM = int(noise.Stream.RANGE_UNIFORM)
_RANGE_SCALE = int(noise.Stream.RANGE_SCALE)
_INSTRUMENT_STREAMS = tuple(sorted({sensor.stream for sensor in sensors.INSTRUMENTS}))
_BROADCAST = (*sensors.LEADER, *sensors.LEADER_ATTITUDE)
_COLUMNS = (
    LeaderMessage._fields.index(name)
    for name in ("timestamp", "east", "north", "heading_sigma", "position_sigma")
)
_TIME, _EAST, _NORTH, _HEADING_SIGMA, _POSITION_SIGMA = _COLUMNS
_CONTENT = len(LeaderMessage._fields)

# outcome of a filter step; NO_RANGES: a message without a ping is in
NO_MESSAGE, NO_RANGES, RECEIVED = range(3)

# pose, twist and water velocity of a vehicle, shapes (7,), (6,) and (3,)
State = tuple[Floats, Floats, Floats]


class SensorModel(NamedTuple):
    """Sensors and acoustics of a mission as compiled code takes them."""

    seed: np.uint64
    run: np.uint64
    errors: Records  # of each receiver, of ERRORS, shape (f,)
    # of each receiver in the place of `noise.Address.follower`, shape (f,)
    noise_numbers: Ints
    senses_acceleration: bool  # the leader takes accelerations for tilt
    tilt_gain: float  # `sim.sensing.sensors.complementary_filter_gain` of the leader
    dt: float  # filter step [s]
    stride: int  # instants from one filter step to the next
    message_every: int  # filter steps from one message to the next
    message_offset: int  # filter steps by which all messages are later than multiples of that
    sound: acoustics.Sound
    transmitters: Ints  # how many pings of a message each receiver waits for, shape (f,)
    assumed_sound: Ints  # of each receiver, as of `acoustics.Listener`, shape (f,)


def _sound_of(sensing: SensingSettings, link: Link | None) -> acoustics.Sound:
    """Sound on a link; the clocks of all followers differ from the leader's alike, and so not among
    each other.
    """
    sound = acoustics.sound_of(sensing)
    if link is not None and link.sender > 0:
        return sound._replace(clock_offset=0.0, clock_drift=0.0)
    return sound


def sensor_model_of(
    sensing: SensingSettings,
    link: Link | None = None,
    *,
    leader_receives: bool = False,
    sensing_of: Sequence[SensingSettings] = (),
) -> SensorModel:
    """Sensors and acoustics as compiled code takes them, of the leader's broadcast or another
    link.

    Receivers are the followers, and with `leader_receives` the leader after them. `sensing_of` are
    the settings by the navigation of each follower; none: all navigate as `sensing` has it.
    """
    name = LEADER_LINK if link is None else link.name
    followers = range(len(sensing.of_vehicles) - 1)
    receivers = [sensing_of[i] if sensing_of else sensing for i in followers]
    noise_numbers = [i + noise_base(receivers[i].links, name) for i in followers]
    errors = [sensors.errors_of(sensing, i, link) for i in followers]
    if leader_receives:
        receivers.append(sensing)
        noise_numbers.append(noise.LEADER_NUMBER + noise_base(sensing.links, name))
        errors.append(errors[0])
    transmitters = [receiver.transmitters for receiver in receivers]
    if link is not None:
        transmitters = [min(number, link.transmitters) for number in transmitters]
    assumed_sound = [acoustics.ASSUMED_SOUND.index(receiver.sound_speed) for receiver in receivers]
    return SensorModel(
        seed=np.uint64(sensing.seed),
        run=np.uint64(sensing.run),
        errors=np.array([tuple(e) for e in errors], sensors.ERRORS).view(np.recarray),
        noise_numbers=np.array(noise_numbers, dtype=np.int64),
        senses_acceleration=sensing.broadcast_attitude
        and sensing.sensors.leader_attitude_senses_acceleration,
        tilt_gain=sensors.complementary_filter_gain(sensing.sensors),
        dt=sensing.links.filter_step_s,
        stride=round(sensing.links.filter_step_s / CONTROL_STEP_S),
        message_every=sensing.links.message_every if link is None else link.every,
        message_offset=0 if link is None else link.offset,
        sound=_sound_of(sensing, link),
        transmitters=np.array(transmitters, dtype=np.int64),
        assumed_sound=np.array(assumed_sound, dtype=np.int64),
    )


@jitable
def listener_of(s: SensorModel, receiver: int, hydrophone: Any) -> acoustics.Listener:
    """A receiver by its index, and the offset of its hydrophone, shape (3,), [m]."""
    return acoustics.Listener(
        receiver + 1, hydrophone, s.transmitters[receiver], s.assumed_sound[receiver]
    )


@jitable
def _write_channels(values: Sequence[float], column: int, row: Floats) -> None:
    """Write the channels of a sensor from a column on."""
    for i in range(len(values)):
        row[column + i] = values[i]


@jitable
def true_readings(e: sensors.SensorErrors, instant: sensors.Instant, true: Floats) -> None:
    """Write what a follower's own sensors would read without random errors and biases: speed,
    heading, depth, (3,).
    """
    for sensor in literal_unroll(sensors.OWN):
        _write_channels(sensor.true(e, instant, None), sensor.column, true)


@jitable
def read_own(e: sensors.SensorErrors, address: Address, true: Floats, reading: Floats) -> None:
    """Read the own sensors at an address of the noise, by values of `true_readings`; both of
    shape (3,).
    """
    for sensor in literal_unroll(sensors.OWN):
        draws = noise.normals_at(address, sensor.stream)
        _write_channels(sensor.read(e, true[sensor.column :], draws), sensor.column, reading)


class InstrumentNoise(NamedTuple):
    """Normals of the instruments of f followers, drawn for several filter steps at once."""

    # of each stream and follower, as of `noise.draw_ahead`
    normals: Floats
    first: Ints  # the first filter step that they are of, shape (1,); negative: of none


def new_instrument_noise(followers: int) -> InstrumentNoise:
    """Nothing drawn yet."""
    streams = max(_INSTRUMENT_STREAMS) + 1
    return InstrumentNoise(
        normals=np.zeros((streams, followers, 2 * noise.STEPS_AHEAD)),
        first=np.full(1, -noise.STEPS_AHEAD),
    )


@compiled
def _draw_instruments(s: SensorModel, k: int, drawn: InstrumentNoise) -> None:
    """Draw for the instruments of all followers from filter step k on."""
    drawn.first[0] = k
    for stream in _INSTRUMENT_STREAMS:
        for follower in range(drawn.normals.shape[1]):
            address = Address(s.seed, s.run, follower, k)
            noise.draw_ahead(address, stream, drawn.normals[stream, follower])


@compiled
def read_instruments(
    s: SensorModel,
    k: int,
    follower: int,
    state: State,
    depth_sensor: Floats,
    drawn: InstrumentNoise,
    reading: Floats,
) -> None:
    """Read all of a follower's own sensors at filter step k, in the order of
    `laisn.swarm.READING`, with noise that is drawn ahead where that of step k is not yet.
    """
    if not 0 <= k - drawn.first[0] < noise.STEPS_AHEAD:
        _draw_instruments(s, k, drawn)
    i = k - drawn.first[0]
    e = s.errors[follower]
    instant = sensors.instant_of_instruments((k * s.dt, follower), state, depth_sensor)
    for sensor in literal_unroll(sensors.INSTRUMENTS):
        normals = drawn.normals[sensor.stream, follower]
        draws = (normals[i], normals[noise.STEPS_AHEAD + i])
        _write_channels(
            sensor.read(e, sensor.true(e, instant, None), draws), sensor.column, reading
        )


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


class MeasurementRecord(NamedTuple):
    """What f followers read and receive, with room for n filter steps and q messages of each."""

    own: Floats  # speed [m/s], heading [rad] and depth [m] at each step, shape (f, n, 3)
    message_step: Ints  # filter step at which each message is in, shape (f, q)
    message: Floats  # rows of `LeaderMessage`, shape (f, q, 10)
    ranges: Floats  # rows of `laisn.messages.Ranges`, shape (f, q, 3), [m]
    messages: Ints  # how many are in so far, shape (f,)

    @classmethod
    def empty(cls, followers: int, steps: int, message_every: int) -> Self:
        """Room for a mission of so many filter steps, with a message every so many of them."""
        q = steps // message_every + 1
        return cls(
            own=spillable_zeros((followers, steps, 3)),
            message_step=spillable_zeros((followers, q), np.int64),
            message=spillable_zeros((followers, q, len(LeaderMessage._fields))),
            ranges=spillable_zeros((followers, q, 3)),
            messages=np.zeros(followers, dtype=np.int64),
        )

    def _within(self, follower: int, steps: int) -> slice:
        """Messages that are in by the first steps."""
        arrived = self.message_step[follower, : self.messages[follower]]
        return slice(0, int(np.searchsorted(arrived, steps, side="right")))

    def messages_of(self, follower: int, steps: int, offsets: Floats) -> LinkMessages:
        """The messages of the first steps, as of a further link with transmitters at `offsets`."""
        messages = self._within(follower, steps)
        return LinkMessages(
            message_step=self.message_step[follower, messages],
            message=self.message[follower, messages],
            ranges=self.ranges[follower, messages],
            offsets=offsets,
        )

    def measurements(
        self,
        follower: int,
        steps: range,
        dt: float,
        custom: Mapping[str, Floats],
        headers: Mapping[str, SensorHeader],
        places: Floats | None = None,
        links: Mapping[str, LinkMessages] = MappingProxyType({}),
    ) -> Measurements:
        """All that a follower measured in filter steps `steps.start` + 1 … `steps.stop` of dt [s],
        with readings of further sensors and their headers, the places of beacons, shape (3, 3),
        [m], and messages of further links.
        """
        arrived = self.message_step[follower, : self.messages[follower]]
        messages = slice(
            *np.searchsorted(arrived, [steps.start, steps.stop], side="right").tolist()
        )
        rows = slice(steps.start, steps.stop)
        count = messages.stop - messages.start
        return Measurements(
            dt=dt,
            speed=self.own[follower, rows, 0],
            heading=self.own[follower, rows, 1],
            depth=self.own[follower, rows, 2],
            message_step=self.message_step[follower, messages] - steps.start,
            message=self.message[follower, messages],
            ranges=self.ranges[follower, messages],
            transmitters=None if places is None else np.tile(places, (count, 1, 1)),
            custom=custom,
            sensors=headers,
            links=dict(links),
        )


@compiled
def record_step(
    record: MeasurementRecord, inbox: Inbox, step: int, follower: int, reading: Floats
) -> None:
    """Record what a follower reads at a filter step, and the message that is in, if there is
    one.
    """
    for i in range(3):
        record.own[follower, step - 1, i] = reading[i]
    if inbox.outcome[follower] == NO_MESSAGE:
        return
    m = record.messages[follower]
    record.messages[follower] += 1
    record.message_step[follower, m] = step
    copy_values(inbox.message_values[follower], record.message[follower, m])
    copy_values(inbox.ranges[follower], record.ranges[follower, m])


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
        _write_channels(sensor.true(e, instant, None), sensor.column, content)
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
        _write_channels(sensor.read(e, true[sensor.column :], tilt_draws), sensor.column, content)
    inbox.last_sent[f] = sent.step
    for sensor in literal_unroll(sensors.LEADER):
        draws = noise.normals_at(sent, sensor.stream)
        _write_channels(sensor.read(e, true[sensor.column :], draws), sensor.column, content)


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

    `tilts` are what accelerations add to the leader's measured
    pitch and roll at each instant, shape (n, 2), [rad].
    """
    inbox.outcome[follower] = NO_MESSAGE
    sent, pings = poll_reception(s, k, follower, sites, motion, inbox)
    if sent > 0:
        e = s.errors[follower]
        content = np.empty(_CONTENT)
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


_ARRIVAL = np.dtype([(name, np.float64) for name in acoustics.Arrival._fields])


class Receptions(NamedTuple):
    """True content and sound of m messages; transmitters are rear, front and middle, paths in
    the order of `Path`.
    """

    emission_step: Ints  # filter step at which a message is sent, shape (m,)
    # filter step by which all pings that the follower may take are in, shape (m,)
    message_step: Ints
    content: Floats  # what it holds, of `true_reception`, shape (m, 10)
    ranges: Floats  # likewise, shape (m, 3 transmitters, 3 paths), [m]
    transmitter: Floats  # where each ping left, shape (m, 3, 3), the last axis in the world, [m]
    # how each ping arrives: numbers of `Arrival`, shape (m, 3 transmitters, 3 paths, 4)
    arrivals: Floats

    @property
    def arrival(self) -> Records:
        """How each ping arrives: records with the fields of `Arrival`, shape (m, 3 transmitters,
        3 paths).
        """
        return self.arrivals.view(_ARRIVAL)[..., 0].view(np.recarray)

    @property
    def range(self) -> Floats:
        """Slant range before random errors, shape (m, 3 transmitters, 3 paths), [m]; not cut off
        at any distance.
        """
        return np.asarray(self.arrival.length * self.arrival.ratio + self.arrival.clock_range)


def new_receptions(messages: int) -> Receptions:
    """Room for so many messages."""
    steps = spillable_zeros((2, messages), np.int64)
    shapes = ((_CONTENT,), (3, 3), (3, 3), (3, 3, 4))
    return Receptions(
        steps[0], steps[1], *[spillable_zeros((messages, *shape)) for shape in shapes]
    )


class Span(NamedTuple):
    """Filter steps of one follower that are sensed in one call."""

    follower: int  # its index
    first: int  # filter step at which the motion begins
    done: int  # the last one that was sensed before
    messages: int  # how many messages were taken up before


@jitable
def _true_steps(
    clock: tuple[float, int],
    e: sensors.SensorErrors,
    span: Span,
    last: int,
    depth_sensor: Any,
    truth: StateHistory,
    readings: Floats,
) -> None:
    """What a follower's own sensors see at each filter step until the last one; `clock` is the
    filter step [s] and its number of instants, and the others are as of `sense_steps`.
    """
    dt, stride = clock
    v = span.follower + 1
    for k in range(span.done + 1, last + 1):
        i = (k - span.first) * stride
        motion = (row(truth.pose, i, v), row(truth.twist, i, v), row(truth.water, i, v))
        instant = sensors.instant_of((k * dt, span.follower), motion, depth_sensor, (0.0, 0.0))
        true_readings(e, instant, readings[k - span.first - 1])


@jitable
def sense_steps(  # noqa: PLR0913 - compiled: a record of them would be packed for each mission
    s: SensorModel,
    e: sensors.SensorErrors,
    span: Span,
    sites: acoustics.Sites,
    depth_sensor: Any,
    motion_of_vehicles: acoustics.Motion,
    tilts: Floats,
    inbox: Inbox,
    readings: Floats,
    receptions: Receptions,
) -> int:
    """Sense a motion as far as it is known, without random errors: own sensors at each step, and
    messages; gives how many messages are in now.

    `depth_sensor` is the place of the follower's pressure sensor, shape (3,), [m]. `readings`, out,
    has shape (n, 3), or is empty where it is not asked for.
    """
    follower = span.follower
    first = span.first
    last = first + motion_of_vehicles.last // s.stride
    truth = motion_of_vehicles.truth
    if readings.shape[0] > 0:
        _true_steps((s.dt, s.stride), e, span, last, depth_sensor, truth, readings)
    m = span.messages
    for k in range(span.done + 1, last + 1):
        # a call at each step would hand over all that sound depends on
        if inbox.earliest_step[follower] > k:
            continue
        sent, pings = poll_reception(s, k, follower, sites, motion_of_vehicles, inbox)
        if sent == 0:
            continue
        receptions.emission_step[m] = sent
        receptions.message_step[m] = k
        leader = sender_at(s, sent, (sent - first) * s.stride, truth, tilts)
        true_reception(s, e, leader, k, pings, receptions.content[m], receptions.ranges[m])
        for j in range(3):
            source, arrivals = pings[j]
            for i in range(3):
                receptions.transmitter[m, j, i] = source[i]
                for number in range(4):
                    receptions.arrivals[m, j, i, number] = arrivals[i][number]
        m += 1
    return m


@compiled
def sense_steps_compiled(  # noqa: PLR0913 - as `sense_steps`
    s: SensorModel,
    e: sensors.SensorErrors,
    span: Span,
    sites: acoustics.Sites,
    depth_sensor: Floats,
    motion_of_vehicles: acoustics.Motion,
    tilts: Floats,
    inbox: Inbox,
    readings: Floats,
    receptions: Receptions,
) -> int:
    """`sense_steps`, compiled; to count references to all arrays would take a third of its time."""
    return sense_steps(
        borrowed_values(s),
        e,
        span,
        borrowed_values(sites),
        borrowed_values(depth_sensor),
        borrowed_values(motion_of_vehicles),
        borrowed_values(tilts),
        borrowed_values(inbox),
        borrowed_values(readings),
        borrowed_values(receptions),
    )


# missions of more instants are sensed by compiled code, unless a caller chooses
LONG_MISSION_INSTANTS = 100_000


def _sense(
    trajectory: Trajectory,
    sensing: SensingSettings,
    follower: int,
    tilts: Floats,
    readings: Floats,
    use_compiled: bool | None,
    link: Link | None,
) -> Receptions:
    """Sense a motion with the sender of a link in the leader's place, None: with the leader's
    broadcast.

    `tilts` and `readings`, out, are as of `sense_steps`, `use_compiled` as of `observe`.
    """
    s = sensor_model_of(sensing, link)
    motion = acoustics.motion_of(trajectory)
    first = round(float(trajectory.time[0]) / s.dt)
    sent_before = max(first - s.message_offset, 0) // s.message_every
    last = first + motion.last // s.stride
    receptions = new_receptions(max(last // s.message_every - sent_before, 0))
    hydrophones = [f"{name}/hydrophone" for name in trajectory.names[1:]]
    names = *acoustics.TRANSMITTERS, *hydrophones, f"{trajectory.names[follower + 1]}/depth_sensor"
    offset = trajectory.site_offset[[trajectory.site(name) for name in names]]
    inbox = new_inbox(follower + 1, s.message_every, sent_before)
    span = Span(follower, first, first, 0)
    if use_compiled or (use_compiled is None and trajectory.time.size > LONG_MISSION_INSTANTS):
        sites = acoustics.Sites(offset[:3], offset[3:-1])
        e = s.errors[follower]
        m = sense_steps_compiled(
            s, e, span, sites, offset[-1], motion, tilts, inbox, readings, receptions
        )
    else:
        *places, depth_sensor = offset.tolist()
        sites = acoustics.Sites(places[:3], places[3:])
        e = sensors.errors_of(sensing, follower, link)
        m = sense_steps(s, e, span, sites, depth_sensor, motion, tilts, inbox, readings, receptions)
    if link is not None and not link.hears(follower):
        m = 0
    if link is not None:
        receptions.content[:, link.hidden] = np.nan
    return Receptions(*[values[:m] for values in receptions])  # type: ignore[arg-type]


def propagate(
    trajectory: Trajectory,
    sensing: SensingSettings,
    follower: int = 0,
    *,
    use_compiled: bool | None = None,
) -> Receptions:
    """Follow the sound of all messages sent in a trajectory to one follower, on the link that it
    navigates on, as far as they are in by its end.

    Their content lacks pitch and roll. `use_compiled` is as of `observe`.
    """
    unknown = np.full((trajectory.time.size, 2), np.nan)
    motion = navigated_motion(trajectory, sensing.links)
    link = navigated_link(sensing.links)
    return _sense(motion, sensing, follower, unknown, np.empty((0, 3)), use_compiled, link)


@dataclass(frozen=True, kw_only=True)
class IdealLink:
    """What one follower receives of a further link without random errors: m messages, as of
    `IdealMeasurements`.
    """

    name: str
    noise_base: int  # as of `sim.sensing.links.noise_base`
    message_step: Ints
    emission_step: Ints
    content: Floats  # rows of `LeaderMessage`, shape (m, 10)
    ranges: Floats  # shape (m, 3 transmitters, 3 paths), [m]
    transmitters: int  # how many the sender has
    places: Floats | None
    offsets: Floats | None  # as of `laisn.messages.Reception`

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True, kw_only=True)
class IdealMeasurements:
    """What one follower's sensors see of a mission, without errors: n filter steps (k = 1 … n)
    and m messages.
    """

    dt: float  # filter step Δt [s]
    # state of the hydrophone at step 0: x, y [m] and velocity through the water [m/s], shape (4,)
    start: Floats
    speed: Floats  # speed of the follower through the water, along its hull, shape (n,), [m/s]
    heading: Floats  # heading of the follower, shape (n,), [rad]
    depth: Floats  # depth of the follower's depth sensor, shape (n,), [m]
    hydrophone: Floats  # horizontal position that is estimated, shape (n, 2), [m]
    leader_position: Floats  # horizontal position of the leader's body origin, shape (n, 2), [m]
    leader_heading: Floats  # heading of the leader, shape (n,), [rad]
    message_step: Ints  # step k at which a message is available, shape (m,), increasing
    emission_step: Ints  # step at which the leader sent it, the address of its noise, shape (m,)
    # true content, of `laisn.swarm.MESSAGE`, shape (m,); pitch and roll are NaN if not broadcast
    sent: Records
    # to rear, front, middle transmitter, shape (m, 3), [m]; NaN where nothing is received
    slant_range: Floats
    echo_range: Floats | None = None  # by surface and bottom, shape (2, m, 3), [m]; None: no echoes
    # further sensors, and their true readings (n, …)
    custom: tuple[tuple[SensorDriver, Floats], ...] = ()
    transmitters: int = 3  # how many the sender has
    places: Floats | None = None
    """East, north and depth of beacons, shape (3, 3), [m], NaN for none; None of a vehicle."""
    further: tuple[IdealLink, ...] = ()  # links that are received beside

    def __post_init__(self) -> None:
        freeze_arrays(self)


def start_of(trajectory: Trajectory, follower: int = 0) -> Floats:
    """Initial position of a follower's hydrophone [m], and its velocity through the water [m/s],
    shape (4,).
    """
    v = follower + 1
    name = trajectory.names[follower + 1]
    hydrophone = trajectory.site_path(f"{name}/hydrophone", np.zeros(1, dtype=np.int64))[0]
    return np.concatenate(
        [hydrophone[:2], trajectory.velocity[0, v, :2] - trajectory.water_velocity[0, v, :2]]
    )


def leader_start(trajectory: Trajectory, hydrophone: Floats) -> Floats:
    """The same of the leader, whose hydrophone is at an offset from its origin, shape (3,), [m]."""
    position = np.array(body_point_in_world(trajectory.pose[0, 0], hydrophone))
    water = trajectory.water_velocity[0, 0, :2]
    return np.concatenate([position[:2], trajectory.velocity[0, 0, :2] - water])


def observe(
    trajectory: Trajectory,
    sensing: SensingSettings,
    follower: int = 0,
    *,
    use_compiled: bool | None = None,
) -> IdealMeasurements:
    """What the sensors of one follower see of a trajectory of a mission from its start, without
    errors.

    `use_compiled` chooses compiled code, which takes seconds to compile once and then milliseconds
    for what Python takes half a second; None: for long missions. ValueError if the trajectory
    begins later, or is too short for one filter step.
    """
    dt = sensing.links.filter_step_s
    v = follower + 1
    name = trajectory.names[follower + 1]
    stride = round(dt / CONTROL_STEP_S)
    n = (trajectory.time.size - 1) // stride
    if n < 1:
        raise ValueError(
            f"the trajectory ends at {trajectory.time[-1]:g} s, before the first filter step of "
            f"{dt:g} s"
        )
    if trajectory.time[0] != 0.0:
        raise ValueError(
            f"the trajectory begins at {trajectory.time[0]:g} s; what is sensed depends on all "
            "before"
        )
    grid = slice(stride, n * stride + 1, stride)
    true_values = np.empty((n, 3))
    link = navigated_link(sensing.links)
    motion = trajectory if link is None else link.motion_of(trajectory)
    tilts = _tilts_of(motion, sensing)
    sound = _sense(motion, sensing, follower, tilts, true_values, use_compiled, link)
    hydrophone = trajectory.site_path(f"{name}/hydrophone")[grid]

    def custom() -> Iterator[tuple[SensorDriver, Floats]]:
        """Further sensors and their true readings."""
        drivers = sensors.custom_sensors(sensing, follower)
        if not drivers:
            return
        source = np.full((n, 3, 3), np.nan)
        direct = sound.ranges[:, :, [Path.DIRECT]]
        source[sound.message_step - 1] = np.where(np.isnan(direct), np.nan, sound.transmitter)
        motion_on_grid = (
            trajectory.pose[grid, v],
            trajectory.twist[grid, v],
            trajectory.water_velocity[grid, v],
        )
        depth_sensor = trajectory.site_offset[trajectory.site(f"{name}/depth_sensor")]
        states = VehicleState.of_motion(
            trajectory.time[grid], motion_on_grid, depth_sensor, (hydrophone, source), follower
        )
        environment = sensors.environment_of(sensing)
        for driver in drivers:
            yield driver, driver.true(states, environment, 1)

    return IdealMeasurements(
        dt=dt,
        start=start_of(trajectory, follower),
        speed=true_values[:, 0],
        heading=true_values[:, 1],
        depth=true_values[:, 2],
        hydrophone=hydrophone[:, :2],
        leader_position=trajectory.position[grid, 0, :2],
        leader_heading=heading_angles(trajectory.quaternion[grid, 0]),
        message_step=sound.message_step,
        emission_step=sound.emission_step,
        sent=sound.content.view(MESSAGE).reshape(-1).view(np.recarray),
        slant_range=sound.ranges[:, :, Path.DIRECT],
        echo_range=np.moveaxis(sound.ranges[:, :, Path.SURFACE :], 2, 0),
        custom=tuple(custom()),
        transmitters=3 if link is None else link.transmitters,
        places=None if link is None else link.places,
        further=tuple(
            _observe_link(trajectory, sensing, follower, name, use_compiled)
            for name in sensing.links.further
        ),
    )


def _tilts_of(motion: Trajectory, sensing: SensingSettings) -> Floats:
    """What accelerations add to the sender's measured pitch and roll, shape (n, 2), [rad]; NaN
    where they are not broadcast.
    """
    if sensing.broadcast_attitude:
        return sensors.tilt_errors(motion, sensing.sensors)
    return np.full((motion.time.size, 2), np.nan)


def _observe_link(
    trajectory: Trajectory,
    sensing: SensingSettings,
    follower: int,
    name: str,
    use_compiled: bool | None,
) -> IdealLink:
    """What a follower receives of a further link without random errors."""
    link = named_link(sensing.links, name)
    motion = trajectory if link is None else link.motion_of(trajectory)
    tilts = _tilts_of(motion, sensing)
    sound = _sense(motion, sensing, follower, tilts, np.empty((0, 3)), use_compiled, link)
    return IdealLink(
        name=name,
        noise_base=noise_base(sensing.links, name),
        message_step=sound.message_step,
        emission_step=sound.emission_step,
        content=sound.content,
        ranges=sound.ranges,
        transmitters=3 if link is None else link.transmitters,
        places=None if link is None else link.places,
        offsets=broadcast_offsets(trajectory.sites) if link is None else link.offsets,
    )


def _measure_link(
    link: IdealLink,
    e: sensors.SensorErrors,
    address: Address,
    transmitters_and_dt: tuple[int, float],
) -> LinkMessages:
    """Receive a further link with the noise of a run.

    `address` is of the follower, `transmitters_and_dt` how many transmitters its navigator uses,
    and its filter step [s].
    """
    transmitters, dt = transmitters_and_dt
    m = link.message_step.size
    message = np.empty((m, _CONTENT))
    ranges = np.empty((m, 3))
    inbox = new_inbox(1, 1)
    used = (min(transmitters, link.transmitters), dt)
    sent = address._replace(follower=link.noise_base + address.follower)
    for i in range(m):
        addresses = (
            sent._replace(step=int(link.emission_step[i])),
            sent._replace(step=int(link.message_step[i])),
        )
        true = (link.content[i].tolist(), link.ranges[i].tolist())
        read_reception(e, used, addresses, true, inbox, 0)
        message[i] = inbox.message_values[0]
        ranges[i] = inbox.ranges[0]
    ranges[:, link.transmitters :] = np.nan
    return LinkMessages(
        message_step=link.message_step,
        message=message,
        ranges=ranges,
        places=link.places,
        offsets=link.offsets,
    )


@jitable
def read_steps(
    e: sensors.SensorErrors,
    transmitters_and_dt: tuple[int, float],
    address: Address,
    span: Span,
    true_values: Floats,
    sent: tuple[Ints, Ints, Floats, Floats],
    inbox: Inbox,
    readings: tuple[Floats, Floats, Floats],
) -> None:
    """Read the steps of a span, and all after it, of what `sense_steps` gave with the noise of a
    run.

    `transmitters_and_dt` is as of `read_reception`, `address` that of the follower at any step.
    `true_values` are those of own sensors, shape (n, 3), `sent` the steps at which messages are
    taken up and were sent, their content and ranges, (m, 10) and (m, 3, 3); `readings`, out, own
    ones, content and ranges, (m, 3).
    """
    taken_up, emitted, content, ranges = sent
    own_read, content_read, ranges_read = readings
    i = span.messages
    for k in range(span.done + 1, true_values.shape[0] + 1):
        step_address = Address(address.seed, address.run, address.follower, k)
        read_own(e, step_address, true_values[k - 1], own_read[k - 1])
        if i < taken_up.size and taken_up[i] == k:
            addresses = (
                Address(address.seed, address.run, address.follower, emitted[i]),
                step_address,
            )
            true = (content[i], ranges[i])
            read_reception(e, transmitters_and_dt, addresses, true, inbox, 0)
            for j in range(_CONTENT):
                content_read[i, j] = inbox.message_values[0, j]
            for j in range(3):
                ranges_read[i, j] = inbox.ranges[0, j]
            i += 1


read_steps_compiled = compiled(read_steps)


def measure(
    truth: IdealMeasurements,
    errors: sensors.SensorErrors,
    *,
    seed: int,
    run: int,
    follower: int = 0,
    transmitters: int = 3,
    use_compiled: bool | None = None,
    further: Mapping[str, sensors.SensorErrors] | None = None,
) -> Measurements:
    """Everything that one follower measures in a run: exactly the noise of that run in a campaign.

    `transmitters` is N_T, how many of the leader's it uses, rear and front first; `use_compiled` is
    as of `observe`; `further` are errors of further links by name. LaisnError if seed or run is too
    large.
    """
    n = truth.speed.size
    m = truth.message_step.size
    address = Address(*noise.seed_and_run(seed, run), follower, 0)
    transmitters_and_dt = (min(transmitters, truth.transmitters), truth.dt)
    by_echo = np.full((2, m, 3), np.nan) if truth.echo_range is None else truth.echo_range
    ranges = np.moveaxis(np.array([truth.slant_range, *by_echo]), 0, 2).copy()
    content = numbers_of(np.ascontiguousarray(truth.sent))
    true_values = np.column_stack([truth.speed, truth.heading, truth.depth])
    sent = (truth.message_step, truth.emission_step)
    readings = (np.empty((n, 3)), np.empty((m, _CONTENT)), np.empty((m, 3)))
    inbox = new_inbox(1, 1)
    span = Span(follower, 0, 0, 0)
    if use_compiled or (use_compiled is None and n > LONG_MISSION_INSTANTS):
        e = np.array([tuple(errors)], sensors.ERRORS).view(np.recarray)[0]
        read_steps_compiled(
            e,
            transmitters_and_dt,
            address,
            span,
            true_values,
            (*sent, content, ranges),
            inbox,
            readings,
        )
    else:
        numbers = content.tolist(), ranges.tolist()
        read_steps(
            errors,
            transmitters_and_dt,
            address,
            span,
            true_values,
            (*sent, *numbers),
            inbox,
            readings,
        )
    readings[2][:, truth.transmitters :] = np.nan
    # rows of the filter steps at which all pings of a message are lost
    lost_rows = truth.message_step[np.isnan(readings[2]).all(axis=1)] - 1
    custom = {}
    for driver, values in truth.custom:
        draws = driver.draws(seed, run, follower, np.arange(1, n + 1))
        custom_readings = driver.read(values, draws, 1)
        if driver.acoustic:
            custom_readings[lost_rows] = np.nan
        custom[driver.name] = custom_readings
    return Measurements(
        dt=truth.dt,
        speed=readings[0][:, 0],
        heading=readings[0][:, 1],
        depth=readings[0][:, 2],
        message_step=truth.message_step,
        message=readings[1],
        ranges=readings[2],
        transmitters=None if truth.places is None else np.tile(truth.places, (m, 1, 1)),
        custom=custom,
        sensors={driver.name: driver.header for driver, _ in truth.custom},
        links={
            link.name: _measure_link(
                link, (further or {}).get(link.name, errors), address, (transmitters, truth.dt)
            )
            for link in truth.further
        },
    )

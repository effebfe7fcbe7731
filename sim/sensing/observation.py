"""Sensing of finished missions: first without random errors (`observe`), then with the noise of a
run (`measure`), in Python or compiled.

The functions are those that closed loops call under way (`own_sensors`, `reception`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Records, freeze_arrays, numbers_of
from laisn.compiled import compiled, jitable
from laisn.held import borrowed_values
from laisn.messages import LinkMessages, Measurements
from laisn.spilled import spillable_zeros
from laisn.swarm import MESSAGE
from sim.attitude import body_point_in_world, heading_angles
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
from sim.sensing.own_sensors import read_own, true_readings
from sim.sensing.reception import (
    CONTENT_SIZE,
    Inbox,
    new_inbox,
    poll_reception,
    read_reception,
    sender_at,
    true_reception,
)
from sim.sensing.sensor import SensorDriver, VehicleState
from sim.sensing.sensor_model import SensorModel, sensor_model_of
from sim.trajectory import StateHistory, Trajectory, row
from sim.water.rays import Path

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
    shapes = ((CONTENT_SIZE,), (3, 3), (3, 3), (3, 3, 4))
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
    message = np.empty((m, CONTENT_SIZE))
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
            for j in range(CONTENT_SIZE):
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
    readings = (np.empty((n, 3)), np.empty((m, CONTENT_SIZE)), np.empty((m, 3)))
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

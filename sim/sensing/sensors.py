"""The sensors: what each would read without errors, and its readings; shipped ones and those of plugins.

A sensor is an entry of a list. One set of functions serves one instant and a finished mission: compiled code calls them
with numbers and records, under way (`sim.sensing.instant`); Python calls them with arrays over filter steps or
messages (`sim.sensing.observation`). Further sensors of a follower come from tables `[[sensors.own]]` of a scenario.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import elementwise, select
from laisn.failure import LaisnError
from laisn.messages import BEARING
from laisn.navigators import NAVIGATORS
from laisn.plugins import find_class
from sim.attitude import carried, rotate
from sim.scenario.section import in_si
from sim.scenario.sensors import OwnSensor as OwnSensorTable
from sim.scenario.settings import Scenario
from sim.sensing.errors import drift, heading_reading, path_taken, plain_reading, range_readings, speed_reading
from sim.sensing.noise import Address, Stream, normals_at, uniforms_at
from sim.trajectory import Body, speed_through_water

# compiled code needs numbers, not the members of an enum
_ECHO, _RANGE_UNIFORM, _RANGE_SCALE = int(Stream.ECHO), int(Stream.RANGE_UNIFORM), int(Stream.RANGE_SCALE)


class Carrier(NamedTuple):
    """A vehicle with sensors at an instant, or at many of them."""

    follower: int  # its index; of the leader 0
    time: Any  # [s]
    body: Body
    depth_sensor: Any  # offset of its pressure sensor, three numbers [m]


class Sensor(NamedTuple):
    """A sensor that reads one number at a time; its functions take numbers or arrays.

    Their first argument `e` is a record or tuple of `sim.sensing.errors`.
    """

    name: str  # of its readings
    true: Callable[[Any, Carrier], Any]  # what it reads without random errors and constant biases
    stream: Stream | None = None  # of its noise; None: it has no errors
    column: int = 0
    """Which of the two normals of a step is its own; sensors of one stream stand side by side in their order."""
    bias: str = ""  # field of `SensorErrors`; "": it has none
    sigma: str = ""  # field of `SensorErrors`; "": it has none
    read: Callable[..., Any] = plain_reading  # reading from the true value, bias, standard deviation and normal


@elementwise
def _log_speed(e: Any, on: Carrier) -> Any:
    return speed_through_water(on.body.pose, on.body.twist, on.body.water)


@elementwise
def _drifting_speed(e: Any, on: Carrier) -> Any:
    return _log_speed(e, on) + drift(e, e.speed_drift, e.speed_drift_phase, on.follower, on.time)


@elementwise
def _heading(e: Any, on: Carrier) -> Any:
    return on.body.heading


@elementwise
def _drifting_heading(e: Any, on: Carrier) -> Any:
    return on.body.heading + drift(e, e.heading_drift, e.heading_drift_phase, on.follower, on.time)


@elementwise
def _depth(e: Any, on: Carrier) -> Any:
    return -carried(on.body.pose, on.depth_sensor)[2]


OWN = (
    Sensor("speed", _drifting_speed, Stream.OWN_MOTION, 0, "speed_bias", "speed_sigma", speed_reading),
    Sensor("heading", _drifting_heading, Stream.OWN_MOTION, 1, "heading_bias", "heading_sigma", heading_reading),
    Sensor("depth", _depth, Stream.DEPTH, 0, "", "depth_sigma"),
)
"""A follower's own sensors that its navigator reads."""
STEERING = (
    Sensor("pitch", elementwise(lambda e, on: on.body.pitch), Stream.TILT, 0, "", "tilt_sigma"),
    Sensor("turning", elementwise(lambda e, on: on.body.twist[5]), Stream.GYRO, 0, "", "gyro_sigma"),
    Sensor("pitching", elementwise(lambda e, on: on.body.twist[4]), Stream.GYRO, 1, "", "gyro_sigma"),
)
"""Those that only steer it."""
LEADER = (
    Sensor("timestamp", elementwise(lambda e, on: on.time)),
    Sensor("east", elementwise(lambda e, on: on.body.pose[0] + e.leader_drift_east * on.time)),
    Sensor("north", elementwise(lambda e, on: on.body.pose[1] + e.leader_drift_north * on.time)),
    Sensor("speed", _log_speed, Stream.LEADER_MOTION, 0, "leader_speed_bias", "", speed_reading),
    Sensor(
        "heading", _heading, Stream.LEADER_MOTION, 1, "leader_heading_bias", "leader_heading_sigma", heading_reading
    ),
    Sensor("depth", _depth, Stream.LEADER_DEPTH, 0, "", "leader_depth_sigma"),
)
"""The leader's; of its attitude see `true_message` and `read_message`."""
_AT_ORIGIN = 0.0, 0.0, 0.0


def _parameter(name: str) -> Callable[[Any], float]:
    """A function that gives a field of the errors, or zero for ""."""
    if not name:
        return elementwise(lambda e: 0.0)
    return elementwise(lambda e: getattr(e, name))


def truth_of(sensors: Sequence[Sensor]) -> Callable[[Any, Carrier, Any], None]:
    """A function that writes what sensors read without errors by name, in Python and in compiled code."""
    if not sensors:
        return elementwise(lambda e, on, readings: None)
    (name, true, *_), write_others = sensors[0], truth_of(sensors[1:])

    @elementwise
    def write_all(e: Any, on: Carrier, readings: Any) -> None:
        readings[name] = true(e, on)
        write_others(e, on, readings)

    return write_all


def _reader_of(sensors: Sequence[Sensor]) -> Callable[..., None]:
    """As `reader_of`; the last argument holds the normals of the sensor before."""
    if not sensors:
        return elementwise(lambda e, address, true, readings, drawn: None)
    name, _, stream, column, bias_name, sigma_name, read = sensors[0]
    assert stream is not None
    bias, sigma, read_others, number = (
        _parameter(bias_name),
        _parameter(sigma_name),
        _reader_of(sensors[1:]),
        int(stream),
    )

    @elementwise
    def read_all(e: Any, address: Address, true: Any, readings: Any, drawn: tuple[float, float]) -> None:
        if column == 0:
            drawn = normals_at(address, number)
        readings[name] = read(true[name], bias(e), sigma(e), drawn[column])
        read_others(e, address, true, readings, drawn)

    return read_all


def reader_of(sensors: Sequence[Sensor]) -> Callable[[Any, Address, Any, Any], None]:
    """A function that reads a list of sensors, in Python and in compiled code, which unrolls the list.

    It takes errors, address of the noise, and true values and readings by name, which may be the same.
    """
    read_all = _reader_of([sensor for sensor in sensors if sensor.stream is not None])
    return elementwise(lambda e, address, true, readings: read_all(e, address, true, readings, (0.0, 0.0)))


write_true_own, read_own = truth_of((*OWN, *STEERING)), reader_of(OWN)
read_follower = reader_of((*OWN, *STEERING))
_write_true_leader, _read_leader = truth_of(LEADER), reader_of(LEADER)


@elementwise
def true_message(e: Any, time: Any, leader: Body, tilt: Any, message: Any) -> None:
    """What a message of the leader holds without random errors and constant biases.

    Args:
        e: record or tuple of `sim.sensing.errors`.
        time: of sending [s].
        leader: its motion then.
        tilt: what accelerations add to measured pitch and roll [rad]; NaN if these are not broadcast.
        message: out: of `laisn.swarm.MESSAGE`.
    """
    _write_true_leader(e, Carrier(0, time, leader, _AT_ORIGIN), message)
    message.pitch, message.roll, message.heading_sigma = leader.pitch + tilt[0], leader.roll + tilt[1], np.nan


@elementwise
def read_message(e: Any, sent: Address, true: Any, offset: Any, fluctuation: Any, message: Any) -> None:
    """What a message holds.

    Args:
        e: record or tuple of `sim.sensing.errors`.
        sent: address of the noise at the filter step at which it is sent.
        true: of `true_message`, which may be the same as the message.
        offset: normals of the errors of pitch and roll that a run keeps.
        fluctuation: values of the Gauss–Markov processes, of unit variance.
        message: out: of `laisn.swarm.MESSAGE`.
    """
    _read_leader(e, sent, true, message)
    constant, sigma = e.leader_attitude_offset_sigma, e.leader_tilt_sigma
    pitch = plain_reading(true.pitch, 0.0, constant, offset[0])
    roll = plain_reading(true.roll, 0.0, constant, offset[1])
    message.pitch = plain_reading(pitch, 0.0, sigma, fluctuation[0])
    message.roll = plain_reading(roll, 0.0, sigma, fluctuation[1])


@elementwise
def paths_taken(e: Any, sent: Address) -> Any:
    """`Path` that a receiver takes for the direct one from the rear, front and middle transmitter."""
    drawn = uniforms_at(sent, _ECHO)
    front, middle = (drawn[0], drawn[0]) if e.common_echoes else (drawn[1], drawn[2])
    return path_taken(drawn[0], e), path_taken(front, e), path_taken(middle, e)


@elementwise
def _along(true: Any, path: Any) -> Any:
    """Of the ranges by each path the one by this path."""
    return select(path == 0, true[0], select(path == 1, true[1], true[2]))


@elementwise
def read_ranges(e: Any, transmitters: int, sent: Address, received: Address, true: Any) -> Any:
    """Ranges of messages that are not lost, to the rear, front and middle transmitter [m].

    Args:
        e: record or tuple of `sim.sensing.errors`.
        transmitters: how many of the leader's the follower uses.
        sent: address of the noise at the filter step at which a message is sent.
        received: at the one at which it is received.
        true: range by each path from each transmitter, shape (3 transmitters, 3 paths, …), [m]; NaN where nothing
            is received.
    """
    paths = 0, 0, 0
    if e.surface_echo_probability + e.bottom_echo_probability > 0.0:
        paths = paths_taken(e, sent)
    ranges = _along(true[0], paths[0]), _along(true[1], paths[1]), _along(true[2], paths[2])
    drawn, normal = uniforms_at(received, _RANGE_UNIFORM), normals_at(received, _RANGE_SCALE)[0]
    return range_readings(e, transmitters, ranges, drawn, normal)


class FollowerState(NamedTuple):
    """True state of a follower at filter steps k = 1 … n."""

    time: Floats  # shape (n,), [s]
    position: Floats  # of the body origin in the world, shape (n, 3), [m]
    quaternion: Floats  # attitude from body to world, (w, x, y, z), shape (n, 4)
    velocity: Floats  # in the world, shape (n, 3), [m/s]
    angular_velocity: Floats  # in the body frame, shape (n, 3), [rad/s]
    water_velocity: Floats  # in the world, shape (n, 3), [m/s]
    hydrophone: Floats  # in the world, shape (n, 3), [m]
    source: Floats
    """Where the pings left that are received at a step, from the rear, front and middle transmitter, in the world,
    shape (n, 3, 3), [m]; NaN where none is received."""


class OwnSensor(Protocol):
    """A sensor: a frozen dataclass whose fields are its parameters, keys of its table, in SI units and radians."""

    @property
    def name(self) -> str:
        """Of its readings in `Measurements.own`."""

    @property
    def stream(self) -> int:
        """Number of its noise, 16 … 63, for no other sensor."""

    @property
    def acoustic(self) -> bool:
        """Whether it reads pings, and nothing where all pings of a message are lost."""

    def true(self, state: FollowerState) -> Floats:
        """What it would read without errors, shape (n, c); NaN where it reads nothing."""

    def read(self, true: Floats, normals: Floats) -> Floats:
        """Its readings, shape (n, c), of true values and two standard normals a step, shape (n, 2)."""


@dataclass(frozen=True, kw_only=True)
class InvertedUsbl:
    """Inverted USBL of a follower: azimuth, positive to starboard, and elevation of the
    leader's front transmitter in its own hull [rad]."""

    name = BEARING
    stream = 15
    acoustic = True

    azimuth_sigma: float = float(np.deg2rad(1.0))
    azimuth_bias: float = 0.0
    """As of a head that is mounted askew."""
    elevation_sigma: float = float(np.deg2rad(1.0))

    def true(self, state: FollowerState) -> Floats:
        """Directions without errors, shape (n, 2)."""
        to_hull = state.quaternion * np.array([1.0, -1.0, -1.0, -1.0])
        forward, port, up = rotate(to_hull, state.source[:, 1] - state.hydrophone).T
        return np.column_stack([np.arctan2(-port, forward), np.arctan2(up, np.hypot(forward, port))])

    def read(self, true: Floats, normals: Floats) -> Floats:
        """Readings of true directions."""
        error = normals * (self.azimuth_sigma, self.elevation_sigma) + (self.azimuth_bias, 0.0)
        return np.asarray(true + error)


SHIPPED: Mapping[str, type[Any]] = {"inverted-usbl": InvertedUsbl}
"""Sensors of this project by the names that scenarios accept; all are off by default."""


def own_tables(scenario: Scenario) -> tuple[Any, ...]:
    """Tables of a scenario's further sensors: its own, after the one that its navigator needs."""
    variant, given = scenario.navigation.variant, scenario.sensors.own
    needed = NAVIGATORS[variant].sensor if variant in NAVIGATORS else ""
    there = not needed or any(table.sensor == needed for table in given)
    return given if there else (OwnSensorTable(sensor=needed), *given)


def own_sensors(scenario: Scenario) -> tuple[OwnSensor, ...]:
    """A scenario's further sensors; LaisnError if one cannot be found, or does not have a key of its table."""
    sensors = []
    for table in own_tables(scenario):
        made = SHIPPED.get(table.sensor) or find_class("sensor", table.sensor)
        try:
            sensors.append(made(**in_si(table.model_extra or {}, getattr(made, "__dataclass_fields__", ()))))
        except TypeError as error:
            raise LaisnError(f"sensors.own: {table.sensor}: {error}") from None
    return tuple(sensors)

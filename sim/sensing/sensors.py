"""The sensors: what each would read without errors, and its readings; shipped ones and those of plugins.

One set of formulas serves one instant and a finished mission: compiled code calls them with numbers and records, under
way (`sim.sensing.instant`); Python calls them with arrays over filter steps or messages (`sim.sensing.observation`).
Their first argument `e` is a record or tuple of `sim.sensing.errors`. Further sensors of a follower come from tables
`[[sensors.own]]` of a scenario.
"""

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
_OWN_MOTION, _DEPTH, _TILT, _GYRO = int(Stream.OWN_MOTION), int(Stream.DEPTH), int(Stream.TILT), int(Stream.GYRO)
_LEADER_MOTION, _LEADER_DEPTH = int(Stream.LEADER_MOTION), int(Stream.LEADER_DEPTH)
_ECHO, _RANGE_UNIFORM, _RANGE_SCALE = int(Stream.ECHO), int(Stream.RANGE_UNIFORM), int(Stream.RANGE_SCALE)


@elementwise
def true_own(e: Any, follower: int, time: Any, body: Body, depth_sensor: Any, true: Any) -> None:
    """What log, compass and pressure sensor of a follower read without random errors and constant biases.

    `depth_sensor` is the pressure sensor's offset, shape (3,), [m]. Writes a record of `laisn.swarm.READING`.
    """
    speed = speed_through_water(body.pose, body.twist, body.water)
    true.speed = speed + drift(e, e.speed_drift, e.speed_drift_phase, follower, time)
    true.heading = body.heading + drift(e, e.heading_drift, e.heading_drift_phase, follower, time)
    true.depth = -carried(body.pose, depth_sensor)[2]


@elementwise
def read_own(e: Any, address: Address, true: Any, reading: Any) -> None:
    """Read log, compass and pressure sensor: of `true_own`, which may be the same record as the reading."""
    log, compass = normals_at(address, _OWN_MOTION)
    reading.speed = speed_reading(true.speed, e.speed_bias, e.speed_sigma, log)
    reading.heading = heading_reading(true.heading, e.heading_bias, e.heading_sigma, compass)
    reading.depth = plain_reading(true.depth, 0.0, e.depth_sigma, normals_at(address, _DEPTH)[0])


@elementwise
def read_steering(e: Any, address: Address, body: Body, reading: Any) -> None:
    """Read inclinometer and gyros of a follower, which only steer it, into a record of `laisn.swarm.READING`."""
    about_up, about_port = normals_at(address, _GYRO)
    reading.pitch = plain_reading(body.pitch, 0.0, e.tilt_sigma, normals_at(address, _TILT)[0])
    reading.turning = plain_reading(body.twist[5], 0.0, e.gyro_sigma, about_up)
    reading.pitching = plain_reading(body.twist[4], 0.0, e.gyro_sigma, about_port)


@elementwise
def true_message(e: Any, time: Any, leader: Body, tilt: Any, message: Any) -> None:
    """What a message of the leader holds without random errors and constant biases.

    `tilt` is what accelerations add to measured pitch and roll [rad]; NaN if these are not broadcast. Writes a record
    of `laisn.swarm.MESSAGE`.
    """
    message.timestamp = time
    message.east = leader.pose[0] + e.leader_drift_east * time
    message.north = leader.pose[1] + e.leader_drift_north * time
    message.speed = speed_through_water(leader.pose, leader.twist, leader.water)
    message.heading, message.depth, message.heading_sigma = leader.heading, -leader.pose[2], np.nan
    message.pitch, message.roll = leader.pitch + tilt[0], leader.roll + tilt[1]


@elementwise
def read_message(e: Any, sent: Address, true: Any, offset: Any, fluctuation: Any, message: Any) -> None:
    """What a message holds, by that of `true_message`, which may be the same record.

    `sent` is the address of the noise at the filter step at which it is sent, `offset` normals of the errors of pitch
    and roll that a run keeps, and `fluctuation` values of the Gauss–Markov processes, of unit variance.
    """
    log, compass = normals_at(sent, _LEADER_MOTION)
    message.speed = speed_reading(true.speed, e.leader_speed_bias, 0.0, log)
    message.heading = heading_reading(true.heading, e.leader_heading_bias, e.leader_heading_sigma, compass)
    message.depth = plain_reading(true.depth, 0.0, e.leader_depth_sigma, normals_at(sent, _LEADER_DEPTH)[0])
    constant, sigma = e.leader_attitude_offset_sigma, e.leader_tilt_sigma
    message.pitch = true.pitch + constant * offset[0] + sigma * fluctuation[0]
    message.roll = true.roll + constant * offset[1] + sigma * fluctuation[1]


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
    azimuth_bias: float = 0.0  # as of a head that is mounted askew
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
        made = InvertedUsbl if table.sensor == "inverted-usbl" else find_class("sensor", table.sensor)
        try:
            sensors.append(made(**in_si(table.model_extra or {}, getattr(made, "__dataclass_fields__", ()))))
        except TypeError as error:
            raise LaisnError(f"sensors.own: {table.sensor}: {error}") from None
    return tuple(sensors)

"""The sensors: errors of sensors and ranges in SI units (paper, Eqs. 26–28), and the formulas by
which they read.

Sensors are declared as `sim.sensing.sensor.Sensor`. One set of formulas of numbers serves closed
loops, finished missions (both by `sim.sensing.own_sensors` and `reception`) and runs side by side
(`experiments.campaign.lane_flight`). `e` is a record of ERRORS or `SensorErrors`. Further sensors
of a follower come from tables `[[sensors.custom]]` of a scenario.

Messages are lost by the two-state chain of Gilbert (Bell System Technical Journal 39, 1960) and
Elliott (ibid. 42, 1963). The leader measures pitch and roll by an inclinometer, which takes the
specific force a − g for the vertical, alone or steadied by gyros (Mahony, Hamel & Pflimlin, IEEE
Transactions on Automatic Control 53, 2008). The error e of this filter is linear in the
inclinometer's error i and in the angle w by which the gyros walk off in a step:

    e_k = (1 − γ)(e_{k−1} + w_k) + γ i_k,    γ = 1 − exp(−Δt / τ).

Accelerations go through the filter here. The random part is a first-order Gauss–Markov process of
correlation time τ, exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974):

    x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import DispatchedFormula, compiled, formula, jitable
from laisn.errors import LaisnError
from laisn.geometry import signed_angle
from laisn.messages import LeaderMessage
from laisn.navigators import MAX_RANGE, MAX_SPEED
from laisn.plugins import find_class
from laisn.swarm import READING
from sim.attitude import Vector, body_point_in_world, heading_of, pitch_of, roll_of, rotated
from sim.scenario.class_keys import class_arguments
from sim.scenario.parts import SensingSettings
from sim.scenario.section import in_si
from sim.scenario.sensors import Acoustics, Sensors
from sim.scenario.sensors import CustomSensor as CustomSensorTable
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing.dvl import Dvl
from sim.sensing.links import Link, named_link, navigated_link
from sim.sensing.noise import Address, Stream, uniforms_at
from sim.sensing.sensor import (
    Sensor,
    SensorDriver,
    VehicleState,
    require_distinct,
    require_distinct_fields,
)
from sim.sensing.sonar import hearing_probability, sonar_of
from sim.trajectory import Trajectory, speed_through_water
from sim.water.assembly import floor_of, ocean_of, rays_of
from sim.water.environment import Environment
from sim.water.ocean import Ocean
from sim.water.rays import Path
from sim.water.waves import GRAVITY

_ECHO = int(Stream.ECHO)  # compiled code needs numbers, not the members of an enum


def complementary_filter_gain(sensors: Sensors) -> float:
    """γ: share of the inclinometer in each step of the filter; 1 without gyros."""
    if sensors.leader_gyro_time_constant_s == 0.0:
        return 1.0
    return float(-np.expm1(-CONTROL_STEP_S / sensors.leader_gyro_time_constant_s))


def leader_tilt_error(sensors: Sensors) -> tuple[float, float]:
    """Standard deviation [rad] and correlation time [s] of the random errors of the leader's pitch
    and roll; time 0: those of messages are independent.
    """
    reading_sigma = float(np.deg2rad(sensors.leader_attitude_sigma_deg))
    if sensors.leader_gyro_time_constant_s == 0.0:
        return reading_sigma, 0.0
    gain = complementary_filter_gain(sensors)
    walk_sigma = np.deg2rad(sensors.leader_gyro_random_walk_deg_sqrt_h) * np.sqrt(
        CONTROL_STEP_S / 3600.0
    )
    complement = 1.0 - gain
    variance = (gain**2 * reading_sigma**2 + complement**2 * walk_sigma**2) / (1.0 - complement**2)
    return float(np.sqrt(variance)), sensors.leader_gyro_time_constant_s


@jitable
def _apparent_tilt(pose: Any, change: Any) -> tuple[float, float]:
    """Pitch and roll [rad] that specific force seems to show, from pose and change of velocity
    [m/s] in a control step.
    """
    force = (
        change[0] / CONTROL_STEP_S,
        change[1] / CONTROL_STEP_S,
        change[2] / CONTROL_STEP_S + GRAVITY,
    )
    forward, port, up = rotated((pose[3], -pose[4], -pose[5], -pose[6]), force)
    return math.atan2(forward, math.hypot(port, up)), math.atan2(port, up)


@compiled
def update_tilt_error(gain: float, k: int, pose: Floats, twist: Floats, tilts: Floats) -> None:
    """Write what accelerations add to the leader's measured pitch and roll at instant k > 0, shape
    (n, 2), [rad].

    `gain` is `complementary_filter_gain`, `pose` and `twist` are of all instants until now; at the
    first they are those of the second.
    """
    change = (
        twist[k, 0] - twist[k - 1, 0],
        twist[k, 1] - twist[k - 1, 1],
        twist[k, 2] - twist[k - 1, 2],
    )
    for i in range(0 if k == 1 else k, k + 1):
        pitch, roll = _apparent_tilt(pose[i], change)
        errors = (
            signed_angle(pitch - pitch_of(pose[i, 3:])),
            signed_angle(roll - roll_of(pose[i, 3:])),
        )
        last = max(i, 1)
        for j in range(2):
            tilts[i, j] = tilts[last - 1, j] + gain * (errors[j] - tilts[last - 1, j])


def tilt_errors(trajectory: Trajectory, sensors: Sensors) -> Floats:
    """The same of a whole mission, none at its start."""
    tilts = np.zeros((trajectory.time.size, 2))
    gain = complementary_filter_gain(sensors)
    for k in range(1, len(tilts) if sensors.leader_attitude_senses_acceleration else 0):
        update_tilt_error(gain, k, trajectory.pose[:, 0], trajectory.twist[:, 0], tilts)
    return tilts


@formula
def gauss_markov_weights(steps: int, dt: float, time: float) -> tuple[float, float]:
    """Weights a and √(1 − a²) of a Gauss–Markov value `steps` steps dt [s] ago (0: none), and of
    a fresh normal.
    """
    persistence = math.exp(-steps * (dt / time)) if steps > 0 and time > 0.0 else 0.0
    return persistence, math.sqrt(1.0 - persistence * persistence)


@formula
def gauss_markov_step(
    last: float, persistence: float, spread_weight: float, normal: float
) -> float:
    """Next value of the process."""
    return persistence * last + spread_weight * normal


_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # the next follower's drift is ahead by it [rad]


class SensorErrors(NamedTuple):
    """Keys of `[sensors]` and `[acoustics]` without their units, in SI units and radians, by
    default those of the paper. No navigator has access to them.
    """

    speed_bias: float = 0.2
    speed_sigma: float = 0.2
    heading_bias: float = math.radians(5.0)
    heading_sigma: float = math.radians(2.0)
    depth_sigma: float = 0.0
    speed_drift: float = 0.0
    heading_drift: float = 0.0
    drift_period: float = 400.0
    speed_drift_phase: float = 0.0
    heading_drift_phase: float = 0.0
    gyro_sigma: float = math.radians(0.1)
    tilt_sigma: float = math.radians(0.5)
    leader_speed_bias: float = 0.0
    leader_speed_sigma: float = 0.0
    leader_heading_bias: float = 0.0
    leader_heading_sigma: float = 0.0
    leader_depth_sigma: float = 0.0
    leader_position_sigma: float = 0.0
    leader_position_walk: float = 0.0
    leader_attitude_offset_sigma: float = 0.0
    range_tau: tuple[float, float, float] = (0.01, 0.01, 0.01)
    range_error_centred: bool = False
    range_scale_mean: float = 0.1
    range_scale_sigma: float = 0.05
    travel_time: bool = False
    ping_slot: float = 0.0
    sound_speed: float = 1500.0
    sound_speed_bias: float = 0.0
    clock_offset: float = 0.0
    clock_drift: float = 0.0
    surface_echo_probability: float = 0.0
    bottom_echo_probability: float = 0.0
    common_echoes: bool = False
    loss_probability: float = 0.0
    burst_probability: float = 0.0
    burst_mean_messages: float = 5.0
    burst_loss_probability: float = 1.0
    max_range: float = 0.0
    # fields of `Sonar`
    sonar_detects: bool = False
    sonar_margin: float = 0.0
    sonar_spreading: float = 0.0
    sonar_absorption: float = 0.0
    sonar_scatter: float = 0.0
    leader_tilt_sigma: float = 0.0  # standard deviation of the leader's pitch and roll [rad]
    leader_tilt_time: float = 0.0  # its correlation time [s]; 0: messages are independent
    # rate at which the leader's broadcast position departs from the true one [m/s]
    leader_drift_east: float = 0.0
    leader_drift_north: float = 0.0


_SONAR = [name for name in SensorErrors._fields if name.startswith("sonar_")]
# computed from several keys each
_DERIVED = ("leader_tilt_sigma", "leader_tilt_time", "leader_drift_east", "leader_drift_north")
_KEYS = [name for name in SensorErrors._fields if name not in (*_SONAR, *_DERIVED)]


def _errors(sensors: Sensors, acoustics: Acoustics) -> SensorErrors:
    in_units = in_si({**dict(sensors), **dict(acoustics)})
    sonar = sonar_of(acoustics)
    tilt = leader_tilt_error(sensors)
    towards = np.deg2rad(sensors.leader_position_drift_deg)
    return SensorErrors(
        **{name: in_units[name] for name in _KEYS},
        **{name: getattr(sonar, name.removeprefix("sonar_")) for name in _SONAR},
        leader_tilt_sigma=tilt[0],
        leader_tilt_time=tilt[1],
        leader_drift_east=float(sensors.leader_position_drift_m_s * np.sin(towards)),
        leader_drift_north=float(sensors.leader_position_drift_m_s * np.cos(towards)),
    )


# the same as a record for compiled code
ERRORS = np.dtype(
    [
        (name, np.float64, np.shape(value)) if np.ndim(value) else (name, type(value))
        for name, value in SensorErrors()._asdict().items()
    ]
)


def errors_of(
    sensing: SensingSettings, follower: int = 0, link: Link | None = None
) -> SensorErrors:
    """The true errors of a follower's sensors and of a sender's, of the leader's by default;
    beacons, which are surveyed, have none.
    """
    sensors = sensing.sensors_of(follower, 0 if link is None else max(link.sender, 0))
    if link is not None and link.places is not None:
        keys = [name for name in Sensors.model_fields if name.startswith("leader_")]
        sensors = sensors.model_copy(update={k: Sensors.model_fields[k].default for k in keys})
    return _errors(sensors, sensing.acoustics)


def leader_errors_of(sensing: SensingSettings) -> SensorErrors:
    """The true errors of the leader's own sensors, as of a follower's."""
    return _errors(sensing.sensors_of_leader(), sensing.acoustics)


def navigated_errors_of(sensing: SensingSettings, follower: int = 0) -> SensorErrors:
    """The same of the link that the followers navigate on."""
    return errors_of(sensing, follower, navigated_link(sensing.links))


def further_errors_of(sensing: SensingSettings, follower: int = 0) -> dict[str, SensorErrors]:
    """The same of each further link that the followers navigate on, by its name."""
    links = sensing.links
    return {name: errors_of(sensing, follower, named_link(links, name)) for name in links.further}


Numbers = Sequence[float] | Floats
"""True values, or draws, of one reading."""


class Instant(NamedTuple):
    """True state of a vehicle at an instant, as the sensors of every vehicle see it, in numbers.

    Fields are named as those of `VehicleState`, which sensors of users' get.
    """

    time: float  # [s]
    follower: int  # index of the follower; 0 of the leader
    heading: float  # clockwise from north [rad]
    pitch: float  # positive nose up [rad]
    roll: float  # positive starboard down [rad]
    speed: float  # through the water, along the hull [m/s]
    depth: float  # of the pressure sensor [m]
    angular_velocity: tuple[float, float, float]  # in the body frame [rad/s]
    # what accelerations add to measured pitch and roll [rad]; NaN: these are not measured
    tilt: tuple[float, float]


@jitable
def instant_of(
    clock: tuple[float, int],
    motion: tuple[Any, Any, Any],
    depth_sensor: Vector | Floats,
    tilt: tuple[float, float],
) -> Instant:
    """What the sensors of a vehicle may see.

    Args:
        clock: time [s] and index of the follower.
        motion: pose, twist and velocity of the water, shapes (7,), (6,) and (3,).
        depth_sensor: its place in the hull, shape (3,), [m].
        tilt: as of `Instant`.
    """
    return _instant_of(clock, motion, depth_sensor, tilt, roll_of(motion[0][3:]))


@jitable
def instant_of_instruments(
    clock: tuple[float, int], motion: tuple[Any, Any, Any], depth_sensor: Vector | Floats
) -> Instant:
    """What INSTRUMENTS may see: the same without roll and tilt, which none of them reads."""
    return _instant_of(clock, motion, depth_sensor, (math.nan, math.nan), math.nan)


@jitable
def _instant_of(
    clock: tuple[float, int],
    motion: tuple[Any, Any, Any],
    depth_sensor: Vector | Floats,
    tilt: tuple[float, float],
    roll: float,
) -> Instant:
    pose, twist, water = motion
    quaternion = pose[3:]
    return Instant(
        clock[0],
        clock[1],
        heading_of(quaternion),
        pitch_of(quaternion),
        roll,
        speed_through_water(pose, twist, water),
        -body_point_in_world(pose, depth_sensor)[2],
        (twist[3], twist[4], twist[5]),
        tilt,
    )


@jitable
def write_channels(values: Sequence[float], column: int, row: Floats) -> None:
    """Write the channels of a sensor from a column on."""
    for i in range(len(values)):
        row[column + i] = values[i]


@jitable
def drift(e: SensorErrors, amplitude: float, phase: float, follower: int, time: float) -> float:
    """Sinusoidal drift of a bias of a follower, by its index, at a time [s]; in the unit of the
    amplitude.
    """
    if amplitude == 0.0:
        return 0.0
    return amplitude * math.sin(
        2.0 * math.pi / e.drift_period * time + (phase + follower * _GOLDEN)
    )


@formula
def read_speed(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Speed log of a follower, never negative (paper, Eq. 26); its scale ends at `MAX_SPEED`
    [m/s].
    """
    return np.minimum(np.maximum(true + e.speed_bias + e.speed_sigma * normals[0], 0.0), MAX_SPEED)


@formula
def read_heading(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Compass of a follower; the random part adds to the bias, whatever its sign (paper, Eq. 27)
    [rad].
    """
    return true + e.heading_bias + e.heading_sigma * np.abs(normals[1])


@formula
def read_depth(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Pressure sensor of a follower [m]."""
    return true + e.depth_sigma * normals[0]


@formula
def read_heel(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Inclinometer across the hull: the sine of its heel [-]. That along the hull takes the first
    normal.
    """
    return true + e.tilt_sigma * normals[1]


@formula
def read_rolling(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Gyro about the forward axis [rad/s]."""
    return true + e.gyro_sigma * normals[0]


@formula
def read_leader_speed(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Speed log of the leader, as `read_speed` [m/s]."""
    measured = true + e.leader_speed_bias + e.leader_speed_sigma * normals[0]
    return np.minimum(np.maximum(measured, 0.0), MAX_SPEED)


@formula
def read_leader_heading(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Compass of the leader, as `read_heading` [rad]."""
    return true + e.leader_heading_bias + e.leader_heading_sigma * np.abs(normals[1])


@formula
def read_leader_depth(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Pressure sensor of the leader, at its origin [m]."""
    return true + e.leader_depth_sigma * normals[0]


@formula
def position_errs(e: SensorErrors) -> bool:
    """Whether the leader's broadcast position has random errors."""
    return bool(e.leader_position_sigma + e.leader_position_walk > 0.0)


@formula
def read_leader_position(e: SensorErrors, true: float, normal: float, walk: float) -> Any:
    """The leader's broadcast position along an axis [m], by a normal of the message and the sum of
    normals times √Δt since the start.
    """
    return true + e.leader_position_sigma * normal + e.leader_position_walk * walk


@formula
def read_leader_attitude(e: SensorErrors, true: float, normals: tuple[float, float]) -> Any:
    """Pitch or roll of the leader [rad], by a normal that a run keeps and a Gauss–Markov value
    of unit variance.
    """
    return true + e.leader_attitude_offset_sigma * normals[0] + e.leader_tilt_sigma * normals[1]


if TYPE_CHECKING:

    class _BuiltInSensor(SensorErrors, Sensor):
        """A sensor of the project: compiled code gives its methods the errors as `self`."""

else:
    _BuiltInSensor = Sensor


class SpeedLog(_BuiltInSensor):
    """Speed log of a follower, with the errors of `[sensors]`, which are its `self`."""

    name = "speed"
    channels: ClassVar = {"speed": "m/s"}
    stream = Stream.OWN_MOTION

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Speed through the water along the hull, and the drift of the bias."""
        swing = drift(self, self.speed_drift, self.speed_drift_phase, state.follower, state.time)
        return (state.speed + swing,)

    def read(self, true: Numbers, draws: tuple[float, float]) -> tuple[float]:
        """As `read_speed`."""
        return (read_speed(self, true[0], draws),)


class Compass(_BuiltInSensor):
    """Compass of a follower; it shares the stream of the log, and takes its second normal."""

    name = "heading"
    channels: ClassVar = {"heading": "rad"}
    stream = Stream.OWN_MOTION

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Heading, and the drift of the bias."""
        phase = self.heading_drift_phase
        swing = drift(self, self.heading_drift, phase, state.follower, state.time)
        return (state.heading + swing,)

    def read(self, true: Numbers, draws: tuple[float, float]) -> tuple[float]:
        """As `read_heading`."""
        return (read_heading(self, true[0], draws),)


class PressureSensor(_BuiltInSensor):
    """Pressure sensor of a follower."""

    name = "depth"
    channels: ClassVar = {"depth": "m"}
    stream = Stream.DEPTH

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Depth of the sensor's place in the hull."""
        return (state.depth,)

    def read(self, true: Numbers, draws: tuple[float, float]) -> tuple[float]:
        """As `read_depth`."""
        return (read_depth(self, true[0], draws),)


@dataclass(frozen=True, kw_only=True)
class Inclinometer(Sensor):
    """Inclinometer of a follower, by which it steers, and its navigator where it is listed."""

    name = "inclinometer"
    channels: ClassVar = {"pitch": "rad"}
    stream = Stream.TILT

    period: float = 0.0
    tilt_sigma: float = SensorErrors().tilt_sigma

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Pitch, positive nose up."""
        return (state.pitch,)

    def read(self, true: Numbers, draws: Numbers) -> tuple[float]:
        """Pitch with its error."""
        return (true[0] + self.tilt_sigma * draws[0],)


@dataclass(frozen=True, kw_only=True)
class Gyros(Sensor):
    """Gyros of a follower, by which it steers, and its navigator where they are listed."""

    name = "gyros"
    channels: ClassVar = {"yaw_rate": "rad/s", "pitch_rate": "rad/s"}
    stream = Stream.GYRO

    period: float = 0.0
    gyro_sigma: float = SensorErrors().gyro_sigma

    def true(self, state: Instant, environment: Environment | None) -> tuple[float, float]:
        """Rates about the hull's upward axis, positive to port, and its port axis, nose down."""
        return (state.angular_velocity[2], state.angular_velocity[1])

    def read(self, true: Numbers, draws: Numbers) -> tuple[float, float]:
        """Rates with their errors."""
        return (true[0] + self.gyro_sigma * draws[0], true[1] + self.gyro_sigma * draws[1])


class LeaderCompass(_BuiltInSensor):
    """Compass of the leader."""

    name = "heading"
    channels: ClassVar = {"heading": "rad"}
    stream = Stream.LEADER_MOTION

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Heading."""
        return (state.heading,)

    def read(self, true: Numbers, draws: tuple[float, float]) -> tuple[float]:
        """As `read_leader_heading`."""
        return (read_leader_heading(self, true[0], draws),)


class LeaderSpeedLog(_BuiltInSensor):
    """Speed log of the leader."""

    name = "speed"
    channels: ClassVar = {"speed": "m/s"}
    stream = Stream.LEADER_MOTION

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Speed through the water along the hull."""
        return (state.speed,)

    def read(self, true: Numbers, draws: tuple[float, float]) -> tuple[float]:
        """As `read_leader_speed`."""
        return (read_leader_speed(self, true[0], draws),)


class LeaderPressureSensor(_BuiltInSensor):
    """Pressure sensor of the leader, at its origin."""

    name = "depth"
    channels: ClassVar = {"depth": "m"}
    stream = Stream.LEADER_DEPTH

    def true(self, state: Instant, environment: Environment | None) -> tuple[float]:
        """Depth."""
        return (state.depth,)

    def read(self, true: Numbers, draws: tuple[float, float]) -> tuple[float]:
        """As `read_leader_depth`."""
        return (read_leader_depth(self, true[0], draws),)


class LeaderAttitude(_BuiltInSensor):
    """Inclinometer of the leader, perhaps steadied by gyros.

    Its draws are, of pitch and roll, the normals that a run keeps, then the Gauss–Markov values.
    """

    name = "attitude"
    channels: ClassVar = {"pitch": "rad", "roll": "rad"}
    stream = Stream.LEADER_ATTITUDE
    normals = 4

    def true(self, state: Instant, environment: Environment | None) -> tuple[float, float]:
        """Pitch and roll with what accelerations add; NaN where they are not measured."""
        return (state.pitch + state.tilt[0], state.roll + state.tilt[1])

    def read(self, true: Numbers, draws: Numbers) -> tuple[float, float]:
        """As `read_leader_attitude`."""
        return (
            read_leader_attitude(self, true[0], (draws[0], draws[2])),
            read_leader_attitude(self, true[1], (draws[1], draws[3])),
        )


class CompiledSensor(NamedTuple):
    """A declared sensor as compiled code calls it, with a record of ERRORS or `SensorErrors` for
    `self`.
    """

    column: int  # of the first of its channels in READING or MESSAGE
    stream: int
    true: Any
    read: Any


def _compiled_sensor(sensor: type[Sensor], names: Sequence[str], first: str = "") -> CompiledSensor:
    """A sensor whose channels are consecutive columns of an array with columns of these names, from
    the one named `first` on; by default that named as the sensor's first channel.
    """
    column = names.index(first or next(iter(sensor.channels)))
    true = DispatchedFormula(sensor.true)
    return CompiledSensor(column, int(sensor.stream), true, DispatchedFormula(sensor.read))


OWN_SENSORS: tuple[type[Sensor], ...] = (SpeedLog, Compass, PressureSensor)
"""What a follower's navigator takes; their readings are fields of `Measurements`."""
OWN = tuple(_compiled_sensor(sensor, READING.names or ()) for sensor in OWN_SENSORS)
INSTRUMENTS = (  # besides, inclinometer and gyros, by which the autopilot steers
    *OWN,
    _compiled_sensor(Inclinometer, READING.names or ()),
    _compiled_sensor(Gyros, READING.names or (), "turning"),
)
LEADER = (  # what a message holds beside time and place
    _compiled_sensor(LeaderCompass, LeaderMessage._fields),
    _compiled_sensor(LeaderSpeedLog, LeaderMessage._fields),
    _compiled_sensor(LeaderPressureSensor, LeaderMessage._fields),
)
LEADER_ATTITUDE = (_compiled_sensor(LeaderAttitude, LeaderMessage._fields),)


@formula
def longest_range(true: Numbers, transmitters: int) -> float:
    """Longest of the ranges to the rear, front and, of three transmitters, middle one; 0 if none
    is received.
    """
    longest = 0.0
    longest = true[0] if true[0] > longest else longest
    longest = true[1] if true[1] > longest else longest
    return true[2] if transmitters > 2 and true[2] > longest else longest


@formula
def range_reading(
    e: SensorErrors, tau: float, true: tuple[float, float], numbers_drawn: tuple[float, float]
) -> float:
    """Range to a transmitter or NaN [m] (paper, Eq. 28) by the true and the longest one, a uniform
    and the normal of ψ.

    A receiver rejects zero, negative ranges and those beyond `MAX_RANGE`. ψ counts in proportion to
    the longest range to the N_T transmitters in use: 2 with LAISN-2 and 3 with LAISN-3 (Sections
    2.2 and 2.3). The middle one, which LAISN-2 has no use for, is scaled by the longest of all.
    """
    psi = e.range_scale_mean + e.range_scale_sigma * numbers_drawn[1]
    longest = true[1] + (true[1] == 0.0)
    reading = (
        true[0] + tau * (numbers_drawn[0] - 0.5 * e.range_error_centred) + psi * (true[0] / longest)
    )
    return reading if (reading > 0.0) & (reading <= MAX_RANGE) else math.nan


@formula
def loses(e: SensorErrors) -> bool:
    """Whether a message is ever lost."""
    return bool(e.loss_probability + e.burst_probability > 0.0 or e.sonar_detects)


@formula
def is_bad(bad: bool, uniform: float, e: SensorErrors) -> bool:
    """Whether the next message meets the bad state, which is left with the inverse of its mean
    length.
    """
    return bool(uniform * e.burst_mean_messages >= 1.0 if bad else uniform < e.burst_probability)


@formula
def is_lost(bad: bool, uniform: float, e: SensorErrors) -> bool:
    """Whether a message in that state is lost."""
    return bool(uniform < (e.burst_loss_probability if bad else e.loss_probability))


@formula
def is_heard(uniform: float, e: SensorErrors, measured: float, time: float) -> bool:
    """Whether a message is heard whose range before random errors [m] is read at a time [s]; what
    the clocks add to it is no distance.
    """
    clock = e.clock_offset + e.clock_drift * time
    distance = measured - (e.sound_speed + e.sound_speed_bias) * clock
    return bool(not e.sonar_detects or uniform < hearing_probability(e, distance))


@formula
def path_taken(uniform: float, e: SensorErrors) -> Any:
    """`Path` that the receiver takes for the direct one by a draw in (0, 1)."""
    surface = uniform < e.surface_echo_probability
    either = uniform < e.surface_echo_probability + e.bottom_echo_probability
    # 1 for the surface, 2 for the bottom: a draw below the first chance is below the sum of both
    return 2 * either - 1 * surface


@jitable
def paths_taken(e: SensorErrors, address: Address) -> tuple[int, int, int]:
    """`Path` that a receiver takes for the direct one from the rear, front and middle transmitter.

    `address` is that of the noise at the filter step at which a message is sent.
    """
    if e.surface_echo_probability + e.bottom_echo_probability == 0.0:
        return 0, 0, 0
    uniforms = uniforms_at(address, _ECHO)
    rear = path_taken(uniforms[0], e)
    if e.common_echoes:
        return rear, rear, rear
    return rear, path_taken(uniforms[1], e), path_taken(uniforms[2], e)


@dataclass(frozen=True, kw_only=True)
class InvertedUsblSensor(Sensor):
    """Inverted USBL of a follower: azimuth, positive to starboard, and elevation of the
    leader's front transmitter in its own hull [rad]."""

    name = "bearing"
    channels: ClassVar = {"azimuth": "rad", "elevation": "rad"}
    stream = 15
    acoustic = True

    azimuth_sigma: float = float(np.deg2rad(1.0))
    azimuth_bias: float = 0.0  # as of a head that is mounted askew
    elevation_sigma: float = float(np.deg2rad(1.0))

    def true(self, state: VehicleState, environment: Environment) -> tuple[float, float]:
        """Direction without errors, from which the direct ray arrives."""
        towards = state.source[1] - state.hydrophone
        if environment.rays.bends:
            source = tuple(state.source[1].tolist())
            ray = environment.rays.ray(int(Path.DIRECT), source, tuple(state.hydrophone.tolist()))
            towards[2] = np.hypot(towards[0], towards[1]) * np.tan(ray.elevation)
        forward, port, up = state.in_hull(towards)
        return np.arctan2(-port, forward), np.arctan2(up, np.hypot(forward, port))

    def read(self, true: Floats, draws: Floats) -> Floats:
        """Reading of a true direction."""
        error = draws * (self.azimuth_sigma, self.elevation_sigma) + (self.azimuth_bias, 0.0)
        return np.asarray(true + error)


SHIPPED: dict[str, type[Sensor]] = {
    "dvl": Dvl,
    "inverted-usbl": InvertedUsblSensor,
    "inclinometer": Inclinometer,
    "gyros": Gyros,
}
"""Sensors of this project that a scenario may list, by their names there."""


def _made_sensor(table: Any, where: str) -> Any:
    """The sensor of a table, by its key; LaisnError if there is no such class, or it has no such
    key.
    """
    sensor_class = SHIPPED.get(table.sensor) or find_class("sensor", table.sensor)
    keys = class_arguments(sensor_class, table.sensor, table.model_extra or {}, where)
    try:
        return sensor_class(**keys)
    except TypeError as error:
        raise LaisnError(f"{where}: {table.sensor}: {error}") from None


def custom_sensors(sensing: SensingSettings, follower: int) -> tuple[SensorDriver, ...]:
    """The further sensors of a follower, also that which its navigator needs; LaisnError if one
    cannot be found, does not have a key of its table or is not declared as it must be, or if two
    have one name or one stream of noise.
    """
    tables = sensing.sensors_of(follower).custom
    has_own = sensing.of_vehicles[follower + 1].custom is not None
    where = f"followers[{follower}].sensors.custom" if has_own else "sensors.custom"
    return _drivers(tables, where, sensing.needed_sensor, sensing.links.filter_step_s)


def leader_custom_sensors(sensing: SensingSettings) -> tuple[SensorDriver, ...]:
    """Further sensors of the leader; errors are as of `custom_sensors`."""
    tables = sensing.sensors_of_leader().custom
    where = "leader.sensors.custom"
    return _drivers(tables, where, sensing.needed_by_leader, sensing.links.filter_step_s)


def sensors_of_all(sensing_of: Sequence[SensingSettings]) -> tuple[SensorDriver, ...]:
    """Further sensors of all vehicles, those of one declaration once, by the settings for each
    follower; LaisnError also if two vehicles have sensors of one name with other channels, or of
    names that are one in the fields of logs.
    """
    drivers = [*leader_custom_sensors(sensing_of[0])]
    for follower, sensing in enumerate(sensing_of):
        drivers += custom_sensors(sensing, follower)
    distinct: dict[str, SensorDriver] = {}
    for driver in drivers:
        other = distinct.setdefault(driver.name, driver)
        if other.header != driver.header:
            raise LaisnError(
                f"sensors.custom: {other.kind} and {driver.kind}, of different vehicles, are both "
                f"named {driver.name!r}; expected the same channels and period, or another name"
            )
    require_distinct_fields(distinct.values())
    return tuple(distinct.values())


def _drivers(
    tables: Sequence[Any], where: str, required_name: str, dt: float
) -> tuple[SensorDriver, ...]:
    """Drivers of the sensors of tables, a list of this key, after the one that a navigator
    needs.
    """
    drivers = [
        SensorDriver(sensor=_made_sensor(table, f"{where}[{i}]"), dt=dt)
        for i, table in enumerate(tables)
    ]
    if required_name and all(table.sensor != required_name for table in tables):
        table = CustomSensorTable(sensor=required_name)
        driver = SensorDriver(sensor=_made_sensor(table, where), dt=dt)
        # a user's sensor of the same name takes its place
        if all(other.name != driver.name for other in drivers):
            drivers.insert(0, driver)
    require_distinct(drivers)
    return tuple(drivers)


def environment_of(sensing: SensingSettings) -> Environment:
    """The sea as sensors see it; at rest where vehicles move as points."""
    sea = sensing.sound.sea
    if sensing.kind == "kinematic":
        water = Ocean(floor_depth_m=sea.ocean.floor_depth_m, floor=floor_of(sea))
    else:
        water = ocean_of(sea)
    return replace(water, rays=rays_of(sensing.sound)).environment

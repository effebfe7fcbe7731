"""The sensors: errors of sensors and ranges in SI units (paper, Eqs. 26–28), and the formulas by which they read.

One set of formulas serves one instant, a finished mission (both by `sim.sensing.observation`) and runs side by side
(`experiments.campaign.lane_flight`): compiled code calls them with numbers and records, Python with arrays over filter
steps or messages. `e` is a record of ERRORS or `SensorErrors`. Further sensors of a follower come from tables
`[[sensors.own]]` of a scenario.

Messages are lost by the two-state chain of Gilbert (Bell System Technical Journal 39, 1960) and Elliott (ibid. 42,
1963). The leader measures pitch and roll by an inclinometer, which takes the specific force a − g for the vertical,
alone or steadied by gyros (Mahony, Hamel & Pflimlin, IEEE Transactions on Automatic Control 53, 2008). The error e of
this filter is linear in the inclinometer's error i and in the angle w by which the gyros walk off in a step:

    e_k = (1 − γ)(e_{k−1} + w_k) + γ i_k,    γ = 1 − exp(−Δt / τ).

Accelerations go through the filter here. The random part is a first-order Gauss–Markov process of correlation time τ,
exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974):

    x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ).
"""

import math
from collections import namedtuple
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, elementwise, formula, select
from laisn.failure import LaisnError
from laisn.geometry import signed_angle
from laisn.messages import BEARING
from laisn.navigators import FARTHEST, FASTEST, NAVIGATORS
from laisn.plugins import find_class
from sim.attitude import carried, pitch_of, roll_of, rotate, rotated
from sim.scenario.section import in_si
from sim.scenario.sensors import Acoustics, Sensors
from sim.scenario.sensors import OwnSensor as OwnSensorTable
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.noise import Address, Stream, normals_at, uniforms_at
from sim.trajectory import Body, Trajectory, speed_through_water
from sim.water import GRAVITY

# compiled code needs numbers, not the members of an enum
_OWN_MOTION, _DEPTH, _TILT, _GYRO = int(Stream.OWN_MOTION), int(Stream.DEPTH), int(Stream.TILT), int(Stream.GYRO)
_LEADER_MOTION, _LEADER_DEPTH = int(Stream.LEADER_MOTION), int(Stream.LEADER_DEPTH)
_ECHO, _RANGE_UNIFORM, _RANGE_SCALE = int(Stream.ECHO), int(Stream.RANGE_UNIFORM), int(Stream.RANGE_SCALE)


def gain(sensors: Sensors) -> float:
    """γ: share of the inclinometer in each step of the filter; 1 without gyros."""
    if sensors.leader_gyro_time_constant_s == 0.0:
        return 1.0
    return float(-np.expm1(-CONTROL_STEP_S / sensors.leader_gyro_time_constant_s))


def random_error(sensors: Sensors) -> tuple[float, float]:
    """Standard deviation [rad] and correlation time [s] of the leader's pitch and roll errors; 0: each has its own."""
    reading = float(np.deg2rad(sensors.leader_attitude_sigma_deg))
    if sensors.leader_gyro_time_constant_s == 0.0:
        return reading, 0.0
    share = gain(sensors)
    walk = np.deg2rad(sensors.leader_gyro_random_walk_deg_sqrt_h) * np.sqrt(CONTROL_STEP_S / 3600.0)
    kept = 1.0 - share
    variance = (share**2 * reading**2 + kept**2 * walk**2) / (1.0 - kept**2)
    return float(np.sqrt(variance)), sensors.leader_gyro_time_constant_s


@elementwise
def _shown(quaternion: Any, change: Any) -> Any:
    """Pitch and roll that specific force seems to show, from attitude and change of velocity in a control step."""
    force = change[0] / CONTROL_STEP_S, change[1] / CONTROL_STEP_S, change[2] / CONTROL_STEP_S + GRAVITY
    to_body = quaternion[0], -quaternion[1], -quaternion[2], -quaternion[3]
    forward, port, up = rotated(to_body, force)
    return np.arctan2(forward, np.hypot(port, up)), np.arctan2(port, up)


def apparent_tilt(trajectory: Trajectory) -> Floats:
    """Pitch and roll that specific force shows at the leader's origin, means over a step, shape (n, 2), [rad]."""
    change = np.diff(trajectory.velocity[:, 0], axis=0)
    change = np.concatenate([change[:1], change])
    return np.column_stack(_shown(trajectory.quaternion[:, 0].T, change.T))


@compiled
def follow_tilt(share: float, k: int, pose: Floats, twist: Floats, tilts: Floats) -> None:
    """Write what accelerations add to the leader's measured pitch and roll at instant k > 0, shape (n, 2), [rad].

    `share` is `gain`, `pose` and `twist` are of all instants until now; at the first they are those of the second.
    """
    change = twist[k, 0] - twist[k - 1, 0], twist[k, 1] - twist[k - 1, 1], twist[k, 2] - twist[k - 1, 2]
    for i in range(0 if k == 1 else k, k + 1):
        w, x, y, z = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
        pitch, roll = _shown((w, x, y, z), change)
        errors, last = (signed_angle(pitch - pitch_of(w, x, y, z)), signed_angle(roll - roll_of(w, x, y, z))), max(i, 1)
        for j in range(2):
            tilts[i, j] = tilts[last - 1, j] + share * (errors[j] - tilts[last - 1, j])


def tilt_errors(trajectory: Trajectory, sensors: Sensors) -> Floats:
    """The same of a whole mission, none at its start."""
    tilts, share, leader = (
        np.zeros((trajectory.time.size, 2)),
        gain(sensors),
        (trajectory.pose[:, 0], trajectory.twist[:, 0]),
    )
    for k in range(1, len(tilts) if sensors.leader_attitude_senses_acceleration else 0):
        follow_tilt(share, k, *leader, tilts)
    return tilts


@formula
def weights(since: int, dt: float, time: float) -> tuple[float, float]:
    """Weights a and √(1 − a²) of a Gauss–Markov value `since` steps dt [s] ago (0: none), and of a fresh normal."""
    kept = math.exp(-since * (dt / time)) if since > 0 and time > 0.0 else 0.0
    return kept, math.sqrt(1.0 - kept * kept)


@formula
def advanced(last: Any, kept: float, fresh: float, normal: Any) -> Any:
    """Next value of the process."""
    return kept * last + fresh * normal


_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))  # the next follower's drift is ahead by it [rad]
_DERIVED = ("leader_position_drift", "leader_gyro", "leader_attitude_senses", "leader_attitude_sigma")
"""Keys that count by what follows from them."""


def _values(sensors: Sensors, acoustics: Acoustics) -> dict[str, Any]:
    given = in_si({**dict(sensors), **dict(acoustics)})
    declared = {
        name: value
        for name, value in given.items()
        if name not in ("own", "sound_speed_profile") and not name.startswith(_DERIVED)
    }
    tilt, towards = random_error(sensors), np.deg2rad(sensors.leader_position_drift_deg)
    return declared | {
        "leader_tilt_sigma": tilt[0],
        "leader_tilt_time": tilt[1],
        "leader_drift_east": float(sensors.leader_position_drift_m_s * np.sin(towards)),
        "leader_drift_north": float(sensors.leader_position_drift_m_s * np.cos(towards)),
    }


_DEFAULTS = _values(Sensors(), Acoustics())


_fields: Any = namedtuple


class SensorErrors(_fields("SensorErrors", _DEFAULTS, defaults=_DEFAULTS.values())):  # type: ignore[misc]
    """Keys of `[sensors]` and `[acoustics]` without their units, in SI units, by default those of the paper.

    Besides: `leader_tilt_sigma` [rad] and `leader_tilt_time` [s], standard deviation and correlation time of the
    leader's pitch and roll (0: each message has its own), and `leader_drift_east` and `leader_drift_north`, the rate at
    which its broadcast position departs from the true one [m/s]. No navigator has access to them.
    """


# the same as a record for compiled code
ERRORS = np.dtype([(name, np.float64, np.shape(v)) if np.ndim(v) else (name, type(v)) for name, v in _DEFAULTS.items()])


def errors_of(scenario: Scenario, follower: int = 0) -> SensorErrors:
    """The true errors of a follower's and the leader's sensors."""
    return SensorErrors(**_values(scenario.sensors_of(follower), scenario.acoustics))


@elementwise
def drift(e: Any, amplitude: float, phase: float, follower: int, time: Any) -> Any:
    """Sinusoidal drift of a bias of a follower, by its index, at a time [s]; in the unit of the amplitude."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * np.sin(2.0 * np.pi / e.drift_period * time + (phase + follower * _GOLDEN))


@formula
def speed_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Speed log, never negative (paper, Eq. 26); its scale ends at `FASTEST`."""
    return np.minimum(np.maximum(true + bias + sigma * normal, 0.0), FASTEST)


@formula
def heading_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Compass: the random part adds to the bias, whatever its sign (paper, Eq. 27)."""
    return true + bias + sigma * np.abs(normal)


@formula
def plain_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Normal error: pressure sensor, inclinometer, gyro."""
    return true + bias + sigma * normal


@formula
def _range_reading(true: Any, longest: Any, tau: float, uniform: Any, psi: Any) -> Any:
    reading = true + tau * uniform + psi * (true / (longest + (longest == 0.0)))
    return select((reading > 0.0) & (reading <= FARTHEST), reading, np.nan)


@formula
def range_readings(e: SensorErrors, transmitters: int, true: Any, uniform: Any, normal: Any) -> Any:
    """Ranges of a message to the rear, front and middle transmitter (paper, Eq. 28); NaN where none is received.

    A receiver rejects zero, negative ranges and those beyond `FARTHEST`. N_T is 2 with LAISN-2 and 3 with LAISN-3
    (Sections 2.2 and 2.3); ψ counts in proportion to the longest range to those in use. The middle one, which LAISN-2
    has no use for, is scaled by the longest of all.
    """
    psi, centre = e.range_scale_mean + e.range_scale_sigma * normal, 0.5 * e.range_error_centred
    of_two = np.fmax(np.fmax(true[0], true[1]), 0.0)
    of_all = np.fmax(of_two, true[2])
    longest = of_all if transmitters > 2 else of_two
    return (
        _range_reading(true[0], longest, e.range_tau[0], uniform[0] - centre, psi),
        _range_reading(true[1], longest, e.range_tau[1], uniform[1] - centre, psi),
        _range_reading(true[2], of_all, e.range_tau[2], uniform[2] - centre, psi),
    )


@formula
def loses(e: SensorErrors) -> bool:
    """Whether a message is ever lost."""
    return bool(e.loss_probability + e.burst_probability > 0.0)


@formula
def is_bad(bad: bool, uniform: float, e: SensorErrors) -> bool:
    """Whether the next message meets the bad state, which is left with the inverse of its mean length."""
    return bool(uniform * e.burst_mean_messages >= 1.0 if bad else uniform < e.burst_probability)


@formula
def is_lost(bad: bool, uniform: float, e: SensorErrors) -> bool:
    """Whether a message in that state is lost."""
    return bool(uniform < (e.burst_loss_probability if bad else e.loss_probability))


@formula
def path_taken(uniform: Any, e: SensorErrors) -> Any:
    """`Path` that the receiver takes for the direct one by a draw in (0, 1); numbers or arrays."""
    surface = uniform < e.surface_echo_probability
    either = uniform < e.surface_echo_probability + e.bottom_echo_probability
    # 1 for the surface, 2 for the bottom: a draw below the first chance is below the sum of both
    return 2 * either - 1 * surface


@elementwise
def true_own(e: Any, follower: int, time: Any, body: Body, depth_sensor: Any, true: Any) -> None:
    """Write what log, compass and pressure sensor, at an offset [m], read without random errors and biases."""
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
        e: record or tuple of `sim.sensing.sensors`.
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
    source: Floats  # where received pings left, of rear, front, middle transmitter, shape (n, 3, 3), [m]; else NaN


def follower_state(time: Floats, motion: tuple[Floats, Floats, Floats], *places: Floats) -> FollowerState:
    """The state of poses, twists and velocities of the water, shapes (n, 7), (n, 6) and (n, 3), and two places."""
    pose, twist, water = motion
    return FollowerState(time, pose[:, :3], pose[:, 3:], twist[:, :3], twist[:, 3:], water, *places)


class OwnSensor(Protocol):
    """A sensor: a frozen dataclass whose fields are its parameters, keys of its table, in SI units and radians."""

    name: str  # of its readings in `Measurements.own`
    stream: int  # number of its noise, 16 … 63, for no other sensor
    acoustic: bool  # whether it reads pings, and nothing where all pings of a message are lost

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

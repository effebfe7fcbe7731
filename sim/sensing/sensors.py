"""The sensors: errors of sensors and ranges in SI units (paper, Eqs. 26–28), and the formulas by
which they read.

One set of formulas of numbers serves closed loops, finished missions (both by
`sim.sensing.observation`) and runs side by side (`experiments.campaign.lane_flight`). `e` is a
record of ERRORS or `SensorErrors`. Further sensors of a follower come from tables `[[sensors.own]]`
of a scenario.

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
from collections import namedtuple
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import DispatchedFormula, compiled, formula, jitable
from laisn.errors import LaisnError
from laisn.geometry import signed_angle
from laisn.messages import BEARING, LeaderMessage, Ranges
from laisn.navigators import FARTHEST, FASTEST, NAVIGATORS
from laisn.plugins import calling, find_class
from laisn.swarm import READING
from sim.attitude import body_point_in_world, heading_of, pitch_of, roll_of, rotate, rotated
from sim.scenario.section import in_si
from sim.scenario.sensors import Acoustics, Sensors
from sim.scenario.sensors import OwnSensor as OwnSensorTable
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.noise import Address, Stream, uniforms_at
from sim.trajectory import Trajectory, speed_through_water
from sim.water.waves import GRAVITY

_ECHO = int(Stream.ECHO)  # compiled code needs numbers, not the members of an enum


def complementary_filter_gain(sensors: Sensors) -> float:
    """γ: share of the inclinometer in each step of the filter; 1 without gyros."""
    if sensors.leader_gyro_time_constant_s == 0.0:
        return 1.0
    return float(-np.expm1(-CONTROL_STEP_S / sensors.leader_gyro_time_constant_s))


def random_error(sensors: Sensors) -> tuple[float, float]:
    """Standard deviation [rad] and correlation time [s] of the leader's pitch and roll errors;
    0: each has its own.
    """
    reading = float(np.deg2rad(sensors.leader_attitude_sigma_deg))
    if sensors.leader_gyro_time_constant_s == 0.0:
        return reading, 0.0
    share = complementary_filter_gain(sensors)
    walk = np.deg2rad(sensors.leader_gyro_random_walk_deg_sqrt_h) * np.sqrt(CONTROL_STEP_S / 3600.0)
    kept = 1.0 - share
    variance = (share**2 * reading**2 + kept**2 * walk**2) / (1.0 - kept**2)
    return float(np.sqrt(variance)), sensors.leader_gyro_time_constant_s


@jitable
def _apparent_tilt(pose: Any, change: Any) -> tuple[float, float]:
    """Pitch and roll that specific force seems to show, from pose and change of velocity in a
    control step.
    """
    force = (
        change[0] / CONTROL_STEP_S,
        change[1] / CONTROL_STEP_S,
        change[2] / CONTROL_STEP_S + GRAVITY,
    )
    forward, port, up = rotated((pose[3], -pose[4], -pose[5], -pose[6]), force)
    return math.atan2(forward, math.hypot(port, up)), math.atan2(port, up)


@compiled
def update_tilt_error(share: float, k: int, pose: Floats, twist: Floats, tilts: Floats) -> None:
    """Write what accelerations add to the leader's measured pitch and roll at instant k > 0, shape
    (n, 2), [rad].

    `share` is `complementary_filter_gain`, `pose` and `twist` are of all instants until now; at the
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
            tilts[i, j] = tilts[last - 1, j] + share * (errors[j] - tilts[last - 1, j])


def tilt_errors(trajectory: Trajectory, sensors: Sensors) -> Floats:
    """The same of a whole mission, none at its start."""
    tilts = np.zeros((trajectory.time.size, 2))
    share = complementary_filter_gain(sensors)
    for k in range(1, len(tilts) if sensors.leader_attitude_senses_acceleration else 0):
        update_tilt_error(share, k, trajectory.pose[:, 0], trajectory.twist[:, 0], tilts)
    return tilts


@formula
def gauss_markov_weights(since: int, dt: float, time: float) -> tuple[float, float]:
    """Weights a and √(1 − a²) of a Gauss–Markov value `since` steps dt [s] ago (0: none), and of
    a fresh normal.
    """
    kept = math.exp(-since * (dt / time)) if since > 0 and time > 0.0 else 0.0
    return kept, math.sqrt(1.0 - kept * kept)


@formula
def gauss_markov_step(last: float, kept: float, fresh: float, normal: float) -> float:
    """Next value of the process."""
    return kept * last + fresh * normal


_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # the next follower's drift is ahead by it [rad]
_DERIVED = (
    "leader_position_drift",
    "leader_gyro",
    "leader_attitude_senses",
    "leader_attitude_sigma",
)
"""Keys that count by what follows from them."""


def _values(sensors: Sensors, acoustics: Acoustics) -> dict[str, Any]:
    given = in_si({**dict(sensors), **dict(acoustics)})
    declared = {
        name: value
        for name, value in given.items()
        if name not in ("own", "sound_speed_profile") and not name.startswith(_DERIVED)
    }
    tilt = random_error(sensors)
    towards = np.deg2rad(sensors.leader_position_drift_deg)
    return declared | {
        "leader_tilt_sigma": tilt[0],
        "leader_tilt_time": tilt[1],
        "leader_drift_east": float(sensors.leader_position_drift_m_s * np.sin(towards)),
        "leader_drift_north": float(sensors.leader_position_drift_m_s * np.cos(towards)),
    }


_DEFAULTS = _values(Sensors(), Acoustics())


_fields: Any = namedtuple


class SensorErrors(_fields("SensorErrors", _DEFAULTS, defaults=_DEFAULTS.values())):  # type: ignore[misc]
    """Keys of `[sensors]` and `[acoustics]` without their units, in SI units, by default those of
    the paper.

    Besides: `leader_tilt_sigma` [rad] and `leader_tilt_time` [s], standard deviation and
    correlation time of the leader's pitch and roll (0: each message has its own), and
    `leader_drift_east` and `leader_drift_north`, the rate at which its broadcast position departs
    from the true one [m/s]. No navigator has access to them.
    """


# the same as a record for compiled code
ERRORS = np.dtype(
    [
        (name, np.float64, np.shape(v)) if np.ndim(v) else (name, type(v))
        for name, v in _DEFAULTS.items()
    ]
)


def errors_of(scenario: Scenario, follower: int = 0) -> SensorErrors:
    """The true errors of a follower's and the leader's sensors."""
    return SensorErrors(**_values(scenario.sensors_of(follower), scenario.acoustics))


class Instant(NamedTuple):
    """What the sensors of a vehicle may read at an instant."""

    time: float  # [s]
    follower: int  # index of the follower
    pose: Any  # position [m] and quaternion (w, x, y, z), seven numbers
    twist: Any  # velocity in the world [m/s] and angular velocity in the body [rad/s], six numbers
    water: Any  # velocity of the water, three numbers [m/s]
    depth_sensor: Any  # its place in the hull, three numbers [m]
    # what accelerations add to measured pitch and roll [rad]; NaN: these are not measured
    tilt: tuple[float, float]


class Sensor(NamedTuple):
    """A sensor: what it would read without random errors and biases, and what it reads by that and
    its noise.

    `true(e, at)` takes the `SensorErrors` and an `Instant`, `read(e, true, drawn)` two numbers of
    its stream of noise. Ranges have no `true`: `sim.sensing.acoustics` gives these.
    """

    name: str  # of its reading
    column: int  # of its reading in READING, MESSAGE or `laisn.messages.Ranges`
    stream: int
    true: Any
    read: Any


def _sensor(name: str, stream: Stream, true: Any, read: Any) -> Sensor:
    own = (
        list(READING.fields or ()) if stream < Stream.LEADER_MOTION else list(LeaderMessage._fields)
    )
    columns = list(Ranges._fields) if stream == Stream.RANGE_UNIFORM else own
    return Sensor(
        name,
        columns.index(name),
        int(stream),
        DispatchedFormula(true) if true else None,
        DispatchedFormula(read),
    )


@jitable
def drift(e: Any, amplitude: float, phase: float, follower: int, time: float) -> float:
    """Sinusoidal drift of a bias of a follower, by its index, at a time [s]; in the unit of the
    amplitude.
    """
    if amplitude == 0.0:
        return 0.0
    return amplitude * math.sin(
        2.0 * math.pi / e.drift_period * time + (phase + follower * _GOLDEN)
    )


def _drifting_speed(e: Any, at: Instant) -> float:
    speed = speed_through_water(at.pose, at.twist, at.water)
    return speed + drift(e, e.speed_drift, e.speed_drift_phase, at.follower, at.time)  # type: ignore[no-any-return]


@formula
def read_speed(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Speed log of a follower, never negative (paper, Eq. 26); its scale ends at `FASTEST`
    [m/s].
    """
    return np.minimum(np.maximum(true + e.speed_bias + e.speed_sigma * drawn[0], 0.0), FASTEST)


def _drifting_heading(e: Any, at: Instant) -> float:
    return heading_of(at.pose[3:]) + drift(
        e, e.heading_drift, e.heading_drift_phase, at.follower, at.time
    )


@formula
def read_heading(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Compass of a follower; the random part adds to the bias, whatever its sign (paper, Eq. 27)
    [rad].
    """
    return true + e.heading_bias + e.heading_sigma * np.abs(drawn[1])


@formula
def read_depth(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Pressure sensor of a follower [m]."""
    return true + e.depth_sigma * drawn[0]


@formula
def read_leader_speed(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Speed log of the leader, as `read_speed` with a bias alone [m/s]."""
    return np.minimum(np.maximum(true + e.leader_speed_bias, 0.0), FASTEST)


@formula
def read_leader_heading(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Compass of the leader, as `read_heading` [rad]."""
    return true + e.leader_heading_bias + e.leader_heading_sigma * np.abs(drawn[1])


@formula
def read_leader_depth(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Pressure sensor of the leader, at its origin [m]."""
    return true + e.leader_depth_sigma * drawn[0]


@formula
def position_errs(e: Any) -> bool:
    """Whether the leader's broadcast position has random errors."""
    return bool(e.leader_position_sigma + e.leader_position_walk > 0.0)


@formula
def read_leader_position(e: Any, true: float, normal: float, walk: float) -> Any:
    """The leader's broadcast position along an axis [m], by a normal of the message and the sum of
    normals times √Δt since the start.
    """
    return true + e.leader_position_sigma * normal + e.leader_position_walk * walk


@formula
def read_leader_attitude(e: Any, true: float, drawn: tuple[float, float]) -> Any:
    """Pitch or roll of the leader [rad], by a normal that a run keeps and a Gauss–Markov value
    of unit variance.
    """
    return true + e.leader_attitude_offset_sigma * drawn[0] + e.leader_tilt_sigma * drawn[1]


OWN = (  # what a follower's navigator takes
    _sensor("speed", Stream.OWN_MOTION, _drifting_speed, read_speed),
    _sensor("heading", Stream.OWN_MOTION, _drifting_heading, read_heading),
    _sensor(
        "depth",
        Stream.DEPTH,
        lambda e, at: -body_point_in_world(at.pose, at.depth_sensor)[2],
        read_depth,
    ),
)
INSTRUMENTS = (  # besides, inclinometer and gyros, which only steer
    *OWN,
    _sensor(
        "pitch",
        Stream.TILT,
        lambda e, at: pitch_of(at.pose[3:]),
        lambda e, true, drawn: true + e.tilt_sigma * drawn[0],
    ),
    _sensor(
        "turning",
        Stream.GYRO,
        lambda e, at: at.twist[5],
        lambda e, true, drawn: true + e.gyro_sigma * drawn[0],
    ),
    _sensor(
        "pitching",
        Stream.GYRO,
        lambda e, at: at.twist[4],
        lambda e, true, drawn: true + e.gyro_sigma * drawn[1],
    ),
)
LEADER = (  # what a message holds beside time and place
    _sensor(
        "heading", Stream.LEADER_MOTION, lambda e, at: heading_of(at.pose[3:]), read_leader_heading
    ),
    _sensor(
        "speed",
        Stream.LEADER_MOTION,
        lambda e, at: speed_through_water(at.pose, at.twist, at.water),
        read_leader_speed,
    ),
    _sensor("depth", Stream.LEADER_DEPTH, lambda e, at: -at.pose[2], read_leader_depth),
)
LEADER_ATTITUDE = (
    _sensor(
        "pitch",
        Stream.LEADER_ATTITUDE,
        lambda e, at: pitch_of(at.pose[3:]) + at.tilt[0],
        read_leader_attitude,
    ),
    _sensor(
        "roll",
        Stream.LEADER_ATTITUDE,
        lambda e, at: roll_of(at.pose[3:]) + at.tilt[1],
        read_leader_attitude,
    ),
)


@formula
def longest_range(true: Any, transmitters: int) -> Any:
    """Longest of the ranges to the rear, front and, of three transmitters, middle one; 0 if none
    is received.
    """
    longest = 0.0
    longest = true[0] if true[0] > longest else longest
    longest = true[1] if true[1] > longest else longest
    return true[2] if transmitters > 2 and true[2] > longest else longest


@formula
def range_reading(
    e: Any, tau: float, true: tuple[float, float], drawn: tuple[float, float]
) -> float:
    """Range to a transmitter or NaN [m] (paper, Eq. 28) by the true and the longest one, a uniform
    and the normal of ψ.

    A receiver rejects zero, negative ranges and those beyond `FARTHEST`. ψ counts in proportion to
    the longest range to the N_T transmitters in use: 2 with LAISN-2 and 3 with LAISN-3 (Sections
    2.2 and 2.3). The middle one, which LAISN-2 has no use for, is scaled by the longest of all.
    """
    psi = e.range_scale_mean + e.range_scale_sigma * drawn[1]
    longest = true[1] + (true[1] == 0.0)
    reading = true[0] + tau * (drawn[0] - 0.5 * e.range_error_centred) + psi * (true[0] / longest)
    return reading if (reading > 0.0) & (reading <= FARTHEST) else math.nan


RANGES = (  # `true` is a range and the longest one, the noise a uniform and a normal
    _sensor(
        "rear",
        Stream.RANGE_UNIFORM,
        None,
        lambda e, true, drawn: range_reading(e, e.range_tau[0], true, drawn),
    ),
    _sensor(
        "front",
        Stream.RANGE_UNIFORM,
        None,
        lambda e, true, drawn: range_reading(e, e.range_tau[1], true, drawn),
    ),
    _sensor(
        "middle",
        Stream.RANGE_UNIFORM,
        None,
        lambda e, true, drawn: range_reading(e, e.range_tau[2], true, drawn),
    ),
)


@formula
def loses(e: Any) -> bool:
    """Whether a message is ever lost."""
    return bool(e.loss_probability + e.burst_probability > 0.0)


@formula
def is_bad(bad: bool, uniform: float, e: Any) -> bool:
    """Whether the next message meets the bad state, which is left with the inverse of its mean
    length.
    """
    return bool(uniform * e.burst_mean_messages >= 1.0 if bad else uniform < e.burst_probability)


@formula
def is_lost(bad: bool, uniform: float, e: Any) -> bool:
    """Whether a message in that state is lost."""
    return bool(uniform < (e.burst_loss_probability if bad else e.loss_probability))


@formula
def path_taken(uniform: float, e: Any) -> Any:
    """`Path` that the receiver takes for the direct one by a draw in (0, 1)."""
    surface = uniform < e.surface_echo_probability
    either = uniform < e.surface_echo_probability + e.bottom_echo_probability
    # 1 for the surface, 2 for the bottom: a draw below the first chance is below the sum of both
    return 2 * either - 1 * surface


@jitable
def paths_taken(e: Any, sent: Address) -> tuple[int, int, int]:
    """`Path` that a receiver takes for the direct one from the rear, front and middle transmitter.

    `sent` is the address of the noise at the filter step at which a message is sent.
    """
    if e.surface_echo_probability + e.bottom_echo_probability == 0.0:
        return 0, 0, 0
    drawn = uniforms_at(sent, _ECHO)
    rear = path_taken(drawn[0], e)
    if e.common_echoes:
        return rear, rear, rear
    return rear, path_taken(drawn[1], e), path_taken(drawn[2], e)


class FollowerState(NamedTuple):
    """True state of a follower at filter steps k = 1 … n."""

    time: Floats  # shape (n,), [s]
    position: Floats  # of the body origin in the world, shape (n, 3), [m]
    quaternion: Floats  # attitude from body to world, (w, x, y, z), shape (n, 4)
    velocity: Floats  # in the world, shape (n, 3), [m/s]
    angular_velocity: Floats  # in the body frame, shape (n, 3), [rad/s]
    water_velocity: Floats  # in the world, shape (n, 3), [m/s]
    hydrophone: Floats  # in the world, shape (n, 3), [m]
    # where received pings left, of rear, front, middle transmitter, shape (n, 3, 3), [m]; else NaN
    source: Floats


def follower_state(
    time: Floats, motion: tuple[Floats, Floats, Floats], *places: Floats
) -> FollowerState:
    """The state of poses, twists and velocities of the water, shapes (n, 7), (n, 6) and (n, 3),
    and two places.
    """
    pose, twist, water = motion
    return FollowerState(time, pose[:, :3], pose[:, 3:], twist[:, :3], twist[:, 3:], water, *places)


class CustomSensor(Protocol):
    """A sensor: a frozen dataclass whose fields are its parameters, keys of its table, in SI
    units and radians.
    """

    name: str  # of its readings in `Measurements.own`
    stream: int  # number of its noise, 16 … 63, for no other sensor
    acoustic: bool  # whether it reads pings, and nothing where all pings of a message are lost

    def true(self, state: FollowerState) -> Floats:
        """What it would read without errors, shape (n, c); NaN where it reads nothing."""

    def read(self, true: Floats, normals: Floats) -> Floats:
        """Its readings, shape (n, c), of true values and two standard normals a step, shape (n,
        2).
        """


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
        return np.column_stack(
            [np.arctan2(-port, forward), np.arctan2(up, np.hypot(forward, port))]
        )

    def read(self, true: Floats, normals: Floats) -> Floats:
        """Readings of true directions."""
        error = normals * (self.azimuth_sigma, self.elevation_sigma) + (self.azimuth_bias, 0.0)
        return np.asarray(true + error)


def own_tables(scenario: Scenario) -> tuple[Any, ...]:
    """Tables of a scenario's further sensors: its own, after the one that its navigator needs."""
    variant = scenario.navigation.variant
    given = scenario.sensors.own
    needed = NAVIGATORS[variant].sensor if variant in NAVIGATORS else ""
    there = not needed or any(table.sensor == needed for table in given)
    return given if there else (OwnSensorTable(sensor=needed), *given)


_OF_SENSORS = ("name", "stream", "acoustic", "true", "read")
"""What a class of sensors has; see docs/extending.md."""


def custom_readings(sensor: CustomSensor, true: Any, normals: Floats) -> Floats:
    """Readings of a further sensor at n filter steps, by two normals a step, shape (n, 2); a row a
    step. LaisnError if it gives something else.
    """
    kind = type(sensor).__name__
    with calling(f"sensor {kind}: read"):
        given = sensor.read(true, normals)
    try:
        readings: Floats = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        readings = np.empty(0)
    if readings.shape[:1] != normals.shape[:1]:
        raise LaisnError(
            f"sensor {kind}: `read` gave {given!r:.60}; expected numbers, a row for each of "
            f"{len(normals)} filter steps"
        )
    return readings


def own_sensors(scenario: Scenario) -> tuple[CustomSensor, ...]:
    """A scenario's further sensors; LaisnError if one cannot be found, or does not have a key of
    its table.
    """
    sensors = []
    for table in own_tables(scenario):
        made = (
            InvertedUsbl if table.sensor == "inverted-usbl" else find_class("sensor", table.sensor)
        )
        try:
            sensors.append(
                made(**in_si(table.model_extra or {}, getattr(made, "__dataclass_fields__", ())))
            )
        except TypeError as error:
            raise LaisnError(f"sensors.own: {table.sensor}: {error}") from None
        missing = [name for name in _OF_SENSORS if not hasattr(sensors[-1], name)]
        if missing:
            raise LaisnError(f"sensors.own: {table.sensor} has no {', '.join(missing)}")
    return tuple(sensors)

"""What followers' own sensors read at one instant, in compiled code: for followers that steer by it.

Formulas and noise are those of `observation` and `sensor_errors`, which make the measurements of a finished mission;
both give the same bits. `listening` does the same for what followers hear.
"""

from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, inlined
from sim.geometry.attitude import heading_of, pitch_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing import ahrs
from sim.sensing.drift import BiasDrift, biased
from sim.sensing.hearing import Hearing
from sim.sensing.loss import Channel
from sim.sensing.noise import STREAMS, Stream, two_normals, two_units, uniform, words
from sim.sensing.observation import errors_of
from sim.sensing.pings import Sound, site, sound_of
from sim.sensing.sensor_errors import heading_reading, plain_reading, speed_reading

_U = np.uint64
# compiled code holds numbers, not the members of an enum
_OWN_MOTION, _DEPTH, _GYRO, _TILT = (int(s) for s in (Stream.OWN_MOTION, Stream.DEPTH, Stream.GYRO, Stream.TILT))


_OWN_ERRORS = (
    "speed_bias",
    "speed_sigma",
    "heading_bias",
    "heading_sigma",
    "depth_sigma",
    "gyro_sigma",
    "tilt_sigma",
)
OWN_ERRORS = np.dtype([(name, np.float64) for name in (*_OWN_ERRORS, *BiasDrift._fields)])
"""Errors of one follower's own sensors: those of `SensorErrors`, of a rate of turn [rad/s], of the inclinometer [rad],
and `BiasDrift`."""


class Senses(NamedTuple):
    """Errors and hearing of a mission as compiled code takes them; names as in `SensorErrors` and `Hearing`."""

    seed: np.uint64
    run: np.uint64
    own: Any
    """Records of OWN_ERRORS, shape (f,)."""
    leader_speed: tuple[float, float]
    leader_heading: tuple[float, float]
    leader_depth_sigma: float
    leader_attitude: tuple[float, float, float]
    """Offset, pitch and roll [rad]."""
    leader_attitude_time: float
    """Correlation time of pitch and roll [s]."""
    broadcast_attitude: bool
    feels_acceleration: bool
    """The leader takes accelerations for tilt."""
    tilt_share: float
    """`ahrs.gain` of the leader."""
    range_tau: tuple[float, float, float]
    range_centre: float
    range_scale: tuple[float, float]
    echo_chance: tuple[float, float]
    common_echoes: bool
    channel: Channel
    loses: bool
    transmitters: int
    dt: float
    stride: int
    """Instants from one filter step to the next."""
    message_every: int
    """Filter steps from one message to the next."""
    sound: Sound
    leader_drift: tuple[float, float]
    """Rate at which the broadcast position departs from the true one, east and north [m/s]."""


def senses_of(scenario: Scenario) -> Senses:
    """Errors and hearing of a scenario as compiled code takes them."""
    errors, hearing, f = errors_of(scenario), Hearing.of(scenario), len(scenario.followers)
    own = np.zeros(f, dtype=OWN_ERRORS)
    for i in range(f):
        sensors, its = scenario.sensors_of(i), errors_of(scenario, i)
        gyro, tilt = np.deg2rad(sensors.gyro_sigma_deg_s), np.deg2rad(sensors.tilt_sigma_deg)
        own[i] = (*(getattr(its, name) for name in _OWN_ERRORS[:5]), gyro, tilt, *BiasDrift.of(sensors, i))
    return Senses(
        seed=_U(scenario.seed),
        run=_U(scenario.run),
        own=own.view(np.recarray),
        leader_speed=(errors.leader_speed_bias, errors.leader_speed_sigma),
        leader_heading=(float(errors.leader_heading_bias), float(errors.leader_heading_sigma)),
        leader_depth_sigma=errors.leader_depth_sigma,
        leader_attitude=(
            float(errors.leader_attitude_offset_sigma),
            float(errors.leader_pitch_sigma),
            float(errors.leader_roll_sigma),
        ),
        leader_attitude_time=errors.leader_attitude_time,
        broadcast_attitude=hearing.broadcast_attitude,
        feels_acceleration=hearing.broadcast_attitude and hearing.leader_attitude_feels_acceleration,
        tilt_share=ahrs.gain(hearing),
        range_tau=errors.range_tau,
        range_centre=errors.range_centre,
        range_scale=(errors.range_scale_mean, errors.range_scale_sigma),
        echo_chance=errors.echo_chance,
        common_echoes=errors.common_echoes,
        channel=errors.channel,
        loses=errors.channel.loses,
        transmitters=hearing.transmitters,
        dt=hearing.filter_step_s,
        stride=round(hearing.filter_step_s / CONTROL_STEP_S),
        message_every=hearing.message_every,
        sound=sound_of(hearing),
        leader_drift=hearing.leader_drift,
    )


@inlined
def drawn_normals(s: Senses, stream: int, k: int) -> tuple[float, float]:
    """Two normals of a stream at filter step k. Compiled code only."""
    w0, w1, w2, w3 = words(s.seed, s.run, _U(stream), _U(k))
    first, second = two_units(w0, w1, w2, w3)
    return two_normals(first, second)


@inlined
def drawn_uniforms(s: Senses, stream: int, k: int) -> tuple[float, float, float]:
    """Three uniforms of a stream at filter step k. Compiled code only."""
    w0, w1, w2, _ = words(s.seed, s.run, _U(stream), _U(k))
    return uniform(w0), uniform(w1), uniform(w2)


@compiled
def forward_speed(pose: Floats, twist: Floats, water: Floats) -> float:
    """Speed through the water along the hull [m/s], rounded as `Trajectory.forward_speed` does."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    east, north, up = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    along = east * (twist[0] - water[0])
    return float(along + north * (twist[1] - water[1]) + up * (twist[2] - water[2]))


@compiled
def read_own(
    s: Senses, k: int, follower: int, body: tuple[Floats, Floats, Floats], depth_sensor: Floats, reading: Floats
) -> None:
    """Read a follower's own sensors at filter step k.

    Args:
        s: errors.
        k: step, from 1.
        follower: index.
        body: pose, twist and water velocity, shapes (7,), (6,) and (3,).
        depth_sensor: its offset, shape (3,), [m].
        reading: out: log, compass, pressure, pitch, rates of turn about the up and the port axis.
    """
    pose, twist, water = body
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    streams, errors = STREAMS * follower, s.own[follower]
    first, second = drawn_normals(s, streams + _OWN_MOTION, k)
    speed, heading = forward_speed(pose, twist, water), heading_of(w, x, y, z)
    speed, heading = biased(errors, k * s.dt, speed, heading)
    reading[0] = speed_reading(speed, errors.speed_bias, errors.speed_sigma, first)
    reading[1] = heading_reading(heading, errors.heading_bias, errors.heading_sigma, second)
    third = drawn_normals(s, streams + _DEPTH, k)[0] if errors.depth_sigma > 0.0 else 0.0
    reading[2] = plain_reading(-site(pose, depth_sensor)[2], errors.depth_sigma, third)
    tilt, _ = drawn_normals(s, streams + _TILT, k)
    reading[3] = plain_reading(pitch_of(w, x, y, z), errors.tilt_sigma, tilt)
    turning, pitching = drawn_normals(s, streams + _GYRO, k)
    reading[4] = plain_reading(twist[5], errors.gyro_sigma, turning)
    reading[5] = plain_reading(twist[4], errors.gyro_sigma, pitching)

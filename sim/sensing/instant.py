"""What followers sense and hear at one instant, in compiled code: for followers that steer by it.

Formulas and noise are those of `observation`, `acoustics` and `sensor_errors`, which make the measurements of a
finished mission; at every instant both give the same bits. Sound takes no time here, and the leader's attitude has no
errors with a history: `Scenario.misfits` tells of missions that have.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, inlined
from sim.geometry.attitude import heading_of, pitch_of, roll_of
from sim.scenario.settings import Scenario
from sim.sensing.echo import path_taken
from sim.sensing.hearing import Hearing
from sim.sensing.loss import Channel, is_bad, is_lost
from sim.sensing.noise import STREAMS, Stream, two_normals, two_units, uniform, words
from sim.sensing.observation import errors_of
from sim.sensing.sensor_errors import (
    attitude_reading,
    heading_reading,
    longest,
    longest_used,
    plain_reading,
    range_reading,
    speed_reading,
)
from sim.sensing.wandering import Wandering, biased

_U = np.uint64
# compiled code holds numbers, not the members of an enum
_OWN_MOTION, _DEPTH, _GYRO, _TILT = (int(s) for s in (Stream.OWN_MOTION, Stream.DEPTH, Stream.GYRO, Stream.TILT))
_RANGE_UNIFORM, _RANGE_SCALE, _ECHO, _LOSS = (
    int(s) for s in (Stream.RANGE_UNIFORM, Stream.RANGE_SCALE, Stream.ECHO, Stream.LOSS)
)
_LEADER_MOTION, _LEADER_DEPTH, _LEADER_ATTITUDE = (
    int(s) for s in (Stream.LEADER_MOTION, Stream.LEADER_DEPTH, Stream.LEADER_ATTITUDE)
)
MESSAGE = 8
"""Columns of a message: those of `LeaderMessage` from timestamp to roll."""


class Senses(NamedTuple):
    """Errors and hearing of a mission as compiled code takes them; names as in `SensorErrors` and `Hearing`."""

    seed: np.uint64
    run: np.uint64
    speed: tuple[float, float]
    """Bias and standard deviation of the log [m/s]."""
    heading: tuple[float, float]
    """Bias and standard deviation of the compass [rad]."""
    depth_sigma: float
    gyro_sigma: float
    """Standard deviation of a rate of turn [rad/s]."""
    tilt_sigma: float
    """Standard deviation of the inclinometer [rad]."""
    leader_speed: tuple[float, float]
    leader_heading: tuple[float, float]
    leader_depth_sigma: float
    leader_attitude: tuple[float, float, float]
    """Offset, pitch and roll [rad]."""
    broadcast_attitude: bool
    range_tau: tuple[float, float, float]
    range_scale: tuple[float, float]
    echo_chance: tuple[float, float]
    channel: Channel
    loses: bool
    transmitters: int
    dt: float
    message_every: int
    floor: float
    max_range: float
    ratio: float
    """Range that is believed for a metre of path."""
    believed_speed: float
    """Speed of sound that is believed [m/s]."""
    clock_offset: float
    clock_drift: float
    """[s/s]."""
    wandering: Wandering


def senses_of(scenario: Scenario) -> Senses:
    """Errors and hearing of a scenario as compiled code takes them; it must have no misfits."""
    errors, hearing, sensors = errors_of(scenario), Hearing.of(scenario), scenario.sensors
    believed = hearing.sound_speed_m_s + hearing.sound_speed_bias_m_s
    return Senses(
        seed=_U(scenario.seed),
        run=_U(scenario.run),
        speed=(errors.speed_bias, errors.speed_sigma),
        heading=(float(errors.heading_bias), float(errors.heading_sigma)),
        depth_sigma=errors.depth_sigma,
        gyro_sigma=float(np.deg2rad(sensors.gyro_sigma_deg_s)),
        tilt_sigma=float(np.deg2rad(sensors.tilt_sigma_deg)),
        leader_speed=(errors.leader_speed_bias, errors.leader_speed_sigma),
        leader_heading=(float(errors.leader_heading_bias), float(errors.leader_heading_sigma)),
        leader_depth_sigma=errors.leader_depth_sigma,
        leader_attitude=(
            float(errors.leader_attitude_offset_sigma),
            float(errors.leader_pitch_sigma),
            float(errors.leader_roll_sigma),
        ),
        broadcast_attitude=hearing.broadcast_attitude,
        range_tau=errors.range_tau,
        range_scale=(errors.range_scale_mean, errors.range_scale_sigma),
        echo_chance=errors.echo_chance,
        channel=errors.channel,
        loses=errors.channel.loses,
        transmitters=hearing.transmitters,
        dt=hearing.filter_step_s,
        message_every=hearing.message_every,
        floor=hearing.floor_depth_m,
        max_range=hearing.max_range_m or np.inf,
        ratio=believed / hearing.sound_speed_m_s,
        believed_speed=believed,
        clock_offset=hearing.clock_offset_s,
        clock_drift=1e-6 * hearing.clock_drift_ppm,
        wandering=hearing.wandering,
    )


@inlined
def _normals(s: Senses, stream: int, k: int) -> tuple[float, float]:
    w0, w1, w2, w3 = words(s.seed, s.run, _U(stream), _U(k))
    first, second = two_units(w0, w1, w2, w3)
    return two_normals(first, second)


@inlined
def _uniforms(s: Senses, stream: int, k: int) -> tuple[float, float, float]:
    w0, w1, w2, _ = words(s.seed, s.run, _U(stream), _U(k))
    return uniform(w0), uniform(w1), uniform(w2)


@compiled
def site(pose: Floats, offset: Floats) -> tuple[float, float, float]:
    """Where a point of a hull is in the world [m], rounded as `Trajectory.site_position` does."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    east, north, up = pose[0], pose[1], pose[2]
    if offset[0] != 0.0:
        east += offset[0] * (1.0 - 2.0 * (yy + zz))
        north += offset[0] * (2.0 * (xy + wz))
        up += offset[0] * (2.0 * (xz - wy))
    if offset[1] != 0.0:
        east += offset[1] * (2.0 * (xy - wz))
        north += offset[1] * (1.0 - 2.0 * (xx + zz))
        up += offset[1] * (2.0 * (yz + wx))
    if offset[2] != 0.0:
        east += offset[2] * (2.0 * (xz + wy))
        north += offset[2] * (2.0 * (yz - wx))
        up += offset[2] * (1.0 - 2.0 * (xx + yy))
    return east, north, up


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
    streams = STREAMS * follower
    first, second = _normals(s, streams + _OWN_MOTION, k)
    speed, heading = forward_speed(pose, twist, water), heading_of(w, x, y, z)
    speed, heading = biased(s.wandering, follower, k * s.dt, speed, heading)
    reading[0] = speed_reading(speed, s.speed[0], s.speed[1], first)
    reading[1] = heading_reading(heading, s.heading[0], s.heading[1], second)
    third = _normals(s, streams + _DEPTH, k)[0] if s.depth_sigma > 0.0 else 0.0
    reading[2] = plain_reading(-site(pose, depth_sensor)[2], s.depth_sigma, third)
    tilt, _ = _normals(s, streams + _TILT, k)
    reading[3] = plain_reading(pitch_of(w, x, y, z), s.tilt_sigma, tilt)
    turning, pitching = _normals(s, streams + _GYRO, k)
    reading[4] = plain_reading(twist[5], s.gyro_sigma, turning)
    reading[5] = plain_reading(twist[4], s.gyro_sigma, pitching)


@compiled
def broadcast(s: Senses, k: int, body: tuple[Floats, Floats, Floats], message: Floats) -> None:
    """What the leader sends at filter step k.

    Args:
        s: errors.
        k: step, from 1.
        body: pose, twist and water velocity of the leader.
        message: out: columns of `LeaderMessage` from timestamp to roll, shape (MESSAGE,).
    """
    pose, twist, water = body
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    first, second = _normals(s, _LEADER_MOTION, k)
    deep, _ = _normals(s, _LEADER_DEPTH, k)
    message[0] = k * s.dt
    message[1] = pose[0] + s.wandering.leader[0] * message[0]
    message[2] = pose[1] + s.wandering.leader[1] * message[0]
    message[3] = heading_reading(heading_of(w, x, y, z), s.leader_heading[0], s.leader_heading[1], second)
    message[4] = speed_reading(forward_speed(pose, twist, water), s.leader_speed[0], s.leader_speed[1], first)
    message[5] = plain_reading(-pose[2], s.leader_depth_sigma, deep)
    message[6] = message[7] = np.nan
    if s.broadcast_attitude:
        offsets = _normals(s, _LEADER_ATTITUDE, 0)
        drawn = _normals(s, _LEADER_ATTITUDE, k)
        offset_sigma, pitch_sigma, roll_sigma = s.leader_attitude
        message[6] = attitude_reading(pitch_of(w, x, y, z), offset_sigma, offsets[0], pitch_sigma, drawn[0])
        message[7] = attitude_reading(roll_of(w, x, y, z), offset_sigma, offsets[1], roll_sigma, drawn[1])


@compiled
def hear(
    s: Senses, k: int, follower: int, sites: tuple[Floats, Floats], poses: Floats, bad: Floats, ranges: Floats
) -> bool:
    """Ranges of the message of step k to one follower.

    Args:
        s: errors.
        k: step, a multiple of `message_every`.
        follower: index; its vehicle is the one after.
        sites: offsets of the transmitters, shape (3, 3), and of the followers' hydrophones, shape (f, 3), [m].
        poses: of all vehicles, shape (v, 7) or more columns.
        bad: whether each follower's channel is in its bad state, shape (f,); brought forward.
        ranges: out: to rear, front and middle transmitter, shape (3,), [m]; NaN where nothing is received.

    Returns:
        Whether anything was received.
    """
    streams = STREAMS * follower
    there = site(poses[follower + 1], sites[1][follower])
    clock = s.believed_speed * (s.clock_offset + s.clock_drift * (k * s.dt))
    taken = _uniforms(s, streams + _ECHO, k)
    echoes = s.echo_chance[0] + s.echo_chance[1] > 0.0
    for i in range(3):
        east, north, up = site(poses[0], sites[0][i])
        x, y, z = east - there[0], north - there[1], up - there[2]
        direct = np.sqrt(x * x + y * y + z * z)
        length = direct
        if echoes:
            path = path_taken(taken[i], s.echo_chance[0], s.echo_chance[1])
            if path != 0:
                z = (-up if path == 1 else -2.0 * s.floor - up) - there[2]
                length = np.sqrt(x * x + y * y + z * z)
        ranges[i] = length * s.ratio + clock if direct <= s.max_range else np.nan
    rear, front, middle = ranges[0], ranges[1], ranges[2]
    far, farthest = longest_used(rear, front, middle, s.transmitters), longest(rear, front, middle)
    drawn = _uniforms(s, streams + _RANGE_UNIFORM, k)
    psi = plain_reading(s.range_scale[0], s.range_scale[1], _normals(s, streams + _RANGE_SCALE, k)[0])
    ranges[0] = range_reading(rear, far, s.range_tau[0], drawn[0], psi)
    ranges[1] = range_reading(front, far, s.range_tau[1], drawn[1], psi)
    ranges[2] = range_reading(middle, farthest, s.range_tau[2], drawn[2], psi)
    if s.loses:
        fate = _uniforms(s, streams + _LOSS, k)
        in_burst = is_bad(bad[follower] > 0.0, fate[0], s.channel)
        bad[follower] = 1.0 if in_burst else 0.0
        if is_lost(in_burst, fate[1], s.channel):
            ranges[:] = np.nan
    return bool(ranges[0] == ranges[0] or ranges[1] == ranges[1] or ranges[2] == ranges[2])

"""The sound of a message on its way to one follower, in compiled code: for followers that listen while they swim.

Paths, clocks and what arrives when are those of `acoustics`, which follows the sound of a finished mission.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.geometry.attitude import between
from sim.geometry.vectors import Vector
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing.acoustics import sound_speed
from sim.sensing.echo import Path
from sim.sensing.hearing import Hearing
from sim.trajectory import Truth
from sim.water.sound import Profile, mean_slowness, speed_at

_DIRECT, _SURFACE = int(Path.DIRECT), int(Path.SURFACE)
_ITERATIONS = 6
"""As in `acoustics`."""
_PATHS = len(Path)

Known = tuple[Truth, int]
"""Motion at all instants, and the last that is known."""


class Sound(NamedTuple):
    """What decides how sound gets to a follower; names as in `Hearing`."""

    on_grid: bool
    """All pings leave and arrive at an instant that is recorded."""
    travels: bool
    slot: float
    """From one ping of a message to the next [s]."""
    paths: tuple[bool, bool, bool]
    """Whether each path has a chance to be taken."""
    floor: float
    max_range: float
    profile: Profile
    varies: bool
    """Sound has another speed at another depth."""
    ratio: float
    """Range that is believed for a metre of path, where it has not."""
    believed_speed: float
    """Speed of sound that is believed [m/s]."""
    clock_offset: float
    clock_drift: float
    """[s/s]."""


def sound_of(hearing: Hearing) -> Sound:
    """Sound of a mission as compiled code takes it."""
    believed = hearing.sound_speed_m_s + hearing.sound_speed_bias_m_s
    return Sound(
        on_grid=not hearing.travel_time and hearing.ping_slot_s == 0,
        travels=hearing.travel_time,
        slot=float(hearing.ping_slot_s),
        paths=(True, Path.SURFACE in hearing.paths, Path.BOTTOM in hearing.paths),
        floor=float(hearing.floor_depth_m),
        max_range=float(hearing.max_range_m or np.inf),
        profile=sound_speed(hearing).profile,
        varies=bool(hearing.sound_speed_profile),
        ratio=believed / hearing.sound_speed_m_s,
        believed_speed=believed,
        clock_offset=float(hearing.clock_offset_s),
        clock_drift=1e-6 * hearing.clock_drift_ppm,
    )


@compiled
def _carried(place: Vector, quaternion: tuple[float, float, float, float], offset: Floats) -> Vector:
    """A body's origin moved to a site, rounded as `Trajectory.site_position` does."""
    w, x, y, z = quaternion
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    east, north, up = place
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
def site(pose: Floats, offset: Floats) -> Vector:
    """Where a point of a hull is in the world [m]; the pose is position and quaternion, shape (7,)."""
    return _carried((pose[0], pose[1], pose[2]), (pose[3], pose[4], pose[5], pose[6]), offset)


@compiled
def _site_between(known: Known, vehicle: int, offset: Floats, time: float) -> Vector:
    """A site at any time that is known, as `Trajectory.site_at`; at a later one, where it is last known [m]."""
    truth, last = known
    place = min(max(time / CONTROL_STEP_S, 0.0), float(last))
    i = min(int(place), last - 1)
    u = place - i
    one, other = truth.pose[i, vehicle], truth.pose[i + 1, vehicle]
    here, there = truth.twist[i, vehicle], truth.twist[i + 1, vehicle]
    a, b = 2.0 * u**3 - 3.0 * u**2 + 1.0, u**3 - 2.0 * u**2 + u
    c, d = 3.0 * u**2 - 2.0 * u**3, u**3 - u**2
    b, d = b * CONTROL_STEP_S, d * CONTROL_STEP_S
    origin = (
        a * one[0] + b * here[0] + c * other[0] + d * there[0],
        a * one[1] + b * here[1] + c * other[1] + d * there[1],
        a * one[2] + b * here[2] + c * other[2] + d * there[2],
    )
    return _carried(origin, between(one[3:7], other[3:7], u), offset)


@compiled
def _place(s: Sound, known: Known, vehicle: int, offset: Floats, time: float) -> Vector:
    if s.on_grid:
        return site(known[0].pose[round(time / CONTROL_STEP_S), vehicle], offset)
    return _site_between(known, vehicle, offset, time)


@compiled
def _distance(a: Vector, b: Vector) -> float:
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return float(np.sqrt(x * x + y * y + z * z))


@compiled
def _slowness(s: Sound, path: int, source: float, receiver: float) -> float:
    """Mean of 1/c along a path from one height to another, as `echo.mean_slowness` [s/m]."""
    if path == _DIRECT:
        return mean_slowness(s.profile, -source, -receiver)
    turn = 0.0 if path == _SURFACE else s.floor
    first, second = abs(-source - turn), abs(-receiver - turn)
    if first + second <= 0.0:
        return 1.0 / speed_at(s.profile, turn)
    legs = first * mean_slowness(s.profile, -source, turn) + second * mean_slowness(s.profile, -receiver, turn)
    return float(legs / (first + second))


@compiled
def follow(
    s: Sound,
    known: Known,
    sites: tuple[Floats, Floats],
    follower: int,
    sent: float,
    listened: int,
    ranges: Floats,
    arrivals: Floats,
) -> float:
    """Follow the sound of a message to one follower, as far as the motion is known.

    Args:
        s: how sound travels.
        known: the motion, at least two instants of it.
        sites: offsets of the transmitters, shape (3, 3), and of the followers' hydrophones, shape (f, 3), [m].
        follower: index; its vehicle is the one after.
        sent: time of the message [s].
        listened: number of transmitters that are waited for, rear and front first.
        ranges: out: range of each ping by each path before random errors, shape (3, 3), [m]; NaN for paths that are
            never taken, and for pings from out of range.
        arrivals: out: when each arrives, shape (3, 3), [s].

    Returns:
        The time by which all that are waited for are in [s]; right as soon as it is not later than what is known.
    """
    complete = sent
    for i in range(3):
        leaves, within = sent + s.slot * i, True
        transmitter = _place(s, known, 0, sites[0][i], leaves)
        there = _place(s, known, follower + 1, sites[1][follower], leaves)
        for path in range(_PATHS):
            ranges[i, path] = arrivals[i, path] = np.nan
            if not s.paths[path]:
                continue
            source = transmitter
            if path != _DIRECT:
                up = -transmitter[2] if path == _SURFACE else -2.0 * s.floor - transmitter[2]
                source = transmitter[0], transmitter[1], up
            arrival, at = leaves, there
            if s.travels:
                for _ in range(_ITERATIONS):
                    arrival = leaves + _distance(source, at) * _slowness(s, path, transmitter[2], at[2])
                    at = _place(s, known, follower + 1, sites[1][follower], arrival)
            length, ratio = _distance(source, at), s.ratio
            if s.varies:
                ratio = s.believed_speed * _slowness(s, path, transmitter[2], at[2])
            if path == _DIRECT:
                within = length <= s.max_range
            if within:
                ranges[i, path] = length * ratio + s.believed_speed * (s.clock_offset + s.clock_drift * arrival)
            arrivals[i, path] = arrival
            if i < listened:
                complete = max(complete, arrival)
    return complete

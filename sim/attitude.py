"""Attitude from quaternions (w, x, y, z), body (forward, port, up) to world (east, north, up),
vectors, and the map.

3-vectors and 3×3 matrices are tuples, which compiled code keeps in registers.
`scipy.spatial.transform.Rotation`, with which tests compare, takes two to seven times as long on a
flight's arrays, and 0.4 s to import.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import compiled, jitable

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Quaternion: TypeAlias = tuple[float, float, float, float] | Floats
"""Four numbers w, x, y, z, or arrays of them along the first axis."""
Pose: TypeAlias = tuple[float, float, float, float, float, float, float] | Floats
"""Position east, north, up [m] and quaternion, seven numbers."""
Twist: TypeAlias = tuple[float, float, float, float, float, float] | Floats
"""Velocity of the origin in the world [m/s] and rate of turn in the body [rad/s], six numbers."""


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def matvec(m: Matrix, a: Vector) -> Vector:
    return (
        m[0][0] * a[0] + m[0][1] * a[1] + m[0][2] * a[2],
        m[1][0] * a[0] + m[1][1] * a[1] + m[1][2] * a[2],
        m[2][0] * a[0] + m[2][1] * a[1] + m[2][2] * a[2],
    )


@compiled
def transposed(m: Matrix) -> Matrix:
    return (m[0][0], m[1][0], m[2][0]), (m[0][1], m[1][1], m[2][1]), (m[0][2], m[1][2], m[2][2])


@compiled
def plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def scaled(factor: float, a: Vector) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def rotation(quaternion: Quaternion) -> Matrix:
    """Rotation matrix, body to world, of a unit quaternion: four numbers or an array (w, x, y,
    z).
    """
    # R = I + 2 w [v]× + 2 [v]× [v]×, with q = (w, v)
    w = quaternion[0]
    x = quaternion[1]
    y = quaternion[2]
    z = quaternion[3]
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@jitable
def rotated(quaternion: Quaternion, vector: Vector | Floats) -> tuple[Any, Any, Any]:
    """A body vector in the world; four and three components, numbers or arrays."""
    w = quaternion[0]
    x = quaternion[1]
    y = quaternion[2]
    z = quaternion[3]
    a = vector[0]
    b = vector[1]
    c = vector[2]
    # v + w t + axis × t with t = 2 axis × v
    p = 2.0 * (y * c - z * b)
    q = 2.0 * (z * a - x * c)
    r = 2.0 * (x * b - y * a)
    return a + w * p + (y * r - z * q), b + w * q + (z * p - x * r), c + w * r + (x * q - y * p)


def rotate(quaternion: Floats, vector: Floats) -> Floats:
    """Turn body vectors into the world; shapes (…, 4) and (…, 3) broadcast."""
    return np.stack(rotated(np.moveaxis(quaternion, -1, 0), np.moveaxis(vector, -1, 0)), axis=-1)


@jitable
def forward_of(quaternion: Quaternion) -> tuple[Any, Any, Any]:
    """East, north and up of the forward axis; four components, numbers or arrays."""
    # the first column of R
    w = quaternion[0]
    x = quaternion[1]
    y = quaternion[2]
    z = quaternion[3]
    return 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)


@jitable
def heel_of(quaternion: Quaternion) -> Any:
    """Sine of the heel, the angle of the port axis above the level, positive starboard down; four
    components, numbers or arrays.
    """
    # up of the second column of R
    return 2.0 * (quaternion[2] * quaternion[3] + quaternion[0] * quaternion[1])


@jitable
def body_point_in_world(pose: Pose, offset: Vector | Floats) -> Any:
    """East, north, up of a point of a hull by its position and quaternion, and the point's
    `offset` in the body [m].
    """
    # p + R(q) offset, with the columns of R as in `rotation`
    w = pose[3]
    x = pose[4]
    y = pose[5]
    z = pose[6]
    xx = x * x
    yy = y * y
    zz = z * z
    xy = x * y
    xz = x * z
    yz = y * z
    wx = w * x
    wy = w * y
    wz = w * z
    east, north, up = pose[0], pose[1], pose[2]
    # most points lie on an axis or two of their hull; what adds nothing is not computed
    if offset[0] != 0.0:
        east = east + offset[0] * (1.0 - 2.0 * (yy + zz))
        north = north + offset[0] * (2.0 * (xy + wz))
        up = up + offset[0] * (2.0 * (xz - wy))
    if offset[1] != 0.0:
        east = east + offset[1] * (2.0 * (xy - wz))
        north = north + offset[1] * (1.0 - 2.0 * (xx + zz))
        up = up + offset[1] * (2.0 * (yz + wx))
    if offset[2] != 0.0:
        east = east + offset[2] * (2.0 * (xz + wy))
        north = north + offset[2] * (2.0 * (yz - wx))
        up = up + offset[2] * (1.0 - 2.0 * (xx + yy))
    return east, north, up


def from_euler(
    heading: npt.ArrayLike, pitch: npt.ArrayLike = 0.0, roll: npt.ArrayLike = 0.0
) -> Floats:
    """Quaternion of a hull turned to its compass heading, then pitched nose up, then rolled
    starboard down [rad].
    """
    heading, pitch, roll = (np.asarray(angle, dtype=np.float64) for angle in (heading, pitch, roll))
    # a rotation about +y (port) lowers the nose; yaw counts counter-clockwise from east
    y = (np.pi / 2 - heading) / 2
    p = -pitch / 2
    r = roll / 2
    cy = np.cos(y)
    sy = np.sin(y)
    cp = np.cos(p)
    sp = np.sin(p)
    cr = np.cos(r)
    sr = np.sin(r)
    # q = q_z(yaw) q_y(−pitch) q_x(roll)
    w = cy * cp * cr + sy * sp * sr
    x = cy * cp * sr - sy * sp * cr
    return np.stack([w, x, cy * sp * cr + sy * cp * sr, sy * cp * cr - cy * sp * sr], axis=-1)


@jitable
def heading_of(quaternion: Quaternion) -> float:
    """Compass heading of an attitude of four numbers in [0, 2π) [rad]."""
    w = quaternion[0]
    x = quaternion[1]
    y = quaternion[2]
    z = quaternion[3]
    # atan2(east, north) of the forward axis
    angle = math.atan2(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))
    return angle + 2.0 * math.pi if angle < 0.0 else angle


@jitable
def pitch_of(quaternion: Quaternion) -> float:
    """Pitch of an attitude of four numbers, positive nose up [rad]."""
    w = quaternion[0]
    x = quaternion[1]
    y = quaternion[2]
    z = quaternion[3]
    # asin(up) of the forward axis
    return math.asin(min(max(2.0 * (x * z - w * y), -1.0), 1.0))


@jitable
def roll_of(quaternion: Quaternion) -> float:
    """Roll of an attitude of four numbers, positive starboard down [rad]."""
    w = quaternion[0]
    x = quaternion[1]
    y = quaternion[2]
    z = quaternion[3]
    # atan2(R_zy, R_zz), of how far port and up axes point up
    return math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))


@compiled
def _angles(rows: Floats, angles: Floats) -> None:
    """Write heading, pitch and roll of attitudes, shape (n, 4), as rows of `angles`, shape (3, n):
    the same bits for one as for many, unlike NumPy's.
    """
    for k in range(rows.shape[0]):
        angles[0, k] = heading_of(rows[k])
        angles[1, k] = pitch_of(rows[k])
        angles[2, k] = roll_of(rows[k])


def heading_pitch_roll(quaternion: Floats) -> tuple[Floats, Floats, Floats]:
    """Compass heading in [0, 2π), pitch (nose up) and roll (starboard down), each of shape (…,),
    [rad].
    """
    rows = np.ascontiguousarray(quaternion, dtype=np.float64).reshape(-1, 4)
    angles = np.empty((3, len(rows)))
    _angles(rows, angles)
    heading, pitch, roll = angles.reshape(3, *quaternion.shape[:-1])
    return heading, pitch, roll


@compiled
def _headings(rows: Floats, headings: Floats) -> None:
    for k in range(rows.shape[0]):
        headings[k] = heading_of(rows[k])


@compiled
def _pitches(rows: Floats, pitches: Floats) -> None:
    for k in range(rows.shape[0]):
        pitches[k] = pitch_of(rows[k])


def _each_angle(write: Callable[[Floats, Floats], None], quaternion: Floats) -> Floats:
    """What a compiled function writes of attitudes of shape (…, 4): of shape (…,)."""
    rows = np.asarray(quaternion, dtype=np.float64).reshape(-1, 4)
    angles = np.empty(len(rows))
    write(rows, angles)
    return angles.reshape(quaternion.shape[:-1])


def heading_angles(quaternion: Floats) -> Floats:
    """Compass heading alone, of attitudes of shape (…, 4): in [0, 2π), of shape (…,), [rad]."""
    return _each_angle(_headings, quaternion)


def pitch_angles(quaternion: Floats) -> Floats:
    """Pitch alone, nose up, of attitudes of shape (…, 4): of shape (…,), [rad]."""
    return _each_angle(_pitches, quaternion)


@jitable
def _slerp_weight(fraction: float, angle: float) -> float:
    """sin(fraction angle) / sin(angle), which becomes the fraction where the angle is zero."""
    return math.sin(fraction * angle) / math.sin(angle) if angle != 0.0 else fraction


@jitable
def slerp(start: Quaternion, end: Quaternion, fraction: float) -> tuple[float, float, float, float]:
    """Spherical interpolation of two attitudes of four numbers; fraction in [0, 1]."""
    cosine = start[0] * end[0] + start[1] * end[1] + start[2] * end[2] + start[3] * end[3]
    angle = math.acos(min(abs(cosine), 1.0))
    a = _slerp_weight(1.0 - fraction, angle)
    b = math.copysign(_slerp_weight(fraction, angle), cosine)
    # q = (sin((1 − s) θ) q_0 ± sin(s θ) q_1) / sin θ with cos θ = |q_0 · q_1|, of length 1 again
    w = a * start[0] + b * end[0]
    x = a * start[1] + b * end[1]
    y, z = a * start[2] + b * end[2], a * start[3] + b * end[3]
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size


SEMI_MAJOR_AXIS = 6378137.0  # semi-major axis of the WGS 84 ellipsoid [m]
FLATTENING = 1 / 298.257223563  # flattening of the WGS 84 ellipsoid


class MetresPerDegree(NamedTuple):
    """Arcs of a degree at a latitude on the ellipsoid."""

    east: float  # of longitude [m]
    north: float  # of latitude [m]


def metres_per_degree(latitude_deg: float) -> MetresPerDegree:
    """Arcs along parallel and meridian, by their radii of curvature (WGS 84; NIMA TR8350.2)."""
    radii = _radii(latitude_deg)
    return MetresPerDegree(float(np.deg2rad(radii[0])), float(np.deg2rad(radii[1])))


def _radii(latitude_deg: float) -> tuple[float, float]:
    """Radius of the parallel, and of curvature of the meridian [m]."""
    eccentricity_squared = FLATTENING * (2 - FLATTENING)
    latitude = np.deg2rad(latitude_deg)
    w = np.sqrt(1 - eccentricity_squared * np.sin(latitude) ** 2)
    meridian = SEMI_MAJOR_AXIS * (1 - eccentricity_squared) / w**3
    return SEMI_MAJOR_AXIS / w * np.cos(latitude), meridian


def geodetic(position: Floats, latitude_deg: float, longitude_deg: float) -> Floats:
    """Latitude, longitude [deg] and height [m] of positions about the scenario's origin on the map,
    shape (n, 3).

    East and north are arcs along the parallel and the meridian of the origin, with the radii of
    curvature there (WGS 84; NIMA TR8350.2); heights are kept, as the simulated sea is flat. A
    kilometre from the origin at 60° N this is off by 0.16 m.
    """
    parallel, meridian = _radii(latitude_deg)
    east, north, up = position.T
    longitude = longitude_deg + np.rad2deg(east / parallel)
    return np.column_stack(
        [latitude_deg + np.rad2deg(north / meridian), (longitude + 180) % 360 - 180, up]
    )

"""Attitude from quaternions (w, x, y, z), body (forward, port, up) to world (east, north, up)."""

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats


def _parts(quaternion: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    return quaternion[..., 0], quaternion[..., 1], quaternion[..., 2], quaternion[..., 3]


def rotate(quaternion: Floats, vector: Floats) -> Floats:
    """Turn body vectors into the world; shapes (…, 4) and (…, 3) broadcast."""
    w, x, y, z = _parts(quaternion)
    a, b, c = vector[..., 0], vector[..., 1], vector[..., 2]
    # v + w t + axis × t with t = 2 axis × v, by components: on long arrays, np.cross costs several times as much
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    out = np.empty((*np.shape(p), 3))
    out[..., 0] = a + w * p + (y * r - z * q)
    out[..., 1] = b + w * q + (z * p - x * r)
    out[..., 2] = c + w * r + (x * q - y * p)
    return out


def axes(quaternion: Floats) -> Floats:
    """The hull's axes (forward, port, up) in the world: shape (3, 3, …), axis first, then its east, north and up."""
    w, x, y, z = (np.ascontiguousarray(part) for part in _parts(quaternion))
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    return np.array(
        [
            [1.0 - 2.0 * (yy + zz), 2.0 * (xy + wz), 2.0 * (xz - wy)],
            [2.0 * (xy - wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz + wx)],
            [2.0 * (xz + wy), 2.0 * (yz - wx), 1.0 - 2.0 * (xx + yy)],
        ]
    )


def forward(quaternion: Floats) -> tuple[Floats, Floats, Floats]:
    """East, north and up of the forward axis alone, each of shape (…,)."""
    w, x, y, z = _parts(quaternion)
    return 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)


def from_euler(heading: npt.ArrayLike, pitch: npt.ArrayLike = 0.0, roll: npt.ArrayLike = 0.0) -> Floats:
    """Quaternion of compass heading, pitch (nose up) and roll (starboard down), shape (…, 4); angles in [rad].

    The hull is turned to its heading, then pitched, then rolled about its own axes.
    """
    heading, pitch, roll = (np.asarray(angle, dtype=np.float64) for angle in (heading, pitch, roll))
    # a rotation about +y (port) lowers the nose; yaw counts counter-clockwise from east
    y, p, r = (np.pi / 2 - heading) / 2, -pitch / 2, roll / 2
    cy, sy, cp, sp, cr, sr = np.cos(y), np.sin(y), np.cos(p), np.sin(p), np.cos(r), np.sin(r)
    return np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ],
        axis=-1,
    )


def heading(quaternion: Floats) -> Floats:
    """Compass heading in [0, 2π), shape (…,), [rad]."""
    east, north, _ = forward(quaternion)
    angle = np.arctan2(east, north)
    return np.asarray(angle + 2 * np.pi * (angle < 0.0))


def pitch(quaternion: Floats) -> Floats:
    """Pitch, positive nose up, shape (…,), [rad]."""
    return np.asarray(np.arcsin(np.clip(forward(quaternion)[2], -1.0, 1.0)))


def roll(quaternion: Floats) -> Floats:
    """Roll, positive starboard down, shape (…,), [rad]."""
    w, x, y, z = _parts(quaternion)
    return np.asarray(np.arctan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)))


def slerp(start: Floats, end: Floats, fraction: Floats) -> Floats:
    """Spherical interpolation; quaternions of shape (…, 4), fraction in [0, 1] of shape (…,)."""
    cosine = np.einsum("...i,...i->...", start, end)
    end = np.where(cosine[..., None] < 0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    # sin(u a) / sin(a) → u for small a; sinc avoids the division by zero
    scale = np.sinc(angle / np.pi)
    a = (1 - fraction) * np.sinc((1 - fraction) * angle / np.pi) / scale
    b = fraction * np.sinc(fraction * angle / np.pi) / scale
    mixed = a[..., None] * start + b[..., None] * end
    return np.asarray(mixed / np.linalg.norm(mixed, axis=-1, keepdims=True))

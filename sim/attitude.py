"""Attitude from quaternions (w, x, y, z), body (forward, port, up) to world (east, north, up)."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def rotate(quaternion: Floats, vector: Floats) -> Floats:
    """Turn body vectors into the world; shapes (…, 4) and (…, 3) broadcast."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    axis, vector = np.broadcast_arrays(axis, vector)
    twice = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + w * twice + np.cross(axis, twice))


def from_euler(heading: npt.ArrayLike, pitch: npt.ArrayLike = 0.0, roll: npt.ArrayLike = 0.0) -> Floats:
    """Quaternion of compass heading, pitch (nose up) and roll (starboard down), shape (…, 4); angles in [rad].

    The hull is turned to its heading, then pitched, then rolled about its own axes.
    """
    heading, pitch, roll = np.broadcast_arrays(
        np.asarray(heading, dtype=np.float64), np.asarray(pitch, float), np.asarray(roll, float)
    )
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
    forward = rotate(quaternion, np.array([1.0, 0.0, 0.0]))
    return np.asarray(np.arctan2(forward[..., 0], forward[..., 1]) % (2 * np.pi))


def pitch(quaternion: Floats) -> Floats:
    """Pitch, positive nose up, shape (…,), [rad]."""
    forward = rotate(quaternion, np.array([1.0, 0.0, 0.0]))
    return np.asarray(np.arcsin(np.clip(forward[..., 2], -1.0, 1.0)))


def roll(quaternion: Floats) -> Floats:
    """Roll, positive starboard down, shape (…,), [rad]."""
    port = rotate(quaternion, np.array([0.0, 1.0, 0.0]))
    up = rotate(quaternion, np.array([0.0, 0.0, 1.0]))
    return np.asarray(np.arctan2(port[..., 2], up[..., 2]))


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

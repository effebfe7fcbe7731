"""Speed of sound over depth, and how long sound takes along straight rays.

A ray that is straight and not level spends equal times at equal depth steps, so that its mean slowness is the mean of
1/c over the depths it crosses (Medwin & Clay, Fundamentals of Acoustical Oceanography, 1998: ray
bending is neglected, which over 100 m and usual gradients of 0.1 /s changes a path by less than a millimetre).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.failure import LaisnError
from laisn.records import own_arrays

_LEVEL_M = 1e-3
"""Depth steps below this have the slowness of their middle: the quotient of two small differences would round."""


@dataclass(frozen=True, kw_only=True)
class SoundSpeed:
    """Speed of sound, linear between depths and constant above the first and below the last.

    Raises LaisnError if shapes disagree, depths do not increase or a speed is not positive.
    """

    depth: Floats
    """Depths of the profile, shape (n,), increasing from 0 or more, [m]."""
    speed: Floats
    """Speed of sound at each depth, shape (n,), [m/s]."""

    def __post_init__(self) -> None:
        if self.depth.ndim != 1 or self.depth.size < 1 or self.depth.shape != self.speed.shape:
            raise LaisnError(f"a profile needs as many depths as speeds, got {self.depth.shape} and {self.speed.shape}")
        if self.depth[0] < 0 or np.any(np.diff(self.depth) <= 0):
            raise LaisnError(f"depths of a sound-speed profile must increase, got {self.depth.tolist()} m")
        if not (np.all(np.isfinite(self.speed)) and self.speed.min() > 0):
            raise LaisnError(f"speeds of sound must be positive, got {self.speed.tolist()} m/s")
        own_arrays(self)

    @classmethod
    def constant(cls, speed: float) -> Self:
        """One speed at all depths [m/s]."""
        return cls(depth=np.zeros(1), speed=np.array([float(speed)]))

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, speed], …], shape (n, 2), [m] and [m/s]."""
        table = np.array(points, dtype=np.float64)
        if table.ndim != 2 or table.shape[1] != 2:
            raise LaisnError(f"a sound-speed profile needs points of shape (n, 2), got {table.shape}")
        return cls(depth=table[:, 0].copy(), speed=table[:, 1].copy())

    def at(self, depth: npt.ArrayLike) -> Floats:
        """Speed at depths of any shape, [m/s]."""
        return np.asarray(np.interp(np.asarray(depth, dtype=np.float64), self.depth, self.speed))

    @cached_property
    def _crossing(self) -> Floats:
        """Time to cross vertically from the first depth to each, shape (n,), [s]."""
        growth = np.diff(self.speed) / self.speed[:-1]
        # ∫ dz / c over a linear segment is Δz ln(c₂/c₁) / (c₂ − c₁)
        factor = np.divide(np.log1p(growth), growth, out=np.ones_like(growth), where=growth != 0)
        return np.concatenate([[0.0], np.cumsum(np.diff(self.depth) / self.speed[:-1] * factor)])

    def vertical_time(self, depth: npt.ArrayLike) -> Floats:
        """Time of a vertical ray from the first depth of the profile down to depths of any shape, [s]."""
        depth = np.asarray(depth, dtype=np.float64)
        i = np.clip(np.searchsorted(self.depth, depth, side="right") - 1, 0, self.depth.size - 1)
        step = depth - self.depth[i]
        growth = (self.at(depth) - self.speed[i]) / self.speed[i]
        factor = np.divide(np.log1p(growth), growth, out=np.ones_like(growth), where=growth != 0)
        return np.asarray(self._crossing[i] + step / self.speed[i] * factor)

    def mean_slowness(self, upper: npt.ArrayLike, lower: npt.ArrayLike) -> Floats:
        """Mean of 1/c between two depths, in either order; shapes broadcast, [s/m]."""
        upper, lower = np.broadcast_arrays(np.asarray(upper, dtype=np.float64), np.asarray(lower, dtype=np.float64))
        span = lower - upper
        level = np.abs(span) < _LEVEL_M
        mean = (self.vertical_time(lower) - self.vertical_time(upper)) / np.where(level, 1.0, span)
        return np.where(level, 1.0 / self.at((upper + lower) / 2), mean)

    @property
    def profile(self) -> "Profile":
        """The same as compiled code takes it."""
        return Profile(self.depth, self.speed, self._crossing)


class Profile(NamedTuple):
    """A `SoundSpeed` in compiled code; arrays of shape (n,)."""

    depth: Floats
    """[m]."""
    speed: Floats
    """[m/s]."""
    crossing: Floats
    """Time to cross vertically from the first depth to each [s]."""


@compiled
def _above(p: Profile, depth: float) -> int:
    """The last depth of the profile that is not below another one; the first, if that is."""
    i = 0
    while i < p.depth.size - 1 and p.depth[i + 1] <= depth:
        i += 1
    return i


@compiled
def speed_at(p: Profile, depth: float) -> float:
    """Speed of sound at a depth [m/s]."""
    i = _above(p, depth)
    if depth <= p.depth[0] or i == p.depth.size - 1:
        return float(p.speed[i])
    share = (depth - p.depth[i]) / (p.depth[i + 1] - p.depth[i])
    return float(p.speed[i] + share * (p.speed[i + 1] - p.speed[i]))


@compiled
def _vertical_time(p: Profile, depth: float) -> float:
    """As `SoundSpeed.vertical_time`."""
    i = _above(p, depth)
    growth = (speed_at(p, depth) - p.speed[i]) / p.speed[i]
    factor = np.log1p(growth) / growth if growth != 0.0 else 1.0
    return float(p.crossing[i] + (depth - p.depth[i]) / p.speed[i] * factor)


@compiled
def mean_slowness(p: Profile, upper: float, lower: float) -> float:
    """Mean of 1/c between two depths, in either order [s/m]; as `SoundSpeed.mean_slowness`."""
    span = lower - upper
    if abs(span) < _LEVEL_M:
        return 1.0 / speed_at(p, 0.5 * (upper + lower))
    return (_vertical_time(p, lower) - _vertical_time(p, upper)) / span

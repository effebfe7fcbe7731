"""Speed of sound over depth, and how long sound takes along straight rays.

A ray that is straight and not level spends equal times at equal depth steps, so that its mean slowness is the mean of
1/c over the depths it crosses (Medwin & Clay, Fundamentals of Acoustical Oceanography, 1998: ray
bending is neglected, which over 100 m and usual gradients of 0.1 /s changes a path by less than a millimetre).
"""

from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import elementwise, select

_LEVEL_M = 1e-3
"""Depth steps below this have the slowness of their middle: the quotient of two small differences would round."""


class SoundProfile(NamedTuple):
    """Speed of sound, linear between n depths and constant above the first and below the last."""

    depth: Floats
    """Shape (n,), increasing, [m]."""
    speed: Floats
    """Speed of sound at each depth, shape (n,), [m/s]."""
    crossing: Floats
    """Time to cross vertically from the first depth to each, shape (n,), [s]."""

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, speed], …], shape (n, 2), [m] and [m/s]; one point is a constant speed."""
        depth, speed = np.array(points, dtype=np.float64).T.copy()
        layers = np.diff(depth) / speed[:-1] * _delay(np.diff(speed) / speed[:-1])
        return cls(depth, speed, np.concatenate([[0.0], np.cumsum(layers)]))


@elementwise
def _delay(growth: Any) -> Any:
    """ln(1 + g) / g: time through a layer whose speed grows by a share g, in that at its first speed."""
    constant = growth == 0.0
    return np.log1p(growth) / (growth + constant) + constant


@elementwise
def _layer(p: SoundProfile, depth: Any) -> Any:
    """Index of the last depth of the profile that is not below another one; 0, if that is above all."""
    i = 0
    for j in range(1, p.depth.size):
        i = i + (p.depth[j] <= depth)
    return i


@elementwise
def speed_at(p: SoundProfile, depth: Any) -> Any:
    """Speed of sound at a depth [m/s]."""
    i = _layer(p, depth)
    j = np.minimum(i + 1, p.depth.size - 1)
    step = p.depth[j] - p.depth[i]
    share = np.maximum(depth - p.depth[i], 0.0) / (step + (step == 0.0))
    return p.speed[i] + share * (p.speed[j] - p.speed[i])


@elementwise
def _vertical_time(p: SoundProfile, depth: Any) -> Any:
    """Time of a vertical ray from the first depth of the profile down to another one [s]."""
    i = _layer(p, depth)
    growth = (speed_at(p, depth) - p.speed[i]) / p.speed[i]
    return p.crossing[i] + (depth - p.depth[i]) / p.speed[i] * _delay(growth)


@elementwise
def mean_slowness(p: SoundProfile, upper: Any, lower: Any) -> Any:
    """Mean of 1/c between two depths, in either order [s/m]."""
    span = lower - upper
    level = np.abs(span) < _LEVEL_M
    mean = (_vertical_time(p, lower) - _vertical_time(p, upper)) / (span + level)
    return select(level, 1.0 / speed_at(p, 0.5 * (upper + lower)), mean)

"""A speed of sound whose gradient has no jumps, as rays that bend need it.

A jump of the gradient makes false shadows and false strong arrivals. The speed is a monotone cubic
between the given depths (Fritsch & Butland, SIAM Journal on Scientific and Statistical Computing
5, 1984). Beyond the first and the last of them the gradient fades to nothing within a few metres.
"""

from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import compiled, jitable

_FADE_M = 5.0  # in which the gradient fades beyond the given depths
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
# nodes and weights of Gauss and Legendre on 0 … 1
_QUADRATURE = tuple(
    (0.5 * (node + 1.0), 0.5 * weight) for node, weight in zip(_NODES, _WEIGHTS, strict=True)
)
# smaller depth steps have the slowness of their middle: quotients of small differences round [m]
_MIN_DEPTH_STEP_M = 1e-3


class SmoothProfile(NamedTuple):
    """Speed of sound by depth, cubic between n depths, constant above the first and below the
    last.
    """

    depth: Floats  # shape (n,), increasing, [m]
    # speed, gradient, and coefficients of square and cube below each depth, shape (n, 4)
    cubic: Floats
    crossing: Floats  # time to cross vertically from the first depth to each, shape (n,), [s]
    slowest: float  # [m/s]
    fastest: float  # [m/s]

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, speed], …], shape (n, 2), [m] and [m/s]; one point is a constant
        speed.
        """
        pairs = np.array(points, dtype=np.float64)
        depth = pairs[:, 0]
        speed = pairs[:, 1]
        slope = _slopes(depth, speed)
        first = (depth[0] - _FADE_M, speed[0] - 0.5 * _FADE_M * slope[0], 0.0)
        last = (depth[-1] + _FADE_M, speed[-1] + 0.5 * _FADE_M * slope[-1], 0.0)
        knots = np.vstack([first, np.column_stack([depth, speed, slope]), last])
        cubic = _coefficients(knots)
        crossing = np.zeros(len(knots))
        profile = cls(
            np.ascontiguousarray(knots[:, 0]),
            cubic,
            crossing,
            float(knots[:, 1].min()),
            float(knots[:, 1].max()),
        )
        for i in range(1, len(knots)):
            crossing[i] = crossing[i - 1] + _time_within(profile, i - 1, float(knots[i, 0]))
        return profile


def _end_slope(widths: Floats, secants: Floats) -> float:
    """Gradient at the outermost of three depths [1/s], that of a parabola as far as the speed stays
    monotone, by widths [m] and mean gradients [1/s] of the layers from there on.
    """
    slope = ((2.0 * widths[0] + widths[1]) * secants[0] - widths[0] * secants[1]) / widths[:2].sum()
    if np.sign(slope) != np.sign(secants[0]):
        return 0.0
    if np.sign(secants[0]) != np.sign(secants[1]) and abs(slope) > 3.0 * abs(secants[0]):
        return float(3.0 * secants[0])
    return float(slope)


def _slopes(depth: Floats, speed: Floats) -> Floats:
    """Gradients at the points that keep the cubic between them monotone: harmonic means."""
    if depth.size == 1:
        return np.zeros(1)
    width = np.diff(depth)
    secant = np.diff(speed) / width
    if depth.size == 2:
        return np.full(2, secant[0])
    weight_before = 2.0 * width[1:] + width[:-1]
    weight_after = width[1:] + 2.0 * width[:-1]
    slopes = np.zeros(depth.size)
    is_monotonic = secant[1:] * secant[:-1] > 0.0
    weights = (
        weight_before[is_monotonic] / secant[:-1][is_monotonic]
        + weight_after[is_monotonic] / secant[1:][is_monotonic]
    )
    slopes[1:-1][is_monotonic] = (weight_before + weight_after)[is_monotonic] / weights
    slopes[0] = _end_slope(width, secant)
    slopes[-1] = _end_slope(width[::-1], secant[::-1])
    return slopes


def _coefficients(knots: Floats) -> Floats:
    """Cubics of Hermite by rows of depth, speed and gradient; the last one is a constant."""
    depth, speed, slope = knots.T
    width = np.diff(depth)
    secant = np.diff(speed) / width
    cubic = np.zeros((len(knots), 4))
    cubic[:, 0] = speed
    cubic[:, 1] = slope
    cubic[:-1, 2] = (3.0 * secant - 2.0 * slope[:-1] - slope[1:]) / width
    cubic[:-1, 3] = (slope[:-1] + slope[1:] - 2.0 * secant) / width**2
    return cubic


@jitable
def interval_of(p: SmoothProfile, depth: float, index: int) -> int:
    """Index of the last depth of the profile that is not below another one; 0, if that is above
    all. `index` is tried first: the answer for a depth nearby, or 0.
    """
    if p.depth[index] <= depth and (index + 1 == p.depth.size or depth < p.depth[index + 1]):
        return index
    low = 0
    high = p.depth.size
    while high - low > 1:
        middle = (low + high) // 2
        if p.depth[middle] <= depth:
            low = middle
        else:
            high = middle
    return low


@jitable
def speed_and_gradient(p: SmoothProfile, depth: float, index: int) -> tuple[float, float, int]:
    """Speed of sound at a depth [m/s], its gradient [1/s], and the index of the interval; for
    `index` see `interval_of`.
    """
    i = interval_of(p, depth, index)
    x = max(depth - p.depth[i], 0.0)
    if depth < p.depth[0]:
        return p.cubic[0, 0], 0.0, 0
    second = p.cubic[i, 2]
    third = p.cubic[i, 3]
    speed = p.cubic[i, 0] + x * (p.cubic[i, 1] + x * (second + x * third))
    return speed, p.cubic[i, 1] + x * (2.0 * second + 3.0 * x * third), i


@jitable
def _time_within(p: SmoothProfile, i: int, depth: float) -> float:
    """Time of a vertical ray from the depth of an interval to one in it [s]."""
    width = depth - p.depth[i]
    time = 0.0
    for node, weight in _QUADRATURE:
        x = node * width
        speed = p.cubic[i, 0] + x * (p.cubic[i, 1] + x * (p.cubic[i, 2] + x * p.cubic[i, 3]))
        time += weight / speed
    return float(time * width)


@jitable
def vertical_time(p: SmoothProfile, depth: float) -> float:
    """Time of a vertical ray from the first depth of the profile down to another one [s]."""
    i = interval_of(p, depth, 0)
    if depth < p.depth[0]:
        return float((depth - p.depth[0]) / p.cubic[0, 0])
    return float(p.crossing[i] + _time_within(p, i, depth))


@compiled
def mean_slowness(p: SmoothProfile, upper: float, lower: float) -> float:
    """Mean of 1/c between two depths, in either order [s/m]."""
    if abs(lower - upper) < _MIN_DEPTH_STEP_M:
        return 1.0 / speed_and_gradient(p, 0.5 * (upper + lower), 0)[0]
    return (vertical_time(p, lower) - vertical_time(p, upper)) / (lower - upper)

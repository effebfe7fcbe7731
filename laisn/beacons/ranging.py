"""One range to one beacon: what a component expects of it, and what it teaches.

The range is z = (1 + g) |p − L_i − δ_i| + d_i with the beacon's surveyed place L_i.
"""

import math
from typing import NamedTuple

from laisn.beacons.belief import OWN, SCALE, SHARED, Belief, X, Y
from laisn.compiled import compiled

_SHORTEST = 0.1
"""Nearer to a beacon than this the direction to it means nothing [m]."""
_LEARNING = 0.02
"""Share of a range in the learnt variance of its beacon."""
_LARGEST = 16.0
"""A range adds to that at most so many times the variance."""
_LEAST, _MOST = 0.25, 16.0
"""Bounds of the learnt variance, as multiples of the settings'."""


class Ranging(NamedTuple):
    """A range as compiled code takes it."""

    beacon: int
    """Which beacon, from 0."""
    east: float
    """Its surveyed place [m]."""
    north: float
    deeper: float
    """How much deeper it is than the receiver [m]."""
    range: float
    """Measured, along the line of sight [m]."""
    variance: float
    """Variance of the settings' random error [m²]."""
    accepted: float
    """Logarithm of the chance that the range is right."""
    wrong: float
    """Logarithm of the probability density of a range that is wrong [1/m]."""


@compiled
def look(b: Belief, k: int, z: Ranging) -> tuple[float, float, float]:
    """What component k expects of a range; P Hᵀ goes into `b.gain`.

    Second-order terms follow Bar-Shalom, Li & Kirubarajan 2001, Section 10.3.2: ½ tr(F C) in the mean and
    ½ tr((F C)²) in the variance, with the range's second derivatives F and the covariance C of p − δ.

    Returns:
        Residual [m]; its variance without the random error [m²]; and half the curvature along the tangent times the
        variance there [m], by which the circle bends away from its tangent.
    """
    x, P, n = b.state[k], b.covariance[k], b.fresh.size
    own = SHARED + OWN * z.beacon
    dx, dy = x[X] - z.east - x[own + 1], x[Y] - z.north - x[own + 2]
    distance = max(math.sqrt(dx * dx + dy * dy + z.deeper * z.deeper), _SHORTEST)
    flat = max(math.sqrt(dx * dx + dy * dy), _SHORTEST)
    scale = 1.0 + x[SCALE]
    hx, hy = scale * dx / distance, scale * dy / distance
    for j in range(n):
        b.gain[j] = hx * (P[j, X] - P[j, own + 1]) + hy * (P[j, Y] - P[j, own + 2]) + distance * P[j, SCALE] + P[j, own]
    gain = b.gain
    variance = hx * (gain[X] - gain[own + 1]) + hy * (gain[Y] - gain[own + 2]) + distance * gain[SCALE] + gain[own]
    cxx = P[X, X] - 2.0 * P[X, own + 1] + P[own + 1, own + 1]
    cyy = P[Y, Y] - 2.0 * P[Y, own + 2] + P[own + 2, own + 2]
    cxy = P[X, Y] - P[X, own + 2] - P[own + 1, Y] + P[own + 1, own + 2]
    per = scale / distance
    fxx, fyy = per * (1.0 - dx * dx / distance**2), per * (1.0 - dy * dy / distance**2)
    fxy = -per * dx * dy / distance**2
    axx, axy = fxx * cxx + fxy * cxy, fxx * cxy + fxy * cyy
    ayx, ayy = fxy * cxx + fyy * cxy, fxy * cxy + fyy * cyy
    second = 0.5 * (axx * axx + 2.0 * axy * ayx + ayy * ayy)
    residual = z.range - scale * distance - x[own] - 0.5 * (axx + ayy)
    tx, ty = -dy / flat, dx / flat
    bend = 0.5 * (tx * tx * cxx + 2.0 * tx * ty * cxy + ty * ty * cyy) / flat
    return residual, variance + second, bend


@compiled
def learn(b: Belief, k: int, z: Ranging) -> tuple[bool, float]:
    """Update component k with a range, unless that is more likely a wrong one.

    Returns:
        Whether it was used, and the logarithm of its probability density.
    """
    n = b.fresh.size
    residual, expected, _ = look(b, k, z)
    variance = expected + b.variance[z.beacon]
    density = z.accepted - 0.5 * (residual * residual / variance + math.log(2.0 * math.pi * variance))
    if density < z.wrong:
        return False, z.wrong
    x, P, gain = b.state[k], b.covariance[k], b.gain
    for i in range(n):
        share = gain[i] / variance
        x[i] += share * residual
        for j in range(i + 1):
            P[i, j] -= share * gain[j]
            P[j, i] = P[i, j]
    return True, density


@compiled
def learn_variance(b: Belief, z: Ranging) -> None:
    """Adapt a beacon's variance to what the heaviest component makes of a range, before it is updated."""
    residual, expected, _ = look(b, 0, z)
    now = b.variance[z.beacon]
    surplus = min(max(residual * residual - expected, 0.0), _LARGEST * now)
    now += _LEARNING * (surplus - now)
    b.variance[z.beacon] = min(max(now, _LEAST * z.variance), _MOST * z.variance)

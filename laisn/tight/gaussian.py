"""Gaussians in small arrays: factors, updates, mixtures of two, and halves."""

import math

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled

_SQRT_HALF = math.sqrt(0.5)
_PER_SQRT_TURN = 1.0 / math.sqrt(2.0 * math.pi)
_NEGLIGIBLE = 1e-12
"""A half with less than this of the whole is empty: its moments would be those of rounding errors."""


@compiled
def factor(spread: Floats, used: Ints, count: int, root: Floats, per_root: Floats) -> bool:
    """Cholesky factor of a covariance over some of its variables; False if it is not positive definite.

    Args:
        spread: shape (t, t).
        used: indices of the variables, the first `count` of it.
        count: how many.
        root: lower triangle of the factor, in the order of `used`; overwritten.
        per_root: reciprocals of its diagonal, as dividing takes much longer than multiplying; overwritten.
    """
    for i in range(count):
        for j in range(i + 1):
            value = spread[used[i], used[j]]
            for h in range(j):
                value -= root[i, h] * root[j, h]
            if i > j:
                root[i, j] = value * per_root[j]
            elif value > 0.0:
                root[i, i] = math.sqrt(value)
                per_root[i] = 1.0 / root[i, i]
            else:
                # NaN comes here too
                return False
    return True


@compiled
def blend(mean: Floats, covariance: Floats, one: int, other: int, share: float, n: int) -> None:
    """Replace Gaussian `one` by that with the moments of (1 − share) of it and `share` of `other`."""
    kept = 1.0 - share
    for i in range(n):
        for j in range(n):
            apart = (mean[other, i] - mean[one, i]) * (mean[other, j] - mean[one, j])
            covariance[one, i, j] = (
                kept * covariance[one, i, j] + share * covariance[other, i, j] + kept * share * apart
            )
    for i in range(n):
        mean[one, i] = kept * mean[one, i] + share * mean[other, i]


@compiled
def half_moments(z: float) -> tuple[float, float, float]:
    """Moments of the half u > 0 of a normal variable u with mean z and variance 1.

    Returns:
        Its mass Φ(z); by how much its mean is larger, λ = φ(z)/Φ(z); and by how much its variance is smaller, λ(λ + z).
        An empty half keeps its moments. Johnson, Kotz & Balakrishnan, Continuous Univariate Distributions 1
        (truncated normal).
    """
    mass = 0.5 * math.erfc(-z * _SQRT_HALF)
    if mass < _NEGLIGIBLE:
        return 0.0, 0.0, 0.0
    shift = _PER_SQRT_TURN * math.exp(-0.5 * z * z) / mass
    return mass, shift, shift * (shift + z)

"""Mixtures of Gaussians in arrays, as the tightly coupled navigators have them: Cholesky factors, halves, merging,
moments, and the ring of positions that one range allows.

The first two states of a component are its position x, y [m].
"""

import math

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled

_SQRT_HALF = math.sqrt(0.5)
_PER_SQRT_TURN = 1.0 / math.sqrt(2.0 * math.pi)
_SAME = 0.3
"""Squared Mahalanobis distance below which two positions are one."""
_OVERLAP = 0.6
"""Standard deviation of a bearing's Gaussian as a share of their spacing on a ring, for which their sum is nearly
even."""
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


@compiled
def is_same(apart: float, variance: float) -> bool:
    """Whether two components are nearer to each other in one state than their mean variance resolves."""
    return apart * apart <= _SAME * variance


@compiled
def is_same_place(mean: Floats, covariance: Floats, i: int, j: int) -> bool:
    """Whether the positions of two components are nearer than their mean spread."""
    dx, dy = mean[i, 0] - mean[j, 0], mean[i, 1] - mean[j, 1]
    xx, xy = 0.5 * (covariance[i, 0, 0] + covariance[j, 0, 0]), 0.5 * (covariance[i, 0, 1] + covariance[j, 0, 1])
    yy = 0.5 * (covariance[i, 1, 1] + covariance[j, 1, 1])
    return bool(dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx < _SAME * (xx * yy - xy * xy))


@compiled
def place_on_ring(
    mean: Floats,
    covariance: Floats,
    centre: tuple[float, float],
    distance: float,
    direction: tuple[float, float],
    ring: tuple[float, int],
) -> None:
    """Set the position of a component, and its covariance, to one of the Gaussians whose sum is a ring.

    Args:
        mean: of the component, shape (n,); overwritten at x, y.
        covariance: its covariance, shape (n, n); likewise.
        centre: of the ring [m].
        distance: its radius [m].
        direction: unit vector from the centre to this Gaussian.
        ring: variance along the radius [m²], and number of Gaussians.
    """
    (ux, uy), (along, bearings) = direction, ring
    across = (_OVERLAP * 2.0 * math.pi / bearings * distance) ** 2
    mean[0], mean[1] = centre[0] + distance * ux, centre[1] + distance * uy
    covariance[0, 0] = along * ux * ux + across * uy * uy
    covariance[1, 1] = along * uy * uy + across * ux * ux
    covariance[0, 1] = covariance[1, 0] = (along - across) * ux * uy


@compiled
def add_moments(
    mean: Floats,
    moment: Floats,
    weight: float,
    here: tuple[float, float, float, float],
    rows: Floats,
    covariance: Floats,
) -> None:
    """Add a component to the moments of x, y, vx, vy about the origin.

    Args:
        mean: sum so far, shape (4,).
        moment: sum of squares so far, shape (4, 4).
        weight: of the component.
        here: its x, y, vx, vy.
        rows: their derivatives by its n states, shape (4, n) or wider.
        covariance: of the states, shape (n, n) or larger.
    """
    n = covariance.shape[0]
    for i in range(4):
        mean[i] += weight * here[i]
        for j in range(4):
            value = here[i] * here[j]
            for g in range(n):
                if rows[i, g] != 0.0:
                    for h in range(n):
                        value += rows[i, g] * covariance[g, h] * rows[j, h]
            moment[i, j] += weight * value

"""Mixtures of Gaussians: weights, pruning, merging, halves, moments, and the ring of positions that one range allows.

A mixture consists of hypotheses, and each of these of one Gaussian *component* for every mode of the motion: component
`hypothesis · modes + mode`. The first two states of a component are its position x, y [m]. Compiled functions change a
mixture in place; the number of its hypotheses is the caller's.
"""

import math
from typing import Any, TypeAlias

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled

Mixture: TypeAlias = Any
"""A record or NamedTuple with arrays of c components: `state`, shape (c, n), `covariance`, shape (c, n, n), `weight`,
shape (c,), and `outcome`, shape (c,), records of the result of the last update, which copies keep. `states` is the
number of states in use; arrays may be wider."""

_SQRT_HALF = math.sqrt(0.5)
_PER_SQRT_TURN = 1.0 / math.sqrt(2.0 * math.pi)
_SAME = 0.3
"""Squared Mahalanobis distance below which two positions are one; likewise of another state."""
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
def copy_component(b: Mixture, source: int, target: int) -> None:
    """Copy a component."""
    b.weight[target], b.outcome[target] = b.weight[source], b.outcome[source]
    for i in range(b.states):
        b.state[target, i] = b.state[source, i]
        for j in range(b.states):
            b.covariance[target, i, j] = b.covariance[source, i, j]


@compiled
def copy_hypothesis(b: Mixture, modes: int, source: int, target: int) -> None:
    """Copy all components of a hypothesis."""
    for mode in range(modes):
        copy_component(b, source * modes + mode, target * modes + mode)


@compiled
def clear_component(b: Mixture, k: int) -> None:
    """Set weight, mean and covariance of a component to zero."""
    b.weight[k] = 0.0
    b.state[k] = 0.0
    b.covariance[k] = 0.0


@compiled
def heaviest(b: Mixture, modes: int, h: int) -> int:
    """Component with the most weight of a hypothesis."""
    best: int = h * modes
    for k in range(h * modes + 1, (h + 1) * modes):
        if b.weight[k] > b.weight[best]:
            best = k
    return best


@compiled
def hypothesis_weight(b: Mixture, modes: int, h: int) -> float:
    """Weight of a hypothesis over its modes."""
    total = 0.0
    for k in range(h * modes, (h + 1) * modes):
        total += b.weight[k]
    return total


@compiled
def heaviest_hypothesis(b: Mixture, modes: int, count: int) -> int:
    """Hypothesis with the most weight of the first `count`, the earlier one among equals."""
    top = 0
    for h in range(1, count):
        if hypothesis_weight(b, modes, h) > hypothesis_weight(b, modes, top):
            top = h
    return top


@compiled
def _lightest_hypothesis(b: Mixture, modes: int, count: int) -> int:
    least = 0
    for h in range(1, count):
        if hypothesis_weight(b, modes, h) < hypothesis_weight(b, modes, least):
            least = h
    return least


@compiled
def normalise(weight: Floats, count: int) -> float:
    """Scale the first `count` weights to a sum of 1; their sum before."""
    total = 0.0
    for k in range(count):
        total += weight[k]
    for k in range(count):
        weight[k] /= total
    return total


@compiled
def _merge(b: Mixture, modes: int, g: int, h: int) -> None:
    """Merge hypothesis h into g, mode by mode, keeping mean and covariance of both together."""
    for mode in range(modes):
        i, j = g * modes + mode, h * modes + mode
        total = b.weight[i] + b.weight[j]
        if total > 0.0:
            if b.weight[j] > b.weight[i]:
                b.outcome[i] = b.outcome[j]
            blend(b.state, b.covariance, i, j, b.weight[j] / total, b.states)
        b.weight[i] = total


@compiled
def _is_same(b: Mixture, modes: int, g: int, h: int, further: int) -> bool:
    """Whether two hypotheses are nearer than their mean spread, by the positions of their heaviest components.

    Those with different values of the state `further` are not merged: their predictions differ.
    """
    i, j = heaviest(b, modes, g), heaviest(b, modes, h)
    x, P = b.state, b.covariance
    if further >= 0:
        apart, variance = x[i, further] - x[j, further], 0.5 * (P[i, further, further] + P[j, further, further])
        if not apart * apart <= _SAME * variance:
            return False
    dx, dy = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1]
    xx, xy = 0.5 * (P[i, 0, 0] + P[j, 0, 0]), 0.5 * (P[i, 0, 1] + P[j, 0, 1])
    yy = 0.5 * (P[i, 1, 1] + P[j, 1, 1])
    return bool(dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx < _SAME * (xx * yy - xy * xy))


@compiled
def prune_and_merge(b: Mixture, modes: int, count: int, least_weight: float, kept: int, further: int) -> int:
    """Prune light hypotheses, merge those at one position, and keep the heaviest; the last fills a gap.

    Args:
        b: the mixture; its weights are not scaled to a sum of 1 again.
        modes: components of a hypothesis.
        count: hypotheses.
        least_weight: lighter ones are pruned.
        kept: most hypotheses to keep.
        further: index of a state in which merged hypotheses agree, too; −1 for none.

    Returns:
        How many hypotheses are left.
    """
    h = 0
    while h < count:
        if hypothesis_weight(b, modes, h) < least_weight:
            count -= 1
            copy_hypothesis(b, modes, count, h)
        else:
            h += 1
    g = 0
    while g < count:
        h = g + 1
        while h < count:
            if _is_same(b, modes, g, h, further):
                _merge(b, modes, g, h)
                count -= 1
                copy_hypothesis(b, modes, count, h)
            else:
                h += 1
        g += 1
    while count > kept:
        h = _lightest_hypothesis(b, modes, count)
        count -= 1
        copy_hypothesis(b, modes, count, h)
    return count


def mixture_moments(weight: Floats, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance, shapes (n,) and (n, n), of k Gaussians of weights with the sum 1."""
    centre = weight @ mean
    off = mean - centre
    return centre, np.einsum("k,kij->ij", weight, covariance + off[:, :, None] * off[:, None, :])


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

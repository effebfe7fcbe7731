"""Gaussians: mixtures of them, and fixed-lag smoothing of a chain of them from message to message.

A mixture consists of hypotheses, and each of these of one Gaussian *component* for every mode of
the motion: component `hypothesis · modes + mode`. The first two states of a component are its
position x, y [m]. Compiled functions change a mixture in place; the number of its hypotheses is the
caller's.
"""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from laisn.arrays import Floats, Four, Ints, Two
from laisn.compiled import compiled


class Mixture(Protocol):
    """A record or NamedTuple with arrays of c components."""

    @property
    def state(self) -> Floats:
        """Means, shape (c, n) or wider."""

    @property
    def covariance(self) -> Floats:
        """Shape (c, n, n) or wider."""

    @property
    def weight(self) -> Floats:
        """Shape (c,)."""

    @property
    def outcome(self) -> Any:
        """Records of the result of the last update, which copies keep, shape (c,)."""

    @property
    def n_states(self) -> int:
        """Number n of states in use."""


_SQRT_HALF = math.sqrt(0.5)
_PER_SQRT_TURN = 1.0 / math.sqrt(2.0 * math.pi)
# σ of a bearing's Gaussian as a share of their spacing on a ring, for which their sum is nearly
# even
_OVERLAP = 0.6
# a half with less than this of the whole is empty: its moments would be rounding errors
_NEGLIGIBLE = 1e-12


@compiled
def blend(mean: Floats, covariance: Floats, first: int, second: int, share: float, n: int) -> None:
    """Replace Gaussian `first` by that with the moments of (1 − share) of it and `share` of
    `second`.
    """
    # P ← (1 − s) P_1 + s P_2 + s (1 − s) (x_2 − x_1)(x_2 − x_1)ᵀ, x ← (1 − s) x_1 + s x_2
    remainder = 1.0 - share
    for i in range(n):
        difference = mean[second, i] - mean[first, i]
        # both halves of the symmetric covariance, so that the loop is vectorised
        for j in range(n):
            blended = remainder * covariance[first, i, j] + share * covariance[second, i, j]
            covariance[first, i, j] = blended + remainder * share * (
                difference * (mean[second, j] - mean[first, j])
            )
    for i in range(n):
        mean[first, i] = remainder * mean[first, i] + share * mean[second, i]


@compiled
def update_scalar(
    mean: Floats, covariance: Floats, ph: Floats, residual: float, variance: float, n: int
) -> None:
    """Kalman update of n states x, P with one number of residual ν and variance S; `ph` is P Hᵀ,
    not yet divided by S.
    """
    # x += K ν and P −= K S Kᵀ with K = P Hᵀ / S
    for i in range(n):
        share = ph[i] / variance
        mean[i] += share * residual
        for j in range(i + 1):
            covariance[i, j] -= share * ph[j]
            covariance[j, i] = covariance[i, j]


@compiled
def copy_component(b: Mixture, source: int, target: int) -> None:
    """Copy a component."""
    b.weight[target], b.outcome[target] = b.weight[source], b.outcome[source]
    for i in range(b.n_states):
        b.state[target, i] = b.state[source, i]
        for j in range(b.n_states):
            b.covariance[target, i, j] = b.covariance[source, i, j]


@compiled
def copy_hypothesis(b: Mixture, modes: int, source: int, target: int) -> None:
    """Copy all components of a hypothesis."""
    for mode in range(modes):
        copy_component(b, source * modes + mode, target * modes + mode)


@compiled
def reset_component(b: Mixture, k: int, variance: Floats) -> None:
    """Set a component to weight and mean of zero, and to independent states with these
    variances, shape (n,).
    """
    b.weight[k] = 0.0
    for i in range(b.n_states):
        b.state[k, i] = 0.0
        for j in range(b.n_states):
            b.covariance[k, i, j] = 0.0
        b.covariance[k, i, i] = variance[i]


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
def normalise(weight: Floats, count: int) -> float:
    """Scale the first `count` weights to a sum of 1; their sum before."""
    total = 0.0
    for k in range(count):
        total += weight[k]
    for k in range(count):
        weight[k] /= total
    return total


@compiled
def merge_components(b: Mixture, i: int, j: int) -> None:
    """Merge component j into i, keeping weight, mean and covariance of both together."""
    total = b.weight[i] + b.weight[j]
    if total > 0.0:
        if b.weight[j] > b.weight[i]:
            b.outcome[i] = b.outcome[j]
        blend(b.state, b.covariance, i, j, b.weight[j] / total, b.n_states)
    b.weight[i] = total


@compiled
def _is_same(
    b: Mixture, modes: int, g: int, h: int, further_state: int, merge_distance: float
) -> bool:
    """Whether the heaviest components of the hypotheses g and h are nearer than `merge_distance`, a
    squared Mahalanobis distance by their mean covariance, in position, and in the state of index
    `further_state` too (−1: none).
    """
    i = heaviest(b, modes, g)
    j = heaviest(b, modes, h)
    x = b.state
    P = b.covariance
    if further_state >= 0:
        difference = x[i, further_state] - x[j, further_state]
        variance = 0.5 * (P[i, further_state, further_state] + P[j, further_state, further_state])
        if not difference * difference <= merge_distance * variance:
            return False
    # dᵀ adj(P̄) d < merge_distance · det(P̄), so that nothing is divided by a vanishing determinant
    dx, dy = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1]
    xx, xy = 0.5 * (P[i, 0, 0] + P[j, 0, 0]), 0.5 * (P[i, 0, 1] + P[j, 0, 1])
    yy = 0.5 * (P[i, 1, 1] + P[j, 1, 1])
    return bool(
        dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx < merge_distance * (xx * yy - xy * xy)
    )


@compiled
def prune_and_merge(
    b: Mixture,
    modes: int,
    count: int,
    least_weight: float,
    max_count: int,
    further_state: int,
    merge_distance: float,
) -> int:
    """Prune hypotheses lighter than `least_weight`, merge those that are the same by
    `merge_distance` and `further_state` (as of `_is_same`), and keep the `max_count` heaviest; how
    many are left. Weights are not scaled to a sum of 1; the last hypothesis fills a gap.
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
            if _is_same(b, modes, g, h, further_state, merge_distance):
                for mode in range(modes):
                    merge_components(b, g * modes + mode, h * modes + mode)
                count -= 1
                copy_hypothesis(b, modes, count, h)
            else:
                h += 1
        g += 1
    while count > max_count:
        lightest = 0
        for h in range(1, count):
            if hypothesis_weight(b, modes, h) < hypothesis_weight(b, modes, lightest):
                lightest = h
        count -= 1
        copy_hypothesis(b, modes, count, lightest)
    return count


def mixture_moments(weight: Floats, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance, shapes (n,) and (n, n), of k Gaussians of weights with the sum 1."""
    centre = weight @ mean
    deviation = mean - centre
    return centre, np.einsum(
        "k,kij->ij", weight, covariance + deviation[:, :, None] * deviation[:, None, :]
    )


@compiled
def half_moments(z: float) -> tuple[float, float, float]:
    """Of the half u > 0 of a normal variable u with mean z and variance 1: mass Φ(z), by how much
    its mean is larger, λ = φ(z)/Φ(z), and its variance smaller, λ(λ + z) (Johnson, Kotz &
    Balakrishnan, Univariate Distributions 1).
    """
    mass = 0.5 * math.erfc(-z * _SQRT_HALF)
    if mass < _NEGLIGIBLE:
        return 0.0, 0.0, 0.0
    shift = _PER_SQRT_TURN * math.exp(-0.5 * z * z) / mass
    return mass, shift, shift * (shift + z)


@compiled
def place_on_ring(
    b: Mixture, k: int, centre: Two, distance: float, direction: Two, ring: tuple[float, int]
) -> None:
    """Set position and covariance of component k to one of the Gaussians whose sum is a ring: in a
    direction (a unit vector), at a distance [m]; `ring` is the variance along the radius [m²] and
    the number of Gaussians.
    """
    mean = b.state[k]
    covariance = b.covariance[k]
    ux, uy = direction
    radial_variance, bearings = ring
    tangential_variance = (_OVERLAP * 2.0 * math.pi / bearings * distance) ** 2
    mean[0] = centre[0] + distance * ux
    mean[1] = centre[1] + distance * uy
    # P = σ_r² u uᵀ + σ_t² (I − u uᵀ)
    covariance[0, 0] = radial_variance * ux * ux + tangential_variance * uy * uy
    covariance[1, 1] = radial_variance * uy * uy + tangential_variance * ux * ux
    covariance[0, 1] = covariance[1, 0] = (radial_variance - tangential_variance) * ux * uy


@compiled
def add_moments(
    mean: Floats, moment: Floats, weight: float, values: Four, rows: Floats, covariance: Floats
) -> None:
    """Add a component to mean and moment (upper triangle) of x, y, vx, vy about an origin: its
    values `values`, their derivatives F by its n states (`rows`, shape (5, n) or wider, whose last
    row is overwritten), and its covariance. The origin is the mean position, so that the squares of
    large coordinates do not swallow small variances.
    """
    n = covariance.shape[0]
    shifted_row = rows[4]
    for i in range(4):
        mean[i] += weight * values[i]
        # moment += w (y yᵀ + F P Fᵀ) with the values y: F P, one row after the other, then its
        # product with the rows of F
        for h in range(n):
            shifted_row[h] = 0.0
        for g in range(n):
            if rows[i, g] != 0.0:
                for h in range(n):
                    shifted_row[h] += rows[i, g] * covariance[g, h]
        for j in range(i, 4):
            value = values[i] * values[j]
            for h in range(n):
                value += shifted_row[h] * rows[j, h]
            moment[i, j] += weight * value


@compiled
def centre_moments(mean: Floats, moment: Floats) -> None:
    """Turn a moment as of `add_moments`, shape (4, 4), into a covariance."""
    for i in range(4):
        for j in range(i, 4):
            moment[i, j] -= mean[i] * mean[j]
            moment[j, i] = moment[i, j]


# eigenvalues of a correlation matrix below this are rounding errors: directions known exactly
_SINGULAR = 1e-13


class Chain(NamedTuple):
    """Estimates x of s states after each of m messages, or at a known start, each predicted by
    the one before it.
    """

    mean: Floats  # after the message, shape (m, s)
    covariance: Floats  # of that, shape (m, s, s)
    predicted: Floats  # mean just before the message, shape (m, s)
    predicted_covariance: Floats  # of that, shape (m, s, s)
    # covariance of x after this message with x just before the next one, shape (m, s, s)
    cross_to_next: Floats


def _inverse(covariance: Floats) -> Floats:
    """Inverses of covariances, shape (m, s, s); zero in directions that are known exactly."""
    # of what is known exactly rounding may leave a variance below zero
    sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    per_sigma = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
    scale = per_sigma[:, :, None] * per_sigma[:, None, :]
    return np.asarray(scale * np.linalg.pinv(scale * covariance, rcond=_SINGULAR, hermitian=True))


def smooth(
    chain: Chain, latest: Ints, last: Ints, filtered: tuple[Floats, Floats], cross_to_next: Floats
) -> tuple[Floats, Floats]:
    """Smooth n quantities y, of r numbers each, with later messages; mean and covariance as of
    `filtered`.

    `latest` is the index of the last message at or before y, `last` of the last one to use, shapes
    (n,); y stays where that is no later one. `filtered` are mean and covariance of y so far, shapes
    (n, r) and (n, r, r), `cross_to_next` its covariance with x just before the next message, shape
    (n, r, s), read only where that is used.
    """
    mean = filtered[0].copy()
    covariance = filtered[1].copy()
    inverse = _inverse(chain.predicted_covariance)
    gain = chain.cross_to_next[:-1] @ inverse[1:]
    shift = chain.mean - chain.predicted
    change = chain.covariance - chain.predicted_covariance
    rows = np.flatnonzero(last > latest)
    message = latest[rows] + 1
    # gain from a change of x just before `message` to y
    back = cross_to_next[rows] @ inverse[message]
    while rows.size:
        mean[rows] += np.einsum("nrs,ns->nr", back, shift[message])
        covariance[rows] += back @ change[message] @ back.swapaxes(1, 2)
        continues = last[rows] > message
        rows = rows[continues]
        message = message[continues]
        back = back[continues]
        back = back @ gain[message]
        message = message + 1
    return mean, covariance

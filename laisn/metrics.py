"""How far estimates are off: position and bearing errors, consistency, mirror locks (paper,
Section 3.2).
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from laisn import POSITION
from laisn.arrays import Bools, Floats
from laisn.compiled import formula, inlined, select
from laisn.estimates import Estimates, FixKind
from laisn.geometry import Point, SinCos, is_singular
from laisn.vector_math import half_turn_angle

Number: TypeAlias = float | Floats
"""A number, or an array of them of one shape."""
MIRROR_LOCK_ERROR = 5.0
"""Position error beyond which an estimate near the mirror image of the truth counts as locked on
it [m].
"""
_MIN_DETERMINANT = 1e-8
"""Least determinant of a covariance with an inverse, as a share of the product of its variances."""


@formula
def squared_error(estimate: Point, truth: Point) -> float:
    """E_P², squared distance of estimate and truth [m²]."""
    east, north = estimate.east - truth.east, estimate.north - truth.north
    return east * east + north * north


@inlined
def bearing_error(estimate: Point, truth: Point, leader: Point) -> float:
    """E_B, the angle at the leader's true position between estimate and truth, in [0, π] [rad].
    Compiled code only.
    """
    true_x, true_y = truth.east - leader.east, truth.north - leader.north
    x, y = estimate.east - leader.east, estimate.north - leader.north
    return half_turn_angle(true_x * y - true_y * x, true_x * x + true_y * y)


@formula
def is_mirror_locked(estimate: Point, truth: Point, leader: Point, axis: SinCos) -> bool:
    """Whether an estimate is far off and sits at the truth's mirror image in the leader's axis, the
    line through its place `leader` in the direction `axis` of its heading.

    That is: farther than `MIRROR_LOCK_ERROR` from the truth, and at least twice as far from it as
    from its mirror image. A follower on the axis is its own mirror image, so that an error there is
    no mirror lock.
    """
    squared = squared_error(estimate, truth)
    # distances from the axis: reflecting the truth in it changes a squared distance by 4 times
    # their product
    true_side = axis.sine * (truth.north - leader.north) - axis.cosine * (truth.east - leader.east)
    side = axis.sine * (estimate.north - leader.north) - axis.cosine * (estimate.east - leader.east)
    to_mirror = squared + 4.0 * side * true_side
    return (squared > MIRROR_LOCK_ERROR * MIRROR_LOCK_ERROR) & (4.0 * to_mirror < squared)


@formula
def is_invertible(pxx: Number, pxy: Number, pyy: Number) -> Any:
    """Whether a position's covariance has an inverse that is more than rounding: axes differ
    less than 10⁴ times.
    """
    # "^ True" negates arrays and numbers alike
    return (is_singular(pxx, pyy) ^ True) & (pxx * pyy - pxy * pxy > _MIN_DETERMINANT * pxx * pyy)


@formula
def normalised_square(x: Number, y: Number, pxx: Number, pxy: Number, pyy: Number) -> Any:
    """eᵀ P⁻¹ e of an error (x, y) and its covariance, numbers or arrays of them; NaN where that
    is singular.
    """
    determinant = select(is_invertible(pxx, pxy, pyy), pxx * pyy - pxy * pxy, np.nan)
    return (pyy * x * x - 2.0 * pxy * x * y + pxx * y * y) * (1.0 / determinant)


# What follows takes a run in NumPy, which agrees with the formulas above to 1e-14 and compiles
# nothing.


def _points(rows: Floats) -> Point:
    """Points of shape (n, 2) as one of arrays."""
    return Point(rows[:, 0], rows[:, 1])  # type: ignore[arg-type]  # formulas take arrays for numbers


def position_errors(estimate: Floats, truth: Floats) -> Floats:
    """E_P: distance of estimate and truth, both of shape (n, 2), [m]; the answer of shape (n,),
    [m].
    """
    return np.asarray(np.sqrt(squared_error(_points(estimate), _points(truth))))


def bearing_errors(estimate: Floats, truth: Floats, leader: Floats) -> Floats:
    """E_B: angle at the leader between estimate and truth, in [0, π], shape (n,); points of
    shape (n, 2).
    """
    x, y = (estimate - leader).T
    true_x, true_y = (truth - leader).T
    return np.asarray(np.arctan2(np.abs(true_x * y - true_y * x), true_x * x + true_y * y))


SEGMENT_TOLERANCE = 0.1
"""By which share of its length a segment of the true path may miss it."""


def relative_errors(estimate: Floats, truth: Floats, length: float) -> Floats:
    """Errors of the displacement over segments of the true path of about a length [m].

    From each step k the segment reaches to the later step whose distance along the path is nearest
    to `length`; steps without one within `SEGMENT_TOLERANCE` are left out. The error is that of
    p(end) − p(k) in the world, of estimate against truth: headings are measured and no states, so
    that no alignment is made. Points have shape (n, 2), [m]; NaN where an estimate is; the answer
    has shape (s,), [m].

    Source: pairs as in Geneva et al., "OpenVINS", ICRA 2020, and Zhang & Scaramuzza, "A tutorial on
    quantitative trajectory evaluation", IROS 2018, Section III-C.
    """
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth, axis=0).T))])
    last = travelled.size - 1
    after = np.minimum(np.searchsorted(travelled, travelled + length), last)
    before = np.maximum(after - 1, 0)
    shortfall = np.abs(travelled[before] - travelled - length)
    excess = np.abs(travelled[after] - travelled - length)
    end = np.where(shortfall <= excess, before, after)
    has_length = np.abs(travelled[end] - travelled - length) <= SEGMENT_TOLERANCE * length
    first = np.flatnonzero(has_length)
    end = end[first]
    drift = (estimate[end] - estimate[first]) - (truth[end] - truth[first])
    return np.asarray(np.hypot(drift[:, 0], drift[:, 1]))


class Summary(NamedTuple):
    """The paper's six figures; σ is that about the mean, over all steps."""

    e_p_max_m: float
    e_p_mean_m: float
    e_p_std_m: float
    e_b_max_deg: float
    e_b_mean_deg: float
    e_b_std_deg: float


def summarise(position: Floats, bearing: Floats) -> Summary:
    """Maximum, mean and σ of E_P [m] and E_B [rad]; ValueError without a step, or if an error is
    not finite.
    """
    if not position.size or not (np.all(np.isfinite(position)) and np.all(np.isfinite(bearing))):
        raise ValueError("a summary needs at least one step, and finite errors only")
    return Summary(
        *(float(f()) for e in (position, np.rad2deg(bearing)) for f in (e.max, e.mean, e.std))
    )


def nees(estimates: Estimates, truth: Floats) -> Floats:
    """eᵀ P⁻¹ e of the position, shape (n,); 2 on average if P is right, NaN where singular;
    truth of shape (n, 2).
    """
    error = estimates.state[:, POSITION] - truth
    return normalised_errors(error, estimates.covariance[:, POSITION, POSITION])


def nis(estimates: Estimates) -> Floats:
    """Normalised squared innovation of each fix, shape (f,); 2 on average if S is right; NaN for
    none of a position.
    """
    left_out = (FixKind.GATED, FixKind.SINGULAR, FixKind.LOST, FixKind.ONE_RANGE)
    used = ~np.isin(estimates.fix_kind, left_out)
    covariance = np.where(used[:, None, None], estimates.innovation_covariance, 0.0)
    return normalised_errors(estimates.innovation, covariance)


def normalised_errors(error: Floats, covariance: Floats) -> Floats:
    """eᵀ P⁻¹ e, shape (n,), of errors of shape (n, 2) and their covariances, shape (n, 2, 2); NaN
    where these are singular.
    """
    x, y = error.T
    pxx, pxy, pyy = covariance.reshape(-1, 4).T[[0, 1, 3]]
    return np.asarray(normalised_square(x, y, pxx, pxy, pyy))


def mirror_locked_steps(
    estimate: Floats, truth: Floats, leader: Floats, leader_heading: Floats
) -> Bools:
    """Steps at which `is_mirror_locked`, shape (n,); of points, shape (n, 2), and headings,
    shape (n,).
    """
    sine, cosine = np.sin(leader_heading), np.cos(leader_heading)
    axis = SinCos(sine, cosine)  # type: ignore[arg-type]  # formulas take arrays for numbers
    return np.asarray(is_mirror_locked(_points(estimate), _points(truth), _points(leader), axis))


def longest_mirror_lock(mirror_locked: Bools) -> int:
    """Most steps in a row that are mirror locks; a run is a mirror lock if they span a message
    interval or more.
    """
    edges = np.diff(np.concatenate([[0], mirror_locked.astype(np.int64), [0]]))
    lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    return int(lengths.max(initial=0))


def fix_counts(estimates: Estimates) -> dict[str, int]:
    """Number of fixes of each kind, by the kind's name in lower case."""
    counts = np.bincount(estimates.fix_kind, minlength=len(FixKind))
    return {kind.name.lower(): int(counts[kind]) for kind in FixKind}

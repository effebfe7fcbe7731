"""How far estimates are off: position and bearing errors, consistency, mirror captures (paper, Section 3.2)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from laisn import POSITION
from laisn.estimates import Estimates, FixKind
from laisn.geometry import SINGULAR_VARIANCE

Floats = npt.NDArray[np.float64]

CAPTURE_ERROR = 5.0
"""Position error beyond which an estimate near the mirror image of the truth counts as captured there [m]."""


def position_errors(estimate: Floats, truth: Floats) -> Floats:
    """E_P: distance of estimate and truth, both of shape (n, 2), [m]; the answer of shape (n,), [m]."""
    return np.asarray(np.hypot(*(estimate - truth).T))


def bearing_errors(estimate: Floats, truth: Floats, leader: Floats) -> Floats:
    """E_B: angle at the leader's true position between estimate and truth, in [0, π].

    The leader's heading cancels, as both bearings are taken from its true pose.

    Args:
        estimate: shape (n, 2), [m].
        truth: shape (n, 2), [m].
        leader: shape (n, 2), [m].

    Returns:
        Shape (n,), [rad].
    """
    (ax, ay), (bx, by) = (estimate - leader).T, (truth - leader).T
    return np.asarray(np.arctan2(np.abs(ax * by - ay * bx), ax * bx + ay * by))


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The paper's six figures."""

    e_p_max_m: float
    e_p_mean_m: float
    e_p_std_m: float
    """σ about the mean, over all steps."""
    e_b_max_deg: float
    e_b_mean_deg: float
    e_b_std_deg: float


def summarise(position: Floats, bearing: Floats) -> Summary:
    """Maximum, mean and standard deviation of E_P [m] and E_B [rad], arrays of any shape.

    Raises:
        ValueError: there is no step, or an error is not finite.
    """
    if not position.size or not (np.all(np.isfinite(position)) and np.all(np.isfinite(bearing))):
        raise ValueError("a summary needs at least one step, and finite errors only")
    degrees = np.rad2deg(bearing)
    return Summary(
        e_p_max_m=float(position.max()),
        e_p_mean_m=float(position.mean()),
        e_p_std_m=float(position.std()),
        e_b_max_deg=float(degrees.max()),
        e_b_mean_deg=float(degrees.mean()),
        e_b_std_deg=float(degrees.std()),
    )


def nees(estimates: Estimates, truth: Floats) -> Floats:
    """Normalised squared error eᵀ P⁻¹ e of the position, shape (n,); 2 on average if P is right.

    NaN where the covariance is singular. Bar-Shalom, Li & Kirubarajan 2001, Section 5.4.2. `truth` has shape (n, 2).
    """
    error = estimates.state[:, POSITION] - truth
    return _normalised(error, estimates.covariance[:, POSITION, POSITION])


def nis(estimates: Estimates) -> Floats:
    """Normalised squared innovation of each fix, shape (f,); 2 on average if S is right.

    NaN if it was not used, or was one range alone, which measures one coordinate and not two.
    """
    left_out = (FixKind.GATED, FixKind.SINGULAR, FixKind.LOST, FixKind.ONE_RANGE)
    used = ~np.isin(estimates.fix_kind, left_out)
    covariance = np.where(used[:, None, None], estimates.innovation_covariance, 0.0)
    return _normalised(np.where(used[:, None], estimates.innovation, 0.0), covariance)


def _normalised(error: Floats, covariance: Floats) -> Floats:
    result = np.full(error.shape[0], np.nan)
    regular = 0.5 * np.trace(covariance, axis1=1, axis2=2) >= SINGULAR_VARIANCE
    solved = np.linalg.solve(covariance[regular], error[regular][..., None])[..., 0]
    result[regular] = np.einsum("ni,ni->n", error[regular], solved)
    return result


def captured_steps(estimate: Floats, truth: Floats, leader: Floats, leader_heading: Floats) -> npt.NDArray[np.bool_]:
    """Steps at which the estimate is far off and sits at the truth's mirror image in the leader's axis.

    That is: farther than `CAPTURE_ERROR` from the truth, and at least twice as far from it as from its mirror image.
    A follower on the axis is its own mirror image, so that an error there is no capture.

    Args:
        estimate: shape (n, 2), [m].
        truth: shape (n, 2), [m].
        leader: shape (n, 2), [m].
        leader_heading: shape (n,), [rad].

    Returns:
        Shape (n,).
    """
    axis = np.stack([np.sin(leader_heading), np.cos(leader_heading)])

    def aside(point: Floats) -> Floats:
        x, y = (point - leader).T
        return np.asarray(axis[0] * y - axis[1] * x)

    squared = np.sum((estimate - truth) ** 2, axis=1)
    to_mirror = squared + 4.0 * aside(estimate) * aside(truth)
    return np.asarray((squared > CAPTURE_ERROR**2) & (4.0 * to_mirror < squared))


def longest_capture(captured: npt.NDArray[np.bool_]) -> int:
    """Most steps in a row that are captured; a run is a mirror capture if they span a message interval or more."""
    edges = np.diff(np.concatenate([[0], captured.astype(np.int64), [0]]))
    lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    return int(lengths.max(initial=0))


def fix_counts(estimates: Estimates) -> dict[str, int]:
    """Number of fixes of each kind, by the kind's name in lower case."""
    counts = np.bincount(estimates.fix_kind, minlength=len(FixKind))
    return {kind.name.lower(): int(counts[kind]) for kind in FixKind}

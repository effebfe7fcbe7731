"""Confidence intervals of what studies print: proportions, means over runs, and shares of sums over
missions.

Runs and missions are independent; arms of one run share their noise, so that their differences are
paired. All limits are two-sided and leave the same chance on either side.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats

CONFIDENCE = 0.95
FEWEST_RUNS = 20  # fewer runs do not determine their skewness: no interval is given


class Interval(NamedTuple):
    """An estimate and its limits; NaN limits: the data do not bound it."""

    value: float
    low: float
    high: float


def _special() -> Any:
    """Functions of SciPy, which take a fifth of a second to load; reports of flights need none."""
    from scipy import special

    return special


def proportion(count: int, trials: int, confidence: float = CONFIDENCE) -> Interval:
    """Share of trials with an outcome, with the exact limits of Clopper and Pearson (Biometrika 26,
    1934).

    Where the chance differs from trial to trial they hold for its mean (Hoeffding 1956).
    ValueError: no trial, or a count outside 0 … `trials`.
    """
    if not 0 <= count <= trials or trials == 0:
        raise ValueError(f"{count} of {trials} is no proportion")
    return Interval(count / trials, *exact_limits(count, trials, confidence))


def exact_limits(
    count: float, trials: float, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Limits of Clopper and Pearson for a count of trials, which need not be whole numbers."""
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(_special().betaincinv(count, trials - count + 1, tail))
    high = (
        1.0
        if count == trials
        else float(_special().betaincinv(count + 1, trials - count, 1.0 - tail))
    )
    return low, high


def _undo_skewness(transformed: Floats, skewness: Floats, runs: Floats) -> Floats:
    """Inverse of T + γ T² / 3 + γ² T³ / 27 + γ / (6 n), the cubic of T = (mean − μ) / s that is
    nearly normal.
    """
    third = skewness / 3.0
    with np.errstate(invalid="ignore", divide="ignore"):
        untransformed = (
            np.cbrt(1.0 + 3.0 * third * (transformed - skewness / (6.0 * runs))) - 1.0
        ) / third
    # the limit of small skewness, where the difference above would be lost to rounding
    return np.asarray(np.where(np.abs(third) < 1e-6, transformed, untransformed))


def ratio_intervals(
    numerators: Floats, denominators: Floats, confidence: float = CONFIDENCE
) -> list[Interval]:
    """Ratios of sums over runs, Σ numerator / Σ denominator, with t intervals that account for
    skewness.

    Hall's cubic transformation removes the skewness γ; its quantiles are those of t with n − 1
    degrees of freedom (P. Hall, J. R. Stat. Soc. B 54, 1992, 221–228). A ratio is treated as the
    mean of its linearisation, (numerator − ratio · denominator) / mean(denominator).

    Args:
        numerators: of each run, a column for each ratio, shape (R, k).
        denominators: likewise, not negative; 0: the run does not count.
        confidence: of the intervals; limits are NaN where fewer than `FEWEST_RUNS` count.
    """
    runs = np.count_nonzero(denominators, axis=0).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = numerators.sum(axis=0) / denominators.sum(axis=0)
        residual = numerators - ratio * denominators
        squares = np.sum(residual**2, axis=0)
        spread = np.sqrt(squares / (runs - 1.0)) * runs / denominators.sum(axis=0)
        skewness = np.where(
            squares > 0.0, np.sqrt(runs) * np.sum(residual**3, axis=0) / squares**1.5, 0.0
        )
        quantile = _special().stdtrit(runs - 1.0, (1.0 + confidence) / 2.0) / np.sqrt(runs)
        low, high = (
            ratio - spread * _undo_skewness(sign * quantile, skewness, runs) for sign in (1.0, -1.0)
        )
    is_small = runs < FEWEST_RUNS
    limits = (np.where(is_small, math.nan, limit).tolist() for limit in (low, high))
    return [Interval(*row) for row in zip(ratio.tolist(), *limits, strict=True)]


def mean_interval(
    values: Floats, counted: Bools | None = None, confidence: float = CONFIDENCE
) -> Interval:
    """Mean over runs that count, shape (R,) each, with its interval as of `ratio_intervals`;
    `counted` None: all runs count.
    """
    mask = (
        np.ones(values.shape, dtype=np.float64) if counted is None else counted.astype(np.float64)
    )
    return ratio_intervals((mask * values)[:, None], mask[:, None], confidence)[0]


def difference_of_shares(differences: Floats, confidence: float = CONFIDENCE) -> Interval:
    """Mean over runs, shape (R,), of paired differences of outcomes that are 0 or 1, or of
    combinations, in −1 … 1.

    The adjusted Wald interval of Bonett & Price (J. Educ. Behav. Stat. 37, 2012): one run
    decisive for each side (+1 and −1) is added, so that outcomes which no run had are not taken
    for impossible.
    """
    adjusted = np.append(differences, [1.0, -1.0])
    half_width = (
        float(_special().ndtri((1.0 + confidence) / 2.0))
        * float(adjusted.std())
        / math.sqrt(adjusted.size)
    )
    middle = float(adjusted.mean())
    return Interval(
        float(differences.mean()), max(middle - half_width, -1.0), min(middle + half_width, 1.0)
    )


def _sum_and_covariance(missions: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Sum over missions of each column's mean over runs, shape (c,), and the covariance matrix of
    that sum, shape (c, c).
    """
    total = np.sum([mission.mean(axis=0) for mission in missions], axis=0)
    covariances = [
        np.atleast_2d(np.cov(mission, rowvar=False, ddof=1)) / mission.shape[0]
        for mission in missions
    ]
    return np.atleast_1d(total), np.sum(covariances, axis=0)


def mean_over_missions(missions: Sequence[Floats], confidence: float = CONFIDENCE) -> Interval:
    """Mean over missions of the means over their runs, shape (R,) each: what other noise on these
    would change.

    The interval is by the normal law for a sum of many runs.
    """
    total, covariance = _sum_and_covariance([mission[:, None] for mission in missions])
    half_width = float(_special().ndtri((1.0 + confidence) / 2.0)) * math.sqrt(
        float(covariance[0, 0])
    )
    return Interval(
        *((float(total[0]) + step) / len(missions) for step in (0.0, -half_width, half_width))
    )


def share_removed(
    missions: Sequence[tuple[Floats, Floats]], confidence: float = CONFIDENCE
) -> Interval:
    """Share of a sum over missions that is taken away, 1 − Σ mean(left) / Σ mean(before), by
    Fieller's theorem.

    Each mission is a pair (before, left): what there is to remove and what is left of it, run by
    run, shape (R,) each (Fieller, J. R. Stat. Soc. B 16, 1954). Limits are NaN where the sum before
    cannot be distinguished from zero.
    """
    total, covariance = _sum_and_covariance([np.column_stack(pair) for pair in missions])
    total_before, total_left = (float(v) for v in total)
    if total_before == 0.0:
        return Interval(math.nan, math.nan, math.nan)
    z2 = float(_special().ndtri((1.0 + confidence) / 2.0)) ** 2
    # roots t of (left − t before)² = z² Var(left − t before), i.e. a t² − 2 b t + c = 0
    a = total_before * total_before - z2 * float(covariance[0, 0])
    b = total_before * total_left - z2 * float(covariance[0, 1])
    c = total_left * total_left - z2 * float(covariance[1, 1])
    discriminant = b * b - a * c
    if a <= 0.0 or discriminant < 0.0:
        return Interval(1.0 - total_left / total_before, math.nan, math.nan)
    roots = sorted(((b - math.sqrt(discriminant)) / a, (b + math.sqrt(discriminant)) / a))
    return Interval(1.0 - total_left / total_before, 1.0 - roots[1], 1.0 - roots[0])

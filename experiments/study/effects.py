"""Main effects: the share of a metric's variance over a study's points that each factor alone explains."""

from typing import Any

import numpy as np

from experiments.intervals import CONFIDENCE, Interval
from experiments.study.estimate import Place, Results
from experiments.study.plan import ARM, FOLLOWER, Plan, levels, varied
from laisn.arrays import Floats, Ints

INTERACTIONS = "interactions"
_RESAMPLES = 1000
_MOST_VALUES = 5_000_000
"""Bound on the values that are resampled: designs of many places have fewer resamples, at least 20."""
_KEY = 0xEF
"""Keeps the random numbers of resampling apart from others."""


def explained(factor: Floats | Ints, values: Floats) -> Floats:
    """Share of the variance of values that a factor alone explains, R².

    Args:
        factor: numbers of its levels, shape (n,): the means of the levels explain, as in the analysis of variance; or
            columns of a linear model, shape (n, k).
        values: shape (n, m).

    Returns:
        Shape (m,); NaN where all values are the same.
    """
    y = values - values.mean(axis=0)
    if factor.ndim == 1:
        level = factor.astype(np.int64)
        sums = np.zeros((int(level.max()) + 1, y.shape[1]))
        np.add.at(sums, level, y)
        fitted = (sums / np.maximum(np.bincount(level), 1)[:, None])[level]
    else:
        x = factor - factor.mean(axis=0)
        fitted = x @ np.linalg.lstsq(x, y, rcond=None)[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((fitted**2).sum(axis=0) / (y**2).sum(axis=0))


def _coded(plan: Plan, name: str, given: list[Any]) -> Floats | Ints:
    """What stands for a factor in `explained`: its levels, or of a sampled range the value and its square."""
    factor = next((f for f in plan.study.factors if f.key == name), None)
    if factor is not None and not factor.values:
        x = np.log(given) if factor.log else np.array(given)
        x = (x - x.mean()) / x.std()
        return np.column_stack([x, x**2])
    number = {repr(level): i for i, level in enumerate(levels(plan, name))}
    return np.array([number[repr(value)] for value in given])


def _sample(results: Results, place: Place, metric: str) -> Floats:
    """Independent values whose mean a place has: of runs of a single realization, or of realizations."""
    runs = results.by_run(place, metric)
    return runs[0] if runs is not None and len(runs) == 1 else results.by_realization(place, metric)


def _limits(resampled: Floats) -> tuple[float, float]:
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.nanquantile(resampled, [tail, 1.0 - tail])
    return float(low), float(high)


def main_effects(plan: Plan, results: Results, metric: str) -> dict[str, Interval]:
    """First-order Sobol' indices of factors, arms and followers, with bootstrap intervals; largest first.

    Of a factorial design they are main effects of the analysis of variance of the means at all places, the rest being
    interactions; runs, or realizations, are resampled in all places alike. Of a sampled design each is the adjusted R²
    of a quadratic in the factor (Saltelli et al., Global Sensitivity Analysis, 2008, section 1.2.5); points are
    resampled.

    Returns:
        Shares by name of the factor; none if fewer than two factors vary, a place has no value, or all have the same.
    """
    factors = varied(plan)
    places = list(results.rows)
    given_samples = [_sample(results, place, metric) for place in places]
    alike = len(places) == len(plan.points) * len(plan.arms) * len(plan.followers)
    if len(factors) < 2 or not alike or len({sample.size for sample in given_samples}) > 1:
        return {}
    samples = np.array(given_samples)
    if np.isnan(samples).all(axis=1).any():
        return {}
    means = np.nanmean(samples, axis=1)
    if np.ptp(means) == 0.0:
        return {}
    names = factors + [ARM] * (len(plan.arms) > 1) + [FOLLOWER] * (len(plan.followers) > 1)
    given = {name: [plan.points[place[0]][name] for place in places] for name in factors}
    given |= {ARM: [place[1] for place in places], FOLLOWER: [place[2] for place in places]}
    random = np.random.default_rng([_KEY, plan.study.file.seed or 0])
    coded = {name: _coded(plan, name, given[name]) for name in names}
    resamples = min(_RESAMPLES, max(_MOST_VALUES // len(places), 20))
    found: dict[str, Interval] = {}
    if plan.study.file.design == "factorial":
        count = samples.shape[1]
        weights = random.multinomial(count, np.full(count, 1.0 / count), resamples) if count > 1 else np.ones((0, 1))
        known = ~np.isnan(samples)
        with np.errstate(invalid="ignore", divide="ignore"):
            resampled = (np.where(known, samples, 0.0) @ weights.T) / (known @ weights.T)
        shares = {name: explained(coded[name], np.column_stack([means, resampled])) for name in names}
        shares[INTERACTIONS] = 1.0 - np.sum(list(shares.values()), axis=0)
        for name, share in shares.items():
            found[name] = Interval(float(share[0]), *(_limits(share[1:]) if count > 1 else (np.nan, np.nan)))
    else:
        by_point = np.argsort([place[0] for place in places], kind="stable").reshape(len(plan.points), -1)
        chosen = [np.arange(len(plan.points)), *random.integers(0, len(plan.points), (resamples, len(plan.points)))]
        for name, factor in coded.items():
            rows = (by_point[picked].ravel() for picked in chosen)
            share = np.array([explained(factor[r], means[r, None])[0] for r in rows])
            k = factor.shape[1] if factor.ndim == 2 else int(factor.max())
            adjusted = np.maximum(1.0 - (1.0 - share) * (len(places) - 1) / max(len(places) - 1 - k, 1), 0.0)
            found[name] = Interval(float(adjusted[0]), *_limits(adjusted[1:]))
    order = sorted(found, key=lambda name: (name == INTERACTIONS, -found[name].value))
    return {name: found[name] for name in order}

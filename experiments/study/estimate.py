"""Estimates of a metric at a point: means with intervals, paired differences of arms, and main
effects of factors.

With several realizations an interval is for the mean over the population of realizations, else for
that realization alone. Arms share realizations and noise, so that their differences are taken run
by run.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from experiments.campaign.store import Record
from experiments.study.measure import SHARES
from experiments.study.plan import ARM, FOLLOWER, StudyPlan, levels, varied
from laisn.arrays import Floats, Ints
from reports import intervals
from reports.intervals import (
    CONFIDENCE,
    FEWEST_RUNS,
    Interval,
    difference_of_shares,
    mean_interval,
)


class Condition(NamedTuple):
    """What is told apart in the results of a study, a place of it in its documents: a point, an arm
    and a follower.
    """

    point: int  # index into `StudyPlan.points`
    arm: str
    follower: str


NOTHING = Interval(math.nan, math.nan, math.nan)
INTERACTIONS = "interactions"
VERDICTS = ("lower", "higher", "undecided", "same")
_RESAMPLES = 1000
_MAX_VALUES = 5_000_000
"""Bound on the values that are resampled: designs of many places have fewer resamples, at least
20.
"""
_KEY = 0xEF  # first of the numbers that seed resamples


def digits(value: float) -> str:
    """A number with three significant digits, zeros included, so that 0.500 stands beside 0.497;
    a dash for NaN.
    """
    if math.isnan(value):
        return "–"
    text = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:#.3g}".rstrip(".")
    return text.replace("-", "−")


def interval_text(interval: Interval, unit: str = "") -> str:
    """An estimate and its unit, with limits in brackets if the data give them; a dash for NaN."""
    text = digits(interval.value)
    if unit and not math.isnan(interval.value):
        text += f" {unit}"
    if not math.isnan(interval.low):
        text += f" ({digits(interval.low)} to {digits(interval.high)})"
    return text


def verdict_of(difference: Interval, value: float, base: float) -> str:
    """Whether a value is lower or higher than another one, by the whole interval of the
    difference; "same" if no shown digit differs.
    """
    decided = difference.high < 0 or difference.low > 0
    if digits(value) == digits(base) and (decided or difference.value == 0):
        return "same"
    if not decided:
        return "undecided"
    return "lower" if difference.value < 0 else "higher"


def verdicts_text(counts: Counter[str]) -> str:
    """At how many places each verdict is given, in words: "lower at 2, undecided at 1"; of a single
    place its verdict alone.
    """
    given = [
        ("the same" if verdict == "same" else verdict, counts[verdict])
        for verdict in VERDICTS
        if counts[verdict]
    ]
    if counts.total() == 1:
        return given[0][0]
    return ", ".join(f"{text} at {count}" for text, count in given)


def _quantile(number: float) -> float:
    """Quantile of Student's t of two-sided limits of `CONFIDENCE`, of a mean of so many values."""
    return float(stdtrit(number - 1, (1 + CONFIDENCE) / 2))


def over_realizations(means: Floats) -> Interval:
    """Mean over realizations, shape (S,): `mean_interval` of at least `FEWEST_RUNS`, else Student's
    t, which needs two.

    Limits are NaN where all realizations have the same. Each one's mean holds the scatter of its
    runs already, so that runs are not drawn again (Davison & Hinkley, Bootstrap Methods and their
    Application, 1997, section 3.8).
    """
    mean = float(means.mean())
    if means.size < 2 or np.ptp(means) == 0:
        return Interval(mean, math.nan, math.nan)
    if means.size >= FEWEST_RUNS:
        return mean_interval(means)
    half_width = _quantile(means.size) * float(means.std(ddof=1)) / math.sqrt(means.size)
    return Interval(mean, mean - half_width, mean + half_width)


def over_runs(
    realizations: Sequence[Floats], *, shares: bool = False, paired: bool = False
) -> Interval:
    """Mean of values of runs, shape (R,) for each realization, every realization counting alike.

    With `shares` values are 0 or 1, or, if `paired`, differences of such. The share over several
    realizations has the limits of Clopper and Pearson for as many independent runs as would scatter
    like the means of the realizations (Korn & Graubard, Survey Methodology 24, 1998). Where no run
    has the outcome, or all have, a realization counts as one run.
    """
    count = len(realizations)
    means = np.array([values.mean() for values in realizations])
    if count > 1 and shares and not paired:
        runs = float(sum(values.size for values in realizations))
        share = float(means.mean())
        effective_runs = float(count)
        if 0.0 < share < 1.0:
            binomial_variance = share * (1.0 - share) * (_quantile(runs) / _quantile(count)) ** 2
            scatter = float(means.var(ddof=1))
            effective_runs = min(binomial_variance * count / scatter, runs) if scatter > 0 else runs
        return Interval(share, *intervals.exact_limits(share * effective_runs, effective_runs))
    if count > 1:
        # realizations that all differ by nothing do not make a difference impossible
        if shares and np.ptp(means) == 0:
            return difference_of_shares(means)
        return over_realizations(means)
    (values,) = realizations
    if shares and paired:
        return difference_of_shares(values)
    if shares:
        return intervals.proportion(int(values.sum()), values.size)
    if np.ptp(values):
        return mean_interval(values)
    return Interval(float(values[0]), math.nan, math.nan)


def _without_nan(values: Floats) -> Floats:
    return values[~np.isnan(values)]


def _interval(
    runs: Sequence[Floats] | None, realizations: Floats, metric: str, *, paired: bool = False
) -> Interval:
    """Mean and interval of values of runs, or of realizations where there are none of runs; NaN
    where one has none.
    """
    if runs is None:
        if not realizations.size or np.isnan(realizations).any():
            return NOTHING
        return over_realizations(realizations)
    finite_runs = [_without_nan(values) for values in runs]
    if not finite_runs or not all(values.size for values in finite_runs):
        return NOTHING
    return over_runs(finite_runs, shares=metric in SHARES, paired=paired)


@dataclass(frozen=True, kw_only=True)
class Results:
    """Rows and runs of a study by place, realizations in their order.

    A run that contact ended has NaN for all that only a whole run has; means and differences are
    over the others.
    """

    rows: Mapping[Condition, list[Record]]
    runs: Mapping[Condition, list[Record]]
    _estimates: dict[tuple[Condition, str], Interval] = field(
        default_factory=dict, init=False, compare=False
    )

    @classmethod
    def of(cls, rows: Sequence[Record], runs: Sequence[tuple[Record, Record]]) -> "Results":
        """Sort the rows of a study."""
        rows_of: dict[Condition, list[Record]] = {}
        runs_of: dict[Condition, list[Record]] = {}
        for row, (_, lists) in zip(rows, runs, strict=True):
            condition = Condition(row["point"], row["arm"], row["follower"])
            rows_of.setdefault(condition, []).append(row)
            runs_of.setdefault(condition, []).append(lists)
        return cls(rows=rows_of, runs=runs_of)

    def by_run(self, condition: Condition, metric: str) -> list[Floats] | None:
        """Values of the runs of each realization; None if the metric is not one of single runs."""
        runs = self.runs.get(condition, [])
        if not runs or any(metric not in lists for lists in runs):
            return None
        return [np.array(lists[metric], dtype=np.float64) for lists in runs]

    def by_realization(self, condition: Condition, metric: str) -> Floats:
        """A value for each realization, shape (S,); means over the runs where the metric is one
        of runs.
        """
        runs = self.by_run(condition, metric)
        if runs is not None:
            finite_runs = [_without_nan(values) for values in runs]
            return np.array([values.mean() if values.size else math.nan for values in finite_runs])
        return np.array([row.get(metric) for row in self.rows.get(condition, [])], dtype=np.float64)

    def estimate(self, condition: Condition, metric: str) -> Interval:
        """Mean of a metric at a place with its interval; NaN where nothing was flown."""
        if (condition, metric) not in self._estimates:
            runs = self.by_run(condition, metric)
            realizations = self.by_realization(condition, metric)
            self._estimates[condition, metric] = _interval(runs, realizations, metric)
        return self._estimates[condition, metric]

    def difference(self, condition: Condition, base: str, metric: str) -> Interval:
        """Mean of the arm of a place less that of the arm `base` at the same point, paired by
        realization and run.
        """
        other = condition._replace(arm=base)
        if self._realizations(condition) != self._realizations(other):
            return NOTHING
        runs = self.by_run(condition, metric) or []
        base_runs = self.by_run(other, metric) or []
        differences = None
        if runs and base_runs:
            if [a.size for a in runs] != [b.size for b in base_runs]:
                return NOTHING
            differences = [a - b for a, b in zip(runs, base_runs, strict=True)]
        means = self.by_realization(condition, metric) - self.by_realization(other, metric)
        return _interval(differences, means, metric, paired=True)

    def _realizations(self, condition: Condition) -> list[Any]:
        return [row["realization"] for row in self.rows.get(condition, [])]

    def differences(self, base: str, metric: str) -> dict[Condition, Interval]:
        """Differences from the arm `base` at all places of other arms where both were flown."""
        return {
            condition: self.difference(condition, base, metric)
            for condition in self.rows
            if condition.arm != base and condition._replace(arm=base) in self.rows
        }


def explained(factor: Floats | Ints, values: Floats) -> Floats:
    """Share R² of the variance of values, shape (n, m), that a factor alone explains, shape (m,);
    NaN if there is none.

    The factor is given by the numbers of its levels, shape (n,): the means of the levels explain,
    as in the analysis of variance; or by columns of a linear model, shape (n, k).
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


def _coded(plan: StudyPlan, name: str, values: list[Any]) -> Floats | Ints:
    """What stands for a factor in `explained`: its levels, or of a sampled range the value and
    its square.
    """
    factor = next((f for f in plan.study.factors if f.key == name), None)
    if factor is not None and not factor.values:
        x = np.log(values) if factor.log else np.array(values)
        x = (x - x.mean()) / x.std()
        return np.column_stack([x, x**2])
    number = {repr(level): i for i, level in enumerate(levels(plan, name))}
    return np.array([number[repr(value)] for value in values])


def _limits(resampled: Floats) -> tuple[float, float]:
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.nanquantile(resampled, [tail, 1.0 - tail])
    return float(low), float(high)


def main_effects(plan: StudyPlan, results: Results, metric: str) -> dict[str, Interval]:
    """First-order Sobol' indices of factors, arms and followers by name, with bootstrap intervals;
    largest first, `INTERACTIONS` last.

    Of a factorial design they are main effects of the analysis of variance of the means at all
    places; runs, or realizations, are resampled in all places alike. Of a sampled design each is
    the adjusted R² of a quadratic in the factor (Saltelli et al., Global Sensitivity Analysis,
    2008, section 1.2.5); points are resampled. None if fewer than two factors vary, a place has no
    value, or all have the same.
    """
    places = list(results.rows)
    samples = _samples(plan, results, metric)
    if samples is None or len(varied(plan)) < 2 or np.isnan(samples).all(axis=1).any():
        return {}
    if np.ptp(np.nanmean(samples, axis=1)) == 0.0:
        return {}
    coded = _coded_factors(plan, places)
    random = np.random.default_rng([_KEY, plan.study.file.seed or 0])
    resamples = min(_RESAMPLES, max(_MAX_VALUES // len(places), 20))
    if plan.study.file.design == "factorial":
        effects = _analysis_of_variance(coded, samples, resamples, random)
    else:
        points = np.array([condition.point for condition in places])
        effects = _quadratic_effects(coded, samples, points, resamples, random)
    return dict(sorted(effects.items(), key=lambda item: (item[0] == INTERACTIONS, -item[1].value)))


def _samples(plan: StudyPlan, results: Results, metric: str) -> Floats | None:
    """Independent values whose mean each place has, shape (places, n): of the runs of a single
    realization, or of realizations; None where places are missing or have several numbers of them.
    """
    places = list(results.rows)
    samples = []
    for condition in places:
        runs = results.by_run(condition, metric) or []
        samples.append(runs[0] if len(runs) == 1 else results.by_realization(condition, metric))
    if len(places) != len(plan.points) * len(plan.arms) * len(plan.followers):
        return None
    if len({sample.size for sample in samples}) > 1:
        return None
    return np.array(samples)


def _coded_factors(plan: StudyPlan, places: Sequence[Condition]) -> dict[str, Floats | Ints]:
    """What stands for the value of each factor, and of arm and follower if there are several, in
    `explained`: a row for each place.
    """
    values: dict[str, list[Any]] = {
        name: [plan.points[condition.point][name] for condition in places] for name in varied(plan)
    }
    if len(plan.arms) > 1:
        values[ARM] = [condition.arm for condition in places]
    if len(plan.followers) > 1:
        values[FOLLOWER] = [condition.follower for condition in places]
    return {name: _coded(plan, name, place_values) for name, place_values in values.items()}


def _analysis_of_variance(
    coded: Mapping[str, Floats | Ints],
    samples: Floats,
    resamples: int,
    random: np.random.Generator,
) -> dict[str, Interval]:
    """Main effects of a factorial design, and the share of their interactions."""
    count = samples.shape[1]
    weights: Floats | Ints = np.ones((0, 1))
    if count > 1:
        weights = random.multinomial(count, np.full(count, 1.0 / count), resamples)
    measured = ~np.isnan(samples)
    means = np.nanmean(samples, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        resampled = (np.where(measured, samples, 0.0) @ weights.T) / (measured @ weights.T)
    # the share of the means of the samples, then of each resample
    shares = {
        name: explained(factor, np.column_stack([means, resampled]))
        for name, factor in coded.items()
    }
    shares[INTERACTIONS] = 1.0 - np.sum(list(shares.values()), axis=0)
    effects = {}
    for name, share in shares.items():
        low, high = _limits(share[1:]) if count > 1 else (np.nan, np.nan)
        effects[name] = Interval(float(share[0]), low, high)
    return effects


def _quadratic_effects(
    coded: Mapping[str, Floats | Ints],
    samples: Floats,
    points: Ints,
    resamples: int,
    random: np.random.Generator,
) -> dict[str, Interval]:
    """Adjusted R² of a quadratic in each factor of a sampled design; `points` are indices of the
    points of the places, shape (places,).
    """
    places = points.size
    means = np.nanmean(samples, axis=1)
    count = np.unique(points).size
    by_point = np.argsort(points, kind="stable").reshape(count, -1)
    # all points, then those of each resample
    resamples_of = [np.arange(count), *random.integers(0, count, (resamples, count))]
    effects = {}
    for name, factor in coded.items():
        rows = (by_point[picked].ravel() for picked in resamples_of)
        share = np.array([explained(factor[r], means[r, None])[0] for r in rows])
        k = factor.shape[1] if factor.ndim == 2 else int(factor.max())
        degrees_of_freedom = max(places - 1 - k, 1)
        adjusted = np.maximum(1.0 - (1.0 - share) * (places - 1) / degrees_of_freedom, 0.0)
        low, high = _limits(adjusted[1:])
        effects[name] = Interval(float(adjusted[0]), low, high)
    return effects

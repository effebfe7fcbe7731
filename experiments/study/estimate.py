"""Estimates of a metric at a point: means with intervals, and paired differences of arms.

Realizations are drawn independently, and runs have noise of their own; arms share both, so that their differences are
taken run by run. With several realizations the interval is for the mean over the population of realizations; with one
it is for that realization alone.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtrit

from experiments.campaign.store import Record
from experiments.intervals import (
    CONFIDENCE,
    FEWEST_RUNS,
    Interval,
    difference_of_shares,
    exact_limits,
    mean_interval,
    proportion,
)
from experiments.study.metrics import SHARES
from laisn.arrays import Floats

Place = tuple[int, str, str]
"""Point, arm and follower."""


def digits(value: float) -> str:
    """A number with three significant digits, zeros included, so that 0.500 stands beside 0.497; a dash for NaN."""
    if math.isnan(value):
        return "–"
    return (f"{value:,.0f}" if abs(value) >= 1000 else f"{value:#.3g}".rstrip(".")).replace("-", "−")


def shown(interval: Interval, unit: str = "") -> str:
    """An estimate and its unit, with limits in brackets if the data give them; a dash for NaN."""
    value = digits(interval.value) + (f" {unit}" if unit and not math.isnan(interval.value) else "")
    limits = "" if math.isnan(interval.low) else f" ({digits(interval.low)} to {digits(interval.high)})"
    return value + limits


def _quantile(number: int) -> float:
    """Student's t of a mean of this number of values."""
    return float(stdtrit(number - 1, (1 + CONFIDENCE) / 2))


def over_realizations(means: Floats) -> Interval:
    """Mean over realizations, shape (S,): `mean_interval` of at least `FEWEST_RUNS`, else Student's t, which needs two.

    Limits are NaN where all realizations have the same: nothing is known of how they scatter.

    Each realization's mean holds the scatter of its runs already, so that runs are not drawn again (Davison & Hinkley,
    Bootstrap Methods and their Application, 1997, section 3.8).
    """
    mean = float(means.mean())
    if means.size < 2 or np.ptp(means) == 0:
        return Interval(mean, math.nan, math.nan)
    if means.size >= FEWEST_RUNS:
        return mean_interval(means)
    half = _quantile(means.size) * float(means.std(ddof=1)) / math.sqrt(means.size)
    return Interval(mean, mean - half, mean + half)


def share_over_realizations(realizations: Sequence[Floats]) -> Interval:
    """Share of runs with an outcome that is 0 or 1, every realization counting alike, shape (R,) for each.

    Limits of Clopper and Pearson for as many independent runs as would scatter like the means of the realizations (Korn
    & Graubard, Survey Methodology 24, 1998). Where no run has the outcome, or all have, a realization counts as one
    run.
    """
    means = np.array([values.mean() for values in realizations])
    count, runs, share = means.size, sum(values.size for values in realizations), float(means.mean())
    scatter = float(means.var(ddof=1)) / count
    alike = float(count)
    if 0.0 < share < 1.0:
        most = share * (1.0 - share) * (_quantile(runs) / _quantile(count)) ** 2
        alike = min(most / scatter, float(runs)) if scatter > 0 else float(runs)
    return Interval(share, *exact_limits(share * alike, alike))


def over_runs(realizations: Sequence[Floats], *, shares: bool = False, paired: bool = False) -> Interval:
    """Mean of values of runs, shape (R,) for each realization, every realization counting alike.

    Args:
        realizations: values of each realization.
        shares: values are 0 or 1, or differences of such.
        paired: they are differences.
    """
    if len(realizations) > 1:
        if shares and not paired:
            return share_over_realizations(realizations)
        means = np.array([values.mean() for values in realizations])
        # realizations that all differ by nothing do not make a difference impossible
        return difference_of_shares(means) if shares and np.ptp(means) == 0 else over_realizations(means)
    (values,) = realizations
    if shares:
        return difference_of_shares(values) if paired else proportion(int(values.sum()), values.size)
    if np.ptp(values) == 0:
        return Interval(float(values[0]), math.nan, math.nan)
    return mean_interval(values)


def _whole(values: Floats) -> Floats:
    return values[~np.isnan(values)]


NOTHING = Interval(math.nan, math.nan, math.nan)
"""What there is where nothing was flown."""


def _interval(runs: Sequence[Floats] | None, realizations: Floats, metric: str, *, paired: bool = False) -> Interval:
    """Mean and interval of values of runs, or of realizations where there are none of runs; NaN where one has none."""
    whole = None if runs is None else [_whole(values) for values in runs]
    if not realizations.size or (
        np.isnan(realizations).any() if whole is None else not all(values.size for values in whole)
    ):
        return NOTHING
    return (
        over_realizations(realizations) if whole is None else over_runs(whole, shares=metric in SHARES, paired=paired)
    )


@dataclass(frozen=True, kw_only=True)
class Results:
    """Rows and runs of a study by place, realizations in their order.

    A run that contact ended has NaN for all that only a whole run has; means and differences are over the others.
    """

    rows: Mapping[Place, list[Record]]
    runs: Mapping[Place, list[Record]]
    _estimates: dict[tuple[Place, str], Interval] = field(default_factory=dict, init=False, compare=False)
    """Of places and metrics that were asked for: a page shows the same ones in several figures and tables."""

    @classmethod
    def of(cls, rows: Sequence[Record], runs: Sequence[tuple[Record, Record]]) -> "Results":
        """Sort the rows of a study."""
        by_place: dict[Place, list[Record]] = {}
        runs_of: dict[Place, list[Record]] = {}
        for row, (_, lists) in zip(rows, runs, strict=True):
            place = row["point"], row["arm"], row["follower"]
            by_place.setdefault(place, []).append(row)
            runs_of.setdefault(place, []).append(lists)
        return cls(rows=by_place, runs=runs_of)

    def by_run(self, place: Place, metric: str) -> list[Floats] | None:
        """Values of the runs of each realization; None if the metric is not one of single runs."""
        runs = self.runs.get(place, [])
        if not runs or any(metric not in lists for lists in runs):
            return None
        return [np.array(lists[metric], dtype=np.float64) for lists in runs]

    def by_realization(self, place: Place, metric: str) -> Floats:
        """A value for each realization, shape (S,); means over the runs where the metric is one of runs."""
        runs = self.by_run(place, metric)
        if runs is not None:
            whole = [_whole(values) for values in runs]
            return np.array([values.mean() if values.size else math.nan for values in whole])
        values = [row.get(metric) for row in self.rows.get(place, [])]
        return np.array([math.nan if value is None else value for value in values], dtype=np.float64)

    def estimate(self, place: Place, metric: str) -> Interval:
        """Mean of a metric at a place with its interval; NaN where nothing was flown."""
        if (place, metric) not in self._estimates:
            found = _interval(self.by_run(place, metric), self.by_realization(place, metric), metric)
            self._estimates[place, metric] = found
        return self._estimates[place, metric]

    def difference(self, place: Place, base: str, metric: str) -> Interval:
        """Mean of the arm of a place less that of the arm `base` at the same point, paired by realization and run."""
        other = (place[0], base, place[2])
        realizations, base_realizations = (
            [row["realization"] for row in self.rows.get(at, [])] for at in (place, other)
        )
        if realizations != base_realizations:
            return NOTHING
        runs, base_runs = self.by_run(place, metric), self.by_run(other, metric)
        if runs and base_runs and [one.size for one in runs] != [one.size for one in base_runs]:
            return NOTHING
        apart = [a - b for a, b in zip(runs, base_runs, strict=True)] if runs and base_runs else None
        return _interval(
            apart, self.by_realization(place, metric) - self.by_realization(other, metric), metric, paired=True
        )

    def differences(self, base: str, metric: str) -> dict[Place, Interval]:
        """Differences from the arm `base` at all places of other arms where both were flown."""
        places = [p for p in self.rows if p[1] != base and (p[0], base, p[2]) in self.rows]
        return {place: self.difference(place, base, metric) for place in places}

"""Confidence intervals: against closed forms, against SciPy's, and how often they cover the true
value.
"""

import math

import numpy as np
import pytest
from scipy import optimize, stats

from laisn.arrays import Floats
from reports.intervals import (
    FEWEST_RUNS,
    Interval,
    difference_of_shares,
    mean_interval,
    mean_over_missions,
    proportion,
    ratio_intervals,
    share_removed,
)
from tools.documents import coverage
from tools.documents.coverage import count_covering


@pytest.mark.parametrize(
    ("count", "of"), [(0, 40), (1, 5), (17, 40), (39, 40), (40, 40), (3, 60_000)]
)
@pytest.mark.parametrize("confidence", [0.95, 0.99])
def test_a_proportion_has_the_exact_limits(count: int, of: int, confidence: float) -> None:
    exact = stats.binomtest(count, of).proportion_ci(confidence, method="exact")
    assert proportion(count, of, confidence) == pytest.approx(
        (count / of, exact.low, exact.high), rel=1e-9, abs=1e-12
    )


def test_none_of_forty_is_at_most_nine_per_cent() -> None:
    """The upper limit solves (1 − p)⁴⁰ = 2.5 %."""
    low, high = proportion(0, 40)[1:]
    assert low == 0.0
    assert high == pytest.approx(1 - 0.025 ** (1 / 40), rel=1e-9)
    assert f"{high:.0%}" == "9%"


@pytest.mark.parametrize(("count", "of"), [(1, 0), (0, 0), (-1, 4), (5, 4)])
def test_what_is_no_proportion_is_refused(count: int, of: int) -> None:
    with pytest.raises(ValueError, match=f"{count} of {of} is no proportion"):
        proportion(count, of)


def _hall(values: Floats, confidence: float) -> tuple[float, float]:
    """Limits by Hall's cubic transformation, solved by bisection: g(T) = t / √n (J. R. Stat.
    Soc. B 54, 1992, 221).
    """
    n, skewness, spread = values.size, stats.skew(values), values.std(ddof=1)

    def cubic(t: float) -> float:
        return float(t + skewness * t**2 / 3 + skewness**2 * t**3 / 27 + skewness / (6 * n))

    t = stats.t.ppf((1 + confidence) / 2, n - 1) / math.sqrt(n)
    upper, lower = (
        optimize.brentq(lambda x, y=y: cubic(x) - y, -1e4, 1e4, xtol=1e-14) for y in (t, -t)
    )
    return values.mean() - spread * upper, values.mean() - spread * lower


@pytest.mark.parametrize("confidence", [0.95, 0.975])
@pytest.mark.parametrize("runs", [20, 64, 384])
@pytest.mark.parametrize("shape", [0.08, 0.7, 40.0])
def test_a_mean_has_the_limits_of_halls_transformation(
    shape: float, runs: int, confidence: float
) -> None:
    values = np.random.default_rng(3).gamma(shape, size=runs)
    actual = mean_interval(values, confidence=confidence)
    assert actual.value == pytest.approx(values.mean(), rel=1e-12)
    assert (actual.low, actual.high) == pytest.approx(_hall(values, confidence), rel=1e-6)


def test_values_without_skewness_have_the_limits_of_students_t() -> None:
    values = np.tile([-1.0, -0.5, 0.5, 1.0], 10) + 3.0
    half = stats.t.ppf(0.975, 39) * values.std(ddof=1) / math.sqrt(40)
    assert mean_interval(values) == pytest.approx((3.0, 3.0 - half, 3.0 + half), rel=1e-9)


@pytest.mark.parametrize(
    ("law", "runs", "least"),
    [
        ("normal", 20, 0.94),
        ("gamma", 20, 0.94),
        ("exponential", 20, 0.935),
        ("exponential", 60, 0.94),
        ("lognormal", 20, 0.91),
        ("lognormal", 60, 0.925),
        ("difference", 20, 0.93),
        ("difference", 60, 0.94),
        ("ratio", 20, 0.91),
        ("ratio", 60, 0.93),
        ("mirror", 20, 0.85),
        ("mirror", 60, 0.96),
    ],
)
def test_intervals_have_about_their_nominal_coverage(law: str, runs: int, least: float) -> None:
    """Where a tenth of runs locks on the mirror image, 0.9²⁰ = 12 % of samples of 20 runs have none
    of them, so that at most 88 % of intervals cover the true mean.
    """
    trials = 4000
    assert least <= count_covering(law, runs, trials) / trials < 0.985


def test_coverage_counts_what_is_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        coverage.LAWS,
        "known",
        coverage.Law("", 0.5, lambda rng, shape: (np.linspace(0, 1, 7)[None], None)),
    )
    limits = [
        (0.5, 0.6),
        (0.4, 0.5),
        (0.51, 0.6),
        (0.4, 0.49),
        (0.0, 1.0),
        (math.nan, math.nan),
        (0.6, 0.9),
    ]
    monkeypatch.setattr(
        coverage, "ratio_intervals", lambda above, below: [Interval(0.5, *pair) for pair in limits]
    )
    assert count_covering("known", 20, 7) == 3


def test_only_runs_that_count_are_in_a_mean() -> None:
    rng = np.random.default_rng(5)
    values, counted = rng.normal(3.0, 1.0, 400), rng.random(400) < 0.3
    values_with_outliers = np.where(counted, values, 1e6)
    with_mask, counted_only = (
        mean_interval(values_with_outliers, counted),
        mean_interval(values[counted]),
    )
    assert with_mask.value == pytest.approx(values[counted].mean(), rel=1e-12)
    assert with_mask == pytest.approx(counted_only, rel=1e-9)


def test_equal_values_have_an_interval_of_no_width() -> None:
    assert mean_interval(np.full(64, 0.25)) == (0.25, 0.25, 0.25)


def test_few_runs_have_no_limits() -> None:
    counted = np.arange(64) < FEWEST_RUNS - 1
    interval = mean_interval(np.ones(64), counted)
    assert interval.value == 1.0
    assert math.isnan(interval.low)
    assert math.isnan(interval.high)
    assert math.isnan(mean_interval(np.ones(64), np.zeros(64, dtype=bool)).value)


def test_a_ratio_counts_whole_runs() -> None:
    # messages of a run are all alike: there are 80 independent trials, not 8000
    per_message = (np.arange(80) % 4 == 0).astype(float)
    (interval,) = ratio_intervals((100 * per_message)[:, None], np.full((80, 1), 100.0))
    half = 1.96 * math.sqrt(0.25 * 0.75 / 80)
    assert interval.value == pytest.approx(0.25)
    assert (interval.low, interval.high) == pytest.approx(
        (0.25 - half, 0.25 + half), abs=0.15 * half
    )


@pytest.mark.parametrize(
    ("rates", "runs"), [((0.3, 0.3), 64), ((0.02, 0.0), 64), ((0.001, 0.001), 384)]
)
def test_limits_of_a_difference_of_shares_cover_the_true_one(
    rates: tuple[float, float], runs: int
) -> None:
    rng, trials = np.random.default_rng(7), 3000
    gained_rate, lost_rate = rates
    draw = rng.random((trials, runs))
    difference = (draw < gained_rate).astype(float) - (draw > 1 - lost_rate).astype(float)
    actual = [difference_of_shares(d) for d in difference]
    sampling_error = 3 * math.sqrt(0.025 * 0.975 / trials)
    assert (
        np.mean([i.high < gained_rate - lost_rate for i in actual])
        <= 0.025 + sampling_error + 0.005
    )
    assert (
        np.mean([i.low > gained_rate - lost_rate for i in actual]) <= 0.025 + sampling_error + 0.005
    )


def test_a_difference_that_no_run_shows_has_limits_all_the_same() -> None:
    no_changes = difference_of_shares(np.zeros(64))
    assert no_changes.value == 0.0
    # z √(2 / 66) / √66: 2 added runs of 66 in all
    assert no_changes.high == pytest.approx(1.959964 * math.sqrt(2 / 66 / 66), rel=1e-6)
    assert no_changes.low == -no_changes.high
    assert difference_of_shares(np.ones(30)).high == 1.0


def test_a_mean_over_missions_has_the_scatter_of_their_runs() -> None:
    missions = [np.array([1.0, 3.0]), np.array([10.0, 10.0, 13.0])]
    # variances of the means: 2/2 and 3/3; of their average: (1 + 1) / 4
    half = 1.959964 * math.sqrt(0.5)
    assert mean_over_missions(missions) == pytest.approx((6.5, 6.5 - half, 6.5 + half), rel=1e-6)


def test_a_share_of_sums_weighs_missions_by_what_there_is_to_remove() -> None:
    rng = np.random.default_rng(8)
    errors = [1.0 + 0.01 * rng.normal(size=50), 9.0 + 0.01 * rng.normal(size=50)]
    remaining_errors = [0.5 * errors[0], 0.1 * errors[1]]
    expected = 1.0 - (0.5 * errors[0].mean() + 0.1 * errors[1].mean()) / (
        errors[0].mean() + errors[1].mean()
    )
    share = share_removed(list(zip(errors, remaining_errors, strict=True)))
    assert share.value == pytest.approx(expected, rel=1e-12)
    assert share.low < share.value < share.high


def test_the_interval_of_a_share_has_its_nominal_coverage() -> None:
    rng, trials = np.random.default_rng(9), 2000
    misses = 0
    for _ in range(trials):
        missions = []
        for size in (0.2, 1.0, 3.0):
            error = size * rng.gamma(1.0, size=40)
            missions.append((error, 0.15 * error + 0.2 * rng.normal(size=40)))
        share = share_removed(missions)
        misses += not share.low <= 0.85 <= share.high
    assert misses / trials == pytest.approx(0.05, abs=3 * math.sqrt(0.05 * 0.95 / trials) + 0.005)


def test_a_share_of_nothing_has_no_limits() -> None:
    noise = np.random.default_rng(10).normal(size=(2, 60))
    barely = noise[0] - noise[0].mean() + 0.1
    assert math.isnan(share_removed([(barely, noise[1])]).low)
    zero = share_removed([(np.zeros(30), noise[1, :30])])
    assert math.isnan(zero.value)


@pytest.mark.parametrize("runs", [700, 1280])
def test_many_runs_have_limits_of_second_order(runs: int) -> None:
    """They are twice 1.96 standard errors apart; to second order their middle is moved by
    (2 z² + 1) γ / 6 √n of these errors, where γ is the skewness.
    """
    rng = np.random.default_rng(runs)
    values = rng.gamma(1.0, size=runs)
    counted = rng.random(runs) < 0.8
    actual = mean_interval(values, counted)
    counted_values = values[counted]
    error = counted_values.std() / np.sqrt(counted_values.size)
    assert actual.value == pytest.approx(counted_values.mean(), rel=1e-12)
    assert actual.high - actual.low == pytest.approx(2 * 1.96 * error, rel=0.1)
    shift = (
        (2 * 1.96**2 + 1)
        * float(np.mean(((counted_values - counted_values.mean()) / counted_values.std()) ** 3))
        / 6
        / np.sqrt(counted_values.size)
    )
    assert (actual.high + actual.low) / 2 - actual.value == pytest.approx(
        shift * error, abs=0.06 * error
    )


def test_a_study_that_stops_by_its_interval_takes_as_many_runs_as_the_law_needs() -> None:
    """σ = 1 and half of an interval of 0.1 need (1.96 / 0.1)² = 384 runs; an interval is no
    wider than required.
    """
    intervals = [
        coverage.interval_when_stopped("normal", np.random.default_rng(seed)) for seed in range(50)
    ]
    half_widths = np.array([(interval.high - interval.low) / 2 for interval in intervals])
    assert half_widths.max() <= 0.1
    assert np.median(half_widths) > 0.08
    assert coverage.count_covering_when_stopped("normal", 200) == pytest.approx(190, abs=12)

"""Confidence intervals: against closed forms, scipy's own, and how often they hold what they should."""

import math

import numpy as np
import pytest
from scipy import stats

from experiments.intervals import (
    FEWEST_RUNS,
    Interval,
    bootstrap_mean,
    bootstrap_ratios,
    difference_of_shares,
    mean_over_missions,
    proportion,
    share_removed,
)


@pytest.mark.parametrize(("count", "of"), [(0, 40), (1, 5), (17, 40), (39, 40), (40, 40), (3, 60_000)])
@pytest.mark.parametrize("confidence", [0.95, 0.99])
def test_a_proportion_has_the_exact_limits(count: int, of: int, confidence: float) -> None:
    exact = stats.binomtest(count, of).proportion_ci(confidence, method="exact")
    assert proportion(count, of, confidence) == pytest.approx((count / of, exact.low, exact.high), rel=1e-9, abs=1e-12)


def test_none_of_forty_is_at_most_nine_per_cent() -> None:
    low, high = proportion(0, 40)[1:]
    assert low == 0.0
    assert high == pytest.approx(1 - 0.025 ** (1 / 40), rel=1e-9)
    assert f"{high:.0%}" == "9%"


@pytest.mark.parametrize(("count", "of"), [(1, 0), (0, 0), (-1, 4), (5, 4)])
def test_what_is_no_proportion_is_refused(count: int, of: int) -> None:
    with pytest.raises(ValueError, match=f"{count} of {of} is no proportion"):
        proportion(count, of)


@pytest.mark.parametrize("confidence", [0.95, 0.975])
@pytest.mark.parametrize("runs", [64, 384])
def test_the_bootstrap_is_that_of_scipy(runs: int, confidence: float) -> None:
    values = np.random.default_rng(3).gamma(0.7, size=runs)
    theirs = stats.bootstrap((values,), np.mean, n_resamples=9999, confidence_level=confidence, method="BCa",
                             rng=np.random.default_rng(4)).confidence_interval  # fmt: skip
    ours = bootstrap_mean(values, confidence=confidence)
    width = theirs.high - theirs.low
    assert ours.value == pytest.approx(values.mean(), rel=1e-12)
    # quantiles of 2000 resamples scatter by a few per cent of the width
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.08 * width)


def test_skewed_runs_push_the_interval_to_their_tail() -> None:
    """It agrees with scipy's; without acceleration, its upper end would lie lower than the tolerance here allows."""
    values = np.random.default_rng(15).gamma(0.08, size=64)
    theirs = stats.bootstrap((values,), np.mean, n_resamples=9999, method="BCa",
                             rng=np.random.default_rng(16)).confidence_interval  # fmt: skip
    ours = bootstrap_mean(values)
    assert ours.high - ours.value > 1.5 * (ours.value - ours.low)
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.08 * (theirs.high - theirs.low))


def test_only_runs_that_count_are_in_a_mean() -> None:
    rng = np.random.default_rng(5)
    values, counted = rng.normal(3.0, 1.0, 400), rng.random(400) < 0.3
    spoiled = np.where(counted, values, 1e6)
    among, alone = bootstrap_mean(spoiled, counted), bootstrap_mean(values[counted])
    assert among.value == pytest.approx(values[counted].mean(), rel=1e-12)
    assert (among.low, among.high) == pytest.approx((alone.low, alone.high), abs=0.1 * (alone.high - alone.low))


def test_equal_values_leave_nothing_open() -> None:
    assert bootstrap_mean(np.full(64, 0.25)) == (0.25, 0.25, 0.25)


def test_few_runs_bound_nothing() -> None:
    counted = np.arange(64) < FEWEST_RUNS - 1
    interval = bootstrap_mean(np.ones(64), counted)
    assert interval.value == 1.0
    assert math.isnan(interval.low)
    assert math.isnan(interval.high)
    assert not interval.beyond(0.5)
    assert not interval.short(2.0)
    assert math.isnan(bootstrap_mean(np.ones(64), np.zeros(64, dtype=bool)).value)


def test_the_bootstrap_holds_the_mean_of_skewed_runs_as_often_as_it_says() -> None:
    rng, trials = np.random.default_rng(6), 2000
    values = rng.gamma(2.0, size=(96, trials))
    below = above = 0
    for first in range(0, trials, 500):
        block = values[:, first : first + 500]
        found = bootstrap_ratios(block, np.ones_like(block))
        below += sum(i.high < 2.0 for i in found)
        above += sum(i.low > 2.0 for i in found)
    # BCa is of second order: a few tenths of a per cent at 96 runs, beside the scatter of 2000 trials
    scatter = 3 * math.sqrt(0.025 * 0.975 / trials)
    assert below / trials == pytest.approx(0.025, abs=scatter + 0.005)
    assert above / trials == pytest.approx(0.025, abs=scatter + 0.005)


def test_a_ratio_draws_whole_runs() -> None:
    # messages of a run are all alike: there are 80 independent trials, not 8000
    alike = (np.arange(80) % 4 == 0).astype(float)
    (interval,) = bootstrap_ratios((100 * alike)[:, None], np.full((80, 1), 100.0))
    half = 1.96 * math.sqrt(0.25 * 0.75 / 80)
    assert interval.value == pytest.approx(0.25)
    assert (interval.low, interval.high) == pytest.approx((0.25 - half, 0.25 + half), abs=0.15 * half)


@pytest.mark.parametrize(("rates", "runs"), [((0.3, 0.3), 64), ((0.02, 0.0), 64), ((0.001, 0.001), 384)])
def test_limits_of_a_difference_of_captures_hold_it(rates: tuple[float, float], runs: int) -> None:
    rng, trials = np.random.default_rng(7), 3000
    more, fewer = rates
    draw = rng.random((trials, runs))
    difference = (draw < more).astype(float) - (draw > 1 - fewer).astype(float)
    found = [difference_of_shares(d) for d in difference]
    scatter = 3 * math.sqrt(0.025 * 0.975 / trials)
    assert np.mean([i.high < more - fewer for i in found]) <= 0.025 + scatter + 0.005
    assert np.mean([i.low > more - fewer for i in found]) <= 0.025 + scatter + 0.005


def test_what_no_run_did_is_not_impossible() -> None:
    none = difference_of_shares(np.zeros(64))
    assert none.value == 0.0
    # z √(2 / 66) / √66: 2 added runs of 66 in all
    assert none.high == pytest.approx(1.959964 * math.sqrt(2 / 66 / 66), rel=1e-6)
    assert none.low == -none.high
    assert difference_of_shares(np.ones(30)).high == 1.0


def test_a_mean_over_missions_has_the_scatter_of_their_runs() -> None:
    missions = [np.array([1.0, 3.0]), np.array([10.0, 10.0, 13.0])]
    # variances of the means: 2/2 and 3/3; of their average: (1 + 1) / 4
    half = 1.959964 * math.sqrt(0.5)
    assert mean_over_missions(missions) == pytest.approx((6.5, 6.5 - half, 6.5 + half), rel=1e-6)


def test_a_share_of_sums_weighs_missions_by_what_there_is_to_remove() -> None:
    rng = np.random.default_rng(8)
    parts = [1.0 + 0.01 * rng.normal(size=50), 9.0 + 0.01 * rng.normal(size=50)]
    lefts = [0.5 * parts[0], 0.1 * parts[1]]
    expected = 1.0 - (0.5 * parts[0].mean() + 0.1 * parts[1].mean()) / (parts[0].mean() + parts[1].mean())
    share = share_removed(list(zip(parts, lefts, strict=True)))
    assert share.value == pytest.approx(expected, rel=1e-12)
    assert share.low < share.value < share.high


def test_a_share_holds_the_truth_as_often_as_it_says() -> None:
    rng, trials = np.random.default_rng(9), 2000
    outside = 0
    for _ in range(trials):
        missions = []
        for size in (0.2, 1.0, 3.0):
            part = size * rng.gamma(1.0, size=40)
            missions.append((part, 0.15 * part + 0.2 * rng.normal(size=40)))
        share = share_removed(missions)
        outside += not share.low <= 0.85 <= share.high
    assert outside / trials == pytest.approx(0.05, abs=3 * math.sqrt(0.05 * 0.95 / trials) + 0.005)


def test_a_share_of_nothing_has_no_limits() -> None:
    noise = np.random.default_rng(10).normal(size=(2, 60))
    barely = noise[0] - noise[0].mean() + 0.1
    assert math.isnan(share_removed([(barely, noise[1])]).low)
    zero = share_removed([(np.zeros(30), noise[1, :30])])
    assert math.isnan(zero.value)


def test_beyond_and_short_need_the_whole_interval() -> None:
    interval = Interval(0.9, 0.85, 0.95)
    assert (interval.beyond(0.85), interval.beyond(0.86)) == (True, False)
    assert (interval.short(0.96), interval.short(0.95)) == (True, False)


@pytest.mark.parametrize("runs", [700, 1280])
def test_many_runs_are_drawn_in_blocks_to_the_same_end(runs: int) -> None:
    """Twice 1.96 standard errors, and for skewed values moved by what BCa limits of a mean are, to second order."""
    rng = np.random.default_rng(runs)
    values = rng.gamma(1.0, size=runs)
    counted = rng.random(runs) < 0.8
    found = bootstrap_mean(values, counted)
    some = values[counted]
    error = some.std() / np.sqrt(some.size)
    assert found.value == pytest.approx(some.mean(), rel=1e-12)
    assert found.high - found.low == pytest.approx(2 * 1.96 * error, rel=0.1)
    shift = (2 * 1.96**2 + 1) * float(np.mean(((some - some.mean()) / some.std()) ** 3)) / 6 / np.sqrt(some.size)
    assert (found.high + found.low) / 2 - found.value == pytest.approx(shift * error, abs=0.06 * error)

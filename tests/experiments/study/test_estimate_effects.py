"""Shares of variance: of factors that add or interact in closed form, and of a function with
known Sobol' indices.
"""

import itertools

import numpy as np
import pytest

from experiments.study.estimate import INTERACTIONS, Results, _limits, explained, main_effects
from experiments.study.file import study_from_table
from experiments.study.plan import StudyPlan, plan_of

TABLE = {"scenario": "T5", "runs": 40, "set": {"duration_s": 20.0}}


def results_of(plan: StudyPlan, mean, noise: float = 0.0) -> Results:
    """Runs of all points and arms: `mean` of the point's values and the arm, plus the same 40 draws
    of noise, in every third point once, twice and three times as large.
    """
    rows, runs, draws = [], [], np.random.default_rng(2).normal(0.0, noise, 40)
    for (i, point), arm in itertools.product(enumerate(plan.points), plan.arms):
        row = {"point": i, "arm": arm, "follower": plan.followers[0], "realization": 0, "seed": 1}
        values = mean(*point.values(), arm) + draws * (1 + i % 3)
        rows.append(row)
        runs.append((row, {"e_p_mean_m": values.tolist()}))
    return Results.of(rows, runs)


@pytest.fixture(scope="module")
def factorial() -> StudyPlan:
    vary = {"followers.0.depth_m": [10.0, 12.0, 14.0], "leader.depth_m": [5.0, 7.0]}
    return plan_of(
        study_from_table(
            TABLE | {"vary": vary, "arm": [{"name": "a"}, {"name": "b"}]}, "mine.toml", "mine"
        )
    )


def test_factors_that_add_explain_their_own_variances(factorial: StudyPlan) -> None:
    """3 x + 2 y + z of x in −1, 0, 1, y of ±1 and the arm's z of ±1: variances 2/3 · 3², 2², 1."""

    def mean(x: float, y: float, arm: str) -> float:
        return 10 + 3.0 * (x - 12) / 2 + 2.0 * (y - 6) + (1.0 if arm == "a" else -1.0)

    actual = main_effects(factorial, results_of(factorial, mean), "e_p_mean_m")
    assert list(actual) == ["followers.0.depth_m", "leader.depth_m", "arm", INTERACTIONS]
    assert [share.value for share in actual.values()] == pytest.approx(
        [6 / 11, 4 / 11, 1 / 11, 0.0], abs=1e-12
    )
    assert all(
        share.low <= share.value + 1e-9 and share.value <= share.high + 1e-9
        for share in actual.values()
    )


def test_what_only_two_factors_together_do_is_interaction(factorial: StudyPlan) -> None:
    actual = main_effects(
        factorial, results_of(factorial, lambda x, y, _: 10 + (x - 12) * (y - 6)), "e_p_mean_m"
    )
    assert actual[INTERACTIONS].value == pytest.approx(1.0)
    assert actual["followers.0.depth_m"].value == pytest.approx(0.0, abs=1e-12)


def test_noise_widens_the_intervals(factorial: StudyPlan) -> None:
    def width(noise: float) -> float:
        actual = main_effects(
            factorial, results_of(factorial, lambda x, y, _: x + y, noise), "e_p_mean_m"
        )
        share = actual["followers.0.depth_m"]
        assert share.low < share.value < share.high
        return share.high - share.low

    assert width(0.1) < width(1.0)


@pytest.mark.parametrize("design", ["latin-hypercube", "sobol"])
def test_sampled_ranges_have_their_sobol_indices(design: str) -> None:
    """2 u + v² + w of u, v, w in 0 … 1: variances 4/12, 4/45 and 1/12, which a quadratic
    explains whole.
    """
    ranges = (
        {"from": 10.0, "to": 14.0},
        {"from": 5.0, "to": 7.0},
        {"from": 0.01, "to": 1.0, "scale": "log"},
    )
    keys = "followers.0.depth_m", "leader.depth_m", "sensors.speed_bias_m_s"
    table = TABLE | {"vary": dict(zip(keys, ranges, strict=True)), "design": design, "points": 128}
    plan = plan_of(study_from_table(table, "mine.toml", "mine"))

    def mean(x: float, y: float, z: float, _: str) -> float:
        return (x - 10) / 2 + ((y - 5) / 2) ** 2 + (np.log10(z) + 2) / 2

    actual = main_effects(plan, results_of(plan, mean), "e_p_mean_m")
    total = 4 / 12 + 4 / 45 + 1 / 12
    for key, variance in zip(keys, (4 / 12, 4 / 45, 1 / 12), strict=True):
        assert actual[key].value == pytest.approx(variance / total, abs=0.06)
        assert actual[key].low < variance / total < actual[key].high
    assert INTERACTIONS not in actual


def test_a_single_factor_and_constant_columns_have_no_shares(factorial: StudyPlan) -> None:
    assert main_effects(factorial, results_of(factorial, lambda *_: 3.0), "e_p_mean_m") == {}
    single_factor = plan_of(
        study_from_table(TABLE | {"vary": {"leader.depth_m": [5.0, 7.0]}}, "mine.toml", "mine")
    )
    assert (
        main_effects(single_factor, results_of(single_factor, lambda y, _: y), "e_p_mean_m") == {}
    )


def test_limits_leave_a_fortieth_of_the_resamples_at_each_end() -> None:
    assert _limits(np.arange(1001.0)) == pytest.approx((25.0, 975.0))
    assert _limits(np.array([np.nan, 3.0, 3.0])) == (3.0, 3.0)


def test_a_regression_explains_what_lies_in_its_columns() -> None:
    x = np.array([[0.0], [1.0], [2.0]])
    shares = explained(x, np.array([[0.0, 1.0], [2.0, 0.0], [4.0, 1.0]]))
    assert shares == pytest.approx([1.0, 0.0], abs=1e-12)
    # of two levels with means 1 and 5: 4 + 4 + 4 + 4 of 16 + 4
    assert explained(
        np.array([0, 0, 1, 1]), np.array([[0.0], [2.0], [4.0], [6.0]])
    ) == pytest.approx([0.8])


def test_resampling_is_repeatable(factorial: StudyPlan) -> None:
    results = results_of(factorial, lambda x, y, _: x + y, 1.0)
    assert main_effects(factorial, results, "e_p_mean_m") == main_effects(
        factorial, results, "e_p_mean_m"
    )

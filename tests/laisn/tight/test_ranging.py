"""Ranges of the tightly coupled navigator: derivatives, updates, echoes; all against independent
formulas.
"""

import itertools
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import multivariate_normal

from laisn.arrays import Floats
from laisn.settings import Assume, TightSettings
from laisn.tight.model import GaussianMixture, Model, model_of, new_belief
from laisn.tight.ranging import Signal, new_signal, predict_ranges, update

EVERYTHING = TightSettings(
    assume=Assume(exact_leader=False, drift=False, current=True, offsets=True, clock=True)
)
STATES = 12
ARMS = np.array([[-0.9, -0.4, 1.5], [0.9, 0.4, 2.0], [-0.04, 0.1, 1.7]])
LEADER = np.array([3.0, -4.0])
STATE = np.array([25.0, -12.0, 0.1, 0.05, 0.15, 0.08, 0.2, -0.1, 0.01, -0.02, 0.3, 0.002])


def ranges_of(
    state: npt.NDArray[np.complex128] | Floats, farthest: float
) -> npt.NDArray[np.complex128]:
    """z_i = ρ_i (1 + b_r / max z) + d_i + τ, analytic in the state."""
    turn = np.exp(1j * 0) * np.array(
        [[np.cos(state[5]), -np.sin(state[5])], [np.sin(state[5]), np.cos(state[5])]]
    )
    apart = state[:2] - LEADER - (turn @ ARMS[:, :2].T).T
    rho = np.sqrt(np.sum(apart**2, axis=1) + ARMS[:, 2] ** 2)
    return np.asarray(
        rho * (1.0 + state[4] / farthest) + np.concatenate([[0.0], state[8:10]]) + state[10]
    )


def gradient(state: Floats, farthest: float) -> Floats:
    """Derivatives of all ranges by the states, from complex steps, shape (3, n)."""
    step = 1e-30
    columns = [ranges_of(state + 1j * step * unit, farthest).imag / step for unit in np.eye(STATES)]
    return np.stack(columns, axis=1)


def belief(
    covariance: Floats, mean: Floats = STATE, settings: TightSettings = EVERYTHING
) -> tuple[GaussianMixture, Model]:
    model = model_of(settings)
    made = new_belief(settings, model, (0.0, 0.0))
    n = len(mean)
    made.state[0, :n] = mean
    made.covariance[0, :n, :n] = covariance
    return made, model


def signal(ranges: Floats) -> Signal:
    message = new_signal()
    message.east, message.north, message.heading, message.speed = *LEADER, 0.3, 1.0
    message.arms, message.ranges = ARMS, ranges
    return message


def some_covariance(scale: float) -> Floats:
    root = np.random.default_rng(7).normal(size=(STATES, STATES)) * scale
    return np.asarray(root @ root.T)


def test_derivatives_of_ranges_equal_complex_steps() -> None:
    ranges = ranges_of(STATE, 30.0).real
    made, model = belief(np.eye(STATES))
    assert predict_ranges(made, model, 0, signal(ranges), 0.0, 0.0) == 3
    # the scale's own slope is neglected against 1 in the derivatives by position: b_r is
    # centimetres at tens of metres
    plain = STATE.copy()
    plain[4] = 0.0
    exact = gradient(plain, float(ranges.max()))
    # the common error is in proportion to what was measured
    exact[:, 4] = ranges / ranges.max()
    np.testing.assert_allclose(made.work.gain[:, :STATES], exact, atol=1e-12)


def test_second_derivatives_equal_differences_of_complex_steps() -> None:
    plain = STATE.copy()
    plain[4] = 0.0
    ranges = ranges_of(plain, 30.0).real
    made, model = belief(np.eye(STATES), plain)
    predict_ranges(made, model, 0, signal(ranges), 0.0, 0.0)
    step, chosen = 1e-5, [0, 1, 5]
    for j, other in itertools.product(range(3), range(3)):
        unit = np.eye(STATES)[chosen[other]] * step
        slope = (gradient(plain + unit, 30.0) - gradient(plain - unit, 30.0)) / (2 * step)
        np.testing.assert_allclose(made.work.curvature[:, j, other], slope[:, chosen[j]], atol=1e-8)


def test_expected_ranges_equal_their_mean_over_a_gaussian() -> None:
    # the expectation over position and leader's compass by 10⁶ antithetic draws: second order is
    # exact to σ⁴
    covariance = np.zeros((STATES, STATES))
    root = np.random.default_rng(5).normal(size=(3, 3)) * np.array([[0.8], [0.8], [0.05]])
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] = root @ root.T
    plain = STATE.copy()
    plain[4] = 0.0
    made, model = belief(covariance, plain)
    predict_ranges(made, model, 0, signal(np.zeros(3) + 30.0), 0.0, 0.0)
    half = np.random.default_rng(1).normal(size=(500_000, 3)) @ root.T
    draws = np.concatenate([half, -half])
    x, y, bias = plain[0] + draws[:, 0], plain[1] + draws[:, 1], plain[5] + draws[:, 2]
    for i in range(3):
        sx = np.cos(bias) * ARMS[i, 0] - np.sin(bias) * ARMS[i, 1]
        sy = np.sin(bias) * ARMS[i, 0] + np.cos(bias) * ARMS[i, 1]
        rho = np.sqrt((x - LEADER[0] - sx) ** 2 + (y - LEADER[1] - sy) ** 2 + ARMS[i, 2] ** 2)
        offset = plain[10] + (plain[7 + i] if i else 0.0)
        mean = 0.5 * (rho[:500_000] + rho[500_000:])
        assert 30.0 - made.work.residual[i] == pytest.approx(
            mean.mean() + offset, abs=4 * mean.std() / 700 + 1e-4
        )


@pytest.mark.parametrize("lost", [(), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2)])
def test_an_update_equals_filterpys(lost: tuple[int, ...]) -> None:
    """With a covariance so small that nothing bends, and no random error of the leader."""
    settings = replace(EVERYTHING, leader_heading_sigma=0.0)
    covariance = some_covariance(1e-3)
    plain = STATE.copy()
    plain[4] = 0.0
    ranges = ranges_of(plain, 30.0).real + np.array([0.003, -0.002, 0.004])
    ranges[list(lost)] = np.nan
    kept = [i for i in range(3) if i not in lost]
    made, model = belief(covariance, plain, settings)
    made.leader_variance = 0.0
    assert update(made, model, 0, signal(ranges)) == len(kept)

    exact = gradient(plain, float(np.nanmax(ranges)))
    exact[:, 4] = ranges / np.nanmax(ranges)
    hessians = np.array([second(plain, i) for i in range(3)])
    chosen = covariance[np.ix_([0, 1, 5], [0, 1, 5])]
    bent = [h @ chosen for h in hessians]
    share = exact[:, 4]
    # rows of missing ranges are not used
    share[list(lost)] = 0.0
    noise = settings.range_sigma**2 * np.eye(3) + settings.range_scale_sigma**2 * np.outer(
        share, share
    )
    noise += 0.5 * np.array([[np.trace(a @ b) for a in bent] for b in bent])
    kalman = KalmanFilter(dim_x=STATES, dim_z=len(kept))
    kalman.x, kalman.P = plain.copy(), covariance.copy()
    kalman.H, kalman.R = exact[kept], noise[np.ix_(kept, kept)]
    expected = ranges_of(plain, 30.0).real + 0.5 * np.array([np.trace(a) for a in bent])
    kalman.update(exact[kept] @ plain + (ranges - expected)[kept])
    np.testing.assert_allclose(made.state[0, :STATES], kalman.x, atol=1e-9)
    np.testing.assert_allclose(made.covariance[0, :STATES, :STATES], kalman.P, atol=1e-9)


def second(state: Floats, i: int) -> Floats:
    """Hessian of range i by x, y and b_L."""
    step, chosen = 1e-5, [0, 1, 5]
    rows = []
    for index in chosen:
        unit = np.eye(STATES)[index] * step
        rows.append(
            ((gradient(state + unit, 30.0) - gradient(state - unit, 30.0)) / (2 * step))[i, chosen]
        )
    return np.array(rows)


@pytest.mark.parametrize(
    "echo", [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.5, 3.0), (1.0, 2.0, 3.0)]
)
def test_the_subset_of_direct_ranges_is_the_likeliest_of_all(echo: tuple[float, ...]) -> None:
    plain = STATE.copy()
    plain[4] = 0.0
    covariance = some_covariance(0.01)
    ranges = ranges_of(plain, 30.0).real + np.array(echo)
    made, model = belief(covariance, plain)
    predict_ranges(made, model, 0, signal(ranges), 0.0, made.leader_variance)
    residual, spread = made.work.residual.copy(), made.work.innovation_covariance.copy()
    best = {}
    for size in range(4):
        for used in itertools.combinations(range(3), size):
            left = [i for i in range(3) if i not in used]
            total = size * np.log(0.95) + sum(
                np.log(0.05 / 4.5) - 6.0 * (residual[i] < 0) for i in left
            )
            if used:
                total += multivariate_normal.logpdf(
                    residual[list(used)], cov=spread[np.ix_(used, used)]
                )
            best[used] = total
    likeliest = max(best, key=best.__getitem__)
    assert update(made, model, 0, signal(ranges)) == len(likeliest)
    assert made.evidence[0] == pytest.approx(best[likeliest], abs=1e-9)


def test_a_message_of_which_nothing_came_teaches_nothing() -> None:
    made, model = belief(some_covariance(0.01))
    before = made.state.copy(), made.covariance.copy()
    outcome = made.outcome[0]
    made.evidence[0] = outcome["normalised_innovation"] = made.turn_excess[0] = 7.0
    assert update(made, model, 0, signal(np.full(3, np.nan))) == 0
    assert (
        made.evidence[0],
        made.outcome["normalised_innovation"][0],
        made.turn_excess[0],
        made.outcome["n_used"][0],
    ) == (0.0, 0.0, 0.0, 0)
    np.testing.assert_array_equal(made.state, before[0])
    np.testing.assert_array_equal(made.covariance, before[1])


def test_a_covariance_that_is_not_positive_definite_is_refused() -> None:
    made, model = belief(-np.eye(STATES))
    assert update(made, model, 0, signal(ranges_of(STATE, 30.0).real)) == -1
    made, model = belief(np.full((STATES, STATES), np.nan))
    assert update(made, model, 0, signal(ranges_of(STATE, 30.0).real)) == -1


def test_of_ranges_that_share_an_echo_only_the_difference_is_used() -> None:
    """Two transmitters 2 m apart, abeam at 10 m east: a delay common to both has no information on
    the distance.

    Ranges are ρ = (10² + 1)^½ each, and H of their difference is (0, 2/ρ). Of a late ping the
    difference of 4 cm is as it was; a reflection would have made it less likely.
    """
    config = TightSettings(transmitters=2, range_scale_sigma=0.0)
    model, sigma, rho = model_of(config), 0.3, np.sqrt(101.0)
    made, message = new_belief(config, model, (10.0, 0.0)), new_signal()
    made.covariance[0, :2, :2] = sigma**2 * np.eye(2)
    made.covariance[0, 4, 4] = 0.0
    message.arms = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    message.ranges = rho + 3.0 + 0.02, rho + 3.0 - 0.02, np.nan
    assert update(made, model, 0, message) == 1
    slope = 2.0 / rho
    assert made.state[0, 0] == pytest.approx(10.0, abs=1e-12)
    assert made.covariance[0, 0, 0] == pytest.approx(sigma**2, abs=1e-12)
    # ½ tr(F P F P) of the difference, whose second derivative by x and y is −2 x / ρ³
    bent = (2.0 * 10.0 / rho**3 * sigma**2) ** 2
    variance = slope**2 * sigma**2 + 2.0 * config.range_sigma**2 + bent
    assert made.state[0, 1] == pytest.approx(slope * sigma**2 / variance * 0.04, rel=0.05)
    assert made.covariance[0, 1, 1] == pytest.approx(
        sigma**2 - (slope * sigma**2) ** 2 / variance, abs=1e-4
    )
    assert made.outcome[0]["nis_sum"] == pytest.approx(0.04**2 / variance, rel=0.05)


def test_the_differences_of_a_reflection_are_those_of_the_direct_ways() -> None:
    """Both ways of a reflection are (ρ² + K)^½ long, as off a level floor: the direct ranges, and
    with them the bearing, follow from K, of which the mean range at the prediction tells.

    A follower 30 m east and 40 m north, whose bearing the prediction has 0.2 m off; taken as late,
    the difference would move it by metres to where it is a tenth smaller.
    """
    config = TightSettings(transmitters=2, range_scale_sigma=0.0)
    model = model_of(config)
    place = np.array([30.0, 40.0])
    aside = np.array([-0.8, 0.6])
    made, message = new_belief(config, model, tuple(place + 0.2 * aside)), new_signal()
    made.covariance[0, :2, :2] = 1e-4 * np.eye(2) + 0.25 * np.outer(aside, aside)
    made.covariance[0, 4, 4] = 0.0
    message.arms = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    message.echo_span = 10.0
    ranges = np.hypot(place[0], place[1] - np.array([-1.0, 1.0]))
    message.ranges[:2] = np.sqrt(ranges**2 + 600.0)
    message.ranges[2] = np.nan
    assert update(made, model, 0, message) == 1
    assert made.outcome[0]["shared"] == 1
    off = made.state[0, :2] - place
    # second-order terms and the width across leave some centimetres
    assert abs(off @ aside) < 0.05
    assert made.covariance[0, :2, :2].diagonal().sum() < 0.05

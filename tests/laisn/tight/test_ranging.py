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
from laisn.tight.ranging import RangeMessage, new_range_message, predict_ranges, update

EVERYTHING = TightSettings(
    assume=Assume(exact_leader=False, drift=False, current=True, offsets=True, clock=True)
)
STATES = 12
ARMS = np.array([[-0.9, -0.4, 1.5], [0.9, 0.4, 2.0], [-0.04, 0.1, 1.7]])
"""Transmitters from the leader: east, north, and depth below the hydrophone [m]."""
LEADER = np.array([3.0, -4.0])
"""The leader's position, east and north [m]."""
STATE = np.array([25.0, -12.0, 0.1, 0.05, 0.15, 0.08, 0.2, -0.1, 0.01, -0.02, 0.3, 0.002])
"""x, y, biases of log and compass, b_r of the common scale, b_L of the leader's compass, current
east and north, offsets d of front and middle ranges, clock offset τ and its drift.
"""


def ranges_of(
    state: npt.NDArray[np.complex128] | Floats, farthest: float
) -> npt.NDArray[np.complex128]:
    """z_i = ρ_i (1 + b_r / max z) + d_i + τ, analytic in the state."""
    rotation = np.array(
        [[np.cos(state[5]), -np.sin(state[5])], [np.sin(state[5]), np.cos(state[5])]],
        dtype=np.complex128,
    )
    separation = state[:2] - LEADER - (rotation @ ARMS[:, :2].T).T
    rho = np.sqrt(np.sum(separation**2, axis=1) + ARMS[:, 2] ** 2)
    return np.asarray(
        rho * (1.0 + state[4] / farthest) + np.concatenate([[0.0], state[8:10]]) + state[10]
    )


def gradient(state: Floats, farthest: float) -> Floats:
    """Derivatives of all ranges by the states, from complex steps, shape (3, n)."""
    step = 1e-30
    columns = [ranges_of(state + 1j * step * unit, farthest).imag / step for unit in np.eye(STATES)]
    return np.stack(columns, axis=1)


def make_belief(
    covariance: Floats, mean: Floats = STATE, settings: TightSettings = EVERYTHING
) -> tuple[GaussianMixture, Model]:
    model = model_of(settings)
    mixture = new_belief(settings, model, (0.0, 0.0))
    n = len(mean)
    mixture.state[0, :n] = mean
    mixture.covariance[0, :n, :n] = covariance
    return mixture, model


def range_message(ranges: Floats) -> RangeMessage:
    message = new_range_message()
    message.east, message.north, message.heading, message.speed = *LEADER, 0.3, 1.0
    message.arms, message.ranges = ARMS, ranges
    return message


def some_covariance(scale: float) -> Floats:
    root = np.random.default_rng(7).normal(size=(STATES, STATES)) * scale
    return np.asarray(root @ root.T)


def test_derivatives_of_ranges_equal_complex_steps() -> None:
    ranges = ranges_of(STATE, 30.0).real
    mixture, model = make_belief(np.eye(STATES))
    assert predict_ranges(mixture, model, 0, range_message(ranges), 0.0, 0.0) == 3
    # the scale's own slope is neglected against 1 in the derivatives by position: b_r is
    # centimetres at tens of metres
    unscaled = STATE.copy()
    unscaled[4] = 0.0
    exact = gradient(unscaled, float(ranges.max()))
    # the common error is in proportion to what was measured
    exact[:, 4] = ranges / ranges.max()
    np.testing.assert_allclose(mixture.work.ph[:, :STATES], exact, atol=1e-12)


def test_second_derivatives_equal_differences_of_complex_steps() -> None:
    unscaled = STATE.copy()
    unscaled[4] = 0.0
    ranges = ranges_of(unscaled, 30.0).real
    mixture, model = make_belief(np.eye(STATES), unscaled)
    predict_ranges(mixture, model, 0, range_message(ranges), 0.0, 0.0)
    step, curved = 1e-5, [0, 1, 5]
    for j, other in itertools.product(range(3), range(3)):
        unit = np.eye(STATES)[curved[other]] * step
        slope = (gradient(unscaled + unit, 30.0) - gradient(unscaled - unit, 30.0)) / (2 * step)
        np.testing.assert_allclose(
            mixture.work.curvature[:, j, other], slope[:, curved[j]], atol=1e-8
        )


def test_expected_ranges_equal_their_mean_over_a_gaussian() -> None:
    # the expectation over position and leader's compass by 10⁶ antithetic draws, to four standard
    # errors of their 500 000 pairs; second order is exact to σ⁴
    covariance = np.zeros((STATES, STATES))
    root = np.random.default_rng(5).normal(size=(3, 3)) * np.array([[0.8], [0.8], [0.05]])
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] = root @ root.T
    unscaled = STATE.copy()
    unscaled[4] = 0.0
    mixture, model = make_belief(covariance, unscaled)
    predict_ranges(mixture, model, 0, range_message(np.zeros(3) + 30.0), 0.0, 0.0)
    half = np.random.default_rng(1).normal(size=(500_000, 3)) @ root.T
    draws = np.concatenate([half, -half])
    x, y, bias = unscaled[0] + draws[:, 0], unscaled[1] + draws[:, 1], unscaled[5] + draws[:, 2]
    for i in range(3):
        sx = np.cos(bias) * ARMS[i, 0] - np.sin(bias) * ARMS[i, 1]
        sy = np.sin(bias) * ARMS[i, 0] + np.cos(bias) * ARMS[i, 1]
        rho = np.sqrt((x - LEADER[0] - sx) ** 2 + (y - LEADER[1] - sy) ** 2 + ARMS[i, 2] ** 2)
        offset = unscaled[10] + (unscaled[7 + i] if i else 0.0)
        mean = 0.5 * (rho[:500_000] + rho[500_000:])
        assert 30.0 - mixture.work.residual[i] == pytest.approx(
            mean.mean() + offset, abs=4 * mean.std() / 700 + 1e-4
        )


@pytest.mark.parametrize("lost", [(), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2)])
def test_an_update_equals_filterpys(lost: tuple[int, ...]) -> None:
    """With a covariance so small that nothing bends, and no random error of the leader."""
    settings = replace(EVERYTHING, leader_heading_sigma=0.0)
    covariance = some_covariance(1e-3)
    unscaled = STATE.copy()
    unscaled[4] = 0.0
    ranges = ranges_of(unscaled, 30.0).real + np.array([0.003, -0.002, 0.004])
    ranges[list(lost)] = np.nan
    received = [i for i in range(3) if i not in lost]
    mixture, model = make_belief(covariance, unscaled, settings)
    mixture.leader_variance = 0.0
    assert update(mixture, model, 0, range_message(ranges)) == len(received)

    exact = gradient(unscaled, float(np.nanmax(ranges)))
    exact[:, 4] = ranges / np.nanmax(ranges)
    hessians = np.array([hessian(unscaled, i) for i in range(3)])
    curved_covariance = covariance[np.ix_([0, 1, 5], [0, 1, 5])]
    hessian_covariance = [h @ curved_covariance for h in hessians]
    scale_derivative = exact[:, 4]
    # rows of missing ranges are not used
    scale_derivative[list(lost)] = 0.0
    noise = settings.range_sigma**2 * np.eye(3) + settings.range_scale_sigma**2 * np.outer(
        scale_derivative, scale_derivative
    )
    noise += 0.5 * np.array(
        [[np.trace(a @ b) for a in hessian_covariance] for b in hessian_covariance]
    )
    kalman = KalmanFilter(dim_x=STATES, dim_z=len(received))
    kalman.x, kalman.P = unscaled.copy(), covariance.copy()
    kalman.H, kalman.R = exact[received], noise[np.ix_(received, received)]
    expected = ranges_of(unscaled, 30.0).real + 0.5 * np.array(
        [np.trace(a) for a in hessian_covariance]
    )
    kalman.update(exact[received] @ unscaled + (ranges - expected)[received])
    np.testing.assert_allclose(mixture.state[0, :STATES], kalman.x, atol=1e-9)
    np.testing.assert_allclose(mixture.covariance[0, :STATES, :STATES], kalman.P, atol=1e-9)


def hessian(state: Floats, i: int) -> Floats:
    """Hessian of range i by x, y and b_L."""
    step, curved = 1e-5, [0, 1, 5]
    rows = []
    for index in curved:
        unit = np.eye(STATES)[index] * step
        rows.append(
            ((gradient(state + unit, 30.0) - gradient(state - unit, 30.0)) / (2 * step))[i, curved]
        )
    return np.array(rows)


@pytest.mark.parametrize(
    "echo", [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.5, 3.0), (1.0, 2.0, 3.0)]
)
def test_the_subset_of_direct_ranges_is_the_likeliest_of_all(echo: tuple[float, ...]) -> None:
    unscaled = STATE.copy()
    unscaled[4] = 0.0
    covariance = some_covariance(0.01)
    ranges = ranges_of(unscaled, 30.0).real + np.array(echo)
    mixture, model = make_belief(covariance, unscaled)
    predict_ranges(mixture, model, 0, range_message(ranges), 0.0, mixture.leader_variance)
    residual, spread = mixture.work.residual.copy(), mixture.work.innovation_covariance.copy()
    log_likelihoods = {}
    for size in range(4):
        for used in itertools.combinations(range(3), size):
            echoes = [i for i in range(3) if i not in used]
            # an echo has a chance of 0.05 and a density of 1 / 4.5 m; a range that is too short is
            # no echo, by a factor of exp(-6)
            log_likelihood = size * np.log(0.95) + sum(
                np.log(0.05 / 4.5) - 6.0 * (residual[i] < 0) for i in echoes
            )
            if used:
                log_likelihood += multivariate_normal.logpdf(
                    residual[list(used)], cov=spread[np.ix_(used, used)]
                )
            log_likelihoods[used] = log_likelihood
    likeliest = max(log_likelihoods, key=log_likelihoods.__getitem__)
    assert update(mixture, model, 0, range_message(ranges)) == len(likeliest)
    assert mixture.evidence[0] == pytest.approx(log_likelihoods[likeliest], abs=1e-9)


def test_a_message_without_received_ranges_changes_no_belief() -> None:
    mixture, model = make_belief(some_covariance(0.01))
    before = mixture.state.copy(), mixture.covariance.copy()
    outcome = mixture.outcome[0]
    mixture.evidence[0] = outcome["normalised_innovation"] = mixture.turn_excess[0] = 7.0
    assert update(mixture, model, 0, range_message(np.full(3, np.nan))) == 0
    assert (
        mixture.evidence[0],
        mixture.outcome["normalised_innovation"][0],
        mixture.turn_excess[0],
        mixture.outcome["n_used"][0],
    ) == (0.0, 0.0, 0.0, 0)
    np.testing.assert_array_equal(mixture.state, before[0])
    np.testing.assert_array_equal(mixture.covariance, before[1])


def test_a_covariance_that_is_not_positive_definite_is_refused() -> None:
    mixture, model = make_belief(-np.eye(STATES))
    assert update(mixture, model, 0, range_message(ranges_of(STATE, 30.0).real)) == -1
    mixture, model = make_belief(np.full((STATES, STATES), np.nan))
    assert update(mixture, model, 0, range_message(ranges_of(STATE, 30.0).real)) == -1


def test_of_ranges_that_share_an_echo_only_the_difference_is_used() -> None:
    """Two transmitters 2 m apart, abeam at 10 m east: a delay common to both has no information on
    the distance.

    Ranges are ρ = (10² + 1)^½ each, and H of their difference is (0, 2/ρ). Of a late ping the
    difference of 4 cm is as it was; a reflection would have made it less likely.
    """
    config = TightSettings(transmitters=2, range_scale_sigma=0.0)
    model, sigma, rho = model_of(config), 0.3, np.sqrt(101.0)
    mixture, message = new_belief(config, model, (10.0, 0.0)), new_range_message()
    mixture.covariance[0, :2, :2] = sigma**2 * np.eye(2)
    mixture.covariance[0, 4, 4] = 0.0
    message.arms = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    message.ranges = rho + 3.0 + 0.02, rho + 3.0 - 0.02, np.nan
    assert update(mixture, model, 0, message) == 1
    slope = 2.0 / rho
    assert mixture.state[0, 0] == pytest.approx(10.0, abs=1e-12)
    assert mixture.covariance[0, 0, 0] == pytest.approx(sigma**2, abs=1e-12)
    # ½ tr(F P F P) of the difference, whose second derivative by x and y is −2 x / ρ³
    second_order_variance = (2.0 * 10.0 / rho**3 * sigma**2) ** 2
    variance = slope**2 * sigma**2 + 2.0 * config.range_sigma**2 + second_order_variance
    assert mixture.state[0, 1] == pytest.approx(slope * sigma**2 / variance * 0.04, rel=0.05)
    assert mixture.covariance[0, 1, 1] == pytest.approx(
        sigma**2 - (slope * sigma**2) ** 2 / variance, abs=1e-4
    )
    assert mixture.outcome[0]["nis_sum"] == pytest.approx(0.04**2 / variance, rel=0.05)


def test_the_differences_of_a_reflection_are_those_of_the_direct_ways() -> None:
    """Both ways of a reflection are (ρ² + K)^½ long, as off a level floor: the direct ranges, and
    with them the bearing, follow from K, of which the mean range at the prediction tells.

    A follower 30 m east and 40 m north, whose bearing the prediction has 0.2 m off; taken as late,
    the difference would move it by metres to where it is a tenth smaller.
    """
    config = TightSettings(transmitters=2, range_scale_sigma=0.0)
    model = model_of(config)
    true_position = np.array([30.0, 40.0])
    across = np.array([-0.8, 0.6])
    mixture, message = (
        new_belief(config, model, tuple(true_position + 0.2 * across)),
        new_range_message(),
    )
    mixture.covariance[0, :2, :2] = 1e-4 * np.eye(2) + 0.25 * np.outer(across, across)
    mixture.covariance[0, 4, 4] = 0.0
    message.arms = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    message.echo_span = 10.0
    ranges = np.hypot(true_position[0], true_position[1] - np.array([-1.0, 1.0]))
    message.ranges[:2] = np.sqrt(ranges**2 + 600.0)
    message.ranges[2] = np.nan
    assert update(mixture, model, 0, message) == 1
    assert mixture.outcome[0]["shared"] == 1
    error = mixture.state[0, :2] - true_position
    # second-order terms and the width across leave some centimetres
    assert abs(error @ across) < 0.05
    assert mixture.covariance[0, :2, :2].diagonal().sum() < 0.05

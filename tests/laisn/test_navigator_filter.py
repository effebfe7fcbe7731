"""The filter, against textbook formulas written out here."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from laisn.navigator import Filter

H_POSITION, H_VELOCITY = np.eye(4)[:2], np.eye(4)[2:]


def test_process_noise_is_that_of_a_constant_acceleration_over_the_step() -> None:
    """G Gᵀ σa² with G = [Δt²/2, Δt] on each axis."""
    kalman = Filter(0.5, np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4))
    kalman.predict(6.0)
    gain = np.array([[0.125, 0], [0, 0.125], [0.5, 0], [0, 0.5]])
    np.testing.assert_allclose(kalman.covariance, 36.0 * gain @ gain.T)
    np.testing.assert_allclose(kalman.state, [2.5, 4.0, 3.0, 4.0])


def test_updates_agree_with_the_information_form() -> None:
    """P⁺ = (P⁻¹ + Hᵀ R⁻¹ H)⁻¹ and x⁺ = P⁺ (P⁻¹ x + Hᵀ R⁻¹ z)."""
    kalman = Filter(0.1, np.array([1.0, 2.0, 0.5, -0.5]), np.array([1.0, 1.0, 0.3, 0.3]))
    kalman.predict(60.0)
    x, prior_information, prior_covariance = (
        kalman.state,
        np.linalg.inv(kalman.covariance),
        kalman.covariance,
    )
    innovation = kalman.update_position((1.4, 1.7), 0.2)
    np.testing.assert_allclose(innovation.residual, [1.4 - x[0], 1.7 - x[1]])
    np.testing.assert_allclose(innovation.covariance, prior_covariance[:2, :2] + 0.04 * np.eye(2))
    information = prior_information + H_POSITION.T @ H_POSITION / 0.04
    x = np.linalg.solve(information, prior_information @ x + H_POSITION.T @ [1.4, 1.7] / 0.04)
    np.testing.assert_allclose(kalman.state, x)
    np.testing.assert_allclose(kalman.covariance, np.linalg.inv(information), atol=1e-12)

    speed, heading, sigma_v, sigma_theta = 1.2, 0.7, 0.2, np.deg2rad(2)
    kalman.update_speed(speed, heading, sigma_v, sigma_theta)
    along, across = (
        np.array([np.sin(heading), np.cos(heading)]),
        np.array([np.cos(heading), -np.sin(heading)]),
    )
    noise = sigma_v**2 * np.outer(along, along) + (speed * sigma_theta) ** 2 * np.outer(
        across, across
    )
    weight = H_VELOCITY.T @ np.linalg.inv(noise)
    prior_information = information
    information = prior_information + weight @ H_VELOCITY
    x = np.linalg.solve(information, prior_information @ x + weight @ (speed * along))
    np.testing.assert_allclose(kalman.state, x)
    np.testing.assert_allclose(kalman.covariance, np.linalg.inv(information), atol=1e-12)


def test_a_certain_fix_is_taken_over_and_a_second_one_skipped() -> None:
    kalman = Filter(0.1, np.zeros(4), np.zeros(4))
    kalman.predict(60.0)
    first = kalman.update_position((3.0, 4.0), 0.0)
    assert first.applied
    np.testing.assert_allclose(first.residual, [3.0, 4.0])
    np.testing.assert_allclose(kalman.state[:2], [3.0, 4.0])
    second = kalman.update_position((9.0, 9.0), 0.0)
    assert not second.applied
    np.testing.assert_allclose(kalman.state[:2], [3.0, 4.0])
    assert kalman.update_position((3.1, 4.0), 0.01).applied


def test_a_line_that_is_known_exactly_is_left_alone() -> None:
    """One range without error does not change an exact state; nor does one with an error of a
    millimetre.
    """
    kalman = Filter(0.1, np.array([1.0, 2.0, 0.0, 0.0]), np.zeros(4))
    skipped = kalman.update_position((4.0, 6.0), 0.0, (0.6, 0.8))
    assert not skipped.applied
    np.testing.assert_allclose(skipped.residual, [3.0, 4.0])
    np.testing.assert_array_equal(skipped.covariance, np.zeros((2, 2)))
    np.testing.assert_array_equal(kalman.state, [1.0, 2.0, 0.0, 0.0])
    taken = kalman.update_position((4.0, 6.0), 1e-3, (0.6, 0.8))
    assert taken.applied
    np.testing.assert_allclose(taken.covariance, 1e-6 * np.eye(2))
    np.testing.assert_allclose(kalman.state, [1.0, 2.0, 0.0, 0.0])


def test_position_gain_is_about_one_with_the_papers_settings() -> None:
    """σa0 = 60 m/s² dwarfs β/sep, so that a fix decides: the gain is P / (P + σp²)."""
    kalman = Filter(0.1, np.zeros(4), np.zeros(4))
    kalman.predict(60.0)
    variance = (60 * 0.1**2 / 2) ** 2
    kalman.update_position((1.0, 0.0), 0.01)
    assert kalman.state[0] == pytest.approx(variance / (variance + 1e-4))


def test_a_hundred_steps_are_those_of_filterpy() -> None:
    """Steps of varying length, with a position every fifth of them."""
    rng = np.random.default_rng(5)
    start = np.array([3.0, -2.0, 0.4, 0.9])
    sigma0 = np.array([0.5, 0.5, 0.1, 0.1])
    kalman = Filter(0.1, start, sigma0)
    expected = KalmanFilter(dim_x=4, dim_z=2)
    expected.x = start.copy()
    expected.P = np.diag(sigma0**2)
    for k in range(100):
        sigma_a, dt = rng.uniform(0.01, 2.0), rng.uniform(0.05, 0.5)
        gain = np.kron([[0.5 * dt * dt], [dt]], np.eye(2))
        kalman.predict(sigma_a, dt)
        expected.predict(F=np.eye(4) + dt * np.eye(4, k=2), Q=sigma_a**2 * gain @ gain.T)
        if k % 5 == 0:
            fix, sigma = rng.normal(0.0, 3.0, 2), rng.uniform(0.05, 1.0)
            kalman.update_position(tuple(fix), sigma)
            expected.update(fix, R=sigma**2 * np.eye(2), H=H_POSITION)
        speed, heading = rng.uniform(0.3, 2.0), rng.uniform(-np.pi, np.pi)
        along = np.array([np.sin(heading), np.cos(heading)])
        across = np.array([np.cos(heading), -np.sin(heading)])
        noise = 0.1**2 * np.outer(along, along) + (0.03 * speed) ** 2 * np.outer(across, across)
        kalman.update_speed(speed, heading, 0.1, 0.03)
        expected.update(speed * along, R=noise, H=H_VELOCITY)
        np.testing.assert_allclose(kalman.state, expected.x, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(kalman.covariance, expected.P, rtol=1e-11, atol=1e-14)

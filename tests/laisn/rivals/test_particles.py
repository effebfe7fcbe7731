"""The particle filter: its steps against NumPy and SciPy, its result against integration."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from laisn.arrays import Floats
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.rivals.particles import (
    ParticleFilter,
    SinceArrival,
    effective_number,
    log_likelihood,
    moments,
    move,
    reweighted,
    systematic_ancestors,
)
from laisn.settings import RivalSettings

RANDOM = np.random.default_rng(71)
PARTICLES = RANDOM.standard_normal((40, 7)) * [5.0, 5.0, 0.1, 0.2, 0.5, 0.2, 0.2]
WEIGHTS = RANDOM.random(40)
WEIGHTS /= WEIGHTS.sum()
TRANSMITTERS = np.array([[20.0, 3.0, 4.0], [21.0, 3.5, 4.2], [22.0, 2.0, 3.0]])


def test_particles_move_by_the_odometry_turned_by_their_compass_bias() -> None:
    displacement = np.array([3.0, -4.0])
    path = np.array([1.0, -2.0])
    covariance = np.array([[0.09, 0.02], [0.02, 0.04]])
    walks = np.array([0.01, 0.02, 0.03, 0.04])
    normals = RANDOM.standard_normal((40, 6))
    root = np.linalg.cholesky(covariance)
    particles = PARTICLES.copy()
    move(particles, (displacement, path, root, 2.5), walks, normals)
    for before, after, noise in zip(PARTICLES, particles, normals, strict=True):
        bias = before[3]
        # a compass that reads too much has turned the way clockwise
        rotation = np.array([[np.cos(bias), -np.sin(bias)], [np.sin(bias), np.cos(bias)]])
        unbiased = displacement - before[2] * path + root @ noise[:2]
        expected = before[:2] + rotation @ unbiased + 2.5 * before[5:]
        np.testing.assert_allclose(after[:2], expected, atol=1e-12)
        np.testing.assert_allclose(after[[2, 3, 5, 6]], before[[2, 3, 5, 6]] + walks * noise[2:])
        assert after[4] == before[4]


def since_arrival(ways: Floats, drift_time: Floats, covariance: Floats) -> SinceArrival:
    """At 1.2 m/s by the log."""
    return SinceArrival(ways, ways / 1.2, drift_time, covariance)


@pytest.mark.parametrize("is_late", [False, True])
@pytest.mark.parametrize("leader_sigma", [0.0, 0.4])
@pytest.mark.parametrize("received", [[0], [0, 2], [0, 1, 2]])
def test_the_likelihood_is_the_density_of_a_normal_distribution(
    leader_sigma: float, received: list[int], is_late: bool
) -> None:
    """Of pings that arrived some time ago it is that of the particle's place at that time."""
    ways = np.array([[1.5, 1.8], [1.2, 1.7], [0.7, 1.4]])[received] * is_late
    # of errors that add up: those of the later ping of two
    variances = np.array([0.5, 0.3, 0.0])[received] * is_late
    shape = np.array([[1.0, 0.4], [0.4, 2.0]])
    between = np.minimum.outer(variances, variances)[:, :, None, None] * shape
    drift_time = np.array([2.0, 1.9, 1.8])[received] * is_late
    transmitters = TRANSMITTERS[received]
    ranges = np.array([19.0, 23.0, 20.5])[received]
    sigma = (0.3, 0.8, leader_sigma)
    since = since_arrival(ways, drift_time, between)
    logarithm = log_likelihood(PARTICLES, transmitters, ranges, sigma, since)
    expected = []
    for particle in PARTICLES:
        # a compass that reads too much has turned the way clockwise
        bias = particle[3]
        rotation = np.array([[np.cos(bias), -np.sin(bias)], [np.sin(bias), np.cos(bias)]])
        moved = (1.0 - particle[2] / 1.2) * ways @ rotation.T + np.outer(drift_time, particle[5:])
        offset = particle[:2] - moved - transmitters[:, :2]
        distance = np.hypot(np.hypot(offset[:, 0], offset[:, 1]), transmitters[:, 2])
        scale_derivative = distance / ranges.max()
        unit = offset / distance[:, None]
        covariance = 0.3**2 * np.eye(len(received)) + 0.8**2 * np.outer(
            scale_derivative, scale_derivative
        )
        covariance += leader_sigma**2 * unit @ unit.T
        covariance += np.minimum.outer(variances, variances) * (unit @ shape @ unit.T)
        expected.append(
            multivariate_normal.logpdf(
                ranges, distance + scale_derivative * particle[4], covariance
            )
            + 0.5 * len(received) * np.log(2.0 * np.pi)
        )
    np.testing.assert_allclose(logarithm, expected, rtol=1e-10)


def test_a_particle_at_a_transmitter_has_a_likelihood() -> None:
    particles = np.zeros((1, 7))
    since = since_arrival(np.zeros((1, 2)), np.zeros(1), np.zeros((1, 1, 2, 2)))
    transmitter, measured = np.zeros((1, 3)), np.array([2.0])
    (logarithm,) = log_likelihood(particles, transmitter, measured, (0.5, 0.0, 1.0), since)
    # of N(0, 0.5²) at 2, without ½ log 2π: no direction, hence no error of the leader's position
    assert logarithm == pytest.approx(-0.5 * (2.0 / 0.5) ** 2 - np.log(0.5))


def test_weights_are_multiplied_by_a_power_of_the_likelihood() -> None:
    # logarithms whose exponentials underflow
    logarithm = 3.0 * RANDOM.standard_normal(40) - 5000.0
    product = WEIGHTS * np.exp(0.25 * (logarithm - logarithm.max()))
    np.testing.assert_allclose(
        reweighted(WEIGHTS, logarithm, 0.25), product / product.sum(), rtol=1e-12
    )
    assert effective_number(WEIGHTS) == pytest.approx(1.0 / np.sum(WEIGHTS**2))


def test_moments_are_those_of_weighted_samples() -> None:
    mean, covariance = moments(PARTICLES, WEIGHTS)
    np.testing.assert_allclose(mean, np.average(PARTICLES, axis=0, weights=WEIGHTS), atol=1e-13)
    expected = np.cov(PARTICLES.T, aweights=WEIGHTS, ddof=0)
    np.testing.assert_allclose(covariance, expected, atol=1e-12)


def test_ancestors_are_drawn_in_proportion_to_the_weights() -> None:
    for start in (0.0, 0.3, 0.999):
        ancestors = systematic_ancestors(WEIGHTS, start)
        counts = np.bincount(ancestors, minlength=40)
        # of n systematic draws each particle gets ⌊n w⌋ or one more
        assert (counts >= np.floor(40 * WEIGHTS) - 1e-9).all()
        assert (counts <= np.floor(40 * WEIGHTS) + 1.0).all()
        assert (np.diff(ancestors) >= 0).all()


@pytest.mark.system
def test_particles_have_the_moments_of_the_exact_posterior() -> None:
    """A prior of 2 m and one range to a transmitter 4 m away: the posterior is bent, no Gaussian;
    its moments by integration on a grid.
    """
    settings = RivalSettings(
        particles=1_000_000,
        start_sigma=2.0,
        range_sigma=0.5,
        range_scale_sigma=0.0,
        speed_sigma=0.0,
        speed_bias_sigma=0.0,
        heading_bias_sigma=0.0,
        range_scale_bias_sigma=0.0,
    )
    navigator = ParticleFilter(settings, np.zeros(4))
    message = LeaderMessage(timestamp=0.0, east=0.1, north=4.0, heading=0.0, speed=1.0, depth=10.0)
    navigator.step(OwnMotion(0.0, 0.0, 10.0), Reception(message, Ranges(np.nan, np.nan, 4.5)))
    x, y = np.meshgrid(np.linspace(-9.0, 9.0, 1801), np.linspace(-9.0, 9.0, 1801))
    # the middle transmitter is 0.1 m to port of a leader that heads north
    density = np.exp(-(x**2 + y**2) / 8.0 - 0.5 * ((np.hypot(x, y - 4.0) - 4.5) / 0.5) ** 2)
    density /= density.sum()
    mean = np.array([(density * x).sum(), (density * y).sum()])
    var_x, var_y = (density * (x - mean[0]) ** 2).sum(), (density * (y - mean[1]) ** 2).sum()
    assert navigator.state[:2] == pytest.approx(mean, abs=0.02)
    assert (navigator.covariance[0, 0], navigator.covariance[1, 1]) == pytest.approx(
        (var_x, var_y), rel=0.03
    )

"""A particle filter on ranges: a rival method with the states of `laisn.rivals.filters`.

Between messages its estimate is one Gaussian of the particles' moments, and at a message all
particles move by the odometry since the last one, are weighted by the likelihood of the ranges and,
where few of them count, resampled (Arulampalam, Maskell, Gordon and Clapp, IEEE Transactions on
Signal Processing 50(2), 2002). A likelihood that leaves few particles is applied by powers of it,
so that particles are resampled in between (Neal, Statistics and Computing 11, 2001). New biases are
drawn from a kernel that keeps their mean and covariance (Liu and West, in Sequential Monte Carlo
Methods in Practice, 2001).

Functions take `particles`, shape (N, 7), and `weights`, shape (N,), whose sum is 1. The states of a
particle are its place x, y, the biases b_v of the log, b_θ of the compass and b_r of the ranges
(that of the longest), and the current c_x, c_y.
"""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.messages import OwnMotion, Reception
from laisn.rivals.filters import STATES, DeadReckoning
from laisn.rivals.leader_track import CurrentMeasurement
from laisn.settings import COMPASS_WALK, LOG_WALK, RivalSettings

DISCOUNT = 0.98
KEPT_DEVIATION = (3.0 * DISCOUNT - 1.0) / (2.0 * DISCOUNT)
"""Share of a bias's deviation from the mean that the kernel of Liu and West keeps, by its discount
(3 δ − 1) / 2 δ.
"""
MIN_SHARE = 0.1
"""A power of the likelihood is applied first where fewer particles than this share would count."""
SMALLEST_POWER = 2.0**-10
RESAMPLED_SHARE = 0.5
"""Particles are resampled after an update where fewer than this share of them count."""


class SinceArrival(NamedTuple):
    """What happened since r pings left and arrived, for each particle by its own biases."""

    # ways of the follower through the water as log and compass read, east and north, shape (r, 2),
    # [m], and what they gain for 1 m/s more, likewise, [s]
    logged: Floats
    per_speed: Floats
    drift_time: Floats  # for how long the current has carried both vehicles, shape (r,), [s]
    # of the errors of these ways until the last ping arrived, shape (r, r, 2, 2), [m²]
    covariance: Floats


@compiled
def move(
    particles: Floats,
    odometry: tuple[Floats, Floats, Floats, float],
    walks: Floats,
    normals: Floats,
) -> None:
    """Move particles by odometry: p ← p + R(b_θ) (D − b_v U + L w) + c t.

    `odometry` are D, the displacement by log and compass as they read, shape (2,), [m]; U, the path
    for 1 m/s, shape (2,), [s]; L, the lower triangle with L Lᵀ the covariance of D, shape (2, 2);
    and t [s]. `walks` are the standard deviations of the walks of b_v, b_θ, c_x and c_y, shape
    (4,), `normals` standard normal numbers, shape (N, 6): two of the displacement, four of walks.
    """
    displacement, path, root, time = odometry
    for i in range(particles.shape[0]):
        p = particles[i]
        noise = normals[i]
        east = displacement[0] - p[2] * path[0] + root[0, 0] * noise[0]
        north = displacement[1] - p[2] * path[1] + root[1, 0] * noise[0] + root[1, 1] * noise[1]
        sine = np.sin(p[3])
        cosine = np.cos(p[3])
        p[0] += east * cosine - north * sine + p[5] * time
        p[1] += east * sine + north * cosine + p[6] * time
        p[2] += walks[0] * noise[2]
        p[3] += walks[1] * noise[3]
        p[5] += walks[2] * noise[4]
        p[6] += walks[3] * noise[5]


@compiled
def log_likelihood(
    particles: Floats,
    transmitters: Floats,
    ranges: Floats,
    sigma: tuple[float, float, float],
    since: SinceArrival,
) -> Floats:
    """log N(z; h, S) of all ranges, but for a constant, shape (N,), with
    S = σ² I + σ_s² s sᵀ + σ_L² u uᵀ + [u_jᵀ N_jk u_k].

    h_j = |p − t_j − r_j − m_j c| + s_j b_r, with s_j the range by the longest measured one, u_j the
    horizontal direction from transmitter j, r_j = Rot(b_θ) (A_j − b_v B_j) the particle's way
    through the water since ping j, and A, B, m and N those of `since`. `transmitters` are east,
    north, depth below the hydrophone, shape (r, 3), of the r received `ranges`, shape (r,), [m];
    `sigma` are σ, σ_s and σ_L [m].
    """
    n_ranges = ranges.size
    longest = ranges.max()
    residual = np.empty(n_ranges)
    share = np.empty(n_ranges)
    direction = np.empty((n_ranges, 2))
    lower = np.empty((n_ranges, n_ranges))
    out = np.empty(particles.shape[0])
    for i in range(particles.shape[0]):
        p = particles[i]
        sine = np.sin(p[3])
        cosine = np.cos(p[3])
        for j in range(n_ranges):
            # as if the ping had left so much farther on, and had been received here and now
            way_east = since.logged[j, 0] - p[2] * since.per_speed[j, 0]
            way_north = since.logged[j, 1] - p[2] * since.per_speed[j, 1]
            moved_east = way_east * cosine - way_north * sine + since.drift_time[j] * p[5]
            moved_north = way_east * sine + way_north * cosine + since.drift_time[j] * p[6]
            east = p[0] - (transmitters[j, 0] + moved_east)
            north = p[1] - (transmitters[j, 1] + moved_north)
            rho = np.sqrt(east * east + north * north + transmitters[j, 2] * transmitters[j, 2])
            share[j] = rho / longest
            residual[j] = ranges[j] - rho - share[j] * p[4]
            # a particle at a transmitter has no direction from it
            inverse = 1.0 / rho if rho > 0.0 else 0.0
            direction[j, 0] = inverse * east
            direction[j, 1] = inverse * north
        # S = L Lᵀ, L y = z − h: the exponent is −yᵀ y / 2, the determinant that of L squared
        nis = 0.0
        log_determinant = 0.0
        for j in range(n_ranges):
            rest = residual[j]
            for k in range(j + 1):
                between = direction[j, 0] * direction[k, 0] + direction[j, 1] * direction[k, 1]
                covariance = sigma[1] ** 2 * share[j] * share[k] + sigma[2] ** 2 * between
                for m in range(2):
                    for n in range(2):
                        covariance += (
                            direction[j, m] * since.covariance[j, k, m, n] * direction[k, n]
                        )
                if j == k:
                    covariance += sigma[0] ** 2
                for m in range(k):
                    covariance -= lower[j, m] * lower[k, m]
                if j == k:
                    lower[j, j] = np.sqrt(covariance)
                else:
                    lower[j, k] = covariance / lower[k, k]
                    rest -= lower[j, k] * residual[k]
            residual[j] = rest / lower[j, j]
            nis += residual[j] * residual[j]
            log_determinant += 2.0 * np.log(lower[j, j])
        out[i] = -0.5 * (nis + log_determinant)
    return out


@compiled
def reweighted(weights: Floats, logarithm: Floats, power: float) -> Floats:
    """Weights times exp(power · logarithm), whose sum is 1; the weights where nothing is left."""
    largest = logarithm.max()
    product = np.empty(weights.size)
    total = 0.0
    for i in range(weights.size):
        product[i] = weights[i] * np.exp(power * (logarithm[i] - largest))
        total += product[i]
    if not total > 0.0:
        return weights.copy()
    for i in range(weights.size):
        product[i] /= total
    return product


@compiled
def effective_number(weights: Floats) -> float:
    """How many particles of equal weights would be as good, 1 / Σ w²."""
    squares = 0.0
    for i in range(weights.size):
        squares += weights[i] * weights[i]
    return float(1.0 / squares)


@compiled
def moments(particles: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Mean, shape (7,), and covariance, shape (7, 7), of weighted particles."""
    states = particles.shape[1]
    mean = np.zeros(states)
    covariance = np.zeros((states, states))
    deviation = np.empty(states)
    for i in range(particles.shape[0]):
        for j in range(states):
            mean[j] += weights[i] * particles[i, j]
    for i in range(particles.shape[0]):
        for j in range(states):
            deviation[j] = particles[i, j] - mean[j]
            for k in range(j + 1):
                covariance[j, k] += weights[i] * deviation[j] * deviation[k]
    for j in range(states):
        for k in range(j):
            covariance[k, j] = covariance[j, k]
    return mean, covariance


@compiled
def systematic_ancestors(weights: Floats, start: float) -> Ints:
    """Index of the particle that each of N equal strata of the summed weights falls on, shape (N,);
    `start` is the place in the first stratum, 0 to 1 (Kitagawa, Journal of Computational and
    Graphical Statistics 5(1), 1996).
    """
    n = weights.size
    ancestors = np.empty(n, dtype=np.int64)
    index = 0
    total = weights[0]
    for i in range(n):
        position = (start + i) / n
        while total < position and index < n - 1:
            index += 1
            total += weights[index]
        ancestors[i] = index
    return ancestors


class ParticleFilter(DeadReckoning):
    """State [x, y, b_v, b_θ, b_r, c_x, c_y] of each of N particles; between messages one
    Gaussian of their moments.
    """

    KEEPS_READINGS = True  # those of log and compass, for `_odometry`
    MOVES_TRANSMITTERS = False  # `log_likelihood` does, for each particle

    def __init__(self, settings: RivalSettings, start: Floats) -> None:
        """As of `DeadReckoning`."""
        super().__init__(settings, start)
        normals = self._random(0, 0.0).standard_normal((settings.particles, STATES))
        self.particles: Floats = self.x + normals * np.sqrt(np.diag(self.P))
        self.weights: Floats = np.full(settings.particles, 1.0 / settings.particles)

    def _random(self, step: int, reading: float) -> np.random.Generator:
        """Generator of the random numbers of a step: a function of its number and of a reading, so
        that runs do not share them, and each gives the same when it is repeated.
        """
        key = int(np.float64(reading).view(np.uint64))
        return np.random.Generator(np.random.Philox(key=key, counter=step << 64))

    def _move(self, random: np.random.Generator) -> None:
        """Move all particles by the odometry since the last message."""
        displacement, path, noise, time = self._odometry()
        current_walk = self._noise[3]  # [m/s/√s]
        walks = np.array([LOG_WALK, COMPASS_WALK, current_walk, current_walk])
        root = np.asarray(np.linalg.cholesky(noise), dtype=np.float64)
        move(
            self.particles,
            (displacement, path, root, time),
            math.sqrt(time) * walks,
            random.standard_normal((self.weights.size, 6)),
        )

    def _take_moments(self) -> None:
        """Take mean and covariance of the particles for the estimate."""
        self.x, self.P = moments(self.particles, self.weights)

    def _update_current(self, measurement: CurrentMeasurement) -> None:
        """Move each particle's current as a Kalman filter would, by their common covariance, with
        random numbers that leave the right one (P. L. Houtekamer, H. L. Mitchell, Monthly Weather
        Review 126, 1998): few particles have the current that is seen.
        """
        random = self._random(self._step, float(measurement.current[0]))
        _, P = moments(self.particles, self.weights)
        gain = np.linalg.solve(P[5:, 5:] + measurement.variance * np.eye(2), P[5:]).T
        noise = math.sqrt(measurement.variance) * random.standard_normal((self.weights.size, 2))
        innovation = measurement.current + noise - self.particles[:, 5:]
        self.particles = self.particles + innovation @ gain.T
        self._take_moments()

    def _resample(self, random: np.random.Generator, first: int) -> None:
        """Systematic resampling, and new states from `first` on from the kernel of Liu and West."""
        n = self.weights.size
        self.particles = self.particles[systematic_ancestors(self.weights, random.random())]
        self.weights = np.full(n, 1.0 / n)
        states = self.particles[:, first:]
        mean, covariance = moments(self.particles, self.weights)
        unbiased = covariance[first:, first:] * (n / (n - 1))
        variance, axes = np.linalg.eigh(unbiased)
        root = np.sqrt((1.0 - KEPT_DEVIATION**2) * np.maximum(variance, 0.0))
        deviation = (random.standard_normal(states.shape) * root) @ axes.T
        states *= KEPT_DEVIATION
        states += (1.0 - KEPT_DEVIATION) * mean[first:] + deviation

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        random = self._random(self._step, own.heading)
        settings = self.settings
        n = self.weights.size
        received = np.flatnonzero(np.isfinite(ranges))
        sigma = (
            settings.range_sigma,
            settings.range_scale_sigma,
            math.sqrt(self._leader_position_variance(reception)),
        )
        since = SinceArrival(
            self._ways.logged[received],
            self._ways.per_speed[received],
            self._delays.drift_time[received],
            self._ways.covariance_before_last(received),
        )
        self._move(random)
        remaining_power = 1.0
        while True:
            logarithm = log_likelihood(
                self.particles, transmitters[received], ranges[received], sigma, since
            )
            power = remaining_power
            weights = reweighted(self.weights, logarithm, power)
            while effective_number(weights) < MIN_SHARE * n and power > SMALLEST_POWER:
                power *= 0.5
                weights = reweighted(self.weights, logarithm, power)
            self.weights = weights
            remaining_power -= power
            if remaining_power <= 0.0:
                break
            self._resample(random, first=0)
        self._take_moments()
        if effective_number(self.weights) < RESAMPLED_SHARE * n:
            self._resample(random, first=2)
        # as of `laisn.delays.Ways`
        since_last = self._ways.covariance_since_last(received)
        if since_last.any():
            root = np.linalg.cholesky(since_last + 1e-12 * np.eye(2))
            self.particles[:, :2] += random.standard_normal((n, 2)) @ root.T
        return True

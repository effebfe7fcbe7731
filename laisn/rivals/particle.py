"""Bootstrap particle filter on the ranges of a message.

Particles move by the odometry since the last message, each with its own biases; at a message they are weighted by the
likelihood of all its ranges and resampled where few count (N. Gordon, D. Salmond, A. Smith, IEE Proc. F 140(2), 1993;
systematic resampling: M. S. Arulampalam et al., IEEE Trans. Signal Process. 50(2), 2002). A likelihood that is much
narrower than the cloud is applied by steps (progressive correction: C. Musso, N. Oudjane, F. Le Gland, Improving
regularised particle filters, 2001). Biases are constants, which resampling would deplete: they are drawn anew from a
kernel that keeps mean and covariance (J. Liu, M. West, Combined parameter and state estimation in simulation-based
filtering, 2001).
"""

import numpy as np

from laisn.arrays import Floats
from laisn.messages import OwnMotion, Reception
from laisn.rivals.odometry import STATES, OdometrySums
from laisn.tight.settings import COMPASS_WALK, LOG_WALK, RivalSettings

DISCOUNT = 0.98
"""Discount of Liu and West: the kernel keeps (3 δ − 1) / 2 δ of a bias's deviation from the mean."""
KEPT = (3.0 * DISCOUNT - 1.0) / (2.0 * DISCOUNT)
LEAST_SHARE = 0.1
"""A power of the likelihood is applied first where fewer particles than this share would count."""
SMALLEST_POWER = 2.0**-10
_INITIAL = 0
"""Step that addresses the random numbers of the first particles."""


class ParticleFilter(OdometrySums):
    """State [x, y, b_v, b_θ, b_r, c_x, c_y] of each of N particles; between messages one Gaussian of their moments."""

    def __init__(self, settings: RivalSettings, start: Floats) -> None:
        """As of `DeadReckoning`."""
        super().__init__(settings, start)
        normals = self._random(_INITIAL, 0.0).standard_normal((settings.particles, STATES))
        self.particles: Floats = self.x + normals * np.sqrt(np.diag(self.P))
        self.weights: Floats = np.full(settings.particles, 1.0 / settings.particles)

    def _random(self, step: int, reading: float) -> np.random.Generator:
        """Random numbers of a step: a function of its number and of a reading, so that runs do not share them."""
        key = int(np.float64(reading).view(np.uint64))
        return np.random.Generator(np.random.Philox(key=key, counter=step << 64))

    def _move(self, random: np.random.Generator) -> None:
        """Move all particles by the odometry since the last message: p ← p + R(b_θ) (D − b_v Σ u Δt + w) + c t."""
        p, normals = self.particles, random.standard_normal((self.weights.size, 6))
        way, path, noise, time = self._odometry()
        way = way - p[:, 2:3] * path + normals[:, :2] @ np.linalg.cholesky(noise).T
        sine, cosine = np.sin(p[:, 3]), np.cos(p[:, 3])
        p[:, 0] += way[:, 0] * cosine - way[:, 1] * sine + p[:, 5] * time
        p[:, 1] += way[:, 0] * sine + way[:, 1] * cosine + p[:, 6] * time
        walks = np.sqrt(time) * np.array([LOG_WALK, COMPASS_WALK, self._noise[3], self._noise[3]])
        p[:, [2, 3, 5, 6]] += walks * normals[:, 2:]

    def _likelihood(self, below: Floats, ranges: Floats) -> Floats:
        """log N(z; h, σ² I + σ_s² s sᵀ) of all ranges, but for a constant, shape (N,)."""
        settings, received = self.settings, np.flatnonzero(np.isfinite(ranges))
        z = ranges[received]
        away = self.particles[:, None, :2] - below[received, :2]
        rho = np.sqrt((away**2).sum(axis=2) + below[received, 2] ** 2)
        share = rho / z.max()
        residual = z - rho - share * self.particles[:, 4:5]
        # of the matrix σ² I + σ_s² s sᵀ: determinant and inverse by Sherman and Morrison
        small, large = settings.range_sigma**2, settings.range_scale_sigma**2
        whole = small + large * (share**2).sum(axis=1)
        along = (share * residual).sum(axis=1)
        squared = ((residual**2).sum(axis=1) - large * along**2 / whole) / small
        return np.asarray(-0.5 * (squared + np.log(whole)))

    def _resample(self, random: np.random.Generator, first: int) -> None:
        """Systematic resampling, and new states from `first` on from the kernel of Liu and West."""
        n = self.weights.size
        positions = (random.random() + np.arange(n)) / n
        chosen = np.minimum(np.searchsorted(np.cumsum(self.weights), positions), n - 1)
        self.particles, self.weights = self.particles[chosen], np.full(n, 1.0 / n)
        states = self.particles[:, first:]
        mean, (variance, axes) = states.mean(axis=0), np.linalg.eigh(np.cov(states.T))
        root = np.sqrt((1.0 - KEPT**2) * np.maximum(variance, 0.0))
        fresh = (random.standard_normal(states.shape) * root) @ axes.T
        self.particles[:, first:] = KEPT * states + (1.0 - KEPT) * mean + fresh

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        random, n, rest = self._random(self._step, own.heading), self.weights.size, 1.0
        self._move(random)
        while True:
            # a power of the likelihood that leaves enough particles, as long as the rest of it is not small
            likelihood, power = self._likelihood(below, ranges), rest
            weights = _weighted(self.weights, power * likelihood)
            while 1.0 / np.sum(weights**2) < LEAST_SHARE * n and power > SMALLEST_POWER:
                power *= 0.5
                weights = _weighted(self.weights, power * likelihood)
            self.weights, rest = weights, rest - power
            if rest <= 0.0:
                break
            self._resample(random, first=0)
        self.x = self.weights @ self.particles
        away = self.particles - self.x
        self.P = (self.weights[:, None] * away).T @ away
        if 1.0 / np.sum(self.weights**2) < 0.5 * n:
            self._resample(random, first=2)
        return True


def _weighted(weights: Floats, logarithm: Floats) -> Floats:
    """Weights times exp(logarithm), whose sum is 1."""
    product = weights * np.exp(logarithm - logarithm.max())
    total = float(product.sum())
    return product / total if total > 0.0 else weights

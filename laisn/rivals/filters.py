"""Rival methods that filter: Kalman updates with ranges or with range and bearing, a geodetic adjustment, particles."""

import math

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.filter import kalman_update
from laisn.geometry import signed_angle
from laisn.messages import OwnMotion, Reception
from laisn.rivals.odometry import STATES, DeadReckoning, OdometrySums, single_transmitter, slant
from laisn.settings import COMPASS_WALK, LOG_WALK, RivalSettings, TightSettings


class RangeFilter(DeadReckoning):
    """Extended Kalman filter on the ranges of a message, one measurement.

    h_i = ρ_i (1 + b_r / max z); R = σ² I + σ_s² s sᵀ with s_i = ρ_i / max z. One Gaussian, linearised at its mean, no
    second hypothesis, no test for echoes (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to
    Tracking and Navigation, 2001, section 10.3).
    """

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        settings: TightSettings = self.settings
        received = np.flatnonzero(np.isfinite(ranges))
        z = ranges[received]
        away = np.column_stack([self.x[:2] - below[received, :2], below[received, 2]])
        rho = np.linalg.norm(away, axis=1)
        share = rho / z.max()
        H = np.zeros((z.size, STATES))
        H[:, :2], H[:, 4] = away[:, :2] / rho[:, None], share
        R = settings.range_sigma**2 * np.eye(z.size) + settings.range_scale_sigma**2 * np.outer(share, share)
        self.x, self.P = kalman_update(self.x, self.P, H, z - rho - share * self.x[4], R)
        return True


class OneWayTravelTime(RangeFilter):
    """The same filter on the range to one transmitter, from the one-way travel time of its ping.

    What the leader broadcasts of itself counts as exact, and its heading hardly matters with the middle transmitter
    (R. M. Eustice, H. Singh, L. L. Whitcomb, J. Field Robotics 28(1), 2011; S. E. Webster et al., Int. J. Robotics
    Research 31(8), 2012, of which this is the client's filter without the delayed states of the server).
    """

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        one = ranges.copy()
        one[np.arange(3) != single_transmitter(ranges)] = np.nan
        return bool(np.isfinite(one).any()) and super()._update(below, one, own, reception)


class GeodeticAdjustment(DeadReckoning):
    """Dead reckoning since the last message and one range, adjusted by weighted least squares.

    Observations are the two coordinates of dead reckoning, with the covariance C that course and speed give them, and
    the distance to the leader. With A = [I; uᵀ] of the direction u from the leader,

        δ = (Aᵀ W A)⁻¹ Aᵀ W l,    W = diag(C⁻¹, 1/σ²),

    repeated at the adjusted position until it rests; its covariance is (Aᵀ W A)⁻¹. Constant errors of course, speed and
    range are no unknowns. After K. Naus and P. Piskur, Applying the geodetic adjustment method for positioning in
    relation to the swarm leader of underwater vehicles based on course, speed, and distance measurements, Energies 15,
    8472, 2022.
    """

    def __init__(self, settings: TightSettings, start: Floats) -> None:
        """As of `DeadReckoning`, with mean errors of course, speed and current in place of estimated states."""
        super().__init__(settings, start)
        self._biases = self.P[2:, 2:].copy()

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        i = single_transmitter(ranges)
        if math.isnan(ranges[i]):
            return False
        transmitter, z = below[i], float(ranges[i])
        reckoned, weight = self.x[:2].copy(), np.linalg.inv(self.P[:2, :2])
        sigma = math.hypot(self.settings.range_sigma, self.settings.range_scale_sigma)
        sigma = math.hypot(sigma, self.settings.range_scale_bias_sigma)
        for _ in range(10):
            rho, direction = slant(self.x, transmitter)
            normal = weight + np.outer(direction, direction) / sigma**2
            change = np.linalg.solve(normal, weight @ (reckoned - self.x[:2]) + direction * (z - rho) / sigma**2)
            self.x[:2] += change
            if np.abs(change).max() < 1e-6:
                break
        # mean errors of course and speed act again until the next message
        self.P = np.zeros((STATES, STATES))
        self.P[:2, :2], self.P[2:, 2:] = np.linalg.inv(normal), self._biases
        return True


class InvertedUsbl(DeadReckoning):
    """Extended Kalman filter on range, azimuth and elevation of one ping in the follower's own frame.

    az = atan2(Δe, Δn) − (θ − b_θ) and el = atan(Δz / D) of the vector from hydrophone to transmitter; of the front
    transmitter, as the sensor measures it. An azimuth has the random error of the compass beside its own
    (M. Morgado, P. Oliveira, C. Silvestre, J. F. Vasconcelos, Embedded vehicle dynamics aiding for USBL/INS underwater
    navigation, IEEE Trans. Control Syst. Technol. 22(1), 2014).
    """

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        settings = self.settings
        if reception.bearing is None:
            raise LaisnError(
                f"step {self._step}: the message has no azimuth and elevation of an inverted USBL; flights with "
                'sensors.own = [{ sensor = "inverted-usbl" }] measure them, and logs do not hold them'
            )
        azimuth, elevation = reception.bearing
        transmitter, z = below[1], ranges[1]
        if not np.isfinite([azimuth, elevation, z]).all():
            return False
        rho, direction = slant(self.x, transmitter)
        east, north = transmitter[:2] - self.x[:2]
        level, up = math.hypot(east, north), -float(transmitter[2])
        H = np.zeros((3, STATES))
        H[0, :2], H[0, 4] = direction, 1.0
        H[1, :2], H[1, 3] = (-north / level**2, east / level**2), 1.0
        H[2, :2] = up / rho**2 * np.array([east, north]) / level
        expected = math.atan2(east, north) - own.heading + self.x[3]
        innovation = [z - rho - self.x[4], signed_angle(azimuth - expected), elevation - math.atan2(up, level)]
        R = np.diag([
            settings.range_sigma**2 + settings.range_scale_sigma**2,
            settings.azimuth_sigma**2 + settings.heading_sigma**2,
            settings.elevation_sigma**2,
        ])  # fmt: skip
        self.x, self.P = kalman_update(self.x, self.P, H, np.array(innovation), R)
        return True


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

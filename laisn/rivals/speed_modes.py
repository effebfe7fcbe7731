"""A rival method that models motion: speed through the water is a state, in one of two modes.

State x = [x, y, b_v, b_θ, b_r, v, c_x, c_y]: as of `laisn.rivals.filters`, with the speed through
the water v [m/s] beside them. A vehicle that holds its speed changes it slowly, one that manoeuvres
quickly; an extended Kalman filter runs for each, and the interacting multiple model estimator (H.
A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988) mixes them. The log, an input
of the other filters, is a measurement here, v + b_v: slow changes of speed average its errors.
"""

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.delays import Delays, RecentWay, Ways, delays_of
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.geometry import place_transmitters, signed_angle
from laisn.messages import OwnMotion, Reception
from laisn.navigator import kalman_update
from laisn.navigators import OnlineNavigator
from laisn.rivals.filters import leader_position_variance, range_measurement
from laisn.rivals.leader_track import LeaderTrack
from laisn.settings import COMPASS_WALK, CURRENT_WALK, LOG_WALK, RivalSettings

X, Y, LOG_BIAS, COMPASS_BIAS, RANGE_SCALE, SPEED, CURRENT_EAST, CURRENT_NORTH = range(8)
"""Indices of the states x, y, b_v, b_θ, b_r, v, c_x and c_y."""
STATES = 8
WALKS = (0.005, 0.2)
"""Random walks of the speed in the two modes [m/s/√s]."""
STAY_PROBABILITY = 0.97
"""Chance that a mode stays over `MIXING_TIME`."""
MIXING_TIME = 1.0  # [s]
MIN_WEIGHT = 1e-6  # of a mode
START_SPEED_SIGMA = 10.0  # nothing is known of the speed before the first reading [m/s]


@compiled
def moments(x: Floats, P: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of Gaussians of these weights, whose sum is 1; x (m, 8), P (m, 8, 8)."""
    mean = np.zeros(STATES)
    covariance = np.zeros((STATES, STATES))
    for mode in range(weights.size):
        mean += weights[mode] * x[mode]
    for mode in range(weights.size):
        spread = x[mode] - mean
        covariance += weights[mode] * (P[mode] + np.outer(spread, spread))
    return mean, covariance


@compiled
def predict(
    x: Floats,
    P: Floats,
    walks: Floats,
    noise: tuple[float, float, float],
    heading: float,
    dt: float,
) -> None:
    """Both filters: x ← f(x), P ← F P Fᵀ + Q over a step.

    `heading` is the compass's at the middle of the step [rad], `dt` the step's length [s]. `walks`
    are the random walks of the speed by mode [m/s/√s], `noise` the random error of the compass
    [rad], that of motion which the log does not see [m/√s], and the random walk of the current
    [m/s/√s].
    """
    for mode in range(walks.size):
        course = heading - x[mode, COMPASS_BIAS]
        speed = x[mode, SPEED]
        u = np.array([np.sin(course), np.cos(course)])
        across = np.array([-u[1], u[0]])
        F = np.eye(STATES)
        Q = np.zeros((STATES, STATES))
        across_variance = (speed * noise[0] * dt) ** 2
        for i in range(2):
            F[i, SPEED] = u[i] * dt
            F[i, COMPASS_BIAS] = speed * across[i] * dt
            F[i, CURRENT_EAST + i] = dt
            for j in range(2):
                Q[i, j] = across_variance * across[i] * across[j]
            Q[i, i] += noise[1] ** 2 * dt
            Q[CURRENT_EAST + i, CURRENT_EAST + i] = noise[2] ** 2 * dt
            x[mode, i] += (speed * u[i] + x[mode, CURRENT_EAST + i]) * dt
        Q[LOG_BIAS, LOG_BIAS] = LOG_WALK**2 * dt
        Q[COMPASS_BIAS, COMPASS_BIAS] = COMPASS_WALK**2 * dt
        Q[SPEED, SPEED] = walks[mode] ** 2 * dt
        P[mode] = F @ P[mode] @ F.T + Q


@compiled
def update_weights(weights: Floats, log_likelihoods: Floats) -> None:
    """Multiply the weights by likelihoods, given as logarithms."""
    best = log_likelihoods.max()
    total = 0.0
    for mode in range(weights.size):
        weights[mode] *= np.exp(log_likelihoods[mode] - best)
        total += weights[mode]
    bounded = 0.0
    for mode in range(weights.size):
        weights[mode] = max(weights[mode] / total, MIN_WEIGHT)
        bounded += weights[mode]
    for mode in range(weights.size):
        weights[mode] /= bounded


@compiled
def update_log(x: Floats, P: Floats, weights: Floats, reading: float, sigma: float) -> None:
    """Both filters: update with a reading of the log, v + b_v, of random error σ [m/s], and weigh
    them by its likelihoods.
    """
    log_likelihoods = np.empty(weights.size)
    for mode in range(weights.size):
        # H has ones at the speed and at the log's bias: K = P Hᵀ / S
        ph = P[mode, :, SPEED] + P[mode, :, LOG_BIAS]
        variance = ph[SPEED] + ph[LOG_BIAS] + sigma**2
        innovation = reading - (x[mode, SPEED] + x[mode, LOG_BIAS])
        x[mode] += ph * (innovation / variance)
        P[mode] -= np.outer(ph, ph) / variance
        log_likelihoods[mode] = -0.5 * (innovation**2 / variance + np.log(variance))
    update_weights(weights, log_likelihoods)


@compiled
def mix(x: Floats, P: Floats, weights: Floats) -> None:
    """Let each filter begin anew with a blend of both, by the chance that the mode has changed."""
    stayed = weights * STAY_PROBABILITY
    changed = weights * (1.0 - STAY_PROBABILITY)
    mixed_x = np.empty_like(x)
    mixed_P = np.empty_like(P)
    totals = np.empty_like(weights)
    for mode in range(weights.size):
        joint = changed.copy()
        joint[mode] = stayed[mode]
        totals[mode] = joint.sum()
        mixed_x[mode], mixed_P[mode] = moments(x, P, joint / totals[mode])
    x[:] = mixed_x
    P[:] = mixed_P
    weights[:] = totals


@compiled
def estimate(
    x: Floats, P: Floats, weights: Floats, heading: float, sigma: float
) -> tuple[Floats, Floats]:
    """Mean, shape (4,), and covariance of x, y, vx, vy over both filters, at a compass reading
    [rad] of random error σ.
    """
    mean, covariance = moments(x, P, weights)
    course = heading - mean[COMPASS_BIAS]
    speed = mean[SPEED]
    u = np.array([np.sin(course), np.cos(course)])
    across = np.array([-u[1], u[0]])
    state = np.empty(4)
    J = np.zeros((4, STATES))
    for i in range(2):
        J[i, i] = 1.0
        J[2 + i, SPEED] = u[i]
        J[2 + i, COMPASS_BIAS] = speed * across[i]
        J[2 + i, CURRENT_EAST + i] = 1.0
        state[i] = mean[i]
        state[2 + i] = speed * u[i] + mean[CURRENT_EAST + i]
    V = J @ covariance @ J.T
    V[2:, 2:] += (speed * sigma) ** 2 * np.outer(across, across)
    return state, V


class SpeedModes(OnlineNavigator[Estimates]):
    """Two extended Kalman filters on log and ranges, mixed once a second; without a test for
    echoes.
    """

    def __init__(self, settings: RivalSettings, start: Floats) -> None:
        """Begin at a known place; LaisnError if the start is not four finite numbers."""
        super().__init__(settings, start, settings.start_sigma)
        current = settings.current_sigma if settings.assume.current else 0.0
        sigmas = [
            settings.start_sigma,
            settings.start_sigma,
            settings.speed_bias_sigma,
            settings.heading_bias_sigma,
            settings.range_scale_bias_sigma,
            START_SPEED_SIGMA,
            current,
            current,
        ]
        modes = len(WALKS)
        self.x: Floats = np.zeros((modes, STATES))
        self.x[:, :2] = self._state[:2]
        self.P: Floats = np.tile(np.diag(np.square(sigmas)), (modes, 1, 1))
        self.weights: Floats = np.full(modes, 1.0 / modes)
        current_walk = CURRENT_WALK if settings.assume.current else 0.0
        self._noise = settings.heading_sigma, settings.slip, current_walk
        self._track = LeaderTrack()
        self._recent = RecentWay(settings.speed_sigma, settings.heading_sigma, settings.slip)
        self._heading: float | None = None
        self._since_mixing = 0.0

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        self._recent.advance(np.array([[own.speed, own.heading]]), np.array([dt]))
        last_heading = own.heading if self._heading is None else self._heading
        middle = last_heading + 0.5 * signed_angle(own.heading - last_heading)
        self._heading = own.heading
        predict(self.x, self.P, np.array(WALKS), self._noise, middle, dt)
        update_log(self.x, self.P, self.weights, own.speed, self.settings.speed_sigma)
        used = reception is not None and self._receive(own, reception)
        self._since_mixing += dt
        if self._since_mixing >= MIXING_TIME - 1e-6:
            self._since_mixing = 0.0
            mix(self.x, self.P, self.weights)
        self._state, self._covariance = estimate(
            self.x, self.P, self.weights, own.heading, self.settings.heading_sigma
        )
        if reception is None:
            return []
        return [self._fix_at_estimate(FixKind.RANGES if used else FixKind.LOST)]

    def _receive(self, own: OwnMotion, reception: Reception) -> bool:
        """Update both filters with the ranges of a message, and with the current that the
        leader's way shows; whether there was a range.
        """
        settings = self.settings
        places = place_transmitters(reception, settings)
        transmitters = places - (0.0, 0.0, own.depth - settings.hydrophone_height)
        ranges = np.where(np.isfinite(transmitters).all(axis=1), reception.ranges, np.nan)
        ranges[settings.transmitters :] = np.nan
        used = bool(np.isfinite(ranges).any())
        if used:
            variance = leader_position_variance(settings, reception.message)
            delays = Delays(np.zeros(3), np.zeros(3))
            if settings.compensate_motion:
                clock = self._recent.clock
                delays = delays_of(reception.message, reception.ranges, clock, settings)
            ways = self._recent.since(delays.lag)
            measured = transmitters, ranges, variance
            log_likelihoods = [
                self._update_ranges(mode, delays, ways, measured) for mode in range(len(WALKS))
            ]
            update_weights(self.weights, np.array(log_likelihoods))
            self._recent.last_message = self._recent.clock
        current = self._track.receive(reception.message)
        if current is not None and settings.assume.current:
            H = np.zeros((2, STATES))
            H[:, CURRENT_EAST:] = np.eye(2)
            noise = current.variance * np.eye(2)
            for mode in range(len(WALKS)):
                innovation = current.current - self.x[mode, CURRENT_EAST:]
                self._update(mode, H, innovation, noise)
        return used

    def _update(self, mode: int, H: Floats, innovation: Floats, R: Floats) -> None:
        self.x[mode], self.P[mode] = kalman_update(self.x[mode], self.P[mode], H, innovation, R)

    def _update_ranges(
        self, mode: int, delays: Delays, ways: Ways, measured: tuple[Floats, Floats, float]
    ) -> float:
        """Update the filter of a mode with ranges; their log likelihood but for a constant.

        The ways since the pings are by the log's readings.

        `measured` are the transmitters as of `DeadReckoning._update`, the ranges to them, NaN where
        none came, shape (3,), [m], and the variance of the leader's broadcast position [m²].
        """
        transmitters, ranges, variance = measured
        x = self.x[mode]
        biases = float(x[LOG_BIAS]), float(x[COMPASS_BIAS])
        way = ways.less_biases(*biases)
        # as if each ping had arrived here and now: since it arrived the vehicle has gone on; over
        # the drift time the current has carried both vehicles
        moved_transmitters = transmitters.copy()
        moved_transmitters[:, :2] += way + np.outer(delays.drift_time, x[CURRENT_EAST:])
        H, innovation, R = range_measurement(self.settings, x, moved_transmitters, ranges)
        directions = H[:, :2].copy()
        R = R + variance * directions @ directions.T
        received = np.isfinite(ranges)
        H[:, LOG_BIAS] = -(directions * ways.by_log(biases[1])[received]).sum(axis=1)
        H[:, COMPASS_BIAS] = (
            directions[:, 0] * way[received, 1] - directions[:, 1] * way[received, 0]
        )
        # the state has a speed that errs less than the way by the log's readings
        errors = ways.covariance_of_pairs(np.flatnonzero(received))
        R += np.einsum("ik,ijkl,jl->ij", directions, errors, directions)
        if self.settings.assume.current:
            H[:, CURRENT_EAST:] = -delays.drift_time[received, None] * directions
        S = H @ self.P[mode] @ H.T + R
        self._update(mode, H, innovation, R)
        squared = float(innovation @ np.linalg.solve(S, innovation))
        return -0.5 * (squared + float(np.linalg.slogdet(S)[1]))

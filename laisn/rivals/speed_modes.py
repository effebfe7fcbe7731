"""A rival method that models motion: speed through the water is a state, in one of two modes.

State x = [x, y, b_v, b_θ, b_r, v, c_x, c_y]: as of `laisn.rivals.filters`, with the speed through
the water v [m/s] beside them. A vehicle that holds its speed changes it slowly, one that manoeuvres
quickly; an extended Kalman filter runs for each, and the interacting multiple model estimator (H.
A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988) mixes them. The log, an input
of the other filters, is a measurement here, v + b_v: slow changes of speed average its errors.
"""

import math
from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.delays import Delays, delays_of
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.geometry import place_transmitters, signed_angle
from laisn.messages import OwnMotion, Reception
from laisn.navigator import kalman_update
from laisn.navigators import OnlineNavigator
from laisn.rivals.filters import place_variance, range_measurement
from laisn.rivals.leader_track import LeaderTrack
from laisn.settings import COMPASS_WALK, CURRENT_WALK, LOG_WALK, RivalSettings

X, Y, LOG, COMPASS, SCALE, SPEED, EAST, NORTH = range(8)
STATES = 8
WALKS = (0.005, 0.2)
"""Random walks of the speed in the two modes [m/s/√s]."""
STAY = 0.97
"""Chance that a mode stays over `MIXING_TIME`."""
MIXING_TIME = 1.0  # [s]
LEAST_WEIGHT = 1e-6
START_SPEED_SIGMA = 10.0  # nothing is known of the speed before the first reading [m/s]


@dataclass
class Mode:
    """One of the two filters: its state, shape (8,), covariance, shape (8, 8), and weight."""

    x: Floats
    P: Floats
    walk: float  # of the speed [m/s/√s]
    weight: float


def moments(modes: list[Mode], weights: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of Gaussians of these weights, whose sum is 1."""
    x = sum((w * mode.x for w, mode in zip(weights, modes, strict=True)), np.zeros(STATES))
    P = np.zeros((STATES, STATES))
    for w, mode in zip(weights, modes, strict=True):
        P += w * (mode.P + np.outer(mode.x - x, mode.x - x))
    return x, P


class SpeedModes(OnlineNavigator[Estimates]):
    """Two extended Kalman filters on log and ranges, mixed once a second; without a test for
    echoes.
    """

    def __init__(self, settings: RivalSettings, start: Floats) -> None:
        """Begin at a known place; ValueError if the start is not four finite numbers."""
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
        x = np.zeros(STATES)
        x[:2] = self._state[:2]
        P = np.diag(np.square(sigmas))
        self.modes = [Mode(x.copy(), P.copy(), walk, 1.0 / len(WALKS)) for walk in WALKS]
        self._current_walk = CURRENT_WALK if settings.assume.current else 0.0
        self._track = LeaderTrack()
        self._clock = 0.0
        self._heading: float | None = None
        self._since_mixing = 0.0

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        self._clock += dt
        before = own.heading if self._heading is None else self._heading
        middle = before + 0.5 * signed_angle(own.heading - before)
        self._heading = own.heading
        for mode in self.modes:
            self._predict(mode, middle, dt)
        self._update_weights([self._update_log(mode, own.speed) for mode in self.modes])
        used = reception is not None and self._receive(own, reception)
        self._since_mixing += dt
        if self._since_mixing >= MIXING_TIME - 1e-6:
            self._since_mixing = 0.0
            self._mix()
        self._write_estimate(own.heading)
        if reception is None:
            return []
        return [self._fix_at_estimate(FixKind.RANGES if used else FixKind.LOST)]

    def _predict(self, mode: Mode, heading: float, dt: float) -> None:
        """x ← f(x), P ← F P Fᵀ + Q over a step, with the compass [rad] at its middle."""
        settings = self.settings
        x = mode.x
        u = np.array([math.sin(heading - x[COMPASS]), math.cos(heading - x[COMPASS])])
        across = np.array([-u[1], u[0]])
        F = np.eye(STATES)
        F[:2, SPEED] = u * dt
        F[:2, COMPASS] = x[SPEED] * across * dt
        F[X, EAST] = F[Y, NORTH] = dt
        Q = np.zeros((STATES, STATES))
        Q[:2, :2] = (x[SPEED] * settings.heading_sigma * dt) ** 2 * np.outer(across, across)
        Q[:2, :2] += settings.slip**2 * dt * np.eye(2)
        Q[LOG, LOG] = LOG_WALK**2 * dt
        Q[COMPASS, COMPASS] = COMPASS_WALK**2 * dt
        Q[SPEED, SPEED] = mode.walk**2 * dt
        Q[EAST, EAST] = Q[NORTH, NORTH] = self._current_walk**2 * dt
        x[:2] += (x[SPEED] * u + x[EAST:]) * dt
        mode.P = F @ mode.P @ F.T + Q

    def _update_log(self, mode: Mode, reading: float) -> float:
        """Update with a reading of the log, v + b_v [m/s]; its log likelihood."""
        gain = mode.P[:, SPEED] + mode.P[:, LOG]
        variance = float(gain[SPEED] + gain[LOG]) + self.settings.speed_sigma**2
        innovation = reading - float(mode.x[SPEED] + mode.x[LOG])
        mode.x += gain * innovation / variance
        mode.P -= np.outer(gain, gain) / variance
        squared = innovation * innovation / variance
        return float(-0.5 * (squared + math.log(variance)))

    def _update_weights(self, likelihoods: list[float]) -> None:
        """Multiply the weights by likelihoods, given as logarithms."""
        best = max(likelihoods)
        weights = np.array(
            [
                mode.weight * math.exp(likelihood - best)
                for mode, likelihood in zip(self.modes, likelihoods, strict=True)
            ]
        )
        weights = np.maximum(weights / weights.sum(), LEAST_WEIGHT)
        for mode, weight in zip(self.modes, (weights / weights.sum()).tolist(), strict=True):
            mode.weight = weight

    def _mix(self) -> None:
        """Before the next second either filter begins with a blend of both, by the chance that the
        mode has changed.
        """
        chance = np.array([[STAY, 1.0 - STAY], [1.0 - STAY, STAY]])
        weights = np.array([mode.weight for mode in self.modes])
        joint = weights[:, None] * chance
        totals = joint.sum(axis=0)
        mixed = [moments(self.modes, joint[:, j] / totals[j]) for j in range(len(WALKS))]
        for mode, (x, P), total in zip(self.modes, mixed, totals.tolist(), strict=True):
            mode.x = x
            mode.P = P
            mode.weight = total

    def _receive(self, own: OwnMotion, reception: Reception) -> bool:
        """Update both filters with the ranges of a message, and with the current that the
        leader's way shows; whether there was a range.
        """
        settings = self.settings
        places = place_transmitters(reception, settings)
        below = places - (0.0, 0.0, own.depth - settings.hydrophone_height)
        ranges = np.where(np.isfinite(below).all(axis=1), reception.ranges, np.nan)
        ranges[settings.transmitters :] = np.nan
        used = bool(np.isfinite(ranges).any())
        if used:
            variance = place_variance(settings, reception.message)
            delays = Delays(np.zeros(3), np.zeros(3))
            if settings.compensate_motion:
                delays = delays_of(reception.message, reception.ranges, self._clock, settings)
            likelihoods = [
                self._update_ranges(mode, own.heading, delays, (below, ranges, variance))
                for mode in self.modes
            ]
            self._update_weights(likelihoods)
        seen = self._track.receive(reception.message)
        if seen is not None and settings.assume.current:
            H = np.zeros((2, STATES))
            H[:, EAST:] = np.eye(2)
            for mode in self.modes:
                innovation = seen.current - mode.x[EAST:]
                noise = seen.variance * np.eye(2)
                mode.x, mode.P = kalman_update(mode.x, mode.P, H, innovation, noise)
        return used

    def _update_ranges(
        self, mode: Mode, heading: float, delays: Delays, measured: tuple[Floats, Floats, float]
    ) -> float:
        """Update a filter with ranges, NaN where none came, to the transmitters below and with the
        variance of the leader's place; their log likelihood.
        """
        below, ranges, variance = measured
        course = heading - mode.x[COMPASS]
        ahead = np.array([math.sin(course), math.cos(course)])
        moved = below.copy()
        moved[:, :2] += np.outer(delays.lag, mode.x[SPEED] * ahead)
        moved[:, :2] += np.outer(delays.age, mode.x[EAST:])
        H, innovation, R = range_measurement(self.settings, mode.x, moved, ranges)
        directions = H[:, :2].copy()
        R = R + variance * directions @ directions.T
        received = np.isfinite(ranges)
        lag = delays.lag[received]
        H[:, SPEED] = -lag * (directions @ ahead)
        across = directions[:, 0] * ahead[1] - directions[:, 1] * ahead[0]
        H[:, COMPASS] = lag * mode.x[SPEED] * across
        if self.settings.assume.current:
            H[:, EAST:] = -delays.age[received, None] * directions
        S = H @ mode.P @ H.T + R
        mode.x, mode.P = kalman_update(mode.x, mode.P, H, innovation, R)
        squared = float(innovation @ np.linalg.solve(S, innovation))
        return -0.5 * (squared + float(np.linalg.slogdet(S)[1]))

    def _write_estimate(self, heading: float) -> None:
        """Mean and covariance of x, y, vx, vy over both filters."""
        weights = np.array([mode.weight for mode in self.modes])
        x, P = moments(self.modes, weights)
        u = np.array([math.sin(heading - x[COMPASS]), math.cos(heading - x[COMPASS])])
        across = np.array([-u[1], u[0]])
        J = np.zeros((4, STATES))
        J[:2, :2] = np.eye(2)
        J[2:, SPEED] = u
        J[2:, COMPASS] = x[SPEED] * across
        J[2:, EAST:] = np.eye(2)
        self._state = np.array([*x[:2], *(x[SPEED] * u + x[EAST:])])
        self._covariance = J @ P @ J.T
        noise = (x[SPEED] * self.settings.heading_sigma) ** 2
        self._covariance[2:, 2:] += noise * np.outer(across, across)

"""Dead reckoning on log and compass, with the covariance of what that leaves: the base of all rival methods.

State x = [x, y, b_v, b_θ, b_r, c_x, c_y]: position of the hydrophone [m], biases of log [m/s] and compass [rad], mean
of the error that the ranges share in proportion to their length [m at the largest], and current [m/s], which is zero
unless `assume.current`. The vehicle moves with the mean velocity of both ends of a step,
v = (s − b_v) [sin(θ − b_θ), cos(θ − b_θ)] + c, of log s and compass θ (L. Paull, S. Saeedi, M. Seto, H. Li, AUV
navigation and localization: a review, IEEE J. Ocean. Eng. 39(1), 2014).
"""

import math

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.failure import LaisnError
from laisn.geometry import place_transmitters
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.navigators import OnlineNavigator, require_message, require_readings
from laisn.settings import COMPASS_WALK, CURRENT_WALK, LOG_WALK, TightSettings

STATES = 7


@compiled
def propagate(
    x: Floats,
    P: Floats,
    readings: Floats,
    durations: Floats,
    sigma: tuple[float, float, float, float],
    out: tuple[Floats, Floats],
) -> Floats:
    """Filter steps without a message: x ← f(x), P ← F P Fᵀ + Q; returns P.

    `readings` are log [m/s] and compass [rad] before the first step and after each of n, shape (n + 1, 2), `durations`
    of the steps [s]. `sigma` are random errors of log and compass, random walks of motion beside the log [m/√s] and of
    the current [m/s/√s]. `out` gets x, y, vx, vy after each step, shape (n, 4), and their covariance, shape (n, 4, 4).
    """
    states, covariances = out
    for k in range(durations.size):
        dt = durations[k]
        F, Q, J = np.eye(STATES), np.zeros((STATES, STATES)), np.zeros((2, STATES))
        F[0, 5] = F[1, 6] = dt
        east = north = water = 0.0
        for end in range(2):
            water, heading = readings[k + end, 0] - x[2], readings[k + end, 1] - x[3]
            east, north = np.sin(heading), np.cos(heading)
            x[0] += 0.5 * dt * (water * east + x[5])
            x[1] += 0.5 * dt * (water * north + x[6])
            F[0, 2] -= 0.5 * dt * east
            F[1, 2] -= 0.5 * dt * north
            F[0, 3] -= 0.5 * dt * water * north
            F[1, 3] += 0.5 * dt * water * east
        # the velocity's derivatives by the states, and its random error: along by the log, across by the compass
        J[0, 2], J[0, 3], J[0, 5] = -east, -water * north, 1.0
        J[1, 2], J[1, 3], J[1, 6] = -north, water * east, 1.0
        along, across = sigma[0] ** 2, (sigma[1] * readings[k + 1, 0]) ** 2
        xx, yy = along * east * east + across * north * north, along * north * north + across * east * east
        W = np.array([[xx, (along - across) * east * north], [(along - across) * east * north, yy]])
        for i in range(2):
            for j in range(2):
                Q[i, j] = dt * dt * W[i, j]
            Q[i, i] += sigma[2] ** 2 * dt
        Q[2, 2], Q[3, 3] = LOG_WALK**2 * dt, COMPASS_WALK**2 * dt
        Q[5, 5] = Q[6, 6] = sigma[3] ** 2 * dt
        P = F @ P @ F.T + Q
        PJ = P @ J.T
        V = J @ PJ + W
        states[k, 0], states[k, 1], states[k, 2], states[k, 3] = x[0], x[1], water * east + x[5], water * north + x[6]
        for i in range(2):
            for j in range(2):
                covariances[k, i, j] = P[i, j]
                covariances[k, i, 2 + j] = covariances[k, 2 + j, i] = PJ[i, j]
                covariances[k, 2 + i, 2 + j] = V[i, j]
    return P


class DeadReckoning(OnlineNavigator[Estimates]):
    """Takes no ranges at all; a subclass updates `x` and `P` in `_update`."""

    def __init__(self, settings: TightSettings, start: Floats) -> None:
        """Begin at a known state; ValueError if the start is not four finite numbers."""
        super().__init__(settings, start, settings.start_sigma)
        biases = settings.speed_bias_sigma, settings.heading_bias_sigma, settings.range_scale_bias_sigma
        current, walk = (settings.current_sigma, CURRENT_WALK) if settings.assume.current else (0.0, 0.0)
        self.x: Floats = np.concatenate([self._state[:2], np.zeros(STATES - 2)])
        self.P: Floats = np.diag(np.square([settings.start_sigma, settings.start_sigma, *biases, current, current]))
        self._reading = np.empty((0, 2))
        self._noise = settings.speed_sigma, settings.heading_sigma, settings.slip, walk

    @property
    def biases(self) -> tuple[float, float]:
        """Estimated biases of log [m/s] and compass [rad]."""
        return float(self.x[2]), float(self.x[3])

    def step(
        self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None
    ) -> list[FixRecord]:
        """Advance by one filter step; see `OnlineNavigator.step`."""
        own = self._begin_step(own, duration)
        dt = self.settings.dt if duration is None else duration
        self._advance(np.array([[own.speed, own.heading]]), np.array([dt]))
        return [] if reception is None else [self._receive(own, reception)]

    def run(self, measurements: Measurements) -> Estimates:
        """As `OnlineNavigator.run`; all steps between two messages are one call."""
        measurements.require_fresh(self._step, self.settings.dt)
        n = measurements.speed.size
        readings = np.column_stack([measurements.speed, measurements.heading])
        broken = np.flatnonzero(~np.isfinite(readings).all(axis=1) | np.isinf(measurements.depth))
        if broken.size:
            raise LaisnError(f"step {broken[0] + 1}: log, compass or depth are not finite")
        durations = np.full(n, measurements.dt) if measurements.durations is None else measurements.durations
        states, covariances, fixes = np.empty((n, 4)), np.empty((n, 4, 4)), []
        for done, own, reception in measurements.receptions():
            part = slice(self._step, done)
            states[part], covariances[part] = self._advance(readings[part], durations[part])
            self._step = done
            if reception is not None:
                fixes.append(self._receive(own, reception))
                states[done - 1], covariances[done - 1] = self._state, self._covariance
        return self._estimates(states, covariances, fixes)

    def _advance(self, readings: Floats, durations: Floats) -> tuple[Floats, Floats]:
        """Bring the estimate forward by n steps; states and covariances after each."""
        n = durations.size
        out = np.empty((n, 4)), np.empty((n, 4, 4))
        if n:
            before = self._reading if self._reading.size else readings[:1]
            self.P = propagate(self.x, self.P, np.vstack([before, readings]), durations, self._noise, out)
            self._reading, self._state, self._covariance = readings[-1:], out[0][-1], out[1][-1]
        return out

    def _receive(self, own: OwnMotion, reception: Reception) -> FixRecord:
        """Update with a message: the fix is the estimate after it."""
        require_readings(self._step, own, reception, "log")
        require_message(self._step, reception.message)
        places = place_transmitters(reception, self.settings)
        below = places - (0.0, 0.0, own.depth - self.settings.hydrophone_height)
        ranges = np.where(np.isfinite(below).all(axis=1), reception.ranges, np.nan)
        ranges[self.settings.transmitters :] = np.nan
        used = bool(np.isfinite(ranges).any()) and self._update(below, ranges, own, reception)
        if used:
            # velocity by the new biases; no time passes
            out = np.empty((1, 4)), np.empty((1, 4, 4))
            propagate(self.x.copy(), self.P, np.vstack([self._reading] * 2), np.zeros(1), self._noise, out)
            self._state, self._covariance = out[0][0], out[1][0]
        spread = math.sqrt(0.5 * float(np.trace(self.P[:2, :2])))
        kind = FixKind.RANGES if used else FixKind.LOST
        return FixRecord(step=self._step, position=self._state[:2], sigma=spread, kind=kind)

    def _update(self, below: Floats, ranges: Floats, own: OwnMotion, reception: Reception) -> bool:
        """Update `x` and `P` with the readings and the message of this step; whether the ranges were used.

        `below` has the transmitters: east, north, depth below the hydrophone, shape (3, 3), [m]; `ranges` the slant
        ranges, shape (3,), [m], NaN where none is to be used, not all.
        """
        return False


class OdometrySums(DeadReckoning):
    """Base of methods that move from message to message: sums of the odometry by the compass, as it reads."""

    def __init__(self, settings: TightSettings, start: Floats) -> None:
        """As of `DeadReckoning`."""
        super().__init__(settings, start)
        self._sums: Floats = np.zeros(8)

    def _advance(self, readings: Floats, durations: Floats) -> tuple[Floats, Floats]:
        before = self._reading if self._reading.size else readings[:1]
        speed, heading = np.vstack([before, readings]).T
        u, dt = np.column_stack([np.sin(heading), np.cos(heading)]), durations[:, None]
        v, settings = speed[:, None] * u, self.settings
        along, across = settings.speed_sigma * dt * u[1:], settings.heading_sigma * dt * v[1:, ::-1] * (-1.0, 1.0)
        noise = [along[:, i] * along[:, j] + across[:, i] * across[:, j] for i, j in ((0, 0), (0, 1), (1, 1))]
        noise = [noise[0] + settings.slip**2 * durations, noise[1], noise[2] + settings.slip**2 * durations]
        terms = np.column_stack([0.5 * dt * (v[:-1] + v[1:]), 0.5 * dt * (u[:-1] + u[1:]), *noise, dt])
        # one after another: the same to the bit in one call and in many
        self._sums = np.cumsum(np.vstack([self._sums, terms]), axis=0)[-1]
        return super()._advance(readings, durations)

    def _odometry(self) -> tuple[Floats, Floats, Floats, float]:
        """Odometry since the last message, which is then reset: Σ s u Δt [m] and Σ u Δt [s], shape (2,), with u of the
        compass; the covariance of the first, shape (2, 2), [m²]; and the time [s].
        """
        *way, xx, xy, yy, time = self._sums.tolist()
        self._sums = np.zeros(8)
        return np.array(way[:2]), np.array(way[2:]), np.array([[xx, xy], [xy, yy]]) + 1e-12 * np.eye(2), time


def single_transmitter(ranges: Floats) -> int:
    """The transmitter of methods that use one: the middle one, or the rear where that is not received."""
    return 0 if np.isnan(ranges[2]) else 2


def slant(x: Floats, transmitter: Floats) -> tuple[float, Floats]:
    """Slant range [m] and the direction from a transmitter to the state's position, shape (2,)."""
    away = x[:2] - transmitter[:2]
    rho = math.sqrt(float(away @ away) + float(transmitter[2]) ** 2)
    return rho, away / rho

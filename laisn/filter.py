"""The linear Kalman filter of LAISN with its process noise, and its gate (paper, Sections 2.1 and 2.4).

The only module that uses filterpy.
"""

import math
from typing import NamedTuple

import numpy as np

from laisn import POSITION
from laisn.arrays import Floats
from laisn.compiled import formula
from laisn.geometry import SINGULAR_VARIANCE, Point, angle_between, is_singular
from laisn.settings import GATE_MEASURED, GATE_OFF, Tuning

_H_POSITION = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])
_H_VELOCITY = np.array([[0, 0, 1.0, 0], [0, 0, 0, 1.0]])

_PER_PI = 1.0 / math.pi


@formula
def speed_share(before: float, now: float, speed_max: float) -> float:
    """γv: change of speed as a share of the top speed; 0 if the first is NaN."""
    share = abs(now - before) * (1.0 / speed_max)
    return share if share > 0.0 else 0.0


@formula
def turn_share(before: float, now: float) -> float:
    """γθ: smallest angle between two headings as a share of π; 0 if the first is NaN."""
    share = angle_between(now, before) * _PER_PI
    return share if share > 0.0 else 0.0


@formula
def larger(a: float, b: float) -> float:
    """Larger of two shares, which is that of the vehicle that changed more."""
    return a if a > b else b


@formula
def expected_acceleration(speed_change: float, turn: float, t: Tuning) -> float:
    """σa = α (γv + γθ) + σa0 [m/s²]: more where a vehicle manoeuvres (paper, Section 2.1)."""
    return t.alpha * (speed_change + turn) + t.sigma_a0


class Innovation(NamedTuple):
    """Innovation of a position update: z − H x̂, shape (2,), [m], and S, shape (2, 2), [m²]."""

    residual: Floats
    covariance: Floats
    applied: bool
    """False where S was singular and the update was skipped."""


def kalman_update(x: Floats, P: Floats, H: Floats, innovation: Floats, R: Floats) -> tuple[Floats, Floats]:
    """Joseph form: x ← x + K ν, P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ with K = P Hᵀ S⁻¹, S = H P Hᵀ + R."""
    HP = H @ P
    K = np.linalg.solve(HP @ H.T + R, HP).T
    rest = np.eye(x.size) - K @ H
    return x + K @ innovation, rest @ P @ rest.T + K @ R @ K.T


def _motion(dt: float) -> tuple[Floats, Floats]:
    """Transition over a step of constant velocity, and Q for a constant unit acceleration (Section 2.1), shape (4,
    4).
    """
    noise = np.asarray(np.kron([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]], np.eye(2)), dtype=np.float64)
    return np.eye(4) + dt * np.eye(4, k=2), noise


class Filter:
    """State [x, y, vx, vy] and its covariance."""

    def __init__(self, dt: float, start: Floats, sigma0: Floats) -> None:
        """Start at a known state and its standard deviations, shapes (4,); `dt` is the filter step [s]."""
        from filterpy.kalman import KalmanFilter

        self._kalman = KalmanFilter(dim_x=4, dim_z=2)
        # one-dimensional: a column would broadcast against the rows of z without an error
        self._kalman.x = np.array(start, dtype=np.float64)
        self._kalman.P = np.diag(np.square(sigma0))
        self._kalman.F, self._unit_noise = _motion(dt)

    @property
    def state(self) -> Floats:
        """State x, y, vx, vy, shape (4,); a copy."""
        return np.array(self._kalman.x)

    @property
    def covariance(self) -> Floats:
        """Covariance of `state`, shape (4, 4); a copy."""
        return np.array(self._kalman.P)

    def predict(self, sigma_a: float, duration: float | None = None) -> None:
        """One step, of another `duration` than Δt [s] if given, under accelerations of standard deviation σa [m/s²]."""
        if duration is None:
            self._kalman.predict(Q=sigma_a**2 * self._unit_noise)
        else:
            transition, noise = _motion(duration)
            self._kalman.predict(F=transition, Q=sigma_a**2 * noise)

    def update_position(self, position: tuple[float, float], sigma: float) -> Innovation:
        """Position update in Joseph form; skipped where the filter is already exact and σp = 0."""
        z = np.array(position)
        residual = z - self._kalman.x[POSITION]
        covariance = self._kalman.P[POSITION, POSITION] + sigma**2 * np.eye(2)
        if is_singular(covariance[0, 0], covariance[1, 1]):
            return Innovation(residual, covariance, applied=False)
        self._kalman.update(z, R=sigma**2 * np.eye(2), H=_H_POSITION)
        return Innovation(residual, covariance, applied=True)

    def update_along(self, position: tuple[float, float], axis: tuple[float, float], sigma: float) -> Innovation:
        """Update with a position that is known along one direction alone, in Joseph form; skipped as the other one.

        The position is on the line through the prediction along the unit vector `axis`, with σ along it [m]. Returns
        the residual along the axis as a vector, and the variance of its length times the unit matrix.
        """
        residual = np.array(position) - self._kalman.x[POSITION]
        h = np.array([axis[0], axis[1], 0.0, 0.0])
        covariance = self._kalman.P
        variance = float(h @ covariance @ h) + sigma**2
        if variance < SINGULAR_VARIANCE:
            return Innovation(residual, variance * np.eye(2), applied=False)
        along, noise = np.array([residual @ h[:2]]), np.array([[sigma**2]])
        self._kalman.x, self._kalman.P = kalman_update(self._kalman.x, covariance, h[None], along, noise)
        return Innovation(residual, variance * np.eye(2), applied=True)

    def update_speed(self, speed: float, heading: float, sigma_speed: float, sigma_heading: float) -> None:
        """Speed update from log and compass, R = J diag(σV², σθ²) Jᵀ (paper, Section 2.1)."""
        sine, cosine = np.sin(heading), np.cos(heading)
        jacobian = np.array([[sine, speed * cosine], [cosine, -speed * sine]])
        noise = (jacobian * (sigma_speed**2, sigma_heading**2)) @ jacobian.T
        self._kalman.update(np.array([speed * sine, speed * cosine]), R=noise, H=_H_VELOCITY)


@formula
def reach(elapsed: float, speed: float, t: Tuning) -> float:
    """Greatest distance that a vehicle can have come in a time [s], at top speed or at the one measured [m]."""
    top = speed if t.gate == GATE_MEASURED else t.follower_speed_max
    return np.inf if t.gate == GATE_OFF else top * elapsed


@formula
def is_beyond(place: Point, start: Point, bound: float) -> bool:
    """Whether a place lies farther from a start than the bound [m]."""
    east, north = place.east - start.east, place.north - start.north
    return math.sqrt(east * east + north * north) > bound


class Gate:
    """Gate around the last accepted position: the state right after the update that was accepted."""

    def __init__(self, tuning: Tuning, start: Point) -> None:
        self._tuning = tuning
        self._position = start
        self._step = 0
        self._extra = 0.0

    def lengthen(self, extra: float) -> None:
        """Account for a step that takes longer than Δt by `extra` [s]."""
        self._extra += extra

    def bound(self, step: int, speed: float) -> float:
        """Greatest distance from the last accepted position at step k [m], at a measured speed [m/s]."""
        # steps of Δt are counted, not added up, so that this is exact where there are no others
        return reach((step - self._step) * self._tuning.dt + self._extra, speed, self._tuning)

    def passes(self, position: Point, step: int, speed: float) -> bool:
        """Whether a fix at that position passes."""
        return not is_beyond(position, self._position, self.bound(step, speed))

    def accept(self, position: Point, step: int) -> None:
        """Take the state after an update as the new last accepted position."""
        self._position = position
        self._step = step
        self._extra = 0.0

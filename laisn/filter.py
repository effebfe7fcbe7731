"""The linear Kalman filter of LAISN (paper, Section 2.1): the only module that knows filterpy."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from filterpy.kalman import KalmanFilter

from laisn import POSITION
from laisn.geometry import SINGULAR_VARIANCE

Floats = npt.NDArray[np.float64]

_H_POSITION = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])
_H_VELOCITY = np.array([[0, 0, 1.0, 0], [0, 0, 0, 1.0]])


class Innovation(NamedTuple):
    """Of a position update."""

    residual: Floats
    """z − H x̂, shape (2,), [m]."""
    covariance: Floats
    """S, shape (2, 2), [m²]."""
    applied: bool
    """False where S was singular and the update was skipped."""


class Filter:
    """State [x, y, vx, vy] and its covariance."""

    def __init__(self, dt: float, start: Floats, sigma0: Floats) -> None:
        """Start at a known state.

        Args:
            dt: filter step [s].
            start: state, shape (4,).
            sigma0: its standard deviations, shape (4,).
        """
        self._kalman = KalmanFilter(dim_x=4, dim_z=2)
        # one-dimensional: a column would broadcast against the rows of z in silence
        self._kalman.x = np.array(start, dtype=np.float64)
        self._kalman.P = np.diag(np.square(sigma0))
        self._kalman.F = np.eye(4) + dt * np.eye(4, k=2)
        # Q for an acceleration of unit variance, constant over the step (paper, Section 2.1)
        position, cross, velocity = dt**4 / 4, dt**3 / 2, dt**2
        self._unit_noise = np.array(
            [
                [position, 0, cross, 0],
                [0, position, 0, cross],
                [cross, 0, velocity, 0],
                [0, cross, 0, velocity],
            ]
        )

    @property
    def state(self) -> Floats:
        """Shape (4,); a copy."""
        return np.array(self._kalman.x)

    @property
    def covariance(self) -> Floats:
        """Shape (4, 4); a copy."""
        return np.array(self._kalman.P)

    def predict(self, sigma_a: float) -> None:
        """One step of constant velocity under accelerations of standard deviation σa [m/s²]."""
        self._kalman.predict(Q=sigma_a**2 * self._unit_noise)

    def update_position(self, position: tuple[float, float], sigma: float) -> Innovation:
        """Position update in Joseph form; skipped where the filter is already exact and σp = 0."""
        z = np.array(position)
        residual = z - self._kalman.x[POSITION]
        covariance = self._kalman.P[POSITION, POSITION] + sigma**2 * np.eye(2)
        if 0.5 * np.trace(covariance) < SINGULAR_VARIANCE:
            return Innovation(residual, covariance, applied=False)
        self._kalman.update(z, R=sigma**2 * np.eye(2), H=_H_POSITION)
        return Innovation(residual, covariance, applied=True)

    def update_speed(self, speed: float, heading: float, sigma_speed: float, sigma_heading: float) -> None:
        """Speed update from log and compass, R = J diag(σV², σθ²) Jᵀ (paper, Section 2.1)."""
        sine, cosine = np.sin(heading), np.cos(heading)
        jacobian = np.array([[sine, speed * cosine], [cosine, -speed * sine]])
        noise = jacobian @ np.diag([sigma_speed**2, sigma_heading**2]) @ jacobian.T
        self._kalman.update(np.array([speed * sine, speed * cosine]), R=noise, H=_H_VELOCITY)

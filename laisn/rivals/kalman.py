"""Rival methods with one Gaussian: Kalman updates with ranges or with range and bearing, and a geodetic adjustment."""

import math

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.filter import kalman_update
from laisn.geometry import signed_angle
from laisn.messages import OwnMotion, Reception
from laisn.rivals.odometry import STATES, DeadReckoning, single_transmitter, slant
from laisn.tight.settings import TightSettings


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

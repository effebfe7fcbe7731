"""How the leader measures its pitch and roll: an inclinometer, alone or steadied by gyros (AHRS).

An inclinometer takes the specific force a − g for the vertical, so that a hull that accelerates, as in waves, reads
wrong by up to a / g. A complementary filter follows the gyros at once and the inclinometer slowly (Mahony, Hamel &
Pflimlin, IEEE Transactions on Automatic Control 53, 2008). Its error e is linear in the inclinometer's error i and in
the angle w by which the gyros walk off in a step:

    e_k = (1 − γ)(e_{k−1} + w_k) + γ i_k,    γ = 1 − exp(−Δt / τ).

Accelerations are the same in every run, and go through the filter here; the random part is a Gauss–Markov process with
correlation time τ, of which `sim.sensing.sensor_errors` takes the values that are broadcast.
"""

from typing import NamedTuple, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from sim.geometry import attitude
from sim.scenario.settings import CONTROL_STEP_S, Sensors
from sim.trajectory import Trajectory
from sim.water.waves import GRAVITY

_SECONDS_AN_HOUR = 3600.0


class RandomError(NamedTuple):
    """Random error of pitch and of roll."""

    sigma: float
    """Standard deviation [rad]."""
    time: float
    """Correlation time; 0: each reading has its own [s]."""


class Ahrs(Protocol):
    """What of the leader's AHRS is the same in every run; the sensors of a scenario have it."""

    @property
    def leader_attitude_feels_acceleration(self) -> bool:
        """Whether the inclinometer takes accelerations for tilt."""

    @property
    def leader_gyro_time_constant_s(self) -> float:
        """τ of the filter; 0: no gyros."""


def gain(sensors: Ahrs) -> float:
    """γ: share of the inclinometer in each step of the filter; 1 without gyros."""
    if sensors.leader_gyro_time_constant_s == 0.0:
        return 1.0
    return float(-np.expm1(-CONTROL_STEP_S / sensors.leader_gyro_time_constant_s))


def random_error(sensors: Sensors) -> RandomError:
    """Random part of the error of a measured angle, after the filter has run for long."""
    reading = float(np.deg2rad(sensors.leader_attitude_sigma_deg))
    if sensors.leader_gyro_time_constant_s == 0.0:
        return RandomError(reading, 0.0)
    share = gain(sensors)
    walk = np.deg2rad(sensors.leader_gyro_random_walk_deg_sqrt_h) * np.sqrt(CONTROL_STEP_S / _SECONDS_AN_HOUR)
    kept = 1.0 - share
    variance = (share**2 * reading**2 + kept**2 * walk**2) / (1.0 - kept**2)
    return RandomError(float(np.sqrt(variance)), sensors.leader_gyro_time_constant_s)


def apparent_tilt(trajectory: Trajectory, vehicle: int = 0) -> Floats:
    """Pitch and roll that specific force seems to show at a vehicle's origin, shape (n, 2), [rad].

    Accelerations are means over the interval that ends at an instant, as the sensor knows them then; the first instant
    has those of the second.
    """
    acceleration = np.diff(trajectory.velocity[:, vehicle], axis=0) / trajectory.dt
    acceleration = np.concatenate([acceleration[:1], acceleration])
    force = acceleration + np.array([0.0, 0.0, GRAVITY])
    to_body = trajectory.quaternion[:, vehicle] * np.array([1.0, -1.0, -1.0, -1.0])
    forward, port, up = attitude.rotate(to_body, force).T
    return np.column_stack([np.arctan2(forward, np.hypot(port, up)), np.arctan2(port, up)])


@compiled
def _low_pass(error: Floats, share: float) -> Floats:
    """e_k = (1 − γ) e_{k−1} + γ i_k, column by column; importing scipy.signal for it would take a second."""
    passed = np.empty_like(error)
    for j in range(error.shape[1]):
        last = 0.0
        for k in range(error.shape[0]):
            last += share * (error[k, j] - last)
            passed[k, j] = last
    return passed


@compiled
def _turned(quaternion: Floats, vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector of the world in the hull's axes, rounded as `attitude.rotate` does."""
    w, x, y, z = quaternion[0], -quaternion[1], -quaternion[2], -quaternion[3]
    a, b, c = vector
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * p + (y * r - z * q), b + w * q + (z * p - x * r), c + w * r + (x * q - y * p)


@compiled
def follow_tilt(share: float, quaternion: Floats, change: Floats, last: Floats, error: Floats) -> None:
    """Error of measured pitch and roll at an instant, but for random errors, from that of the instant before.

    So compiled code goes on from instant to instant as `measured_attitude` does over a finished mission.

    Args:
        share: `gain` of the filter.
        quaternion: attitude at the instant, shape (4,).
        change: of the velocity since the instant before, shape (3,), [m/s].
        last: error at the instant before, shape (2,), [rad].
        error: out: at this one, shape (2,), [rad].
    """
    force = change[0] / CONTROL_STEP_S, change[1] / CONTROL_STEP_S, change[2] / CONTROL_STEP_S + GRAVITY
    forward, port, up = _turned(quaternion, force)
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    pitch = signed_angle(np.arctan2(forward, np.hypot(port, up)) - attitude.pitch_of(w, x, y, z))
    roll = signed_angle(np.arctan2(port, up) - attitude.roll_of(w, x, y, z))
    error[0] = last[0] + share * (pitch - last[0])
    error[1] = last[1] + share * (roll - last[1])


def measured_attitude(trajectory: Trajectory, sensors: Ahrs, vehicle: int = 0) -> Floats:
    """Pitch and roll as the leader measures them, but for random errors, shape (n, 2), [rad].

    The filter starts without error.
    """
    true = np.column_stack([trajectory.pitch[:, vehicle], trajectory.roll[:, vehicle]])
    if not sensors.leader_attitude_feels_acceleration:
        return true
    error = signed_angle(apparent_tilt(trajectory, vehicle) - true)
    return true + _low_pass(error, gain(sensors))

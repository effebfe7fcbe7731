"""How the leader measures its pitch and roll: an inclinometer, alone or steadied by gyros (AHRS).

An inclinometer takes the specific force a − g for the vertical, so that a hull that accelerates, as in waves, reads
wrong by up to a / g. A complementary filter follows the gyros at once and the inclinometer slowly (Mahony, Hamel &
Pflimlin, IEEE Transactions on Automatic Control 53, 2008). Its error e is linear in the inclinometer's error i and in
the angle w by which the gyros walk off in a step:

    e_k = (1 − γ)(e_{k−1} + w_k) + γ i_k,    γ = 1 − exp(−Δt / τ).

Accelerations are the same in every run, and go through the filter here. The random part is a first-order Gauss–Markov
process of correlation time τ, of which `sim.sensing.observation` and `.instant` take the values that are broadcast:

    x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ),

exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974).
"""

import math
from functools import partial
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, elementwise, formula
from laisn.geometry import signed_angle
from sim.geometry.attitude import pitch_of, roll_of, rotated
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


def gain(sensors: Sensors) -> float:
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


@elementwise
def _shown(quaternion: Any, change: Any) -> Any:
    """Pitch and roll that specific force seems to show, from attitude and change of velocity in a control step."""
    force = change[0] / CONTROL_STEP_S, change[1] / CONTROL_STEP_S, change[2] / CONTROL_STEP_S + GRAVITY
    to_body = quaternion[0], -quaternion[1], -quaternion[2], -quaternion[3]
    forward, port, up = rotated(to_body, force)
    return np.arctan2(forward, np.hypot(port, up)), np.arctan2(port, up)


@formula
def _filtered(last: float, error: float, share: float) -> float:
    """e_k = (1 − γ) e_{k−1} + γ i_k."""
    return last + share * (error - last)


def apparent_tilt(trajectory: Trajectory) -> Floats:
    """Pitch and roll that specific force seems to show at the leader's origin, shape (n, 2), [rad].

    Accelerations are means over the interval that ends at an instant, as the sensor has them then; the first instant
    has those of the second.
    """
    change = np.diff(trajectory.velocity[:, 0], axis=0)
    change = np.concatenate([change[:1], change])
    return np.column_stack(_shown(trajectory.quaternion[:, 0].T, change.T))


def tilt_errors(trajectory: Trajectory, sensors: Sensors) -> Floats:
    """What accelerations add to the leader's measured pitch and roll, shape (n, 2), [rad].

    The filter starts without error.
    """
    true = np.column_stack([trajectory.pitch[:, 0], trajectory.roll[:, 0]])
    if not sensors.leader_attitude_senses_acceleration:
        return np.zeros_like(true)
    step = partial(_filtered, share=gain(sensors))
    errors = signed_angle(apparent_tilt(trajectory) - true).T
    return np.array([list(accumulate([0.0, *column], step))[1:] for column in errors.tolist()]).T


@compiled
def follow_tilt(share: float, quaternion: Floats, change: Floats, last: Floats, error: Floats) -> None:
    """One step of `tilt_errors` in compiled code: from the errors at the instant before to those at an instant.

    Args:
        share: `gain` of the filter.
        quaternion: attitude at the instant, shape (4,).
        change: of the velocity since the instant before, shape (3,), [m/s].
        last: error at the instant before, shape (2,), [rad].
        error: out: at this one, shape (2,), [rad].
    """
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    pitch, roll = _shown((w, x, y, z), (change[0], change[1], change[2]))
    error[0] = _filtered(last[0], signed_angle(pitch - pitch_of(w, x, y, z)), share)
    error[1] = _filtered(last[1], signed_angle(roll - roll_of(w, x, y, z)), share)


def weights(step: Ints, dt: float, time: float) -> Floats:
    """Weights of the last value of a Gauss–Markov process and of the fresh normal, a_i and √(1 − a_i²), shape (m, 2).

    The first value is all fresh: the process has run for long.

    Args:
        step: at which the process is read, shape (m,), increasing.
        dt: length of a step [s].
        time: correlation time τ [s]; 0 for independent values.
    """
    kept = np.zeros(step.size)
    if time > 0.0:
        # not `np.exp`, which rounds otherwise for arrays than for numbers
        kept[1:] = [math.exp(-steps * (dt / time)) for steps in np.diff(step).tolist()]
    return np.column_stack([kept, np.sqrt(1.0 - kept**2)])


@formula
def advanced(last: Any, kept: float, fresh: float, normal: Any) -> Any:
    """Next value of the process."""
    return kept * last + fresh * normal


def gauss_markov(normals: Floats, step: Ints, dt: float, time: float) -> Floats:
    """Values of processes, one for each column of normals, shape (m, …); other arguments as of `weights`."""
    values, last = np.empty_like(normals), np.zeros(normals.shape[1:])
    for i, (kept, fresh) in enumerate(weights(step, dt, time).tolist()):
        last = values[i] = advanced(last, kept, fresh, normals[i])
    return values

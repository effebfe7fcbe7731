"""Errors that change slowly: sinusoidal drift of biases, drift of the leader's position, Gauss–Markov processes.

The biases of log and compass swing as sines about their means, those of each follower at another phase; the leader's
inertial navigation drifts at a constant rate. Both are functions of time alone. A first-order Gauss–Markov process of
unit variance is random,

    x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ),

exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import elementwise, formula
from sim.scenario.sensors import OwnSensors, Sensors

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""The next follower's swings are ahead by this angle, which spreads any number of phases evenly [rad]."""


class BiasDrift(NamedTuple):
    """Sinusoidal drift of the biases of one follower's log and compass."""

    speed: float
    """Amplitude of the log's bias about its mean [m/s]."""
    heading: float
    """Amplitude of the compass's bias about its mean [rad]."""
    rate: float
    """Angular rate of both sines [rad/s]."""
    speed_phase: float
    """Phase of the log's sine at the start [rad]."""
    heading_phase: float
    """Phase of the compass's sine at the start [rad]."""

    @classmethod
    def of(cls, sensors: OwnSensors, follower: int) -> "BiasDrift":
        """The drift of a follower, by its index, with the sensors of `Scenario.sensors_of`."""
        return cls(
            speed=sensors.speed_drift_m_s,
            heading=float(np.deg2rad(sensors.heading_drift_deg)),
            rate=2.0 * np.pi / sensors.drift_period_s,
            speed_phase=float(np.deg2rad(sensors.speed_drift_phase_deg)) + follower * _GOLDEN,
            heading_phase=float(np.deg2rad(sensors.heading_drift_phase_deg)) + follower * _GOLDEN,
        )


def position_drift(sensors: Sensors) -> tuple[float, float]:
    """Rate at which the position that the leader broadcasts departs from the true one, east and north [m/s]."""
    towards, speed = np.deg2rad(sensors.leader_position_drift_deg), sensors.leader_position_drift_m_s
    return float(speed * np.sin(towards)), float(speed * np.cos(towards))


@elementwise
def biased(w: BiasDrift, time: Any, speed: Any, heading: Any) -> Any:
    """Speed [m/s] and heading [rad] with the drift at a time [s]; `w`: also a record with these fields."""
    if w.speed == 0.0 and w.heading == 0.0:
        return speed, heading
    turned = w.rate * time
    return speed + w.speed * np.sin(turned + w.speed_phase), heading + w.heading * np.sin(turned + w.heading_phase)


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

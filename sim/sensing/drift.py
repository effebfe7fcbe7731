"""Errors that change slowly: sinusoidal drift of biases, drift of the leader's position, Gauss–Markov processes.

The biases of log and compass swing as sines about their means, those of each follower at another phase; the leader's
inertial navigation drifts at a constant rate. Both are functions of time alone. A first-order Gauss–Markov process of
unit variance is random,

    x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ),

exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974).
"""

import math
from typing import Any

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import elementwise, formula

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""The next follower's swings are ahead by this angle, which spreads any number of phases evenly [rad]."""


@elementwise
def biased(e: Any, follower: int, time: Any, speed: Any, heading: Any) -> Any:
    """Speed [m/s] and heading [rad] with the drift of a follower's log and compass at a time [s].

    Args:
        e: record or tuple of `sim.sensing.errors`; the drift's keys are read.
        follower: its index.
        time: [s].
        speed: true [m/s].
        heading: true [rad].
    """
    if e.speed_drift == 0.0 and e.heading_drift == 0.0:
        return speed, heading
    turned, ahead = 2.0 * np.pi / e.drift_period * time, follower * _GOLDEN
    return (
        speed + e.speed_drift * np.sin(turned + (e.speed_drift_phase + ahead)),
        heading + e.heading_drift * np.sin(turned + (e.heading_drift_phase + ahead)),
    )


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

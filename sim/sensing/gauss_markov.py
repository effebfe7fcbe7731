"""Errors that die away slowly instead of being drawn anew: the first-order Gauss–Markov process of unit variance.

x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ),

exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974).
"""

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import inlined
from laisn.elementary import fma


def weights(step: Ints, dt: float, time: float) -> Floats:
    """Weights of the last value and of the fresh normal, a_i and √(1 − a_i²), shape (m, 2).

    The first value is all fresh: the process has run for long.

    Args:
        step: at which the process is read, shape (m,), increasing.
        dt: length of a step [s].
        time: correlation time τ [s]; 0 for values that know nothing of each other.
    """
    kept = np.zeros(step.size)
    if time > 0.0:
        kept[1:] = np.exp(-np.diff(step) * (dt / time))
    return np.column_stack([kept, np.sqrt(1.0 - kept**2)])


@inlined
def advanced(last: float, kept: float, fresh: float, normal: float) -> float:
    """Next value of the process. Compiled code only."""
    return fma(kept, last, fresh * normal)

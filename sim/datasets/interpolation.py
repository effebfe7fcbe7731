"""Values of a sensor at times between its readings."""

import numpy as np

from laisn.arrays import Floats, Ints

_BRIDGED_INTERVALS = 5.0  # gaps up to so many intervals between readings are interpolated
_BRIDGED_S = 1.0  # and all gaps up to this long [s]


def interpolated(time_ns: Ints, values: Floats, at_ns: Ints, *, is_angle: bool) -> Floats:
    """Values at other times, by readings at times that do not fall, NaN for none; angles the short
    way, in rad. NaN outside of the readings and within gaps.
    """
    finite = np.isfinite(values)
    times = time_ns[finite]
    values = values[finite]
    if not times.size:
        return np.full(at_ns.size, np.nan)
    after = np.searchsorted(times, at_ns)
    before = np.clip(np.searchsorted(times, at_ns, side="right") - 1, 0, times.size - 1)
    is_covered = (after < times.size) & (at_ns >= times[0])
    after = np.minimum(after, times.size - 1)
    span = times[after] - times[before]
    interval = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    longest_ns = max(_BRIDGED_INTERVALS * interval, 1e9 * _BRIDGED_S)
    share = np.divide(at_ns - times[before], span, out=np.zeros(at_ns.size), where=span > 0)
    change = values[after] - values[before]
    if is_angle:
        change = np.remainder(change + np.pi, 2.0 * np.pi) - np.pi
    # between two readings alone: at a reading its value counts to the bit
    result = np.where(share > 0.0, values[before] + share * change, values[before])
    if is_angle:
        result = np.where(share > 0.0, np.remainder(result, 2.0 * np.pi), result)
    return np.where(is_covered & (span <= longest_ns), result, np.nan)

"""Rules for a mission planner: how deep a follower may swim below its leader for a given pitch and error."""

import numpy as np

from experiments.asymmetry.map import closed_form_error
from laisn.arrays import Floats

PITCH_DEG = (1.0, 2.0, 5.0, 10.0, 15.0)
OFF_AXIS_DEG = (90.0, 60.0, 45.0, 30.0, 20.0)
"""Angle between the leader's axis and the direction to the follower: 90 abeam, the same ahead and astern."""
_DEEPEST_M = 50.0


def worst_error(pitch: float, depth_offset: float, off_axis: float, greatest_range: float) -> float:
    """Largest error of a noiseless LAISN-2 fix, nose up or down, ahead or astern, from 5 m to a range, [m].

    Infinite where the circles do not meet, so that the follower is put on the leader's axis. Angles in [rad].
    """
    reach = np.geomspace(5.0, greatest_range, 40)
    cases = [
        closed_form_error(sign * pitch, depth_offset, reach, bearing)
        for sign in (1.0, -1.0)
        for bearing in (off_axis, np.pi - off_axis)
    ]
    return float(np.nan_to_num(np.stack(cases), nan=np.inf).max())


def deepest_offset(pitch: float, off_axis: float, greatest_range: float, bound: float) -> float:
    """Largest depth offset that keeps the error under a bound, [m]; NaN if none does. Angles in [rad]."""
    if worst_error(pitch, 0.0, off_axis, greatest_range) > bound:
        return float("nan")
    low, high = 0.0, _DEEPEST_M
    if worst_error(pitch, high, off_axis, greatest_range) <= bound:
        return high
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if worst_error(pitch, middle, off_axis, greatest_range) <= bound else (low, middle)
    return low


def rules(greatest_range: float, bound: float) -> Floats:
    """Deepest offsets for `PITCH_DEG` (rows) and `OFF_AXIS_DEG` (columns), [m]; NaN where no offset will do."""
    return np.array(
        [[deepest_offset(np.deg2rad(p), np.deg2rad(b), greatest_range, bound) for b in OFF_AXIS_DEG] for p in PITCH_DEG]
    )

"""Times in order of recording: steps back of a clock, apart from late messages."""

import numpy as np

from laisn.arrays import Ints

_MIN_LATE_DISTANCE = 2.0 / 3.0  # least distance of a late time from others [intervals]
_MAX_LATE_LEAD = 10.0  # how much earlier than all others a late time may be [intervals]


def _late(times: Ints, first: int, interval: float) -> int:
    """How many times from `first` on are those of late messages, which fill a gap that was left
    before; 0 if the clock stepped back, so that times that were recorded come again.
    """
    before = np.sort(times[:first])
    is_earlier = times[first:] < before[-1]
    number = int(np.argmin(is_earlier)) if not is_earlier.all() else is_earlier.size
    late_times = times[first : first + number]
    indices = np.searchsorted(before, late_times)
    distance = np.minimum(
        np.abs(late_times - before[np.maximum(indices - 1, 0)]),
        np.abs(before[np.minimum(indices, before.size - 1)] - late_times),
    )
    # times recorded again lie within half an interval of those before, or before the recording
    are_recorded = np.any(distance < _MIN_LATE_DISTANCE * interval)
    return 0 if are_recorded or late_times.min() < before[0] - _MAX_LATE_LEAD * interval else number


def steps_back(times: Ints, interval: float) -> list[int]:
    """Positions of the first times after each step back of the clock, of times a usual interval
    apart, both [ns]; late ones are none.
    """
    steps = list[int]()
    begin = 0
    skip = 0
    for position in (np.flatnonzero(np.diff(times) < 0) + 1).tolist():
        if position < skip:
            continue
        late_count = _late(times[begin:], position - begin, interval)
        if late_count:
            skip = position + late_count
        else:
            steps.append(position)
            begin = position
    return steps

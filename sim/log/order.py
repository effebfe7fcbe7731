"""Times in order of recording: steps back of a clock, apart from late and repeated messages."""

import numpy as np

from laisn.arrays import Bools, Floats, Ints

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


def repeats(times: Ints, values: Floats) -> Bools:
    """Which rows, in order of recording, repeat earlier ones wholly, as where two recordings
    overlap, shape (n,); `times` [ns] and `values`, shape (n, c), in which NaN equals NaN.

    Rows that step back to a time that an earlier row has with other values are those of a clock
    that was set back: none from there to the next new time counts as repeated, however alike.
    """
    is_repeated = np.zeros(times.size, dtype=np.bool_)
    if np.all(np.diff(times) > 0):
        return is_repeated
    # adding 0 makes −0 and 0 equal
    contents = np.where(np.isnan(values), np.nan, values + 0.0)
    known: dict[int, set[bytes]] = {}
    latest = int(times[0])
    run = list[int]()  # repeated rows since the last new time
    in_conflict = False
    for row, time in enumerate(times.tolist()):
        content = contents[row].tobytes()
        earlier = known.setdefault(time, set())
        if content in earlier:
            run.append(row)
        elif time >= latest:
            is_repeated[run if not in_conflict else []] = True
            run = []
            in_conflict = False
        else:
            in_conflict = in_conflict or bool(earlier)
        earlier.add(content)
        latest = max(latest, time)
    is_repeated[run if not in_conflict else []] = True
    return is_repeated

"""The clock of a recorder: rows of a table and messages of a log stand in order of recording, and
their times may step, have gaps, or be those of writing.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.errors import LaisnError
from laisn.messages import Ranges
from sim.log.order import steps_back

TIMESTAMP = "leader_timestamp"
_SOUND_M_S = 1500.0  # typical speed of sound
_MAX_STEPS = 20  # more steps back are no corrections of a clock
_MAX_NAMED_GAPS = 5  # most gaps that are named
_MIN_GAP_INTERVALS = 10.0  # shortest gap that is named [intervals between rows]
_MIN_GAP_S = 1.0
# largest turn of a leader whose way tells the time that passed
_MAX_STRAIGHT_TURN = math.radians(20.0)
_MIN_SPEED_M_S = 0.2
_MAX_DELAY_S = 60.0
"""A message that is older belongs to another clock [s]."""
_MIN_DELAY_S = 0.1


@dataclass
class RecordedRows:
    """Rows of a table, or messages of a log, in order of recording; functions correct their times
    and remark on it.
    """

    source: str  # file, for errors
    name: str  # of the time
    time: Ints  # shape (n,), [ns]
    columns: dict[str, Floats]  # by field, in SI units, shape (n,)
    has_motion: Bools  # rows with own measurements, shape (n,)
    received: Bools  # rows with a range, shape (n,)
    remarks: list[str]
    item: str = "row"  # or message, for remarks
    stepped: bool = False  # whether the clock stepped
    # of each row in the file, counted from 1, shape (n,); None: all rows of it are here
    numbers: Ints | None = None

    def number(self, row: int) -> int:
        """The number of a row in the file, counted from 1."""
        return row + 1 if self.numbers is None else int(self.numbers[row])

    @property
    def rows(self) -> Ints:
        """Rows with own measurements, or all where none has."""
        return (
            np.flatnonzero(self.has_motion) if self.has_motion.any() else np.arange(self.time.size)
        )

    @property
    def interval_ns(self) -> int:
        """Median interval between rows [ns]."""
        spans = np.diff(self.time[self.rows])
        rising = spans[spans > 0]
        return int(np.median(rising)) if rising.size else 0

    @property
    def timestamp(self) -> Floats:
        """The leader's clock in each row with a range, NaN elsewhere, shape (n,), [s]."""
        clock = self.columns.get(TIMESTAMP)
        return (
            np.full(self.time.size, np.nan)
            if clock is None
            else np.where(self.received, clock, np.nan)
        )


@dataclass(frozen=True)
class _Crossing:
    """The last message before a step and the first one after it."""

    before: int  # row
    after: int
    clock_s: float  # time that passed on the leader's clock between them; NaN without it
    # time that the leader took from one position to the other at its speed; NaN if it turned or was
    # slow
    way_s: float


def _crossing(recording: RecordedRows, row: int) -> _Crossing | None:
    """Messages beside the step before a row; None without."""
    messages = np.flatnonzero(recording.received)
    index = int(np.searchsorted(messages, row))
    if index in (0, messages.size):
        return None
    pair = messages[index - 1 : index + 1]
    east, north, speed, heading = (
        recording.columns[f"leader_{name}"][pair] for name in ("east", "north", "speed", "heading")
    )
    turn = abs(math.remainder(float(heading[1] - heading[0]), 2.0 * math.pi))
    mean_speed = float(np.mean(np.abs(speed)))
    way_s = math.nan
    if mean_speed > _MIN_SPEED_M_S and turn < _MAX_STRAIGHT_TURN:
        way_s = math.hypot(*np.diff([east, north], axis=1)[:, 0]) / mean_speed
    clock = recording.timestamp[pair]
    return _Crossing(int(pair[0]), int(pair[1]), float(clock[1] - clock[0]), way_s)


def _passed_ns(recording: RecordedRows, row: int, last: int) -> tuple[int, bool]:
    """Time that passed from the row `last` to `row`, across a step back [ns], and whether the
    leader's clock stepped too.
    """
    interval = recording.interval_ns
    crossing = _crossing(recording, row)
    if crossing is None or not math.isfinite(crossing.clock_s):
        return interval, False
    time = recording.time
    outside_step_ns = int(time[last] - time[crossing.before] + time[crossing.after] - time[row])
    passed_ns = round(1e9 * crossing.clock_s) - outside_step_ns
    if passed_ns <= 0:
        return interval, True
    return (passed_ns if abs(passed_ns - interval) > interval else interval), False


def _shift(recording: RecordedRows, row: int, shift_ns: int, leader_too: bool) -> None:
    recording.time[row:] += shift_ns
    if leader_too and TIMESTAMP in recording.columns:
        recording.columns[TIMESTAMP][row:] += shift_ns / 1e9
    recording.stepped = True


def correct_steps_back(recording: RecordedRows) -> None:
    """Shift rows after each step back of the clock, so that the time that passed lies between
    them; LaisnError if there are too many.
    """
    rows = recording.rows
    interval = recording.interval_ns
    steps = steps_back(recording.time[rows], interval)
    if len(steps) > _MAX_STEPS:
        raise LaisnError(
            f"{recording.source}: {recording.name}: the time steps back {len(steps)} times, first "
            f"after {recording.item} {recording.number(rows[steps[0] - 1])}; "
            f"{recording.item}s are expected in order of recording"
        )
    for position in steps:
        row = int(rows[position])
        last = int(rows[position - 1])
        before_ns = int(recording.time[last])
        after_ns = int(recording.time[row])
        passed_ns, leader_too = _passed_ns(recording, row, last)
        shift_ns = before_ns + passed_ns - after_ns
        _shift(recording, row, shift_ns, leader_too)
        clocks = "and the leader's clock step" if leader_too else "steps"
        origin = int(recording.time[0])
        recording.remarks.append(
            f"{recording.name} {clocks} back by {shift_ns / 1e9:.6g} s after {recording.item} "
            f"{recording.number(last)}, {(before_ns - origin) / 1e9:.6g} s after the first; later "
            f"{recording.item}s are shifted by as much, so that {passed_ns / 1e9:g} s lie between"
        )
    _require_receptions_in_order(recording)
    backward_count = int(np.count_nonzero(np.diff(recording.time[rows]) < 0))
    if backward_count:
        recording.remarks.append(
            f"{recording.name}: {recording.item}s out of order in {backward_count} "
            f"place{'s' if backward_count > 1 else ''}, sorted"
        )


def _require_receptions_in_order(recording: RecordedRows) -> None:
    """LaisnError if rows that hold receptions alone step back among themselves."""
    rows = np.flatnonzero(recording.received & ~recording.has_motion)
    steps = steps_back(recording.time[rows], 2 * recording.interval_ns)
    if steps:
        raise LaisnError(
            f"{recording.source}: {recording.name}: the time of receptions steps back after "
            f"{recording.item} {recording.number(rows[steps[0] - 1])}, and that of own "
            f"measurements does not; {recording.item}s are expected in order of recording"
        )


def _steps_forward(recording: RecordedRows, row: int, last: int) -> tuple[int, bool] | None:
    """Time that passed across a gap, where it is shorter than the gap [ns], and whether the
    leader's clock stepped too; None for a gap.
    """
    crossing = _crossing(recording, row)
    if crossing is None:
        return None
    time = recording.time
    row_gap_ns = int(time[row] - time[last])
    message_gap_ns = int(time[crossing.after] - time[crossing.before])
    clock_s = crossing.clock_s
    if math.isfinite(clock_s) and 0.0 < clock_s < 0.5e-9 * message_gap_ns:
        passed_ns = round(1e9 * clock_s) - (message_gap_ns - row_gap_ns)
        return max(passed_ns, recording.interval_ns), False
    if crossing.way_s < 0.5e-9 * message_gap_ns:
        passed_ns = round(1e9 * crossing.way_s) - (message_gap_ns - row_gap_ns)
        return max(passed_ns, recording.interval_ns), math.isfinite(clock_s)
    return None


def correct_steps_forward(recording: RecordedRows) -> None:
    """Shift rows after steps forward that the leader's clock or way contradicts, and remark on
    gaps.
    """
    rows = recording.rows
    interval = recording.interval_ns
    spans = np.diff(recording.time[rows])
    longest = max(_MIN_GAP_INTERVALS * interval, 1e9 * _MIN_GAP_S)
    gaps = list[str]()
    for position in np.flatnonzero(spans > longest).tolist():
        row = int(rows[position + 1])
        last = int(rows[position])
        gap_ns = int(recording.time[row] - recording.time[last])
        step = _steps_forward(recording, row, last)
        if step is None:
            gaps.append(f"{gap_ns / 1e9:.6g} s after row {recording.number(last)}")
            continue
        passed_ns, leader_too = step
        _shift(recording, row, passed_ns - gap_ns, leader_too)
        by = "way" if leader_too else "clock"
        recording.remarks.append(
            f"{recording.name} steps forward by {(gap_ns - passed_ns) / 1e9:.6g} s after row "
            f"{recording.number(last)} by the leader's {by}; later rows are shifted back"
        )
    if gaps:
        named = ", ".join(gaps[:_MAX_NAMED_GAPS])
        if len(gaps) > _MAX_NAMED_GAPS:
            named += f" and {len(gaps) - _MAX_NAMED_GAPS} others"
        recording.remarks.append(f"{recording.name}: gaps without own measurements: {named}")


def _mean_range(columns: Mapping[str, Floats]) -> Floats:
    """Mean of the ranges of each row, shape (n,), [m]; NaN without any."""
    names = [f"range_{name}" for name in Ranges._fields if f"range_{name}" in columns]
    table = np.array([columns[name] for name in names])
    counts = np.isfinite(table).sum(axis=0)
    return np.where(counts > 0, np.nansum(table, axis=0) / np.maximum(counts, 1), np.nan)


def reception_times(recording: RecordedRows) -> Ints:
    """When each row's message was received, shape (n,), [ns].

    A message that is older in its row than sound needs is received when it was sent and sound had
    travelled its range, by the leader's clock. Where that is another clock, times are those of
    the rows. Remarks tell which.
    """
    time_s = recording.time / 1e9
    travel = _mean_range(recording.columns) / _SOUND_M_S
    arrival = recording.timestamp + travel
    delay = time_s - arrival
    valid = np.isfinite(delay)
    if not valid.any():
        return recording.time.copy()
    tolerance = max(_MIN_DELAY_S, 1.5 * recording.interval_ns / 1e9)
    typical = float(np.median(delay[valid]))
    other_clock = typical < -tolerance or typical > _MAX_DELAY_S
    is_late = valid & (delay > tolerance) & (delay <= _MAX_DELAY_S)
    if other_clock or (recording.stepped and typical > tolerance):
        recording.remarks.append(
            f"{TIMESTAMP} differs from {recording.name} by {typical:.6g} s: another clock; "
            "receptions have the times of their rows"
        )
        return recording.time.copy()
    if not is_late.any():
        if typical > _MIN_DELAY_S:
            recording.remarks.append(
                f"receptions are older than sound needs by {typical:.3g} s (median), less than "
                f"rows lie apart: they have the times of their rows"
            )
        return recording.time.copy()
    recording.remarks.append(
        f"{int(is_late.sum())} of {int(valid.sum())} receptions are older than sound needs, by "
        f"{float(np.median(delay[is_late])):.3g} s (median): they are taken at {TIMESTAMP} and the "
        f"travel time; where pings have slots, set acoustics.ping_slot_s of the scenario of the "
        f"replay; without the column {TIMESTAMP} they have the times of their rows"
    )
    return np.where(is_late, np.rint(np.where(is_late, arrival, 0.0) * 1e9), recording.time).astype(
        np.int64
    )

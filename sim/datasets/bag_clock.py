"""Clocks of a bag that step: of the recorder, by the order in which it wrote messages, and of a
sensor, by the recorder's.
"""

import re
import sqlite3
from collections import defaultdict, deque
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.reader import make_reader

from laisn.arrays import Ints
from sim.log.order import steps_back

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader

_MAX_STEPS = 20  # more are no corrections of a clock
_COMPARED_MESSAGES = 20  # messages on each side of a step that are compared
_MIN_MESSAGES = 3  # fewest of them on each side
_MIN_GAP_INTERVALS = 10.0  # shortest gap between stamps that may be a step forward [intervals]
_MIN_GAP_NS = 10**9  # and in time [ns]
_MESSAGES = (
    "SELECT topics.name, messages.timestamp FROM messages "
    "JOIN topics ON topics.id = messages.topic_id ORDER BY messages.id"
)


class WrittenMessage(NamedTuple):
    """A message as it was recorded."""

    topic: str
    time_ns: int  # of recording


def _interval(times: Ints) -> int:
    """Median interval between times [ns]."""
    spans = np.diff(times)
    rising = spans[spans > 0]
    return int(np.median(rising)) if rising.size else 0


def _file_order(path: Path) -> tuple[int, str]:
    """Key that orders the files of a bag: bag_2.db3 comes before bag_10.db3."""
    digits = re.search(r"(\d+)$", path.stem)
    return int(digits[1]) if digits else 0, path.name


def _messages_of_mcap(path: Path, topics: Collection[str]) -> Iterator[WrittenMessage]:
    with path.open("rb") as stream:
        reader = make_reader(stream)
        for _, channel, message in reader.iter_messages(topics, log_time_order=False):
            yield WrittenMessage(channel.topic, message.log_time)


def _messages_of_database(path: Path, topics: Collection[str]) -> Iterator[WrittenMessage]:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?immutable=1", uri=True)
    try:
        for topic, time_ns in connection.execute(_MESSAGES):
            if topic in topics:
                yield WrittenMessage(topic, time_ns)
    finally:
        connection.close()


def _messages_of_ros1(reader: "Reader", topics: Collection[str]) -> Iterator[WrittenMessage]:
    entries = [
        ((entry.chunk_pos, entry.offset), WrittenMessage(connection.topic, entry.time))
        for connection in reader.connections
        if connection.topic in topics
        for entry in reader.indexes[connection.id]
    ]
    for _, written in sorted(entries):
        yield written


def written_order(path: Path, readers: Any, topics: Collection[str]) -> list[WrittenMessage]:
    """Messages of topics in the order in which they were written, which readers of rosbags give
    sorted by time; none where that cannot be told, as of compressed files.
    """
    if path.suffix == ".bag":
        return [messages for reader in readers for messages in _messages_of_ros1(reader, topics)]
    messages = list[WrittenMessage]()
    for suffix, read in ((".mcap", _messages_of_mcap), (".db3", _messages_of_database)):
        files = [path] if path.is_file() else sorted(path.glob(f"*{suffix}"), key=_file_order)
        for file in files:
            if file.suffix == suffix:
                messages += read(file, topics)
    return messages


class _Place(NamedTuple):
    """Where a message stands, and when it was recorded by a clock that does not step."""

    position: int
    time_ns: int


class RecorderClock:
    """Times of recording without the steps back of the recorder's clock.

    Attributes:
        remarks: what was corrected.
    """

    def __init__(self, order: list[WrittenMessage]) -> None:
        self.remarks: list[str] = []
        self._places = defaultdict[WrittenMessage, deque[_Place]](deque)
        self._count = 0  # messages so far whose places are not in `_places`
        if order:
            self._correct(order)

    def _correct(self, order: list[WrittenMessage]) -> None:
        positions_by_topic = defaultdict[str, list[int]](list)
        for position, message in enumerate(order):
            positions_by_topic[message.topic].append(position)
        # the topic with the most messages tells best when a step was
        reference_topic = max(positions_by_topic, key=lambda topic: len(positions_by_topic[topic]))
        positions = np.array(positions_by_topic[reference_topic])
        times = np.array([message.time_ns for message in order], dtype=np.int64)
        interval = _interval(times[positions])
        steps = steps_back(times[positions], interval)
        if not steps:
            return
        if len(steps) > _MAX_STEPS:
            self.remarks.append(
                f"times of recording step back {len(steps)} times in the order of the file, and "
                "are sorted"
            )
            return
        shifted = times.copy()
        for step in steps:
            before, after = positions[step - 1 : step + 1].tolist()
            shift = int(shifted[before]) + interval - int(shifted[after])
            skipped = np.arange(before + 1, after)
            # messages of other topics in between are of the clock before or after the step: of that
            # to whose time theirs is nearer
            distance = np.abs(times[skipped, None] - times[[before, after]])
            is_later = distance[:, 1] < distance[:, 0]
            shifted[skipped[is_later]] += shift
            shifted[after:] += shift
            self.remarks.append(
                f"the recorder's clock steps back by {shift / 1e9:.6g} s after message {step} of "
                f"{reference_topic}; later messages are shifted by as much"
            )
        for position, message in enumerate(order):
            self._places[message].append(_Place(position, int(shifted[position])))

    def place(self, topic: str, time_ns: int) -> _Place:
        """Place of the next message of a topic with a time of recording, as readers give them.

        Without corrections messages are counted as they come.
        """
        places = self._places.get(WrittenMessage(topic, time_ns))
        if places:
            return places.popleft()
        self._count += 1
        return _Place(self._count, time_ns)


def _stamp_offset(stamps: Ints, recorded: Ints) -> float:
    """Median of stamps less times of recording [ns]; NaN of few messages, or if these were not
    recorded as fast as they were stamped, as in a bag that was converted.
    """
    offset = stamps - recorded
    steady = stamps.size >= _MIN_MESSAGES and np.ptp(offset) <= 0.5 * np.ptp(stamps)
    return float(np.median(offset)) if steady else np.nan


class Stamps(NamedTuple):
    """Stamps without steps of their clock."""

    time_ns: Ints
    remarks: list[str]


def corrected_stamps(stamps: Ints, recorded: Ints) -> Stamps:
    """Stamps of a topic whose clock steps against that of the recorder: later ones are shifted, so
    that messages are recorded as long after their stamps as before. Both in order of recording,
    shapes (n,), [ns].
    """
    interval = _interval(stamps)
    gap = max(_MIN_GAP_INTERVALS * interval, _MIN_GAP_NS)
    forward = np.flatnonzero(np.diff(stamps) - np.diff(recorded) > gap) + 1
    step_indices = sorted({*steps_back(stamps, interval), *forward.tolist()})
    if len(step_indices) > _MAX_STEPS:
        return Stamps(stamps, [])
    corrected = stamps.copy()
    remarks = list[str]()
    ends = [*step_indices[1:], stamps.size][: len(step_indices)]
    begin = 0
    for index, end in zip(step_indices, ends, strict=True):
        preceding = slice(max(begin, index - _COMPARED_MESSAGES), index)
        following = slice(index, min(end, index + _COMPARED_MESSAGES))
        difference = _stamp_offset(corrected[preceding], recorded[preceding]) - _stamp_offset(
            corrected[following], recorded[following]
        )
        if not abs(difference) > interval:
            continue
        shift = round(difference)
        corrected[index:] += shift
        begin = index
        direction = "back" if shift > 0 else "forward"
        remarks.append(
            f"stamps step {direction} by {abs(shift) / 1e9:.6g} s after message {index}, by the "
            "times of recording; later ones are shifted by as much"
        )
    return Stamps(corrected, remarks)

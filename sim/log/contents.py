"""What is in a log: its attachments, metadata, and the messages of its channels."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.well_known import MessageEncoding
from mcap_protobuf.decoder import DecoderFactory

from laisn.arrays import Bytes, Floats, Ints
from sim.log import wire
from sim.log.batches import records
from sim.log.file import LogError, check, faults
from sim.log.records import KEPT_COST, Budget
from sim.log.spool import Spool

_MESSAGES, _BYTES = 1 << 16, 8 << 20
"""As many messages are decoded at a time, of so many bytes together if there is more than one."""


def _nothing() -> Ints:
    return np.empty(0, dtype=np.int64)


class Stretch(NamedTuple):
    """Some messages that follow each other."""

    data: Bytes
    """The bytes that they lie in."""
    start: Ints
    """Where each begins in them, shape (n,)."""
    stop: Ints
    """Where it ends."""


def _found(descriptor: Any, stretch: Stretch, name: str) -> tuple[Any, wire.Field]:
    """Descriptor and place of the field "name" or "name.of.a.nested.one"."""
    data, start, stop = stretch
    *parents, last = name.split(".")
    for parent in parents:
        outer = descriptor.fields_by_name[parent]
        start, stop = wire.find(data, start, stop, outer)
        descriptor = outer.message_type
    leaf = descriptor.fields_by_name[last]
    return leaf, wire.find(data, start, stop, leaf)


@dataclass
class Messages:
    """The messages of a topic in order of time: their bytes one behind the other."""

    schema: Schema | None
    encoding: str
    time_ns: Ints = field(default_factory=_nothing)
    """Log times since 1970, shape (n,), [ns]."""
    stop: Ints = field(default_factory=_nothing)
    """Where each ends in `data`, and the next one begins, shape (n,)."""
    data: Spool = field(default_factory=Spool)

    def is_like(self, other: "Messages") -> bool:
        """Whether messages of the other channel are understood in the same way."""
        mine, yours = (None if m.schema is None else (m.schema.name, m.schema.data) for m in (self, other))
        return (mine, self.encoding) == (yours, other.encoding)

    def before(self, time_ns: int) -> "Messages":
        """The messages before some time since 1970 [ns], of the same bytes."""
        n = int(np.searchsorted(self.time_ns, time_ns))
        return Messages(self.schema, self.encoding, self.time_ns[:n], self.stop[:n], self.data)

    def parts(self, most: int = _MESSAGES) -> Iterator[slice]:
        """All messages, some of them at a time: `most` at most, and not too many bytes."""
        first, count = 0, self.stop.size
        while first < count:
            begin = int(self.stop[first - 1]) if first else 0
            fit = int(np.searchsorted(self.stop, begin + _BYTES, side="right"))
            last = min(max(fit, first + 1), first + most, count)
            yield slice(first, last)
            first = last

    def stretch(self, part: slice) -> Stretch:
        """Some of the messages."""
        begin = int(self.stop[part.start - 1]) if part.start else 0
        stop = self.stop[part] - begin
        start = np.append(0, stop[:-1]) if stop.size else stop
        return Stretch(self.data.read(begin, begin + int(stop[-1]) if stop.size else begin), start, stop)

    def each(self) -> Iterator[bytes]:
        """The bytes of one message after the other."""
        for part in self.parts():
            data, starts, stops = self.stretch(part)
            for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
                yield data[start:stop].tobytes()

    @cached_property
    def descriptor(self) -> Any:
        """The protobuf descriptor of the messages, by the schema in the file.

        Raises ValueError if they are encoded in another way.
        """
        decode: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(self.encoding, self.schema)
        if decode is None:
            raise ValueError(f"messages are encoded as {self.encoding or 'nothing known'}, expected protobuf")
        return decode(b"").DESCRIPTOR

    def numbers_in(self, stretch: Stretch, name: str) -> npt.NDArray[Any]:
        """Numbers of some messages by the name of their field ("pose.position.x"), shape (n,), of a type that fits."""
        leaf, found = _found(self.descriptor, stretch, name)
        return wire.numbers(found, leaf)

    def texts_in(self, stretch: Stretch, name: str) -> list[str]:
        """Texts of some messages by the name of their field; its default where it is not there."""
        leaf, found = _found(self.descriptor, stretch, name)
        if leaf.type != leaf.TYPE_STRING:
            raise ValueError(f"field {name} holds no texts")
        places = zip(found.value.tolist(), found.end.tolist(), strict=True)
        return [stretch.data[a:b].tobytes().decode() if b else leaf.default_value for a, b in places]

    def numbers(self, name: str) -> npt.NDArray[Any]:
        """Numbers of all messages by the name of their field."""
        # of no messages too: their type is known
        parts = list(self.parts()) or [slice(0, 0)]
        return np.concatenate([self.numbers_in(self.stretch(part), name) for part in parts])

    def fill(self, table: Floats, names: Sequence[str]) -> None:
        """Put numbers, by the names of their fields, into the columns of a table, shape (n, len(names))."""
        for part in self.parts():
            stretch = self.stretch(part)
            for k, name in enumerate(names):
                table[part, k] = self.numbers_in(stretch, name)

    def columns(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, each column in one piece, not to be written, shape (n, len(names))."""
        result = np.empty((len(names), self.time_ns.size))
        self.fill(result.T, names)
        result.flags.writeable = False
        return result.T

    def rows(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, each row in one piece, not to be written, shape (n, len(names))."""
        result = np.empty((self.time_ns.size, len(names)))
        self.fill(result, names)
        result.flags.writeable = False
        return result


class _Gathered:
    """The messages of a topic as they come."""

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        # they grow in place: a list of arrays would lie beside what is made of it
        self._times, self._sizes = bytearray(), bytearray()

    def add(self, batch: wire.Batch, chosen: Ints) -> None:
        start, stop = batch.start[chosen], batch.stop[chosen]
        self._times += batch.log_time[chosen].data
        self._sizes += (stop - start).data
        self.messages.data.append(wire.gather(batch.data, start, stop).data)

    def _sort(self) -> None:
        """Bring the messages into the order of their log time; those of equal time stay as they came."""
        messages = self.messages
        order = np.argsort(messages.time_ns, kind="stable")
        start, stop = np.append(0, messages.stop[:-1])[order], messages.stop[order]
        data = Spool()
        sorted_ = Messages(None, "", messages.time_ns[order], np.cumsum(stop - start), data)
        for part in sorted_.parts():
            # times that are a little out of order mean bytes that lie nearly side by side
            begin, end = int(start[part].min()), int(stop[part].max())
            near = messages.data.read(begin, end)
            data.append(wire.gather(near, start[part] - begin, stop[part] - begin).data)
        messages.time_ns, messages.stop, messages.data = sorted_.time_ns, sorted_.stop, data

    def settle(self) -> Messages:
        """All of them, in order of their log time."""
        messages, stop = self.messages, np.frombuffer(self._sizes, dtype=np.int64)
        np.cumsum(stop, out=stop)
        messages.time_ns, messages.stop = np.frombuffer(self._times, dtype=np.int64), stop
        if np.any(messages.time_ns[1:] < messages.time_ns[:-1]):
            self._sort()
        return messages


@dataclass
class Contents:
    """What a log holds."""

    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    topics: dict[str, Messages] = field(default_factory=dict)

    def keep_before(self, time_ns: int) -> None:
        """Drop the messages from some time since 1970 on [ns]."""
        self.topics = {topic: messages.before(time_ns) for topic, messages in self.topics.items()}


Choice = Callable[[str, Messages], bool]
"""Whether a channel is wanted, by its topic and its messages before there are any."""


def collect(path: Path, records: Iterable[Any], budget: Budget, wanted: Choice) -> Contents:
    """What is in the records of a log; channels of the same topic are one, messages come in order of their log time.

    Raises:
        LogError: a channel has messages of several types.
        DamagedError: it unfolds to more than is believable.
    """
    result, schemas = Contents(), dict[int, Schema]()
    topics, ids = dict[str, _Gathered](), dict[int, _Gathered]()
    for record in records:
        if isinstance(record, wire.Batch):
            for number, chosen in record.by_channel():
                if number in ids:
                    budget.charge(KEPT_COST * chosen.size + int(np.sum(record.stop[chosen] - record.start[chosen])))
                    ids[number].add(record, chosen)
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channel = Messages(schemas.get(record.schema_id), record.message_encoding)
            if wanted(record.topic, channel):
                ids[record.id] = topics.setdefault(record.topic, _Gathered(channel))
                if not ids[record.id].messages.is_like(channel):
                    raise LogError(f"{path}: channel {record.topic} has messages of two types; it may have one")
        elif isinstance(record, Attachment):
            result.attachments[record.name] = record.data
        elif isinstance(record, Metadata):
            result.metadata[record.name] = record.metadata
    ids.clear()
    while topics:
        topic = next(iter(topics))
        # one after the other, so that what was gathered does not lie beside what came of it
        result.topics[topic] = topics.pop(topic).settle()
    return result


def contents(path: Path, wanted: Choice = lambda topic, messages: True) -> Contents:
    """Read a log after `check`; as `collect` orders it.

    Raises:
        LogError: it cannot be read, is damaged, unfolds to more than is believable, or is no MCAP file.
    """
    check(path)
    budget = Budget(path.stat().st_size)
    with faults(path), path.open("rb") as stream:
        return collect(path, records(stream, budget), budget, wanted)


def require(path: Path, log: Contents, topic: str, names: Sequence[str]) -> Messages:
    """The messages of a topic that has all the named fields.

    Raises:
        LogError: naming the topics or the fields that there are.
    """
    messages = log.topics.get(topic)
    if messages is None:
        raise LogError(f"{path}: lacks channel {topic}; available: {', '.join(sorted(log.topics)) or 'none'}")
    with faults(path):
        if messages.encoding != MessageEncoding.Protobuf:
            raise LogError(f"{path}: channel {topic} is encoded as {messages.encoding!r}, expected protobuf")
        missing = [name for name in names if not has_field(messages.descriptor, name)]
    if missing:
        known = ", ".join(f.name for f in messages.descriptor.fields)
        raise LogError(f"{path}: channel {topic} lacks {', '.join(missing)}; its fields: {known}")
    return messages


def has_field(descriptor: Any, name: str) -> bool:
    """Whether a protobuf type has the field "name" or "name.of.a.nested.one"."""
    for part in name.split("."):
        inner = descriptor.fields_by_name.get(part) if descriptor is not None else None
        if inner is None:
            return False
        descriptor = inner.message_type
    return True

"""What is in a log: its attachments, metadata, and the messages of its channels."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

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

_BLOCK = 1 << 16
"""Messages that are decoded at a time."""


def _nothing() -> Ints:
    return np.empty(0, dtype=np.int64)


def blocks(count: int, size: int = _BLOCK) -> Iterator[slice]:
    """Stretches of so many elements that cover them all."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


@dataclass
class Messages:
    """The messages of a topic in order of time: their bytes one behind the other."""

    schema: Schema | None
    encoding: str
    time_ns: Ints = field(default_factory=_nothing)
    """Log times since 1970, shape (n,), [ns]."""
    stop: Ints = field(default_factory=_nothing)
    """Where each ends in `data`, and the next one begins, shape (n,)."""
    data: Bytes = field(default_factory=lambda: np.frombuffer(b"", dtype=np.uint8))

    def is_like(self, other: "Messages") -> bool:
        """Whether messages of the other channel are understood in the same way."""
        mine, yours = (None if m.schema is None else (m.schema.name, m.schema.data) for m in (self, other))
        return (mine, self.encoding) == (yours, other.encoding)

    def before(self, time_ns: int) -> "Messages":
        """The messages before some time since 1970 [ns], of the same bytes."""
        n = int(np.searchsorted(self.time_ns, time_ns))
        return Messages(self.schema, self.encoding, self.time_ns[:n], self.stop[:n], self.data)

    def bounds(self, part: slice = slice(None)) -> tuple[Ints, Ints]:
        """Where messages begin and end in `data`."""
        first, stop = part.start or 0, self.stop[part]
        start = np.empty_like(stop)
        start[1:], start[:1] = stop[:-1], self.stop[first - 1] if first else 0
        return start, stop

    def each(self) -> Iterator[bytes]:
        """The bytes of one message after the other."""
        for start, stop in zip(*(x.tolist() for x in self.bounds()), strict=True):
            yield self.data[start:stop].tobytes()

    @cached_property
    def descriptor(self) -> Any:
        """The protobuf descriptor of the messages, by the schema in the file.

        Raises ValueError if they are encoded in another way.
        """
        decode: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(self.encoding, self.schema)
        if decode is None:
            raise ValueError(f"messages are encoded as {self.encoding or 'nothing known'}, expected protobuf")
        return decode(b"").DESCRIPTOR

    def _found(self, name: str, part: slice) -> tuple[Any, wire.Field]:
        """Descriptor and place of the field "name" or "name.of.a.nested.one"."""
        descriptor, (start, stop) = self.descriptor, self.bounds(part)
        *parents, last = name.split(".")
        for parent in parents:
            outer = descriptor.fields_by_name[parent]
            start, stop = wire.find(self.data, start, stop, outer)
            descriptor = outer.message_type
        leaf = descriptor.fields_by_name[last]
        return leaf, wire.find(self.data, start, stop, leaf)

    def numbers(self, name: str, part: slice = slice(None)) -> npt.NDArray[Any]:
        """Numbers by the name of their field ("pose.position.x"), shape (n,), of the type that holds them all."""
        leaf, found = self._found(name, part)
        return wire.numbers(found, leaf)

    def texts(self, name: str, part: slice = slice(None)) -> list[str]:
        """Texts by the name of their field; empty where it is not there."""
        leaf, found = self._found(name, part)
        if leaf.type != leaf.TYPE_STRING:
            raise ValueError(f"field {name} holds no texts")
        places = zip(found.value.tolist(), found.end.tolist(), strict=True)
        return [self.data[a:b].tobytes().decode() if b else leaf.default_value for a, b in places]

    def columns(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, each column in one piece, shape (n, len(names))."""
        result = np.empty((len(names), self.time_ns.size))
        for part in blocks(self.time_ns.size):
            for k, name in enumerate(names):
                result[k, part] = self.numbers(name, part)
        return result.T


class _Gathered:
    """The messages of a topic as they come."""

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        # they grow in place: a list of arrays would lie beside what is made of it
        self._times, self._sizes, self._data = bytearray(), bytearray(), bytearray()

    def add(self, batch: wire.Batch, chosen: Ints) -> None:
        start, stop = batch.start[chosen], batch.stop[chosen]
        self._times += batch.log_time[chosen].data
        self._sizes += (stop - start).data
        self._data += wire.gather(batch.data, start, stop).data

    def settle(self) -> Messages:
        """All of them, in order of their log time."""
        messages, stop = self.messages, np.frombuffer(self._sizes, dtype=np.int64)
        np.cumsum(stop, out=stop)
        messages.time_ns, messages.stop = np.frombuffer(self._times, dtype=np.int64), stop
        # not to be written: compiled code would otherwise come in two versions
        messages.data = np.frombuffer(memoryview(self._data).toreadonly(), dtype=np.uint8)
        if np.any(messages.time_ns[1:] < messages.time_ns[:-1]):
            order = np.argsort(messages.time_ns, kind="stable")
            first, last = (x[order] for x in messages.bounds())
            messages.time_ns, messages.stop = messages.time_ns[order], np.cumsum(last - first)
            messages.data = np.frombuffer(wire.gather(messages.data, first, last).tobytes(), dtype=np.uint8)
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

"""What is in a log: its attachments, metadata, and the messages of its channels."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.well_known import MessageEncoding
from mcap_protobuf.decoder import DecoderFactory

from laisn.arrays import Floats, Ints
from sim.log.file import LogError, check, faults, records
from sim.log.records import KEPT_COST, Budget


@dataclass
class Messages:
    """The messages of a topic in order of time."""

    schema: Schema | None
    encoding: str
    time_ns: list[int] = field(default_factory=list)
    """Log times since 1970 [ns]."""
    data: list[bytes] = field(default_factory=list)

    def is_like(self, other: "Messages") -> bool:
        """Whether messages of the other channel are understood in the same way."""
        mine, yours = (None if m.schema is None else (m.schema.name, m.schema.data) for m in (self, other))
        return (mine, self.encoding) == (yours, other.encoding)

    def decoded(self) -> Iterator[Any]:
        """Decode the messages as protobuf, by the schema in the file."""
        decode = self._decoder()
        return (decode(data) for data in self.data)

    def _decoder(self) -> Callable[[bytes], Any]:
        decode: Callable[[bytes], Any] | None = DecoderFactory().decoder_for(self.encoding, self.schema)
        if decode is None:
            raise ValueError(f"messages are encoded as {self.encoding or 'nothing known'}, expected protobuf")
        return decode

    def descriptor(self) -> Any:
        """The protobuf descriptor of the messages."""
        return self._decoder()(b"").DESCRIPTOR

    def columns(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields ("pose.position.x"), shape (n, len(names))."""
        fields = [attrgetter(name) for name in names]
        numbers = (get(message) for message in self.decoded() for get in fields)
        count = len(self.data) * len(names)
        return np.fromiter(numbers, dtype=np.float64, count=count).reshape(len(self.data), len(names))

    def integers(self, name: str) -> Ints:
        """An integer field, shape (n,)."""
        get = attrgetter(name)
        return np.array([get(message) for message in self.decoded()], dtype=np.int64)


@dataclass
class Contents:
    """What a log holds."""

    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    topics: dict[str, Messages] = field(default_factory=dict)

    def keep_before(self, time_ns: int) -> None:
        """Drop the messages from some time since 1970 on [ns]."""
        for messages in self.topics.values():
            n = bisect_left(messages.time_ns, time_ns)
            del messages.time_ns[n:], messages.data[n:]


def collect(path: Path, records: Iterable[Any], budget: Budget, wanted: Callable[[str], bool]) -> Contents:
    """What is in the records of a log; channels of the same topic are one, messages come in order of their log time.

    Raises:
        LogError: a channel has messages of several types.
        DamagedError: it unfolds to more than is believable.
    """
    result, schemas, ids = Contents(), dict[int, Schema](), dict[int, Messages]()
    for record in records:
        if isinstance(record, Message):
            messages = ids.get(record.channel_id)
            if messages is not None:
                budget.charge(KEPT_COST + len(record.data))
                messages.time_ns.append(record.log_time)
                messages.data.append(record.data)
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and wanted(record.topic):
            channel = Messages(schemas.get(record.schema_id), record.message_encoding)
            ids[record.id] = result.topics.setdefault(record.topic, channel)
            if not ids[record.id].is_like(channel):
                raise LogError(f"{path}: channel {record.topic} has messages of two types; it may have one")
        elif isinstance(record, Attachment):
            result.attachments[record.name] = record.data
        elif isinstance(record, Metadata):
            result.metadata[record.name] = record.metadata
    for messages in result.topics.values():
        order = np.argsort(messages.time_ns, kind="stable").tolist()
        messages.time_ns = [messages.time_ns[i] for i in order]
        messages.data = [messages.data[i] for i in order]
    return result


def contents(path: Path, wanted: Callable[[str], bool] = lambda topic: True) -> Contents:
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
        missing = [name for name in names if not has_field(messages.descriptor(), name)]
    if missing:
        known = ", ".join(f.name for f in messages.descriptor().fields)
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

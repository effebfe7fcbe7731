"""What is in a log: its attachments, metadata, and the messages of its channels as columns of numbers."""

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema
from mcap.well_known import MessageEncoding

from laisn.arrays import Floats, Ints
from sim.log.file import Checksums, DamagedError, Decompressor, LogError, faults, records
from sim.log.schema import FixedLayout

Values = npt.NDArray[Any] | list[Any]


def message_class_of(schema: Schema) -> Any:
    """The protobuf class of a message type by the file descriptors that a log holds of it."""
    files = {file.name: file for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file}
    pool = descriptor_pool.DescriptorPool()

    def add(name: str) -> None:
        file = files.pop(name, None)
        if file is not None:
            for needed in file.dependency:
                add(needed)
            pool.Add(file)

    for name in list(files):
        add(name)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


@dataclass
class Messages:
    """The messages of a topic in order of log time: their bytes one behind the other."""

    schema: Any
    """An MCAP schema (name, encoding, data), or None."""
    encoding: str
    data: bytearray = field(default_factory=bytearray)
    times: Any = field(default_factory=lambda: array("q"))
    sizes: Any = field(default_factory=lambda: array("I"))

    def is_like(self, other: "Messages") -> bool:
        """Whether messages of the other channel are of the same type."""
        mine, yours = (None if m.schema is None else (m.schema.name, m.schema.data) for m in (self, other))
        return (mine, self.encoding) == (yours, other.encoding)

    def sort(self) -> None:
        """Bring the messages into the order of their log time; those of equal time stay as they came."""
        time_ns = self.time_ns
        if np.any(time_ns[1:] < time_ns[:-1]):
            each, order = list(self.each()), np.argsort(time_ns, kind="stable").tolist()
            self.data = bytearray().join(each[i] for i in order)
            self.times = array("q", [self.times[i] for i in order])
            self.sizes = array("I", [self.sizes[i] for i in order])

    @property
    def time_ns(self) -> Ints:
        """Log times since 1970, shape (n,), [ns]."""
        return np.array(self.times, dtype=np.int64)

    def each(self) -> Iterator[bytes]:
        """The bytes of one message after the other."""
        start = 0
        for size in self.sizes:
            yield bytes(self.data[start : start + size])
            start += size

    @cached_property
    def message_class(self) -> Any:
        """The protobuf class of the messages, by the schema in the file.

        Raises ValueError if they are encoded in another way.
        """
        if self.schema is None or self.encoding != MessageEncoding.Protobuf:
            raise ValueError(f"messages are encoded as {self.encoding or 'nothing known'}, expected protobuf")
        return message_class_of(self.schema)

    @property
    def descriptor(self) -> Any:
        """The protobuf descriptor of the messages."""
        return self.message_class.DESCRIPTOR

    @cached_property
    def _layout(self) -> FixedLayout | None:
        """Where the numbers of the messages stand, if that is the same place in all of them."""
        size = self.sizes[0] if self.sizes else 0
        if not size or len(self.data) != size * len(self.sizes) or np.any(np.asarray(self.sizes) != size):
            return None
        layout = FixedLayout.of(self.message_class.FromString(bytes(self.data[:size])))
        return layout if layout.fits(self.data, size) else None

    def columns(self, names: Sequence[str]) -> list[Values]:
        """Values by the names of their fields ("pose.position.x"), n each; enumerations are numbers.

        Raises ValueError if a message is malformed, or a field is a list or holds no value.
        """
        paths = [name.split(".") for name in names]
        for path in paths:
            _leaf(self.descriptor, path)
        layout, n = self._layout, len(self.sizes)
        if layout is not None:
            return [
                layout.column(self.data, name) if name in layout.offsets else [_value(layout.first, path)] * n
                for name, path in zip(names, paths, strict=True)
            ]
        found: list[list[Any]] = [[] for _ in names]
        for data in self.each():
            message = self.message_class.FromString(data)
            for values, path in zip(found, paths, strict=True):
                values.append(_value(message, path))
        return list(found)

    def table(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, not to be written, shape (n, len(names))."""
        result = np.empty((len(self.sizes), len(names)))
        for k, values in enumerate(self.columns(names)):
            result[:, k] = values
        result.flags.writeable = False
        return result


def _leaf(descriptor: Any, path: Sequence[str]) -> Any:
    """Descriptor of a field with a single value."""
    for name in path:
        if descriptor.fields_by_name[name].is_repeated:
            raise ValueError(f"field {name} is a list, expected one value")
        leaf = descriptor.fields_by_name[name]
        descriptor = leaf.message_type
    if descriptor is not None:
        raise ValueError(f"field {'.'.join(path)} holds no single value")
    return leaf


def _value(message: Any, path: Sequence[str]) -> Any:
    for name in path:
        message = getattr(message, name)
    return message


@dataclass
class Contents:
    """What a log holds."""

    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    topics: dict[str, Messages] = field(default_factory=dict)
    unverified: tuple[str, ...] = ()
    """Parts of the file that have no checksum."""


Choice = Callable[[str, Messages], bool]
"""Whether a channel is wanted, by its topic and its messages before there are any."""


def contents(path: Path, wanted: Choice = lambda topic, messages: True) -> Contents:
    """Read a log in one pass; channels of the same topic are one, messages come in order of their log time.

    Raises:
        LogError: it cannot be read, is no MCAP file or is damaged, decompresses to more than is plausible, or a channel
            has messages of several types.
    """
    result, checksums = Contents(), Checksums()
    schemas, channels = dict[int, Schema](), dict[int, Messages | None]()

    def take(record: Any) -> None:
        if isinstance(record, Message):
            messages = channels.get(record.channel_id)
            if messages is not None:
                messages.data += record.data
                messages.times.append(record.log_time)
                messages.sizes.append(len(record.data))
        elif isinstance(record, Schema):
            schemas.setdefault(record.id, record)
        elif isinstance(record, Channel) and record.id not in channels:
            messages = Messages(schemas.get(record.schema_id), record.message_encoding)
            channels[record.id] = None
            if wanted(record.topic, messages):
                channels[record.id] = result.topics.setdefault(record.topic, messages)
                if not result.topics[record.topic].is_like(messages):
                    raise DamagedError(f"channel {record.topic} has messages of two types; it may have one")

    with faults(path), path.open("rb") as stream:
        decompressor = Decompressor(path.stat().st_size)
        for record in records(stream, checksums):
            if isinstance(record, Chunk):
                for inner in decompressor.records(record, stream.tell()):
                    take(inner)
            elif isinstance(record, Attachment):
                result.attachments[record.name] = record.data
            elif isinstance(record, Metadata):
                result.metadata[record.name] = record.metadata
            else:
                take(record)
    for messages in result.topics.values():
        messages.sort()
    result.unverified = checksums.missing
    return result


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

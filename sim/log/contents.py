"""What is in a log: its attachments, metadata, and the messages of its channels as columns of numbers."""

import struct
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Metadata, Schema
from mcap.well_known import MessageEncoding
from numpy.lib.stride_tricks import sliding_window_view

from laisn.arrays import Floats, Ints
from sim.log.clock import Clock
from sim.log.file import SCENARIO, LogError, faults, records
from sim.log.schema import FixedLayout, RecordType, message_class_of
from sim.scenario import file as scenario_file

Values = npt.NDArray[Any] | list[Any]
Getter = Callable[[Any], Any]

_HEAD = np.dtype(
    [("opcode", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("time_ns", "<i8"), ("publish", "<i8")]
)
"""What a message begins with."""
_RECORD_HEAD = 9
"""Length of opcode and size of any record [bytes]; the size does not count them."""


class Messages:
    """The messages of a topic in order of log time: their bytes one behind the other."""

    def __init__(self, schema: Any, encoding: str) -> None:
        self.schema, self.encoding = schema, encoding
        self.kept, self.count, self._parts = True, 0, list[tuple[Ints, Ints]]()
        self.data = bytearray()

    def add(self, time_ns: Ints, sizes: Ints, parts: Iterable[bytes]) -> None:
        """Append messages, or count them if they are not kept."""
        self.count += time_ns.size
        if self.kept:
            self._parts.append((time_ns, sizes))
            self.data += b"".join(parts)

    def sort(self) -> None:
        """Bring the messages into the order of their log time; those of equal time stay as they came."""
        if np.any(self.time_ns[1:] < self.time_ns[:-1]):
            order, each = np.argsort(self.time_ns, kind="stable"), list(self.each())
            self.data = bytearray().join(each[i] for i in order.tolist())
            self.time_ns, self.sizes = self.time_ns[order], self.sizes[order]

    @cached_property
    def time_ns(self) -> Ints:
        """Log times since 1970, shape (n,), [ns]."""
        return np.concatenate([np.empty(0, dtype=np.int64), *(time_ns for time_ns, _ in self._parts)])

    @cached_property
    def sizes(self) -> Ints:
        """Of each message, shape (n,), [bytes]."""
        return np.concatenate([np.empty(0, dtype=np.int64), *(sizes for _, sizes in self._parts)])

    def each(self) -> Iterator[bytes]:
        """The bytes of one message after the other."""
        ends = np.cumsum(self.sizes)
        for start, end in zip((ends - self.sizes).tolist(), ends.tolist(), strict=True):
            yield bytes(self.data[start:end])

    @cached_property
    def message_class(self) -> Any:
        """The protobuf class of the messages, by the schema in the file.

        Raises ValueError if they are encoded in another way.
        """
        if self.schema is None or self.encoding != MessageEncoding.Protobuf:
            raise ValueError(f"messages are encoded as {self.encoding or 'nothing known'}, expected protobuf")
        return message_class_of(self.schema)

    def has(self, name: str) -> bool:
        """Whether the messages have the field "name" or "name.of.a.nested.one"."""
        descriptor = self.message_class.DESCRIPTOR
        for part in name.split("."):
            inner = descriptor.fields_by_name.get(part) if descriptor is not None else None
            if inner is None:
                return False
            descriptor = inner.message_type
        return True

    def columns(self, names: Sequence[str]) -> list[Values]:
        """Values by the names of their fields ("pose.position.x"), n each; enumerations are numbers.

        A field that has presence and is not set gives None; of numbers, `table` makes it NaN.

        Raises ValueError if a message is malformed, or a field is a list or holds no value.
        """
        getters = [_getter(self.message_class.DESCRIPTOR, name) for name in names]
        # messages of one length mostly differ in numbers alone; of a log of a flight, all those of a channel do
        order = np.argsort(self.sizes, kind="stable")
        groups = np.split(order, 1 + np.flatnonzero(np.diff(self.sizes[order])))
        if len(groups) == 1:
            return self._decoded(self.data, self.sizes.size, names, getters)
        whole, begins = np.frombuffer(self.data, dtype=np.uint8), np.cumsum(self.sizes) - self.sizes
        columns = [np.empty(order.size, dtype=object) for _ in names]
        for rows in groups:
            size = int(self.sizes[rows[0]])
            data = sliding_window_view(whole, size)[begins[rows]].tobytes() if size else b""
            for column, values in zip(columns, self._decoded(data, rows.size, names, getters), strict=True):
                column[rows] = values
        return list(columns)

    def _decoded(
        self, data: bytes | bytearray, n: int, names: Sequence[str], getters: Sequence[Getter]
    ) -> list[Values]:
        """Values of n messages of one length: as arrays if they differ in numbers alone, otherwise one by one."""
        size, parse = len(data) // max(n, 1), self.message_class.FromString
        if n > 1:
            first = parse(bytes(data[:size]))
            layout = FixedLayout(first)
            if layout.dtype.itemsize == size and layout.fits(data):
                block: Any = np.frombuffer(data, layout.dtype) if size else np.empty(n)
                return [
                    block[name].copy() if name in layout.names else np.broadcast_to(np.array(get(first), object), n)
                    for name, get in zip(names, getters, strict=True)
                ]
        found: list[list[Any]] = [[] for _ in names]
        for start in range(0, n * size, size) if size else [0] * n:
            message = parse(bytes(data[start : start + size]))
            for values, get in zip(found, getters, strict=True):
                values.append(get(message))
        return list(found)

    def table(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, NaN for what is absent, not to be written, shape (n, len(names))."""
        result = np.empty((self.sizes.size, len(names)))
        for k, values in enumerate(self.columns(names)):
            result[:, k] = values
        result.flags.writeable = False
        return result


def _getter(descriptor: Any, name: str) -> Getter:
    """A function that takes a single value from a message, None if it or what holds it is not set."""
    path = []
    for part in name.split("."):
        field_ = descriptor.fields_by_name[part]
        if field_.is_repeated:
            raise ValueError(f"field {part} is a list, expected one value")
        path.append((part, field_.has_presence))
        descriptor = field_.message_type
    if descriptor is not None:
        raise ValueError(f"field {name} holds no single value")

    def get(message: Any) -> Any:
        for part, optional in path:
            if optional and not message.HasField(part):
                return None
            message = getattr(message, part)
        return message

    return get


Choice = Callable[[str, Messages], bool]
"""Whether the messages of a channel are kept, by its topic and the channel without messages."""


class Contents:
    """What a log holds; read in one pass. Channels of the same topic are one.

    Args:
        path: the log.
        wanted: of other channels, the messages are counted only.

    Raises:
        LogError: it cannot be read, is no MCAP file or is damaged, decompresses to more than is plausible, or a channel
            has messages of several types.
    """

    def __init__(self, path: Path, wanted: Choice = lambda topic, messages: True) -> None:
        self.path = path
        self.attachments, self.topics = dict[str, bytes](), dict[str, Messages]()
        self.metadata = dict[str, dict[str, str]]()
        self.span_ns: tuple[int, int] | None = None
        """Log times of the first and the last message [ns]."""
        self.unverified: tuple[str, ...] = ()
        """Parts that no checksum covers, so that damage to them cannot be noticed."""
        self._wanted, self._schemas, self._channels = wanted, dict[int, Schema](), dict[int, Messages]()
        chunks = bare = 0
        with faults(path):
            for record in records(path):
                if isinstance(record, Chunk):
                    chunks, bare = chunks + 1, bare + (not record.uncompressed_crc)
                    self._add(record.data)
                elif isinstance(record, Attachment):
                    self.attachments[record.name] = record.data
                elif isinstance(record, Metadata):
                    self.metadata[record.name] = record.metadata
                elif isinstance(record, DataEnd) and not record.data_section_crc:
                    self.unverified = ("metadata", *([f"{bare} of {chunks} chunks"] if bare else []))
            for messages in self.topics.values():
                messages.sort()

    def _add(self, data: bytes) -> None:
        """Take the records of a chunk.

        `mcap.stream_reader.breakup_chunk` makes an object of each message, which takes several times as long and ten
        times the memory. Here a loop finds the records, and their heads are read as arrays.
        """
        starts, at, unpack = array("q"), 0, struct.Struct("<Q").unpack_from
        while at < len(data):
            starts.append(at)
            at += _RECORD_HEAD + unpack(data, at + 1)[0]
        places, block = np.frombuffer(starts, dtype=np.int64), np.frombuffer(data, dtype=np.uint8)
        opcodes = block[places]
        for place in places[(opcodes == Opcode.SCHEMA) | (opcodes == Opcode.CHANNEL)].tolist():
            self._define(data, place)
        places = places[opcodes == Opcode.MESSAGE]
        if at > len(data) or (places.size and places[-1] + _HEAD.itemsize > len(data)):
            raise ValueError("a chunk holds a broken record")
        if not places.size:
            return
        heads = np.ascontiguousarray(sliding_window_view(block, _HEAD.itemsize)[places]).view(_HEAD)[:, 0]
        sizes = heads["size"].astype(np.int64) - (_HEAD.itemsize - _RECORD_HEAD)
        if np.any(sizes < 0):
            raise ValueError("a chunk holds a broken message")
        for channel in np.unique(heads["channel"]).tolist():
            mine = heads["channel"] == channel
            begins = places[mine] + _HEAD.itemsize
            ends = (begins + sizes[mine]).tolist()
            parts = (data[begin:end] for begin, end in zip(begins.tolist(), ends, strict=True))
            self._channels[channel].add(heads["time_ns"][mine], sizes[mine], parts)
        known, span = self.span_ns or (2**63 - 1, 0), (int(heads["time_ns"].min()), int(heads["time_ns"].max()))
        self.span_ns = min(known[0], span[0]), max(known[1], span[1])

    def _define(self, data: bytes, place: int) -> None:
        """Take a schema or a channel, unless it is repeated."""
        body, number = place + _RECORD_HEAD, int.from_bytes(data[place + 9 : place + 11], "little")
        if number in (self._schemas if data[place] == Opcode.SCHEMA else self._channels):
            return
        stream = ReadDataStream(BytesIO(data[body:]))
        if data[place] == Opcode.SCHEMA:
            self._schemas[number] = Schema.read(stream)
        else:
            channel = Channel.read(stream)
            new = Messages(self._schemas.get(channel.schema_id), channel.message_encoding)
            known = self._channels[number] = self.topics.setdefault(channel.topic, new)
            if known is new:
                new.kept = self._wanted(channel.topic, new)
            mine, others = ((m.encoding, m.schema and (m.schema.name, m.schema.data)) for m in (known, new))
            if mine != others:
                raise LogError(f"{self.path}: channel {channel.topic} has messages of two types; it may have one")

    def start_ns(self) -> int:
        """When the mission began: the epoch of its scenario, or in other logs the first message kept [ns]."""
        if SCENARIO in self.attachments:
            return Clock(scenario_file.parse(self.attachments[SCENARIO].decode(), SCENARIO)["epoch"]).epoch_ns
        return min((int(m.time_ns[0]) for m in self.topics.values() if m.time_ns.size), default=0)

    def add_empty(self, topic: str, type_: RecordType) -> None:
        """Add a channel of a flight that is not in its file, as it has no message."""
        self.topics.setdefault(topic, Messages(type_.schema, MessageEncoding.Protobuf))

    def require(self, topic: str, names: Sequence[str]) -> Messages:
        """The messages of a topic with all the named fields; LogError naming the topics or fields that there are."""
        messages = self.topics.get(topic)
        if messages is None:
            raise LogError(f"{self.path}: lacks channel {topic}; available: {', '.join(sorted(self.topics)) or 'none'}")
        with faults(self.path):
            if messages.encoding != MessageEncoding.Protobuf:
                raise LogError(f"{self.path}: channel {topic} is encoded as {messages.encoding!r}, expected protobuf")
            missing = [name for name in names if not messages.has(name)]
            if missing:
                known = ", ".join(f.name for f in messages.message_class.DESCRIPTOR.fields)
                raise LogError(f"{self.path}: channel {topic} lacks {', '.join(missing)}; its fields: {known}")
        return messages

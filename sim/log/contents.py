"""What is in a log: one pass over its records verifies every checksum and gives the messages as columns of numbers."""

import os
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import lz4.frame
import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import MAGIC_SIZE, CRCValidationError, StreamReader, breakup_chunk
from mcap.well_known import MessageEncoding

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from sim.log.schema import Clock, fixed_layout, message_class_of
from sim.scenario import file as scenario_file

SCENARIO, VEHICLES, SUMMARY, VERSIONS = "scenario.toml", "vehicles.json", "summary.json", "versions.json"
"""Attachments of a log."""
FLIGHT = "laisn"
"""Metadata record by which the log of a flight is known."""
_ALLOWANCE, _RATIO = 8 << 20, 16
"""A file of n bytes may decompress to 8 MiB + 16 n; flights decompress to 6 n."""
Values = npt.NDArray[Any] | list[Any]


class LogError(LaisnError):
    """A log that cannot be written or read; the text states file, cause and remedy."""


class DamagedError(LogError):
    """A record is broken; the text states which, and where."""

    def __init__(self, path: Path, problem: str) -> None:
        self.problem = problem
        super().__init__(f"{path}: {problem}; laisn log recover keeps what is intact")


def partial_path(path: Path) -> Path:
    """The name that a log grows under until it is complete."""
    return path.with_name(f"{path.name}.partial")


@contextmanager
def log_errors(path: Path) -> Iterator[None]:
    """Convert errors of reading the file to a LogError with its name."""
    try:
        yield
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from error
    except Exception as error:
        # foreign bytes make decompressors, decoders and arrays fail in many ways; to the user they are one
        raise LogError(f"{path}: damaged, or written by something else ({type(error).__name__}: {error})") from error


def _intact(stream: IO[bytes], attachment: Attachment) -> bool:
    """Whether the checksum of an attachment that was just read matches; the library skips it. 0 stands for none."""
    stream.seek(-4, os.SEEK_CUR)
    stored, builder = stream.read(4), RecordBuilder()
    attachment.write(builder)
    return stored in (bytes(4), builder.end()[-4:])  # type: ignore[no-untyped-call]  # the library leaves it bare


def _decompressed(chunk: Chunk, most: int) -> Chunk:
    """A chunk decompressed as a stream: at once, any size that it states would be allocated."""
    size, data = chunk.uncompressed_size, chunk.data
    if size > most:
        raise ValueError(f"a chunk of {len(data)} bytes would decompress to {size}, too many")
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
    elif chunk.compression == "lz4":
        data = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    elif chunk.compression:
        raise ValueError(f"a chunk is compressed by {chunk.compression!r}; expected zstd, lz4 or nothing")
    if len(data) != size:
        raise ValueError("the size of a chunk does not match")
    return replace(chunk, compression="", data=data)


def _reason(error: Exception) -> str:
    """What is wrong with a record by which the library failed."""
    if isinstance(error, CRCValidationError):
        return f"the checksum of {'a chunk' if isinstance(error.record, Chunk) else 'the data section'} does not match"
    return "the file ends within a record" if isinstance(error, (EndOfFile, struct.error)) else str(error)


def records(path: Path, on_damaged: Callable[[str], None] | None = None) -> Iterator[McapRecord]:
    """The data section of an MCAP file in order, each record after its checksum was verified.

    Metadata have no checksum but that of the section as a whole, at its end. Each chunk is followed by what is in it.

    Args:
        path: the file.
        on_damaged: is called for a damaged attachment, which is left out; None: it raises.

    Raises:
        DamagedError: the first record that is broken, or the missing end of the file.
        LogError: the file cannot be read, or is no MCAP file.
    """
    with log_errors(path), path.open("rb") as stream:
        size, at, ended = path.stat().st_size, 0, False
        left = _ALLOWANCE + _RATIO * size
        # no record is longer than its file
        reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    inner = breakup_chunk(_decompressed(record, left), validate_crc=True)
                    left -= record.uncompressed_size
                    yield record
                    yield from inner
                elif isinstance(record, Attachment) and not _intact(stream, record):
                    if on_damaged is None:
                        raise ValueError(f"the checksum of attachment {record.name!r} does not match")
                    on_damaged(f"attachment {record.name!r} is damaged and is left out")
                elif isinstance(record, Footer) and not ended:
                    raise ValueError("the data section has no end")
                elif not ended:
                    yield record
                ended, at = ended or isinstance(record, DataEnd), stream.tell()
            if stream.read(1):
                raise ValueError("bytes follow the end of the log")
        except OSError:
            raise
        except Exception as error:
            if size < MAGIC_SIZE or (isinstance(error, InvalidMagic) and at == 0):
                raise LogError(f"{path}: no MCAP file") from error
            raise DamagedError(path, f"damaged or cut off at byte {at}: {_reason(error)}") from error


def _value(message: Any, path: Sequence[tuple[str, bool]]) -> Any:
    """A single value, by the names of nested fields and whether they have presence; None if one of them is not set."""
    for name, has_presence in path:
        if has_presence and not message.HasField(name):
            return None
        message = getattr(message, name)
    return message


class Messages:
    """The messages of a topic, of a schema (None: unknown) and an encoding; if they are not kept, their times alone."""

    def __init__(self, schema: Any, encoding: str = MessageEncoding.Protobuf) -> None:
        self.schema, self.encoding, self.kept = schema, encoding, True
        self._times, self.data = array("q"), list[bytes]()

    def add(self, message: Message) -> None:
        """Append a message."""
        self._times.append(message.log_time)
        if self.kept:
            self.data.append(message.data)

    def sort(self) -> None:
        """Bring the messages into the order of their log time; those of equal time stay as they came."""
        if self.kept and np.any(self.time_ns[1:] < self.time_ns[:-1]):
            order = np.argsort(self.time_ns, kind="stable")
            self._times = array("q", self.time_ns[order].tobytes())
            self.data = [self.data[i] for i in order.tolist()]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._times)

    @property
    def time_ns(self) -> Ints:
        """Log times since 1970, shape (n,), [ns]."""
        return np.asarray(self._times)

    @property
    def is_protobuf(self) -> bool:
        """Whether they are encoded as protobuf, by a schema that the log holds."""
        return self.schema is not None and self.encoding == MessageEncoding.Protobuf

    @cached_property
    def message_class(self) -> Any:
        """The protobuf class of the messages, by the schema in the file; for messages that `is_protobuf`."""
        return message_class_of(self.schema)

    def path(self, name: str) -> list[Any]:
        """Descriptors of the field "name", or of all in "name.of.a.nested.one"; empty if there is no such field."""
        descriptor, found = self.message_class.DESCRIPTOR, list[Any]()
        for part in name.split("."):
            field = descriptor.fields_by_name.get(part) if descriptor is not None else None
            if field is None:
                return []
            found.append(field)
            descriptor = field.message_type
        return found

    def columns(self, names: Sequence[str]) -> list[Values]:
        """Values by the names of their fields ("pose.position.x"), n each; enumerations are numbers.

        Messages with a number of eight bytes in every field, as those of a flight, are read as arrays. A field that has
        presence and is not set gives None; of numbers, `table` makes it NaN.

        Raises ValueError if a message is malformed, or a field holds no single value.
        """
        paths = [self.path(name) for name in names]
        for name, (*_, field) in zip(names, paths, strict=True):
            if field.is_repeated or field.message_type is not None:
                raise ValueError(f"field {name} holds no single value")
        layout = fixed_layout(self.message_class)
        if layout and {len(data) for data in self.data} == {len(layout.example)}:
            block = np.frombuffer(b"".join(self.data), layout.dtype)
            each, example = block.view(np.uint8).reshape(block.size, -1), np.frombuffer(layout.example, np.uint8)
            if np.all(each[:, layout.tags] == example[layout.tags]):
                return [block[name].copy() for name in names]
        steps = [[(field.name, field.has_presence) for field in path] for path in paths]
        found = [list[Any]() for _ in names]
        for message in map(self.message_class.FromString, self.data):
            for values, path in zip(found, steps, strict=True):
                values.append(_value(message, path))
        return list(found)

    def table(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, NaN for what is absent, not to be written, shape (n, len(names))."""
        result = np.empty((len(self.data), len(names)))
        for k, values in enumerate(self.columns(names)):
            result[:, k] = values
        result.flags.writeable = False
        return result


Choice = Callable[[str, Messages], bool]
"""Whether the messages of a channel are kept, by its topic and the channel without messages."""


class Contents:
    """What a log holds; read in one pass. Channels of the same topic are one.

    Args:
        path: the log.
        wanted: of other channels, only the times of the messages are kept.

    Raises:
        LogError: it cannot be read, is no MCAP file or is damaged, decompresses to more than is plausible, or a channel
            has messages of several types.
    """

    def __init__(self, path: Path, wanted: Choice = lambda topic, messages: True) -> None:
        self.path = path
        self.attachments, self.topics = dict[str, bytes](), dict[str, Messages]()
        self.metadata = dict[str, dict[str, str]]()
        self.unverified: tuple[str, ...] = ()
        """Parts that no checksum covers, so that damage to them cannot be noticed."""
        schemas, channels = dict[int, Schema](), dict[int, Messages]()
        chunks = bare = 0
        with log_errors(path):
            for record in records(path):
                if isinstance(record, Message):
                    channels[record.channel_id].add(record)
                elif isinstance(record, Schema):
                    schemas.setdefault(record.id, record)
                elif isinstance(record, Channel) and record.id not in channels:
                    new = Messages(schemas.get(record.schema_id), record.message_encoding)
                    known = channels[record.id] = self.topics.setdefault(record.topic, new)
                    if known is new:
                        new.kept = wanted(record.topic, new)
                    mine, others = ((m.encoding, m.schema and (m.schema.name, m.schema.data)) for m in (known, new))
                    if mine != others:
                        raise LogError(f"{path}: channel {record.topic} has messages of two types; it may have one")
                elif isinstance(record, Attachment):
                    self.attachments[record.name] = record.data
                elif isinstance(record, Metadata):
                    self.metadata[record.name] = record.metadata
                elif isinstance(record, Chunk):
                    chunks, bare = chunks + 1, bare + (not record.uncompressed_crc)
                elif isinstance(record, DataEnd) and not record.data_section_crc:
                    self.unverified = ("metadata", *([f"{bare} of {chunks} chunks"] if bare else []))
            for messages in self.topics.values():
                messages.sort()

    def start_ns(self) -> int:
        """When the mission began: the epoch of its scenario, or in other logs the first message kept [ns]."""
        if SCENARIO in self.attachments:
            return Clock(scenario_file.parse(self.attachments[SCENARIO].decode(), SCENARIO)["epoch"]).epoch_ns
        return min((int(m.time_ns[0]) for m in self.topics.values() if m.data), default=0)

    def require(self, topic: str, names: Sequence[str], empty: Any = None) -> Messages:
        """The messages of a topic that have fields of these names.

        Args:
            topic: of the channel.
            names: of the fields.
            empty: schema of a channel that is not in the file if it has no message; None: it must be there.

        Raises:
            LogError: there is no such channel or field; the text names the topics or fields that there are.
        """
        messages = self.topics.get(topic, empty and Messages(empty))
        if messages is None:
            raise LogError(f"{self.path}: lacks channel {topic}; available: {', '.join(sorted(self.topics)) or 'none'}")
        if not messages.is_protobuf:
            found = f"{messages.encoding!r}{'' if messages.schema else ' without a schema'}"
            raise LogError(f"{self.path}: channel {topic} is encoded as {found}, expected protobuf and its schema")
        if missing := [name for name in names if not messages.path(name)]:
            known = ", ".join(f.name for f in messages.message_class.DESCRIPTOR.fields)
            raise LogError(f"{self.path}: channel {topic} lacks {', '.join(missing)}; its fields: {known}")
        return messages

"""The MCAP file under a log: names, integrity, and its records."""

import os
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding
from mcap_protobuf.decoder import DecoderFactory

from laisn.failure import LaisnError

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD_BYTES = 1 + 8
FOOTER_BYTES = RECORD_HEAD_BYTES + 8 + 8 + 4
DATA_END_BYTES = RECORD_HEAD_BYTES + 4

SCENARIO, VEHICLES, SUMMARY, VERSIONS = "scenario.toml", "vehicles.json", "summary.json", "versions.json"
"""Attachments of a log."""


class LogError(LaisnError):
    """A log that cannot be written or read; the text says which file, what is wrong and what helps."""


def partial_path(path: Path) -> Path:
    """The name that a log grows under until it is whole."""
    return path.with_name(f"{path.name}.partial")


@contextmanager
def faults(path: Path) -> Iterator[None]:
    """Whatever goes wrong with the file inside becomes a LogError that names it."""
    try:
        yield
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from error
    except Exception as error:
        # foreign bytes make decompressors, decoders and arrays fail in many ways; to the reader they are one
        raise LogError(f"{path}: damaged, or written by something else ({type(error).__name__}: {error})") from error


def _crc(stream: IO[bytes], start: int, stop: int, crc: int = 0) -> int:
    stream.seek(start)
    left = stop - start
    while left > 0 and (data := stream.read(min(left, 1 << 20))):
        crc = zlib.crc32(data, crc)
        left -= len(data)
    return crc


def end_of_log(stream: IO[bytes]) -> int | None:
    """Where the first whole MCAP file in a stream ends, whatever follows it; None if no end of one is there."""
    size, place = stream.seek(0, os.SEEK_END), len(MAGIC)
    while place + RECORD_HEAD_BYTES <= size:
        stream.seek(place)
        opcode, length = struct.unpack("<BQ", stream.read(RECORD_HEAD_BYTES))
        place += RECORD_HEAD_BYTES + length
        if opcode == Opcode.FOOTER:
            stream.seek(min(place, size))
            return place + len(MAGIC) if stream.read(len(MAGIC)) == MAGIC else None
    return None


def _refusal(path: Path, stream: IO[bytes], size: int, what: str) -> LogError:
    """What is wrong with a file that does not end as it should: `what`, or bytes behind the end of a log."""
    stop = end_of_log(stream)
    if stop is not None and stop < size:
        what = f"{size - stop} bytes follow the end of the log; laisn log recover makes a copy without them"
    return LogError(f"{path}: {what}")


def check(path: Path) -> None:
    """Check that an MCAP file is whole and that its bytes are those that were written.

    Raises:
        LogError: it cannot be read, is none, is cut off, goes on behind its end, or fails a checksum.
    """
    with faults(path), path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise LogError(f"{path}: no MCAP file")
        size = stream.seek(0, os.SEEK_END)
        footer = size - len(MAGIC) - FOOTER_BYTES
        stream.seek(max(0, footer))
        end = stream.read()
        if footer < DATA_END_BYTES or end[0] != Opcode.FOOTER or not end.endswith(MAGIC):
            raise _refusal(path, stream, size, "cut off before its end; laisn log recover rescues what is there")
        summary_start, _, summary_crc = struct.unpack("<QQI", end[9:FOOTER_BYTES])
        summary_start = summary_start or footer
        data_end = summary_start - DATA_END_BYTES
        if not len(MAGIC) <= data_end < footer:
            raise _refusal(path, stream, size, "damaged: its footer points outside the file")
        stream.seek(data_end)
        opcode, _, data_crc = struct.unpack("<BQI", stream.read(DATA_END_BYTES))
        intact = opcode == Opcode.DATA_END
        # zero stands for a checksum that the writer left out
        intact = intact and data_crc in (0, _crc(stream, 0, data_end))
        through_footer = zlib.crc32(end[: FOOTER_BYTES - 4], _crc(stream, summary_start, footer))
        if not intact or summary_crc not in (0, through_footer):
            raise _refusal(path, stream, size, "damaged: a checksum does not fit its bytes")


def whole_records(path: Path) -> Iterator[Any]:
    """Records of a file of which the end may be missing, chunks as they are, up to the first that is not whole."""
    with path.open("rb") as stream:
        reader = StreamReader(stream, emit_chunks=True, record_size_limit=path.stat().st_size)
        records = iter(reader.records)
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except Exception:
                # past the last whole record there may be anything
                return
            yield record


def rescuable(path: Path) -> bool:
    """Whether a partial log holds so much that recovering it makes sense: a chunk of more than one instant."""
    try:
        records = whole_records(path)
        return any(isinstance(r, Chunk) and r.message_end_time > r.message_start_time for r in records)
    except OSError:
        return False


@dataclass
class Messages:
    """The messages of a topic in order of time."""

    schema: Schema | None
    encoding: str
    time_ns: list[int] = field(default_factory=list)
    """Log times since 1970 [ns]."""
    data: list[bytes] = field(default_factory=list)

    def decoded(self) -> Iterator[Any]:
        """As protobuf messages, by the schema in the file."""
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
        get = attrgetter(*names)
        rows = [get(message) for message in self.decoded()]
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(names))

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


def contents(path: Path, wanted: Callable[[str], bool] = lambda topic: True) -> Contents:
    """Read a log after `check`; channels of the same topic are one, messages come in order of their log time.

    Raises:
        LogError: it cannot be read, is damaged, or no MCAP file.
    """
    check(path)
    result, schemas, ids = Contents(), dict[int, Schema](), dict[int, Messages]()
    with faults(path), path.open("rb") as stream:
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Message):
                messages = ids.get(record.channel_id)
                if messages is not None:
                    messages.time_ns.append(record.log_time)
                    messages.data.append(record.data)
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and wanted(record.topic):
                ids[record.id] = result.topics.setdefault(
                    record.topic, Messages(schemas.get(record.schema_id), record.message_encoding)
                )
            elif isinstance(record, Attachment):
                result.attachments[record.name] = record.data
            elif isinstance(record, Metadata):
                result.metadata[record.name] = record.metadata
        for messages in result.topics.values():
            order = np.argsort(messages.time_ns, kind="stable").tolist()
            messages.time_ns = [messages.time_ns[i] for i in order]
            messages.data = [messages.data[i] for i in order]
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

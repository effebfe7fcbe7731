"""An MCAP file: one pass verifies its checksums and gives messages as columns; recovery keeps
what is intact.
"""

import mmap
import os
import re
import struct
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from mcap.data_stream import RecordBuilder
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import MAGIC_SIZE, CRCValidationError, StreamReader
from mcap.well_known import MessageEncoding
from mcap.writer import CompressionType, Writer

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from sim.log.frames import MAGIC, Damage, DamagedAttachment, Salvage, SummarySection, records_of
from sim.log.schema import Clock, fixed_layout, message_class_of
from sim.scenario import file as scenario_file
from sim.system import atomic_write

# attachments of a flight's log
SCENARIO = "scenario.toml"
VEHICLES = "vehicles.json"
SUMMARY = "summary.json"
VERSIONS = "versions.json"
FLIGHT = "laisn"  # metadata record that every log of a flight has
FIRST_GAP = "first_gap_ns"
"""Key of that record in a recovered log: time before which a flight is complete [ns]."""
CLOCK = "laisn-clock"
"""Metadata record of logs that know when their mission started, as those of the benchmark."""
START = "start_ns"
"""Key of that record: start of the mission [ns], from which `leader_timestamp` counts."""
_FIRST_DATE_NS = 315_532_800 * 10**9  # 1980; times of logs that are less are no dates
_INTERRUPTED = "INTERRUPTED"
_PARTIAL = ".partial"
_MAX_NAMED_PLACES = 10  # most damaged places that are named
_CHUNK_BYTES = 2**18  # of a recovered log: the last chunk is lost where the log is cut again
# a file of n bytes may decompress to 8 MiB + 16 n; flights decompress to 6 n
_DECOMPRESSED_BASE_BYTES = 8 << 20
_DECOMPRESSED_PER_BYTE = 16


class LogError(LaisnError):
    """A log that cannot be written or read; the text states file, cause and remedy."""


class DamagedError(LogError):
    """A record is broken; the text states which, and where."""

    def __init__(self, path: Path, problem: str) -> None:
        self.problem = problem
        super().__init__(f"{path}: {problem}; laisn log recover keeps what is intact")


def partial_path(path: Path) -> Path:
    """The name that a log grows under until it is complete."""
    return path.with_name(f"{path.name}{_PARTIAL}")


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
        # foreign bytes make decompressors, decoders and arrays fail in many ways; to the user they
        # are one
        raise LogError(
            f"{path}: damaged, or written by something else ({type(error).__name__}: {error})"
        ) from error


def _intact(stream: IO[bytes], attachment: Attachment) -> bool:
    """Whether the checksum of an attachment that was just read matches; the library skips it.

    A stored checksum of 0 means that there is none.
    """
    stream.seek(-4, os.SEEK_CUR)
    stored = stream.read(4)
    builder = RecordBuilder()
    attachment.write(builder)
    return stored in (bytes(4), builder.end()[-4:])  # type: ignore[no-untyped-call]  # the library leaves it bare


class _Verifier:
    """The records of a data section, each checked against what the file promises.

    ValueError for a wrong checksum of an attachment, a wrong number of messages or a missing end.
    """

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream = stream
        # bytes that chunks may still decompress to
        self._allowance = _DECOMPRESSED_BASE_BYTES + _DECOMPRESSED_PER_BYTE * size
        self._messages = 0
        self._ended = False

    def verify(self, record: McapRecord) -> list[McapRecord]:
        """The record and what is in it; nothing where it belongs to the summary."""
        records = [record]
        match record:
            case Chunk():
                inner = records_of(record, self._allowance)
                self._allowance -= record.uncompressed_size
                self._messages += sum(isinstance(item, Message) for item in inner)
                return records + inner
            case Attachment() if not _intact(self._stream, record):
                raise ValueError(f"the checksum of attachment {record.name!r} does not match")
            case Statistics() if record.message_count != self._messages:
                raise ValueError(
                    f"it holds {self._messages} messages, and its summary promises "
                    f"{record.message_count}"
                )
            case Footer() if not self._ended:
                raise ValueError("the data section has no end")
        if self._ended:
            return []
        self._messages += isinstance(record, Message)
        self._ended = isinstance(record, DataEnd)
        return records


def _reason(error: Exception) -> str:
    """What is wrong with a file that could not be read to its end."""
    if isinstance(error, CRCValidationError):
        section = "a chunk" if isinstance(error.record, Chunk) else "the data section"
        return f"the checksum of {section} does not match"
    if isinstance(error, (EndOfFile, struct.error)):
        return "the file ends within a record"
    return str(error)


def _records(path: Path) -> Iterator[McapRecord]:
    """The data section in order, each record after its checksum was verified; a chunk is followed
    by what is in it. DamagedError for all damage, and for another number of messages than the
    summary promises.
    """
    with log_errors(path), path.open("rb") as stream:
        size = path.stat().st_size
        position = 0
        verifier = _Verifier(stream, size)
        # no record is longer than its file
        reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size)
        try:
            for record in reader.records:
                yield from verifier.verify(record)
                position = stream.tell()
            if stream.read(1):
                raise ValueError("bytes follow the end of the log")
        except OSError:
            raise
        except Exception as error:
            if size < MAGIC_SIZE or (isinstance(error, InvalidMagic) and position == 0):
                raise LogError(f"{path}: no MCAP file") from error
            raise DamagedError(
                path, f"damaged or cut off at byte {position}: {_reason(error)}"
            ) from error


@dataclass
class Messages:
    """The messages of a topic in order of time, or their times alone in order of recording."""

    schema: Any  # None: unknown
    encoding: str = MessageEncoding.Protobuf
    holds_data: bool = True  # not times alone
    times: "array[int]" = field(default_factory=lambda: array("q"))
    data: list[bytes] = field(default_factory=list)
    # of those with data, their numbers in the order of recording, among all records of the log
    ordinals: "array[int]" = field(default_factory=lambda: array("q"))

    @property
    def time_ns(self) -> Ints:
        """Log times since 1970, shape (n,), [ns]."""
        return np.asarray(self.times)

    @property
    def type_id(self) -> tuple[str, Any]:
        """What tells their type: encoding, and name and text of the schema."""
        return self.encoding, self.schema and (self.schema.name, self.schema.data)

    def append(self, record: Message, ordinal: int) -> None:
        """Add a message, or its time alone."""
        self.times.append(record.log_time)
        if self.holds_data:
            self.data.append(record.data)
            self.ordinals.append(ordinal)

    def sort(self) -> None:
        """Put the messages in order of time; those at one time stay as they were recorded.

        Messages kept as times alone stay as recorded.
        """
        if not self.holds_data or np.all(self.time_ns[1:] >= self.time_ns[:-1]):
            return
        order = np.argsort(self.time_ns, kind="stable").tolist()
        self.times = array("q", [self.times[i] for i in order])
        self.data = [self.data[i] for i in order]
        self.ordinals = array("q", [self.ordinals[i] for i in order])

    def shift(self, shift_ns: Ints) -> None:
        """Add to the times of the messages, shape (n,), [ns]."""
        self.times = array("q", (self.time_ns + shift_ns).tolist())
        self.sort()

    @property
    def is_protobuf(self) -> bool:
        """Whether they are encoded as protobuf, by a schema that the log holds."""
        return self.schema is not None and self.encoding == MessageEncoding.Protobuf

    @cached_property
    def message_class(self) -> Any:
        return message_class_of(self.schema)

    def field_path(self, name: str) -> list[Any]:
        """Descriptors of the field "name", or of all in "name.of.a.nested.one"; empty if there
        is no such field.
        """
        descriptor = self.message_class.DESCRIPTOR
        fields = list[Any]()
        for component in name.split("."):
            descriptor_of_field = (
                descriptor.fields_by_name.get(component) if descriptor is not None else None
            )
            if descriptor_of_field is None:
                return []
            fields.append(descriptor_of_field)
            descriptor = descriptor_of_field.message_type
        return fields

    def columns(self, names: Sequence[str]) -> list[npt.NDArray[Any] | list[Any]]:
        """Values of fields ("pose.position.x"), n each, None where unset; ValueError: malformed,
        or no single value.
        """
        paths = [self.field_path(name) for name in names]
        for name, (*_, last) in zip(names, paths, strict=True):
            if last.is_repeated or last.message_type is not None:
                raise ValueError(f"field {name} holds no single value")
        records = self._fixed_records()
        if records is not None:
            return [records[name].copy() for name in names]
        named_paths = [[(field.name, field.has_presence) for field in path] for path in paths]
        columns: list[Any] = [[] for _ in names]
        for message in map(self.message_class.FromString, self.data):
            for values, path in zip(columns, named_paths, strict=True):
                values.append(_value(message, path))
        return columns

    def _fixed_records(self) -> npt.NDArray[Any] | None:
        """Messages with a number of eight bytes in every field, as those of a flight, as records,
        shape (n,); None if some are others.
        """
        layout = fixed_layout(self.message_class)
        if not layout or {len(data) for data in self.data} != {len(layout.example)}:
            return None
        records = np.frombuffer(b"".join(self.data), layout.dtype)
        message_bytes = records.view(np.uint8).reshape(records.size, -1)
        example = np.frombuffer(layout.example, np.uint8)
        return records if np.all(message_bytes[:, layout.tags] == example[layout.tags]) else None

    def table(self, names: Sequence[str]) -> Floats:
        """Numbers by the names of their fields, NaN for what is absent, read-only, shape (n,
        len(names)).
        """
        result = np.empty((len(self.data), len(names)))
        for k, values in enumerate(self.columns(names)):
            result[:, k] = values
        result.flags.writeable = False
        return result


def _value(message: Any, path: list[tuple[str, bool]]) -> Any:
    """The value at a path of names, each with whether it may be unset; None where it is."""
    for name, has_presence in path:
        if has_presence and not message.HasField(name):
            return None
        message = getattr(message, name)
    return message


class Contents:
    """What a log holds; of topics that `select` refuses (by name and empty channel), the times of
    messages alone.

    LogError if it cannot be read, is no MCAP file or is damaged, decompresses to more than is
    plausible, or a topic has messages of several types.
    """

    def __init__(
        self, path: Path, select: Callable[[str, Messages], bool] = lambda topic, messages: True
    ) -> None:
        self.path = path
        self.attachments = dict[str, bytes]()
        self.topics = dict[str, Messages]()
        self.metadata = dict[str, dict[str, str]]()
        # parts that no checksum covers, so that damage to them cannot be noticed
        self.unverified: tuple[str, ...] = ()
        self._select = select
        self._schemas = dict[int, Schema]()
        self._channels = dict[int, Messages]()
        with log_errors(path):
            self._read()
            for messages in self.topics.values():
                messages.sort()

    def _read(self) -> None:
        """Take in all records of the file."""
        chunks = 0
        unchecked = 0
        for ordinal, record in enumerate(_records(self.path)):
            match record:
                case Message():
                    self._channels[record.channel_id].append(record, ordinal)
                case Schema():
                    self._schemas.setdefault(record.id, record)
                case Channel():
                    self._register(record)
                case Attachment():
                    self.attachments[record.name] = record.data
                case Metadata():
                    self.metadata[record.name] = record.metadata
                case Chunk():
                    chunks += 1
                    unchecked += not record.uncompressed_crc
                case DataEnd() if not record.data_section_crc:
                    self.unverified = ("metadata",)
                    if unchecked:
                        self.unverified += (f"{unchecked} of {chunks} chunks",)

    def _register(self, channel: Channel) -> None:
        """Take in a channel; several of one topic are one. LogError if their types differ."""
        if channel.id in self._channels:
            return
        new = Messages(self._schemas.get(channel.schema_id), channel.message_encoding)
        registered = self.topics.setdefault(channel.topic, new)
        self._channels[channel.id] = registered
        if registered is new:
            new.holds_data = self._select(channel.topic, new)
        elif registered.type_id != new.type_id:
            raise LogError(
                f"{self.path}: channel {channel.topic} has messages of two types; it may have one"
            )

    def cut(self, end_ns: int) -> None:
        """Leave out messages from a time on [ns]."""
        for messages in self.topics.values():
            if not messages.holds_data:
                # times alone are in order of recording
                messages.times = array("q", [time for time in messages.times if time < end_ns])
                continue
            number = int(np.searchsorted(messages.time_ns, end_ns))
            del messages.times[number:]
            del messages.data[number:]
            del messages.ordinals[number:]

    def mission_start_ns(self) -> int | None:
        """Start of the mission, as the log states it: the epoch of its scenario, or the metadata
        record of its clock [ns]; None: it does not.
        """
        if SCENARIO in self.attachments:
            return Clock(
                scenario_file.parse(self.attachments[SCENARIO].decode(), SCENARIO)["epoch"]
            ).epoch_ns
        stated = self.metadata.get(CLOCK, {}).get(START, "")
        return int(stated) if re.fullmatch(r"[0-9]{1,19}", stated) else None

    def start_ns(self) -> int:
        """Zero of times of the log that are given in seconds [ns].

        The start of the mission where the log states it; without, the first message of any channel
        if its time is a date, and else zero: such times already count from a start.
        """
        stated = self.mission_start_ns()
        if stated is not None:
            return stated
        first = min((min(m.times) for m in self.topics.values() if m.times), default=0)
        return first if first >= _FIRST_DATE_NS else 0

    def require(self, topic: str, names: Sequence[str], empty_schema: Any = None) -> Messages:
        """The messages of a topic that have fields of these names.

        `empty_schema` is that of a channel which may have no message and then is not in the file;
        None: it must be there. LogError if there is no such channel or field.
        """
        messages = self.topics.get(topic, empty_schema and Messages(empty_schema))
        if messages is None:
            raise LogError(
                f"{self.path}: lacks channel {topic}; available: "
                f"{', '.join(sorted(self.topics)) or 'none'}"
            )
        if not messages.is_protobuf:
            encoding = f"{messages.encoding!r}{'' if messages.schema else ' without a schema'}"
            raise LogError(
                f"{self.path}: channel {topic} is encoded as {encoding}, expected protobuf and its "
                "schema"
            )
        if missing := [name for name in names if not messages.field_path(name)]:
            fields = ", ".join(f.name for f in messages.message_class.DESCRIPTOR.fields)
            raise LogError(
                f"{self.path}: channel {topic} lacks {', '.join(missing)}; its fields: {fields}"
            )
        return messages


def holds_messages(path: Path) -> bool:
    """Whether a message is readable before the first damage."""
    try:
        return any(isinstance(record, Message) for record in _records(path))
    except LogError:
        return False


class _Copy:
    """A finished log that grows from the intact records of a damaged one."""

    def __init__(self, stream: IO[bytes], summary: SummarySection) -> None:
        # the library's own writer keeps all that a record holds
        self._writer = Writer(
            stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer.start()
        self._schema_ids = {0: 0}
        self._channel_ids = dict[int, int]()
        # schemas and channels of a broken chunk stand in the summary again
        self._summary_records = {
            Schema: {record.id: record for record in summary.of(Schema)},
            Channel: {record.id: record for record in summary.of(Channel)},
        }
        # messages of one time that are not yet written, for a gap may follow within them
        self._instant = list[Message]()
        self.metadata = dict[str, dict[str, str]]()
        self.times_ns = array("Q")
        self.attachments = 0
        self.undescribed = 0  # messages of a channel that no intact record describes
        # just after the last complete instant before the first gap [ns]
        self.first_gap_ns: int | None = None
        self._gap_pending = False

    def _add_schema(self, record: Schema) -> None:
        if record.id not in self._schema_ids:
            self._schema_ids[record.id] = self._writer.register_schema(
                record.name, record.encoding, record.data
            )

    def _add_channel(self, record: Channel) -> None:
        if record.id in self._channel_ids:
            return
        if record.schema_id in self._summary_records[Schema]:
            self._add_schema(self._summary_records[Schema][record.schema_id])
        self._channel_ids[record.id] = self._writer.register_channel(
            record.topic,
            record.message_encoding,
            self._schema_ids.get(record.schema_id, 0),
            record.metadata,
        )

    def _add_message(self, record: Message) -> None:
        if record.channel_id not in self._channel_ids:
            described = self._summary_records[Channel].get(record.channel_id)
            if described is None:
                self.undescribed += 1
                return
            self._add_channel(described)
        if self._instant and self._instant[0].log_time != record.log_time:
            self.write_instant()
        if self._gap_pending:
            self._gap_pending = False
            if self.first_gap_ns is None:
                self.first_gap_ns = max(self.times_ns, default=-1) + 1
        self._instant.append(record)

    def add(self, record: McapRecord) -> None:
        if isinstance(record, Message):
            self._add_message(record)
        elif isinstance(record, Schema):
            self._add_schema(record)
        elif isinstance(record, Channel):
            self._add_channel(record)
        elif isinstance(record, Attachment):
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
            self.attachments += 1
        elif isinstance(record, Metadata):
            self._writer.add_metadata(record.name, record.metadata)
            self.metadata[record.name] = record.metadata

    def mark_gap(self) -> None:
        """Note that messages are missing at this place; the last instant of a flight before it may
        lack some, and is dropped.
        """
        self._gap_pending = True
        if FLIGHT in self.metadata:
            self._instant.clear()
        else:
            self.write_instant()

    def write_instant(self) -> None:
        for m in self._instant:
            self._writer.add_message(
                self._channel_ids[m.channel_id], m.log_time, m.data, m.publish_time, m.sequence
            )
            self.times_ns.append(m.log_time)
        self._instant.clear()

    def finish(self, is_complete: bool, remarks: Sequence[str]) -> None:
        """Write the rest, the facts of an interrupted flight and the remarks, and close the log.

        `is_complete` tells whether the data section is there to its end.
        """
        if is_complete or FLIGHT not in self.metadata:
            self.write_instant()
        if FLIGHT in self.metadata and (not is_complete or self.first_gap_ns is not None):
            # of records with one name, the last one counts
            facts = self.metadata[FLIGHT] | {"outcome": _INTERRUPTED}
            if self.first_gap_ns is not None:
                facts[FIRST_GAP] = str(self.first_gap_ns)
            self._writer.add_metadata(FLIGHT, facts)
        if remarks:
            self._writer.add_metadata("recovery", {str(i): text for i, text in enumerate(remarks)})
        self._writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare


def _salvage(salvage: Salvage, copy: _Copy, remarks: list[str]) -> tuple[list[Damage], bool]:
    """Copy all that is intact; the damage, and whether the end of the data section was found."""
    damages = list[Damage]()
    is_complete = False
    for item in salvage:
        if isinstance(item, DamagedAttachment):
            remarks.append(f"attachment {item.name!r} is damaged and is left out")
        elif isinstance(item, Damage):
            damages.append(item)
            if item.loses_messages and not is_complete:
                copy.mark_gap()
        else:
            # `Salvage` yields no record after DataEnd
            is_complete = isinstance(item, DataEnd)
            copy.add(item)
    return damages, is_complete


def _copy(path: Path, target: Path, remarks: list[str]) -> list[str]:
    """Write what is intact as a finished log; returns what is wrong with the log."""
    size = path.stat().st_size
    with path.open("rb") as source:
        if source.read(MAGIC_SIZE) != MAGIC:
            raise LogError(f"{path}: no MCAP file")
        with (
            mmap.mmap(source.fileno(), 0, access=mmap.ACCESS_READ) as data,
            target.open("wb") as stream,
        ):
            salvage = Salvage(data, _DECOMPRESSED_BASE_BYTES + _DECOMPRESSED_PER_BYTE * size)
            copy = _Copy(stream, salvage.summary)
            damages, is_complete = _salvage(salvage, copy, remarks)
            problems = [f"damaged or cut off at byte {d.at}: {d.reason}" for d in damages]
            if copy.metadata and not is_complete:
                remarks.append(
                    f"metadata {', '.join(copy.metadata)}: no checksum, damage cannot be detected"
                )
            copy.finish(is_complete, remarks)
    if problems and not copy.times_ns:
        qualifier = " whose channel is described" if copy.undescribed else ""
        raise LogError(
            f"{path}: holds no intact message{qualifier} ({problems[0]}); there is nothing to "
            "recover"
        )
    promised = salvage.summary.message_count
    has_lost_messages = promised is not None and promised > len(copy.times_ns)
    remarks += _count_lines(copy, f" of {promised}" if has_lost_messages else "")
    if has_lost_messages and not problems:
        problems = [f"the summary promises {promised} messages"]
    remarks += [f"left out: {problem}" for problem in problems[:_MAX_NAMED_PLACES]]
    if len(problems) > _MAX_NAMED_PLACES:
        remarks.append(f"left out: {len(problems) - _MAX_NAMED_PLACES} more places")
    return problems


def _count_lines(copy: _Copy, of_promised: str) -> list[str]:
    """How much a copy holds, and what it lacks for want of a description."""
    span_s = np.ptp(copy.times_ns) / 1e9 if copy.times_ns else 0.0
    number = len(copy.times_ns)
    lines = [
        f"kept {number}{of_promised} messages of {span_s:g} s and {copy.attachments} attachments"
    ]
    if copy.undescribed:
        lines.append(
            f"left out: {copy.undescribed} messages of channels that no intact record describes"
        )
    return lines


def recovered_path(path: Path) -> Path:
    """The file that `recover` writes for a log."""
    if path.suffix == _PARTIAL:
        return path.with_suffix("")
    return path.with_name(f"{path.stem}.recovered{path.suffix}")


def recover(path: Path, report: Callable[[str], None] = lambda remark: None) -> Path:
    """Finish a log with all its intact records, also those behind broken ones; the path of the
    result.

    A flight that was cut off ends with its last complete instant, with the outcome "interrupted";
    one with a gap is read as a flight up to the gap, and its measurements to the end.
    An unfinished log, "NAME.partial", becomes NAME; a damaged one stays beside "NAME.recovered" +
    suffix. `report` takes remarks. LogError if the log is complete, or holds no intact message, or
    the result cannot be written.
    """
    if not path.is_file():
        raise LogError(f"{path}: no such file")
    unfinished = path.suffix == _PARTIAL
    remarks = list[str]()
    target = recovered_path(path)
    try:
        with atomic_write(target) as work:
            problems = _copy(path, work, remarks)
            if not problems and not unfinished:
                raise LogError(f"{path}: is complete; there is nothing to recover")
            if not problems:
                # complete, only not renamed: keep its bytes instead of the copy's
                os.replace(path, work)
    except OSError as error:
        raise LogError(f"{target}: cannot be written: {error.strerror or error}") from error
    if unfinished:
        path.unlink(missing_ok=True)
    for text in remarks if problems else ():
        report(text)
    return target

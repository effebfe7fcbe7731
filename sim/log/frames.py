"""Records of an MCAP file by their frames: kind, length, content. Records behind a broken one are
found again.

A record may be longer than its known fields; the rest is for later versions of the format and is
passed over.
"""

import mmap
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # kind and length of a record
# the footer record and the magic behind it
_FOOTER_BYTES = _HEAD.size + 20 + len(MAGIC)
_DATA_END_BYTES = _HEAD.size + 4
_PRIVATE = 0x80  # kinds from here on belong to the writing program
# compression stands behind start time, end time and uncompressed size, of eight bytes each, and a
# checksum of four
_COMPRESSION_AT = _HEAD.size + 28
_COMPRESSION = re.compile(rb"\x04\0\0\0zstd|\x03\0\0\0lz4")
_CHUNK_FIELD_BYTES = 40  # bytes of a chunk beside compression and data
_BLOCK = 1 << 20  # bytes that a checksum takes at once
_READERS: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.HEADER: Header.read,
    Opcode.FOOTER: Footer.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
    Opcode.DATA_END: DataEnd.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.STATISTICS: Statistics.read,
}
_KINDS = frozenset(int(kind) for kind in Opcode)

FileBytes = bytes | mmap.mmap  # of a whole file, in memory or mapped


def parsed(kind: int, content: bytes) -> McapRecord | None:
    """The record of a kind, None for kinds that are not used; errors of the library if it is
    malformed.
    """
    stream = ReadDataStream(BytesIO(content))
    if kind == Opcode.MESSAGE:
        message: Message = Message.read(stream, len(content))
        return message
    reader = _READERS.get(kind)
    record: McapRecord | None = reader(stream) if reader is not None else None
    return record


def chunk_data(chunk: Chunk, max_size: int) -> bytes:
    """What a chunk holds, of at most so many bytes, after its checksum was verified; ValueError if
    it is too large, of unknown compression or damaged.

    It is decompressed as a stream: at once, any size that the chunk states would be allocated.
    """
    size = chunk.uncompressed_size
    data = chunk.data
    if size > max_size:
        raise ValueError(f"a chunk of {len(data)} bytes would decompress to {size}, too many")
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
    elif chunk.compression == "lz4":
        data = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    elif chunk.compression:
        raise ValueError(
            f"a chunk is compressed by {chunk.compression!r}; expected zstd, lz4 or nothing"
        )
    if len(data) != size:
        raise ValueError("the size of a chunk does not match")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk does not match")
    return data


def records_of(chunk: Chunk, max_size: int) -> list[McapRecord]:
    """Schemas, channels and messages of a chunk; errors as of `chunk_data`, and of the library."""
    data = chunk_data(chunk, max_size)
    records = list[McapRecord]()
    offset = 0
    while offset < len(data):
        if offset + _HEAD.size > len(data):
            raise ValueError("a chunk ends within a record")
        kind, length = _HEAD.unpack_from(data, offset)
        begin = offset + _HEAD.size
        offset = begin + length
        if offset > len(data):
            raise ValueError("a record is longer than its chunk")
        if kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            record = parsed(kind, data[begin:offset])
            assert record is not None
            records.append(record)
    return records


def intact_attachment(content: bytes) -> bool:
    """Whether the checksum of an attachment matches; 0 stands for none."""
    (stored,) = struct.unpack("<I", content[-4:])
    return stored in (0, zlib.crc32(content[:-4]))


@dataclass(frozen=True)
class Damage:
    """A stretch of a file that holds no intact record."""

    at: int  # byte
    reason: str
    loses_messages: bool  # whether messages may have stood there


@dataclass(frozen=True)
class DamagedAttachment:
    name: str


@dataclass
class SummarySection:
    """What stands behind the data of a finished file; empty if that is damaged."""

    start: int = 0  # byte; 0: there is none, or offsets are of no use
    records: list[McapRecord] = field(default_factory=list)

    def of(self, kind: type) -> list[Any]:
        return [record for record in self.records if isinstance(record, kind)]

    @property
    def message_count(self) -> int | None:
        return next((record.message_count for record in self.of(Statistics)), None)

    @property
    def offsets(self) -> list[int]:
        """Bytes at which the file has a chunk, an attachment, metadata or the end of its data."""
        indices = (ChunkIndex, AttachmentIndex, MetadataIndex)
        begins = [
            record.chunk_start_offset if isinstance(record, ChunkIndex) else record.offset
            for record in self.records
            if isinstance(record, indices)
        ]
        if self.start:
            begins.append(self.start - _DATA_END_BYTES)
        return sorted(begins)


def _summary_at(data: FileBytes, start: int, footer: Footer) -> list[McapRecord]:
    """Records of a summary that begins at a byte; none if its checksum does not match."""
    footer_at = len(data) - _FOOTER_BYTES
    if not 0 < start <= footer_at:
        return []
    checked = data[start : len(data) - len(MAGIC) - 4]
    if footer.summary_crc not in (0, zlib.crc32(checked)):
        return []
    return [record for record in _parsed_records(data[start:footer_at]) if record is not None]


def summary_of(data: FileBytes) -> SummarySection:
    """The summary of a file, if it is intact.

    Where bytes before it were lost or added, it is not where the footer has it: it is looked for
    behind the last record of the end of data, and only its records without offsets are kept.
    """
    size = len(data)
    try:
        if size < _FOOTER_BYTES or data[size - len(MAGIC) :] != MAGIC:
            return SummarySection()
        footer_at = size - _FOOTER_BYTES
        footer = Footer.read(ReadDataStream(BytesIO(data[footer_at + _HEAD.size :])))
        if records := _summary_at(data, footer.summary_start, footer):
            return SummarySection(footer.summary_start, records)
        start = data.rfind(_HEAD.pack(Opcode.DATA_END, 4)) + _DATA_END_BYTES
        without_offsets = (Schema, Channel, Statistics)
        summary = _summary_at(data, start, footer)
        return SummarySection(
            0, [record for record in summary if isinstance(record, without_offsets)]
        )
    except Exception:
        # foreign bytes make the library fail in many ways
        return SummarySection()


def _parsed_records(data: bytes) -> Iterator[McapRecord | None]:
    offset = 0
    while offset + _HEAD.size <= len(data):
        kind, length = _HEAD.unpack_from(data, offset)
        yield parsed(kind, data[offset + _HEAD.size : offset + _HEAD.size + length])
        offset += _HEAD.size + length


def _is_chunk_at(data: FileBytes, offset: int) -> bool:
    """Whether a chunk of consistent lengths begins at a byte."""
    if offset < 0 or offset + _HEAD.size + _CHUNK_FIELD_BYTES > len(data):
        return False
    kind, length = _HEAD.unpack_from(data, offset)
    if kind != Opcode.CHUNK or offset + _HEAD.size + length > len(data):
        return False
    (name_length,) = struct.unpack_from("<I", data, offset + _COMPRESSION_AT)
    data_at = offset + _COMPRESSION_AT + 4 + name_length
    if name_length > 16 or data_at + 8 > len(data):
        return False
    (data_length,) = struct.unpack_from("<Q", data, data_at)
    return bool(_CHUNK_FIELD_BYTES + name_length + data_length == length)


def _next_record(data: FileBytes, after: int, summary: SummarySection) -> int | None:
    """Byte of the next record that can be found behind a broken one."""
    indexed = next((offset for offset in summary.offsets if offset > after), None)
    limit = len(data) if indexed is None else min(len(data), indexed + _COMPRESSION_AT)
    for match in _COMPRESSION.finditer(data, after, limit):
        chunk_offset = match.start() - _COMPRESSION_AT
        if chunk_offset > after and _is_chunk_at(data, chunk_offset):
            return chunk_offset
    return indexed


@dataclass
class _Frame:
    at: int
    end: int  # byte behind it
    kind: int
    content: bytes


def _frame(data: FileBytes, offset: int) -> _Frame | str:
    """The frame that begins at a byte, or why there is none."""
    if offset + _HEAD.size > len(data):
        return "the file ends within a record"
    kind, length = _HEAD.unpack_from(data, offset)
    end = offset + _HEAD.size + length
    if kind not in _KINDS and kind < _PRIVATE:
        return "a record is of no known kind"
    if end > len(data):
        return "the file ends within a record"
    if kind == Opcode.CHUNK and not _is_chunk_at(data, offset):
        return "the lengths in a chunk do not match"
    return _Frame(offset, end, kind, data[offset + _HEAD.size : end])


def _checksum(data: FileBytes, end: int) -> int:
    """CRC-32 of the first `end` bytes."""
    crc = 0
    for begin in range(0, end, _BLOCK):
        crc = zlib.crc32(data[begin : min(begin + _BLOCK, end)], crc)
    return crc


class Salvage:
    """All intact records of a file in order, with the damage between them.

    Iteration gives records, those of a chunk one by one, `Damage` and `DamagedAttachment`.
    `max_size` is what all chunks may decompress to [bytes].
    """

    def __init__(self, data: FileBytes, max_size: int) -> None:
        self.summary = summary_of(data)
        self._data = data
        self._bytes_left = max_size
        self._damaged = False

    def _damage(self, offset: int, end: int, reason: str) -> Damage:
        self._damaged = True
        chunks = self.summary.of(ChunkIndex)
        lost_chunks = [chunk for chunk in chunks if offset <= chunk.chunk_start_offset < end]
        if lost_chunks:
            begin_ns = min(chunk.message_start_time for chunk in chunks)
            first = (min(chunk.message_start_time for chunk in lost_chunks) - begin_ns) / 1e9
            last = (max(chunk.message_end_time for chunk in lost_chunks) - begin_ns) / 1e9
            reason = f"{reason} (messages from {first:g} s to {last:g} s)"
        return Damage(offset, reason, bool(lost_chunks) or not chunks)

    def _contents(self, frame: _Frame) -> list[McapRecord | Damage | DamagedAttachment]:
        """What a frame holds; errors of the library if that is malformed."""
        record = parsed(frame.kind, frame.content)
        if isinstance(record, Chunk):
            records = records_of(record, self._bytes_left)
            self._bytes_left -= record.uncompressed_size
            return [*records]
        if isinstance(record, Attachment) and not intact_attachment(frame.content):
            return [DamagedAttachment(record.name)]
        if isinstance(record, DataEnd):
            stored = record.data_section_crc
            if stored and not self._damaged and stored != _checksum(self._data, frame.at):
                reason = "the checksum of the data section does not match"
                return [self._damage(frame.at, frame.at, reason), record]
        return [] if record is None else [record]

    def __iter__(self) -> Iterator[McapRecord | Damage | DamagedAttachment]:
        offset = len(MAGIC)
        while True:
            frame = _frame(self._data, offset)
            if isinstance(frame, str):
                following = _next_record(self._data, offset, self.summary)
                yield self._damage(offset, following or len(self._data), frame)
                if following is None:
                    return
                offset = following
                continue
            try:
                items = self._contents(frame)
            except Exception as error:
                # foreign bytes make decompressors and decoders fail in many ways
                items = [self._damage(offset, frame.end, str(error) or "a record is malformed")]
            yield from items
            offset = frame.end
            if frame.kind == Opcode.DATA_END:
                yield from self._tail(offset)
                return

    def _tail(self, offset: int) -> Iterator[Damage]:
        """What is wrong behind the data section."""
        while True:
            frame = _frame(self._data, offset)
            if isinstance(frame, str):
                yield Damage(offset, frame, False)
                return
            offset = frame.end
            if frame.kind == Opcode.FOOTER:
                break
        if self._data[offset : offset + len(MAGIC)] != MAGIC:
            yield Damage(offset, "the file ends within a record", False)
        elif offset + len(MAGIC) < len(self._data):
            yield Damage(offset + len(MAGIC), "bytes follow the end of the log", False)

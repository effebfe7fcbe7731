"""The MCAP file under a log: its names, its errors, and one pass over its records that verifies every checksum."""

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader

from laisn.failure import LaisnError

SCENARIO, VEHICLES, SUMMARY, VERSIONS = "scenario.toml", "vehicles.json", "summary.json", "versions.json"
"""Attachments of a log."""
FLIGHT = "laisn"
"""Metadata record by which the log of a flight is known."""
_ALLOWANCE, _RATIO = 8 << 20, 16
"""A file of n bytes may decompress to 8 MiB + 16 n; flights decompress to 6 n."""
_MAGIC = 8
"""Length of the bytes that every MCAP file begins and ends with."""
_LOOSE = Message, Schema, Channel
"""Records that may stand outside of chunks."""
_BLOCK = 4 << 20
"""Size from which on records outside of chunks are taken together [bytes]."""


class LogError(LaisnError):
    """A log that cannot be written or read; the text says which file, what is wrong and what helps."""


class DamagedError(LogError):
    """A record is broken; the text says which, and where."""

    def __init__(self, path: Path, problem: str) -> None:
        self.problem = problem
        super().__init__(f"{path}: {problem}; laisn log recover keeps what is intact")


def partial_path(path: Path) -> Path:
    """The name that a log grows under until it is complete."""
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
        # foreign bytes make decompressors, decoders and arrays fail in many ways; to the user they are one
        raise LogError(f"{path}: damaged, or written by something else ({type(error).__name__}: {error})") from error


def _check_attachment(stream: IO[bytes], attachment: Attachment) -> None:
    """Verify the checksum of an attachment that was just read; the library skips it. 0 stands for none."""
    stream.seek(-4, os.SEEK_CUR)
    stored, builder = stream.read(4), RecordBuilder()
    attachment.write(builder)
    if stored not in (bytes(4), builder.end()[-4:]):  # type: ignore[no-untyped-call]  # the library leaves it bare
        raise ValueError(f"the checksum of attachment {attachment.name!r} does not match")


def _decompressed(chunk: Chunk, most: int) -> Chunk:
    """A chunk decompressed as a stream: at once, any size that it states would be allocated."""
    size = chunk.uncompressed_size
    if size > most:
        raise ValueError(f"a chunk of {len(chunk.data)} bytes would decompress to {size}, too many")
    data = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
    elif chunk.compression == "lz4":
        data = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    elif chunk.compression:
        raise ValueError(f"a chunk is compressed by {chunk.compression!r}; expected zstd, lz4 or nothing")
    if len(data) != size or chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("the size or the checksum of a chunk does not match")
    return replace(chunk, compression="", data=data)


def _verified(stream: IO[bytes], record: McapRecord | None, left: int, ended: bool) -> McapRecord | None:
    """A record that was just read, a chunk decompressed, if it is intact and stands in its place."""
    if record is None and stream.read(1):
        raise ValueError("bytes follow the end of the log")
    if isinstance(record, Footer) and not ended:
        raise ValueError("the data section has no end")
    if isinstance(record, Attachment):
        _check_attachment(stream, record)
    return _decompressed(record, left) if isinstance(record, Chunk) else record


def records(path: Path, on_damaged: Callable[[str], None] | None = None) -> Iterator[McapRecord]:
    """The data section of an MCAP file in order, each record after its checksum was verified.

    Metadata have no checksum but that of the section as a whole, at its end.

    Args:
        path: the file.
        on_damaged: is called for a damaged attachment, which is left out; None: it raises.

    Yields:
        Attachments, metadata, chunks with their decompressed bytes, and the end of the section. Records outside of
        chunks come as chunks too.

    Raises:
        DamagedError: the first record that is broken, or the missing end of the file.
        LogError: the file cannot be read, or is no MCAP file.
    """
    with faults(path), path.open("rb") as stream:
        size, loose, problem, ended = path.stat().st_size, RecordBuilder(), None, False
        left = _ALLOWANCE + _RATIO * size
        # no record is longer than its file
        found = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size).records
        record: McapRecord | None = Message(0, 0, b"", 0, 0)
        while record is not None:
            at, record = stream.tell(), None
            try:
                record = next(found, None)
                record = _verified(stream, record, left, ended)
            except Exception as error:
                # the library fails in many ways on bytes that are no record
                if isinstance(error, OSError):
                    raise
                if size < _MAGIC or (isinstance(error, InvalidMagic) and at == 0):
                    raise LogError(f"{path}: no MCAP file") from error
                if isinstance(record, Attachment) and on_damaged is not None:
                    on_damaged(f"attachment {record.name!r} is damaged and is left out")
                    continue
                reason = str(error)
                if isinstance(error, CRCValidationError):
                    reason = "the checksum of the data section does not match"
                elif isinstance(error, (EndOfFile, struct.error)):
                    reason = "the file ends within a record"
                problem = DamagedError(path, f"damaged or cut off at byte {at}: {reason}")
                problem.__cause__, record = error, None
            if isinstance(record, _LOOSE) and not ended:
                record.write(loose)
            if loose.count > (_BLOCK if isinstance(record, _LOOSE) else 0):
                data = loose.end()  # type: ignore[no-untyped-call]  # the library leaves it bare
                yield Chunk("", data, 0, 0, 0, len(data))
            if isinstance(record, Chunk):
                left -= len(record.data)
            if isinstance(record, (Chunk, Attachment, Metadata, DataEnd)):
                yield record
            ended = ended or isinstance(record, DataEnd)
        if problem is not None:
            raise problem

"""The MCAP file under a log: names and integrity."""

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode

from laisn.failure import LaisnError
from sim.log.records import (
    HEAD,
    MAGIC,
    DamagedError,
    attachment_crc,
    attachment_name,
    places,
    read_content,
)

FOOTER_BYTES = HEAD.size + 8 + 8 + 4
DATA_END_BYTES = HEAD.size + 4

SCENARIO, VEHICLES, SUMMARY, VERSIONS = "scenario.toml", "vehicles.json", "summary.json", "versions.json"
"""Attachments of a log."""
LARGEST_ATTACHMENT = 64 << 20
"""Larger ones are not looked at [bytes]."""
_CHECKED = {Opcode.ATTACHMENT, Opcode.CHUNK, Opcode.DATA_END, Opcode.FOOTER}
"""Kinds of records that hold a checksum."""


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
    except DamagedError as error:
        raise LogError(f"{path}: damaged: {error}") from error
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
    """Offset at which the first whole MCAP file in a stream ends, whatever follows it; None if there is no such end."""
    end = 0
    try:
        for place in places(stream, {Opcode.FOOTER}):
            end = place.start + place.length
    except EOFError:
        return None
    stream.seek(end)
    return end + len(MAGIC) if stream.read(len(MAGIC)) == MAGIC else None


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


def unprotected(path: Path) -> list[str]:
    """What in a file, as far as its records are whole, has no checksum; damage to it would go unnoticed."""
    attachments: list[str] = []
    others: list[str] = []
    chunks = bare_chunks = 0
    with path.open("rb") as stream, suppress(EOFError):
        for place in places(stream, _CHECKED):
            if place.opcode == Opcode.ATTACHMENT and place.length <= LARGEST_ATTACHMENT:
                content = read_content(stream, place)
                attachments += [] if attachment_crc(content) else [f"attachment {attachment_name(content)}"]
            elif place.opcode == Opcode.CHUNK:
                chunks += 1
                bare_chunks += not int.from_bytes(read_content(stream, place, 28)[24:], "little")
            elif place.opcode == Opcode.DATA_END:
                others += [] if any(read_content(stream, place)) else ["the data as a whole"]
            elif place.opcode == Opcode.FOOTER:
                others += [] if any(read_content(stream, place)[16:]) else ["the summary"]
    return attachments + ([f"{bare_chunks} of {chunks} chunks"] if bare_chunks else []) + others

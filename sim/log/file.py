"""The MCAP file under a log: its names, its errors, and one pass over its records that verifies every checksum."""

import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.exceptions import InvalidMagic
from mcap.records import Attachment, Chunk, DataEnd, Footer
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

from laisn.failure import LaisnError

SCENARIO, VEHICLES, SUMMARY, VERSIONS = "scenario.toml", "vehicles.json", "summary.json", "versions.json"
"""Attachments of a log."""
_MAGIC_BYTES = 8
_DATA_END = b"\x0f\x04" + bytes(7)
"""Opcode and length of the record at the end of the data section, which no checksum covers."""
_CHUNK_ALLOWANCE, _CHUNK_RATIO = 16 << 20, 4
_FILE_ALLOWANCE, _FILE_RATIO = 64 << 20, 16
"""A chunk of n bytes may decompress to 16 MiB + 4 n, a file of n bytes to 64 MiB + 16 n in all. Flights decompress to
6 n; as a Python object, the smallest message takes ten times its size."""


class LogError(LaisnError):
    """A log that cannot be written or read; the text says which file, what is wrong and what helps."""


class DamagedError(ValueError):
    """A record is broken, or decompresses to more than is plausible; the text says which, and where."""


class TrailingBytesError(DamagedError):
    """Bytes follow the end of the log."""

    def __init__(self, end: int, extra: int) -> None:
        self.end = end
        super().__init__(f"{extra} bytes follow the end of the log; laisn log recover makes a copy without them")


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
    except DamagedError as error:
        raise LogError(f"{path}: {error}") from error
    except Exception as error:
        # foreign bytes make decompressors, decoders and arrays fail in many ways; to the user they are one
        raise LogError(f"{path}: damaged, or written by something else ({type(error).__name__}: {error})") from error


@dataclass
class Checksums:
    """Which parts of a file have no checksum."""

    attachments: list[str] = field(default_factory=list)
    chunks: int = 0
    bare_chunks: int = 0
    sections: list[str] = field(default_factory=list)

    @property
    def missing(self) -> tuple[str, ...]:
        """Parts whose damage cannot be noticed; a checksum of the data section covers all that stands in it."""
        inside = [f"attachment {name!r}" for name in self.attachments]
        inside += [f"{self.bare_chunks} of {self.chunks} chunks"] if self.bare_chunks else []
        return (*inside, *self.sections)


def _attachment_crc(stream: IO[bytes], attachment: Attachment) -> tuple[int, int]:
    """Checksums of an attachment that was just read: as stored (0: none), and as computed."""
    stream.seek(-4, os.SEEK_CUR)
    stored = stream.read(4)
    builder = RecordBuilder()
    attachment.write(builder)
    computed = builder.end()[-4:]  # type: ignore[no-untyped-call]  # the library leaves it bare
    return int.from_bytes(stored, "little"), int.from_bytes(computed, "little")


def _check_footer(stream: IO[bytes], data_end: int | None, footer: Footer) -> None:
    """Check the end of the data section and the checksum of the summary, after the footer was read."""
    end = stream.tell()
    if data_end is None:
        raise DamagedError("damaged: the data section has no end")
    stream.seek(data_end - len(_DATA_END) - 4)
    intact = stream.read(len(_DATA_END)) == _DATA_END
    stream.seek(data_end)
    computed = zlib.crc32(stream.read(end - 4 - data_end))
    stream.seek(end)
    if not intact or footer.summary_crc not in (0, computed):
        raise DamagedError(f"damaged: the checksum of the summary at byte {data_end} does not match")


def records(
    stream: IO[bytes], checksums: Checksums | None = None, on_damaged: Callable[[str], None] | None = None
) -> Iterator[Any]:
    """All records of an MCAP file in order, chunks compressed as they are, each after its checksum was verified.

    The checksums of the data section and of the summary come at their ends: nothing is verified as a whole before the
    last record was taken.

    Args:
        stream: the file, at its start.
        checksums: collects what has none.
        on_damaged: is called with the name of each attachment whose checksum does not match, which is left out; None:
            it raises.

    Raises:
        DamagedError: the first record that is broken, or the missing end of the file.
    """
    checksums = checksums or Checksums()
    size = os.fstat(stream.fileno()).st_size
    # no record is longer than its file
    found = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=size).records
    data_end: int | None = None
    while True:
        at = stream.tell()
        try:
            record = next(found, None)
        except CRCValidationError as error:
            raise DamagedError(f"damaged: the checksum of the data section, up to byte {at}, does not match") from error
        except OSError:
            raise
        except Exception as error:
            # the reader fails in many ways on bytes that are no record
            if (isinstance(error, InvalidMagic) and at == 0) or size < _MAGIC_BYTES:
                raise DamagedError("no MCAP file") from error
            raise DamagedError(
                f"broken or cut off in the record at byte {at}; laisn log recover rescues what is before it"
            ) from error
        if record is None:
            break
        if isinstance(record, Attachment):
            stored, computed = _attachment_crc(stream, record)
            if stored not in (0, computed):
                if on_damaged is None:
                    raise DamagedError(f"damaged: the checksum of attachment {record.name!r} at byte {at} is wrong")
                on_damaged(record.name)
                continue
            checksums.attachments += [] if stored else [record.name]
        elif isinstance(record, Chunk):
            checksums.chunks += 1
            checksums.bare_chunks += not record.uncompressed_crc
        elif isinstance(record, DataEnd):
            data_end = stream.tell()
            checksums.sections += [] if record.data_section_crc else ["the data section"]
        elif isinstance(record, Footer):
            _check_footer(stream, data_end, record)
            checksums.sections += [] if record.summary_crc else ["the summary"]
        yield record
    if stream.tell() < size:
        raise TrailingBytesError(stream.tell(), size - stream.tell())


class Decompressor:
    """Decompresses the chunks of one file within bounds."""

    def __init__(self, size: int) -> None:
        self._left = _FILE_ALLOWANCE + _FILE_RATIO * size

    def records(self, chunk: Chunk, end: int) -> list[Any]:
        """Messages, schemas and channels of a chunk.

        Args:
            chunk: as `records` yields it.
            end: offset of its end in the file, for messages.

        Raises:
            DamagedError: its size or checksum is wrong, or it decompresses to more than is plausible.
        """
        size, where = chunk.uncompressed_size, f"the chunk before byte {end}"
        self._left -= size
        if size > _CHUNK_ALLOWANCE + _CHUNK_RATIO * len(chunk.data) or self._left < 0:
            raise DamagedError(f"damaged: {where} of {len(chunk.data)} bytes would decompress to {size}, too many")
        try:
            data = _decompressed(chunk, size + 1)
            if len(data) != size:
                raise DamagedError(f"damaged: {where} states {size} bytes and does not have them")
            return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)
        except CRCValidationError as error:
            raise DamagedError(f"damaged: the checksum of {where} does not match") from error
        except DamagedError:
            raise
        except Exception as error:
            raise DamagedError(f"damaged: {where} ({type(error).__name__}: {error})") from error


def _decompressed(chunk: Chunk, most: int) -> bytes:
    """The first bytes of a chunk, decompressed as a stream: at once, any size that it states would be allocated."""
    if chunk.compression == "zstd":
        return zstandard.ZstdDecompressor().stream_reader(chunk.data).read(most)
    if chunk.compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most))
    if chunk.compression:
        raise DamagedError(f"a chunk is compressed by {chunk.compression!r}; expected zstd, lz4 or nothing")
    return chunk.data

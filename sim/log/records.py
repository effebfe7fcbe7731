"""The records of an MCAP file one by one, each checked against its checksum and none larger than it may be."""

import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from io import BytesIO
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""Opcode and length of a record."""
ATTACHMENT_HEAD = struct.Struct("<QQI")
"""Log time, time of creation, and length of the name."""

_BLOCK = 1 << 14
"""Part of a file that is looked through for records at once [bytes]."""
ALLOWANCE, CHUNK_ALLOWANCE, RATIO = 64 << 20, 32 << 20, 16
"""A file of n bytes may unfold to ALLOWANCE + RATIO · n bytes, a chunk to CHUNK_ALLOWANCE + RATIO · n; with the costs
below, flights unfold to some 6 n, and the smallest messages of a vehicle to 8 n."""
READ_SHARE = 16
"""What is unfolded and then dropped costs time, but no memory: a sixteenth of what is kept."""
RECORD_COST, KEPT_COST, PARSED_COST = 50, 100, 2000
"""What a record costs besides its bytes: any, a message that is kept, one that is no message [bytes]."""

_PARSERS: dict[int, Callable[[ReadDataStream], Any]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
}


class DamagedError(ValueError):
    """A record that is not what was written, or would unfold to more than is believable."""


class Place(NamedTuple):
    """Position of a record in the file."""

    opcode: int
    start: int
    """Position of the record's content in the file."""
    length: int


class Budget:
    """How much the chunks and messages of one file may still unfold to."""

    def __init__(self, size: int) -> None:
        self._left = ALLOWANCE + RATIO * size

    def charge(self, amount: int) -> None:
        """Take from what is left; DamagedError if that is too little."""
        self._left -= amount
        if self._left < 0:
            raise DamagedError(
                f"it unfolds to more than {ALLOWANCE >> 20} MiB and {RATIO} times its size, which no vehicle's log does"
            )


def places(stream: IO[bytes], kinds: Collection[int] = range(256)) -> Iterator[Place]:
    """Positions of the records of some kinds, from the first to the footer.

    Raises EOFError where a record runs past the end of the file.
    """
    size, at, opcode = stream.seek(0, 2), len(MAGIC), 0
    block, begin = b"", 0
    while opcode != Opcode.FOOTER:
        if at + HEAD.size > begin + len(block):
            stream.seek(at)
            block, begin = stream.read(_BLOCK), at
        if at + HEAD.size > size:
            raise EOFError("the file ends before its footer")
        opcode, length = HEAD.unpack_from(block, at - begin)
        at += HEAD.size
        if length > size - at:
            raise EOFError("a record goes on behind the end of the file")
        if opcode in kinds:
            yield Place(opcode, at, length)
        at += length


def read_content(stream: IO[bytes], place: Place, most: int | None = None) -> bytes:
    """The bytes of a record, or the first `most` of them."""
    stream.seek(place.start)
    return stream.read(place.length if most is None else min(place.length, most))


def attachment_crc(content: bytes) -> int:
    """The checksum that stands in an attachment; 0: none."""
    return int.from_bytes(content[-4:], "little")


def is_intact(content: bytes) -> bool:
    """Whether an attachment fits its checksum, if it has one."""
    return attachment_crc(content) in (0, zlib.crc32(content[:-4]))


def attachment_name(content: bytes) -> str:
    """The name of an attachment, as far as it can be told."""
    _, _, length = ATTACHMENT_HEAD.unpack_from(content.ljust(ATTACHMENT_HEAD.size, b"\0"))
    return repr(content[ATTACHMENT_HEAD.size :][: min(length, 100)].decode(errors="replace"))


def parse(opcode: int, content: bytes) -> Any:
    """A record that is no message, or None if it is of a kind that holds no data of its own.

    Raises DamagedError if it is an attachment that does not fit its checksum.
    """
    parser = _PARSERS.get(opcode)
    if parser is None:
        return None
    if opcode == Opcode.ATTACHMENT and not is_intact(content):
        raise DamagedError(f"attachment {attachment_name(content)} does not fit its checksum")
    return parser(ReadDataStream(BytesIO(content)))


def unfolded(chunk: Chunk) -> bytes:
    """The bytes in a chunk.

    Raises:
        DamagedError: they are not as many as it says, do not fit its checksum, or are more than is believable.
    """
    size, most = chunk.uncompressed_size, CHUNK_ALLOWANCE + RATIO * len(chunk.data)
    if size > most:
        raise DamagedError(f"a chunk of {len(chunk.data)} bytes would unfold to {size}; at most {most} are believable")
    if chunk.compression == "zstd":
        # as a stream: at once, it would take the frame's own word for its size
        data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise DamagedError(f"a chunk is compressed by {chunk.compression!r}; zstd, lz4 and nothing are known")
    if len(data) != size:
        raise DamagedError(f"a chunk says that it unfolds to {size} bytes, and does not")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise DamagedError("a chunk does not fit its checksum")
    return data

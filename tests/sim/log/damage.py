"""Ways to damage a log, and a program that rewrites it, perhaps with other contents, with correct
checksums.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

Generator = np.random.Generator
MAGIC = b"\x89MCAP0\r\n"


@dataclass
class Parts:
    """What is in a log, in order, and how it is rewritten."""

    attachments: list[Any] = field(default_factory=list)
    metadata: list[Any] = field(default_factory=list)
    messages: list[tuple[Schema | None, Channel, Message]] = field(default_factory=list)
    compression: CompressionType = CompressionType.ZSTD
    chunk_size: int = 1 << 20
    library: str = "another program"

    @classmethod
    def of(cls, data: bytes) -> "Parts":
        reader = make_reader(BytesIO(data))
        return cls(
            attachments=list(reader.iter_attachments()),
            metadata=list(reader.iter_metadata()),
            messages=list(reader.iter_messages(log_time_order=False)),
        )

    def written(self) -> bytes:
        """The log as another program would write it: with fresh checksums."""
        stream = BytesIO()
        writer = Writer(
            stream, chunk_size=self.chunk_size, compression=self.compression, enable_data_crcs=True
        )
        writer.start(library=self.library)
        for a in self.attachments:
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        for m in self.metadata:
            writer.add_metadata(m.name, m.metadata)
        schemas: dict[Any, int] = {}
        channels: dict[Any, int] = {}
        for schema, channel, message in self.messages:
            if schema is not None and schema.name not in schemas:
                schemas[schema.name] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.topic not in channels:
                schema_id = schemas[schema.name] if schema is not None else 0
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id
                )
            writer.add_message(
                channels[channel.topic], message.log_time, message.data, message.publish_time
            )
        writer.finish()  # type: ignore[no-untyped-call]
        return stream.getvalue()


def _stretch(random: Generator, size: int, most: int) -> slice:
    """Fewer than `most` bytes in a row, anywhere in so many."""
    start = int(random.integers(size))
    return slice(start, start + int(random.integers(1, most)))


def flip_bits(data: bytes, random: Generator) -> bytes:
    damaged = bytearray(data)
    for byte_index in random.integers(len(data), size=int(random.integers(1, 6))).tolist():
        damaged[byte_index] ^= 1 << int(random.integers(8))
    return bytes(damaged)


def cut_tail(data: bytes, random: Generator) -> bytes:
    return data[: int(random.integers(len(data)))]


def cut_head(data: bytes, random: Generator) -> bytes:
    rest = data[int(random.integers(1, len(data))) :]
    return rest if random.random() < 0.5 else MAGIC + rest


def zero_stretch(data: bytes, random: Generator) -> bytes:
    damaged = bytearray(data)
    stretch = _stretch(random, len(data), 2000)
    damaged[stretch] = bytes(len(damaged[stretch]))
    return bytes(damaged)


def delete_stretch(data: bytes, random: Generator) -> bytes:
    stretch = _stretch(random, len(data), 5000)
    return data[: stretch.start] + data[stretch.stop :]


def double_stretch(data: bytes, random: Generator) -> bytes:
    stretch = _stretch(random, len(data), 5000)
    return data[: stretch.stop] + data[stretch] + data[stretch.stop :]


KINDS_OF_DAMAGE: list[Callable[[bytes, Generator], bytes]] = [
    flip_bits,
    cut_tail,
    cut_head,
    zero_stretch,
    delete_stretch,
    double_stretch,
]


def damaged(data: bytes, random: Generator) -> tuple[bytes, str]:
    """A log with damage of a random kind, and the name of the kind."""
    damage = KINDS_OF_DAMAGE[int(random.integers(len(KINDS_OF_DAMAGE)))]
    return damage(data, random), damage.__name__

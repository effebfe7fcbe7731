"""Ways to damage a log: blindly, byte by byte, and knowingly, by writing it anew with every checksum right."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
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
    """What is in a log, in order, and how it is to be written anew."""

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
        """The log as another program would write it: proofs and all, with fresh checksums."""
        stream = BytesIO()
        writer = Writer(stream, chunk_size=self.chunk_size, compression=self.compression, enable_data_crcs=True)
        writer.start(library=self.library)
        for a in self.attachments:
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        for m in self.metadata:
            writer.add_metadata(m.name, m.metadata)
        schemas: dict[Any, int] = {}
        channels: dict[Any, int] = {}
        for schema, channel, message in self.messages:
            if schema is not None and schema.name not in schemas:
                schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.topic not in channels:
                type_ = schemas[schema.name] if schema is not None else 0
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, type_)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
        return stream.getvalue()


def _stretch(random: Generator, size: int, most: int) -> slice:
    start = int(random.integers(size))
    return slice(start, start + int(random.integers(1, most)))


def flip_bits(data: bytes, random: Generator) -> bytes:
    damaged = bytearray(data)
    for place in random.integers(len(data), size=int(random.integers(1, 6))).tolist():
        damaged[place] ^= 1 << int(random.integers(8))
    return bytes(damaged)


def cut_tail(data: bytes, random: Generator) -> bytes:
    return data[: int(random.integers(len(data)))]


def cut_head(data: bytes, random: Generator) -> bytes:
    rest = data[int(random.integers(1, len(data))) :]
    return rest if random.random() < 0.5 else MAGIC + rest


def zero_stretch(data: bytes, random: Generator) -> bytes:
    damaged = bytearray(data)
    gone = _stretch(random, len(data), 2000)
    damaged[gone] = bytes(len(damaged[gone]))
    return bytes(damaged)


def delete_stretch(data: bytes, random: Generator) -> bytes:
    gone = _stretch(random, len(data), 5000)
    return data[: gone.start] + data[gone.stop :]


def double_stretch(data: bytes, random: Generator) -> bytes:
    twice = _stretch(random, len(data), 5000)
    return data[: twice.stop] + data[twice] + data[twice.stop :]


BLIND: list[Callable[[bytes, Generator], bytes]] = [
    flip_bits,
    cut_tail,
    cut_head,
    zero_stretch,
    delete_stretch,
    double_stretch,
]


def _altered(data: bytes, random: Generator) -> bytes:
    place = int(random.integers(len(data)))
    return data[:place] + bytes([data[place] ^ (1 << int(random.integers(8)))]) + data[place + 1 :]


def drop_start(parts: Parts, random: Generator) -> None:
    del parts.messages[: int(random.integers(1, len(parts.messages)))]


def drop_end(parts: Parts, random: Generator) -> None:
    del parts.messages[int(random.integers(1, len(parts.messages))) :]


def drop_middle(parts: Parts, random: Generator) -> None:
    del parts.messages[_stretch(random, len(parts.messages), 400)]


def drop_message(parts: Parts, random: Generator) -> None:
    del parts.messages[int(random.integers(len(parts.messages)))]


def double_messages(parts: Parts, random: Generator) -> None:
    twice = _stretch(random, len(parts.messages), 400)
    parts.messages[twice.stop : twice.stop] = parts.messages[twice]


def swap_messages(parts: Parts, random: Generator) -> None:
    a, b = random.integers(len(parts.messages), size=2).tolist()
    first, second = parts.messages[a], parts.messages[b]
    if first[1].topic == second[1].topic:
        parts.messages[a] = (*first[:2], replace(first[2], data=second[2].data))
        parts.messages[b] = (*second[:2], replace(second[2], data=first[2].data))


def alter_message(parts: Parts, random: Generator) -> None:
    i = int(random.integers(len(parts.messages)))
    schema, channel, message = parts.messages[i]
    parts.messages[i] = schema, channel, replace(message, data=_altered(message.data, random))


def shift_times(parts: Parts, random: Generator) -> None:
    late = int(random.integers(-(10**9), 10**9))
    parts.messages = [(s, c, replace(m, log_time=m.log_time + late)) for s, c, m in parts.messages]


def drop_channel(parts: Parts, random: Generator) -> None:
    gone = parts.messages[int(random.integers(len(parts.messages)))][1].topic
    parts.messages = [item for item in parts.messages if item[1].topic != gone]


def rename_channel(parts: Parts, random: Generator) -> None:
    topics = sorted({channel.topic for _, channel, _ in parts.messages})
    a, b = random.choice(topics, 2).tolist()
    new = {a: b, b: a}
    parts.messages = [(s, replace(c, topic=new.get(c.topic, c.topic)), m) for s, c, m in parts.messages]


def alter_attachment(parts: Parts, random: Generator) -> None:
    i = int(random.integers(len(parts.attachments)))
    parts.attachments[i] = replace(parts.attachments[i], data=_altered(parts.attachments[i].data, random))


def drop_attachment(parts: Parts, random: Generator) -> None:
    del parts.attachments[int(random.integers(len(parts.attachments)))]


def drop_metadata(parts: Parts, random: Generator) -> None:
    del parts.metadata[int(random.integers(len(parts.metadata)))]


def drop_last_metadata(parts: Parts, random: Generator) -> None:
    parts.metadata.pop()


def alter_metadata(parts: Parts, random: Generator) -> None:
    i = int(random.integers(len(parts.metadata)))
    record = parts.metadata[i]
    key = str(random.choice(sorted(record.metadata)))
    parts.metadata[i] = replace(record, metadata=record.metadata | {key: record.metadata[key] + "0"})


def write_otherwise(parts: Parts, random: Generator) -> None:
    parts.compression = list(CompressionType)[int(random.integers(3))]
    parts.chunk_size = int(random.integers(1000, 1 << 20))


KNOWING: list[Callable[[Parts, Generator], None]] = [
    drop_start,
    drop_end,
    drop_middle,
    drop_message,
    double_messages,
    swap_messages,
    alter_message,
    shift_times,
    drop_channel,
    rename_channel,
    alter_attachment,
    drop_attachment,
    drop_metadata,
    drop_last_metadata,
    alter_metadata,
    write_otherwise,
]


def damaged(whole: bytes, random: Generator) -> tuple[bytes, list[str]]:
    """A log that one to three things happened to, and their names."""
    names: list[str] = []
    data = whole
    if random.random() < 0.7:
        parts = Parts.of(whole)
        for _ in range(int(random.integers(1, 3))):
            if parts.messages and parts.attachments and parts.metadata:
                knowing = KNOWING[int(random.integers(len(KNOWING)))]
                knowing(parts, random)
                names.append(knowing.__name__)
        data = parts.written()
    if not names or random.random() < 0.4:
        blind = BLIND[int(random.integers(len(BLIND)))]
        data = blind(data, random)
        names.append(blind.__name__)
    return data, names

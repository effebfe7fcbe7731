"""Chunks of a log, byte for byte those of the mcap library, but filled with many messages at once.

The library writes every field of every message by a call of its own. For the hundred thousand messages of a mission
that takes half a second, twice as long as flying it.
"""

import struct
from collections.abc import Sequence
from itertools import chain, islice

from mcap._chunk_builder import ChunkBuilder
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex

from sim.log.records import HEAD

_MESSAGE = struct.Struct("<BQHIQQ")
"""Kind and length of the record, channel, sequence, log time and publish time [ns]."""
_INDEX = struct.Struct("<BQHI")
"""Kind and length of the record, channel, length of the entries."""
CHUNK_BYTES = 1 << 20
"""A chunk is full with more than this [bytes]."""


class _Index(MessageIndex):
    """Where the messages of one channel stand in their chunk."""

    def write(self, stream: RecordBuilder) -> None:
        """Write the record: times and places by turns."""
        size = 16 * len(self.records)
        head = _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX.size - HEAD.size + size, self.channel_id, size)
        stream.write(head + struct.pack(f"<{2 * len(self.records)}Q", *chain.from_iterable(self.records)))


class Chunk(ChunkBuilder):
    """The messages that are compressed together."""

    def extend(self, messages: Sequence[tuple[int, int, bytes]], start: int) -> int:
        """Add messages (time [ns], channel, data), in order of time, from one of them on until the chunk is full.

        Returns:
            Which message comes next.
        """
        indices, place, packed = self.message_indices, self.record_writer.count, []
        for at, channel, data in islice(messages, start, None):
            index = indices.get(channel)
            if index is None:
                index = indices[channel] = _Index(channel_id=channel, records=[])
            index.records.append((at, place))
            record = _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE.size - HEAD.size + len(data), channel, 0, at, at) + data
            packed.append(record)
            place += len(record)
            if place > CHUNK_BYTES:
                break
        if packed:
            first, last = messages[start][0], messages[start + len(packed) - 1][0]
            self.message_start_time = min(self.message_start_time, first) if self.num_messages else first
            self.message_end_time = max(self.message_end_time, last)
            self.num_messages += len(packed)
            self.record_writer.write(b"".join(packed))
        return start + len(packed)

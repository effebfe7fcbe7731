"""Chunks of a log, byte for byte those of the mcap library, but filled with many messages at once.

The library writes every field of every message by a call of its own. For the hundred thousand messages of a mission
that takes half a second, twice as long as flying it.
"""

import struct
from collections.abc import Mapping, Sequence
from itertools import chain, islice

import numpy as np
from mcap._chunk_builder import ChunkBuilder
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex

from laisn.arrays import Ints
from sim.log import wire
from sim.log.records import HEAD

_MESSAGE = struct.Struct("<BQHIQQ")
"""Kind and length of the record, channel, sequence, log time and publish time [ns]."""
_CHANNEL_AT = HEAD.size
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

    def _new_index(self, channel: int) -> MessageIndex:
        self.message_indices[channel] = _Index(channel_id=channel, records=[])
        return self.message_indices[channel]

    def _add(self, packed: bytes | memoryview, count: int, first_ns: int, last_ns: int) -> None:
        """Add the records of messages between two times."""
        self.message_start_time = min(self.message_start_time, first_ns) if self.num_messages else first_ns
        self.message_end_time = max(self.message_end_time, last_ns)
        self.num_messages += count
        self.record_writer.write(packed)

    def extend(self, messages: Sequence[tuple[int, int, bytes]], start: int) -> int:
        """Add messages (time [ns], channel, data), in order of time, from one of them on until the chunk is full.

        Returns:
            Which message comes next.
        """
        indices, place, packed = self.message_indices, self.record_writer.count, []
        for at, channel, data in islice(messages, start, None):
            index = indices.get(channel) or self._new_index(channel)
            index.records.append((at, place))
            record = _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE.size - HEAD.size + len(data), channel, 0, at, at) + data
            packed.append(record)
            place += len(record)
            if place > CHUNK_BYTES:
                break
        if packed:
            self._add(b"".join(packed), len(packed), messages[start][0], messages[start + len(packed) - 1][0])
        return start + len(packed)

    def extend_batch(self, batch: wire.Batch, chosen: Ints, numbers: Mapping[int, int]) -> int:
        """Add messages of a batch, one at least, until the chunk is full.

        Args:
            batch: messages as they lie in a file.
            chosen: which of them, in the order in which to add them.
            numbers: of their channels in this file, by those in the batch.

        Returns:
            How many were added.
        """
        size = batch.stop[chosen] - batch.start[chosen] + _MESSAGE.size
        count = int(np.searchsorted(np.cumsum(size), CHUNK_BYTES - self.count, side="right")) + 1
        some, size = chosen[:count], size[:count]
        at, time_ns = np.cumsum(size) - size, batch.log_time[some]
        packed = wire.gather(batch.data, batch.start[some] - _MESSAGE.size, batch.stop[some])
        # an index stands where its channel comes first
        for number, places in sorted(wire.grouped(batch.channel[some]), key=lambda group: int(group[1][0])):
            own = numbers[number]
            for k, byte in enumerate(own.to_bytes(2, "little")):
                packed[at[places] + _CHANNEL_AT + k] = byte
            index = self.message_indices.get(own) or self._new_index(own)
            index.records += zip(time_ns[places].tolist(), (self.count + at[places]).tolist(), strict=True)
        self._add(packed.data, some.size, int(time_ns.min()), int(time_ns.max()))
        return int(some.size)

"""The writer of logs that prove that they are whole."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import IO

from mcap.records import Schema, Statistics
from mcap.writer import CompressionType, Writer

from laisn.arrays import Ints
from sim.log import wire
from sim.log.chunks import CHUNK_BYTES, Chunk
from sim.log.proof import LIBRARY, PROOF, Digests, Proof, framed, is_core


class ProvingWriter(Writer):
    """Writes an MCAP file, and proofs of what it wrote."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
        # under the names that Python gives to private attributes of the library's class
        self._chunk = self._Writer__chunk_builder = Chunk()
        self._statistics: Statistics = self._Writer__statistics  # type: ignore[attr-defined]
        self._digests = Digests()
        self._known: dict[int, Schema] = {}
        self._topics: dict[int, str] = {}
        self._proofs = 0
        self.start(profile="", library=LIBRARY)

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        self._digests.add_attachment(name, data)
        super().add_attachment(create_time, log_time, name, media_type, data)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record."""
        self._digests.add_metadata(name, data)
        super().add_metadata(name, data)

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Register a message type; returns its number."""
        number = int(super().register_schema(name, encoding, data))
        self._known[number] = Schema(id=number, data=data, encoding=encoding, name=name)
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Register a channel; returns its number."""
        number = int(super().register_channel(topic, message_encoding, schema_id, dict(metadata or {})))
        if is_core(topic):
            self._topics[number] = topic
            self._digests.add_channel(topic, message_encoding, self._known.get(schema_id))
        return number

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Write a message."""
        topic = self._topics.get(channel_id)
        if topic is not None:
            self._digests.add_message(topic, log_time, data)
        super().add_message(channel_id, log_time, data, publish_time, sequence)

    def _count(self, first_ns: int, last_ns: int, messages: Mapping[int, int]) -> None:
        """Take messages between two times, so many of each channel, into the statistics."""
        known = self._statistics
        known.message_start_time = min(known.message_start_time, first_ns) if known.message_count else first_ns
        known.message_end_time = max(known.message_end_time, last_ns)
        known.message_count += sum(messages.values())
        for channel, count in messages.items():
            known.channel_message_counts[channel] += count

    def add_messages(self, messages: Sequence[tuple[int, int, bytes]]) -> None:
        """Write messages (time [ns], channel, data), in order of time: the same bytes as one by one, but quickly."""
        if not messages:
            return
        proved: dict[int, list[bytes]] = {channel: [] for channel in self._topics}
        for at, channel, data in messages:
            if channel in proved:
                proved[channel].append(framed(at, data))
        for channel, parts in proved.items():
            self._digests.add_framed(self._topics[channel], b"".join(parts))
        written = 0
        while written < len(messages):
            written = self._chunk.extend(messages, written)
            if self._chunk.count > CHUNK_BYTES:
                self.flush()  # type: ignore[no-untyped-call]  # the library leaves it bare
        self._count(messages[0][0], messages[-1][0], Counter(channel for _, channel, _ in messages))

    def add_batch(self, batch: wire.Batch, chosen: Ints, numbers: Mapping[int, int]) -> None:
        """Write messages of a batch as they are, and quickly.

        Args:
            batch: messages as they lie in a file.
            chosen: which of them, in the order in which to write them.
            numbers: of their channels in this file, by those in the batch.
        """
        if not chosen.size:
            return
        counts = {}
        for number, places in wire.grouped(batch.channel[chosen]):
            own, its = numbers[number], chosen[places]
            counts[own] = its.size
            if own in self._topics:
                parts = wire.framed(batch.log_time[its], batch.data, batch.start[its], batch.stop[its])
                self._digests.add_framed(self._topics[own], parts.data)
        left = chosen
        while left.size:
            left = left[self._chunk.extend_batch(batch, left, numbers) :]
            if self._chunk.count > CHUNK_BYTES:
                self.flush()  # type: ignore[no-untyped-call]  # the library leaves it bare
        time_ns = batch.log_time[chosen]
        self._count(int(time_ns.min()), int(time_ns.max()), counts)

    def prove(self, until_ns: int, outcome: str = "") -> None:
        """Add a proof of everything so far, which lies before `until_ns`; an outcome makes it the last one.

        What was written so far goes to the stream first, so that a crash costs what came later at most.
        """
        self.flush()  # type: ignore[no-untyped-call]  # the library leaves it bare
        proof = Proof(until_ns, self._digests.current(), outcome)
        super().add_metadata(f"{PROOF}{self._proofs}", proof.record())
        self._proofs += 1

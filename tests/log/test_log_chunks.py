"""Messages that are written many at a time: byte for byte what the MCAP library writes of them one by one."""

from collections.abc import Callable
from io import BytesIO
from operator import itemgetter

import numpy as np
import pytest
from mcap._chunk_builder import ChunkBuilder
from mcap.reader import make_reader
from mcap.writer import Writer

from sim.log import wire
from sim.log.batches import records
from sim.log.chunks import CHUNK_BYTES, Chunk
from sim.log.proof import CORE
from sim.log.proving import ProvingWriter
from sim.log.records import Budget

MANY = [(10 * k + k % 7, k % 5, bytes([k % 251]) * (k % 4000)) for k in range(1500)]
"""Messages (time, channel, data) for more than one chunk."""


@pytest.mark.parametrize("messages", [MANY, MANY[:1], []], ids=["chunks", "one", "none"])
def test_messages_written_at_once_are_byte_for_byte_the_librarys(messages: list[tuple[int, int, bytes]]) -> None:
    """A log, its chunks, indices, statistics and proofs, written in two portions, and message by message."""
    written = []
    messages = sorted(messages, key=itemgetter(0))
    for at_once in (True, False):
        writer = ProvingWriter(stream := BytesIO())
        if not at_once:
            writer._Writer__chunk_builder = ChunkBuilder()
        schema = writer.register_schema("one", "jsonschema", b"{}")
        numbers = [writer.register_channel(f"/{i}{CORE[i % 2]}", "json", schema) for i in range(4)]
        numbers.append(writer.register_channel("/aside", "json", schema))
        writer.prove(0)
        for portion in (messages[:700], messages[700:]):
            if at_once:
                writer.add_messages([(at, numbers[channel], data) for at, channel, data in portion])
            else:
                for at, channel, data in portion:
                    writer.add_message(numbers[channel], at, data, at)
        writer.prove(2**63, "done")
        writer.finish()
        written.append(stream.getvalue())
    assert written[0] == written[1]
    summary = make_reader(BytesIO(written[0])).get_summary()
    assert (summary.statistics.chunk_count > 1) == (len(messages) > 1)


def batch_of(messages: list[tuple[int, int, bytes]]) -> wire.Batch:
    """Messages (channel, time, data) as they lie in a file; the ninth of their sender."""
    with BytesIO() as stream:
        writer = Writer(stream, chunk_size=1 << 30)
        writer.start()
        for channel, at, data in messages:
            writer.add_message(channel, at, data, at + 5, sequence=9)
        writer.finish()  # type: ignore[no-untyped-call]
        (batch,) = (b for b in records(stream, Budget(stream.tell())) if isinstance(b, wire.Batch) and b.channel.size)
    return batch


def test_a_chunk_is_full_with_the_message_that_makes_it_longer_than_a_mebibyte() -> None:
    """Each message takes 31 bytes besides its content."""
    half = CHUNK_BYTES // 2 - 31
    for sizes, expected in (([half, half, 1, 1], [3, 1]), ([half, half + 1, 1, 1], [2, 2]), ([3 * half, 1], [1, 1])):
        batch = batch_of([(3, k, bytes(size)) for k, size in enumerate(sizes)])
        left, added = np.arange(len(sizes)), []
        while left.size:
            added.append(Chunk().extend_batch(batch, left, {3: 1}))
            left = left[added[-1] :]
        assert added == expected


@pytest.mark.parametrize(("count", "size"), [(1, 1), (40, 60_000), (3, 3_000_000)])
def test_batches_are_written_as_one_by_one(count: int, size: int) -> None:
    """Out of order of time, some of them only; chunks end within a batch, go on in the next, hold one long message."""
    rng, numbers = np.random.default_rng(2), {7: 513, 3: 2}
    batches = []
    for _ in range(2):
        channels, times = rng.choice([7, 3], count).tolist(), rng.integers(1, 1 << 62, count).tolist()
        messages = [(c, at, rng.bytes(int(rng.integers(0, size)))) for c, at in zip(channels, times, strict=True)]
        batches.append((batch_of(messages), messages))
    chosen = np.flatnonzero(np.arange(count) % 4 != 2)

    def in_batches(writer: ProvingWriter) -> None:
        for batch, _ in batches:
            writer.add_batch(batch, chosen, numbers)
            writer.add_batch(batch, chosen[:0], numbers)

    def one_by_one(writer: ProvingWriter) -> None:
        for _, messages in batches:
            for k in chosen.tolist():
                channel, at, data = messages[k]
                writer.add_message(numbers[channel], at, data, at + 5, sequence=9)

    def written(write: Callable[[ProvingWriter], None], *, by_library: bool) -> bytes:
        writer = ProvingWriter(stream := BytesIO())
        if by_library:
            writer._Writer__chunk_builder = ChunkBuilder()
        for k in range(1, 514):
            writer.register_channel("/a/motion" if k == 513 else f"/aside {k}", "", 0)
        write(writer)
        writer.prove(1 << 62, "done")
        writer.finish()  # type: ignore[no-untyped-call]
        return stream.getvalue()

    assert written(in_batches, by_library=False) == written(one_by_one, by_library=True)

"""Damaged logs, for the commands that read one; of damaged chunks all others are kept."""

import io
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from sim.log import writer
from tests.synthetic import make_flight
from tools.fuzz.case import FuzzCase
from tools.fuzz.values import damaged

COMMANDS = (
    ["log", "info", "in.mcap"],
    ["log", "recover", "in.mcap"],
    ["log", "export", "in.mcap", "tables"],
    ["log", "export", "in.mcap", "tables", "--format", "csv"],
    ["replay", "in.mcap"],
)


_RECOVERED = "in.recovered.mcap"
_MAX_MESSAGES_OF_INSTANT = 20  # most messages; the instant before a gap is left out


@cache
def _undamaged_log(duration_s: float = 5.0) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "whole.mcap"
        writer.write(make_flight(duration_s), path)
        return path.read_bytes()


@dataclass(frozen=True)
class _StoredChunk:
    """Where the compressed messages of a chunk are in a log."""

    begin: int
    end: int
    messages: int


@cache
def _chunks() -> tuple[_StoredChunk, ...]:
    """Those of a log of some minutes."""
    content = _undamaged_log(120.0)
    chunks = list[_StoredChunk]()
    for record in StreamReader(io.BytesIO(content), emit_chunks=True).records:
        if isinstance(record, Chunk):
            begin = content.index(record.data, chunks[-1].end if chunks else 0)
            number = sum(isinstance(inner, Message) for inner in breakup_chunk(record))
            chunks.append(_StoredChunk(begin, begin + len(record.data), number))
    return tuple(chunks)


def _keeps(number: int) -> Callable[[Path], list[str]]:
    """Says whether so many messages were recovered."""

    def faults(folder: Path) -> list[str]:
        with (folder / _RECOVERED).open("rb") as stream:
            recovered = sum(1 for _ in make_reader(stream).iter_messages())
        return (
            []
            if recovered >= number
            else [f"kept {recovered} of {number} messages that are intact"]
        )

    return faults


def _damaged_chunks(random: Random) -> FuzzCase:
    """A log with a bit turned in some of its chunks."""
    content = bytearray(_undamaged_log(120.0))
    chunks = _chunks()
    lost = random.sample(chunks, random.randrange(1, len(chunks)))
    for chunk in lost:
        content[random.randrange(chunk.begin, chunk.end)] ^= 1 << random.randrange(8)
    intact = sum(chunk.messages for chunk in chunks if chunk not in lost)
    return FuzzCase(
        words=["log", "recover", "in.mcap"],
        files={"in.mcap": bytes(content)},
        written=(_RECOVERED,),
        judge=_keeps(intact - _MAX_MESSAGES_OF_INSTANT * len(lost)),
    )


def make(random: Random) -> FuzzCase:
    """A log of a flight with some of its bytes changed."""
    if random.random() < 0.2:
        return _damaged_chunks(random)
    content = damaged(_undamaged_log(), random, random.choice((1, 1, 2, 8)))
    return FuzzCase(words=list(random.choice(COMMANDS)), files={"in.mcap": content})

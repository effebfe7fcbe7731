"""Recovery goes on behind broken records; records may be longer than what is known of them."""

import re
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from sim.flight import Termination
from sim.log import writer
from sim.log.contents import Contents, LogError, recover
from sim.log.reader import read, read_recording
from tests.synthetic import make_flight

CHUNKS = 6
EACH = 20


def several_chunks(compression: CompressionType = CompressionType.ZSTD) -> bytes:
    """Messages 0, 1, 2 … of one topic, a second apart, `EACH` in each of `CHUNKS` chunks."""
    stream = BytesIO()
    log = Writer(stream, chunk_size=EACH * (22 + 8 + 9), compression=compression)
    log.start()
    channel = log.register_channel("/x", "json", log.register_schema("x", "jsonschema", b"{}"))
    for k in range(CHUNKS * EACH):
        log.add_message(channel, k * 10**9, struct.pack("<Q", k), k * 10**9)
    log.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def chunk_starts(data: bytes) -> list[int]:
    summary = make_reader(BytesIO(data)).get_summary()
    assert summary is not None
    return [index.chunk_start_offset for index in summary.chunk_indexes]


def numbers(path: Path) -> list[int]:
    return [struct.unpack("<Q", data)[0] for data in Contents(path).topics["/x"].data]


def without(chunk: int) -> list[int]:
    """All messages but those of a chunk; the first has one less, beside its schema and channel."""
    return [k for k in range(CHUNKS * EACH) if k not in messages_of(chunk)]


def messages_of(chunk: int) -> set[int]:
    reader = StreamReader(BytesIO(several_chunks()), emit_chunks=True)
    chunks = [record for record in reader.records if isinstance(record, Chunk)]
    actual = chunks[chunk]
    return set(range(actual.message_start_time // 10**9, actual.message_end_time // 10**9 + 1))


@pytest.mark.system
@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.parametrize("at", [60, 1, 30], ids=["content", "length", "size"])
def test_all_chunks_but_the_broken_one_are_kept(tmp_path: Path, chunk: int, at: int) -> None:
    """A bit is flipped in the data, in the length of the frame, or in the stated size."""
    data = bytearray(several_chunks())
    begin = chunk_starts(bytes(data))[chunk]
    data[begin + at] ^= 4
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    result = CliRunner().invoke(app, ["log", "recover", str(path)])
    assert result.exit_code == 0, result.output
    assert numbers(tmp_path / "a.recovered.mcap") == without(chunk)
    lost = messages_of(chunk)
    assert f"kept {CHUNKS * EACH - len(lost)} of {CHUNKS * EACH} messages" in result.output
    flat = " ".join(result.output.split())
    assert f"(messages from {min(lost)} s to {max(lost)} s)" in flat


def test_each_gap_is_reported(tmp_path: Path) -> None:
    data = bytearray(several_chunks())
    starts = chunk_starts(bytes(data))
    for chunk in (1, 3, 4):
        data[starts[chunk] + 60] ^= 4
    (tmp_path / "a.mcap").write_bytes(data)
    printed: list[str] = []
    path = recover(tmp_path / "a.mcap", printed.append)
    left_out = [line for line in printed if line.startswith("left out: ")]
    places = [int(re.findall(r"at byte (\d+)", line)[0]) for line in left_out]
    assert places == [starts[chunk] for chunk in (1, 3, 4)]
    lost = messages_of(1) | messages_of(3) | messages_of(4)
    assert numbers(path) == [k for k in range(CHUNKS * EACH) if k not in lost]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_chunks_are_found_without_a_summary(tmp_path: Path, compression: CompressionType) -> None:
    """A stretch of zeros over the frame of chunk 3, and the end of the file cut off."""
    data = bytearray(several_chunks(compression))
    starts = chunk_starts(bytes(data))
    data[starts[3] : starts[3] + 40] = bytes(40)
    (tmp_path / "a.mcap").write_bytes(data[: starts[-1]])
    assert numbers(recover(tmp_path / "a.mcap")) == sorted(
        messages_of(0) | messages_of(1) | messages_of(2) | messages_of(4)
    )


@pytest.mark.parametrize("lost", [True, False])
def test_channels_of_a_broken_first_chunk_are_those_of_a_summary_that_moved(
    tmp_path: Path, lost: bool
) -> None:
    """Bytes in chunk 2 are lost, or stand there twice, so that all offsets behind are wrong."""
    data = bytearray(several_chunks())
    starts = chunk_starts(bytes(data))
    data[starts[0] + 60] ^= 4
    first, last = starts[2] + 5, starts[2] + 60
    changed = data[:first] + data[last:] if lost else data[:last] + data[first:]
    (tmp_path / "a.mcap").write_bytes(changed)
    printed: list[str] = []
    path = recover(tmp_path / "a.mcap", printed.append)
    lost_messages = messages_of(0) | messages_of(2)
    assert numbers(path) == [k for k in range(CHUNKS * EACH) if k not in lost_messages]
    assert sum(line.startswith("left out: ") for line in printed) >= 2


def test_messages_without_an_intact_channel_are_no_recovery(tmp_path: Path) -> None:
    data = bytearray(several_chunks())
    data[chunk_starts(bytes(data))[0] + 60] ^= 4
    (tmp_path / "a.mcap").write_bytes(data[:-200])
    with pytest.raises(LogError, match="no intact message whose channel is described"):
        recover(tmp_path / "a.mcap")


def frame(kind: int, content: bytes, more: bytes = b"") -> bytes:
    return struct.pack("<BQ", kind, len(content) + len(more)) + content + more


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def longer_records(more: bytes, promised: int) -> bytes:
    """A log after the specification of MCAP, whose schema and channel have further fields."""
    schema = struct.pack("<H", 1) + text("x") + text("jsonschema") + text("{}")
    channel = struct.pack("<HH", 1, 1) + text("/x") + text("json") + struct.pack("<I", 0)
    messages = b"".join(
        frame(5, struct.pack("<HIQQQ", 1, k, k * 10**9, k * 10**9, k)) for k in range(EACH)
    )
    inner = frame(3, schema, more) + frame(4, channel, more) + messages
    chunk = struct.pack("<QQQI", 0, EACH * 10**9, len(inner), zlib.crc32(inner)) + text("")
    chunk += struct.pack("<Q", len(inner)) + inner
    magic = b"\x89MCAP0\r\n"
    head = magic + frame(1, text("") + text("")) + frame(6, chunk) + frame(15, bytes(4))
    statistics = struct.pack("<QHIIIIQQI", promised, 1, 1, 0, 0, 1, 0, EACH * 10**9, 0)
    return head + frame(11, statistics) + frame(2, struct.pack("<QQI", len(head), 0, 0)) + magic


@pytest.mark.parametrize("more", [b"", b"\x05", b"further fields"])
def test_longer_records_in_a_chunk_are_read(tmp_path: Path, more: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(longer_records(more, EACH))
    assert numbers(path) == list(range(EACH))


def test_fewer_messages_than_the_summary_promises_are_no_complete_log(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(longer_records(b"", EACH + 3))
    with pytest.raises(LogError, match=r"holds 20 messages, and its summary promises 23"):
        Contents(path)
    printed: list[str] = []
    assert numbers(recover(path, printed.append)) == list(range(EACH))
    assert printed[-2:] == [
        "kept 20 of 23 messages of 19 s and 0 attachments",
        "left out: the summary promises 23 messages",
    ]


def test_of_a_flight_with_a_gap_the_start_is_a_flight_and_all_measurements_are_kept(
    tmp_path: Path,
) -> None:
    flight = make_flight(100.0)
    path = tmp_path / "a.mcap"
    writer.write(flight, path)
    data = bytearray(path.read_bytes())
    starts = chunk_starts(bytes(data))
    data[starts[len(starts) // 2] + 100] ^= 1
    path.write_bytes(data)
    recovered = recover(path)
    start = read(recovered)
    n = start.trajectory.time.size
    assert start.outcome is Termination.INTERRUPTED
    assert 100 < n < flight.trajectory.time.size // 2 + 200
    assert start.trajectory.position.tobytes() == flight.trajectory.position[:n].tobytes()
    name = flight.trajectory.names[1]
    measured, remarks = read_recording(recovered, name, 100.0)
    assert measured.time[-1] == pytest.approx(100.0, abs=0.11)
    assert measured.speed.size > start.measurements[0].speed.size + 100
    assert any("gap" in remark for remark in remarks)
    after = measured.speed[start.measurements[0].speed.size :]
    assert np.isin(after, flight.measurements[0].speed).all()

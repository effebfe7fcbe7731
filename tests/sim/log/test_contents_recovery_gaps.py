"""Recovery goes on behind broken records; records may have more fields than the reader knows."""

import re
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
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

CHUNK_COUNT = 6
MESSAGES_PER_CHUNK = 20


def log_of_chunks(compression: CompressionType = CompressionType.ZSTD) -> bytes:
    """Messages 0, 1, 2 … of one topic, a second apart, about `MESSAGES_PER_CHUNK` in each of
    `CHUNK_COUNT` chunks; the first chunk also has the schema and the channel.
    """
    stream = BytesIO()
    log = Writer(stream, chunk_size=MESSAGES_PER_CHUNK * (22 + 8 + 9), compression=compression)
    log.start()
    channel = log.register_channel("/x", "json", log.register_schema("x", "jsonschema", b"{}"))
    for k in range(CHUNK_COUNT * MESSAGES_PER_CHUNK):
        log.add_message(channel, k * 10**9, struct.pack("<Q", k), k * 10**9)
    log.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def chunk_starts(data: bytes) -> list[int]:
    summary = make_reader(BytesIO(data)).get_summary()
    assert summary is not None
    return [index.chunk_start_offset for index in summary.chunk_indexes]


def numbers_in(path: Path) -> list[int]:
    """Numbers of the messages that a log holds."""
    return [struct.unpack("<Q", data)[0] for data in Contents(path).topics["/x"].data]


def numbers_without(chunk: int) -> list[int]:
    """Numbers of all messages but those of a chunk."""
    return [k for k in range(CHUNK_COUNT * MESSAGES_PER_CHUNK) if k not in numbers_of(chunk)]


def numbers_of(chunk: int) -> set[int]:
    """Numbers of the messages in a chunk."""
    reader = StreamReader(BytesIO(log_of_chunks()), emit_chunks=True)
    chunks = [record for record in reader.records if isinstance(record, Chunk)]
    broken = chunks[chunk]
    return set(range(broken.message_start_time // 10**9, broken.message_end_time // 10**9 + 1))


@pytest.mark.system
@pytest.mark.parametrize("chunk", range(CHUNK_COUNT))
@pytest.mark.parametrize("offset", [60, 1, 30], ids=["content", "length", "size"])
def test_all_chunks_but_the_broken_one_are_kept(tmp_path: Path, chunk: int, offset: int) -> None:
    """A bit is flipped in the data, in the length of the frame, or in the stated size."""
    data = bytearray(log_of_chunks())
    start = chunk_starts(bytes(data))[chunk]
    data[start + offset] ^= 4
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    result = CliRunner().invoke(app, ["log", "recover", str(path)])
    assert result.exit_code == 0, result.output
    assert numbers_in(tmp_path / "a.recovered.mcap") == numbers_without(chunk)
    lost = numbers_of(chunk)
    total = CHUNK_COUNT * MESSAGES_PER_CHUNK
    assert f"kept {total - len(lost)} of {total} messages" in result.output
    printed_text = " ".join(result.output.split())
    assert f"(messages from {min(lost)} s to {max(lost)} s)" in printed_text


def test_each_gap_is_reported(tmp_path: Path) -> None:
    data = bytearray(log_of_chunks())
    starts = chunk_starts(bytes(data))
    for chunk in (1, 3, 4):
        data[starts[chunk] + 60] ^= 4
    (tmp_path / "a.mcap").write_bytes(data)
    printed: list[str] = []
    path = recover(tmp_path / "a.mcap", printed.append)
    left_out = [line for line in printed if line.startswith("left out: ")]
    offsets = [int(re.findall(r"at byte (\d+)", line)[0]) for line in left_out]
    assert offsets == [starts[chunk] for chunk in (1, 3, 4)]
    lost = numbers_of(1) | numbers_of(3) | numbers_of(4)
    assert numbers_in(path) == [k for k in range(CHUNK_COUNT * MESSAGES_PER_CHUNK) if k not in lost]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_chunks_are_found_without_a_summary(tmp_path: Path, compression: CompressionType) -> None:
    """Zeros cover the frame of chunk 3, and the file is cut off before the last chunk."""
    data = bytearray(log_of_chunks(compression))
    starts = chunk_starts(bytes(data))
    data[starts[3] : starts[3] + 40] = bytes(40)
    (tmp_path / "a.mcap").write_bytes(data[: starts[-1]])
    assert numbers_in(recover(tmp_path / "a.mcap")) == sorted(
        numbers_of(0) | numbers_of(1) | numbers_of(2) | numbers_of(4)
    )


@pytest.mark.parametrize("is_lost", [True, False])
def test_channels_of_a_broken_first_chunk_are_those_of_a_summary_that_moved(
    tmp_path: Path, is_lost: bool
) -> None:
    """Chunk 0 is broken, and with it the record of the channel; bytes in chunk 2 are lost or stand
    there twice, so that all offsets behind are wrong.
    """
    data = bytearray(log_of_chunks())
    starts = chunk_starts(bytes(data))
    data[starts[0] + 60] ^= 4
    first, last = starts[2] + 5, starts[2] + 60
    moved = data[:first] + data[last:] if is_lost else data[:last] + data[first:]
    (tmp_path / "a.mcap").write_bytes(moved)
    printed: list[str] = []
    path = recover(tmp_path / "a.mcap", printed.append)
    lost_messages = numbers_of(0) | numbers_of(2)
    assert numbers_in(path) == [
        k for k in range(CHUNK_COUNT * MESSAGES_PER_CHUNK) if k not in lost_messages
    ]
    assert sum(line.startswith("left out: ") for line in printed) >= 2


def test_messages_without_an_intact_channel_cannot_be_recovered(tmp_path: Path) -> None:
    data = bytearray(log_of_chunks())
    data[chunk_starts(bytes(data))[0] + 60] ^= 4
    (tmp_path / "a.mcap").write_bytes(data[:-200])
    with pytest.raises(LogError, match="no intact message whose channel is described"):
        recover(tmp_path / "a.mcap")


def record_bytes(opcode: int, content: bytes, further_fields: bytes = b"") -> bytes:
    return struct.pack("<BQ", opcode, len(content) + len(further_fields)) + content + further_fields


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def log_with_longer_records(further_fields: bytes, promised_messages: int) -> bytes:
    """A log by the specification of MCAP, whose schema and channel end with fields that it does not
    define, and whose summary states so many messages.
    """
    schema = struct.pack("<H", 1) + text("x") + text("jsonschema") + text("{}")
    channel = struct.pack("<HH", 1, 1) + text("/x") + text("json") + struct.pack("<I", 0)
    messages = b"".join(
        record_bytes(Opcode.MESSAGE, struct.pack("<HIQQQ", 1, k, k * 10**9, k * 10**9, k))
        for k in range(MESSAGES_PER_CHUNK)
    )
    chunk_records = (
        record_bytes(Opcode.SCHEMA, schema, further_fields)
        + record_bytes(Opcode.CHANNEL, channel, further_fields)
        + messages
    )
    chunk = struct.pack(
        "<QQQI", 0, MESSAGES_PER_CHUNK * 10**9, len(chunk_records), zlib.crc32(chunk_records)
    ) + text("")
    chunk += struct.pack("<Q", len(chunk_records)) + chunk_records
    magic = b"\x89MCAP0\r\n"
    head = (
        magic
        + record_bytes(Opcode.HEADER, text("") + text(""))
        + record_bytes(Opcode.CHUNK, chunk)
        + record_bytes(Opcode.DATA_END, bytes(4))
    )
    statistics = struct.pack(
        "<QHIIIIQQI", promised_messages, 1, 1, 0, 0, 1, 0, MESSAGES_PER_CHUNK * 10**9, 0
    )
    return (
        head
        + record_bytes(Opcode.STATISTICS, statistics)
        + record_bytes(Opcode.FOOTER, struct.pack("<QQI", len(head), 0, 0))
        + magic
    )


@pytest.mark.parametrize("further_fields", [b"", b"\x05", b"further fields"])
def test_longer_records_in_a_chunk_are_read(tmp_path: Path, further_fields: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(log_with_longer_records(further_fields, MESSAGES_PER_CHUNK))
    assert numbers_in(path) == list(range(MESSAGES_PER_CHUNK))


def test_fewer_messages_than_the_summary_promises_are_no_complete_log(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(log_with_longer_records(b"", MESSAGES_PER_CHUNK + 3))
    with pytest.raises(LogError, match=r"holds 20 messages, and its summary promises 23"):
        Contents(path)
    printed: list[str] = []
    assert numbers_in(recover(path, printed.append)) == list(range(MESSAGES_PER_CHUNK))
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
    instants = start.trajectory.time.size
    assert start.outcome is Termination.INTERRUPTED
    assert 100 < instants < flight.trajectory.time.size // 2 + 200
    assert start.trajectory.position.tobytes() == flight.trajectory.position[:instants].tobytes()
    name = flight.trajectory.names[1]
    measured, remarks, _ = read_recording(recovered, name, 100.0)
    assert measured.time[-1] == pytest.approx(100.0, abs=0.11)
    assert measured.speed.size > start.measurements[0].speed.size + 100
    assert any("gap" in remark for remark in remarks)
    speeds_after_start = measured.speed[start.measurements[0].speed.size :]
    assert np.isin(speeds_after_start, flight.measurements[0].speed).all()

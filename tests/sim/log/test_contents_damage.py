"""Damaged, rewritten and hostile logs: refused, or recovered up to the damage; never another
flight.
"""

import re
import struct
import subprocess
import sys
import zlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, IndexType, Writer
from mcap_protobuf.schema import register_schema

from sim.flight import FlightRecord, Termination, excerpt
from sim.log import writer
from sim.log.contents import Contents, LogError, recover
from sim.log.export import export
from sim.log.reader import read, read_recording
from sim.log.schema import OWN_MOTION, RECEPTION
from tests.sim.log.damage import Parts, damaged
from tests.synthetic import bits, make_flight

FOLLOWER_CHANNELS = (
    "motion",
    "reception",
    "filter",
    "innovation",
    "estimate",
    "estimate/fix",
    "error",
)


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(35.0, 2)


def log_of(flight: FlightRecord, folder: Path) -> bytes:
    path = folder / "flight.mcap"
    writer.write(flight, path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def log_bytes(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return log_of(flight, tmp_path_factory.mktemp("whole"))


def is_start_of(candidate: FlightRecord, flight: FlightRecord) -> bool:
    """Whether a flight consists of the first filter steps of another, to the bit, and is marked as
    interrupted.
    """
    steps = candidate.measurements[0].speed.size
    beginning = excerpt(flight, 0.0, steps * flight.measurements[0].dt)
    points = candidate.trajectory.time.size
    truths = [
        {k: v for k, v in bits(t).items() if k[:4] != "site"}
        for t in (candidate.trajectory, beginning.trajectory)
    ]
    return (
        candidate.outcome is Termination.INTERRUPTED
        and points == beginning.trajectory.time.size
        and truths[0] == truths[1]
        and bits(candidate.trajectory)["site_offset"] == bits(flight.trajectory)["site_offset"]
        and bits(candidate.measurements) == bits(beginning.measurements)
        and bits(candidate.estimates) == bits(beginning.estimates)
        and candidate.scenario == flight.scenario
    )


@pytest.fixture(scope="module")
def short_flight() -> FlightRecord:
    """Its log has three blocks of 20 s, of which the last is not full."""
    return make_flight(44.0, 2)


@pytest.fixture(scope="module")
def short_log_bytes(short_flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return log_of(short_flight, tmp_path_factory.mktemp("brief"))


@pytest.mark.system
@pytest.mark.parametrize("seed", range(60))
def test_no_damaged_log_gives_another_flight(
    short_flight: FlightRecord, short_log_bytes: bytes, tmp_path: Path, seed: int
) -> None:
    """It is refused; what is recovered is the start of the flight, or all of it."""
    data, kind_of_damage = damaged(short_log_bytes, np.random.default_rng(seed))
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    if data == short_log_bytes:
        return
    with pytest.raises(LogError, match=r"^\S+a\.mcap: [^\n]+$"):
        read(path)
    with suppress(LogError):
        actual = read(recover(path))
        assert bits(actual) == bits(short_flight) or is_start_of(actual, short_flight), (
            kind_of_damage
        )


@pytest.mark.system
@pytest.mark.parametrize("seed", range(20))
def test_of_a_truncated_log_a_prefix_is_recovered(
    short_flight: FlightRecord, short_log_bytes: bytes, tmp_path: Path, seed: int
) -> None:
    """All but the last block, at most, and the messages of every channel of it."""
    length = int(
        np.random.default_rng(seed).integers(len(short_log_bytes) // 2, len(short_log_bytes))
    )
    (tmp_path / "a.mcap").write_bytes(short_log_bytes[:length])
    path = recover(tmp_path / "a.mcap")
    actual = read(path)
    assert bits(actual) == bits(short_flight) or is_start_of(actual, short_flight)
    # half of the file holds the first 20 s and more
    assert actual.trajectory.time[-1] >= 19.8
    scenes = {f"/scene/{name}" for name in ("hulls", "vehicles", "acoustics")}
    assert set(Contents(path).topics) == {"/log", "/tf", "/tf_static"} | scenes | {
        f"/{name}/{channel}"
        for name in ("leader", "follower1", "follower2")
        for channel in ("pose", "state", "fix", *FOLLOWER_CHANNELS)
        if name != "leader" or channel in ("pose", "state", "fix")
    }


def rewrite(log_bytes: bytes, path: Path, change: Any) -> Path:
    """A log with changed parts, as another program would write it."""
    parts = Parts.of(log_bytes)
    change(parts)
    path.write_bytes(parts.written())
    return path


def index_since(seconds: float, parts: Parts) -> int:
    """Index of the first message that is so long after the start, or longer."""
    start = parts.messages[0][2].log_time
    return next(
        i for i, item in enumerate(parts.messages) if item[2].log_time >= start + seconds * 1e9
    )


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_log_that_another_program_rewrote_is_read_as_the_same_flight(
    flight: FlightRecord, log_bytes: bytes, tmp_path: Path, compression: CompressionType
) -> None:
    def change(parts: Parts) -> None:
        parts.compression, parts.chunk_size = compression, 20_000
        schema, channel, message = parts.messages[0]
        parts.messages[0] = schema, channel, replace(message, sequence=7)

    path = rewrite(log_bytes, tmp_path / "a.mcap", change)
    assert bits(read(path)) == bits(flight)
    assert Contents(path).unverified == ()


def test_a_flight_whose_start_or_end_was_cut_is_refused_but_its_measurements_are_read(
    log_bytes: bytes, tmp_path: Path
) -> None:
    def cut_start(parts: Parts) -> None:
        del parts.messages[: index_since(12.0, parts)]

    def cut_end(parts: Parts) -> None:
        del parts.messages[index_since(27.0, parts) :]

    for cut, text, steps_left in (
        (cut_start, "the messages of /leader/state are not at the times of a flight", 231),
        (cut_end, "a completed mission of 35 s has 350 filter steps, this log has 269", 269),
    ):
        path = rewrite(log_bytes, tmp_path / "a.mcap", cut)
        with pytest.raises(LogError, match=text):
            read(path)
        assert read_recording(path, "follower1").measurements.speed.size == steps_left


@pytest.mark.parametrize(
    ("topic", "text"),
    [
        ("/follower1/reception", "receptions without a fix, or fixes without a reception"),
        ("/follower2/innovation", "receptions without a fix, or fixes without a reception"),
        ("/leader/state", "/leader/state are not at the times of a flight, without a gap"),
        ("/follower1/motion", "/follower1/motion are not at the times of a flight, without a gap"),
    ],
)
def test_a_missing_message_of_a_flight_is_detected(
    log_bytes: bytes, tmp_path: Path, topic: str, text: str
) -> None:
    def drop_middle_message(parts: Parts) -> None:
        indices = [i for i, item in enumerate(parts.messages) if item[1].topic == topic]
        del parts.messages[indices[len(indices) // 2]]

    path = rewrite(log_bytes, tmp_path / "a.mcap", drop_middle_message)
    with pytest.raises(LogError, match=text):
        read(path)


def test_a_log_cut_twice_is_recovered_twice(
    flight: FlightRecord, log_bytes: bytes, tmp_path: Path
) -> None:
    def in_small_chunks(parts: Parts) -> None:
        parts.chunk_size = 20_000

    path = rewrite(log_bytes, tmp_path / "a.mcap", in_small_chunks)
    for fraction in (0.8, 0.6):
        data = path.read_bytes()
        path.write_bytes(data[: int(fraction * len(data))])
        path = recover(path)
        actual = read(path)
        assert is_start_of(actual, flight)
    assert actual.trajectory.time[-1] > 9


def without_data_checksum(data: bytes) -> bytearray:
    """The checksum of the data section, before the summary, replaced by zero, which means that
    there is none.
    """
    changed = bytearray(data)
    summary_start = int.from_bytes(changed[-8 - 20 : -8 - 12], "little")
    changed[summary_start - 4 : summary_start] = bytes(4)
    return changed


def with_another_baseline(data: bytes, *, checksum: bool) -> bytes:
    """One bit flipped in the scenario, and perhaps its checksum replaced by zero."""
    changed = bytearray(data)
    text = b"baseline_m = 2.0"
    changed[changed.index(text) + len(text) - 1] ^= 1
    if not checksum:
        scenario = next(a for a in Parts.of(data).attachments if a.name == "scenario.toml").data
        end = data.index(scenario) + len(scenario)
        changed[end : end + 4] = bytes(4)
    return bytes(changed)


def test_recovery_leaves_a_damaged_scenario_out(log_bytes: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(with_another_baseline(log_bytes, checksum=True)[:-100])
    printed: list[str] = []
    path = recover(tmp_path / "a.mcap", printed.append)
    assert printed[0] == "attachment 'scenario.toml' is damaged and is left out"
    assert Contents(path).metadata["recovery"]["0"] == printed[0]
    with pytest.raises(LogError, match=r"lacks attachment scenario\.toml"):
        read(path)
    # the measurements are recovered but for the last instant
    assert read_recording(path, "follower1").measurements.speed.size == 349


def test_attachments_have_checksums_of_their_own(log_bytes: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(without_data_checksum(with_another_baseline(log_bytes, checksum=True)))
    with pytest.raises(
        LogError, match=r"at byte \d+: the checksum of attachment 'scenario\.toml' does not match"
    ):
        read(path)
    path.write_bytes(without_data_checksum(log_bytes))
    assert Contents(path).unverified == ("metadata",)


def test_a_chunk_is_verified_where_the_data_section_has_no_checksum(
    log_bytes: bytes, tmp_path: Path
) -> None:
    changed = without_data_checksum(log_bytes)
    changed[changed.index(struct.pack("<I", 0xFD2FB528)) + 1000] ^= 1
    (tmp_path / "a.mcap").write_bytes(changed)
    with pytest.raises(LogError, match=r"damaged or cut off at byte \d+: "):
        read(tmp_path / "a.mcap")


def plain_log(path: Path, fill: Any, **options: Any) -> Path:
    with path.open("wb") as stream:
        plain = Writer(stream, **options)
        plain.start()
        fill(plain)
        plain.finish()  # type: ignore[no-untyped-call]
    return path


def test_parts_without_a_checksum_are_remarked_on(tmp_path: Path) -> None:
    def fill(plain: Writer) -> None:
        channel = plain.register_channel(
            "/auv/motion", "protobuf", register_schema(plain, OWN_MOTION.message_class)
        )
        for k in range(20):
            plain.add_message(
                channel,
                k * 10**8,
                OWN_MOTION.message_class(speed=1.0, heading=0.0, depth=1.0).SerializeToString(),
                k * 10**8,
            )
        channel = plain.register_channel(
            "/auv/reception", "protobuf", register_schema(plain, RECEPTION.message_class)
        )
        values = dict.fromkeys(RECEPTION.fields, 1.0)
        plain.add_message(channel, 0, RECEPTION.message_class(**values).SerializeToString(), 0)

    path = plain_log(tmp_path / "a.mcap", fill, enable_crcs=False, chunk_size=200)
    assert Contents(path).unverified == ("metadata", "7 of 7 chunks")
    assert read_recording(path, "auv").remarks == (
        "7 of 7 chunks: no checksum, damage cannot be detected",
    )


PEAK = """
import sys
from pathlib import Path
from sim.log.contents import LogError, recover
from sim.log import reader, export
path = Path(sys.argv[1])
uses = (reader.read, reader.read_recording, lambda p: export.export(p, p.parent / "t"), recover)
for use in uses:
    try:
        use(path)
        print("done")
    except LogError as error:
        print(error)
# the resource usage of a process also counts what its parent took before it was started
status = Path("/proc/self/status").read_text().splitlines()
print(next(float(line.split()[1]) / 1e3 for line in status if line.startswith("VmHWM")))
"""


def peak_of_reading(path: Path) -> tuple[list[str], float]:
    """What the readers print of a file, and the most memory that a process with all of them
    takes [MB].
    """
    child = subprocess.run(
        [sys.executable, "-c", PEAK, str(path)], capture_output=True, text=True, check=True
    )
    *lines, peak = child.stdout.splitlines()
    return lines, float(peak)


@pytest.mark.system
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_small_log_does_not_unfold_without_bound(
    tmp_path: Path, compression: CompressionType
) -> None:
    """Gigabytes of zeros in a small file are refused before they are decompressed."""

    def fill(plain: Writer) -> None:
        schema = register_schema(plain, OWN_MOTION.message_class)
        channels = [
            plain.register_channel(f"/follower/{name}", "protobuf", schema)
            for name in ("motion", "reception")
        ]
        for _ in range(30):
            for channel in channels:
                plain.add_message(channel, 0, bytes(8 << 20), 0)

    path = plain_log(tmp_path / "a.mcap", fill, compression=compression, chunk_size=8 << 20)
    lines, peak = peak_of_reading(path)
    assert all(
        re.search(r"a\.mcap: damaged or cut off at byte \d+: .* would decompress to", x)
        for x in lines[:3]
    )
    assert peak < 500
    assert not (tmp_path / "t").exists()


def log_of_chunks(path: Path, record: bytes, *, size: int, count: int, compress: Any) -> Path:
    """A log of about `size` bytes, at least one chunk, whose chunks hold `count` records each."""

    def fill(plain: Writer) -> None:
        plain.register_channel(
            "/follower/motion", "protobuf", register_schema(plain, OWN_MOTION.message_class)
        )
        plain.register_channel(
            "/follower/reception", "protobuf", register_schema(plain, RECEPTION.message_class)
        )

    chunk_data, chunk = count * record, RecordBuilder()
    Chunk("zstd", compress(chunk_data), 0, 0, zlib.crc32(chunk_data), len(chunk_data)).write(chunk)
    chunks = chunk.end()
    chunks *= max(1, size // len(chunks))
    without_summary = {
        "enable_crcs": False,
        "use_chunking": False,
        "repeat_channels": False,
        "repeat_schemas": False,
    }
    data = plain_log(
        path,
        fill,
        **without_summary,
        use_statistics=False,
        use_summary_offsets=False,
        index_types=IndexType.NONE,
    ).read_bytes()
    # without a summary nothing in the file gives offsets of other records
    # before the records of the end of the data, 13 bytes, and of the footer, 29, and the magic, 8
    end_of_data = len(data) - 8 - 29 - 13
    path.write_bytes(data[:end_of_data] + chunks + data[end_of_data:])
    return path


EMPTY_MESSAGE = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 0, 0)
CHANNEL = struct.pack("<BQHHIBII", Opcode.CHANNEL, 17, 7, 0, 1, 97, 0, 0)


@pytest.mark.system
@pytest.mark.parametrize(
    ("record", "size"),
    [
        pytest.param(EMPTY_MESSAGE, 1_000_000, id="messages", marks=pytest.mark.long),
        pytest.param(CHANNEL, 1, id="channels"),
    ],
)
def test_many_small_records_do_not_fill_the_memory(
    tmp_path: Path, record: bytes, size: int
) -> None:
    count = (23 << 20) // len(record)
    path = log_of_chunks(
        tmp_path / "a.mcap", record, size=size, count=count, compress=zstandard.compress
    )
    assert path.stat().st_size < 1_010_000
    assert peak_of_reading(path)[1] < 500


@pytest.mark.system
def test_a_chunk_that_lies_about_its_size_is_refused(tmp_path: Path) -> None:
    """By its record, and by the frame of its compressor, which states a thousand gigabytes."""
    path = log_of_chunks(
        tmp_path / "a.mcap", EMPTY_MESSAGE, size=1, count=1000, compress=zstandard.compress
    )
    data = bytearray(path.read_bytes())
    index = data.index(struct.pack("<Q", 31_000))
    data[index : index + 8] = struct.pack("<Q", 30_999)
    path.write_bytes(data)
    with pytest.raises(LogError, match=r"the size of a chunk does not match"):
        read_recording(path)

    def frame(content: bytes) -> bytes:
        header = struct.pack("<IBBQ", 0xFD2FB528, 0b1100_0000, 0x50, 10**12)
        return header + struct.pack("<I", len(content[:900]) << 3 | 1)[:3] + content[:900]

    path = log_of_chunks(tmp_path / "b.mcap", EMPTY_MESSAGE, size=1, count=1000, compress=frame)
    lines, peak = peak_of_reading(path)
    assert all("damaged or cut off at byte" in line for line in lines[:3])
    assert peak < 500


def test_topics_of_any_name_have_a_table_of_their_own(tmp_path: Path) -> None:
    topics = ["/a/b", "/a_b", "/A/B", "/a\0b", "/../x", "/é/\n", ""]

    def fill(plain: Writer) -> None:
        schema = register_schema(plain, OWN_MOTION.message_class)
        for k, topic in enumerate(topics):
            channel = plain.register_channel(topic, "protobuf", schema)
            plain.add_message(
                channel, 0, OWN_MOTION.message_class(speed=float(k)).SerializeToString(), 0
            )

    files = export(plain_log(tmp_path / "a.mcap", fill), tmp_path / "tables")
    # in order of topic: "", "/../x", "/A/B", "/a\0b", "/a/b", "/a_b", "/é/\n"; some file systems
    # ignore case
    stems = ["channel", ".._x", "A_B", "a%00b", "a_b~2", "a_b~3", "%C3%A9_%0A"]
    assert [f.name for f in files] == [f"{stem}.parquet" for stem in stems]
    assert {f.parent for f in files} == {tmp_path / "tables"}
    speeds = {pyarrow.parquet.read_table(f)["speed"][0].as_py() for f in files}
    assert speeds == {float(k) for k in range(len(topics))}


def test_an_excerpt_is_no_log(flight: FlightRecord, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="begins with its mission; this flight at 5 s"):
        writer.write(excerpt(flight, 5.0, 9.0), tmp_path / "a.mcap")

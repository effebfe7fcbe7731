"""Damaged logs: what is read is the flight that was written, or the start of it and called so; or it is refused."""

import resource
import zlib
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import zstandard
from damage import Parts, damaged
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.writer import CompressionType, IndexType, Writer
from mcap_protobuf.schema import register_schema
from synthetic import bits, make_flight

from sim.excerpt import excerpt
from sim.flight import Flight, Outcome
from sim.log import writer
from sim.log.export import export
from sim.log.file import LogError
from sim.log.info import info
from sim.log.proof import LIBRARY
from sim.log.reader import read, read_measurements
from sim.log.records import HEAD, places
from sim.log.recovery import recover
from sim.log.schema import OWN_MOTION


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(35.0, 2)


def log_of(flight: Flight, folder: Path) -> bytes:
    path = folder / "flight.mcap"
    writer.write(flight, path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def whole(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return log_of(flight, tmp_path_factory.mktemp("whole"))


def is_start_of(part: Flight, flight: Flight) -> bool:
    """Whether a flight is the first n filter steps of another, and says that it was interrupted."""
    n = part.measurements[0].speed.size
    begin = excerpt(flight, 0.0, n * flight.measurements[0].dt)
    points = part.trajectory.time.size
    truths = [{k: v for k, v in bits(t).items() if k[:4] != "site"} for t in (part.trajectory, begin.trajectory)]
    return (
        part.outcome is Outcome.INTERRUPTED
        and points == begin.trajectory.time.size
        and truths[0] == truths[1]
        and bits(part.trajectory)["site_offset"] == bits(flight.trajectory)["site_offset"]
        and bits(part.measurements) == bits(begin.measurements)
        and bits(part.estimates) == bits(begin.estimates)
        and part.scenario == flight.scenario
    )


@pytest.fixture(scope="module")
def brief() -> Flight:
    """With two proofs on the way, and one at the end."""
    return make_flight(22.0, 2)


@pytest.fixture(scope="module")
def brief_log(brief: Flight, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return log_of(brief, tmp_path_factory.mktemp("brief"))


@pytest.mark.parametrize("seed", range(40))
def test_no_damaged_log_gives_another_flight(brief: Flight, brief_log: bytes, tmp_path: Path, seed: int) -> None:
    data, what = damaged(brief_log, np.random.default_rng(seed))
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    with suppress(LogError):
        found = read(path)
        assert bits(found) == bits(brief) or is_start_of(found, brief), what
    with suppress(LogError):
        assert is_start_of(read(recover(path)), brief), what


def rewritten(whole: bytes, path: Path, change: Any) -> Path:
    parts = Parts.of(whole)
    change(parts)
    path.write_bytes(parts.written())
    return path


def since(seconds: float, parts: Parts) -> int:
    """Index of the first message so long after the start."""
    start = parts.messages[0][2].log_time
    return next(i for i, item in enumerate(parts.messages) if item[2].log_time >= start + seconds * 1e9)


def test_a_log_whose_start_is_cut_off_is_refused(whole: bytes, tmp_path: Path) -> None:
    def cut(parts: Parts) -> None:
        del parts.messages[: since(12.0, parts)]

    path = rewritten(whole, tmp_path / "a.mcap", cut)
    for reader in (read, lambda p: read_measurements(p, "follower1")):
        with pytest.raises(LogError, match=r"a\.mcap: is not what was written: the first 12(\.1)? s of its mission"):
            reader(path)


def test_a_log_whose_end_is_cut_off_is_an_interrupted_flight(flight: Flight, whole: bytes, tmp_path: Path) -> None:
    def cut(parts: Parts) -> None:
        del parts.messages[since(27.0, parts) + 3 :]

    found = read(rewritten(whole, tmp_path / "a.mcap", cut))
    assert is_start_of(found, flight)
    # proofs come every ten seconds
    assert found.trajectory.time[-1] == pytest.approx(19.9)


@pytest.mark.parametrize(
    "topic", ["/follower1/reception", "/follower2/innovation", "/leader/pose", "/follower1/motion"]
)
def test_a_missing_message_is_noticed(whole: bytes, tmp_path: Path, topic: str) -> None:
    def drop(parts: Parts) -> None:
        places = [i for i, item in enumerate(parts.messages) if item[1].topic == topic]
        del parts.messages[places[len(places) // 2]]

    path = rewritten(whole, tmp_path / "a.mcap", drop)
    with pytest.raises(LogError, match=f"is not what was written: {topic} changed"):
        read(path)


def test_a_log_without_proofs_is_no_flight(whole: bytes, tmp_path: Path) -> None:
    def strip(parts: Parts) -> None:
        parts.metadata = [m for m in parts.metadata if not m.name.startswith("proof")]

    path = rewritten(whole, tmp_path / "a.mcap", strip)
    with pytest.raises(LogError, match="it lacks proofs of being whole"):
        read(path)
    # a vehicle's log needs none
    assert read_measurements(path, "follower1").speed.size == 350


def test_what_another_program_wrote_after_the_last_proof_is_not_believed(whole: bytes, tmp_path: Path) -> None:
    """A changed message in fresh checksums, in a log that is cut before a proof would tell."""

    def change(parts: Parts) -> None:
        del parts.messages[since(9.0, parts) :]
        at = next(i for i in range(since(7.5, parts), 10**6) if parts.messages[i][1].topic == "/leader/pose")
        schema, channel, message = parts.messages[at]
        parts.messages[at] = schema, channel, replace(message, data=message.data[:-1] + b"?")

    path = rewritten(whole, tmp_path / "a.mcap", change)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match=r"a\.mcap: "):
        recover(path)


def test_a_log_cut_twice_is_recovered_twice(flight: Flight, whole: bytes, tmp_path: Path) -> None:
    def in_small_chunks(parts: Parts) -> None:
        parts.chunk_size, parts.library = 20_000, LIBRARY

    path = rewritten(whole, tmp_path / "a.mcap", in_small_chunks)
    for _ in range(2):
        data = path.read_bytes()
        path.write_bytes(data[: int(0.8 * len(data))])
        path = recover(path)
        found = read(path)
        assert is_start_of(found, flight)
    assert found.trajectory.time[-1] > 15


def without_data_checksum(data: bytes) -> bytearray:
    """The checksum of all that stands before the summary replaced by zero, which stands for none."""
    changed = bytearray(data)
    summary_start = int.from_bytes(changed[-8 - 20 : -8 - 12], "little")
    changed[summary_start - 4 : summary_start] = bytes(4)
    return changed


def with_another_baseline(data: bytes, *, checksum: bool) -> bytes:
    """One bit flipped in the scenario, and perhaps its checksum replaced by zero."""
    with BytesIO(data) as stream:
        scenario = next(place for place in places(stream) if place.opcode == Opcode.ATTACHMENT)
    changed = bytearray(data)
    text = b"baseline_m = 2.0"
    changed[changed.index(text) + len(text) - 1] ^= 1
    if not checksum:
        end = scenario.start + scenario.length
        changed[end - 4 : end] = bytes(4)
    return bytes(changed)


@pytest.mark.parametrize("checksum", [True, False])
def test_recovery_does_not_launder_a_damaged_scenario(whole: bytes, tmp_path: Path, checksum: bool) -> None:
    (tmp_path / "a.mcap").write_bytes(with_another_baseline(whole, checksum=checksum)[:-100])
    said: list[str] = []
    path = recover(tmp_path / "a.mcap", said.append)
    assert any("attachment" in line and "scenario.toml" in line and "left out" in line for line in said)
    with pytest.raises(LogError, match=r"lacks attachment scenario\.toml"):
        read(path)
    # what was measured is not lost
    assert read_measurements(path, "follower1").speed.size > 250


@pytest.mark.parametrize(
    ("checksum", "text"), [(True, "'scenario.toml' does not fit its checksum"), (False, "scenario.toml changed")]
)
def test_a_damaged_scenario_is_refused_whatever_checksums_there_are(
    whole: bytes, tmp_path: Path, checksum: bool, text: str
) -> None:
    (tmp_path / "a.mcap").write_bytes(without_data_checksum(with_another_baseline(whole, checksum=checksum)))
    with pytest.raises(LogError, match=text):
        read(tmp_path / "a.mcap")
    bare = ("the data as a whole",) if checksum else ("attachment 'scenario.toml'", "the data as a whole")
    assert info(tmp_path / "a.mcap").unprotected == bare


def plain_log(path: Path, fill: Any, **options: Any) -> Path:
    with path.open("wb") as stream:
        plain = Writer(stream, **options)
        plain.start()
        fill(plain)
        plain.finish()  # type: ignore[no-untyped-call]
    return path


def test_what_has_no_checksum_is_called_unprotected(tmp_path: Path) -> None:
    def fill(plain: Writer) -> None:
        channel = plain.register_channel("/auv/motion", "protobuf", register_schema(plain, OWN_MOTION.message_class))
        for k in range(20):
            plain.add_message(channel, k * 10**8, OWN_MOTION.message_class(speed=1.0).SerializeToString(), k * 10**8)

    path = plain_log(tmp_path / "a.mcap", fill, enable_crcs=False, chunk_size=200)
    bare = info(path).unprotected
    assert bare[0].endswith("chunks")
    assert bare[1:] == ("the data as a whole", "the summary")
    path.write_bytes(path.read_bytes()[:-40])
    said: list[str] = []
    rescued = recover(path, said.append)
    assert said[0].startswith(bare[0])
    assert "not protected" in said[0]
    # the copy has checksums of its own, and says that they prove nothing of what was copied
    assert "not protected" in info(rescued).metadata["recovery 0"]["0"]


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_small_log_does_not_unfold_without_bound(tmp_path: Path, compression: CompressionType) -> None:
    """Gigabytes of zeros in a small file are refused before they are unfolded."""

    def fill(plain: Writer) -> None:
        schema = register_schema(plain, OWN_MOTION.message_class)
        channels = [plain.register_channel(f"/follower/{name}", "protobuf", schema) for name in ("motion", "reception")]
        for _ in range(30):
            for channel in channels:
                plain.add_message(channel, 0, bytes(8 << 20), 0)

    path = plain_log(tmp_path / "a.mcap", fill, compression=compression, chunk_size=8 << 20)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for reader in (read, read_measurements, lambda p: export(p, tmp_path / "tables")):
        with pytest.raises(LogError, match=r"a\.mcap: damaged: .*(unfolds to more than|would unfold to)"):
            reader(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 150_000
    assert not (tmp_path / "tables").exists()


def test_many_empty_messages_do_not_fill_the_memory(tmp_path: Path) -> None:
    def fill(plain: Writer) -> None:
        plain.add_message(plain.register_channel("/follower/motion", "protobuf", 0), 0, b"", 0)

    # without a summary nothing in the file says where something else lies
    bare = {"enable_crcs": False, "use_chunking": False, "repeat_channels": False, "use_statistics": False}
    options = {"use_summary_offsets": False, "index_types": IndexType.NONE}
    data = plain_log(tmp_path / "a.mcap", fill, **bare, **options).read_bytes()
    with BytesIO(data) as stream:
        end = next(place for place in places(stream) if place.opcode == Opcode.DATA_END).start - HEAD.size
    empty = HEAD.pack(Opcode.MESSAGE, 22) + (1).to_bytes(2, "little") + bytes(20)
    many, chunk = 600_000 * empty, RecordBuilder()
    Chunk("zstd", zstandard.compress(many), 0, 0, zlib.crc32(many), len(many)).write(chunk)
    (tmp_path / "a.mcap").write_bytes(data[:end] + chunk.end() + data[end:])
    assert (tmp_path / "a.mcap").stat().st_size < 10_000
    with pytest.raises(LogError, match="unfolds to more than"):
        read_measurements(tmp_path / "a.mcap")


def test_a_chunk_that_lies_about_its_size_is_refused(whole: bytes, tmp_path: Path) -> None:
    with BytesIO(whole) as stream:
        chunk = next(place for place in places(stream) if place.opcode == Opcode.CHUNK)
    changed = without_data_checksum(whole)
    size = int.from_bytes(changed[chunk.start + 16 : chunk.start + 24], "little")
    changed[chunk.start + 16 : chunk.start + 24] = (size - 1).to_bytes(8, "little")
    (tmp_path / "a.mcap").write_bytes(changed)
    with pytest.raises(LogError, match=f"says that it unfolds to {size - 1} bytes"):
        read(tmp_path / "a.mcap")


def test_topics_of_any_name_have_a_table_of_their_own(tmp_path: Path) -> None:
    topics = ["/a/b", "/a_b", "/A/B", "/a\0b", "/../x", "/é/\n", ""]

    def fill(plain: Writer) -> None:
        schema = register_schema(plain, OWN_MOTION.message_class)
        for k, topic in enumerate(topics):
            channel = plain.register_channel(topic, "protobuf", schema)
            plain.add_message(channel, 0, OWN_MOTION.message_class(speed=float(k)).SerializeToString(), 0)

    files = export(plain_log(tmp_path / "a.mcap", fill), tmp_path / "tables")
    # in order of topic: "", "/../x", "/A/B", "/a\0b", "/a/b", "/a_b", "/é/\n"; some disks don't tell case apart
    stems = ["channel", ".._x", "A_B", "a%00b", "a_b~2", "a_b~3", "%C3%A9_%0A"]
    assert [f.name for f in files] == [f"{stem}.parquet" for stem in stems]
    assert {f.parent for f in files} == {tmp_path / "tables"}
    speeds = {pyarrow.parquet.read_table(f)["speed"][0].as_py() for f in files}
    assert speeds == {float(k) for k in range(len(topics))}


def test_an_excerpt_is_no_log(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="begins with its mission; this flight at 5 s"):
        writer.write(excerpt(flight, 5.0, 9.0), tmp_path / "a.mcap")

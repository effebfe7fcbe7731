"""Damaged, unfinished and foreign files: a clear error or a rescued log, never another flight."""

import os
import re
import signal
import struct
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from sim.flight import FlightRecord, Termination
from sim.log import writer
from sim.log.contents import Contents, LogError, partial_path, recover
from sim.log.export import export
from sim.log.reader import read, read_recording
from tests.synthetic import bits, make_flight, short_flight, write_log


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return short_flight()


@pytest.fixture(scope="module")
def written(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(flight, tmp_path_factory.mktemp("log"))


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "text").write_text("speed,heading\n1,2\n")
    for name, text in (
        ("empty", "no MCAP"),
        ("text", "no MCAP"),
        ("absent", "No such file"),
        (".", "directory"),
    ):
        for reader in (read, read_recording, Contents):
            with pytest.raises(LogError, match=text):
                reader(tmp_path / name)


@pytest.mark.system
def test_every_flipped_bit_is_detected(flight: FlightRecord, written: Path, tmp_path: Path) -> None:
    """A flipped bit in the data section is refused with one line; one behind it is refused or does
    not change the flight.
    """
    log_bytes, random = written.read_bytes(), np.random.default_rng(2)
    # the footer has 29 bytes, the magic 8, and the end of the data before the summary 13
    footer = len(log_bytes) - 8 - 29
    summary = struct.unpack("<Q", log_bytes[footer + 9 : footer + 17])[0]
    byte_indices = [
        *random.choice(len(log_bytes), 550, replace=False).tolist(),
        *range(9),
        *range(summary - 13, summary),
    ]
    refused, lines = 0, []
    for byte_index in [*byte_indices, *range(footer, len(log_bytes))]:
        damaged = bytearray(log_bytes)
        damaged[byte_index] ^= 1 << int(random.integers(8))
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        try:
            assert bits(read(tmp_path / "damaged.mcap")) == bits(flight)
        except LogError as error:
            refused += byte_index < summary - 13
            lines.append(str(error))
    assert refused == sum(byte_index < summary - 13 for byte_index in byte_indices)
    assert all(
        re.fullmatch(r"\S+\.mcap: (damaged or cut off at byte \d+: [^\n]+|no MCAP file)", x)
        for x in lines
    )


def test_a_cut_off_log_is_refused_and_recovered(
    flight: FlightRecord, written: Path, tmp_path: Path
) -> None:
    log_bytes, printed = written.read_bytes(), list[str]()
    for length in (9, 3 * len(log_bytes) // 4, len(log_bytes) - 1):
        (tmp_path / "cut.mcap").write_bytes(log_bytes[:length])
        with pytest.raises(
            LogError,
            match=(
                r"damaged or cut off at byte \d+: the file ends within a record; "
                "laisn log recover"
            ),
        ):
            read(tmp_path / "cut.mcap")
    # all of the data is there
    rescued = recover(tmp_path / "cut.mcap", printed.append)
    assert rescued.name == "cut.recovered.mcap"
    assert (tmp_path / "cut.mcap").exists()
    assert bits(read(rescued)) == bits(flight)
    message_count = sum(len(messages.times) for messages in Contents(written).topics.values())
    assert printed[0] == f"kept {message_count} messages of 30 s and 4 attachments"
    assert re.fullmatch(
        r"left out: damaged or cut off at byte \d+: the file ends within a record", printed[1]
    )
    with pytest.raises(LogError, match="is complete"):
        recover(rescued)
    (tmp_path / "cut.mcap").write_bytes(log_bytes[: 2 * len(log_bytes) // 3])
    part = read(recover(tmp_path / "cut.mcap", printed.append))
    assert part.outcome is Termination.INTERRUPTED
    instants = part.trajectory.time.size
    assert part.trajectory.position.tobytes() == flight.trajectory.position[:instants].tobytes()
    assert printed[2] == "metadata conventions, laisn: no checksum, damage cannot be detected"
    assert re.fullmatch(
        rf"kept \d+ messages of {(instants - 1) / 10:g} s and 3 attachments", printed[3]
    )
    assert re.fullmatch(
        r"left out: damaged or cut off at byte \d+: the file ends within a record", printed[4]
    )
    (tmp_path / "cut.mcap").write_bytes(log_bytes[:5000])
    with pytest.raises(LogError, match="nothing to recover"):
        recover(tmp_path / "cut.mcap")


@pytest.mark.parametrize("appendix", ["a byte", "text", "zeros", "another log"])
def test_bytes_behind_the_end_are_called_so_and_left_out(
    flight: FlightRecord, written: Path, tmp_path: Path, appendix: str
) -> None:
    log_bytes = written.read_bytes()
    appended = {
        "a byte": b"\0",
        "text": b"end of mission\n",
        "zeros": bytes(3000),
        "another log": log_bytes,
    }[appendix]
    long = tmp_path / "long.mcap"
    long.write_bytes(log_bytes + appended)
    for reader in (read, read_recording, Contents):
        with pytest.raises(
            LogError, match=r"long\.mcap: damaged .* at byte \d+: bytes follow the end of the log"
        ):
            reader(long)
    rescued = recover(long)
    assert rescued.name == "long.recovered.mcap"
    assert bits(read(rescued)) == bits(flight)
    assert long.exists()
    partial_path(tmp_path / "b.mcap").write_bytes(log_bytes + appended)
    assert bits(read(recover(tmp_path / "b.mcap.partial"))) == bits(flight)
    assert not (tmp_path / "b.mcap.partial").exists()


def test_a_damaged_log_with_bytes_behind_its_end_gives_what_stands_before_the_damage(
    tmp_path: Path,
) -> None:
    flight = make_flight(45.0)
    writer.write(flight, tmp_path / "c.mcap")
    damaged = bytearray((tmp_path / "c.mcap").read_bytes())
    damaged[len(damaged) // 2] ^= 0x10
    (tmp_path / "a.mcap").write_bytes(bytes(damaged) + b"rest")
    rescued = read(recover(tmp_path / "a.mcap"))
    instants = rescued.trajectory.time.size
    assert 190 < instants < 452
    assert rescued.outcome is Termination.INTERRUPTED
    assert rescued.trajectory.position.tobytes() == flight.trajectory.position[:instants].tobytes()
    assert (
        rescued.estimates[0].state.tobytes() == flight.estimates[0].state[: instants - 1].tobytes()
    )
    damaged[8000] ^= 0x10
    (tmp_path / "b.mcap").write_bytes(bytes(damaged) + b"rest")
    with pytest.raises(LogError, match="nothing to recover"):
        recover(tmp_path / "b.mcap")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "a.mcap",
        "a.recovered.mcap",
        "b.mcap",
        "c.mcap",
    ]


def test_a_log_may_be_named_by_text(written: Path) -> None:
    assert bits(read(str(written))) == bits(read(written))
    assert (
        read_recording(str(written)).measurements.ranges.tobytes()
        == read_recording(written).measurements.ranges.tobytes()
    )
    with pytest.raises(LogError, match=r"absent\.mcap: No such file"):
        read("absent.mcap")


def test_recovery_keeps_whole_instants(tmp_path: Path) -> None:
    """Of a log of several chunks that is cut within one, a prefix of the flight is recovered, in
    which all channels end at the same time.
    """
    flight = make_flight(200.0)
    writer.write(flight, tmp_path / "a.mcap")
    log_bytes = (tmp_path / "a.mcap").read_bytes()
    partial = partial_path(tmp_path / "b.mcap")
    partial.write_bytes(log_bytes[: len(log_bytes) // 2])
    path = recover(partial)
    assert path == tmp_path / "b.mcap"
    assert not partial.exists()
    rescued = read(path)
    steps = rescued.measurements[0].speed.size
    assert 500 < steps < 1500
    assert rescued.trajectory.time.size == steps + 1
    assert (
        rescued.trajectory.position.tobytes() == flight.trajectory.position[: steps + 1].tobytes()
    )
    assert (
        rescued.estimates[0].covariance.tobytes()
        == flight.estimates[0].covariance[:steps].tobytes()
    )
    assert rescued.measurements[0].ranges.shape == (steps // 10, 3)
    assert rescued.scenario == flight.scenario


class Frames(list[tuple[float, bytes]]):
    """Frames of a film that call `write` before each of them is written."""

    def write(self, number: int) -> None:
        """Before a frame is written."""

    def __getitem__(self, number: Any) -> Any:
        self.write(number)
        return super().__getitem__(number)


def test_a_crash_costs_twenty_seconds_at_most(tmp_path: Path) -> None:
    """Each 20 s of mission are in the file when the next 20 s begin."""
    lost_s: list[float] = []

    class Film(Frames):
        def write(self, number: int) -> None:
            if number in (20, 40, 60):
                (tmp_path / "b.mcap").write_bytes(partial_path(tmp_path / "a.mcap").read_bytes())
                lost_s.append(
                    number - float(read(recover(tmp_path / "b.mcap")).trajectory.time[-1])
                )

    writer.write(
        make_flight(80.0), tmp_path / "a.mcap", video=Film((float(k), b"x") for k in range(80))
    )
    assert len(lost_s) == 3
    assert max(lost_s) < 0.3


def test_a_finished_log_under_its_partial_name_only_gets_its_name(
    written: Path, tmp_path: Path
) -> None:
    partial_path(tmp_path / "a.mcap").write_bytes(written.read_bytes())
    assert recover(tmp_path / "a.mcap.partial").read_bytes() == written.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    for path in (tmp_path / "a.mcap.partial", tmp_path, Path()):
        with pytest.raises(LogError, match="no such file"):
            recover(path)


def write_with_file_limit(folder: Path, size: int) -> subprocess.CompletedProcess[str]:
    """Write a log of 200 s in a process whose files may not grow beyond `size` bytes."""
    code = f"""
import resource, signal, sys
sys.path.insert(0, {str(Path(__file__).parents[3])!r})
from pathlib import Path
from tests.synthetic import make_flight
from sim.log import writer
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
flight = make_flight(200.0)
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
try:
    writer.write(flight, Path({str(folder)!r}) / "mission.mcap")
except writer.LogError as error:
    print(error)
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


@pytest.mark.system
def test_when_the_disk_is_full_what_was_written_can_be_recovered(tmp_path: Path) -> None:
    message = write_with_file_limit(tmp_path, 800_000).stdout
    assert (
        "cannot be written: File too large; what was written is kept: laisn log recover" in message
    )
    assert message.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["mission.mcap.partial"]
    rescued = read(recover(tmp_path / "mission.mcap.partial"))
    assert rescued.outcome is Termination.INTERRUPTED
    assert rescued.trajectory.time[-1] > 50
    assert [p.name for p in tmp_path.iterdir()] == ["mission.mcap"]


@pytest.mark.system
def test_when_the_disk_is_full_at_once_nothing_stays(tmp_path: Path) -> None:
    assert "cannot be written" in write_with_file_limit(tmp_path, 20_000).stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_no_space_left(flight: FlightRecord, tmp_path: Path) -> None:
    (tmp_path / "a.mcap.partial").symlink_to("/dev/full")
    with pytest.raises(LogError, match=r"a\.mcap: cannot be written: No space left on device"):
        writer.write(flight, tmp_path / "a.mcap")
    assert not list(tmp_path.iterdir())


def test_folders_that_cannot_be_written(
    flight: FlightRecord, written: Path, tmp_path: Path
) -> None:
    with pytest.raises(LogError, match="cannot be written: No such file or directory"):
        writer.write(flight, tmp_path / "absent" / "a.mcap")
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match="cannot be written: Not a directory"):
        writer.write(flight, tmp_path / "file" / "a.mcap")
    with pytest.raises(LogError, match="cannot be written: it is a folder"):
        writer.write(flight, tmp_path)
    assert not partial_path(tmp_path).exists()
    with pytest.raises(LogError, match="cannot be written"):
        export(written, tmp_path / "file" / "tables")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(flight: FlightRecord, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(LogError, match="cannot be written: Permission denied"):
        writer.write(flight, tmp_path / "a.mcap")


def test_an_interrupt_leaves_the_old_log_and_a_partial_one(tmp_path: Path) -> None:
    """A handler raises in the main thread: the log ends with the last whole block of 20 s before
    the frame of 150 s, at 140 s.
    """

    class Film(Frames):
        def write(self, number: int) -> None:
            if number == 1:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.5)

    (tmp_path / "a.mcap").write_bytes(b"older")
    with pytest.raises(KeyboardInterrupt):
        writer.write(
            make_flight(200.0), tmp_path / "a.mcap", video=Film([(0.0, b"x"), (150.0, b"x")])
        )
    assert (tmp_path / "a.mcap").read_bytes() == b"older"
    rescued = read(recover(tmp_path / "a.mcap.partial"))
    assert 139 < rescued.trajectory.time[-1] < 140


@pytest.mark.parametrize("delay_s", [0.001, 0.01, 0.03, 0.1, 0.2])
def test_a_signal_at_any_time_leaves_a_complete_log_or_a_partial_one_that_is_recovered(
    tmp_path: Path, delay_s: float
) -> None:
    """Python raises the exception of a handler wherever its main thread is; the library that writes
    the log would not survive one that is raised within it.
    """
    flight = make_flight(100.0)

    def interrupt(*_: object) -> None:
        raise InterruptedError

    previous_handler = signal.signal(signal.SIGALRM, interrupt)
    try:
        with suppress(LogError, InterruptedError):
            signal.setitimer(signal.ITIMER_REAL, delay_s)
            writer.write(flight, tmp_path / "a.mcap")
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            assert bits(read(tmp_path / "a.mcap")) == bits(flight)
            return
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous_handler)
    if partial_path(tmp_path / "a.mcap").exists():
        actual = read(recover(tmp_path / "a.mcap.partial"))
        instants = actual.trajectory.time.size
        assert (
            actual.trajectory.position.tobytes() == flight.trajectory.position[:instants].tobytes()
        )


def test_times_of_64_bits_are_recovered(tmp_path: Path) -> None:
    """MCAP's times are unsigned; the last record is cut."""
    times_ns = [5, 2**63, 2**64 - 1]
    with (tmp_path / "a.mcap").open("wb") as stream:
        log = Writer(stream, use_chunking=False)
        log.start()
        channel = log.register_channel("/x", "json", 0)
        for time_ns in times_ns:
            log.add_message(channel, time_ns, b"{}", time_ns)
        end = stream.tell()
    with (tmp_path / "a.mcap").open("r+b") as stream:
        stream.truncate(end - 1)
    with recover(tmp_path / "a.mcap").open("rb") as stream:
        recovered_times = [
            message.log_time for _, _, message in make_reader(stream).iter_messages()
        ]
    assert recovered_times == times_ns[:2]

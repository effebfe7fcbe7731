"""Files: no partial file under a final name after errors or kills, and locks between processes."""

import fcntl
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import BinaryIO

import pytest

from reports.version import ROOT
from sim.system import atomic_open, atomic_write, locked, remove_unfinished

pytestmark = pytest.mark.system


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def test_a_file_appears_under_its_name_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with atomic_write(path) as part_file:
        part_file.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert names(tmp_path) == ["a.txt"]


def test_content_reaches_the_disk_before_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: calls.append("fsync") or fsync(handle))
    monkeypatch.setattr(os, "replace", lambda a, b: calls.append("replace") or replace(a, b))
    with atomic_write(tmp_path / "a.txt") as part_file:
        part_file.write_text("new")
    assert calls == ["fsync", "replace"]
    with atomic_write(tmp_path / "b.txt", durable=False) as part_file:
        part_file.write_text("new")
    assert calls == ["fsync", "replace", "replace"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error), atomic_write(path) as part_file:  # noqa: PT012  (the block is what fails)
        part_file.write_text("ha")
        raise error
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_new_files_have_the_mode_of_other_new_files(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    with atomic_write(tmp_path / "a.txt") as part_file:
        part_file.touch()
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "plain").stat().st_mode


WRITER = """
import sys, time
from pathlib import Path
from sim.system import atomic_write, locked
folder = Path(sys.argv[1])
with locked(folder), atomic_write(folder / "a.txt") as part:
    part.write_text("half")
    print("ready", flush=True)
    time.sleep(60)
"""


def test_a_killed_process_leaves_no_lock_and_no_partial_file_under_a_final_name(
    tmp_path: Path,
) -> None:
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert writer.stdout is not None
    with writer:
        assert writer.stdout.readline() == "ready\n"
        with pytest.raises(BlockingIOError), locked(tmp_path, wait=False):
            pass
        writer.send_signal(signal.SIGKILL)
    with locked(tmp_path, wait=False):
        pass
    [part_file] = tmp_path.iterdir()
    assert (part_file.suffix, part_file.read_text()) == (".part", "half")


OPEN_WRITER = """
import sys, time
from pathlib import Path
from sim.system import atomic_open
with atomic_open(Path(sys.argv[1]) / "a.txt") as file:
    file.write(b"half")
    file.flush()
    print("ready", flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_writes_is_not(
    tmp_path: Path,
) -> None:
    writer = subprocess.Popen(
        [sys.executable, "-c", OPEN_WRITER, str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert writer.stdout is not None
    with writer, atomic_open(tmp_path / "b.txt") as file:
        assert writer.stdout.readline() == "ready\n"
        remove_unfinished(tmp_path)
        assert len(names(tmp_path)) == 2
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        remove_unfinished(tmp_path)
        [remaining_name] = names(tmp_path)
        assert remaining_name.startswith(".b.txt.")
        file.write(b"whole")
    assert names(tmp_path) == ["b.txt"]
    assert (tmp_path / "b.txt").read_bytes() == b"whole"


def test_a_file_that_is_removed_before_it_is_locked_is_opened_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock = fcntl.flock

    def remove_first(file: BinaryIO, operation: int) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        remove_unfinished(tmp_path)
        assert names(tmp_path) == []
        flock(file, operation)

    monkeypatch.setattr(fcntl, "flock", remove_first)
    with atomic_open(tmp_path / "a.txt") as file:
        file.write(b"whole")
    assert (tmp_path / "a.txt").read_bytes() == b"whole"
    assert names(tmp_path) == ["a.txt"]


def test_a_lock_is_waited_for(tmp_path: Path) -> None:
    order: list[str] = []

    def wait() -> None:
        with locked(tmp_path):
            order.append("second")

    with locked(tmp_path):
        second = threading.Thread(target=wait)
        second.start()
        time.sleep(0.1)
        order.append("first")
    second.join(10)
    assert order == ["first", "second"]

"""Files that appear whole or not at all, written by any number of processes, of which any may be killed."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from experiments.campaign.version import ROOT
from laisn.whole_files import held, parts, remove_abandoned, replaced


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def test_a_file_takes_its_name_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with replaced(path) as part:
        part.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_file_that_fails_leaves_the_old_one_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(error), replaced(path) as part:  # noqa: PT012  (the block is what fails)
        part.write_text("ha")
        raise error
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_new_files_have_the_mode_of_other_new_files(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    with replaced(tmp_path / "a.txt"):
        pass
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "plain").stat().st_mode


WRITER = """
import sys, time
from pathlib import Path
from laisn.whole_files import held, replaced
folder = Path(sys.argv[1])
with replaced(folder / "a.txt") as part, held(folder / "work"):
    part.write_text("half")
    print("ready", flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_holds_is_not(tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    (work / "inside").touch()
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert writer.stdout is not None
    with writer:
        assert writer.stdout.readline() == "ready\n"
        remove_abandoned([*parts(tmp_path), work])
        [part] = parts(tmp_path)
        assert part.read_text() == "half"
        assert (work / "inside").exists()
        writer.send_signal(signal.SIGKILL)
    remove_abandoned([*parts(tmp_path), work])
    assert names(tmp_path) == []


def test_links_and_other_files_are_left_alone(tmp_path: Path) -> None:
    kept = tmp_path / "kept.part"
    kept.touch()
    link = tmp_path / ".link.part"
    link.symlink_to(kept)
    remove_abandoned([*parts(tmp_path), tmp_path / "absent"])
    assert names(tmp_path) == [".link.part", "kept.part"]


def test_sweeping_while_others_write_costs_them_nothing(tmp_path: Path) -> None:
    """A sweep may come between the making of a file and its being held."""
    done = threading.Event()

    def sweep() -> None:
        while not done.is_set():
            remove_abandoned(parts(tmp_path))

    sweeper = threading.Thread(target=sweep)
    sweeper.start()
    try:
        for i in range(300):
            with replaced(tmp_path / "a.txt") as part:
                part.write_text(f"{i}")
            assert (tmp_path / "a.txt").read_text() == f"{i}"
    finally:
        done.set()
        sweeper.join()
    assert names(tmp_path) == ["a.txt"]


def test_one_holds_at_a_time(tmp_path: Path) -> None:
    first, second = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(first)
        with held(tmp_path):
            os.write(second, b"1")
        os._exit(0)
    os.close(second)
    try:
        assert os.read(first, 1) == b"1"
        with held(tmp_path):
            pass
    finally:
        os.waitpid(child, 0)
        os.close(first)

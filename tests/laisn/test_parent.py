"""Tasks in a copy of this process, beside what goes on here."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from laisn.failure import LaisnError
from laisn.parent import alongside


def wait_for(path: Path) -> None:
    end = time.monotonic() + 20.0
    while not path.exists():
        assert time.monotonic() < end, f"{path.name} never came"
        time.sleep(0.005)


def test_a_task_goes_on_beside_the_block(tmp_path: Path) -> None:
    """Each waits for what the other does, which no order of one after the other would give."""
    here, there = tmp_path / "here", tmp_path / "there"
    given = [1, 2, 3]

    def task() -> None:
        wait_for(here)
        there.write_text(f"{sum(given)} {os.getpid()}")

    with alongside(task):
        here.touch()
        wait_for(there)
    total, process = there.read_text().split()
    assert total == "6"
    assert int(process) != os.getpid()


def test_the_end_of_the_block_waits_for_the_task(tmp_path: Path) -> None:
    def task() -> None:
        time.sleep(0.3)
        (tmp_path / "done").touch()

    with alongside(task):
        pass
    assert (tmp_path / "done").exists()


def refuse() -> None:
    raise LaisnError("no such route")


def stumble() -> None:
    raise OSError(28, "No space left on device", "report.html")


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize(
    ("task", "error", "text"),
    [
        (refuse, LaisnError, "no such route"),
        (stumble, OSError, "No space left on device: 'report.html'"),
        (die, RuntimeError, "exit code -9 and without an answer"),
    ],
)
def test_what_a_task_raises_is_raised_here(task: Callable[[], None], error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text) as raised, alongside(task):
        pass
    assert task is die or f"in {task.__name__}" in str(raised.value.__cause__)


def test_a_block_that_fails_ends_the_task(tmp_path: Path) -> None:
    begun = tmp_path / "begun"

    def task() -> None:
        begun.write_text(str(os.getpid()))
        time.sleep(60)

    def fail() -> None:
        wait_for(begun)
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), alongside(task):
        fail()
    assert time.monotonic() - start < 30
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)

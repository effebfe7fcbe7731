"""Tasks in a copy of this process, beside what goes on here."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

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

    def task(factor: int) -> None:
        wait_for(here)
        there.write_text(f"{factor * sum(given)} {os.getpid()}")

    with alongside(lambda: task) as beside, beside(7):
        here.touch()
        wait_for(there)
    total, process = there.read_text().split()
    assert total == "42"
    assert int(process) != os.getpid()


def test_the_end_of_the_block_waits_for_the_task(tmp_path: Path) -> None:
    def task() -> None:
        time.sleep(0.3)
        (tmp_path / "done").touch()

    with alongside(lambda: task) as beside:
        with beside():
            pass
        assert (tmp_path / "done").exists()


def test_a_task_is_prepared_before_it_is_asked_for(tmp_path: Path) -> None:
    ready = tmp_path / "ready"

    def prepare() -> Callable[[str], object]:
        ready.write_text(str(os.getpid()))
        return ready.write_text

    with alongside(prepare) as beside:
        wait_for(ready)
        # more than a pipe holds
        with beside("x" * 1_000_000):
            pass
    assert ready.stat().st_size == 1_000_000


def test_a_copy_that_nothing_is_asked_of_ends(tmp_path: Path) -> None:
    ready = tmp_path / "ready"

    def prepare() -> Callable[[], None]:
        ready.write_text(str(os.getpid()))
        ready.with_name("whole").touch()
        return lambda: None

    with alongside(prepare):
        wait_for(ready.with_name("whole"))
    with pytest.raises(ProcessLookupError):
        os.kill(int(ready.read_text()), 0)


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
    with pytest.raises(error, match=text) as raised, alongside(lambda: task) as beside, beside():
        pass
    assert task is die or f"in {task.__name__}" in str(raised.value.__cause__)


@pytest.mark.parametrize(("prepare", "error"), [(refuse, LaisnError), (die, RuntimeError)])
def test_what_fails_before_the_task_is_raised_when_it_is_asked_for(
    prepare: Callable[[], Any], error: type[Exception]
) -> None:
    """Also where the copy is gone before it could take what it is sent."""
    with pytest.raises(error), alongside(prepare) as beside, beside("x" * 1_000_000):
        pass


def test_a_block_that_fails_ends_the_task(tmp_path: Path) -> None:
    begun = tmp_path / "begun"

    def task() -> None:
        begun.write_text(str(os.getpid()))
        begun.with_name("whole").touch()
        time.sleep(60)

    def fail() -> None:
        wait_for(begun.with_name("whole"))
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), alongside(lambda: task) as beside, beside():
        fail()
    assert time.monotonic() - start < 30
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)

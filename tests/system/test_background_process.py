"""A task in a background process: it works beside the block, and what it raises is raised by its
result.
"""

import os
import signal
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

from laisn.errors import LaisnError
from sim.system import background_process

pytestmark = pytest.mark.system


def wait_for(path: Path) -> None:
    end = time.monotonic() + 20.0
    while not path.exists():
        assert time.monotonic() < end, f"{path.name} never came"
        time.sleep(0.005)


def meet(here: Path, there: Path) -> int:
    wait_for(here)
    there.touch()
    return os.getpid()


def test_a_task_works_beside_the_block(tmp_path: Path) -> None:
    """Each waits for what the other does, which no order of one after the other would give."""
    here, there = tmp_path / "here", tmp_path / "there"
    with background_process(os.getpid) as background:
        actual = background.submit(meet, here, there)
        here.touch()
        wait_for(there)
        assert actual.result() != os.getpid()


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
        (die, BrokenProcessPool, "terminated abruptly"),
    ],
)
def test_what_a_task_raises_is_raised_by_its_result(task, error, text) -> None:
    with pytest.raises(error, match=text) as raised, background_process() as background:
        background.submit(task).result()
    assert task is die or f"in {task.__name__}" in str(raised.value.__cause__)


def sleep_after(begun: Path) -> None:
    begun.write_text(str(os.getpid()))
    begun.with_name("whole").touch()
    time.sleep(60)


def test_a_block_that_fails_kills_the_task(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), background_process() as background:  # noqa: PT012  (the block is what fails)
        background.submit(sleep_after, begun)
        wait_for(tmp_path / "whole")
        raise KeyboardInterrupt
    assert time.monotonic() - start < 30
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)


def test_a_signal_during_the_fork_reaches_its_handler() -> None:
    """Python prints and discards what a handler raises within a hook of the fork."""
    parent, sent = os.getpid(), list[int]()

    def send() -> None:
        if os.getpid() == parent and not sent:
            sent.append(signal.SIGTERM)
            os.kill(parent, signal.SIGTERM)

    os.register_at_fork(after_in_parent=send)

    def interrupt(number: int, _: object) -> None:
        raise KeyboardInterrupt(signal.Signals(number).name)

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt, match="SIGTERM"), background_process():
            pytest.fail("the block begins in spite of the signal")
    finally:
        signal.signal(signal.SIGTERM, before)
    assert sent

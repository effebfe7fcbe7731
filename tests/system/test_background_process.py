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
    deadline = time.monotonic() + 20.0
    while not path.exists():
        assert time.monotonic() < deadline, f"{path.name} never came"
        time.sleep(0.005)


def wait_and_touch(awaited: Path, touched: Path) -> int:
    wait_for(awaited)
    touched.touch()
    return os.getpid()


def test_a_task_works_beside_the_block(tmp_path: Path) -> None:
    """Block and task each wait for a file of the other, so neither can be first."""
    by_block, by_task = tmp_path / "by_block", tmp_path / "by_task"
    with background_process(os.getpid) as background:
        task_pid = background.submit(wait_and_touch, by_block, by_task)
        by_block.touch()
        wait_for(by_task)
        assert task_pid.result() != os.getpid()


def raise_project_error() -> None:
    raise LaisnError("no such route")


def raise_os_error() -> None:
    raise OSError(28, "No space left on device", "report.html")


def kill_itself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize(
    ("task", "error", "text"),
    [
        (raise_project_error, LaisnError, "no such route"),
        (raise_os_error, OSError, "No space left on device: 'report.html'"),
        (kill_itself, BrokenProcessPool, "terminated abruptly"),
    ],
)
def test_the_result_raises_what_the_task_raises(task, error, text) -> None:
    with pytest.raises(error, match=text) as raised, background_process() as background:
        background.submit(task).result()
    assert task is kill_itself or f"in {task.__name__}" in str(raised.value.__cause__)


def write_pid_and_sleep(pid_file: Path) -> None:
    pid_file.write_text(str(os.getpid()))
    pid_file.with_name("pid_is_written").touch()
    time.sleep(60)


def test_a_block_that_fails_kills_the_task(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt), background_process() as background:  # noqa: PT012  (the block is what fails)
        background.submit(write_pid_and_sleep, pid_file)
        wait_for(tmp_path / "pid_is_written")
        raise KeyboardInterrupt
    assert time.monotonic() - start < 30
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid_file.read_text()), 0)


def test_a_signal_during_the_fork_reaches_its_handler() -> None:
    """Python prints and discards what a handler raises within a hook of the fork."""
    parent, sent = os.getpid(), list[int]()

    def send_once() -> None:
        if os.getpid() == parent and not sent:
            sent.append(signal.SIGTERM)
            os.kill(parent, signal.SIGTERM)

    os.register_at_fork(after_in_parent=send_once)

    def interrupt(number: int, _: object) -> None:
        raise KeyboardInterrupt(signal.Signals(number).name)

    previous_handler = signal.signal(signal.SIGTERM, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt, match="SIGTERM"), background_process():
            pytest.fail("the block begins in spite of the signal")
    finally:
        signal.signal(signal.SIGTERM, previous_handler)
    assert sent

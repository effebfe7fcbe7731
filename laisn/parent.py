"""Processes that end with the one that started them, however that ends."""

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection

_LOOK_EVERY_S = 0.2


def end_with(parent: int) -> None:
    """End this process as soon as the process of that number, which started it, is gone; leave Ctrl-C to that one.

    A process that is killed can end nothing itself. To be called from the main thread.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


class _ElsewhereError(Exception):
    """Cause of an exception that came from another process; its text is the traceback there."""


def _report(prepare: Callable[[], Callable[..., None]], parent: int, line: Connection) -> None:
    """In a copy of the parent, prepare a task, run it on what is sent, and answer with what it raised, or nothing."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    end_with(parent)
    # whatever shows progress in the parent may have held its lock when it was copied
    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
    try:
        task = prepare()
        task(*line.recv())
    except BaseException as error:
        line.send((error, traceback.format_exc()))
    else:
        line.send(None)


@contextmanager
def alongside(prepare: Callable[[], Callable[..., None]]) -> Iterator[Callable[..., AbstractContextManager[None]]]:
    """Keep a copy of this process at hand while the block runs, for a task that goes on beside it.

    The copy calls `prepare` at once, which may import what takes long, and gives the task. It shares memory with this
    process until one of them writes to it.

    Yields:
        Called with the task's arguments once, it runs the task while a block of its own runs; the end of that waits for
        the task. Of what the task does, files stay, and what it raises is raised here. If a block fails, or nothing was
        asked for, the copy is ended.
    """
    fork = get_context("fork")
    line, other = fork.Pipe()
    process = fork.Process(target=_report, args=(prepare, os.getpid(), other), daemon=True)
    process.start()
    other.close()

    @contextmanager
    def run(*arguments: object) -> Iterator[None]:
        # a copy that is gone says why below
        with suppress(BrokenPipeError, ConnectionResetError):
            line.send(arguments)
        yield
        try:
            raised = line.recv()
        except (EOFError, ConnectionResetError):
            process.join()
            raise RuntimeError(f"a process ended with exit code {process.exitcode} and without an answer") from None
        if raised is not None:
            error, where = raised
            raise error from _ElsewhereError(where)

    try:
        yield run
    finally:
        process.kill()
        process.join()
        line.close()

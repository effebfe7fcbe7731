"""Processes that end with the one that started them, however that ends."""

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


def _report(task: Callable[[], None], parent: int, answer: Connection) -> None:
    """Run a task in a copy of its parent, and answer with what it raised, or with nothing."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    end_with(parent)
    # whatever shows progress in the parent may have held its lock when it was copied
    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
    try:
        task()
    except BaseException as error:
        answer.send((error, traceback.format_exc()))
    else:
        answer.send(None)


@contextmanager
def alongside(task: Callable[[], None]) -> Iterator[None]:
    """Run a task in a copy of this process while the block runs; the end of the block waits for it.

    The copy shares memory with this process until one of them writes to it, so that nothing is handed over. Of what the
    task does, files stay, and what it raises is raised here. If the block fails, the task is ended.
    """
    fork = get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)
    process = fork.Process(target=_report, args=(task, os.getpid(), sender), daemon=True)
    process.start()
    sender.close()
    try:
        yield
        try:
            raised = receiver.recv()
        except EOFError:
            process.join()
            raise RuntimeError(f"a process ended with exit code {process.exitcode} and without an answer") from None
    finally:
        process.kill()
        process.join()
        receiver.close()
    if raised is not None:
        error, where = raised
        raise error from _ElsewhereError(where)

"""Child processes: they exit with their parent, and work beside it."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager

_CHECK_PARENT_S = 0.5


def exit_with_parent(parent: int) -> None:
    """Exit this process when its parent has ended, even if that was killed; leave Ctrl-C to the parent.

    To be called from the main thread.

    Args:
        parent: number of the process that started this one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_CHECK_PARENT_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def background_process(first: Callable[[], object] | None = None) -> Iterator[ProcessPoolExecutor]:
    """An executor of one process, forked at its first task; if the block fails, it is killed.

    Args:
        first: task that it starts with, such as imports.
    """
    executor = ProcessPoolExecutor(
        1, multiprocessing.get_context("fork"), initializer=exit_with_parent, initargs=(os.getpid(),)
    )
    others = {child.pid for child in multiprocessing.active_children()}
    try:
        if first is not None:
            executor.submit(first)
        yield executor
    except BaseException:
        for child in multiprocessing.active_children():
            if child.pid is not None and child.pid not in others:
                child.kill()
        raise
    finally:
        executor.shutdown(cancel_futures=True)

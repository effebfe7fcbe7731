"""Files, locks and child processes: atomic writing, and processes that exit with their parent."""

import ctypes
import fcntl
import multiprocessing
import os
import secrets
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from laisn.failure import LaisnError

_STALE_S = 3600.0  # age at which a temporary file belongs to a process that was killed
_CHECK_PARENT_S = 0.5
_M_MMAP_THRESHOLD = -3  # of malloc.h of the GNU C library


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Write a file so that its final name never shows a partial file, whatever processes write it at once.

    Yields the path of a temporary file, for the block to create; if the block fails, `path` stays as it was.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(6)}.part")
    try:
        yield part
        with part.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def remove_stale_parts(folder: Path) -> None:
    """Remove temporary files that killed processes left in a folder; others may still be written."""
    for part in folder.glob(".*.part"):
        # another process may rename it
        with suppress(FileNotFoundError):
            if part.stat(follow_symlinks=False).st_mtime < time.time() - _STALE_S:
                part.unlink()


@contextmanager
def locked(folder: Path, *, wait: bool = True) -> Iterator[None]:
    """Lock a folder for the block; the system releases the lock of a process that is killed.

    A file system without locks is used without. With `wait` unset, BlockingIOError: another process holds the lock.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            if isinstance(error, BlockingIOError):
                raise
        yield
    finally:
        os.close(handle)


def read_text(path: Path, max_bytes: int) -> str:
    """Text of a regular file that a user names, without a byte order mark; a pipe or a device might never end.

    Raises:
        LaisnError: the file cannot be read, is not regular, is too large or is not UTF-8; gives the reason alone.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise LaisnError("it is a folder" if stat.S_ISDIR(status.st_mode) else "it is no plain file")
        if status.st_size > max_bytes:
            raise LaisnError(f"it has {status.st_size} bytes, there may be {max_bytes}")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LaisnError(error.strerror or str(error)) from None
    except UnicodeDecodeError:
        raise LaisnError("not UTF-8 text") from None
    except ValueError as error:
        # one of these, or a NUL in the path
        raise LaisnError(str(error)) from None


def exit_with_parent(parent: int) -> None:
    """Exit this process when its parent, of this number, has ended, even if that was killed; leave Ctrl-C to it.

    To be called from the main thread.
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
    others = multiprocessing.active_children()
    try:
        if first is not None:
            executor.submit(first)
        yield executor
    except BaseException:
        for child in multiprocessing.active_children():
            if child not in others:
                child.kill()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


def return_large_blocks() -> None:
    """Let the C library return every freed block of 1 MB or more to the system, where it has such a setting.

    Otherwise glibc keeps freed arrays of up to 32 MB for itself, which raises the peak of a long mission.
    """
    with suppress(AttributeError):
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, 1 << 20)

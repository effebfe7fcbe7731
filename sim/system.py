"""Files, locks and child processes: atomic writing, and processes that exit with their parent."""

import ctypes
import fcntl
import hashlib
import multiprocessing
import os
import secrets
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

from laisn.errors import LaisnError

_CHECK_PARENT_S = 0.5  # how often a child looks whether its parent still runs [s]
_M_MMAP_THRESHOLD = -3  # of malloc.h of the GNU C library


@contextmanager
def atomic_write(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """Yield a path for the block to create a file at, which replaces `path`, whole, when the
    block has succeeded. An OSError of the block that names no file, as of a full disk, names it.

    A file that is not `durable` may be cut if the power fails soon after; it waits for no disk.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(6)}.part")
    try:
        yield temporary
        if durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_open(path: Path, *, durable: bool = True) -> Iterator[BinaryIO]:
    """Yield an open file that replaces `path` as in `atomic_write`; `remove_unfinished` can tell
    that its writer lives, by a lock on it.
    """
    # the file is closed, and its lock gone, only when it has its name
    with ExitStack() as ending, atomic_write(path, durable=durable) as temporary:
        file = ending.enter_context(temporary.open("wb"))
        # `remove_unfinished` may come between, and remove what is not locked yet
        while not _claimed(file, temporary):
            file = ending.enter_context(temporary.open("wb"))
        yield file
        file.flush()


def _claimed(file: BinaryIO, path: Path) -> bool:
    """Lock an open file; whether `path` is still its path. A file system without locks is used
    without.
    """
    with suppress(OSError):
        fcntl.flock(file, fcntl.LOCK_EX)
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def remove_unfinished(folder: Path) -> None:
    """Remove from a folder, and those in it, what killed processes have left half-written.

    Files of `atomic_open` stay whose writers live, of this machine or another; `atomic_write` must
    not be at work there.
    """
    for path in folder.rglob(".*.part"):
        # opened for writing, which locks of network file systems need
        with suppress(OSError), path.open("r+b") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()


@contextmanager
def locked(folder: Path, *, wait: bool = True) -> Iterator[None]:
    """Lock a folder for the block; the system releases the lock of a process that is killed.

    A file system without locks is used without. With `wait` unset, BlockingIOError: another process
    holds the lock.
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
    """Text of a regular file that a user names, without a byte order mark; a pipe or a device might
    never end.

    LaisnError, with the reason alone, if the file cannot be read, is not regular, is too large or
    is not UTF-8.
    """
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise LaisnError("it is a folder" if path.is_dir() else "it is no plain file")
        if size > max_bytes:
            raise LaisnError(f"it has {size} bytes, there may be {max_bytes}")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LaisnError(error.strerror or str(error)) from None
    except UnicodeDecodeError:
        raise LaisnError("not UTF-8 text") from None
    except ValueError as error:
        # a LaisnError from above, which is a ValueError, or a NUL character in the path
        raise LaisnError(str(error)) from None


def file_digest(path: Path) -> str | None:
    """SHA-256 of a file's content; None if it cannot be read."""
    try:
        state = path.stat()
        return _digest(path, state.st_mtime_ns, state.st_size)
    except OSError:
        return None


# time of the last change and size are only keys of the cache: a changed file is read again
@lru_cache(maxsize=64)
def _digest(path: Path, _changed_ns: int, _size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def exit_with_parent(parent: int, *environment: tuple[str, str]) -> None:
    """Exit this process when its parent, of this number, has ended, even if that was killed; leave
    Ctrl-C to it.

    `environment` are names and values of variables that it sets.
    """
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_CHECK_PARENT_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def signals_after() -> Iterator[None]:
    """Ctrl-C and signals to end reach their handlers after the block."""
    came = list[int]()  # numbers of the signals that came within the block
    handlers = dict[int, Any]()
    if threading.current_thread() is threading.main_thread():
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        handlers = {
            number: signal.signal(number, lambda received, _: came.append(received))
            for number in numbers
        }
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


@contextmanager
def background_process(first: Callable[[], object] = os.getpid) -> Iterator[ProcessPoolExecutor]:
    """An executor of one process, which begins with the task `first`; if the block fails, it is
    killed.
    """
    executor = ProcessPoolExecutor(
        1,
        multiprocessing.get_context("fork"),
        initializer=exit_with_parent,
        initargs=(os.getpid(),),
    )
    others = multiprocessing.active_children()
    try:
        # the hooks of a fork discard what handlers raise
        with signals_after():
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
    """Let the C library return every freed block of 1 MB or more to the system, where it has such a
    setting.

    Otherwise glibc keeps freed arrays of up to 32 MB for itself, which raises the peak of a long
    mission.
    """
    with suppress(AttributeError):
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, 1 << 20)

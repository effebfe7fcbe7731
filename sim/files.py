"""Files: atomic writing, locks between processes, and text files of users."""

import fcntl
import os
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from laisn.failure import LaisnError

_STALE_S = 3600.0
"""Age at which a temporary file belongs to a process that was killed."""


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Write a file so that its final name never shows a partial file.

    Any number of processes may write the same file at once: readers find the complete file of one of them.

    Args:
        path: to be created or replaced when the block ends; if the block fails, `path` stays as it was.

    Yields:
        Path of a temporary file in the same folder, for the block to create.

    Raises:
        OSError: the folder cannot be written.
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

    A file system without locks is used without.

    Args:
        folder: to be locked.
        wait: until another process releases it.

    Raises:
        BlockingIOError: another process holds the lock, and `wait` is not set.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            raise
        except OSError:
            pass
        yield
    finally:
        os.close(handle)


def read_text(path: Path, max_bytes: int) -> str:
    """Text of a file that a user names, without a byte order mark.

    Args:
        path: of a regular file; reading a pipe or a device might never end.
        max_bytes: largest size.

    Raises:
        LaisnError: the file cannot be read, is not regular, is too large or is not UTF-8; gives the reason alone.
    """
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode) and status.st_size <= max_bytes:
            return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LaisnError(error.strerror or str(error)) from None
    except UnicodeDecodeError:
        raise LaisnError("not UTF-8 text") from None
    except ValueError as error:
        raise LaisnError(str(error)) from None  # a NUL in the path
    if stat.S_ISREG(status.st_mode):
        raise LaisnError(f"it has {status.st_size} bytes, there may be {max_bytes}")
    raise LaisnError("it is a folder" if stat.S_ISDIR(status.st_mode) else "it is no plain file")

"""Files that appear whole or not at all, and what is left of those whose writer was killed.

Whoever writes holds a lock on what is unfinished. The system gives the lock up when the process ends, however it ends,
and whatever its number was: what nobody holds, nobody will finish.
"""

import fcntl
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold a file or folder for the block; wait while another process holds it.

    On a file system without locks, this holds nothing, and nothing counts as abandoned.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _created(path: Path) -> int:
    """Create a file and hold it; the handle that does."""
    handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
    with suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A file to write that takes the place of `path` when the block ends; if the block fails, it is removed.

    Any number of processes may replace the same file at once: readers find one of theirs, whole.

    Args:
        path: to appear or to be replaced.

    Yields:
        An empty file beside it, to be opened by its name.

    Raises:
        OSError: the folder cannot be written.
    """
    while True:
        part = path.with_name(f".{path.name}.{secrets.token_hex(6)}.part")
        handle = _created(part)
        if part.exists():
            break
        # taken for abandoned before it was held
        os.close(handle)
    try:
        yield part
        os.replace(part, path)
    finally:
        os.close(handle)
        part.unlink(missing_ok=True)


def remove_abandoned(paths: Iterable[Path]) -> None:
    """Remove those unfinished files and folders that nobody holds any more."""
    for path in paths:
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
        except OSError:
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        except OSError:
            # held, or not ours to remove
            pass
        finally:
            os.close(handle)


def parts(folder: Path) -> Iterator[Path]:
    """Unfinished files of `replaced` in a folder and the folders within."""
    return folder.rglob(".*.part")

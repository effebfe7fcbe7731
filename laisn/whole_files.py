"""Files that appear whole or not at all, and what is left of those whose writer was killed.

Whoever writes holds a lock on what is unfinished. The system gives the lock up when the process ends, however it ends,
and whatever its number was: what nobody holds, nobody will finish.
"""

import fcntl
import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path

_SCRATCH = "laisn-scratch-"


def _tokens() -> Iterator[str]:
    """Names that nobody else has, without end."""
    while True:
        yield secrets.token_hex(6)


def _hold(path: Path) -> int:
    """Hold a file or folder, as soon as no other process does; the handle to close."""
    handle = os.open(path, os.O_RDONLY)
    with suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold a file or folder for the block; wait while another process holds it.

    On a file system without locks, this holds nothing, and nothing counts as abandoned.
    """
    handle = _hold(path)
    try:
        yield
    finally:
        os.close(handle)


@contextmanager
def _new(folder: Path, names: Iterable[str], make: Callable[[Path], None]) -> Iterator[Path]:
    """A new file or folder, of the first name that is free, held for the block."""
    for name in names:
        path = folder / name
        try:
            make(path)
            handle = _hold(path)
        except (FileExistsError, FileNotFoundError):
            if not folder.is_dir():
                raise
            continue
        except KeyboardInterrupt:
            with suppress(OSError):
                path.rmdir() if path.is_dir() else path.unlink()
            raise
        try:
            # it may have been taken for abandoned before it was held
            if path.exists():
                yield path
                return
        finally:
            os.close(handle)


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
    names = (f".{path.name}.{token}.part" for token in _tokens())
    with _new(path.parent, names, lambda part: part.touch(exist_ok=False)) as part:
        try:
            yield part
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A new folder, held for the block; it stays. If the name is taken, something is added to it."""
    names = (f"{path.name}-{token}" for token in _tokens())
    with _new(path.parent, chain([path.name], names), Path.mkdir) as made:
        yield made


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder of the system's temporary one for the block, which no other user can read."""
    names = (f"{_SCRATCH}{token}" for token in _tokens())
    with _new(Path(tempfile.gettempdir()), names, lambda path: path.mkdir(mode=0o700)) as path:
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)


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


def sweep_scratch() -> None:
    """Remove the scratch folders of processes that were killed."""
    remove_abandoned(Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*"))

"""Arrays of long missions in files of their own, which take disk in place of memory.

Such an array is mapped from a file that has no name any more, and is gone with the process. The
process has in its memory what it has touched since the last `release_mapped_memory`, which
`released_regularly` repeats.
"""

import mmap
import os
import tempfile
import threading
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

SPILLED_FROM = 50_000
"""Arrays of so many instants, steps or messages are in files."""
_RELEASE_EVERY_S = 0.05
_LASTING = Path("/var/tmp")
"""Folder of temporary files that is on a disk, while that of others may be in memory."""


class _Mapping(mmap.mmap):
    """Memory of one array."""


_MAPPINGS: "weakref.WeakSet[_Mapping]" = weakref.WeakSet()
_CHANGES = threading.Lock()  # of these


def _new_file() -> IO[bytes]:
    """A file without a name; OSError if there can be none."""
    has_folder = any(name in os.environ for name in ("TMPDIR", "TEMP", "TMP"))
    folder = _LASTING if not has_folder and os.access(_LASTING, os.W_OK) else None
    return tempfile.TemporaryFile(dir=folder)


def _mapping(size: int) -> _Mapping | None:
    """Memory in a file of so many bytes, all zero; None: the disk has no room, or the system cannot
    reserve it.
    """
    if not (hasattr(os, "posix_fallocate") and hasattr(mmap, "MADV_DONTNEED")):
        return None
    try:
        with _new_file() as file:
            # a hole that cannot be filled later would end the process
            os.posix_fallocate(file.fileno(), 0, size)
            return _Mapping(file.fileno(), size)
    except OSError:
        return None


def is_long(shape: Sequence[int]) -> bool:
    """Whether arrays of a shape are in files: an axis is long."""
    return max(shape, default=0) >= SPILLED_FROM


def spillable_zeros(shape: Sequence[int], dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """An array of zeros, in a file if an axis is long."""
    layout = np.dtype(dtype)
    size = int(np.prod(shape, dtype=np.int64)) * layout.itemsize
    mapping = _mapping(size) if size > 0 and is_long(shape) else None
    if mapping is None:
        return np.zeros(shape, layout)
    with _CHANGES:
        _MAPPINGS.add(mapping)
    return np.ndarray(shape, layout, buffer=mapping)


def is_spilled(owner: object) -> bool:
    """Whether what an array gives as its `base` is the memory of such a file."""
    return isinstance(owner, _Mapping)


def release_mapped_memory() -> None:
    """Leave to the system the memory of all arrays in files; their numbers stay."""
    with _CHANGES:
        mappings = list(_MAPPINGS)
    for mapping in mappings:
        mapping.madvise(mmap.MADV_DONTNEED)


@contextmanager
def released_regularly() -> Iterator[None]:
    """The memory of arrays in files is released again and again while the block runs, by a thread
    of its own: the block may go through all of them.
    """
    finished = threading.Event()

    def release_until_over() -> None:
        while not finished.wait(_RELEASE_EVERY_S):
            release_mapped_memory()

    thread = threading.Thread(target=release_until_over, daemon=True)
    thread.start()
    try:
        yield
    finally:
        finished.set()
        thread.join()
        release_mapped_memory()

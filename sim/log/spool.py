"""Bytes that are too many for the memory: they are appended, and read again in stretches."""

import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO

import numpy as np

from laisn.arrays import Bytes
from sim.log.file import LogError

IN_MEMORY = 1 << 19
"""Up to so many they stay in memory; more lie in a temporary file without a name [bytes]."""


@contextmanager
def _faults() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise LogError(
            f"no room for what the log unfolds to: {error.strerror or error}; TMPDIR names a folder for temporary files"
        ) from error


class Spool:
    """Takes bytes at its end and gives them back from anywhere.

    Raises LogError where many bytes find no room in the folder for temporary files.
    """

    def __init__(self, data: bytes = b"") -> None:
        self._file: IO[bytes] = tempfile.SpooledTemporaryFile(IN_MEMORY)  # noqa: SIM115  # it lives as long as this does
        weakref.finalize(self, self._file.close)
        self.append(data)

    def append(self, data: bytes | memoryview) -> None:
        """Add bytes at the end."""
        with _faults():
            self._file.seek(0, 2)
            self._file.write(data)

    def read(self, start: int, stop: int) -> Bytes:
        """The bytes of a stretch, shape (stop - start,)."""
        with _faults():
            self._file.seek(start)
            return np.frombuffer(self._file.read(stop - start), dtype=np.uint8)

"""Results on disk: tables of studies as Parquet, and a store of single results under keys of all that made them.

Each stored result is one `.npz` archive with a checksum of all its bytes.
"""

import csv
import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from experiments.campaign.version import code_version
from laisn.failure import LaisnError, LaisnWarning
from sim.files import atomic_write, locked, remove_stale_parts
from sim.trajectory import Trajectory

Content = TypeVar("Content")
Record = dict[str, Any]
"""A row: column names and plain values."""
Arrays = dict[str, npt.NDArray[Any]]
"""Columns of a result by name, arrays of shape (n,)."""

PER_RUN, PER_STEP = "run_", "step_"
"""Prefixes of what is stored of each run, and of each step over all runs."""

_CHECKSUM_BYTES = 32
_RECORD = "record"
"""Array that holds the JSON of a stored record."""


class DamagedResult(LaisnWarning):
    """A stored result cannot be read; the text names the file, the reason and what is done about it."""


class CampaignError(LaisnError):
    """A campaign cannot go on; every finished result is stored."""


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """Write a Parquet file with page checksums; the same content gives the same bytes."""
    with atomic_write(path) as part:
        pq.write_table(pa.table(dict(columns)), part, compression="zstd", write_page_checksum=True)


def arrow_table(path: Path) -> Any:
    """The `pyarrow.Table` in a file of `write_table`; LaisnError if the file is damaged."""
    try:
        # in this thread: one of Arrow's own that still reads when the process ends would abort it
        return pq.ParquetFile(path, page_checksum_verification=True).read(use_threads=False)
    except (ValueError, OSError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        why = " ".join(str(error).split())
        raise LaisnError(f"{path}: it is damaged: {why}; the command that wrote it writes it again") from None


def read_table(path: Path) -> list[Record]:
    """The rows in a file of `write_table`; LaisnError if the file is damaged."""
    rows: list[Record] = arrow_table(path).to_pylist()
    return rows


def columns_of(rows: Sequence[Record]) -> dict[str, list[Any]]:
    """Rows as columns; a row that lacks a column has None there."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def write_csv(path: Path, rows: Sequence[Record]) -> None:
    """Write rows as CSV, numbers with all their digits."""
    columns = columns_of(rows)
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _decoded(file: BinaryIO) -> Any:
    with np.load(file, allow_pickle=False) as arrays:
        return json.loads(arrays[_RECORD].tobytes())


def _arrays(file: BinaryIO, prefix: str) -> Arrays:
    with np.load(file, allow_pickle=False) as arrays:
        return {name.removeprefix(prefix): arrays[name] for name in arrays if name.startswith(prefix)}


def _checksum(path: Path, content: bytes) -> bytes:
    """Checksum of a result and its key, which follows its archive: those of a zip file leave gaps."""
    return hashlib.sha256(path.stem.encode() + content).digest()


STUDY_FILE, FLIGHT_FILE = "campaign.json", "summary.json"
"""A file that each folder of a study, and each folder of a flight, has."""


def require_kind(folder: Path, other: str, found: str) -> None:
    """Refuse a folder with results of the other kind: "flight" or "study", recognised by a file; raises LaisnError."""
    if (folder / found).exists():
        raise LaisnError(f"{folder}: holds the results of a {other} ({found}); choose another folder with --out")


class Store:
    """The results folder of a campaign; any number of processes may work in it at once.

    Raises LaisnError if the folder holds results of another version and `force` is not set.
    """

    def __init__(self, folder: Path, *, force: bool = False) -> None:
        """Open or make the folder; `force`: stored results count as missing, those of another version are removed."""
        require_kind(folder, "flight", FLIGHT_FILE)
        self.folder = folder
        self._cells, self._flights = folder / "cells", folder / "flights"
        self._force = force
        self._written: set[Path] = set()
        for each in (self._cells, self._flights):
            each.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            self._require_version()
        for each in (folder, self._cells, self._flights):
            remove_stale_parts(each)

    def _require_version(self) -> None:
        """Make the folder one of this version, or refuse."""
        manifest, found = self.folder / STUDY_FILE, None
        try:
            found = str(json.loads(manifest.read_text(encoding="utf-8"))["version"])
        except FileNotFoundError:
            pass
        except (ValueError, KeyError, TypeError, RecursionError):
            # keys of results hold their version too
            warnings.warn(f"{manifest} cannot be read and is written again", DamagedResult, stacklevel=1)
        if found == code_version():
            return
        if found is not None:
            if not self._force:
                raise LaisnError(
                    f"{self.folder} holds results of version {found}, this is {code_version()}; "
                    "choose another folder with --out, or replace them with --force"
                )
            for path in (*self._cells.iterdir(), *self._flights.iterdir()):
                path.unlink(missing_ok=True)
        with atomic_write(manifest) as part:
            part.write_text(json.dumps({"version": code_version()}) + "\n", encoding="utf-8")

    def _read(self, path: Path, load: Callable[[BinaryIO], Content]) -> Content | None:
        """Content of a stored result; None if it must be computed. A damaged file warns and counts as missing."""
        if self._force and path not in self._written:
            return None
        try:
            content = path.read_bytes()
            archive, checksum = content[:-_CHECKSUM_BYTES], content[-_CHECKSUM_BYTES:]
            if checksum != _checksum(path, archive):
                raise ValueError("wrong checksum: it is damaged or another result's")
            return load(BytesIO(archive))
        except FileNotFoundError:
            return None
        except Exception as error:  # NumPy raises a dozen kinds for files that are none of ours
            what = f"{path} cannot be read and is computed again: {error or type(error).__name__}"
            warnings.warn(what, DamagedResult, stacklevel=1)
            return None

    def _write(self, path: Path, save: Callable[[Path], None]) -> None:
        with atomic_write(path) as part:
            save(part)
            checksum = _checksum(path, part.read_bytes())
            with part.open("ab") as file:
                file.write(checksum)
        self._written.add(path)

    def record(self, key: str) -> Any:
        """What `write_record` stored under a key; None if it must be computed."""
        return self._read(self._cells / f"{key}.npz", _decoded)

    def write_record(self, key: str, record: object, arrays: Mapping[str, npt.NDArray[Any]] | None = None) -> None:
        """Store a JSON value, in which NumPy's numbers and arrays become plain, and arrays by prefixed names."""
        text = json.dumps(record, default=lambda value: value.tolist()).encode()
        content: dict[str, Any] = {_RECORD: np.frombuffer(text, dtype=np.uint8), **(arrays or {})}

        def save(part: Path) -> None:
            with part.open("wb") as file:
                np.savez_compressed(file, **content)

        self._write(self._cells / f"{key}.npz", save)

    def write(self, key: str, content: object, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store a mission, or a record with its arrays."""
        if isinstance(content, Trajectory):
            self.write_flight(key, content)
        else:
            self.write_record(key, content, arrays)

    def arrays(self, key: str, prefix: str) -> Arrays | None:
        """The arrays of a record with a prefix, by their names without it; None if they must be computed."""
        return self._read(self._cells / f"{key}.npz", partial(_arrays, prefix=prefix)) or None

    def flight(self, key: str) -> Trajectory | None:
        """A stored mission; None if it must be simulated."""
        return self._read(self._flights / f"{key}.npz", Trajectory.load)

    def write_flight(self, key: str, trajectory: Trajectory) -> None:
        """Store a mission."""
        self._write(self._flights / f"{key}.npz", trajectory.save)

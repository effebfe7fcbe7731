"""Results on disk: tables of studies as Parquet, and a store of single results under keys of all
that made them.
"""

import csv
import hashlib
import json
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from io import BytesIO
from itertools import chain
from pathlib import Path
from types import FunctionType
from typing import Any
from zipfile import ZipFile, ZipInfo

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.lib.format import read_array, write_array
from pydantic_core import to_jsonable_python

from experiments.result_files import FLIGHT_FILE, STUDY_FILE
from laisn.errors import LaisnError, LaisnWarning
from laisn.plugins import plugin_digest, plugin_files, registered_tokens
from reports.parquet import arrow_table
from reports.version import code_version, version_of
from sim.system import atomic_open, atomic_write, locked, remove_unfinished

Record = dict[str, Any]  # a row: plain values by column
Arrays = dict[str, npt.NDArray[Any]]  # columns of a result, shape (n,) each
Result = tuple[str, Any, Arrays]  # key, JSON value and arrays of a result that is stored

_KEY_LENGTH = 24  # hexadecimal digits
_RECORD = "record.json"
_COLUMNS = "columns"
_MOST_IN_RECORD = (
    200  # numbers of columns that are written as JSON, which takes a tenth of the time
)


class DamagedResult(LaisnWarning):
    """A stored result cannot be read; the text names the file, the reason and what is done about
    it.
    """


class CampaignError(LaisnError):
    """A campaign cannot continue; every finished result is stored."""


@cache
def _source(module: str) -> str:
    """Version of a module and of all sources that it can reach."""
    return version_of([module])


def _plain(value: object) -> list[Any]:
    """What stands for a value in a key that pydantic cannot write; TypeError if nothing does."""
    if isinstance(value, FunctionType):
        return [_source(value.__module__), value.__qualname__]
    if isinstance(value, partial):
        return [value.func, value.args, value.keywords]
    if isinstance(value, range):
        return [value.start, value.stop, value.step]
    raise TypeError(
        f"a result depends on {type(value).__name__}, of which no key can be made: {value!r:.60}"
    )


def key_of(*content: object) -> str:
    """Key of a result: a hash of the code version and of all that makes it.

    That is JSON values, data classes, scenarios, functions with every source that they can reach,
    and of plugins whose names are values all sources of the user's own that they reach. TypeError
    if there is something else.
    """
    text = json.dumps(
        to_jsonable_python([code_version(), *content], fallback=_plain), sort_keys=True
    )
    digest = hashlib.sha256(text.encode())
    for name in sorted(plugin_files()):
        # of a scenario's key, or of the suffix of a numeric in the text of a hull
        if re.search(rf'[".]{re.escape(name)}[":\\\']', text):
            digest.update(plugin_digest(name).encode())
    for token in registered_tokens(text):
        digest.update(token.encode())
    return digest.hexdigest()[:_KEY_LENGTH]


def derived_key(*keys: str) -> str:
    """Key of what follows from results and functions of these keys."""
    return hashlib.sha256(" ".join(keys).encode()).hexdigest()[:_KEY_LENGTH]


def write_table(path: Path, columns: Mapping[str, Any] | Iterator[pa.Table]) -> None:
    """Write columns, or tables one below the other, as Parquet with page checksums; same
    content, same bytes.
    """
    tables = iter([pa.table(dict(columns))]) if isinstance(columns, Mapping) else columns
    first = next(tables)
    with (
        atomic_write(path) as unfinished,
        pq.ParquetWriter(
            unfinished, first.schema, compression="zstd", write_page_checksum=True
        ) as writer,
    ):
        for table in chain([first], tables):
            writer.write_table(table)


def read_table(path: Path) -> list[Record]:
    """The rows in a file of `write_table`; LaisnError if the file is damaged."""
    return arrow_table(path).to_pylist()  # type: ignore[no-any-return]


def columns_of(rows: Sequence[Record]) -> dict[str, list[Any]]:
    """Rows as columns; a row that lacks a column has None there."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def write_csv(path: Path, rows: Sequence[Record]) -> None:
    """Write rows as CSV, numbers with all their digits."""
    with (
        atomic_write(path) as unfinished,
        unfinished.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.DictWriter(file, columns_of(rows))
        writer.writeheader()
        writer.writerows(rows)


class Store:
    """The results folder of a campaign; any number of processes may work in it at once."""

    def __init__(self, folder: Path, *, force: bool = False) -> None:
        """Open or make the folder; `force`: stored results count as missing, those of another
        version are removed.

        LaisnError if the folder holds a flight, or results of another version and `force` is not
        set.
        """
        if (folder / FLIGHT_FILE).exists():
            raise LaisnError(
                f"{folder}: holds a flight ({FLIGHT_FILE}); choose another folder with --out"
            )
        self.folder = folder
        self._results = folder / "store"
        self._force = force
        self.written = set[str]()  # keys of results that were stored by this command
        self._results.mkdir(parents=True, exist_ok=True)
        self.remove_unfinished()
        manifest = folder / STUDY_FILE
        stored_version = ""
        version = code_version()
        with locked(folder):
            # keys of results hold their version too, so that a damaged manifest may be written
            # again
            with suppress(FileNotFoundError, ValueError, KeyError, TypeError, RecursionError):
                stored_version = str(json.loads(manifest.read_text(encoding="utf-8"))["version"])
            if stored_version not in ("", version):
                if not force:
                    raise LaisnError(
                        f"{folder} holds results of version {stored_version}, this is {version}; "
                        "choose another folder with --out, or replace them with --force"
                    )
                for path in self._results.iterdir():
                    path.unlink(missing_ok=True)
            if stored_version != version:
                with atomic_write(manifest) as unfinished:
                    unfinished.write_text(json.dumps({"version": version}) + "\n", encoding="utf-8")

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"written": set()}  # another process has no use for it

    def remove_unfinished(self) -> None:
        """Remove what killed processes have left half-written."""
        remove_unfinished(self._results)

    def path(self, key: str) -> Path:
        return self._results / f"{key}.zip"

    def get(self, key: str) -> tuple[Any, Arrays] | None:
        """What `put` stored under a key; None if it must be computed, with a warning if it is
        damaged.
        """
        if self._force and key not in self.written:
            return None
        try:
            with ZipFile(self.path(key)) as archive:
                # to read the whole of a member compares its checksum
                members = {name: archive.read(name) for name in archive.namelist()}
            # ten thousand records share the names of their columns in memory
            stored_key, names, record, columns = json.loads(
                members.pop(_RECORD),
                object_pairs_hook=lambda pairs: {sys.intern(k): v for k, v in pairs},
            )
            arrays = {name: np.array(values, kind) for name, (kind, values) in columns.items()}
            for name, content in members.items():
                values = read_array(BytesIO(content), allow_pickle=False)
                arrays |= (
                    {column: values[column].copy() for column in values.dtype.names or ()}
                    if name == _COLUMNS
                    else {name: values}
                )
            if (stored_key, names) != (key, [*arrays]):
                raise ValueError("it lacks arrays, or is another result's")
            return record, arrays
        except FileNotFoundError:
            return None
        except Exception as error:  # NumPy raises a dozen kinds for files that are none of ours
            problem = (
                f"{self.path(key)} cannot be read and is computed again: "
                f"{error or type(error).__name__}"
            )
            warnings.warn(problem, DamagedResult, stacklevel=1)
            return None

    def has(self, *keys: str) -> bool:
        """Whether all these results are there, whole; those that were written here are not read."""
        return all(key in self.written or self.get(key) is not None for key in keys)

    def put(self, key: str, record: object, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store a JSON value, in which NumPy's numbers and arrays become plain, and arrays by
        name.
        """
        columns: dict[str, Any] = {}
        members: dict[str, npt.NDArray[Any]] = dict(arrays)
        if {values.ndim for values in arrays.values()} == {1}:
            sizes = [*map(len, arrays.values())]
            if sum(sizes) <= _MOST_IN_RECORD:
                columns = {name: [v.dtype.str, v.tolist()] for name, v in arrays.items()}
                members = {}
            elif len({*sizes}) == 1:
                # lists over runs as one array: a dozen take two to three times as long to write
                # and to read
                names = [*arrays]
                members = {_COLUMNS: np.rec.fromarrays([*arrays.values()], names=names)}  # type: ignore[call-overload]
        text = json.dumps([key, [*arrays], record, columns], default=lambda value: value.tolist())
        # what a power failure cuts is found by its checksum, and computed again
        path = self.path(key)
        with atomic_open(path, durable=False) as unfinished, ZipFile(unfinished, "w") as archive:
            # members without the time of day: same results, same bytes
            archive.writestr(ZipInfo(_RECORD), text)
            for name, values in members.items():
                with archive.open(ZipInfo(name), "w", force_zip64=True) as file:
                    write_array(file, np.asanyarray(values), allow_pickle=False)
        self.written.add(key)

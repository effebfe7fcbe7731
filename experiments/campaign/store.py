"""Results on disk: one Parquet file for each cell, whole or not there, under a hash of all that made it."""

import csv
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from experiments.campaign.seal import blank, require_whole, sealed
from experiments.campaign.version import code_version
from laisn.failure import LaisnError
from laisn.whole_files import held, parts, remove_abandoned, replaced

Record = dict[str, Any]
"""A row: column names and plain values."""
Steps = dict[str, npt.NDArray[np.float32]]
"""Errors at each step over all runs, arrays of shape (n,) by column name."""

PER_RUN = "run_"
"""Start of the names of columns that hold a list over runs."""

_MANIFEST = "campaign.json"


class DamagedResult(UserWarning):
    """A stored result cannot be read; the text says which file, what is wrong with it, and what is done about it."""


class CampaignError(LaisnError):
    """A campaign cannot go on; every finished cell is stored."""


def _sealed_parquet(path: Path, columns: Mapping[str, Any]) -> bytes:
    """A table as Parquet, sealed under the name that its file has; the same content gives the same bytes."""
    table, file = pa.table(dict(columns)), pa.BufferOutputStream()
    with pq.ParquetWriter(file, table.schema, compression="zstd", write_page_checksum=True) as writer:
        writer.write_table(table)
        # not with the schema, of which Arrow keeps a second copy
        writer.add_key_value_metadata({b"seal": blank(path.name)})
    return sealed(file.getvalue().to_pybytes())


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """Write a Parquet file, whole or not at all; the same content gives the same bytes."""
    with replaced(path) as part:
        part.write_bytes(_sealed_parquet(path, columns))


def _table_in(path: Path) -> Any:
    """The table in a Parquet file that was sealed under its name; ValueError if it is not what was written."""
    content = path.read_bytes()
    require_whole(content, path.name)
    # in this thread: one of Arrow's own that still reads when the process ends would abort it
    return pq.ParquetFile(pa.BufferReader(content)).read(use_threads=False)


def arrow_table(path: Path) -> Any:
    """The `pyarrow.Table` in a file of `write_table`; LaisnError if it is not what was written."""
    try:
        return _table_in(path)
    except ValueError as error:
        raise LaisnError(f"{path}: {error}; the command that wrote it writes it again") from None


def read_table(path: Path) -> list[Record]:
    """The rows in a file of `write_table`; LaisnError if it is not what was written."""
    rows: list[Record] = arrow_table(path).to_pylist()
    return rows


def columns_of(rows: Sequence[Record]) -> dict[str, list[Any]]:
    """Rows as columns; a row that lacks a column has None there."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


class Store:
    """The results folder of a campaign; any number of processes may work in it at once.

    Raises LaisnError if the folder holds results of another version and `force` is not set.
    """

    def __init__(self, folder: Path, *, force: bool = False) -> None:
        """Open or make the folder.

        Args:
            folder: of the campaign.
            force: cells that are there count as missing, and results of another version are removed.
        """
        self.folder = folder
        self._cells = folder / "cells"
        self._force = force
        self._rows: dict[str, Record] = {}
        self._cells.mkdir(parents=True, exist_ok=True)
        # versions are compared, and results of others removed, by one process at a time
        with held(folder):
            self._require_version()
        remove_abandoned(parts(folder))

    def _require_version(self) -> None:
        """Make the folder one of this version, or refuse."""
        manifest = self.folder / _MANIFEST
        found = self._version(manifest)
        if found == code_version():
            return
        if found is not None:
            if not self._force:
                raise LaisnError(
                    f"{self.folder} holds results of version {found}, this is {code_version()}; "
                    "choose another folder with --out, or replace them with --force"
                )
            for path in (*self._cells.glob("*.parquet"), *self.flights.glob("*.npz")):
                path.unlink(missing_ok=True)
        with replaced(manifest) as part:
            part.write_text(json.dumps({"version": code_version()}) + "\n", encoding="utf-8")

    @staticmethod
    def _version(manifest: Path) -> str | None:
        """The version of a folder's results; None if it has none, or says none that can be read.

        Nothing is taken for what it is not: the names of cells and flights depend on their version.
        """
        try:
            return str(json.loads(manifest.read_text(encoding="utf-8"))["version"])
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, RecursionError):
            warnings.warn(f"{manifest} cannot be read and is written again", DamagedResult, stacklevel=4)
            return None

    @property
    def flights(self) -> Path:
        """Folder of the flown missions."""
        return self.folder / "flights"

    def _read(self, key: str, suffix: str) -> pa.Table | None:
        path = self._cells / f"{key}{suffix}"
        if not path.is_file() or (self._force and key not in self._rows):
            return None
        try:
            return _table_in(path)
        except (ValueError, OSError) as error:
            warnings.warn(f"{path} cannot be read and is computed again: {error}", DamagedResult, stacklevel=3)
            return None

    def read(self, key: str) -> Record | None:
        """The row of a cell less its lists over runs; None if it must be computed.

        A damaged file warns and counts as missing.
        """
        if key not in self._rows:
            table = self._read(key, ".parquet")
            if table is None:
                return None
            self._rows[key] = table.drop_columns([n for n in table.column_names if n.startswith(PER_RUN)]).to_pylist()[
                0
            ]
        return self._rows[key]

    def read_runs(self, key: str) -> Record:
        """The lists over runs of a cell that is stored, by their names without `PER_RUN`; empty if it has none."""
        table = self._read(key, ".parquet")
        if table is None:
            return {}
        return {n.removeprefix(PER_RUN): table[n].to_pylist()[0] for n in table.column_names if n.startswith(PER_RUN)}

    def read_steps(self, key: str) -> Steps | None:
        """The errors of a cell at each step; None if they must be computed."""
        table = self._read(key, ".steps.parquet")
        return None if table is None else {name: table[name].to_numpy() for name in table.column_names}

    def write(self, key: str, row: Record, steps: Steps | None = None) -> None:
        """Store a cell; the steps first, so that a row never stands without those that were asked for.

        Raises:
            CampaignError: the process that computed it had other sources.
        """
        if row["version"] != code_version():
            raise CampaignError(
                f"a worker has version {row['version']}, the campaign began with {code_version()}: "
                "the sources changed while it ran; run it again"
            )
        if steps is not None:
            self._write(key, ".steps.parquet", steps)
        self._write(key, ".parquet", columns_of([row]))
        self._rows[key] = {name: value for name, value in row.items() if not name.startswith(PER_RUN)}

    def rows(self, key: str) -> list[Record] | None:
        """Rows that belong together, as `write_rows` stored them; None if they must be computed."""
        row = self.read(key)
        if row is None:
            return None
        columns = {name: values for name, values in row.items() if name != "version"}
        return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]

    def write_rows(self, key: str, rows: Sequence[Record]) -> None:
        """Store rows that belong together, under one key, as lists; errors as of `write`."""
        self.write(key, columns_of(rows) | {"version": code_version()})

    def _write(self, key: str, suffix: str, columns: Mapping[str, Any]) -> None:
        path = self._cells / f"{key}{suffix}"
        with replaced(path) as part:
            part.write_bytes(_sealed_parquet(path, columns))


def write_csv(path: Path, rows: Sequence[Record]) -> None:
    """Write rows as CSV, whole or not at all; numbers with all their digits."""
    columns = columns_of(rows)
    with replaced(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))

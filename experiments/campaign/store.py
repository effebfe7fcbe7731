"""Results on disk: one Parquet file for each cell, whole or not there, under a hash of all that made it."""

import csv
import json
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from experiments.campaign.failures import CampaignError, DamagedResult
from experiments.campaign.leftovers import writer_runs
from experiments.campaign.version import code_version

Record = dict[str, Any]
"""A row: column names and plain values."""
Steps = dict[str, npt.NDArray[np.float32]]
"""Errors at each step over all runs, arrays of shape (n,) by column name."""

PER_RUN = "run_"
"""Start of the names of columns that hold a list over runs."""

_MANIFEST = "campaign.json"
_KEY = b"cell"


def write_table(path: Path, columns: Mapping[str, Any], metadata: Mapping[bytes, bytes] | None = None) -> None:
    """Write a Parquet file under a temporary name and rename it; the same content gives the same bytes."""
    table = pa.table(dict(columns)).replace_schema_metadata(dict(metadata or {}))
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        pq.write_table(table, temporary, compression="zstd", write_page_checksum=True)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def columns_of(rows: Sequence[Record]) -> dict[str, list[Any]]:
    """Rows as columns; a row that lacks a column has None there."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


class Store:
    """The results folder of a campaign.

    Raises ValueError if the folder holds results of another version and `force` is not set.
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
        manifest = folder / _MANIFEST
        if manifest.is_file() and (found := self._version(manifest)) != code_version():
            if not force:
                raise ValueError(
                    f"{folder} holds results of version {found}, this is {code_version()}; "
                    "choose another folder with --out, or replace them with --force"
                )
            for path in self._cells.glob("*.parquet"):
                path.unlink()
        self._cells.mkdir(parents=True, exist_ok=True)
        for part in folder.rglob(".*.part"):
            if not writer_runs(part.name.split(".")[-2]):
                part.unlink(missing_ok=True)
        manifest.write_text(json.dumps({"version": code_version()}) + "\n", encoding="utf-8")

    @staticmethod
    def _version(manifest: Path) -> str:
        try:
            return str(json.loads(manifest.read_text(encoding="utf-8"))["version"])
        except (ValueError, KeyError, TypeError):
            return "unknown"

    @property
    def flights(self) -> Path:
        """Folder of the flown missions."""
        return self.folder / "flights"

    def _read(self, key: str, suffix: str) -> pa.Table | None:
        path = self._cells / f"{key}{suffix}"
        if not path.is_file() or (self._force and key not in self._rows):
            return None
        try:
            table = pq.ParquetFile(path, page_checksum_verification=True).read()
            if (table.schema.metadata or {}).get(_KEY) != key.encode():
                raise ValueError("it is another cell's")
        except (pa.ArrowException, ValueError, OSError) as error:
            reason = str(error).partition("\n")[0]
            warnings.warn(f"{path} cannot be read and is computed again: {reason}", DamagedResult, stacklevel=3)
            return None
        return table

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
        metadata = {_KEY: key.encode()}
        if steps is not None:
            write_table(self._cells / f"{key}.steps.parquet", steps, metadata)
        write_table(self._cells / f"{key}.parquet", columns_of([row]), metadata)
        self._rows[key] = {name: value for name, value in row.items() if not name.startswith(PER_RUN)}


def write_csv(path: Path, rows: Sequence[Record]) -> None:
    """Write rows as CSV under a temporary name and rename it; numbers with all their digits."""
    columns = columns_of(rows)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)

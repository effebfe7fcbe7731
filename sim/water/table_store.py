"""Tables of rays on disk, so that later processes do not compute them again.

They lie beside the compiled code of the same sources (`laisn.compiled`), which goes with another
version, each under a hash of all that it was computed from. Where nothing can be stored, or what
was stored is damaged, tables are computed.
"""

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from laisn.compiled import FOLDER
from sim.system import atomic_open, remove_unfinished
from sim.water.ray_table import RayTable

_MAX_TABLES = 24
"""Largest number of tables that are kept for the same sources, those used last; each takes some
megabytes.
"""


def _folder() -> Path | None:
    return None if FOLDER is None else FOLDER / "rays"


def _read(file: Path) -> RayTable | None:
    """A stored table; None if there is none, or it is damaged."""
    try:
        with np.load(file, allow_pickle=False) as arrays:
            values = {name: arrays[name] for name in RayTable._fields}
        file.touch()
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
    return RayTable(**values | {"range_step": float(values["range_step"])})


def _write(table: RayTable, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic_open(file) as unfinished:
        np.savez(unfinished, **table._asdict())
    remove_unfinished(file.parent)
    tables = sorted(file.parent.glob("*.npz"), key=lambda path: path.stat().st_mtime)
    for old in tables[:-_MAX_TABLES]:
        old.unlink(missing_ok=True)


def stored_table(inputs: object, compute: Callable[[], RayTable]) -> RayTable:
    """The table that is computed from `inputs`, which JSON can hold: from disk, or computed and
    stored there.
    """
    folder = _folder()
    if folder is None:
        return compute()
    digest = hashlib.sha256(json.dumps(inputs).encode()).hexdigest()
    file = folder / f"{digest[:32]}.npz"
    table = _read(file)
    if table is None:
        table = compute()
        # that it is not stored costs the next process some seconds, and nothing else
        with suppress(OSError):
            _write(table, file)
    return table

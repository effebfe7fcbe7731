"""The data sets of Djugash, Hamner & Roth 2009, "Navigating with Ranging Radios": five tables, in MATLAB or text files.

    DR   time, distance driven, change of heading          odometry
    TD   time, sender, receiver, range                     ranges to the receivers
    TL   node, x, y                                        surveyed places of the nodes
    GT   time, x, y, heading                               surveyed path; may be missing
    DRp  time, x, y, heading                               odometry summed up from the start on; may be missing

Times are in s, places in m, headings in rad anticlockwise from east.
"""

import math
import re
from pathlib import Path

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from sim.datasets.range_data import LARGEST, RangeData, require_unique
from sim.system import background_process

_COLUMNS = {"DR": 3, "TD": 4, "TL": 3, "GT": 4, "DRp": 4}
"""Columns of each table."""
_NEEDED = ("DR", "TD", "TL")
_NODES = {"TD": [1, 2], "TL": [0]}
"""Columns of nodes' numbers."""
_MOST_NUMBERS = 40_000_000
"""In all tables; a compressed file of few bytes may state any number."""
_TEXT = re.compile(r"(.*)_DR\.(txt|csv)")


def _load(path: Path) -> dict[str, Floats]:
    # data sets in text, and logs, need none of it
    from scipy.io import loadmat, whosmat

    stated = sum(math.prod(shape) for name, shape, _ in whosmat(path) if name in _COLUMNS)
    if stated > _MOST_NUMBERS:
        raise LaisnError(f"its tables have {stated:,} numbers, at most {_MOST_NUMBERS:,} are read")
    found = loadmat(path, variable_names=tuple(_COLUMNS))
    return {name: found[name] for name in _COLUMNS if name in found}


def _from_matlab(path: Path) -> dict[str, Floats]:
    try:
        # damaged files crash the library
        with background_process() as process:
            return process.submit(_load, path).result()
    except (OSError, LaisnError) as error:
        raise LaisnError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    except Exception as error:
        # foreign bytes make the library fail in many ways
        raise LaisnError(f"{path}: no MATLAB file of version 5, or damaged: {error}") from None


def _from_text(path: Path) -> dict[str, Floats]:
    """Tables of `NAME_DR.txt` and those beside it."""
    match = _TEXT.fullmatch(path.name)
    if match is None:
        raise LaisnError(f"{path}: name the table of odometry, such as Plaza1_DR.txt; the others are found beside it")
    tables = {}
    for name in _COLUMNS:
        table = path.with_name(f"{match[1]}_{name}.{match[2]}")
        if not table.is_file():
            continue
        try:
            tables[name] = np.loadtxt(
                table, delimiter="," if match[2] == "csv" else None, ndmin=2, encoding="utf-8-sig"
            )
        except (OSError, ValueError) as error:
            raise LaisnError(f"{table}: no table of numbers: {error}") from None
    return tables


def _checked(tables: dict[str, Floats], source: str) -> dict[str, Floats]:
    """The tables, if those that are needed are there with all their columns."""
    missing = [name for name in _NEEDED if name not in tables]
    if missing:
        raise LaisnError(f"{source}: lacks {', '.join(missing)}; it has {', '.join(tables) or 'none of the tables'}")
    for name, table in tables.items():
        if not np.issubdtype(table.dtype, np.number) or table.ndim != 2 or table.shape[1] != _COLUMNS[name]:
            raise LaisnError(f"{source}: table {name} has the shape {table.shape}, expected {_COLUMNS[name]} columns")
        whole = _NODES.get(name, [])
        usable = np.all(np.abs(table) <= LARGEST, axis=1) & np.all(table[:, whole] == np.rint(table[:, whole]), axis=1)
        if not usable.all():
            raise LaisnError(
                f"{source}: table {name}, row {int(np.argmin(usable)) + 1}: expected numbers within ±{LARGEST:g}, and "
                "whole ones for nodes"
            )
    return {name: np.asarray(table, dtype=np.float64) for name, table in tables.items()}


def _start(tables: dict[str, Floats], source: str) -> tuple[float, Floats]:
    """Time of the start [s], and its pose: x, y and heading anticlockwise from east, shape (3,)."""
    for name in ("DRp", "GT"):
        if name in tables:
            before = tables[name][tables[name][:, 0] < tables["DR"][0, 0]]
            if len(before):
                return float(before[-1, 0]), before[-1, 1:4]
    raise LaisnError(
        f"{source}: neither DRp nor GT has a pose before the first odometry, at {tables['DR'][0, 0]:.3f} s"
    )


def read_range_tables(path: Path) -> RangeData:
    """A data set of ranging radios.

    Args:
        path: MATLAB file with all tables, or the text file `NAME_DR.txt` with the others beside it.

    Raises:
        LaisnError: a file cannot be read, or a table or a column is missing.
    """
    tables = _checked(_from_matlab(path) if path.suffix == ".mat" else _from_text(path), str(path))
    begin, pose = _start(tables, str(path))
    odometry, ranges, nodes = (tables[name] for name in _NEEDED)
    names = nodes[:, 0].astype(np.int64).tolist()
    require_unique(names, f"{path}: table TL: node")
    index = {name: i for i, name in enumerate(names)}
    beacons = [index.get(node, -1) for node in ranges[:, 2].tolist()]
    return RangeData.collect(
        source=str(path),
        start=np.array([pose[0], pose[1], 0.5 * np.pi - pose[2]]),
        time=np.concatenate([[begin], odometry[:, 0]]),
        odometry=np.column_stack([odometry[:, 1], np.zeros(len(odometry)), odometry[:, 2]]),
        beacons=tuple(map(str, names)),
        places=nodes[:, 1:].copy(),
        ranges=np.column_stack([ranges[:, 0], beacons, ranges[:, 3]]),
        range_sigma=None,
        truth=tables["GT"][:, :3].copy() if "GT" in tables else np.empty((0, 3)),
        remarks=(),
    )

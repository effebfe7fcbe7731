"""A vehicle's measurements in a text table with named columns, as a log that navigation is replayed
on.

Columns have the names of the log's fields, with or without a unit ("heading_deg", "range_rear
[m]"). A row without ranges holds own measurements alone, and a row without own measurements a
reception alone.
"""

import csv
import math
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from sim.datasets.range_data import LARGEST, numbers, text_of
from sim.log.schema import OWN_MOTION, PLACES, RECEPTION

_TIME = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
_SPEED = {"m/s": 1.0, "m_s": 1.0, "kn": 1852.0 / 3600.0, "km/h": 1.0 / 3.6}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}
_LENGTH = {"m": 1.0, "cm": 0.01, "km": 1000.0, "ft": 0.3048}
_TIME_NAMES = ("time", "timestamp", "t", "datetime")
_FIELDS = (*OWN_MOTION.fields, *RECEPTION.fields, *PLACES.names)
_NEEDED = (
    *OWN_MOTION.fields,
    "leader_east",
    "leader_north",
    "leader_heading",
    "leader_speed",
    "leader_depth",
)
# a time beyond these is counted from 1970 in this unit
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))


class VehicleTable(NamedTuple):
    """Own measurements and receptions of a table, and what was taken for what."""

    time_ns: Ints  # of each row, increasing, shape (n,), [ns]
    # by the names of the log's fields, shape (n,), in SI units; NaN where a cell is empty
    columns: dict[str, Floats]
    remarks: tuple[str, ...]


def _units(field: str) -> dict[str, float]:
    if field in _TIME_NAMES:
        return _TIME
    if field == "leader_timestamp":
        return {unit: scale / 1e9 for unit, scale in _TIME.items()}
    if "speed" in field:
        return _SPEED
    return _ANGLE if any(word in field for word in ("heading", "pitch", "roll")) else _LENGTH


def _named(head: str) -> tuple[str, str]:
    """Field and unit of a column's head, "" for what is not known."""
    text = head.strip().lower()
    for field in (*_TIME_NAMES, *_FIELDS):
        match = re.fullmatch(rf"{field}(?:[ _]*[\[(]?([^\])]+)[\])]?)?", text)
        if match is not None and (match[1] is None or match[1] in _units(field)):
            return field, match[1] or ""
    return "", ""


def _times(words: list[str], unit: str, where: str) -> tuple[Ints, str]:
    """Times [ns], and the format that was found."""
    try:
        times = numbers(words, where, 1e9 * LARGEST)
    except LaisnError as error:
        try:
            dates = [datetime.fromisoformat(word.strip()) for word in words]
        except ValueError:
            raise LaisnError(
                f"{error}; expected numbers or dates such as 2026-05-01T12:00:00.25Z"
            ) from None
        since = [
            d.replace(tzinfo=d.tzinfo or UTC) - datetime(1970, 1, 1, tzinfo=UTC) for d in dates
        ]
        return np.array(
            [round(s.total_seconds() * 1e6) * 1000 for s in since], dtype=np.int64
        ), "dates (UTC)"
    if not np.all(np.isfinite(times)):
        raise LaisnError(f"{where}: a time is not finite")
    if not unit:
        unit = next((name for least, name in _EPOCHS if times.max() > least), "s")
        # own measurements less often than every 5 s would be rare
        unit = "ms" if unit == "s" and np.median(np.diff(np.unique(times))) > 5.0 else unit
    return np.rint(times * _TIME[unit]).astype(np.int64), unit


def read_vehicle_table(path: Path) -> VehicleTable:
    """Measurements of a text table; header, delimiter, units and format of time are detected.

    LaisnError, naming the line, if it cannot be read, lacks a column, or a cell is no number.
    """
    lines = [
        line for line in text_of(path).splitlines() if line.strip() and not line.startswith("#")
    ]
    if len(lines) < 3:
        raise LaisnError(f"{path}: {len(lines)} lines; a header and two rows are needed at least")
    delimiter = max(",;\t", key=lines[0].count)
    heads, *rows = csv.reader(lines, delimiter=delimiter)
    named = [_named(head) for head in heads]
    by_field = {field: (i, unit) for i, (field, unit) in enumerate(named) if field}
    times = [field for field in _TIME_NAMES if field in by_field]
    missing = [name for name in _NEEDED if name not in by_field] + ([] if times else ["time"])
    missing += [] if any(field.startswith("range_") for field in by_field) else ["range_rear"]
    if missing:
        raise LaisnError(
            f"{path}: lacks columns {', '.join(missing)}; its columns: {', '.join(heads)}"
        )
    for k, row in enumerate(rows, start=1):
        if len(row) != len(heads):
            raise LaisnError(f"{path}, row {k}: {len(row)} cells, the header has {len(heads)}")
    if delimiter != ",":
        # a decimal comma is only possible beside another delimiter
        rows = [[cell.replace(",", ".") for cell in row] for row in rows]
    place, unit = by_field[times[0]]
    time_ns, format_ = _times([row[place] for row in rows], unit, f"{path}, column {heads[place]}")
    if time_ns.min() < 0:
        raise LaisnError(f"{path}, column {heads[place]}: times before 1970, or negative ones")
    remarks = [f"{heads[place]}: time in {format_}, {np.ptp(time_ns) / 1e9:g} s"]
    by_field = {field: column for field, column in by_field.items() if field not in _TIME_NAMES}
    columns = {
        field: numbers((row[i] for row in rows), f"{path}, column {heads[i]}")
        for field, (i, _) in by_field.items()
    }
    bare = [
        np.abs(columns[field])
        for field, (_, given) in by_field.items()
        if _units(field) is _ANGLE and not given
    ]
    # no angle in radians is that large, and one table has one unit
    degrees = bool(bare) and np.nanmax(bare, initial=0.0) > 4.0 * math.pi
    for field, (i, given) in by_field.items():
        units = _units(field)
        known = given or ("deg" if degrees and units is _ANGLE else next(iter(units)))
        columns[field] = columns[field] * units[known]
        remarks.append(f"{heads[i]}: {field} in {known}")
    unused = [head for head, (field, _) in zip(heads, named, strict=True) if not field]
    remarks += [f"not used: {', '.join(unused)}"] if unused else []
    order = np.argsort(time_ns, kind="stable")
    columns.setdefault("leader_timestamp", time_ns / 1e9)
    return VehicleTable(
        time_ns[order], {field: values[order] for field, values in columns.items()}, tuple(remarks)
    )

"""The columns of a vehicle's table: which field of the log each holds, and the unit that its header
states.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError, printable, shortened
from laisn.navigators import MAX_RANGE, MAX_SPEED
from sim.datasets.range_data import LARGEST_NUMBER, parse_numbers, text_of
from sim.log.clock import TIMESTAMP
from sim.log.schema import OWN_MOTION, PLACES, RECEPTION


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """What columns measure, with the units that headers may state and their size in SI units."""

    name: str
    units: Mapping[str, float]

    @property
    def si(self) -> str:
        """The SI unit, which is the first."""
        return next(iter(self.units))


TIME = Quantity(name="time", units={"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "days": 86400.0})
SPEED = Quantity(
    name="speed",
    units={
        "m/s": 1.0,
        "m_s": 1.0,
        "cm/s": 0.01,
        "mm/s": 0.001,
        "kn": 1852.0 / 3600.0,
        "km/h": 1.0 / 3.6,
    },
)
ANGLE = Quantity(name="angle", units={"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0})
LENGTH = Quantity(
    name="length", units={"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048}
)
QUANTITIES = (TIME, SPEED, ANGLE, LENGTH)

TIME_NAMES = ("time", "timestamp", "t", "datetime")
FIELDS = (*OWN_MOTION.fields, *RECEPTION.fields, *PLACES.names)
"""Fields of the log that a column may hold, beside "time"."""
NEEDED = (
    *OWN_MOTION.fields,
    "leader_east",
    "leader_north",
    "leader_heading",
    "leader_speed",
    "leader_depth",
)
"""Fields without which a navigator cannot work, beside a range."""
DATES = "dates (UTC)"  # how messages call the unit of times that are dates
# depths of so much above the surface are not refused: waves and a sensor's bias give them
_ABOVE_SURFACE_M = 1.0
_MAX_CHARACTERS = 40  # characters of a cell or header that messages show


def quantity_of(field: str) -> Quantity:
    """The quantity of a field of the log, or of "time"."""
    if field == "time" or field == TIMESTAMP:
        return TIME
    if "speed" in field:
        return SPEED
    return ANGLE if any(word in field for word in ("heading", "pitch", "roll")) else LENGTH


@dataclass(frozen=True, kw_only=True)
class Column:
    """Numbers of one column as they stand in the file."""

    header: str
    field: str  # of the log, or "time"
    unit: str  # as the header states it; "" without one
    values: Floats  # shape (n,); NaN where a cell is empty
    where: str  # file and column, for messages
    has_dates: bool = False  # they are dates, converted to us since 1970

    @property
    def quantity(self) -> Quantity:
        return quantity_of(self.field)


@dataclass(frozen=True, kw_only=True)
class Columns:
    """A table's columns by field, in the order of the file."""

    path: Path
    time: Column
    fields: dict[str, Column]  # all others
    has_dates: bool  # times are dates, converted to us since 1970
    unused: tuple[str, ...]  # headers that name no field


def _field_and_unit(header: str, where: str) -> tuple[str, str]:
    """Field and unit of a header, "" for what it does not name; LaisnError for an unknown unit in
    brackets.
    """
    text = header.strip().lower()
    for name in (*TIME_NAMES, *FIELDS):
        field = "time" if name in TIME_NAMES else name
        units = quantity_of(field).units
        if text == name:
            return field, ""
        bracketed = re.fullmatch(rf"{name}[ _]*[\[(]([^\])]*)[\])]", text)
        if bracketed is not None and bracketed[1].strip() not in units:
            raise LaisnError(
                f"{where}: unknown unit {shortened(bracketed[1], _MAX_CHARACTERS)!r} of column "
                f"{shortened(header, _MAX_CHARACTERS)!r}; expected {', '.join(units)}"
            )
        if bracketed is not None:
            return field, bracketed[1].strip()
        suffixed = re.fullmatch(rf"{name}[ _]*(.+)", text)
        if suffixed is not None and suffixed[1] in units:
            return field, suffixed[1]
    return "", ""


def cells_of(path: Path) -> tuple[list[str], list[list[str]]]:
    """Headers and rows of a text table; LaisnError naming the row that is none."""
    text = text_of(path)
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 3:
        raise LaisnError(f"{path}: {len(lines)} lines; a header and two rows are needed at least")
    delimiter = max(",;\t|", key=lines[0].count)
    try:
        (headers,) = csv.reader(lines[:1], delimiter=delimiter, strict=True)
    except csv.Error as error:
        start = shortened(printable(lines[0]), 2 * _MAX_CHARACTERS)
        raise LaisnError(
            f"{path}: the header {start!r} cannot be read: {error}; is a quote not closed?"
        ) from None
    rows = list[list[str]]()
    try:
        for row in csv.reader(lines[1:], delimiter=delimiter, strict=True):
            rows.append(row)
            if len(row) != len(headers):
                raise LaisnError(
                    f"{path}, row {len(rows)}: {len(row)} cells, the header has {len(headers)}"
                )
    except csv.Error as error:
        raise LaisnError(
            f"{path}, row {len(rows) + 1}: cannot be read: {error}; is a quote not closed?"
        ) from None
    if delimiter != ",":
        # a decimal comma is only possible beside another delimiter
        rows = [[cell.replace(",", ".") for cell in row] for row in rows]
    return headers, rows


def _require_columns(path: Path, fields: Mapping[str, int], headers: Sequence[str]) -> None:
    missing = [name for name in (*NEEDED, "time") if name not in fields]
    if not any(field.startswith("range_") for field in fields):
        missing.append("range_rear")
    if missing:
        names = shortened(printable(", ".join(headers)), 500)
        raise LaisnError(
            f"{path}: lacks columns {', '.join(missing)}; its columns: {names}; a map tells which "
            f"holds what: laisn log import {path} --propose map.toml"
        )


def _dates(words: Sequence[str]) -> Floats | None:
    """Times since 1970 [us] of dates, which a float64 holds exactly, NaN for empty cells; None if
    one is no date.
    """
    epoch = datetime(1970, 1, 1, tzinfo=UTC)
    times = np.full(len(words), np.nan)
    try:
        for row, word in enumerate(words):
            if word.strip():
                date = datetime.fromisoformat(word.strip())
                span = date.replace(tzinfo=date.tzinfo or UTC) - epoch
                times[row] = round(span.total_seconds() * 1e6)
    except ValueError:
        return None
    return times


def column_numbers(words: Sequence[str], where: str, largest: float = LARGEST_NUMBER) -> Floats:
    """The numbers in the cells of a column, shape (n,), NaN where they are empty; LaisnError naming
    row and value of the first that is none, or beyond ±`largest`.
    """
    try:
        return parse_numbers(words, where, largest)
    except LaisnError:
        for row, word in enumerate(words, start=1):
            parse_numbers([word], f"{where}, row {row}", largest)
        raise


def clock_numbers(words: Sequence[str], where: str) -> tuple[Floats, bool]:
    """The times in the cells of a column, shape (n,), NaN where they are empty, and whether they
    are dates, in us since 1970; LaisnError naming row and value of the first that is no time.
    """
    try:
        # a bound in seconds holds once the unit is known
        return column_numbers(words, where, 1e9 * LARGEST_NUMBER), False
    except LaisnError as error:
        dates = _dates(words)
        if dates is None:
            raise LaisnError(
                f"{error}; expected numbers or dates such as 2026-05-01T12:00:00.25Z"
            ) from None
        return dates, True


def times_of(words: Sequence[str], header: str, unit: str, where: str) -> tuple[Column, bool]:
    """The column of times, and whether they are dates."""
    values, are_dates = clock_numbers(words, where)
    missing = np.flatnonzero(~np.isfinite(values))
    if missing.size:
        cell = shortened(printable(words[int(missing[0])].strip()), _MAX_CHARACTERS)
        raise LaisnError(
            f"{where}, row {missing[0] + 1}: expected a time in each row (given: {cell!r})"
        )
    unit = "us" if are_dates else unit
    return Column(header=header, field="time", unit=unit, values=values, where=where), are_dates


def read_columns(path: Path) -> Columns:
    """The columns of a text table; delimiter and dates are detected.

    LaisnError, naming row or column: it cannot be read, a cell is no number, a column is missing,
    or two columns hold the same field.
    """
    headers, rows = cells_of(path)
    fields_and_units = [_field_and_unit(header, str(path)) for header in headers]
    index = dict[str, int]()
    for i, (field, _) in enumerate(fields_and_units):
        if field and field in index:
            raise LaisnError(
                f"{path}: columns {headers[index[field]]!r} and {headers[i]!r} both hold {field}; "
                "keep one of them"
            )
        if field:
            index[field] = i
    _require_columns(path, index, headers)

    def words(i: int) -> list[str]:
        return [row[i] for row in rows]

    time_column = index.pop("time")
    time, has_dates = times_of(
        words(time_column),
        headers[time_column],
        fields_and_units[time_column][1],
        f"{path}, column {headers[time_column]}",
    )
    fields = dict[str, Column]()
    for field, i in index.items():
        where = f"{path}, column {headers[i]}"
        unit = fields_and_units[i][1]
        are_dates = False
        if field == TIMESTAMP:
            values, are_dates = clock_numbers(words(i), where)
        else:
            values = column_numbers(words(i), where)
        fields[field] = Column(
            header=headers[i],
            field=field,
            unit="us" if are_dates else unit,
            values=values,
            where=where,
            has_dates=are_dates,
        )
    unused = tuple(
        header for header, (field, _) in zip(headers, fields_and_units, strict=True) if not field
    )
    return Columns(path=path, time=time, fields=fields, has_dates=has_dates, unused=unused)


def require_measurable(where: str, field: str, values: Floats) -> None:
    """LaisnError if a speed [m/s] or a range [m], by the field, is beyond what navigators take;
    `where` names its column, for the message.
    """
    if field == "speed":
        least, largest, unit = -MAX_SPEED, MAX_SPEED, "m/s"
    elif field.startswith("range_"):
        least, largest, unit = 0.0, MAX_RANGE, "m"
    else:
        return
    broken = np.flatnonzero((values < least) | (values > largest))
    if broken.size:
        row = int(broken[0])
        raise LaisnError(
            f"{where}, row {row + 1}: {values[row]:g} {unit}, expected {least:g} … {largest:g} "
            f"{unit}; leave the cell empty where nothing was measured"
        )


def require_depths(where: str, metres: Floats) -> None:
    """LaisnError if a depth lies above the surface, as of numbers that count upwards; `where` names
    them, for the message.
    """
    highest = float(np.nanmin(metres, initial=0.0))
    if highest < -_ABOVE_SURFACE_M:
        row = int(np.nanargmin(metres)) + 1
        raise LaisnError(
            f"{where}, row {row}: a depth of {highest:g} m lies above the surface; depths "
            "count downwards: change the sign if the column counts upwards"
        )

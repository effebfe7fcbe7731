"""The columns of a vehicle's table by a map, whatever their headers are."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.errors import LaisnError, printable, shortened
from sim.datasets.field_map import (
    LATITUDE,
    LONGITUDE,
    QUATERNION,
    FieldEntry,
    FieldMap,
    GeodeticOrigin,
    require_complete,
)
from sim.datasets.table_columns import (
    Column,
    Columns,
    cells_of,
    clock_numbers,
    column_numbers,
    quantity_of,
    times_of,
)
from sim.log.clock import TIMESTAMP


def _column_indices(path: Path, field_map: FieldMap, headers: Sequence[str]) -> dict[str, int]:
    """Indices of the columns that a map names, by header; LaisnError for one that the table has
    not, or has twice.
    """
    names = [header.strip() for header in headers]
    field_by_column = dict[str, str]()
    for field, entry in field_map.entries.items():
        if entry.topic is not None or entry.derive or entry.unit == QUATERNION:
            raise LaisnError(
                f"{field_map.path}: {field}: expected a column or a value: {path} is a table"
            )
        if entry.column is not None:
            field_by_column.setdefault(entry.column.strip(), field)
        for column in entry.where:
            field_by_column.setdefault(column.strip(), field)
    for column, field in field_by_column.items():
        if names.count(column) != 1:
            problem = "twice" if column in names else "not"
            headers_text = shortened(printable(", ".join(names)), 500)
            raise LaisnError(
                f"{field_map.path}: {field}: column {column!r} is {problem} in {path}; its "
                f"columns: {headers_text}"
            )
    return {column: names.index(column) for column in field_by_column}


def _equals(word: str, value: str | int | float | bool) -> bool:
    """Whether a cell holds a value of a map."""
    if word.strip() == str(value):
        return True
    try:
        return float(word) == float(value)
    except ValueError:
        return False


def _chosen(
    entry: FieldEntry, rows: Sequence[Sequence[str]], column_index: Mapping[str, int]
) -> Bools:
    """Rows whose cells have the values that an entry wants."""
    mask = np.ones(len(rows), dtype=np.bool_)
    for name, value in entry.where.items():
        i = column_index[name.strip()]
        mask &= np.array([_equals(row[i], value) for row in rows], dtype=np.bool_)
    return mask


def _origin(field_map: FieldMap, raw: Mapping[str, Floats]) -> GeodeticOrigin | None:
    """The map's origin, or else the first place of the table."""
    if field_map.settings.origin is not None:
        return field_map.settings.origin
    first = dict[str, float]()
    for field, values in raw.items():
        unit = field_map.entries[field].unit
        finite = values[np.isfinite(values)]
        if unit in (LATITUDE, LONGITUDE) and finite.size:
            first.setdefault(unit, float(finite[0]))
    if len(first) < 2:
        return None
    return GeodeticOrigin(latitude_deg=first[LATITUDE], longitude_deg=first[LONGITUDE])


def _column(
    field_map: FieldMap,
    field: str,
    header: str,
    values: Floats,
    origin: GeodeticOrigin | None,
    location: str,
) -> Column:
    """A column with the unit that the map states, or converted where that is no mere factor.

    `location` names file and column, for messages.
    """
    entry = field_map.entries[field]
    if entry.is_plain and entry.value is None:
        return Column(
            header=header,
            field=field,
            unit=entry.unit,
            values=values * entry.factor + entry.offset,
            where=location,
        )
    if entry.angle == "yaw" and not entry.unit and entry.value is None:
        raise LaisnError(f"{field_map.path}: {field}: a yaw needs its unit, deg or rad")
    try:
        converted = entry.in_si(values, field, origin)
    except ValueError as error:
        raise LaisnError(f"{field_map.path}: {field}: {error}") from None
    return Column(
        header=header, field=field, unit=quantity_of(field).si, values=converted, where=location
    )


def _merged(columns: Columns, times: Sequence[str]) -> Columns:
    """Rows of one time as one row, whose cells are the last ones that are not empty: a table with a
    row for each range.
    """
    groups = [
        [i for i, _ in group] for _, group in groupby(enumerate(times), key=lambda item: item[1])
    ]

    def last(values: Floats) -> Floats:
        merged = np.full(len(groups), np.nan)
        for k, rows in enumerate(groups):
            finite = [value for value in values[rows].tolist() if value == value]
            merged[k] = finite[-1] if finite else np.nan
        return merged

    first = np.array([rows[0] for rows in groups])
    return replace(
        columns,
        time=replace(columns.time, values=columns.time.values[first]),
        fields={
            field: replace(column, values=last(column.values))
            for field, column in columns.fields.items()
        },
    )


def read_mapped_columns(path: Path, field_map: FieldMap) -> Columns:
    """The columns of a text table that a map names; those without a unit may have any.

    LaisnError, naming map, row or column: the table cannot be read, lacks a column, or a cell is no
    number; the map lacks a field, or names what no table has.
    """
    require_complete(field_map, ["time"])
    headers, rows = cells_of(path)
    column_index = _column_indices(path, field_map, headers)

    def words(entry: FieldEntry) -> list[str]:
        i = column_index[str(entry.column).strip()]
        return [row[i] for row in rows]

    clock = field_map.entries["time"]
    if clock.column is None:
        raise LaisnError(f"{field_map.path}: time: expected a column")
    times = words(clock)
    time, has_dates = times_of(times, clock.column, clock.unit, f"{path}, column {clock.column}")
    raw = dict[str, Floats]()
    has_leader_dates = False
    for field, entry in field_map.entries.items():
        if field == "time":
            continue
        if entry.value is not None:
            raw[field] = np.full(len(rows), entry.value)
            continue
        mask = _chosen(entry, rows, column_index)
        cells = [word if is_read else "" for word, is_read in zip(words(entry), mask, strict=True)]
        location = f"{path}, column {entry.column}"
        if field == TIMESTAMP:
            raw[field], has_leader_dates = clock_numbers(cells, location)
        else:
            raw[field] = column_numbers(cells, location)
    origin = _origin(field_map, raw)
    fields = dict[str, Column]()
    for field, values in raw.items():
        entry = field_map.entries[field]
        header = field if entry.column is None else entry.column
        location = f"{path}, column {header}"
        if field == TIMESTAMP and has_leader_dates:
            fields[field] = Column(
                header=header,
                field=field,
                unit="us",
                values=values,
                where=location,
                has_dates=True,
            )
        else:
            fields[field] = _column(field_map, field, header, values, origin, location)
    unused = tuple(header for header in headers if header.strip() not in column_index)
    columns = Columns(path=path, time=time, fields=fields, has_dates=has_dates, unused=unused)
    has_conditions = any(entry.where for entry in field_map.entries.values())
    return _merged(columns, times) if has_conditions else columns

"""The tables of LAISN-Bench: measurements, truth and estimates as CSV files of a fixed layout.

Every number has a fixed number of decimals, so that machines whose last bits differ write the same
files but for single digits.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyarrow import ArrowInvalid, csv, types

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.messages import LeaderMessage, Measurements, Ranges, SensorHeader
from sim.sensing.sensor import header_of
from sim.sensing.sensors import SHIPPED
from sim.system import atomic_write

DECIMALS = 4
"""Of lengths [m], speeds [m/s], times [s] and angles [°] in all tables."""
_ANGLES = ("heading", "pitch", "roll", "heading_sigma")
_LENGTHS = ("east", "north", "depth", "position_sigma")
OWN_COLUMNS = ("speed [m/s]", "heading_deg", "depth [m]")
RANGE_COLUMNS = tuple(f"range_{name} [m]" for name in Ranges._fields)
TRUTH_COLUMNS = (
    "time [s]",
    "east [m]",
    "north [m]",
    "depth [m]",
    "heading_deg",
    "leader_east [m]",
    "leader_north [m]",
    "bound [m]",
)
"""Columns of a truth table: a follower's hydrophone and its compass heading, the leader's origin,
and the least RMS of the position error that is possible."""


def _leader_column(name: str) -> str:
    if name in _ANGLES:
        return f"leader_{name}_deg"
    unit = "m" if name in _LENGTHS else {"timestamp": "s", "speed": "m/s"}[name]
    return f"leader_{name} [{unit}]"


class _FurtherSensor(NamedTuple):
    """A sensor of this project that missions may have beside log, compass and pressure sensor."""

    header: SensorHeader
    columns: tuple[str, ...]
    scale: Floats  # from SI units to those of the columns


def _further_sensor(name: str, header: SensorHeader) -> _FurtherSensor:
    in_degrees = [channel.unit.startswith("rad") for channel in header.channels]
    units = [channel.unit.replace("rad", "deg") for channel in header.channels]
    names = [f"{name}_{channel.name}" for channel in header.channels]
    return _FurtherSensor(
        header=header,
        columns=tuple(f"{column} [{unit}]" for column, unit in zip(names, units, strict=True)),
        scale=np.where(in_degrees, np.degrees(1.0), 1.0),
    )


FURTHER_SENSORS = {
    str(sensor.name): _further_sensor(sensor.name, header_of(sensor()))
    for sensor in SHIPPED.values()
}
"""Further sensors by the names of their readings."""
LEADER_COLUMNS = tuple(map(_leader_column, LeaderMessage._fields))
_IN_DEGREES = np.array([name in _ANGLES for name in LeaderMessage._fields])


def _round(values: Floats) -> Floats:
    # + 0 makes −0 positive
    return np.asarray(np.round(values, DECIMALS) + 0.0)


def _round_angles(values: Floats) -> Floats:
    return np.radians(_round(np.degrees(values)))


def as_written(measurements: Measurements, transmitters: int) -> Measurements:
    """Measurements with the digits that tables have, and of two transmitters without the third."""
    custom = {
        name: _round(readings * FURTHER_SENSORS[name].scale) / FURTHER_SENSORS[name].scale
        for name, readings in measurements.custom.items()
    }
    message = _round(measurements.message)
    message[:, _IN_DEGREES] = _round_angles(measurements.message[:, _IN_DEGREES])
    ranges = _round(measurements.ranges)
    ranges[:, transmitters:] = np.nan
    return replace(
        measurements,
        speed=_round(measurements.speed),
        heading=_round_angles(measurements.heading),
        depth=_round(measurements.depth),
        message=message,
        ranges=ranges,
        custom=custom,
    )


def _texts(values: Floats) -> list[str]:
    """Numbers with their decimals; NaN as an empty cell."""
    return ["" if math.isnan(value) else f"{value:.{DECIMALS}f}" for value in values.tolist()]


def _write(path: Path, columns: Mapping[str, Sequence[str]]) -> None:
    rows = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as unfinished:
        unfinished.write_text("\n".join(rows) + "\n", encoding="utf-8", newline="\n")


def write_measurements(path: Path, measurements: Measurements) -> None:
    """Write what a follower measured: a row for each filter step, as `laisn log import` reads it.

    Columns of the leader's message that are never there, and those of transmitters that are never
    heard, are left out.
    """
    columns: dict[str, Sequence[str]] = {"time [s]": _texts(measurements.time)}
    own_readings = (measurements.speed, np.degrees(measurements.heading), measurements.depth)
    columns |= {
        name: _texts(values) for name, values in zip(OWN_COLUMNS, own_readings, strict=True)
    }
    for name, readings in measurements.custom.items():
        sensor = FURTHER_SENSORS[name]
        values_by_channel = (readings * sensor.scale).T
        columns |= {
            column: _texts(values)
            for column, values in zip(sensor.columns, values_by_channel, strict=True)
        }
    message = np.where(_IN_DEGREES, np.degrees(measurements.message), measurements.message)
    received = [
        *zip(LEADER_COLUMNS, message.T, strict=True),
        *zip(RANGE_COLUMNS, measurements.ranges.T, strict=True),
    ]
    rows = measurements.message_step - 1
    for name, values in received:
        if np.isnan(values).all():
            continue
        cells = np.full(measurements.speed.size, np.nan)
        cells[rows] = values
        columns[name] = _texts(cells)
    _write(path, columns)


def write_truth(path: Path, rows: Floats) -> None:
    """Write the true path, rows in the order of `TRUTH_COLUMNS`, shape (n, 8)."""
    _write(path, dict(zip(TRUTH_COLUMNS, map(_texts, _round(rows).T), strict=True)))


def read_columns(path: Path) -> dict[str, Any]:
    """Columns of a CSV file by their names: numbers as floats, NaN where a cell is empty, and
    texts; LaisnError if it cannot be read.
    """
    try:
        table = csv.read_csv(path)
    except OSError as error:
        raise LaisnError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ArrowInvalid as error:
        raise LaisnError(f"{path}: no table of comma-separated values: {error}") from error
    columns = dict[str, Any]()
    for name, column in zip(table.column_names, table.columns, strict=True):
        if types.is_integer(column.type) or types.is_floating(column.type):
            columns[name] = column.to_numpy().astype(np.float64)
        elif types.is_null(column.type):
            columns[name] = np.full(table.num_rows, np.nan)
        else:
            columns[name] = np.array(column.cast("string").to_pylist(), dtype=object)
    return columns


def _first_text(cells: Sequence[str | None]) -> tuple[int, str]:
    """Number, from 1 on, and text of the first cell that is no number."""
    for row, cell in enumerate(cells, start=1):
        try:
            float(cell or "nan")
        except ValueError:
            return row, str(cell)
    # all are numbers to Python, which takes 1_000, too
    return 1, str(cells[0])


def require_numbers(path: Path, columns: Mapping[str, Any], names: Sequence[str]) -> Floats:
    """Columns of numbers by their names, shape (n, len(names)); LaisnError naming the first that is
    not there or holds other things.
    """
    for name in names:
        if name not in columns:
            raise LaisnError(
                f"{path}: lacks column {name!r}; expected {', '.join(names)} (given: "
                f"{', '.join(columns)})"
            )
        if columns[name].dtype == object:
            row, cell = _first_text(columns[name])
            raise LaisnError(
                f"{path}: column {name!r}, row {row} of the values: {cell!r:.60}; expected a number"
            )
    return np.column_stack([columns[name] for name in names])


def read_measurements(path: Path) -> Measurements:
    """Read what `write_measurements` wrote; LaisnError if it cannot be read."""
    columns = read_columns(path)
    own_readings = require_numbers(path, columns, ("time [s]", *OWN_COLUMNS))
    n = len(own_readings)
    if not n:
        raise LaisnError(f"{path}: has no rows")
    empty = np.full(n, np.nan)
    received = {name: columns.get(name, empty) for name in (*LEADER_COLUMNS, *RANGE_COLUMNS)}
    message = require_numbers(path, received, LEADER_COLUMNS)
    ranges = require_numbers(path, received, RANGE_COLUMNS)
    message[:, _IN_DEGREES] = np.radians(message[:, _IN_DEGREES])
    rows = np.flatnonzero(np.isfinite(message[:, 1]))
    custom = {
        name: require_numbers(path, columns, sensor.columns) / sensor.scale
        for name, sensor in FURTHER_SENSORS.items()
        if set(sensor.columns) <= columns.keys()
    }
    return Measurements(
        dt=round(float(own_readings[-1, 0]) / n, DECIMALS),
        speed=own_readings[:, 1],
        heading=np.radians(own_readings[:, 2]),
        depth=own_readings[:, 3],
        message_step=rows + 1,
        message=message[rows],
        ranges=ranges[rows],
        custom=custom,
        sensors={name: FURTHER_SENSORS[name].header for name in custom},
    )


class Truth(NamedTuple):
    """A follower's true path at filter steps."""

    time: Floats  # shape (n,), [s]
    position: Floats  # of the hydrophone, east and north, shape (n, 2), [m]
    leader: Floats  # origin of the leader, east and north, shape (n, 2), [m]
    bound: Floats  # least RMS of the position error, shape (n,), [m]


def read_truth(path: Path) -> Truth:
    """Read what `write_truth` wrote; LaisnError if it cannot be read."""
    rows = require_numbers(path, read_columns(path), TRUTH_COLUMNS)
    return Truth(rows[:, 0], rows[:, 1:3], rows[:, 5:7], rows[:, 7])

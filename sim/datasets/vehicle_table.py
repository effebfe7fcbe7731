"""A vehicle's measurements in a text table with named columns, as a log that navigation is replayed
on.

Columns have the names of the log's fields, with or without a unit ("heading_deg", "range_rear
[m]"). A row without ranges holds own measurements alone, and a row without own measurements a
reception alone. Rows stand in order of recording.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.errors import LaisnError
from sim.datasets.field_map import FieldMap
from sim.datasets.interpolation import interpolated
from sim.datasets.mapped_table import read_mapped_columns
from sim.datasets.range_data import LARGEST_NUMBER
from sim.datasets.table_columns import (
    ANGLE,
    DATES,
    TIME,
    Column,
    Columns,
    read_columns,
    require_depths,
    require_measurable,
)
from sim.datasets.table_units import UnitChoice, decide_units, timestamp_unit
from sim.log.clock import (
    TIMESTAMP,
    RecordedRows,
    correct_steps_back,
    correct_steps_forward,
    reception_times,
)
from sim.log.order import repeats
from sim.log.schema import OWN_MOTION


class VehicleTable(NamedTuple):
    """Own measurements and receptions of a table, and what was taken for what."""

    time_ns: Ints  # of each row, increasing, shape (n,), [ns]
    reception_ns: Ints  # when the row's message was received, shape (n,), [ns]
    # by the names of the log's fields, shape (n,), in SI units; NaN where a cell is empty
    columns: dict[str, Floats]
    remarks: tuple[str, ...]


def _require_bounded(columns: Columns, unit: str) -> None:
    """LaisnError if times are too large for their unit."""
    if np.abs(columns.time.values).max() * TIME.units[unit] > LARGEST_NUMBER:
        raise LaisnError(
            f"{columns.time.where}: in {unit}, times are not within ±{LARGEST_NUMBER:g} s"
        )


def _time_ns(columns: Columns, unit: str) -> Ints:
    """Times of the rows; LaisnError if they are too large for their unit."""
    _require_bounded(columns, unit)
    ns_per_unit = round(1e9 * TIME.units[unit])
    return np.rint(columns.time.values * ns_per_unit).astype(np.int64)


def _require_since_1970(columns: Columns, recording: RecordedRows) -> None:
    """LaisnError if corrected times lie before 1970."""
    row = int(np.argmin(recording.time))
    if recording.time[row] < 0:
        raise LaisnError(
            f"{columns.time.where}, row {recording.number(row)}: times before 1970, or negative "
            "ones"
        )


def _si(
    columns: Columns, choice: UnitChoice, time_s: Floats
) -> tuple[dict[str, Floats], list[str]]:
    """Columns in SI units, and what unit each was taken in."""
    table = dict[str, Floats]()
    remarks = list[str]()

    def add(column: Column, unit: str) -> None:
        values = column.values * column.quantity.units[unit]
        if np.nanmax(np.abs(values), initial=0.0) > LARGEST_NUMBER:
            raise LaisnError(
                f"{column.where}: in {unit}, values are not within ±{LARGEST_NUMBER:g} "
                f"{column.quantity.si}"
            )
        require_measurable(column.where, column.field, values)
        if "depth" in column.field:
            require_depths(column.where, values)
        table[column.field] = values
        words = DATES if column.has_dates else unit
        remarks.append(f"{column.header.strip()}: {column.field} in {words}")

    for field, column in columns.fields.items():
        if field == TIMESTAMP:
            time_unit = columns.time.unit or choice[TIME.name]
            add(column, timestamp_unit(columns, time_s, time_unit))
        else:
            add(column, column.unit or choice[column.quantity.name])
    return table, remarks


def _rows_once(time_ns: Ints, table: Mapping[str, Floats]) -> tuple[Ints, list[str]]:
    """Numbers, from 1 on, of the rows that do not repeat earlier ones wholly, and a remark on the
    others.
    """
    is_repeated = repeats(time_ns, np.column_stack([*table.values()]))
    numbers = np.arange(1, time_ns.size + 1)
    count = int(np.count_nonzero(is_repeated))
    if not count:
        return numbers, []
    first = int(np.argmax(is_repeated)) + 1
    rows = "1 row repeats an earlier one" if count == 1 else f"{count} rows repeat earlier ones"
    return numbers[~is_repeated], [f"{rows} wholly, first row {first}: left out"]


def _has_steps(columns: Columns, table: Mapping[str, Floats]) -> Bools:
    """Rows with what is measured most often of the vehicle's own motion, which are its filter
    steps, shape (n,); LaisnError if speed, heading or depth is in no row.
    """
    measured = {field: np.isfinite(table[field]) for field in OWN_MOTION.fields}
    empty = [
        columns.fields[field].header.strip() for field, rows in measured.items() if not rows.any()
    ]
    if empty:
        raise LaisnError(f"{columns.path}: all cells of {', '.join(empty)} are empty")
    return max(measured.values(), key=np.count_nonzero)


def _bring_to_steps(
    columns: Columns, time_ns: Ints, table: dict[str, Floats], is_step: Bools
) -> list[str]:
    """Leave own motion at the filter steps alone, with rows in order of time; remarks on what they
    lacked.

    Speed and heading that are measured less often are interpolated to them, but not over gaps:
    such steps are none. A depth in another row is that of the next step, and where there is none
    it is absent. LaisnError if no step has speed and heading.
    """
    remarks = list[str]()
    steps = np.flatnonzero(is_step)

    def remark(field: str, count: int, consequence: str) -> None:
        if count:
            header = columns.fields[field].header.strip()
            remarks.append(
                f"{header}: absent at {count} of {steps.size} filter steps, {consequence}"
            )

    at_steps = dict[str, Floats]()
    for field in ("speed", "heading"):
        values = table[field]
        is_angle = columns.fields[field].quantity is ANGLE
        at_steps[field] = interpolated(time_ns, values, time_ns[steps], is_angle=is_angle)
        absent = np.isnan(values[steps])
        bridged = int(np.count_nonzero(absent & np.isfinite(at_steps[field])))
        remark(field, bridged, "interpolated")
        remark(field, int(absent.sum()) - bridged, "in gaps or at an end: left out")
    others = np.flatnonzero(np.isfinite(table["depth"]) & ~is_step)
    next_step = np.searchsorted(time_ns[steps], time_ns[others])
    has_next = next_step < steps.size
    depth = np.full(steps.size, np.nan)
    depth[next_step[has_next]] = table["depth"][others[has_next]]
    own_depth = table["depth"][steps]
    at_steps["depth"] = np.where(np.isfinite(own_depth), own_depth, depth)
    remark("depth", int(np.isnan(at_steps["depth"]).sum()), "the last one counts")
    is_complete = np.isfinite(at_steps["speed"]) & np.isfinite(at_steps["heading"])
    if not is_complete.any():
        headers = " and ".join(columns.fields[f].header.strip() for f in ("speed", "heading"))
        raise LaisnError(f"{columns.path}: {headers} are never known at the same time")
    for field, values in at_steps.items():
        table[field] = np.full(time_ns.size, np.nan)
        table[field][steps] = np.where(is_complete, values, np.nan)
    return remarks


def read_vehicle_table(path: Path, field_map: FieldMap | None = None) -> VehicleTable:
    """Measurements of a text table; header, delimiter, units and format of time are detected, or
    columns and units are those of a map.

    Units that no header states are those that motion and ranges fit (`table_units`); steps of the
    clock are corrected, and receptions that were written late are dated by the leader's clock
    (`sim.log.clock`). LaisnError, naming row or column, if the table cannot be read, lacks a
    column, has one twice, a cell is no number, or a unit or the clock remains in doubt.
    """
    columns = read_columns(path) if field_map is None else read_mapped_columns(path, field_map)
    if columns.time.unit:
        _require_bounded(columns, columns.time.unit)
    choice, choice_remarks = decide_units(columns)
    unit = columns.time.unit or choice[TIME.name]
    time_ns = _time_ns(columns, unit)
    table, unit_remarks = _si(columns, choice, (time_ns - time_ns[0]) / 1e9)
    numbers, repeat_remarks = _rows_once(time_ns, table)
    time_ns = time_ns[numbers - 1]
    table = {field: values[numbers - 1] for field, values in table.items()}
    ranges = {field: values for field, values in table.items() if field.startswith("range_")}
    received = np.any(np.isfinite(list(ranges.values())), axis=0)
    if not received.any():
        headers = ", ".join(columns.fields[field].header.strip() for field in ranges)
        raise LaisnError(f"{path}: no row has a range, all cells of {headers} are empty")
    has_motion = _has_steps(columns, table)
    recording = RecordedRows(
        source=str(path),
        name=columns.time.header.strip(),
        time=time_ns,
        columns=table,
        has_motion=has_motion,
        received=received,
        remarks=repeat_remarks,
        numbers=numbers,
    )
    correct_steps_back(recording)
    correct_steps_forward(recording)
    _require_since_1970(columns, recording)
    received_ns = reception_times(recording)
    time_ns = recording.time
    table = recording.columns
    table.setdefault(TIMESTAMP, time_ns / 1e9)
    order = np.argsort(time_ns, kind="stable")
    table = {field: values[order] for field, values in table.items()}
    step_remarks = _bring_to_steps(columns, time_ns[order], table, has_motion[order])
    header = columns.time.header.strip()
    remarks = [
        f"{header}: time in {DATES if columns.has_dates else unit}, {np.ptp(time_ns) / 1e9:g} s",
        *unit_remarks,
        *choice_remarks,
        *recording.remarks,
        *step_remarks,
    ]
    remarks += [f"not used: {', '.join(columns.unused)}"] if columns.unused else []
    return VehicleTable(time_ns[order], received_ns[order], table, tuple(remarks))

"""Results as tables for use from Python: short to print, and ready for pandas, polars and NumPy."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.messages import Measurements, Ranges, SensorHeader
from reports.parquet import arrow_table
from reports.summary import mirror_locked_steps, true_bearing
from sim.flight import FlightRecord, position_and_bearing_errors

_MAX_SHOWN_ROWS = 5
_MAX_NAMED_COLUMNS = 12


class Table:
    """Columns of a result by name; `arrow` is the `pyarrow.Table`.

    `table["e_p_m"]` is a NumPy array; `polars.DataFrame(table)` and
    `pandas.DataFrame.from_arrow(table)` accept it.
    """

    def __init__(self, arrow: pa.Table) -> None:
        self.arrow = arrow

    @classmethod
    def read(cls, path: Path) -> Table:
        """The table in a Parquet file of a study; LaisnError if the file is damaged."""
        return cls(arrow_table(path))

    @property
    def columns(self) -> list[str]:
        return list(self.arrow.column_names)

    def __len__(self) -> int:
        return int(self.arrow.num_rows)

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """Values of a column, shape (rows,); LaisnError listing the columns if there is none of
        that name.
        """
        if name not in self.columns:
            raise LaisnError(f"unknown column {name!r}; available: {', '.join(self.columns)}")
        return np.asarray(self.arrow[name].to_numpy())

    def rows(self) -> list[dict[str, Any]]:
        """Every row as a dictionary."""
        return list(self.arrow.to_pylist())

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame`; LaisnError if pandas is not installed."""
        try:
            return self.arrow.to_pandas()
        except ModuleNotFoundError:
            raise LaisnError("to_pandas needs pandas: pip install pandas") from None

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Arrow's protocol, with which other libraries read a table without a copy."""
        return self.arrow.__arrow_c_stream__(requested_schema)

    def __repr__(self) -> str:
        columns = self.columns[:_MAX_NAMED_COLUMNS]
        if len(self.columns) > _MAX_NAMED_COLUMNS:
            columns.append("…")
        return f"<Table: {len(self)} rows, {len(self.columns)} columns: {', '.join(columns)}>"

    def _repr_html_(self) -> str:
        heads = "".join(f"<th>{html.escape(name)}</th>" for name in self.columns)
        rows = ""
        for row in self.arrow.slice(0, _MAX_SHOWN_ROWS).to_pylist():
            texts = (f"{v:.6g}" if isinstance(v, float) else str(v) for v in row.values())
            rows += f"<tr>{''.join(f'<td>{html.escape(text)}</td>' for text in texts)}</tr>"
        return (
            f"<table><caption>{len(self)} "
            f"rows</caption><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
        )


def _place(position: npt.NDArray[Any]) -> dict[str, Any]:
    """Columns of positions (east, north, up), shape (n, 3), [m]."""
    return {"east_m": position[:, 0], "north_m": position[:, 1], "depth_m": -position[:, 2]}


def errors_table(flight: FlightRecord) -> Table:
    """Errors of a flight's estimates over time, a row for each follower and filter step.

    Columns: `follower`, `time_s`; `e_p_m` and `e_b_deg`, the paper's errors of position and
    bearing; `east_m`, `north_m`, `depth_m` of the hydrophone and the `estimate_east_m`,
    `estimate_north_m` of it; `bearing_deg` from the leader's bow clockwise and `distance_m` from
    the leader; `mirror_locked`, whether the estimate is at the mirror image.
    """
    steps = flight.step_index()
    time = flight.trajectory.time[steps]
    leader = flight.trajectory.position[steps, 0, :2]
    parts = []
    for i, (position, bearing) in enumerate(position_and_bearing_errors(flight)):
        truth = flight.hydrophone(i)
        estimate = flight.estimates[i].state
        columns = {
            "follower": [flight.trajectory.names[i + 1]] * time.size,
            "time_s": time,
            "e_p_m": position,
        }
        columns |= {"e_b_deg": np.rad2deg(bearing), **_place(truth)}
        columns |= {"estimate_east_m": estimate[:, 0], "estimate_north_m": estimate[:, 1]}
        columns |= {"bearing_deg": np.rad2deg(true_bearing(flight, i))}
        columns |= {
            "distance_m": np.hypot(*(truth[:, :2] - leader).T),
            "mirror_locked": mirror_locked_steps(flight, i),
        }
        parts.append(pa.table(columns))
    return Table(pa.concat_tables(parts))


def truth_table(flight: FlightRecord) -> Table:
    """True motion over time, a row for each vehicle and control step.

    Columns: `vehicle`, `time_s`; `east_m`, `north_m`, `depth_m` of the body origin; `heading_deg`,
    `pitch_deg` (nose up), `roll_deg` (starboard down); `surge_m_s`, speed along the hull through
    the water; `velocity_east_m_s`, `velocity_north_m_s`, `velocity_up_m_s` over ground;
    `water_east_m_s`, `water_north_m_s`, `water_up_m_s`.
    """
    t = flight.trajectory
    parts = []
    for v, name in enumerate(t.names):
        columns = {"vehicle": [name] * t.time.size, "time_s": t.time, **_place(t.position[:, v])}
        columns |= {
            "heading_deg": np.rad2deg(t.heading[:, v]) % 360.0,
            "pitch_deg": np.rad2deg(t.pitch[:, v]),
        }
        columns |= {"roll_deg": np.rad2deg(t.roll[:, v]), "surge_m_s": t.forward_speed[:, v]}
        for quantity, values in (("velocity", t.velocity), ("water", t.water_velocity)):
            columns |= {
                f"{quantity}_{axis}_m_s": values[:, v, j]
                for j, axis in enumerate(("east", "north", "up"))
            }
        parts.append(pa.table(columns))
    return Table(pa.concat_tables(parts))


_LEADER_COLUMNS = (
    "time_s",
    "east_m",
    "north_m",
    "heading_deg",
    "speed_m_s",
    "depth_m",
    "pitch_deg",
    "roll_deg",
    "heading_sigma_deg",
    "position_sigma_m",
)
"""Columns of the fields of `LeaderMessage`, in their order; angles in degrees."""


def _custom_columns(measurements: Measurements) -> Iterator[tuple[str, Floats]]:
    """Readings of further sensors as columns, shape (n,): names with units, angles in degrees."""
    for sensor, readings in measurements.custom.items():
        rows = readings.reshape(len(readings), -1)
        header = measurements.sensors.get(sensor, SensorHeader())
        units = [channel.unit for channel in header.channels] or [""] * rows.shape[1]
        for name, unit, values in zip(header.names(rows.shape[1]), units, rows.T, strict=True):
            is_angle = unit.partition("/")[0] == "rad"
            shown_unit = unit.replace("rad", "deg", 1) if is_angle else unit
            ending = re.sub(r"\W+", "_", shown_unit).strip("_").lower()
            column = "_".join(filter(None, (sensor, name, ending)))
            yield column, np.rad2deg(values) if is_angle else values


def measurements_table(flight: FlightRecord) -> Table:
    """What the followers measured, a row for each follower and filter step.

    Columns: `follower`, `time_s`; `speed_m_s`, `heading_deg` and `depth_m` of its own sensors;
    where a message was received, the fields of `laisn.messages.LeaderMessage` as `leader_…` and the
    slant ranges `range_rear_m`, `range_front_m` and `range_middle_m`; where a further sensor read,
    its channels as `NAME_CHANNEL_UNIT` (`dvl_altitude_m`); null elsewhere.
    """
    parts = []
    for name, measurements in zip(flight.trajectory.names[1:], flight.measurements, strict=True):
        columns = {
            "follower": [name] * measurements.speed.size,
            "time_s": flight.trajectory.time[0] + measurements.time,
            "speed_m_s": measurements.speed,
        }
        columns |= {
            "heading_deg": np.rad2deg(measurements.heading) % 360.0,
            "depth_m": measurements.depth,
        }
        received = {
            f"leader_{column}": measurements.message[:, i]
            for i, column in enumerate(_LEADER_COLUMNS)
        }
        received |= {
            f"range_{transmitter}_m": measurements.ranges[:, i]
            for i, transmitter in enumerate(Ranges._fields)
        }
        for column, values in received.items():
            column_values = np.full(measurements.speed.size, np.nan)
            column_values[measurements.message_step - 1] = (
                np.rad2deg(values) if column.endswith("_deg") else values
            )
            columns[column] = pa.array(column_values, from_pandas=True)
        for column, values in _custom_columns(measurements):
            columns[column] = pa.array(values, from_pandas=True)
        parts.append(pa.table(columns))
    # vehicles may carry different sensors
    return Table(pa.concat_tables(parts, promote_options="default"))

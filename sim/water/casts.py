"""Speeds of sound by depth out of casts: tables and NetCDF files of temperature and salinity, or of
the speed itself.

Temperature, salinity and pressure become speeds by TEOS-10 (IOC, SCOR and IAPSO, The international
thermodynamic equation of seawater 2010; package gsw). Of a file with many columns the nearest one
to the origin is taken, at the nearest time.
"""

import csv
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.system import file_digest
from sim.water.field_files import (
    FieldOrigin,
    Source,
    VariableNames,
    axis_kind,
    find,
    open_dataset,
    units_of,
)

_SLOWEST, _FASTEST = 1300.0, 1700.0  # of sound in the sea, and the bounds of the keys [m/s]
_LARGEST_BYTES = 50_000_000  # of a table


class CastColumn(NamedTuple):
    """A quantity of a cast, and what its units are multiplied by, and added, to have those of
    TEOS-10.
    """

    quantity: VariableNames
    units: dict[str, tuple[float, float]]  # factor and offset; "" if none is given


_CELSIUS = dict.fromkeys(
    ("", "degc", "deg_c", "celsius", "degree_celsius", "degrees_celsius", "°c", "c", "degrees c"),
    (1.0, 0.0),
) | dict.fromkeys(("k", "kelvin", "degk"), (1.0, -273.15))
_SALINITY = dict.fromkeys(
    ("", "1", "psu", "1e-3", "0.001", "g/kg", "g kg-1", "pss-78", "ppt", "‰", "pss"), (1.0, 0.0)
) | {"kg/kg": (1000.0, 0.0), "kg kg-1": (1000.0, 0.0)}
_DEPTH = dict.fromkeys(("", "m", "meter", "metre", "meters", "metres"), (1.0, 0.0))
_PRESSURE = dict.fromkeys(("", "dbar", "decibar", "db"), (1.0, 0.0)) | {
    "pa": (1e-4, 0.0),
    "kpa": (0.1, 0.0),
    "bar": (10.0, 0.0),
    "mbar": (0.01, 0.0),
    "hpa": (0.01, 0.0),
}
_SPEED = dict.fromkeys(("", "m/s", "m s-1", "meter/second", "m_s"), (1.0, 0.0))

COLUMNS = {
    "speed": CastColumn(
        VariableNames(
            "speed of sound",
            ("speed_of_sound_in_sea_water",),
            ("sound_speed", "soundspeed", "speed_of_sound", "svel", "sv", "sound_velocity", "c"),
        ),
        _SPEED,
    ),
    "conservative": CastColumn(
        VariableNames(
            "conservative temperature",
            ("sea_water_conservative_temperature",),
            ("conservative_temperature", "ct"),
        ),
        _CELSIUS,
    ),
    "potential": CastColumn(
        VariableNames(
            "potential temperature",
            ("sea_water_potential_temperature",),
            ("potential_temperature", "thetao", "votemper", "water_temp", "pt", "theta"),
        ),
        _CELSIUS,
    ),
    "temperature": CastColumn(
        VariableNames(
            "temperature", ("sea_water_temperature",), ("temperature", "temp", "t", "tem", "t90")
        ),
        _CELSIUS,
    ),
    "absolute": CastColumn(
        VariableNames(
            "absolute salinity", ("sea_water_absolute_salinity",), ("absolute_salinity", "sa")
        ),
        _SALINITY,
    ),
    "salinity": CastColumn(
        VariableNames(
            "salinity",
            ("sea_water_practical_salinity", "sea_water_salinity"),
            ("practical_salinity", "salinity", "sal", "psal", "so", "vosaline", "s", "sp"),
        ),
        _SALINITY,
    ),
    "pressure": CastColumn(
        VariableNames("pressure", ("sea_water_pressure",), ("pressure", "pres", "press", "p")),
        _PRESSURE,
    ),
    "depth": CastColumn(
        VariableNames("depth", ("depth",), ("depth", "z", "lev", "level", "deptht")), _DEPTH
    ),
}


@dataclass(frozen=True, kw_only=True)
class Cast:
    """A speed of sound by depth."""

    points: Floats  # depth [m] and speed [m/s], shape (n, 2), depths increasing
    report: str  # what was read, in a line


def read_cast(source: Source, origin: FieldOrigin) -> Cast:
    """The speed of sound of a file; FieldError if it has none."""
    return _read_cast(source, file_digest(source.file), origin)


@lru_cache(maxsize=4)
def _read_cast(source: Source, _digest: str | None, origin: FieldOrigin) -> Cast:
    if source.file.suffix.lower() in (".csv", ".txt", ".tsv"):
        columns, names = _of_table(source)
    else:
        columns, names = _of_dataset(source, origin)
    depth, speed = _profile(source, columns, origin)
    present = np.isfinite(depth) & np.isfinite(speed)
    rows = present.size
    if not present.any():
        raise source.error("none of its rows has all numbers that are needed")
    order = np.argsort(depth[present], kind="stable")
    depth = depth[present][order]
    speed = speed[present][order]
    if depth[0] < 0.0:
        raise source.error(f"it has a depth of {depth[0]:g} m; depths count downwards")
    distinct = np.flatnonzero(np.diff(depth, prepend=-1.0) > 1e-6)
    # rows of one depth are averaged
    means = np.add.reduceat(speed, distinct) / np.diff([*distinct, depth.size])
    points = np.column_stack([depth[distinct], means])
    if points[:, 1].min() < _SLOWEST or points[:, 1].max() > _FASTEST:
        raise source.error(
            f"its speeds of sound are {points[:, 1].min():.4g} to {points[:, 1].max():.4g} m/s; "
            f"expected {_SLOWEST:g} to {_FASTEST:g} m/s: are units of temperature, salinity and "
            "depth right?"
        )
    report = (
        f"{source.file.name}: {', '.join(names)}; {len(points)} depths, {points[0, 0]:.4g} to "
        f"{points[-1, 0]:.4g} m, {points[:, 1].min():.1f} to {points[:, 1].max():.1f} m/s"
    )
    if not present.all():
        report += f"; {rows - int(present.sum())} of {rows} rows lack numbers and are left out"
    return Cast(points=points, report=report)


def _profile(
    source: Source, columns: dict[str, Floats], origin: FieldOrigin
) -> tuple[Floats, Floats]:
    """Depths [m] and speeds of sound [m/s] of the rows of a cast."""
    latitude = origin.latitude_deg
    if "depth" not in columns and "pressure" not in columns:
        raise source.error("it has neither depth nor pressure; expected a column 'depth'")
    try:
        import gsw
    except ImportError:
        raise source.error(
            "reading casts needs packages that are not installed: pip install 'laisn-sim[fields]'"
        ) from None
    depth = columns.get("depth")
    pressure = columns.get("pressure")
    if depth is None:
        depth = -gsw.z_from_p(pressure, latitude)
    if pressure is None:
        pressure = gsw.p_from_z(-depth, latitude)
    if "speed" in columns:
        return depth, columns["speed"]
    salinity = columns.get("absolute")
    if salinity is None:
        practical = columns.get("salinity")
        if practical is None:
            raise source.error("it has no salinity, and no speed of sound; expected 'salinity'")
        salinity = gsw.SA_from_SP(practical, pressure, origin.longitude_deg, latitude)
    if "conservative" in columns:
        temperature = columns["conservative"]
    elif "temperature" in columns:
        temperature = gsw.CT_from_t(salinity, columns["temperature"], pressure)
    elif "potential" in columns:
        temperature = gsw.CT_from_pt(salinity, columns["potential"])
    else:
        raise source.error("it has no temperature, and no speed of sound; expected 'temperature'")
    return np.asarray(depth), np.asarray(gsw.sound_speed(salinity, temperature, pressure))


def _scaled(source: Source, name: str, values: Floats, column: CastColumn, units: str) -> Floats:
    if units not in column.units:
        expected = ", ".join(unit for unit in list(column.units)[1:4])
        raise source.error(f"{name} has units {units!r}; expected {expected}")
    factor, offset = column.units[units]
    return factor * values + offset


def _column_of(header: str) -> tuple[str, str] | None:
    """The quantity and unit of a header, as `temperature_degC`, `Temperature [°C]` or `temp`."""
    text = header.strip().lower().replace("(", "[").rstrip(")]").strip()
    name, bracket, units = (piece.strip() for piece in text.partition("["))
    name = name.replace(" ", "_")
    for key, column in COLUMNS.items():
        for quantity_name in (*column.quantity.standard_names, *column.quantity.names):
            if name == quantity_name:
                return key, units if bracket else ""
            if (
                not bracket
                and name.startswith(f"{quantity_name}_")
                and name[len(quantity_name) + 1 :] in {*column.units}
            ):
                return key, name[len(quantity_name) + 1 :]
    return None


def _of_table(source: Source) -> tuple[dict[str, Floats], list[str]]:
    try:
        if source.file.stat().st_size > _LARGEST_BYTES:
            raise source.error(f"it is larger than {_LARGEST_BYTES / 1e6:g} MB")
        text = source.file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise source.error(f"cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise source.error("it is no UTF-8 text") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 2:
        raise source.error("it has no rows below a header")
    separator = max(",;\t", key=lines[0].count)
    rows = list(csv.reader(lines, delimiter=separator))
    columns: dict[str, Floats] = {}
    names = []
    for index, header in enumerate(rows[0]):
        quantity = _column_of(header)
        if quantity is None or quantity[0] in columns:
            continue
        key, units = quantity
        values = np.array([_number(source, row, index, number) for number, row in _data(rows)])
        columns[key] = _scaled(source, f"column {header!r}", values, COLUMNS[key], units)
        names.append(header.strip())
    if not columns:
        expected = "'depth', 'temperature', 'salinity', or 'depth', 'sound_speed'"
        raise source.error(f"its header {lines[0]!r:.80} has none of the columns {expected}")
    return columns, names


def _data(rows: list[list[str]]) -> list[tuple[int, list[str]]]:
    return list(enumerate(rows[1:], start=2))


def _number(source: Source, row: list[str], index: int, number: int) -> float:
    text = row[index].strip() if index < len(row) else ""
    if not text:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        raise source.error(
            f"row {number} has {text!r:.40} in column {index + 1}; expected a number"
        ) from None


def _of_dataset(source: Source, origin: FieldOrigin) -> tuple[dict[str, Floats], list[str]]:
    columns: dict[str, Floats] = {}
    names = []
    with open_dataset(source) as dataset:
        for key, column in COLUMNS.items():
            axis = key in ("depth", "pressure")
            variable = find(dataset, column.quantity, coordinates=axis)
            if variable is None:
                continue
            values = _nearest_column(source, dataset, variable, origin)
            values = np.atleast_1d(np.asarray(values, dtype=np.float64))
            columns[key] = _scaled(source, str(variable.name), values, column, units_of(variable))
            if key == "depth" and str(variable.attrs.get("positive", "")).lower() == "up":
                columns[key] = -columns[key]
            names.append(str(variable.name))
    if not columns:
        raise source.error("it has no temperature, salinity or speed of sound by their usual names")
    sizes = {values.size for values in columns.values()}
    if len(sizes) > 1:
        raise source.error(f"its variables {', '.join(names)} have different numbers of depths")
    return columns, names


def _nearest_column(source: Source, dataset: Any, variable: Any, origin: FieldOrigin) -> Any:
    """A variable along its one axis of depth, nearest to the origin and at the first time."""
    chosen: dict[Any, int] = {}
    for dimension in variable.dims:
        kind = axis_kind(dataset[dimension]) if dimension in dataset.coords else ""
        if kind == "X" or kind == "Y":
            coordinate = origin.longitude_deg if kind == "X" else origin.latitude_deg
            away = np.asarray(dataset[dimension].values, dtype=np.float64) - coordinate
            away = (away + 180.0) % 360.0 - 180.0 if kind == "X" else away
            chosen[dimension] = int(np.argmin(np.abs(away)))
        elif kind == "T" or (kind == "" and variable.sizes[dimension] == 1):
            chosen[dimension] = 0
    cut = variable.isel(chosen)
    if cut.ndim > 1:
        raise source.error(
            f"{variable.name} has axes {', '.join(map(str, cut.dims))}; expected depth alone, "
            "beside longitude, latitude and time"
        )
    return cut.values

"""Columns of casts out of tables and NetCDF files, in the units of TEOS-10.

A file may hold many columns of water: a grid of longitude and latitude, a list of profiles with
places of their own (as those of Argo floats), or rows of a table that name their cast or place. One
is taken: that of a number, or the nearest to the origin that has values.
"""

import csv
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.attitude import metres_per_degree
from sim.water.field_files import (
    FieldError,
    FieldOrigin,
    Source,
    VariableNames,
    axis_kind,
    find,
    open_dataset,
    seconds_from_start,
    units_of,
)

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

_LARGEST_BYTES = 50_000_000  # of a table
_MAX_TRIALS = 400  # columns nearest to the origin that are searched for values


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
_DENSITY = dict.fromkeys(
    ("", "kg/m3", "kg/m³", "kg/m^3", "kg m-3", "kg m^-3", "kg m**-3"), (1.0, 0.0)
) | {"g/cm3": (1000.0, 0.0), "g cm-3": (1000.0, 0.0)}
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
    "density": CastColumn(
        VariableNames("density", ("sea_water_density",), ("density", "rho", "insitu_density")),
        _DENSITY,
    ),
    "pressure": CastColumn(
        VariableNames("pressure", ("sea_water_pressure",), ("pressure", "pres", "press", "p")),
        _PRESSURE,
    ),
    "depth": CastColumn(
        VariableNames("depth", ("depth",), ("depth", "z", "lev", "level", "deptht")), _DEPTH
    ),
}
_LEVELS = ("depth", "pressure")
"""Quantities that say where the values of the others are; coordinates may hold them."""

_GROUPS = ("profile", "cast", "station", "profile_id", "cast_id", "station_id", "cast_number")
_LATITUDES = ("latitude", "lat", "latitude_deg", "lat_deg")
_LONGITUDES = ("longitude", "lon", "long", "longitude_deg", "lon_deg")
"""Headers of columns of a table that tell its casts apart."""
_SAME_PLACE_DEG = 0.02  # within which a ship drifts during a cast


@dataclass(frozen=True, kw_only=True)
class CastColumns:
    """Quantities of a cast by the keys of `COLUMNS`, and what they were read from."""

    values: dict[str, Floats]  # shapes (n,), from the file's first depth on
    names: tuple[str, ...]  # of the variables or columns of the file
    place: str  # which of several columns of water it is, in words; "": the only one


@dataclass(frozen=True, kw_only=True)
class _Places:
    """Where the columns of water of a file are; shapes (c,), NaN where the file does not say."""

    latitude: Floats  # [°]
    longitude: Floats  # [°]

    @property
    def are_known(self) -> bool:
        return bool(np.isfinite(self.latitude).any() and np.isfinite(self.longitude).any())

    def distances(self, origin: FieldOrigin) -> Floats:
        """Distances from the origin [m], shape (c,); infinite where a place is not known."""
        degree = metres_per_degree(origin.latitude_deg)
        east = (self.longitude - origin.longitude_deg + 180.0) % 360.0 - 180.0
        north = self.latitude - origin.latitude_deg
        distance = np.hypot(degree.east * east, degree.north * north)
        return np.where(np.isfinite(distance), distance, np.inf)

    def words(self, column: int, origin: FieldOrigin, *, is_nearest: bool) -> str:
        """Which column was taken."""
        count = self.latitude.size
        text = f"cast {column + 1} of {count}"
        if not self.are_known:
            return text
        distance = float(self.distances(origin)[column])
        if math.isfinite(distance):
            text += f", {distance / 1e3:.3g} km from the origin"
        return text + (", the nearest with values" if is_nearest else "")


def read_columns(source: Source, origin: FieldOrigin, profile: int | None) -> CastColumns:
    """The quantities of one cast of a file; FieldError if it has none.

    `profile` is the number of the cast in the file, from 1 on; None: the nearest to the origin.
    """
    if source.file.suffix.lower() in (".csv", ".txt", ".tsv"):
        return _columns_of_table(source, origin, profile)
    return _columns_of_dataset(source, origin, profile)


def _chosen(
    source: Source, places: _Places, origin: FieldOrigin, profile: int | None, has_values: Any
) -> int:
    """The column of water to take; `has_values(column)` tells whether there is anything in it."""
    count = places.latitude.size
    if profile is not None:
        if profile > count:
            raise source.error(
                f"profile = {profile}; it has {count} cast{'s' if count > 1 else ''}"
            )
        return profile - 1
    if count == 1:
        return 0
    if not places.are_known:
        raise source.error(
            f"it has {count} casts, and does not say where they were taken; choose one with "
            f"profile = 1 … {count}"
        )
    nearest = np.argsort(places.distances(origin), kind="stable")[:_MAX_TRIALS].tolist()
    for column in nearest:
        if has_values(column):
            return int(column)
    raise source.error("none of its rows has all numbers that are needed")


def _scaled(source: Source, name: str, values: Floats, column: CastColumn, units: str) -> Floats:
    if units not in column.units:
        expected = ", ".join(unit for unit in list(column.units)[1:4])
        raise source.error(f"{name} has units {units!r}; expected {expected}")
    factor, offset = column.units[units]
    return factor * values + offset


def _place(
    places: _Places, column: int, origin: FieldOrigin, profile: int | None, moment: str = ""
) -> str:
    """Which of several columns of water, and times, was taken."""
    count = places.latitude.size
    words = [places.words(column, origin, is_nearest=profile is None)] if count > 1 else []
    return ", ".join([*words, moment] if moment else words)


def _plain_header(header: str) -> str:
    """Name of a column without its unit, in lower case."""
    text = header.strip().lower().replace("(", "[")
    return text.partition("[")[0].strip().replace(" ", "_")


def _column_of(header: str) -> tuple[str, str] | None:
    """The quantity and unit of a header, as `temperature_degC`, `Temperature [°C]` or `temp`."""
    text = header.strip().lower().replace("(", "[").rstrip(")]").strip()
    _, bracket, units = (piece.strip() for piece in text.partition("["))
    name = _plain_header(header)
    for key, column in COLUMNS.items():
        for quantity_name in (*column.quantity.standard_names, *column.quantity.names):
            if name == quantity_name:
                return key, units if bracket else ""
            suffix = name.removeprefix(f"{quantity_name}_")
            if not bracket and suffix != name and suffix in column.units:
                return key, suffix
    return None


class _Row(NamedTuple):
    """A row of a table."""

    number: int  # in the file, from its header on
    cells: list[str]


def _rows(source: Source) -> tuple[list[str], list[_Row]]:
    """Header and rows of a table."""
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
    header, *rows = csv.reader(lines, delimiter=separator)
    return header, [_Row(number, cells) for number, cells in enumerate(rows, start=2)]


def _number(source: Source, row: _Row, index: int) -> float:
    text = row.cells[index].strip() if index < len(row.cells) else ""
    if not text:
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise source.error(
            f"row {row.number} has {text!r:.40} in column {index + 1}; expected a number"
        ) from None


def _header_index(header: list[str], names: tuple[str, ...]) -> int | None:
    plain_header = [_plain_header(text) for text in header]
    return next((plain_header.index(name) for name in names if name in plain_header), None)


def _casts_of_table(
    source: Source, header: list[str], rows: list[_Row]
) -> tuple[list[list[_Row]], _Places]:
    """Rows of each cast of a table, in the order of the file, and their places."""
    group = _header_index(header, _GROUPS)
    indices = [_header_index(header, names) for names in (_LATITUDES, _LONGITUDES)]

    def place_of(row: _Row) -> tuple[float, ...]:
        return tuple(math.nan if i is None else _number(source, row, i) for i in indices)

    casts: list[list[_Row]] = []
    if group is not None:
        by_name: dict[str, list[_Row]] = {}
        for row in rows:
            by_name.setdefault(row.cells[group] if group < len(row.cells) else "", []).append(row)
        casts = list(by_name.values())
    else:
        first: tuple[float, ...] = ()
        for row in rows:
            position = place_of(row)
            has_moved = [
                abs(a - b) > _SAME_PLACE_DEG for a, b in zip(position, first, strict=False)
            ]
            if not casts or any(has_moved):
                casts.append([])
                first = position
            casts[-1].append(row)
    places = np.array([place_of(cast[0]) for cast in casts])
    return casts, _Places(latitude=places[:, 0], longitude=places[:, 1])


def _columns_of_table(source: Source, origin: FieldOrigin, profile: int | None) -> CastColumns:
    header, rows = _rows(source)
    casts, places = _casts_of_table(source, header, rows)
    column = _chosen(source, places, origin, profile, lambda _: True)
    values: dict[str, Floats] = {}
    names = []
    for index, text in enumerate(header):
        quantity = _column_of(text)
        if quantity is None or quantity[0] in values:
            continue
        key, units = quantity
        numbers = np.array([_number(source, row, index) for row in casts[column]])
        values[key] = _scaled(source, f"column {text!r}", numbers, COLUMNS[key], units)
        names.append(text.strip())
    if not values:
        expected = "'depth', 'temperature', 'salinity', or 'depth', 'sound_speed'"
        raise source.error(
            f"its header {','.join(header)!r:.80} has none of the columns {expected}"
        )
    place = _place(places, column, origin, profile)
    return CastColumns(values=values, names=tuple(names), place=place)


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """How the variables of a file hold columns of water."""

    across: tuple[str, ...]  # dimensions over which columns are counted
    sizes: tuple[int, ...]  # of these
    fixed: dict[str, int]  # indices along further dimensions, as time
    places: _Places
    moment: str  # which of several times is taken, in words; "": there is one

    def values(self, source: Source, variable: "DataArray", column: int) -> Floats:
        """A variable along its one axis of depth in a column."""
        index = np.unravel_index(column, self.sizes) if self.across else ()
        indices = self.fixed | dict(zip(self.across, map(int, index), strict=True))
        cut = variable.isel({d: i for d, i in indices.items() if d in variable.dims})
        if cut.ndim > 1:
            raise source.error(
                f"{variable.name} has axes {', '.join(map(str, cut.dims))}; expected depth alone, "
                "beside longitude, latitude, time and the number of the cast"
            )
        return np.atleast_1d(np.asarray(cut.values, dtype=np.float64))


def _coordinates_along(dataset: "Dataset", dimension: str, kind: str) -> Floats | None:
    """Longitudes (X) or latitudes (Y) of the points of a dimension; None: there are none."""
    for name in dataset.variables:
        variable = dataset[name]
        if variable.dims == (dimension,) and axis_kind(variable) == kind:
            return np.asarray(variable.values, dtype=np.float64)
    return None


def _kinds(dataset: "Dataset", variable: "DataArray") -> dict[str, str]:
    """X, Y, Z or T of each dimension of a variable; P: along which there are casts."""
    kinds = {}
    for dimension in map(str, variable.dims):
        kind = axis_kind(dataset[dimension]) if dimension in dataset.coords else ""
        is_projected = all(
            _coordinates_along(dataset, dimension, axis) is not None for axis in "XY"
        )
        kinds[dimension] = "P" if is_projected and kind not in tuple("XYZ") else kind
    unknown = [dimension for dimension, kind in kinds.items() if kind == ""]
    if "Z" not in kinds.values() and unknown:
        # levels stand last
        kinds[unknown.pop()] = "Z"
    kinds |= dict.fromkeys(unknown, "P")
    return kinds


def _places(dataset: "Dataset", kinds: dict[str, str], across: tuple[str, ...]) -> _Places:
    sizes = tuple(dataset.sizes[dimension] for dimension in across)
    missing = np.full(sizes, np.nan)
    latitude = longitude = missing
    for axis, dimension in enumerate(across):
        shape = [1] * len(sizes)
        shape[axis] = -1
        north = _coordinates_along(dataset, dimension, "Y")
        east = _coordinates_along(dataset, dimension, "X")
        if kinds[dimension] in "YP" and north is not None:
            latitude = np.broadcast_to(north.reshape(shape), sizes)
        if kinds[dimension] in "XP" and east is not None:
            longitude = np.broadcast_to(east.reshape(shape), sizes)
    return _Places(latitude=latitude.ravel(), longitude=longitude.ravel())


def _layout(
    source: Source, dataset: "Dataset", variable: "DataArray", origin: FieldOrigin
) -> _Layout:
    kinds = _kinds(dataset, variable)
    across = tuple(dimension for dimension, kind in kinds.items() if kind in "XYP")
    fixed = {}
    moment = ""
    for dimension, kind in kinds.items():
        if kind != "T":
            continue
        count = dataset.sizes[dimension]
        fixed[dimension] = _nearest_time(source, dataset[dimension], origin)
        if count > 1:
            moment = f"time {fixed[dimension] + 1} of {count}"
    sizes = tuple(dataset.sizes[dimension] for dimension in across)
    places = _places(dataset, kinds, across)
    return _Layout(across=across, sizes=sizes, fixed=fixed, places=places, moment=moment)


def _nearest_time(source: Source, axis: "DataArray", origin: FieldOrigin) -> int:
    """Index of the time nearest to the start of the mission; 0 if the axis does not tell, as one of
    the months of a climatology.
    """
    try:
        seconds = seconds_from_start(source, axis, origin)
    except FieldError:
        return 0
    finite = np.where(np.isfinite(seconds), np.abs(seconds), np.inf)
    return int(np.argmin(finite))


def _columns_of_dataset(source: Source, origin: FieldOrigin, profile: int | None) -> CastColumns:
    with open_dataset(source) as dataset:
        variables = {}
        for key, declared in COLUMNS.items():
            variable = find(dataset, declared.quantity, coordinates=key in _LEVELS)
            if variable is not None:
                variables[key] = variable
        measured = [variable for key, variable in variables.items() if key not in _LEVELS]
        if not measured:
            raise source.error(
                "it has no temperature, salinity or speed of sound by their usual names"
            )
        fullest = max(measured, key=lambda variable: variable.ndim)
        layout = _layout(source, dataset, fullest, origin)

        def has_values(column: int) -> bool:
            return bool(np.isfinite(layout.values(source, fullest, column)).any())

        column = _chosen(source, layout.places, origin, profile, has_values)
        values = {}
        for key, variable in variables.items():
            numbers = layout.values(source, variable, column)
            units = units_of(variable)
            values[key] = _scaled(source, str(variable.name), numbers, COLUMNS[key], units)
            if key == "depth" and str(variable.attrs.get("positive", "")).lower() == "up":
                values[key] = -values[key]
    names = tuple(str(variable.name) for variable in variables.values())
    if len({numbers.size for numbers in values.values()}) > 1:
        raise source.error(f"its variables {', '.join(names)} have different numbers of depths")
    return CastColumns(
        values=values,
        names=names,
        place=_place(layout.places, column, origin, profile, layout.moment),
    )

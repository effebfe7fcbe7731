"""Values of casts out of tables and NetCDF files, in the units of TEOS-10.

A file may hold many columns of water: a grid of longitude and latitude, a list of profiles with
places of their own (as those of Argo floats), or rows of a table that name their cast or place. One
is taken: that of a number, or the nearest to the origin that has values.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.attitude import metres_per_degree
from sim.water.field_files import (
    METRES_PER_SECOND,
    FieldError,
    FieldOrigin,
    Source,
    VariableNames,
    axis_kind,
    downward,
    find_variable,
    open_dataset,
    other_quantities,
    places_of_points,
    seconds_from_start,
    units_of,
    valid_values,
)

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

_LARGEST_BYTES = 50_000_000  # of a table
_MAX_TRIALS = 400  # casts nearest to the origin that are searched for values


class CastQuantity(NamedTuple):
    """A quantity of a cast, and what its units are multiplied by, and added, to have those of
    TEOS-10.
    """

    variable_names: VariableNames
    units: dict[str, tuple[float, float]]  # factor and offset; "" if none is given


# the spellings of UDUNITS, by which CF states units, and those with a space
_CELSIUS = (
    *("degc", "deg_c", "celsius", "degree_celsius", "degrees_celsius", "degree_c", "degrees_c"),
    *("degree celsius", "degrees celsius", "degree c", "degrees c", "deg c", "°c", "c"),
)
_KELVIN = (
    *("k", "kelvin", "kelvins", "degree_kelvin", "degrees_kelvin"),
    *("degree_k", "degrees_k", "deg_k", "degk"),
)
_TEMPERATURE_UNITS = dict.fromkeys(("", *_CELSIUS), (1.0, 0.0)) | dict.fromkeys(
    _KELVIN, (1.0, -273.15)
)
_SALINITY_UNITS = dict.fromkeys(
    ("", "1", "psu", "1e-3", "0.001", "g/kg", "g kg-1", "pss-78", "ppt", "‰", "pss"), (1.0, 0.0)
) | {"kg/kg": (1000.0, 0.0), "kg kg-1": (1000.0, 0.0)}
_DEPTH_UNITS = dict.fromkeys(("", "m", "meter", "metre", "meters", "metres"), (1.0, 0.0))
_PRESSURE_UNITS = dict.fromkeys(("", "dbar", "decibar", "db"), (1.0, 0.0)) | {
    "pa": (1e-4, 0.0),
    "kpa": (0.1, 0.0),
    "bar": (10.0, 0.0),
    "mbar": (0.01, 0.0),
    "hpa": (0.01, 0.0),
}
_DENSITY_UNITS = dict.fromkeys(
    ("", "kg/m3", "kg/m³", "kg/m^3", "kg m-3", "kg m^-3", "kg m**-3"), (1.0, 0.0)
) | {"g/cm3": (1000.0, 0.0), "g cm-3": (1000.0, 0.0)}
_SPEED_UNITS = dict.fromkeys(
    ("", "m/s", "m s-1", "meter/second", "m_s", *METRES_PER_SECOND), (1.0, 0.0)
)

CAST_QUANTITIES = {
    "speed": CastQuantity(
        VariableNames(
            "speed of sound",
            ("speed_of_sound_in_sea_water",),
            ("sound_speed", "soundspeed", "speed_of_sound", "svel", "sv", "sound_velocity", "c"),
            r".*(sound|acoustic)",
        ),
        _SPEED_UNITS,
    ),
    "conservative": CastQuantity(
        VariableNames(
            "conservative temperature",
            ("sea_water_conservative_temperature",),
            ("conservative_temperature", "ct"),
            r".*conservative_temperature",
        ),
        _TEMPERATURE_UNITS,
    ),
    "potential": CastQuantity(
        VariableNames(
            "potential temperature",
            ("sea_water_potential_temperature",),
            ("potential_temperature", "thetao", "votemper", "water_temp", "pt", "theta"),
            r".*potential_temperature",
        ),
        _TEMPERATURE_UNITS,
    ),
    "temperature": CastQuantity(
        VariableNames(
            "temperature",
            ("sea_water_temperature",),
            ("temperature", "temp", "t", "tem", "t90"),
            r"(?!.*(air|potential|conservative|wet_bulb|dew)).*temperature",
        ),
        _TEMPERATURE_UNITS,
    ),
    "absolute": CastQuantity(
        VariableNames(
            "absolute salinity",
            ("sea_water_absolute_salinity",),
            ("absolute_salinity", "sa"),
            r".*absolute_salinity",
        ),
        _SALINITY_UNITS,
    ),
    "salinity": CastQuantity(
        VariableNames(
            "salinity",
            ("sea_water_practical_salinity", "sea_water_salinity"),
            ("practical_salinity", "salinity", "sal", "psal", "so", "vosaline", "s", "sp"),
            r"(?!.*(absolute|preformed|reference)).*salinity",
        ),
        _SALINITY_UNITS,
    ),
    "density": CastQuantity(
        VariableNames(
            "density",
            ("sea_water_density",),
            ("density", "rho", "insitu_density"),
            r"(?!.*(potential|air|anomaly)).*density",
        ),
        _DENSITY_UNITS,
    ),
    "pressure": CastQuantity(
        VariableNames(
            "pressure",
            ("sea_water_pressure",),
            ("pressure", "pres", "press", "p"),
            r"(?!.*(air|atmosph|surface|partial)).*pressure",
        ),
        _PRESSURE_UNITS,
    ),
    "depth": CastQuantity(
        VariableNames(
            "depth",
            ("depth",),
            ("depth", "z", "lev", "level", "deptht"),
            r"(?!.*(floor|bottom|mixed)).*(depth|height|altitude)",
        ),
        _DEPTH_UNITS,
    ),
}
_LEVELS = ("depth", "pressure")
"""Quantities that say where the values of the others are; coordinates may hold them."""

_CAST_HEADERS = ("profile", "cast", "station", "profile_id", "cast_id", "station_id", "cast_number")
_LATITUDES = ("latitude", "lat", "latitude_deg", "lat_deg")
_LONGITUDES = ("longitude", "lon", "long", "longitude_deg", "lon_deg")
"""Headers of columns of a table that tell its casts apart."""
_SAME_PLACE_DEG = 0.02  # within which a ship drifts during a cast


@dataclass(frozen=True, kw_only=True)
class CastValues:
    """Quantities of a cast by the keys of `CAST_QUANTITIES`, and what they were read from."""

    values: dict[str, Floats]  # shapes (n,), from the file's first depth on
    names: tuple[str, ...]  # of the variables or columns of the file
    place: str  # which of several columns of water it is, in words; "": the only one
    remarks: tuple[str, ...]  # on what the file does not say, or contradicts


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

    def words(self, cast_index: int, origin: FieldOrigin, *, is_nearest: bool) -> str:
        """Which cast was taken."""
        count = self.latitude.size
        text = f"cast {cast_index + 1} of {count}"
        if not self.are_known:
            return text
        distance = float(self.distances(origin)[cast_index])
        if math.isfinite(distance):
            text += f", {distance / 1e3:.3g} km from the origin"
        return text + (", the nearest with values" if is_nearest else "")


def read_cast_values(source: Source, origin: FieldOrigin, profile: int | None) -> CastValues:
    """The quantities of one cast of a file; FieldError if it has none.

    `profile` is the number of the cast in the file, from 1 on; None: the nearest to the origin.
    """
    if source.file.suffix.lower() in (".csv", ".txt", ".tsv"):
        return _values_of_table(source, origin, profile)
    return _values_of_dataset(source, origin, profile)


def _chosen(
    source: Source,
    places: _Places,
    origin: FieldOrigin,
    profile: int | None,
    has_values: Callable[[int], bool],
) -> int:
    """Index of the cast to take; `has_values(index)` tells whether there is anything in one."""
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
    for cast_index in nearest:
        if has_values(cast_index):
            return int(cast_index)
    raise source.error(f"none of the {len(nearest)} casts nearest to the origin has values")


# units that are taken where a file states none; salinities need none
_USUAL_UNITS = {
    **dict.fromkeys(("conservative", "potential", "temperature"), "°C"),
    "speed": "m/s",
    "density": "kg/m³",
    "pressure": "dbar",
    "depth": "m",
}


def _without_units(key: str, name: str, units: str) -> list[str]:
    """A remark on a quantity whose units are not stated."""
    usual = _USUAL_UNITS.get(key)
    return [f"{name} without units, taken as {usual}"] if usual and not units else []


def _scaled(
    source: Source, name: str, values: Floats, quantity: CastQuantity, units: str
) -> Floats:
    if units not in quantity.units:
        expected = ", ".join([unit for unit in quantity.units if unit][:3])
        raise source.error(f"{name} has units {units!r}; expected {expected}")
    factor, offset = quantity.units[units]
    return factor * values + offset


def _place_words(
    places: _Places, cast_index: int, origin: FieldOrigin, profile: int | None, moment: str = ""
) -> str:
    """Which of several columns of water, and times, was taken."""
    words = []
    if places.latitude.size > 1:
        words.append(places.words(cast_index, origin, is_nearest=profile is None))
    if moment:
        words.append(moment)
    return ", ".join(words)


def _plain_header(header: str) -> str:
    """Name of a column without its unit, in lower case."""
    text = header.strip().lower().replace("(", "[")
    return text.partition("[")[0].strip().replace(" ", "_")


def _quantity_of(header: str) -> tuple[str, str] | None:
    """The quantity's key and the unit of a header, as `temperature_degC`, `Temperature [°C]` or
    `temp`.
    """
    text = header.strip().lower().replace("(", "[").rstrip(")]").strip()
    _, bracket, units = (piece.strip() for piece in text.partition("["))
    name = _plain_header(header)
    for key, quantity in CAST_QUANTITIES.items():
        for usual_name in (*quantity.variable_names.standard_names, *quantity.variable_names.names):
            if name == usual_name:
                return key, units if bracket else ""
            prefix = f"{usual_name}_"
            suffix = name.removeprefix(prefix)
            if not bracket and name.startswith(prefix) and suffix in quantity.units:
                return key, suffix
    return None


class _Row(NamedTuple):
    """A row of a table."""

    number: int  # of the lines that are neither blank nor comments; the header is 1
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
    try:
        header, *rows = csv.reader(lines, delimiter=separator)
    except csv.Error as error:
        raise source.error(f"it is no table: {error}") from None
    if not rows:
        raise source.error("it has no rows below its header, in which a quote is open")
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
    cast_column = _header_index(header, _CAST_HEADERS)
    indices = [_header_index(header, names) for names in (_LATITUDES, _LONGITUDES)]

    def place_of(row: _Row) -> tuple[float, ...]:
        return tuple(math.nan if i is None else _number(source, row, i) for i in indices)

    casts: list[list[_Row]] = []
    if cast_column is not None:
        by_name: dict[str, list[_Row]] = {}
        for row in rows:
            name = row.cells[cast_column] if cast_column < len(row.cells) else ""
            by_name.setdefault(name, []).append(row)
        casts = list(by_name.values())
    else:
        cast_place = place_of(rows[0])
        for row in rows:
            place = place_of(row)
            has_moved = [
                abs(a - b) > _SAME_PLACE_DEG for a, b in zip(place, cast_place, strict=True)
            ]
            if not casts or any(has_moved):
                casts.append([])
                cast_place = place
            casts[-1].append(row)
    places = np.array([place_of(cast[0]) for cast in casts])
    return casts, _Places(latitude=places[:, 0], longitude=places[:, 1])


def _values_of_table(source: Source, origin: FieldOrigin, profile: int | None) -> CastValues:
    header, rows = _rows(source)
    casts, places = _casts_of_table(source, header, rows)
    cast_index = _chosen(source, places, origin, profile, lambda _: True)
    values: dict[str, Floats] = {}
    names = []
    remarks = list[str]()
    for index, text in enumerate(header):
        key_and_unit = _quantity_of(text)
        if key_and_unit is None or key_and_unit[0] in values:
            continue
        key, units = key_and_unit
        numbers = np.array([_number(source, row, index) for row in casts[cast_index]])
        values[key] = _scaled(source, f"column {text!r}", numbers, CAST_QUANTITIES[key], units)
        names.append(text.strip())
        remarks += _without_units(key, text.strip(), units)
    if not values:
        expected = "'depth', 'temperature', 'salinity', or 'depth', 'sound_speed'"
        raise source.error(
            f"its header {','.join(header)!r:.80} has none of the columns {expected}"
        )
    place = _place_words(places, cast_index, origin, profile)
    return CastValues(values=values, names=tuple(names), place=place, remarks=tuple(remarks))


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """How the variables of a file hold columns of water."""

    cast_dimensions: tuple[str, ...]  # dimensions over which casts are counted
    sizes: tuple[int, ...]  # of these
    fixed: dict[str, int]  # indices along further dimensions, as time
    places: _Places
    moment: str  # which of several times is taken, in words; "": there is one

    def values(self, source: Source, variable: "DataArray", cast_index: int) -> Floats:
        """A variable along its one axis of depth in a cast."""
        index = np.unravel_index(cast_index, self.sizes) if self.cast_dimensions else ()
        indices = self.fixed | dict(zip(self.cast_dimensions, map(int, index), strict=True))
        cut = variable.isel({d: i for d, i in indices.items() if d in variable.dims})
        if cut.ndim > 1:
            raise source.error(
                f"{variable.name} has axes {', '.join(map(str, cut.dims))}; expected depth alone, "
                "beside longitude, latitude, time and the number of the cast"
            )
        return np.atleast_1d(np.asarray(cut.values, dtype=np.float64))


def _kinds(dataset: "Dataset", variable: "DataArray") -> dict[str, str]:
    """X, Y, Z or T of each dimension of a variable; P: along which there are casts."""
    kinds = {}
    for dimension in map(str, variable.dims):
        kind = axis_kind(dataset[dimension]) if dimension in dataset.coords else ""
        # each point along the dimension has its own longitude and latitude
        has_places = all(places_of_points(dataset, axis, [dimension]) is not None for axis in "XY")
        kinds[dimension] = "P" if has_places and kind not in ("X", "Y", "Z") else kind
    unknown = [dimension for dimension, kind in kinds.items() if kind == ""]
    if "Z" not in kinds.values() and unknown:
        # levels stand last
        kinds[unknown.pop()] = "Z"
    kinds |= dict.fromkeys(unknown, "P")
    return kinds


def _places(dataset: "Dataset", cast_dimensions: tuple[str, ...]) -> _Places:
    """Where casts are, by coordinates of one dimension or, of a curvilinear grid, of two."""
    sizes = tuple(dataset.sizes[dimension] for dimension in cast_dimensions)
    degrees = []
    for kind in "YX":
        places = places_of_points(dataset, kind, cast_dimensions)
        if places is None:
            degrees.append(np.full(sizes, np.nan))
            continue
        along = [dimension for dimension in cast_dimensions if dimension in places.dims]
        shape = [sizes[i] if d in along else 1 for i, d in enumerate(cast_dimensions)]
        values = np.asarray(places.transpose(*along).values, dtype=np.float64)
        degrees.append(np.broadcast_to(values.reshape(shape), sizes))
    latitude, longitude = degrees
    return _Places(latitude=latitude.ravel(), longitude=longitude.ravel())


def _layout(
    source: Source, dataset: "Dataset", variable: "DataArray", origin: FieldOrigin
) -> _Layout:
    kinds = _kinds(dataset, variable)
    cast_dimensions = tuple(dimension for dimension, kind in kinds.items() if kind in "XYP")
    fixed = {}
    moment = ""
    for dimension, kind in kinds.items():
        if kind != "T":
            continue
        count = dataset.sizes[dimension]
        fixed[dimension] = _nearest_time(source, dataset[dimension], origin)
        if count > 1:
            moment = f"time {fixed[dimension] + 1} of {count}"
    sizes = tuple(dataset.sizes[dimension] for dimension in cast_dimensions)
    places = _places(dataset, cast_dimensions)
    return _Layout(
        cast_dimensions=cast_dimensions, sizes=sizes, fixed=fixed, places=places, moment=moment
    )


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


def _values_of_dataset(source: Source, origin: FieldOrigin, profile: int | None) -> CastValues:
    with open_dataset(source) as dataset:
        variables = {}
        for key, quantity in CAST_QUANTITIES.items():
            variable = find_variable(dataset, quantity.variable_names, coordinates=key in _LEVELS)
            if variable is not None:
                variables[key] = variable
        measured = [variable for key, variable in variables.items() if key not in _LEVELS]
        if not measured:
            raise source.error(
                "it has no temperature, salinity or speed of sound by their usual names"
                + other_quantities(dataset, [q.variable_names for q in CAST_QUANTITIES.values()])
            )
        most_dimensional = max(measured, key=lambda variable: variable.ndim)
        layout = _layout(source, dataset, most_dimensional, origin)

        def has_values(cast_index: int) -> bool:
            values = layout.values(source, most_dimensional, cast_index)
            return bool(np.isfinite(valid_values(source, most_dimensional, values, [])).any())

        cast_index = _chosen(source, layout.places, origin, profile, has_values)
        values = {}
        taken = [str(variable.name) for variable in variables.values()]
        left = dataset.drop_vars(taken)
        not_taken = other_quantities(left, [q.variable_names for q in CAST_QUANTITIES.values()])
        remarks = [f"not taken: {not_taken.removeprefix('; ')}"] if not_taken else []
        for key, variable in variables.items():
            numbers = layout.values(source, variable, cast_index)
            numbers = valid_values(source, variable, numbers, remarks)
            units = units_of(variable)
            values[key] = _scaled(source, str(variable.name), numbers, CAST_QUANTITIES[key], units)
            remarks += _without_units(key, str(variable.name), units)
            if key == "depth":
                values[key] = downward(source, variable, values[key], remarks)
    names = tuple(str(variable.name) for variable in variables.values())
    if len({numbers.size for numbers in values.values()}) > 1:
        raise source.error(f"its variables {', '.join(names)} have different numbers of depths")
    return CastValues(
        values=values,
        names=names,
        place=_place_words(layout.places, cast_index, origin, profile, layout.moment),
        remarks=tuple(remarks),
    )

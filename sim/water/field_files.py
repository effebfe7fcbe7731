"""Fields of the sea out of NetCDF files: currents and floors.

Variables are found by their CF `standard_name`, then by the names of CMEMS and NEMO, HYCOM, GEBCO
and plain ones, unless their `standard_name` is that of another quantity. Values outside of their
`valid_min`, `valid_max` or `valid_range` are missing ones. Places in degrees are projected about
the mission's origin as `geodetic` of `sim.attitude` does; places in metres are about the origin as
they are. Only the part of a file that a mission may need is read. The packages are those of the
extra `fields`.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.errors import LaisnError
from sim.attitude import metres_per_degree
from sim.system import file_digest
from sim.water.grids import CurrentGrid, GriddedCurrent, GriddedFloor
from sim.water.region import Region

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

_MAX_BYTES = 1_000_000_000  # of what is read of a file
_LENGTH_UNITS = {"m": 1.0, "meter": 1.0, "metre": 1.0, "meters": 1.0, "metres": 1.0, "km": 1000.0}
_EAST_UNITS = ("degrees_east", "degree_east", "degrees_e", "degreee", "degree_e")
_NORTH_UNITS = ("degrees_north", "degree_north", "degrees_n", "degreen", "degree_n")
_PLAIN_DEGREES = ("degree", "degrees", "deg")
METRES_PER_SECOND = (
    *("m/s", "m s-1", "m s^-1", "m.s-1", "m s**-1", "ms-1", "m/sec"),
    *("meter/second", "meters/second", "metre/second", "metres/second"),
    *("meter second-1", "metre second-1"),
)
_SPEED_UNITS = {
    **dict.fromkeys(METRES_PER_SECOND, 1.0),
    **dict.fromkeys(("cm/s", "cm s-1", "cm s^-1", "centimeter/second"), 0.01),
}
_TIME_UNITS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, "minutes": 60.0}
_TIME_UNITS |= {"h": 3600.0, "hour": 3600.0, "hours": 3600.0, "d": 86400.0, "day": 86400.0}
_TIME_UNITS |= {"days": 86400.0}
# xarray writes times that lie less than a second apart in these
_TIME_UNITS |= {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
_FLOOR_FOLLOWING = re.compile(r"ocean_(s|sigma|sigma_z|double_sigma)_coordinate")
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
# floating-point numbers that a program did not write have 9.96921e36, and are missing (NetCDF)
_FILLED = 9.9e36
_VALID_TOLERANCE = 1e-6  # of a bound of valid values, which may be rounded
_SAME_MERIDIAN_DEG = 1e-6  # rounding of longitudes

_DATE_PARTS = ("year", "month", "day", "hour", "minute")
_DATE = re.compile(
    r"(?P<year>\d{1,4})-(?P<month>\d{1,2})-(?P<day>\d{1,2})"
    r"([ t](?P<hour>\d{1,2})(:(?P<minute>\d{1,2})(:(?P<second>\d{1,2}(\.\d*)?))?)?)?"
    r" *(z|utc|gmt|(?P<sign>[+-])(?P<zone_h>\d{1,2}):?(?P<zone_min>\d{2})?)?"
)


class FieldError(LaisnError):
    """A file that cannot be used; the text names key, file, variable and expectation."""


class FieldOrigin(NamedTuple):
    """The place of (0, 0), and the time 0."""

    latitude_deg: float
    longitude_deg: float
    time: str  # ISO 8601


class VariableNames(NamedTuple):
    """What a variable may be called."""

    title: str  # in messages
    standard_names: tuple[str, ...]  # of CF
    names: tuple[str, ...]  # names of variables, in lower case
    standard_pattern: str  # that a `standard_name` of a variable of such a name matches

    def may_be(self, variable: "DataArray") -> bool:
        """Whether the `standard_name` of a variable is none, or not that of another quantity."""
        standard = standard_name_of(variable)
        return not standard or re.match(self.standard_pattern, standard) is not None


EASTWARD = VariableNames(
    "eastward velocity",
    (
        "eastward_sea_water_velocity",
        "sea_water_x_velocity",
        "surface_eastward_sea_water_velocity",
        "barotropic_eastward_sea_water_velocity",
    ),
    ("uo", "water_u", "u", "vozocrtx", "utotal", "ucur", "u_east"),
    r"(?!.*(northward|y_velocity|upward)).*(sea_water.*velocity|current)",
)
NORTHWARD = VariableNames(
    "northward velocity",
    (
        "northward_sea_water_velocity",
        "sea_water_y_velocity",
        "surface_northward_sea_water_velocity",
        "barotropic_northward_sea_water_velocity",
    ),
    ("vo", "water_v", "v", "vomecrty", "vtotal", "vcur", "v_north"),
    r"(?!.*(eastward|x_velocity|upward)).*(sea_water.*velocity|current)",
)
UPWARD = VariableNames(
    "upward velocity",
    ("upward_sea_water_velocity",),
    ("wo", "water_w", "w", "vovecrtz"),
    r".*(upward|vertical).*sea_water.*velocity",
)
FLOOR_LEVEL = VariableNames(
    "elevation or depth of the floor",
    (
        "sea_floor_depth_below_geoid",
        "sea_floor_depth_below_sea_level",
        "sea_floor_depth_below_sea_surface",
        "sea_floor_depth_below_mean_sea_level",
        "sea_floor_depth",
        "height_above_mean_sea_level",
        "height_above_reference_ellipsoid",
        "surface_altitude",
        "altitude",
    ),
    ("elevation", "depth", "deptho", "bathymetry", "topo", "z", "band1", "h", "mbathy"),
    r"(?!.*(sea_surface_height|wave|thickness|mixed|level_number|air|cloud)).*"
    r"(depth|bathymetry|altitude|height|elevation|topography)",
)


_LONGITUDES = ("lon", "longitude", "nav_lon")
_LATITUDES = ("lat", "latitude", "nav_lat")


class _AxisNames(NamedTuple):
    """What an axis may be called."""

    title: str  # in messages
    standard_names: tuple[str, ...]  # of CF
    names: tuple[str, ...]  # in lower case


_AXES = {
    "X": _AxisNames(
        "longitude or east",
        ("longitude", "projection_x_coordinate"),
        (*_LONGITUDES, "x", "east", "easting"),
    ),
    "Y": _AxisNames(
        "latitude or north",
        ("latitude", "projection_y_coordinate"),
        (*_LATITUDES, "y", "north", "northing"),
    ),
    "Z": _AxisNames(
        "depth",
        ("depth", "height", "altitude"),
        ("depth", "deptht", "depthu", "depthv", "lev", "level", "z", "height"),
    ),
    "T": _AxisNames("time", ("time",), ("time", "time_counter", "ocean_time", "t")),
}


class Source(NamedTuple):
    """A file, and the key that names it."""

    key: str  # of the settings
    file: Path

    def error(self, problem: str) -> FieldError:
        """The error of a problem of this file."""
        return FieldError(f"{self.key}: {self.file}: {problem}")

    def require_content(self, sha256: str | None) -> None:
        """FieldError if the file is there and its SHA-256 is not this one."""
        digest = file_digest(self.file)
        if digest is not None and sha256 is not None and digest != sha256:
            raise self.error(
                f"its content is not that with which the scenario was saved (sha256 {sha256[:12]}…)"
            )


@dataclass(frozen=True, kw_only=True)
class CurrentField:
    """A current that was read."""

    current: GriddedCurrent
    # what the kept grid covers: up to one point beyond what was asked for, less where the file ends
    region: Region
    land: Bools  # columns without water, shape (j, i)
    report: str  # what was read, in a line

    def on_land(self, position: Floats) -> Bools:
        """Whether the nearest points of the grid to places, shape (n, 2), [m], are land."""
        grid = self.current.grid
        i = _nearest(grid.east, position[:, 0])
        j = _nearest(grid.north, position[:, 1])
        return np.asarray(self.land[j, i])


@dataclass(frozen=True, kw_only=True)
class FloorField:
    """A floor that was read."""

    floor: GriddedFloor
    region: Region
    report: str


def _nearest(axis: Floats, values: Floats) -> Ints:
    if axis.size == 1:
        return np.zeros(values.shape, dtype=np.int64)
    middles = 0.5 * (axis[1:] + axis[:-1])
    return np.searchsorted(middles, values)


def read_current(source: Source, origin: FieldOrigin, region: Region) -> CurrentField:
    """The part that a region needs of the current in a file, about an origin; FieldError if the
    file has no such field.
    """
    return _read_current(source, file_digest(source.file), origin, region)


def read_floor(source: Source, origin: FieldOrigin, region: Region) -> FloorField:
    """The part that a region needs of the floor in a file, about an origin; FieldError if the file
    has no such field.
    """
    return _read_floor(source, file_digest(source.file), origin, region)


def open_dataset(source: Source) -> Any:
    """The opened file, its times as numbers; FieldError if it is no NetCDF file."""
    try:
        with source.file.open("rb") as file:
            magic = file.read(8)
    except OSError as error:
        raise source.error(f"cannot be read: {error.strerror or error}") from None
    try:
        import xarray
    except ImportError:
        raise source.error(
            "reading fields needs packages that are not installed: pip install 'laisn-sim[fields]'"
        ) from None
    if magic.startswith(b"\x89HDF"):
        engine = "h5netcdf"
    elif magic[:4] in (b"CDF\x01", b"CDF\x02"):
        engine = "scipy"
    else:
        raise source.error("it is no NetCDF file (classic or NetCDF-4)")
    try:
        return xarray.open_dataset(
            source.file, engine=engine, decode_times=False, decode_timedelta=False
        )
    except Exception as error:
        # of many libraries; whatever it is, this file cannot be opened
        reason = str(error).partition("\n")[0]
        raise source.error(f"it cannot be opened as NetCDF: {reason:.200}") from error


def find_variable(dataset: "Dataset", quantity: VariableNames, *, coordinates: bool = False) -> Any:
    """The variable that is a quantity; None if there is none. `coordinates`: also among these."""
    names = [*dataset.data_vars, *(dataset.coords if coordinates else ())]
    variables = [dataset[name] for name in names]
    for standard_name in quantity.standard_names:
        for variable in variables:
            if standard_name_of(variable) == standard_name:
                return variable
    for usual_name in quantity.names:
        for variable in variables:
            if str(variable.name).lower() == usual_name and quantity.may_be(variable):
                return variable
    return None


def other_quantities(dataset: "Dataset", quantities: Sequence[VariableNames]) -> str:
    """Variables of the usual names of quantities whose `standard_name` is that of another one, as
    the end of a message; "" if there are none.
    """
    others = [
        f"{variable.name} has the standard_name {standard_name_of(variable)!r}"
        for variable in dataset.data_vars.values()
        for quantity in quantities
        if str(variable.name).lower() in quantity.names and not quantity.may_be(variable)
    ]
    return "; " + ", ".join(dict.fromkeys(others)) if others else ""


def _groups_left_out(source: Source) -> str:
    """Groups of a NetCDF-4 file, whose variables are not read, as the end of a message; "" if there
    are none.
    """
    import h5netcdf

    try:
        with h5netcdf.File(source.file) as file:
            groups = ", ".join(map(repr, file.groups))
    except OSError:
        # of the classic format, which has none
        return ""
    return f"; variables in groups are not read: {groups}" if groups else ""


def _require(source: Source, dataset: "Dataset", quantity: VariableNames) -> Any:
    variable = find_variable(dataset, quantity)
    if variable is not None:
        return variable
    expected = f"standard_name {quantity.standard_names[0]!r}, or the name "
    expected += " or ".join(repr(name) for name in quantity.names[:3])
    available = ", ".join(str(name) for name in dataset.data_vars) or "none"
    raise source.error(
        f"it has no {quantity.title}: expected {expected}; its variables: {available}"
        f"{other_quantities(dataset, [quantity])}{_groups_left_out(source)}"
    )


def axis_kind(coordinate: "DataArray") -> str:
    """X, Y, Z or T of a coordinate; "" if it is none of them."""
    units = units_of(coordinate)
    standard = standard_name_of(coordinate)
    for kind, quantity in _AXES.items():
        if standard in quantity.standard_names:
            return kind
    if units in _EAST_UNITS:
        return "X"
    if units in _NORTH_UNITS:
        return "Y"
    for kind, quantity in _AXES.items():
        if str(coordinate.name).lower() in quantity.names:
            return kind
    axis = str(coordinate.attrs.get("axis", "")).upper()
    if axis in _AXES:
        return axis
    return "T" if " since " in units else ""


def is_in_degrees(coordinate: "DataArray") -> bool:
    """Whether a coordinate is a longitude or latitude, and none of a rotated grid or an index."""
    standard = standard_name_of(coordinate)
    units = units_of(coordinate).replace(" ", "_")
    if standard in ("longitude", "latitude") or units in (*_EAST_UNITS, *_NORTH_UNITS):
        return True
    names_a_place = str(coordinate.name).lower() in (*_LONGITUDES, *_LATITUDES)
    return not standard and (units in _PLAIN_DEGREES or (not units and names_a_place))


def places_of_points(dataset: "Dataset", kind: str, dimensions: Sequence[str]) -> Any:
    """The longitudes (X) or latitudes (Y) of the points along some dimensions; None: there are
    none.
    """
    for name in dataset.variables:
        variable = dataset[name]
        is_along = variable.dims and set(variable.dims) <= set(dimensions)
        if is_along and axis_kind(variable) == kind and is_in_degrees(variable):
            return variable
    return None


def standard_name_of(variable: "DataArray") -> str:
    """`standard_name` of a variable by CF, in lower case; "" if it has none."""
    return str(variable.attrs.get("standard_name", "")).strip().lower()


def _bounds_of(source: Source, variable: "DataArray", attribute: str) -> Floats:
    """Numbers of an attribute `valid_…`, unpacked as the values of the variable are; empty without
    it.
    """
    given = variable.attrs.get(attribute)
    if given is None:
        return np.empty(0)
    try:
        bounds = np.atleast_1d(np.asarray(given)).astype(np.float64)
    except ValueError:
        raise source.error(
            f"{variable.name} has {attribute} = {given!r:.40}; expected numbers"
        ) from None
    packed_type = np.dtype(variable.encoding.get("dtype", np.float64))
    # bounds of packed values are whole numbers as these are
    if packed_type.kind in "iu" and np.asarray(given).dtype.kind in "iu":
        scale = float(variable.encoding.get("scale_factor", 1.0))
        bounds = scale * bounds + float(variable.encoding.get("add_offset", 0.0))
    return bounds


def valid_values(
    source: Source, variable: "DataArray", values: Floats, remarks: list[str]
) -> Floats:
    """Values of a variable, NaN outside of its `valid_min`, `valid_max` or `valid_range` (CF 2.5.1)
    and where nothing was written; `remarks` get how many these are.

    FieldError if the bounds are no numbers.
    """
    ranged = _bounds_of(source, variable, "valid_range")
    if ranged.size not in (0, 2):
        raise source.error(f"{variable.name} has {ranged.size} numbers as valid_range; expected 2")
    low, high = -np.inf, np.inf
    if ranged.size:
        low, high = float(ranged.min()), float(ranged.max())
    least = _bounds_of(source, variable, "valid_min")
    greatest = _bounds_of(source, variable, "valid_max")
    if float(variable.encoding.get("scale_factor", 1.0)) < 0.0:
        least, greatest = greatest, least
    low = max([low, *least.tolist()])
    high = min([high, *greatest.tolist()])
    rounding = 0.5 * abs(float(variable.encoding.get("scale_factor", 0.0)))
    is_too_small = values < low - rounding - _VALID_TOLERANCE * abs(low)
    is_too_large = values > high + rounding + _VALID_TOLERANCE * abs(high)
    is_invalid = is_too_small | is_too_large
    if np.any(is_invalid):
        least_and_greatest = [f"at least {low:.4g}"] if low > -np.inf else []
        least_and_greatest += [f"at most {high:.4g}"] if high < np.inf else []
        remarks.append(
            f"{np.mean(is_invalid):.2g} of {variable.name} outside of its valid range "
            f"({', '.join(least_and_greatest)}), missing"
        )
    return np.where(is_invalid | (np.abs(values) > _FILLED), np.nan, values)


def downward(source: Source, variable: "DataArray", values: Floats, remarks: list[str]) -> Floats:
    """Depths, positive down, of an axis of depths or heights [m]. Of numbers of one sign, whichever
    it is, the magnitude is the depth; of both, `positive` or a `standard_name` of heights tells, or
    else that there are more metres of water than above it. `remarks` get what is contradicted.

    FieldError if `positive` contradicts numbers of both signs.
    """
    positive = str(variable.attrs.get("positive", "")).strip().lower()
    if positive not in ("up", "down"):
        positive = "up" if standard_name_of(variable) in ("height", "altitude") else ""
    top = float(np.nanmax(values, initial=0.0))
    bottom = float(np.nanmin(values, initial=0.0))
    is_upward = -bottom > top
    is_contradicted = positive == ("down" if is_upward else "up") and top != bottom
    if is_contradicted and bottom < 0.0 < top:
        raise source.error(
            f"{variable.name} is {bottom:.4g} to {top:.4g} m, positive {positive}: most of it "
            f"would be above the water; expected positive = {'up' if is_upward else 'down'!r}"
        )
    if is_contradicted:
        sign = "negative" if is_upward else "positive"
        remarks.append(
            f"{variable.name} is {sign} though its positive is {positive!r}: taken as depths below "
            "the surface"
        )
    # no negative zero
    return (-values if is_upward else values) + 0.0


def units_of(variable: "DataArray") -> str:
    """Units of a variable, in lower case; "" if it has none."""
    return str(variable.attrs.get("units", "")).strip().lower()


def _axes(source: Source, dataset: "Dataset", variable: "DataArray", kinds: str) -> dict[str, Any]:
    """Coordinates of a variable's dimensions by kind; only the kinds in `kinds`, "TZYX" or "YX",
    are allowed.
    """
    for level in map(str, variable.dims):
        follows_floor = _FLOOR_FOLLOWING.match(standard_name_of(dataset[level]))
        if follows_floor or level in ("s_rho", "s_w"):
            raise source.error(
                f"{variable.name} is on levels that follow the floor, {level} (s- or "
                "σ-coordinates, as of ROMS); expected levels of depth: interpolate to them first"
            )
    axes: dict[str, Any] = {}
    for dimension in variable.dims:
        if dimension not in dataset.coords:
            if variable.sizes[dimension] == 1:
                continue
            raise source.error(
                f"{variable.name}: its dimension {dimension!r} has no coordinate of that name; "
                "expected longitude, latitude, depth and time as axes of one dimension each"
            )
        kind = axis_kind(dataset[dimension])
        if kind == "" or kind not in kinds:
            if variable.sizes[dimension] == 1:
                continue
            raise source.error(
                f"{variable.name}: its dimension {dimension!r} is not understood; expected "
                f"{', '.join(_AXES[key].title for key in kinds)}"
            )
        if kind in axes:
            raise source.error(
                f"{variable.name}: two of its dimensions are {_AXES[kind].title}: "
                f"{axes[kind].name!r} and {dimension!r}"
            )
        axes[kind] = dataset[dimension]
    for kind in "XY":
        if kind not in axes:
            raise source.error(
                f"{variable.name} has no axis of {_AXES[kind].title}; its dimensions: "
                f"{', '.join(map(str, variable.dims))}"
            )
    _require_map_axes(source, dataset, variable, axes)
    return axes


_MAP_ADVICE = (
    "expected axes of longitude and latitude, or of metres east and north of (0, 0): interpolate "
    "to them first"
)


def _require_map_axes(
    source: Source, dataset: "Dataset", variable: "DataArray", axes: dict[str, Any]
) -> None:
    """FieldError if the axes of a variable are those of a map projection, of a rotated or of a
    curvilinear grid.
    """
    projection = _projection_of(dataset, variable)
    if projection:
        raise source.error(
            f"{variable.name} is on the grid of a projection ({projection}); {_MAP_ADVICE}"
        )
    dimensions = [str(axes[kind].name) for kind in "XY"]
    for kind in "XY":
        axis = axes[kind]
        if is_in_degrees(axis):
            continue
        places = places_of_points(dataset, kind, dimensions)
        if places is not None:
            raise source.error(
                f"{variable.name} is on a curvilinear grid, whose points have their "
                f"{_AXES[kind].standard_names[0]}s in {places.name}; {_MAP_ADVICE}"
            )
        standard = standard_name_of(axis)
        if standard and standard not in _AXES[kind].standard_names:
            raise source.error(f"{axis.name} has the standard_name {standard!r}; {_MAP_ADVICE}")


def _projection_of(dataset: "Dataset", variable: "DataArray") -> str:
    """Name of the projection by CF (`grid_mapping`) whose axes a variable has; "": none."""
    given = variable.attrs.get("grid_mapping", variable.encoding.get("grid_mapping", ""))
    # "crs", or "crs: x y"
    mapping = str(given).partition(":")[0].strip()
    if mapping not in dataset.variables:
        return ""
    name = str(dataset[mapping].attrs.get("grid_mapping_name", "")).strip()
    return "" if name == "latitude_longitude" else name


class _Axis(NamedTuple):
    """Values of an axis in SI units, increasing, and the order in which the file has them."""

    value: Floats
    order: Ints

    def part(self, low: float, high: float) -> "_Axis":
        """The points from one before `low` to one behind `high`."""
        first = max(int(np.searchsorted(self.value, low, "right")) - 1, 0)
        last = min(int(np.searchsorted(self.value, high, "left")), self.value.size - 1)
        covered = slice(first, max(last, first) + 1)
        return _Axis(self.value[covered], self.order[covered])


def _sorted(source: Source, name: str, value: Floats) -> _Axis:
    if value.size == 0 or not np.isfinite(value).all():
        raise source.error(f"{name} has values that are missing or no numbers")
    order = np.argsort(value, kind="stable")
    value = value[order]
    if (np.diff(value) <= 0.0).any():
        raise source.error(
            f"{name} has the same value twice; expected values that increase or fall"
        )
    return _Axis(value, order.astype(np.int64))


def _horizontal_axes(
    source: Source, axes: dict[str, Any], origin: FieldOrigin
) -> tuple[_Axis, _Axis]:
    """Axes of east and north about the origin [m]."""
    units = [units_of(axes[kind]) for kind in "XY"]
    values = [np.atleast_1d(np.asarray(axes[kind].values, dtype=np.float64)) for kind in "XY"]
    names = [str(axes[kind].name) for kind in "XY"]
    if all(unit in _LENGTH_UNITS for unit in units):
        scaled = [value * _LENGTH_UNITS[unit] for value, unit in zip(values, units, strict=True)]
        east, north = scaled
    elif all(is_in_degrees(axes[kind]) for kind in "XY"):
        per_degree = metres_per_degree(origin.latitude_deg)
        if np.abs(values[1]).max(initial=0.0) > 90.0:
            raise source.error(
                f"{names[1]} has values beyond 90 and no units of metres; expected degrees, or "
                "units 'm'"
            )
        # east of the origin within half a turn, whether the file has 0 to 360° or -180 to 180°
        east = ((values[0] - origin.longitude_deg + 180.0) % 360.0 - 180.0) * per_degree.east
        north = (values[1] - origin.latitude_deg) * per_degree.north
    else:
        raise source.error(
            f"{names[0]} and {names[1]} have units {units[0]!r} and {units[1]!r}; expected "
            "degrees_east and degrees_north, or m"
        )
    once = np.arange(east.size)
    if is_in_degrees(axes["X"]):
        once = _each_meridian_once(values[0])
    east_axis = _sorted(source, names[0], east[once])
    east_axis = east_axis._replace(order=once[east_axis.order])
    return east_axis, _sorted(source, names[1], north)


def _each_meridian_once(longitude: Floats) -> Ints:
    """Indices of longitudes, shape (i,), [°], without those a turn and more from the least: grids
    of the globe may be closed by their first column, as of -180 and 180°.
    """
    beyond_a_turn = longitude - longitude.min(initial=np.inf) > 360.0 - _SAME_MERIDIAN_DEG
    return np.flatnonzero(~beyond_a_turn)


def _depth_axis(source: Source, axes: dict[str, Any], remarks: list[str]) -> _Axis:
    """Depths, positive down [m]; one of 0 where a field has none."""
    if "Z" not in axes:
        return _Axis(np.zeros(1), np.zeros(1, dtype=np.int64))
    axis = axes["Z"]
    units = units_of(axis)
    if units and units not in _LENGTH_UNITS:
        raise source.error(f"{axis.name} has units {units!r}; expected metres of depth")
    value = np.atleast_1d(np.asarray(axis.values, dtype=np.float64)) * _LENGTH_UNITS.get(units, 1.0)
    if not units:
        remarks.append(f"{axis.name} without units, taken as m")
    return _sorted(source, str(axis.name), downward(source, axis, value, remarks))


def _time_axis(source: Source, axes: dict[str, Any], origin: FieldOrigin, end_time: float) -> _Axis:
    """Times since the start of the mission [s]; one of 0 for a steady field."""
    if "T" not in axes or axes["T"].size == 1:
        return _Axis(np.zeros(1), np.zeros(1, dtype=np.int64))
    axis = axes["T"]
    time = _sorted(source, str(axis.name), seconds_from_start(source, axis, origin))
    first, last = time.value[0], time.value[-1]
    if first > 0.0 or last < end_time:
        raise source.error(
            f"{axis.name} covers {first:g} to {last:g} s from the start of the mission, which "
            f"lasts from 0 to {end_time:g} s; its time 0 is ocean.origin.time = {origin.time}"
        )
    return time


def seconds_from_start(source: Source, axis: "DataArray", origin: FieldOrigin) -> Floats:
    """Times of an axis since the start of the mission [s]; FieldError if it does not tell them."""
    units = units_of(axis)
    value = np.asarray(axis.values, dtype=np.float64)
    if units in _TIME_UNITS:
        return value * _TIME_UNITS[units]
    unit, separator, reference = units.partition(" since ")
    calendar = str(axis.attrs.get("calendar", "standard")).lower()
    if not separator or unit not in _TIME_UNITS:
        raise source.error(
            f"{axis.name} has units {units!r}; expected such as 'hours since 2026-01-01', or 's' "
            "from the start of the mission"
        )
    if calendar not in _CALENDARS:
        raise source.error(f"{axis.name} has the calendar {calendar!r}; expected 'standard'")
    epoch = _moment(source, str(axis.name), reference.strip())
    return value * _TIME_UNITS[unit] + (epoch - datetime.fromisoformat(origin.time)).total_seconds()


def _moment(source: Source, name: str, text: str) -> datetime:
    """The date and time that a NetCDF unit counts from, in UTC unless it has a zone."""
    match = _DATE.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        year, month, day, hour, minute = (int(match[field] or 0) for field in _DATE_PARTS)
        moment = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except ValueError:
        raise source.error(f"{name}: {text!r} is no date such as 2026-01-01 00:00:00") from None
    seconds = timedelta(seconds=float(match["second"] or 0.0))
    zone_offset = timedelta(hours=int(match["zone_h"] or 0), minutes=int(match["zone_min"] or 0))
    if match["sign"] == "-":
        zone_offset = -zone_offset
    return moment + seconds - zone_offset


def _values(
    source: Source,
    variable: "DataArray",
    axes: dict[str, _Axis],
    names: dict[str, str],
    remarks: list[str],
) -> Floats:
    """Values of a variable on parts of its axes, shape (t, k, j, i); NaN where there are none."""
    orders = {names[kind]: axis.order for kind, axis in axes.items() if kind in names}
    first_indices = {d: 0 for d in variable.dims if d not in orders}
    count = int(np.prod([axis.value.size for axis in axes.values()]))
    if 8 * count > _MAX_BYTES:
        raise source.error(
            f"{variable.name} has {8e-9 * count:.1f} GB about the mission; at most "
            f"{1e-9 * _MAX_BYTES:g} GB are read: cut or thin it out"
        )
    try:
        # in the file's own order, which it reads fast, and then in that of the axes
        cut = variable.isel(first_indices).isel({d: np.sort(order) for d, order in orders.items()})
        cut = cut.isel({d: np.argsort(np.argsort(order)) for d, order in orders.items()})
        cut = cut.transpose(*[names[kind] for kind in axes if kind in names])
        values = np.asarray(cut.values, dtype=np.float64)
    except Exception as error:
        # of many libraries, where the data are damaged
        reason = str(error).partition("\n")[0]
        raise source.error(f"{variable.name} cannot be read: {reason:.200}") from error
    shape = [axis.value.size if kind in names else 1 for kind, axis in axes.items()]
    return valid_values(source, variable, values, remarks).reshape(shape)


def _speed_scale(source: Source, variable: "DataArray", remarks: list[str]) -> float:
    units = " ".join(units_of(variable).split())
    if not units:
        remarks.append(f"{variable.name} without units, taken as m/s")
        return 1.0
    if units not in _SPEED_UNITS:
        raise source.error(f"{variable.name} has units {units!r}; expected m s-1, or cm s-1")
    return _SPEED_UNITS[units]


def _covered(east: _Axis, north: _Axis, region: Region) -> Region:
    """What axes cover."""
    return Region(east.value[0], east.value[-1], north.value[0], north.value[-1], region.end_time)


def _require_overlap(source: Source, east: _Axis, north: _Axis, region: Region) -> None:
    """FieldError if a field is elsewhere than the mission."""
    e = east.value
    n = north.value
    if e[0] < region.east and e[-1] > region.west and n[0] < region.north and n[-1] > region.south:
        return
    raise source.error(
        f"it covers {e[0] / 1e3:.4g} to {e[-1] / 1e3:.4g} km east and {n[0] / 1e3:.4g} to "
        f"{n[-1] / 1e3:.4g} km north of the origin, and none of the mission; set ocean.origin"
    )


# the digest is only a key of the cache: a changed file is read again
@lru_cache(maxsize=4)
def _read_current(
    source: Source, _digest: str | None, origin: FieldOrigin, region: Region
) -> CurrentField:
    with open_dataset(source) as dataset:
        eastward = _require(source, dataset, EASTWARD)
        northward = _require(source, dataset, NORTHWARD)
        upward = find_variable(dataset, UPWARD)
        grid_axes = _axes(source, dataset, eastward, "TZYX")
        for other in (northward, *(() if upward is None else (upward,))):
            if other.dims != eastward.dims:
                raise source.error(
                    f"{other.name} and {eastward.name} are on different axes; expected one grid "
                    "for all components"
                )
        names = {kind: str(axis.name) for kind, axis in grid_axes.items()}
        time = _time_axis(source, grid_axes, origin, region.end_time)
        remarks = list[str]()
        depth = _depth_axis(source, grid_axes, remarks)
        east, north = _horizontal_axes(source, grid_axes, origin)
        _require_overlap(source, east, north, region)
        axes = {
            "T": time.part(0.0, region.end_time),
            "Z": depth,
            "Y": north.part(region.south, region.north),
            "X": east.part(region.west, region.east),
        }
        components = [eastward, northward] + ([] if upward is None else [upward])
        # shape (t, k, j, i, 2 or 3), [m/s]
        velocity = np.empty((*(axis.value.size for axis in axes.values()), len(components)))
        for i, variable in enumerate(components):
            scale = _speed_scale(source, variable, remarks)
            velocity[..., i] = scale * _values(source, variable, axes, names, remarks)
    remarks_on_gaps, land = _fill_gaps(velocity, axes["T"].value, depth.value)
    if land.all():
        problem = f"{eastward.name} has no values about the mission: land, or no data"
        raise source.error("; ".join([problem, *remarks]))
    remarks += remarks_on_gaps
    grid = CurrentGrid(
        time=axes["T"].value,
        depth=depth.value,
        north=axes["Y"].value,
        east=axes["X"].value,
        velocity=velocity,
    )
    fastest = float(np.sqrt((velocity**2).sum(axis=-1)).max())
    report = f"{_names_of(components)} {_extent(axes, names)}, up to {fastest:.3g} m/s"
    if land.any():
        report += f", {land.mean():.0%} land"
    report = "; ".join([report, *remarks])
    return CurrentField(
        current=GriddedCurrent(grid),
        region=_covered(axes["X"], axes["Y"], region),
        land=land,
        report=f"{source.file.name}: {report}",
    )


def _names_of(variables: Sequence[Any]) -> str:
    return ", ".join(str(variable.name) for variable in variables)


def _extent(axes: dict[str, _Axis], names: dict[str, str]) -> str:
    """Size, place and time of what was read."""
    east, north = (axes[kind].value / 1e3 for kind in "XY")
    text = (
        f"on {axes['X'].value.size} × {axes['Y'].value.size} points, {east[0]:.4g} to "
        f"{east[-1]:.4g} km east and {north[0]:.4g} to {north[-1]:.4g} km north of the origin"
    )
    if "Z" in axes:
        depth = axes["Z"].value
        text += (
            f", {depth.size} depths, {depth[0]:.4g} to {depth[-1]:.4g} m"
            if "Z" in names
            else ", the same at all depths"
        )
    if "T" in axes:
        time = axes["T"].value
        text += (
            f", {time.size} times, {time[0]:g} to {time[-1]:g} s from the start"
            if time.size > 1
            else ", steady"
        )
    return text


def _fill_gaps(velocity: Floats, time: Floats, depth: Floats) -> tuple[list[str], Bools]:
    """Give points without a velocity one: between levels, then between times, linearly; above the
    first level that has one, and below the deepest, as below the floor, that of this level; before
    the first time and after the last likewise; zero where there is none at any time.

    Args:
        velocity: shape (t, k, j, i, 2 or 3), [m/s]; NaN where there is none. Filled in place.
        time, depth: shapes (t,), [s], and (k,), [m].

    Returns:
        What to remark, and which columns have no velocity at any time: land, shape (j, i).
    """
    # a velocity of which one horizontal component is missing is none; without the upward one it is
    # still a current
    for horizontal in velocity[..., :2]:
        horizontal[np.isnan(horizontal).any(axis=-1)] = np.nan
    is_dry = np.isnan(velocity[..., 0]).all(axis=1)  # shape (t, j, i)
    land: Bools = np.asarray(is_dry.all(axis=0))
    remarks = []
    without_time = np.asarray(is_dry & ~land)
    if without_time.any():
        remarks.append(
            f"{without_time.mean():.2g} of the columns of water lack values at a time, taken as "
            "linear between the times that are read about it, or as the nearest of these"
        )
    for component in np.moveaxis(velocity, -1, 0):
        _interpolate_gaps(np.moveaxis(component, 1, 0), depth)
        _interpolate_gaps(component, time)
    velocity[np.isnan(velocity)] = 0.0
    return remarks, land


def _interpolate_gaps(values: Floats, axis: Floats) -> None:
    """Replace NaN along the first axis of values, shape (n, …), in place: linear in `axis`, shape
    (n,), between numbers, and the nearest number beyond them. Where all are NaN, they stay.
    """
    is_missing = np.isnan(values)
    last = axis.size - 1
    last_number = last - np.argmax(~is_missing[::-1], axis=0)
    last_number[is_missing.all(axis=0)] = -1
    for k in range(last + 1):
        gaps = is_missing[k] & (last_number > k)
        for later in range(k + 1, last + 1):
            if not gaps.any():
                break
            ends = gaps & ~is_missing[later]
            gaps &= ~ends
            if k == 0:
                values[k][ends] = values[later][ends]
                continue
            # what was filled before lies on the same line
            start = values[k - 1][ends]
            share = (axis[k] - axis[k - 1]) / (axis[later] - axis[k - 1])
            values[k][ends] = start + share * (values[later][ends] - start)
        if k > 0:
            beyond = is_missing[k] & (last_number < k)
            values[k][beyond] = values[k - 1][beyond]


# the digest is only a key of the cache, as above
@lru_cache(maxsize=4)
def _read_floor(
    source: Source, _digest: str | None, origin: FieldOrigin, region: Region
) -> FloorField:
    with open_dataset(source) as dataset:
        variable = _require(source, dataset, FLOOR_LEVEL)
        grid_axes = _axes(source, dataset, variable, "YX")
        names = {kind: str(axis.name) for kind, axis in grid_axes.items()}
        units = units_of(variable)
        if units and units not in _LENGTH_UNITS:
            raise source.error(f"{variable.name} has units {units!r}; expected metres")
        east, north = _horizontal_axes(source, grid_axes, origin)
        _require_overlap(source, east, north, region)
        axes = {
            "Y": north.part(region.south, region.north),
            "X": east.part(region.west, region.east),
        }
        remarks = [] if units else [f"{variable.name} without units, taken as m"]
        values = _values(source, variable, axes, names, remarks)
        depth = _LENGTH_UNITS.get(units, 1.0) * values
        if _is_upward(variable):
            depth = -depth
    missing = np.isnan(depth)
    if missing.any():
        raise source.error(
            f"{variable.name} has no value at {missing.mean():.1%} of its points about the "
            "mission; expected a depth or height everywhere, above zero on land"
            + "".join(f"; {remark}" for remark in remarks)
        )
    if (depth <= 0.0).all():
        raise source.error(
            f"{variable.name} lies above the water everywhere about the mission; a depth, "
            "positive down, has the standard_name 'sea_floor_depth_below_geoid' or the attribute "
            "positive = 'down'"
        )
    report = (
        f"{variable.name} {_extent(axes, names)}, {max(depth.min(), 0.0):.3g} to {depth.max():.3g} "
        "m deep"
    )
    if (depth <= 0.0).any():
        report += f", {(depth <= 0.0).mean():.0%} land"
    report = "; ".join([report, *remarks])
    return FloorField(
        floor=GriddedFloor(axes["Y"].value, axes["X"].value, np.ascontiguousarray(depth)),
        region=_covered(axes["X"], axes["Y"], region),
        report=f"{source.file.name}: {report}",
    )


def _is_upward(variable: "DataArray") -> bool:
    """Whether a variable is a height, positive up, and no depth."""
    positive = str(variable.attrs.get("positive", "")).lower()
    if positive in ("up", "down"):
        return positive == "up"
    standard = standard_name_of(variable)
    if standard:
        return "depth" not in standard
    return str(variable.name).lower() in ("elevation", "topo", "z", "band1")

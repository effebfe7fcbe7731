"""The map of a recording: a TOML file that tells which column, or which field of which topic, holds
what the navigator needs, in what unit.

    [heading]                          [leader_east]
    topic = "/auv/imu"                 column = "ldr_E"
    field = "orientation"              unit = "ft"
    unit = "quaternion"

A table of the map has the name of a field of the log. Numbers become SI units by `unit`, or by
`factor` and `offset` alone.
"""

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator

from laisn.arrays import Floats
from laisn.errors import LaisnError, printable, screenful, shortened
from sim.attitude import FLATTENING, SEMI_MAJOR_AXIS
from sim.datasets.range_data import text_of
from sim.datasets.table_columns import FIELDS, NEEDED, quantity_of
from sim.system import atomic_write

PRESSURES = {
    "Pa": 1.0,
    "hPa": 100.0,
    "mbar": 100.0,
    "kPa": 1e3,
    "dbar": 1e4,
    "bar": 1e5,
    "psi": 6894.757293168,
}
"""Units of pressure, by their size in pascals; a depth follows."""
QUATERNION = "quaternion"
"""Unit of an orientation with x, y, z and w; a heading, pitch or roll follows."""
LATITUDE = "latitude"
LONGITUDE = "longitude"
"""Units of places on the map [deg]; metres east and north of the origin follow."""
_GRAVITY = 9.81  # [m/s²]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class FieldEntry(_Table):
    """Where the numbers of one field are."""

    column: str | None = None  # of a text table, by its header
    topic: str | None = None  # of a bag
    field: str | None = None  # of the topic's messages, nested ones with dots
    value: float | None = None  # a constant in their place; without a unit in SI units
    derive: bool = False  # heading or speed of the leader by its places, in bags
    unit: str = ""  # one of `units_of`; "": SI units in bags, detected in text tables
    # numbers are multiplied by `factor` and `offset` is added, before the unit is applied; to the
    # angle of an orientation `offset` is added [rad]
    factor: float = 1.0
    offset: float = 0.0
    # compass: clockwise from north; yaw: anticlockwise from east
    angle: Annotated[str, Field(pattern="^(compass|yaw)$")] = "compass"
    where: dict[str, str | int | float | bool] = {}  # only messages or rows with these values
    hold: bool = False  # of another topic than the ranges': its last value counts, not one between
    surface_pressure_pa: float = 101325.0
    density_kg_m3: Annotated[float, Field(gt=0)] = 1026.0

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        sources = [self.column, self.topic, self.value, True if self.derive else None]
        if sum(source is not None for source in sources) != 1:
            raise ValueError("expected one of column, topic (with field), value and derive")
        if (self.topic is None) != (self.field is None):
            raise ValueError("topic and field belong together")
        return self

    def in_si(self, numbers: Floats, name: str, origin: "GeodeticOrigin | None") -> Floats:
        """Values of the field `name` in SI units, shape (n,), by numbers of its source, shape (n,),
        or quaternions (x, y, z, w), shape (n, 4).

        ValueError: the unit is none of the field's, or needs an `origin`.
        """
        if self.unit == QUATERNION:
            angle = _angle_of(numbers, name) + self.offset
            return np.mod(angle, 2.0 * np.pi) if name.endswith("heading") else angle
        values = numbers * self.factor + self.offset
        if self.unit in (LATITUDE, LONGITUDE):
            if origin is None:
                raise ValueError(f"unit {self.unit!r} needs the table [origin] of the map")
            return origin.metres(values, self.unit)
        if self.unit in PRESSURES and name.endswith("depth"):
            gauge_pressure = values * PRESSURES[self.unit] - self.surface_pressure_pa
            return np.asarray(gauge_pressure / (self.density_kg_m3 * _GRAVITY))
        if self.unit:
            values = values * self.size(name)
        return 0.5 * np.pi - values if self.angle == "yaw" else values

    def size(self, name: str) -> float:
        """Size of the unit in SI units; ValueError if it is none of the field's."""
        units = units_of(name)
        if self.unit not in units:
            raise ValueError(f"unknown unit {self.unit!r}; expected {', '.join(units)}")
        return units.get(self.unit, 1.0)

    def constant(self, name: str, origin: "GeodeticOrigin | None") -> float:
        """The value of the field `name` in SI units where it is a constant; ValueError as of
        `in_si`.
        """
        return float(self.in_si(np.array([self.value]), name, origin)[0])

    @property
    def is_plain(self) -> bool:
        """Whether a column's numbers are the field's but for factor and offset."""
        return self.angle == "compass" and self.unit not in (
            *PRESSURES,
            QUATERNION,
            LATITUDE,
            LONGITUDE,
        )


class GeodeticOrigin(_Table):
    """The place on the map from which east and north count."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]

    def metres(self, degrees: Floats, unit: str) -> Floats:
        """Metres north of latitudes, or east of longitudes, [deg], shape (n,), as
        `sim.attitude.geodetic` has them.
        """
        eccentricity_squared = FLATTENING * (2 - FLATTENING)
        latitude = math.radians(self.latitude_deg)
        w = math.sqrt(1 - eccentricity_squared * math.sin(latitude) ** 2)
        if unit == LATITUDE:
            meridian = SEMI_MAJOR_AXIS * (1 - eccentricity_squared) / w**3
            return np.asarray(np.deg2rad(degrees - self.latitude_deg) * meridian)
        parallel = SEMI_MAJOR_AXIS / w * math.cos(latitude)
        degrees_east = (degrees - self.longitude_deg + 180.0) % 360.0 - 180.0
        return np.asarray(np.deg2rad(degrees_east) * parallel)


def units_of(name: str) -> dict[str, float]:
    """Units that a field may have, by their size in SI units; 0 for those that need more than a
    factor.
    """
    units = dict(quantity_of(name).units)
    if name.endswith("depth"):
        units |= PRESSURES
    if name.endswith(("heading", "pitch", "roll")):
        units[QUATERNION] = 0.0
    if name.endswith("east"):
        units[LONGITUDE] = 0.0
    if name.endswith("north"):
        units[LATITUDE] = 0.0
    return units


def _angle_of(xyzw: Floats, name: str) -> Floats:
    """Compass heading, pitch or roll [rad], whichever the field `name` is, shape (n,), of
    orientations from forward, port, up to east, north, up, shape (n, 4). NaN where all four numbers
    are zero, which is how ROS leaves an orientation that nothing has measured.
    """
    length = np.linalg.norm(xyzw, axis=1, keepdims=True)
    x, y, z, w = np.divide(xyzw, length, out=np.full(xyzw.shape, np.nan), where=length > 0.0).T
    if name.endswith("pitch"):
        return np.asarray(np.arcsin(np.clip(2.0 * (x * z - w * y), -1.0, 1.0)))
    if name.endswith("roll"):
        return np.asarray(np.arctan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)))
    return np.asarray(np.arctan2(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)))


class _MapBase(_Table):
    steps: str | None = None
    """Topic whose messages are the filter steps; others are interpolated. None: that of the
    speed."""
    stamps: Annotated[str, Field(pattern="^(header|log)$")] = "header"
    """Times of messages: those in their headers, where these have one, or those of recording."""
    ping_window_s: Annotated[float, Field(gt=0, le=60)] = 0.5
    """Ranges of different transmitters within this time are one reception."""
    origin: GeodeticOrigin | None = None


_declared: dict[str, Any] = dict.fromkeys(("time", *FIELDS), (FieldEntry | None, None))
_Map: Any = create_model("_Map", __base__=_MapBase, **_declared)


@dataclass(frozen=True, kw_only=True)
class FieldMap:
    """A map that was read."""

    path: Path
    settings: _MapBase
    entries: Mapping[str, FieldEntry]  # by the names of the log's fields, and "time"


def _error_lines(error: ValidationError) -> list[str]:
    lines = []
    for detail in error.errors(include_url=False, include_context=False):
        key = shortened(printable(".".join(map(str, detail["loc"]))), 100)
        if detail["type"] == "extra_forbidden":
            model = FieldEntry if len(detail["loc"]) > 1 else _Map
            keys = ", ".join(model.model_fields)
            lines.append(f"  {key}: unknown key; known here: {keys}")
            continue
        message = str(detail["msg"]).removeprefix("Value error, ")
        lines.append(
            f"  {key}: {message} (given: {shortened(printable(repr(detail['input'])), 80)})"
        )
    return lines


def _unit_errors(entries: Mapping[str, FieldEntry]) -> list[str]:
    lines = []
    for name, entry in entries.items():
        if entry.unit and entry.unit not in units_of(name):
            lines.append(
                f"  {name}.unit: expected {', '.join(units_of(name))} (given: {entry.unit!r})"
            )
        if entry.angle != "compass" and not name.endswith("heading"):
            lines.append(f"  {name}.angle: {name} is no heading")
        if entry.unit == QUATERNION:
            lines += _orientation_errors(name, entry)
        if entry.derive and name not in ("leader_heading", "leader_speed"):
            lines.append(f"  {name}.derive: leader_heading and leader_speed only")
    return lines


def _orientation_errors(name: str, entry: FieldEntry) -> list[str]:
    """Lines on what an entry states beside an orientation, which is none of its numbers."""
    lines = []
    if entry.value is not None:
        lines.append(f"  {name}.value: a quaternion has four numbers; expected an angle")
    if entry.factor != 1.0:
        lines.append(f"  {name}.factor: no factor of a quaternion (given: {entry.factor:g})")
    if entry.angle != "compass":
        lines.append(
            f"  {name}.angle: a quaternion is from forward, port, up to east, north, up; expected "
            f"no angle (given: {entry.angle!r})"
        )
    return lines


def read_map(path: Path) -> FieldMap:
    """The map in a file; LaisnError with a line for every key that is invalid."""
    try:
        table = tomllib.loads(text_of(path))
    except tomllib.TOMLDecodeError as error:
        raise LaisnError(f"{path}: no TOML: {error}") from None
    return map_of(table, path)


def map_of(table: Mapping[str, Any], path: Path) -> FieldMap:
    """The map in a table, whose file is named in errors; LaisnError as of `read_map`."""
    try:
        settings = _Map.model_validate(table)
    except ValidationError as error:
        raise LaisnError(
            "\n".join([f"{path}: invalid map", *screenful(_error_lines(error))])
        ) from None
    entries = {
        name: entry for name in ("time", *FIELDS) if (entry := getattr(settings, name)) is not None
    }
    if wrong := _unit_errors(entries):
        raise LaisnError("\n".join([f"{path}: invalid map", *screenful(wrong)]))
    return FieldMap(path=path, settings=settings, entries=entries)


def missing_fields(fields: Iterable[str], required: Sequence[str] = ()) -> tuple[str, ...]:
    """What the navigator needs of a recording beside these fields.

    All recordings need NEEDED and a range; `required` is what one of this kind needs besides, as a
    text table needs times.
    """
    present = set(fields)
    missing = [name for name in (*required, *NEEDED) if name not in present]
    if not any(name.startswith("range_") for name in present):
        missing.append("range_rear")
    return tuple(missing)


def require_complete(field_map: FieldMap, required: Sequence[str] = ()) -> None:
    """LaisnError naming the fields that a map lacks."""
    if missing := missing_fields(field_map.entries, required):
        raise LaisnError(
            f"{field_map.path}: lacks {', '.join(missing)}; add a table of this name with column, "
            "or topic and field, or with a value"
        )


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A map as it is proposed."""

    source: str  # the recording
    settings: Mapping[str, Any]
    entries: Mapping[str, Mapping[str, Any]]  # by field
    notes: Mapping[str, str]  # by field, what its user should check
    missing: tuple[str, ...]  # fields that the navigator needs and nothing was found for
    unused: tuple[str, ...]  # columns or topics

    def table(self) -> dict[str, Any]:
        """The map as a table."""
        return {**self.settings, **{field: dict(entry) for field, entry in self.entries.items()}}

    def text(self) -> str:
        """The map as TOML, with notes."""
        lines = [
            f"# Map of {printable(self.source)}, proposed from names and types: check it, and "
            "edit it.",
            "# Tables have the names of the log's fields; docs/ros.md lists them and all keys.",
            "",
        ]
        if self.settings:
            lines += [tomli_w.dumps(dict(self.settings))]
        for name, entry in self.entries.items():
            if name in self.notes:
                lines.append(f"# check: {self.notes[name]}")
            lines.append(tomli_w.dumps({name: dict(entry)}))
        for name in self.missing:
            units = ", ".join(units_of(name))
            lines += [
                f"# {name}: nothing was found for it, and the navigator needs it. Its units:",
                f"# {units}",
                f"# [{name}]",
                "# value = 0.0",
                "",
            ]
        if self.unused:
            lines += ["# Not used:", *(f"#   {printable(name)}" for name in self.unused), ""]
        return "\n".join(lines)


def write_proposal(proposal: Proposal, path: Path) -> None:
    """Write a proposal as a file."""
    with atomic_write(path) as temporary:
        temporary.write_text(proposal.text(), encoding="utf-8")

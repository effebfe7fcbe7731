"""What tables of a scenario file are made of: their common rules, the ranges of their numbers,
and time steps.
"""

import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from itertools import pairwise
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    TypeVar,
    cast,
    get_args,
    get_type_hints,
)

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    Strict,
    create_model,
    model_validator,
)

from laisn.arrays import Record
from laisn.errors import shortened

Positive = Annotated[float, Field(gt=0, le=1e6)]
NonNegative = Annotated[float, Field(ge=0, le=1e6)]
Angle = Annotated[float, Field(ge=-360, le=360)]
Chance = Annotated[float, Field(ge=0, le=1)]
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Speed = Annotated[float, Field(gt=0, le=5)]
_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
Name = Annotated[str, Field(pattern=_NAME)]
CUSTOM_CLASS = r"^\w+(:\w+)?$"
SENSOR_CLASS = r"^([\w.]+:[\w.]+|dvl|inverted-usbl|inclinometer|gyros)$"
PATTERNS = {
    _NAME: "1 to 64 letters A to Z, digits, '_', '.' or '-', the first a letter or digit",
    CUSTOM_CLASS: "the class of a plugin, module:Class",
    SENSOR_CLASS: (
        '"dvl", "inverted-usbl", "inclinometer", "gyros", or the class of a plugin, module:Class'
    ),
}
"""What patterns of texts mean, for messages; what is in double quotes is a value."""
SectionType = TypeVar("SectionType", bound="Section")
LIST_OR_TUPLE = Strict(False)  # lets a tuple be given as a list too, as a TOML file has it


class PerRun:
    """In the annotation of a key: marks a random error or a constant bias.

    Such a key changes the readings of each run, and nothing that the runs of a mission share: its
    motion, and what of it is observed before errors are added.
    """


@dataclass(frozen=True, kw_only=True)
class Idle:
    """In the annotation of a key: it has no effect where another key of its table, `key`, has one
    of the values `at`.
    """

    key: str
    at: tuple[float | str, ...] = (0.0,)


@dataclass(frozen=True, kw_only=True)
class Because:
    """In the annotation of a key: why its bounds are what they are, for messages."""

    text: str


CONTROL_STEP_S = 0.1  # interval of the autopilot and of the recorded truth [s]
MAX_POINTS = 100_000  # most points of a route or a profile: one a second for more than a day
_DEGREE = np.pi / 180.0
UNITS = {
    "_deg_sqrt_h": ("°/√h", _DEGREE / 60.0),
    "_deg_sqrt_s": ("°/√s", _DEGREE),
    "_deg_s": ("°/s", _DEGREE),
    "_deg": ("°", _DEGREE),
    "_m_sqrt_s": ("m/√s", 1.0),
    "_m_s2": ("m/s²", 1.0),
    "_m_s": ("m/s", 1.0),
    "_kg_m3": ("kg/m³", 1.0),
    "_per_s": ("1/s", 1.0),
    "_m2": ("m²", 1.0),
    "_m": ("m", 1.0),
    "_s": ("s", 1.0),
    "_n": ("N", 1.0),
    "_px": ("px", 1.0),
    "_hz": ("Hz", 1.0),
    "_ppm": ("10⁻⁶", 1e-6),
}
"""Units by the endings of keys, longer ones before those that they end in: how they are written,
and in SI units.
"""


@cache
def split_unit(key: str) -> tuple[str, str, float]:
    """Name of a key without its unit, how the unit is written, and what it is in SI units and
    radians.
    """
    ending = next((ending for ending in UNITS if key.endswith(ending)), "")
    return (key.removesuffix(ending), *UNITS.get(ending, ("", 1.0)))


def in_si(table: Mapping[str, Any], unconverted: Collection[str] = ()) -> dict[str, Any]:
    """Values in SI units and radians by keys without units; keys among `unconverted` stay as they
    are, a value of None is left out.
    """
    converted = {}
    for key, value in table.items():
        name, _, scale = (key, "", 1.0) if key in unconverted else split_unit(key)
        if value is not None:
            converted[name] = value if scale == 1.0 else _scaled(value, scale)
    return converted


def _scaled(value: Any, scale: float) -> Any:
    """A number, or all numbers of a list, in another unit."""
    if isinstance(value, list | tuple):
        return tuple(_scaled(member, scale) for member in value)
    return value * scale


def quoted_bool_hint(value: object) -> str:
    """What to write in place of a text that means true or false in other languages; else empty."""
    if isinstance(value, str) and value.lower() in ("true", "false"):
        return f"; write {value.lower()}, without quotes and in lower case"
    return ""


def increasing(quantity: str, unit: str) -> AfterValidator:
    """Validation of the points of a profile: the first number increases; it is a time [s] from 0
    on, or a depth.
    """

    def checked(points: Any) -> Any:
        if unit == "s" and points and points[0][0] != 0:
            raise ValueError(f"the first {quantity} must stand at time 0")
        for number, (before, after) in enumerate(pairwise(points), start=2):
            if after[0] <= before[0]:
                order = "later" if unit == "s" else "deeper"
                raise ValueError(
                    f"{quantity} {number} at {after[0]:g} {unit} is not {order} than the one before"
                )
        return points

    return AfterValidator(checked)


class Section(BaseModel):
    """A table of the scenario file: unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    RECORD_NAMES: ClassVar[Mapping[str, str]] = {}
    """Names in `record` by keys, of those that are others there."""

    def record(self) -> Record:
        """Numbers, and choices by index, for compiled code: by names without units, in SI units
        and radians.
        """
        values: dict[str, Any] = {}
        for key, field in type(self).model_fields.items():
            value = getattr(self, key)
            if isinstance(value, str):
                value = get_args(field.annotation).index(value)
            if isinstance(value, bool | int | float):
                [in_units] = in_si({key: value}).values()
                values[self.RECORD_NAMES.get(key, split_unit(key)[0])] = in_units
        row = np.array(
            [tuple(values.values())], [(name, type(value)) for name, value in values.items()]
        )
        return row.view(np.recarray)[0]

    def changed_keys(self) -> list[str]:
        """Keys whose values are not their defaults."""
        return [
            name
            for name, field in type(self).model_fields.items()
            if getattr(self, name) != field.get_default(call_default_factory=True)
        ]

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """What differs from the defaults; all else would fill screens."""
        for name in self.changed_keys():
            value = getattr(self, name)
            yield name, shortened(value, 80) if isinstance(value, str) else value


class FurtherKeys(Section):
    """A section with keys beside those that its class has, from `with_fields_of`."""

    if TYPE_CHECKING:

        def __getattr__(self, key: str) -> Any: ...


_ENDINGS = {unit.replace("°", "rad"): ending for ending, (unit, _) in UNITS.items()}
"""Endings of keys by the units of the numbers that they become."""


def _lower_first(description: str) -> str:
    """A description in lower case unless it begins with a symbol or an abbreviation."""
    if not description[:2].isupper() and description[1] not in ":_":
        return description[0].lower() + description[1:]
    return description


def with_fields_of(
    settings_class: Any,
    *,
    positive: Collection[str] = (),
    excluded: Collection[str] = (),
    optional: bool = False,
) -> Callable[[type[SectionType]], type[SectionType]]:
    """Give a section a key for each field of a navigator's settings, a dataclass, which declares
    them.

    A key is the field's name with its unit, degrees in place of radians. Only fields of the class
    itself that are a `laisn.settings.setting` have one, less those in `excluded` and those for
    which the section has a key. Numbers are not negative, and those in POSITIVE and `positive` not
    zero; `optional`: all defaults are None.
    """
    types = get_type_hints(settings_class)
    declared_here = inspect.get_annotations(settings_class)
    keys: dict[str, Any] = {}
    for field in fields(settings_class):
        if field.name not in declared_here or not field.metadata or field.name in excluded:
            continue
        unit = field.metadata["unit"]
        description = _lower_first(field.metadata["description"])
        ending = _ENDINGS[unit] if unit else ""
        value = field.default
        if ending.startswith("_deg"):
            # the same angle to the bit once it is made radians again
            value = round(float(np.rad2deg(cast(float, value))), 9)
        bounded = types[field.name]
        if bounded is float:
            bounded = (
                Positive if field.name in {*settings_class.POSITIVE, *positive} else NonNegative
            )
        described = Field(None if optional else value, description=description)
        keys[field.name + ending] = (bounded | None if optional else bounded, described)

    def add(base: type[SectionType]) -> type[SectionType]:
        declared = {split_unit(key)[0] for key in base.model_fields}
        undeclared = {
            key: field for key, field in keys.items() if split_unit(key)[0] not in declared
        }
        return create_model(
            base.__name__,
            __base__=base,
            __module__=base.__module__,
            __doc__=base.__doc__,
            **undeclared,
        )

    return add


def keys_per_run(section: type[Section]) -> list[str]:
    """Keys that are marked as `PerRun`."""
    return [key for key, field in section.model_fields.items() if PerRun in field.metadata]


def is_multiple(value: float, unit: float) -> bool:
    """Whether one time is a whole number of another, one at least, but for rounding."""
    ratio = value / unit
    return abs(ratio - round(ratio)) < 1e-9 and round(ratio) >= 1


class Timing(Section):
    """Time steps."""

    physics_step_s: float = Field(
        0.02, ge=1e-4, le=0.1, description="rigid-body solver step; must divide 0.1 s"
    )
    engine: Literal["mujoco", "direct"] = Field(
        "mujoco",
        description="rigid-body solver: MuJoCo, or each hull's equations of motion alone, the "
        "same motion to 1e-9 m (docs/speed.md)",
    )
    filter_step_s: Positive = Field(0.1, description="filter step Δt; multiple of 0.1 s")
    message_interval_s: Positive = Field(
        1.0, description="message interval Δt_D; multiple of the filter step"
    )

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if not is_multiple(CONTROL_STEP_S, self.physics_step_s):
            raise ValueError(
                f"physics_step_s = {self.physics_step_s:g} does not divide {CONTROL_STEP_S:g} s"
            )
        if not is_multiple(self.filter_step_s, CONTROL_STEP_S):
            raise ValueError(
                f"filter_step_s = {self.filter_step_s:g} is no multiple of {CONTROL_STEP_S:g} s"
            )
        if not is_multiple(self.message_interval_s, self.filter_step_s):
            raise ValueError(
                f"message_interval_s = {self.message_interval_s:g} is no multiple of "
                f"filter_step_s = {self.filter_step_s:g}"
            )
        return self

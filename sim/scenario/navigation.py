"""What a user may set of a follower's navigation, and the settings in SI units that its
navigator is made of.
"""

import difflib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast

from pydantic import (
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
)

from laisn.errors import LaisnError
from laisn.navigators import CUSTOM_SECTION, NAVIGATORS, find, is_known
from laisn.plugins import is_plugin_name
from laisn.settings import (
    LAISN_VARIANTS,
    Assume,
    BeaconSettings,
    NavigationSettings,
    RivalSettings,
    Settings,
    TightSettings,
    WaterBeaconSettings,
    transmitters_of,
)
from sim.scenario.class_keys import ClassValue, class_arguments
from sim.scenario.links import LEADER_LINK, Offset
from sim.scenario.section import (
    LIST_OR_TUPLE,
    FurtherKeys,
    Name,
    NonNegative,
    Section,
    in_si,
    split_unit,
    with_fields_of,
)

_TYPICAL_SOUND_M_S = 1500.0
STORED = {"plugins": "not loaded"}
"""Context of the validation of what was flown: its plugins need not be loaded."""

SettingsClass = TypeVar("SettingsClass")


def _settings_from(settings_class: type[SettingsClass], values: Mapping[str, Any]) -> SettingsClass:
    """A dataclass of those values that are fields of it, or of a dataclass in it."""
    arguments = {}
    for field in fields(settings_class):  # type: ignore[arg-type]
        inner: Any = field.default_factory
        if is_dataclass(inner):
            arguments[field.name] = _settings_from(cast("type[Any]", inner), values)
        elif field.name in values:
            arguments[field.name] = values[field.name]
    return settings_class(**arguments)


@with_fields_of(TightSettings)
@with_fields_of(Assume)
class AssumeTable(FurtherKeys):
    """Model assumptions and sensor errors of the tightly coupled navigator; unused by LAISN."""

    transmitters: Literal[2, 3] = Field(3, description="rear and front, or all three")
    clock_offset_sigma_s: NonNegative = Field(
        1e-3, description="σ of the clock offset at the start"
    )
    clock_drift_sigma_ppm: NonNegative = Field(1.0, description="σ of the clock drift")
    slip_m_sqrt_s: NonNegative | None = Field(
        None, description="random walk of unmeasured motion; default: that of the vehicles"
    )
    outlier_probability: Annotated[float, Field(gt=0, lt=1)] = Field(
        TightSettings.outlier_probability, description="probability that a range is an echo's"
    )


@with_fields_of(RivalSettings, excluded={field.name for field in fields(TightSettings)})
class Rival(FurtherKeys):
    """Settings of the rival methods beside the standard deviations of `[navigation.assume]`."""

    particles: Annotated[int, Field(ge=10, le=1_000_000)] = Field(
        RivalSettings.particles, description="particle filter: number of particles"
    )


@with_fields_of(BeaconSettings, excluded={"dt", "hydrophone_height", "known_start"})
@with_fields_of(WaterBeaconSettings, excluded={"known_start"})
class BeaconsTable(FurtherKeys):
    """Settings of the navigator among beacons, `variant = "beacons"`."""

    outlier_probability: Annotated[float, Field(gt=0, lt=1)] = Field(
        WaterBeaconSettings.outlier_probability, description="chance of a wrong range"
    )


class Custom(Section):
    """Settings of an own navigator, `variant = "module:Class"`: fields of its `Settings`, with
    or without unit.
    """

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, ClassValue]


_OF_LAISN_ALONE = {field.name for field in fields(NavigationSettings)} - {
    "variant",
    *(field.name for field in fields(Settings)),
}
"""Settings in `[navigation]` itself, without their units, that navigators with tables of their own
do not read.
"""
_OF_BOUND = {
    *("speed_bias_sigma", "heading_bias_sigma", "range_scale_bias_sigma"),
    *("leader_heading_bias_sigma", "current_sigma", "drift"),
}
"""Settings in `[navigation.assume]`, without their units, that the Cramér–Rao bound takes whatever
the navigator (`reports.bound.noise_of`).
"""
_SECTIONS = ("assume", "rival", "beacons")
"""Tables of settings of other navigators. Keys of `custom` that are none of its class are refused.
"""


@with_fields_of(NavigationSettings, positive={"sigma_a0", "sigma_speed", "sigma_heading"})
class Navigation(FurtherKeys):
    """Navigator of the followers and its settings."""

    if TYPE_CHECKING:

        def __init__(self, **keys: Any) -> None: ...

    variant: Annotated[str, WithJsonSchema({"enum": [*NAVIGATORS, "module:Class"]})] = Field(
        NavigationSettings.variant,
        description="LAISN variant, tightly coupled navigator, or own class",
    )
    link: Name = Field(
        LEADER_LINK,
        description='whose messages the followers navigate on: "leader", or the name of one of '
        "[[links]]",
    )
    further_links: Annotated[tuple[Name, ...], LIST_OR_TUPLE] = Field(
        (), description="of [[links]], which the navigator gets beside"
    )
    assume: AssumeTable = AssumeTable()
    rival: Rival = Rival()
    beacons: BeaconsTable = BeaconsTable()
    custom: Custom | None = None
    sound_speed: Literal["mean", "straight", "profile"] = Field(
        "mean",
        description="by which times become ranges: acoustics.sound_speed_m_s, the profile's mean "
        "between both depths, or rays through the profile",
    )
    use_attitude: bool = Field(
        NavigationSettings.use_attitude,
        description="place transmitters by the broadcast pitch and roll; default with stations: "
        "leader.broadcast_attitude",
    )
    transmitters_m: Annotated[tuple[Offset, ...], LIST_OR_TUPLE, Field(max_length=3)] = Field(
        (),
        description="[[forward, port, up], …], assumed offsets of the transmitters from the "
        "leader's position; "
        "replaces leader.baseline_m and leader.middle_offset_m",
    )
    hydrophone_height_m: Annotated[float, Field(ge=-1000, le=1000)] | None = Field(
        None,
        description="assumed height of the hydrophone above the depth sensor; default: the hull's",
    )

    @property
    def transmitters(self) -> int:
        """How many of the leader's transmitters the navigator uses, rear and front first."""
        section = self._section()
        return (
            int(section["transmitters"])
            if "transmitters" in section
            else transmitters_of(self.variant)
        )

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that the navigator estimates beside biases of its own sensors, as of
        `Settings.estimated`; none of a class in a plugin that is not loaded, as a log may name.
        """
        return self.settings().estimated if is_known(self.variant) else frozenset()

    def hydrophone_height(self, of_hull: float) -> float:
        """How much higher the navigator assumes the hydrophone than the depth sensor [m]: as the
        hull has it, unless a key states another; its code is not imported.
        """
        stated = in_si(self._section()).get("hydrophone_height", self.hydrophone_height_m)
        return of_hull if stated is None else float(stated)

    def reads(self, key: str) -> bool:
        """Whether the navigator, or the bound of its errors, takes a key of this table, such as
        "assume.clock", into account; one of a plugin that is not loaded may take all.
        """
        if not is_known(self.variant):
            return True
        sections = find(self.variant).sections
        section, dot, setting = key.partition(".")
        if section == "assume" and split_unit(setting)[0] in _OF_BOUND:
            return True
        if dot:
            return section in sections
        return not sections or split_unit(key)[0] not in _OF_LAISN_ALONE

    def keys_set(self) -> list[str]:
        """Keys that a navigator may read or not and whose values are not their defaults, those of
        tables with a dot.
        """
        keys = [key for key in self.changed_keys() if split_unit(key)[0] in _OF_LAISN_ALONE]
        for name in _SECTIONS:
            section = getattr(self, name)
            if section is not None:
                keys += [f"{name}.{key}" for key in section.changed_keys()]
        return keys

    def _section(self) -> dict[str, Any]:
        """Keys that belong to the navigator alone; its code is not imported."""
        names = (
            NAVIGATORS[self.variant].sections if self.variant in NAVIGATORS else (CUSTOM_SECTION,)
        )
        sections = (getattr(self, name) for name in names)
        return {
            key: value
            for section in sections
            if section
            for key, value in section.model_dump().items()
        }

    def settings(
        self, defaults: Mapping[str, Any] | None = None, sound_m_s: float = _TYPICAL_SOUND_M_S
    ) -> Settings:
        """Settings of the navigator: `defaults` by the names of fields, replaced by keys of its own
        section.

        `sound_m_s` is the speed of sound that it assumes [m/s], by which its clock's errors [s]
        become those of ranges [m]. LaisnError if there is no such navigator, or a key of `custom`
        is none of its settings.
        """
        spec = find(self.variant)
        field_names = {field.name for field in fields(spec.settings)}
        if CUSTOM_SECTION in spec.sections:
            return self._custom_settings(spec.settings, field_names, defaults or {})
        values = dict(defaults or {})
        for name in spec.sections:
            values |= in_si(dict(getattr(self, name)))
        for name in {"clock_offset_sigma", "clock_drift_sigma"} & set(values):
            # errors of the clock are those of ranges
            values[name] *= sound_m_s
        if not spec.sections:
            values |= in_si(dict(self), field_names)
        if self.variant not in LAISN_VARIANTS:
            # a navigator of one's own without settings of its own is no variant of LAISN
            values.pop("variant", None)
        return _settings_from(spec.settings, values)

    def _custom_settings(
        self, settings_class: type[Settings], field_names: set[str], defaults: Mapping[str, Any]
    ) -> Settings:
        common = frozenset(field.name for field in fields(Settings))
        section = class_arguments(
            settings_class, self.variant, self._section(), "navigation.custom", hidden=common
        )
        values = {
            name: value for name, value in {**defaults, **section}.items() if name in field_names
        }
        try:
            return TypeAdapter(settings_class).validate_python(values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(map(str, ("navigation.custom", *first["loc"])))
            raise LaisnError(f"{key}: {first['msg'].removeprefix('Value error, ')}") from None

    @field_validator("variant")
    @classmethod
    def _known(cls, name: str, info: ValidationInfo) -> str:
        # "module" stands for the only navigator of a plugin, which was loaded when it was flown
        is_stored = STORED.items() <= (info.context or {}).items() and name.isidentifier()
        if name not in NAVIGATORS and not is_stored and not is_plugin_name(name):
            close = difflib.get_close_matches(name.lower(), NAVIGATORS, n=1, cutoff=0.6)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            names = ", ".join(map(repr, NAVIGATORS))
            raise ValueError(f"Input should be {names} or 'module:Class' of a plugin{hint}")
        return name

    @field_validator("transmitters_m")
    @classmethod
    def _two_places(cls, offsets: tuple[Offset, ...]) -> tuple[Offset, ...]:
        if offsets and (len(offsets) < 2 or offsets[0][:2] == offsets[1][:2]):
            raise ValueError(
                "needs a rear and a front transmitter, one before, behind or beside the other"
            )
        return offsets


class FollowerNavigation(Navigation):
    """Navigator of this follower: keys of `[navigation]` whose values are others for it alone."""


def navigation_with(common: Navigation, changes: Navigation) -> Navigation:
    """A navigation with the keys that another one sets in place of its own, also within tables.

    Keys of `custom` are those of one class: with another `variant` none of them is taken over.
    """
    values: dict[str, Any] = {key: getattr(changes, key) for key in changes.model_fields_set}
    for key in values.keys() & {*_SECTIONS}:
        section = getattr(changes, key)
        set_keys = {name: getattr(section, name) for name in section.model_fields_set}
        values[key] = getattr(common, key).model_copy(update=set_keys)
    is_same = values.get("variant", common.variant) == common.variant
    if is_same and common.custom is not None and values.get("custom") is not None:
        extra = {**common.custom.model_dump(), **values["custom"].model_dump()}
        values["custom"] = Custom(**extra)
    elif not is_same:
        values.setdefault("custom", None)
    return common.model_copy(update=values)

"""What a user may set of a follower's navigation, and the settings in SI units that its navigator is made of."""

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal, TypeVar, cast

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, WithJsonSchema, field_validator

from laisn.failure import LaisnError
from laisn.navigators import NAVIGATORS, OWN_SECTION, find, is_own
from laisn.settings import VARIANTS, GateRule, NavigationSettings, Settings, SideRule, transmitters_of
from laisn.tight.settings import TightSettings
from sim.scenario.section import LISTED, Coordinate, NonNegative, Positive, Section

Offset = Annotated[tuple[Coordinate, Coordinate, Coordinate], LISTED]
_PAPER, _SENSORS = NavigationSettings(), TightSettings()
"""The navigators' own defaults, which are a scenario's too."""

_ENDINGS = ("_deg_sqrt_s", "_deg_s", "_deg", "_m_sqrt_s", "_m_s2", "_m_s", "_m2", "_m", "_s")
"""Units that keys end in; longer ones before those that they end in."""
_TYPICAL_SOUND_M_S = 1500.0

Kind = TypeVar("Kind")


def in_si(table: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """Values in SI units and radians by the names of fields, which are those of the keys without their units.

    A key that is the name of a field itself stays as it is; a value of None is left out.
    """
    found = {}
    for key, value in table.items():
        ending = "" if key in names else next((e for e in _ENDINGS if key.endswith(e)), "")
        if value is not None:
            found[key.removesuffix(ending)] = float(np.deg2rad(value)) if ending.startswith("_deg") else value
    return found


def _made(kind: type[Kind], values: Mapping[str, Any]) -> Kind:
    """A dataclass of those values that are fields of it, or of a dataclass in it."""
    given = {}
    for field in fields(kind):  # type: ignore[arg-type]
        inner: Any = field.default_factory
        if is_dataclass(inner):
            given[field.name] = _made(cast("type[Any]", inner), values)
        elif field.name in values:
            given[field.name] = values[field.name]
    return kind(**given)


def _degrees(angle: float) -> float:
    """An angle [rad] as a user would write it in degrees: the same angle to the bit once it is made radians again."""
    return round(float(np.rad2deg(angle)), 9)


class Assume(Section):
    """What the tightly coupled navigator takes as given, and how good it takes its sensors to be; LAISN ignores it."""

    transmitters: Literal[2, 3] = Field(3, description="how many it uses: rear and front, or the middle one too")
    known_start: bool = Field(_SENSORS.known_start, description="the start is given; else the first message gives it")
    exact_leader: bool = Field(
        _SENSORS.assume.exact_leader, description="the leader's compass has no bias; else that is estimated"
    )
    drift: bool = Field(_SENSORS.assume.drift, description="biases of log and compass drift")
    deviation: bool = Field(
        _SENSORS.assume.deviation, description="compasses err by another bias on another heading, by 3 % of a turn"
    )
    current: bool = Field(_SENSORS.assume.current, description="the water moves; the current is estimated")
    offsets: bool = Field(_SENSORS.assume.offsets, description="a transmitter may be early or late by a constant time")
    clock: bool = Field(
        _SENSORS.assume.clock, description="the follower's clock is off and drifts; its error is estimated"
    )
    start_sigma_m: Positive = Field(_SENSORS.start_sigma, description="σ of the start along each axis")
    speed_sigma_m_s: NonNegative = Field(_SENSORS.speed_sigma, description="σ of each reading of the speed log")
    speed_bias_sigma_m_s: NonNegative = Field(
        _SENSORS.speed_bias_sigma, description="σ of the log's bias before the mission"
    )
    heading_sigma_deg: NonNegative = Field(
        _degrees(_SENSORS.heading_sigma), description="σ of each reading of the compass"
    )
    heading_bias_sigma_deg: NonNegative = Field(
        _degrees(_SENSORS.heading_bias_sigma), description="σ of the compass's bias before the mission"
    )
    range_sigma_m: Positive = Field(_SENSORS.range_sigma, description="σ of each range's own error")
    range_scale_sigma_m: NonNegative = Field(
        _SENSORS.range_scale_sigma,
        description="σ of the error that the ranges of a message share in proportion, at the longest",
    )
    range_scale_bias_sigma_m: NonNegative = Field(
        _SENSORS.range_scale_bias_sigma, description="σ of that error's mean before the mission"
    )
    leader_heading_sigma_deg: NonNegative = Field(
        _degrees(_SENSORS.leader_heading_sigma), description="σ of each heading of the leader, if not exact"
    )
    leader_heading_bias_sigma_deg: NonNegative = Field(
        _degrees(_SENSORS.leader_heading_bias_sigma), description="σ of its bias, if not exact"
    )
    current_sigma_m_s: NonNegative = Field(
        _SENSORS.current_sigma, description="σ of the current along each axis, if there may be one"
    )
    offset_sigma_m: NonNegative = Field(
        _SENSORS.offset_sigma, description="σ of a transmitter's offset, if there may be one"
    )
    clock_offset_sigma_s: NonNegative = Field(
        1e-3, description="σ of the clock's offset at the start, if it may be off"
    )
    clock_drift_sigma_ppm: NonNegative = Field(1.0, description="σ of its drift, likewise")
    slip_m_sqrt_s: NonNegative | None = Field(
        None, description="motion that the log does not see, in a second; default: that of the vehicles, 0 of points"
    )
    outlier_chance: Annotated[float, Field(gt=0, lt=1)] = Field(
        _SENSORS.outlier_chance, description="chance that a range is an echo's"
    )
    outlier_span_m: Positive = Field(_SENSORS.outlier_span, description="largest excess of an echo's range")

    def in_si(self, sound_m_s: float) -> dict[str, Any]:
        """Values by the names of `TightSettings`; errors of the clock are ranges there."""
        clock = {
            "clock_offset_sigma": sound_m_s * self.clock_offset_sigma_s,
            "clock_drift_sigma": 1e-6 * sound_m_s * self.clock_drift_sigma_ppm,
        }
        return in_si(dict(self), ()) | clock


class Own(Section):
    """Settings of a navigator of your own, `variant = "module:Class"`: fields of its `Settings`, units may be added."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, bool | int | float | str]


class Navigation(Section):
    """What the follower believes, and how it decides."""

    variant: Annotated[str, WithJsonSchema({"enum": [*NAVIGATORS, "module:Class"]})] = Field(
        _PAPER.variant, description="which LAISN, the tightly coupled navigator, or a class of your own"
    )
    assume: Assume = Assume()
    own: Own | None = None
    threshold_m: NonNegative = Field(_PAPER.threshold, description="T: intersections closer than this are one")
    beta_m2: NonNegative = Field(_PAPER.beta, description="β: σp = β / distance of the intersections")
    sigma_floor_m: NonNegative = Field(_PAPER.sigma_floor, description="smallest σp that the filter is given")
    alpha_m_s2: NonNegative = Field(_PAPER.alpha, description="α: process noise of manoeuvres")
    sigma_a0_m_s2: Positive = Field(_PAPER.sigma_a0, description="σa0: process noise of steady motion")
    sigma_speed_m_s: Positive = Field(_PAPER.sigma_speed, description="σV of the speed update")
    sigma_heading_deg: Positive = Field(_degrees(_PAPER.sigma_heading), description="σθ of the speed update")
    position_sigma0_m: NonNegative = Field(_PAPER.position_sigma0, description="uncertainty of the start")
    velocity_sigma0_m_s: NonNegative = Field(_PAPER.velocity_sigma0, description="uncertainty of the start")
    leader_speed_max_m_s: Positive = Field(_PAPER.leader_speed_max, description="v_max of the leader in γv")
    follower_speed_max_m_s: Positive = Field(
        _PAPER.follower_speed_max, description="v_max of the follower in γv and in the gate"
    )
    gate: GateRule = Field(_PAPER.gate, description="gross-error gate")
    side_rule: SideRule = Field(_PAPER.side_rule, description="where a fix without clear intersections goes")
    use_attitude: bool = Field(
        _PAPER.use_attitude,
        description="place the transmitters by the broadcast pitch and roll; default where followers are on stations: "
        "leader.broadcast_attitude",
    )
    expected_pitch_deg: NonNegative = Field(_degrees(_PAPER.expected_pitch), description="pitch that inflates σp")
    use_single_range: bool = Field(
        _PAPER.use_single_range,
        description="where one range alone arrived, move the estimate along its line of sight; unless it stands here "
        "as false, a replay of a vehicle's log does so",
    )
    transmitters_m: Annotated[tuple[Offset, ...], LISTED, Field(max_length=3)] = Field(
        (),
        description="[[forward, port, up], …] of rear, front and perhaps middle transmitter from the leader's "
        "position, as the follower believes; replaces leader.baseline_m and leader.middle_offset_m",
    )

    hydrophone_height_m: Annotated[float, Field(ge=-1000, le=1000)] | None = Field(
        None,
        description="height of the hydrophone above the depth sensor, as the follower believes; default: the hull's",
    )

    @property
    def transmitters(self) -> int:
        """How many of the leader's transmitters the follower listens to, rear and front first."""
        section = self._section()
        return int(section["transmitters"]) if "transmitters" in section else transmitters_of(self.variant)

    def _section(self) -> dict[str, Any]:
        """Keys that belong to the navigator alone; its code is not imported."""
        name = NAVIGATORS[self.variant].section if self.variant in NAVIGATORS else OWN_SECTION
        section: Section | None = getattr(self, name) if name else None
        return section.model_dump() if section else {}

    def settings(self, given: Mapping[str, Any] | None = None, sound_m_s: float = _TYPICAL_SOUND_M_S) -> Settings:
        """Settings of the navigator.

        Args:
            given: what stands elsewhere, by the names of fields, and counts unless a key of the navigator's own section
                says otherwise: filter step, transmitters, hydrophone …
            sound_m_s: speed of sound as the follower believes, by which errors of a clock become ranges [m/s].

        Raises:
            LaisnError: there is no such navigator, or a key of `own` is none of its settings.
        """
        spec = find(self.variant)
        kind, names = spec.settings, {field.name for field in fields(spec.settings)}
        if spec.section == OWN_SECTION:
            return self._own_settings(kind, dict(given or {}))
        if spec.section:
            return _made(kind, {**(given or {}), **getattr(self, spec.section).in_si(sound_m_s)})
        section = in_si(dict(self), names)
        if self.variant not in VARIANTS:
            # a navigator of one's own without settings of its own
            del section["variant"]
        return _made(kind, {**section, **(given or {})})

    def _own_settings(self, kind: type[Settings], given: dict[str, Any]) -> Settings:
        names = {field.name for field in fields(kind)}
        section = in_si(self._section(), names)
        unknown = set(section) - names
        if unknown:
            available = ", ".join(sorted(names - {field.name for field in fields(Settings)})) or "none"
            raise LaisnError(f"navigation.own: {self.variant} has no {', '.join(sorted(unknown))}; it has: {available}")
        values = {name: value for name, value in {**given, **section}.items() if name in names}
        try:
            return TypeAdapter(kind).validate_python(values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(map(str, ("navigation.own", *first["loc"])))
            raise LaisnError(f"{key}: {first['msg'].removeprefix('Value error, ')}") from None

    @field_validator("variant")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in NAVIGATORS and not is_own(name):
            raise ValueError(f"Input should be {', '.join(map(repr, NAVIGATORS))} or 'module:Class' of your own")
        return name

    @field_validator("transmitters_m")
    @classmethod
    def _two_places(cls, offsets: tuple[Offset, ...]) -> tuple[Offset, ...]:
        if offsets and (len(offsets) < 2 or offsets[0][:2] == offsets[1][:2]):
            raise ValueError("needs a rear and a front transmitter, one before, behind or beside the other")
        return offsets

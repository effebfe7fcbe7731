"""What tables of a scenario file are made of: their common rules, the ranges of their numbers, and time steps."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator

from sim.screen import shortened

Positive = Annotated[float, Field(gt=0, le=1e6)]
NonNegative = Annotated[float, Field(ge=0, le=1e6)]
Angle = Annotated[float, Field(ge=-360, le=360)]
Scale = Annotated[float, Field(ge=0.1, le=10)]
Chance = Annotated[float, Field(ge=0, le=1)]
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Speed = Annotated[float, Field(gt=0, le=5)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
LISTED = Strict(False)
"""Lets a tuple be given as a list too, as a TOML file has it."""
CONTROL_STEP_S = 0.1
"""Interval of the autopilot and of the recorded truth [s]."""
MOST_POINTS = 100_000
"""Most points of a route or a profile: one a second for more than a day."""


def require_increasing(points: Sequence[tuple[float, ...]], what: str, unit: str, begins_at_zero: bool = True) -> None:
    """ValueError naming the first point of a profile whose first number is not more than that of the one before."""
    if begins_at_zero and points and points[0][0] != 0:
        raise ValueError(f"the first {what} must stand at time 0")
    for number, (before, after) in enumerate(pairwise(points), start=2):
        if after[0] <= before[0]:
            order = "later" if unit == "s" else "deeper"
            raise ValueError(f"{what} {number} at {after[0]:g} {unit} is not {order} than the one before")


class Section(BaseModel):
    """A table of the scenario file: unknown keys, NaN and infinity are refused."""

    ORDERED: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of keys of which the first may not be more than the second."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for low, high in self.ORDERED:
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low} = {getattr(self, low):g} is more than {high} = {getattr(self, high):g}")
        return self

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        """What differs from the defaults; all else would fill screens."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if value != field.get_default(call_default_factory=True):
                yield name, shortened(value, 80) if isinstance(value, str) else value


def is_multiple(whole: float, part: float) -> bool:
    """Whether one time is a whole number of another, one at least, but for rounding."""
    ratio = whole / part
    return abs(ratio - round(ratio)) < 1e-9 and round(ratio) >= 1


class Timing(Section):
    """Time steps."""

    physics_step_s: Annotated[float, Field(ge=1e-4, le=0.1)] = Field(
        0.02, description="step of the rigid-body solver; must divide 0.1 s"
    )
    filter_step_s: Positive = Field(0.1, description="filter step Δt; a multiple of 0.1 s")
    message_interval_s: Positive = Field(1.0, description="message interval Δt_D; a multiple of the filter step")

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if not is_multiple(CONTROL_STEP_S, self.physics_step_s):
            raise ValueError(f"physics_step_s = {self.physics_step_s:g} does not divide {CONTROL_STEP_S:g} s")
        if not is_multiple(self.filter_step_s, CONTROL_STEP_S):
            raise ValueError(f"filter_step_s = {self.filter_step_s:g} is no multiple of {CONTROL_STEP_S:g} s")
        if not is_multiple(self.message_interval_s, self.filter_step_s):
            raise ValueError(
                f"message_interval_s = {self.message_interval_s:g} is no multiple of "
                f"filter_step_s = {self.filter_step_s:g}"
            )
        return self

"""What a user may set of time: steps of physics, filter and messages."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from sim.scenario.section import Positive, Section

CONTROL_STEP_S = 0.1
"""Interval of the autopilot and of the recorded truth [s]."""


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

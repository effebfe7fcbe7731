"""What a replay among beacons may be told: the medium, and whatever differs from what that suggests."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from laisn.beacons.settings import BeaconSettings
from laisn.failure import LaisnError
from sim.scenario.navigation import in_si
from sim.scenario.section import NonNegative, Positive, Section


class Beacons(Section):
    """What is known of odometry and ranges; keys that are not given follow the medium."""

    medium: Literal["auto", "air", "water"] = Field(
        "auto", description="what ranges are measured through; auto: tries both, and believes the likelier one"
    )
    known_start: bool = Field(True, description="the start is that of the data set; else the first ranges give it")
    start_sigma_m: Positive | None = Field(None, description="σ of the start along each axis")
    heading_sigma_deg: NonNegative | None = Field(None, description="σ of the heading at the start")
    gyro_bias_sigma_deg_s: NonNegative | None = Field(None, description="σ of a gyro's drift; 0 for a compass")
    speed_scale_sigma: NonNegative | None = Field(None, description="σ of the logarithm of true over measured speed")
    slip_m_sqrt_s: NonNegative | None = Field(None, description="motion that odometry does not see, in a second")
    heading_walk_deg_sqrt_s: NonNegative | None = Field(None, description="random walk of the heading, in a second")
    current_sigma_m_s: NonNegative | None = Field(None, description="σ of a current along each axis")
    range_sigma_m: Positive | None = Field(None, description="σ of a range; default: the data set's, or 0.5 m")
    range_scale_sigma: NonNegative | None = Field(None, description="σ of the scale that all ranges share")
    range_offset_sigma_m: NonNegative | None = Field(None, description="σ of each beacon's constant error")
    survey_sigma_m: NonNegative | None = Field(None, description="σ of each beacon's place along each axis")
    outlier_chance: Annotated[float, Field(gt=0, lt=1)] | None = Field(None, description="chance of a wrong range")
    outlier_span_m: Positive | None = Field(None, description="width of the span in which wrong ranges lie")

    def over(self, base: BeaconSettings) -> BeaconSettings:
        """Settings with what is given here instead of what stands there."""
        return replace(base, **in_si(self.model_dump(exclude={"medium"}), ()))


def beacons_of(values: Mapping[str, object]) -> Beacons:
    """Settings by their keys.

    Raises:
        LaisnError: a key is not known or a value out of its range; the text names all that are at fault.
    """
    try:
        return Beacons.model_validate(dict(values))
    except ValidationError as error:
        lines = []
        for fault in error.errors():
            key = ".".join(str(part) for part in fault["loc"][:1])
            known = "" if key in Beacons.model_fields else f"; known: {', '.join(Beacons.model_fields)}"
            lines.append(f"  beacons.{key}: {fault['msg']}{known}")
        raise LaisnError("\n".join(["settings of beacons:", *lines])) from None

"""What a user may set of the water: current, waves, floor."""

from typing import Annotated, Literal

from pydantic import Field

from sim.scenario.section import Angle, Section

FASTEST_CURRENT_M_S = 3.0
"""Faster water would carry away what can swim at 3 m/s."""


class Waves(Section):
    """Surface waves (linear)."""

    kind: Literal["none", "regular", "jonswap"] = "none"
    height_m: Annotated[float, Field(ge=0, le=20)] = Field(
        0.5, description="height H of regular waves, significant height Hs of a sea"
    )
    period_s: Annotated[float, Field(gt=0.5, le=30)] = Field(4.0, description="period T, or peak period Tp")
    direction_deg: Angle = Field(90.0, description="compass direction that the waves run towards")
    peak_enhancement: Annotated[float, Field(ge=1, le=10)] = Field(3.3, description="γ of JONSWAP")
    components: Annotated[int, Field(ge=1, le=200)] = Field(100, description="number of components of a sea")
    spreading_deg: Annotated[float, Field(ge=0, le=60)] = Field(
        0.0, description="standard deviation of the directions of a sea"
    )


class Ocean(Section):
    """Water and sea floor."""

    density_kg_m3: Annotated[float, Field(ge=950, le=1100)] = 1026.0
    floor_depth_m: Annotated[float, Field(ge=2, le=11000)] = Field(30.0, description="depth of the sea floor")
    current_speed_m_s: Annotated[float, Field(ge=0, le=3)] = Field(0.0, description="current at the surface")
    current_direction_deg: Angle = Field(0.0, description="compass direction that the current runs towards")
    current_shear_per_s: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0, description="decrease of the current with depth"
    )
    waves: Waves = Waves()

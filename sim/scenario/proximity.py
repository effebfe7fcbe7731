"""Short-range sensing of other vehicles, and how followers on stations give way by it."""

from typing import Annotated

from pydantic import Field

from sim.scenario.section import NonNegative, Section, Speed


class Proximity(Section):
    """What followers on stations sense of vehicles nearby, and how they give way; without it they do neither."""

    range_m: Annotated[float, Field(gt=0, le=100)] = Field(
        5.0, description="vehicles nearer than this are sensed, from middle to middle; giving way begins there"
    )
    range_sigma_m: NonNegative = Field(0.1, description="standard deviation of a range")
    bearing_sigma_deg: Annotated[float, Field(ge=0, le=180)] = Field(
        3.0, description="standard deviation of a bearing, which is relative to the hull"
    )
    period_s: Annotated[float, Field(ge=0.1, le=60)] = Field(
        0.5, description="time from one look to the next; a multiple of 0.1 s"
    )
    aperture_deg: Annotated[float, Field(gt=0, le=180)] = Field(
        20.0, description="opening of the fan from top to bottom, about the horizontal"
    )
    full_m: NonNegative = Field(3.0, description="at this range and nearer, a follower gives way at full speed")
    give_way_m_s: Speed = Field(0.8, description="that speed, added to the one that leads to its station")

"""What a user may set of the water: current, waves, floor."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from laisn.arrays import Floats
from sim.scenario.section import LISTED, MOST_POINTS, Angle, NonNegative, Section, require_increasing

FASTEST_CURRENT_M_S = 3.0
"""Faster water would carry away vehicles with 3 m/s."""


CurrentSpeed = Annotated[float, Field(ge=0, le=FASTEST_CURRENT_M_S)]
TimedCurrent = Annotated[tuple[NonNegative, CurrentSpeed, Angle], LISTED]


class Waves(Section):
    """Surface waves (linear)."""

    kind: Literal["none", "regular", "jonswap"] = "none"
    height_m: Annotated[float, Field(ge=0, le=20)] = Field(
        0.5, description="height H of regular waves, significant height Hs of JONSWAP"
    )
    period_s: Annotated[float, Field(gt=0.5, le=30)] = Field(4.0, description="period T, or peak period Tp")
    direction_deg: Angle = Field(90.0, description="compass direction of propagation")
    peak_enhancement: Annotated[float, Field(ge=1, le=10)] = Field(3.3, description="γ of JONSWAP")
    components: Annotated[int, Field(ge=1, le=200)] = Field(100, description="number of JONSWAP components")
    spreading_deg: Annotated[float, Field(ge=0, le=60)] = Field(0.0, description="σ of JONSWAP directions")


class Ocean(Section):
    """Water and sea floor."""

    density_kg_m3: Annotated[float, Field(ge=950, le=1100)] = 1026.0
    floor_depth_m: Annotated[float, Field(ge=2, le=11000)] = Field(30.0, description="depth of the sea floor")
    current_speed_m_s: CurrentSpeed = Field(0.0, description="current at the surface")
    current_direction_deg: Angle = Field(0.0, description="compass direction towards which it flows")
    current_shear_per_s: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0, description="decrease of the current with depth"
    )
    current_profile: Annotated[tuple[TimedCurrent, ...], LISTED] = Field(
        (),
        max_length=MOST_POINTS,
        description="[[time_s, speed_m_s, direction_deg], …] of the surface current, components interpolated "
        "linearly, constant after the last; replaces current_speed_m_s and, except for shear, "
        "current_direction_deg",
    )
    waves: Waves = Waves()

    @field_validator("current_profile")
    @classmethod
    def _times_increase(cls, points: tuple[TimedCurrent, ...]) -> tuple[TimedCurrent, ...]:
        require_increasing(points, "current", "s")
        return points

    @property
    def moves(self) -> bool:
        """Whether there is a current at the surface."""
        return any(speed for _, speed, _ in self.current_profile or [(0.0, self.current_speed_m_s, 0.0)])

    def current_change(self) -> Floats:
        """The profile as time [s], east and north [m/s], shape (n, 3)."""
        points = np.reshape(self.current_profile, (-1, 3))
        towards = np.deg2rad(points[:, 2])
        return np.column_stack([points[:, 0], points[:, 1] * np.sin(towards), points[:, 1] * np.cos(towards)])

    def current_at(self, depth: Floats | float, time: Floats | float) -> Floats:
        """Current, east and north; depth [m] and time [s] broadcast to the leading shape of the answer, [m/s]."""
        towards = np.deg2rad(self.current_direction_deg)
        speed = 0.0 if self.current_profile else self.current_speed_m_s
        along = np.asarray(speed - self.current_shear_per_s * np.asarray(depth))
        steady = along[..., None] * np.array([np.sin(towards), np.cos(towards)])
        if not self.current_profile:
            return np.asarray(steady)
        change = self.current_change()
        return np.asarray(steady + np.stack([np.interp(time, change[:, 0], part) for part in change.T[1:]], axis=-1))

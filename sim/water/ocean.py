"""The settings of a sea, and the `Environment` that they make."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from laisn.arrays import Floats, freeze_arrays
from sim.water.currents import ACCELERATION, DISPLACEMENT, START, VELOCITY, ShearedCurrent
from sim.water.custom import CustomCaller
from sim.water.densities import DensityProfile, UniformDensity
from sim.water.environment import Environment, water_velocity
from sim.water.floors import LevelFloor
from sim.water.grids import GriddedFloor
from sim.water.rays import SoundProfile, StraightRays
from sim.water.refraction import RefractedRays
from sim.water.waves import FLOOR_DEPTH_M, Waves, WaveTrain

_SOUND_SPEED_M_S = 1500.0  # unless it is given


@dataclass(frozen=True, kw_only=True)
class Ocean:
    """Current, waves, density, depth and speed of sound of a sea."""

    current_speed_m_s: float = 0.0  # speed of the current at the surface
    current_direction_rad: float = 0.0  # compass direction that the current runs towards
    current_shear_1_s: float = 0.0  # loss of speed per metre of depth
    added_current: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """Velocity V that is added at all depths: time [s], east and north [m/s], shape (m, 3), times
    increasing from 0; linear between the points, constant after the last."""
    current: Any = None  # another current in place of that of these fields
    custom: CustomCaller | None = None  # or one of the user's own
    density_kg_m3: float = 1026.0
    density: DensityProfile | None = None  # by depth, in place of that
    trim_depth_m: float | None = None
    """Depth [m] for whose density the hulls' buoyancy is stated; None: for each hull that at which
    it starts.
    """
    floor_depth_m: float = FLOOR_DEPTH_M  # that waves feel
    floor: LevelFloor | GriddedFloor | None = None  # None: a level one of this depth
    waves: Waves = field(default_factory=Waves.none)  # made for the same depth
    rays: StraightRays | RefractedRays | None = (
        None  # None: a speed of sound of 1500 m/s everywhere
    )

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def _flow_direction(self) -> Floats:
        direction = self.current_direction_rad
        return np.array([np.sin(direction), np.cos(direction)])

    def _sheared_current(self) -> ShearedCurrent:
        """The current that the fields describe, in floats: for other types the code would be
        compiled again.
        """
        east, north = self._flow_direction
        surface = (self.current_speed_m_s * east, self.current_speed_m_s * north)
        shear = (self.current_shear_1_s * east, self.current_shear_1_s * north)
        return ShearedCurrent(surface, shear, change_table(self.added_current))

    @cached_property
    def environment(self) -> Environment:
        """The sea as compiled functions take it."""
        surface_current = (0.0, 0.0)
        current = self.current
        if self.custom is not None:
            current = self.custom.compiled_current
        elif current is None:
            current = self._sheared_current()
            surface_current = current.surface
        floor = self.floor or LevelFloor(float(self.floor_depth_m))
        rays = self.rays
        if rays is None:
            rays = StraightRays(SoundProfile.through([[0.0, _SOUND_SPEED_M_S]]), False, floor)
        return Environment(
            current=current,
            waves=WaveTrain.on(self.waves, surface_current, self.floor_depth_m),
            floor=floor,
            rays=rays,
            density_model=self.density or UniformDensity(float(self.density_kg_m3)),
        )

    def trim_density(self, depth: float) -> float:
        """Density [kg/m³] for which the buoyancy of a hull is stated that starts at a depth [m]."""
        if self.density is None:
            return self.density_kg_m3
        return self.density.density_at(depth if self.trim_depth_m is None else self.trim_depth_m)

    def velocity(self, position: Floats, time: float) -> Floats:
        """Velocity of the water in the world at points of shape (n, 3), [m]; the answer
        likewise, [m/s].
        """
        out = np.empty(position.shape)
        water_velocity(self.environment, position, time, out)
        self.raise_custom_error()
        return out

    def raise_custom_error(self) -> None:
        """Raise what a current of the user's own has raised when compiled code called it."""
        if self.custom is not None:
            self.custom.raise_error()


def change_table(points: Floats) -> Floats:
    """The changing part of a current as `sim.water.currents.drift_at` takes it, shape (m, 7),
    columns START, VELOCITY, ACCELERATION, DISPLACEMENT, from points of time [s] and velocity, east
    and north [m/s], shape (m, 3).
    """
    time = points[:, 0]
    velocity = points[:, 1:]
    table = np.zeros((time.size, 7))
    dt = np.diff(time)[:, None]
    table[:, START] = time
    table[:, VELOCITY] = velocity
    table[:-1, ACCELERATION] = np.diff(velocity, axis=0) / dt
    table[1:, DISPLACEMENT] = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt, axis=0)
    return table

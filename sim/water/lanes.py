"""The sea about vehicles side by side (`laisn.simd`), one in each lane.

Currents that are linear in depth, and waves, are computed in lanes and may differ between them. A
field or a profile is the same for all lanes and is asked lane by lane, since each looks at another
place of it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, have_same_bits
from laisn.compiled import compiled, method_by_type
from laisn.simd import LANES, in_lanes, lanes_of
from sim.attitude import Vector
from sim.water.currents import CurrentFlow, Drift, ShearedCurrent
from sim.water.densities import DensityProfile, UniformDensity
from sim.water.environment import Environment
from sim.water.grids import GriddedCurrent, GriddedInstant
from sim.water.waves import CalmSurface, LaneWaves, WaveTrain

method_by_type("current_of_lanes")
method_by_type("surface_of_lanes")


class ShearedMemory(NamedTuple):
    """A `ShearedCurrent` in each lane, the lanes along the last axis."""

    surface: Floats  # shape (2, LANES), as the next
    shear: Floats
    change: Floats  # the same in all lanes

    @compiled
    def current_of_lanes(self) -> ShearedCurrent:
        """The current about all vehicles."""
        surface = lanes_of(self.surface)
        shear = lanes_of(self.shear)
        return ShearedCurrent((surface[0], surface[1]), (shear[0], shear[1]), self.change)


class FieldInstant(NamedTuple):
    """A `FieldMemory` at one time."""

    drift: Drift
    instant: GriddedInstant
    questions: Floats  # as of `FieldMemory`, as the next
    answers: Floats

    @compiled
    def flow(self, position: Vector, velocity: Vector) -> CurrentFlow:
        """As of `sim.water.currents.ShearedInstant.flow`, in lanes."""
        asked = lanes_of(self.questions)
        asked[0] = position[0]
        asked[1] = position[1]
        asked[2] = position[2]
        asked[3] = velocity[0]
        asked[4] = velocity[1]
        asked[5] = velocity[2]
        q = self.questions
        out = self.answers
        for lane in range(LANES):
            place = (q[0, lane], q[1, lane], q[2, lane])
            water = self.instant.flow(place, (q[3, lane], q[4, lane], q[5, lane]))
            for i in range(3):
                out[i, lane] = water.velocity[i]
                out[3 + i, lane] = water.rate[i]
                for j in range(3):
                    out[6 + 3 * i + j, lane] = water.gradient[i][j]
        a = lanes_of(out)
        gradient = ((a[6], a[7], a[8]), (a[9], a[10], a[11]), (a[12], a[13], a[14]))
        return CurrentFlow((a[0], a[1], a[2]), (a[3], a[4], a[5]), gradient)


class FieldMemory(NamedTuple):
    """A current on a grid, the same about all lanes."""

    current: GriddedCurrent
    questions: Floats  # room for place [m] and velocity [m/s] in each lane, shape (6, LANES)
    answers: Floats  # room for a `CurrentFlow` in each lane, shape (15, LANES)

    @compiled
    def current_of_lanes(self) -> "FieldMemory":
        """The current about all vehicles."""
        return self

    @compiled
    def at_time(self, time: float) -> FieldInstant:
        """The current at a time [s]."""
        instant = self.current.at_time(time)
        return FieldInstant(instant.drift, instant, self.questions, self.answers)


class ProfileMemory(NamedTuple):
    """A density that depends on depth, the same about all lanes."""

    profile: DensityProfile
    room: Floats  # for depth [m] and density [kg/m³] in each lane, shape (2, LANES)

    @compiled
    def relative_density_at(self, depth: float, reference: float) -> float:
        """As of `DensityProfile`, in lanes."""
        depths_and_densities = lanes_of(self.room)
        depths_and_densities[0] = depth
        for lane in range(LANES):
            self.room[1, lane] = self.profile.density_at(self.room[0, lane])
        return float(depths_and_densities[1] / reference)


class CalmMemory(NamedTuple):
    """A surface without waves in all lanes."""

    highest: float = 0.0

    @compiled
    def surface_of_lanes(self) -> CalmSurface:
        """The surface over all vehicles."""
        return CalmSurface(self.highest)


class WaveMemory(NamedTuple):
    """Waves over each lane, the lanes along the last axis."""

    components: Floats  # as of `WaveTrain`, shape (12, n, LANES)
    floor_depth: Floats  # [m], shape (1, LANES), as the next
    highest: Floats  # [m]
    one_way: bool  # the same for all
    room: Floats  # for orbits, shape (4, n, LANES)

    @compiled
    def surface_of_lanes(self) -> LaneWaves:
        """The surface over all vehicles."""
        return LaneWaves(
            lanes_of(self.components),
            lanes_of(self.floor_depth)[0],
            lanes_of(self.highest)[0],
            self.one_way,
            lanes_of(self.room),
        )


class SeaMemory(NamedTuple):
    """Current, waves and density in lanes."""

    current: ShearedMemory | FieldMemory
    waves: CalmMemory | WaveMemory
    density: UniformDensity | ProfileMemory


def sea_suits_lanes(sea: Environment) -> bool:
    """Whether vehicles may move in lanes in a sea: not in a current of the user's own, which is
    written for numbers.
    """
    return isinstance(sea.current, ShearedCurrent | GriddedCurrent)


def is_steady(sea: Environment) -> bool:
    """Whether nothing in a sea depends on time, as far as can be told by its kinds."""
    is_calm = isinstance(sea.waves, WaveTrain) and sea.waves.components.shape[1] == 0
    return is_calm and isinstance(sea.current, ShearedCurrent) and len(sea.current.change) == 0


def _currents_in_lanes(
    currents: Sequence[ShearedCurrent | GriddedCurrent],
) -> ShearedMemory | FieldMemory:
    first = currents[0]
    if isinstance(first, GriddedCurrent):
        if not all(have_same_bits(each, first) for each in currents):
            raise ValueError("fields of the current differ")
        return FieldMemory(first, np.zeros((6, LANES)), np.zeros((15, LANES)))
    sheared = [each for each in currents if isinstance(each, ShearedCurrent)]
    if len(sheared) < len(currents) or any(
        not have_same_bits(each.change, first.change) for each in sheared
    ):
        raise ValueError("currents change otherwise")
    return ShearedMemory(
        surface=in_lanes([np.array(each.surface) for each in sheared]),
        shear=in_lanes([np.array(each.shear) for each in sheared]),
        change=first.change,
    )


def _densities_in_lanes(
    densities: Sequence[UniformDensity | DensityProfile],
) -> UniformDensity | ProfileMemory:
    first = densities[0]
    if all(isinstance(each, UniformDensity) for each in densities):
        # hulls are made for the density of their lane, which no force depends on besides
        return UniformDensity(0.0)
    if not isinstance(first, DensityProfile) or any(
        not have_same_bits(each, first) for each in densities
    ):
        raise ValueError("profiles of density differ")
    return ProfileMemory(first, np.zeros((2, LANES)))


def _waves_in_lanes(trains: Sequence[WaveTrain]) -> CalmMemory | WaveMemory:
    components = in_lanes([train.components for train in trains])
    n = components.shape[1]
    if n == 0:
        return CalmMemory()
    one_way = trains[0].one_way
    if any(train.one_way != one_way for train in trains):
        raise ValueError("some waves run one way")
    return WaveMemory(
        components=components,
        floor_depth=in_lanes([np.array([train.floor_depth]) for train in trains]),
        highest=in_lanes([np.array([train.highest]) for train in trains]),
        one_way=one_way,
        room=np.empty((4, n, LANES)),
    )


def sea_memory_of(seas: Sequence[Environment]) -> SeaMemory:
    """Up to eight seas as of `sea_suits_lanes` side by side; ValueError if they differ in more than
    numbers, or in a field or a profile.
    """
    return SeaMemory(
        current=_currents_in_lanes([sea.current for sea in seas]),
        waves=_waves_in_lanes([sea.waves for sea in seas]),
        density=_densities_in_lanes([sea.density_model for sea in seas]),
    )


@compiled
def sea_of_lanes(memory: SeaMemory) -> Environment:
    """The sea as far as vehicles in lanes move in it: without floor and sound."""
    current = memory.current.current_of_lanes()
    return Environment(current, memory.waves.surface_of_lanes(), 0.0, 0.0, memory.density)

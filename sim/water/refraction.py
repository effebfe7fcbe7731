"""Rays that bend, as an `Environment` has them: by a table for missions, traced for a look at one.

The direct ray meets neither surface nor floor, the surface echo meets the surface once, the bottom
echo the floor once. Of several the one that arrives first is taken; where there is none, nothing is
received by that path.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled, jitable
from sim.attitude import Vector
from sim.water.eigenrays import (
    MAX_RAYS,
    MIN_CLEARANCE_M,
    NO_RAY,
    Eigenray,
    PathInWater,
    drop,
    earliest,
    eigenrays,
    may_turn,
    refine,
    straight_slowness,
)
from sim.water.floors import LevelFloor
from sim.water.grids import GriddedFloor
from sim.water.ray_table import RayTable, ray_slowness, table_of
from sim.water.rays import Path, Ray, distance, image
from sim.water.smooth_profile import SmoothProfile, speed_and_gradient
from sim.water.table_store import stored_table

# compiled code holds numbers, not the members of an enum
_DIRECT, _SURFACE, _BOTTOM = map(int, Path)


class RefractedRays(NamedTuple):
    """Rays that bend in a speed of sound that depends on depth."""

    profile: SmoothProfile
    varies: bool
    floor: Any  # as `sim.water.floors.LevelFloor`
    deepest: float  # of the floor [m]
    direct: RayTable
    surface: RayTable
    bends: bool = True  # so that each slowness takes longer to find than that of a straight ray

    @jitable
    def apparent_source(self, path: int, source: Vector, receiver: Vector) -> Vector:
        """Place from which sound would seem to come that takes a path, if it ran straight [m]."""
        return image(source, path, receiver, self.floor)

    @compiled
    def slowness(self, path: int, source: Vector, receiver: Vector) -> float:
        """Time by the length of the straight path [s/m]; NaN if there is no ray."""
        leg = leg_of(self, path, source, receiver)
        if path == _DIRECT:
            return ray_slowness(self.direct, leg.water, leg.source, leg.receiver, leg.distance)
        if path == _SURFACE:
            return ray_slowness(self.surface, leg.water, leg.source, leg.receiver, leg.distance)
        return bottom_slowness(leg)

    @compiled
    def straight_slowness(self, path: int, source: Vector, receiver: Vector) -> float:
        """Mean of 1/c over the depths that a path crosses [s/m]."""
        leg = leg_of(self, path, source, receiver)
        return straight_slowness(leg.water, leg.source, leg.receiver)

    def speed(self, depth: float) -> float:
        """Speed of sound at a depth [m/s]."""
        return float(speed_and_gradient(self.profile, depth, 0)[0])

    def ray(self, path: int, source: Vector, receiver: Vector) -> Ray:
        """The ray of a path that arrives first, traced; NaN if there is none."""
        leg = leg_of(self, path, source, receiver)
        eigenray, _ = earliest(leg.water, leg.source, leg.receiver, leg.distance)
        return self._ray(path, source, receiver, leg, eigenray)

    def rays(self, path: int, source: Vector, receiver: Vector) -> tuple[Ray, ...]:
        """All rays of a path, the first to arrive first."""
        leg = leg_of(self, path, source, receiver)
        rows = np.empty((MAX_RAYS, len(Eigenray._fields)))
        count = eigenrays(leg.water, leg.source, leg.receiver, leg.distance, rows)
        in_order = sorted(rows[:count].tolist())
        return tuple(
            self._ray(path, source, receiver, leg, Eigenray(*numbers)) for numbers in in_order
        )

    def _ray(
        self, path: int, source: Vector, receiver: Vector, leg: "Leg", eigenray: Eigenray
    ) -> Ray:
        length = distance(self.apparent_source(path, source, receiver), receiver)
        level_length = math.hypot(leg.distance, drop(leg.water, leg.source, leg.receiver))
        time = eigenray.time
        if path == _BOTTOM and level_length > 0.0:
            # over a sloping floor a ray bends as over a level one
            time *= length / level_length
        # rays leave downwards at positive angles, and arrive from above at positive ones, too
        return Ray(Path(path), length, time, eigenray.arrival_angle, eigenray.departure_angle)


class Leg(NamedTuple):
    """A path between two depths, as its rays are found."""

    water: PathInWater
    source: float  # depth, between surface and floor [m]
    receiver: float  # likewise
    distance: float  # horizontal distance [m]


@compiled
def leg_of(rays: RefractedRays, path: int, source: Vector, receiver: Vector) -> Leg:
    """A path between two places; one above the surface or below the floor counts as just
    within the water."""
    floor = rays.floor.reflection(source, receiver).depth if path == _BOTTOM else rays.deepest
    water = PathInWater(rays.profile, floor, int(path == _SURFACE), int(path == _BOTTOM))
    return Leg(
        water,
        min(max(-source[2], MIN_CLEARANCE_M), floor - MIN_CLEARANCE_M),
        min(max(-receiver[2], MIN_CLEARANCE_M), floor - MIN_CLEARANCE_M),
        math.hypot(receiver[0] - source[0], receiver[1] - source[1]),
    )


@compiled
def bottom_slowness(leg: Leg) -> float:
    """Time of the bottom echo by the length of its straight path [s/m]: of the ray that leaves
    nearly as the straight one, where that leads to one.
    """
    depth_change = drop(leg.water, leg.source, leg.receiver)
    length = math.hypot(leg.distance, depth_change)
    if length == 0.0:
        return straight_slowness(leg.water, leg.source, leg.receiver)
    ray = NO_RAY
    if may_turn(leg.water.profile, leg.distance, depth_change):
        upper = min(leg.source, leg.receiver)
        lower = max(leg.source, leg.receiver)
        ray = refine(leg.water, upper, lower, leg.distance, math.atan2(depth_change, leg.distance))
    if ray.time != ray.time:
        ray = earliest(leg.water, leg.source, leg.receiver, leg.distance)[0]
    return ray.time / length


_NO_TABLE = RayTable(
    np.zeros(1), 1.0, np.zeros((1, 1, 1, 8)), np.zeros((1, 1, 1)), np.zeros((0, 0, 0), np.uint8)
)


@lru_cache(maxsize=8)
def _table(
    points: tuple[tuple[float, float], ...],
    floor: float,
    by_surface: int,
    depth: float,
    distance: float,
) -> RayTable:
    def compute() -> RayTable:
        return table_of(
            PathInWater(SmoothProfile.through(points), floor, by_surface, 0), depth, distance
        )

    return stored_table([points, floor, by_surface, depth, distance], compute)


class Extent(NamedTuple):
    """Depth and horizontal distance that a table of rays covers; rays beyond are traced, which
    takes a thousand times as long.
    """

    depth: float  # [m]
    distance: float  # [m]

    def rounded(self, floor: float) -> "Extent":
        """One that similar missions share, above a floor [m]."""
        steps = [step for step in _TABLE_DISTANCES_M if step >= self.distance]
        return Extent(
            min(5.0 * math.ceil(self.depth / 5.0), floor),
            steps[0] if steps else _TABLE_DISTANCES_M[-1],
        )


_TABLE_DISTANCES_M = (
    25.0,
    50.0,
    75.0,
    100.0,
    150.0,
    200.0,
    300.0,
    400.0,
    600.0,
    800.0,
    1200.0,
    2000.0,
)


def refracted_rays(
    points: npt.ArrayLike, floor: LevelFloor | GriddedFloor, extent: Extent, *, surface_echoes: bool
) -> RefractedRays:
    """Rays in a speed of sound through points [[depth, speed], …], shape (n, 2), [m] and [m/s].

    `floor` is as `sim.water.floors.LevelFloor`. Tables are computed once for the same numbers, and
    stored for later processes; that of surface echoes if they are wanted.
    """
    numbers = np.array(points, dtype=np.float64)
    key = tuple(map(tuple, numbers.tolist()))
    deepest = float(floor.deepest)
    covered = extent.rounded(deepest)
    direct, surface = (
        _table(key, deepest, by_surface, *covered) if is_wanted else _NO_TABLE
        for by_surface, is_wanted in enumerate((True, surface_echoes))
    )
    return RefractedRays(SmoothProfile.through(numbers), True, floor, deepest, direct, surface)


def traced_rays(points: npt.ArrayLike, floor: LevelFloor | GriddedFloor) -> RefractedRays:
    """The same without tables: each ray is traced."""
    profile = SmoothProfile.through(points)
    return RefractedRays(profile, True, floor, float(floor.deepest), _NO_TABLE, _NO_TABLE)

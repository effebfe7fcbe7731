"""How sound gets from one place to another: rays, their lengths and the mean slowness along them.

Rays are straight: their mean slowness is the mean of 1/c over the depths they cross (Medwin & Clay,
Fundamentals of Acoustical Oceanography, 1998). A boundary sends an echo that seems to come from the
mirror image of its source (ibid.): a floor that is not level reflects it as the plane does that
touches the floor where the sound meets it.

Rays are a NamedTuple with the methods `apparent_source(path, source, receiver)`,
`slowness(path, source, receiver)` and `straight_slowness`, the same as if rays did not bend, which
compiled code chooses by its type. Those that bend are in `sim.water.refraction`.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import formula, jitable, method_by_type
from sim.attitude import Vector

method_by_type("apparent_source")
method_by_type("slowness")
method_by_type("straight_slowness")

# smaller depth steps have the slowness of their middle: quotients of small differences round [m]
_MIN_DEPTH_STEP_M = 1e-3


class SoundProfile(NamedTuple):
    """Speed of sound, linear between n depths and constant above the first and below the last."""

    depth: Floats  # shape (n,), increasing, [m]
    speed: Floats  # speed of sound at each depth, shape (n,), [m/s]
    crossing: Floats  # time to cross vertically from the first depth to each, shape (n,), [s]

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, speed], …], shape (n, 2), [m] and [m/s]; one point is a constant
        speed.
        """
        depth, speed = np.array(points, dtype=np.float64).T.copy()
        delays = [_relative_layer_time(growth) for growth in (np.diff(speed) / speed[:-1]).tolist()]
        layers = np.diff(depth) / speed[:-1] * np.array(delays)
        return cls(depth, speed, np.concatenate([[0.0], np.cumsum(layers)]))


@formula
def _relative_layer_time(growth: float) -> float:
    """ln(1 + g) / g: time through a layer whose speed grows by a share g, over the time at its
    first speed.
    """
    return math.log1p(growth) / growth if growth != 0.0 else 1.0


@jitable
def _layer(p: SoundProfile, depth: float) -> int:
    """Index of the last depth of the profile that is not below another one; 0, if that is above
    all.
    """
    i = 0
    while i + 1 < p.depth.size and p.depth[i + 1] <= depth:
        i += 1
    return i


@jitable
def speed_at(p: SoundProfile, depth: float) -> float:
    """Speed of sound at a depth [m/s]."""
    i = _layer(p, depth)
    if i + 1 == p.depth.size or depth <= p.depth[i]:
        return float(p.speed[i])
    share = (depth - p.depth[i]) / (p.depth[i + 1] - p.depth[i])
    return float(p.speed[i] + share * (p.speed[i + 1] - p.speed[i]))


@jitable
def _vertical_time(p: SoundProfile, depth: float) -> float:
    """Time of a vertical ray from the first depth of the profile down to another one [s]."""
    i = _layer(p, depth)
    growth = (speed_at(p, depth) - p.speed[i]) / p.speed[i]
    return float(p.crossing[i] + (depth - p.depth[i]) / p.speed[i] * _relative_layer_time(growth))


@jitable
def mean_slowness(p: SoundProfile, upper: float, lower: float) -> float:
    """Mean of 1/c between two depths, in either order [s/m]."""
    if abs(lower - upper) < _MIN_DEPTH_STEP_M:
        return 1.0 / speed_at(p, 0.5 * (upper + lower))
    return (_vertical_time(p, lower) - _vertical_time(p, upper)) / (lower - upper)


class Path(IntEnum):
    """How the sound came; index into arrays over paths."""

    DIRECT = 0
    SURFACE = 1
    BOTTOM = 2


# compiled code holds numbers, not the members of an enum
_DIRECT, _SURFACE, _BOTTOM = map(int, Path)


@jitable
def distance(a: Vector, b: Vector) -> float:
    """Distance of two places [m]."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)


@jitable
def image(source: Vector, path: int, receiver: Vector, floor: Any) -> Vector:
    """Place from which sound seems to come that takes a path [m]."""
    if path == _DIRECT:
        return source[0], source[1], source[2]
    if path == _SURFACE:
        return source[0], source[1], -source[2]
    return floor.reflection(source, receiver).image  # type: ignore[no-any-return]


@jitable
def path_slowness(
    profile: SoundProfile, path: int, source: Vector, receiver: Vector, floor: Any
) -> float:
    """Mean of 1/c along a path that is straight but for its reflection, between two places
    [s/m].
    """
    source_depth = -source[2]
    receiver_depth = -receiver[2]
    if path == _DIRECT:
        return mean_slowness(profile, source_depth, receiver_depth)
    # at the surface both ways have the same slope, so that they share the path in proportion to the
    # depths that they cross
    boundary = 0.0
    first = abs(source_depth)
    second = abs(receiver_depth)
    if path == _BOTTOM:
        reflection = floor.reflection(source, receiver)
        boundary = reflection.depth
        first = reflection.way_down
        second = reflection.way_up
    if first + second == 0.0:
        return 1.0 / speed_at(profile, boundary)
    down = first * mean_slowness(profile, source_depth, boundary)
    up = second * mean_slowness(profile, receiver_depth, boundary)
    return (down + up) / (first + second)


class Ray(NamedTuple):
    """How sound gets by one path from a place to another, both at rest."""

    path: Path
    length: float  # of the straight path [m]
    time: float  # [s]
    elevation: float  # of the ray where it arrives, positive where it comes from above [rad]
    departure: float  # angle at which it leaves, positive downwards [rad]


def _elevation(source: Vector, receiver: Vector) -> float:
    """Of a straight ray where it arrives, positive where it comes from above [rad]."""
    length = distance(source, receiver)
    return math.asin((source[2] - receiver[2]) / length) if length > 0.0 else 0.0


class StraightRays(NamedTuple):
    """Rays that are straight but for their reflection."""

    profile: SoundProfile
    varies: bool  # sound has another speed at another depth
    floor: Any  # as `sim.water.floors.LevelFloor`
    bends: bool = False  # rays that bend are traced, so that each slowness takes long to find

    @jitable
    def apparent_source(self, path: int, source: Vector, receiver: Vector) -> Vector:
        """Place from which sound seems to come that takes a path [m]."""
        return image(source, path, receiver, self.floor)

    @jitable
    def slowness(self, path: int, source: Vector, receiver: Vector) -> float:
        """Mean of 1/c along a path [s/m]."""
        return path_slowness(self.profile, path, source, receiver, self.floor)

    @jitable
    def straight_slowness(self, path: int, source: Vector, receiver: Vector) -> float:
        """The same as `slowness`, since the rays are straight."""
        return self.slowness(path, source, receiver)

    def speed(self, depth: float) -> float:
        """Speed of sound at a depth [m/s]."""
        return speed_at(self.profile, depth)

    def ray(self, path: int, source: Vector, receiver: Vector) -> Ray:
        """The ray of a path."""
        apparent = self.apparent_source(path, source, receiver)
        length = distance(apparent, receiver)
        elevation = _elevation(apparent, receiver)
        time = length * self.slowness(path, source, receiver)
        # the way back leaves where this one arrives
        departure = -_elevation(self.apparent_source(path, receiver, source), source)
        return Ray(Path(path), length, time, elevation, departure)

    def rays(self, path: int, source: Vector, receiver: Vector) -> tuple[Ray, ...]:
        """The one ray of a path."""
        return (self.ray(path, source, receiver),)

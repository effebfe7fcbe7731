"""Echoes from floors that slope and bend, by the law of reflection and by Fermat's principle."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize

from laisn.arrays import Floats
from sim.water.grids import GriddedFloor
from sim.water.rays import Path, SoundProfile, StraightRays

_SPEED = SoundProfile.through([[0.0, 1500.0]])


def plane(depth: float, eastward: float, northward: float) -> GriddedFloor:
    """A floor that grows deeper in these directions, which a grid holds exactly."""
    axis = np.array([-5000.0, 5000.0])
    north, east = np.meshgrid(axis, axis, indexing="ij")
    return GriddedFloor(axis, axis, depth + eastward * east + northward * north)


def hills(east: Floats | float, north: Floats | float) -> Floats:
    """Depths of gentle hills [m]."""
    return np.asarray(30.0 + 3.0 * np.sin(np.asarray(east) / 60.0) * np.cos(np.asarray(north) / 80))


def places(seed: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """A source and a receiver up to 12 m deep and some 100 m apart."""
    rng = np.random.default_rng(seed)
    (x, y), (u, v) = rng.uniform(-70.0, 70.0, (2, 2)).tolist()
    up, other_up = (-rng.uniform(1.0, 12.0, 2)).tolist()
    return (x, y, up), (u, v, other_up)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.1, 0.0), (-0.05, 0.2), (0.3, -0.3)])
@pytest.mark.parametrize("seed", range(5))
def test_a_slope_reflects_as_a_mirror(slope: tuple[float, float], seed: int) -> None:
    """An echo has the length of the straight way from the image, and meets the floor at equal
    angles.
    """
    depth = 70.0
    source, receiver = places(seed)
    normal = np.array([*slope, 1.0])
    image = np.array(source) - 2.0 * (normal @ source + depth) / (normal @ normal) * normal
    rays = StraightRays(_SPEED, varies=False, floor=plane(depth, *slope))
    np.testing.assert_allclose(rays.apparent_source(2, source, receiver), image, atol=1e-9)
    ray = rays.ray(Path.BOTTOM, source, receiver)
    assert ray.length == pytest.approx(math.dist(image, receiver), abs=1e-9)
    assert ray.time == pytest.approx(ray.length / 1500.0, rel=1e-12)
    # where the way from the image meets the floor
    down = normal @ np.array(source) + depth
    up = normal @ np.array(receiver) + depth
    point = image + down / (down + up) * (np.array(receiver) - image)
    arriving = (point - receiver) / math.dist(point, receiver)
    leaving = (point - source) / math.dist(point, source)
    assert ray.elevation == pytest.approx(math.asin(arriving[2]), abs=1e-9)
    assert ray.departure == pytest.approx(-math.asin(leaving[2]), abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_hills_reflect_along_the_shortest_way(seed: int) -> None:
    source, receiver = places(seed)
    axis = np.arange(-200.0, 200.5, 0.5)
    north, east = np.meshgrid(axis, axis, indexing="ij")
    rays = StraightRays(_SPEED, varies=False, floor=GriddedFloor(axis, axis, hills(east, north)))

    def length(place: Floats) -> float:
        point = (float(place[0]), float(place[1]), -float(hills(*place)))
        return math.dist(source, point) + math.dist(point, receiver)

    middle = 0.5 * (np.array(source[:2]) + receiver[:2])
    shortest = minimize(
        length, middle, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9}
    )
    assert rays.ray(Path.BOTTOM, source, receiver).length == pytest.approx(shortest.fun, abs=2e-3)


def test_an_echo_of_a_slope_takes_the_mean_slowness_of_its_ways() -> None:
    """Down and up again have different slopes, so that they spend other shares in each layer."""
    profile = SoundProfile.through([[0.0, 1540.0], [20.0, 1500.0], [90.0, 1470.0]])
    slope = (0.25, 0.1)
    source, receiver = (-60.0, 20.0, -4.0), (55.0, -30.0, -11.0)
    rays = StraightRays(profile, varies=True, floor=plane(60.0, *slope))
    normal = np.array([*slope, 1.0])
    down, up = (normal @ np.array(place) + 60.0 for place in (source, receiver))
    image = np.array(source) - 2.0 * down / (normal @ normal) * normal
    point = image + down / (down + up) * (np.array(receiver) - image)

    def time(begin: Floats, end: Floats) -> float:
        def slowness(share: float) -> float:
            depth = -(begin[2] + share * (end[2] - begin[2]))
            return float(1.0 / np.interp(depth, profile.depth, profile.speed))

        mean = quad(slowness, 0.0, 1.0, epsabs=1e-12, limit=200)[0]
        return math.dist(begin, end) * mean

    expected = time(np.array(source), point) + time(point, np.array(receiver))
    assert rays.ray(Path.BOTTOM, source, receiver).time == pytest.approx(expected, rel=1e-7)

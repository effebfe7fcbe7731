"""Paths by surface and floor: the depths that they cross, and their mean slowness along a straight
line, against quadrature.
"""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad

from sim.water.eigenrays import PathInWater, drop, straight_slowness
from sim.water.smooth_profile import SmoothProfile, speed_and_gradient

PROFILE = SmoothProfile.through([[0.0, 1500.0], [8.0, 1520.0], [20.0, 1480.0], [60.0, 1490.0]])
FLOOR_M = 45.0
DIRECT = PathInWater(PROFILE, FLOOR_M, 0, 0)
SURFACE = PathInWater(PROFILE, FLOOR_M, 1, 0)
BOTTOM = PathInWater(PROFILE, FLOOR_M, 0, 1)


def _crossing_time(upper: float, lower: float) -> float:
    """Time of sound straight down [s]."""
    inner = [float(depth) for depth in (8.0, 20.0, 60.0) if upper < depth < lower]
    ends = [upper, *inner, lower]
    return sum(
        quad(lambda z: 1.0 / speed_and_gradient(PROFILE, z, 0)[0], a, b, epsabs=1e-14)[0]
        for a, b in itertools.pairwise(ends)
    )


@pytest.mark.parametrize(
    ("water", "legs"),
    [
        (DIRECT, [(12.0, 31.0)]),
        (SURFACE, [(0.0, 12.0), (0.0, 31.0)]),
        (BOTTOM, [(12.0, FLOOR_M), (31.0, FLOOR_M)]),
    ],
)
def test_mean_slowness_is_that_of_the_depths_that_a_path_crosses(
    water: PathInWater, legs: list[tuple[float, float]]
) -> None:
    way = sum(lower - upper for upper, lower in legs)
    expected = sum(_crossing_time(*leg) for leg in legs) / way
    for ends in ((12.0, 31.0), (31.0, 12.0)):
        assert straight_slowness(water, *ends) == pytest.approx(expected, rel=1e-9)
        assert abs(drop(water, *ends)) == pytest.approx(way)


@pytest.mark.parametrize(("water", "depth"), [(SURFACE, 0.0), (BOTTOM, FLOOR_M)])
def test_between_places_where_a_path_turns_it_is_that_of_their_depth(
    water: PathInWater, depth: float
) -> None:
    expected = 1.0 / float(speed_and_gradient(PROFILE, depth, 0)[0])
    assert straight_slowness(water, depth, depth) == expected
    assert np.isfinite(expected)

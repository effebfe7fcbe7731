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
    """Time of sound straight down, by quadrature between the points of the profile [s]."""
    knots = [float(depth) for depth in (8.0, 20.0, 60.0) if upper < depth < lower]
    limits = [upper, *knots, lower]
    return sum(
        quad(lambda z: 1.0 / speed_and_gradient(PROFILE, z, 0)[0], a, b, epsabs=1e-14)[0]
        for a, b in itertools.pairwise(limits)
    )


@pytest.mark.parametrize(
    ("water", "depth_intervals"),
    [
        (DIRECT, [(12.0, 31.0)]),
        (SURFACE, [(0.0, 12.0), (0.0, 31.0)]),
        (BOTTOM, [(12.0, FLOOR_M), (31.0, FLOOR_M)]),
    ],
)
def test_mean_slowness_is_that_of_the_depths_that_a_path_crosses(
    water: PathInWater, depth_intervals: list[tuple[float, float]]
) -> None:
    vertical_distance = sum(lower - upper for upper, lower in depth_intervals)
    expected = sum(_crossing_time(*interval) for interval in depth_intervals) / vertical_distance
    for end_depths in ((12.0, 31.0), (31.0, 12.0)):
        assert straight_slowness(water, *end_depths) == pytest.approx(expected, rel=1e-9)
        assert abs(drop(water, *end_depths)) == pytest.approx(vertical_distance)


@pytest.mark.parametrize(("water", "depth"), [(SURFACE, 0.0), (BOTTOM, FLOOR_M)])
def test_at_the_depth_of_a_reflection_mean_slowness_is_that_of_the_depth(
    water: PathInWater, depth: float
) -> None:
    """Where both ends lie on the surface or the floor, the path crosses no depths."""
    expected = 1.0 / float(speed_and_gradient(PROFILE, depth, 0)[0])
    assert straight_slowness(water, depth, depth) == expected
    assert np.isfinite(expected)

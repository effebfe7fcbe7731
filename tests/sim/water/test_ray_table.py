"""Interpolation of the table of rays, which cubics of Hermite make exact for cubic functions."""

from itertools import product

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval3d

from laisn.arrays import Floats
from sim.water.ray_table import RayTable, _Cell, bending

DEPTHS = np.array([0.0, 3.0, 4.0, 9.0])
RANGE_STEP_M = 7.0
DERIVATIVES = ((), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2))
"""Axes of the derivatives that `RayTable.value` holds, in its order: 0 depth of the source, 1 of
the receiver, 2 distance."""


def table_of(coefficients: Floats) -> RayTable:
    """The table of a polynomial in both depths and the distance, shape (4, 4, 4)."""
    coordinates = np.meshgrid(DEPTHS, DEPTHS, RANGE_STEP_M * np.arange(4), indexing="ij")
    derivative_values = []
    for axes in DERIVATIVES:
        derivative = coefficients
        for axis in axes:
            derivative = polyder(derivative, axis=axis)
        derivative_values.append(polyval3d(*coordinates, derivative))
    return RayTable(
        depth=DEPTHS,
        range_step=RANGE_STEP_M,
        value=np.stack(derivative_values, axis=-1),
        departure=np.zeros((4, 4, 4)),
        kind=np.zeros((3, 3, 3), np.uint8),
    )


def test_a_cubic_of_depths_and_distance_is_interpolated_exactly_in_every_cell() -> None:
    random = np.random.default_rng(11)
    coefficients = random.normal(size=(4, 4, 4)) * 10.0 ** -np.add.outer(
        np.add.outer(np.arange(4), np.arange(4)), np.arange(4)
    )
    table = table_of(coefficients)
    for i, j, k in product(range(3), repeat=3):
        x, y, z = random.random(3)
        point = (
            DEPTHS[i] + x * (DEPTHS[i + 1] - DEPTHS[i]),
            DEPTHS[j] + y * (DEPTHS[j + 1] - DEPTHS[j]),
            RANGE_STEP_M * (k + z),
        )
        expected = polyval3d(*point, coefficients)
        np.testing.assert_allclose(bending(table, _Cell(i, j, k, x, y, z)), expected, rtol=1e-9)

"""Masks of lanes: whether a condition holds in any lane, and in all."""

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.compiled import compiled
from laisn.simd import LANES, all_lanes, any_lane, lanes_of


@compiled
def _positive(x: Floats, out: Bools) -> None:
    """Whether any of a row of lanes is positive, and whether all are."""
    values = lanes_of(x)
    for i in range(x.shape[0]):
        out[i, 0] = any_lane(values[i] > 0.0)
        out[i, 1] = all_lanes(values[i] > 0.0)


def test_conditions_of_lanes_hold_in_any_and_in_all() -> None:
    """All 256 masks."""
    masks = (np.arange(1 << LANES)[:, None] >> np.arange(LANES)) & 1
    out = np.empty((len(masks), 2), np.bool_)
    _positive(masks.astype(np.float64), out)
    np.testing.assert_array_equal(out[:, 0], masks.any(axis=1))
    np.testing.assert_array_equal(out[:, 1], masks.all(axis=1))


def test_conditions_of_a_number_hold_in_its_only_lane() -> None:
    assert any_lane(True)
    assert all_lanes(True)
    assert not any_lane(False)
    assert not all_lanes(False)

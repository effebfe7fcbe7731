"""Values that are compared by their bits."""

import numpy as np
import pytest

from laisn.arrays import have_same_bits

NAN_AND_ZEROS = np.array([np.nan, 0.0, -0.0])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (NAN_AND_ZEROS, NAN_AND_ZEROS.copy()),
        (np.arange(6.0).reshape(2, 3).T, np.ascontiguousarray(np.arange(6.0).reshape(2, 3).T)),
        ((1.0, (NAN_AND_ZEROS, 2)), (1.0, (NAN_AND_ZEROS.copy(), 2))),
        (np.zeros(2, [("a", "f8"), ("b", "i4")]), np.zeros(2, [("a", "f8"), ("b", "i4")])),
        ((), ()),
    ],
)
def test_values_of_the_same_bits(first: object, second: object) -> None:
    assert have_same_bits(first, second)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (NAN_AND_ZEROS, np.array([np.nan, -0.0, -0.0])),
        (NAN_AND_ZEROS, np.array([np.nan, 0.0, 0.0])),
        (1.0, np.nextafter(1.0, 2.0)),
        (1.0, 1),
        (np.zeros(2), np.zeros((1, 2))),
        (np.zeros(2), np.zeros(2, np.int64)),
        (np.zeros(2), np.zeros(4, np.float32)),
        ((1.0,), (1.0, 1.0)),
        ((1.0, (2.0,)), (1.0, (3.0,))),
        ((1.0,), np.ones(1)),
    ],
)
def test_values_of_other_bits(first: object, second: object) -> None:
    assert not have_same_bits(first, second)

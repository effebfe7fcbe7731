"""Formulas: the same whether Python runs them or compiled code has them inlined, and by hand
calculation.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError

from laisn import navigator
from laisn.arrays import Floats
from laisn.compiled import compiled, copy_rows
from laisn.fix import Circle, Fix, Pair, laisn_3_2, laisn_best, laisn_main, pair_fix
from laisn.geometry import Point, SinCos
from laisn.settings import NavigationSettings, Tuning

PLACE, RANGE = st.floats(-50, 50), st.floats(0, 60) | st.just(float("nan"))


@compiled
def _pair_fix(pair: Pair, heading: SinCos, predicted: Point, t: Tuning) -> Fix:
    return pair_fix(pair, heading, predicted, t)


@compiled
def _variants(pairs: tuple[Fix, Fix, Fix], predicted: Point) -> tuple[Fix, Fix, Fix]:
    return laisn_3_2(pairs, predicted), laisn_best(pairs, predicted), laisn_main(pairs, predicted)


@pytest.mark.system
@given(rear=RANGE, front=RANGE, middle=RANGE, x=PLACE, y=PLACE, ahead=st.booleans())
def test_python_and_compiled_code_compute_the_same_bits(
    rear: float, front: float, middle: float, x: float, y: float, ahead: bool
) -> None:
    t = Tuning.of(NavigationSettings(side_rule="predicted" if ahead else "behind"))
    circles = (
        Circle(Point(-1.0, 0.0), rear),
        Circle(Point(1.0, 0.0), front),
        Circle(Point(0.0, 0.1), middle),
    )
    heading, predicted = SinCos(1.0, 0.0), Point(x, y)
    chosen = (
        Pair(*circles[:2], False),
        Pair(circles[0], circles[2], False),
        Pair(circles[2], circles[1], True),
    )
    pairs = tuple(pair_fix(pair, heading, predicted, t) for pair in chosen)
    compiled_pairs = tuple(_pair_fix(pair, heading, predicted, t) for pair in chosen)
    np.testing.assert_array_equal(pairs, compiled_pairs)
    expected = (
        laisn_3_2(pairs, predicted),
        laisn_best(pairs, predicted),
        laisn_main(pairs, predicted),
    )
    np.testing.assert_array_equal(expected, _variants(pairs, predicted))


def test_a_formula_is_a_function_to_its_reader() -> None:
    assert navigator.turn_share.__name__ == "turn_share"
    assert navigator.turn_share.__doc__


def test_manoeuvres_are_shares_of_a_half_turn_and_of_the_top_speed() -> None:
    """A quarter turn is ½ of a half turn; 0.6 m/s is ⅕ of 3 m/s; a first reading is 0."""
    assert navigator.turn_share(0.1, 0.1 - 0.5 * np.pi) == pytest.approx(0.5)
    assert navigator.turn_share(np.pi - 0.1, 0.1 - np.pi) == pytest.approx(0.2 / np.pi)
    assert navigator.speed_share(1.6, 1.0, 3.0) == pytest.approx(0.2)
    assert navigator.turn_share(np.nan, 1.0) == navigator.speed_share(np.nan, 1.0, 3.0) == 0.0
    t = Tuning.of(NavigationSettings(alpha=8.0, sigma_a0=60.0))
    assert navigator.expected_acceleration(0.2, 0.5, t) == pytest.approx(65.6)


@compiled
def _copy_rows(k: int, source: Floats, target: Floats) -> None:
    copy_rows(source, target[k])


@pytest.mark.system
def test_rows_are_copied_to_their_place_and_no_further() -> None:
    source = np.arange(12.0).reshape(4, 3)
    target = np.full((3, 4, 3), -1.0)
    _copy_rows(1, source, target)
    np.testing.assert_array_equal(target[1], source)
    assert np.all(target[[0, 2]] == -1.0)
    nothing = np.full((1, 0, 3), -1.0)
    _copy_rows(0, nothing[0], nothing)
    # strided ones would need a loop
    with pytest.raises(TypingError):
        _copy_rows(1, np.zeros((4, 6))[:, ::2], target)

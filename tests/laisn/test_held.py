"""Values that compiled code holds from call to call, and functions that are compiled within their
callers only.
"""

import copy
import gc
import pickle
import re
import sys
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numba
import numpy as np
import pytest
from numba.extending import overload

from laisn import held
from laisn.arrays import Floats, Records, records
from laisn.compiled import compiled, compiled_apart, jitable
from laisn.errors import LaisnError
from laisn.held import Held, borrowed_values, held_values
from laisn.nesting import NestedLibrary

pytestmark = pytest.mark.system

POINT = np.dtype([("x", np.float64), ("y", np.float64)])


class Inner(NamedTuple):
    numbers: Floats
    factor: float


class Outer(NamedTuple):
    inner: Inner
    points: Records
    pair: tuple[Floats, bool]


def new_outer() -> Outer:
    return Outer(Inner(np.arange(4.0), 3.0), records(POINT, 2), (np.zeros(2), True))


@compiled
def _count(k: int, held: Held) -> float:
    values = held_values(held)
    values.points[1].y += k
    values.pair[0][0] += values.inner.factor
    return values.inner.numbers[k] if values.pair[1] else -1.0


def test_held_values_are_those_of_python() -> None:
    """Both write into the same arrays, and see what the other has written."""
    outer = new_outer()
    held = Held(outer)
    assert _count(2, held) == 2.0
    outer.inner.numbers[2] = 8.0
    assert _count(2, held) == 8.0
    assert outer.points[1].y == 4.0
    assert outer.pair[0].tolist() == [6.0, 0.0]


@compiled
def _count_borrowed(k: int, outer: Outer) -> float:
    values = borrowed_values(outer)
    values.points[1].y += k
    values.pair[0][0] += values.inner.factor
    return values.inner.numbers[k] if values.pair[1] else -1.0


def test_borrowed_values_are_those_of_the_caller_who_keeps_them() -> None:
    outer = new_outer()
    arrays = (outer.inner.numbers, outer.points, outer.pair[0])
    references = [sys.getrefcount(array) for array in arrays]
    for _ in range(3):
        assert _count_borrowed(2, outer) == 2.0
    assert [sys.getrefcount(array) for array in arrays] == references
    assert outer.points[1].y == 6.0
    assert outer.pair[0].tolist() == [9.0, 0.0]
    del arrays
    of_a_temporary = _count_borrowed(3, new_outer())
    gc.collect()
    assert of_a_temporary == 3.0


def test_held_arrays_live_as_long_as_they_are_held() -> None:
    array = np.arange(1e5)
    outer = new_outer()
    held = Held(outer._replace(inner=Inner(array, 1.0)))
    del outer
    references = sys.getrefcount(array)
    gc.collect()
    assert _count(3, held) == 3.0
    assert sys.getrefcount(array) == references
    del held
    gc.collect()
    # released are the references of the NamedTuple and of compiled code
    assert sys.getrefcount(array) == references - 2


class Other(NamedTuple):
    numbers: Floats
    factor: float


def with_numbers(numbers: object) -> Outer:
    return new_outer()._replace(inner=Inner(cast(Any, numbers), 3.0))


def test_held_values_have_the_type_that_numba_finds() -> None:
    """Types are kept by structure, of which everything counts that a type follows from."""
    read_only = np.arange(4.0)
    read_only.flags.writeable = False
    packed = np.dtype([("a", np.int8), ("x", np.float64)])
    aligned = np.dtype([("a", np.int8), ("x", np.float64)], align=True)
    as_aligned = np.dtype(
        {"names": ["a", "x"], "formats": [np.int8, np.float64], "offsets": [0, 8], "itemsize": 16}
    )
    assert as_aligned == aligned
    nested = [np.dtype([("inner", dtype, 2)]) for dtype in (aligned, as_aligned)]
    values: list[object] = [
        new_outer(),
        new_outer()._replace(inner=cast(Any, Other(np.arange(4.0), 3.0))),
        new_outer()._replace(pair=(np.zeros(2), cast(Any, 1))),
        new_outer()._replace(points=cast(Any, records(POINT, 2)[0])),
        with_numbers(read_only),
        with_numbers(np.arange(8.0)[::2]),
        with_numbers(np.zeros((2, 2))),
        with_numbers(np.zeros((2, 2), order="F")),
        with_numbers(np.arange(4)),
        with_numbers(np.float32(1.0)),
        with_numbers(2**63),
        with_numbers(None),
        with_numbers((1.0, True)),
        *(with_numbers(np.zeros(2, dtype)) for dtype in (packed, aligned, as_aligned, *nested)),
        *(with_numbers(np.zeros(2, dtype)[0]) for dtype in (packed, aligned, as_aligned)),
    ]
    found = [numba.typeof(value) for value in values]
    for _ in range(2):
        assert [numba.typeof(Held(value)).values for value in values] == found
    assert numba.typeof(Held(new_outer())) is numba.typeof(Held(new_outer()))


def test_types_of_held_values_are_bounded_in_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(held, "_MOST_TYPES", 2)
    monkeypatch.setattr(held, "_held_types", {})
    for values in ((1.0,), (1.0, 2), (True,)):
        Held(values)
        Held(values)
    assert [kept.values for kept in held._held_types.values()] == [
        numba.typeof(values) for values in ((1.0, 2), (True,))
    ]


@jitable
def _root(x: float) -> float:
    return float(np.sqrt(x))


@compiled
def _inmost(x: float) -> float:
    return _root(x) + 1.0


@compiled
def _sum(x: float, numbers: Floats) -> float:
    total = _inmost(x)
    for i in range(numbers.size):
        total += _inmost(numbers[i])
    return total


@compiled_apart
def _shared(x: float, numbers: Floats) -> float:
    return 2.0 * _sum(x, numbers)


@compiled
def _outermost(x: float, numbers: Floats) -> float:
    return _shared(x, numbers) + _sum(x, numbers)


@compiled
def _sum_from(first: int, numbers: Floats) -> float:
    # one that calls itself stays a function of its own in its caller's code
    if first == numbers.size:
        return 0.0
    return float(numbers[first] + _sum_from(first + 1, numbers))


@compiled
def _sum_of_all(numbers: Floats) -> float:
    return _sum_from(0, numbers)


def test_code_for_callers_is_known_to_have_no_other_callers() -> None:
    """Only then does the optimiser leave out what these callers do not need."""
    assert _sum_of_all(np.arange(5.0)) == 10.0
    (code,) = _sum_of_all.inspect_llvm().values()  # type: ignore[attr-defined]
    assert re.findall(r"^define (\w+) .*_sum_from", code, flags=re.MULTILINE) == ["internal"]


@compiled
def _count_from(first: int, end: int) -> int:
    return 0 if first == end else 1 + _count_from(first + 1, end)


@compiled
def _count_of_all(numbers: Floats) -> int:
    return _count_from(0, numbers.size)


def test_code_for_callers_is_the_same_if_python_called_the_function_before() -> None:
    assert _count_from(2, 5) == 3
    assert are_nested(_count_from) == [False]
    assert _count_of_all(np.zeros(4)) == 4
    (code,) = _count_of_all.inspect_llvm().values()  # type: ignore[attr-defined]
    assert re.findall(r"^define (\w+) .*_count_from", code, flags=re.MULTILINE) == ["internal"]


def _typed_number() -> float:
    raise NotImplementedError("for compiled code")


@overload(_typed_number)
def _choose_number() -> Callable[[], float]:
    number = _called_while_compiling(4.0)
    return lambda: number


@compiled
def _called_while_compiling(x: float) -> float:
    return x + 1.0


@compiled
def _compiled_around_a_call() -> float:
    return 2.0 * _typed_number()


def test_python_may_call_a_function_while_another_is_compiled() -> None:
    """Held values need it: their memory is released whenever Python collects garbage."""
    assert _compiled_around_a_call() == 10.0
    assert are_nested(_called_while_compiling) == [False]


def are_nested(function: object) -> list[bool]:
    """Whether the code of each signature of a function is only within its callers."""
    overloads = function.overloads.values()  # type: ignore[attr-defined]
    return [isinstance(overload.library, NestedLibrary) for overload in overloads]


def test_functions_for_their_callers_have_no_code_of_their_own_until_python_calls_them() -> None:
    numbers = np.array([0.0, 1.0, 4.0, 9.0])
    # 1 + (1 + √0) + (1 + √1) + (1 + √4) + (1 + √9), and the root of 1
    total = 12.0
    assert _outermost(1.0, numbers) == 3.0 * total
    assert are_nested(_inmost) == are_nested(_sum) == [True]
    assert are_nested(_shared) == are_nested(_outermost) == [False]
    assert _inmost(4.0) == 3.0
    assert are_nested(_inmost) == [False]
    assert _sum(1.0, numbers) == total
    assert are_nested(_sum) == [False]
    assert _shared(1.0, numbers) == 2.0 * total

    # other signatures, and a function of the user's that calls them
    assert _sum(1, numbers.astype(np.float32)) == total

    @numba.njit
    def custom(numbers: Floats) -> float:
        return _sum(1.0, numbers) + _outermost(1.0, numbers)

    assert custom(numbers) == 4.0 * total


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, pickle.dumps])
def test_held_values_are_neither_copied_nor_pickled(duplicate: Callable[[object], object]) -> None:
    """A copy would read, and give back, the memory of the first."""
    held = Held(new_outer())
    with pytest.raises(LaisnError, match="Held holds addresses in memory, so it is neither copied"):
        duplicate(held)
    assert _count(3, held) == 3.0

"""Compilation in two stages: nothing twice, the same answers, and errors that still come out."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numba
import numpy as np
import pytest
from numba.core import event
from numba.core.bytecode import FunctionIdentity
from numba.core.environment import Environment
from numba.core.runtime._nrt_python import memsys_disable_stats, memsys_enable_stats
from numba.core.runtime.nrt import rtsys

from laisn import code_cache
from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.geometry import attitude

HELPERS = attitude.heading_of, attitude.pitch_of, attitude.roll_of
HEADING_EAST = np.array([[1.0, 0.0, 0.0, 0.0]] * 2)


@contextmanager
def listening() -> Iterator[list[str]]:
    """Names of functions that are compiled meanwhile: once for their part, once more for code that Python calls."""
    told: list[str] = []

    class Compiling(event.Listener):
        def on_start(self, began: Any) -> None:
            told.append(began.data["dispatcher"].py_func.__name__)

        def on_end(self, _: Any) -> None:
            pass

    with event.install_listener("numba:compile", Compiling()):
        yield told


@pytest.fixture
def _nothing_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    code_cache.folder.cache_clear()
    yield
    code_cache.folder.cache_clear()


@pytest.mark.usefixtures("_nothing_kept")
def test_what_compiled_code_calls_is_compiled_once_for_all_callers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second caller is a new process as far as its helpers can tell: they have but what was kept."""
    told_by = []
    for rows in (HEADING_EAST, np.asfortranarray(HEADING_EAST)):
        for helper in HELPERS:
            monkeypatch.setattr(helper, "_parts", {})
        angles = compiled(attitude._angles.py_func)
        with listening() as told:
            assert angles(rows, 0).tolist() == [np.pi / 2] * 2
            assert angles(rows, 1).tolist() == [0.0] * 2
        told_by.append(told)
    assert {"_angles", *(helper.py_func.__name__ for helper in HELPERS)} <= set(told_by[0])
    assert set(told_by[1]) == {"_angles"}


@pytest.mark.usefixtures("_nothing_kept")
def test_code_and_part_that_two_processes_kept_work_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba numbers functions in each process anew, so that they have the same names in both."""

    def new_process(first_number: int) -> Any:
        monkeypatch.setattr(FunctionIdentity, "_unique_ids", count(first_number))
        monkeypatch.setattr(Environment, "_memo", WeakValueDictionary())
        return compiled(attitude._angles.py_func)

    expected = [np.pi / 2] * 2
    assert new_process(1_000_001)(HEADING_EAST, 0).tolist() == expected
    assert compiled(_angles_by(new_process(1_000_000)))(HEADING_EAST).tolist() == expected
    angles = new_process(1_000_000)
    with listening() as told:
        assert compiled(_angles_by(angles))(HEADING_EAST).tolist() == expected
        assert angles(HEADING_EAST, 0).tolist() == expected
    assert set(told) == {"caller"}


_CALLER = """
from numba.core.bytecode import FunctionIdentity
from sim.geometry.attitude import heading
import numpy as np
print(next(FunctionIdentity._unique_ids), heading(np.array([1.0, 0.0, 0.0, 0.0])))
"""
_CALLED = """
from numba.core.bytecode import FunctionIdentity
from sim.geometry.attitude import heading_of
print(next(FunctionIdentity._unique_ids), heading_of(1.0, 0.0, 0.0, 0.0))
"""


def test_python_calls_what_another_process_kept_for_compiled_callers(tmp_path: Path) -> None:
    """Nothing else is compiled there, so that nothing else loads what numba compiles with."""
    env = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    told = [
        subprocess.run([sys.executable, "-c", program], env=env, text=True, capture_output=True, check=True).stdout
        for program in (_CALLER, _CALLED)
    ]
    (one, heading), (other, same) = (line.split() for line in told)
    assert float(heading) == float(same) == np.pi / 2
    assert abs(int(one) - int(other)) > 1000, "functions of two processes may have one name"


def _angles_by(angles: Any) -> Any:
    def caller(rows: Floats) -> Floats:
        return angles(rows, 0)

    return caller


def test_a_function_that_others_call_has_no_machine_code_before_python_calls_it() -> None:
    doubled, called = compiled(_double), compiled(_negative)
    assert compiled(_twice(doubled))(3.0) == 12.0
    assert list(doubled.overloads) == []
    assert doubled(3.0) == 6.0
    assert len(doubled.overloads) == 1
    assert compiled(_twice(called))(3.0) == 3.0


def _double(x: float) -> float:
    return 2.0 * x


def _negative(x: float) -> float:
    return -x


def _twice(function: Any) -> Any:
    def twice(x: float) -> float:
        return function(function(x))

    return twice


@compiled
def _put(target: Floats, values: Floats) -> None:
    target[:] = values


@compiled
def _put_all(target: Floats, values: Floats) -> None:
    _put(target, values)


def test_an_array_goes_into_one_of_its_shape_alone() -> None:
    target = np.zeros(3)
    _put_all(target, np.array([1.0, 2.0, 3.0]))
    assert target.tolist() == [1.0, 2.0, 3.0]
    for put in (_put, _put_all):
        with pytest.raises(ValueError, match="different shape"):
            put(target, np.zeros(2))
    assert target.tolist() == [1.0, 2.0, 3.0]


@compiled
def _first(row: Floats) -> float:
    return row[0]


@compiled
def _first_negative(rows: Floats) -> int:
    for i in range(rows.shape[0]):
        if _first(rows[i]) < 0.0:
            return i
    return -1


@compiled
def _pair(x: float) -> Floats:
    return np.array([x, 2.0 * x])


@compiled
def _sum_of_pair(x: float) -> float:
    pair = _pair(x)
    return pair[0] + pair[1]


@compiled
def _shifted(values: Floats) -> None:
    values[1:] = values[:-1]


@compiled
def _itself(values: Floats) -> Floats:
    return values


def _counts(function: Any, *args: Any) -> bool:
    """Whether the code of a function that compiled code calls with such arguments counts references."""
    types = tuple(numba.typeof(arg) for arg in args)
    code = str(function._new_part(types, keep=False).library._get_module_for_linking())
    return re.search(r"call .*@NRT_(incref|decref)", code) is not None


def test_references_are_counted_where_arrays_are_owned_and_nowhere_else() -> None:
    """What numba counts in vain took a sixth of a formation's time; what it does not count is lost for ever."""
    rows = np.array([[3.0, 4.0]])
    assert not _counts(_first_negative, rows)
    for owner, given in ((_sum_of_pair, 1.0), (_itself, rows)):
        assert _counts(owner, given), owner.py_func.__name__


def test_compiled_code_frees_every_array_that_it_makes() -> None:
    values, twice = np.array([1.0, 2.0, 3.0]), compiled(_twice(_itself))

    def use() -> None:
        assert [_sum_of_pair(float(i)) for i in range(9)] == [3.0 * i for i in range(9)]
        values[:] = 1.0, 2.0, 3.0
        _shifted(values)
        assert values.tolist() == [1.0, 1.0, 2.0]
        assert twice(values) is not None

    use()  # compiles
    memsys_enable_stats()
    try:
        held, before = sys.getrefcount(values), rtsys.get_allocation_stats()
        use()
        after = rtsys.get_allocation_stats()
    finally:
        memsys_disable_stats()
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free > 0
    assert after.alloc - before.alloc == after.free - before.free > 0
    assert sys.getrefcount(values) == held

"""Code of functions that were compiled for their callers, in later processes."""

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools import import_graph

pytestmark = pytest.mark.system

# a module of this project for those that ask its name: only their functions are stored
PARTS = '''
import numpy as np
from numba import literal_unroll

from laisn.compiled import DispatchedFormula, compiled, compiled_apart

LARGE = np.arange(200_000.0)
"""Numba takes the address of so large a constant."""


@compiled
def roots(values):
    total = 0.0
    for value in values:
        total += np.sqrt(value)
    return total


@compiled
def entry(number):
    return LARGE[number]


def double(x):
    return 2.0 * x


def triple(x):
    return 3.0 * x


FORMULAS = DispatchedFormula(double), DispatchedFormula(triple)


@compiled
def all_formulas(x):
    total = 0.0
    for formula in literal_unroll(FORMULAS):
        total += formula(x)
    return total


@compiled
def first(x):
    return 1.0 + roots(np.array([x, 4.0]))


@compiled
def second(x):
    return 2.0 * roots(np.array([x, 4.0]))


@compiled_apart
def large(unused, values):
    """Too long to be written into its callers, to which it needs one of its arguments alone."""
    total = 0.0
    for i in range(values.size):
        value = values[i]
STATEMENTS
    return total


@compiled
def with_large(values):
    return large(np.zeros(2), values) + large(np.zeros(2), np.zeros(3)) + 1.0


@compiled
def first_large(x):
    return with_large(np.full(3, x))


@compiled
def second_large(x):
    return -with_large(np.full(3, x))


@compiled
def large_alone(x):
    return large(np.zeros(2), np.full(3, x))


@compiled
def large_again(x):
    return 2.0 * large(np.zeros(2), np.full(3, x))


@compiled
def first_entry(x):
    return x + entry(7)


@compiled
def second_entry(x):
    return x - entry(7)


@compiled
def first_formulas(x):
    return 1.0 + all_formulas(x)


@compiled
def second_formulas(x):
    return 2.0 * all_formulas(x)
'''
STATEMENTS = "\n".join(
    f"        total += np.sin({i}.0 * value) * np.exp(-value)" for i in range(60)
)
PARTS = PARTS.replace("STATEMENTS", STATEMENTS)
CALLS = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("laisn.parts", sys.argv[1])
parts = importlib.util.module_from_spec(spec)
sys.modules["laisn.parts"] = parts
spec.loader.exec_module(parts)
from laisn.nesting import count_nested
results = [getattr(parts, name)(1.0) for name in sys.argv[2].split()]
part = getattr(parts, sys.argv[3])
print(results[-1], sum(part.stats.cache_hits.values()), count_nested())
"""


def call(folder: Path, callers: str, part: str) -> tuple[float, int, int]:
    """Call functions of `PARTS` in a new process: what the last one gives for 1, how often a part
    of it came from the store, and how many were compiled for their callers.
    """
    path = folder / "parts.py"
    if not path.exists():
        path.write_text(PARTS)
    environment = os.environ | {"PYTHONPATH": str(import_graph.ROOT), "XDG_CACHE_HOME": str(folder)}
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CALLS, str(path), callers, part],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    result, hits, nested = run.stdout.split()
    return float(result), int(hits), int(nested)


@pytest.mark.parametrize(
    ("part", "callers", "results"),
    [
        ("roots", ("first", "second"), (4.0, 6.0)),
        # numba tells formulas apart by addresses in memory
        ("all_formulas", ("first_formulas", "second_formulas"), (6.0, 10.0)),
    ],
)
def test_another_caller_takes_a_part_as_the_first_one_has_stored_it(
    part: str, callers: tuple[str, str], results: tuple[float, float], tmp_path: Path
) -> None:
    result, hits, nested = call(tmp_path, callers[0], part)
    assert (result, hits) == (results[0], 0)
    assert nested >= 1
    assert call(tmp_path, callers[1], part) == (results[1], 1, 0)


def test_a_function_that_is_compiled_apart_keeps_its_arguments(tmp_path: Path) -> None:
    """A process takes it from the store as a part of a part, which is free to leave out arguments
    where nobody else can call it, beside its machine code.
    """
    expected = 3.0 * sum(math.sin(i) * math.exp(-1.0) for i in range(60))
    assert call(tmp_path, "first_large", "with_large")[0] == pytest.approx(expected + 1.0)
    result, hits, _ = call(tmp_path, "large_alone second_large large_again", "large")
    assert result == pytest.approx(2.0 * expected)
    assert hits == 1


def test_a_part_with_an_address_of_its_process_is_compiled_in_each(tmp_path: Path) -> None:
    assert call(tmp_path, "first_entry", "entry") == (8.0, 0, 1)
    assert call(tmp_path, "second_entry", "entry") == (-6.0, 0, 1)


def test_parts_of_changed_sources_are_compiled_anew(tmp_path: Path) -> None:
    """The source of the function itself is compared by numba, others by the name of the folder."""
    call(tmp_path, "first", "roots")
    (tmp_path / "parts.py").write_text(PARTS.replace("np.sqrt(value)", "value"))
    assert call(tmp_path, "second", "roots") == (10.0, 0, 1)


def test_a_caller_works_where_the_code_of_a_part_is_gone(tmp_path: Path) -> None:
    call(tmp_path, "first", "roots")
    (store,) = tmp_path.glob("laisn-sim/compiled/*/nested")
    for path in store.iterdir():
        path.unlink()
    assert call(tmp_path, "second", "roots") == (6.0, 0, 1)

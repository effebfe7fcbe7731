"""One mutant: what it changes in a source, and the run of the tests that cover it, in a copy of
the checkout.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import get_operator, operator_names
from cosmic_ray.testing import run_tests
from cosmic_ray.work_item import MutationSpec, TestOutcome

from tools import import_graph
from tools.import_graph import ROOT
from tools.mutants.cover import SOURCES, covering

OPERATORS = (
    "ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|Pow_Mul|FloorDiv_Mul|Mod_Mul|MatMul_Add|BitAnd_BitOr|BitOr_BitAnd"
    "|BitXor_BitOr|RShift_LShift|LShift_RShift)|ReplaceComparisonOperator_(Lt_LtE|LtE_Lt|Gt_GtE|GtE_Gt|Lt_Gt|Gt_Lt|LtE_GtE"
    "|GtE_LtE|Eq_NotEq|NotEq_Eq|Is_IsNot|IsNot_Is)|ReplaceUnaryOperator_Delete_.*|AddNot|Replace(True|False|And|Or|Break"
    "|Continue)With.*|NumberReplacer|ZeroIterationForLoop"
)
"""Operators of cosmic-ray, without those whose mutants seldom compile."""
EQUIVALENT = Path(__file__).with_name("equivalent.toml")
MIN_TIMEOUT_S = 60.0
TIMEOUT_RATIO = 10.0
"""A mutant's tests may take this long, and this many times as long as they take without it."""

Span = tuple[tuple[int, int], tuple[int, int]]
"""Line and column of the first character, and of the one after the last."""


class Tried(NamedTuple):
    """A mutant that was tested."""

    location: str
    """File and line."""
    before: str
    after: str
    killed: bool
    timed_out: bool
    """Its tests did not end in time, which does not count as killed: the machine may have had
    other work.
    """
    equivalent: str
    """Why it is equivalent to the original; empty otherwise."""


@cache
def equivalents() -> dict[tuple[str, str, str], str]:
    """Reasons by file and by the text before and after the change."""
    entries = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8"))["equivalent"]
    return {(e["file"], e["was"], e["becomes"]): e["why"] for e in entries}


def without_effect(source: str) -> list[Span]:
    """Places of annotations and of the `strict` of zip: changes there do not show in a run."""
    expressions: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            expressions.append(node.returns)
        if isinstance(node, ast.arg | ast.AnnAssign):
            expressions.append(node.annotation)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "zip":
            expressions += [keyword.value for keyword in node.keywords]
    return [
        ((n.lineno, n.col_offset), (n.end_lineno or 0, n.end_col_offset or 0))
        for n in expressions
        if n is not None
    ]


def mutants_of(file: str) -> Iterator[MutationSpec]:
    """All mutants of a source file."""
    nodes = list(ast_nodes(get_ast_from_path(ROOT / file)))
    excluded = without_effect((ROOT / file).read_text(encoding="utf-8"))
    for name in operator_names():
        if not re.fullmatch(OPERATORS, name.rpartition("/")[2]):
            continue
        operator = get_operator(name)()
        places = ((node, span) for node in nodes for span in operator.mutation_positions(node))
        for occurrence, (node, (start, end)) in enumerate(places):
            # the star among the parameters of a function is no product
            star = node.type == "operator" and node.parent.type in ("parameters", "lambdef")
            if not star and not any(first <= start and end <= last for first, last in excluded):
                yield MutationSpec(file, name, occurrence, start, end)


def enter_copy(folder: Path) -> None:
    """Make the working directory of this process a copy of the checkout; copies share compiled
    code.
    """
    tree = folder / str(os.getpid())
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(
        command, cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\0"):
        if name and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, tree / name)
    # a test that fails on any edit of a source, even of a comment, would kill every mutant; here it
    # fails without any
    for path in import_graph.modules(tree, SOURCES).values():
        path.write_text(path.read_text(encoding="utf-8") + "# unchanged\n", encoding="utf-8")
    os.chdir(tree)
    os.environ |= {
        "PYTHONPATH": str(tree),
        "XDG_CACHE_HOME": str(folder / "cache"),
        "OMP_NUM_THREADS": "1",
    }


def pytest_command(tests: Iterable[str]) -> str:
    """The command that runs test files until one test fails."""
    return (
        f"{sys.executable} -m pytest -x -m 'not typed and not long' -p no:cacheprovider --tb=short "
        f"--hypothesis-profile mutants {' '.join(tests)}"
    )


def time_of(test: str) -> float:
    """Time that a test file takes without any mutant [s], compiling included.

    Raises:
        ValueError: it fails.
    """
    begin = time.monotonic()
    outcome, output = run_tests(pytest_command([test]), None)
    if outcome is not TestOutcome.SURVIVED:
        raise ValueError(f"{output}\n{test} fails without any mutant")
    return time.monotonic() - begin


def attempt(mutant: MutationSpec, times: Mapping[str, float]) -> Tried:
    """Test a mutant by the tests that cover it, those of its own folder first, and of these the
    quickest; `times` are of each without mutants [s].
    """
    file = str(mutant.module_path)
    location = f"{mutant.module_path}:{mutant.start_pos[0]}"
    home, elsewhere = covering(file)
    tests = [*sorted(home, key=times.__getitem__), *sorted(elsewhere, key=times.__getitem__)]
    timeout = MIN_TIMEOUT_S + TIMEOUT_RATIO * sum(times[test] for test in tests)
    # without a test it survives; pytest without a file would run all tests
    result = mutate_and_test([mutant], pytest_command(tests) if tests else "true", timeout)
    if result.diff is None:
        raise ValueError(f"{location}: {mutant.operator_name} cannot be applied: {result.output}")
    lines = result.diff.splitlines()[4:]
    before, after = (
        "\n".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+"
    )
    timed_out = result.output == "timeout"
    killed = result.is_killed and not timed_out
    return Tried(
        location, before, after, killed, timed_out, equivalents().get((file, before, after), "")
    )

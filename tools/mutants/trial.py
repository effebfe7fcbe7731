"""A copy of the working tree in which tests meet faults."""

import io
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import redirect_stderr, redirect_stdout
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from tools import import_graph
from tools.import_graph import ROOT
from tools.mutants.cover import SOURCES, covering
from tools.mutants.faults import Mutant

_OURS = ("models", "laisn", "sim", "experiments", "tools", "tests", "laisn_sim")
_PRELOADED = (
    "hypothesis", "numba", "scipy.integrate", "scipy.optimize", "scipy.spatial.transform", "scipy.stats",
    "filterpy.kalman", "mujoco", "pyarrow.parquet", "pydantic", "matplotlib.backends.backend_svg", "matplotlib.figure",
    "mcap.reader", "mcap.writer", "jinja2", "typer.testing", "rich.progress", "joblib",
)  # fmt: skip
"""Packages that many tests import: a process that has them begins a trial two seconds earlier."""
_WAITS = 10.0
"""How many times its processor time a trial may take: tests sleep, and the machine may have other work."""


class Outcome(Enum):
    """What became of a mutant."""

    NOTICED = "noticed"
    SURVIVED = "survived"
    SLOW = "slow"
    """Tests took far longer than without it: it may loop for ever, or the machine had much else to do."""


class Done(NamedTuple):
    """How a run of tests ended."""

    passed: bool
    in_time: bool
    """It ended by itself."""
    said: str
    seconds: float
    """Processor time."""


def preload() -> None:
    """Import what tests import besides this project, and wake the compiler."""
    for name in _PRELOADED:
        import_module(name)
    numba = import_module("numba")
    numba.njit(lambda x: x + 1.0)(1.0)


def _run_here(tests: Iterable[str], tree: Path, cache: Path, told: int) -> None:
    """Be the process that runs tests on a tree; ends with it."""
    for name in [name for name in sys.modules if name.partition(".")[0] in _OURS]:
        del sys.modules[name]
    sys.path[:] = [str(tree), *(path for path in sys.path if path not in ("", str(ROOT)))]
    os.chdir(tree)
    others = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path not in ("", str(ROOT))]
    os.environ |= {"PYTHONPATH": os.pathsep.join([str(tree), *others]), "XDG_CACHE_HOME": str(cache)}
    said, code = io.StringIO(), 1
    try:
        import pytest

        with redirect_stdout(said), redirect_stderr(said):
            command = ["-x", "-p", "no:cacheprovider", "--tb=short", "--hypothesis-profile", "mutants", *tests]
            code = int(pytest.main(command))
    finally:
        os.write(told, said.getvalue()[-4000:].encode())
        os._exit(code)


def run(tests: Iterable[str], tree: Path, cache: Path, limit: float | None = None) -> Done:
    """Run tests on a tree in a process forked off this one, which has imported nothing of the project's that matters.

    Args:
        tests: files, in the order in which they are run, until one fails.
        tree: the working tree.
        cache: XDG_CACHE_HOME.
        limit: processor time [s] after which they are ended.
    """
    reads, told = os.pipe()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = os.fork()
    if child == 0:
        os.setsid()
        os.close(reads)
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 2))
        _run_here(tests, tree, cache, told)
    os.close(told)
    ends = None if limit is None else time.monotonic() + _WAITS * limit
    while True:
        ended, status = os.waitpid(child, os.WNOHANG if ends is not None else 0)
        if ended:
            break
        if ends is not None and time.monotonic() > ends:
            os.killpg(child, signal.SIGKILL)
            ends = None
        else:
            time.sleep(0.02)
    with os.fdopen(reads, "rb") as pipe:
        said = pipe.read().decode(errors="replace")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    in_time = not (os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGKILL, signal.SIGXCPU))
    return Done(os.waitstatus_to_exitcode(status) == 0, in_time, said, spent)


class Copy:
    """A copy of the working tree in which mutants are tried, one after the other."""

    def __init__(self, folder: Path, kept: Path) -> None:
        """Copy the files that git knows or would take, each source with a comment more.

        Tests thereby meet sources that read otherwise and mean the same, and those that mind are found out.

        Args:
            folder: to be made.
            kept: cache of compiled code, which copies may share.
        """
        self._tree, self._trial, self._kept = folder / "tree", folder / "cache", kept
        self._written = 0
        git = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        for name in subprocess.run(git, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0"):
            if name and (ROOT / name).is_file():
                (self._tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, self._tree / name)
        for path in import_graph.modules(packages=SOURCES).values():
            self._write(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8") + "# as it is\n")

    def _write(self, file: str, text: str) -> None:
        """Write a source with a time of its own: Python takes it for unchanged where second and size are the same."""
        (self._tree / file).write_text(text, encoding="utf-8")
        self._written += 1
        os.utime(self._tree / file, (self._written, self._written))

    def control(self, test: str) -> Done:
        """Run a test file without any mutant; code that it compiles is kept."""
        return run([test], self._tree, self._kept)

    def outcome(self, mutant: Mutant, took: dict[str, float]) -> Outcome:
        """Whether a test fails, or they take far longer than the processor time that each test file `took` [s].

        The quickest are run first.
        """
        tests = sorted(covering(mutant.file), key=took.__getitem__)
        whole = (self._tree / mutant.file).read_text(encoding="utf-8")
        if not tests:
            return Outcome.SURVIVED
        # files of a cache are replaced, never written to: links will do
        shutil.copytree(self._kept, self._trial, copy_function=os.link)
        self._write(mutant.file, mutant.text())
        try:
            done = run(tests, self._tree, self._trial, 30.0 + 3.0 * sum(took[test] for test in tests))
        finally:
            self._write(mutant.file, whole)
            shutil.rmtree(self._trial)
        if not done.in_time:
            return Outcome.SLOW
        return Outcome.SURVIVED if done.passed else Outcome.NOTICED


@cache
def _own_copy(folder: Path) -> Copy:
    """The copy of this process, made on first use."""
    preload()
    return Copy(folder / str(os.getpid()), folder / "kept")


def attempt(folder: Path, mutant: Mutant, took: dict[str, float]) -> Outcome:
    """Whether a test notices a mutant.

    Args:
        folder: of all copies.
        mutant: to be tried.
        took: processor time of each test file without any mutant [s].
    """
    return _own_copy(folder).outcome(mutant, took)


def control(folder: Path, test: str) -> float:
    """Processor time that a test file takes without any mutant [s], compiling included; compiled code is kept.

    Raises:
        ValueError: it fails.
    """
    done = _own_copy(folder).control(test)
    if not done.passed:
        raise ValueError(f"{done.said}\n{test} fails without any mutant")
    return done.seconds

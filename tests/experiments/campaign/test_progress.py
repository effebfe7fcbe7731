"""Progress that a user sees while waiting."""

import io
import os
import re
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from experiments.campaign import progress
from reports.version import ROOT

COMPILING_PROGRAM = """
from rich.console import Console
from experiments.campaign.progress import phases
from sim.control.allocation import clip
with phases(Console(stderr=True)) as phase:
    with phase("first") as update:
        clip(1.0, 0.0, 2.0)
        update(0.5)
    with phase("second"):
        clip(3.0, 0.0, 2.0)
"""


def lines_of(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().err.splitlines()


@pytest.mark.system
def test_compiling_is_reported_once_and_not_where_the_cache_has_it(tmp_path: Path) -> None:
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    processes = [
        subprocess.run(
            [sys.executable, "-c", COMPILING_PROGRAM],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        for _ in range(2)
    ]
    first, second = (process.stderr.splitlines() for process in processes)
    assert re.fullmatch(r"compiled \(once\): [1-9][0-9]* functions, [0-9]+ s", first[-1])
    assert second == []


@pytest.mark.parametrize(
    "shown",
    [
        progress.phases,
        lambda _: progress.compiling_shown(),
        lambda _: progress.progress("runs", 3),
    ],
    ids=["phases", "no phases", "counted items"],
)
def test_a_terminal_counts_the_functions_compiled(
    monkeypatch: pytest.MonkeyPatch, shown: Callable[[Console], AbstractContextManager[Any]]
) -> None:
    """With the phases of a flight, in commands without phases and where items are counted, with
    the time that it takes.

    The cache held 3 functions at first, and holds 10 in the end.
    """
    stored_counts, all_compiled = iter([3, 3, 4, *[10] * 1000]), threading.Event()

    def count_stored() -> int:
        count = next(stored_counts)
        if count == 10:
            all_compiled.set()
        return count

    monkeypatch.setattr("laisn.compiled.count_stored", count_stored)
    monkeypatch.setattr(progress, "_REFRESH_HZ", 100.0)
    console = Console(file=io.StringIO(), force_terminal=True, width=120, color_system=None)
    monkeypatch.setattr(progress, "Console", lambda stderr: console)
    with shown(console):
        assert all_compiled.wait(10.0)
        time.sleep(0.3)
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    assert re.search(r"compiling \(once for each version.*: 7 functions, \d+ s", printed)


def test_the_first_item_is_not_in_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first takes 60 s, as it compiles, then there is one every 10 s: with 3 of 6 done, 30 s
    are left, at 0.1 a second.
    """
    clock = [0.0]
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    with progress.progress("cells", 6) as advance:
        for clock[0] in (60.0, 70.0, 80.0, 90.0, 100.0, 110.0):
            advance(1)
    assert lines_of(capsys) == [
        "cells: 1/6",
        "cells: 2/6, 0.1/s, 40 s left",
        "cells: 3/6, 0.1/s, 30 s left",
        "cells: 4/6, 0.1/s, 20 s left",
        "cells: 5/6, 0.1/s, 10 s left",
        "cells: 6/6, 0.1/s, 0 s left",
    ]


def test_a_log_is_never_silent_for_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """While a phase of a flight or compiling takes long, there is a line every so often, here
    every fifth of a second. The cache holds 3 functions at first, then 8.
    """
    stored_counts = iter([3, 3, *[8] * 1000])
    monkeypatch.setattr("laisn.compiled.count_stored", lambda: next(stored_counts))
    monkeypatch.setattr(progress, "_LINE_EVERY_S", 0.2)
    with progress.phases(Console(stderr=True)) as phase:
        time.sleep(0.5)
        with phase("simulate") as update:
            update(0.4)
            time.sleep(0.5)
    lines = lines_of(capsys)
    assert any(re.fullmatch(r"compiling \(once.*\): 5 functions, 0 s", line) for line in lines)
    assert any(line.startswith("simulate: 40 %; compiling (once") for line in lines)
    assert re.fullmatch(r"compiled \(once\): 5 functions, \d s", lines[-1])


def test_nothing_is_reported_where_nothing_is_to_be_done(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress.progress("cells", 0) as advance:
        advance(1)
    with progress.progress("cells", 3, quiet=True) as advance:
        advance(3)
    assert lines_of(capsys) == []


def test_the_oldest_rich_allowed_prints_no_empty_line() -> None:
    """Bars that are switched off print one before version 14.3."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (requirement,) = (
        dependency for dependency in project["dependencies"] if dependency.startswith("rich")
    )
    assert requirement.startswith("rich>=")
    assert tuple(map(int, re.findall(r"[0-9]+", requirement))) >= (14, 3)

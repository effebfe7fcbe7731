"""Compiled code from the cache: never of other sources, never damaged, never somebody else's."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments.campaign import cells
from laisn import compiled as compilation
from laisn.compiled import compiled, compiled_lanes, compiling
from tools import import_graph

ROOT = import_graph.ROOT

CAPTURES = """
import numpy as np
from experiments.campaign import lane_metrics as metric
from laisn import lane_rows as row

# leader at the origin, heading north; the follower 1 m east of its axis, all estimates 1 m west of it
block, tally, bins = np.zeros(row.SIZE), np.zeros(metric.SIZE), np.zeros(2 * row.LANES, dtype=np.int64)
block[row.X : row.X + row.LANES] = -1.0
metric.tally_step(block, tally, bins, (1.0, 0.0), (0.0, 0.0, 0.0))
hits = sum(metric.tally_step.stats.cache_hits.values())
runs = np.count_nonzero(tally[metric.LONGEST_ASTRAY : metric.LONGEST_ASTRAY + row.LANES])
print(runs, hits)
"""


def child(program: str, cache: Path, root: Path = ROOT) -> subprocess.Popen[str]:
    """A process that runs a program on the packages of a folder, with a home of its own for compiled code."""
    environment = os.environ | {"PYTHONPATH": str(root), "XDG_CACHE_HOME": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", program], cwd=root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def captures(root: Path, cache: Path) -> tuple[int, int]:
    """Captured runs of the packages in a folder, and how many signatures of the function came from the cache."""
    process = child(CAPTURES, cache, root)
    out, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    runs, hits = out.split()
    return int(runs), int(hits)


def test_a_second_process_takes_code_from_the_cache_until_a_constant_of_another_file_changes(tmp_path: Path) -> None:
    tree, cache = tmp_path / "tree", tmp_path / "cache"
    for package in import_graph.PACKAGES:
        shutil.copytree(ROOT / package, tree / package)
    metrics = tree / "laisn" / "metrics.py"
    whole = metrics.read_text(encoding="utf-8")
    assert [captures(tree, cache) for _ in range(2)] == [(0, 0), (0, 1)]
    metrics.write_text(whole.replace("CAPTURE_ERROR = 5.0\n", "CAPTURE_ERROR = 0.5\n"), encoding="utf-8")
    assert captures(tree, cache) == (64, 0)
    metrics.write_text(whole, encoding="utf-8")
    assert captures(tree, cache) == (0, 1)


def test_compiled_modules_import_only_sources_that_name_the_folder() -> None:
    """Otherwise a constant that compiled code contains could change without notice."""
    sources, imports = import_graph.modules(), import_graph.imports()
    named = {name for name, path in sources.items() if path in compilation._AT_START} | {"models"}
    decorated = re.compile(r"^ *@(compiled|inlined|formula)", flags=re.MULTILINE)
    compiling = {name for name, path in sources.items() if decorated.search(path.read_text(encoding="utf-8"))}
    assert len(compiling & named) > 60
    for name in compiling:
        reached, new = set[str](), set(imports[name])
        while new:
            reached |= new
            new = set[str]().union(*(imports[module] for module in new)) - reached
        assert reached - named - {name} == set(), name


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found = compilation._find_folder()
    assert found is not None
    assert found.parent == tmp_path / "laisn-sim" / "compiled"
    monkeypatch.setattr(compilation, "FOLDER", found)
    return found


def added() -> int:
    """Compile a function, or take its code from the cache, and see that it is right; hits of the cache."""
    function = compiled_lanes(cells._add_in_order.py_func)
    total = np.zeros(2)
    function(total, np.array([[1.0, 2.0], [3.0, 5.0]]))
    assert total.tolist() == [3.0, 8.0]
    return sum(function.stats.cache_hits.values())


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_code_is_stored_where_nobody_else_can_enter(folder: Path) -> None:
    assert [added(), added()] == [0, 1]
    assert folder.parent.stat().st_mode & 0o777 == 0o700
    assert {path.suffix for path in files(folder)} == {".nbi", ".nbc"}


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722, 0o755])
def test_a_folder_that_others_can_enter_is_not_used(folder: Path, monkeypatch: pytest.MonkeyPatch, mode: int) -> None:
    folder.parent.chmod(mode)
    assert compilation._find_folder() is None
    monkeypatch.setattr(compilation, "FOLDER", None)
    assert [added(), added()] == [0, 0]
    assert files(folder) == []


def test_a_folder_of_another_user_is_not_used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert compilation._find_folder() is None


def test_a_link_or_a_file_in_the_folder_s_place_is_not_used(folder: Path) -> None:
    place, elsewhere = folder.parent, folder.parents[1] / "elsewhere"
    place.rename(elsewhere)
    place.symlink_to(elsewhere)
    assert compilation._find_folder() is None
    place.unlink()
    place.write_text("no folder")
    assert compilation._find_folder() is None


@pytest.mark.parametrize("home", ["/dev/null", "/proc/none"])
def test_a_home_that_cannot_be_used_costs_nothing_but_time(tmp_path: Path, home: str) -> None:
    assert captures(ROOT, Path(home)) == (0, 0)


@pytest.mark.parametrize("damage", [b"", b"\x80\x04", b"cos\nsystem\n"])
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_code_is_compiled_again(folder: Path, damage: bytes, suffix: str) -> None:
    added()
    [kept] = folder.rglob(f"*{suffix}")
    kept.write_bytes(damage)
    assert [added(), added()] == [0, 1]


def test_signatures_that_two_processes_stored_under_one_name_are_told_apart(folder: Path) -> None:
    """Each process numbers the signatures that it stores: a file may hold another signature than the index says."""
    dense = np.array([[1.0, 2.0], [3.0, 5.0]])
    sparse = np.repeat(dense, 2, axis=1)[:, ::2]
    for values in (dense, sparse):
        compiled_lanes(cells._add_in_order.py_func)(np.zeros(2), values)
    of_dense, of_sparse = sorted(folder.rglob("*.nbc"))
    shutil.copy(of_dense, of_sparse)
    total = np.zeros(2)
    compiled_lanes(cells._add_in_order.py_func)(total, sparse)
    assert total.tolist() == [3.0, 8.0]


def test_a_full_disk_costs_nothing_but_time(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert added() == 0
    assert files(folder) == []


def test_old_versions_make_room(folder: Path) -> None:
    for i in range(20):
        old = folder.with_name(f"{i:016x}")
        old.mkdir()
        os.utime(old, (i, i))
    assert compilation._find_folder() == folder
    assert {path.name for path in folder.parent.iterdir()} == {folder.name, *(f"{i:016x}" for i in range(13, 20))}


def test_code_of_sources_that_were_edited_meanwhile_is_not_stored(folder: Path, monkeypatch: pytest.MonkeyPatch
                                                                 ) -> None:  # fmt: skip
    monkeypatch.setitem(compilation._AT_START, ROOT / "laisn" / "metrics.py", 0)
    assert added() == 0
    assert not folder.exists()
    assert added() == 0


def _adding(number: float) -> object:
    @compiled
    def add(x: float) -> float:
        return x + number

    return add


def test_closures_and_functions_of_other_projects_are_not_stored(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert compiled(_doubled)(2.0) == 4.0
    monkeypatch.setattr(sys.modules[__name__], "__name__", "laisn.test")
    assert _adding(1.0)(2.0) == 3.0
    assert _adding(2.0)(2.0) == 4.0
    assert files(folder) == []


def _doubled(x: float) -> float:
    return 2.0 * x


@compiled
def _power(x: float, n: int) -> float:
    return x**n


@compiled
def _cubic(x: float) -> float:
    return _power(x, 3) + _power(x, 2) + _power(x, 1)


def test_constants_that_callers_pass_make_no_versions_of_a_function() -> None:
    seen: list[int] = []
    with compiling(seen.append):
        assert _cubic(2.0) == 14.0
        assert _power(2.0, 4) == 16.0
        assert _cubic(3.0) == 39.0
    # `_power` for compiled callers, `_cubic`, and `_power` for Python
    assert np.diff([functions for functions in seen if functions]).tolist() == [1, 1]
    assert seen.count(0) == 2


INTERRUPTED = """
import os
import signal
import numpy as np
from laisn.compiled import compiling
from sim.geometry import attitude

seen = []

def tell(functions):
    seen.append(functions)
    if INTERRUPT:
        os.kill(os.getpid(), signal.SIGINT)

with compiling(tell):
    print(*attitude._angles(np.array([[1.0, 0.0, 0.0, 0.0]]), 0), max(seen, default=0))
"""


def test_ctrl_c_while_code_is_compiled_ends_a_process_and_spoils_nothing(tmp_path: Path) -> None:
    """It comes when the first of four functions is compiled."""
    interrupted = child(INTERRUPTED.replace("INTERRUPT", "True"), tmp_path)
    _, errors = interrupted.communicate(timeout=120)
    assert interrupted.returncode == -signal.SIGINT, errors
    for compiled_now in ("3", "0"):
        process = child(INTERRUPTED.replace("INTERRUPT", "False"), tmp_path)
        assert process.communicate(timeout=120)[0].split() == [str(np.pi / 2), compiled_now]

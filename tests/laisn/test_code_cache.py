"""Machine code that is kept: never of other sources, never damaged, never somebody else's."""

import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments.campaign import cells
from laisn import code_cache
from laisn.compiled import compiled_lanes
from laisn.sources import PACKAGES, ROOT

CAPTURES = """
import sys
import numpy as np
from experiments.campaign import lane_metrics as metric
from laisn import lane_rows as row

# leader at the origin, heading north; the follower 1 m east of its axis, all estimates 1 m west of it
block, tally, bins = np.zeros(row.SIZE), np.zeros(metric.SIZE), np.zeros(2 * row.LANES, dtype=np.int64)
block[row.X : row.X + row.LANES] = -1.0
metric.tally_step(block, tally, bins, (1.0, 0.0), (0.0, 0.0, 0.0))
hits = sum(metric.tally_step.stats.cache_hits.values())
runs = np.count_nonzero(tally[metric.LONGEST_ASTRAY : metric.LONGEST_ASTRAY + row.LANES])
print(runs, hits, "numba.np.arraymath" in sys.modules)
"""


def captures(root: Path, cache: Path) -> tuple[int, int]:
    """Captured runs of the packages in a folder, and how much of the code for it was there already."""
    environment = os.environ | {"PYTHONPATH": str(root), "XDG_CACHE_HOME": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", CAPTURES], cwd=root, env=environment, capture_output=True, text=True, check=True
    )
    runs, hits, compiler = done.stdout.split()
    # what numba can compile takes most of a second to load, and code that is kept needs none of it
    assert compiler == str(hits == "0")
    return int(runs), int(hits)


def test_a_constant_that_compiled_code_freezes_counts_at_once(tmp_path: Path) -> None:
    """The constant stands in a file that compiles nothing."""
    tree, cache = tmp_path / "tree", tmp_path / "cache"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tree / package)
    metrics = tree / "laisn" / "metrics.py"
    whole = metrics.read_text(encoding="utf-8")
    assert captures(tree, cache) == (0, 0)
    metrics.write_text(whole.replace("CAPTURE_ERROR = 5.0\n", "CAPTURE_ERROR = 0.5\n"), encoding="utf-8")
    assert captures(tree, cache) == (64, 0)
    (tree / "laisn" / "navigator.py").write_text("# nothing compiled reaches this\n", encoding="utf-8")
    assert captures(tree, cache) == (64, 1)
    metrics.write_text(whole, encoding="utf-8")
    assert captures(tree, cache) == (0, 1)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    code_cache.folder.cache_clear()
    yield tmp_path / "laisn-sim" / "code"
    code_cache.folder.cache_clear()


def added() -> int:
    """Compile a function, or take its code from the cache, and see that it is right; hits of the cache."""
    function = compiled_lanes(cells._add_in_order.py_func)
    total = np.zeros(2)
    function(total, np.array([[1.0, 2.0], [3.0, 5.0]]))
    assert total.tolist() == [3.0, 8.0]
    return sum(function.stats.cache_hits.values())


def test_code_is_kept_where_only_this_user_can_write(cache: Path) -> None:
    assert [added(), added()] == [0, 1]
    [kept] = cache.iterdir()
    assert kept.name.startswith("experiments.campaign.cells._add_in_order.")
    assert cache.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("damage", ["empty", "cut off", "flipped", "garbage"])
def test_damaged_code_is_compiled_again(cache: Path, damage: str) -> None:
    added()
    [kept] = cache.iterdir()
    whole = kept.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    kept.write_bytes(
        {"empty": b"", "cut off": whole[:-1], "flipped": bytes(flipped), "garbage": b"cos\nsystem\n"}[damage]
    )
    assert [added(), added()] == [0, 1]


def test_code_that_expects_what_the_process_lacks_gets_all_that_numba_has(monkeypatch: pytest.MonkeyPatch) -> None:
    context = compiled_lanes(cells._add_in_order.py_func).targetctx
    told: list[str] = []
    monkeypatch.setattr(context, "refresh", lambda: told.append("loaded"))
    code_cache._provide(["sin", "NRT_Free", "Py_IncRef"], context)
    assert told == []
    code_cache._provide(["sin", "numba_no_such_thing"], context)
    assert told == ["loaded"]


def test_what_code_expects_is_kept_with_it(cache: Path) -> None:
    added()
    [kept] = cache.iterdir()
    _, symbols, _ = pickle.loads(code_cache._read(kept) or b"")
    # it takes arrays from Python, and gives None back
    assert {"NRT_adapt_ndarray_from_python", "_Py_NoneStruct"} <= set(symbols)


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
def test_a_folder_that_others_can_write_is_not_used(cache: Path, mode: int) -> None:
    cache.mkdir(parents=True)
    cache.chmod(mode)
    assert code_cache.folder() is None
    assert [added(), added()] == [0, 0]
    assert list(cache.iterdir()) == []


def test_nothing_is_kept_until_something_is(cache: Path) -> None:
    assert code_cache.keeps_nothing()
    added()
    assert not code_cache.keeps_nothing()
    shutil.rmtree(cache)
    cache.write_text("no folder")
    code_cache.folder.cache_clear()
    assert not code_cache.keeps_nothing(), "where nothing can be kept, another process compiles in vain"


def test_a_link_or_a_file_in_the_folder_s_place_is_not_used(cache: Path, tmp_path: Path) -> None:
    cache.parent.mkdir()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    cache.symlink_to(elsewhere)
    assert code_cache.folder() is None
    cache.unlink()
    cache.write_text("no folder")
    code_cache.folder.cache_clear()
    assert code_cache.folder() is None
    assert added() == 0


def test_code_that_another_user_wrote_is_not_run(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    added()
    assert code_cache.folder() is not None
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert added() == 0
    code_cache.folder.cache_clear()
    assert code_cache.folder() is None


def test_a_full_disk_costs_nothing_but_time(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, content: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert added() == 0
    assert list(cache.iterdir()) == []


def test_old_code_makes_room(cache: Path) -> None:
    added()
    [kept] = cache.iterdir()
    for i in range(40):
        stale = kept.with_name(f"experiments.campaign.cells._add_in_order.{i:032x}.code")
        stale.write_bytes(b"")
        os.utime(stale, (i, i))
    kept.unlink()
    added()
    names = {path.name for path in cache.iterdir()}
    assert len(names) == 16
    assert kept.name in names
    assert f"experiments.campaign.cells._add_in_order.{39:032x}.code" in names
    assert f"experiments.campaign.cells._add_in_order.{0:032x}.code" not in names


def test_code_of_sources_that_were_edited_meanwhile_is_not_kept(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    metrics = ROOT / "laisn" / "metrics.py"
    monkeypatch.setitem(code_cache._AT_START, metrics, (0, 0))
    code_cache._stamp.cache_clear()
    try:
        assert [added(), added()] == [0, 0]
    finally:
        code_cache._stamp.cache_clear()


def test_functions_of_other_projects_are_not_kept(cache: Path) -> None:
    function = compiled_lanes(_doubled)
    assert function(2.0) == 4.0
    assert list(cache.parent.glob("*/*")) == []


def _doubled(x: float) -> float:
    return 2.0 * x

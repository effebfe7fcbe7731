"""Compiled code from the cache: never of other sources, never of another user."""

import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest
import typer

from experiments.campaign import lane_flight
from laisn import compiled as compilation
from laisn.compiled import compiled
from laisn.lanes import LANES
from laisn_sim.cli.errors import report_errors
from tools import import_graph

pytestmark = pytest.mark.system

ROOT = import_graph.ROOT

COUNTS_MIRROR_LOCKS = """
import numpy as np
from experiments.campaign import lane_flight as metric
from laisn import lanes as row

# leader at the origin, heading north; the follower 1 m east of its axis, all estimates 1 m west
block, tally = np.zeros(row.SIZE), np.zeros(metric.SIZE)
bins = np.zeros(2 * row.LANES, dtype=np.int64)
block[row.X : row.X + row.LANES] = -1.0
metric.tally_step(block, tally, bins, (1.0, 0.0), (0.0, 0.0, 0.0))
hits = sum(metric.tally_step.stats.cache_hits.values())
runs = np.count_nonzero(tally[metric.LONGEST_MIRROR_LOCK : metric.LONGEST_MIRROR_LOCK + row.LANES])
print(runs, hits)
"""


FILLS_HISTOGRAMS = """
import sys
import numpy as np
from experiments.campaign.lane_flight import fill_histograms
from laisn.compiled import FOLDER
from laisn.lanes import LANES

counts = np.zeros((2, 1), dtype={kind})
if {wait}:
    print(FOLDER, flush=True)
    sys.stdin.readline()
fill_histograms(np.zeros(2 * LANES, dtype=np.int64), counts, 4)
print(FOLDER, counts[0, 0], sum(fill_histograms.stats.cache_hits.values()))
"""


INTERPOLATES_INVERSES = """
import numpy as np
from sim.control.allocation import clip, pseudo_inverse_at

if {caller}:
    inverse = np.zeros((1, 6))
    pseudo_inverse_at(np.zeros((1, 6)), np.ones((1, 6)), 9.0, inverse)
    print(inverse[0, 0], sum(clip.stats.cache_hits.values()))
print(clip(9.0, 0.0, 1.0), sum(clip.stats.cache_hits.values()))
"""


def start(program: str, cache: Path, root: Path = ROOT) -> subprocess.Popen[str]:
    """A process that runs a program on the packages of a folder `root`, with compiled code in
    `cache`.
    """
    environment = os.environ | {"PYTHONPATH": str(root), "XDG_CACHE_HOME": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=root,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def mirror_locks(root: Path, cache: Path) -> tuple[int, int]:
    """Number of lanes with a mirror lock, by the packages in a folder, and how many signatures of
    the function came from the cache.
    """
    process = start(COUNTS_MIRROR_LOCKS, cache, root)
    out, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    runs, hits = out.split()
    return int(runs), int(hits)


def test_a_caller_takes_no_code_that_python_s_calls_have_stored(tmp_path: Path) -> None:
    """Its speed would depend on what other processes have called before."""
    programs = [INTERPOLATES_INVERSES.format(caller=caller) for caller in (False, True)]
    printed = [start(program, tmp_path).communicate()[0].split() for program in programs]
    assert printed == [["1.0", "0"], ["1.0", "0", "1.0", "1"]]


@pytest.mark.long
def test_a_second_process_takes_code_from_the_cache_until_a_constant_of_another_file_changes(
    tmp_path: Path,
) -> None:
    tree, cache = tmp_path / "tree", tmp_path / "cache"
    for package in import_graph.PACKAGES:
        shutil.copytree(ROOT / package, tree / package)
    metrics = tree / "laisn" / "metrics.py"
    original = metrics.read_text(encoding="utf-8")
    assert [mirror_locks(tree, cache) for _ in range(2)] == [(0, 0), (0, 1)]
    metrics.write_text(
        original.replace("MIRROR_LOCK_ERROR = 5.0\n", "MIRROR_LOCK_ERROR = 0.5\n"), encoding="utf-8"
    )
    assert mirror_locks(tree, cache) == (64, 0)
    # times of files do not matter
    for path in tree.rglob("*.py"):
        os.utime(path, (0, 0))
    metrics.write_text(original, encoding="utf-8")
    assert mirror_locks(tree, cache) == (0, 1)


def test_no_compiled_function_may_reorder_or_fuse_operations() -> None:
    """A function is compiled on its own and within its callers, here or in another process. With
    such freedom the copies round differently, and a campaign of two workers differs from one.
    """
    dispatchers = {
        f"{name}.{key}": value
        for name, module in list(sys.modules.items())
        if name.startswith(("laisn.", "sim.", "experiments."))
        for key, value in vars(module).items()
        if hasattr(value, "targetoptions")
    }
    assert {"laisn.lanes.advance", "sim.water.waves.add_waves"} <= dispatchers.keys()
    assert not [name for name, f in dispatchers.items() if f.targetoptions.get("fastmath")]


def test_compiled_modules_import_only_sources_that_name_the_folder() -> None:
    """Otherwise a constant that compiled code contains could change without notice."""
    sources, imports = import_graph.modules(), import_graph.imports()
    in_folder_name = {
        name for name, path in sources.items() if path in compilation.reached_sources()
    } | {"models"}
    decorated = re.compile(r"^ *@(compiled|inlined|formula)", flags=re.MULTILINE)
    with_compiled_code = {
        name for name, path in sources.items() if decorated.search(path.read_text(encoding="utf-8"))
    }
    assert len(with_compiled_code & in_folder_name) > 30
    for name in with_compiled_code:
        reached, next_modules = set[str](), set(imports[name])
        while next_modules:
            reached |= next_modules
            next_modules = set[str]().union(*(imports[module] for module in next_modules)) - reached
        assert reached - in_folder_name - {name} == set(), name


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found_folder = compilation.find_folder()
    assert found_folder is not None
    assert found_folder.parent == tmp_path / "laisn-sim" / "compiled"
    monkeypatch.setattr(compilation, "FOLDER", found_folder)
    return found_folder


def cache_hits() -> int:
    """Hits of the cache when a function is compiled; its result must be right."""
    function = compiled(lane_flight.fill_histograms.py_func)
    counts = np.zeros((2, 2), dtype=np.int64)
    function(np.repeat([0, 1], LANES), counts, 3)
    assert counts.tolist() == [[3, 0], [0, 3]]
    return sum(function.stats.cache_hits.values())


def stored_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.nb?") if path.is_file())


def test_code_is_stored_in_a_private_folder(folder: Path) -> None:
    assert [cache_hits(), cache_hits()] == [0, 1]
    assert folder.parent.stat().st_mode & 0o777 == 0o700
    assert {path.suffix for path in stored_files(folder)} == {".nbi", ".nbc"}


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722, 0o755])
def test_a_folder_that_others_can_enter_is_not_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    folder.parent.chmod(mode)
    with pytest.warns(compilation.UnstoredCode, match="only this user can enter"):
        assert compilation.find_folder() is None
    monkeypatch.setattr(compilation, "FOLDER", None)
    assert [cache_hits(), cache_hits()] == [0, 0]
    assert stored_files(folder) == []


def test_a_folder_of_another_user_is_not_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.warns(compilation.UnstoredCode):
        assert compilation.find_folder() is None


def test_a_link_or_a_file_in_the_folder_s_place_is_not_used(folder: Path) -> None:
    cache, link_target = folder.parent, folder.parents[1] / "elsewhere"
    cache.rename(link_target)
    cache.symlink_to(link_target)
    with pytest.warns(compilation.UnstoredCode, match=str(cache)):
        assert compilation.find_folder() is None
    cache.unlink()
    cache.write_text("no folder")
    with pytest.warns(compilation.UnstoredCode, match="File exists"):
        assert compilation.find_folder() is None


@pytest.mark.parametrize("home", ["/dev/null", "/proc/none"])
def test_a_home_that_cannot_be_used_costs_nothing_but_time(tmp_path: Path, home: str) -> None:
    assert mirror_locks(ROOT, Path(home)) == (0, 0)


@pytest.mark.parametrize("damage", [b"", b"\x80\x04", b"cos\nsystem\n"])
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_code_is_removed_by_the_command_and_compiled_again(
    folder: Path, damage: bytes, suffix: str
) -> None:
    cache_hits()
    [stored_file] = folder.rglob(f"*{suffix}")
    stored_file.write_bytes(damage)
    with pytest.raises(typer.Exit), report_errors():
        cache_hits()
    assert [cache_hits(), cache_hits()] == [0, 1]


def test_other_errors_leave_compiled_code_alone(folder: Path) -> None:
    cache_hits()
    with pytest.raises(numba.errors.TypingError) as caught:
        compiled(lane_flight.fill_histograms.py_func)("text", "text", "text")
    assert not compilation.remove_if_damaged(caught.value)
    assert cache_hits() == 1


def test_code_of_versions_that_were_not_used_for_a_week_is_removed(folder: Path) -> None:
    current_version, now = folder, time.time()
    for days in (6, 8, 100):
        old_version = current_version.with_name(f"{days:016x}")
        old_version.mkdir()
        os.utime(old_version, (now - 86_400 * days,) * 2)
    # the fixture's folder is in use by this process
    os.utime(current_version, (0, 0))
    assert compilation.find_folder() is not None
    assert set(current_version.parent.iterdir()) == {
        current_version,
        current_version.with_name(f"{6:016x}"),
    }


def test_two_processes_that_compile_at_once_lose_no_code_of_each_other(tmp_path: Path) -> None:
    """Both begin with an empty index of the function, and each stores its first signature."""
    processes = [
        start(FILLS_HISTOGRAMS.format(kind=kind, wait=True), tmp_path)
        for kind in ("float", "complex")
    ]
    folders = {process.stdout.readline().split()[0] for process in processes if process.stdout}
    for process in processes:
        assert process.stdin
        process.stdin.write("\n")
        process.stdin.flush()
    for process in processes:
        process.communicate(timeout=120)
        assert process.returncode == 0
    (folder,) = folders
    results = []
    for kind in ("float", "complex"):
        out, errors = start(FILLS_HISTOGRAMS.format(kind=kind, wait=False), tmp_path).communicate(
            timeout=120
        )
        assert not errors
        results.append(out.split())
    assert results == [[folder, "4.0", "1"], [folder, "(4+0j)", "1"]]
    # one folder for both processes, with an index and the code of two signatures
    assert [path.name for path in Path(folder).parent.iterdir()] == [Path(folder).name]
    assert len(stored_files(Path(folder))) == 3


@pytest.mark.long
def test_the_number_of_stored_files_does_not_grow_with_the_number_of_processes(
    tmp_path: Path,
) -> None:
    """Eight processes begin with an empty cache, and compile the same function at once; then two
    load it.
    """
    processes = [
        start(FILLS_HISTOGRAMS.format(kind="float", wait=True), tmp_path) for _ in range(8)
    ]
    folders = {process.stdout.readline().split()[0] for process in processes if process.stdout}
    (folder,) = map(Path, folders)
    for process in processes:
        assert process.stdin
        process.stdin.write("\n")
        process.stdin.flush()
    for process in processes:
        out, errors = process.communicate(timeout=240)
        assert not errors
        assert out.split()[1] == "4.0"
    assert [path.suffix for path in sorted(stored_files(folder))] == [".nbc", ".nbi"]
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]
    for _ in range(2):
        out, _ = start(FILLS_HISTOGRAMS.format(kind="float", wait=False), tmp_path).communicate(
            timeout=120
        )
        assert out.split() == [str(folder), "4.0", "1"]
    assert len(stored_files(folder)) == 2


def test_an_index_that_another_process_has_written_meanwhile_keeps_its_entry(
    folder: Path,
) -> None:
    """As if both had read the empty index before either of them wrote."""
    first = compiled(lane_flight.fill_histograms.py_func)
    second = compiled(lane_flight.fill_histograms.py_func)
    bins = np.zeros(2 * LANES, dtype=np.int64)
    first(bins, np.zeros((2, 1)), 4)
    second(bins, np.zeros((2, 1), dtype=np.complex128), 4)
    third = compiled(lane_flight.fill_histograms.py_func)
    for counts in (np.zeros((2, 1)), np.zeros((2, 1), dtype=np.complex128)):
        third(bins, counts, 4)
        assert counts[0, 0] == 4.0
    assert sum(third.stats.cache_hits.values()) == 2
    assert compilation.count_stored() == 2


CUSTOM = """
import sys
from typing import NamedTuple
import numpy as np
import laisn.compiled as compilation
from sim import simulation
from laisn.compiled import compiled, jitable, method_by_type
{imports}

class Pair(NamedTuple):
    first: float
    second: float

    @jitable
    def total(self):
        return self[0] + self[1]

method_by_type("total")

@compiled
def total(pair):
    return pair.total()

total._cache = compilation._Cache(simulation.static_trajectory)
print(total({argument}), sum(total.stats.cache_hits.values()))
"""
CUSTOM_TYPE = """
from typing import NamedTuple
from laisn.compiled import jitable
from weights import WEIGHT

class Mine(NamedTuple):
    a: float
    b: float

    @jitable
    def total(self):
        return self.a + WEIGHT * self.b
"""


@pytest.mark.long
def test_code_of_custom_types_is_stored_apart_and_never_used_with_old_methods(
    tmp_path: Path,
) -> None:
    """Processes without the class read the index of the same function, which must not name it."""
    sources = tmp_path / "sources"
    sources.mkdir()
    cache = tmp_path / "cache"
    import_mine = f"sys.dont_write_bytecode = True; sys.path.append({str(sources)!r}); import mine"
    with_own_type = CUSTOM.format(imports=import_mine, argument="mine.Mine(1.0, 2.0)")
    with_tuple = CUSTOM.format(imports="", argument="(1.0, 2.0)").replace("pair.total()", "pair[0]")
    with_type_of_main = CUSTOM.format(imports="", argument="Pair(1.0, 2.0)")

    def run(program: str) -> list[str]:
        out, errors = start(program, cache).communicate(timeout=120)
        assert not errors
        return out.split()

    def write(weight: float, sign: str) -> None:
        (sources / "weights.py").write_text(f"WEIGHT = {weight}\n")
        (sources / "mine.py").write_text(CUSTOM_TYPE.replace("+", sign))

    write(1.0, "+")
    assert [run(with_own_type), run(with_own_type)] == [["3.0", "0"], ["3.0", "1"]]
    assert [run(with_tuple), run(with_tuple)] == [["1.0", "0"], ["1.0", "1"]]
    assert [run(with_type_of_main), run(with_type_of_main)] == [["3.0", "0"], ["3.0", "0"]]
    write(2.0, "+")
    assert [run(with_own_type), run(with_own_type)] == [["5.0", "0"], ["5.0", "1"]]
    write(2.0, "-")
    assert run(with_own_type) == ["-3.0", "0"]
    write(1.0, "+")
    assert run(with_own_type) == ["3.0", "1"]
    (index,) = [
        import_mine for import_mine in cache.rglob("*.nbi") if "-" not in import_mine.parts[-3]
    ]
    assert b"mine" not in index.read_bytes()


def test_a_folder_without_room_is_named_and_costs_nothing_but_time(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(compilation._Files, "save", full)
    with pytest.warns(compilation.UnstoredCode, match=f"{folder}.*No space left.*make room there"):
        assert cache_hits() == 0
    assert stored_files(folder) == []


def _adding(number: float) -> object:
    @compiled
    def add(x: float) -> float:
        return x + number

    return add


def test_closures_and_functions_of_other_projects_are_not_stored(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert compiled(_doubled)(2.0) == 4.0
    monkeypatch.setattr(sys.modules[__name__], "__name__", "laisn.test")
    assert _adding(1.0)(2.0) == 3.0
    assert _adding(2.0)(2.0) == 4.0
    assert stored_files(folder) == []


def _doubled(x: float) -> float:
    return 2.0 * x


INTERRUPTED = """
import os
import signal
import numpy as np
from sim import attitude

if INTERRUPT:
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
angles = np.empty((3, 1))
attitude._angles(np.array([[1.0, 0.0, 0.0, 0.0]]), angles)
print(angles[0, 0], sum(attitude._angles.stats.cache_misses.values()))
"""


def test_ctrl_c_while_code_is_compiled_ends_a_process_and_spoils_nothing(tmp_path: Path) -> None:
    interrupted = start(INTERRUPTED.replace("INTERRUPT", "True"), tmp_path)
    _, errors = interrupted.communicate(timeout=120)
    assert interrupted.returncode == -signal.SIGINT, errors
    compiled_now = []
    for _ in range(2):
        angle, functions = (
            start(INTERRUPTED.replace("INTERRUPT", "False"), tmp_path)
            .communicate(timeout=120)[0]
            .split()
        )
        assert float(angle) == np.pi / 2
        compiled_now.append(int(functions))
    assert compiled_now == [1, 0]


SYMBOLS = """
import numpy as np
from numba import typeof
from laisn import lanes
from laisn.settings import NavigationSettings

kinds = typeof(np.zeros(lanes.SIZE)), typeof(lanes.tuning(NavigationSettings()))
for function in (lanes.fix_rear_front, lanes.fix_rear_middle):
    function.compile(kinds)
    print(function.overloads[kinds].fndesc.mangled_name)
"""

FORKED = """
import os
from numba.core.bytecode import FunctionIdentity
import laisn.compiled

print(next(FunctionIdentity._unique_ids), flush=True)
if os.fork() == 0:
    print(next(FunctionIdentity._unique_ids), flush=True)
    os._exit(0)
os.wait()
print(next(FunctionIdentity._unique_ids))
"""


@pytest.mark.long
def test_functions_of_a_factory_have_other_symbols_in_each_process(tmp_path: Path) -> None:
    """Else the code of two processes, loaded by a third, takes one of them for another."""
    processes = [start(SYMBOLS, tmp_path) for _ in range(2)]
    symbols = [process.communicate()[0].split() for process in processes]
    assert [len(names) for names in symbols] == [2, 2]
    assert len({*symbols[0], *symbols[1]}) == 4


def test_a_process_that_is_forked_numbers_functions_anew(tmp_path: Path) -> None:
    first, forked, second = map(int, start(FORKED, tmp_path).communicate()[0].split())
    assert second == first + 1
    assert abs(forked - first) > 1000

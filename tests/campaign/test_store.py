"""Stored results: no damage becomes a number, and no process is in another's way."""

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.campaign.seal import blank, require_whole, sealed
from experiments.campaign.store import DamagedResult, Record, Steps, Store, columns_of, read_table, write_table
from experiments.campaign.version import ROOT, code_version
from laisn.failure import LaisnError

KEY, OTHER = "0123456789abcdef01234567", "76543210fedcba9876543210"
ROW: Record = {
    "key": KEY, "variant": "laisn-2", "runs": 3, "e_p_mean_m": 0.25, "nees": float("nan"), "none": None,
    "version": code_version(), "run_e_p_mean_m": [0.1, 0.2, 0.45], "run_captured": [False, True, False],
}  # fmt: skip
STEPS: Steps = {"time_s": np.linspace(0.1, 20.0, 200, dtype=np.float32), "e_p_mean_m": np.ones(200, dtype=np.float32)}


@pytest.fixture
def cells(tmp_path: Path) -> Path:
    Store(tmp_path).write(KEY, ROW, STEPS)
    return tmp_path / "cells"


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """One of the things that happen to files."""
    n = len(content)
    i, j = sorted(rng.integers(0, n, 2).tolist())
    kind = rng.integers(0, 6)
    if kind == 0:
        flipped = bytearray(content)
        flipped[i] ^= 1 << int(rng.integers(0, 8))
        return bytes(flipped)
    if kind == 1:
        return content[:i]
    if kind == 2:
        return content[:i] + bytes(j - i) + content[j:]
    if kind == 3:
        return content[:i] + content[j:]
    if kind == 4:
        return content[:j] + content[i:]
    return content[:i] + rng.bytes(j - i) + content[j:]


@pytest.mark.parametrize("suffix", [".parquet", ".steps.parquet"])
def test_no_damage_of_a_cell_changes_a_number(cells: Path, suffix: str) -> None:
    path = cells / f"{KEY}{suffix}"
    whole = path.read_bytes()
    rng = np.random.default_rng(10)
    tried = [damaged(whole, rng) for _ in range(400)]
    # each byte of the footer once: names, types and places of the columns
    footer = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    tried += [whole[:i] + bytes([whole[i] ^ 0x01]) + whole[i + 1 :] for i in range(footer, len(whole))]
    for content in tried:
        path.write_bytes(content)
        store = Store(cells.parent)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = store.read(KEY) if suffix == ".parquet" else store.read_steps(KEY)
        if content == whole:
            assert found is not None
        else:
            assert found is None
            assert [w.category for w in told] == [DamagedResult]
            assert "computed again: " in str(told[0].message)


def test_a_cell_is_read_as_it_was_written(cells: Path) -> None:
    store = Store(cells.parent)
    row, steps = store.read(KEY), store.read_steps(KEY)
    assert row is not None
    assert steps is not None
    expected = {name: value for name, value in ROW.items() if not name.startswith("run_")}
    assert repr(row) == repr(expected)
    for name, values in STEPS.items():
        np.testing.assert_array_equal(steps[name], values)
    # and other programs read it
    assert pq.read_table(cells / f"{KEY}.parquet")["run_captured"].to_pylist() == [ROW["run_captured"]]


def test_a_cell_under_another_name_is_refused(cells: Path) -> None:
    (cells / f"{KEY}.parquet").rename(cells / f"{OTHER}.parquet")
    with pytest.warns(DamagedResult, match="another cell's"):
        assert Store(cells.parent).read(OTHER) is None


@pytest.mark.parametrize(("given", "named"), [(".parquet", ".steps.parquet"), (".steps.parquet", ".parquet")])
def test_a_row_is_not_taken_for_steps_nor_steps_for_a_row(cells: Path, given: str, named: str) -> None:
    (cells / f"{KEY}{given}").replace(cells / f"{KEY}{named}")
    store = Store(cells.parent)
    with pytest.warns(DamagedResult, match="another cell's"):
        assert (store.read(KEY) if named == ".parquet" else store.read_steps(KEY)) is None


def test_a_table_that_was_damaged_or_is_another_is_refused(tmp_path: Path) -> None:
    table, other = tmp_path / "runs.parquet", tmp_path / "results.parquet"
    write_table(table, columns_of([{"e_p_m": 1.0}, {"e_p_m": 2.0}]))
    assert read_table(table) == [{"e_p_m": 1.0}, {"e_p_m": 2.0}]
    whole = table.read_bytes()
    name = whole.rindex(b"e_p_m")
    for damaged in (whole[:name] + b"e_b_m" + whole[name + 5 :], whole[:-20], b""):
        table.write_bytes(damaged)
        with pytest.raises(LaisnError, match=r"runs\.parquet: it (is damaged|has no seal).*writes it again"):
            read_table(table)
    other.write_bytes(whole)
    with pytest.raises(LaisnError, match="another cell's, mission's or table's"):
        read_table(other)


def test_a_seal_holds_for_one_name_and_all_bytes() -> None:
    content = sealed(b"before" + blank("mine") + b"after")
    require_whole(content, "mine")
    assert len(content) == len(b"beforeafter") + len(blank("mine"))
    with pytest.raises(ValueError, match="another"):
        require_whole(content, "yours")
    for i in range(len(content)):
        with pytest.raises(ValueError, match=r"damaged|no seal|another"):
            require_whole(content[:i] + bytes([content[i] ^ 0x10]) + content[i + 1 :], "mine")
    with pytest.raises(ValueError, match="no seal"):
        sealed(b"no seal")


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "\x00" * 40, "[" * 100_000])
def test_a_damaged_manifest_is_written_again(cells: Path, text: str) -> None:
    manifest = cells.parent / "campaign.json"
    whole = manifest.read_bytes()
    manifest.write_text(text)
    with pytest.warns(DamagedResult, match=r"campaign\.json cannot be read and is written again"):
        assert Store(cells.parent).read(KEY) is not None
    assert manifest.read_bytes() == whole


OPENER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_store import KEY, ROW, STEPS
from experiments.campaign.store import Store
for i in range(100):
    store = Store(Path(sys.argv[1]), force=i % 3 == 2)
    if i % 3:
        store.write(KEY, ROW, STEPS)
    row = Store(Path(sys.argv[1])).read(KEY)
    assert row is None or row["e_p_mean_m"] == 0.25
"""


def test_processes_that_share_a_folder_never_fail(tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    command = [sys.executable, "-W", "error", "-c", OPENER, str(folder), str(Path(__file__).parent)]
    children = [subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for child in children:
        _, words = child.communicate(timeout=300)
        assert child.returncode == 0, words
    assert sorted(p.name for p in folder.rglob("*")) == [
        f"{KEY}.parquet", f"{KEY}.steps.parquet", "campaign.json", "cells"
    ]  # fmt: skip

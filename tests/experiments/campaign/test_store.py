"""Stored results: no damage changes a number, and processes may share a folder."""

import errno
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
import typer

from experiments.campaign.store import Arrays, DamagedResult, Record, Store, read_table, write_table
from laisn.errors import LaisnError
from laisn_sim.cli.errors import report_errors
from reports.version import ROOT

KEY, OTHER = "0123456789abcdef01234567", "76543210fedcba9876543210"
RECORD: Record = {
    "key": KEY,
    "variant": "laisn-2",
    "runs": 3,
    "e_p_mean_m": 0.1 + 0.2,
    "nees": float("nan"),
    "none": None,
    "list": [0.1, 0.2, 1e-300],
    "flags": [False, True, False],
}
ARRAYS: Arrays = {
    "time_s": np.linspace(0.1, 20.0, 200, dtype=np.float32),
    "e_p_mean_m": np.ones(200, dtype=np.float32),
    "mirror_locked": np.array([False, True, False]),
}


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Holds one result, as another process left it."""
    Store(tmp_path).put(KEY, RECORD, ARRAYS)
    return Store(tmp_path)


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """The content with a flipped bit, cut short, or with a piece zeroed, left out, repeated or
    overwritten at random.
    """
    size = len(content)
    i, j = sorted(rng.integers(0, size, 2).tolist())
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


def comparable(stored: tuple[Any, Arrays] | None) -> object:
    """All of a result, to the bit, in a form to compare; None if there is none."""
    return stored and (
        repr(stored[0]),
        {name: (array.dtype, array.shape, array.tobytes()) for name, array in stored[1].items()},
    )


@pytest.mark.system
def test_no_damage_of_a_result_changes_a_number(store: Store) -> None:
    """After 400 kinds of damage, and with one bit of every byte flipped, a result is refused or
    the same: bytes that no checksum of a zip archive covers, such as times and attributes, may
    change.
    """
    path = store.path(KEY)
    whole = path.read_bytes()
    rng = np.random.default_rng(10)
    damaged_contents = [damaged(whole, rng) for _ in range(400)]
    damaged_contents += [
        whole[:i] + bytes([whole[i] ^ (1 << i % 8)]) + whole[i + 1 :] for i in range(len(whole))
    ]
    refused = 0
    for damaged_content in damaged_contents:
        path.write_bytes(damaged_content)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            actual = comparable(store.get(KEY))
        if actual is None:
            assert [warning.category for warning in caught] == [DamagedResult]
            assert "computed again: " in str(caught[0].message)
            refused += 1
        else:
            assert actual == comparable((RECORD, ARRAYS))
    assert refused > 0.8 * len(damaged_contents)


def test_a_result_is_read_as_it_was_written(store: Store) -> None:
    record, arrays = store.get(KEY) or (None, {})
    assert repr(record) == repr(RECORD)
    assert {name: values.tolist() for name, values in arrays.items()} == {
        name: values.tolist() for name, values in ARRAYS.items()
    }
    assert store.get(OTHER) is None
    store.put(
        OTHER,
        [{"array": np.array([0.1, 0.2]), "number": np.float64(0.3), "count": np.int64(4)}],
        {},
    )
    assert store.get(OTHER) == ([{"array": [0.1, 0.2], "number": 0.3, "count": 4}], {})


@pytest.mark.parametrize("runs", [1, 3, 400])
def test_columns_are_read_as_they_were_written(store: Store, runs: int) -> None:
    """Whether they are few numbers, many in columns of one length, or of several lengths."""
    numbers = np.random.default_rng(runs).normal(size=runs)
    columns: Arrays = {
        "run": np.arange(runs, dtype=np.int64),
        "e_p_mean_m": numbers,
        "share": numbers.astype(np.float32),
        "mirror_locked": numbers > 0.0,
        "unknown": np.full(runs, np.nan),
        "endless": np.full(runs, -np.inf),
        "smallest": np.full(runs, 5e-324),
    }
    for arrays in (columns, columns | {"time_s": np.arange(runs + 300.0)}):
        store.put(OTHER, RECORD, arrays)
        assert comparable(store.get(OTHER)) == comparable((RECORD, arrays))
        assert [*(store.get(OTHER) or ({}, {}))[1]] == [*arrays]


def test_the_same_result_gives_the_same_bytes(store: Store) -> None:
    first = store.path(KEY).read_bytes()
    store.put(KEY, RECORD, ARRAYS)
    assert store.path(KEY).read_bytes() == first


def test_a_result_under_another_key_is_refused(store: Store) -> None:
    store.path(KEY).rename(store.path(OTHER))
    with pytest.warns(DamagedResult, match="another result"):
        assert store.get(OTHER) is None


def test_a_table_with_a_damaged_page_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.parquet"
    values = np.random.default_rng(1).normal(size=500)
    write_table(path, {"e_p_m": values})
    assert read_table(path) == [{"e_p_m": value} for value in values.tolist()]
    whole = path.read_bytes()
    # pages stand before the footer, which its last eight bytes measure
    pages = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    for offset in np.random.default_rng(2).integers(100, pages, 40).tolist():
        path.write_bytes(whole[:offset] + bytes([whole[offset] ^ 0x10]) + whole[offset + 1 :])
        with pytest.raises(LaisnError, match=r"runs\.parquet: it is damaged: .*writes it again"):
            read_table(path)
    for remainder in (whole[:-20], b""):
        path.write_bytes(remainder)
        with pytest.raises(LaisnError, match="it is damaged"):
            read_table(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", "\x00" * 40, "[" * 100_000])
def test_a_damaged_manifest_is_written_again(store: Store, text: str) -> None:
    manifest = store.folder / "campaign.json"
    whole = manifest.read_bytes()
    manifest.write_text(text)
    assert Store(store.folder).get(KEY) is not None
    assert manifest.read_bytes() == whole


# a process that opens, empties and fills the folder in turn
OPENER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_store import ARRAYS, KEY, RECORD
from experiments.campaign.store import Store
for i in range(100):
    store = Store(Path(sys.argv[1]), force=i % 3 == 2)
    if i % 3:
        store.put(KEY, RECORD, ARRAYS)
    result = Store(Path(sys.argv[1])).get(KEY)
    assert result is None or result[0]["runs"] == 3
"""


@pytest.mark.system
def test_processes_that_share_a_folder_never_fail(tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    command = [sys.executable, "-W", "error", "-c", OPENER, str(folder), str(Path(__file__).parent)]
    children = [
        subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) for _ in range(3)
    ]
    for child in children:
        _, errors = child.communicate(timeout=300)
        assert child.returncode == 0, errors
    assert sorted(path.name for path in folder.rglob("*")) == [
        f"{KEY}.zip",
        "campaign.json",
        "store",
    ]


def test_the_error_of_a_full_disk_names_the_file_being_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The system reports a full disk without the name of the file that is being written."""

    def raise_disk_full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    store = Store(tmp_path)
    monkeypatch.setattr(ZipFile, "writestr", raise_disk_full)
    with pytest.raises(OSError, match="No space left") as caught:
        store.put("a", {}, {})
    assert caught.value.filename == str(store.path("a"))
    assert [path.name for path in (tmp_path / "store").iterdir()] == []
    with pytest.raises(typer.Exit) as exited, report_errors():
        raise caught.value
    assert exited.value.exit_code == 2
    assert "make room there, or choose another folder" in capsys.readouterr().err

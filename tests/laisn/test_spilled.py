"""Arrays of long missions in files."""

import mmap
import os
import threading
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from laisn import spilled
from laisn.arrays import records
from laisn.estimates import Estimates, FixKind, FixRecord, FixTable, TightEstimates
from sim.trajectory import StateHistory, Trajectory


def test_a_long_array_is_in_a_file_without_a_name_and_keeps_its_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    array = spilled.spillable_zeros((spilled.SPILLED_FROM, 3))
    assert spilled.is_spilled(array.base)
    assert not array.any()
    array[:, 1] = np.arange(spilled.SPILLED_FROM)
    spilled.release_mapped_memory()
    np.testing.assert_array_equal(array[:, 1], np.arange(spilled.SPILLED_FROM))
    assert not array[:, 0].any()
    assert list(tmp_path.iterdir()) == []


def test_a_short_array_is_in_memory() -> None:
    array = spilled.spillable_zeros((spilled.SPILLED_FROM - 1, 3))
    assert array.base is None
    assert array.flags.owndata


def refuse(*_: object) -> NoReturn:
    raise OSError("no space left on device")


def test_without_room_on_the_disk_arrays_are_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "posix_fallocate", refuse)
    array = spilled.spillable_zeros((spilled.SPILLED_FROM,), np.int64)
    assert not spilled.is_spilled(array.base)
    assert array.dtype == np.int64


def test_the_truth_of_a_long_mission_is_not_copied() -> None:
    n = spilled.SPILLED_FROM
    truth = StateHistory.empty(n, 1, 2)
    truth.pose[:, :, 3] = 1.0
    for array in truth:
        array.flags.writeable = False
    trajectory = Trajectory(
        names=("leader",),
        time=np.linspace(0.0, 0.1 * (n - 1), n),
        pose=truth.pose,
        twist=truth.twist,
        water_velocity=truth.water,
        effector_states=truth.effector_states,
        effector_force=np.zeros((1, 2, 3)),
        site_names=(),
        site_vehicle=np.zeros(0, dtype=np.int64),
        site_offset=np.zeros((0, 3)),
    )
    assert trajectory.pose is truth.pose
    assert isinstance(trajectory.pose.base, mmap.mmap)


def test_records_of_a_long_mission_have_their_fields() -> None:
    position = np.dtype([("east", np.float64), ("north", np.float64)])
    table = records(position, spilled.SPILLED_FROM, 2)
    table.north[5, 1] = 2.5
    spilled.release_mapped_memory()
    assert (table[5, 1].east, table[5, 1].north) == (0.0, 2.5)


def test_memory_is_released_again_and_again_until_the_block_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    released = threading.Semaphore(0)
    monkeypatch.setattr(spilled, "_RELEASE_EVERY_S", 0.001)
    monkeypatch.setattr(spilled, "release_mapped_memory", released.release)
    with spilled.released_regularly():
        for _ in range(3):
            assert released.acquire(timeout=30.0)
    # the last time is after the block, by this thread
    while released.acquire(blocking=False):
        pass
    assert not released.acquire(timeout=0.05)


def test_copies_of_long_arrays_are_in_files_and_keep_the_memory_order() -> None:
    n = spilled.SPILLED_FROM
    table = np.arange(4.0 * n).reshape(n, 4)
    estimates = Estimates.of(table, np.zeros((n, 4, 4)), [])
    assert estimates.state is not table
    assert spilled.is_spilled(estimates.state.base)
    np.testing.assert_array_equal(estimates.state, table)
    column_major = Estimates.of(np.asfortranarray(table), np.zeros((n, 4, 4)), [])
    assert column_major.state.flags.f_contiguous
    np.testing.assert_array_equal(column_major.state, table)


def test_a_table_of_fixes_grows_and_gives_what_they_hold() -> None:
    """Of the tightly coupled navigator, whose fixes have details; in files when there are many."""
    rng = np.random.default_rng(3)
    columns = TightEstimates.DETAILS.columns
    fixes = [
        FixRecord(
            step=step,
            position=rng.normal(size=2),
            sigma=float(rng.random()),
            kind=FixKind.RANGES if step % 3 else FixKind.LOST,
            innovation=rng.normal(size=2),
            details={
                column.attribute: step if column.integer else rng.normal(size=column.shape)
                for column in columns
            },
        )
        for step in range(1, 300)
    ]
    table = FixTable(TightEstimates)
    for fix in fixes:
        table.extend([fix])
    expected = TightEstimates.of(np.zeros((300, 4)), np.zeros((300, 4, 4)), fixes)
    assert len(table.rows) == 299
    for name in table.rows.dtype.names:
        np.testing.assert_array_equal(table.rows[name], getattr(expected, name), name)

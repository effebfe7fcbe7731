"""Arrays of long missions in files."""

import mmap
import os
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from laisn import spilled
from laisn.arrays import records
from sim.trajectory import StateHistory, Trajectory


def test_a_long_array_is_in_a_file_without_a_name_and_keeps_its_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    array = spilled.room((spilled.LONG, 3))
    assert spilled.is_spilled(array.base)
    assert not array.any()
    array[:, 1] = np.arange(spilled.LONG)
    spilled.release()
    np.testing.assert_array_equal(array[:, 1], np.arange(spilled.LONG))
    assert not array[:, 0].any()
    assert list(tmp_path.iterdir()) == []


def test_a_short_array_is_in_memory() -> None:
    array = spilled.room((spilled.LONG - 1, 3))
    assert array.base is None
    assert array.flags.owndata


def refuse(*_: object) -> NoReturn:
    raise OSError("no space left on device")


def test_without_room_on_the_disk_arrays_are_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "posix_fallocate", refuse)
    array = spilled.room((spilled.LONG,), np.int64)
    assert not spilled.is_spilled(array.base)
    assert array.dtype == np.int64


def test_the_truth_of_a_long_mission_is_not_copied() -> None:
    n = spilled.LONG
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
        thrust=truth.thrust,
        effector_force=np.zeros((1, 2, 3)),
        site_names=(),
        site_vehicle=np.zeros(0, dtype=np.int64),
        site_offset=np.zeros((0, 3)),
    )
    assert trajectory.pose is truth.pose
    assert isinstance(trajectory.pose.base, mmap.mmap)


def test_records_of_a_long_mission_have_their_fields() -> None:
    table = records(np.dtype([("east", np.float64), ("north", np.float64)]), spilled.LONG, 2)
    table.north[5, 1] = 2.5
    spilled.release()
    assert (table[5, 1].east, table[5, 1].north) == (0.0, 2.5)

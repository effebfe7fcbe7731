"""Tables of rays that later processes find on disk."""

from pathlib import Path

import numpy as np
import pytest

from sim.water import refraction, table_store
from sim.water.floors import LevelFloor
from sim.water.ray_table import RayTable
from sim.water.refraction import Extent, RefractedRays, refracted_rays

POINTS = [[0.0, 1480.0], [10.0, 1470.0], [20.0, 1450.0]]


def rays_as_by_another_process() -> RefractedRays:
    refraction._table.cache_clear()
    return refracted_rays(POINTS, LevelFloor(20.0), Extent(10.0, 25.0), surface_echoes=False)


@pytest.fixture
def computations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What was computed, rather than read, with a folder of its own."""
    computations: list[object] = []
    compute = refraction.table_of

    def counting_table_of(*arguments: object) -> RayTable:
        computations.append(arguments)
        return compute(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(refraction, "table_of", counting_table_of)
    monkeypatch.setattr(table_store, "FOLDER", tmp_path)
    return computations


def test_a_table_is_computed_once_for_all_processes(
    computations: list[object], tmp_path: Path
) -> None:
    first = rays_as_by_another_process()
    second = rays_as_by_another_process()
    assert len(computations) == 1
    for stored, fresh in zip(second.direct, first.direct, strict=True):
        np.testing.assert_array_equal(stored, fresh)
    (file,) = (tmp_path / "rays").glob("*.npz")
    # other content has another table
    refraction._table.cache_clear()
    faster = [[depth, speed + 1.0] for depth, speed in POINTS]
    refracted_rays(faster, LevelFloor(20.0), Extent(10.0, 25.0), surface_echoes=False)
    assert len(computations) == 2
    # and one that is damaged is computed again
    file.write_bytes(file.read_bytes()[:1000])
    np.testing.assert_array_equal(rays_as_by_another_process().direct.value, first.direct.value)
    assert len(computations) == 3


def test_where_no_folder_can_be_made_tables_are_computed_each_time(
    computations: list[object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(table_store, "FOLDER", None)
    rays_as_by_another_process()
    (tmp_path / "file").touch()
    monkeypatch.setattr(table_store, "FOLDER", tmp_path / "file")
    rays_as_by_another_process()
    assert len(computations) == 2


def test_no_more_than_the_largest_number_of_tables_is_stored(
    computations: list[object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(table_store, "_MAX_TABLES", 2)
    table = rays_as_by_another_process().direct
    for number in range(3):
        table_store.stored_table([number], lambda: table)
    assert len(list((tmp_path / "rays").glob("*.npz"))) == 2

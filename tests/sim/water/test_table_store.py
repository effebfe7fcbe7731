"""Tables of rays that later processes find on disk."""

from pathlib import Path

import numpy as np
import pytest

from sim.water import refraction, table_store
from sim.water.floors import LevelFloor
from sim.water.ray_table import RayTable
from sim.water.refraction import Extent, RefractedRays, refracted_rays

POINTS = [[0.0, 1480.0], [10.0, 1470.0], [20.0, 1450.0]]


def rays_of_another_process() -> RefractedRays:
    refraction._table.cache_clear()
    return refracted_rays(POINTS, LevelFloor(20.0), Extent(10.0, 25.0), surface_echoes=False)


@pytest.fixture
def computed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What was computed, rather than read, with a folder of its own."""
    made: list[object] = []
    compute = refraction.table_of

    def counted(*arguments: object) -> RayTable:
        made.append(arguments)
        return compute(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(refraction, "table_of", counted)
    monkeypatch.setattr(table_store, "FOLDER", tmp_path)
    return made


def test_a_table_is_computed_once_for_all_processes(computed: list[object], tmp_path: Path) -> None:
    first = rays_of_another_process()
    second = rays_of_another_process()
    assert len(computed) == 1
    for stored, fresh in zip(second.direct, first.direct, strict=True):
        np.testing.assert_array_equal(stored, fresh)
    (file,) = (tmp_path / "rays").glob("*.npz")
    # other content has another table
    refraction._table.cache_clear()
    deeper = [[depth, speed + 1.0] for depth, speed in POINTS]
    refracted_rays(deeper, LevelFloor(20.0), Extent(10.0, 25.0), surface_echoes=False)
    assert len(computed) == 2
    # and one that is damaged is computed again
    file.write_bytes(file.read_bytes()[:1000])
    np.testing.assert_array_equal(rays_of_another_process().direct.value, first.direct.value)
    assert len(computed) == 3


def test_without_a_folder_tables_are_computed(
    computed: list[object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(table_store, "FOLDER", None)
    rays_of_another_process()
    (tmp_path / "file").touch()
    monkeypatch.setattr(table_store, "FOLDER", tmp_path / "file")
    rays_of_another_process()
    assert len(computed) == 2


def test_few_tables_are_kept(
    computed: list[object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(table_store, "_MAX_TABLES", 2)
    table = rays_of_another_process().direct
    for number in range(3):
        table_store.stored_table([number], lambda: table)
    assert len(list((tmp_path / "rays").glob("*.npz"))) == 2

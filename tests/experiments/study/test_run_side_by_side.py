"""Runs of a closed loop side by side in a study: the same results as alone, to the bit."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from experiments.campaign import campaign
from experiments.study import measure
from experiments.study.file import study_of
from experiments.study.plan import StudyPlan, plan_of
from experiments.study.run import StudyResults, fly_studies
from sim.mission_group import MissionGroup
from sim.simulation import Mission

pytestmark = pytest.mark.system


SCENARIO = """
name = "stations"
duration_s = 20.0
navigation.variant = "tight"
leader.broadcast_attitude = true

[[followers]]
name = "port"
station = { behind_m = 8.0, port_m = 8.0, depth_m = 9.0 }

[[followers]]
name = "astern"
station = { behind_m = 16.0, port_m = 0.0, depth_m = 11.0 }
"""


def plan(folder: Path, **keys: Any) -> StudyPlan:
    """A study of two followers on stations, at ten runs of two currents."""
    folder.mkdir()
    path = folder / "stations.toml"
    path.write_text(SCENARIO, encoding="utf-8")
    vary = {"ocean.current_speed_m_s": [0.0, 0.2]}
    return plan_of(study_of(str(path), {"runs": 10, "vary": vary, **keys}))


def results_of(folder: Path, **keys: Any) -> StudyResults:
    """Its results."""
    (results,) = fly_studies([plan(folder, **keys)], folder / "results", workers=1, quiet=True)
    return results


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many missions each group has that is flown side by side."""
    sizes: list[int] = []
    form = MissionGroup.__init__

    def forming(group: MissionGroup, missions: Sequence[Mission]) -> None:
        form(group, missions)
        sizes.append(len(missions))

    monkeypatch.setattr(MissionGroup, "__init__", forming)
    return sizes


def test_a_study_gives_the_same_side_by_side_and_alone(
    tmp_path: Path, groups: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twenty runs are few, and flown alone; else eight of each current beside each other, and two,
    which move faster alone.
    """
    alone = results_of(tmp_path / "alone")
    assert groups == []
    monkeypatch.setattr(campaign, "_MANY_TASKS", 20)
    together = results_of(tmp_path / "together")
    assert groups == [8, 8]
    assert together.rows == alone.rows
    assert together.runs == alone.runs
    assert len({row["track_error_rms_m"] for row in together.rows}) == 4


def test_missions_that_would_fill_the_memory_are_flown_alone(
    tmp_path: Path, groups: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """There are 200 instants of three vehicles: room for 3,000 states is that of five missions."""
    monkeypatch.setattr(campaign, "_MANY_TASKS", 20)
    monkeypatch.setattr("experiments.study.run._MOST_STATES", 3_000)
    results_of(tmp_path / "few")
    assert groups == [5, 5, 5, 5]
    groups.clear()
    results_of(tmp_path / "mujoco", engine="mujoco")
    assert groups == []


def test_runs_that_end_early_do_not_touch_others(
    tmp_path: Path, groups: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A follower 1 m above the floor, by a bad pressure sensor, reaches it in some runs: nothing of
    these counts, in either way of flying them.
    """
    settings = {"set": {"ocean.floor_depth_m": 12.0, "sensors.depth_sigma_m": 10.0}}
    alone = results_of(tmp_path / "alone", **settings)
    monkeypatch.setattr(campaign, "_MANY_TASKS", 20)
    together = results_of(tmp_path / "together", **settings)
    assert groups == [8, 8]
    assert together.rows == alone.rows
    assert together.runs == alone.runs
    shares = {row["follower"]: row["ended"] for row in together.rows}
    assert 0.0 < shares["astern"] < 1.0


def test_a_run_that_is_lost_is_left_to_be_flown_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of four, one whose navigator failed, and one that left finite numbers."""
    scenario = plan(tmp_path / "study").entries[0].scenario

    def fly(missions: Sequence[Mission]) -> list[bool]:
        missions[3].advance(10)
        missions[3].plant.twist[1, 0] = 1e200
        return [True, False, True, True]

    monkeypatch.setattr(measure, "fly_side_by_side", fly)
    rows = measure.records_of_runs([(scenario, run) for run in range(1, 5)])
    assert [row is None for row in rows] == [False, True, False, True]
    assert rows[2] == measure.records_of_run(scenario, 3)

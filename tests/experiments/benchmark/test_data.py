"""Missions and files of LAISN-Bench: what they hold, and that they stay as they are."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark import data
from experiments.benchmark.catalogue import missions
from experiments.benchmark.data import MANIFEST
from experiments.benchmark.tables import (
    RANGE_COLUMNS,
    read_columns,
    read_measurements,
    read_truth,
)
from experiments.flight.library import load_scenario
from laisn.errors import LaisnError
from laisn.messages import Ranges
from sim.log.reader import Pings, read_recording
from tests.experiments.benchmark.sample import SAMPLE, laisn, scores_of

DVL_NAVIGATOR = (
    "import numpy as np\n"
    "class ByDvl:\n"
    "    needs = ('dvl',)\n"
    "    def __init__(self, settings, start):\n"
    "        self.state, self.covariance = np.array(start, float), np.eye(4)\n"
    "    def step(self, own, reception, dt):\n"
    "        forward, port, _, _ = own.custom['dvl']\n"
    "        if np.isfinite(forward):\n"
    "            sine, cosine = np.sin(own.heading), np.cos(own.heading)\n"
    "            self.state[2:] = forward * sine - port * cosine, forward * cosine + port * sine\n"
    "        self.state[:2] += dt * self.state[2:]\n"
)
"""A plugin: dead reckoning by compass and DVL."""


@pytest.mark.parametrize("name", list(missions()))
def test_every_mission_makes_a_scenario_with_its_seed_name_and_transmitters(name: str) -> None:
    mission = missions()[name]
    scenario = mission.scenario(3)
    assert scenario.seed == 3
    assert scenario.name == name
    assert scenario.navigation.assume.transmitters == mission.transmitters


def test_20_missions_are_scored() -> None:
    assert sum(mission.scored for mission in missions().values()) == 20


def test_what_killed_workers_left_half_written_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(folder: Path, *_: object) -> None:
        (folder / "measurements" / "astern").mkdir(parents=True)
        (folder / "measurements" / "astern" / ".follower.csv.1234.part").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr(data, "write_run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        data.generate(tmp_path, list(missions().values())[:1], [1])
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda lines: lines[:1], "has no rows"),
        (
            lambda lines: [*lines[:-1], ",".join(["x"] * len(lines[0].split(",")))],
            "column 'time .s.', row [0-9]+ of the values: 'x'; expected a number",
        ),
        (
            lambda lines: [*lines[:-1], lines[-1].rpartition(",")[0] + ",x"],
            "column 'range_middle .m.', row [0-9]+ of the values: 'x'; expected a number",
        ),
    ],
)
def test_broken_measurements_are_refused(
    tmp_path: Path, damage: Callable[[list[str]], list[str]], problem: str
) -> None:
    table = SAMPLE / "measurements" / "astern" / "01" / "follower.csv"
    copy = tmp_path / "follower.csv"
    copy.write_text("\n".join(damage(table.read_text(encoding="utf-8").splitlines())) + "\n")
    with pytest.raises(LaisnError, match=problem):
        read_measurements(copy)


def test_an_imported_table_has_the_measurements_of_the_table(tmp_path: Path) -> None:
    """A table of the benchmark is one that `laisn log import` takes."""
    table = SAMPLE / "measurements" / "astern" / "01" / "follower.csv"
    laisn("log", "import", table, "--out", tmp_path / "run.mcap")
    imported, *_ = read_recording(tmp_path / "run.mcap")
    measured = read_measurements(table)
    assert imported.dt == measured.dt
    np.testing.assert_array_equal(imported.message_step, measured.message_step)
    for name in ("speed", "heading", "depth", "ranges", "message"):
        np.testing.assert_allclose(
            getattr(imported, name), getattr(measured, name), rtol=1e-12, err_msg=name
        )


@pytest.mark.system
def test_slots_give_the_same_measurements_by_table_and_logs(tmp_path: Path) -> None:
    """The table, the log of the simulator and the log of the imported table, whose importer does
    not know of the slots, are the same to a navigator that a replay gives the slots.
    """
    folder = tmp_path / "data"
    options = ("--mission", "slots", "--seeds", 1, "--seconds", 60, "--workers", 1)
    laisn("bench-data", folder, *options, "--format", "mcap")
    run = folder / "measurements" / "slots" / "01"
    measured = read_measurements(run / "follower.csv")
    laisn("log", "import", run / "follower.csv", "--out", tmp_path / "run.mcap")
    task = load_scenario(str(folder / "tasks" / "slots.toml"), ())
    pings = Pings(task.acoustics.ping_slot_s, task.acoustics.sound_speed_m_s)
    assert pings.slot_s > 0.0
    for path in (run / "measurements.mcap", tmp_path / "run.mcap"):
        logged, remarks, time_s = read_recording(path, pings=pings)
        assert remarks == ()
        np.testing.assert_array_equal(time_s, np.round(measured.time, 6))
        np.testing.assert_array_equal(logged.message_step, measured.message_step)
        for name in ("speed", "heading", "depth", "ranges", "message"):
            np.testing.assert_allclose(
                getattr(logged, name), getattr(measured, name), rtol=1e-12, err_msg=name
            )


def test_a_mission_of_two_transmitters_has_no_column_of_the_third() -> None:
    folder = SAMPLE / "measurements"
    three = read_columns(folder / "astern" / "01" / "follower.csv")
    two = read_columns(folder / "straight-astern-two" / "01" / "follower.csv")
    assert RANGE_COLUMNS[:2] == tuple(name for name in two if name.startswith("range_"))
    assert tuple(name for name in three if name.startswith("range_")) == RANGE_COLUMNS


@pytest.mark.system
def test_version_1_stays_as_it_is(tmp_path: Path) -> None:
    """Written anew, the sample of the repository is the same to one digit of the last decimal.

    A sample that differs more is another version of the benchmark: VERSION has to be raised.
    """
    manifest = json.loads((SAMPLE / MANIFEST).read_text(encoding="utf-8"))
    mission_options = [word for name in manifest["missions"] for word in ("--mission", name)]
    seconds = manifest["seconds"]
    folder = tmp_path / "data"
    laisn(
        "bench-data", folder, *mission_options, "--seeds", 1, "--seconds", seconds, "--workers", 1
    )
    written = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    assert list(written["files"]) == list(manifest["files"])
    for name in manifest["files"]:
        if name.endswith(".toml"):
            assert (folder / name).read_text("utf-8") == (SAMPLE / name).read_text("utf-8")
            continue
        new, old = read_columns(folder / name), read_columns(SAMPLE / name)
        assert list(new) == list(old)
        for column, old_values in old.items():
            np.testing.assert_allclose(
                new[column], old_values, rtol=0, atol=1.01e-4, err_msg=column
            )


@pytest.mark.system
def test_further_sensors_are_in_all_formats_and_navigators_get_them(tmp_path: Path) -> None:
    """The tables and the log have the same readings, which agree with the truth to their noise;
    dead reckoning by the DVL, which measures over ground, is not carried off by the current.
    """
    folder = tmp_path / "data"
    options = ("--mission", "bottom-lock", "--seeds", 1, "--seconds", 60, "--workers", 1)
    laisn("bench-data", folder, *options, "--format", "mcap")
    measured = read_measurements(folder / "measurements" / "bottom-lock" / "01" / "follower.csv")
    log, *_ = read_recording(folder / "measurements" / "bottom-lock" / "01" / "measurements.mcap")
    assert set(measured.custom) == {"dvl", "gyros", "inclinometer"}
    for name, readings in measured.custom.items():
        np.testing.assert_allclose(log.custom[name], readings, rtol=0, atol=1e-12, err_msg=name)
    forward, port, _, altitude = measured.custom["dvl"].T
    measured_steps = np.isfinite(forward)
    # the DVL measures at every second step of 0.1 s, and one reading in ten drops out
    assert np.isnan(forward[::2]).all()
    assert 0.8 < 2.0 * measured_steps.mean() < 0.98
    truth = read_truth(folder / "truth" / "bottom-lock" / "01" / "follower.csv")
    speed = np.hypot(*np.gradient(truth.position, measured.dt, axis=0).T)
    np.testing.assert_allclose(
        np.hypot(forward, port)[measured_steps], speed[measured_steps], atol=0.06
    )
    # the sea is 30 m deep
    assert np.all(np.abs(altitude[measured_steps] + measured.depth[measured_steps] - 30.0) < 0.3)
    (tmp_path / "bottom.py").write_text(DVL_NAVIGATOR, encoding="utf-8")
    laisn(
        *("score", "--navigator", "bottom:ByDvl", "--plugin", tmp_path / "bottom.py"),
        *("--data", folder, "--out", tmp_path / "scores.csv"),
    )
    (row,) = scores_of(tmp_path / "scores.csv")
    # by the log, which measures through the water, 60 s in a current of 0.3 m/s are 18 m off
    assert float(row["e_p_max_m"]) < 9.0


@pytest.mark.system
def test_a_task_has_the_sound_speed_profile_by_which_rays_bend(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    options = ("--mission", "thermocline", "--seeds", 1, "--seconds", 20, "--workers", 1)
    laisn("bench-data", folder, *options)
    task = load_scenario(str(folder / "tasks" / "thermocline.toml"), ())
    mission = missions()["thermocline"].scenario(1)
    assert task.acoustics.sound_speed_profile == mission.acoustics.sound_speed_profile
    assert task.acoustics.rays == mission.acoustics.rays == "refracted"
    printed = laisn("score", "--navigator", "tight", "--data", folder)
    assert "geometric mean of 1 mission" in printed


def test_a_file_that_differs_from_the_manifest_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    shutil.copytree(SAMPLE, folder)
    assert "files are as" in laisn("bench-data", folder, "--check")
    truth = folder / "truth" / "astern" / "01" / "follower.csv"
    truth.write_text(truth.read_text("utf-8").replace("90.0000", "90.0001", 1), "utf-8")
    assert "truth/astern/01/follower.csv" in laisn("bench-data", folder, "--check", code=2)


def test_data_that_would_be_lost_are_named_and_kept(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    shutil.copytree(SAMPLE, folder)
    command = ("bench-data", folder, "--seconds", "20")
    flown, *more = data.read_manifest(folder)["missions"]
    files = [path for path in folder.rglob("*") if path.is_file()]
    printed = laisn(*command, "--mission", flown, code=2)
    assert f"holds data of {', '.join(sorted(more))}, which would be removed" in printed
    own = folder / "measurements" / "mine.csv"
    own.write_text("mine", "utf-8")
    assert "holds measurements/mine.csv" in laisn(*command, "--mission", flown, code=2)
    assert {path for path in folder.rglob("*") if path.is_file()} == {*files, own}
    assert "files are as" in laisn("bench-data", folder, "--check")


def test_ranges_have_the_order_of_the_transmitters() -> None:
    assert tuple(f"range_{name} [m]" for name in Ranges._fields) == RANGE_COLUMNS

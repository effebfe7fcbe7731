"""LAISN-Bench: its missions and files, and scores against errors that are known in advance."""

import csv
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.benchmark.catalogue import missions
from experiments.benchmark.data import MANIFEST
from experiments.benchmark.score import (
    SEGMENTS_M,
    FollowerRun,
    Track,
    score_mission,
    score_run,
    total,
)
from experiments.benchmark.tables import (
    RANGES,
    Truth,
    read_columns,
    read_measurements,
    read_truth,
)
from experiments.flight.library import load_scenario
from laisn.arrays import Floats
from laisn.messages import Ranges
from laisn_sim.cli.main import app
from sim.log.reader import read_recording

ROOT = Path(__file__).resolve().parents[3]
SAMPLE = ROOT / "examples" / "benchmark"
RUN = FollowerRun("astern", 1, "follower")
N = 2000
DT = 0.1
BOTTOM = (
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
"""Dead reckoning by compass and DVL."""


def laisn(*words: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return " ".join(result.output.split())


def straight_truth() -> Truth:
    """A follower that goes east at 1 m/s, 20 m south of its leader."""
    time = DT * np.arange(1, N + 1)
    position = np.column_stack([time, np.zeros(N)])
    return Truth(time, position, position + np.array([0.0, 20.0]), np.full(N, 0.5))


def track(offset: Floats, covariance: tuple[float, float, float], stride: int = 1) -> Track:
    truth = straight_truth()
    rows = slice(stride - 1, None, stride)
    position = (truth.position + offset)[rows]
    return Track(truth.time[rows], position, np.tile(covariance, (len(position), 1)))


def test_a_constant_error_has_the_scores_of_plane_geometry() -> None:
    score = score_run(RUN, straight_truth(), track(np.array([3.0, 4.0]), (4.0, 0.0, 2.0)))
    assert score.covered == 1.0
    assert (score.mean_m, score.rms_m, score.largest_m) == pytest.approx((5.0, 5.0, 5.0))
    assert score.nees == pytest.approx(3.0**2 / 4.0 + 4.0**2 / 2.0)
    # seen from the leader, the follower lies south, and the estimate 3 m east of 16 m south
    assert score.bearing_deg == pytest.approx(math.degrees(math.atan2(3.0, 16.0)))
    assert score.relative_m == pytest.approx([0.0] * len(SEGMENTS_M), abs=1e-9)
    assert score.bound_m == pytest.approx(0.5)


def test_an_error_that_grows_is_a_relative_error() -> None:
    """1 % of the way gives 1 % of each segment; the last ones end at the end of the way, a little
    shorter.
    """
    truth = straight_truth()
    position = truth.position * [1.01, 1.0]
    score = score_run(RUN, truth, Track(truth.time, position, np.full((N, 3), np.nan)))
    assert score.relative_m == pytest.approx([0.01 * length for length in SEGMENTS_M], rel=0.01)
    assert math.isnan(score.nees)


def test_estimates_at_other_times_are_interpolated() -> None:
    """On a straight way estimates every second lie on the line between."""
    score = score_run(RUN, straight_truth(), track(np.array([3.0, 4.0]), (1.0, 0.0, 1.0), 10))
    assert score.largest_m == pytest.approx(5.0)
    assert score.nees == pytest.approx(25.0)
    # the first of them is at the tenth step
    assert score.covered == pytest.approx((N - 9) / N)


def test_a_long_gap_is_not_covered() -> None:
    whole = track(np.zeros(2), (1.0, 0.0, 1.0))
    outside = (whole.time < 50.05) | (whole.time > 70.05)
    part = Track(whole.time[outside], whole.position[outside], whole.covariance[outside])
    score = score_run(RUN, straight_truth(), part)
    assert score.covered == pytest.approx(1.0 - 200 / N)
    assert not score.complete
    mission = score_mission("astern", [score])
    assert mission.incomplete == 1
    assert math.isnan(total([mission]))


def test_no_estimate_covers_nothing() -> None:
    score = score_run(RUN, straight_truth(), track(np.full(2, np.nan), (1.0, 0.0, 1.0)))
    assert score.covered == 0.0
    assert math.isnan(score.mean_m)


def test_the_score_is_the_geometric_mean_of_ratios_to_the_bound() -> None:
    scores = [
        score_mission(
            name, [score_run(RUN, straight_truth(), track(np.array([x, 0.0]), (1, 0, 1)))]
        )
        for name, x in (("astern", 1.0), ("drift", 4.0))
    ]
    # 1 m and 4 m over 0.5 m: the root of 2 · 8
    assert [score.times_bound for score in scores] == pytest.approx([2.0, 8.0])
    assert total(scores) == pytest.approx(4.0)


@pytest.mark.parametrize("name", list(missions()))
def test_every_mission_can_be_flown_and_tells_its_transmitters(name: str) -> None:
    mission = missions()[name]
    scenario = mission.scenario(3)
    assert scenario.seed == 3
    assert scenario.name == name
    assert scenario.navigation.assume.transmitters == mission.transmitters
    assert sum(other.scored for other in missions().values()) == 20


def test_the_importer_reads_the_same_measurements(tmp_path: Path) -> None:
    """A table of the benchmark is one that `laisn log import` takes."""
    table = SAMPLE / "measurements" / "astern" / "01" / "follower.csv"
    laisn("log", "import", table, "--out", tmp_path / "run.mcap")
    imported, _ = read_recording(tmp_path / "run.mcap")
    measured = read_measurements(table)
    assert imported.dt == measured.dt
    np.testing.assert_array_equal(imported.message_step, measured.message_step)
    for name in ("speed", "heading", "depth", "ranges", "message"):
        np.testing.assert_allclose(
            getattr(imported, name), getattr(measured, name), rtol=1e-12, err_msg=name
        )


def test_of_two_transmitters_the_third_has_no_column() -> None:
    folder = SAMPLE / "measurements"
    three = read_columns(folder / "astern" / "01" / "follower.csv")
    two = read_columns(folder / "straight-astern-two" / "01" / "follower.csv")
    assert RANGES[:2] == tuple(name for name in two if name.startswith("range_"))
    assert tuple(name for name in three if name.startswith("range_")) == RANGES


@pytest.mark.system
def test_version_1_stays_as_it_is(tmp_path: Path) -> None:
    """The sample of the repository is written anew, to a digit of the last decimal.

    Files that differ more are another version of the benchmark: VERSION has to be raised.
    """
    manifest = json.loads((SAMPLE / MANIFEST).read_text(encoding="utf-8"))
    chosen = [word for name in manifest["missions"] for word in ("--mission", name)]
    seconds = manifest["seconds"]
    data = tmp_path / "data"
    laisn("bench-data", data, *chosen, "--seeds", 1, "--seconds", seconds, "--workers", 1)
    written = json.loads((data / MANIFEST).read_text(encoding="utf-8"))
    assert list(written["files"]) == list(manifest["files"])
    for name in manifest["files"]:
        if name.endswith(".toml"):
            assert (data / name).read_text("utf-8") == (SAMPLE / name).read_text("utf-8")
            continue
        new, old = read_columns(data / name), read_columns(SAMPLE / name)
        assert list(new) == list(old)
        for column, values in old.items():
            np.testing.assert_allclose(new[column], values, rtol=0, atol=1.01e-4, err_msg=column)


@pytest.mark.system
def test_further_sensors_are_in_all_formats_and_navigators_get_them(tmp_path: Path) -> None:
    """The table is what the DVL measured: with it, a current is no error of dead reckoning."""
    data = tmp_path / "data"
    only = ("--mission", "bottom-lock", "--seeds", 1, "--seconds", 60, "--workers", 1)
    laisn("bench-data", data, *only, "--format", "mcap")
    measured = read_measurements(data / "measurements" / "bottom-lock" / "01" / "follower.csv")
    log, _ = read_recording(data / "measurements" / "bottom-lock" / "01" / "measurements.mcap")
    assert set(measured.custom) == {"dvl", "gyros", "inclinometer"}
    for name, readings in measured.custom.items():
        np.testing.assert_allclose(log.custom[name], readings, rtol=0, atol=1e-12, err_msg=name)
    forward, port, _, altitude = measured.custom["dvl"].T
    due = np.isfinite(forward)
    # every 0.2 s, one in ten left out
    assert np.isnan(forward[::2]).all()
    assert 0.8 < 2.0 * due.mean() < 0.98
    truth = read_truth(data / "truth" / "bottom-lock" / "01" / "follower.csv")
    speed = np.hypot(*np.gradient(truth.position, measured.dt, axis=0).T)
    np.testing.assert_allclose(np.hypot(forward, port)[due], speed[due], atol=0.06)
    assert np.all(np.abs(altitude[due] + measured.depth[due] - 30.0) < 0.3)
    (tmp_path / "bottom.py").write_text(BOTTOM, encoding="utf-8")
    laisn(
        *("score", "--navigator", "bottom:ByDvl", "--plugin", tmp_path / "bottom.py"),
        *("--data", data, "--out", tmp_path / "scores.csv"),
    )
    (row,) = scores_of(tmp_path / "scores.csv")
    # 60 s with a current of 0.3 m/s: 18 m by the log
    assert float(row["e_p_max_m"]) < 9.0


@pytest.mark.system
def test_a_task_tells_the_profile_by_which_rays_bend(tmp_path: Path) -> None:
    data = tmp_path / "data"
    only = ("--mission", "thermocline", "--seeds", 1, "--seconds", 20, "--workers", 1)
    laisn("bench-data", data, *only)
    task = load_scenario(str(data / "tasks" / "thermocline.toml"), ())
    mission = missions()["thermocline"].scenario(1)
    assert task.acoustics.sound_speed_profile == mission.acoustics.sound_speed_profile
    assert task.acoustics.rays == mission.acoustics.rays == "refracted"
    printed = laisn("score", "--navigator", "tight", "--data", data)
    assert "geometric mean of 1 mission" in printed


def test_missions_that_do_not_count_are_left_out_of_the_score() -> None:
    scores = [
        score_mission(
            name, [score_run(RUN, straight_truth(), track(np.array([x, 0.0]), (1, 0, 1)))]
        )
        for name, x in (("astern", 1.0), ("drift", 4.0), ("bottom-lock", 100.0))
    ]
    assert total(scores) == pytest.approx(4.0)
    assert total(scores[2:]) == pytest.approx(200.0)


def test_the_manifest_tells_damage(tmp_path: Path) -> None:
    data = tmp_path / "data"
    shutil.copytree(SAMPLE, data)
    assert "files are as" in laisn("bench-data", data, "--check")
    truth = data / "truth" / "astern" / "01" / "follower.csv"
    truth.write_text(truth.read_text("utf-8").replace("90.0000", "90.0001", 1), "utf-8")
    assert "truth/astern/01/follower.csv" in laisn("bench-data", data, "--check", code=2)


def estimates(folder: Path, offset: float) -> None:
    """Estimates of the sample that are off to the north, as a folder of files."""
    for path in sorted((SAMPLE / "truth").rglob("*.csv")):
        truth = read_truth(path)
        file = folder / path.relative_to(SAMPLE / "truth")
        file.parent.mkdir(parents=True)
        rows = np.column_stack([truth.time, truth.position + np.array([0.0, offset])])
        np.savetxt(
            file, rows, delimiter=",", header="time [s],east [m],north [m]", comments="", fmt="%.6f"
        )


def scores_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_folder_and_a_file_with_labels_have_the_same_score(tmp_path: Path) -> None:
    estimates(tmp_path / "estimates", 0.25)
    laisn("score", tmp_path / "estimates", "--data", SAMPLE, "--out", tmp_path / "folder.csv")
    rows = ["mission,seed,follower,time_s,x_m,y_m"]
    for path in sorted((tmp_path / "estimates").rglob("*.csv")):
        mission, seed = path.relative_to(tmp_path / "estimates").parts[:2]
        rows += [
            f"{mission},{seed},{path.stem},{line}"
            for line in path.read_text("utf-8").splitlines()[1:]
        ]
    (tmp_path / "all.csv").write_text("\n".join(rows), encoding="utf-8")
    printed = laisn("score", tmp_path / "all.csv", "--data", SAMPLE, "--out", tmp_path / "file.csv")
    assert "geometric mean" in printed
    assert scores_of(tmp_path / "folder.csv") == scores_of(tmp_path / "file.csv")
    for row in scores_of(tmp_path / "file.csv"):
        assert float(row["e_p_mean_m"]) == pytest.approx(0.25, abs=1e-6)


@pytest.mark.system
def test_a_navigator_and_its_estimates_have_the_same_score(tmp_path: Path) -> None:
    """What `laisn replay` writes of an imported table is scored as the navigator itself."""
    folder = SAMPLE / "measurements" / "astern" / "01"
    laisn("log", "import", folder / "follower.csv", "--out", tmp_path / "run.mcap")
    task = SAMPLE / "tasks" / "astern.toml"
    states = tmp_path / "estimates" / "astern" / "01.csv"
    states.parent.mkdir(parents=True)
    laisn("replay", tmp_path / "run.mcap", "--scenario", task, "--out", states)
    of = ("--data", SAMPLE, "--mission", "astern")
    laisn("score", tmp_path / "estimates", *of, "--out", tmp_path / "file.csv")
    laisn("score", "--navigator", "tight", *of, "--out", tmp_path / "navigator.csv")
    (file,) = scores_of(tmp_path / "file.csv")
    (navigator,) = scores_of(tmp_path / "navigator.csv")
    for name in ("e_p_mean_m", "e_p_max_m", "nees", "relative_10m_rms_m", "e_b_mean_deg"):
        assert float(file[name]) == pytest.approx(float(navigator[name]), rel=1e-9)
    assert float(navigator["step_us"]) > 0.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time_s,x_m\n1,2\n", "lacks column 'y_m'"),
        ("time_s,x_m,y_m\n1,2,north\n", "column 'y_m' holds cells that are no numbers"),
        ("time_s,x_m,y_m\n2,0,0\n1,0,0\n", "goes from 2 to 1 s"),
        ("x,y\n", "lacks column"),
    ],
)
def test_bad_estimates_are_refused_with_file_and_column(
    tmp_path: Path, text: str, expected: str
) -> None:
    file = tmp_path / "astern" / "01" / "follower.csv"
    file.parent.mkdir(parents=True)
    file.write_text(text, encoding="utf-8")
    message = laisn("score", tmp_path, "--data", SAMPLE, code=2)
    assert expected in message
    assert "follower.csv" in message


def test_what_cannot_be_scored_is_said(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("time_s,x_m,y_m\n1,2,3\n", encoding="utf-8")
    assert "expected a column 'seed'" in laisn("score", tmp_path, "--data", SAMPLE, code=2)
    assert "no manifest" in laisn("score", tmp_path, "--data", tmp_path, code=2)
    assert "none of the benchmark" in laisn(
        "score", "--navigator", "tight", "--data", SAMPLE, "--mission", "T5", code=2
    )
    assert "--navigator NAME" in laisn("score", "--data", SAMPLE, code=2)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "thesis.tex").write_text("", encoding="utf-8")
    assert "thesis.tex" in laisn("bench-data", tmp_path / "data", "--mission", "astern", code=2)


def test_ranges_have_the_order_of_the_transmitters() -> None:
    assert tuple(f"range_{name} [m]" for name in Ranges._fields) == RANGES

"""Trajectories for evo, whose errors are those of the project."""

import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn import metrics
from laisn.arrays import Floats
from laisn_sim.cli.main import app
from reports.summary import SEGMENTS_M, summarise
from sim.flight import FlightRecord
from sim.log import writer
from tests.synthetic import make_flight

EVO = Path(sys.executable).parent


def evo(command: str, *arguments: object, folder: Path) -> dict[str, Any]:
    """Statistics of a command of evo, and the pairs that it used."""
    result = folder / f"{command}.zip"
    result.unlink(missing_ok=True)
    # it keeps settings in the home folder, and draws where it can
    environment = {**os.environ, "HOME": str(folder), "MPLBACKEND": "agg"}
    done = subprocess.run(
        [str(EVO / command), "tum", *map(str, arguments), "--save_results", str(result)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=folder,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with zipfile.ZipFile(result) as archive:
        return dict(json.loads(archive.read("stats.json")))


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(120.0)


@pytest.fixture(scope="module")
def folder(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the command writes."""
    out = tmp_path_factory.mktemp("tum")
    writer.write(flight, out / "a.mcap")
    result = CliRunner().invoke(app, ["log", "export", str(out / "a.mcap"), str(out), "--tum"])
    assert result.exit_code == 0, result.output
    assert "follower_truth.tum" in result.output
    return out


def errors_of(flight: FlightRecord) -> Floats:
    truth = flight.hydrophone(0)[:, :2]
    return np.asarray(np.hypot(*(flight.estimates[0].state[:, :2] - truth).T))


def test_evo_finds_the_position_error_of_the_summary(flight: FlightRecord, folder: Path) -> None:
    files = ("follower_truth.tum", "follower_estimate.tum")
    actual = evo("evo_ape", *files, "--project_to_plane", "xy", folder=folder)
    summary = summarise(flight)["followers"]["follower"]
    assert actual["mean"] == pytest.approx(summary["e_p_mean_m"], abs=1e-6)
    assert actual["max"] == pytest.approx(summary["e_p_max_m"], abs=1e-6)
    assert actual["rmse"] == pytest.approx(
        float(np.sqrt(np.mean(errors_of(flight) ** 2))), abs=1e-6
    )


def level(path: Path) -> Path:
    """The trajectory in the plane and without attitude, for errors of displacement in the world."""
    rows = np.loadtxt(path)
    rows[:, 3] = 0.0
    rows[:, 4:] = 0.0, 0.0, 0.0, 1.0
    flat = path.with_name(f"flat_{path.name}")
    np.savetxt(flat, rows, fmt="%.9f")
    return flat


@pytest.mark.parametrize("length", [10.0, 50.0])
def test_evo_finds_the_relative_error_of_the_summary(
    flight: FlightRecord, folder: Path, length: float
) -> None:
    files = [level(folder / f"follower_{name}.tum") for name in ("truth", "estimate")]
    options = ["--delta", length, "--delta_unit", "m", "--all_pairs", "--pairs_from_reference"]
    actual = evo("evo_rpe", *files, *options, folder=folder)
    rows = summarise(flight)["followers"]["follower"]["relative_errors"]
    (row,) = (row for row in rows if row["length_m"] == length)
    assert actual["rmse"] == pytest.approx(row["rms_m"], rel=1e-5)
    assert actual["median"] == pytest.approx(row["median_m"], rel=1e-5)


def test_evo_runs_on_the_files_as_they_are(folder: Path) -> None:
    """With attitudes, of which the estimate's is the measured heading."""
    files = ("follower_truth.tum", "follower_estimate.tum")
    actual = evo("evo_rpe", *files, "--delta", 10, "--delta_unit", "m", folder=folder)
    assert 0.0 < actual["rmse"] < 5.0


def test_two_formats_at_once_are_refused(folder: Path) -> None:
    arguments = ["log", "export", str(folder / "a.mcap"), str(folder / "b"), "--tum", "--ros2"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "--ros2 and --tum: expected one of them" in " ".join(result.output.split())
    assert not (folder / "b").exists()


def test_lines_are_poses_at_the_times_of_the_steps(flight: FlightRecord, folder: Path) -> None:
    lines = (folder / "follower_truth.tum").read_text().splitlines()
    assert re.fullmatch(r"1767225600\.100000000( -?\d+\.\d{9}){7}", lines[1])
    rows = np.loadtxt(folder / "follower_truth.tum")
    assert len(rows) == 1200
    assert np.allclose(rows[:, 1:4], flight.hydrophone(0), atol=1e-9)
    assert np.allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-8)
    estimate = np.loadtxt(folder / "follower_estimate.tum")
    assert np.allclose(estimate[:, 1:3], flight.estimates[0].state[:, :2], atol=1e-9)


def straight(n: int) -> Floats:
    """A path east, a metre a step."""
    return np.column_stack([np.arange(n, dtype=np.float64), np.zeros(n)])


def test_a_scale_error_grows_with_the_segment() -> None:
    truth = straight(300)
    for length in (10.0, 50.0, 200.0):
        errors = metrics.relative_errors(1.01 * truth, truth, length)
        whole = 300 - round(length)
        # at the end of the path segments of nine tenths of the length are near enough
        assert errors.size == whole + round(0.1 * length)
        assert np.allclose(errors[:whole], 0.01 * length)
        assert np.allclose(errors[-1], 0.009 * length)


def test_a_constant_error_is_no_relative_one() -> None:
    truth = straight(100)
    assert np.allclose(
        metrics.relative_errors(truth + np.array([3.0, -4.0]), truth, 20.0), 0.0, atol=1e-12
    )


def test_white_errors_give_the_root_of_two() -> None:
    """σ per axis at both ends: the RMS of the difference is 2 σ, of two axes."""
    truth = straight(20000)
    random = np.random.default_rng(1)
    errors = metrics.relative_errors(truth + random.normal(0, 0.5, truth.shape), truth, 30.0)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(1.0, rel=0.02)


def test_segments_end_at_the_nearest_step_and_not_far_from_it() -> None:
    truth = np.array([[0.0, 0.0], [9.2, 0.0], [10.5, 0.0], [12.5, 0.0], [40.0, 0.0]])
    estimate = truth + straight(5)
    # from 0 on to 10.5, not 9.2; from 9.2, 10.5 and 12.5 on there is no step near
    assert metrics.relative_errors(estimate, truth, 10.0).tolist() == [2.0]
    assert metrics.relative_errors(estimate, truth, 1000.0).size == 0


def test_a_vehicle_that_waits_has_the_first_step_at_the_end() -> None:
    truth = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 0.0]])
    estimate = truth + straight(4)
    assert metrics.relative_errors(estimate, truth, 10.0).tolist() == [1.0]


def test_summaries_hold_the_lengths_that_the_path_has(flight: FlightRecord) -> None:
    rows = summarise(flight)["followers"]["follower"]["relative_errors"]
    # two minutes at 1.15 m/s on a wider circle are 138 m
    assert [row["length_m"] for row in rows] == [one for one in SEGMENTS_M if one < 138.0]
    assert all(row["median_m"] <= row["p95_m"] for row in rows)
    assert rows[0]["segments"] > rows[-1]["segments"] > 0

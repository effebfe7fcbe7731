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
    """Statistics of errors by a command of evo."""
    result = folder / f"{command}.zip"
    result.unlink(missing_ok=True)
    # it keeps settings in the home folder, and draws where it can
    environment = {**os.environ, "HOME": str(folder), "MPLBACKEND": "agg"}
    child = subprocess.run(
        [str(EVO / command), "tum", *map(str, arguments), "--save_results", str(result)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=folder,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stdout + child.stderr
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


def position_errors(flight: FlightRecord) -> Floats:
    truth = flight.hydrophone(0)[:, :2]
    return np.asarray(np.hypot(*(flight.estimates[0].state[:, :2] - truth).T))


def test_evo_finds_the_position_error_of_the_summary(flight: FlightRecord, folder: Path) -> None:
    files = ("follower_truth.tum", "follower_estimate.tum")
    actual = evo("evo_ape", *files, "--project_to_plane", "xy", folder=folder)
    summary = summarise(flight)["followers"]["follower"]
    assert actual["mean"] == pytest.approx(summary["e_p_mean_m"], abs=1e-6)
    assert actual["max"] == pytest.approx(summary["e_p_max_m"], abs=1e-6)
    assert actual["rmse"] == pytest.approx(
        float(np.sqrt(np.mean(position_errors(flight) ** 2))), abs=1e-6
    )


def in_the_plane(path: Path) -> Path:
    """The trajectory in the plane and without attitude, for errors of displacement in the world."""
    poses = np.loadtxt(path)
    poses[:, 3] = 0.0
    poses[:, 4:] = 0.0, 0.0, 0.0, 1.0
    flat_path = path.with_name(f"flat_{path.name}")
    np.savetxt(flat_path, poses, fmt="%.9f")
    return flat_path


@pytest.mark.parametrize("length", [10.0, 50.0])
def test_evo_finds_the_relative_error_of_the_summary(
    flight: FlightRecord, folder: Path, length: float
) -> None:
    files = [in_the_plane(folder / f"follower_{name}.tum") for name in ("truth", "estimate")]
    options = ["--delta", length, "--delta_unit", "m", "--all_pairs", "--pairs_from_reference"]
    actual = evo("evo_rpe", *files, *options, folder=folder)
    relative_errors = summarise(flight)["followers"]["follower"]["relative_errors"]
    (statistics,) = (
        statistics for statistics in relative_errors if statistics["length_m"] == length
    )
    assert actual["rmse"] == pytest.approx(statistics["rms_m"], rel=1e-5)
    assert actual["median"] == pytest.approx(statistics["median_m"], rel=1e-5)


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
    poses = np.loadtxt(folder / "follower_truth.tum")
    assert len(poses) == 1200
    assert np.allclose(poses[:, 1:4], flight.hydrophone(0), atol=1e-9)
    assert np.allclose(np.linalg.norm(poses[:, 4:], axis=1), 1.0, atol=1e-8)
    estimate = np.loadtxt(folder / "follower_estimate.tum")
    assert np.allclose(estimate[:, 1:3], flight.estimates[0].state[:, :2], atol=1e-9)


def straight_path(n: int) -> Floats:
    """A path east of n points, a metre a step."""
    return np.column_stack([np.arange(n, dtype=np.float64), np.zeros(n)])


def test_a_scale_error_grows_with_the_segment() -> None:
    truth = straight_path(300)
    for length in (10.0, 50.0, 200.0):
        errors = metrics.relative_errors(1.01 * truth, truth, length)
        full_segments = 300 - round(length)
        # a segment may be a tenth shorter: at the end of the path the last ones are
        assert errors.size == full_segments + round(0.1 * length)
        assert np.allclose(errors[:full_segments], 0.01 * length)
        assert np.allclose(errors[-1], 0.009 * length)


def test_a_constant_error_is_no_relative_one() -> None:
    truth = straight_path(100)
    assert np.allclose(
        metrics.relative_errors(truth + np.array([3.0, -4.0]), truth, 20.0), 0.0, atol=1e-12
    )


def test_relative_errors_of_white_errors_have_an_rms_of_two_sigma() -> None:
    """σ per axis at either end: √2 σ per axis of the difference, 2 σ of two axes; σ is 0.5 m."""
    truth = straight_path(20000)
    random = np.random.default_rng(1)
    errors = metrics.relative_errors(truth + random.normal(0, 0.5, truth.shape), truth, 30.0)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(1.0, rel=0.02)


def test_segments_end_at_the_nearest_step_and_not_far_from_it() -> None:
    truth = np.array([[0.0, 0.0], [9.2, 0.0], [10.5, 0.0], [12.5, 0.0], [40.0, 0.0]])
    estimate = truth + straight_path(5)
    # the segment from 0 ends at 10.5, not at 9.2; none from 9.2, 10.5 and 12.5 on ends near 10 m.
    # The error grows by 1 m a step
    assert metrics.relative_errors(estimate, truth, 10.0).tolist() == [2.0]
    assert metrics.relative_errors(estimate, truth, 1000.0).size == 0


def test_a_segment_to_where_a_vehicle_waits_ends_at_the_first_step_there() -> None:
    truth = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 0.0]])
    estimate = truth + straight_path(4)
    assert metrics.relative_errors(estimate, truth, 10.0).tolist() == [1.0]


def test_summaries_hold_the_lengths_that_the_path_has(flight: FlightRecord) -> None:
    relative_errors = summarise(flight)["followers"]["follower"]["relative_errors"]
    # on a wider circle than the leader the follower sails 120 s at 1.15 m/s, 138 m
    assert [statistics["length_m"] for statistics in relative_errors] == [
        length for length in SEGMENTS_M if length < 138.0
    ]
    assert all(statistics["median_m"] <= statistics["p95_m"] for statistics in relative_errors)
    assert relative_errors[0]["segments"] > relative_errors[-1]["segments"] > 0

"""A flight as a factor graph: read back by the importer, and solved by GTSAM."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn_sim.cli.main import app
from sim.datasets.factor_graph import read_factor_graph
from sim.flight import FlightRecord
from tests.synthetic import make_flight


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    # a speed log without a bias, which the graph has no variable for; the bias of the compass is
    # the error of the first pose's heading
    changes = {
        "sensors.speed_bias_m_s": 0.0,
        "sensors.heading_bias_deg": 3.0,
        "acoustics.loss_probability": 0.2,
    }
    return laisn_sim.fly("T7", {"motion": "kinematic", "duration_s": 120.0, **changes})


@pytest.fixture(scope="module")
def graph(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("graph")
    log = laisn_sim.write_log(flight, folder / "flight.mcap")
    result = CliRunner().invoke(app, ["log", "export", str(log), str(folder / "out"), "--pyfg"])
    assert result.exit_code == 0, result.output
    return folder / "out" / "follower.pyfg"


def test_the_importer_reads_odometry_ranges_and_the_true_path(
    flight: FlightRecord, graph: Path
) -> None:
    data, (measured,) = read_factor_graph(graph), flight.measurements
    reception_step = measured.message_step
    np.testing.assert_allclose(
        data.time, np.append(0.0, measured.time[reception_step - 1]), atol=1e-9
    )
    np.testing.assert_allclose(
        data.truth[1:, 1:], flight.hydrophone(0)[reception_step - 1, :2], atol=1e-6
    )
    received = np.isfinite(measured.ranges)
    assert 0 < received.sum() == data.ranges.size < received.size
    # the graph's ranges are horizontal, by the depths that are measured
    depth_below_transmitter = (
        measured.depth[reception_step - 1]
        - measured.message[:, 5]
        - flight.scenario.navigation.settings().hydrophone_height
    )
    horizontal_ranges = np.sqrt(measured.ranges**2 - depth_below_transmitter[:, None] ** 2)[
        received
    ]
    np.testing.assert_allclose(np.sort(data.ranges), np.sort(horizontal_ranges), atol=0.02)
    speed = np.append(measured.speed[0], measured.speed)
    heading = np.append(measured.heading[0], measured.heading)
    velocity = speed[:, None] * np.column_stack([np.sin(heading), np.cos(heading)])
    displacements = np.array(
        [
            0.5 * 0.1 * (velocity[:-1] + velocity[1:])[k : k + 10].sum(axis=0)
            for k in range(0, 1200, 10)
        ]
    )
    np.testing.assert_allclose(
        np.hypot(*data.odometry[:, :2].T), np.hypot(*displacements.T), atol=1e-6
    )


def test_variances_of_ranges_are_those_in_the_plane(tmp_path: Path) -> None:
    """A slant range r of variance σ² is a horizontal one h with (dh/dr)² σ², here by differences,
    of a follower some 22 m below its leader.
    """
    flown = make_flight(30.0)
    (measured,) = flown.measurements
    deep = replace(measured, depth=measured.depth + 20.0, ranges=np.hypot(measured.ranges, 20.0))
    log = laisn_sim.write_log(replace(flown, measurements=(deep,)), tmp_path / "deep.mcap")
    result = CliRunner().invoke(app, ["log", "export", str(log), str(tmp_path / "out"), "--pyfg"])
    assert result.exit_code == 0, result.output
    # random, common to a message, and its mean (docs/scenario.md, [navigation.assume])
    sigma = np.linalg.norm([0.003, 0.05, 0.2])
    text = (tmp_path / "out" / "follower.pyfg").read_text()
    edges = [line.split() for line in text.splitlines() if line.startswith("EDGE_RANGE")]
    factors = []
    for _, _, _, landmark, horizontal, variance in edges:
        # three landmarks for each message
        message, transmitter = divmod(int(landmark[1:]), 3)
        slant = deep.ranges[message, transmitter]
        squared_depth = slant**2 - float(horizontal) ** 2
        step = 1e-4
        above, below = np.sqrt((slant + np.array([step, -step])) ** 2 - squared_depth)
        factors.append((above - below) / (2.0 * step))
        assert float(variance) == pytest.approx((factors[-1] * sigma) ** 2, rel=1e-4)
    assert max(factors) > 1.1


def test_gtsam_solves_the_exported_graph_to_within_a_metre_of_the_true_path(graph: Path) -> None:
    gtsam = pytest.importorskip("gtsam")
    factors, values, gaussian = (
        gtsam.NonlinearFactorGraph(),
        gtsam.Values(),
        gtsam.noiseModel.Gaussian.Covariance,
    )
    truth: dict[str, list[float]] = {}

    def key(name: str) -> int:
        return int(gtsam.symbol(name[0].lower(), int(name[1:])))

    def covariance_of(triangle: list[str], n: int) -> np.ndarray:
        """The n×n matrix of which a line holds the upper triangle."""
        matrix = np.zeros((n, n))
        matrix[np.triu_indices(n)] = list(map(float, triangle))
        return matrix + np.triu(matrix, 1).T

    pose = None
    lines = [line.split() for line in graph.read_text().splitlines()]
    for kind, *words in lines:
        if kind == "VERTEX_SE2":
            truth[words[1]] = list(map(float, words[2:4]))
        elif kind == "VERTEX_SE2:PRIOR":
            pose = gtsam.Pose2(*map(float, words[2:5]))
            factors.add(
                gtsam.PriorFactorPose2(key(words[1]), pose, gaussian(covariance_of(words[5:], 3)))
            )
            values.insert(key(words[1]), pose)
        elif kind == "EDGE_SE2":
            step = gtsam.Pose2(*map(float, words[3:6]))
            factors.add(
                gtsam.BetweenFactorPose2(
                    key(words[1]), key(words[2]), step, gaussian(covariance_of(words[6:], 3))
                )
            )
            assert pose is not None
            pose = pose.compose(step)
            values.insert(key(words[2]), pose)
        elif kind == "VERTEX_XY:PRIOR":
            position = np.array(words[2:4], dtype=float)
            factors.add(
                gtsam.PriorFactorPoint2(
                    key(words[1]), position, gaussian(covariance_of(words[4:], 2))
                )
            )
            values.insert(key(words[1]), position)
        elif kind == "EDGE_RANGE":
            sigma = gtsam.noiseModel.Isotropic.Sigma(1, float(words[4]) ** 0.5)
            # the hydrophone is at the origin of the pose
            arguments = key(words[1]), key(words[2]), float(words[3]), sigma, gtsam.Pose2()
            factors.add(gtsam.RangeFactorWithTransform2D(*arguments))
    solved = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    errors = {
        name: [
            np.hypot(*(np.asarray(estimates.atPose2(key(name)).translation()) - position))
            for name, position in truth.items()
        ]
        for name, estimates in (("reckoned", values), ("solved", solved))
    }
    assert np.mean(errors["solved"]) < 0.3 * np.mean(errors["reckoned"])
    assert np.mean(errors["solved"]) < 1.0

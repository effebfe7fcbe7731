"""`laisn fly --ros2`: the bag belongs to its flight."""

from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from laisn_sim.cli.main import app

FLY_SHORT = [
    "fly",
    "T5",
    "--set",
    "motion=kinematic",
    "--set",
    "duration_s=20",
    "--no-video",
    "--out",
]


@pytest.mark.system
def test_a_flight_has_its_own_bag(tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    assert CliRunner().invoke(app, [*FLY_SHORT, str(folder), "--ros2"]).exit_code == 0
    with AnyReader([folder / "ros2"]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    # every 0.1 s from the start on
    assert counts["/leader/truth/odometry"] == 201
    assert counts["/follower/reception"] == 20
    # the next flight into this folder has none
    assert CliRunner().invoke(app, [*FLY_SHORT, str(folder)]).exit_code == 0
    assert not (folder / "ros2").exists()
    assert (folder / "flight.mcap").exists()


def test_a_flight_spares_a_folder_of_the_users(tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    assert CliRunner().invoke(app, [*FLY_SHORT, str(folder)]).exit_code == 0
    (folder / "ros2").mkdir()
    (folder / "ros2" / "ws.repos").write_text("mine")
    result = CliRunner().invoke(app, [*FLY_SHORT, str(folder)])
    assert result.exit_code == 2
    assert "holds ws.repos" in " ".join(result.output.split())
    assert (folder / "ros2" / "ws.repos").read_text() == "mine"

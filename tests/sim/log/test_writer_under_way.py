"""A log that is written while the mission goes on: the bytes of the finished flight's, and all
until an interrupt.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from experiments.flight.fly import MissionToFly
from experiments.flight.library import as_scenario
from laisn_sim.cli.main import app
from reports.summary import flight_events
from sim.flight import FlightRecord, Termination
from sim.log import reader, writer
from sim.log.contents import Contents, partial_path, recover
from tests.synthetic import bits

pytestmark = pytest.mark.system

FOLLOWERS = [
    {"name": "port", "station": {"behind_m": 8.0, "port_m": 8.0, "depth_m": 9.0}},
    {"name": "astern", "station": {"behind_m": 16.0, "port_m": 0.0, "depth_m": 11.0}},
    # three move side by side, as in formations, whose compiled code serves here
    {"name": "far", "station": {"behind_m": 24.0, "port_m": 8.0, "depth_m": 11.0}},
]
ON_ROUTES: dict[str, Any] = {
    "name": "open",
    "duration_s": 230.0,
    "epoch": "2026-05-04T10:00:13Z",
    "navigation": {"variant": "laisn-3-2"},
    "leader": {"broadcast_attitude": True},
    "acoustics": {"loss_probability": 0.2, "travel_time": True},
    "followers": [{"route": "T5"}],
}
# kinematic motion, with messages so far apart that hypotheses of an earlier part of the log hold
RARE_MESSAGES = ON_ROUTES | {
    "duration_s": 240.0,
    "motion": "kinematic",
    "navigation": {"variant": "tight"},
    "timing": {"filter_step_s": 0.3, "message_interval_s": 120.0},
    "followers": [{"route": "T5"}, {"route": "T3", "name": "other"}],
}
ON_STATIONS = ON_ROUTES | {
    "name": "closed",
    "navigation": {"variant": "tight"},
    "followers": FOLLOWERS,
}


@pytest.mark.parametrize(
    "table", [ON_ROUTES, RARE_MESSAGES, ON_STATIONS], ids=["open", "points", "closed"]
)
def test_a_log_under_way_has_the_bytes_of_the_finished_flight(
    table: dict[str, Any], tmp_path: Path
) -> None:
    mission = MissionToFly(as_scenario(table))
    log = writer.FlightLog(tmp_path / "under-way.mcap")
    trajectory, outcome = mission.simulate(log=log)
    # a part of the log is in the file before it is finished
    partial = partial_path(tmp_path / "under-way.mcap")
    (tmp_path / "cut.mcap").write_bytes(partial.read_bytes())
    flight = mission.flight(trajectory, outcome)
    events = flight_events(flight)
    log.finish(mission.rest_of(flight), outcome, summary="{}", events=events)
    writer.write(flight, tmp_path / "whole.mcap", events=events)
    written = (tmp_path / "under-way.mcap").read_bytes()
    assert written == (tmp_path / "whole.mcap").read_bytes()
    assert bits(reader.read(tmp_path / "whole.mcap")) == bits(flight)
    begun = reader.read(recover(tmp_path / "cut.mcap"))
    assert begun.trajectory.time[-1] > 100.0
    assert begun.outcome is Termination.INTERRUPTED
    require_that_it_begins_as(begun, flight)


def require_that_it_begins_as(beginning: FlightRecord, flight: FlightRecord) -> None:
    """A flight that was cut off is equal to the beginning of the whole one."""
    instants = beginning.trajectory.time.size
    np.testing.assert_array_equal(beginning.trajectory.pose, flight.trajectory.pose[:instants])
    for estimates_of_begun, estimates_of_whole in zip(
        beginning.estimates, flight.estimates, strict=True
    ):
        steps = len(estimates_of_begun.state)
        np.testing.assert_array_equal(estimates_of_begun.state, estimates_of_whole.state[:steps])
        np.testing.assert_array_equal(
            estimates_of_begun.fix_step,
            estimates_of_whole.fix_step[estimates_of_whole.fix_step <= steps],
        )


CONTROLLER = """
class Failing:
    def __init__(self, follower):
        pass

    def control(self, readings, belief, dt):
        if readings.time >= 123.4:
            raise ValueError("out of ideas")
        return 0.5, 1.0, 8.0
"""


def test_a_controller_that_fails_leaves_a_log_until_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "failing_controllers.py").write_text(CONTROLLER)
    monkeypatch.chdir(tmp_path)
    options = [
        "--plugin",
        "failing_controllers.py",
        "--set",
        "followers.0.controller=failing_controllers:Failing",
        "--set",
        "duration_s=200",
    ]
    result = CliRunner().invoke(app, ["fly", "T5", "--no-video", "--out", "flight", *options])
    assert result.exit_code == 2
    assert "out of ideas" in result.output
    assert "the unfinished flight is in flight/unfinished" in result.output
    [log] = Path("flight/unfinished").iterdir()
    flown = reader.read(log)
    assert flown.outcome is Termination.INTERRUPTED
    # the instant before the failure
    assert flown.trajectory.time[-1] == pytest.approx(123.3)
    assert CliRunner().invoke(app, ["log", "info", str(log)]).exit_code == 0


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_a_log_until_then(tmp_path: Path, signal_number: signal.Signals) -> None:
    folder = tmp_path / "flight"
    command = [sys.executable, "-m", "laisn_sim.cli.main", "fly", "T5", "--no-video"]
    # a mission that takes minutes
    child = subprocess.Popen(
        [*command, "--set", "duration_s=40000", "--out", str(folder)],
        stderr=subprocess.PIPE,
        text=True,
    )
    partial = partial_path(folder / "unfinished" / "flight.mcap")
    while not partial.exists() and child.poll() is None:
        time.sleep(0.01)
    child.send_signal(signal_number)
    message = child.communicate(timeout=60)[1]
    assert child.returncode == 128 + signal_number, message
    [log] = (folder / "unfinished").iterdir()
    assert f"the unfinished flight is in {log.parent}" in message
    flown = reader.read(log)
    assert flown.outcome is Termination.INTERRUPTED
    assert flown.trajectory.time[-1] >= 100.0
    lines = Contents(log).topics["/log"]
    assert lines.data[-1].decode(errors="replace").count(Termination.INTERRUPTED.value) == 1


def test_the_log_of_a_simulation_is_that_of_its_flight(tmp_path: Path) -> None:
    table = ON_STATIONS | {"duration_s": 120.0}
    sim = laisn_sim.Simulation(table, log=tmp_path / "a.mcap")
    while not sim.done:
        sim.step(7.3)
    laisn_sim.write_log(sim.flight(), tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def fly_and_fail(log: Path) -> None:
    with laisn_sim.Simulation(ON_STATIONS, log=log) as sim:
        sim.step(130.0)
        sim.step(4.2)
        raise ZeroDivisionError


def test_a_simulation_that_fails_ends_its_log(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        fly_and_fail(tmp_path / "a.mcap")
    flown = reader.read(tmp_path / "a.mcap")
    assert flown.trajectory.time[-1] == pytest.approx(134.2)
    require_that_it_begins_as(flown, laisn_sim.fly(ON_STATIONS))


def test_a_script_that_fails_ends_its_log(tmp_path: Path) -> None:
    script = (
        "import laisn_sim\n"
        f"sim = laisn_sim.Simulation('T5', log={str(tmp_path / 'a.mcap')!r})\n"
        "sim.step(30.0)\n"
        "raise ValueError\n"
    )
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert child.stderr.rstrip().endswith("ValueError")
    assert reader.read(tmp_path / "a.mcap").trajectory.time[-1] == 30.0
    assert os.listdir(tmp_path) == ["a.mcap"]

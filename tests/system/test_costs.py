"""What an extension costs: the table of docs/extending.md, and its examples that no other test
runs.
"""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import laisn_sim
import sim.sensing.acoustics
from laisn.plugins import load_plugin
from sim.scenario.parts import SensingSettings
from sim.sensing.observation import propagate
from sim.water.rays import Path as SoundPath

pytestmark = pytest.mark.usefixtures("no_plugins")

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = {page: (DOCS / page).read_text("utf-8") for page in ("extending.md", "links.md")}
NAMED_BLOCK = re.compile(r"^```python\n# (\S+\.py)\n(.*?)^```", re.DOTALL | re.MULTILINE)
CODE_BY_NAME = {name: code for text in PAGES.values() for name, code in NAMED_BLOCK.findall(text)}
COST_ROW = re.compile(r"^\| (.*?) \| (.*?) \| (\d+) \| (\d+)(.*?) \|$", re.MULTILINE)


def code_lines(name: str) -> int:
    return sum(bool(line.strip()) for line in CODE_BY_NAME[name].splitlines())


def test_the_table_of_costs_counts_the_examples() -> None:
    table_rows = COST_ROW.findall(PAGES["extending.md"])
    assert len(table_rows) == 11
    for _, file, lines, project_lines, remark in table_rows:
        name = file.strip("`")
        expected = code_lines(name) if name.endswith(".py") else 0
        assert (file, int(lines)) == (file, expected)
        if "laisn/fix.py" in remark:
            assert int(project_lines) == code_lines("laisn/fix.py") + code_lines(
                "laisn/settings.py"
            )


def write_block(folder: Path, name: str) -> Path:
    path = folder / name
    path.write_text(CODE_BY_NAME[name], encoding="utf-8")
    return path


def test_a_model_of_sound_is_one_class(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It gives missions travel times along arcs of circles, here computed from both ends."""
    model = load_plugin(str(write_block(tmp_path, "gradient.py"))).ConstantGradient(1480.0, 0.5)
    monkeypatch.setattr(sim.sensing.acoustics, "rays_of", lambda scenario: model)
    table = {
        "duration_s": 5.0,
        "motion": "kinematic",
        "acoustics": {"travel_time": True},
        "followers": [{"waypoints": [[0.0, 400.0, 0.0], [100.0, 500.0, 0.0]], "depth_m": 28.0}],
    }
    scenario = laisn_sim.load(table)
    flight = laisn_sim.fly(scenario)
    received = propagate(flight.trajectory, SensingSettings.of(scenario))
    assert len(received.message_step) == 4
    for message, emission_step in enumerate(received.emission_step):
        arrival_time = received.arrival.time[message, 0, SoundPath.DIRECT]
        source = received.transmitter[message, 0]
        # the follower moves along a line, by 1 m/s
        start = flight.trajectory.site_path("follower/hydrophone")[0]
        end = start + arrival_time * np.array([1.0, 0.0, 0.0])
        horizontal = math.hypot(end[0] - source[0], end[1] - source[1])
        # the centre of the circle lies where sound would have no speed, at depth −c₀ / g; both ends
        # from there
        source_depth, receiver_depth = 2960.0 - source[2], 2960.0 - end[2]
        centre = (horizontal**2 + receiver_depth**2 - source_depth**2) / (2.0 * horizontal)
        angles = [
            math.atan2(source_depth, -centre),
            math.atan2(receiver_depth, horizontal - centre),
        ]
        log_tangents = [math.log(math.tan(0.5 * angle)) for angle in angles]
        expected = abs(log_tangents[1] - log_tangents[0]) / 0.5
        assert arrival_time - 0.1 * emission_step == pytest.approx(expected, rel=1e-9)
        straight = float(np.linalg.norm(end - source)) / 1488.0
        assert abs(expected / straight - 1.0) < 0.01


@pytest.mark.system
def test_an_export_is_one_file(tmp_path: Path) -> None:
    rosbags = pytest.importorskip("rosbags.rosbag2")
    flight = laisn_sim.fly("T5", {"duration_s": 5.0, "motion": "kinematic"})
    laisn_sim.write_log(flight, tmp_path / "flight.mcap")
    script = write_block(tmp_path, "to_ros2.py")
    command = [sys.executable, str(script), "flight.mcap", "bag"]
    subprocess.run(command, cwd=tmp_path, check=True)
    with rosbags.Reader(tmp_path / "bag") as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        store = pytest.importorskip("rosbags.typesys")
        types = store.get_typestore(store.Stores.LATEST)
        channel, time, data = list(reader.messages())[-1]
        last_message = types.deserialize_cdr(data, channel.msgtype)
    assert counts == {"/leader/odometry": 51, "/follower/odometry": 51}
    assert time == 5_000_000_000
    position = last_message.pose.pose.position
    vehicle = 0 if channel.topic == "/leader/odometry" else 1
    np.testing.assert_array_equal(
        [position.x, position.y, position.z], flight.trajectory.position[-1, vehicle]
    )

"""`laisn log import` of bags of ROS 1 and 2, by a map that is proposed, edited and used again."""

import math
import re
import sqlite3
import tomllib
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from sim.datasets.map_proposal import propose_for_bag
from sim.log import writer
from sim.log.reader import read_recording
from tests.sim.datasets.bags import Message, stamped, write_ros1, write_ros2
from tests.synthetic import make_flight

START_NS = 1_700_000_000 * 10**9
GRAVITY, DENSITY, SURFACE_PA = 9.81, 1026.0, 101325.0
# a follower that turns through north, and a leader that sails east past it
# at 0.125 s the first step, and at 4.925 s one at which it points north
TURN_DEG_S, HEADING_DEG = 2.0, 350.15
LEADER_SPEED, LEADER_NORTH, LEADER_DEPTH = 1.2, 30.0, 3.0


def told(result: Any) -> str:
    return " ".join(result.output.split())


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["log", *map(str, arguments)])


def yaw_quaternion(heading_deg: float) -> dict[str, float]:
    yaw = math.radians(90.0 - heading_deg)
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def heading_deg(time_s: float) -> float:
    return (HEADING_DEG + TURN_DEG_S * time_s) % 360.0


def own_messages(duration_s: float = 20.0) -> list[Message]:
    """A compass at 20 Hz, a speed log at 5 Hz, a pressure sensor at 10 Hz: linear in time."""
    messages = list[Message]()
    for k in range(int(duration_s * 20)):
        at = START_NS + 50_000_000 * k
        imu = stamped(at, "auv", orientation=yaw_quaternion(heading_deg(0.05 * k)))
        messages.append(("/auv/imu", "sensor_msgs/msg/Imu", at, imu))
        if k % 2 == 0:
            depth = 8.0 + 0.01 * k
            pressure = SURFACE_PA + DENSITY * GRAVITY * depth
            fluid = stamped(at, "auv", fluid_pressure=pressure)
            messages.append(("/auv/pressure", "sensor_msgs/msg/FluidPressure", at, fluid))
        if k % 4 == 2:
            # 25 ms after a message of the compass, between two
            late = at + 25_000_000
            twist = stamped(late, "auv", twist={"linear": {"x": 1.0 + 0.001 * k}})
            messages.append(("/auv/dvl", "geometry_msgs/msg/TwistStamped", late, twist))
    return messages


def leader_messages(duration_s: float = 20.0) -> list[Message]:
    """Odometry of the leader at 4 Hz."""
    messages = list[Message]()
    for k in range(int(duration_s * 4)):
        at = START_NS + 250_000_000 * k
        position = {"x": LEADER_SPEED * 0.25 * k, "y": LEADER_NORTH, "z": -LEADER_DEPTH}
        pose = {"pose": {"position": position, "orientation": yaw_quaternion(90.0)}}
        odometry = stamped(at, "map", pose=pose, twist={"twist": {"linear": {"x": LEADER_SPEED}}})
        messages.append(("/leader/odom", "nav_msgs/msg/Odometry", at, odometry))
    return messages


def range_messages(duration_s: float = 20.0) -> list[Message]:
    """Each second, 0.1 s after it, a range to the stern transmitter, and 50 ms later to the bow's,
    in one topic.
    """
    messages = list[Message]()
    for k in range(1, int(duration_s) - 1):
        for i, frame in enumerate(("tx_stern", "tx_bow")):
            at = START_NS + 10**9 * k + 100_000_000 + 50_000_000 * i
            values = stamped(at, frame, range=np.float32(40.0 + k + 0.5 * i).item())
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", at, values))
    return messages


def in_order(*parts: list[Message]) -> list[Message]:
    return sorted((m for part in parts for m in part), key=lambda message: message[2])


def ros1(folder: Path, messages: list[Message]) -> Path:
    return write_ros1(folder / "dive.bag", messages)


def db3(folder: Path, messages: list[Message]) -> Path:
    return write_ros2(folder / "dive", messages, StoragePlugin.SQLITE3)


def mcap(folder: Path, messages: list[Message]) -> Path:
    return write_ros2(folder / "dive", messages)


def humble_db3(folder: Path, messages: list[Message]) -> Path:
    """As Humble records it: without definitions of types."""
    bag = db3(folder, messages)
    with closing(sqlite3.connect(bag / "dive.db3")) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
        database.commit()
    return bag


def bare_mcap(folder: Path, messages: list[Message]) -> Path:
    return write_ros2(folder / "dive", messages) / "dive.mcap"


WRITERS = {"ros1": ros1, "db3": db3, "humble": humble_db3, "mcap": mcap, "file": bare_mcap}


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_a_bag_is_imported_by_its_proposed_map(
    write: Callable[[Path, list[Message]], Path], tmp_path: Path
) -> None:
    bag = write(tmp_path, in_order(own_messages(), leader_messages(), range_messages()))
    proposed = run("import", bag, "--propose", tmp_path / "map.toml")
    assert proposed.exit_code == 0, proposed.output
    text = (tmp_path / "map.toml").read_text()
    assert "nothing was found" not in text
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    assert result.exit_code == 0, result.output
    measured = read_recording(tmp_path / "dive.mcap").measurements
    # the speed log's messages are the steps: at 0.125 s, 0.325 s, ...
    n = measured.speed.size
    time = 0.125 + 0.2 * np.arange(n)
    # the last step lies behind the last message of the pressure sensor
    assert n == 99
    assert measured.dt == 0.2
    assert np.allclose(measured.speed, 1.002 + 0.004 * np.arange(n), atol=1e-12)
    expected = np.radians(HEADING_DEG + TURN_DEG_S * time)
    away = np.remainder(measured.heading - expected + np.pi, 2 * np.pi) - np.pi
    assert np.abs(away).max() < 1e-9
    assert np.allclose(measured.depth, 8.0 + 0.2 * time, atol=1e-9)
    # a reception is at the second of its two ranges
    m = measured.message_step.size
    heard = 1.15 + np.arange(m)
    assert m == 18
    assert measured.message_step.tolist() == np.searchsorted(time, heard).__add__(1).tolist()
    assert measured.ranges[:, 0].tolist() == [41.0 + k for k in range(m)]
    assert measured.ranges[:, 1].tolist() == [41.5 + k for k in range(m)]
    assert np.isnan(measured.ranges[:, 2]).all()
    _, east, north, heading, speed, depth = measured.message[:, :6].T
    assert np.allclose(east, LEADER_SPEED * heard, atol=1e-9)
    assert np.allclose(north, LEADER_NORTH, atol=1e-9)
    assert np.allclose(heading, np.pi / 2, atol=1e-9)
    assert np.allclose(speed, LEADER_SPEED, atol=1e-9)
    assert np.allclose(depth, LEADER_DEPTH, atol=1e-9)


def imported(flight: Any, folder: Path, *options: str) -> Any:
    """Measurements of a flight that went out as a bag and came in again."""
    writer.write(flight, folder / "a.mcap")
    assert run("export", folder / "a.mcap", "--ros2", folder / "bag").exit_code == 0
    result = run("import", folder / "bag", "--out", folder / "b.mcap", *options)
    assert result.exit_code == 0, result.output
    return read_recording(folder / "b.mcap").measurements


@pytest.mark.system
@pytest.mark.parametrize("follower", [0, 1])
def test_a_flight_comes_back_from_its_bag(follower: int, tmp_path: Path) -> None:
    flight = make_flight(60.0, 2)
    again = imported(flight, tmp_path, "--vehicle", f"follower{follower + 1}")
    m = flight.measurements[follower]
    assert again.dt == m.dt
    assert np.array_equal(again.speed, m.speed)
    away = np.remainder(again.heading - m.heading + np.pi, 2 * np.pi) - np.pi
    assert np.abs(away).max() < 1e-12
    assert np.allclose(again.depth, m.depth, atol=1e-9, rtol=0)
    assert np.array_equal(again.message_step, m.message_step)
    assert np.array_equal(again.ranges, m.ranges, equal_nan=True)
    assert np.array_equal(again.message[:, 1:], m.message[:, 1:], equal_nan=True)
    assert np.allclose(again.message[:, 0], m.message[:, 0], atol=1e-6, rtol=0)


def test_several_vehicles_are_in_doubt(tmp_path: Path) -> None:
    writer.write(make_flight(10.0, 2), tmp_path / "a.mcap")
    assert run("export", tmp_path / "a.mcap", "--ros2", tmp_path / "bag").exit_code == 0
    result = run("import", tmp_path / "bag", "--out", tmp_path / "b.mcap")
    assert result.exit_code == 2
    assert "--vehicle" in told(result)
    assert "/follower2/imu" in told(result)
    assert not (tmp_path / "b.mcap").exists()
    result = run("import", tmp_path / "bag", "--out", tmp_path / "b.mcap", "--vehicle", "auv")
    assert "it has those of" in told(result)
    assert "follower1" in told(result)


MAP = """
stamps = "log"
[speed]
topic = "/auv/dvl"
field = "twist.linear.x"
[heading]
topic = "/auv/imu"
field = "orientation"
unit = "quaternion"
[depth]
topic = "/auv/pressure"
field = "fluid_pressure"
unit = "Pa"
"""
LEADER = """
[leader_east]
topic = "/leader/odom"
field = "pose.pose.position.x"
[leader_north]
topic = "/leader/odom"
field = "pose.pose.position.y"
[leader_depth]
value = 3.0
[leader_heading]
derive = true
[leader_speed]
derive = true
"""
RANGE = """
[range_rear]
topic = "/auv/acoustic"
field = "range"
where = { "header.frame_id" = "tx_stern" }
"""


def read_by(text: str, messages: list[Message], folder: Path) -> Any:
    (folder / "map.toml").write_text(text)
    bag = write_ros2(folder / "dive", messages)
    result = run("import", bag, "--map", folder / "map.toml", "--out", folder / "dive.mcap")
    assert result.exit_code == 0, result.output
    return read_recording(folder / "dive.mcap").measurements


def test_course_and_speed_follow_from_the_leaders_places(tmp_path: Path) -> None:
    messages = in_order(own_messages(), leader_messages(), range_messages())
    measured = read_by(MAP + LEADER + RANGE, messages, tmp_path)
    assert np.allclose(measured.message[:, 3], np.pi / 2, atol=1e-9)
    assert np.allclose(measured.message[:, 4], LEADER_SPEED, atol=1e-9)
    assert np.isnan(measured.ranges[:, 1]).all()


def test_a_held_value_is_the_last_one(tmp_path: Path) -> None:
    held = re.sub(r'(field = "pose.pose.position.x")', r"\1\nhold = true", LEADER)
    messages = in_order(own_messages(), leader_messages(), range_messages())
    measured = read_by(MAP + held + RANGE, messages, tmp_path)
    # heard 0.1 s after a second, when the last odometry was at the second
    assert np.allclose(measured.message[:, 1], LEADER_SPEED * (1 + np.arange(18)), atol=1e-9)
    # and the message is of that time; the mission begins a step of 0.2 s before the one at 0.125 s
    assert np.allclose(measured.message[:, 0], 1.075 + np.arange(18), atol=1e-6)


def test_two_robots_that_move_are_transmitters(tmp_path: Path) -> None:
    """Ranges to two other robots, each with its own odometry, on one topic with their names."""
    messages = own_messages()
    for k in range(200):
        at = START_NS + 100_000_000 * k
        for i in range(2):
            position = {"x": 5.0 * i + 0.05 * k, "y": 20.0 - 3.0 * i - 0.02 * k, "z": -2.0}
            odometry = stamped(at, "map", pose={"pose": {"position": position}})
            messages.append((f"/robot{i}/odom", "nav_msgs/msg/Odometry", at, odometry))
    for k in range(1, 19):
        for i in range(2):
            at = START_NS + 10**9 * k + 30_000_000 * i
            values = stamped(at, f"robot{i}", range=float(20 + k + i))
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", at, values))
    text = MAP
    for i, slot in enumerate(("rear", "front")):
        text += f'[range_{slot}]\ntopic = "/auv/acoustic"\nfield = "range"\n'
        text += f'where = {{ "header.frame_id" = "robot{i}" }}\n'
        for name, axis, factor in (("east", "x", 1.0), ("north", "y", 1.0), ("depth", "z", -1.0)):
            text += f'[{slot}_{name}]\ntopic = "/robot{i}/odom"\n'
            text += f'field = "pose.pose.position.{axis}"\nfactor = {factor}\n'
    for name, axis in (("east", "x"), ("north", "y")):
        text += f'[leader_{name}]\ntopic = "/robot0/odom"\nfield = "pose.pose.position.{axis}"\n'
    for name in ("heading", "speed", "depth"):
        text += f"[leader_{name}]\nvalue = 0.0\n"
    measured = read_by(text, in_order(messages), tmp_path)
    heard = 0.03 + 1 + np.arange(18)
    places = measured.transmitters
    assert places is not None
    for i in range(2):
        assert np.allclose(places[:, i, 0], 5.0 * i + 0.5 * heard, atol=1e-9)
        assert np.allclose(places[:, i, 1], 20.0 - 3.0 * i - 0.2 * heard, atol=1e-9)
        assert np.allclose(places[:, i, 2], 2.0, atol=1e-9)
        assert measured.ranges[:, i].tolist() == [21.0 + k + i for k in range(18)]
    assert np.isnan(places[:, 2]).all()


def test_robots_are_found_by_the_names_of_frames(tmp_path: Path) -> None:
    messages = own_messages()
    for k in range(200):
        at = START_NS + 100_000_000 * k
        for name in ("alpha", "beta"):
            messages.append((f"/{name}/odom", "nav_msgs/msg/Odometry", at, stamped(at, "map")))
    for k in range(1, 19):
        for i, name in enumerate(("alpha", "beta")):
            at = START_NS + 10**9 * k + 30_000_000 * i
            values = stamped(at, name, range=20.0)
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", at, values))
    bag = write_ros2(tmp_path / "dive", in_order(messages))
    assert run("import", bag, "--propose", tmp_path / "map.toml").exit_code == 0
    proposed = tomllib.loads((tmp_path / "map.toml").read_text())
    for slot, name in (("rear", "alpha"), ("front", "beta")):
        assert proposed[f"range_{slot}"]["where"] == {"header.frame_id": name}
        assert proposed[f"{slot}_depth"]["topic"] == f"/{name}/odom"
        assert proposed[f"{slot}_depth"]["factor"] == -1.0
    # the first of them stands for the leader; heading and speed of the own vehicle are measured
    assert proposed["leader_east"]["topic"] == "/alpha/odom"
    assert proposed["heading"]["topic"] == "/auv/imu"
    arguments = ["--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap"]
    assert run("import", bag, *arguments).exit_code == 0


@pytest.mark.parametrize(
    ("frames", "slots", "asked"),
    [
        # of two frames that name the rear one, the second gets another
        (("rear_1", "rear_2"), ("rear", "front"), "is 'rear_2' the front transmitter?"),
        # a frame that names none has taken the rear one
        (("alpha", "rear"), ("rear", "front"), "is 'rear' the front transmitter?"),
        (("tx_bow", "tx_stern"), ("front", "rear"), ""),
    ],
)
def test_a_frame_that_gets_another_transmitter_than_it_names_is_to_be_checked(
    frames: tuple[str, str], slots: tuple[str, str], asked: str, tmp_path: Path
) -> None:
    messages = own_messages()
    for k in range(1, 5):
        for i, frame in enumerate(frames):
            at = START_NS + 10**9 * k + 30_000_000 * i
            values = stamped(at, frame, range=20.0)
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", at, values))
    bag = write_ros2(tmp_path / "dive", in_order(messages))
    proposal = propose_for_bag(bag)
    for frame, slot in zip(frames, slots, strict=True):
        assert proposal.entries[f"range_{slot}"]["where"] == {"header.frame_id": frame}
    assert proposal.notes.get(f"range_{slots[1]}", "") == asked


def test_stamps_that_step_back_are_told(tmp_path: Path) -> None:
    messages = in_order(own_messages(), leader_messages(), range_messages())
    # the driver of the speed log repeats a message, and sends two in the wrong order
    speeds = [i for i, message in enumerate(messages) if message[0] == "/auv/dvl"]
    first, second = speeds[10:12]
    topic, kind, at, values = messages[first]
    messages[first] = (topic, kind, at, messages[second][3])
    messages[second] = (topic, kind, messages[second][2], values)
    messages.insert(second + 1, messages[second])
    (tmp_path / "map.toml").write_text((MAP + LEADER + RANGE).replace('stamps = "log"', ""))
    bag = write_ros2(tmp_path / "dive", messages)
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    assert result.exit_code == 0, result.output
    assert "/auv/dvl: 1 messages later than others with later times, sorted" in told(result)
    assert "/auv/dvl: 1 messages at the time of another left out" in told(result)
    speed = read_recording(tmp_path / "dive.mcap").measurements.speed
    assert np.allclose(speed, 1.002 + 0.004 * np.arange(speed.size), atol=1e-12)


def test_places_on_the_map_count_from_the_first(tmp_path: Path) -> None:
    """A ship that sails a minute of latitude north in a hundred seconds: 1855.24 m at 54.5° N, by
    the radius of the meridian, 6,378,137 (1 − e²) / (1 − e² sin² φ)^1.5 m.
    """
    messages = in_order(own_messages(), range_messages())
    for k in range(21):
        at = START_NS + 10**9 * k
        fix = stamped(at, "gps", latitude=54.5 + k / 100 / 60, longitude=18.5)
        messages.append(("/ship/gps", "sensor_msgs/msg/NavSatFix", at, fix))
    text = MAP + RANGE + "[leader_depth]\nvalue = 0.0\n"
    for name, field in (("east", "longitude"), ("north", "latitude")):
        text += f'[leader_{name}]\ntopic = "/ship/gps"\nfield = "{field}"\nunit = "{field}"\n'
    text += "[leader_heading]\nderive = true\n[leader_speed]\nderive = true\n"
    measured = read_by(text, in_order(messages), tmp_path)
    e2 = 0.00669437999014
    radius = 6378137.0 * (1 - e2) / (1 - e2 * math.sin(math.radians(54.5)) ** 2) ** 1.5
    speed = radius * math.radians(1 / 60) / 100
    heard = 1.1 + np.arange(18)
    assert np.allclose(measured.message[:, 2], speed * heard, atol=1e-4)
    assert np.allclose(measured.message[:, 1], 0.0, atol=1e-6)
    assert np.allclose(measured.message[:, 4], speed, atol=1e-6)
    assert speed == pytest.approx(18.5524, abs=1e-4)


def test_nothing_is_interpolated_over_gaps(tmp_path: Path) -> None:
    """The compass is silent from 5 to 12 s: steps in between are left out, and told."""
    messages = [
        message
        for message in own_messages()
        if message[0] != "/auv/imu" or not 5 <= (message[2] - START_NS) / 1e9 < 12
    ]
    messages = in_order(messages, leader_messages(), range_messages())
    measured = read_by(MAP + LEADER + RANGE, messages, tmp_path)
    # 35 of the 100 steps lie within the gap, two of them nearer than a step to its ends
    assert measured.durations is not None
    assert measured.durations.max() == pytest.approx(7.2, abs=0.21)
    assert measured.speed.size == pytest.approx(65, abs=1)


CASES = {
    "topic": (MAP.replace("/auv/dvl", "/auv/log") + LEADER + RANGE, "has no topic /auv/log"),
    "field": (MAP.replace("linear.x", "linear.q") + LEADER + RANGE, "twist.linear.x"),
    "unit": (MAP.replace('"Pa"', '"knots"') + LEADER + RANGE, "depth.unit: expected m, cm"),
    "key": (MAP + LEADER + RANGE + "\nheld = true", "held: unknown key; known here: column"),
    "missing": (MAP + RANGE, "lacks leader_east, leader_north"),
    "both": (MAP + LEADER + RANGE + "\nvalue = 1.0", "expected one of column, topic"),
    "kind": (MAP.replace('"quaternion"', '"deg"') + LEADER + RANGE, "has the unit 'quaternion'"),
    "frame": (MAP + LEADER + RANGE.replace("tx_stern", "tx"), "has these values"),
    "syntax": ("[speed\n", "no TOML"),
    "column": (MAP + LEADER + RANGE + '\n[range_front]\ncolumn = "R2"', "is a bag"),
    "steps": ('steps = "/leader/odom"\n' + MAP + LEADER + RANGE, "steps: expected the topic"),
    "upwards": (MAP.replace('unit = "Pa"', 'unit = "Pa"\nfactor = 0.1') + LEADER + RANGE, "above"),
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    messages = in_order(own_messages(), leader_messages(), range_messages())
    return write_ros2(tmp_path_factory.mktemp("bag") / "dive", messages)


@pytest.mark.parametrize("case", CASES)
def test_errors_of_a_map_name_it(case: str, bag: Path, tmp_path: Path) -> None:
    text, expected = CASES[case]
    (tmp_path / "map.toml").write_text(text)
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    assert result.exit_code == 2, result.output
    assert expected in told(result)
    assert not (tmp_path / "dive.mcap").exists()


def test_what_is_no_bag_is_told(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP + LEADER + RANGE)
    whole = (bag / "dive.mcap").read_bytes()
    writer.write(make_flight(10.0), tmp_path / "log.mcap")
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.bag").write_bytes(b"")
    (tmp_path / "text.db3").write_text("no bag")
    for name in ("log.mcap", "cut.mcap", "empty.bag", "text.db3"):
        arguments = ["import", tmp_path / name, "--map", tmp_path / "map.toml"]
        result = run(*arguments, "--out", tmp_path / "dive.mcap")
        assert result.exit_code == 2, result.output
        assert f"{name}: cannot be read as a bag of ROS" in told(result)


def test_the_proposal_of_a_swarm_is_of_one_vehicle(tmp_path: Path) -> None:
    flight = make_flight(10.0, 2)
    writer.write(replace(flight), tmp_path / "a.mcap")
    run("export", tmp_path / "a.mcap", "--ros2", tmp_path / "bag")
    result = run(
        "import", tmp_path / "bag", "--vehicle", "follower2", "--propose", tmp_path / "map.toml"
    )
    assert result.exit_code == 0, result.output
    text = (tmp_path / "map.toml").read_text()
    assert "check:" not in text
    assert "/follower1" not in text
    assert 'topic = "/follower2/reception"' in text

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

from laisn.messages import LeaderMessage, LinkMessages
from laisn_sim.cli.main import app
from sim.datasets.map_proposal import propose_for_bag
from sim.flight import VehicleRecord
from sim.log import writer
from sim.log.reader import read_recording
from sim.log.ros2 import write_measurement_bag
from tests.sim.datasets.bags import Message, stamped, write_ros1, write_ros2
from tests.synthetic import make_flight

START_NS = 1_700_000_000 * 10**9
GRAVITY, DENSITY, SURFACE_PA = 9.81, 1026.0, 101325.0
# a follower that turns at 2°/s, with its first step at 0.125 s, and through north at its step at
# 4.925 s
TURN_DEG_S, HEADING_DEG = 2.0, 350.15
# a leader that sails east past it
LEADER_SPEED, LEADER_NORTH, LEADER_DEPTH = 1.2, 30.0, 3.0


def printed_text(result: Any) -> str:
    """What a command printed, with one space for each line break."""
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
        time_ns = START_NS + 50_000_000 * k
        imu = stamped(time_ns, "auv", orientation=yaw_quaternion(heading_deg(0.05 * k)))
        messages.append(("/auv/imu", "sensor_msgs/msg/Imu", time_ns, imu))
        if k % 2 == 0:
            depth = 8.0 + 0.01 * k
            pressure = SURFACE_PA + DENSITY * GRAVITY * depth
            fluid = stamped(time_ns, "auv", fluid_pressure=pressure)
            messages.append(("/auv/pressure", "sensor_msgs/msg/FluidPressure", time_ns, fluid))
        if k % 4 == 2:
            # 25 ms after a message of the compass, between two
            dvl_ns = time_ns + 25_000_000
            twist = stamped(dvl_ns, "auv", twist={"linear": {"x": 1.0 + 0.001 * k}})
            messages.append(("/auv/dvl", "geometry_msgs/msg/TwistStamped", dvl_ns, twist))
    return messages


def leader_messages(duration_s: float = 20.0) -> list[Message]:
    """Odometry of the leader at 4 Hz."""
    messages = list[Message]()
    for k in range(int(duration_s * 4)):
        time_ns = START_NS + 250_000_000 * k
        position = {"x": LEADER_SPEED * 0.25 * k, "y": LEADER_NORTH, "z": -LEADER_DEPTH}
        pose = {"pose": {"position": position, "orientation": yaw_quaternion(90.0)}}
        odometry = stamped(
            time_ns, "map", pose=pose, twist={"twist": {"linear": {"x": LEADER_SPEED}}}
        )
        messages.append(("/leader/odom", "nav_msgs/msg/Odometry", time_ns, odometry))
    return messages


def range_messages(duration_s: float = 20.0) -> list[Message]:
    """Each second, 0.1 s after it, a range to the stern transmitter, and 50 ms later to the bow's,
    in one topic.
    """
    messages = list[Message]()
    for k in range(1, int(duration_s) - 1):
        for i, frame in enumerate(("tx_stern", "tx_bow")):
            time_ns = START_NS + 10**9 * k + 100_000_000 + 50_000_000 * i
            fields = stamped(time_ns, frame, range=np.float32(40.0 + k + 0.5 * i).item())
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", time_ns, fields))
    return messages


def in_order(*streams: list[Message]) -> list[Message]:
    return sorted((m for stream in streams for m in stream), key=lambda message: message[2])


def ros1(folder: Path, messages: list[Message]) -> Path:
    return write_ros1(folder / "dive.bag", messages)


def db3(folder: Path, messages: list[Message]) -> Path:
    return write_ros2(folder / "dive", messages, StoragePlugin.SQLITE3)


def mcap(folder: Path, messages: list[Message]) -> Path:
    return write_ros2(folder / "dive", messages)


def humble_db3(folder: Path, messages: list[Message]) -> Path:
    """As ROS 2 Humble records it: without definitions of types."""
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
    steps = measured.speed.size
    time = 0.125 + 0.2 * np.arange(steps)
    # the last step lies behind the last message of the pressure sensor
    assert steps == 100
    assert np.isnan(measured.depth[99])
    assert measured.dt == 0.2
    assert np.allclose(measured.speed, 1.002 + 0.004 * np.arange(steps), atol=1e-12)
    expected_heading = np.radians(HEADING_DEG + TURN_DEG_S * time)
    heading_error = np.remainder(measured.heading - expected_heading + np.pi, 2 * np.pi) - np.pi
    assert np.abs(heading_error).max() < 1e-9
    assert np.allclose(measured.depth[:99], 8.0 + 0.2 * time[:99], atol=1e-9)
    # a reception is at the second of its two ranges
    receptions = measured.message_step.size
    reception_time = 1.15 + np.arange(receptions)
    assert receptions == 18
    assert measured.message_step.tolist() == (np.searchsorted(time, reception_time) + 1).tolist()
    assert measured.ranges[:, 0].tolist() == [41.0 + k for k in range(receptions)]
    assert measured.ranges[:, 1].tolist() == [41.5 + k for k in range(receptions)]
    assert np.isnan(measured.ranges[:, 2]).all()
    _, east, north, heading, speed, depth = measured.message[:, :6].T
    assert np.allclose(east, LEADER_SPEED * reception_time, atol=1e-9)
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
    imported_back = imported(flight, tmp_path, "--vehicle", f"follower{follower + 1}")
    measured = flight.measurements[follower]
    assert imported_back.dt == measured.dt
    assert np.array_equal(imported_back.speed, measured.speed)
    heading_error = (
        np.remainder(imported_back.heading - measured.heading + np.pi, 2 * np.pi) - np.pi
    )
    assert np.abs(heading_error).max() < 1e-12
    assert np.allclose(imported_back.depth, measured.depth, atol=1e-9, rtol=0)
    assert np.array_equal(imported_back.message_step, measured.message_step)
    assert np.array_equal(imported_back.ranges, measured.ranges, equal_nan=True)
    assert np.array_equal(imported_back.message[:, 1:], measured.message[:, 1:], equal_nan=True)
    assert np.allclose(imported_back.message[:, 0], measured.message[:, 0], atol=1e-6, rtol=0)


def test_a_flight_among_beacons_comes_back_with_their_places(tmp_path: Path) -> None:
    """Messages of further links are of no field of the log, and are not taken for receptions."""
    flown = make_flight(10.0)
    measured = flown.measurements[0]
    heard = measured.message_step.size
    places = np.tile([[-30.0, -40.0, 12.0], [90.0, -30.0, 20.0], [10.0, 80.0, 15.0]], (heard, 1, 1))
    link = LinkMessages(
        message_step=measured.message_step,
        message=measured.message + 1.0,
        ranges=measured.ranges + 1.0,
    )
    placed = replace(measured, transmitters=places, links={"other": link})
    write_measurement_bag(replace(flown, measurements=(placed,)), tmp_path / "bag")
    log = tmp_path / "b.mcap"
    result = run("import", tmp_path / "bag", "--out", log)
    assert result.exit_code == 0, result.output
    back = read_recording(log).measurements
    assert np.array_equal(back.ranges, measured.ranges, equal_nan=True)
    assert back.transmitters is not None
    assert np.array_equal(back.transmitters, places)


def test_places_of_beacons_are_of_the_reception_that_holds_the_ranges(tmp_path: Path) -> None:
    """The second follower alone navigates among beacons: the proposal, which is of the first one
    unless its user chooses, has no places.
    """
    flown = make_flight(10.0, 2)
    second = flown.measurements[1]
    places = np.tile(np.arange(9.0).reshape(3, 3), (second.message_step.size, 1, 1))
    placed = (flown.measurements[0], replace(second, transmitters=places))
    write_measurement_bag(replace(flown, measurements=placed), tmp_path / "bag")
    proposal = propose_for_bag(tmp_path / "bag")
    assert proposal.entries["range_rear"]["topic"] == "/follower1/reception"
    assert "rear_east" not in proposal.entries
    proposal = propose_for_bag(tmp_path / "bag", "follower2")
    assert proposal.entries["rear_east"]["topic"] == "/follower2/reception"


def test_a_leader_that_has_sensed_is_imported_by_its_name(tmp_path: Path) -> None:
    """Its topics are its own where it is named, and the leader's of a follower elsewhere."""
    flown = make_flight(10.0, 2)
    measured = replace(flown.measurements[1], speed=flown.measurements[1].speed + 0.5)
    leader = VehicleRecord(measurements=measured, estimates=None)
    writer.write(replace(flown, leader=leader), tmp_path / "a.mcap")
    assert run("export", tmp_path / "a.mcap", "--ros2", tmp_path / "bag").exit_code == 0
    log = tmp_path / "b.mcap"
    result = run("import", tmp_path / "bag", "--vehicle", "leader", "--out", log)
    assert result.exit_code == 0, result.output
    back = read_recording(log).measurements
    assert np.array_equal(back.speed, measured.speed)
    assert np.array_equal(back.ranges, measured.ranges, equal_nan=True)
    result = run("import", tmp_path / "bag", "--vehicle", "follower1", "--out", log)
    assert result.exit_code == 0, result.output
    back = read_recording(log).measurements
    assert np.array_equal(back.speed, flown.measurements[0].speed)


def test_a_bag_of_several_vehicles_is_refused_until_one_is_named(tmp_path: Path) -> None:
    writer.write(make_flight(10.0, 2), tmp_path / "a.mcap")
    assert run("export", tmp_path / "a.mcap", "--ros2", tmp_path / "bag").exit_code == 0
    result = run("import", tmp_path / "bag", "--out", tmp_path / "b.mcap")
    assert result.exit_code == 2
    assert "--vehicle" in printed_text(result)
    assert "/follower2/imu" in printed_text(result)
    assert not (tmp_path / "b.mcap").exists()
    result = run("import", tmp_path / "bag", "--out", tmp_path / "b.mcap", "--vehicle", "auv")
    assert "it has those of" in printed_text(result)
    assert "follower1" in printed_text(result)


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
    """Measurements of a bag of messages by the text of a map."""
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


def test_constants_have_the_units_that_are_stated(tmp_path: Path) -> None:
    """A moored leader on the map: the first place is the origin; 10 ft are 3.048 m."""
    leader = '[leader_depth]\nvalue = 10.0\nunit = "ft"\n[leader_speed]\nvalue = 0.0\n'
    leader += '[leader_heading]\nvalue = 30.0\nunit = "deg"\n'
    for name, unit, degrees in (("east", "longitude", 18.5), ("north", "latitude", 54.5)):
        leader += f'[leader_{name}]\nvalue = {degrees}\nunit = "{unit}"\n'
    messages = in_order(own_messages(), range_messages())
    measured = read_by(MAP + leader + RANGE, messages, tmp_path)
    assert measured.message[:, 1:3] == pytest.approx(0.0, abs=1e-9)
    assert measured.message[:, 3] == pytest.approx(math.radians(30.0))
    assert measured.message[:, 5] == pytest.approx(3.048)


def test_a_pitch_between_two_readings_keeps_its_sign(tmp_path: Path) -> None:
    """A leader that lowers its nose by 0.1° a second from -2°, on an IMU at 4 Hz."""
    messages = in_order(own_messages(), leader_messages(), range_messages())
    for k in range(80):
        time_ns = START_NS + 250_000_000 * k
        # heading east, a rotation about the port axis lowers the nose
        half = math.radians(2.0 + 0.025 * k) / 2.0
        orientation = {"x": 0.0, "y": math.sin(half), "z": 0.0, "w": math.cos(half)}
        imu = stamped(time_ns, "leader", orientation=orientation)
        messages.append(("/leader/imu", "sensor_msgs/msg/Imu", time_ns, imu))
    pitch = '[leader_pitch]\ntopic = "/leader/imu"\nfield = "orientation"\nunit = "quaternion"\n'
    measured = read_by(MAP + LEADER + RANGE + pitch, in_order(messages), tmp_path)
    # heard 0.1 s after a second
    expected = np.deg2rad(-2.0 - 0.1 * (1.1 + np.arange(18)))
    column = LeaderMessage._fields.index("pitch")
    assert measured.message[:, column] == pytest.approx(expected, abs=1e-9)


def with_orientations(change: Callable[[int, dict[str, Any]], dict[str, Any]]) -> list[Message]:
    """Messages of a whole dive, with other fields of those of the compass, by their number."""
    own = own_messages()
    compass = [message for message in own if message[0] == "/auv/imu"]
    others = [message for message in own if message[0] != "/auv/imu"]
    changed = [
        (topic, type_name, time_ns, change(k, dict(fields)))
        for k, (topic, type_name, time_ns, fields) in enumerate(compass)
    ]
    return in_order(others, changed, leader_messages(), range_messages())


def test_the_length_of_a_quaternion_does_not_count(tmp_path: Path) -> None:
    def doubled(_: int, fields: dict[str, Any]) -> dict[str, Any]:
        numbers = {axis: 2.0 * value for axis, value in fields["orientation"].items()}
        return {**fields, "orientation": numbers}

    measured = read_by(MAP + LEADER + RANGE, with_orientations(doubled), tmp_path)
    expected = np.deg2rad(HEADING_DEG + TURN_DEG_S * (0.125 + 0.2 * np.arange(measured.speed.size)))
    turns = np.exp(1j * (measured.heading - expected))
    np.testing.assert_allclose(turns, 1.0, atol=1e-6)


ZEROS = {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}}
# as sensor_msgs/Imu states that it has no orientation
NOT_MEASURED = {"orientation": {"w": 1.0}, "orientation_covariance": [-1.0] + [0.0] * 8}


@pytest.mark.parametrize("nothing", [ZEROS, NOT_MEASURED], ids=["zeros", "covariance"])
def test_messages_without_an_orientation_have_no_heading(
    nothing: dict[str, Any], tmp_path: Path
) -> None:
    """Every second one, so that headings between the others count, at 2°/s."""

    def every_second(k: int, fields: dict[str, Any]) -> dict[str, Any]:
        return {**fields, **nothing} if k % 2 else fields

    measured = read_by(MAP + LEADER + RANGE, with_orientations(every_second), tmp_path)
    expected = np.deg2rad(HEADING_DEG + TURN_DEG_S * (0.125 + 0.2 * np.arange(measured.speed.size)))
    turns = np.exp(1j * (measured.heading - expected))
    np.testing.assert_allclose(turns, 1.0, atol=1e-6)


@pytest.mark.parametrize("nothing", [ZEROS, NOT_MEASURED], ids=["zeros", "covariance"])
def test_a_topic_without_any_orientation_is_refused(
    nothing: dict[str, Any], tmp_path: Path
) -> None:
    messages = with_orientations(lambda _, fields: {**fields, **nothing})
    bag = write_ros2(tmp_path / "dive", messages)
    (tmp_path / "map.toml").write_text(MAP + LEADER + RANGE)
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    assert result.exit_code == 2, result.output
    text = printed_text(result)
    assert "map.toml: heading: orientation of /auv/imu is an orientation in none of its 400" in text


def test_a_held_value_is_the_last_one(tmp_path: Path) -> None:
    held = re.sub(r'(field = "pose.pose.position.x")', r"\1\nhold = true", LEADER)
    messages = in_order(own_messages(), leader_messages(), range_messages())
    measured = read_by(MAP + held + RANGE, messages, tmp_path)
    # heard 0.1 s after a second, when the last odometry was at the second
    assert np.allclose(measured.message[:, 1], LEADER_SPEED * (1 + np.arange(18)), atol=1e-9)
    # and the message is of that time; the mission begins a step of 0.2 s before the one at 0.125 s
    assert np.allclose(measured.message[:, 0], 1.075 + np.arange(18), atol=1e-6)


def test_two_moving_robots_are_transmitters(tmp_path: Path) -> None:
    """Ranges to two other robots, each with its own odometry, on one topic with their names."""
    messages = own_messages()
    for k in range(200):
        time_ns = START_NS + 100_000_000 * k
        for i in range(2):
            position = {"x": 5.0 * i + 0.05 * k, "y": 20.0 - 3.0 * i - 0.02 * k, "z": -2.0}
            odometry = stamped(time_ns, "map", pose={"pose": {"position": position}})
            messages.append((f"/robot{i}/odom", "nav_msgs/msg/Odometry", time_ns, odometry))
    for k in range(1, 19):
        for i in range(2):
            time_ns = START_NS + 10**9 * k + 30_000_000 * i
            fields = stamped(time_ns, f"robot{i}", range=float(20 + k + i))
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", time_ns, fields))
    text = MAP
    for i, transmitter in enumerate(("rear", "front")):
        text += f'[range_{transmitter}]\ntopic = "/auv/acoustic"\nfield = "range"\n'
        text += f'where = {{ "header.frame_id" = "robot{i}" }}\n'
        for name, axis, factor in (("east", "x", 1.0), ("north", "y", 1.0), ("depth", "z", -1.0)):
            text += f'[{transmitter}_{name}]\ntopic = "/robot{i}/odom"\n'
            text += f'field = "pose.pose.position.{axis}"\nfactor = {factor}\n'
    for name, axis in (("east", "x"), ("north", "y")):
        text += f'[leader_{name}]\ntopic = "/robot0/odom"\nfield = "pose.pose.position.{axis}"\n'
    for name in ("heading", "speed", "depth"):
        text += f"[leader_{name}]\nvalue = 0.0\n"
    measured = read_by(text, in_order(messages), tmp_path)
    reception_time = 0.03 + 1 + np.arange(18)
    positions = measured.transmitters
    assert positions is not None
    for i in range(2):
        assert np.allclose(positions[:, i, 0], 5.0 * i + 0.5 * reception_time, atol=1e-9)
        assert np.allclose(positions[:, i, 1], 20.0 - 3.0 * i - 0.2 * reception_time, atol=1e-9)
        assert np.allclose(positions[:, i, 2], 2.0, atol=1e-9)
        assert measured.ranges[:, i].tolist() == [21.0 + k + i for k in range(18)]
    assert np.isnan(positions[:, 2]).all()


def test_robots_are_found_by_the_names_of_frames(tmp_path: Path) -> None:
    messages = own_messages()
    for k in range(200):
        time_ns = START_NS + 100_000_000 * k
        for name in ("alpha", "beta"):
            pose = {"pose": {"orientation": yaw_quaternion(0.0)}}
            odometry = stamped(time_ns, "map", pose=pose)
            messages.append((f"/{name}/odom", "nav_msgs/msg/Odometry", time_ns, odometry))
    for k in range(1, 19):
        for i, name in enumerate(("alpha", "beta")):
            time_ns = START_NS + 10**9 * k + 30_000_000 * i
            fields = stamped(time_ns, name, range=20.0)
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", time_ns, fields))
    bag = write_ros2(tmp_path / "dive", in_order(messages))
    assert run("import", bag, "--propose", tmp_path / "map.toml").exit_code == 0
    proposed = tomllib.loads((tmp_path / "map.toml").read_text())
    for transmitter, name in (("rear", "alpha"), ("front", "beta")):
        assert proposed[f"range_{transmitter}"]["where"] == {"header.frame_id": name}
        assert proposed[f"{transmitter}_depth"]["topic"] == f"/{name}/odom"
        assert proposed[f"{transmitter}_depth"]["factor"] == -1.0
    # the first of them stands for the leader; heading and speed of the own vehicle are measured
    assert proposed["leader_east"]["topic"] == "/alpha/odom"
    assert proposed["heading"]["topic"] == "/auv/imu"
    arguments = ["--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap"]
    assert run("import", bag, *arguments).exit_code == 0


@pytest.mark.parametrize(
    ("frames", "transmitters", "note"),
    [
        # of two frames whose names say rear, the second gets the front transmitter
        (("rear_1", "rear_2"), ("rear", "front"), "is 'rear_2' the front transmitter?"),
        # a frame whose name says neither has taken the rear transmitter
        (("alpha", "rear"), ("rear", "front"), "is 'rear' the front transmitter?"),
        (("tx_bow", "tx_stern"), ("front", "rear"), ""),
    ],
)
def test_a_frame_that_gets_another_transmitter_than_it_names_is_to_be_checked(
    frames: tuple[str, str], transmitters: tuple[str, str], note: str, tmp_path: Path
) -> None:
    messages = own_messages()
    for k in range(1, 5):
        for i, frame in enumerate(frames):
            time_ns = START_NS + 10**9 * k + 30_000_000 * i
            fields = stamped(time_ns, frame, range=20.0)
            messages.append(("/auv/acoustic", "sensor_msgs/msg/Range", time_ns, fields))
    bag = write_ros2(tmp_path / "dive", in_order(messages))
    proposal = propose_for_bag(bag)
    for frame, transmitter in zip(frames, transmitters, strict=True):
        assert proposal.entries[f"range_{transmitter}"]["where"] == {"header.frame_id": frame}
    assert proposal.notes.get(f"range_{transmitters[1]}", "") == note


def test_stamps_that_step_back_are_reported(tmp_path: Path) -> None:
    messages = in_order(own_messages(), leader_messages(), range_messages())
    # the driver of the speed log repeats a message, and sends two in the wrong order
    speeds = [i for i, message in enumerate(messages) if message[0] == "/auv/dvl"]
    first, second = speeds[10:12]
    topic, kind, time_ns, fields = messages[first]
    messages[first] = (topic, kind, time_ns, messages[second][3])
    messages[second] = (topic, kind, messages[second][2], fields)
    messages.insert(second + 1, messages[second])
    (tmp_path / "map.toml").write_text((MAP + LEADER + RANGE).replace('stamps = "log"', ""))
    bag = write_ros2(tmp_path / "dive", messages)
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    assert result.exit_code == 0, result.output
    assert "/auv/dvl: 1 messages later than others with later times, sorted" in printed_text(result)
    assert "/auv/dvl: 1 messages at the time of another left out" in printed_text(result)
    speed = read_recording(tmp_path / "dive.mcap").measurements.speed
    assert np.allclose(speed, 1.002 + 0.004 * np.arange(speed.size), atol=1e-12)


def test_latitudes_and_longitudes_become_metres_from_the_first_position(tmp_path: Path) -> None:
    """A ship that sails a minute of latitude north in a hundred seconds: 1855.24 m at 54.5° N, by
    the radius of the meridian, 6,378,137 (1 − e²) / (1 − e² sin² φ)^1.5 m.
    """
    messages = in_order(own_messages(), range_messages())
    for k in range(21):
        time_ns = START_NS + 10**9 * k
        fix = stamped(time_ns, "gps", latitude=54.5 + k / 100 / 60, longitude=18.5)
        messages.append(("/ship/gps", "sensor_msgs/msg/NavSatFix", time_ns, fix))
    text = MAP + RANGE + "[leader_depth]\nvalue = 0.0\n"
    for name, field in (("east", "longitude"), ("north", "latitude")):
        text += f'[leader_{name}]\ntopic = "/ship/gps"\nfield = "{field}"\nunit = "{field}"\n'
    text += "[leader_heading]\nderive = true\n[leader_speed]\nderive = true\n"
    measured = read_by(text, in_order(messages), tmp_path)
    e2 = 0.00669437999014
    radius = 6378137.0 * (1 - e2) / (1 - e2 * math.sin(math.radians(54.5)) ** 2) ** 1.5
    speed = radius * math.radians(1 / 60) / 100
    reception_time = 1.1 + np.arange(18)
    assert np.allclose(measured.message[:, 2], speed * reception_time, atol=1e-4)
    assert np.allclose(measured.message[:, 1], 0.0, atol=1e-6)
    assert np.allclose(measured.message[:, 4], speed, atol=1e-6)
    assert speed == pytest.approx(18.5524, abs=1e-4)


def test_positions_without_a_fix_are_left_out(tmp_path: Path) -> None:
    """A receiver of GNSS that has no fix at first, and then for a second, states 0°, 0° meanwhile;
    the ship sails 0.0001° of longitude a second on the equator.
    """
    messages = in_order(own_messages(), range_messages())
    for k in range(21):
        time_ns = START_NS + 10**9 * k
        has_fix = k > 2 and k != 11
        fix = stamped(time_ns, "gps", latitude=0.0, longitude=9.0 + 1e-4 * k if has_fix else 0.0)
        fix["status"] = {"status": 0 if has_fix else -1, "service": 1}
        messages.append(("/ship/gps", "sensor_msgs/msg/NavSatFix", time_ns, fix))
    text = MAP + RANGE + "[leader_depth]\nvalue = 0.0\n"
    for name, field in (("east", "longitude"), ("north", "latitude")):
        text += f'[leader_{name}]\ntopic = "/ship/gps"\nfield = "{field}"\nunit = "{field}"\n'
    text += "[leader_heading]\nderive = true\n[leader_speed]\nderive = true\n"
    (tmp_path / "map.toml").write_text(text)
    bag = write_ros2(tmp_path / "dive", in_order(messages))
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    print(printed_text(result))
    assert "4 messages of /ship/gps without a position left out" in printed_text(result)
    message = read_recording(tmp_path / "dive.mcap").measurements.message
    speed = 6378137.0 * math.radians(1e-4)
    # from the first fix on; receptions are at 1.1, 2.1, … s
    time = 1.1 + np.arange(2, 18)
    assert np.allclose(message[:, 1], speed * (time - 3.0), atol=1e-4)
    assert np.allclose(message[:, 4], speed, atol=1e-6)


def test_ranges_outside_of_their_own_limits_are_left_out(tmp_path: Path) -> None:
    """A modem reports its maximum plus one where it has heard nothing."""
    messages = own_messages() + leader_messages()
    for k, message in enumerate(range_messages()):
        topic, kind, time_ns, fields = message
        limits = {"min_range": 1.0, "max_range": 500.0}
        heard = fields | limits if k != 4 else fields | limits | {"range": 501.0}
        messages.append((topic, kind, time_ns, heard))
    ranges = read_by(MAP + LEADER + RANGE, in_order(messages), tmp_path).ranges
    heard = ranges[np.isfinite(ranges)]
    # 18 messages of the stern transmitter, without the third
    np.testing.assert_allclose(heard, 41.0 + np.delete(np.arange(18.0), 2), atol=1e-5)


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


# text of a map, and words of the error
BROKEN_MAPS = {
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


@pytest.mark.parametrize("case", BROKEN_MAPS)
def test_errors_of_a_map_are_named(case: str, bag: Path, tmp_path: Path) -> None:
    text, expected = BROKEN_MAPS[case]
    (tmp_path / "map.toml").write_text(text)
    result = run("import", bag, "--map", tmp_path / "map.toml", "--out", tmp_path / "dive.mcap")
    assert result.exit_code == 2, result.output
    assert expected in printed_text(result)
    assert not (tmp_path / "dive.mcap").exists()


def test_files_that_are_no_bags_are_refused(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP + LEADER + RANGE)
    bag_bytes = (bag / "dive.mcap").read_bytes()
    writer.write(make_flight(10.0), tmp_path / "log.mcap")
    (tmp_path / "cut.mcap").write_bytes(bag_bytes[: len(bag_bytes) // 2])
    (tmp_path / "empty.bag").write_bytes(b"")
    (tmp_path / "text.db3").write_text("no bag")
    for name in ("log.mcap", "cut.mcap", "empty.bag", "text.db3"):
        arguments = ["import", tmp_path / name, "--map", tmp_path / "map.toml"]
        result = run(*arguments, "--out", tmp_path / "dive.mcap")
        assert result.exit_code == 2, result.output
        assert f"{name}: cannot be read as a bag of ROS" in printed_text(result)


def test_the_proposal_of_a_swarm_is_of_one_vehicle(tmp_path: Path) -> None:
    flight = make_flight(10.0, 2)
    writer.write(flight, tmp_path / "a.mcap")
    run("export", tmp_path / "a.mcap", "--ros2", tmp_path / "bag")
    result = run(
        "import", tmp_path / "bag", "--vehicle", "follower2", "--propose", tmp_path / "map.toml"
    )
    assert result.exit_code == 0, result.output
    text = (tmp_path / "map.toml").read_text()
    assert "check:" not in text
    assert "/follower1" not in text
    assert 'topic = "/follower2/reception"' in text

"""Flights as ROS 2 bags, read back by two libraries of others: rosbags and mcap."""

import itertools
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import av
import numpy as np
import PIL.Image
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from experiments.flight.fly import fly
from experiments.flight.library import as_scenario
from laisn.messages import Channel, LinkMessages, SensorHeader
from laisn_sim.cli.main import app
from sim import attitude
from sim.flight import FlightRecord, VehicleRecord
from sim.log import writer
from sim.log.ros2 import write_measurement_bag
from sim.log.ros2_robot import roll_pitch_yaw, urdf
from tests.synthetic import make_flight, moved

AXES = ("east", "north", "depth")
EPOCH_NS = 1767225600 * 10**9  # 2026-01-01T00:00:00Z, the epoch of scenarios


def export(flight: FlightRecord, folder: Path, **options: Any) -> Path:
    """The bag that the command writes of a flight's log."""
    log = folder / "mission.mcap"
    writer.write(flight, log, **options)
    result = CliRunner().invoke(app, ["log", "export", str(log), "--ros2", str(folder / "bag")])
    assert result.exit_code == 0, result.output
    assert str(folder / "bag" / "metadata.yaml") in result.output.replace("\n", "")
    return folder / "bag"


def printed_text(result: Any) -> str:
    """What a command printed, on one line."""
    return " ".join(result.output.split())


def by_rosbags(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Times [ns] and messages by topic."""
    topics: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([bag]) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            topics.setdefault(connection.topic, []).append((time_ns, message))
    return topics


def by_mcap(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """The same, decoded by the definitions that the file holds."""
    topics: dict[str, list[tuple[int, Any]]] = {}
    with (bag / "bag.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, decoded))
    return topics


READERS = {"rosbags": by_rosbags, "mcap": by_mcap}


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def xyz(point: Any) -> list[float]:
    return [point.x, point.y, point.z]


def wxyz(quaternion: Any) -> list[float]:
    return [quaternion.w, quaternion.x, quaternion.y, quaternion.z]


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(30.0, 2)


@pytest.fixture(scope="module")
def bag(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export(flight, tmp_path_factory.mktemp("ros2"))


@pytest.fixture(scope="module", params=READERS)
def topics(request: pytest.FixtureRequest, bag: Path) -> dict[str, list[tuple[int, Any]]]:
    return READERS[request.param](bag)


Topics = dict[str, list[tuple[int, Any]]]


def test_the_truth_is_that_of_the_flight(topics: Topics, flight: FlightRecord) -> None:
    trajectory = flight.trajectory
    times = EPOCH_NS + np.rint(1e9 * trajectory.time).astype(np.int64)
    for vehicle, name in enumerate(trajectory.names):
        messages = [message for _, message in topics[f"/{name}/truth/odometry"]]
        assert [time_ns for time_ns, _ in topics[f"/{name}/truth/odometry"]] == times.tolist()
        assert [stamp_ns(message.header) for message in messages] == times.tolist()
        assert {message.header.frame_id for message in messages} == {"map"}
        assert {message.child_frame_id for message in messages} == {f"{name}/base_link"}
        poses = [message.pose.pose for message in messages]
        assert np.array_equal(
            [xyz(pose.position) for pose in poses], trajectory.position[:, vehicle]
        )
        assert np.array_equal(
            [wxyz(pose.orientation) for pose in poses], trajectory.quaternion[:, vehicle]
        )
        # velocity in the body, by another library
        rotations = Rotation.from_quat(np.roll(trajectory.quaternion[:, vehicle], -1, axis=1))
        velocity = rotations.inv().apply(trajectory.velocity[:, vehicle].copy())
        twists = [message.twist.twist for message in messages]
        assert np.allclose([xyz(twist.linear) for twist in twists], velocity, atol=1e-12, rtol=0)
        assert np.array_equal(
            [xyz(twist.angular) for twist in twists], trajectory.angular_velocity[:, vehicle]
        )
    assert [stamp_ns_of_clock(message) for _, message in topics["/clock"]] == times.tolist()


def stamp_ns_of_clock(message: Any) -> int:
    return int(message.clock.sec) * 10**9 + int(message.clock.nanosec)


def test_the_estimate_is_that_of_the_flight(topics: Topics, flight: FlightRecord) -> None:
    for i, name in enumerate(flight.trajectory.names[1:]):
        estimate = flight.estimates[i]
        measured = flight.measurements[i]
        odometry = [message for _, message in topics[f"/{name}/estimate/odometry"]]
        poses = [message for _, message in topics[f"/{name}/estimate/pose"]]
        for messages in (odometry, poses):
            position = np.array([xyz(message.pose.pose.position) for message in messages])
            assert np.array_equal(position[:, :2], estimate.state[:, :2])
            # the hydrophone sits 0.1 m above the pressure sensor
            assert np.allclose(position[:, 2], 0.1 - measured.depth, atol=1e-12, rtol=0)
            covariance = np.array([message.pose.covariance for message in messages]).reshape(
                -1, 6, 6
            )
            assert np.array_equal(covariance[:, :2, :2], estimate.covariance[:, :2, :2])
            assert np.linalg.eigvalsh(covariance).min() >= -1e-12
        # forward and port of a level hull at the measured heading
        forward = np.column_stack([np.sin(measured.heading), np.cos(measured.heading)])
        port = np.column_stack([-np.cos(measured.heading), np.sin(measured.heading)])
        linear = np.array([xyz(message.twist.twist.linear) for message in odometry])
        velocity = estimate.state[:, 2:]
        assert np.allclose(linear[:, 0], (velocity * forward).sum(axis=1), atol=1e-12, rtol=0)
        assert np.allclose(linear[:, 1], (velocity * port).sum(axis=1), atol=1e-12, rtol=0)
        covariance = np.array([message.twist.covariance for message in odometry]).reshape(-1, 6, 6)
        variance_forward = np.einsum(
            "ni,nij,nj->n", forward, estimate.covariance[:, 2:, 2:], forward
        )
        assert np.allclose(covariance[:, 0, 0], variance_forward, atol=1e-12, rtol=0)


def test_measurements_are_those_of_the_flight(topics: Topics, flight: FlightRecord) -> None:
    for i, name in enumerate(flight.trajectory.names[1:]):
        measured = flight.measurements[i]
        speed = [message.twist.twist.linear.x for _, message in topics[f"/{name}/speed_log"]]
        assert np.array_equal(speed, measured.speed)
        pressure = np.array([message.fluid_pressure for _, message in topics[f"/{name}/pressure"]])
        # 1026 kg/m³ and 9.81 m/s² below the standard atmosphere
        assert np.allclose(
            (pressure - 101325.0) / (1026.0 * 9.81), measured.depth, atol=1e-9, rtol=0
        )
        imu = [message for _, message in topics[f"/{name}/imu"]]
        rotations = Rotation.from_quat(
            np.roll([wxyz(message.orientation) for message in imu], -1, axis=1)
        )
        yaw = rotations.as_euler("ZYX")[:, 0]
        heading_error = (
            np.remainder(0.5 * math.pi - yaw - measured.heading + math.pi, 2 * math.pi) - math.pi
        )
        assert np.abs(heading_error).max() < 1e-12
        assert {message.angular_velocity_covariance[0] for message in imu} == {-1.0}
        receptions = [message for _, message in topics[f"/{name}/reception"]]
        assert [message.leader_east for message in receptions] == measured.message[:, 1].tolist()
        assert np.array_equal(
            [
                (message.range_rear, message.range_front, message.range_middle)
                for message in receptions
            ],
            measured.ranges,
            equal_nan=True,
        )
        for k, transmitter in enumerate(("rear", "front", "middle")):
            is_received = np.isfinite(measured.ranges[:, k])
            messages = topics[f"/{name}/range/{transmitter}"]
            assert [message.range for _, message in messages] == measured.ranges[
                is_received, k
            ].astype("f4").tolist()
            steps = measured.message_step[is_received]
            assert [time_ns for time_ns, _ in messages] == (EPOCH_NS + 10**8 * steps).tolist()
            assert {message.radiation_type for _, message in messages} == {0}


def test_covariances_of_log_and_compass_are_the_mean_squares_of_their_errors(
    tmp_path: Path,
) -> None:
    """Of the readings of a mission, over two periods of the drifts; a bias to port and the random
    part of a compass, which is to starboard, cancel in part.
    """
    sensors = {
        "speed_bias_m_s": 0.15,
        "speed_sigma_m_s": 0.1,
        "speed_drift_m_s": 0.2,
        "heading_bias_deg": 5.0,
        "heading_sigma_deg": 4.0,
        "heading_drift_deg": 6.0,
        "drift_period_s": 200.0,
    }
    to_port = {"route": "T5", "name": "to-port", "sensors": {"heading_bias_deg": -5.0}}
    flown, _ = fly(
        as_scenario(
            {
                "duration_s": 400.0,
                "motion": "kinematic",
                "sensors": sensors,
                "followers": [{"route": "T5", "name": "plain"}, to_port],
            }
        )
    )
    messages = by_rosbags(export(flown, tmp_path))
    steps = flown.step_index()
    for i, name in enumerate(("plain", "to_port")):
        measured = flown.measurements[i]
        speed_error = measured.speed - flown.trajectory.forward_speed[steps, i + 1]
        (_, log) = messages[f"/{name}/speed_log"][-1]
        assert log.twist.covariance[0] == pytest.approx(np.mean(speed_error**2), rel=0.05)
        turn = measured.heading - flown.trajectory.heading[steps, i + 1]
        heading_error = np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi
        expected = pytest.approx(np.mean(heading_error**2), rel=0.05)
        (_, imu) = messages[f"/{name}/imu"][-1]
        (_, pose) = messages[f"/{name}/estimate/pose"][-1]
        assert imu.orientation_covariance[8] == expected
        assert pose.pose.covariance[35] == expected


def test_the_variance_of_a_pressure_is_by_the_water_at_its_depth(tmp_path: Path) -> None:
    """Of a pressure p(z), with dp/dz = g ρ(z), and a depth with errors of σ: (g ρ σ)²."""
    pytest.importorskip("gsw")
    (tmp_path / "cast.csv").write_text("depth [m],density [kg/m3]\n0,1000\n40,1040\n")
    flown, _ = fly(
        as_scenario(
            {
                "duration_s": 5.0,
                "motion": "kinematic",
                "ocean": {"density": {"file": str(tmp_path / "cast.csv")}},
                "sensors": {"depth_sigma_m": 0.2},
                "followers": [{"route": "T5", "depth_m": 20.0}],
            }
        )
    )
    messages = by_rosbags(export(flown, tmp_path))["/follower/pressure"]
    pressure = np.array([message.fluid_pressure for _, message in messages])
    variance = np.array([message.variance for _, message in messages])
    depth = flown.measurements[0].depth
    weight = 9.81 * (1000.0 * depth + 0.5 * depth**2)
    np.testing.assert_allclose(pressure - 101325.0, weight, rtol=1e-9)
    np.testing.assert_allclose(variance, (9.81 * (1000.0 + depth) * 0.2) ** 2, rtol=1e-9)


def test_a_vehicle_at_030_and_nose_up_points_there(tmp_path: Path) -> None:
    """REP 103, by hand: at a compass heading of 30°, 20° nose up, forward is 30° east of north and
    up by 20°, and port is level, to the north-west.
    """
    flown = make_flight(10.0)
    instants, vehicles, _ = flown.trajectory.position.shape
    quaternion = np.broadcast_to(
        attitude.from_euler(math.radians(30.0), math.radians(20.0)), (instants, vehicles, 4)
    ).copy()
    flown = replace(flown, trajectory=moved(flown.trajectory, quaternion=quaternion))
    topics = by_rosbags(export(flown, tmp_path))
    frames = {
        transform.child_frame_id: transform
        for _, message in topics["/tf"]
        for transform in message.transforms
    }
    quaternion = frames["leader/base_link"].transform.rotation
    hull = Rotation.from_quat([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
    sin_30, cos_30 = 0.5, math.sqrt(0.75)
    up, horizontal = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    assert np.allclose(
        hull.apply([1, 0, 0]), [sin_30 * horizontal, cos_30 * horizontal, up], atol=1e-12
    )
    assert np.allclose(hull.apply([0, 1, 0]), [-cos_30, sin_30, 0.0], atol=1e-12)
    # level at 030 the yaw is 60°, whose half has the sine 0.5
    level_hull = attitude.from_euler(math.radians(30.0))
    assert np.allclose(level_hull, [cos_30, 0.0, 0.0, 0.5], atol=1e-15)


def test_frames_are_those_of_rep_105(topics: Topics, flight: FlightRecord) -> None:
    ((_, static),) = topics["/tf_static"]
    parents = {
        transform.child_frame_id: transform.header.frame_id for transform in static.transforms
    }
    moving = {
        transform.child_frame_id: transform.header.frame_id
        for _, message in topics["/tf"]
        for transform in message.transforms
    }
    assert not parents.keys() & moving.keys()
    parents |= moving
    for name in flight.trajectory.names:
        assert parents[f"{name}/odom"] == "map"
        assert parents[f"{name}/base_link"] == f"{name}/odom"
    assert parents["leader/tx_front"] == "leader/base_link"
    assert parents["follower1/hydrophone"] == "follower1/base_link"
    assert parents["follower1/estimate"] == "map"
    offsets = {
        transform.child_frame_id: xyz(transform.transform.translation)
        for transform in static.transforms
    }
    assert offsets["leader/tx_rear"] == [-1.0, 0.0, 0.0]
    assert offsets["follower2/hydrophone"] == [0.0, 0.0, 0.1]
    assert offsets["leader/odom"] == [0.0, 0.0, 0.0]
    assert "map" not in parents


def test_positions_on_the_map_are_those_of_the_flight(topics: Topics, flight: FlightRecord) -> None:
    scenario = flight.scenario
    first = topics["/leader/truth/navsat"][0][1]
    assert first.latitude == scenario.origin_latitude_deg
    assert first.longitude == pytest.approx(scenario.origin_longitude_deg, abs=1e-12)
    last = topics["/follower1/estimate/navsat"][-1][1]
    east, north = flight.estimates[0].state[290, :2]
    # a minute of latitude is about a nautical mile
    minutes = 60.0 * (last.latitude - scenario.origin_latitude_deg)
    assert minutes * 1852.0 == pytest.approx(north, rel=0.01)
    # and one of longitude is shorter by the cosine of the latitude
    cos_latitude = math.cos(math.radians(scenario.origin_latitude_deg))
    minutes = 60.0 * (last.longitude - scenario.origin_longitude_deg)
    assert minutes * 1852.0 * cos_latitude == pytest.approx(east, rel=0.01)
    assert last.position_covariance[4] == flight.estimates[0].covariance[290, 1, 1]


def test_humble_reads_what_later_releases_read(bag: Path) -> None:
    """Humble's types are those of the bag, and its Range, which lacks the variance at the end,
    the first bytes of it.
    """
    humble = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([bag]) as reader:
        compared_types = set()
        for connection, _, raw in reader.messages():
            type_name = connection.msgtype
            if type_name in compared_types or type_name.startswith("laisn_msgs"):
                continue
            compared_types.add(type_name)
            if type_name == "sensor_msgs/msg/Range":
                assert (
                    humble.deserialize_cdr(raw[:-4], type_name).range
                    == reader.deserialize(raw, type_name).range
                )
            else:
                assert humble.hash_rihs01(type_name) == connection.digest
                humble.deserialize_cdr(raw, type_name)
    bag_information = YAML(typ="safe").load(bag / "metadata.yaml")["rosbag2_bagfile_information"]
    assert bag_information["version"] == 8
    assert bag_information["storage_identifier"] == "mcap"
    for topic in bag_information["topics_with_message_count"]:
        # Humble reads a text here, in which there is a list
        profiles = topic["topic_metadata"]["offered_qos_profiles"]
        assert isinstance(profiles, str)
        (profile,) = YAML(typ="safe").load(profiles)
        assert profile["lifespan"] == {"sec": 9223372036, "nsec": 854775807}


def test_late_subscribers_get_frames_and_hulls(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        latched = {
            connection.topic
            for connection in reader.connections
            if connection.ext.offered_qos_profiles[0].durability  # type: ignore[union-attr]
            is QosDurability.TRANSIENT_LOCAL
        }
    assert latched == {
        "/tf_static",
        *(f"/{name}/robot_description" for name in ("leader", "follower1", "follower2")),
    }


def test_the_hull_is_as_long_as_the_model(topics: Topics) -> None:
    """The leader's hull reaches from the nozzle's end, 1.03 m astern, to 1 m ahead: by the shapes
    of its description as RViz places them.
    """
    ((_, message),) = topics["/leader/robot_description"]
    robot = ElementTree.fromstring(message.data)
    (link,) = robot.findall("link")
    assert link.get("name") == "leader/base_link"
    ends = list[float]()
    for visual in link.findall("visual"):
        origin, geometry = visual.find("origin"), visual.find("geometry")
        assert origin is not None
        assert geometry is not None
        position = np.array(str(origin.get("xyz")).split(), float)
        angles = np.array(str(origin.get("rpy")).split(), float)
        rotation = Rotation.from_euler("xyz", angles)
        for cylinder in geometry.findall("cylinder"):
            half_length = 0.5 * float(str(cylinder.get("length")))
            radius = float(str(cylinder.get("radius")))
            for end_along_axis in (-half_length, half_length):
                # a disc of a cylinder reaches along x by its radius times the sine
                axis = rotation.apply([0, 0, 1])
                disc_extent = radius * math.sqrt(max(0.0, 1.0 - axis[0] ** 2))
                ends += [
                    position[0] + end_along_axis * axis[0] - disc_extent,
                    position[0] + end_along_axis * axis[0] + disc_extent,
                ]
    assert min(ends) == pytest.approx(-1.03, abs=1e-4)
    assert max(ends) == pytest.approx(1.0, abs=1e-4)


def test_the_view_shows_what_is_in_the_bag(bag: Path, flight: FlightRecord) -> None:
    view = YAML(typ="safe").load(bag / "view.rviz")["Visualization Manager"]
    assert view["Global Options"]["Fixed Frame"] == "map"
    durability_in_view = dict[str, str]()
    for display in view["Displays"]:
        for key in ("Topic", "Description Topic"):
            if key in display:
                durability_in_view[display[key]["Value"]] = display[key]["Durability Policy"]
    with AnyReader([bag]) as reader:
        durability = {
            connection.topic: connection.ext.offered_qos_profiles[0].durability  # type: ignore[union-attr]
            for connection in reader.connections
        }
    name_in_rviz = {
        QosDurability.TRANSIENT_LOCAL: "Transient Local",
        QosDurability.VOLATILE: "Volatile",
    }
    # a subscriber gets what was latched only if it asks for that
    assert durability_in_view == {
        topic: name_in_rviz[durability[topic]] for topic in durability_in_view
    }
    for name in flight.trajectory.names:
        assert {
            f"/{name}/robot_description",
            f"/{name}/truth/odometry",
        } <= durability_in_view.keys()
    assert "/follower2/estimate/odometry" in durability_in_view


@pytest.mark.parametrize("seed", range(5))
def test_roll_pitch_and_yaw_of_a_description_give_its_rotation(seed: int) -> None:
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    by_angles = Rotation.from_euler("xyz", roll_pitch_yaw(rotation)).as_matrix()
    assert np.allclose(by_angles, rotation, atol=1e-12)
    # at a pitch of 90° roll and yaw are not unique
    upright = Rotation.from_euler("xyz", [0.0, 0.5 * math.pi, 0.3 * seed]).as_matrix()
    by_angles = Rotation.from_euler("xyz", roll_pitch_yaw(upright)).as_matrix()
    assert np.allclose(by_angles, upright, atol=1e-9)


@pytest.mark.parametrize("model", ["follower", "remus100", "lauv", "bluerov2_heavy"])
def test_every_hull_has_a_description(model: str) -> None:
    robot = ElementTree.fromstring(urdf("a", model, "a/base_link").encode())
    assert len(robot.findall("link/visual/geometry/*")) > 5


def grey_film(frames: int) -> list[tuple[float, bytes]]:
    """A film of a grey that becomes lighter, a frame a second."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height = 64, 48
    encoder.pix_fmt = "yuv420p"
    encoder.time_base = Fraction(1, 25)
    encoder.options = {"tune": "zerolatency", "bf": "0"}
    packets = list[bytes]()
    for i in range(frames):
        grey = np.full((48, 64, 3), 20 * i, np.uint8)
        packets += [bytes(p) for p in encoder.encode(av.VideoFrame.from_ndarray(grey, "rgb24"))]
    packets += [bytes(p) for p in encoder.encode(None)]
    return list(zip(itertools.count(0.0), packets, strict=False))


def test_the_film_becomes_pictures(tmp_path: Path) -> None:
    bag = export(make_flight(30.0), tmp_path, video=grey_film(8))
    messages = by_rosbags(bag)["/camera/compressed"]
    assert [time_ns - EPOCH_NS for time_ns, _ in messages] == [10**9 * i for i in range(8)]
    assert {message.format for _, message in messages} == {"jpeg"}
    means = [
        float(np.mean(PIL.Image.open(BytesIO(message.data.tobytes())).convert("L")))
        for _, message in messages
    ]
    assert np.allclose(means, 20.0 * np.arange(8), atol=4.0)


def test_the_same_flight_gives_the_same_bytes(
    flight: FlightRecord, bag: Path, tmp_path: Path
) -> None:
    second_bag = export(flight, tmp_path)
    for name in ("bag.mcap", "metadata.yaml"):
        assert (second_bag / name).read_bytes() == (bag / name).read_bytes()


def test_a_bag_replaces_a_bag_and_nothing_else(flight: FlightRecord, tmp_path: Path) -> None:
    writer.write(flight, tmp_path / "a.mcap")

    def run(folder: str) -> Any:
        arguments = ["log", "export", str(tmp_path / "a.mcap"), "--ros2", str(tmp_path / folder)]
        return CliRunner().invoke(app, arguments)

    assert run("bag").exit_code == 0
    before = (tmp_path / "bag/bag.mcap").read_bytes()
    assert run("bag").exit_code == 0
    assert (tmp_path / "bag/bag.mcap").read_bytes() == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("keep")
    result = run("mine")
    assert result.exit_code != 0
    assert "holds notes.txt" in printed_text(result)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".bag")]


def test_names_that_topics_cannot_have_are_replaced(tmp_path: Path) -> None:
    flown = make_flight(10.0, 2)
    names = ("leader", "no-1", "2nd.auv")
    trajectory = replace(
        flown.trajectory,
        names=names,
        site_names=tuple(
            f"{names[v]}/{site.rpartition('/')[2]}"
            for site, v in zip(
                flown.trajectory.site_names, flown.trajectory.site_vehicle, strict=True
            )
        ),
    )
    followers = tuple(
        follower.model_copy(update={"name": name})
        for follower, name in zip(flown.scenario.followers, names[1:], strict=True)
    )
    scenario = flown.scenario.model_copy(update={"followers": followers})
    topics = by_rosbags(export(replace(flown, trajectory=trajectory, scenario=scenario), tmp_path))
    assert {"/no_1/imu", "/v2nd_auv/imu"} <= topics.keys()


def test_sensors_whose_names_are_alike_have_topics_of_their_own(tmp_path: Path) -> None:
    flown = make_flight(2.0)
    measured = flown.measurements[0]
    steps = measured.speed.size
    custom = {"side-scan": np.ones((steps, 1)), "side_scan": np.full((steps, 2), 2.0)}
    flight = replace(flown, measurements=(replace(measured, custom=custom),))
    write_measurement_bag(flight, tmp_path / "bag")
    topics = by_rosbags(tmp_path / "bag")
    for name, values in (("side_scan", [1.0]), ("side_scan_2", [2.0, 2.0])):
        messages = topics[f"/follower/sensor/{name}"]
        assert len(messages) == steps
        assert all(message.values.tolist() == values for _, message in messages)


PLACES = np.array([[-30.0, -40.0, 12.0], [90.0, -30.0, 20.0], [np.nan, np.nan, np.nan]])
"""Of two beacons and none: east, north, depth [m]."""


def with_links_and_sensors(flown: FlightRecord) -> FlightRecord:
    """A flight whose follower navigates among beacons, hears answers with readings of their
    sender, and reads a sensor every 0.5 s, with one reading that is none.
    """
    measured = flown.measurements[0]
    heard = measured.message_step.size
    rows = np.full((measured.speed.size, 2), np.nan)
    rows[4::5] = np.arange(2 * rows[4::5].shape[0]).reshape(-1, 2)
    rows[9] = np.nan
    answers = LinkMessages(
        message_step=measured.message_step,
        message=measured.message,
        ranges=measured.ranges,
        round_trip=0.01 * np.arange(heard),
        content={"dvl": np.arange(2.0 * heard).reshape(heard, 2)},
    )
    beacons = replace(answers, places=PLACES, round_trip=None, content={})
    channels = (Channel("forward", "m/s"), Channel("starboard", "m/s"))
    measured = replace(
        measured,
        transmitters=np.tile(PLACES, (heard, 1, 1)),
        links={"answer-1": answers, "lbl": beacons},
        custom={"dvl": rows},
        sensors={"dvl": SensorHeader(channels=channels, period=0.5)},
    )
    return replace(flown, measurements=(measured,))


@pytest.mark.parametrize("read_bag", READERS.values(), ids=READERS)
def test_receptions_have_places_links_and_answers(
    tmp_path: Path, read_bag: Callable[[Path], Topics]
) -> None:
    flight = with_links_and_sensors(make_flight(10.0))
    write_measurement_bag(flight, tmp_path / "bag")
    topics = read_bag(tmp_path / "bag")
    measured = flight.measurements[0]
    times = (EPOCH_NS + 10**8 * measured.message_step).tolist()
    names = [f"{t}_{axis}" for t in ("rear", "front", "middle") for axis in AXES]
    for topic, has_places in (("reception", True), ("link/lbl", True), ("link/answer_1", False)):
        messages = topics[f"/follower/{topic}"]
        assert [time_ns for time_ns, _ in messages] == times
        expected = PLACES.ravel() if has_places else np.full(9, np.nan)
        for k, (_, message) in enumerate(messages):
            assert message.leader_timestamp == measured.message[k, 0]
            numbers = [getattr(message, name) for name in names]
            assert np.array_equal(numbers, expected, equal_nan=True)
    for k, (_, message) in enumerate(topics["/follower/link/answer_1"]):
        assert message.round_trip == 0.01 * k
        assert list(message.content) == [2.0 * k, 2.0 * k + 1.0]
        assert list(message.channels) == ["dvl.forward", "dvl.starboard"]
        assert list(message.units) == ["m/s", "m/s"]
    assert all(math.isnan(message.round_trip) for _, message in topics["/follower/link/lbl"])


@pytest.mark.parametrize("read_bag", READERS.values(), ids=READERS)
def test_a_sensor_has_messages_at_its_own_rate_with_names_and_units(
    tmp_path: Path, read_bag: Callable[[Path], Topics]
) -> None:
    flight = with_links_and_sensors(make_flight(10.0))
    write_measurement_bag(flight, tmp_path / "bag")
    messages = read_bag(tmp_path / "bag")["/follower/sensor/dvl"]
    assert [time_ns for time_ns, _ in messages] == [
        EPOCH_NS + 5 * 10**8 * (i + 1) for i in range(20)
    ]
    assert list(messages[0][1].channels) == ["forward", "starboard"]
    assert list(messages[0][1].units) == ["m/s", "m/s"]
    # the one that lost its echo is there, too
    values = np.array([list(message.values) for _, message in messages])
    expected = np.arange(40.0).reshape(20, 2)
    expected[1] = np.nan
    assert np.array_equal(values, expected, equal_nan=True)


def test_a_leader_that_navigates_is_in_the_bag_as_followers_are(tmp_path: Path) -> None:
    flown = make_flight(10.0)
    record = VehicleRecord(measurements=flown.measurements[0], estimates=flown.estimates[0])
    topics = by_rosbags(export(replace(flown, leader=record), tmp_path))
    of_follower = {
        topic.removeprefix("/follower/") for topic in topics if topic.startswith("/follower/")
    }
    assert {topic for topic in topics if topic.startswith("/leader/")} == {
        f"/leader/{topic}" for topic in of_follower
    }
    states = record.estimates.state if record.estimates else np.empty(0)
    odometry = [message for _, message in topics["/leader/estimate/odometry"]]
    places = [xyz(message.pose.pose.position)[:2] for message in odometry]
    assert np.array_equal(places, states[:, :2])
    # the synthetic leader has no hydrophone, so that its hull is what it estimates
    assert {m.header.frame_id for _, m in topics["/leader/estimate/navsat"]} == {"leader/base_link"}
    speeds = [message.twist.twist.linear.x for _, message in topics["/leader/speed_log"]]
    assert np.array_equal(speeds, record.measurements.speed)


def test_what_a_bag_has_not_is_said(tmp_path: Path) -> None:
    writer.write(make_flight(10.0), tmp_path / "a.mcap")
    command = ["log", "export", str(tmp_path / "a.mcap"), "--ros2", str(tmp_path / "bag")]
    text = printed_text(CliRunner().invoke(app, command, env={"COLUMNS": "300"}))
    assert "/follower/error, /follower/innovation" in text


def test_times_that_ros_cannot_count_are_refused(tmp_path: Path) -> None:
    flown = make_flight(10.0)
    late = flown.scenario.model_copy(update={"epoch": "2040-01-01T00:00:00Z"})
    writer.write(replace(flown, scenario=late), tmp_path / "a.mcap")
    result = CliRunner().invoke(
        app, ["log", "export", str(tmp_path / "a.mcap"), "--ros2", str(tmp_path / "bag")]
    )
    assert "January 2038" in printed_text(result)
    assert not (tmp_path / "bag").exists()


def test_without_the_package_one_sentence_tells_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    writer.write(make_flight(10.0), tmp_path / "a.mcap")
    result = CliRunner().invoke(app, ["log", "export", str(tmp_path / "a.mcap"), "--ros2"])
    assert "pip install rosbags" in printed_text(result)

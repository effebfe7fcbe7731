"""The log: equal flights, equal bytes, honest failures."""

import dataclasses
import os
import signal
import struct
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory
from mcap_protobuf.writer import Writer as ProtobufWriter
from synthetic import make_flight

import models
from laisn.estimates import FixKind
from sim import log
from sim.flight import Flight, Outcome
from sim.geodesy import FLATTENING, SEMI_MAJOR_AXIS, geodetic
from sim.log_channels import _slot_pose
from sim.log_clock import Clock
from sim.log_events import Event
from sim.log_export import export
from sim.log_file import LogError, contents, partial_path
from sim.log_hull import hull
from sim.log_reader import info, read, read_measurements
from sim.log_schema import OWN_MOTION, RECEPTION, SCALAR_SCHEMAS, STAMP, Template
from sim.recovery import recover

LAYOUT = Path(__file__).resolve().parents[1] / "experiments" / "data" / "foxglove_layout.json"


def bits(value: Any) -> Any:
    """Nested values with arrays as bytes, so that NaN and the sign of zero count."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        return {f.name: bits(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return tuple(bits(item) for item in value) if isinstance(value, tuple) else value


def errors_of(flight: Flight) -> list[tuple[Any, Any]]:
    """Position errors of the hydrophone, and numbers in place of bearing errors."""
    return [
        (np.linalg.norm(e.state[:, :2] - flight.hydrophone(i)[:, :2], axis=1), 1e-3 * e.state[:, 3])
        for i, e in enumerate(flight.estimates)
    ]


@pytest.fixture(scope="module")
def flight() -> Flight:
    return make_flight(30.0)


@pytest.fixture(scope="module")
def written(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "mission.mcap"
    events = [Event(12.0, "warning", "mirror capture", "follower")]
    log.write(flight, path, summary='{"runs": 1}', errors=errors_of(flight), events=events)
    return path


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [item.decoded_message for item in reader.iter_decoded_messages(topics=[topic])]


@pytest.mark.parametrize(
    "options",
    [
        {"duration": 30.0, "n_followers": 1},
        {"duration": 20.0, "n_followers": 3, "message_interval": 5.0},
        {"duration": 40.0, "n_followers": 1, "filter_step": 1.0, "message_interval": 10.0},
        {"duration": 1.0, "n_followers": 1, "message_interval": 10.0},
    ],
    ids=["one", "three", "slow filter", "no message"],
)
def test_reading_gives_the_same_flight_to_the_bit(tmp_path: Path, options: dict[str, Any]) -> None:
    flight = make_flight(**options)
    log.write(flight, tmp_path / "a.mcap")
    assert bits(read(tmp_path / "a.mcap")) == bits(flight)
    for i, name in enumerate(flight.trajectory.names[1:]):
        assert bits(read_measurements(tmp_path / "a.mcap", name)) == bits(flight.measurements[i])


def test_odd_numbers_and_several_fixes_a_step_survive(tmp_path: Path) -> None:
    flight = make_flight(5.0)
    e = flight.estimates[0]
    thrice = {
        f.name: np.repeat(getattr(e, f.name), 3, axis=0) for f in dataclasses.fields(e) if f.name[:2] in ("fi", "in")
    }
    state = e.state.copy()
    state[0] = [-0.0, 5e-324, np.nextafter(1.0, 2.0), -np.inf]
    odd = dataclasses.replace(e, **thrice, state=state)
    flight = dataclasses.replace(flight, estimates=(odd,), outcome=Outcome.DIVERGED)
    log.write(flight, tmp_path / "a.mcap")
    assert bits(read(tmp_path / "a.mcap")) == bits(flight)
    assert messages(tmp_path / "a.mcap", "/log")[-1].message == Outcome.DIVERGED.value


def test_same_flight_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        log.write(make_flight(10.0, 2), tmp_path / name, video=[(0.0, b"x"), (3.0, b"y")])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.parametrize("schema", SCALAR_SCHEMAS, ids=lambda s: s.name)
def test_rows_are_what_protobuf_says(schema: Any) -> None:
    random = np.random.default_rng(1)
    n = 50
    time_ns = random.integers(0, 2**62, n)
    numbers = random.normal(size=(n, len(schema.fields)))
    whole = random.integers(-(2**40), 2**40, (n, len(schema.integers)))
    rows = schema.template().rows(time_ns, np.hstack([numbers, whole.view(np.float64)]))
    for i, row in enumerate(rows):
        expected = schema.message_class(
            **dict(zip(schema.fields, numbers[i].tolist(), strict=True)),
            **dict(zip(schema.integers, whole[i].tolist(), strict=True)),
        )
        expected.timestamp.FromNanoseconds(int(time_ns[i]))
        parsed = schema.message_class.FromString(row)
        assert parsed == expected
        assert parsed.SerializeToString() == expected.SerializeToString()


def test_rows_may_hold_zeros_and_full_seconds() -> None:
    template = Template(PoseInFrame(timestamp=STAMP, frame_id="world", pose=_slot_pose(0)), 7)
    row = template.rows(np.array([7_000_000_000]), np.zeros((1, 7)))[0]
    expected = PoseInFrame(frame_id="world")
    expected.timestamp.seconds = 7
    expected.pose.position.x = expected.pose.orientation.x = 0.0
    parsed = PoseInFrame.FromString(row)
    assert parsed.timestamp == expected.timestamp
    assert parsed.pose.position.x == parsed.pose.orientation.w == 0.0


def test_a_template_needs_all_its_slots() -> None:
    with pytest.raises(ValueError, match=r"no slot for columns \[7\]"):
        Template(PoseInFrame(timestamp=STAMP, pose=_slot_pose(0)), 8)


def test_channels_times_and_attachments(flight: Flight, written: Path) -> None:
    epoch = int(datetime(2026, 1, 1, tzinfo=UTC).timestamp()) * 10**9
    counts: dict[str, int] = {}
    with written.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            stamped = {
                "/tf": lambda m: m.transforms[0],
                "/scene/vehicles": lambda m: m.entities[0],
                "/scene/acoustics": lambda m: m.entities[0],
            }.get(channel.topic, lambda m: m)(decoded)
            assert stamped.timestamp.ToNanoseconds() == message.log_time == message.publish_time
            assert epoch <= message.log_time <= epoch + 30 * 10**9
        attachments = {a.name: a for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert counts == {
        "/tf": 301,
        **dict.fromkeys(("/leader/pose", "/leader/state", "/follower/pose", "/follower/state"), 301),
        **dict.fromkeys(("/leader/fix", "/follower/fix", "/scene/vehicles"), 31),
        **{f"/follower/{name}": 300 for name in ("motion", "filter", "estimate", "error")},
        **dict.fromkeys(
            ("/follower/reception", "/follower/innovation", "/follower/estimate/fix", "/scene/acoustics"), 30
        ),
        "/log": 30 + 1 + 1,
    }
    assert set(attachments) == {"scenario.toml", "vehicles.json", "summary.json", "versions.json"}
    assert all(a.log_time == a.create_time == epoch for a in attachments.values())
    assert attachments["summary.json"].data == b'{"runs": 1}'
    assert metadata["laisn"]["outcome"] == "COMPLETED"
    assert "east" in metadata["conventions"]["world"]


def test_poses_transforms_and_errors_are_the_flight(flight: Flight, written: Path) -> None:
    t = flight.trajectory
    pose, transforms = messages(written, "/follower/pose")[100], messages(written, "/tf")[100].transforms
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == tuple(t.position[100, 1])
    q = pose.pose.orientation
    assert (q.w, q.x, q.y, q.z) == tuple(t.quaternion[100, 1])
    tree = {x.child_frame_id: x for x in transforms}
    assert set(tree) == {"leader", "follower", *(s for s in t.site_names if "depth" not in s)}
    front, leader = tree["leader/tx_front"], tree["leader"]
    assert (front.parent_frame_id, leader.parent_frame_id) == ("leader", "world")
    assert (front.translation.x, front.translation.y, front.translation.z) == (1.0, 0.0, 0.0)
    assert leader.rotation.w == t.quaternion[100, 0, 0]
    error = messages(written, "/follower/error")[-1]
    assert (error.position_error, error.bearing_error) == tuple(x[-1] for x in errors_of(flight)[0])
    state = messages(written, "/leader/state")[100]
    assert (state.pitch, state.depth, state.thrust_main) == (t.pitch[100, 0], t.depth[100, 0], t.thrust[100, 0, 0])


def test_log_lines_tell_kinds_events_and_outcome(flight: Flight, written: Path) -> None:
    lines = messages(written, "/log")
    kinds = flight.estimates[0].fix_kind
    assert sum("gross-error gate" in line.message for line in lines) == np.count_nonzero(kinds == FixKind.GATED)
    assert sum("ranges are missing" in line.message for line in lines) == np.count_nonzero(kinds == FixKind.LOST)
    capture = next(line for line in lines if line.message == "mirror capture")
    assert (capture.timestamp.ToNanoseconds() - lines[0].timestamp.ToNanoseconds(), capture.name) == (
        11 * 10**9,
        "follower",
    )
    assert lines[-1].message == Outcome.COMPLETED.value


def test_video_lies_among_the_messages_in_order_of_time(flight: Flight, tmp_path: Path) -> None:
    frames = [(0.5 * k, bytes([k])) for k in range(70)]
    log.write(flight, tmp_path / "a.mcap", video=iter(frames))
    video = messages(tmp_path / "a.mcap", "/camera")
    assert [frame.data for frame in video] == [data for _, data in frames]
    assert video[3].format == "h264"
    assert video[3].timestamp.ToNanoseconds() - video[0].timestamp.ToNanoseconds() == 1_500_000_000
    with (tmp_path / "a.mcap").open("rb") as stream:
        times = [message.log_time for _, _, message in make_reader(stream).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    with pytest.raises(ValueError, match="in order of time"):
        log.write(flight, tmp_path / "b.mcap", video=[(2.0, b""), (1.0, b"")])
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_errors_must_fit_the_flight(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="errors of follower have shapes"):
        log.write(flight, tmp_path / "a.mcap", errors=[(np.zeros(3), np.zeros(3))])
    with pytest.raises(ValueError, match="the flight has 1"):
        log.write(flight, tmp_path / "a.mcap", errors=errors_of(flight) * 2)


@pytest.mark.parametrize("name", ["leader", "follower"])
def test_the_hull_in_the_scene_fills_the_model(name: str) -> None:
    """Extent along the hull and across it, against MuJoCo's own bounding boxes of the geoms."""
    model = mujoco.MjModel.from_xml_path(str(models.path(name)))
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    boxes = [
        (model.geom_aabb[g, :3] + corners * model.geom_aabb[g, 3:]) @ data.geom_xmat[g].reshape(3, 3).T
        + data.geom_xpos[g]
        for g in range(model.ngeom)
    ]
    expected = np.concatenate(boxes)

    def extent(primitive: Any, half: Any) -> Any:
        place, turn = np.empty(3), np.empty(9)
        p, q = primitive.pose.position, primitive.pose.orientation
        place[:] = p.x, p.y, p.z
        mujoco.mju_quat2Mat(turn, np.array([q.w, q.x, q.y, q.z]))
        return place + half @ turn.reshape(3, 3).T

    entity = hull(name)
    drawn = [
        extent(x, corners * np.array([x.size.x, x.size.y, x.size.z]) / 2)
        for x in (*entity.cylinders, *entity.spheres, *entity.cubes)
    ]
    drawn += [extent(x, np.array([[p.x, p.y, p.z] for p in x.points])) for x in entity.triangles]
    shown = np.concatenate(drawn)
    np.testing.assert_allclose(shown.min(axis=0), expected.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(shown.max(axis=0), expected.max(axis=0), atol=1e-6)


def test_the_scene_is_complete_at_every_second(flight: Flight, written: Path) -> None:
    update = messages(written, "/scene/vehicles")[20]
    entities = {e.id: e for e in update.entities}
    assert set(entities) == {"leader/hull", "leader/trail", "follower/hull", "follower/trail", "follower/estimate"}
    assert entities["leader/hull"].frame_locked
    assert entities["leader/hull"].frame_id == "leader"
    assert len(entities["leader/trail"].lines[0].points) == 21
    last = entities["leader/trail"].lines[0].points[-1]
    assert (last.x, last.y, last.z) == tuple(flight.trajectory.position[200, 0])
    # the ellipse that holds 95 % of a normal distribution has half axes √(χ²₀.₉₅ of 2 degrees, 5.991) σ
    ellipse = entities["follower/estimate"].spheres[0]
    variance = np.linalg.eigvalsh(flight.estimates[0].covariance[199, :2, :2])
    np.testing.assert_allclose([ellipse.size.x, ellipse.size.y], 2 * np.sqrt(5.991464547 * variance[::-1]), rtol=1e-9)
    half_turn = np.arctan2(ellipse.pose.orientation.z, ellipse.pose.orientation.w)
    major = np.array([np.cos(2 * half_turn), np.sin(2 * half_turn)])
    np.testing.assert_allclose(flight.estimates[0].covariance[199, :2, :2] @ major, variance[1] * major, atol=1e-12)


def test_a_ping_is_drawn_from_the_transmitters_to_the_hydrophone(flight: Flight, written: Path) -> None:
    t, m = flight.trajectory, flight.measurements[0]
    ping = messages(written, "/scene/acoustics")[9].entities[0]
    hydrophone, rear = (t.site_position[100, t.site(s)] for s in ("follower/hydrophone", "leader/tx_rear"))
    points = [(p.x, p.y, p.z) for p in ping.lines[0].points]
    assert points[:2] == [tuple(rear), tuple(hydrophone)]
    assert len(points) == 6
    disc = ping.cylinders[0]
    assert (disc.pose.position.x, disc.pose.position.y, disc.pose.position.z) == (rear[0], rear[1], hydrophone[2])
    # Pythagoras: slant range, horizontal range and difference in height
    assert (disc.size.x / 2) ** 2 + (rear[2] - hydrophone[2]) ** 2 == pytest.approx(m.ranges[9, 0] ** 2)
    assert len(messages(written, "/scene/acoustics")[12].entities[0].lines[0].points) == 4, "one range was lost"


def test_the_map_agrees_with_the_ellipsoid() -> None:
    """Against the exact way: the tangent plane at the origin, in earth-centred coordinates."""

    def earth_centred(latitude: Any, longitude: Any, height: Any) -> Any:
        e2 = FLATTENING * (2 - FLATTENING)
        n = SEMI_MAJOR_AXIS / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
        return np.stack(
            [
                (n + height) * np.cos(latitude) * np.cos(longitude),
                (n + height) * np.cos(latitude) * np.sin(longitude),
                (n * (1 - e2) + height) * np.sin(latitude),
            ]
        )

    origin = np.deg2rad([60.0, 18.55])
    places = np.array([[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [-700, 700, 0]], dtype=float)
    latitude, longitude, height = geodetic(places, 60.0, 18.55).T
    apart = earth_centred(np.deg2rad(latitude), np.deg2rad(longitude), height) - earth_centred(*origin, 0.0)[:, None]
    s, c, sl, cl = np.sin(origin[0]), np.cos(origin[0]), np.sin(origin[1]), np.cos(origin[1])
    east, north = -sl * apart[0] + cl * apart[1], -s * cl * apart[0] - s * sl * apart[1] + c * apart[2]
    np.testing.assert_allclose(np.column_stack([east, north]), places[:, :2], atol=0.2)


def test_layout_names_channels_and_fields_that_exist(written: Path) -> None:
    import json

    layout = json.loads(LAYOUT.read_text())
    there = contents(written)
    panels = layout["configById"]

    def leaves(node: Any) -> set[str]:
        return {node} if isinstance(node, str) else leaves(node["first"]) | leaves(node["second"])

    assert leaves(layout["layout"]) == set(panels)
    topics = {t for p in panels.values() for t in [*p.get("topics", {}), *p.get("topicColors", {})]}
    assert topics | {panels["RosOut!log"]["topicToRender"]} <= set(there.topics)
    assert panels["Image!camera"]["imageMode"]["imageTopic"] == "/camera"
    paths = [path["value"].removesuffix(".@rad2deg") for p in panels.values() for path in p.get("paths", [])]
    assert paths
    for topic, _, name in (path.partition(".") for path in paths):
        assert name in there.topics[topic].descriptor().fields_by_name


@pytest.mark.parametrize("table_format", ["parquet", "csv"])
def test_export(flight: Flight, written: Path, tmp_path: Path, table_format: Any) -> None:
    import pyarrow.csv
    import pyarrow.parquet

    files = {f.name: f for f in export(written, tmp_path / "tables", table_format)}
    name = f"follower_motion.{table_format}"
    assert {name, f"leader_pose.{table_format}", f"log.{table_format}"} <= set(files)
    table = (pyarrow.parquet.read_table if table_format == "parquet" else pyarrow.csv.read_csv)(files[name])
    assert table.column_names == ["log_time_ns", "speed", "heading", "depth"]
    assert table["speed"].to_numpy().tobytes() == flight.measurements[0].speed.tobytes()
    assert table["log_time_ns"].to_numpy()[0] == Clock(flight.scenario.epoch).epoch_ns + 10**8
    with pytest.raises(LogError, match="unknown format 'xls'; available: parquet, csv"):
        export(written, tmp_path, "xls")  # type: ignore[arg-type]


def test_info(written: Path) -> None:
    facts = info(written)
    counts = {c.topic: (c.schema, c.messages) for c in facts.channels}
    assert counts["/follower/motion"] == ("laisn.OwnMotion", 300)
    assert facts.duration_s == 30.0
    assert facts.start == datetime(2026, 1, 1, tzinfo=UTC)
    assert facts.metadata["laisn"]["seed"] == "1"
    assert facts.size == written.stat().st_size


def write_foreign(path: Path, *, gap: bool = False, second_reception_s: float = 0.95) -> None:
    """A vehicle's log by the plain protobuf writer, with its own clock and 20 Hz."""
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        start = 1_600_000_000_123_456_789

        def put(topic: str, message: Any, at: float) -> None:
            ns = start + round(at * 1e9)
            writer.write_message(topic, message, log_time=ns, publish_time=ns)

        for k in range(40):
            late = 1.0 if gap and k > 20 else 0.0
            put("/auv/motion", OWN_MOTION.message_class(speed=1.5, heading=0.0, depth=k / 10), 0.05 * k + late)
        for at in (0.512, second_reception_s):
            put(
                "/auv/reception",
                RECEPTION.message_class(leader_east=3.0, range_rear=40.0, range_front=float("nan")),
                at,
            )


def test_measurements_of_a_real_vehicle(tmp_path: Path) -> None:
    write_foreign(tmp_path / "auv.mcap")
    m = read_measurements(tmp_path / "auv.mcap", "auv")
    assert m.dt == 0.05
    assert m.speed.tolist() == [1.5] * 40
    assert m.depth.tolist() == [k / 10 for k in range(40)]
    # 0.512 s lies after step 11 (0.50 s) and before step 12 (0.55 s); 0.95 s is step 20
    assert m.message_step.tolist() == [12, 20]
    assert m.ranges[0, 0] == 40.0
    assert np.isnan(m.ranges[0, 1])
    with pytest.raises(LogError, match="lacks attachment scenario.toml"):
        read(tmp_path / "auv.mcap")
    with pytest.raises(LogError, match="lacks channel /follower/motion; available: /auv/motion, /auv/reception"):
        read_measurements(tmp_path / "auv.mcap")


def test_measurements_with_gaps_or_crowded_steps_are_refused(tmp_path: Path) -> None:
    write_foreign(tmp_path / "gap.mcap", gap=True)
    with pytest.raises(LogError, match=r"every 0.05 s without gaps.*2.05 s after its start"):
        read_measurements(tmp_path / "gap.mcap", "auv")
    write_foreign(tmp_path / "crowd.mcap", second_reception_s=0.53)
    with pytest.raises(LogError, match="several messages within one filter step"):
        read_measurements(tmp_path / "crowd.mcap", "auv")


def test_a_channel_without_the_fields_is_named(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream, ProtobufWriter(stream) as writer:
        writer.write_message("/follower/motion", PoseInFrame(frame_id="world"), log_time=0, publish_time=0)
    with pytest.raises(LogError, match="/follower/motion lacks speed, heading, depth; its fields: timestamp"):
        read_measurements(tmp_path / "a.mcap")
    with (tmp_path / "b.mcap").open("wb") as stream:
        json_writer = Writer(stream)
        json_writer.start()
        json_writer.register_channel("/follower/motion", "json", json_writer.register_schema("x", "jsonschema", b"{}"))
        json_writer.finish()
    with pytest.raises(LogError, match="encoded as 'json', expected protobuf"):
        read_measurements(tmp_path / "b.mcap")


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "text").write_text("speed,heading\n1,2\n")
    for name, text in (("empty", "no MCAP"), ("text", "no MCAP"), ("absent", "No such file"), (".", "directory")):
        for reader in (read, read_measurements, info):
            with pytest.raises(LogError, match=text):
                reader(tmp_path / name)


def test_every_flipped_byte_is_noticed(written: Path, tmp_path: Path) -> None:
    """Or does no harm: the flight is never another one."""
    whole = written.read_bytes()
    expected = bits(read(written))
    places = np.random.default_rng(2).choice(len(whole), 120, replace=False).tolist()
    refused = 0
    for place in [*places, 0, 9, len(whole) - 1, len(whole) - 9, len(whole) - 30]:
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        try:
            assert bits(read(tmp_path / "damaged.mcap")) == expected
        except LogError:
            refused += 1
    assert refused == 125


def test_a_cut_off_log_is_refused_and_recovered(flight: Flight, written: Path, tmp_path: Path) -> None:
    whole = written.read_bytes()
    for length in (9, len(whole) // 3, len(whole) - 1):
        (tmp_path / "cut.mcap").write_bytes(whole[:length])
        with pytest.raises(LogError, match=r"cut off before its end; laisn log recover"):
            read(tmp_path / "cut.mcap")
    rescued = recover(tmp_path / "cut.mcap")
    assert rescued.name == "cut.recovered.mcap"
    assert (tmp_path / "cut.mcap").exists()
    assert read(rescued).outcome is Outcome.INTERRUPTED
    with pytest.raises(LogError, match="is whole"):
        recover(rescued)
    (tmp_path / "cut.mcap").write_bytes(whole[:5000])
    with pytest.raises(LogError, match="nothing to recover"):
        recover(tmp_path / "cut.mcap")


def test_recovery_keeps_whole_instants(tmp_path: Path) -> None:
    """A log of several chunks, cut within one: a prefix of the flight comes back, all channels equally long."""
    flight = make_flight(200.0)
    log.write(flight, tmp_path / "a.mcap")
    whole = (tmp_path / "a.mcap").read_bytes()
    partial = partial_path(tmp_path / "b.mcap")
    partial.write_bytes(whole[: len(whole) // 2])
    path = recover(partial)
    assert path == tmp_path / "b.mcap"
    assert not partial.exists()
    rescued = read(path)
    n = rescued.measurements[0].speed.size
    assert 500 < n < 1500
    assert rescued.trajectory.time.size == n + 1
    assert rescued.trajectory.position.tobytes() == flight.trajectory.position[: n + 1].tobytes()
    assert rescued.estimates[0].covariance.tobytes() == flight.estimates[0].covariance[:n].tobytes()
    assert rescued.measurements[0].ranges.shape == (n // 10, 3)
    assert rescued.scenario == flight.scenario


def limited(folder: Path, size: int) -> subprocess.CompletedProcess[str]:
    """Write a log of 200 s in a process whose files may not grow beyond `size` bytes."""
    code = f"""
import resource, signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from synthetic import make_flight
from sim import log
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
flight = make_flight(200.0)
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
try:
    log.write(flight, Path({str(folder)!r}) / "mission.mcap")
except log.LogError as error:
    print(error)
"""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


def test_when_the_disk_is_full_what_was_written_can_be_recovered(tmp_path: Path) -> None:
    message = limited(tmp_path, 800_000).stdout
    assert "cannot be written: File too large; what was written is kept: laisn log recover" in message
    assert [p.name for p in tmp_path.iterdir()] == ["mission.mcap.partial"]
    rescued = read(recover(tmp_path / "mission.mcap.partial"))
    assert rescued.outcome is Outcome.INTERRUPTED
    assert rescued.trajectory.time[-1] > 50
    assert [p.name for p in tmp_path.iterdir()] == ["mission.mcap"]


def test_when_the_disk_is_full_at_once_nothing_stays(tmp_path: Path) -> None:
    assert "cannot be written" in limited(tmp_path, 20_000).stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_no_space_left(flight: Flight, tmp_path: Path) -> None:
    (tmp_path / "a.mcap.partial").symlink_to("/dev/full")
    with pytest.raises(LogError, match=r"a\.mcap: cannot be written: No space left on device"):
        log.write(flight, tmp_path / "a.mcap")
    assert not list(tmp_path.iterdir())


def test_folders_that_cannot_be_written(flight: Flight, written: Path, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be written: No such file or directory"):
        log.write(flight, tmp_path / "absent" / "a.mcap")
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match="cannot be written: Not a directory"):
        log.write(flight, tmp_path / "file" / "a.mcap")
    with pytest.raises(LogError, match="cannot be written"):
        export(written, tmp_path / "file" / "tables")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(flight: Flight, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(LogError, match="cannot be written: Permission denied"):
        log.write(flight, tmp_path / "a.mcap")


def test_an_interrupt_leaves_the_old_log_and_a_partial_one(tmp_path: Path) -> None:
    def frames() -> Any:
        yield 0.0, b"x"
        yield 150.0, b"x"
        signal.raise_signal(signal.SIGINT)
        time.sleep(10)

    (tmp_path / "a.mcap").write_bytes(b"older")
    with pytest.raises(KeyboardInterrupt):
        log.write(make_flight(200.0), tmp_path / "a.mcap", video=frames())
    assert (tmp_path / "a.mcap").read_bytes() == b"older"
    rescued = read(recover(tmp_path / "a.mcap.partial"))
    assert 50 < rescued.trajectory.time[-1] < 150


def test_an_epoch_that_no_log_can_hold(flight: Flight, tmp_path: Path) -> None:
    for epoch in ("1969-12-31T23:59:59+00:00", "2231-01-01T00:00:00+00:00"):
        early = dataclasses.replace(flight, scenario=flight.scenario.model_copy(update={"epoch": epoch}))
        with pytest.raises(ValueError, match="outside 1970 … 2230"):
            log.write(early, tmp_path / "a.mcap")
    assert Clock("1970-01-02T01:00:00+01:00").epoch_ns == 86_400 * 10**9
    assert Clock("2026-01-01T00:00:00.000001+00:00").ns([0.1, 0.3]).tolist() == [
        1767225600_100_001_000,
        1767225600_300_001_000,
    ]


def test_size_and_speed(tmp_path: Path) -> None:
    """1000 s at 10 Hz take less than 10 MB, and 50 000 messages a second are written."""
    flight = make_flight(1000.0)
    best = 0.0
    for _ in range(3):
        start = time.perf_counter()
        statistics = log.write(flight, tmp_path / "a.mcap", errors=errors_of(flight))
        best = max(best, statistics.messages / (time.perf_counter() - start))
    assert statistics.size < 10e6
    assert best > 50_000


def test_footer_layout() -> None:
    """The footer record of the MCAP specification: opcode, length, two offsets and a checksum."""
    from sim.log_file import DATA_END_BYTES, FOOTER_BYTES

    assert struct.calcsize("<BQQQI") == FOOTER_BYTES
    assert struct.calcsize("<BQI") == DATA_END_BYTES

"""The log: equal flights, equal bytes, and channels with the data of the flight."""

import dataclasses
import functools
import re
import time
import tracemalloc
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from laisn.estimates import FixKind
from laisn_sim.cli import replaying
from sim.flight import FlightRecord, Termination, position_and_bearing_errors
from sim.log import writer
from sim.log.contents import Contents, LogError
from sim.log.export import export
from sim.log.reader import CORE, read, read_recording
from sim.log.schema import DETAILS, ERROR, PLACED_RECEPTION, RECEPTION, Clock, RecordType
from tests.synthetic import bits, make_flight, messages, short_flight, write_log


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return short_flight()


@pytest.fixture(scope="module")
def written(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(flight, tmp_path_factory.mktemp("log"))


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
    writer.write(flight, tmp_path / "a.mcap")
    assert bits(read(tmp_path / "a.mcap")) == bits(flight)
    for i, name in enumerate(flight.trajectory.names[1:]):
        assert bits(read_recording(tmp_path / "a.mcap", name).measurements) == bits(
            flight.measurements[i]
        )


def test_channels_hold_little_beside_the_flight() -> None:
    flight = make_flight(3000.0)
    truth, estimates = flight.trajectory, flight.estimates[0]
    bytes_of_flight = (
        sum(array.nbytes for array in truth.arrays.values())
        + estimates.state.nbytes
        + estimates.covariance.nbytes
    )
    # the first call computes heading and speed, which the trajectory keeps, and imports modules
    writer.channels(flight, (), ())
    tracemalloc.start()
    try:
        channels = writer.channels(flight, (), ())
        assert tracemalloc.get_traced_memory()[0] < bytes_of_flight / 3
    finally:
        tracemalloc.stop()
    assert sum(len(channel.time_ns) for channel in channels) > 150_000


def test_odd_numbers_and_several_fixes_a_step_survive(tmp_path: Path) -> None:
    flight = make_flight(5.0)
    estimate = flight.estimates[0]
    fixes_thrice = {
        field.name: np.repeat(getattr(estimate, field.name), 3, axis=0)
        for field in dataclasses.fields(estimate)
        if field.name[:2] in ("fi", "in")
    }
    state = estimate.state.copy()
    state[0] = [-0.0, 5e-324, np.nextafter(1.0, 2.0), -np.inf]
    odd_estimate = dataclasses.replace(estimate, **fixes_thrice, state=state)
    flight = dataclasses.replace(flight, estimates=(odd_estimate,), outcome=Termination.DIVERGED)
    writer.write(flight, tmp_path / "a.mcap")
    assert bits(read(tmp_path / "a.mcap")) == bits(flight)
    assert messages(tmp_path / "a.mcap", "/log")[-1].message == Termination.DIVERGED.value


def test_the_same_flight_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        writer.write(make_flight(10.0, 2), tmp_path / name, video=[(0.0, b"x"), (3.0, b"y")])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.parametrize("type_", [*CORE, PLACED_RECEPTION, ERROR], ids=lambda t: t.name)
def test_encoded_messages_are_read_by_protobuf(type_: RecordType) -> None:
    """All messages of a type are equally long: they hold zeros, which protobuf would leave out."""
    random = np.random.default_rng(1)
    message_count = 50
    arrays = {
        group.attribute: random.integers(-9, 9, (message_count, *group.shape))
        * (1 if group.integer else 0.37)
        for group in type_.columns
    }
    encoded = type_.rows(arrays)
    assert len({len(data) for data in encoded}) == 1
    for i, data in enumerate(encoded):
        parsed = type_.message_class.FromString(data)
        for group in type_.columns:
            values = dict(
                zip(group.names, arrays[group.attribute][i].ravel().tolist(), strict=True)
            )
            assert {
                name: functools.reduce(getattr, name.split("."), parsed) for name in values
            } == values


def test_no_numbers_make_no_messages() -> None:
    """A channel may be silent for a whole block: the last message may still be on its way when
    the flight ends.
    """
    assert (
        RECEPTION.rows(
            {array.attribute: np.empty((0, *array.shape)) for array in RECEPTION.columns}
        )
        == []
    )


def test_channels_times_and_attachments(flight: FlightRecord, written: Path) -> None:
    epoch = int(datetime(2026, 1, 1, tzinfo=UTC).timestamp()) * 10**9
    counts: dict[str, int] = {}
    with written.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            with_timestamp = {
                "/tf": lambda m: m.transforms[0],
                "/tf_static": lambda m: m.transforms[0],
                "/scene/hulls": lambda m: m.entities[0],
                "/scene/vehicles": lambda m: m.entities[0],
                "/scene/acoustics": lambda m: m.entities[0],
            }.get(channel.topic, lambda m: m)(decoded)
            if schema.name.startswith("foxglove."):
                assert with_timestamp.timestamp.ToNanoseconds() == message.log_time
            assert message.log_time == message.publish_time
            assert epoch <= message.log_time <= epoch + 30 * 10**9
        attachments = {a.name: a for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert counts == {
        "/tf": 301,
        "/tf_static": 1,
        "/scene/hulls": 1,
        **dict.fromkeys(
            ("/leader/pose", "/leader/state", "/follower/pose", "/follower/state"), 301
        ),
        **dict.fromkeys(("/leader/fix", "/follower/fix", "/scene/vehicles"), 31),
        **{f"/follower/{name}": 300 for name in ("motion", "filter", "estimate", "error")},
        **dict.fromkeys(
            (
                "/follower/reception",
                "/follower/innovation",
                "/follower/estimate/fix",
                "/scene/acoustics",
            ),
            30,
        ),
        "/log": 30 + 1 + 1,
    }
    assert set(attachments) == {"scenario.toml", "vehicles.json", "summary.json", "versions.json"}
    assert all(a.log_time == a.create_time == epoch for a in attachments.values())
    assert attachments["summary.json"].data == b'{"runs": 1}'
    assert metadata["laisn"]["outcome"] == "COMPLETED"
    assert "east" in metadata["conventions"]["world"]


def test_poses_transforms_and_errors_are_the_flight(flight: FlightRecord, written: Path) -> None:
    trajectory = flight.trajectory
    pose = messages(written, "/follower/pose")[100]
    transforms = [
        *messages(written, "/tf")[100].transforms,
        *messages(written, "/tf_static")[0].transforms,
    ]
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == tuple(
        trajectory.position[100, 1]
    )
    quaternion = pose.pose.orientation
    assert (quaternion.w, quaternion.x, quaternion.y, quaternion.z) == tuple(
        trajectory.quaternion[100, 1]
    )
    transform_of = {x.child_frame_id: x for x in transforms}
    assert set(transform_of) == {"leader", "follower", *trajectory.site_names}
    front, leader = transform_of["leader/tx_front"], transform_of["leader"]
    assert (front.parent_frame_id, leader.parent_frame_id) == ("leader", "world")
    assert (front.translation.x, front.translation.y, front.translation.z) == (1.0, 0.0, 0.0)
    assert leader.rotation.w == trajectory.quaternion[100, 0, 0]
    error = messages(written, "/follower/error")[-1]
    assert (error.position_error, error.bearing_error) == tuple(
        x[-1] for x in position_and_bearing_errors(flight)[0]
    )
    state = messages(written, "/leader/state")[100]
    assert (state.pitch, state.depth, state.thrust_main) == (
        trajectory.pitch[100, 0],
        trajectory.depth[100, 0],
        trajectory.effector_states[100, 0, 0],
    )


def test_log_lines_list_kinds_events_and_outcome(flight: FlightRecord, written: Path) -> None:
    lines = messages(written, "/log")
    kinds = flight.estimates[0].fix_kind
    assert sum(line.message == "fix: rejected" for line in lines) == np.count_nonzero(
        kinds == FixKind.GATED
    )
    assert sum(line.message == "fix: lost" for line in lines) == np.count_nonzero(
        kinds == FixKind.LOST
    )
    mirror_lock = next(line for line in lines if line.message == "mirror lock")
    assert (
        mirror_lock.timestamp.ToNanoseconds() - lines[0].timestamp.ToNanoseconds(),
        mirror_lock.name,
    ) == (
        11 * 10**9,
        "follower",
    )
    assert lines[-1].message == Termination.COMPLETED.value


def test_video_lies_among_the_messages_in_order_of_time(
    flight: FlightRecord, tmp_path: Path
) -> None:
    frames = [(0.5 * k, bytes([k])) for k in range(70)]
    writer.write(flight, tmp_path / "a.mcap", video=frames)
    video = messages(tmp_path / "a.mcap", "/camera")
    assert [frame.data for frame in video] == [data for _, data in frames]
    assert video[3].format == "h264"
    assert video[3].timestamp.ToNanoseconds() - video[0].timestamp.ToNanoseconds() == 1_500_000_000
    with (tmp_path / "a.mcap").open("rb") as stream:
        times = [
            message.log_time
            for _, _, message in make_reader(stream).iter_messages(log_time_order=False)
        ]
    # the last message is the outcome of the flight; the film goes on after its time
    assert times[:-1] == sorted(times[:-1])
    with pytest.raises(ValueError, match="in order of time"):
        writer.write(flight, tmp_path / "b.mcap", video=[(2.0, b""), (1.0, b"")])
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.parametrize("table_format", ["parquet", "csv"])
def test_exported_tables_hold_the_times_and_numbers_of_channels(
    flight: FlightRecord, written: Path, tmp_path: Path, table_format: Any
) -> None:
    import pyarrow.csv
    import pyarrow.parquet

    files = {f.name: f for f in export(written, tmp_path / "tables", table_format)}
    name = f"follower_motion.{table_format}"
    assert {name, f"leader_pose.{table_format}", f"log.{table_format}"} <= set(files)
    table = (pyarrow.parquet.read_table if table_format == "parquet" else pyarrow.csv.read_csv)(
        files[name]
    )
    assert table.column_names == ["time_s", "log_time_ns", "speed", "heading", "depth"]
    # filter steps k = 1 … 300, at k Δt
    np.testing.assert_array_equal(table["time_s"].to_numpy(), np.arange(1, 301) / 10)
    assert table["speed"].to_numpy().tobytes() == flight.measurements[0].speed.tobytes()
    assert table["log_time_ns"].to_numpy()[0] == Clock(flight.scenario.epoch).epoch_ns + 10**8
    with pytest.raises(LogError, match="unknown format 'xls'; available: parquet, csv"):
        export(written, tmp_path, "xls")


def test_the_documented_channels_are_those_of_the_log(flight: FlightRecord, tmp_path: Path) -> None:
    """Topics and types of the table in docs/log.md; and those of what navigators add."""
    text = (Path(__file__).parents[3] / "docs/log.md").read_text(encoding="utf-8")
    table_rows = re.findall(r"^\| `(/\S*)` \| ((?:foxglove|laisn)\.\w+)", text, re.MULTILINE)
    writer.write(flight, tmp_path / "a.mcap", video=[(0.0, b"x")])
    documented = {
        topic.replace("NAME", name).replace("FOLLOWER", name): schema
        for topic, schema in table_rows
        for name in (["leader", "follower"] if "NAME" in topic else ["follower"])
        # without channels of other navigators, and of further links
        if topic.rpartition("/")[2] not in {type_.topic for type_ in DETAILS.values()}
        and "LINK" not in topic
    }
    # the table also has that of a leader that navigates, which this one does not
    del documented["/leader/error"]
    actual = {
        topic: messages.schema.name
        for topic, messages in Contents(tmp_path / "a.mcap").topics.items()
    }
    assert {
        topic: re.sub(r"_[0-9a-f]{8}$", "_", name) for topic, name in actual.items()
    } == documented
    assert {(f"/FOLLOWER/{type_.topic}", type_.schema.name) for type_ in DETAILS.values()} <= set(
        table_rows
    )


def test_info_prints_size_times_channels_and_outcome(
    written: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replaying.show_info(written)
    reported = " ".join(capsys.readouterr().out.split())
    size = written.stat().st_size / 1e6
    assert f"{size:.2f} MB, 30 s from 2026-01-01T00:00:00+00:00" in reported
    assert "/follower/reception laisn.Reception 30" in reported
    assert "outcome=COMPLETED, run=0, seed=1" in reported
    assert "checksum" not in reported


def test_an_epoch_that_no_log_can_hold_is_refused(flight: FlightRecord, tmp_path: Path) -> None:
    for epoch in ("1969-12-31T23:59:59+00:00", "2105-01-01T00:00:00+00:00"):
        with_epoch = dataclasses.replace(
            flight, scenario=flight.scenario.model_copy(update={"epoch": epoch})
        )
        with pytest.raises(ValueError, match="outside 1970 … 2102"):
            writer.write(with_epoch, tmp_path / "a.mcap")
    assert Clock("1970-01-02T01:00:00+01:00").epoch_ns == 86_400 * 10**9
    assert Clock("2026-01-01T00:00:00.000001+00:00").ns([0.1, 0.3]).tolist() == [
        1767225600_100_001_000,
        1767225600_300_001_000,
    ]


@pytest.mark.system
def test_a_long_log_is_small_and_quickly_written(tmp_path: Path) -> None:
    """1000 s at 10 Hz take less than 10 MB, and 50 000 messages a second of processor time are
    written.
    """
    flight = make_flight(1000.0)
    best = 0.0
    for _ in range(3):
        start = time.process_time()
        writer.write(flight, tmp_path / "a.mcap")
        seconds = time.process_time() - start
        best = max(
            best, sum(len(m.times) for m in Contents(tmp_path / "a.mcap").topics.values()) / seconds
        )
        if best > 50_000:
            break
    assert (tmp_path / "a.mcap").stat().st_size < 10e6
    assert best > 50_000

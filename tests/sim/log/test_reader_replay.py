"""Measurements from logs of vehicles that other programs wrote, and their replay."""

import csv
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from foxglove.messages import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from typer.testing import CliRunner

from laisn.arrays import Floats
from laisn.messages import LeaderMessage
from laisn_sim.cli.main import app
from sim.log.contents import LogError
from sim.log.export import export
from sim.log.reader import Pings, read, read_recording
from sim.log.schema import OWN_MOTION, PLACED_RECEPTION, RECEPTION, RecordType, message_class_of

LEADER_AT_ORIGIN = dict.fromkeys(
    (
        "leader_timestamp",
        "leader_east",
        "leader_north",
        "leader_heading",
        "leader_speed",
        "leader_depth",
    ),
    0.0,
)


def write_vehicle_log(path: Path, *, speed: float = 1.5, second_reception_s: float = 0.95) -> None:
    """Two seconds of a vehicle's log by the plain protobuf writer, at 20 Hz by a clock of its own,
    with two receptions.
    """
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        start = 1_600_000_000_123_456_789

        def write_message(topic: str, message: Any, time_s: float) -> None:
            time_ns = start + round(time_s * 1e9)
            writer.write_message(topic, message, log_time=time_ns, publish_time=time_ns)

        for k in range(40):
            write_message(
                "/auv/motion",
                OWN_MOTION.message_class(speed=speed, heading=0.0, depth=k / 10),
                0.05 * k,
            )
        for time_s in (0.512, second_reception_s):
            write_message(
                "/auv/reception",
                RECEPTION.message_class(
                    **{**LEADER_AT_ORIGIN, "leader_east": 3.0},
                    range_rear=40.0,
                    range_front=float("nan"),
                ),
                time_s,
            )


def test_measurements_of_a_real_vehicle(tmp_path: Path) -> None:
    write_vehicle_log(tmp_path / "auv.mcap")
    measured = read_recording(tmp_path / "auv.mcap", "auv").measurements
    assert measured.dt == 0.05
    assert measured.speed.tolist() == [1.5] * 40
    assert measured.depth.tolist() == [k / 10 for k in range(40)]
    # 0.512 s lies after step 11 (0.50 s) and before step 12 (0.55 s); 0.95 s is step 20
    assert measured.message_step.tolist() == [12, 20]
    assert measured.ranges[0, 0] == 40.0
    assert np.isnan(measured.ranges[0, 1])
    with pytest.raises(LogError, match=r"lacks attachment scenario\.toml"):
        read(tmp_path / "auv.mcap")
    with pytest.raises(
        LogError, match="lacks channel /follower/motion; available: /auv/motion, /auv/reception"
    ):
        read_recording(tmp_path / "auv.mcap")


TimedFields = tuple[float, dict[str, float]]


def write_messages(
    path: Path,
    motion: list[TimedFields],
    receptions: list[TimedFields],
    schema: RecordType = RECEPTION,
) -> Path:
    """A vehicle's log with these messages at these times [s]."""
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        for topic, message_class, timed_fields in (
            ("/auv/motion", OWN_MOTION.message_class, motion),
            ("/auv/reception", schema.message_class, receptions),
        ):
            for time_s, fields in timed_fields:
                time_ns = 1_700_000_000_000_000_000 + round(time_s * 1e9)
                writer.write_message(
                    topic, message_class(**fields), log_time=time_ns, publish_time=time_ns
                )
    return path


def motion_at(times: Any) -> list[TimedFields]:
    """Own motion north at 1 m/s at these times [s]."""
    return [(float(time_s), {"speed": 1.0, "heading": 0.0, "depth": 5.0}) for time_s in times]


def reception_at(time_s: float) -> TimedFields:
    """Two ranges, from a leader at the origin whose clock is the vehicle's."""
    return time_s, {
        **LEADER_AT_ORIGIN,
        "leader_timestamp": time_s,
        "range_rear": 40.0,
        "range_front": 41.0,
        "range_middle": np.nan,
    }


def test_jitter_and_late_samples_are_taken_as_they_are(tmp_path: Path) -> None:
    """A timer that loses 0.2 ms a step drifts off any grid within 69 s; one sample of ten
    minutes is 60 ms late.
    """
    random = np.random.default_rng(4)
    times = 0.1002 * np.arange(6000) + random.uniform(-0.01, 0.01, 6000)
    times[3000] += 0.06
    path = write_messages(
        tmp_path / "a.mcap", motion_at(times), [reception_at(50.0), reception_at(500.0)]
    )
    measured, remarks, _ = read_recording(path, "auv")
    assert remarks == ()
    assert measured.dt == pytest.approx(np.median(np.diff(times)), abs=1e-9)
    assert measured.durations is not None
    np.testing.assert_allclose(measured.durations[1:], np.diff(times), atol=2e-9)
    assert measured.durations[0] == measured.dt
    assert measured.message_step.tolist() == [
        int(np.argmax(times >= 50.0)) + 1,
        int(np.argmax(times >= 500.0)) + 1,
    ]


def test_gaps_are_named_and_bridged_up_to_a_bound(tmp_path: Path) -> None:
    times = 0.1 * np.arange(400)
    times[100:] += 3.0
    times[300:] += 12.0
    path = write_messages(tmp_path / "a.mcap", motion_at(times), [reception_at(1.0)])
    with pytest.raises(LogError) as caught:
        read_recording(path, "auv")
    assert (
        f"{path}: /auv/motion has 2 gaps (12.1 s at 32.900 s, 3.1 s at 9.900 s); gaps of up to 10 "
        "s are bridged" in str(caught.value)
    )
    assert "--longest-gap SECONDS" in str(caught.value)
    measured, remarks, _ = read_recording(path, "auv", longest_gap_s=15.0)
    assert remarks == ("2 gaps in /auv/motion bridged: 12.1 s at 32.900 s, 3.1 s at 9.900 s",)
    assert measured.durations is not None
    assert measured.durations[[100, 300]].tolist() == pytest.approx([3.1, 12.1])
    assert measured.time[-1] == pytest.approx(times[-1] + 0.1)
    # slow sensors have no gaps
    assert (
        read_recording(
            write_messages(tmp_path / "b.mcap", motion_at([0, 30, 60.1]), [reception_at(40.0)]),
            "auv",
        ).remarks
        == ()
    )


def test_unusable_records_are_dropped_and_reported(tmp_path: Path) -> None:
    motion = motion_at(0.1 * np.arange(100))
    motion[10] = (motion[10][0], {"speed": np.nan, "heading": 0.0, "depth": 5.0})
    motion[20] = (motion[19][0], {"speed": 2.0, "heading": 0.0, "depth": 5.0})
    receptions = [reception_at(time_s) for time_s in (-5.0, 2.0, 4.01, 4.02, 6.0, 7.0, 11.0)]
    receptions[4][1]["leader_east"] = np.inf
    receptions[5][1].update(range_rear=-1.0, range_front=np.inf)
    receptions[5][1].pop("range_middle")
    measured, remarks, _ = read_recording(
        write_messages(tmp_path / "a.mcap", motion, receptions), "auv"
    )
    assert remarks == (
        "1 message of /auv/motion left out: not finite",
        "1 message of /auv/motion left out: at the very time of another",
        "2 messages of /auv/reception left out: before the first or after the last filter step",
        "1 message of /auv/reception left out: without a finite pose of the leader",
        "1 message of /auv/reception left out: followed by another in the same filter step",
        "2 ranges of /auv/reception taken as not received: no positive number",
    )
    assert measured.speed.size == 98
    assert measured.speed[18] == 2.0
    # the leader's clock is not the log's: no message was on its way, the first step takes 0.1 s
    assert measured.message[:, 0] == pytest.approx([2.1, 4.12, 7.1])
    assert np.isnan(measured.ranges[2]).all()


def without_presence(type_: RecordType) -> Any:
    """The message class of a type whose fields do not distinguish an unset number from zero."""
    files = FileDescriptorSet.FromString(type_.schema.data)
    for file in files.file:
        file.syntax = "proto3"
    return message_class_of(SimpleNamespace(name=type_.schema.name, data=files.SerializeToString()))


@pytest.mark.parametrize("has_presence", [True, False])
def test_what_a_vehicle_does_not_record_is_absent_without_a_remark(
    tmp_path: Path, has_presence: bool
) -> None:
    """Protobuf reads an unset number as zero: no third range, and neither pitch nor roll, in 300
    receptions.
    """
    schema = (
        RECEPTION if has_presence else SimpleNamespace(message_class=without_presence(RECEPTION))
    )
    times = np.arange(1.0, 301.0)
    receptions = [
        (
            float(time_s),
            {
                **LEADER_AT_ORIGIN,
                "leader_timestamp": time_s,
                "range_rear": 40.0,
                "range_front": 41.0,
            },
        )
        for time_s in times
    ]
    log = write_messages(tmp_path / "a.mcap", motion_at(times), receptions, schema)  # type: ignore[arg-type]
    measured, remarks, _ = read_recording(log, "auv")
    assert remarks == ()
    assert measured.ranges[:, :2].tolist() == [[40.0, 41.0]] * 300
    assert np.isnan(measured.ranges[:, 2]).all()
    message = LeaderMessage(*measured.message.T)
    assert np.isnan([message.pitch, message.roll]).all()
    assert message.heading.tolist() == [0.0] * 300


def test_fewer_than_two_samples_make_no_steps(tmp_path: Path) -> None:
    for motion in ([], motion_at([1.0]), [(k, {"speed": np.nan}) for k in range(5)]):
        with pytest.raises(
            LogError, match=r"(lacks channel|holds [01] usable messages?; at least two are needed)"
        ):
            read_recording(write_messages(tmp_path / "a.mcap", motion, [reception_at(1.0)]), "auv")


BEACON_POSITIONS = {
    "rear": (0.0, 0.0, 2.0),
    "front": (400.0, 30.0, 4.0),
    "middle": (180.0, 350.0, 3.0),
}


def beacon_log(
    path: Path, *, beacons_in_log: bool, rear_range_only: bool = False
) -> tuple[Path, Floats]:
    """A vehicle that sails among beacons, on a clock that jitters; and where it was at its
    samples, shape (n, 2). The log may hold the positions of the beacons, and may lack the ranges to
    all but the rear one.
    """
    random = np.random.default_rng(8)
    times = np.sort(0.2 * np.arange(1000) + random.uniform(-0.02, 0.02, 1000))
    # it is at the start of the scenario's route a step before its first sample
    distance = times - times[0] + np.median(np.diff(times))
    positions = np.array([50.0, 20.0]) + distance[:, None] * [0.6, 0.8]
    motion = [
        (float(t), {"speed": 1.0, "heading": float(np.arctan2(0.6, 0.8)), "depth": 6.0})
        for t in times
    ]
    receptions = []
    for k in range(10, 1000, 10):
        hydrophone = np.append(positions[k], 6.0)
        fields = {
            **LEADER_AT_ORIGIN,
            **{
                f"range_{n}": float(np.linalg.norm(hydrophone - b))
                for n, b in BEACON_POSITIONS.items()
            },
        }
        if rear_range_only:
            fields |= {"range_front": np.nan, "range_middle": np.nan}
        if beacons_in_log:
            for name, beacon in BEACON_POSITIONS.items():
                fields |= dict(
                    zip((f"{name}_east", f"{name}_north", f"{name}_depth"), beacon, strict=True)
                )
        receptions.append((float(times[k]), fields))
    return write_messages(
        path, motion, receptions, PLACED_RECEPTION if beacons_in_log else RECEPTION
    ), positions


def replayed(
    folder: Path, log: Path, navigation: str, *options: str
) -> tuple[list[dict[str, str]], str]:
    (folder / "auv.toml").write_text(
        "duration_s = 200\n[leader]\nwaypoints = [[0, 0, 0], [200, 0, 200]]\n[[followers]]\nname = "
        '"auv"\n'
        "waypoints = [[0, 50, 20], [200, 170, 180]]\n[navigation]\nhydrophone_height_m = "
        f"0.0\n{navigation}\n",
        encoding="utf-8",
    )
    estimates_path = folder / "auv.csv"
    arguments = [
        "replay",
        str(log),
        "--scenario",
        str(folder / "auv.toml"),
        "--out",
        str(estimates_path),
        *options,
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return list(csv.DictReader(estimates_path.open(encoding="utf-8"))), result.output


@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-2"])
def test_beacons_hundreds_of_metres_apart_place_the_vehicle(tmp_path: Path, variant: str) -> None:
    """Without noise the position is exact, whether the log or the scenario places the beacons."""
    # the leader heads north: in its frame (forward, port, up) north is forward, and east negative
    offsets = [[north, -east, -depth] for east, north, depth in BEACON_POSITIONS.values()]
    for beacons_in_log, navigation in ((True, ""), (False, f"transmitters_m = {offsets}")):
        log, positions = beacon_log(tmp_path / "a.mcap", beacons_in_log=beacons_in_log)
        rows, output = replayed(tmp_path, log, navigation, "--variant", variant)
        actual = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
        assert np.abs(actual - positions).max() < 1e-6
        assert "lost" not in output
        assert all(header in output for header in ("Δt [s]", "x [m]", "y [m]"))
        assert float(rows[-1]["time_s"]) == pytest.approx(0.2 * 999, abs=0.1)


def test_a_range_alone_is_used_in_a_replay_unless_the_scenario_refuses(tmp_path: Path) -> None:
    log, positions = beacon_log(tmp_path / "a.mcap", beacons_in_log=True, rear_range_only=True)
    rows, output = replayed(tmp_path, log, "")
    assert "99 one range" in output
    assert float(rows[-1]["x_m"]) == pytest.approx(positions[-1, 0], abs=1e-6)
    assert "99 lost" in replayed(tmp_path, log, "use_single_range = false")[1]


def test_long_gaps_are_bridged_by_command(tmp_path: Path) -> None:
    log = write_messages(
        tmp_path / "a.mcap",
        motion_at([*np.arange(20.0), *np.arange(50.0, 70.0)]),
        [reception_at(1.0)],
    )
    rows, output = replayed(tmp_path, log, "", "--longest-gap", "40")
    assert "note: 1 gap in /auv/motion bridged: 31 s at 19.000 s" in output
    assert [float(row["time_s"]) for row in rows[19:21]] == [19.0, 50.0]


def test_a_channel_without_the_fields_is_named(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream, ProtobufWriter(stream) as writer:
        pose = message_class_of(PoseInFrame.get_schema())(frame_id="world")
        writer.write_message("/follower/motion", pose, log_time=0, publish_time=0)
    with pytest.raises(
        LogError, match="/follower/motion lacks speed, heading, depth; its fields: timestamp"
    ):
        read_recording(tmp_path / "a.mcap")
    for encoding, schema, actual in (
        ("json", "jsonschema", "'json'"),
        ("protobuf", None, "'protobuf' without a schema"),
    ):
        with (tmp_path / "b.mcap").open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            type_ = writer.register_schema("x", schema, b"{}") if schema else 0
            writer.add_message(
                writer.register_channel("/follower/motion", encoding, type_), 0, b"{}", 0
            )
            writer.finish()  # type: ignore[no-untyped-call]
        with pytest.raises(
            LogError, match=f"/follower/motion is encoded as {actual}, expected protobuf"
        ):
            read_recording(tmp_path / "b.mcap")
        with pytest.raises(
            LogError, match=r"expected protobuf channels .* available: /follower/motion"
        ):
            export(tmp_path / "b.mcap", tmp_path / "tables")


def test_a_real_vehicles_log_is_replayed_by_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dead reckoning north at 1 m/s, as the ranges are refused: 40 steps of 0.05 s are 2 m."""
    monkeypatch.chdir(tmp_path)
    write_vehicle_log(tmp_path / "auv.mcap", speed=1.0)
    (tmp_path / "auv.toml").write_text(
        "duration_s = 20\n[leader]\nwaypoints = [[0, 0, 0], [20, 0, 20]]\n[[followers]]\nname = "
        '"auv"\n'
        "waypoints = [[0, 5, -20], [20, 5, 0]]\n",
        encoding="utf-8",
    )
    estimates_path = tmp_path / "auv.csv"
    arguments = [
        "replay",
        str(tmp_path / "auv.mcap"),
        "--scenario",
        str(tmp_path / "auv.toml"),
        "--out",
        str(estimates_path),
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    # its one range, of 40 m, would move it farther than it can have come
    assert "2 rejected" in result.output
    assert "note:" not in result.output
    assert "report in out/replay/auv.html" in result.output
    assert "2σ ellipses" in Path("out/replay/auv.html").read_text(encoding="utf-8")
    rows = list(csv.DictReader(estimates_path.open(encoding="utf-8")))
    assert len(rows) == 40
    # 39 steps after the first message of the log
    assert float(rows[-1]["time_s"]) == pytest.approx(1.95)
    # started at the true speed and course, and measured so throughout
    assert float(rows[-1]["x_m"]) == pytest.approx(5.0, abs=1e-6)
    assert float(rows[-1]["y_m"]) == pytest.approx(-18.0, abs=1e-6)


@pytest.mark.parametrize(
    "further",
    [
        '[[followers]]\nname = "auv"\nguidance_position = "estimate"\nWAY',
        '[[followers]]\nname = "auv"\nWAY\n[leader.navigation]\nvariant = "beacons"\nlink = "lbl"\n'
        "[[links]]\nname = 'lbl'\nbeacons_m = [[0, 0, 5], [9, 0, 5], [0, 9, 5]]\n",
        '[[followers]]\nname = "auv"\nWAY\n[[links]]\nname = "answer"\nsender = "auv"\n'
        'answers = "leader"\nreceivers = ["leader"]\ntransmitters_m = [[0, 0, 0.1]]\n',
    ],
)
def test_keys_of_closed_loops_do_not_change_a_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, further: str
) -> None:
    """Of the scenario only names, starts and navigation count."""
    monkeypatch.chdir(tmp_path)
    write_vehicle_log(tmp_path / "auv.mcap", speed=1.0)
    way = "waypoints = [[0, 5, -20], [20, 5, 0]]\n"
    leader = "[leader]\nhydrophone_m = [0, 0, 0.1]\nwaypoints = [[0, 0, 0], [20, 0, 20]]\n"
    tables = {"plain": '[[followers]]\nname = "auv"\nWAY', "closed": further}
    for name, table in tables.items():
        sound = "[acoustics]\ntravel_time = true\n"
        text = f"duration_s = 20\n{sound}{leader}{table.replace('WAY', way)}"
        Path(f"{name}.toml").write_text(text, encoding="utf-8")
        arguments = ["replay", "auv.mcap", "--scenario", f"{name}.toml", "--out", f"{name}.csv"]
        result = CliRunner().invoke(app, [*arguments, "--variant", "ekf"])
        assert result.exit_code == 0, result.output
    assert Path("closed.csv").read_bytes() == Path("plain.csv").read_bytes()


def test_a_replay_of_a_vehicle_on_a_station_begins_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dead reckoning north at 1 m/s from 10 m behind and 5 m to port of a leader that heads north
    at the origin: 40 steps of 0.05 s are 2 m.
    """
    monkeypatch.chdir(tmp_path)
    write_vehicle_log(tmp_path / "auv.mcap", speed=1.0)
    Path("station.toml").write_text(
        "duration_s = 20\n[leader]\nwaypoints = [[0, 0, 0], [20, 0, 20]]\n[[followers]]\nname = "
        '"auv"\nstation = { behind_m = 10.0, port_m = 5.0, depth_m = 10.0 }\n',
        encoding="utf-8",
    )
    arguments = ["replay", "auv.mcap", "--scenario", "station.toml", "--out", "a.csv"]
    result = CliRunner().invoke(app, [*arguments, "--variant", "dead-reckoning"])
    assert result.exit_code == 0, result.output
    last = list(csv.DictReader(Path("a.csv").read_text("utf-8").splitlines()))[-1]
    assert float(last["x_m"]) == pytest.approx(-5.0, abs=1e-6)
    assert float(last["y_m"]) == pytest.approx(-8.0, abs=1e-6)


def test_a_navigator_that_diverges_is_an_error_of_the_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverge(*_: object) -> None:
        raise ArithmeticError("step 9: a covariance is not positive definite")

    monkeypatch.setattr("laisn.navigator.Navigator.run", diverge)
    write_vehicle_log(tmp_path / "auv.mcap")
    (tmp_path / "auv.toml").write_text(
        '[[followers]]\nname = "auv"\nroute = "T5"\n', encoding="utf-8"
    )
    arguments = ["replay", str(tmp_path / "auv.mcap"), "--scenario", str(tmp_path / "auv.toml")]
    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert (
        "auv.mcap: auv: the navigator diverged: step 9: a covariance is not positive definite"
        in result.output
    )


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        # times of the log's clock, which the leader's agrees with, count from the start on
        ([0.9, 1.8, 2.9], [0.95, 1.85, 2.95]),
        # a clock of its own: of the delays 0.1, 0.2 and 0.1 s the least counts as none
        ([500.9, 501.8, 502.9], [1.05, 1.95, 3.05]),
        # no time, or none that goes on
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([500.0, 900.0, 20.0], [500.0, 900.0, 20.0]),
    ],
)
def test_times_of_messages_count_from_the_start_by_whichever_clock(
    tmp_path: Path, stamps: list[float], expected: list[float]
) -> None:
    # times of the log begin in 2023, and the first step of 0.05 s ends where its readings begin
    epoch = 1.7e9 if stamps[0] == 0.9 else 0.0
    receptions = [reception_at(time_s) for time_s in (1.0, 2.0, 3.0)]
    for (_, fields), stamp in zip(receptions, stamps, strict=True):
        fields["leader_timestamp"] = stamp + epoch
    log = write_messages(tmp_path / "a.mcap", motion_at(0.05 * np.arange(100)), receptions)
    measured = read_recording(log, "auv").measurements
    np.testing.assert_allclose(measured.message[:, 0], expected, rtol=0.0, atol=2e-6)


def test_receptions_are_complete_when_their_last_ping_arrives(tmp_path: Path) -> None:
    """Pings leave 0.2 s apart and travel 0.1 s: a message of 1.0 s that a log has at 1.1 s is
    complete at 1.3 s, and one whose front range was lost at 1.1 s.
    """
    receptions = [reception_at(time_s) for time_s in (1.1, 3.1, 5.3)]
    for (_, fields), stamp in zip(receptions, (1.0, 3.0, 5.0), strict=True):
        fields.update(leader_timestamp=1.7e9 + stamp, range_rear=150.0, range_front=150.0)
    receptions[1][1]["range_front"] = np.nan
    log = write_messages(tmp_path / "a.mcap", motion_at(np.arange(100) / 10), receptions)
    measured, remarks, _ = read_recording(log, "auv", pings=Pings(0.2, 1500.0))
    # steps end at 0.0, 0.1 … s
    assert measured.message_step.tolist() == [14, 32, 54]
    assert not any("older than sound" in remark for remark in remarks)
    # as recorded without slots, which the lag of the last does not explain
    assert read_recording(log, "auv").measurements.message_step.tolist() == [12, 32, 54]


def test_slots_count_in_the_offset_of_another_clock(tmp_path: Path) -> None:
    """Of messages that are complete 0.2, 0.3 and 0.2 s after their first ping the least is that
    of the slots.
    """
    receptions = [reception_at(time_s) for time_s in (1.2, 3.3, 5.2)]
    for (_, fields), stamp in zip(receptions, (501.0, 503.0, 505.0), strict=True):
        fields["leader_timestamp"] = stamp
    log = write_messages(tmp_path / "a.mcap", motion_at(np.arange(100) / 10), receptions)
    measured = read_recording(log, "auv", pings=Pings(0.2, 1500.0)).measurements
    # the first step of 0.1 s begins before the first message of own motion
    np.testing.assert_allclose(measured.message[:, 0], [1.1, 3.1, 5.1], atol=2e-6)

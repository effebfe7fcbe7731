"""Measurements from the log of a real vehicle."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from typer.testing import CliRunner

from experiments.command.cli import app
from sim.log.file import LogError
from sim.log.reader import read, read_measurements
from sim.log.schema import OWN_MOTION, RECEPTION


def write_foreign(path: Path, *, gap: bool = False, speed: float = 1.5, second_reception_s: float = 0.95) -> None:
    """A vehicle's log by the plain protobuf writer, with its own clock and 20 Hz."""
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        start = 1_600_000_000_123_456_789

        def put(topic: str, message: Any, at: float) -> None:
            ns = start + round(at * 1e9)
            writer.write_message(topic, message, log_time=ns, publish_time=ns)

        for k in range(40):
            late = 1.0 if gap and k > 20 else 0.0
            put("/auv/motion", OWN_MOTION.message_class(speed=speed, heading=0.0, depth=k / 10), 0.05 * k + late)
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
    with pytest.raises(LogError, match=r"lacks attachment scenario\.toml"):
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
        json_writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(LogError, match="encoded as 'json', expected protobuf"):
        read_measurements(tmp_path / "b.mcap")


def test_a_real_vehicles_log_is_replayed_by_command(tmp_path: Path) -> None:
    """Dead reckoning north at 1 m/s, as messages without a second range give no fix: 40 steps of 0.05 s are 2 m."""
    write_foreign(tmp_path / "auv.mcap", speed=1.0)
    (tmp_path / "auv.toml").write_text(
        'duration_s = 20\n[leader]\nwaypoints = [[0, 0, 0], [20, 0, 20]]\n[[followers]]\nname = "auv"\n'
        "waypoints = [[0, 5, -20], [20, 5, 0]]\n",
        encoding="utf-8",
    )
    out = tmp_path / "auv.csv"
    words = ["replay", str(tmp_path / "auv.mcap"), "--scenario", str(tmp_path / "auv.toml"), "--out", str(out)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "2 lost" in result.output
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    assert len(rows) == 40
    assert float(rows[-1]["time_s"]) == pytest.approx(2.0)
    # started at the true speed and course, and measured so throughout
    assert float(rows[-1]["x_m"]) == pytest.approx(5.0, abs=1e-6)
    assert float(rows[-1]["y_m"]) == pytest.approx(-18.0, abs=1e-6)

"""Other people's readers open the log: Rerun, and the TypeScript library that Foxglove uses."""

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from sim.flight import FlightRecord, VehicleRecord
from sim.log import writer
from sim.log.contents import Contents, LogError
from sim.log.export import write_recording
from tests.synthetic import make_flight

RERUN = shutil.which(
    "rerun", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
)
NODE = shutil.which("node")
NODE_PACKAGES = ("@mcap/core", "fzstd", "protobufjs")

READ_WITH_TYPESCRIPT = """
const { McapIndexedReader } = require("@mcap/core");
const { decompress } = require("fzstd");
const protobuf = require("protobufjs");
const { FileDescriptorSet } = require("protobufjs/ext/descriptor");
const fs = require("fs/promises");
(async () => {
  const file = await fs.open(process.argv[1], "r");
  const readable = {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const buffer = new Uint8Array(Number(length));
      await file.read(buffer, 0, Number(length), Number(offset));
      return buffer;
    },
  };
  const decompressHandlers = { zstd: (data) => decompress(data) };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const types = new Map();
  for (const [id, schema] of reader.schemasById) {
    const root = protobuf.Root.fromDescriptor(FileDescriptorSet.decode(schema.data));
    types.set(id, root.lookupType(schema.name));
  }
  const counts = {}, last = {};
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const { topic, schemaId } = reader.channelsById.get(message.channelId);
    const type = types.get(schemaId);
    counts[topic] = (counts[topic] ?? 0) + 1;
    last[topic] = type.toObject(type.decode(message.data), { longs: Number });
  }
  const motion = last["/follower/motion"];
  console.log(JSON.stringify({ counts, motion, pose: last["/leader/pose"] }));
})();
"""


def film(frames: int) -> Iterator[tuple[float, bytes]]:
    """H.264 access units of a grey that brightens, one a second, as the log requires."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 160, 120, "yuv420p"
    encoder.framerate = Fraction(30)
    encoder.options = {
        "preset": "veryfast",
        "tune": "zerolatency",
        "bf": "0",
        "g": "5",
        "x264-params": "repeat-headers=1:annexb=1",
    }
    for k in range(frames):
        picture = av.VideoFrame.from_ndarray(
            np.full((120, 160, 3), 10 * k, dtype=np.uint8), format="rgb24"
        )
        for packet in encoder.encode(picture.reformat(format="yuv420p")):
            yield float(k), bytes(packet)


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(20.0)


@pytest.fixture(scope="module")
def written(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("interop") / "mission.mcap"
    writer.write(flight, path, video=list(film(20)))
    return path


def rerun(*arguments: str | Path) -> str:
    """Output of the command; fails the test where the command fails."""
    child = subprocess.run([str(RERUN), *map(str, arguments)], capture_output=True, text=True)
    assert child.returncode == 0, child.stdout + child.stderr
    return child.stdout + child.stderr


@pytest.mark.skipif(
    RERUN is None, reason="the rerun command is not installed (pip install rerun-sdk)"
)
def test_rerun_accepts_structure_and_times(written: Path) -> None:
    report = rerun("mcap", "check", written)
    verdicts = [
        line.split()
        for line in report.splitlines()
        if line.strip().startswith(("ok", "warn", "error"))
    ]
    assert {verdict[3] for verdict in verdicts} == set(Contents(written).topics)
    assert {verdict[0] for verdict in verdicts} == {"ok"}


@pytest.mark.skipif(
    RERUN is None, reason="the rerun command is not installed (pip install rerun-sdk)"
)
def test_rerun_draws_transforms_poses_positions_lines_and_film(
    written: Path, tmp_path: Path
) -> None:
    recording = tmp_path / "mission.rrd"
    rerun("mcap", "convert", written, "-o", recording)
    rerun("rrd", "verify", recording)
    columns = rerun("rrd", "print", "-v", recording)
    for column in (
        "/tf@Transform3D:translation",
        "/leader/pose@InstancePoses3D:translations",
        "/follower/estimate@InstancePoses3D:quaternions",
        "/follower/fix@GeoPoints:positions",
        "/log@TextLog:text",
        "/camera@VideoStream:sample",
        "/follower/motion@laisn.OwnMotion:message",
    ):
        assert column in columns


def test_a_recording_without_reruns_package_reports_what_to_install(
    written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(LogError, match="pip install rerun-sdk"):
        write_recording(written, tmp_path / "mission.rrd")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(
    RERUN is None, reason="the rerun command is not installed (pip install rerun-sdk)"
)
def test_a_flight_that_ends_before_its_first_message_has_a_recording(tmp_path: Path) -> None:
    writer.write(make_flight(0.9), tmp_path / "short.mcap")
    columns = rerun(
        "rrd", "print", "-v", write_recording(tmp_path / "short.mcap", tmp_path / "short.rrd")
    )
    assert "/world/leader/hull/mesh0@Mesh3D:vertex_positions" in columns
    assert "/ping/" not in columns


@pytest.mark.skipif(
    RERUN is None, reason="the rerun command is not installed (pip install rerun-sdk)"
)
def test_a_recording_holds_hulls_trails_rays_and_estimates_in_their_places(
    flight: FlightRecord, written: Path, tmp_path: Path
) -> None:
    """Read back by Rerun itself."""
    path = write_recording(written, tmp_path / "mission.rrd")
    rerun("rrd", "verify", path)
    columns = rerun("rrd", "print", "-v", path)
    for column in (
        "/world/leader@Transform3D:translation",
        "/world/leader/hull/mesh0@Mesh3D:vertex_positions",
        "/world/follower/hull/cylinders@Cylinders3D:lengths",
        "/world/scene/leader/trail/lines@LineStrips3D:strips",
        "/world/scene/follower/estimate/lines@LineStrips3D:strips",
        "/world/scene/follower/ping/lines@LineStrips3D:strips",
        "/world/scene/follower/estimate/spheres@Ellipsoids3D:half_sizes",
        "/errors/follower/E_P@Scalars:scalars",
    ):
        assert column in columns
    assert [p.name for p in tmp_path.iterdir()] == ["mission.rrd"]

    def numbers_at(entity: str, seconds: float) -> npt.NDArray[np.float64]:
        """The numbers that Rerun prints of an instant; of long lists the first."""
        text = rerun("rrd", "print", "-vvv", "--entity", entity, path)
        (line,) = re.findall(rf"┆ PT{seconds:g}S +┆(.*)", text)
        return np.array(
            [float(word) for word in re.findall(r"-?\d+\.\d+(?:e-?\d+)?(?=[,\]])", line)]
        )

    trajectory, step = flight.trajectory, 100
    sites = [
        trajectory.site_position[step, trajectory.site(s)]
        for s in ("leader/tx_rear", "follower/hydrophone", "leader/tx_front")
    ]
    np.testing.assert_allclose(
        numbers_at("/world/scene/follower/ping/lines", 10)[1:9], np.ravel(sites)[:8], rtol=1e-5
    )
    quaternion = trajectory.quaternion[step, 0, [1, 2, 3, 0]]
    np.testing.assert_allclose(
        numbers_at("/world/leader", 10),
        [*quaternion, *trajectory.position[step, 0]],
        rtol=1e-5,
        atol=1e-6,
    )
    np.testing.assert_allclose(
        numbers_at("/world/scene/leader/trail/lines", 10)[4:7],
        trajectory.position[10, 0],
        rtol=1e-5,
        atol=1e-6,
    )
    position_error = flight.estimates[0].state[99, :2] - flight.hydrophone(0)[99, :2]
    np.testing.assert_allclose(
        numbers_at("/errors/follower/E_P", 10), np.hypot(*position_error), rtol=1e-9
    )
    estimate = flight.estimates[0]
    ellipse = numbers_at("/world/scene/follower/estimate/spheres", 10)
    np.testing.assert_allclose(ellipse[:2], estimate.state[99, :2], rtol=1e-5)
    # 95 % of a normal distribution lie within half axes of √5.991 σ (χ² of two degrees of freedom);
    # turned about the vertical by 2 arctan(z/w), of the quaternion
    half_axes, half_turn = ellipse[3:5], np.arctan2(ellipse[8], ellipse[9])
    axis = np.array([np.cos(2 * half_turn), np.sin(2 * half_turn)])
    across = np.array([-axis[1], axis[0]])
    drawn = (
        half_axes[0] ** 2 * np.outer(axis, axis) + half_axes[1] ** 2 * np.outer(across, across)
    ) / 5.991464547
    np.testing.assert_allclose(drawn, estimate.covariance[99, :2, :2], rtol=1e-4)


def node(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(NODE), "-e", script, *arguments], capture_output=True, text=True)


def test_typescript_reads_the_same_numbers(flight: FlightRecord, written: Path) -> None:
    """Needs node, and the packages in a folder that NODE_PATH names."""
    if NODE is None:
        pytest.skip("node is not installed")
    missing_packages = [
        name for name in NODE_PACKAGES if node(f"require.resolve('{name}')").returncode
    ]
    if missing_packages:
        pytest.skip(f"node lacks {', '.join(missing_packages)}; npm install them and set NODE_PATH")
    child = node(READ_WITH_TYPESCRIPT, str(written))
    assert child.returncode == 0, child.stderr
    actual: dict[str, Any] = json.loads(child.stdout)
    assert actual["counts"] == {
        topic: len(messages.times) for topic, messages in Contents(written).topics.items()
    }
    measured, trajectory = flight.measurements[0], flight.trajectory
    assert (actual["motion"]["speed"], actual["motion"]["heading"]) == (
        measured.speed[-1],
        measured.heading[-1],
    )
    assert tuple(actual["pose"]["pose"]["position"][axis] for axis in "xyz") == tuple(
        trajectory.position[-1, 0]
    )


def test_the_film_decodes_from_the_log(written: Path) -> None:
    """Every frame comes back, the first of them a key frame with its parameter sets."""
    (units,) = Contents(written).topics["/camera"].columns(["data"])
    decoder = av.CodecContext.create("h264", "r")
    pictures = [
        picture for unit in units for picture in decoder.decode(av.Packet(unit))
    ] + decoder.decode(None)
    assert len(pictures) == len(units) == 20
    levels = [float(picture.to_ndarray(format="gray").mean()) for picture in pictures]
    assert all(after > before for before, after in itertools.pairwise(levels))


@pytest.mark.skipif(
    RERUN is None, reason="the rerun command is not installed (pip install rerun-sdk)"
)
def test_a_recording_has_the_errors_of_a_leader_that_navigates(
    flight: FlightRecord, tmp_path: Path
) -> None:
    """They are of its position alone: its log has no bearing to itself."""
    record = VehicleRecord(measurements=flight.measurements[0], estimates=flight.estimates[0])
    writer.write(replace(flight, leader=record), tmp_path / "leader.mcap")
    command = ["log", "export", str(tmp_path / "leader.mcap"), str(tmp_path / "out"), "--rerun"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    columns = rerun("rrd", "print", "-v", tmp_path / "out" / "leader.rrd")
    for name in ("leader", "follower"):
        assert f"/errors/{name}/E_P@Scalars:scalars" in columns

"""Flights as glTF, as an independent reader reads them; surfaces of hulls against closed forms."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn.arrays import Floats
from laisn_sim.cli.main import app
from reports.gltf import write_gltf
from reports.scene import shapes
from reports.scene.shapes import Triangles
from sim import attitude
from sim.flight import FlightRecord, VehicleRecord
from sim.log import writer
from tests.synthetic import make_flight

pygltflib = pytest.importorskip("pygltflib")

TYPES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def volume(shape: Triangles) -> float:
    """Of what a surface encloses, positive if its corners run counter-clockwise from outside."""
    a, b, c = np.moveaxis(shape.points[shape.corners], 1, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (shapes.ellipsoid(np.array([0.5, 0.2, 0.3])), 4 / 3 * np.pi * 0.5 * 0.2 * 0.3),
        (shapes.cylinder(0.2, 0.7), np.pi * 0.2**2 * 1.4),
        (shapes.capsule(0.2, 0.7), np.pi * 0.2**2 * (1.4 + 4 / 3 * 0.2)),
        (shapes.diamond(0.3), 4 / 3 * 0.3**3),
        (
            shapes.triangles_of(
                {"kind": "box", "size": [0.1, 0.2, 0.3], "turn": [0.6, 0.8, 0, 0], "at": [1, 2, 3]}
            ),
            0.2 * 0.4 * 0.6,
        ),
    ],
)
def test_surfaces_enclose_their_volume_and_normals_point_out(
    shape: Triangles, expected: float
) -> None:
    # of inscribed circles and spheres up to 4 % are missing
    assert 0.95 * expected < volume(shape) <= expected * (1 + 1e-9)
    np.testing.assert_allclose(np.linalg.norm(shape.normals, axis=1), 1.0, atol=1e-9)
    outward = shape.points - shape.points.mean(axis=0)
    assert np.einsum("ni,ni->n", outward, shape.normals).min() > 0


class Exported:
    """A file as pygltflib reads it."""

    def __init__(self, path: Path) -> None:
        self.file = pygltflib.GLTF2().load(str(path))
        self.names = [node.name for node in self.file.nodes]

    def values(self, accessor: int) -> Floats:
        entry = self.file.accessors[accessor]
        view = self.file.bufferViews[entry.bufferView]
        columns = TYPES[entry.type]
        dtype = np.float32 if entry.componentType == pygltflib.FLOAT else np.uint32
        blob = self.file.binary_blob()
        first = view.byteOffset + (entry.byteOffset or 0)
        table = np.frombuffer(blob, dtype, entry.count * columns, first)
        table = table.reshape(entry.count, columns)
        np.testing.assert_allclose(table.min(axis=0), entry.min)
        np.testing.assert_allclose(table.max(axis=0), entry.max)
        return table.astype(np.float64)

    def motion(self, name: str, path: str) -> tuple[Floats, Floats]:
        """Key times and values of a node's translation or rotation."""
        node = self.names.index(name)
        (animation,) = self.file.animations
        (channel,) = (
            channel
            for channel in animation.channels
            if (channel.target.node, channel.target.path) == (node, path)
        )
        sampler = animation.samplers[channel.sampler]
        assert sampler.interpolation == "LINEAR"
        return self.values(sampler.input)[:, 0], self.values(sampler.output)

    def mesh(self, name: str) -> list[Any]:
        return list(self.file.meshes[self.file.nodes[self.names.index(name)].mesh].primitives)


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(30.0)


@pytest.fixture(scope="module")
def exported(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    folder = tmp_path_factory.mktemp("gltf")
    log = folder / "a.mcap"
    writer.write(flight, log)
    result = CliRunner().invoke(app, ["log", "export", str(log), str(folder / "o"), "--gltf"])
    assert result.exit_code == 0, result.output
    return Exported(folder / "o" / "a.glb")


@pytest.mark.parametrize("vehicle", [0, 1])
def test_hulls_move_as_the_vehicles_do(
    flight: FlightRecord, exported: Exported, vehicle: int
) -> None:
    truth = flight.trajectory
    time, position_in_file = exported.motion(truth.names[vehicle], "translation")
    position, quaternion = truth.at(time.clip(0, truth.time[-1]))
    np.testing.assert_allclose(position_in_file, position[:, vehicle], atol=1e-4)
    same_time, quaternion_in_file = exported.motion(truth.names[vehicle], "rotation")
    np.testing.assert_array_equal(same_time, time)
    assert time[-1] == pytest.approx(truth.time[-1], abs=0.2)
    axes = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    for axis in axes:
        # glTF writes w last
        rotated = attitude.rotate(np.roll(quaternion_in_file, 1, axis=1), axis)
        np.testing.assert_allclose(
            rotated, attitude.rotate(quaternion[:, vehicle], axis), atol=1e-5
        )


def test_the_sea_stands_upright(exported: Exported) -> None:
    """The parent of all turns up (z) into glTF's up (y), and east stays east."""
    (scene,) = exported.file.scenes
    (root,) = scene.nodes
    sea = exported.file.nodes[root]
    x, y, z, w = sea.rotation
    up, east = (
        attitude.rotate(np.array([w, x, y, z]), np.array(v)) for v in ([0, 0, 1.0], [1.0, 0, 0])
    )
    np.testing.assert_allclose(up, [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(east, [1, 0, 0], atol=1e-9)
    assert {"leader", "follower", "follower estimate"} <= {exported.names[n] for n in sea.children}


def test_the_estimate_and_its_path_are_the_navigators(
    flight: FlightRecord, exported: Exported
) -> None:
    time, position_in_file = exported.motion("follower estimate", "translation")
    steps = flight.trajectory.time[flight.step_index()]
    state = flight.estimates[0].state
    for axis in range(2):
        expected = np.interp(time, steps, state[:, axis])
        np.testing.assert_allclose(position_in_file[1:, axis], expected[1:], atol=1e-3)
    (line,) = exported.mesh("follower estimated path")
    assert line.mode == pygltflib.LINE_STRIP
    np.testing.assert_array_equal(exported.values(line.attributes.POSITION), position_in_file)


def test_a_leader_that_navigates_has_its_estimate_and_path(
    flight: FlightRecord, tmp_path: Path
) -> None:
    record = VehicleRecord(measurements=flight.measurements[0], estimates=flight.estimates[0])
    write_gltf(replace(flight, leader=record), tmp_path / "leader.glb")
    exported = Exported(tmp_path / "leader.glb")
    _, of_leader = exported.motion("leader estimate", "translation")
    _, of_follower = exported.motion("follower estimate", "translation")
    np.testing.assert_array_equal(of_leader[:, :2], of_follower[:, :2])
    _, hull_position = exported.motion("leader", "translation")
    np.testing.assert_array_equal(of_leader[:, 2], hull_position[:, 2])
    (line,) = exported.mesh("leader estimated path")
    np.testing.assert_array_equal(exported.values(line.attributes.POSITION), of_leader)


def test_a_vehicle_that_never_had_an_estimate_has_none(
    flight: FlightRecord, tmp_path: Path
) -> None:
    unknown = replace(flight.estimates[0], state=np.full_like(flight.estimates[0].state, np.nan))
    write_gltf(replace(flight, estimates=(unknown,)), tmp_path / "a.glb")
    names = Exported(tmp_path / "a.glb").names
    assert "follower path" in names
    assert not [name for name in names if name and "estimate" in name]


def test_a_hull_is_as_large_as_its_model(exported: Exported) -> None:
    points = [exported.values(part.attributes.POSITION) for part in exported.mesh("leader")]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    assert 1.5 < high[0] - low[0] < 2.5  # the leader of 2 m
    for part in exported.mesh("leader"):
        corners = exported.values(part.indices)
        count = exported.file.accessors[part.attributes.POSITION].count
        assert corners.max() < count
        assert len(corners) % 3 == 0

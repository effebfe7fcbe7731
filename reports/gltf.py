"""A flight as a glTF 2.0 file (.glb), which Blender and other programs of 3D graphics open.

Hulls with moving fins follow their true paths, diamonds are the estimates, and lines the paths of
both. Axes of the world are east, north, up within the node `sea`, which is turned so that glTF's y
axis is up. Format: Khronos Group, glTF 2.0 Specification.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.estimates import Estimates
from reports.scene.hulls import hull
from reports.scene.mission import held, rate_of, smooth_quaternions
from reports.scene.shapes import Triangles, diamond, triangles_of
from reports.version import versions
from sim.film.film_data import ESTIMATE, LEADER, TRUTH
from sim.flight import FlightRecord
from sim.log.tum import estimates_of
from sim.scenario.parts import MissionPlan
from sim.system import atomic_write

_FLOAT, _UNSIGNED = 5126, 5125  # component types
_TYPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4"}
_LINE_STRIP = 3
_DIAMOND_M = 0.12
_Z_UP_TO_Y_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # turns z up into y up: (x, y, z, w)
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942


class _File:
    """A glTF file under construction."""

    def __init__(self) -> None:
        self.tables: dict[str, list[dict[str, Any]]] = {}
        self._bytes = bytearray()
        self._materials: dict[tuple[Any, ...], int] = {}

    def add(self, table: str, **entry: Any) -> int:
        """Add an entry to a table; its index."""
        entries = self.tables.setdefault(table, [])
        entries.append(entry)
        return len(entries) - 1

    def accessor(self, values: npt.NDArray[Any]) -> int:
        """Store an array of shape (n,), (n, 3) or (n, 4), of floats or indices; the index of its
        accessor.
        """
        kind, component = (
            (np.uint32, _UNSIGNED) if values.dtype.kind in "iu" else (np.float32, _FLOAT)
        )
        data = np.ascontiguousarray(values, kind)
        view = self.add(
            "bufferViews", buffer=0, byteOffset=len(self._bytes), byteLength=data.nbytes
        )
        self._bytes += data.tobytes()
        return self.add(
            "accessors",
            bufferView=view,
            componentType=component,
            count=len(data),
            type=_TYPES[data.shape[1:]],
            min=np.atleast_1d(data.min(axis=0)).tolist(),
            max=np.atleast_1d(data.max(axis=0)).tolist(),
        )

    def material(self, colour: tuple[float, ...], shine: float) -> int:
        """The index of a material of a colour, 0 … 1, which glTF takes as linear light; shine
        0 … 1.
        """
        key = (*colour, shine)
        if key not in self._materials:
            linear = [float(np.clip(c, 0.0, 1.0)) ** 2.2 for c in colour[:3]]
            surface = {
                "baseColorFactor": [*linear, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": round(1.0 - 0.8 * shine, 3),
            }
            self._materials[key] = self.add("materials", pbrMetallicRoughness=surface)
        return self._materials[key]

    def surface(self, shape: Triangles, material: int) -> dict[str, Any]:
        """A primitive of triangles."""
        return {
            "attributes": {
                "POSITION": self.accessor(shape.points),
                "NORMAL": self.accessor(shape.normals),
            },
            "indices": self.accessor(shape.corners.ravel()),
            "material": material,
        }

    def to_bytes(self) -> bytes:
        """The file: a header, the JSON and the arrays, each padded to four bytes."""
        arrays = bytes(self._bytes) + b"\0" * (-len(self._bytes) % 4)
        content = {
            "asset": {"version": "2.0", "generator": f"LAISN-Sim {versions()['laisn-sim']}"},
            "scene": 0,
            "buffers": [{"byteLength": len(arrays)}],
            **self.tables,
        }
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + len(arrays)
        return (
            struct.pack("<III", _MAGIC, 2, length)
            + struct.pack("<II", len(text), _JSON)
            + text
            + struct.pack("<II", len(arrays), _BIN)
            + arrays
        )


class _Writer:
    """Puts the vehicles of a flight into a file."""

    def __init__(self, flight: FlightRecord) -> None:
        truth = flight.trajectory
        duration = float(truth.time[-1] - truth.time[0])
        stride = max(1, round(1.0 / (rate_of(duration, len(truth.names)) * truth.dt)))
        self.flight = flight
        self.rows = np.arange(0, truth.time.size, stride)  # instants of the animation's frames
        self.file = _File()
        self.time = self.file.accessor(truth.time[self.rows] - truth.time[0])
        self.samplers: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []

    def animate(self, node: int, path: str, values: Floats) -> None:
        """Move a node: `path` is translation, or rotation by quaternions (w, x, y, z)."""
        output = np.roll(values, -1, axis=1) if path == "rotation" else values
        sampler = {"input": self.time, "output": self.file.accessor(output)}
        self.samplers.append(sampler | {"interpolation": "LINEAR"})
        target = {"node": node, "path": path}
        self.channels.append({"sampler": len(self.samplers) - 1, "target": target})

    def path(self, name: str, points: Floats, colour: tuple[float, ...]) -> int:
        """A line through points, shape (n, 3), [m]; the index of its node."""
        file = self.file
        line = {
            "attributes": {"POSITION": file.accessor(points)},
            "mode": _LINE_STRIP,
            "material": file.material(colour, 0.0),
        }
        return file.add("nodes", name=name, mesh=file.add("meshes", primitives=[line]))

    def vehicle(self, number: int, shape: dict[str, Any]) -> int:
        """A hull that moves, with its fins; number 0 is the leader, `shape` as of
        `reports.scene.hulls.hull`.
        """
        file = self.file
        truth = self.flight.trajectory
        role_colour = TRUTH if number else LEADER
        moving = {fin["part"]: fin for fin in shape["fins"]}

        def material(geom: dict[str, Any]) -> int:
            if geom["name"].startswith("band"):
                return file.material(role_colour, 0.3)
            return file.material(tuple(geom["rgb"]), geom["shine"])

        fixed = [geom for geom in shape["parts"] if geom["name"] not in moving]
        hull_mesh = file.add(
            "meshes",
            primitives=[file.surface(triangles_of(geom), material(geom)) for geom in fixed],
        )
        fins = []
        for geom in shape["parts"]:
            fin = moving.get(geom["name"])
            if fin is None:
                continue
            surface = file.surface(triangles_of(geom, at_origin=True), material(geom))
            node = file.add(
                "nodes",
                name=f"{truth.names[number]} {geom['name']}",
                mesh=file.add("meshes", primitives=[surface]),
                translation=geom["at"],
            )
            if truth.effector_states.shape[2]:
                # of a fin its deflection [rad]
                angle = truth.effector_states[self.rows, number, fin["effector"]]
                half_angle = 0.5 * angle[:, None]
                axis = np.array(fin["axis"]) / np.linalg.norm(fin["axis"])
                self.animate(
                    node, "rotation", np.hstack([np.cos(half_angle), np.sin(half_angle) * axis])
                )
            fins.append(node)
        children = {"children": fins} if fins else {}
        node = file.add("nodes", name=truth.names[number], mesh=hull_mesh, **children)
        self.animate(node, "translation", truth.position[self.rows, number])
        quaternion = smooth_quaternions(truth.quaternion[self.rows])[:, number]
        self.animate(node, "rotation", quaternion)
        return node

    def estimate(self, vehicle: int, estimates: Estimates) -> tuple[int, Floats]:
        """A diamond at the estimate of a vehicle, 0 for the leader, at its true depth; and its
        path.
        """
        file = self.file
        flight = self.flight
        name = f"{flight.trajectory.names[vehicle]} estimate"
        surface = file.surface(diamond(_DIAMOND_M), file.material(ESTIMATE, 0.2))
        node = file.add("nodes", name=name, mesh=file.add("meshes", primitives=[surface]))
        steps = np.clip(self.rows // flight.stride - 1, 0, None)
        state = held(estimates.state[:, :2])[steps]
        up = flight.trajectory.position[self.rows, vehicle, 2:]
        points = np.hstack([state, up])
        self.animate(node, "translation", points)
        return node, points


def write_gltf(flight: FlightRecord, path: Path) -> None:
    """Write a flight as a file that ends in .glb; OSError if that fails."""
    writer = _Writer(flight)
    file = writer.file
    truth = flight.trajectory
    shapes = {name: hull(name) for name in dict.fromkeys(MissionPlan.of(flight.scenario).models)}
    nodes = []
    for number, model in enumerate(MissionPlan.of(flight.scenario).models):
        nodes.append(writer.vehicle(number, shapes[model]))
        colour = TRUTH if number else LEADER
        name = f"{truth.names[number]} path"
        nodes.append(writer.path(name, truth.position[writer.rows, number], colour))
    for vehicle, vehicle_name in enumerate(truth.names):
        estimates = estimates_of(flight, vehicle)
        if estimates is None or not np.isfinite(estimates.state[:, :2]).all(axis=1).any():
            continue
        node, points = writer.estimate(vehicle, estimates)
        nodes += [node, writer.path(f"{vehicle_name} estimated path", points, ESTIMATE)]
    sea = file.add("nodes", name="sea", rotation=_Z_UP_TO_Y_UP, children=nodes)
    file.add("scenes", name=flight.scenario.name, nodes=[sea])
    file.add("animations", name="mission", samplers=writer.samplers, channels=writer.channels)
    with atomic_write(path) as temporary:
        temporary.write_bytes(file.to_bytes())

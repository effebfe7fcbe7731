"""A log as a recording that Rerun draws: scenes (hulls, trails, rays, ellipses), moving vehicles and position errors.

Rerun opens the MCAP log as well, but shows its scenes there as messages only.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from sim.files import atomic_write
from sim.log.contents import Contents
from sim.log.file import LogError, faults
from sim.log.schema import ERROR, POSE

_TIMELINE = "mission"
_LINE_M = 0.03
_SCENES = ("/scene/vehicles", "/scene/acoustics")


def _xyz(vectors: Iterable[Any]) -> list[tuple[float, float, float]]:
    return [(v.x, v.y, v.z) for v in vectors]


def _rgba(primitives: Any) -> list[list[int]]:
    return [[round(255 * c) for c in (p.color.r, p.color.g, p.color.b, p.color.a)] for p in primitives]


def _quaternions(primitives: Any) -> list[tuple[float, ...]]:
    return [(q.x, q.y, q.z, q.w) for q in (p.pose.orientation for p in primitives)]


def _log_entity(rr: Any, stream: Any, entity: Any, *, static: bool) -> None:
    """Log an entity of a scene with all its primitives; what it has none of replaces that of the instant before."""
    # what moves with a vehicle stands below its transform
    path = f"world/{entity.id}" if static else f"world/scene/{entity.id}"

    def solids(primitives: Any) -> dict[str, Any]:
        centers = _xyz(p.pose.position for p in primitives)
        style = {"colors": _rgba(primitives), "fill_mode": "solid"}
        return {"centers": centers, "quaternions": _quaternions(primitives), **style}

    def half(primitives: Any) -> Any:
        return np.array(_xyz(p.size for p in primitives)).reshape(-1, 3) / 2

    size, lists = 2 * half(entity.cylinders), [line.type == line.LINE_LIST for line in entity.lines]
    rounds = rr.Cylinders3D(lengths=size[:, 2], radii=size[:, 0] / 2, **solids(entity.cylinders))
    strips = [
        points[i : i + 2] if pairs else points
        for line, pairs in zip(entity.lines, lists, strict=True)
        for points in [_xyz(line.points)]
        for i in (range(0, len(points), 2) if pairs else [0])
    ]
    colors = _rgba(entity.lines)[:1]
    for name, archetype in (
        ("cylinders", rounds),
        ("spheres", rr.Ellipsoids3D(half_sizes=half(entity.spheres), **solids(entity.spheres))),
        ("boxes", rr.Boxes3D(half_sizes=half(entity.cubes), **solids(entity.cubes))),
        ("lines", rr.LineStrips3D(strips, colors=colors, radii=[_LINE_M])),
    ):
        stream.log(f"{path}/{name}", archetype, static=static)
    for i, (mesh, color) in enumerate(zip(entity.triangles, _rgba(entity.triangles), strict=True)):
        (place,), (turn,) = _xyz([mesh.pose.position]), _quaternions([mesh])
        stream.log(f"{path}/mesh{i}", rr.Transform3D(translation=place, quaternion=turn), static=static)
        faces = np.reshape(mesh.indices, (-1, 3))
        body = rr.Mesh3D(vertex_positions=_xyz(mesh.points), triangle_indices=faces, albedo_factor=color)
        stream.log(f"{path}/mesh{i}", body, static=static)


def write_recording(log_path: Path, path: Path) -> Path:
    """Write the log of a flight as one `.rrd` file for Rerun; the file appears when it is complete.

    Raises:
        LogError: the log cannot be read, or Rerun's package is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise LogError("a recording needs Rerun's package; install it with: pip install rerun-sdk") from None
    log = Contents(log_path, lambda topic, _: topic in _SCENES or topic.endswith(("/pose", "/error")))
    start_ns = log.start_ns()
    with faults(log_path), atomic_write(path) as part:
        # a fixed name: the same log gives the same recording
        stream = rr.RecordingStream("laisn-sim", recording_id=log_path.stem)
        stream.save(part)
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        hulls = set[str]()
        for scene in _SCENES:
            messages = log.require(scene, ["entities"])
            for at, data in zip(messages.time_ns.tolist(), messages.each(), strict=True):
                stream.set_time(_TIMELINE, duration=(at - start_ns) / 1e9)
                for entity in messages.message_class.FromString(data).entities:
                    if entity.id not in hulls:
                        _log_entity(rr, stream, entity, static=entity.frame_locked)
                    if entity.frame_locked:
                        hulls.add(entity.id)
        for topic in [topic for topic, messages in log.topics.items() if messages.kept and topic not in _SCENES]:
            name, type_ = topic.split("/")[1], POSE if topic.endswith("/pose") else ERROR
            arrays = type_.arrays(log.require(topic, type_.fields).table)
            index = [rr.TimeColumn(_TIMELINE, duration=(log.topics[topic].time_ns - start_ns) / 1e9)]
            if type_ is POSE:
                turn = arrays["quaternion"][:, [1, 2, 3, 0]]
                columns = rr.Transform3D.columns(translation=arrays["position"], quaternion=turn)
                rr.send_columns(f"world/{name}", indexes=index, columns=columns, recording=stream)
            else:
                columns = rr.Scalars.columns(scalars=arrays["position_error"])
                rr.send_columns(f"errors/{name}/E_P", indexes=index, columns=columns, recording=stream)
        stream.flush()
        stream.disconnect()
    return path

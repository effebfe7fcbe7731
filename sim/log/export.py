"""Export of logs: a Parquet or CSV file for each channel, or a recording for Rerun."""

from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from google.protobuf.descriptor import FieldDescriptor

from sim.log.contents import Contents, LogError, Messages, log_errors
from sim.log.schema import POSE_FIELDS, POSITION_ERROR
from sim.system import atomic_write

_WRITERS = {"parquet": pa.parquet.ParquetWriter, "csv": pa.csv.CSVWriter}
_UNSIGNED = (FieldDescriptor.CPPTYPE_UINT32, FieldDescriptor.CPPTYPE_UINT64)
_TIMELINE = "mission"
_LINE_M = 0.03  # radius of lines
_SCENES = ("/scene/hulls", "/scene/vehicles", "/scene/acoustics")


def _leaves(descriptor: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and descriptors of numbers and texts of a message."""
    for field in descriptor.fields:
        name = f"{prefix}{field.name}"
        if field.is_repeated or field.type == field.TYPE_BYTES:
            continue
        if field.message_type is None:
            yield name, field
        elif field.message_type.full_name != "google.protobuf.Timestamp":
            yield from _leaves(field.message_type, f"{name}.")


def _table(messages: Messages, start_ns: int) -> Any:
    """Times, then fields; enumerations by their names where these are known."""
    leaves = dict(_leaves(messages.message_class.DESCRIPTOR))
    columns: dict[str, Any] = {
        "time_s": (messages.time_ns - start_ns) / 1e9,
        "log_time_ns": messages.time_ns,
    }
    for (name, leaf), values in zip(leaves.items(), messages.columns(list(leaves)), strict=True):
        column = f"{name}~2" if name in ("time_s", "log_time_ns") else name
        columns[column] = _array(leaf, values)
    return pa.table(columns)


def _array(leaf: Any, values: Any) -> Any:
    """Values of a field as a column; those of an enumeration by their names."""
    if leaf.enum_type is None:
        return pa.array(values, pa.uint64() if leaf.cpp_type in _UNSIGNED else None)
    names = {number: value.name for number, value in leaf.enum_type.values_by_number.items()}
    return pa.array(
        [None if number is None else names.get(number, str(number)) for number in values]
    )


def export(path: Path, out: Path, table_format: str = "parquet") -> list[Path]:
    """Write every protobuf channel with plain numbers or texts as a table; returns the files, in
    order of topic.

    Every row begins with `time_s`, the mission time (without a scenario, since the first message of
    any table), and `log_time_ns`, since 1970; a channel's field of such a name ends in "~2". The
    table of "/follower/estimate" is "follower_estimate.parquet" in the folder `out`. LogError if
    the log is damaged or has nothing to export, the format is unknown, or the folder cannot be
    written.
    """
    if table_format not in _WRITERS:
        raise LogError(f"unknown format {table_format!r}; available: {', '.join(_WRITERS)}")
    log = Contents(
        path,
        lambda _, messages: (
            messages.is_protobuf and any(_leaves(messages.message_class.DESCRIPTOR))
        ),
    )
    files = list[Path]()
    names = set[str]()
    topics = sorted(log.topics)
    with log_errors(path):
        start_ns = log.start_ns()
    for topic in topics:
        messages = log.topics.pop(topic)
        if not messages.data:
            continue
        # other characters than letters, digits, ".", "_", "-" and "~" become %XX; some file systems
        # ignore case
        stem = quote(topic.strip("/").replace("/", "_"), safe="") or "channel"
        name = stem
        number = 1
        while name.lower() in names:
            number += 1
            name = f"{stem}~{number}"
        names.add(name.lower())
        file = out / f"{name}.{table_format}"
        try:
            out.mkdir(parents=True, exist_ok=True)
            with log_errors(path):
                table = _table(messages, start_ns)
            with (
                atomic_write(file) as temporary,
                _WRITERS[table_format](temporary, table.schema) as writer,
            ):
                writer.write_table(table)
        except OSError as error:
            raise LogError(f"{file}: cannot be written: {error.strerror or error}") from error
        files.append(file)
    if not files:
        available = ", ".join(topics) or "none"
        raise LogError(
            f"{path}: expected protobuf channels with numbers or texts; available: {available}"
        )
    return files


def _numbers(values: Any, names: str, prefix: str = "") -> Any:
    """Attributes with names of one letter of messages within others, shape (n, len(names))."""
    get = attrgetter(*(f"{prefix}{name}" for name in names))
    return np.array([get(value) for value in values]).reshape(-1, len(names))


def _entities(rr: Any, entity: Any) -> Iterator[tuple[str, Any]]:
    """Rerun's archetypes of an entity of a scene; empty ones remove those of the previous
    instant.
    """

    def appearance(primitives: Any) -> dict[str, Any]:
        return {
            "centers": _numbers(primitives, "xyz", "pose.position."),
            "quaternions": _numbers(primitives, "xyzw", "pose.orientation."),
            "colors": _numbers(primitives, "rgba", "color."),
            "fill_mode": "solid",
        }

    half_size = {
        kind: _numbers(getattr(entity, kind), "xyz", "size.") / 2
        for kind in ("cylinders", "spheres", "cubes")
    }
    length = 2 * half_size["cylinders"][:, 2]
    radius = half_size["cylinders"][:, 0]
    yield "cylinders", rr.Cylinders3D(**appearance(entity.cylinders), lengths=length, radii=radius)
    yield "spheres", rr.Ellipsoids3D(**appearance(entity.spheres), half_sizes=half_size["spheres"])
    yield "boxes", rr.Boxes3D(**appearance(entity.cubes), half_sizes=half_size["cubes"])
    strips = list[Any]()
    for line in entity.lines:
        points = _numbers(line.points, "xyz")
        strips += list(points.reshape(-1, 2, 3)) if line.type == line.LINE_LIST else [points]
    colors = _numbers(entity.lines, "rgba", "color.")[:1]
    yield "lines", rr.LineStrips3D(strips, colors=colors, radii=[_LINE_M])
    for i, mesh in enumerate(entity.triangles):
        geometry = appearance([mesh])
        faces = np.reshape(mesh.indices, (-1, 3))
        points = _numbers(mesh.points, "xyz")
        yield (
            f"mesh{i}",
            rr.Transform3D(
                translation=geometry["centers"][0], quaternion=geometry["quaternions"][0]
            ),
        )
        yield (
            f"mesh{i}",
            rr.Mesh3D(
                vertex_positions=points, triangle_indices=faces, albedo_factor=geometry["colors"][0]
            ),
        )


def write_recording(log_path: Path, path: Path) -> Path:
    """Write scenes, moving vehicles and position errors of a flight as an `.rrd` file; LogError
    if that fails.
    """
    try:
        import rerun as rr
    except ImportError:
        raise LogError(
            "a recording needs Rerun's package; install it with: pip install rerun-sdk"
        ) from None
    log = Contents(
        log_path, lambda topic, _: topic in _SCENES or topic.endswith(("/pose", "/error"))
    )
    with log_errors(log_path), atomic_write(path) as temporary:
        start_ns = log.start_ns()
        # a fixed name: the same log gives the same recording
        stream = rr.RecordingStream("laisn-sim", recording_id=log_path.stem)
        stream.save(temporary)
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        hulls = set[str]()
        # of a flight without a message no acoustics are drawn
        for scene in filter(log.topics.get, _SCENES):
            messages = log.require(scene, ["entities"])
            for time_ns, data in zip(messages.time_ns.tolist(), messages.data, strict=True):
                stream.set_time(_TIMELINE, duration=(time_ns - start_ns) / 1e9)
                for entity in messages.message_class.FromString(data).entities:
                    # entities that move with a vehicle are children of its transform, logged once
                    fixed = entity.frame_locked
                    root = f"world/{'' if entity.frame_locked else 'scene/'}{entity.id}"
                    for name, archetype in _entities(rr, entity) if entity.id not in hulls else ():
                        stream.log(f"{root}/{name}", archetype, static=fixed)
                    hulls |= {entity.id} if fixed else set()
        for topic, messages in log.topics.items():
            if not messages.holds_data or topic in _SCENES:
                continue
            name = topic.split("/")[1]
            index = [rr.TimeColumn(_TIMELINE, duration=(messages.time_ns - start_ns) / 1e9)]
            if topic.endswith("/pose"):
                xyz, xyzw = np.split(
                    log.require(topic, POSE_FIELDS).table(POSE_FIELDS), [3], axis=1
                )
                entity = f"world/{name}"
                columns = rr.Transform3D.columns(translation=xyz, quaternion=xyzw)
            else:
                error = log.require(topic, POSITION_ERROR.fields).table(POSITION_ERROR.fields)
                entity = f"errors/{name}/E_P"
                columns = rr.Scalars.columns(scalars=error[:, 0])
            rr.send_columns(entity, indexes=index, columns=columns, recording=stream)
        stream.flush()
        stream.disconnect()
    return path

"""The table of numeric channels: which arrays of a flight their messages hold, as protobuf types and as bytes."""

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache, cached_property
from itertools import product
from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt
from foxglove import Schema
from foxglove.messages import FrameTransform, FrameTransforms, Pose, PoseInFrame, Quaternion, Timestamp, Vector3
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field
from mcap.well_known import SchemaEncoding

from laisn.arrays import Floats, Ints
from laisn.estimates import Columns
from laisn.failure import LaisnError
from laisn.messages import LeaderMessage, OwnMotion, Ranges
from laisn.navigators import NAVIGATORS

Array = npt.NDArray[Any]

STAMP = Timestamp(sec=2**32 - 1, nsec=999_999_999)
"""Timestamp of messages that a `FixedLayout` is made from; both its numbers take five bytes."""
_STAMP = timestamp_pb2.Timestamp(seconds=STAMP.sec, nanos=STAMP.nsec)
_TAGS = np.array([8, 0, 0, 0, 0, 0, 16, 0, 0, 0, 0, 0], dtype=np.uint8)
"""What a serialised timestamp holds besides its numbers."""


class Clock:
    """Converts times since the start of the mission [s] to times since 1970 [ns].

    Raises LaisnError if the epoch lies before 1970.
    """

    def __init__(self, epoch: str) -> None:
        since_1970 = datetime.fromisoformat(epoch) - datetime(1970, 1, 1, tzinfo=UTC)
        self.epoch_ns = since_1970 // timedelta(microseconds=1) * 1000
        # a Foxglove timestamp counts seconds in 32 bits, which end in 2106
        if not 0 <= self.epoch_ns < (2**32 - 10**8) * 10**9:
            raise LaisnError(f"epoch {epoch} lies outside 1970 … 2102, the years that a log can hold")

    def ns(self, time_s: npt.ArrayLike) -> Ints:
        """Times since 1970 [ns], of the same shape."""
        return np.asarray(self.epoch_ns + np.rint(np.asarray(time_s, dtype=np.float64) * 1e9).astype(np.int64))


def timestamp(time_ns: int) -> Timestamp:
    """A time since 1970 as Foxglove's messages hold it."""
    return Timestamp(sec=time_ns // 10**9, nsec=time_ns % 10**9)


def _slot(k: int) -> bytes:
    """Eight bytes that mark the place of number k in a serialised message."""
    return b"slt" + struct.pack("<I", k) + b"\x42"


def _mark(message: Any, prefix: str, found: dict[str, tuple[str, Any]]) -> None:
    """Put a slot into every number of eight bytes of a protobuf message; collect its path, type and former value."""
    formats = {Field.TYPE_DOUBLE: "<f8", Field.TYPE_SFIXED64: "<i8", Field.TYPE_FIXED64: "<u8"}
    for field in message.DESCRIPTOR.fields:
        name, value = f"{prefix}{field.name}", getattr(message, field.name)
        if field.is_repeated:
            for i, item in enumerate(value if field.message_type is not None else ()):
                _mark(item, f"{name}.{i}.", found)
        elif field.has_presence and not message.HasField(field.name):
            continue
        elif field.type in formats:
            setattr(message, field.name, np.frombuffer(_slot(len(found)), dtype=formats[field.type])[0].item())
            found[name] = formats[field.type], value
        elif field.message_type is not None and field.message_type.full_name == _STAMP.DESCRIPTOR.full_name:
            value.ParseFromString(_STAMP.SerializeToString())
        elif field.message_type is not None:
            _mark(value, f"{name}.", found)


class FixedLayout:
    """Serialised messages of one length, which differ only in timestamps and in numbers of eight bytes.

    Whole columns are copied to and from such messages, without a protobuf object for each.

    Args:
        message: a protobuf message; numbers that are not set have no place in the layout.
    """

    def __init__(self, message: Any) -> None:
        marked, found = type(message)(), dict[str, tuple[str, Any]]()
        marked.CopyFrom(message)
        _mark(marked, "", found)
        data = marked.SerializeToString()
        stamps = [m.start() for m in re.finditer(re.escape(_STAMP.SerializeToString()), data)]
        fields = {name: (format_, data.index(_slot(k))) for k, (name, (format_, _)) in enumerate(found.items())}
        self.names, self._stamps = tuple(fields), [f"stamp {place}" for place in stamps]
        fields |= {name: ("(12,)u1", place) for name, place in zip(self._stamps, stamps, strict=True)}
        formats, offsets = ([field[i] for field in fields.values()] for i in (0, 1))
        layout: Any = {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": len(data)}
        self.dtype = np.dtype(layout)
        self._template = np.frombuffer(bytearray(data), self.dtype)
        for name, (_, value) in found.items():
            self._template[name] = value

    def rows(self, time_ns: Ints, columns: Mapping[str, Array]) -> list[bytes]:
        """Messages at times since 1970, shape (n,), [ns], with these numbers, shape (n,) each; others stay as made."""
        block = np.repeat(self._template, time_ns.size)
        stamps = np.repeat(_TAGS[None], time_ns.size, axis=0)
        # varints of five bytes; shorter numbers are padded with zero groups, which the wire format allows
        for start, part in zip((1, 7), np.divmod(time_ns, 1_000_000_000), strict=True):
            stamps[:, start : start + 5] = (part[:, None] >> np.arange(0, 35, 7)) & 0x7F | [0x80, 0x80, 0x80, 0x80, 0]
        for name, values in (*dict.fromkeys(self._stamps, stamps).items(), *columns.items()):
            block[name] = values
        whole, length = block.tobytes(), self.dtype.itemsize
        return [whole[i : i + length] for i in range(0, len(whole), length)]

    def read(self, data: bytearray) -> Array | None:
        """Messages, one behind the other, as records with a field for each number; None if one has another layout."""
        constant = np.ones(self.dtype.itemsize, dtype=np.bool_)
        for kind, offset, *_ in (self.dtype.fields or {}).values():
            constant[offset : offset + kind.itemsize] = False
        block = np.frombuffer(data, dtype=np.uint8).reshape(-1, constant.size)
        fits = np.all(block[:, constant] == self._template.view(np.uint8)[constant])
        return block.view(self.dtype)[:, 0] if fits else None


def message_class_of(schema: Any) -> Any:
    """The protobuf class of a message type, by the file descriptors that its schema holds."""
    pool = descriptor_pool.DescriptorPool()
    message_factory.GetMessages(descriptor_pb2.FileDescriptorSet.FromString(schema.data).file, pool)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


@dataclass(frozen=True, kw_only=True)
class RecordType:
    """Messages of one channel: a timestamp and numbers, all float64 or int64, in SI units and radians.

    It is described at run time in the package `laisn`, with explicit presence, so that a number that was not set can be
    told from zero; or it is a type of Foxglove's.
    """

    name: str
    topic: str
    """How its topics end."""
    columns: tuple[Columns, ...]
    """Arrays of a record, and the fields of a message that hold their numbers."""
    steps: str = ""
    """Array with the filter step of each message; "": there is one at every step."""
    foxglove: Any = None
    """A message of Foxglove's with all numbers, at the time `STAMP`."""

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of all numbers."""
        return tuple(dict.fromkeys(name for array in self.columns for name in array.names))

    @cached_property
    def schema(self) -> Schema:
        """The type as a log holds it: with the descriptors of all files that it needs."""
        if self.foxglove is not None:
            schema: Schema = self.foxglove.get_schema()
            return schema
        files = descriptor_pb2.FileDescriptorSet()
        _STAMP.DESCRIPTOR.file.CopyToProto(files.file.add())
        file = files.file.add(name=f"laisn/{self.name}.proto", package="laisn", dependency=[files.file[0].name])
        fields, stamp = file.message_type.add(name=self.name).field, f".{_STAMP.DESCRIPTOR.full_name}"
        fields.add(name="timestamp", number=1, type=Field.TYPE_MESSAGE, type_name=stamp, label=Field.LABEL_OPTIONAL)
        integers = {name for array in self.columns if array.integer for name in array.names}
        for number, name in enumerate(self.fields, start=2):
            type_ = Field.TYPE_SFIXED64 if name in integers else Field.TYPE_DOUBLE
            fields.add(name=name, number=number, type=type_, label=Field.LABEL_OPTIONAL)
        data = files.SerializeToString()
        return Schema(name=f"laisn.{self.name}", encoding=SchemaEncoding.Protobuf, data=data)

    @cached_property
    def message_class(self) -> Any:
        """The protobuf class."""
        return message_class_of(self.schema)

    @cached_property
    def layout(self) -> FixedLayout:
        """Of messages with all numbers."""
        if self.foxglove is not None:
            return FixedLayout(self.message_class.FromString(self.foxglove.encode()))
        message = self.message_class(**dict.fromkeys(self.fields, 0))
        message.timestamp.seconds = STAMP.sec
        return FixedLayout(message)

    def rows(self, time_ns: Ints, arrays: Callable[[str], Array]) -> list[bytes]:
        """Serialised messages, from their times [ns] and the arrays of the attributes, n rows each."""
        columns = dict[str, Array]()
        for array in self.columns:
            table = arrays(array.attribute).reshape(time_ns.size, len(array.names))
            columns |= {name: table[:, k] for k, name in enumerate(array.names)}
        return self.layout.rows(time_ns, columns)

    def arrays(self, table: Callable[[Sequence[str]], Floats]) -> dict[str, Array]:
        """Arrays by attribute, from a function that gives the numbers of fields as columns."""
        found = {array: table(array.names) for array in self.columns}
        return {
            array.attribute: numbers.reshape(len(numbers), *array.shape).astype(
                np.int64 if array.integer else float, copy=False
            )
            for array, numbers in found.items()
        }


def _array(attribute: str, prefix: str, *axes: Sequence[str]) -> Columns:
    """Fields named by a prefix and the index along each axis."""
    names = tuple("_".join(filter(None, (prefix, *index))) for index in product(*axes))
    return Columns(attribute, names, tuple(len(axis) for axis in axes))


def _numbers(*attributes: str) -> tuple[Columns, ...]:
    """Arrays with one number a message, in fields of their name."""
    return tuple(Columns(attribute, (attribute,)) for attribute in attributes)


def vector(xyz: Sequence[float]) -> Vector3:
    """A vector of Foxglove's."""
    x, y, z = xyz
    return Vector3(x=x, y=y, z=z)


def rotation(wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> Quaternion:
    """A quaternion of Foxglove's."""
    w, x, y, z = wxyz
    return Quaternion(x=x, y=y, z=z, w=w)


def pose(xyz: Sequence[float] = (0.0, 0.0, 0.0), wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> Pose:
    """A pose of Foxglove's at a position [m] with a quaternion (w, x, y, z)."""
    return Pose(position=vector(xyz), orientation=rotation(wxyz))


_STATE = ("x", "y", "vx", "vy")
_WORLD, _BODY, _PLANE = ("east", "north", "up"), ("x", "y", "z"), ("x", "y")
PLACES = _array("transmitters", "", Ranges._fields, ("east", "north", "depth"))
"""Positions of the transmitters: rear_east, rear_north, rear_depth …"""


def _pose(topic: str) -> RecordType:
    message = PoseInFrame(timestamp=STAMP, frame_id="world", pose=pose())
    position = Columns("position", tuple(f"pose.position.{axis}" for axis in _BODY), (3,))
    quaternion = Columns("quaternion", tuple(f"pose.orientation.{axis}" for axis in "wxyz"), (4,))
    return RecordType(name="PoseInFrame", topic=topic, columns=(position, quaternion), foxglove=message)


def transforms(vehicles: Sequence[str], sites: Sequence[tuple[str, str, Sequence[float]]]) -> RecordType:
    """World to vehicles, which move, and vehicles to their sites: vehicle, site and its offset [m]."""
    frames = [*(("world", name, (0.0, 0.0, 0.0)) for name in vehicles), *sites]
    parts = [
        FrameTransform(
            timestamp=STAMP, parent_frame_id=parent, child_frame_id=child,
            translation=vector(offset), rotation=rotation(),
        )
        for parent, child, offset in frames
    ]  # fmt: skip

    def moving(attribute: str, field: str, axes: str) -> Columns:
        names = tuple(f"transforms.{v}.{field}.{axis}" for v in range(len(vehicles)) for axis in axes)
        return Columns(attribute, names, (len(vehicles), len(axes)))

    columns = moving("position", "translation", "xyz"), moving("quaternion", "rotation", "wxyz")
    return RecordType(name="FrameTransforms", topic="tf", columns=columns, foxglove=FrameTransforms(transforms=parts))


@cache
def vehicle_state(effectors: tuple[str, ...]) -> RecordType:
    """True state of a vehicle with these effectors: the thrust of `thruster_main` is the field `thrust_main`."""
    return RecordType(
        # vehicles of one log may differ in their effectors
        name=f"VehicleState_{crc32(','.join(effectors).encode()):08x}",
        topic="state",
        columns=(
            *_numbers("time"),
            _array("velocity", "velocity", _WORLD),
            _array("angular_velocity", "angular_velocity", _BODY),
            _array("water_velocity", "water_velocity", _WORLD),
            _array("thrust", "thrust", [name.removeprefix("thruster_") for name in effectors]),
            # these follow from pose and velocity; they are there for plots
            *_numbers("depth", "heading", "pitch", "roll", "forward_speed"),
        ),
    )


POSE, ESTIMATE = _pose("pose"), _pose("estimate")
OWN_MOTION = RecordType(name="OwnMotion", topic="motion", columns=_numbers(*OwnMotion._fields))
_RECEIVED = _array("message", "leader", LeaderMessage._fields), _array("ranges", "range", Ranges._fields)
RECEPTION = RecordType(name="Reception", topic="reception", columns=_RECEIVED, steps="message_step")
PLACED_RECEPTION = RecordType(name="PlacedReception", topic="reception", columns=(*_RECEIVED, PLACES))
"""A reception with the positions of the transmitters; of beacons and buoys, in logs of vehicles."""
FILTER_STATE = RecordType(
    name="FilterState",
    topic="filter",
    columns=(_array("state", "", _STATE), _array("covariance", "covariance", _STATE, _STATE)),
)
FIX = RecordType(
    name="Fix",
    topic="innovation",
    columns=(
        _array("fix_position", "", _PLANE),
        Columns("fix_sigma", ("sigma",)),
        _array("innovation", "innovation", _PLANE),
        _array("innovation_covariance", "innovation_covariance", _PLANE, _PLANE),
        Columns("fix_kind", ("kind",), integer=True),
    ),
    steps="fix_step",
)
DETAILS = {
    kind: RecordType(
        name=kind.DETAILS.name.title(), topic=kind.DETAILS.name, columns=kind.DETAILS.columns, steps="fix_step"
    )
    for kind in {spec.estimates: None for spec in NAVIGATORS.values()}
    if kind.DETAILS
}
"""What navigators log of each message beside the fix, by the class of their estimates."""
ERROR = RecordType(name="Error", topic="error", columns=_numbers("position_error", "bearing_error"))
MEASURED = (OWN_MOTION, RECEPTION)
"""Channels of a follower's measurements; the first has a message at every filter step."""


def estimated(kind: type) -> tuple[RecordType, ...]:
    """Channels of a follower's estimates of this class."""
    return (FILTER_STATE, FIX, *([DETAILS[kind]] if kind in DETAILS else []))

"""The table of numeric channels: which arrays of a flight their messages hold, as protobuf types and as bytes."""

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import numpy.typing as npt
from foxglove import Schema
from foxglove.messages import Pose, PoseInFrame, Quaternion, Timestamp, Vector3
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.well_known import SchemaEncoding

from laisn.arrays import Floats, Ints
from laisn.messages import LeaderMessage, OwnMotion, Ranges
from laisn.navigators import NAVIGATORS

Array = npt.NDArray[Any]

_STAMP_S, _STAMP_NS = 2**32 - 1, 999_999_999
STAMP = Timestamp(sec=_STAMP_S, nsec=_STAMP_NS)
"""Timestamp of messages that a `FixedLayout` is made from; both its numbers take five bytes."""
_STAMP = timestamp_pb2.Timestamp(seconds=_STAMP_S, nanos=_STAMP_NS)


def _slot(k: int) -> bytes:
    """Eight bytes that mark the place of number k in a serialised message."""
    return b"slt" + struct.pack("<I", k) + b"\x42"


def _mark(message: Any, prefix: str, found: dict[str, tuple[str, Any]]) -> None:
    """Put a slot into every number of eight bytes of a protobuf message; collect its path, type and former value."""
    formats = {"TYPE_DOUBLE": "<f8", "TYPE_SFIXED64": "<i8", "TYPE_FIXED64": "<u8"}
    for field in message.DESCRIPTOR.fields:
        name, value = f"{prefix}{field.name}", getattr(message, field.name)
        format_ = formats.get(descriptor_pb2.FieldDescriptorProto.Type.Name(field.type))
        if field.is_repeated:
            for i, item in enumerate(value if field.message_type is not None else ()):
                _mark(item, f"{name}.{i}.", found)
        elif field.has_presence and not message.HasField(field.name):
            continue
        elif format_ is not None:
            setattr(message, field.name, np.frombuffer(_slot(len(found)), dtype=format_)[0].item())
            found[name] = format_, value
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
        data, stamp = marked.SerializeToString(), _STAMP.SerializeToString()
        fields = {name: (format_, data.index(_slot(k))) for k, (name, (format_, _)) in enumerate(found.items())}
        self.names, self._stamps, place = tuple(fields), list[tuple[str, str]](), data.find(stamp)
        while place >= 0:
            seconds, nanos = f"seconds at {place}", f"nanos at {place}"
            fields |= {seconds: ("(5,)u1", place + 1), nanos: ("(5,)u1", place + 7)}
            self._stamps.append((seconds, nanos))
            place = data.find(stamp, place + len(stamp))
        formats, offsets = ([field[i] for field in fields.values()] for i in (0, 1))
        layout: Any = {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": len(data)}
        self.dtype = np.dtype(layout)
        self._template = np.frombuffer(bytearray(data), self.dtype) if data else np.empty(1, self.dtype)
        for name, (_, value) in found.items():
            self._template[name] = value

    def rows(self, time_ns: Ints, columns: Mapping[str, Array]) -> list[bytes]:
        """Messages at times since 1970, shape (n,), [ns], with these numbers, shape (n,) each; others stay as made."""
        block = np.repeat(self._template, time_ns.size)
        # varints of five bytes; shorter numbers are padded with zero groups, which the wire format allows
        groups = [(part[:, None] >> np.arange(0, 35, 7)) & 0x7F for part in np.divmod(time_ns, 1_000_000_000)]
        for names in self._stamps:
            for name, group in zip(names, groups, strict=True):
                block[name] = group | [0x80, 0x80, 0x80, 0x80, 0]
        for name, values in columns.items():
            block[name] = values
        whole, length = block.tobytes(), self.dtype.itemsize
        return [whole[i : i + length] for i in range(0, len(whole), length)]

    def fits(self, data: bytes | bytearray) -> bool:
        """Whether messages, one behind the other, all have this layout."""
        constant = np.ones(self.dtype.itemsize, dtype=np.bool_)
        for kind, offset, *_ in (self.dtype.fields or {}).values():
            constant[offset : offset + kind.itemsize] = False
        if not data:
            return not constant.size
        block = np.frombuffer(data, dtype=np.uint8).reshape(-1, constant.size)
        return bool(np.all(block[:, constant] == self._template.view(np.uint8)[constant]))


def message_class_of(schema: Any) -> Any:
    """The protobuf class of a message type, by the file descriptors that its schema holds."""
    files = {file.name: file for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file}
    pool = descriptor_pool.DescriptorPool()

    def add(name: str) -> None:
        file = files.pop(name, None)
        if file is not None:
            for needed in file.dependency:
                add(needed)
            pool.Add(file)

    for name in list(files):
        add(name)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


class Group(NamedTuple):
    """An array of a record, and the fields of a message that hold its numbers."""

    attribute: str
    fields: tuple[str, ...]
    """One for each number; those of equal numbers, as in a symmetric matrix, may be one."""
    shape: tuple[int, ...] = ()
    """Of the array, for each message."""
    integer: bool = False


@dataclass(frozen=True, kw_only=True)
class RecordType:
    """Messages of one channel: a timestamp and numbers, all float64 or int64, in SI units and radians.

    It is described at run time in the package `laisn`, with explicit presence, so that a number that was not set can be
    told from zero; or it is a type of Foxglove's.
    """

    name: str
    topic: str
    """How its topics end."""
    groups: tuple[Group, ...]
    foxglove: Any = None
    """A message of Foxglove's with all numbers, at the time `STAMP`."""

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of all numbers."""
        return tuple(dict.fromkeys(field for group in self.groups for field in group.fields))

    @cached_property
    def message_class(self) -> Any:
        """The protobuf class."""
        if self.foxglove is not None:
            return message_class_of(self.foxglove.get_schema())
        kind = descriptor_pb2.FieldDescriptorProto
        file = descriptor_pb2.FileDescriptorProto(
            name=f"laisn/{self.name}.proto", package="laisn", dependency=["google/protobuf/timestamp.proto"]
        )
        fields = file.message_type.add(name=self.name).field
        stamp = _STAMP.DESCRIPTOR.full_name
        fields.add(name="timestamp", number=1, type=kind.TYPE_MESSAGE, type_name=f".{stamp}", label=kind.LABEL_OPTIONAL)
        integers = {field for group in self.groups if group.integer for field in group.fields}
        for number, name in enumerate(self.fields, start=2):
            type_ = kind.TYPE_SFIXED64 if name in integers else kind.TYPE_DOUBLE
            fields.add(name=name, number=number, type=type_, label=kind.LABEL_OPTIONAL)
        pool = descriptor_pool.Default()
        pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"laisn.{self.name}"))

    @cached_property
    def schema(self) -> Schema:
        """The type as a log holds it: with the descriptors of all files that it needs."""
        if self.foxglove is not None:
            schema: Schema = self.foxglove.get_schema()
            return schema
        descriptor, files = self.message_class.DESCRIPTOR, descriptor_pb2.FileDescriptorSet()
        for needed in (*descriptor.file.dependencies, descriptor.file):
            needed.CopyToProto(files.file.add())
        return Schema(name=descriptor.full_name, encoding=SchemaEncoding.Protobuf, data=files.SerializeToString())

    @cached_property
    def layout(self) -> FixedLayout:
        """Of messages with all numbers."""
        if self.foxglove is not None:
            return FixedLayout(self.message_class.FromString(self.foxglove.encode()))
        zeros = {field: 0 if group.integer else 0.0 for group in self.groups for field in group.fields}
        return FixedLayout(self.message_class(timestamp=_STAMP, **zeros))

    def rows(self, time_ns: Ints, arrays: Callable[[str], Array]) -> list[bytes]:
        """Serialised messages, from their times [ns] and the arrays of the attributes, n rows each."""
        columns = dict[str, Array]()
        for group in self.groups:
            table = arrays(group.attribute).reshape(time_ns.size, len(group.fields))
            columns |= {field: table[:, k] for k, field in enumerate(group.fields)}
        return self.layout.rows(time_ns, columns)

    def arrays(self, table: Callable[[Sequence[str]], Floats]) -> dict[str, Array]:
        """Arrays by attribute, from a function that gives the numbers of fields as columns."""
        found = dict[str, Array]()
        for group in self.groups:
            numbers = table(group.fields)
            numbers = numbers.reshape(len(numbers), *group.shape)
            found[group.attribute] = numbers.astype(np.int64) if group.integer else numbers
        return found


def _array(attribute: str, prefix: str, *axes: Sequence[str]) -> Group:
    """Fields named by a prefix and the index along each axis."""
    names = tuple("_".join(filter(None, (prefix, *index))) for index in product(*axes))
    return Group(attribute, names, tuple(len(axis) for axis in axes))


def _numbers(*attributes: str) -> tuple[Group, ...]:
    """Arrays with one number a message, in fields of their name."""
    return tuple(Group(attribute, (attribute,)) for attribute in attributes)


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
DERIVED = _numbers("depth", "heading", "pitch", "roll", "forward_speed")
"""Follow from pose and velocity; they are there for plots, and ignored on reading."""
PLACES = _array("transmitters", "", Ranges._fields, ("east", "north", "depth"))
"""Positions of the transmitters: rear_east, rear_north, rear_depth …"""


def _pose(topic: str) -> RecordType:
    message = PoseInFrame(timestamp=STAMP, frame_id="world", pose=pose())
    position = Group("position", tuple(f"pose.position.{axis}" for axis in _BODY), (3,))
    quaternion = Group("quaternion", tuple(f"pose.orientation.{axis}" for axis in "wxyz"), (4,))
    return RecordType(name="PoseInFrame", topic=topic, groups=(position, quaternion), foxglove=message)


@cache
def vehicle_state(effectors: tuple[str, ...]) -> RecordType:
    """True state of a vehicle with these effectors: the thrust of `thruster_main` is the field `thrust_main`."""
    return RecordType(
        # a type of protobuf has one definition in a process, and vehicles differ in their effectors
        name=f"VehicleState_{crc32(','.join(effectors).encode()):08x}",
        topic="state",
        groups=(
            *_numbers("time"),
            _array("velocity", "velocity", _WORLD),
            _array("angular_velocity", "angular_velocity", _BODY),
            _array("water_velocity", "water_velocity", _WORLD),
            _array("thrust", "thrust", [name.removeprefix("thruster_") for name in effectors]),
            *DERIVED,
        ),
    )


POSE, ESTIMATE = _pose("pose"), _pose("estimate")
OWN_MOTION = RecordType(name="OwnMotion", topic="motion", groups=_numbers(*OwnMotion._fields))
_RECEIVED = _array("message", "leader", LeaderMessage._fields), _array("ranges", "range", Ranges._fields)
RECEPTION = RecordType(name="Reception", topic="reception", groups=_RECEIVED)
PLACED_RECEPTION = RecordType(name="PlacedReception", topic="reception", groups=(*_RECEIVED, PLACES))
"""A reception with the positions of the transmitters; of beacons and buoys, in logs of vehicles."""
FILTER_STATE = RecordType(
    name="FilterState",
    topic="filter",
    groups=(_array("state", "", _STATE), _array("covariance", "covariance", _STATE, _STATE)),
)
FIX = RecordType(
    name="Fix",
    topic="innovation",
    groups=(
        _array("fix_position", "", _PLANE),
        Group("fix_sigma", ("sigma",)),
        _array("innovation", "innovation", _PLANE),
        _array("innovation_covariance", "innovation_covariance", _PLANE, _PLANE),
        Group("fix_kind", ("kind",), integer=True),
    ),
)
DETAILS = {
    kind.DETAILS.name: (
        kind,
        RecordType(
            name=kind.DETAILS.name.title(),
            topic=kind.DETAILS.name,
            groups=tuple(Group(*columns) for columns in kind.DETAILS.columns),
        ),
    )
    for kind in {spec.estimates: None for spec in NAVIGATORS.values()}
    if kind.DETAILS
}
"""Class of estimates and type of record of what navigators log of each message beside the fix, by its topic."""
ERROR = RecordType(name="Error", topic="error", groups=_numbers("position_error", "bearing_error"))
FLIGHT = (POSE, vehicle_state(()), OWN_MOTION, RECEPTION, FILTER_STATE, FIX, *(type_ for _, type_ in DETAILS.values()))
"""Types of the channels that make up a flight; all other channels are derived from them."""

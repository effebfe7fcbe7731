"""The table of numeric channels: which arrays of a flight their messages hold, as protobuf types
and as bytes.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache, cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import numpy.typing as npt
from foxglove import Schema
from foxglove.messages import Pose, Quaternion, Timestamp, Vector3
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field
from google.protobuf.message import Message
from mcap.well_known import SchemaEncoding

from laisn.arrays import Ints
from laisn.errors import LaisnError
from laisn.estimates import LogColumns
from laisn.messages import Channel, LeaderMessage, Ranges, SensorHeader
from laisn.navigators import NAVIGATORS
from sim.sensing.sensor import name_in_fields
from sim.sensing.sensors import OWN_SENSORS

Array = npt.NDArray[Any]
_FORMATS = {Field.TYPE_DOUBLE: "<f8", Field.TYPE_SFIXED64: "<i8", Field.TYPE_FIXED64: "<u8"}


class Clock:
    """Converts times since the start of the mission [s] to times since 1970 [ns]; LaisnError for
    an epoch before.
    """

    def __init__(self, epoch: str) -> None:
        since_1970 = datetime.fromisoformat(epoch) - datetime(1970, 1, 1, tzinfo=UTC)
        self.epoch_ns = since_1970 // timedelta(microseconds=1) * 1000
        # a Foxglove timestamp counts seconds in 32 bits, which end in 2106
        if not 0 <= self.epoch_ns < (2**32 - 10**8) * 10**9:
            raise LaisnError(
                f"epoch {epoch} lies outside 1970 … 2102, the years that a log can hold"
            )

    def ns(self, time_s: npt.ArrayLike) -> Ints:
        """Times since 1970 [ns], of the same shape."""
        return np.asarray(
            self.epoch_ns + np.rint(np.asarray(time_s, dtype=np.float64) * 1e9).astype(np.int64)
        )


@lru_cache(maxsize=1024)
def timestamp(time_ns: int) -> Timestamp:
    """A time since 1970 as Foxglove's messages hold it; many channels have messages at the same
    times.
    """
    return Timestamp(sec=time_ns // 10**9, nsec=time_ns % 10**9)


def vector(xyz: Sequence[float]) -> Vector3:
    x, y, z = xyz
    return Vector3(x=x, y=y, z=z)


def quaternion(wxyz: Sequence[float]) -> Quaternion:
    w, x, y, z = wxyz
    return Quaternion(x=x, y=y, z=z, w=w)


def pose(xyz: Sequence[float], wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> Pose:
    """A pose of Foxglove's at a position [m] with a quaternion (w, x, y, z)."""
    return Pose(position=vector(xyz), orientation=quaternion(wxyz))


def message_class_of(schema: Any) -> Any:
    """The protobuf class of a message type, by the file descriptors that its schema holds."""
    pool = descriptor_pool.DescriptorPool()
    message_factory.GetMessages(descriptor_pb2.FileDescriptorSet.FromString(schema.data).file, pool)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


class FixedLayout(NamedTuple):
    """Messages with eight bytes for every field: dtype of the numbers, a message, and where it
    holds no numbers.
    """

    dtype: np.dtype[np.void]
    example: bytes
    tags: Ints


@lru_cache(maxsize=64)
def fixed_layout(message_class: type[Message]) -> FixedLayout | None:
    """The layout of messages of a type; None if one of its fields is no number of eight bytes."""
    fields = sorted(message_class.DESCRIPTOR.fields, key=lambda field: field.number)
    if not fields or any(field.type not in _FORMATS or field.is_repeated for field in fields):
        return None
    ends = np.cumsum([message_class(**{field.name: 1}).ByteSize() for field in fields])
    names = [field.name for field in fields]
    formats = [_FORMATS[field.type] for field in fields]
    dtype = np.dtype(
        {
            "names": names,
            "formats": formats,
            "offsets": (ends - 8).tolist(),
            "itemsize": int(ends[-1]),
        }
    )
    tags = np.setdiff1d(np.arange(ends[-1]), ends[:, None] - np.arange(1, 9))
    return FixedLayout(dtype, message_class(**dict.fromkeys(names, 1)).SerializeToString(), tags)


@dataclass(frozen=True, kw_only=True)
class RecordType:
    """Messages of one channel: numbers, all float64 or int64, in SI units and radians."""

    name: str
    topic: str  # end of its topics
    # arrays of a record, and the fields of a message that hold their numbers
    columns: tuple[LogColumns, ...]
    steps: str = ""  # array with the filter step of each message; "": there is one at every step

    @property
    def fields(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for array in self.columns for name in array.names))

    @cached_property
    def schema(self) -> Schema:
        """A protobuf type in the package `laisn`, whose fields have presence: absent numbers are
        not zero.
        """
        files = descriptor_pb2.FileDescriptorSet()
        fields = (
            files.file.add(name=f"laisn/{self.name}.proto", package="laisn")
            .message_type.add(name=self.name)
            .field
        )
        integer = {name: array.integer for array in self.columns for name in array.names}
        for number, name in enumerate(self.fields, start=1):
            type_ = Field.TYPE_SFIXED64 if integer[name] else Field.TYPE_DOUBLE
            fields.add(name=name, number=number, type=type_, label=Field.LABEL_OPTIONAL)
        return Schema(
            name=f"laisn.{self.name}",
            encoding=SchemaEncoding.Protobuf,
            data=files.SerializeToString(),
        )

    @cached_property
    def message_class(self) -> Any:
        return message_class_of(self.schema)

    def rows(self, arrays: Mapping[str, Array]) -> list[bytes]:
        """Serialised messages, from the arrays of the attributes, n rows each."""
        layout = fixed_layout(self.message_class)
        n = len(arrays[self.columns[0].attribute])
        assert layout is not None
        block = np.frombuffer(bytearray(layout.example * n), layout.dtype)
        for array in self.columns:
            table = arrays[array.attribute].reshape(n, len(array.names))
            for k, name in enumerate(array.names):
                block[name] = table[:, k]
        encoded = block.tobytes()
        length = block.itemsize
        return [encoded[i : i + length] for i in range(0, len(encoded), length)]


def _array(attribute: str, prefix: str, *axes: Sequence[str]) -> LogColumns:
    names = tuple("_".join(filter(None, (prefix, *index))) for index in product(*axes))
    return LogColumns(attribute, names, tuple(len(axis) for axis in axes))


def _numbers(*attributes: str) -> tuple[LogColumns, ...]:
    """Arrays with one number a message, in fields of their name."""
    return tuple(LogColumns(attribute, (attribute,)) for attribute in attributes)


_STATE = ("x", "y", "vx", "vy")
_WORLD = ("east", "north", "up")
_BODY = ("x", "y", "z")
_PLANE = ("x", "y")
PLACES = _array("transmitters", "", Ranges._fields, ("east", "north", "depth"))
"""Positions of the transmitters: rear_east, rear_north, rear_depth …"""
POSE_FIELDS = (
    *(f"pose.position.{axis}" for axis in "xyz"),
    *(f"pose.orientation.{axis}" for axis in "xyzw"),
)
"""Numbers of Foxglove's PoseInFrame."""


@cache
def vehicle_state(effectors: tuple[str, ...]) -> RecordType:
    """True state of a vehicle with these effectors, whose states are fields `thrust_…`, in units as
    of `Trajectory.effector_states`: the thrust of `thruster_main` is `thrust_main`.
    """
    short_names = [name.removeprefix("thruster_") for name in effectors]
    return RecordType(
        # vehicles of one log may differ in their effectors
        name=f"VehicleState_{crc32(','.join(effectors).encode()):08x}",
        topic="state",
        columns=(
            *_numbers("time"),
            _array("position", "position", _WORLD),
            _array("quaternion", "quaternion", "wxyz"),
            _array("velocity", "velocity", _WORLD),
            _array("angular_velocity", "angular_velocity", _BODY),
            _array("water_velocity", "water_velocity", _WORLD),
            _array("effector_states", "thrust", short_names),
            # these follow from the others; they are there for plots
            *_numbers("depth", "heading", "pitch", "roll", "forward_speed"),
        ),
    )


FIXED = ("names", "effector_names", "effector_force", "site_names", "site_vehicle", "site_offset")
"""Arrays of a trajectory that do not change in a mission: a log has them as an attachment."""
OWN_MOTION = RecordType(
    name="OwnMotion",
    topic="motion",
    columns=_numbers(*(name for sensor in OWN_SENSORS for name in sensor.channels)),
)
_RECEIVED = (
    _array("message", "leader", LeaderMessage._fields),
    _array("ranges", "range", Ranges._fields),
)
RECEPTION = RecordType(name="Reception", topic="reception", columns=_RECEIVED, steps="message_step")
PLACED_RECEPTION = RecordType(
    name="PlacedReception", topic="reception", columns=(*_RECEIVED, PLACES)
)
"""A reception with the positions of the transmitters; of beacons and buoys, in logs of vehicles."""
BEACON_RECEPTION = RecordType(
    name="PlacedReception",
    topic="reception",
    columns=(*_RECEIVED, PLACES),
    steps="message_step",
)
"""The same in logs of flights."""
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
        LogColumns("fix_sigma", ("sigma",)),
        _array("innovation", "innovation", _PLANE),
        _array("innovation_covariance", "innovation_covariance", _PLANE, _PLANE),
        LogColumns("fix_kind", ("kind",), integer=True),
    ),
    steps="fix_step",
)
DETAILS = {
    kind: RecordType(
        name=details.name.title(), topic=details.name, columns=details.columns, steps="fix_step"
    )
    for kind in {spec.estimates: None for spec in NAVIGATORS.values()}
    if (details := kind.DETAILS)
}
"""What navigators log of each message beside the fix, by the class of their estimates."""
ERROR = RecordType(name="Error", topic="error", columns=_numbers("position_error", "bearing_error"))
POSITION_ERROR = RecordType(name="PositionError", topic="error", columns=_numbers("position_error"))
"""Of the leader's own estimate: it has no bearing from itself."""
MEASURED = (OWN_MOTION, RECEPTION)
"""Channels of a follower's measurements; the first has a message at every filter step."""
MEASURED_AMONG_BEACONS = (OWN_MOTION, BEACON_RECEPTION)
"""The same where the transmitters are beacons."""
SENSORS = "sensors"
"""Metadata record with the channels and the rates of further sensors by their names."""
SENSOR = "sensor/"
"""Beginning of the topics of readings of further sensors, after the vehicle's name."""


@cache
def custom_reading(sensor: str, channels: tuple[str, ...]) -> RecordType:
    """Readings of a further sensor of this name, with channels of these names."""
    # sensors of one log may have different channels
    key = sensor if channels == SensorHeader().names(len(channels)) else f"{sensor} {channels}"
    return RecordType(
        name=f"Reading_{crc32(key.encode()):08x}_{len(channels)}",
        topic=f"{SENSOR}{sensor}",
        columns=(LogColumns("reading", channels, (len(channels),)),),
    )


LINK = "link/"
"""Beginning of the topics of messages of further links, after the vehicle's name."""
ROUND_TRIP = "round_trip"
"""Field of the round trip of an answer [s]."""


def content_fields(sensor: str, channels: Sequence[str]) -> tuple[str, ...]:
    """Fields of the readings of a sender's sensor in its messages."""
    return tuple(f"{name_in_fields(sensor)}__{channel}" for channel in channels)


@cache
def link_reception(
    link: str,
    *,
    with_position: bool = False,
    with_round_trip: bool = False,
    content: tuple[tuple[str, tuple[str, ...]], ...] = (),
) -> RecordType:
    """Messages of a further link, perhaps with places of beacons, round trips of answers, and
    readings of the sender's sensors, by name and channels.
    """
    columns = [*_RECEIVED]
    if with_position:
        columns.append(PLACES)
    if with_round_trip:
        columns += _numbers(ROUND_TRIP)
    for sensor, channels in content:
        columns.append(LogColumns(sensor, content_fields(sensor, channels), (len(channels),)))
    # links of one log may hold different fields
    names = ",".join(name for array in columns for name in array.names)
    return RecordType(
        name=f"LinkReception_{crc32(names.encode()):08x}",
        topic=f"{LINK}{link}",
        columns=tuple(columns),
        steps="message_step",
    )


def header_text(header: SensorHeader) -> str:
    """What is known of a sensor's readings, as JSON."""
    return json.dumps({"channels": dict(header.channels), "period_s": header.period})


def header_of_text(text: str) -> SensorHeader:
    """What `header_text` wrote."""
    table = json.loads(text)
    channels = tuple(Channel(name, unit) for name, unit in table["channels"].items())
    return SensorHeader(channels=channels, period=float(table["period_s"]))


def estimated(kind: type) -> tuple[RecordType, ...]:
    """Channels of estimates of this class: states, fixes, and the details that such navigators
    log.
    """
    types = (FILTER_STATE, FIX)
    return (*types, DETAILS[kind]) if kind in DETAILS else types

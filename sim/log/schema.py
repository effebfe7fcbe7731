"""Messages of the log: numeric types described at run time, and their numbers as columns of bytes."""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from typing import Any, Self
from zlib import crc32

import numpy as np
import numpy.typing as npt
from foxglove import Schema
from foxglove.messages import Timestamp
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.well_known import SchemaEncoding

from laisn.arrays import Bytes, Ints
from laisn.messages import LeaderMessage, Ranges
from laisn.messages import OwnMotion as OwnMotionTuple
from laisn.tight.estimates import HYPOTHESES, TightEstimates

STATE_NAMES = ("x", "y", "vx", "vy")
"""Order of the filter's state."""


_STAMP_S, _STAMP_NS = 2**32 - 1, 999_999_999
STAMP = Timestamp(sec=_STAMP_S, nsec=_STAMP_NS)
"""Stands where the time of a message goes; both numbers take five bytes."""
_STAMP = timestamp_pb2.Timestamp(seconds=_STAMP_S, nanos=_STAMP_NS)


def slot(k: int) -> float:
    """A number that stands, in a message that a `FixedLayout` is made from, where column k of the values goes."""
    return float(struct.unpack("<d", _slot_bytes(k))[0])


def _slot_bytes(k: int) -> bytes:
    return b"slots" + struct.pack("<H", k) + b"\x42"


def _slot_integer(k: int) -> int:
    return int.from_bytes(_slot_bytes(k), "little")


def _positions(pattern: bytes, data: bytes) -> Iterator[int]:
    start = data.find(pattern)
    while start >= 0:
        yield start
        start = data.find(pattern, start + len(pattern))


def _varints(values: Ints) -> Bytes:
    """Numbers below 2³⁵ as protobuf varints of five bytes each, shape (n, 5).

    Shorter ones are padded with zero groups, which the wire format allows, so that all messages are equally long.
    """
    groups = (values[:, None] >> np.arange(0, 35, 7)) & 0x7F
    groups[:, :4] |= 0x80
    return groups.astype(np.uint8)


def _fill_slots(message: Any, prefix: str, kinds: dict[str, str]) -> None:
    """Put a slot into every number of eight bytes of a protobuf message, and note its name and type."""
    for field in message.DESCRIPTOR.fields:
        if field.is_repeated or (field.has_presence and not message.HasField(field.name)):
            continue
        name = f"{prefix}{field.name}"
        if field.type == field.TYPE_DOUBLE:
            setattr(message, field.name, slot(len(kinds)))
            kinds[name] = "<f8"
        elif field.type in (field.TYPE_SFIXED64, field.TYPE_FIXED64):
            setattr(message, field.name, _slot_integer(len(kinds)))
            kinds[name] = "<i8" if field.type == field.TYPE_SFIXED64 else "<u8"
        elif field.message_type is not None:
            inner = getattr(message, field.name)
            if field.message_type.full_name == _STAMP.DESCRIPTOR.full_name:
                inner.ParseFromString(_STAMP.SerializeToString())
            else:
                _fill_slots(inner, f"{name}.", kinds)


class FixedLayout:
    """Serialised messages of one length that differ in their times and in numbers of eight bytes only.

    Columns of numbers are copied to and from such messages as bytes, without a protobuf object for each message.

    Args:
        data: a serialised message with `slot(k)` for the numbers and `STAMP` for the times.
        columns: number of slots; each must occur.
    """

    def __init__(self, data: bytes, columns: int) -> None:
        self._bytes = np.frombuffer(data, dtype=np.uint8)
        self._stamps = list(_positions(_STAMP.SerializeToString(), data))
        self._slots = [list(_positions(_slot_bytes(k), data)) for k in range(columns)]
        missing = [k for k, places in enumerate(self._slots) if not places]
        if missing:
            raise ValueError(f"the message has no slot for columns {missing}")
        self.first: Any = None
        self.offsets: dict[str, tuple[int, str]] = {}

    @classmethod
    def of(cls, message: Any) -> Self:
        """The layout of messages that are like a protobuf message: numbers by the names of their fields."""
        kinds: dict[str, str] = {}
        slots = type(message)()
        slots.CopyFrom(message)
        _fill_slots(slots, "", kinds)
        layout = cls(slots.SerializeToString(), len(kinds))
        layout.first = message
        layout.offsets = {name: (layout._slots[k][0], kind) for k, (name, kind) in enumerate(kinds.items())}
        return layout

    def rows(self, time_ns: Ints, values: npt.NDArray[Any]) -> list[bytes]:
        """One serialised message a row.

        Args:
            time_ns: since 1970, shape (n,), [ns].
            values: shape (n, columns), of eight bytes each; integers keep their bits in a float64 view.
        """
        n, length = time_ns.size, self._bytes.size
        block = np.empty((n, length), dtype=np.uint8)
        block[:] = self._bytes
        seconds, nanos = np.divmod(time_ns, 1_000_000_000)
        for place in self._stamps:
            block[:, place + 1 : place + 6] = _varints(seconds)
            block[:, place + 7 : place + 12] = _varints(nanos)
        columns = np.ascontiguousarray(values, dtype="<f8").view(np.uint8).reshape(*values.shape, 8)
        for k, places in enumerate(self._slots):
            for place in places:
                block[:, place : place + 8] = columns[:, k]
        whole = block.tobytes()
        return [whole[i : i + length] for i in range(0, n * length, length)]

    def fits(self, data: bytearray, size: int) -> bool:
        """Whether messages of `size` bytes, one behind the other, all have this layout."""
        if size != self._bytes.size:
            return False
        constant = np.ones(size, dtype=np.bool_)
        for place in self._stamps:
            constant[place + 1 : place + 6] = constant[place + 7 : place + 12] = False
        for places in self._slots:
            for place in places:
                constant[place : place + 8] = False
        block = np.frombuffer(data, dtype=np.uint8).reshape(-1, size)
        return bool(np.all(block[:, constant] == self._bytes[constant]))

    def column(self, data: bytearray, name: str) -> npt.NDArray[Any]:
        """The numbers of a field in messages that this layout fits, shape (n,)."""
        offset, kind = self.offsets[name]
        place = np.dtype({"names": ["x"], "formats": [kind], "offsets": [offset], "itemsize": self._bytes.size})
        return np.frombuffer(data, dtype=place)["x"].copy()


@dataclass(frozen=True)
class ScalarSchema:
    """A message of a timestamp (field 1) and numbers (fields 2 …) in the package `laisn`."""

    name: str
    fields: tuple[str, ...]
    """All float64, in SI units and radians."""
    integers: tuple[str, ...] = ()
    """Further fields, int64 of fixed size."""

    @property
    def full_name(self) -> str:
        """Name of the type in the log."""
        return f"laisn.{self.name}"

    @cached_property
    def message_class(self) -> Any:
        """The protobuf class."""
        kind = descriptor_pb2.FieldDescriptorProto
        file = descriptor_pb2.FileDescriptorProto(
            name=f"laisn/{self.name}.proto",
            package="laisn",
            syntax="proto3",
            dependency=["google/protobuf/timestamp.proto"],
        )
        message = file.message_type.add(name=self.name)
        message.field.add(
            name="timestamp",
            number=1,
            type=kind.TYPE_MESSAGE,
            type_name=".google.protobuf.Timestamp",
            label=kind.LABEL_OPTIONAL,
        )
        types = [(f, kind.TYPE_DOUBLE) for f in self.fields] + [(f, kind.TYPE_SFIXED64) for f in self.integers]
        for number, (field, type_) in enumerate(types, start=2):
            message.field.add(name=field, number=number, type=type_, label=kind.LABEL_OPTIONAL)
        pool = descriptor_pool.Default()
        pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(self.full_name))

    @cached_property
    def schema(self) -> Schema:
        """The type as a log holds it: with the descriptors of all files that it needs."""
        file = self.message_class.DESCRIPTOR.file
        files = descriptor_pb2.FileDescriptorSet()
        for needed in (*file.dependencies, file):
            needed.CopyToProto(files.file.add())
        return Schema(name=self.full_name, encoding=SchemaEncoding.Protobuf, data=files.SerializeToString())

    @cached_property
    def layout(self) -> FixedLayout:
        """Serialises rows of `fields` followed by `integers`."""
        slots = {f: slot(k) for k, f in enumerate(self.fields)}
        slots |= {f: _slot_integer(k) for k, f in enumerate(self.integers, start=len(self.fields))}
        return FixedLayout(self.message_class(timestamp=_STAMP, **slots).SerializeToString(), len(slots))


def _prefixed(prefix: str, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{prefix}_{name}" for name in names)


def _matrix(name: str, axes: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{name}_{row}_{column}" for row, column in product(axes, axes))


VELOCITY = _prefixed("velocity", ("east", "north", "up"))
ANGULAR_VELOCITY = _prefixed("angular_velocity", ("x", "y", "z"))
WATER_VELOCITY = _prefixed("water_velocity", ("east", "north", "up"))
DERIVED = ("depth", "heading", "pitch", "roll", "forward_speed")
"""Follow from pose and velocity; they are there for plots, and ignored on reading."""
LEADER_MESSAGE = _prefixed("leader", LeaderMessage._fields)
RANGES = _prefixed("range", Ranges._fields)
COVARIANCE = _matrix("covariance", STATE_NAMES)
INNOVATION = _prefixed("innovation", ("x", "y"))
INNOVATION_COVARIANCE = _matrix("innovation_covariance", ("x", "y"))

TRANSMITTERS = tuple(f"{place}_{axis}" for place in Ranges._fields for axis in ("east", "north", "depth"))
"""Positions of the transmitters, if the messages of a vehicle's log hold them: rear_east, rear_north, rear_depth …"""


def thrust_fields(effectors: Sequence[str]) -> tuple[str, ...]:
    """Fields of the thrusts of a vehicle's effectors: `thrust_main` of `thruster_main`."""
    return tuple(f"thrust_{name.removeprefix('thruster_')}" for name in effectors)


@cache
def vehicle_state(effectors: tuple[str, ...]) -> ScalarSchema:
    """Schema of the true state of a vehicle with these effectors."""
    motion = ("time", *VELOCITY, *ANGULAR_VELOCITY, *WATER_VELOCITY)
    # a type of protobuf has one definition in a process, and vehicles differ in their effectors
    name = f"VehicleState_{crc32(','.join(effectors).encode()):08x}"
    return ScalarSchema(name, (*motion, *thrust_fields(effectors), *DERIVED))


OWN_MOTION = ScalarSchema("OwnMotion", OwnMotionTuple._fields)
RECEPTION = ScalarSchema("Reception", (*LEADER_MESSAGE, *RANGES))
PLACED_RECEPTION = ScalarSchema("PlacedReception", (*LEADER_MESSAGE, *RANGES, *TRANSMITTERS))
"""A reception with the positions of the transmitters; of beacons and buoys, in logs of vehicles."""
FILTER_STATE = ScalarSchema("FilterState", (*STATE_NAMES, *COVARIANCE))
FIX = ScalarSchema("Fix", ("x", "y", "sigma", *INNOVATION, *INNOVATION_COVARIANCE), integers=("kind",))
_SIDES = range(1, HYPOTHESES + 1)
STATES = TightEstimates.names
STATE_SIGMAS = _prefixed("sigma", STATES)
WEIGHTS = tuple(f"weight_{h}" for h in _SIDES)
HYPOTHESIS = tuple(f"{axis}_{h}" for h in _SIDES for axis in "xy")
HYPOTHESIS_COVARIANCE = tuple(f"covariance_{h}_{pair}" for h in _SIDES for pair in ("x_x", "x_y", "y_y"))
MIXTURE = ScalarSchema(
    "Mixture",
    ("nis", *STATES, *STATE_SIGMAS, *WEIGHTS, *HYPOTHESIS, *HYPOTHESIS_COVARIANCE),
    integers=("used",),
)
"""States of the tightly coupled navigator after a message, and its hypotheses by weight."""
ERROR = ScalarSchema("Error", ("position_error", "bearing_error"))
SCALAR_SCHEMAS = (vehicle_state(()), OWN_MOTION, RECEPTION, FILTER_STATE, FIX, MIXTURE, ERROR)

"""Messages of the log: scalar types described at run time, and templates that serialise them a column at a time."""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

from laisn.arrays import Bytes, Ints
from laisn.messages import LeaderMessage, Ranges
from laisn.messages import OwnMotion as OwnMotionTuple
from laisn.tight.estimates import HYPOTHESES, TightEstimates

STATE_NAMES = ("x", "y", "vx", "vy")
"""Order of the filter's state."""


def slot(k: int) -> float:
    """A number that stands, in the message a `Template` is made from, where column k of the values goes."""
    return float(struct.unpack("<d", _slot_bytes(k))[0])


def _slot_bytes(k: int) -> bytes:
    return b"slots" + struct.pack("<H", k) + b"\x42"


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


STAMP = timestamp_pb2.Timestamp(seconds=2**34, nanos=2**30 - 1)
"""Stands where the time of a message goes; both numbers take five bytes."""


class Template:
    """Serialised messages that differ in their numbers and times only.

    Python serialises some 10⁵ messages of twenty numbers in a second; copying columns of bytes is twenty times as fast.

    Args:
        message: a protobuf message with `slot(k)` for the numbers and `STAMP` for the times.
        columns: number of slots; each must occur.
    """

    def __init__(self, message: Any, columns: int) -> None:
        data = message.SerializeToString()
        self._bytes = np.frombuffer(data, dtype=np.uint8)
        self._stamps = list(_positions(STAMP.SerializeToString(), data))
        self._slots = [(k, place) for k in range(columns) for place in _positions(_slot_bytes(k), data)]
        missing = set(range(columns)) - {k for k, _ in self._slots}
        if missing:
            raise ValueError(f"the message has no slot for columns {sorted(missing)}")

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
        for k, place in self._slots:
            block[:, place : place + 8] = columns[:, k]
        whole = block.tobytes()
        return [whole[i : i + length] for i in range(0, n * length, length)]


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

    def template(self) -> Template:
        """Serialises rows of `fields` followed by `integers`."""
        message = self.message_class(timestamp=STAMP, **{f: slot(k) for k, f in enumerate(self.fields)})
        for k, field in enumerate(self.integers, start=len(self.fields)):
            setattr(message, field, int.from_bytes(_slot_bytes(k), "little"))
        return Template(message, len(self.fields) + len(self.integers))


def _prefixed(prefix: str, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{prefix}_{name}" for name in names)


def _matrix(name: str, axes: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{name}_{row}_{column}" for row, column in product(axes, axes))


VELOCITY = _prefixed("velocity", ("east", "north", "up"))
ANGULAR_VELOCITY = _prefixed("angular_velocity", ("x", "y", "z"))
WATER_VELOCITY = _prefixed("water_velocity", ("east", "north", "up"))
THRUST = _prefixed("thrust", ("main", "lateral_bow", "lateral_stern", "vertical_bow", "vertical_stern"))
DERIVED = ("depth", "heading", "pitch", "roll", "forward_speed")
"""Follow from pose and velocity; they are there to be plotted, and ignored on reading."""
LEADER_MESSAGE = _prefixed("leader", LeaderMessage._fields)
RANGES = _prefixed("range", Ranges._fields)
COVARIANCE = _matrix("covariance", STATE_NAMES)
INNOVATION = _prefixed("innovation", ("x", "y"))
INNOVATION_COVARIANCE = _matrix("innovation_covariance", ("x", "y"))

TRANSMITTERS = tuple(f"{place}_{axis}" for place in Ranges._fields for axis in ("east", "north", "depth"))
"""Where the transmitters were, if the messages of a vehicle's log say so: rear_east, rear_north, rear_depth …"""

VEHICLE_STATE = ScalarSchema("VehicleState", ("time", *VELOCITY, *ANGULAR_VELOCITY, *WATER_VELOCITY, *THRUST, *DERIVED))
OWN_MOTION = ScalarSchema("OwnMotion", OwnMotionTuple._fields)
RECEPTION = ScalarSchema("Reception", (*LEADER_MESSAGE, *RANGES))
PLACED_RECEPTION = ScalarSchema("PlacedReception", (*LEADER_MESSAGE, *RANGES, *TRANSMITTERS))
"""A reception that says where the transmitters are; of beacons and buoys, in logs that others write."""
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
"""What the tightly coupled navigator believes after a message: all states, and hypotheses by weight."""
ERROR = ScalarSchema("Error", ("position_error", "bearing_error"))
SCALAR_SCHEMAS = (VEHICLE_STATE, OWN_MOTION, RECEPTION, FILTER_STATE, FIX, MIXTURE, ERROR)

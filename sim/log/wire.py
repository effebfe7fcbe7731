"""Compiled readers of bytes: the messages that follow each other in an MCAP file, and the fields of protobuf messages.

A log of hours holds millions of messages. As objects of Python they would take minutes and gigabytes; here they stay
the bytes that they are, with arrays that say where each begins and ends.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor import FieldDescriptor
from mcap.opcode import Opcode

from laisn.arrays import Bools, Bytes, Ints
from laisn.compiled import compiled, inlined

HEAD_BYTES = 9
"""Opcode and length of an MCAP record."""
_MESSAGE, _MESSAGE_BYTES = int(Opcode.MESSAGE), 22
_HELD = np.zeros(256, dtype=np.bool_)
_HELD[[Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.FOOTER]] = True
"""Opcodes of the records at which a scan stops: those that hold something, and the last one."""

VARINT, FIXED64, DELIMITED, FIXED32 = 0, 1, 2, 5
"""Wire types of protobuf."""
_F = FieldDescriptor
_WIRE_TYPES = dict.fromkeys((_F.TYPE_DOUBLE, _F.TYPE_FIXED64, _F.TYPE_SFIXED64), FIXED64)
_WIRE_TYPES |= dict.fromkeys((_F.TYPE_FLOAT, _F.TYPE_FIXED32, _F.TYPE_SFIXED32), FIXED32)
_WIRE_TYPES |= dict.fromkeys((_F.TYPE_STRING, _F.TYPE_BYTES, _F.TYPE_MESSAGE), DELIMITED)


def grouped(numbers: Ints) -> Iterator[tuple[int, Ints]]:
    """Every number that there is, in order, and where it stands."""
    order = np.argsort(numbers, kind="stable")
    edges = np.flatnonzero(np.diff(numbers[order])) + 1
    for places in np.split(order, edges) if order.size else ():
        yield int(numbers[places[0]]), places


class Batch(NamedTuple):
    """Messages that follow each other in some bytes, in the order of the file."""

    data: Bytes
    """The bytes that they lie in."""
    channel: Ints
    """Numbers of their channels, shape (n,)."""
    log_time: Ints
    """Since 1970, shape (n,), [ns]."""
    publish_time: Ints
    start: Ints
    """Where the content of each begins in the bytes, shape (n,)."""
    stop: Ints
    """Where it ends."""
    records: int
    """How many records were passed, messages and others that hold nothing."""
    end: int
    """Where the first record begins that is not whole in these bytes, is no possible message (too short, or of a time
    after 2262), or holds something else."""

    def by_channel(self) -> Iterator[tuple[int, Ints]]:
        """Numbers of the channels, and which messages are theirs."""
        return grouped(self.channel)

    def each(self) -> Iterator[tuple[int, int, int, bytes]]:
        """One message after the other: channel, log and publish time [ns], and content."""
        content = memoryview(self.data.data)
        for channel, log_time, publish_time, start, stop in zip(*(x.tolist() for x in self[1:6]), strict=True):
            yield channel, log_time, publish_time, bytes(content[start:stop])


@inlined
def _number(data: Bytes, at: int, size: int) -> Any:
    value = np.uint64(0)
    for i in range(size):
        value |= np.uint64(data[at + i]) << np.uint64(8 * i)
    return np.int64(value)


@compiled
def _scan(data: Bytes, at: int, held: Bools, found: Ints) -> tuple[int, int, int]:
    """Rows of `found` (channel, log time, publish time, start, stop) that were filled, records passed, and the end."""
    count = records = 0
    while at + HEAD_BYTES <= data.size and count < found.shape[1] and not held[data[at]]:
        length = _number(data, at + 1, 8)
        start = at + HEAD_BYTES
        if length < 0 or length > data.size - start:
            break
        if data[at] == _MESSAGE:
            if length < _MESSAGE_BYTES or _number(data, start + 6, 8) < 0:
                break
            found[0, count] = _number(data, start, 2)
            found[1, count] = _number(data, start + 6, 8)
            found[2, count] = _number(data, start + 14, 8)
            found[3, count] = start + _MESSAGE_BYTES
            found[4, count] = start + length
            count += 1
        records += 1
        at = start + length
    return count, records, at


def scan(data: Bytes, at: int) -> Batch:
    """Messages from a place on, up to where something else must look: some tens of thousands at most.

    Args:
        data: of a file or a chunk, shape (bytes,).
        at: where a record begins.
    """
    most = min(1 << 16, (data.size - at) // (HEAD_BYTES + _MESSAGE_BYTES) + 1)
    found = np.empty((5, most), dtype=np.int64)
    count, records, end = _scan(data, at, _HELD, found)
    channel, log_time, publish_time, start, stop = found[:, :count]
    return Batch(data, channel, log_time, publish_time, start, stop, records, end)


@compiled
def gather(data: Bytes, start: Ints, stop: Ints) -> Bytes:
    """Stretches of bytes one behind the other, shape (sum of stop - start,)."""
    result = np.empty(np.sum(stop - start), dtype=np.uint8)
    at = 0
    for i in range(start.size):
        for j in range(start[i], stop[i]):
            result[at] = data[j]
            at += 1
    return result


@compiled
def framed(time_ns: Ints, data: Bytes, start: Ints, stop: Ints) -> Bytes:
    """Messages one behind the other, each after its time and its length, of eight bytes, least significant first."""
    result = np.empty(np.sum(stop - start) + 16 * start.size, dtype=np.uint8)
    at = 0
    for i in range(start.size):
        for number in (time_ns[i], stop[i] - start[i]):
            for _ in range(8):
                result[at] = number & 0xFF
                number >>= 8
                at += 1
        for j in range(start[i], stop[i]):
            result[at] = data[j]
            at += 1
    return result


@inlined
def _varint(data: Bytes, at: int, stop: int) -> tuple[Any, Any]:
    """A number and where it ends; -1 where it does not end in time."""
    value, shift, end = np.uint64(0), 0, -1
    while at < stop and shift < 70 and end < 0:
        value |= np.uint64(data[at] & 0x7F) << np.uint64(shift)
        at += 1
        shift += 7
        if not data[at - 1] & 0x80:
            end = at
    return np.int64(value), end


@compiled
def _find(data: Bytes, start: Ints, stop: Ints, tag: int, value: Ints, end: Ints) -> int:
    """Fill in the last value of a field; the number of messages that are well-formed up to the first that is not.

    The value of a delimited field is where it begins. Where a field is not there, its end is left as it was.
    """
    for i in range(start.size):
        at = start[i]
        while at < stop[i]:
            found, at = _varint(data, at, stop[i])
            if at < 0 or not 8 <= found < 1 << 32:
                return i
            kind = found & 7
            number = np.int64(0)
            if kind == VARINT:
                number, at = _varint(data, at, stop[i])
            elif kind == FIXED64 and stop[i] - at >= 8:
                number = _number(data, at, 8)
                at += 8
            elif kind == FIXED32 and stop[i] - at >= 4:
                number = _number(data, at, 4)
                at += 4
            elif kind == DELIMITED:
                length, at = _varint(data, at, stop[i])
                if at < 0 or length < 0 or length > stop[i] - at:
                    return i
                number = at
                at += length
            else:
                return i
            if at < 0:
                return i
            if found == tag:
                value[i] = number
                end[i] = at
    return start.size


class Field(NamedTuple):
    """What was found of one field in n messages."""

    value: Ints
    """The bits of a number, or where texts, bytes and messages begin, shape (n,)."""
    end: Ints
    """Where it ends; 0 where the field is not there."""


def find(data: Bytes, start: Ints, stop: Ints, field: Any) -> Field:
    """Where a field lies in messages, and what bits it has; of several values in a message the last one counts.

    Args:
        data: bytes, shape (bytes,).
        start: where each message begins in them, shape (n,).
        stop: where it ends.
        field: protobuf descriptor.

    Raises:
        ValueError: a message is malformed, or the field is a list.
    """
    if field.is_repeated:
        raise ValueError(f"field {field.name} is a list, expected one value")
    tag = field.number << 3 | _WIRE_TYPES.get(field.type, VARINT)
    value, end = np.zeros_like(start), np.zeros_like(start)
    well = _find(data, start, stop, tag, value, end)
    if well < start.size:
        raise ValueError(f"message {well} is no protobuf message")
    return Field(value, end)


def numbers(found: Field, field: Any) -> npt.NDArray[Any]:
    """The values of a number, truth value or enumeration; its default where it is not there, shape (n,).

    Raises ValueError if the field holds something else.
    """
    bits, low = found.value.view(np.uint64), found.value.astype(np.uint32)
    match field.type:
        case _F.TYPE_DOUBLE:
            values: npt.NDArray[Any] = bits.view(np.float64)
        case _F.TYPE_FLOAT:
            values = low.view(np.float32).astype(np.float64)
        case _F.TYPE_INT64 | _F.TYPE_SFIXED64:
            values = found.value
        case _F.TYPE_UINT64 | _F.TYPE_FIXED64:
            values = bits
        case _F.TYPE_INT32 | _F.TYPE_SFIXED32 | _F.TYPE_ENUM:
            values = low.view(np.int32).astype(np.int64)
        case _F.TYPE_UINT32 | _F.TYPE_FIXED32:
            values = low.astype(np.uint64)
        case _F.TYPE_SINT32:
            values = ((low >> 1).view(np.int32) ^ -(low & 1).view(np.int32)).astype(np.int64)
        case _F.TYPE_SINT64:
            values = (bits >> np.uint64(1)).view(np.int64) ^ -(bits & np.uint64(1)).view(np.int64)
        case _F.TYPE_BOOL:
            values = bits != 0
        case _:
            raise ValueError(f"field {field.name} holds no numbers")
    return np.where(found.end > 0, values, np.asarray(field.default_value, dtype=values.dtype))

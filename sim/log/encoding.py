"""Serialised messages of Foxglove's types that hold a time, texts and numbers, many at once.

The SDK encodes one message at a time, which takes most of the time of a log. Here it encodes one
example, into whose bytes the numbers of all others are written. Protobuf leaves out what is zero:
there is an example for each set of numbers that are.
"""

import struct
from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache

import numpy as np
from foxglove import messages as fg

from laisn.arrays import Floats, Ints
from sim.log.schema import timestamp

Encode = Callable[[int, Sequence[float]], bytes]
"""Serialises a message of a time since 1970 [ns] and its c numbers, with the SDK."""
_TIME_NS = 10**9  # of examples


@lru_cache(maxsize=8192)
def _time_field(time_ns: int) -> bytes:
    """The first field of messages whose first field is their time."""
    return fg.PoseInFrame(timestamp=timestamp(time_ns)).encode()


def repeated(messages: Iterable[bytes]) -> bytes:
    """A message whose only field, of number 1, repeats these messages."""
    return b"".join(b"\x0a" + _length_prefix(len(message)) + message for message in messages)


@cache
def _length_prefix(length: int) -> bytes:
    """A length as protobuf writes it, seven bits a byte."""
    prefix = bytearray()
    while length > 0x7F:
        prefix.append(length & 0x7F | 0x80)
        length >>= 7
    prefix.append(length)
    return bytes(prefix)


class TimedNumbers:
    """Encodes messages of one type whose first field is their time."""

    def __init__(self, encode: Encode) -> None:
        """Take what encodes one message; its texts are the same in all."""
        self._encode = encode
        self._example = cache(self._make_example)

    def _make_example(self, zero: tuple[bool, ...]) -> tuple[bytes, list[int]]:
        """What follows the time in a message with zeros at these numbers, and where the others
        stand in it.
        """
        numbers = [0.0 if is_zero else 1.0 + k / 64.0 for k, is_zero in enumerate(zero)]
        example = self._encode(_TIME_NS, numbers)[len(_time_field(_TIME_NS)) :]
        encoded = [struct.pack("<d", number) for number in numbers if number]
        if any(example.count(number) != 1 for number in encoded):
            raise AssertionError("a number of the example does not stand in its message once")
        return example, [example.index(number) for number in encoded]

    def rows(self, time_ns: Ints, numbers: Floats) -> list[bytes]:
        """Serialised messages of times since 1970, shape (n,), [ns], and numbers, shape (n, c)."""
        rests = np.empty(len(numbers), dtype=object)
        zero = numbers == 0.0
        # a bit for each number that is zero
        patterns = zero @ (1 << np.arange(numbers.shape[1]))
        for pattern in set(patterns.tolist()):
            rows = np.flatnonzero(patterns == pattern)
            is_zero = zero[rows[0]]
            example, offsets = self._example(tuple(is_zero.tolist()))
            block = np.tile(np.frombuffer(example, dtype=np.uint8), (rows.size, 1))
            columns = np.ascontiguousarray(numbers[np.ix_(rows, np.flatnonzero(~is_zero))], "<f8")
            as_bytes = columns.view(np.uint8).reshape(rows.size, -1, 8)
            for k, offset in enumerate(offsets):
                block[:, offset : offset + 8] = as_bytes[:, k]
            encoded = block.tobytes()
            size = len(example)
            for k, row in enumerate(rows.tolist()):
                rests[row] = encoded[k * size : (k + 1) * size]
        return [
            _time_field(time) + fields
            for time, fields in zip(time_ns.tolist(), rests.tolist(), strict=True)
        ]

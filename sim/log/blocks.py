"""An MCAP file that grows by blocks of mission time, each of which is in the file before the next
one begins.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import foxglove
import numpy as np
from foxglove.mcap import MCAPWriteOptions, MCAPWriter
from mcap.well_known import MessageEncoding

from laisn.arrays import Ints

# mission time of a block [ns]: what was logged of it is in the file before more is logged
BLOCK_NS = 20 * 10**9
END_NS = 2**62  # later than all messages [ns]


class LogChannel(NamedTuple):
    """Messages of one topic, in order of time."""

    topic: str
    schema: foxglove.Schema
    time_ns: Ints  # time of each message since 1970, shape (n,), [ns]
    serialised: Callable[[slice], Iterable[bytes]]  # messages of a stretch of rows


class _Buffer(BytesIO):
    """What was written since the last `take`; positions count from the start of the file."""

    taken = 0  # bytes that were taken; positions before their end cannot be reached

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        return self.taken + super().seek(
            offset - (self.taken if whence == os.SEEK_SET else 0), whence
        )

    def take(self) -> bytes:
        data = self.getvalue()
        super().seek(0)
        self.truncate()
        self.taken += len(data)
        return data


class BlockFile:
    """An MCAP file under way. Unless `finish` succeeds, it stays without an end."""

    def __init__(self, path: Path) -> None:
        """Open a new file; OSError if it cannot be written."""
        options = MCAPWriteOptions(compression_threads=0, compression_level=1, disable_seeking=True)
        self._buffer = _Buffer()
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._file = path.open("wb")
        # the SDK only logs errors of its output, and does not survive the exceptions of signals,
        # which the main thread gets
        self._thread = ThreadPoolExecutor(1)
        self._mcap: MCAPWriter = self._call(
            partial(foxglove.open_mcap, self._buffer, context=self._context, writer_options=options)
        )

    def _call(self, function: Callable[[], Any]) -> Any:
        """Call the SDK in its thread, and wait for the result."""
        try:
            future = self._thread.submit(function)
        except RuntimeError:
            # the interpreter is at its end: there are no threads any more, and no signals
            return function()
        return future.result()

    def describe(self, write: Callable[[MCAPWriter], None]) -> None:
        """Write attachments and metadata, which are in the file with the next block."""
        self._call(partial(write, self._mcap))

    def append(
        self, channels: Sequence[LogChannel], begin_ns: int = 0, end_ns: int = END_NS
    ) -> None:
        """Write the messages of all channels from one time until before another, in order of time.

        A channel without messages is not in the file.
        """
        for channel in channels:
            if channel.topic not in self._channels:
                self._channels[channel.topic] = foxglove.Channel(
                    channel.topic,
                    schema=channel.schema,
                    message_encoding=MessageEncoding.Protobuf,
                    context=self._context,
                )
        block_numbers = {
            number
            for channel in channels
            for number in np.unique(_between(channel, begin_ns, end_ns)[1] // BLOCK_NS).tolist()
        }
        for number in sorted(block_numbers):
            span = (max(number * BLOCK_NS, begin_ns), min((number + 1) * BLOCK_NS, end_ns))
            self.append_block(channels, span)

    def append_block(
        self, channels: Sequence[LogChannel], span: tuple[int, int] = (0, END_NS)
    ) -> None:
        """Write the messages of `span` (from one time until before another, [ns]) as one block,
        also if they are earlier than what the file already has. Each channel must have been given
        to `append` before.
        """
        self._call(partial(self._fill, channels, span))
        self._flush()

    def _fill(self, channels: Sequence[LogChannel], span: tuple[int, int]) -> None:
        times = list[Ints]()
        messages = list[bytes]()
        senders = list[Callable[[bytes, int], None]]()
        for channel in channels:
            rows, channel_times = _between(channel, *span)
            times.append(channel_times)
            messages += channel.serialised(rows)
            senders += [self._channels[channel.topic].base.log] * channel_times.size
        time_ns = np.concatenate(times) if times else np.empty(0, dtype=np.int64)
        if len(messages) != time_ns.size:
            raise AssertionError("a channel has not one message for each of its times")
        # messages of equal times stay in the order of channels
        order = np.argsort(time_ns, kind="stable")
        for i, message_time_ns in zip(order.tolist(), time_ns[order].tolist(), strict=True):
            senders[i](messages[i], message_time_ns)
        self._mcap.flush()

    def _flush(self) -> None:
        self._file.write(self._buffer.take())
        self._file.flush()

    def abandon(self) -> None:
        """Close the file as it is, without an end."""
        try:
            self._call(self._mcap.close)
        finally:
            self._thread.shutdown()
            self._file.close()

    def finish(self) -> None:
        """Write the end of the file, and close it when the system has all of it."""
        self._call(self._mcap.close)
        self._flush()
        os.fsync(self._file.fileno())
        self._thread.shutdown()
        self._file.close()


def _between(channel: LogChannel, begin_ns: int, end_ns: int) -> tuple[slice, Ints]:
    """Rows of the messages from one time until before another, and their times [ns]."""
    rows = slice(*np.searchsorted(channel.time_ns, [begin_ns, end_ns]).tolist())
    return rows, channel.time_ns[rows]

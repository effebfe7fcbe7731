"""The channels of a log, streamed to Foxglove while the mission is flown."""

from typing import Any

import foxglove
from mcap.well_known import MessageEncoding

from laisn.errors import LaisnError
from sim.flight import FlightRecord
from sim.log.blocks import LogChannel
from sim.log.writer import channels

HOST = "127.0.0.1"
PORT = 8765  # where Foxglove looks for a server
_BACKLOG_MESSAGES = 65_536  # messages that wait for a client
_LOG = "/log"
_STATIC = "/tf_static"


class FoxgloveStream:
    """A server of this machine alone that gets each message of a flight's log once; transforms that
    never change are sent again with every call, for clients that come later.
    """

    def __init__(self, port: int = PORT) -> None:
        """Serve on a port, 0: any that is free; LaisnError if it is taken."""
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="LAISN-Sim",
                host=HOST,
                port=port,
                context=self._context,
                message_backlog_size=_BACKLOG_MESSAGES,
            )
        except RuntimeError as error:
            raise LaisnError(f"port {port} for Foxglove: {error}") from None
        self._begin()

    def _begin(self) -> None:
        self._writers: dict[str, Any] = {}  # Foxglove's channels by topic
        self._sent: dict[str, int] = {}  # how many messages were sent, by topic

    @property
    def address(self) -> str:
        """What Foxglove opens as a connection."""
        return f"ws://{HOST}:{self._server.port}"

    def begin(self) -> None:
        """Another mission begins: its messages are sent from their first."""
        for writer in self._writers.values():
            writer.close()
        self._begin()
        self._server.clear_session()

    def show(self, flight: FlightRecord, *, is_over: bool = False) -> None:
        """Send what has been added to a mission's flight since the last call."""
        # time, sender of the channel, and content of each message
        messages = list[tuple[int, Any, bytes]]()
        for channel in channels(flight):
            count = channel.time_ns.size
            if channel.topic == _LOG and not is_over:
                count -= 1  # the last line tells how the mission ended
            first = self._sent.get(channel.topic, 0)
            if channel.topic == _STATIC:
                first = 0  # for clients that come later
            if count <= first:
                continue
            self._sent[channel.topic] = count
            send = self._writer(channel).log
            rows = slice(first, count)
            times = channel.time_ns[rows].tolist()
            messages += [
                (time_ns, send, row)
                for time_ns, row in zip(times, channel.serialised(rows), strict=True)
            ]
        messages.sort(key=lambda message: message[0])
        for time_ns, send, row in messages:
            send(row, time_ns)

    def _writer(self, channel: LogChannel) -> Any:
        """Foxglove's channel of a topic; the base, which takes bytes alone."""
        if channel.topic not in self._writers:
            self._writers[channel.topic] = foxglove.Channel(
                channel.topic,
                schema=channel.schema,
                message_encoding=MessageEncoding.Protobuf,
                context=self._context,
            )
        return self._writers[channel.topic].base

    def close(self) -> None:
        """Serve no more."""
        self._server.stop()

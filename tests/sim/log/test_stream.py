"""Channels that are streamed while a mission is flown, as a client of Foxglove's protocol gets
them.
"""

import base64
import dataclasses
import json
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove.messages import PoseInFrame
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import ClientConnection, connect

from laisn.errors import LaisnError
from sim.flight import FlightRecord, Termination
from sim.log.stream import FoxgloveStream
from sim.log.writer import channels
from tests.laisn_sim.test_live import listening_addresses
from tests.synthetic import make_flight

PROTOCOLS: Any = ["foxglove.sdk.v1"]
MESSAGE_DATA = 1


class Client:
    """A client that subscribes to all channels, and what it gets, by topic."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.topics: dict[int, str] = {}
        self.advertised: dict[str, Any] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}

    def receive_until(self, count: int) -> None:
        """Subscribe to what is advertised and read until so many messages have come."""
        while sum(map(len, self.messages.values())) < count:
            data = self.socket.recv(timeout=20)
            if isinstance(data, str):
                self._subscribe(json.loads(data))
            elif data[0] == MESSAGE_DATA:
                subscription, time_ns = struct.unpack_from("<IQ", data, 1)
                self.messages.setdefault(self.topics[subscription], []).append((time_ns, data[13:]))

    def _subscribe(self, event: dict[str, Any]) -> None:
        if event["op"] != "advertise":
            return
        for channel in event["channels"]:
            self.advertised[channel["topic"]] = channel
            self.topics[channel["id"]] = channel["topic"]
        ids = [channel["id"] for channel in event["channels"]]
        subscriptions = [{"id": number, "channelId": number} for number in ids]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))


@pytest.fixture
def stream() -> Iterator[FoxgloveStream]:
    stream = FoxgloveStream(0)
    yield stream
    stream.close()


def with_outcome(flight: FlightRecord, outcome: Termination) -> FlightRecord:
    return dataclasses.replace(flight, outcome=outcome)


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="no table of sockets")
def test_foxglove_is_served_on_this_machine_alone(stream: FoxgloveStream) -> None:
    assert listening_addresses(int(stream.address.rpartition(":")[2])) == ["0100007F"]


def test_a_port_that_is_taken_is_refused(stream: FoxgloveStream) -> None:
    port = int(stream.address.rpartition(":")[2])
    with pytest.raises(LaisnError, match=f"port {port} for Foxglove"):
        FoxgloveStream(port)


def test_a_client_gets_the_channels_of_the_log(stream: FoxgloveStream) -> None:
    """What is streamed after a client has come are the very messages that the log would hold."""
    flight = make_flight(6.0)
    begun = with_outcome(make_flight(2.0), Termination.INTERRUPTED)
    stream.show(begun)  # advertises
    sent_before = {channel.topic: channel.time_ns.size for channel in channels(begun, (), ())}
    sent_before["/log"] -= 1
    sent_before["/tf_static"] = 0
    expected = {
        channel.topic: [
            *zip(channel.time_ns.tolist(), channel.serialised(slice(None)), strict=True)
        ][sent_before.get(channel.topic, 0) :]
        for channel in channels(with_outcome(flight, Termination.COMPLETED), (), ())
        if channel.time_ns.size
    }
    with connect(stream.address, subprotocols=PROTOCOLS, max_size=None) as socket:
        client = Client(socket)
        while not client.advertised:
            client._subscribe(json.loads(str(socket.recv(timeout=20))))
        # a subscription is answered by nothing: what is sent at once could be missed
        time.sleep(0.5)
        stream.show(with_outcome(flight, Termination.COMPLETED), is_over=True)
        client.receive_until(sum(map(len, expected.values())))
    assert set(client.messages) == {topic for topic, messages in expected.items() if messages}
    for topic, messages in client.messages.items():
        assert messages == expected[topic], topic
    # by the schema that was advertised, the last pose is where the leader is
    pose = decoded(client.advertised["/leader/pose"], client.messages["/leader/pose"][-1][1])
    position = [getattr(pose.pose.position, axis) for axis in "xyz"]
    np.testing.assert_allclose(position, flight.trajectory.position[-1, 0], atol=1e-9)


def decoded(channel: dict[str, Any], data: bytes) -> Any:
    """A message by the schema of its channel."""
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    assert channel["schemaName"] == PoseInFrame.get_schema().name
    type_ = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    return type_.FromString(data)

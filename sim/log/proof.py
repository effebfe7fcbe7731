"""Digests by which a log that is read back proves that it is what was written, and how far it is.

Checksums protect single records of a log; they say nothing of one that is missing, doubled, or written anew by another
program. So every ten seconds of mission the writer adds a metadata record, "proof 0", "proof 1" …, with digests of all
that belongs to the flight up to then: each of its channels, the attachments and the other metadata. The last one also
says how the mission ended.
"""

import hashlib
import json
import struct
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any, Self

from mcap.records import Schema, Statistics
from mcap.writer import CompressionType, Writer

from sim.log.chunks import CHUNK_BYTES, Chunk

CORE = ("/pose", "/state", "/motion", "/reception", "/filter", "/innovation")
"""How the topics end that make up a flight; everything else in its log is drawn from them."""
MIXTURE = "/mixture"
"""How the topic ends that is there too if the flight was navigated by ranges themselves."""
PROOF = "proof "
"""How the names of these metadata records begin."""
LIBRARY = "laisn-sim"
"""Who wrote a log, in its header; a program that writes it anew puts its own name there."""
_MESSAGE = struct.Struct("<QQ")
_DIGEST_BYTES = 16


def is_core(topic: str) -> bool:
    """Whether a channel belongs to the flight."""
    return topic.endswith((*CORE, MIXTURE))


class Digests:
    """Running digests of channels, by topic, and of attachments and metadata, by "attachment NAME" and so on."""

    def __init__(self) -> None:
        self._running: dict[str, Any] = {}

    def _add(self, name: str, *parts: bytes) -> None:
        running = self._running.setdefault(name, hashlib.blake2b(digest_size=_DIGEST_BYTES))
        for part in parts:
            running.update(len(part).to_bytes(8, "little") + part)

    def add_attachment(self, name: str, data: bytes) -> None:
        """Take in an attachment."""
        self._add(f"attachment {name}", data)

    def add_metadata(self, name: str, facts: Mapping[str, str]) -> None:
        """Take in a metadata record; proofs don't count."""
        if not name.startswith(PROOF):
            self._add(f"metadata {name}", json.dumps(facts, sort_keys=True).encode())

    def add_channel(self, topic: str, encoding: str, schema: Schema | None) -> None:
        """Take in how the messages of a channel are to be understood."""
        parts = [] if schema is None else [schema.name.encode(), schema.encoding.encode(), schema.data]
        self._add(topic, encoding.encode(), *parts)

    def add_message(self, topic: str, time_ns: int, data: bytes) -> None:
        """Take in the next message of a channel that was taken in."""
        self.add_framed(topic, _MESSAGE.pack(time_ns, len(data)) + data)

    def add_framed(self, topic: str, messages: bytes | memoryview) -> None:
        """Take in the next messages of a channel, each after its time [ns] and its length, of eight bytes."""
        self._running[topic].update(messages)

    def current(self) -> dict[str, str]:
        """The digests as they stand, by name, in hexadecimal."""
        return {name: running.hexdigest() for name, running in self._running.items()}


@dataclass(frozen=True)
class Proof:
    """What was written up to some time."""

    until_ns: int
    """Time since 1970 before which the proof covers messages [ns]."""
    digests: Mapping[str, str]
    outcome: str = ""
    """How the mission ended, in the last proof of a log; else empty."""

    @classmethod
    def parse(cls, facts: Mapping[str, str]) -> Self:
        """Read a proof from a metadata record; ValueError if its time is not a number."""
        digests = {name: digest for name, digest in facts.items() if name not in ("until_ns", "outcome")}
        return cls(int(facts.get("until_ns", "")), digests, facts.get("outcome", ""))

    def record(self) -> dict[str, str]:
        """Write the proof as a metadata record."""
        return {"until_ns": str(self.until_ns), "outcome": self.outcome, **self.digests}

    def differing(self, found: Digests) -> list[str]:
        """Names of what is there and is not what was written.

        What was left out as a whole does not count, nor do attachments and metadata that were added.
        """
        return sorted(
            name
            for name, digest in found.current().items()
            if (name in self.digests or is_core(name)) and self.digests.get(name) != digest
        )


def proofs(metadata: Iterable[tuple[str, Mapping[str, str]]]) -> list[Proof]:
    """The proofs among metadata records, in order of time; ValueError if the time of one is no number."""
    found = [Proof.parse(facts) for name, facts in metadata if name.startswith(PROOF)]
    return sorted(found, key=lambda proof: (proof.until_ns, proof.outcome))


class ProvingWriter(Writer):
    """Writes an MCAP file, and proofs of what it wrote."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
        # under the names that Python gives to private attributes of the library's class
        self._chunk = self._Writer__chunk_builder = Chunk()
        self._statistics: Statistics = self._Writer__statistics  # type: ignore[attr-defined]
        self._digests = Digests()
        self._known: dict[int, Schema] = {}
        self._topics: dict[int, str] = {}
        self._proofs = 0
        self.start(profile="", library=LIBRARY)

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        self._digests.add_attachment(name, data)
        super().add_attachment(create_time, log_time, name, media_type, data)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a metadata record."""
        self._digests.add_metadata(name, data)
        super().add_metadata(name, data)

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Register a message type; returns its number."""
        number = int(super().register_schema(name, encoding, data))
        self._known[number] = Schema(id=number, data=data, encoding=encoding, name=name)
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Register a channel; returns its number."""
        number = int(super().register_channel(topic, message_encoding, schema_id, dict(metadata or {})))
        if is_core(topic):
            self._topics[number] = topic
            self._digests.add_channel(topic, message_encoding, self._known.get(schema_id))
        return number

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Write a message."""
        topic = self._topics.get(channel_id)
        if topic is not None:
            self._digests.add_message(topic, log_time, data)
        super().add_message(channel_id, log_time, data, publish_time, sequence)

    def add_messages(self, messages: Sequence[tuple[int, int, bytes]]) -> None:
        """Write messages (time [ns], channel, data), in order of time: the same bytes as one by one, but quickly."""
        if not messages:
            return
        framed: dict[int, list[bytes]] = {channel: [] for channel in self._topics}
        for at, channel, data in messages:
            if channel in framed:
                framed[channel].append(_MESSAGE.pack(at, len(data)) + data)
        for channel, parts in framed.items():
            self._digests.add_framed(self._topics[channel], b"".join(parts))
        written = 0
        while written < len(messages):
            written = self._chunk.extend(messages, written)
            if self._chunk.count > CHUNK_BYTES:
                self.flush()  # type: ignore[no-untyped-call]  # the library leaves it bare
        known, first, last = self._statistics, messages[0][0], messages[-1][0]
        known.message_start_time = min(known.message_start_time, first) if known.message_count else first
        known.message_end_time = max(known.message_end_time, last)
        known.message_count += len(messages)
        for channel, count in Counter(channel for _, channel, _ in messages).items():
            known.channel_message_counts[channel] += count

    def prove(self, until_ns: int, outcome: str = "") -> None:
        """Add a proof of everything so far, which lies before `until_ns`; an outcome makes it the last one.

        What was written so far goes to the stream first, so that a crash costs what came later at most.
        """
        self.flush()  # type: ignore[no-untyped-call]  # the library leaves it bare
        proof = Proof(until_ns, self._digests.current(), outcome)
        super().add_metadata(f"{PROOF}{self._proofs}", proof.record())
        self._proofs += 1

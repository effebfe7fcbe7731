"""Digests by which a log that is read back proves that it is what was written, and how far it is.

Checksums protect single records of a log; they say nothing of one that is missing, doubled, or written anew by another
program. So every ten seconds of mission the writer adds a metadata record, "proof 0", "proof 1" …, with digests of all
that belongs to the flight up to then: each of its channels, the attachments and the other metadata. The last one also
says how the mission ended.
"""

import hashlib
import json
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from mcap.records import Schema

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


def framed(time_ns: int, data: bytes) -> bytes:
    """A message as digests take it in: after its time and its length."""
    return _MESSAGE.pack(time_ns, len(data)) + data


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
        self.add_framed(topic, framed(time_ns, data))

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

"""A short description of a log; nothing of the simulator is imported, so that the answer is quick."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from mcap.records import Attachment, Channel, Metadata, Schema, Statistics

from sim.log.file import Checksums, LogError, faults, records


@dataclass(frozen=True)
class ChannelInfo:
    """A channel of a log."""

    topic: str
    schema: str
    messages: int


@dataclass(frozen=True)
class LogInfo:
    """What `laisn log info` prints."""

    path: Path
    size: int
    """Size of the file [bytes]."""
    start: datetime
    """Log time of the first message."""
    duration_s: float
    channels: tuple[ChannelInfo, ...]
    attachments: dict[str, int]
    """Sizes by name [bytes]."""
    metadata: dict[str, dict[str, str]]
    """Metadata of the log by name."""
    unverified: tuple[str, ...]
    """Parts that have no checksum, so that damage to them cannot be noticed."""


def info(path: Path) -> LogInfo:
    """Describe any MCAP log with a summary section, by its statistics; its checksums are verified.

    Raises:
        LogError: it cannot be read, is damaged, or no MCAP file.
    """
    checksums, statistics = Checksums(), None
    schemas, channels = dict[int, Schema](), dict[int, Channel]()
    attachments, metadata = dict[str, int](), dict[str, dict[str, str]]()
    with faults(path), path.open("rb") as stream:
        for record in records(stream, checksums):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Attachment):
                attachments[record.name] = len(record.data)
            elif isinstance(record, Metadata):
                metadata[record.name] = record.metadata
            elif isinstance(record, Statistics):
                statistics = record
    if statistics is None:
        raise LogError(f"{path}: holds no statistics in its summary")
    counts = statistics.channel_message_counts
    found = [
        ChannelInfo(c.topic, schemas[c.schema_id].name if c.schema_id in schemas else "", counts.get(c.id, 0))
        for c in channels.values()
    ]
    return LogInfo(
        path=path,
        size=path.stat().st_size,
        start=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=statistics.message_start_time // 1000),
        duration_s=(statistics.message_end_time - statistics.message_start_time) / 1e9,
        channels=tuple(sorted(found, key=lambda channel: channel.topic)),
        attachments=attachments,
        metadata=metadata,
        unverified=checksums.missing,
    )

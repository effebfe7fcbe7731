"""What a log holds, at a glance; nothing of the simulator is imported, so that the answer is quick."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from mcap.reader import make_reader

from sim.log.file import LogError, check, faults, unprotected
from sim.log.proof import PROOF


@dataclass(frozen=True)
class ChannelInfo:
    """A channel of a log."""

    topic: str
    schema: str
    messages: int


@dataclass(frozen=True)
class LogInfo:
    """What `laisn log info` tells."""

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
    """Metadata of the log by name, without the proofs, which tell a reader nothing."""
    unprotected: tuple[str, ...]
    """What has no checksum, so that damage to it cannot be seen."""


def info(path: Path) -> LogInfo:
    """Describe any MCAP log with a summary section.

    Raises:
        LogError: it cannot be read, is damaged, or no MCAP file.
    """
    check(path)
    with faults(path), path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise LogError(f"{path}: holds no statistics; laisn log recover writes them")
        statistics = summary.statistics
        channels = [
            ChannelInfo(
                topic=channel.topic,
                schema=summary.schemas[channel.schema_id].name if channel.schema_id in summary.schemas else "",
                messages=statistics.channel_message_counts.get(id_, 0),
            )
            for id_, channel in summary.channels.items()
        ]
        records = (record for record in reader.iter_metadata() if not record.name.startswith(PROOF))
        metadata = {record.name: dict(record.metadata) for record in records}
        start_ns, end_ns = statistics.message_start_time, statistics.message_end_time
        return LogInfo(
            path=path,
            size=path.stat().st_size,
            start=datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=start_ns // 1000),
            duration_s=(end_ns - start_ns) / 1e9,
            channels=tuple(sorted(channels, key=lambda channel: channel.topic)),
            attachments={index.name: index.data_size for index in summary.attachment_indexes},
            metadata=metadata,
            unprotected=tuple(unprotected(path)),
        )

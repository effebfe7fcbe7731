"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that are damaged, up to the first broken record."""

import os
from array import array
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, DataEnd, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from sim.files import atomic_write
from sim.log.contents import FLIGHT, DamagedError, LogError, records

_INTERRUPTED = "INTERRUPTED"
"""Name of the outcome of a flight whose log was cut off."""


def holds_messages(path: Path) -> bool:
    """Whether a partial log holds an intact block of messages."""
    try:
        return any(isinstance(record, Message) for record in records(path))
    except LogError:
        return False


class _Survey:
    """What is intact of a log: before its first broken record, and of a flight before the last instant."""

    def __init__(self, path: Path) -> None:
        self.remarks, self.problem, whole = list[str](), "", False
        times_ns, attachments, metadata = array("q"), 0, list[str]()
        try:
            for record in records(path, self.remarks.append):
                whole = isinstance(record, DataEnd)
                if isinstance(record, Message):
                    times_ns.append(record.log_time)
                elif isinstance(record, Metadata):
                    metadata.append(record.name)
                attachments += isinstance(record, Attachment)
        except DamagedError as error:
            self.problem = error.problem
        self.interrupted = FLIGHT in metadata and not whole
        # the last instant of a flight that was cut off may lack some of its messages
        self.end_ns = times_ns[-1] if times_ns and self.interrupted else 2**63 - 1
        kept = np.asarray(times_ns)
        kept = kept[kept < self.end_ns]
        if self.problem and not kept.size:
            raise LogError(f"{path}: holds no intact message ({self.problem}); there is nothing to recover")
        if metadata and not whole:
            self.remarks.append(f"metadata {', '.join(metadata)}: no checksum, damage cannot be noticed")
        span_s = np.ptp(kept) / 1e9 if kept.size else 0.0
        self.kept = f"kept {kept.size} messages of {span_s:g} s and {attachments} attachments"


def _copy(path: Path, target: Path, intact: _Survey) -> None:
    """Write what is intact as a finished log, by the library's own writer, which keeps all that a record holds."""
    schemas, channels = {0: 0}, dict[int, int]()
    with target.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start()
        with suppress(DamagedError):
            for r in records(path, lambda _: None):
                if isinstance(r, Message) and r.log_time < intact.end_ns:
                    writer.add_message(channels[r.channel_id], r.log_time, r.data, r.publish_time, r.sequence)
                elif isinstance(r, Schema) and r.id not in schemas:
                    schemas[r.id] = writer.register_schema(r.name, r.encoding, r.data)
                elif isinstance(r, Channel) and r.id not in channels:
                    type_ = schemas[r.schema_id]
                    channels[r.id] = writer.register_channel(r.topic, r.message_encoding, type_, r.metadata)
                elif isinstance(r, Attachment):
                    writer.add_attachment(r.create_time, r.log_time, r.name, r.media_type, r.data)
                elif isinstance(r, Metadata):
                    cut = {"outcome": _INTERRUPTED} if r.name == FLIGHT and intact.interrupted else {}
                    writer.add_metadata(r.name, r.metadata | cut)
        if intact.remarks:
            writer.add_metadata("recovery", {str(i): text for i, text in enumerate(intact.remarks)})
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare


def recover(path: Path, say: Callable[[str], None] = lambda remark: None) -> Path:
    """Finish a log with everything before its first broken record, and give it its name.

    A flight that was cut off ends with its last complete instant, with the outcome "interrupted". A damaged attachment
    is left out. An unfinished file is removed when the new one is in place.

    Args:
        path: the unfinished log, "NAME.partial", or a damaged one.
        say: takes a sentence for what was kept, was left out, or could not be checked for damage.

    Returns:
        The finished log: NAME; or "NAME.recovered" + suffix beside a log under its own name.

    Raises:
        LogError: the log is complete, or holds no intact message, or the result cannot be written.
    """
    unfinished = path.suffix == ".partial"
    target = path.with_suffix("") if unfinished else path.with_name(f"{path.stem}.recovered{path.suffix}")
    if not path.is_file():
        raise LogError(f"{path}: no such file")
    try:
        with atomic_write(target) as work:
            intact = _Survey(path)
            if intact.problem:
                _copy(path, work, intact)
            elif unfinished:
                os.replace(path, work)
            else:
                raise LogError(f"{path}: is complete; there is nothing to recover")
    except OSError as error:
        raise LogError(f"{target}: cannot be written: {error.strerror or error}") from error
    if unfinished:
        path.unlink(missing_ok=True)
    for text in (*intact.remarks, intact.kept, f"left out: {intact.problem}") if intact.problem else ():
        say(text)
    return target

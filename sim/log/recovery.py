"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that are damaged, up to the first broken record."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import EndOfFile
from mcap.records import Attachment, Channel, Chunk, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from sim.files import atomic_write
from sim.log.file import FLIGHT, DamagedError, LogError, records

_INTERRUPTED = "INTERRUPTED"
"""Name of the outcome of a flight whose log was cut off."""


def holds_messages(path: Path) -> bool:
    """Whether a partial log holds an intact block of messages."""
    try:
        return any(isinstance(record, Chunk) for record in records(path))
    except LogError:
        return False


class _Intact:
    """The records of a file before the first broken one, out of their chunks."""

    def __init__(self, path: Path) -> None:
        self.problem, self.remarks, self.whole = "", list[str](), False
        """The first broken record; damaged attachments; whether all of the data section is intact."""
        self._path = path

    def __iter__(self) -> Any:
        self.remarks = []
        try:
            for record in records(self._path, self.remarks.append):
                self.whole = isinstance(record, DataEnd)
                if isinstance(record, Chunk):
                    # one after the other: a list of all takes ten times the memory of their bytes
                    with suppress(EndOfFile):
                        yield from StreamReader(BytesIO(record.data), skip_magic=True).records
                else:
                    yield record
        except DamagedError as error:
            self.problem = error.problem


class _Copy:
    """Writes records as a finished log, by the library's own writer, which keeps all that a record holds."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self.writer.start()
        self._schemas, self._channels = {0: 0}, dict[int, int]()
        self.messages = self.attachments = self.start_ns = self.end_ns = 0

    def add(self, record: McapRecord) -> None:
        """Write a record; a schema or channel that a chunk repeats counts once."""
        if isinstance(record, Message):
            time_ns, channel = record.log_time, self._channels[record.channel_id]
            self.writer.add_message(channel, time_ns, record.data, record.publish_time, record.sequence)
            self.start_ns = min(self.start_ns, time_ns) if self.messages else time_ns
            self.messages, self.end_ns = self.messages + 1, max(self.end_ns, time_ns)
        elif isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = self.writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in self._channels:
            schema = self._schemas[record.schema_id]
            self._channels[record.id] = self.writer.register_channel(
                record.topic, record.message_encoding, schema, record.metadata
            )
        elif isinstance(record, Attachment):
            self.attachments += 1
            self.writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            self.writer.add_metadata(record.name, record.metadata)


def _finish(path: Path, target: Path, say: Callable[[str], None]) -> bool:
    """Write everything before the first broken record as a finished log; False if nothing is broken."""
    last_ns, metadata, intact = 0, list[str](), _Intact(path)
    for record in intact:
        if isinstance(record, Message):
            last_ns = max(last_ns, record.log_time)
        elif isinstance(record, Metadata):
            metadata.append(record.name)
    if not intact.problem:
        return False
    cut = FLIGHT in metadata and not intact.whole
    with target.open("wb") as stream:
        copy = _Copy(stream)
        for record in intact:
            if cut and isinstance(record, Metadata) and record.name == FLIGHT:
                copy.add(replace(record, metadata=record.metadata | {"outcome": _INTERRUPTED}))
            elif not (cut and isinstance(record, Message) and record.log_time == last_ns):
                # of a flight that was cut off, the last instant may lack some of its messages
                copy.add(record)
        if not copy.messages:
            raise LogError(f"{path}: holds no intact message ({intact.problem}); there is nothing to recover")
        remarks = list(intact.remarks)
        if metadata and not intact.whole:
            remarks.append(f"metadata {', '.join(metadata)}: no checksum, damage cannot be noticed")
        if remarks:
            copy.add(Metadata("recovery", {str(i): text for i, text in enumerate(remarks)}))
        copy.writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare
    span_s = (copy.end_ns - copy.start_ns) / 1e9
    for text in (*remarks, f"kept {copy.messages} messages of {span_s:g} s and {copy.attachments} attachments"):
        say(text)
    say(f"left out: {intact.problem}")
    return True


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
            if not _finish(path, work, say):
                if not unfinished:
                    raise LogError(f"{path}: is complete; there is nothing to recover")
                os.replace(path, work)
    except OSError as error:
        raise LogError(f"{target}: cannot be written: {error.strerror or error}") from error
    path.unlink(missing_ok=True) if unfinished else None
    return target

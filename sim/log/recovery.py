"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that are damaged, up to the first broken record."""

import os
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import IO

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


def _contained(record: McapRecord) -> Iterator[McapRecord]:
    """The record, or what is in a chunk one by one: a list of all takes ten times the memory of their bytes."""
    if isinstance(record, Chunk):
        with suppress(EndOfFile):
            yield from StreamReader(BytesIO(record.data), skip_magic=True).records
    else:
        yield record


class _Copy:
    """Writes records as a finished log, by the library's own writer, which keeps all that a record holds."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self.writer.start()
        self.schemas, self.channels = {0: 0}, dict[int, int]()
        self.attachments, self.metadata, self.times_ns = list[str](), dict[str, dict[str, str]](), array("q")
        self.last = list[Message]()
        """Messages of the last instant, which are not written yet."""

    def write_last(self) -> None:
        """Write the messages of the last instant."""
        for m in self.last:
            self.writer.add_message(self.channels[m.channel_id], m.log_time, m.data, m.publish_time, m.sequence)
            self.times_ns.append(m.log_time)
        self.last.clear()

    def add(self, record: McapRecord) -> None:
        """Take a record; a schema or channel that a chunk repeats counts once."""
        if isinstance(record, Message):
            if self.last and record.log_time != self.last[0].log_time:
                self.write_last()
            self.last.append(record)
        elif isinstance(record, Schema) and record.id not in self.schemas:
            self.schemas[record.id] = self.writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in self.channels:
            self.channels[record.id] = self.writer.register_channel(
                record.topic, record.message_encoding, self.schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Attachment):
            self.attachments.append(record.name)
            self.writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            self.metadata[record.name] = record.metadata
            # corrected at the end if the flight is complete; a log that is cut again holds this one
            cut = {"outcome": _INTERRUPTED} if record.name == FLIGHT else {}
            self.writer.add_metadata(record.name, record.metadata | cut)


def _finish(path: Path, target: Path, say: Callable[[str], None]) -> bool:
    """Write everything before the first broken record as a finished log; False if nothing is broken."""
    remarks, problem, whole = list[str](), "", False
    with target.open("wb") as stream:
        copy = _Copy(stream)
        try:
            for record in records(path, remarks.append):
                whole = isinstance(record, DataEnd)
                for inner in _contained(record):
                    copy.add(inner)
        except DamagedError as error:
            problem = error.problem
        if not problem:
            return False
        if not whole and FLIGHT in copy.metadata:
            # the last instant of a flight that was cut off may lack some of its messages
            copy.last.clear()
        elif FLIGHT in copy.metadata:
            copy.writer.add_metadata(FLIGHT, copy.metadata[FLIGHT])
        copy.write_last()
        if not copy.times_ns:
            raise LogError(f"{path}: holds no intact message ({problem}); there is nothing to recover")
        if copy.metadata and not whole:
            remarks.append(f"metadata {', '.join(copy.metadata)}: no checksum, damage cannot be noticed")
        if remarks:
            copy.writer.add_metadata("recovery", {str(i): text for i, text in enumerate(remarks)})
        copy.writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare
    span_s = (max(copy.times_ns) - min(copy.times_ns)) / 1e9
    kept = f"kept {len(copy.times_ns)} messages of {span_s:g} s and {len(copy.attachments)} attachments"
    for text in (*remarks, kept, f"left out: {problem}"):
        say(text)
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

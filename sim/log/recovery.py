"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that are damaged, up to the first broken record."""

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from mcap.records import Attachment, Channel, Chunk, DataEnd, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from sim.files import atomic_write
from sim.log.file import Checksums, DamagedError, Decompressor, LogError, TrailingBytesError, faults, records

FLIGHT = "laisn"
"""Metadata record by which the log of a flight is known."""
_RECOVERY = "recovery"
"""Metadata record of a recovered log, numbered."""
_INTERRUPTED = "INTERRUPTED"
"""Name of the outcome of a flight whose log was cut off."""


class _Intact:
    """The records of a file before the first broken one, chunks decompressed."""

    def __init__(self, path: Path) -> None:
        self._path, self.checksums = path, Checksums()
        self.problem = ""
        """The first broken record, if it stands before the end of the data section."""
        self.damaged_attachments: list[str] = []

    def __iter__(self) -> Iterator[Any]:
        decompressor = Decompressor(self._path.stat().st_size)
        with self._path.open("rb") as stream:
            try:
                for record in records(stream, self.checksums, self.damaged_attachments.append):
                    if isinstance(record, DataEnd):
                        return
                    if isinstance(record, Chunk):
                        yield from decompressor.records(record, stream.tell())
                    else:
                        yield record
            except DamagedError as error:
                self.problem = str(error).partition(";")[0]


def holds_messages(path: Path) -> bool:
    """Whether a partial log holds an intact message."""
    try:
        return any(isinstance(record, Message) for record in _Intact(path))
    except OSError:
        return False


class _Copy:
    """Writes records as a finished log, by the library's own writer, which keeps all that a record holds."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start()
        self._schemas, self._channels = {0: 0}, dict[int, int]()
        self.messages = self.attachments = self.start_ns = self.end_ns = 0

    def add(self, record: Any) -> None:
        """Write a record; one that a chunk repeats counts once."""
        if isinstance(record, Message):
            time_ns = record.log_time
            self._writer.add_message(
                self._channels[record.channel_id], time_ns, record.data, record.publish_time, record.sequence
            )
            self.start_ns = min(self.start_ns, time_ns) if self.messages else time_ns
            self.messages, self.end_ns = self.messages + 1, max(self.end_ns, time_ns)
        elif isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = self._writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in self._channels:
            self._channels[record.id] = self._writer.register_channel(
                record.topic, record.message_encoding, self._schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Attachment):
            self.attachments += 1
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        elif isinstance(record, Metadata):
            self._writer.add_metadata(record.name, record.metadata)

    def finish(self) -> None:
        """Write the end of the log."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare


def _rescue(path: Path, stream: IO[bytes], say: Callable[[str], None]) -> None:
    """Write everything before the first broken record as a finished log."""
    last_ns, metadata = 0, list[str]()
    intact = _Intact(path)
    for record in intact:
        if isinstance(record, Message):
            last_ns = max(last_ns, record.log_time)
        elif isinstance(record, Metadata):
            metadata.append(record.name)
    cut_flight = bool(intact.problem) and FLIGHT in metadata
    copy = _Copy(stream)
    for record in _Intact(path):
        if cut_flight and isinstance(record, Metadata) and record.name == FLIGHT:
            copy.add(replace(record, metadata=record.metadata | {"outcome": _INTERRUPTED}))
        elif not (cut_flight and isinstance(record, Message) and record.log_time == last_ns):
            # of a flight that was cut off, the last instant may lack some of its messages
            copy.add(record)
    if not copy.messages:
        raise LogError(f"{path}: holds no intact message ({intact.problem}); there is nothing to recover")
    remarks = [f"attachment {name!r} is damaged and is left out" for name in intact.damaged_attachments]
    bare = [*intact.checksums.missing, *(f"metadata {name}" for name in metadata if intact.problem)]
    remarks += [f"{', '.join(bare)}: no checksum, damage cannot be noticed"] if bare else []
    if remarks:
        number = sum(name.startswith(_RECOVERY) for name in metadata)
        copy.add(Metadata(f"{_RECOVERY} {number}", {str(i): text for i, text in enumerate(remarks)}))
    copy.finish()
    for remark in remarks:
        say(remark)
    span_s, problem = (copy.end_ns - copy.start_ns) / 1e9, intact.problem or "the data section is complete"
    say(f"kept {copy.messages} messages of {span_s:g} s and {copy.attachments} attachments; {problem}")


def _finish(path: Path, work: Path, say: Callable[[str], None]) -> bool:
    """Write a finished log into `work`; False if `path` is one itself."""
    end: int | None = None
    try:
        with faults(path), path.open("rb") as stream:
            try:
                for _ in records(stream):
                    pass
                return False
            except TrailingBytesError as error:
                end = error.end
    except LogError:
        if not path.is_file():
            raise
    with work.open("wb") as target:
        if end is None:
            _rescue(path, target, say)
        else:
            with path.open("rb") as stream:
                shutil.copyfileobj(stream, target)
            target.truncate(end)
            say(f"kept all of the log, without the bytes from {end} on")
        target.flush()
        os.fsync(target.fileno())
    return True


def recover(path: Path, say: Callable[[str], None] = lambda remark: None) -> Path:
    """Finish a log with everything before its first broken record, and give it its name.

    A flight that was cut off ends with its last complete instant, with the outcome "interrupted". A damaged attachment
    is left out. A complete log that other bytes follow is copied without these. An unfinished file is removed when the
    new one is in place.

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

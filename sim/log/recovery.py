"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that have something behind their end, made whole."""

import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import IO

from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, Writer

from sim.flight import Outcome
from sim.log.file import LogError, check, end_of_log, faults, partial_path, rescuable, whole_records


def _is_whole(path: Path) -> bool:
    try:
        check(path)
    except LogError:
        return False
    return True


def _last_instant(path: Path) -> int:
    return max(record.message_end_time for record in whole_records(path) if isinstance(record, Chunk))


def _copy(source: Path, stream: IO[bytes], before_ns: int) -> None:
    """Write what is whole in `source` and earlier than `before_ns` as a finished log."""
    writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="")
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    for record in whole_records(source):
        if isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            facts = dict(record.metadata)
            if record.name == "laisn":
                facts["outcome"] = Outcome.INTERRUPTED.name
            writer.add_metadata(record.name, facts)
        for part in breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]:
            if isinstance(part, Schema) and part.id not in schemas:
                schemas[part.id] = writer.register_schema(part.name, part.encoding, part.data)
            elif isinstance(part, Channel) and part.id not in channels:
                channels[part.id] = writer.register_channel(
                    part.topic, part.message_encoding, schemas[part.schema_id], part.metadata
                )
            elif isinstance(part, Message) and part.log_time < before_ns:
                writer.add_message(channels[part.channel_id], part.log_time, part.data, part.publish_time)
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare


def _ends_before(path: Path) -> int | None:
    """Where the log in a file ends, if other bytes follow; else None."""
    with path.open("rb") as stream:
        stop = end_of_log(stream)
        return stop if stop is not None and stop < stream.seek(0, os.SEEK_END) else None


def _rescue(path: Path, work: Path) -> None:
    """Write a whole log into `work`: the one that ends within the file, or else what is whole of one without an end."""
    stop = _ends_before(path)
    if stop is not None:
        with path.open("rb") as source, work.open("wb") as stream:
            shutil.copyfileobj(source, stream)
            stream.truncate(stop)
            stream.flush()
            os.fsync(stream.fileno())
        if _is_whole(work):
            return
    with work.open("wb") as stream:
        _copy(path, stream, _last_instant(path))
        stream.flush()
        os.fsync(stream.fileno())


def recover(path: Path) -> Path:
    """Finish an unfinished log and give it its name; the flight in it ends where whole instants end.

    A log that is whole and has other bytes behind its end is copied without these and keeps all of its flight.
    Messages lie in the file in order of time, so that all instants before the last one that was begun are whole;
    that last one is left out. The unfinished file is removed when the new one is in place.

    Args:
        path: the unfinished log, "NAME.partial", or a log that was cut off or goes on behind its end.

    Returns:
        The finished log: NAME; or "NAME.recovered" + suffix beside a log that was at fault under its own name.

    Raises:
        LogError: the log is whole already, or holds nothing to rescue, or the result cannot be written.
    """
    unfinished = path.suffix == ".partial"
    target = path.with_suffix("") if unfinished else path.with_name(f"{path.stem}.recovered{path.suffix}")
    if _is_whole(path):
        if not unfinished:
            raise LogError(f"{path}: is whole; there is nothing to recover")
        with faults(target):
            os.replace(path, target)
        return target
    if not path.is_file():
        raise LogError(f"{path}: no such file")
    if not rescuable(path):
        raise LogError(f"{path}: holds no whole part of a log; there is nothing to recover")
    work = partial_path(target.with_name(f"{target.name}.recovery"))
    try:
        _rescue(path, work)
        os.replace(work, target)
    except BaseException as error:
        with suppress(OSError):
            work.unlink()
        if isinstance(error, OSError):
            raise LogError(f"{target}: cannot be written: {error.strerror or error}") from error
        if isinstance(error, Exception):
            raise LogError(f"{path}: damaged beyond recovery ({type(error).__name__}: {error})") from error
        raise
    if unfinished:
        with faults(path):
            path.unlink()
    return target

"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that are damaged, up to the first broken record."""

import os
from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Channel, DataEnd, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from sim.log.contents import FLIGHT, DamagedError, LogError, records
from sim.system import atomic_write

_INTERRUPTED = "INTERRUPTED"
"""Name of the outcome of a flight whose log was cut off."""


def holds_messages(path: Path) -> bool:
    """Whether a partial log holds an intact block of messages."""
    try:
        return any(isinstance(record, Message) for record in records(path))
    except LogError:
        return False


def _copy(path: Path, target: Path, remarks: list[str]) -> str:
    """Write what is intact as a finished log, by the library's own writer, which keeps all that a record holds.

    Of a flight that was cut off, the last instant is left out, as it may lack some of its messages. Returns what is
    wrong with the log, "" for nothing.
    """
    schemas, channels, metadata = {0: 0}, dict[int, int](), dict[str, dict[str, str]]()
    times_ns, held, attachments, whole, problem = array("Q"), list[Message](), 0, False, ""
    with target.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start()

        def write_held() -> None:
            for m in held:
                writer.add_message(channels[m.channel_id], m.log_time, m.data, m.publish_time, m.sequence)
                times_ns.append(m.log_time)
            held.clear()

        try:
            for r in records(path, remarks.append):
                whole = isinstance(r, DataEnd)
                if isinstance(r, Message):
                    if held and held[0].log_time != r.log_time:
                        write_held()
                    held.append(r)
                elif isinstance(r, Schema) and r.id not in schemas:
                    schemas[r.id] = writer.register_schema(r.name, r.encoding, r.data)
                elif isinstance(r, Channel) and r.id not in channels:
                    type_ = schemas.get(r.schema_id, 0)
                    channels[r.id] = writer.register_channel(r.topic, r.message_encoding, type_, r.metadata)
                elif isinstance(r, Attachment):
                    writer.add_attachment(r.create_time, r.log_time, r.name, r.media_type, r.data)
                    attachments += 1
                elif isinstance(r, Metadata):
                    writer.add_metadata(r.name, r.metadata)
                    metadata[r.name] = r.metadata
        except DamagedError as error:
            problem = error.problem
        if FLIGHT in metadata and not whole:
            # of records with one name, the last one counts
            writer.add_metadata(FLIGHT, metadata[FLIGHT] | {"outcome": _INTERRUPTED})
        else:
            write_held()
        if problem and not times_ns:
            raise LogError(f"{path}: holds no intact message ({problem}); there is nothing to recover")
        if metadata and not whole:
            remarks.append(f"metadata {', '.join(metadata)}: no checksum, damage cannot be detected")
        if remarks:
            writer.add_metadata("recovery", {str(i): text for i, text in enumerate(remarks)})
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare
    span_s = np.ptp(times_ns) / 1e9 if times_ns else 0.0
    remarks += [f"kept {len(times_ns)} messages of {span_s:g} s and {attachments} attachments", f"left out: {problem}"]
    return problem


def recover(path: Path, report: Callable[[str], None] = lambda remark: None) -> Path:
    """Finish a log with everything before its first broken record, and give it its name.

    A flight that was cut off ends with its last complete instant, with the outcome "interrupted". A damaged attachment
    is left out.

    Args:
        path: the unfinished log, "NAME.partial", which becomes NAME; or a damaged one, which stays.
        report: takes a sentence for what was kept, was left out, or could not be checked for damage.

    Returns:
        The finished log: NAME, or "NAME.recovered" + suffix.

    Raises:
        LogError: the log is complete, or holds no intact message, or the result cannot be written.
    """
    if not path.is_file():
        raise LogError(f"{path}: no such file")
    unfinished, remarks = path.suffix == ".partial", list[str]()
    target = path.with_suffix("") if unfinished else path.with_name(f"{path.stem}.recovered{path.suffix}")
    try:
        with atomic_write(target) as work:
            problem = _copy(path, work, remarks)
            if not problem and not unfinished:
                raise LogError(f"{path}: is complete; there is nothing to recover")
            if not problem:
                os.replace(path, work)
    except OSError as error:
        raise LogError(f"{target}: cannot be written: {error.strerror or error}") from error
    if unfinished:
        path.unlink(missing_ok=True)
    for text in remarks if problem else ():
        report(text)
    return target

"""Logs that a crash, a full disk or Ctrl-C left unfinished, or that have something behind their end, made whole."""

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from laisn.whole_files import replaced
from sim.flight import Outcome
from sim.log import reader
from sim.log.batches import rescuable, whole_records
from sim.log.contents import collect
from sim.log.file import (
    SCENARIO,
    VEHICLES,
    LogError,
    check,
    end_of_log,
    faults,
    unprotected,
)
from sim.log.proof import LIBRARY, PROOF, is_core, proofs
from sim.log.proving import ProvingWriter
from sim.log.records import Budget, places, read_content
from sim.log.wholeness import proved_times, strangers
from sim.log.wire import Batch

_RECOVERY = "recovery"
"""Name of the metadata that a recovered log bears."""


def _is_whole(path: Path) -> bool:
    try:
        check(path)
    except LogError:
        return False
    return True


def _is_ours(path: Path) -> bool:
    """Whether the header says that this program wrote the log."""
    with path.open("rb") as stream:
        content = read_content(stream, next(places(stream)))
    try:
        return bool(Header.read(ReadDataStream(BytesIO(content))).library == LIBRARY)
    except Exception:
        # foreign bytes make decoders fail in many ways
        return False


@dataclass(frozen=True)
class _Rescue:
    """What of an unfinished log is to be kept."""

    ends_ns: list[int]
    """Where to stop, exclusive [ns]: the first that gives a whole flight."""
    proofs_ns: list[int]
    """Where its flight is proved; none if it is no flight's log."""
    left_out: list[str]
    """Damaged attachments and metadata, as "attachment NAME" and so on."""
    remarks: list[str]
    """What the user should know."""
    readable: bool
    """Whether it should read as a flight."""


def _survey(path: Path) -> _Rescue:
    """Find out how far a log is what was written.

    A flight is proved up to the last proof that fits. What lies behind is kept too if its chunks have checksums, of
    this program's making, and if it goes on without a gap.
    """
    remarks: list[str] = []
    budget, last_ns = Budget(path.stat().st_size), 0

    def followed() -> Iterator[Any]:
        nonlocal last_ns
        for record in whole_records(path, budget, remarks):
            if isinstance(record, Batch):
                last_ns = max(last_ns, int(record.log_time.max(initial=0)))
            yield record

    log = collect(path, followed(), budget, lambda topic, _: is_core(topic))
    bare = unprotected(path)
    if not any(name.startswith(PROOF) for name in log.metadata):
        remarks += [f"{what} is not protected: it has no checksum, damage to it cannot be seen" for what in bare]
        return _Rescue([last_ns], [], [], remarks, readable=False)
    left_out = strangers(path, log)
    remarks += [f"{name} is not what was written, and is left out" for name in left_out]
    for name in left_out:
        kind, _, rest = name.partition(" ")
        (log.attachments if kind == "attachment" else log.metadata).pop(rest)
    proved = proved_times(path, log)
    if not proved:
        raise LogError(f"{path}: damaged beyond recovery: its first messages are not what was written")
    readable = {SCENARIO, VEHICLES} <= set(log.attachments) and "laisn" in log.metadata
    broken = any(proof.until_ns <= last_ns + 1 for proof in proofs(log.metadata.items()) if proof.until_ns > proved[-1])
    tail = readable and not broken and not any("chunks" in what for what in bare) and _is_ours(path)
    return _Rescue([last_ns, proved[-1]] if tail else [proved[-1]], proved, left_out, remarks, readable)


def _copy(source: Path, stream: IO[bytes], rescue: _Rescue, before_ns: int) -> None:
    """Write what is to be kept of `source` and lies before some time as a finished log."""
    flight = bool(rescue.proofs_ns)
    writer = ProvingWriter(stream)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    recoveries, proved = 0, list(rescue.proofs_ns)
    for record in whole_records(source, Budget(source.stat().st_size), []):
        if isinstance(record, Attachment) and f"attachment {record.name}" not in rescue.left_out:
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata) and f"metadata {record.name}" not in rescue.left_out:
            facts = dict(record.metadata)
            if record.name == "laisn":
                facts["outcome"] = Outcome.INTERRUPTED.name
            recoveries += record.name.startswith(_RECOVERY)
            if not record.name.startswith(PROOF):
                writer.add_metadata(record.name, facts)
        elif isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
            )
        elif isinstance(record, Batch):
            kept = np.flatnonzero(record.log_time < before_ns)
            while proved and (late := np.flatnonzero(record.log_time[kept] >= proved[0])).size:
                writer.add_batch(record, kept[: late[0]], channels)
                writer.prove(proved.pop(0))
                kept = kept[late[0] :]
            writer.add_batch(record, kept, channels)
    if rescue.remarks:
        writer.add_metadata(f"{_RECOVERY} {recoveries}", {str(i): text for i, text in enumerate(rescue.remarks)})
    if flight:
        writer.prove(before_ns, Outcome.INTERRUPTED.name)
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare


def _ends_before(path: Path) -> int | None:
    """Offset at which the log in a file ends, if other bytes follow; else None."""
    with path.open("rb") as stream:
        stop = end_of_log(stream)
        return stop if stop is not None and stop < stream.seek(0, os.SEEK_END) else None


def _rescue(path: Path, work: Path, say: Callable[[str], None]) -> None:
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
    rescue = _survey(path)
    for remark in rescue.remarks:
        say(remark)
    for attempt, end_ns in enumerate(rescue.ends_ns, start=1):
        with work.open("wb") as stream:
            _copy(path, stream, rescue, end_ns)
            stream.flush()
            os.fsync(stream.fileno())
        try:
            if rescue.readable:
                reader.read(work)
        except LogError:
            if attempt == len(rescue.ends_ns):
                raise
        else:
            if rescue.proofs_ns and end_ns > rescue.proofs_ns[-1]:
                unproved_s = (end_ns - rescue.proofs_ns[-1]) / 1e9
                say(f"the last {unproved_s:g} s come after the last proof; checksums alone speak for them")
            return


def recover(path: Path, say: Callable[[str], None] = lambda remark: None) -> Path:
    """Finish an unfinished log and give it its name; the flight in it ends where whole instants end.

    A log that is whole and has other bytes behind its end is copied without these and keeps all of its flight.
    Messages lie in the file in order of time, so that all instants before the last one that was begun are whole;
    that last one is left out. So is everything from the first damage on, and every damaged attachment. The unfinished
    file is removed when the new one is in place.

    Args:
        path: the unfinished log, "NAME.partial", or a log that was cut off or goes on behind its end.
        say: takes a sentence for everything that was left out, or that could not be checked for damage.

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
    try:
        with replaced(target) as work:
            try:
                _rescue(path, work, say)
            except LogError as error:
                raise LogError(str(error).replace(str(work), str(path))) from error
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{target}: cannot be written: {error.strerror or error}") from error
    except Exception as error:
        raise LogError(f"{path}: damaged beyond recovery ({type(error).__name__}: {error})") from error
    if unfinished:
        with faults(path):
            path.unlink()
    return target

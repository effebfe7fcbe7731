"""What an MCAP file holds, in the order of the file: messages in batches, and records one by one."""

from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk

from laisn.arrays import Bytes
from sim.log import wire
from sim.log.file import LARGEST_ATTACHMENT
from sim.log.records import (
    HEAD,
    MAGIC,
    PARSED_COST,
    READ_SHARE,
    RECORD_COST,
    Budget,
    DamagedError,
    Place,
    attachment_name,
    is_intact,
    parse,
    read_content,
    unfolded,
)

_BLOCK = 1 << 16
"""Part of a file that is looked through for messages at once [bytes]."""
_IMPOSSIBLE = "a message is too short to be one, or of a time after 2262"
_PARSED = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA}


def _batch(data: Bytes, at: int, budget: Budget) -> wire.Batch:
    """The messages from a place on; DamagedError if there are more than is believable."""
    batch = wire.scan(data, at)
    budget.charge(RECORD_COST * batch.records)
    return batch


def _inside(chunk: Chunk, budget: Budget) -> Iterator[Any]:
    """The messages, schemas and channels of a chunk; errors as of `unfolded`."""
    content = unfolded(chunk)
    budget.charge(len(content) // READ_SHARE)
    data, at, end = np.frombuffer(content, dtype=np.uint8), 0, len(content)
    while at < end:
        batch = _batch(data, at, budget)
        at = batch.end
        if batch.records:
            yield batch
            continue
        if at + HEAD.size > end:
            raise DamagedError("a chunk ends within a record")
        opcode, length = HEAD.unpack_from(content, at)
        at += HEAD.size
        if length > end - at:
            raise DamagedError("a record goes on behind the end of its chunk")
        if opcode == Opcode.MESSAGE:
            raise DamagedError(_IMPOSSIBLE)
        budget.charge(PARSED_COST)
        record = parse(opcode, content[at : at + length])
        if record is not None:
            yield record
        at += length


def _read_head(stream: IO[bytes], at: int, size: int) -> Place:
    """The record at a place of a file; EOFError if it is not whole."""
    stream.seek(at)
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        raise EOFError("the file ends before its footer")
    opcode, length = HEAD.unpack(head)
    if length > size - at - HEAD.size:
        raise EOFError("a record goes on behind the end of the file")
    return Place(opcode, at + HEAD.size, length)


def records(stream: IO[bytes], budget: Budget, left_out: list[str] | None = None) -> Iterator[Any]:
    """Messages as `wire.Batch`, and schemas, channels, attachments and metadata of a file; those in chunks included.

    Args:
        stream: the file.
        budget: what it may unfold to.
        left_out: takes a line for every attachment that fails its checksum, which is left out then; None: it raises.

    Raises:
        DamagedError: a record fails its checksum or unfolds to more than is believable.
        EOFError: the file ends before its footer.
    """
    size, at = stream.seek(0, 2), len(MAGIC)
    while (place := _read_head(stream, at, size)).opcode != Opcode.FOOTER:
        at = place.start + place.length
        if place.opcode in _PARSED:
            attached = place.opcode == Opcode.ATTACHMENT
            if attached and place.length > LARGEST_ATTACHMENT:
                continue
            content = read_content(stream, place)
            if attached and left_out is not None and not is_intact(content):
                left_out.append(f"attachment {attachment_name(content)} does not fit its checksum and is left out")
                continue
            record = parse(place.opcode, content)
            if isinstance(record, Chunk):
                yield from _inside(record, budget)
            else:
                yield record
        elif place.opcode == Opcode.MESSAGE or place.length < _BLOCK:
            begin = place.start - HEAD.size
            stream.seek(begin)
            data = np.frombuffer(stream.read(max(_BLOCK, at - begin)), dtype=np.uint8)
            batch = _batch(data, 0, budget)
            if not batch.records:
                raise DamagedError(_IMPOSSIBLE)
            yield batch
            at = begin + batch.end


def whole_records(path: Path, budget: Budget, left_out: list[str]) -> Iterator[Any]:
    """Records of a file whose end may be missing or damaged: up to the first record that is not whole."""
    with path.open("rb") as stream:
        found = records(stream, budget, left_out)
        while True:
            try:
                record = next(found)
            except OSError:
                raise
            except Exception:
                # past the last whole record there may be anything
                return
            yield record


def rescuable(path: Path) -> bool:
    """Whether a partial log holds so much that recovering it makes sense: messages of more than one instant."""
    first = None
    try:
        for record in whole_records(path, Budget(path.stat().st_size), []):
            if isinstance(record, wire.Batch) and record.log_time.size:
                first = int(record.log_time[0]) if first is None else first
                if np.any(record.log_time > first):
                    return True
    except OSError:
        pass
    return False

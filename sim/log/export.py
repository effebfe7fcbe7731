"""Channels of a log as tables: a Parquet or CSV file for each."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, get_args
from urllib.parse import quote

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from google.protobuf.descriptor import FieldDescriptor
from mcap.well_known import MessageEncoding

from sim.files import atomic_write
from sim.log.contents import Contents, Messages
from sim.log.file import LogError, faults

Format = Literal["parquet", "csv"]
_WRITERS = {"parquet": pa.parquet.ParquetWriter, "csv": pa.csv.CSVWriter}
_KINDS = {
    FieldDescriptor.CPPTYPE_DOUBLE: pa.float64(),
    FieldDescriptor.CPPTYPE_FLOAT: pa.float64(),
    FieldDescriptor.CPPTYPE_INT32: pa.int64(),
    FieldDescriptor.CPPTYPE_INT64: pa.int64(),
    FieldDescriptor.CPPTYPE_UINT32: pa.uint64(),
    FieldDescriptor.CPPTYPE_UINT64: pa.uint64(),
    FieldDescriptor.CPPTYPE_BOOL: pa.bool_(),
    FieldDescriptor.CPPTYPE_STRING: pa.string(),
}


def _leaves(descriptor: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and descriptors of the single numbers and texts of a message; nothing for what holds lists or bytes."""
    for field in descriptor.fields:
        name = f"{prefix}{field.name}"
        if field.is_repeated or field.type == field.TYPE_BYTES:
            continue
        if field.message_type is None:
            yield name, field
        elif field.message_type.full_name != "google.protobuf.Timestamp":
            yield from _leaves(field.message_type, f"{name}.")


def _table(messages: Messages, leaves: Sequence[tuple[str, Any]], start_ns: int) -> Any:
    """All messages of a channel: the times, then the leaves, enumerations by their names where these are known."""
    columns = {
        "time_s": pa.array((messages.time_ns - start_ns) / 1e9, pa.float64()),
        "log_time_ns": pa.array(messages.time_ns, pa.int64()),
    }
    for (name, leaf), values in zip(leaves, messages.columns([name for name, _ in leaves]), strict=True):
        if leaf.enum_type is not None:
            names = {None: None} | {number: value.name for number, value in leaf.enum_type.values_by_number.items()}
            column = pa.array([names.get(number, str(number)) for number in values], pa.string())
        else:
            column = pa.array(values, _KINDS[leaf.cpp_type])
        columns[f"{name}~2" if name in ("time_s", "log_time_ns") else name] = column
    return pa.table(columns)


def _file_names(topics: Iterable[str]) -> dict[str, str]:
    """A name for the table of each topic, without suffix: no two the same, also where case does not count."""
    names: dict[str, str] = {}
    taken: set[str] = set()
    for topic in topics:
        # "/" separates, what is no letter, digit, ".", "_", "-" or "~" is written as %XX
        stem = quote(topic.strip("/").replace("/", "_"), safe="") or "channel"
        stem = next(
            n for n in itertools.chain([stem], (f"{stem}~{k}" for k in itertools.count(2))) if n.lower() not in taken
        )
        taken.add(stem.lower())
        names[topic] = stem
    return names


def export(path: Path, out: Path, table_format: Format = "parquet") -> list[Path]:
    """Write every protobuf channel with plain numbers or texts as a table; scenes, transforms and video are left out.

    Every row begins with `time_s`, the mission's time (in a log without scenario since the first message of any table),
    and `log_time_ns`, that of the log since 1970; a channel's own field of such a name ends in "~2".

    Args:
        path: any MCAP log with protobuf channels.
        out: folder for the tables, made if need be; "/follower/estimate" becomes "follower_estimate.parquet". Unusual
            characters become %XX, and names that would fall together end in "~2", "~3" …
        table_format: "parquet", or "csv" (numbers in shortest form that reads back to the same float64).

    Returns:
        The files, in order of topic.

    Raises:
        LogError: the log is damaged or has nothing to export, the format is unknown, or the folder cannot be written.
    """
    if table_format not in get_args(Format):
        raise LogError(f"unknown format {table_format!r}; available: {', '.join(get_args(Format))}")
    tables: dict[str, list[tuple[str, Any]]] = {}

    def has_table(topic: str, messages: Messages) -> bool:
        readable = messages.encoding == MessageEncoding.Protobuf
        tables[topic] = list(_leaves(messages.message_class.DESCRIPTOR)) if readable else []
        return bool(tables[topic])

    log, files = Contents(path, has_table), []
    names = _file_names(sorted(tables))
    with faults(path):
        start_ns = log.start_ns()
    for topic, name in names.items():
        messages, leaves = log.topics.pop(topic), tables[topic]
        if not leaves or not messages.count:
            continue
        file = out / f"{name}.{table_format}"
        try:
            out.mkdir(parents=True, exist_ok=True)
            with faults(path):
                table = _table(messages, leaves, start_ns)
            with atomic_write(file) as part, _WRITERS[table_format](part, table.schema) as writer:
                writer.write_table(table)
        except OSError as error:
            raise LogError(f"{file}: cannot be written: {error.strerror or error}") from error
        files.append(file)
    if not files:
        channels = ", ".join(names) or "none"
        raise LogError(f"{path}: lacks protobuf channels with numbers or texts to export; available: {channels}")
    return files

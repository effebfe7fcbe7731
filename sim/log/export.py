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
from sim.log.clock import Clock
from sim.log.contents import Contents, Messages
from sim.log.file import SCENARIO, LogError, faults
from sim.scenario import file as scenario_file

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


def _schema(leaves: Sequence[tuple[str, Any]]) -> Any:
    """Columns of a table: the times, then the leaves."""
    kinds = [pa.string() if leaf.enum_type is not None else _KINDS[leaf.cpp_type] for _, leaf in leaves]
    times = ("time_s", pa.float64()), ("log_time_ns", pa.int64())
    names = [f"{name}~2" if name in dict(times) else name for name, _ in leaves]
    return pa.schema([*times, *zip(names, kinds, strict=True)])


def _start_ns(log: Contents) -> int:
    """When the mission began, in log time: the epoch of its scenario, or the first message read of any other log."""
    if SCENARIO in log.attachments:
        return Clock(scenario_file.parse(log.attachments[SCENARIO].decode(), SCENARIO)["epoch"]).epoch_ns
    return min((int(messages.time_ns[0]) for messages in log.topics.values() if messages.time_ns.size), default=0)


def _column(leaf: Any, values: Any) -> Any:
    """The values of a leaf, enumerations by their names where these are known."""
    if leaf.enum_type is None:
        return values
    names = {number: value.name for number, value in leaf.enum_type.values_by_number.items()}
    return [names.get(number, str(number)) for number in values]


def _table(messages: Messages, leaves: Sequence[tuple[str, Any]], start_ns: int) -> Any:
    """All messages of a channel."""
    schema, time_ns = _schema(leaves), messages.time_ns
    found = messages.columns([name for name, _ in leaves])
    values = [_column(leaf, column) for (_, leaf), column in zip(leaves, found, strict=True)]
    columns = [(time_ns - start_ns) / 1e9, time_ns, *values]
    return pa.table([pa.array(c, type=t) for c, t in zip(columns, schema.types, strict=True)], schema=schema)


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
        tables[topic] = (
            list(_leaves(messages.message_class.DESCRIPTOR)) if messages.encoding == MessageEncoding.Protobuf else []
        )
        return bool(tables[topic])

    log = Contents(path, has_table)
    names = _file_names(sorted(tables))
    with faults(path):
        start_ns = _start_ns(log)
    files = []
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

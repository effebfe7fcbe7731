"""Channels of a log as tables: a Parquet or CSV file for each."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, get_args

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from sim.log.file import LogError, Messages, contents, faults

Format = Literal["parquet", "csv"]


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


def _value(message: Any, path: str) -> Any:
    for part in path.split("."):
        message = getattr(message, part)
    return message


def _table(messages: Messages) -> Any:
    """A row a message: its log time, then its leaves; None if it has none."""
    leaves = list(_leaves(messages.descriptor()))
    if not leaves:
        return None
    decoded = list(messages.decoded())
    columns: dict[str, Any] = {"log_time_ns": pa.array(messages.time_ns, type=pa.int64())}
    for path, field in leaves:
        kind = pa.float64() if field.cpp_type == field.CPPTYPE_DOUBLE else None
        values = [_value(message, path) for message in decoded]
        if field.enum_type is not None:
            values = [field.enum_type.values_by_number[value].name for value in values]
        columns[path] = pa.array(values, type=kind)
    return pa.table(columns)


def export(path: Path, out: Path, table_format: Format = "parquet") -> list[Path]:
    """Write every protobuf channel with plain numbers or texts as a table; scenes, transforms and video are left out.

    Args:
        path: any MCAP log with protobuf channels.
        out: folder for the tables, made if need be; "/follower/estimate" becomes "follower_estimate.parquet".
        table_format: "parquet", or "csv" (numbers in shortest form that reads back to the same float64).

    Returns:
        The files, in order of topic.

    Raises:
        LogError: the log is damaged or has nothing to export, the format is unknown, or the folder cannot be written.
    """
    if table_format not in get_args(Format):
        raise LogError(f"unknown format {table_format!r}; available: {', '.join(get_args(Format))}")
    log = contents(path)
    files = []
    for topic, messages in sorted(log.topics.items()):
        if messages.encoding != "protobuf":
            continue
        with faults(path):
            table = _table(messages)
        if table is None:
            continue
        file = out / f"{topic.strip('/').replace('/', '_')}.{table_format}"
        work = file.with_name(f"{file.name}.partial")
        try:
            out.mkdir(parents=True, exist_ok=True)
            if table_format == "parquet":
                pa.parquet.write_table(table, work)
            else:
                pa.csv.write_csv(table, work)
            os.replace(work, file)
        except OSError as error:
            with suppress(OSError):
                work.unlink()
            raise LogError(f"{file}: cannot be written: {error.strerror or error}") from error
        files.append(file)
    if not files:
        channels = ", ".join(sorted(log.topics)) or "none"
        raise LogError(f"{path}: lacks protobuf channels with numbers or texts to export; available: {channels}")
    return files

"""Bags of ROS as other programs record them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

Message = tuple[str, str, int, Mapping[str, Any]]
"""Topic, type, time [ns], and fields, nested ones as mappings."""


def build_message(store: Any, type_name: str, field_values: Mapping[str, Any]) -> Any:
    """A message of rosbags with some of its fields, the others zero; without the project's code."""
    _, fields = store.fielddefs[type_name]
    arguments = dict[str, Any]()
    for name, (kind, detail) in fields:
        field_value = field_values.get(name)
        if kind.name == "NAME":
            arguments[name] = build_message(store, detail, field_value or {})
        elif kind.name == "BASE":
            arguments[name] = (
                ("" if detail[0] == "string" else 0) if field_value is None else field_value
            )
        else:
            (_, element), length = detail
            base = element[0] if isinstance(element, tuple) else "float64"
            arguments[name] = (
                np.zeros(length, base) if field_value is None else np.asarray(field_value, base)
            )
    return store.types[type_name](**arguments)


def stamped(time_ns: int, frame: str = "", **fields: Any) -> dict[str, Any]:
    """Fields of a message with a header."""
    seconds, nanoseconds = divmod(time_ns, 10**9)
    stamp = {"sec": seconds, "nanosec": nanoseconds}
    return {"header": {"stamp": stamp, "frame_id": frame}, **fields}


def write_ros1(path: Path, messages: list[Message]) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        connections = dict[str, Any]()
        for topic, type_name, time_ns, field_values in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_name, typestore=store)
            raw = store.serialize_ros1(build_message(store, type_name, field_values), type_name)
            writer.write(connections[topic], time_ns, raw)
    return path


def write_ros2(
    path: Path, messages: list[Message], plugin: StoragePlugin = StoragePlugin.MCAP
) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        connections = dict[str, Any]()
        for topic, type_name, time_ns, field_values in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_name, typestore=store)
            raw = store.serialize_cdr(build_message(store, type_name, field_values), type_name)
            writer.write(connections[topic], time_ns, raw)
    return path

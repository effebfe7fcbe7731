"""Bags of ROS 1 and ROS 2 (.bag, .db3, .mcap, or a folder with metadata.yaml): topics with their
fields, and numbers of fields over time.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError, shortened
from sim.datasets.bag_clock import RecorderClock, corrected_stamps, written_order
from sim.log.ros2_encoding import MISSING

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

SUFFIXES = (".bag", ".db3", ".mcap")
_TIME = "builtin_interfaces/msg/Time"
_QUATERNION = "geometry_msgs/msg/Quaternion"
_MAX_NESTING = 12  # types within one another
_SAMPLES = 20  # messages of a topic whose texts, such as frames, are looked at
_MAX_CHARACTERS = 60  # characters of a value that messages show


class BagTopic(NamedTuple):
    """A topic of a bag."""

    name: str
    type_name: str
    messages: int
    fields: tuple[str, ...]  # numbers and quaternions, nested ones with dots
    # values of texts that messages have, by their fields, as far as the first messages tell
    texts: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of a field over time."""

    time_ns: Ints  # since 1970, increasing, shape (n,), [ns]
    # shape (n,), or (n, 4) of a quaternion (x, y, z, w); NaN where a message has none
    values: Floats
    steps_back: int = 0  # how often times stepped back in the order of recording
    repeated: int = 0  # messages at the very time of another, which are left out
    remarks: tuple[str, ...] = ()  # of the topic's clock


def is_bag(path: Path) -> bool:
    """Whether a path has the name of a bag, or is a folder with one."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader of a bag; LaisnError without rosbags, or if the bag cannot be read."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LaisnError(MISSING) from None
    try:
        # recordings without definitions are of Humble or earlier, whose types are those of Humble
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except LaisnError:
        raise
    except Exception as error:
        # foreign bytes make the library fail in many ways
        raise LaisnError(
            f"{path}: cannot be read as a bag of ROS: {type(error).__name__}: {error}"
        ) from None


def _number_fields(
    store: "Typestore", type_name: str, prefix: str = "", depth: int = 0
) -> Iterator[str]:
    """Fields of a type that hold a number, a time or an orientation."""
    from rosbags.interfaces import Nodetype

    if type_name not in store.fielddefs or depth > _MAX_NESTING:
        return
    for name, (kind, detail) in store.fielddefs[type_name][1]:
        path = f"{prefix}{name}"
        if (kind == Nodetype.BASE and detail[0] != "string") or (
            kind == Nodetype.NAME and detail in (_TIME, _QUATERNION)
        ):
            yield path
        elif kind == Nodetype.NAME:
            yield from _number_fields(store, str(detail), f"{path}.", depth + 1)


def _text_fields(
    store: "Typestore", type_name: str, prefix: str = "", depth: int = 0
) -> Iterator[str]:
    """Fields of a type that hold a text."""
    from rosbags.interfaces import Nodetype

    if type_name not in store.fielddefs or depth > _MAX_NESTING:
        return
    for name, (kind, detail) in store.fielddefs[type_name][1]:
        if kind == Nodetype.BASE and detail[0] == "string":
            yield f"{prefix}{name}"
        elif kind == Nodetype.NAME:
            yield from _text_fields(store, str(detail), f"{prefix}{name}.", depth + 1)


def _value(message: object, path: Sequence[str]) -> Any:
    """What a field holds; a number in a path counts elements of a list."""
    value: Any = message
    for step in path:
        value = value[int(step)] if step.isdigit() else getattr(value, step)
    return value


def topics_of(path: Path) -> list[BagTopic]:
    """Topics of a bag in order of their names; LaisnError if it cannot be read."""
    with _opened(path) as reader:
        store = reader.typestore
        texts: dict[str, dict[str, set[str]]] = {}
        connections = [c for c in reader.connections if c.msgtype in store.fielddefs]
        fields = {c.topic: [*_text_fields(store, c.msgtype)] for c in connections}
        seen_counts = dict.fromkeys(fields, 0)
        unfinished = {c.topic for c in connections if fields[c.topic]}
        for connection, _, raw in reader.messages(
            [c for c in connections if c.topic in unfinished]
        ):
            if seen_counts[connection.topic] >= _SAMPLES:
                unfinished.discard(connection.topic)
                if not unfinished:
                    break
                continue
            seen_counts[connection.topic] += 1
            message = reader.deserialize(raw, connection.msgtype)
            values = texts.setdefault(connection.topic, {})
            for field in fields[connection.topic]:
                values.setdefault(field, set()).add(_value(message, field.split(".")))
        counts = dict[str, int]()
        types = dict[str, str]()
        for connection in reader.connections:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
            types[connection.topic] = connection.msgtype
        return [
            BagTopic(
                name=name,
                type_name=types[name],
                messages=counts[name],
                fields=tuple(_number_fields(store, types[name])),
                texts={
                    field: tuple(sorted(values)) for field, values in texts.get(name, {}).items()
                },
            )
            for name in sorted(types)
        ]


class Request(NamedTuple):
    """A field of a topic, in messages whose other fields have certain values."""

    topic: str
    field: str
    where: tuple[tuple[str, Any], ...] = ()


def _number(value: Any, request: Request) -> Any:
    """A number, seconds of a time, or x, y, z and w of an orientation."""
    if hasattr(value, "nanosec"):
        return value.sec + 1e-9 * value.nanosec
    if hasattr(value, "w"):
        return value.x, value.y, value.z, value.w
    if isinstance(value, int | float | bool | np.number):
        return float(value)
    raise LaisnError(
        f"topic {request.topic}: field {request.field} holds no number "
        f"(given: {shortened(repr(value), _MAX_CHARACTERS)})"
    )


def _has_value(message: Any, path: Sequence[str]) -> bool:
    """Whether a message has what its field is for. ROS states otherwise

    - by −1 as the first element of the covariance beside a field, as an Imu without an orientation,
    - by a negative status of a NavSatFix without a fix,
    - by a Range outside of the limits that it states itself.
    """
    covariance: Any = getattr(_value(message, path[:-1]), f"{path[-1]}_covariance", ())
    if len(covariance) > 0 and covariance[0] == -1.0:
        return False
    if _is(message, "NavSatFix") and len(path) == 1:
        return bool(message.status.status >= 0)
    if _is(message, "Range") and path == ["range"] and message.max_range > message.min_range:
        return bool(message.min_range <= message.range <= message.max_range)
    return True


def _is(message: object, name: str) -> bool:
    """Whether a message is of a type of sensor_msgs, in ROS 1 or 2."""
    return type(message).__name__ == f"sensor_msgs__msg__{name}"


def _stamp_ns(message: object, logged_ns: int) -> int:
    """Time in the header of a message; without one, or with one of zero, that of recording."""
    header = getattr(message, "header", None)
    stamp = getattr(header, "stamp", None)
    if stamp is None or (stamp.sec == 0 and stamp.nanosec == 0):
        return logged_ns
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _holds(message: object, where: Sequence[tuple[str, Any]]) -> bool:
    """Whether fields of a message have the values of `Request.where`."""
    return all(_value(message, field.split(".")) == expected for field, expected in where)


def _require_fields(path: Path, reader: "AnyReader", requests: Sequence[Request]) -> None:
    """LaisnError naming a topic or field that the bag has not."""
    types = {c.topic: c.msgtype for c in reader.connections}
    for request in requests:
        if request.topic not in types:
            topics = shortened(", ".join(sorted(types)), 800)
            raise LaisnError(f"{path}: has no topic {request.topic}; its topics: {topics}")
        type_name = types[request.topic]
        if type_name not in reader.typestore.fielddefs:
            raise LaisnError(
                f"{path}: topic {request.topic} has the type {type_name}, whose definition is not "
                "in the bag"
            )


class _Message(NamedTuple):
    """A value as it was recorded."""

    position: int  # in order of recording
    recorded_ns: int
    stamp_ns: int
    value: Any


class BagSeries(NamedTuple):
    """What was read of a bag."""

    series: dict[Request, Series]
    remarks: list[str]  # of the recorder's clock


def series_of(path: Path, requests: Sequence[Request], stamps: str = "header") -> BagSeries:
    """Values of fields over time, sorted by time; those of one time keep the last message. Times
    are without steps of clocks (`sim.datasets.bag_clock`).

    `stamps` tells which times: "header", those in messages where they have one, or "log".
    LaisnError: the bag cannot be read, or lacks a topic or field.
    """
    by_topic: dict[str, list[Request]] = {}
    for request in requests:
        by_topic.setdefault(request.topic, []).append(request)
    messages: dict[Request, list[_Message]] = {request: [] for request in requests}
    with _opened(path) as reader:
        _require_fields(path, reader, requests)
        connections = [c for c in reader.connections if c.topic in by_topic]
        clock = RecorderClock(written_order(path, reader.readers, by_topic))
        for connection, logged_ns, raw in reader.messages(connections):
            message = reader.deserialize(raw, connection.msgtype)
            place = clock.place(connection.topic, logged_ns)
            stamp_ns = place.time_ns
            if stamps == "header":
                stamp_ns = _stamp_ns(message, place.time_ns)
            for request in by_topic[connection.topic]:
                try:
                    if not _holds(message, request.where):
                        continue
                    field_path = request.field.split(".")
                    value = _value(message, field_path)
                except (AttributeError, IndexError, TypeError):
                    fields = [*_number_fields(reader.typestore, connection.msgtype)]
                    field_list = shortened(", ".join(fields), 800)
                    names = " or ".join([request.field, *(name for name, _ in request.where)])
                    raise LaisnError(
                        f"{path}: topic {request.topic} has no field {names}; its fields: "
                        f"{field_list}"
                    ) from None
                number = _number(value, request)
                if not _has_value(message, field_path):
                    number = np.full(np.shape(number), np.nan)
                messages[request].append(_Message(*place, stamp_ns, number))
    return BagSeries(
        series={request: _sorted(messages[request]) for request in requests},
        remarks=clock.remarks,
    )


def _sorted(messages: list[_Message]) -> Series:
    """A field over time, by its messages as readers give them."""
    messages.sort(key=lambda message: message.position)
    recorded_ns = np.array([message.recorded_ns for message in messages], dtype=np.int64)
    stamp_ns = np.array([message.stamp_ns for message in messages], dtype=np.int64)
    numbers = np.array([message.value for message in messages], dtype=np.float64)
    time_ns, remarks = corrected_stamps(stamp_ns, recorded_ns)
    order = np.argsort(time_ns, kind="stable")
    is_last = np.append(np.diff(time_ns[order]) > 0, True)[: order.size]
    return Series(
        time_ns=time_ns[order][is_last],
        values=numbers[order][is_last],
        steps_back=int(np.count_nonzero(np.diff(time_ns) < 0)),
        repeated=int(np.count_nonzero(~is_last)),
        remarks=tuple(remarks),
    )

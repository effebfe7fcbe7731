"""ROS 2 messages of one type as a block of bytes: an example is serialised once, and columns of
numbers are written into its copies.

Strings and lengths of sequences are those of the example, so that all messages have its layout.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.arrays import Ints
from laisn.errors import LaisnError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MISSING = (
    "ROS 2 bags need the package rosbags; install it with: pip install rosbags, "
    "or with this program: pip install 'laisn-sim[ros2]'"
)
LINK_RECEPTION_TYPE = "laisn_msgs/msg/LinkReception"
"""Messages of a further link, as the bags of this project have them."""
_HEADER_BYTES = 4  # that stand before a message; alignment counts from behind them
_LAST_SECOND = 2**31 - 1  # builtin_interfaces/Time counts seconds in 32 bits with sign
_STAMP = "header.stamp"


class Leaf(NamedTuple):
    """Where the numbers of a field stand in a message."""

    offset: int  # byte
    dtype: np.dtype[Any]
    n_numbers: int


def typestore() -> Any:
    """Message types of the newest release of ROS 2 that rosbags knows; LaisnError without the
    package.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LaisnError(MISSING) from None
    return get_typestore(Stores.LATEST)


def _value_or_zero(store: "Typestore", description: Any, value: Any) -> Any:
    """The value of a field by its type: `value` where it holds one, else zeros and empty texts."""
    from rosbags.interfaces import Nodetype

    # rosbags: (NAME, type), (BASE, (type, most characters)), or (ARRAY or SEQUENCE, (element,
    # length)) with the element described likewise
    kind, detail = description
    if kind == Nodetype.NAME:
        return build(store, detail, value or {})
    if kind == Nodetype.BASE:
        base, _ = detail
        empty: Any = "" if base == "string" else np.dtype(base).type(0).item()
        return empty if value is None else value
    element, length = detail
    element_kind, element_detail = element
    if element_kind == Nodetype.NAME:
        return [build(store, element_detail, item) for item in value or ()]
    base, _ = element_detail
    if base == "string":
        return list(value or ())
    if value is None:
        return np.zeros(length if kind == Nodetype.ARRAY else 0, base)
    return np.asarray(value, base)


def build(store: "Typestore", type_name: str, values: Mapping[str, Any]) -> Any:
    """A message of a type from the values of its fields, nested ones as mappings; the others are
    zero or empty.
    """
    _, fields = store.fielddefs[type_name]
    return store.types[type_name](
        **{
            name: _value_or_zero(store, description, values.get(name))
            for name, description in fields
        }
    )


@dataclass
class _Walk:
    """Leaves of a message in the order in which they are serialised."""

    store: "Typestore"
    at: int  # byte behind the last one, counted from behind the header
    leaves: dict[str, Leaf]

    def numbers(self, path: str, base: str, count: int) -> None:
        dtype = np.dtype(base).newbyteorder("<")
        if count:
            self.at += -self.at % dtype.itemsize
            self.leaves[path] = Leaf(_HEADER_BYTES + self.at, dtype, count)
        self.at += count * dtype.itemsize

    def length(self) -> None:
        """The number of elements of a sequence, or of bytes of a text."""
        self.at += -self.at % 4 + 4

    def message(self, type_name: str, message: Any, prefix: str) -> None:
        _, fields = self.store.fielddefs[type_name]
        for name, description in fields:
            self.value(description, getattr(message, name), f"{prefix}{name}")

    def value(self, description: Any, value: Any, path: str) -> None:
        from rosbags.interfaces import Nodetype

        kind, detail = description
        if kind == Nodetype.NAME:
            self.message(detail, value, f"{path}.")
        elif kind == Nodetype.BASE and detail[0] == "string":
            self.length()
            self.at += len(value.encode()) + 1
        elif kind == Nodetype.BASE:
            self.numbers(path, detail[0], 1)
        else:
            if kind == Nodetype.SEQUENCE:
                self.length()
            element, _ = detail
            self.elements(element, value, path)

    def elements(self, element: Any, values: Any, path: str) -> None:
        from rosbags.interfaces import Nodetype

        kind, detail = element
        if kind == Nodetype.BASE and detail[0] != "string":
            self.numbers(path, detail[0], len(values))
            return
        for i, value in enumerate(values):
            self.value(element, value, f"{path}.{i}")


def leaves_of(store: "Typestore", type_name: str, message: Any) -> dict[str, Leaf]:
    """Numbers of a message by the path of their field, as "pose.covariance" or
    "transforms.0.transform.translation.x".
    """
    walk = _Walk(store, 0, {})
    walk.message(type_name, message, "")
    return walk.leaves


def stamps(time_ns: Ints) -> tuple[Ints, Ints]:
    """Seconds and nanoseconds of times since 1970, shape (n,) each; LaisnError after January
    2038, when ROS 2's end.
    """
    seconds, nanoseconds = np.divmod(time_ns, 10**9)
    if time_ns.size and seconds.max() > _LAST_SECOND:
        raise LaisnError(
            "epoch: stamps of ROS 2 end in January 2038, and this mission is later; give it an "
            "earlier epoch"
        )
    return seconds, nanoseconds


@dataclass(frozen=True)
class Template:
    """Messages of a type that differ in numbers alone."""

    store: "Typestore"
    type_name: str
    example: Mapping[str, Any]  # values of fields, nested ones as mappings

    def rows(
        self,
        time_ns: Ints,
        columns: Mapping[str, npt.ArrayLike],
        stamped: Sequence[str] = (_STAMP,),
    ) -> list[bytes]:
        """Serialised messages of n times [ns], with a column of n rows for each path of
        `leaves_of`; paths of `stamped` hold the times.
        """
        message = build(self.store, self.type_name, self.example)
        leaves = leaves_of(self.store, self.type_name, message)
        encoded = bytes(self.store.serialize_cdr(message, self.type_name))
        block = np.tile(np.frombuffer(encoded, np.uint8), (time_ns.size, 1))
        seconds, nanoseconds = stamps(time_ns)
        filled: dict[str, npt.ArrayLike] = dict(columns)
        for path in stamped:
            filled[f"{path}.sec"] = seconds
            filled[f"{path}.nanosec"] = nanoseconds
        for path, values in filled.items():
            leaf = leaves[path]
            n_bytes = leaf.n_numbers * leaf.dtype.itemsize
            numbers = np.ascontiguousarray(values, dtype=leaf.dtype).reshape(
                time_ns.size, leaf.n_numbers
            )
            block[:, leaf.offset : leaf.offset + n_bytes] = numbers.view(np.uint8)
        data = block.tobytes()
        length = len(encoded)
        return [data[i : i + length] for i in range(0, len(data), length)]

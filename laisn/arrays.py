"""Array types for annotations (docstrings give shapes), records with named fields, and checked,
frozen dataclasses.
"""

import math
import numbers
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeAlias,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
import numpy.typing as npt

from laisn.errors import LaisnError
from laisn.spilled import is_long, is_spilled, spillable_zeros

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Record: TypeAlias = Any
"""One record of a structured dtype that no class declares; its fields are attributes."""
Records: TypeAlias = Any
"""An array of them."""


def records(dtype: npt.DTypeLike, *shape: int) -> Records:
    """Records of a structured dtype, all zero."""
    return spillable_zeros(shape, dtype).view(np.recarray)


class RecordFields:
    """A class whose annotations declare the fields of a record of `record_dtype`: `float`, `int` or
    another such class; an array of numbers, as `Annotated[Floats, (3, 3)]`; of another such class,
    as `Annotated[list[Other], (8,)]`; or of a layout that is made elsewhere, as
    `Annotated[Records, LAYOUT, (8,)]`.

    Its objects are records of numpy's.
    """

    if TYPE_CHECKING:
        dtype: np.dtype[np.void]

        def __getitem__(self, field: str | list[str]) -> Any: ...
        def __setitem__(self, field: str, value: Any) -> None: ...


def record_dtype(declaration: type[RecordFields]) -> np.dtype[np.void]:
    """Layout of the records that a class declares; their fields are attributes."""
    return np.dtype((np.record, row_dtype(declaration)))


def row_dtype(declaration: type[RecordFields]) -> np.dtype[np.void]:
    """The same of rows of a plain array, whose fields are items."""
    return np.dtype(_layout_of(declaration), align=True)


_ELEMENTS: dict[Any, type[np.generic]] = {
    float: np.float64,
    int: np.int64,
    bool: np.bool_,
    Floats: np.float64,
    Ints: np.int64,
}


def _layout_of(declaration: type[RecordFields]) -> list[Any]:
    """Names, types and shapes of the fields that a class declares."""
    layout = []
    for name, hint in get_type_hints(declaration, include_extras=True).items():
        element, *element_type, shape = (
            get_args(hint) if get_origin(hint) is Annotated else (hint, ())
        )
        if get_origin(element) is list:
            (element,) = get_args(element)
        if element_type:
            (field_type,) = element_type
        elif isinstance(element, type) and issubclass(element, RecordFields):
            field_type = _layout_of(element)
        else:
            field_type = _ELEMENTS[element]
        layout.append((name, field_type, shape))
    return layout


def numbers_of(array: Records) -> Floats:
    """The memory of records that hold float numbers alone as an array, its last axis over their
    fields.
    """
    return np.asarray(array).view(np.float64).reshape(*array.shape, len(array.dtype.names))


def have_same_bits(first: object, second: object) -> bool:
    """Whether two values, arrays of numbers or tuples of such are of the same type, shape and
    bits.
    """
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(have_same_bits, first, second))
    left = np.asarray(first)
    right = np.asarray(second)
    if left.dtype != right.dtype or left.shape != right.shape:
        return False
    # as bytes, since a NaN does not equal itself, and a zero equals that of the other sign
    left_bytes = np.ascontiguousarray(left).view(np.uint8)
    return np.array_equal(left_bytes, np.ascontiguousarray(right).view(np.uint8))


Two = tuple[float, float]
Four = tuple[float, float, float, float]
Offset = tuple[float, float, float]
"""Forward, port and up from a body's origin [m]."""


class ArrayRecord:
    """A dataclass of arrays that prints their shapes in place of their values."""

    def __repr__(self) -> str:
        parts = []
        for field in fields(cast(Any, self)):
            value = getattr(self, field.name)
            is_array = isinstance(value, np.ndarray)
            parts.append(
                f"{field.name} {value.shape}" if is_array else f"{field.name}={value!r}"[:100]
            )
        return f"<{type(self).__name__}: {', '.join(parts)}>"


def require_shapes(record: object, expected: Mapping[str, tuple[int, ...]]) -> None:
    """ValueError naming the first array of a record, by its field, whose shape is not the
    expected one.
    """
    for name, shape in expected.items():
        actual = getattr(record, name).shape
        if actual != shape:
            raise ValueError(f"{type(record).__name__}.{name} has shape {actual}, expected {shape}")


@cache
def _declared_types(kind: type) -> dict[str, Any]:
    """Types that a dataclass declares of its fields; none where they have names that are not there
    at run time.
    """
    try:
        return get_type_hints(kind)
    except (NameError, TypeError, AttributeError, SyntaxError):
        return {}


class _UnexpectedError(Exception):
    """A value is not of the declared type; the text says what was expected."""


_BOOLS = (bool, np.bool_)


def _number(value: Any, kind: Any, name: str) -> Any:
    if isinstance(value, _BOOLS) or not isinstance(value, kind):
        raise _UnexpectedError(name)
    return value


def _as_bool(value: Any) -> bool:
    if not isinstance(value, _BOOLS):
        raise _UnexpectedError("True or False")
    return bool(value)


def _as_text(value: Any) -> str:
    if not isinstance(value, str):
        raise _UnexpectedError("a text")
    return value


def _as_tuple(value: Any, hint: Any) -> tuple[Any, ...]:
    """A tuple, list or array by a hint as `tuple[float, ...]` or `tuple[float, float]`."""
    declared = get_args(hint)
    if not isinstance(value, tuple | list | np.ndarray):
        raise _UnexpectedError("a tuple")
    if declared[1:] == (...,):
        return tuple(_as_declared(item, declared[0]) for item in value)
    if len(value) != len(declared):
        raise _UnexpectedError(f"{len(declared)} values")
    return tuple(map(_as_declared, value, declared))


def _as_one_of(value: Any, hints: tuple[Any, ...]) -> Any:
    """A value as the first of several types that it is of."""
    expected = []
    for hint in hints:
        try:
            return _as_declared(value, hint)
        except _UnexpectedError as error:
            expected.append(str(error))
    raise _UnexpectedError(" or ".join(expected))


def _as_none(value: Any) -> None:
    if value is not None:
        raise _UnexpectedError("None")


_SIMPLE: dict[Any, Callable[[Any], Any]] = {
    float: lambda value: float(_number(value, numbers.Real, "a finite number")),
    int: lambda value: int(_number(value, numbers.Integral, "a whole number")),
    bool: _as_bool,
    str: _as_text,
    NoneType: _as_none,
}
"""How a value of the types that are checked becomes the one of the type itself."""


def _as_declared(value: Any, hint: Any) -> Any:
    """A value as the declared type has it: whole numbers and those of NumPy as `float` where that
    is the type; _UnexpectedError of another type. Types of users' own are not checked.
    """
    if hint in _SIMPLE:
        return _SIMPLE[hint](value)
    if get_origin(hint) is Literal:
        choices = get_args(hint)
        if not any(type(value) is type(choice) and value == choice for choice in choices):
            raise _UnexpectedError(f"one of {', '.join(map(str, choices))}")
        return value
    if get_origin(hint) is tuple and get_args(hint):
        return _as_tuple(value, hint)
    if get_origin(hint) in (Union, UnionType):
        return _as_one_of(value, get_args(hint))
    if isinstance(hint, type) and is_dataclass(hint) and not isinstance(value, hint):
        raise _UnexpectedError(f"an object of {hint.__name__}")
    return value


def _numbers_in(value: Any) -> Iterator[float]:
    """The numbers of a value of nested tuples."""
    if isinstance(value, tuple):
        for item in value:
            yield from _numbers_in(item)
    elif isinstance(value, float):
        yield value


def require_numbers(
    record: "DataclassInstance",
    *,
    positive: Collection[str] = (),
    signed: Collection[str] = (),
    chances: Collection[str] = (),
) -> None:
    """LaisnError naming a field of a frozen record that is not of the type that its class declares,
    or a number of it that is not finite, or, of one alone, negative unless `signed`, 0 if
    `positive`, or not between 0 and 1 if of `chances`.

    A `float` may be given as any real number that is no truth value, and becomes a `float`.
    """
    hints = _declared_types(type(record))
    for field in fields(record):
        name = field.name
        given = getattr(record, name)
        hint = hints.get(name, type(given))
        bound = ""
        if name in chances:
            bound = " between 0 and 1"
        elif hint is float and name not in signed:
            bound = ", positive" if name in positive else ", zero or more"
        try:
            value = _as_declared(given, hint)
        except _UnexpectedError as error:
            raise LaisnError(f"{name} is {given!r:.80}, expected {error}{bound}") from None
        is_low = bound and (value < 0.0 or (value == 0.0 and name in {*positive, *chances}))
        is_high = name in chances and value >= 1.0
        if is_low or is_high or not all(map(math.isfinite, _numbers_in(value))):
            raise LaisnError(f"{name} is {given}, expected a finite number{bound}")
        if value is not given:
            object.__setattr__(record, name, value)


def _is_read_only(array: npt.NDArray[Any]) -> bool:
    """Whether an array is contiguous, and neither it nor an array that it is a view of can be
    written.
    """
    owner: Any = array
    while isinstance(owner, np.ndarray) and not owner.flags.writeable:
        owner = owner.base
    return (owner is None or is_spilled(owner)) and array.flags.forc


def _copied(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A copy in the order of the given array, so that sums over it round alike."""
    in_order = all(before >= after for before, after in pairwise(array.strides))
    if not (in_order and is_long(array.shape)):
        return array.copy(order="K")
    copy = spillable_zeros(array.shape, array.dtype)
    copy[...] = array
    return copy


def freeze_arrays(record: "DataclassInstance") -> None:
    """Replace the arrays of a frozen record, in its `__post_init__`, by read-only copies unless
    they are read-only.
    """
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray) and not _is_read_only(value):
            copy = _copied(value)
            copy.flags.writeable = False
            object.__setattr__(record, field.name, copy)

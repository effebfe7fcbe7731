"""Values of compiled code that stay in memory from call to call.

To hand over a structure of a hundred arrays takes numba some eighty microseconds. What is held is
handed over once; compiled functions get its address, and read it by `held_values`.
"""

# mypy: allow-untyped-calls

import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NoReturn, SupportsIndex, cast

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.extending import NativeValue, intrinsic, register_model, typeof_impl, unbox

from laisn.compiled import compiled
from laisn.errors import LaisnError

if TYPE_CHECKING:
    from llvmlite.ir import IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.datamodel.manager import DataModelManager
    from numba.core.pythonapi import _UnboxContext
    from numba.core.typing.templates import Signature


class HeldType(types.Type):
    """The type of held values of a type."""

    def __init__(self, values: types.Type) -> None:
        self.values = values
        super().__init__(name=f"Held({values})")

    @property
    def key(self) -> Any:
        """What tells it from others."""
        return self.values


@register_model(HeldType)
class _HeldModel(PrimitiveModel):
    """In compiled code it is the address of the values."""

    def __init__(self, manager: "DataModelManager", held: HeldType) -> None:
        super().__init__(manager, held, cgutils.intp_t)


@unbox(HeldType)
def _unbox(_: HeldType, held: "Value", c: "_UnboxContext") -> NativeValue:
    address = c.pyapi.object_getattr_string(held, "address")
    value = c.pyapi.number_as_ssize_t(address)
    c.pyapi.decref(address)
    return NativeValue(value)


def _pointer(
    context: "BaseContext", builder: "IRBuilder", kind: types.Type, address: "Value"
) -> "Value":
    return builder.inttoptr(address, ir.PointerType(context.get_value_type(kind)))


def _emit_store(_: object, values: types.Type) -> Any:
    def generate(
        context: "BaseContext",
        builder: "IRBuilder",
        signature: "Signature",
        args: Sequence["Value"],
    ) -> "Value":
        (kind,) = signature.args
        context.nrt.incref(builder, kind, args[0])
        size = context.get_abi_sizeof(context.get_value_type(kind))
        room = context.nrt.allocate(builder, context.get_constant(types.intp, size))
        address = builder.ptrtoint(room, cgutils.intp_t)
        builder.store(args[0], _pointer(context, builder, kind, address))
        return address

    return types.intp(values), generate


def _borrowed(
    context: "BaseContext", builder: "IRBuilder", kind: types.Type, values: "Value"
) -> "Value":
    """The same values, whose arrays do not count as references to their memory: the `Held` has
    one.
    """
    if isinstance(kind, types.BaseTuple):
        for i, member in enumerate(cast(Any, kind).types):
            borrowed = _borrowed(context, builder, member, builder.extract_value(values, i))
            values = builder.insert_value(values, borrowed, i)
        return values
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, values)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        return array._getvalue()
    context.nrt.incref(builder, kind, values)
    return values


def _emit_load(_: object, held: types.Type) -> Any:
    if not isinstance(held, HeldType):
        return None

    def generate(
        context: "BaseContext",
        builder: "IRBuilder",
        signature: "Signature",
        args: Sequence["Value"],
    ) -> "Value":
        kind = signature.return_type
        values = builder.load(_pointer(context, builder, kind, args[0]))
        return _borrowed(context, builder, kind, values)

    return held.values(held), generate


def _emit_borrowed(_: object, values: types.Type) -> Any:
    def generate(
        context: "BaseContext",
        builder: "IRBuilder",
        signature: "Signature",
        args: Sequence["Value"],
    ) -> "Value":
        return _borrowed(context, builder, signature.return_type, args[0])

    return values(values), generate


def _emit_release(_: object, held: HeldType) -> Any:
    def generate(
        context: "BaseContext",
        builder: "IRBuilder",
        signature: "Signature",
        args: Sequence["Value"],
    ) -> "Value":
        kind = signature.args[0].values
        pointer = _pointer(context, builder, kind, args[0])
        context.nrt.decref(builder, kind, builder.load(pointer))
        context.nrt.free(builder, builder.bitcast(pointer, cgutils.voidptr_t))
        return context.get_dummy_value()

    return types.none(held), generate


_store: Any = cast(Any, intrinsic(_emit_store))
held_values: Any = cast(Any, intrinsic(_emit_load))
"""The values that a `Held` holds, which must not outlive it: counting references to its arrays
would take some 5 % of a mission. To be called from compiled code only.
"""
borrowed_values: Any = cast(Any, intrinsic(_emit_borrowed))
"""The same values, whose arrays count no references: for the arguments of a call, which those of
its caller keep in memory. To be called from compiled code only.
"""
_release: Any = cast(Any, intrinsic(_emit_release))


@compiled
def _store_values(values: object) -> int:
    return int(_store(values))


@compiled
def _release_values(held: "Held") -> None:
    _release(held)


def _structure(values: object) -> object:
    """What the type of values follows from: a key of `_held_types`.

    Arrays are of `numpy.ndarray` or a class of it, records of `numpy.void`, and numbers have the
    types themselves for keys.
    """
    if isinstance(values, tuple):
        return type(values), *map(_structure, values)
    if isinstance(values, np.ndarray):
        flags = values.flags
        layout = (flags.c_contiguous, flags.f_contiguous, flags.writeable)
        return type(values), values.ndim, layout, *_structure_of_elements(values.dtype)
    if isinstance(values, np.void):
        return type(values), *_structure_of_elements(values.dtype)
    return numba.typeof(values)


def _structure_of_elements(dtype: np.dtype[Any]) -> tuple[object, ...]:
    """A type of elements, and whether the records in it are aligned, which equal ones need not
    be alike.
    """
    dtype, shape = dtype.subdtype or (dtype, ())
    if dtype.names is None:
        return dtype, shape
    members = [_structure_of_elements(dtype[name]) for name in dtype.names]
    return dtype, shape, dtype.isalignedstruct, *members


# the types of the values that were held last, by `_structure`: to find one takes some 10 ms
_held_types: dict[object, HeldType] = {}
_MOST_TYPES = 64


def _held_type(values: object) -> HeldType:
    """The type of held values, whose memory can be given back from now on."""
    structure = _structure(values)
    held_type = _held_types.get(structure)
    if held_type is not None:
        return held_type
    held_type = HeldType(numba.typeof(values))
    # an object may go at any time, also while something else is compiled
    cast(Any, _release_values).compile((held_type,))
    while len(_held_types) >= _MOST_TYPES:
        _held_types.pop(next(iter(_held_types)), None)
    _held_types[structure] = held_type
    return held_type


def refuse_copy(holder: object) -> NoReturn:
    """LaisnError: `holder` holds addresses in memory. A copy of it would work on the memory of the
    original, or on what is there when the original is gone.
    """
    name = type(holder).__name__
    raise LaisnError(
        f"{name} holds addresses in memory, so it is neither copied nor pickled; make a new one"
    )


class Held:
    """Values of compiled code, such as a NamedTuple of arrays, in memory until this object goes."""

    # the last name is numba's
    __slots__ = ("_numba_type_", "_values", "address")

    def __init__(self, values: object) -> None:
        # records are views of the memory of these objects
        self._values = values
        self._numba_type_ = _held_type(values)
        self.address = _store_values(values)

    @property
    def type(self) -> HeldType:
        """The type of the values for the compiler."""
        return self._numba_type_

    def __del__(
        self,
        release: Callable[["Held"], None] = _release_values,
        ends: Callable[[], bool] = sys.is_finalizing,
    ) -> None:
        """Give the memory back."""
        if hasattr(self, "address") and not ends():
            release(self)

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `refuse_copy`."""
        refuse_copy(self)


@typeof_impl.register(Held)
def _typeof(held: Held, _: object) -> Any:
    return held._numba_type_

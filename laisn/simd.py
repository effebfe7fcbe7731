"""Lanes: eight numbers that compiled code computes with as with one.

A formula that is compiled for numbers is compiled for lanes by its arguments' types, with the same
operations and, lane by lane, the same bits. What depends on a condition is written with `select`,
what is left out where no lane needs it with `any_lane`; other branches must be the same for all
lanes. Elementary functions of the C library are called lane by lane.

Memory holds the eight numbers of a place side by side: an array of shape (…, LANES) is
`lanes_of(array)` to compiled code, an array of lanes of shape (…). A record of such arrays is
`lane_records(array)[i]`: fields of whole numbers are shared by all lanes.
"""

# mypy: allow-untyped-calls, allow-untyped-defs

import math
import operator
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel, StructModel
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AttributeTemplate, signature
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_builtin,
    lower_cast,
    lower_getattr_generic,
    lower_setattr_generic,
    overload,
    register_model,
    type_callable,
)

from laisn.arrays import Bools, Floats
from laisn.compiled import select

if TYPE_CHECKING:
    from llvmlite.ir import IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.typing.templates import Signature

LANES = 8
Emit = Callable[..., Any]
"""Emits code of an operation: by the context of the compiler, the builder and the operands."""

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_MASK = ir.VectorType(ir.IntType(1), LANES)
_BITS = ir.VectorType(ir.IntType(64), LANES)


class LaneType(types.Type):
    """Eight numbers."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes({LANES})")

    def can_convert_from(self, _: Any, other: Any) -> Any:
        """Whether one number stands for eight alike."""
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None


class MaskType(types.Type):
    """Eight conditions."""

    def __init__(self) -> None:
        super().__init__(name=f"LaneMask({LANES})")


class BitsType(types.Type):
    """The bits of eight numbers, each an unsigned integer of 64 bits."""

    def __init__(self) -> None:
        super().__init__(name=f"LaneBits({LANES})")


lane = LaneType()
mask = MaskType()
bits = BitsType()


@register_model(LaneType)
class _LaneModel(PrimitiveModel):
    def __init__(self, manager: object, kind: types.Type) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(MaskType)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager: object, kind: types.Type) -> None:
        super().__init__(manager, kind, _MASK)


@register_model(BitsType)
class _BitsModel(PrimitiveModel):
    def __init__(self, manager: object, kind: types.Type) -> None:
        super().__init__(manager, kind, _BITS)


def _splat(builder: "IRBuilder", value: "Value") -> "Value":
    """Eight times a number."""
    undefined = ir.Constant(ir.VectorType(value.type, LANES), ir.Undefined)
    single = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(single, undefined, order)


def _as_lane(
    context: "BaseContext", builder: "IRBuilder", kind: types.Type, value: "Value"
) -> "Value":
    """A value as eight numbers."""
    if isinstance(kind, LaneType):
        return value
    return _splat(builder, context.cast(builder, value, kind, types.float64))


@lower_cast(types.Float, LaneType)
@lower_cast(types.Integer, LaneType)
def _cast_number(
    context: "BaseContext", builder: "IRBuilder", kind: types.Type, _: Any, value: "Value"
) -> "Value":
    return _as_lane(context, builder, kind, value)


def _is_operand(kind: types.Type) -> bool:
    return isinstance(kind, LaneType | types.Float | types.Integer)


_PAIRS = (
    (LaneType, LaneType),
    (LaneType, types.Float),
    (types.Float, LaneType),
    (LaneType, types.Integer),
    (types.Integer, LaneType),
)


def _define_pairwise(
    function: Callable[..., object], emit: Emit, result: types.Type = lane
) -> None:
    """A function of two numbers, of which one is lanes."""

    @type_callable(function)
    def type_operation(_: object) -> Any:
        def typer(a, b):  # numba compares signatures
            lanes_taken = isinstance(a, LaneType) or isinstance(b, LaneType)
            return result if lanes_taken and _is_operand(a) and _is_operand(b) else None

        return typer

    for pair in _PAIRS:

        @lower_builtin(function, *pair)
        def lower_operation(
            context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
        ) -> "Value":
            values = [
                _as_lane(context, builder, kind, value)
                for kind, value in zip(sig.args, args, strict=True)
            ]
            return emit(context, builder, values)


def _define_binary(
    function: Callable[..., object],
    result: types.Type,
    emit: Callable[["IRBuilder", "Value", "Value"], "Value"],
) -> None:
    """An operation of two operands, of which one is lanes."""
    _define_pairwise(function, lambda _, builder, ab: emit(builder, *ab), result)


def _larger(builder: "IRBuilder", a: "Value", b: "Value") -> "Value":
    # as numba's max of numbers
    return builder.select(builder.fcmp_ordered(">", b, a), b, a)


def _smaller(builder: "IRBuilder", a: "Value", b: "Value") -> "Value":
    return builder.select(builder.fcmp_ordered("<", b, a), b, a)


for _operation, _emit in (
    ("add", lambda builder, a, b: builder.fadd(a, b)),
    ("sub", lambda builder, a, b: builder.fsub(a, b)),
    ("mul", lambda builder, a, b: builder.fmul(a, b)),
    ("truediv", lambda builder, a, b: builder.fdiv(a, b)),
):
    _define_binary(getattr(operator, _operation), lane, _emit)
    _define_binary(getattr(operator, f"i{_operation}"), lane, _emit)
_define_binary(max, lane, _larger)
_define_binary(min, lane, _smaller)


def _define_comparison(function: Callable[..., object], sign: str) -> None:
    unordered = sign == "!="

    def emit(builder: "IRBuilder", a: "Value", b: "Value") -> "Value":
        compare = builder.fcmp_unordered if unordered else builder.fcmp_ordered
        return compare(sign, a, b)

    _define_binary(function, mask, emit)


for _function, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _define_comparison(_function, _sign)


def _define_unary(
    function: Callable[..., object], operand: type[types.Type], result: types.Type, emit: Emit
) -> None:
    @type_callable(function)
    def type_operation(_: object) -> Any:
        return lambda a: result if isinstance(a, operand) else None

    @lower_builtin(function, operand)
    def lower_operation(
        context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
    ) -> "Value":
        return emit(context, builder, args[0])


def _call_intrinsic(builder: "IRBuilder", name: str, values: Sequence["Value"]) -> "Value":
    """A function of the processor or the compiler, of all lanes at once."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(values))
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
    return builder.call(function, values)


def _by_intrinsic(name: str) -> Any:
    return lambda _, builder, a: _call_intrinsic(builder, name, [a])


def _by_lane(function: Callable[..., object]) -> Any:
    """A function of the C library, lane by lane."""

    def emit(context: "BaseContext", builder: "IRBuilder", *values: "Value") -> "Value":
        sig = signature(types.float64, *[types.float64] * len(values))
        called = context.get_function(function, sig)
        out = ir.Constant(_VECTOR, ir.Undefined)
        for i in range(LANES):
            place = ir.Constant(ir.IntType(32), i)
            numbers = [builder.extract_element(value, place) for value in values]
            out = builder.insert_element(out, called(builder, numbers), place)
        return out

    return emit


def _same(_: Any, __: Any, a: Any) -> Any:
    return a


_define_unary(float, LaneType, lane, _same)
_define_unary(operator.pos, LaneType, lane, _same)
_define_unary(operator.neg, LaneType, lane, lambda _, builder, a: builder.fneg(a))
_define_unary(abs, LaneType, lane, _by_intrinsic("fabs"))
_define_unary(np.sqrt, LaneType, lane, _by_intrinsic("sqrt"))
_define_unary(math.sqrt, LaneType, lane, _by_intrinsic("sqrt"))
for _name in ("exp", "sin", "cos"):
    for _module in (np, math):
        _define_unary(getattr(_module, _name), LaneType, lane, _by_lane(getattr(math, _name)))
_define_unary(np.arcsin, LaneType, lane, _by_lane(math.asin))
_define_unary(np.arctan, LaneType, lane, _by_lane(math.atan))


def fma_of_lanes(*kinds: types.Type) -> Any:
    """Signature and code of `laisn.vector_math.fma` where a number is lanes."""

    def generate(
        context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
    ) -> "Value":
        values = [
            _as_lane(context, builder, kind, value)
            for kind, value in zip(sig.args, args, strict=True)
        ]
        return _call_intrinsic(builder, "fma", values)

    return lane(*kinds), generate


_define_pairwise(
    np.arctan2, lambda context, builder, ab: _by_lane(math.atan2)(context, builder, *ab)
)
_define_pairwise(
    operator.mod, lambda context, builder, ab: _by_lane(operator.mod)(context, builder, *ab)
)
_define_pairwise(np.copysign, lambda _, builder, ab: _call_intrinsic(builder, "copysign", ab))
_define_pairwise(np.hypot, lambda context, builder, ab: _by_lane(math.hypot)(context, builder, *ab))


def _define_logic(function: Callable[..., object], name: str) -> None:
    @type_callable(function)
    def type_operation(_: object) -> Any:
        def typer(a, b):  # numba compares signatures
            return mask if isinstance(a, MaskType) and isinstance(b, MaskType) else None

        return typer

    @lower_builtin(function, MaskType, MaskType)
    def lower_operation(
        _: object, builder: "IRBuilder", __: object, args: Sequence["Value"]
    ) -> Any:
        return getattr(builder, name)(*args)


_define_logic(operator.and_, "and_")
_define_logic(operator.or_, "or_")
_define_unary(operator.invert, MaskType, mask, lambda _, builder, a: builder.not_(a))


def _define_bitwise(function: Callable[..., object], emit: Emit, result: types.Type = bits) -> None:
    """An operation of bits and bits, or an unsigned integer."""

    @type_callable(function)
    def type_operation(_: object) -> Any:
        def typer(a, b):  # numba compares signatures
            known = isinstance(a, BitsType) and (isinstance(b, BitsType) or b == types.uint64)
            return result if known else None

        return typer

    for other in (BitsType, types.uint64):

        @lower_builtin(function, BitsType, other)
        def lower_operation(
            _: object, builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
        ) -> "Value":
            a, b = args
            return emit(builder, a, b if isinstance(sig.args[1], BitsType) else _splat(builder, b))


for _function, _emit in (
    (operator.and_, lambda builder, a, b: builder.and_(a, b)),
    (operator.xor, lambda builder, a, b: builder.xor(a, b)),
    (operator.add, lambda builder, a, b: builder.add(a, b)),
    (operator.lshift, lambda builder, a, b: builder.shl(a, b)),
):
    _define_bitwise(_function, _emit)
_define_bitwise(operator.ne, lambda builder, a, b: builder.icmp_unsigned("!=", a, b), mask)


def bitcast_of_lanes(source: types.Type, target: types.Type) -> Any:
    """Signature and code of `laisn.vector_math.to_bits` and `from_bits` of lanes."""

    def generate(
        context: "BaseContext", builder: "IRBuilder", _: object, args: Sequence["Value"]
    ) -> "Value":
        return builder.bitcast(args[0], context.get_value_type(target))

    return target(source), generate


def _emit_select(_: object, condition: types.Type, chosen: types.Type, other: types.Type) -> Any:
    def generate(
        context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
    ) -> "Value":
        a = _as_lane(context, builder, sig.args[1], args[1])
        b = _as_lane(context, builder, sig.args[2], args[2])
        return builder.select(args[0], a, b)

    return lane(condition, chosen, other), generate


_select_lanes: Any = cast(Any, intrinsic(_emit_select))


@overload(select, strict=False)
def _select(condition: types.Type, chosen: types.Type, other: types.Type) -> Any:
    if not isinstance(condition, MaskType):
        return None
    return lambda condition, chosen, other: _select_lanes(condition, chosen, other)


def like(number: float, other: float | Floats) -> float:
    """A number, eight times where another value is lanes: what is to be added up in a loop, whose
    type must not change there.
    """
    return number


@overload(like, strict=False)
def _like(number: types.Type, other: types.Type) -> Any:
    if isinstance(other, LaneType):
        return lambda number, other: _select_lanes(other == other, number, number)
    return lambda number, other: number


def _bits(builder: "IRBuilder", value: "Value") -> "Value":
    return builder.bitcast(value, ir.IntType(LANES))


def _emit_any(_: object, condition: types.Type) -> Any:
    def generate(__: object, builder: "IRBuilder", ___: object, args: Sequence["Value"]) -> Any:
        none = ir.Constant(ir.IntType(LANES), 0)
        return builder.icmp_unsigned("!=", _bits(builder, args[0]), none)

    return types.boolean(condition), generate


def _emit_all(_: object, condition: types.Type) -> Any:
    def generate(__: object, builder: "IRBuilder", ___: object, args: Sequence["Value"]) -> Any:
        every = ir.Constant(ir.IntType(LANES), (1 << LANES) - 1)
        return builder.icmp_unsigned("==", _bits(builder, args[0]), every)

    return types.boolean(condition), generate


_any_of_mask: Any = cast(Any, intrinsic(_emit_any))
_all_of_mask: Any = cast(Any, intrinsic(_emit_all))


def any_lane(condition: bool | Bools) -> bool:
    """Whether a condition holds, of lanes in any of them."""
    return bool(condition)


def all_lanes(condition: bool | Bools) -> bool:
    """Whether a condition holds, of lanes in all of them."""
    return bool(condition)


@overload(any_lane, strict=False, inline="always")
def _any_lane(condition: types.Type) -> Any:
    if isinstance(condition, MaskType):
        return lambda condition: _any_of_mask(condition)
    return lambda condition: condition


@overload(all_lanes, strict=False, inline="always")
def _all_lanes(condition: types.Type) -> Any:
    if isinstance(condition, MaskType):
        return lambda condition: _all_of_mask(condition)
    return lambda condition: condition


class LanesType(types.Type):
    """An array of lanes, in the memory of an array of numbers that lives longer."""

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions
        super().__init__(name=f"LaneArray({dimensions})")


class LaneRecordsType(types.Type):
    """An array of records of lanes, likewise."""

    def __init__(self, record: types.Record, dimensions: int) -> None:
        self.record = record
        self.dimensions = dimensions
        super().__init__(name=f"LaneRecords({record}, {dimensions})")


class LaneRecordType(types.Type):
    """One of these records."""

    def __init__(self, record: types.Record) -> None:
        self.record = record
        super().__init__(name=f"LaneRecord({record})")


class _ArrayModel(StructModel):
    """The address of the first number, and the shape."""

    def __init__(self, manager: object, kind: "LanesType | LaneRecordsType") -> None:
        shape = types.UniTuple(types.intp, kind.dimensions)
        super().__init__(manager, kind, [("data", types.voidptr), ("shape", shape)])


register_model(LanesType)(_ArrayModel)
register_model(LaneRecordsType)(_ArrayModel)


@register_model(LaneRecordType)
class _RecordModel(PrimitiveModel):
    """Its address."""

    def __init__(self, manager: object, kind: types.Type) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)


_Shaped = LanesType | LaneRecordsType


def _view(
    context: "BaseContext",
    builder: "IRBuilder",
    kind: types.Type,
    address: "Value",
    shape: Sequence["Value"],
) -> "Value":
    """An array of a type by its address and shape."""
    view = cgutils.create_struct_proxy(kind)(context, builder)
    view.data = address
    view.shape = cgutils.pack_array(builder, shape, cgutils.intp_t)
    return view._getvalue()


def _emit_lanes_of(_: object, array: types.Type) -> Any:
    if not (isinstance(array, types.Array) and array.layout == "C"):
        return None
    if isinstance(array.dtype, types.Record):
        kind: LanesType | LaneRecordsType = LaneRecordsType(array.dtype, array.ndim)
    else:
        kind = LanesType(array.ndim - 1)

    def generate(
        context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
    ) -> "Value":
        (taken,) = sig.args
        source = context.make_array(taken)(context, builder, args[0])
        shape = cgutils.unpack_tuple(builder, source.shape, kind.dimensions)
        address = builder.bitcast(source.data, cgutils.voidptr_t)
        return _view(context, builder, kind, address, shape)

    return kind(array), generate


lanes_of: Callable[[Any], Any] = cast(Any, intrinsic(_emit_lanes_of))
"""An array of shape (…, LANES), or of records of such arrays, as one of lanes; it holds no
reference to the memory. To be called from compiled code only.
"""


@infer_getattr
class _ShapeOfLanes(AttributeTemplate):
    key = LanesType

    def resolve_shape(self, array: LanesType) -> types.Type:
        return types.UniTuple(types.intp, array.dimensions)


@infer_getattr
class _ShapeOfRecords(AttributeTemplate):
    key = LaneRecordsType

    def resolve_shape(self, array: LaneRecordsType) -> types.Type:
        return types.UniTuple(types.intp, array.dimensions)


@lower_getattr_generic(LanesType)
@lower_getattr_generic(LaneRecordsType)
def _lower_shape(
    context: "BaseContext", builder: "IRBuilder", kind: types.Type, value: "Value", _: str
) -> "Value":
    return cgutils.create_struct_proxy(kind)(context, builder, value=value).shape


def _element_size(kind: types.Type) -> int:
    return int(kind.record.size) if isinstance(kind, LaneRecordsType) else 8 * LANES


def _item_type(kind: LanesType | LaneRecordsType, count: int) -> types.Type:
    """Type of what an index of so many whole numbers takes of an array."""
    left = kind.dimensions - count
    if isinstance(kind, LaneRecordsType):
        return LaneRecordsType(kind.record, left) if left else LaneRecordType(kind.record)
    return LanesType(left) if left else lane


def _index_types(index: types.Type) -> tuple[types.Type, ...]:
    return tuple(cast(Any, index)) if isinstance(index, types.BaseTuple) else (index,)


def _is_index(kind: LanesType | LaneRecordsType, index: types.Type) -> bool:
    places = _index_types(index)
    return len(places) <= kind.dimensions and all(isinstance(p, types.Integer) for p in places)


@type_callable(operator.getitem)
def _type_getitem(_: object) -> Any:
    def typer(array, index):  # numba compares signatures
        if isinstance(array, _Shaped) and _is_index(array, index):
            return _item_type(array, len(_index_types(index)))
        return None

    return typer


@type_callable(operator.setitem)
def _type_setitem(_: object) -> Any:
    def typer(array, index, value):  # numba compares signatures
        if isinstance(array, LanesType) and _is_index(array, index) and _is_operand(value):
            return types.none
        return None

    return typer


def _locate(
    context: "BaseContext",
    builder: "IRBuilder",
    kind: LanesType | LaneRecordsType,
    array: "Value",
    index_type: types.Type,
    index: "Value",
) -> "Value":
    """Address of an item, and the shape of what lies there."""
    view = cgutils.create_struct_proxy(kind)(context, builder, value=array)
    shape = cgutils.unpack_tuple(builder, view.shape, kind.dimensions)
    places = [index]
    if isinstance(index_type, types.BaseTuple):
        places = cgutils.unpack_tuple(builder, index, len(index_type))
    offset = ir.Constant(cgutils.intp_t, 0)
    for axis in range(kind.dimensions):
        offset = builder.mul(offset, shape[axis])
        if axis < len(places):
            place = context.cast(builder, places[axis], _index_types(index_type)[axis], types.intp)
            offset = builder.add(offset, place)
    size = ir.Constant(cgutils.intp_t, _element_size(kind))
    address = builder.gep(view.data, [builder.mul(offset, size)])
    return address, shape[len(places) :]


def _load(builder: "IRBuilder", address: "Value") -> "Value":
    return builder.load(builder.bitcast(address, ir.PointerType(_VECTOR)), align=8)


def _store(
    context: "BaseContext", builder: "IRBuilder", kind: types.Type, value: "Value", address: "Value"
) -> None:
    pointer = builder.bitcast(address, ir.PointerType(_VECTOR))
    builder.store(_as_lane(context, builder, kind, value), pointer, align=8)


def _lower_getitem(
    context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
) -> "Value":
    kind, index_type = sig.args
    address, shape = _locate(context, builder, kind, args[0], index_type, args[1])
    item = sig.return_type
    if isinstance(item, LaneType):
        return _load(builder, address)
    if isinstance(item, LaneRecordType):
        return address
    return _view(context, builder, item, address, shape)


def _lower_setitem(
    context: "BaseContext", builder: "IRBuilder", sig: "Signature", args: Sequence["Value"]
) -> "Value":
    kind, index_type, value_type = sig.args
    address, _ = _locate(context, builder, kind, args[0], index_type, args[1])
    _store(context, builder, value_type, args[2], address)
    return context.get_dummy_value()


for _array in (LanesType, LaneRecordsType):
    for _index in (types.Integer, types.BaseTuple):
        lower_builtin(operator.getitem, _array, _index)(_lower_getitem)
for _index in (types.Integer, types.BaseTuple):
    for _value in (LaneType, types.Float, types.Integer):
        lower_builtin(operator.setitem, LanesType, _index, _value)(_lower_setitem)


def _field_type(field: types.Type) -> types.Type:
    """What a field of a record is to compiled code: lanes, an array of them, records, or a number
    that all lanes share.
    """
    if isinstance(field, types.Record):
        return LaneRecordType(field)
    if not isinstance(field, types.NestedArray):
        return field
    if isinstance(field.dtype, types.Record):
        return LaneRecordsType(field.dtype, field.ndim)
    return LanesType(field.ndim - 1) if field.ndim > 1 else lane


@infer_getattr
class _Fields(AttributeTemplate):
    key = LaneRecordType

    def generic_resolve(self, row: LaneRecordType, name: str) -> Any:  # type: ignore[override]
        return _field_type(row.record.typeof(name)) if name in row.record.fields else None


@lower_getattr_generic(LaneRecordType)
def _lower_field(
    context: "BaseContext", builder: "IRBuilder", row: LaneRecordType, value: "Value", name: str
) -> "Value":
    offset = ir.Constant(cgutils.intp_t, row.record.offset(name))
    address = builder.gep(value, [offset])
    field = row.record.typeof(name)
    kind = _field_type(field)
    if isinstance(kind, LaneType):
        return _load(builder, address)
    if isinstance(kind, LaneRecordType):
        return address
    if isinstance(kind, _Shaped):
        shape = [
            ir.Constant(cgutils.intp_t, n)
            for n in cast(types.NestedArray, field).shape[: kind.dimensions]
        ]
        return _view(context, builder, kind, address, shape)
    stored = builder.bitcast(address, ir.PointerType(context.get_data_type(kind)))
    return context.unpack_value(builder, kind, stored)


@lower_setattr_generic(LaneRecordType)
def _lower_set_field(
    context: "BaseContext",
    builder: "IRBuilder",
    sig: "Signature",
    args: Sequence["Value"],
    name: str,
) -> None:
    row, value_type = sig.args
    offset = ir.Constant(cgutils.intp_t, row.record.offset(name))
    _store(context, builder, value_type, args[1], builder.gep(args[0], [offset]))


def lane_dtype(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Layout of records of lanes: floats eight by eight, whole numbers shared by all lanes."""
    if dtype.names is None:
        base = dtype.base
        if base.names is not None:
            return np.dtype((lane_dtype(base), dtype.shape))
        return np.dtype((base, (*dtype.shape, LANES))) if base.kind == "f" else dtype
    fields = [(name, lane_dtype(dtype[name])) for name in dtype.names]
    return np.dtype(fields, align=True)


def _are_doubles(dtype: np.dtype[Any]) -> bool:
    """Whether a record is numbers of double precision and nothing else."""
    base = dtype.base
    if base.names is None:
        return base == np.float64
    whole = base.itemsize == sum(base[name].itemsize for name in base.names)
    return whole and all(_are_doubles(base[name]) for name in base.names)


def in_lanes(arrays: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Arrays of up to eight missions side by side, of numbers or records; further lanes repeat the
    first.

    ValueError if they differ in shape, or in whole numbers, which all lanes share.
    """
    first = arrays[0]
    if any(array.shape != first.shape or array.dtype != first.dtype for array in arrays):
        raise ValueError("arrays differ in shape or type")
    chosen = [*arrays, *[first] * (LANES - len(arrays))]
    if first.dtype.names is None:
        if first.dtype.kind == "f":
            return np.ascontiguousarray(np.stack(chosen, axis=-1))
        if any(not np.array_equal(array, first) for array in arrays):
            raise ValueError("whole numbers differ")
        return first.copy()
    out = np.zeros(first.shape, lane_dtype(first.dtype))
    if _are_doubles(first.dtype):
        # all fields at once: records lie side by side as numbers do
        numbers = out.view(np.float64).reshape(first.size, -1, LANES)
        for lane_number, array in enumerate(chosen):
            values = np.ascontiguousarray(array).view(np.float64)
            numbers[:, :, lane_number] = values.reshape(first.size, -1)
        return out
    for name in first.dtype.names:
        out[name] = in_lanes([array[name] for array in chosen])
    return out


def whole_numbers(record: npt.NDArray[Any] | np.void) -> bytes:
    """All that is no float of a record, or of an array of numbers or records: what the lanes of
    `in_lanes` share.
    """
    array = np.asarray(record)
    if array.dtype.names is None:
        return b"" if array.dtype.kind == "f" else array.tobytes()
    return b"".join(whole_numbers(array[name]) for name in array.dtype.names)


def of_lane(values: Floats, i: int) -> Floats:
    """The numbers of one lane."""
    return np.ascontiguousarray(values[..., i])

"""Numba types for one number or sixteen side by side (lanes), in which integrators are written.

Numba compiles ``a * b`` on sixteen numbers to one instruction for each vector register, two of the
widest registers or more of narrower ones. Lanes never mix: the result in a lane does not depend on
the other lanes. Products and sums are fused by ``fma`` and by nothing else. The kernel is compiled
for the arrays that it is called with: ``(.., ..)`` for a single orbit, ``(.., .., 16)`` for lanes.

Within compiled code: ``load(a, i, j)`` reads the lanes of an entry of a C-ordered float64 array,
``store(a, i, j, x)`` writes them, ``take(a, i)`` and ``give(a, i, x)`` are the same for arrays
``(..,)`` and ``(.., 16)``, ``get`` and ``put`` access one lane. A single number acts as sixteen
equal numbers; ``+ - * /`` and comparisons work lane by lane, ``choose(mask, x, y)`` selects,
``bits`` converts a mask to an integer.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import lower_cast, models, overload, register_model

from herringbone_sim.core.numba_private import Conversion, cgutils, intrinsic, ir, make_array

LANES = 16

_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class Lanes(types.Type):  # type: ignore[misc]
    """Numba type of sixteen float64; a single number converts to sixteen equal ones."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes({LANES})")

    def can_convert_from(self, _: Any, other: Any) -> Any:
        return Conversion.safe if isinstance(other, types.Number) else None

    def unify(self, _: Any, other: Any) -> Any:
        return self if isinstance(other, types.Number) else None


class Mask(types.Type):  # type: ignore[misc]
    """Numba type of sixteen truth values; a single one converts to sixteen equal ones."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask({LANES})")

    def can_convert_from(self, _: Any, other: Any) -> Any:
        return Conversion.safe if isinstance(other, types.Boolean) else None

    def unify(self, _: Any, other: Any) -> Any:
        return self if isinstance(other, types.Boolean) else None


lanes, mask = Lanes(), Mask()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


def _everywhere(builder: Any, kind: Any, value: Any) -> Any:
    """Return the LLVM value with one value in all lanes."""
    none = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(none, value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, none, zeros)


@lower_cast(types.Number, Lanes)
def _number_everywhere(context: Any, builder: Any, kind: Any, _: Any, value: Any) -> Any:
    return _everywhere(builder, _DOUBLES, context.cast(builder, value, kind, types.float64))


@lower_cast(types.Boolean, Mask)
def _truth_everywhere(context: Any, builder: Any, kind: Any, _: Any, value: Any) -> Any:
    return _everywhere(builder, _BITS, value)


def _pointer(context: Any, builder: Any, kind: Any, array: Any, *place: Any) -> Any:
    """Return a pointer to an entry, or to its lanes if the array has one axis more."""
    struct = make_array(kind)(context, builder, array)
    if kind.ndim == len(place):
        return cgutils.get_item_pointer(context, builder, kind, struct, list(place))
    zero = context.get_constant(types.intp, 0)
    first = cgutils.get_item_pointer(context, builder, kind, struct, [*place, zero])
    return builder.bitcast(first, _DOUBLES.as_pointer())


@intrinsic
def load(typing: Any, array: Any, i: Any, j: Any) -> Any:
    """Return the lanes ``array[i, j, :]``, or the number ``array[i, j]`` of a 2-d array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, array, *args), align=8)

    kind = types.float64 if array.ndim == 2 else lanes
    return kind(array, types.intp, types.intp), code


@intrinsic
def store(typing: Any, array: Any, i: Any, j: Any, value: Any) -> Any:
    """Write lanes into ``array[i, j, :]``, or a number into ``array[i, j]`` of a 2-d array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[3], _pointer(context, builder, array, *args[:3]), align=8)
        return context.get_dummy_value()

    kind = types.float64 if array.ndim == 2 else lanes
    return types.void(array, types.intp, types.intp, kind), code


@intrinsic
def take(typing: Any, array: Any, i: Any) -> Any:
    """Return the lanes ``array[i, :]``, or the number ``array[i]`` of a 1-d array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, array, *args), align=8)

    return (types.float64 if array.ndim == 1 else lanes)(array, types.intp), code


@intrinsic
def give(typing: Any, array: Any, i: Any, value: Any) -> Any:
    """Write lanes into ``array[i, :]``, or a number into ``array[i]`` of a 1-d array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _pointer(context, builder, array, *args[:2]), align=8)
        return context.get_dummy_value()

    kind = types.float64 if array.ndim == 1 else lanes
    return types.void(array, types.intp, kind), code


def _element(context: Any, builder: Any, kind: Any, array: Any, *place: Any) -> Any:
    struct = make_array(kind)(context, builder, array)
    return cgutils.get_item_pointer(context, builder, kind, struct, list(place[: kind.ndim]))


@intrinsic
def get(typing: Any, array: Any, i: Any, j: Any, lane: Any) -> Any:
    """Return the number ``array[i, j, lane]``, or ``array[i, j]`` of a 2-d array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_element(context, builder, array, *args))

    return types.float64(array, types.intp, types.intp, types.intp), code


@intrinsic
def put(typing: Any, array: Any, i: Any, j: Any, lane: Any, value: Any) -> Any:
    """Write a number into ``array[i, j, lane]``, or into ``array[i, j]`` of a 2-d array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[4], _element(context, builder, array, *args[:4]))
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, types.intp, types.float64), code


@intrinsic
def n_lanes(typing: Any, array: Any) -> Any:
    """Return the number of lanes of an array: 16 of a 3-d array, else 1."""
    n = LANES if array.ndim == 3 else 1

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.get_constant(types.intp, n)

    return types.intp(array), code


def _all_of(operands: tuple[Any, ...]) -> Any:
    """Return the type of a result: lanes if any operand is lanes, else a number."""
    return lanes if lanes in operands else types.float64


def _function(name: str, operands: tuple[Any, ...]) -> tuple[Any, Any]:
    """Return signature and code generator of an LLVM intrinsic for numbers or lanes."""
    kind = _all_of(operands)
    double, of = (_DOUBLES, f"v{LANES}f64") if kind is lanes else (ir.DoubleType(), "f64")

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        form = ir.FunctionType(double, [double] * len(operands))
        function = cgutils.get_or_insert_function(builder.module, form, f"llvm.{name}.{of}")
        return builder.call(function, args)

    return kind(*(kind,) * len(operands)), code


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a * b + c, rounded once."""
    return _function("fma", (a, b, c))


@intrinsic
def absolute(typing: Any, a: Any) -> Any:
    """Return the absolute values."""
    return _function("fabs", (a,))


@intrinsic
def root(typing: Any, a: Any) -> Any:
    """Return the square roots."""
    return _function("sqrt", (a,))


@intrinsic
def nearest(typing: Any, a: Any) -> Any:
    """Return the nearest whole numbers, of two equally near the even one."""
    return _function("rint", (a,))


@intrinsic
def choose(typing: Any, where: Any, a: Any, b: Any) -> Any:
    """Return a in the lanes where the mask holds, b in the others."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(*args)

    kind = lanes if where is mask else _all_of((a, b))
    return kind(where, kind, kind), code


@intrinsic
def without(typing: Any, where: Any) -> Any:
    """Return the negation of a mask."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.not_(args[0])

    return where(where), code


@intrinsic
def bits(typing: Any, where: Any) -> Any:
    """Return a mask as an integer, lane 0 in its lowest bit."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        whole = args[0] if where is not mask else builder.bitcast(args[0], ir.IntType(LANES))
        return builder.zext(whole, ir.IntType(64))

    return types.int64(where), code


def _binary(kind: Any, result: Any, build: Callable[[Any, Any, Any], Any]) -> Any:
    @intrinsic
    def apply(typing: Any, a: Any, b: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return build(builder, *args)

        return result(kind, kind), code

    return apply


def _operator(symbol: Any, kind: Any, apply: Any) -> None:
    @overload(symbol)
    def choose_implementation(a, b):
        others = (kind, types.Float) if kind is lanes else (kind,)
        if kind in (a, b) and all(x is kind or isinstance(x, others[1:]) for x in (a, b)):
            return lambda a, b: apply(a, b)
        return None


def _comparison(symbol: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: builder.fcmp_ordered(symbol, a, b)


_operator(operator.add, lanes, _binary(lanes, lanes, lambda builder, a, b: builder.fadd(a, b)))
_operator(operator.sub, lanes, _binary(lanes, lanes, lambda builder, a, b: builder.fsub(a, b)))
_operator(operator.mul, lanes, _binary(lanes, lanes, lambda builder, a, b: builder.fmul(a, b)))
_operator(operator.truediv, lanes, _binary(lanes, lanes, lambda builder, a, b: builder.fdiv(a, b)))
_operator(operator.lt, lanes, _binary(lanes, mask, _comparison("<")))
_operator(operator.gt, lanes, _binary(lanes, mask, _comparison(">")))
_operator(operator.eq, lanes, _binary(lanes, mask, _comparison("==")))
_operator(operator.ne, lanes, _binary(lanes, mask, _comparison("!=")))
_operator(operator.and_, mask, _binary(mask, mask, lambda builder, a, b: builder.and_(a, b)))
_operator(operator.or_, mask, _binary(mask, mask, lambda builder, a, b: builder.or_(a, b)))

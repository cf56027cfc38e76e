"""Sixteen numbers side by side: the type that the lanes of the kernel are written in.

Numba compiles ``a * b`` on these to one instruction a register, on every machine: two of the
widest registers, or more of narrower ones; so one product needn't wait for another. Lanes never
mix: what a lane gives does not depend on its neighbours. Products that are added are fused by
``fma`` and by nothing else.

Within compiled code: ``load(a, i, j)`` takes the lanes ``a[i, j, :]`` of a C-ordered float64
array ``(.., .., 16)``, ``store(a, i, j, x)`` puts them back, ``splat(x)`` is one number in all
lanes, ``+ - *`` and the comparisons work lane by lane, ``choose(mask, x, y)`` selects, ``bits``
gives a mask as an integer.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import intrinsic, models, overload, register_model

from herringbone_sim.core.numba_private import cgutils, ir, make_array

LANES = 16

_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)


class Lanes(types.Type):  # type: ignore[misc]
    """Numba's type of sixteen float64."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes({LANES})")


class Mask(types.Type):  # type: ignore[misc]
    """Numba's type of sixteen truth values."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask({LANES})")


lanes, mask = Lanes(), Mask()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


def _pointer(context: Any, builder: Any, kind: Any, array: Any, i: Any, j: Any) -> Any:
    struct = make_array(kind)(context, builder, array)
    zero = context.get_constant(types.intp, 0)
    place = cgutils.get_item_pointer(context, builder, kind, struct, [i, j, zero])
    return builder.bitcast(place, _DOUBLES.as_pointer())


@intrinsic
def load(typing: Any, array: Any, i: Any, j: Any) -> Any:
    """Lanes ``array[i, j, :]``."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, array, *args), align=8)

    return lanes(array, types.intp, types.intp), code


@intrinsic
def store(typing: Any, array: Any, i: Any, j: Any, value: Any) -> Any:
    """Put lanes into ``array[i, j, :]``."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[3], _pointer(context, builder, array, *args[:3]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes), code


@intrinsic
def splat(typing: Any, value: Any) -> Any:
    """One number in all lanes."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        first = builder.insert_element(ir.Constant(_DOUBLES, ir.Undefined), args[0], _index(0))
        everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(first, ir.Constant(_DOUBLES, ir.Undefined), everywhere)

    return lanes(types.float64), code


def _index(i: int) -> Any:
    return ir.Constant(ir.IntType(32), i)


def _function(name: str, operands: int) -> Any:
    """Function of lanes that LLVM knows by name."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_DOUBLES, [_DOUBLES] * operands)
        known = f"llvm.{name}.v{LANES}f64"
        function = cgutils.get_or_insert_function(builder.module, kind, known)
        return builder.call(function, args)

    return code


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a * b + c, rounded once."""
    return lanes(lanes, lanes, lanes), _function("fma", 3)


@intrinsic
def absolute(typing: Any, a: Any) -> Any:
    """Magnitudes."""
    return lanes(lanes), _function("fabs", 1)


@intrinsic
def root(typing: Any, a: Any) -> Any:
    """Square roots."""
    return lanes(lanes), _function("sqrt", 1)


@intrinsic
def nearest(typing: Any, a: Any) -> Any:
    """Nearest whole numbers."""
    return lanes(lanes), _function("rint", 1)


@intrinsic
def choose(typing: Any, where: Any, a: Any, b: Any) -> Any:
    """A where the mask holds, else b."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(*args)

    return lanes(mask, lanes, lanes), code


@intrinsic
def without(typing: Any, where: Any) -> Any:
    """The lanes where the mask does not hold."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.not_(args[0])

    return mask(mask), code


@intrinsic
def bits(typing: Any, where: Any) -> Any:
    """The mask as an integer, lane 0 in its lowest bit."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), ir.IntType(64))

    return types.int64(mask), code


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
        if a is kind and b is kind:
            return lambda a, b: apply(a, b)
        if kind is lanes and a is kind and isinstance(b, types.Float):
            return lambda a, b: apply(a, splat(b))
        if kind is lanes and b is kind and isinstance(a, types.Float):
            return lambda a, b: apply(splat(a), b)
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

"""Named tuples that compiled code takes as one pointer.

Numba passes each array of a tuple by seven numbers or more, and a function with the work arrays of
the kernel would have hundreds of arguments: to compile their calls took most of the time that the
first gear on a machine waits. Behind a ``Reference`` the numbers lie in a table; compiled code
reads a field where it needs it, by name, as from the tuple.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import typeof, types
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

from herringbone_sim.arrays import Indices
from herringbone_sim.core.numba_private import (
    AttributeTemplate,
    as_dtype,
    cgutils,
    entry_point,
    from_dtype,
    intrinsic,
    ir,
    make_array,
    populate_array,
)

_WORD = ir.IntType(64)
_types: dict[Any, ReferenceType] = {}
_entries: dict[Any, Any] = {}


class Reference:
    """A named tuple of arrays, numbers and named tuples of such, for compiled code.

    Compiled code takes it as one pointer and reads ``reference.field``, as Python code can. Fields
    that are tuples must consist of zeros: their length is part of the type. Numbers are those of
    the time when it was made, as are the arrays, whose contents may change.

    Args:
        fields: the named tuple.

    Raises:
        TypeError: a field of another kind.

    Attributes:
        fields: the named tuple.
        address: where the table lies that compiled code reads.
    """

    def __init__(self, fields: Any) -> None:
        self.fields = fields
        words: list[int] = []
        kinds: list[Any] = []
        _read_fields(fields, words, kinds)
        key = type(fields), *kinds
        if key not in _types:
            _types[key] = _type_of(fields)
        self._numba_type_ = _types[key]
        self._table = np.array(words, dtype=np.int64)
        self.address = self._table.ctypes.data

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy has a table of its own arrays."""
        return Reference, (self.fields,)

    def __getattr__(self, name: str) -> Any:
        if name == "fields":  # not yet set, as while it is copied
            raise AttributeError(name)
        return getattr(self.fields, name)


def call(function: Any, *args: Any) -> Any:
    """Call a compiled function without the check of its argument types; return what it returns.

    Numba's check takes longer than a mesh cycle.
    """
    key = function, _kind_of(args)
    if key not in _entries:
        kinds = tuple(typeof(arg) for arg in args)
        _entries[key] = entry_point(function, kinds) if hasattr(function, "compile") else function
    return _entries[key](*args)


def _kind_of(arg: Any) -> Any:
    """Return what decides the Numba type of an argument."""
    if isinstance(arg, np.ndarray):
        return arg.dtype.str, arg.ndim, arg.flags.num
    if isinstance(arg, tuple):
        return tuple(map(_kind_of, arg))
    return arg._numba_type_ if isinstance(arg, Reference) else type(arg)


def tables(tuples: Sequence[Any]) -> Indices:
    """Return the tables (n, words) of named tuples of one type, for ``row_of``."""
    rows: list[list[int]] = [[] for _ in tuples]
    for fields, words in zip(tuples, rows, strict=True):
        _read_fields(fields, words, [])
    return np.array(rows, dtype=np.int64)


class ReferenceType(types.Type):  # type: ignore[misc]
    """Numba type of a ``Reference``: name and Numba type of each field."""

    def __init__(self, fields: tuple[tuple[str, Any], ...]) -> None:
        self.fields = fields
        self.places: dict[str, tuple[Any, int]] = {}
        first = 0
        for name, kind in fields:
            self.places[name] = kind, first
            first += _size(kind)
        self.size = first
        whole = ", ".join(f"{name}: {kind}" for name, kind in fields)
        super().__init__(name=f"Reference_{hashlib.sha256(whole.encode()).hexdigest()[:16]}")


def _size(kind: Any) -> int:
    """Return the number of words of a field in the table."""
    if isinstance(kind, types.Array):
        return 1 + int(kind.ndim)
    if isinstance(kind, ReferenceType):
        return kind.size
    return 0 if isinstance(kind, types.BaseTuple | types.NoneType) else 1


def _type_of(fields: Any) -> ReferenceType:
    """Return the type of a reference to a named tuple."""

    def kind(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return types.Array(from_dtype(value.dtype), value.ndim, "C")
        return _type_of(value) if hasattr(value, "_fields") else typeof(value)

    pairs = zip(fields._fields, fields, strict=True)
    return ReferenceType(tuple((name, kind(value)) for name, value in pairs))


def _read_fields(fields: Any, words: list[int], kinds: list[Any]) -> None:
    """Append addresses and shapes of arrays, and numbers, to the table ``words``.

    What decides the types of the fields is appended to ``kinds``.
    """
    for name, value in zip(fields._fields, fields, strict=True):
        kind: Any = type(value)
        if kind is np.ndarray and value.flags.c_contiguous:
            words.append(value.__array_interface__["data"][0])
            words += value.shape
            kind = value.dtype.str, value.ndim
        elif isinstance(value, float):
            words += struct.unpack("q", struct.pack("d", value))
        elif isinstance(value, int):
            words.append(int(value))
        elif hasattr(value, "_fields"):
            _read_fields(value, words, kinds)
        elif value is not None:
            kind = value
            if not isinstance(value, tuple) or not _is_empty(value):
                raise TypeError(
                    f"{name} must be a C-ordered array, a number or zeros, got {type(value)}"
                )
        kinds.append(kind)


def _is_empty(value: Any) -> bool:
    """Whether a value is zero, or a tuple of such that holds nothing but its lengths."""
    return all(map(_is_empty, value)) if isinstance(value, tuple) else value == 0


@typeof_impl.register(Reference)
def _typeof(value: Reference, _: Any) -> ReferenceType:
    return value._numba_type_


@register_model(ReferenceType)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


@unbox(ReferenceType)
def _unbox(kind: Any, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(value, "address")
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(c.builder.bitcast(pointer, _WORD.as_pointer()))


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = ReferenceType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        return kind.places[name][0] if name in kind.places else None


@intrinsic
def row_of(typing: Any, like: Any, rows: Any, i: Any) -> Any:
    """Return row i of ``tables`` as a reference of the type of ``like``."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = make_array(rows)(context, builder, args[1])
        zero = context.get_constant(types.intp, 0)
        return cgutils.get_item_pointer(context, builder, rows, array, [args[2], zero])

    return like(like, rows, types.intp), code


@lower_builtin("__array__", types.Array)
def _itself(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """An array is its own array.

    Numba asks for this at each access, and without an answer it looks through all registries.
    """
    return args[0]


@lower_getattr_generic(ReferenceType)
def _read(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> Any:
    field, first = kind.places[name]

    def word(i: int) -> Any:
        loaded = builder.load(builder.gep(pointer, [ir.Constant(ir.IntType(32), first + i)]))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if isinstance(field, ReferenceType):
        return builder.gep(pointer, [ir.Constant(ir.IntType(32), first)])
    if isinstance(field, types.BaseTuple | types.NoneType):
        return context.get_constant_null(field)
    if isinstance(field, types.Array):
        return _array(context, builder, field, [word(i) for i in range(1 + field.ndim)])
    if field is types.float64:
        return builder.bitcast(word(0), ir.DoubleType())
    return builder.trunc(word(0), ir.IntType(1)) if field is types.boolean else word(0)


def _array(context: Any, builder: Any, kind: Any, words: list[Any]) -> Any:
    """Return Numba's array of an address and a shape."""
    array = make_array(kind)(context, builder)
    size = as_dtype(kind.dtype).itemsize
    strides = [ir.Constant(_WORD, size)]
    for length in words[:1:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(words[0], array.data.type)
    populate_array(array, data=data, shape=words[1:], strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()

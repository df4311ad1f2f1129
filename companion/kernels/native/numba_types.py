"""Teaches numba structures, kernels and local arrays. Importing this module registers them."""

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.imputils import lower_builtin, lower_constant, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, Signature, infer_getattr, signature
from numba.extending import register_model, type_callable, typeof_impl
from numba.np import arrayobj

from companion.kernels.native import kinds
from companion.kernels.native.kernel import Kernel, local_floats, local_ints, local_table

_Typed = Any  # Objects of numba's compiler have no static types.

WORD = ir.IntType(64)
SCALARS = {"f": types.float64, "s": types.float32, "i": types.int64, "b": types.boolean}


class StructType(types.Type):
    """The type of a structure, whose value is the address of its words."""

    def __init__(self, cls: type) -> None:
        self.cls = cls
        super().__init__(name=f"{cls.__module__}.{cls.__qualname__}")


class KernelType(types.Callable):
    """The type of one kernel as a function that can be called."""

    def __init__(self, one: Kernel) -> None:
        self.kernel = one
        super().__init__(name=f"kernel {one.symbol}")

    def get_call_type(self, context: _Typed, args: _Typed, kws: _Typed) -> Signature | None:
        """Return the kernel's signature if the arguments can be converted to it."""
        declared = signature_in_numba(self.kernel)
        if kws or len(args) != len(declared.args):
            return None
        pairs = zip(map(types.unliteral, args), declared.args, strict=True)
        return declared if all(context.can_convert(*pair) is not None for pair in pairs) else None

    def get_call_signatures(self) -> tuple[list[Signature], bool]:
        """Return the only signature."""
        return [signature_in_numba(self.kernel)], False

    def get_impl_key(self, _sig: Signature) -> Kernel:
        """Return the key under which the code of a call is registered."""
        return self.kernel


@register_model(StructType)
class _StructModel(models.PrimitiveModel):
    def __init__(self, manager: _Typed, kind: StructType) -> None:
        super().__init__(manager, kind, WORD.as_pointer())


register_model(KernelType)(models.OpaqueModel)


def type_in_numba(kind: kinds.Kind) -> _Typed:
    """Return numba's type for a kind."""
    if isinstance(kind, kinds.Scalar):
        return SCALARS[kind.code]
    if isinstance(kind, kinds.Array):
        return types.Array(SCALARS[kind.code], kind.ndim, "C")
    if isinstance(kind, kinds.Pointer):
        return StructType(kind.cls)
    if isinstance(kind, kinds.Tuple):
        return types.BaseTuple.from_types([type_in_numba(item) for item in kind.items], kind.cls)
    return types.none


def signature_in_numba(one: Kernel) -> Signature:
    """Return a kernel's signature in numba's types."""
    declared = one.signature
    return signature(type_in_numba(declared.returns), *map(type_in_numba, declared.kinds))


@typeof_impl.register(Kernel)
def _type_of_kernel(one: Kernel, _context: _Typed) -> KernelType:
    return KernelType(one)


@lower_constant(KernelType)
def _constant_kernel(context: _Typed, _builder: _Typed, _kind: _Typed, _value: Kernel) -> _Typed:
    return context.get_dummy_value()


@infer_getattr
class _StructAttributes(AttributeTemplate):
    key = StructType

    def generic_resolve(self, kind: StructType, name: str) -> _Typed:  # type: ignore[override]
        """Return the type of a structure's field."""
        found = kinds.layout(kind.cls).get(name)
        return None if found is None else type_in_numba(found)


@lower_getattr_generic(StructType)
def _get_field(context: _Typed, builder: _Typed, kind: StructType, value: _Typed, name: str) -> _Typed:
    return load(context, builder, kinds.layout(kind.cls)[name], value, kinds.offset_of(kind.cls, name))


def load(context: _Typed, builder: _Typed, kind: kinds.Kind, words: _Typed, offset: int) -> _Typed:
    """Generate code that loads a value, ``offset`` words behind an address."""
    if isinstance(kind, kinds.Tuple):
        items = []
        for item in kind.items:
            items.append(load(context, builder, item, words, offset))
            offset += kinds.num_words(item)
        return context.make_tuple(builder, type_in_numba(kind), items)
    if isinstance(kind, kinds.Array):
        array_type = type_in_numba(kind)
        shape = [_load_word(builder, words, offset + 1 + axis, WORD) for axis in range(kind.ndim)]
        data = _load_word(builder, words, offset, context.get_data_type(array_type.dtype).as_pointer())
        return _array(context, builder, array_type, data, shape)
    if isinstance(kind, kinds.Scalar) and kind.code == "f":
        return _load_word(builder, words, offset, ir.DoubleType())
    if isinstance(kind, kinds.Scalar) and kind.code == "b":
        return builder.trunc(_load_word(builder, words, offset, WORD), ir.IntType(1))
    return _load_word(builder, words, offset, WORD.as_pointer() if isinstance(kind, kinds.Pointer) else WORD)


def _load_word(builder: _Typed, words: _Typed, offset: int, kind: _Typed) -> _Typed:
    """Generate code that loads one word.

    The words of a structure do not change while a kernel runs, so LLVM may load them once for a whole loop.
    """
    place = builder.bitcast(builder.gep(words, [WORD(offset)], inbounds=True), kind.as_pointer())
    found = builder.load(place)
    found.set_metadata("invariant.load", builder.module.add_metadata([]))
    return found


def _array(context: _Typed, builder: _Typed, array_type: _Typed, data: _Typed, shape: list[_Typed]) -> _Typed:
    """Generate code that makes a C-contiguous array without an owner: the caller keeps the memory alive."""
    size = context.get_abi_sizeof(context.get_data_type(array_type.dtype))
    strides = [WORD(size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    made = context.make_array(array_type)(context, builder)
    arrayobj.populate_array(
        made,
        data=data,
        shape=cgutils.pack_array(builder, shape),
        strides=cgutils.pack_array(builder, strides),
        itemsize=WORD(size),
        meminfo=None,
        parent=None,
    )
    return made._getvalue()


def _are_constant(*shape: _Typed) -> bool:
    return all(isinstance(length, types.IntegerLiteral) for length in shape)


@type_callable(local_floats)
def _type_of_floats(_context: _Typed) -> _Typed:
    return lambda n: type_in_numba(kinds.Array("f", 1)) if _are_constant(n) else None


@type_callable(local_ints)
def _type_of_ints(_context: _Typed) -> _Typed:
    return lambda n: type_in_numba(kinds.Array("i", 1)) if _are_constant(n) else None


@type_callable(local_table)
def _type_of_table(_context: _Typed) -> _Typed:
    return lambda rows, columns: type_in_numba(kinds.Array("f", 2)) if _are_constant(rows, columns) else None


@lower_builtin(local_floats, types.IntegerLiteral)
@lower_builtin(local_ints, types.IntegerLiteral)
@lower_builtin(local_table, types.IntegerLiteral, types.IntegerLiteral)
def _make_local(context: _Typed, builder: _Typed, sig: Signature, _args: _Typed) -> _Typed:
    """Generate code that makes an array of a constant shape on the kernel's stack."""
    array_type: _Typed = sig.return_type
    shape, element = [length.literal_value for length in sig.args], context.get_data_type(array_type.dtype)
    place = cgutils.alloca_once(builder, ir.ArrayType(element, math.prod(shape)))
    data = builder.bitcast(place, element.as_pointer())
    return _array(context, builder, array_type, data, [WORD(n) for n in shape])


@lower_builtin(operator.setitem, types.Array, types.Any, types.Any)
def _set_item(context: _Typed, builder: _Typed, sig: Signature, args: _Typed) -> _Typed:
    """Generate code for ``array[index] = value``, item by item.

    Numba copies the value first if both could overlap, and allocates for that. Kernels allocate nothing, and
    assign rows and slices only to others than themselves. Code that is no kernel keeps numba's way.
    """
    if context.enable_nrt:
        return arrayobj.setitem_array(context, builder, sig, args)
    array_type, index_type, value_type = sig.args
    array, index, value = args
    kinds_of_indices: _Typed = (index_type,)
    indices: _Typed = (index,)
    if isinstance(index_type, types.BaseTuple):
        kinds_of_indices = index_type.types  # type: ignore[attr-defined]
        indices = cgutils.unpack_tuple(builder, index, count=len(index_type))
    array = arrayobj.make_array(array_type)(context, builder, array)
    kinds_of_indices, indices = arrayobj.normalize_indices(context, builder, kinds_of_indices, indices)
    data, shape, strides = arrayobj.basic_indexing(
        context, builder, array_type, array, kinds_of_indices, indices, boundscheck=False
    )
    source, item_type = None, value_type
    if isinstance(value_type, types.Array):
        if value_type.ndim != len(shape):
            raise NotImplementedError(f"a kernel cannot assign {value_type} to {len(shape)} axes")
        source, item_type = arrayobj.make_array(value_type)(context, builder, value), value_type.dtype
    with cgutils.loop_nest(builder, shape, WORD) as at:
        place = cgutils.get_item_pointer2(context, builder, data, shape, strides, "A", at)
        if source is not None:
            origin = cgutils.get_item_pointer(context, builder, value_type, source, at)
            value = arrayobj.load_item(context, builder, value_type, origin)
        item = context.cast(builder, value, item_type, array_type.dtype)
        arrayobj.store_item(context, builder, array_type, item, place)
    return None

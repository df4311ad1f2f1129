"""Arrays without an owner: the same memory, for which nobody counts references.

Numba counts references to an array wherever it is taken out of a tuple, by an atomic operation of some
5 ns. Kernels that pass a tree of eighteen arrays through five calls a node spend more time on that than
on geometry. A kernel that runs long therefore takes :func:`borrowed` of its arguments once: the caller
holds them until it returns, so that nothing can be freed meanwhile. Never take it of an array made in
the same function: that one would be freed after the last use of its own name.
"""

from __future__ import annotations

from typing import Any

import numba as nb
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ["borrowed"]

_Typed = Any  # numba's compiler hands over objects that have no static types


def _without_owner(context: _Typed, builder: _Typed, kind: _Typed, value: _Typed) -> _Typed:
    """The value of an array, or of a tuple with all its arrays, with no owner to count for."""
    is_array, is_tuple = isinstance(kind, types.Array), isinstance(kind, types.BaseTuple)
    if is_array:
        array = cgutils.create_struct_proxy(kind)(context, builder, value=value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        return array._getvalue()
    if is_tuple:
        parts = cgutils.unpack_tuple(builder, value, len(kind))
        stripped = [_without_owner(context, builder, *part) for part in zip(kind.types, parts, strict=True)]
        return context.make_tuple(builder, kind, stripped)
    return value


def _borrowed(_typing_context: _Typed, values: _Typed) -> _Typed:
    """An array or a tuple of arrays and numbers, of the same type and memory, without an owner."""

    def generate(context: _Typed, builder: _Typed, signature: _Typed, arguments: _Typed) -> _Typed:
        return _without_owner(context, builder, signature.args[0], arguments[0])

    return values(values), generate


def _itself(values: _Typed) -> _Typed:
    """What stands for it where nothing is compiled: the interpreter counts in any case."""
    return values


borrowed: _Typed = _itself if nb.config.DISABLE_JIT else intrinsic(_borrowed)  # type: ignore[attr-defined]

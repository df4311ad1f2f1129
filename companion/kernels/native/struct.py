"""Structures: groups of arrays and numbers that kernels receive as one address.

Numba passes a named tuple of a hundred arrays as some nine hundred numbers, and takes it apart in every
kernel that passes it on. That took most of the time of compiling, and a part of the time of planning.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from struct import error as StructError
from struct import pack_into
from typing import Any, ClassVar, Self, cast, dataclass_transform

from companion.kernels.native.kinds import add_words, layout, struct_format

__all__ = ["Struct"]


@dataclass_transform(frozen_default=True, eq_default=False)
class Struct:
    """Base class of structures. Annotations name the fields, as in a frozen dataclass without defaults.

    An instance keeps the arrays alive that it names. The contents of an array may change. Which array a field
    names may not.

    Attributes
    ----------
    kernel_address : int
        Where the words of the fields lie in memory.

    Raises
    ------
    TypeError
        If a field is missing or unknown, or its value has another type than its annotation.
    """

    kernel_address: ClassVar[int] = 0

    def __init__(self, *values: Any, **named: Any) -> None:
        cls: type = type(self)
        kinds = layout(cls)
        fields = dict(zip(kinds, values, strict=False)) | named
        if len(fields) != len(values) + len(named) or fields.keys() != kinds.keys():
            raise TypeError(
                f"{cls.__name__}: got {', '.join(fields)}: expected {', '.join(kinds)}, each once"
            )
        words: list[Any] = []
        for name, kind in kinds.items():
            add_words(words, kind, fields[name], f"{cls.__name__}.{name}")
        memory = (ctypes.c_int64 * max(1, len(words)))()
        try:
            pack_into(struct_format(cls), memory, 0, *words)
        except StructError as error:
            raise TypeError(f"{cls.__name__}: {words}: {error}") from None
        vars(self).update(fields, kernel_memory=memory, kernel_address=ctypes.addressof(memory))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{type(self).__name__}.{name} cannot be assigned: a structure does not change")

    def __repr__(self) -> str:
        cls: type = type(self)
        fields = (f"{name}={getattr(self, name)!r}" for name in layout(cls))
        return f"{type(self).__name__}({', '.join(fields)})"

    def _replace(self, **changes: Any) -> Self:
        """Return a copy with other values in some fields, as a named tuple does."""
        cls: type = type(self)
        kept = {name: getattr(self, name) for name in layout(cls)}
        return cast("Self", cls(**kept | changes))

    def __iter__(self) -> Iterator[Any]:
        """Go through the fields' values in their order, as a named tuple does."""
        cls: type = type(self)
        return (getattr(self, name) for name in layout(cls))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle the fields alone: a copy lies elsewhere in memory."""
        cls: type = type(self)
        return cls, tuple(self)

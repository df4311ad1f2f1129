"""Structures: what kernels are handed by one address, whatever is in it.

A named tuple of a hundred arrays is taken apart and put together again in every kernel that passes it on, which
takes most of the time of compiling and some of that of running. A structure is one word there.
"""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Iterator
from struct import error as StructError
from struct import pack_into
from typing import Any, ClassVar, Self, dataclass_transform

from companion.kernels.native.kinds import add_words, layout, struct_format

__all__ = ["Struct"]


@dataclass_transform(frozen_default=True, eq_default=False)
class Struct:
    """Base of structures: numbers, arrays and other structures as annotated, immutable, by name.

    An instance keeps what it names alive, and with it the words that kernels read. What stands in an array may
    change, the array itself may not.

    Raises
    ------
    TypeError
        If a field has another type than its annotation.
    """

    kernel_words: ClassVar[int] = 0

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        dataclasses.dataclass(frozen=True, eq=False)(cls)

    def __post_init__(self) -> None:
        cls = type(self)
        words: list[Any] = []
        for name, kind in layout(cls).items():
            add_words(words, kind, getattr(self, name), f"{cls.__name__}.{name}")
        memory = (ctypes.c_int64 * max(1, len(words)))()
        try:
            pack_into(struct_format(cls), memory, 0, *words)
        except StructError as error:
            raise TypeError(f"{cls.__name__}: {words}: {error}") from None
        object.__setattr__(self, "_memory", memory)
        object.__setattr__(self, "kernel_address", ctypes.addressof(memory))

    def _replace(self, **changes: Any) -> Self:
        """A structure with other values in some fields, as of a named tuple."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def __iter__(self) -> Iterator[Any]:
        """The fields' values in their order, as of a named tuple."""
        return (getattr(self, name) for name in layout(type(self)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Where it lies in memory is nobody else's business."""
        return type(self), tuple(self)

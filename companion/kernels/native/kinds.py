"""The types that kernels know, and how their values lie in memory.

A type is read from an annotation. In memory every value is a row of 8-byte words. A number is one word. An
array is its address and its shape. A structure is the address of its own words. A tuple is its items in a
row.
"""

from __future__ import annotations

import ctypes
import hashlib
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, cast

import numpy as np

__all__ = ["Array", "Kind", "Nothing", "Pointer", "Scalar", "Signature", "Tuple", "kind_of", "signature_of"]

DTYPES = {code: np.dtype(name) for code, name in (("f", "f8"), ("s", "f4"), ("i", "i8"), ("b", "?"))}
SCALARS = {float: "f", int: "i", bool: "b"}


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number. Its ``code`` is f for a float, i for an integer, b for a truth value."""

    code: str

    def __str__(self) -> str:
        return {"f": "float", "i": "int", "b": "bool"}[self.code]


@dataclass(frozen=True, slots=True)
class Array:
    """A C-contiguous array of ``ndim`` axes.

    Its ``code`` is that of :class:`Scalar`, or s for single precision.
    """

    code: str
    ndim: int

    def __str__(self) -> str:
        return f"C-contiguous array of {self.ndim} axes, dtype {DTYPES[self.code]}"


@dataclass(frozen=True, slots=True)
class Pointer:
    """A structure of the class ``cls``, passed by its address."""

    cls: type

    def __str__(self) -> str:
        return self.cls.__name__


@dataclass(frozen=True, slots=True)
class Tuple:
    """A tuple. Its ``cls`` is the class of a named tuple, else None."""

    items: tuple[Kind, ...]
    cls: type | None = None

    def __str__(self) -> str:
        return self.cls.__name__ if self.cls else f"({', '.join(map(str, self.items))})"


@dataclass(frozen=True, slots=True)
class Nothing:
    """The result of a kernel that returns nothing."""

    def __str__(self) -> str:
        return "None"


Kind = Scalar | Array | Pointer | Tuple | Nothing


@dataclass(frozen=True, slots=True)
class Signature:
    """The ``names`` and ``kinds`` of a kernel's parameters, and the kind that it ``returns``."""

    names: tuple[str, ...]
    kinds: tuple[Kind, ...]
    returns: Kind


@cache
def hints_of(owner: Callable[..., object] | type) -> dict[str, Any]:
    """Evaluate the annotations of a function or a class."""
    return typing.get_type_hints(owner, include_extras=True)


@cache
def kind_of(annotation: Any) -> Kind:
    """Return the kind that an annotation stands for.

    Raises
    ------
    TypeError
        If kernels do not know the type.
    """
    if annotation is None or annotation is type(None):
        return Nothing()
    if annotation in SCALARS:
        return Scalar(SCALARS[annotation])
    origin = typing.get_origin(annotation)
    if origin is Annotated and isinstance(typing.get_args(annotation)[1], Array):
        return cast("Array", typing.get_args(annotation)[1])
    if origin is tuple:
        return Tuple(tuple(kind_of(item) for item in typing.get_args(annotation)))
    if isinstance(annotation, type):
        if hasattr(annotation, "kernel_address"):
            return Pointer(annotation)
        if issubclass(annotation, tuple) and hasattr(annotation, "_fields"):
            return Tuple(tuple(kind_of(hint) for hint in hints_of(annotation).values()), annotation)
    expected = "float, int, bool, an array with its number of axes, a Struct, a NamedTuple or a tuple"
    raise TypeError(f"{annotation!r} is no type of a kernel: expected {expected}")


def signature_of(function: Callable[..., object]) -> Signature:
    """Return the signature that a function's annotations give.

    Raises
    ------
    TypeError
        If an annotation is missing, or kernels do not know its type.
    """
    hints, code = hints_of(function), function.__code__
    names = code.co_varnames[: code.co_argcount]
    missing = [name for name in (*names, "return") if name not in hints]
    if missing:
        raise TypeError(f"{function.__module__}.{function.__qualname__}: {', '.join(missing)}: no annotation")
    return Signature(names, tuple(kind_of(hints[name]) for name in names), kind_of(hints["return"]))


@cache
def layout(cls: type) -> dict[str, Kind]:
    """Return the kinds of a structure's fields by name, in the order of their words."""
    hints = hints_of(cls)
    return {name: kind_of(hints[name]) for name in cls.__annotations__}


@cache
def struct_format(cls: type) -> str:
    """Return the words of a structure as a format of the standard library's :mod:`struct`."""
    return "".join(map(word_format, layout(cls).values()))


def offset_of(cls: type, name: str) -> int:
    """Return the position of a field's first word.

    Raises
    ------
    AttributeError
        If the structure has no such field.
    """
    offset = 0
    for field, kind in layout(cls).items():
        if field == name:
            return offset
        offset += num_words(kind)
    raise AttributeError(name)


def num_words(kind: Kind) -> int:
    """Return how many words a value takes."""
    if isinstance(kind, Array):
        return 1 + kind.ndim
    if isinstance(kind, Tuple):
        return sum(map(num_words, kind.items))
    return 0 if isinstance(kind, Nothing) else 1


def word_format(kind: Kind) -> str:
    """Return the words of a value as a format of the standard library's :mod:`struct`."""
    if isinstance(kind, Tuple):
        return "".join(map(word_format, kind.items))
    return "d" if kind == Scalar("f") else "q" * num_words(kind)


def add_words(words: list[Any], kind: Kind, value: Any, where: str) -> None:
    """Append the words of a value. Numbers are appended as they are.

    Raises
    ------
    TypeError
        If the value is of another kind. The message begins with ``where``.
    """
    if isinstance(kind, Scalar):
        words.append(value)
    elif isinstance(kind, Array):
        if (
            not isinstance(value, np.ndarray)
            or value.ndim != kind.ndim
            or value.dtype != DTYPES[kind.code]
            or not value.flags.c_contiguous
        ):
            raise TypeError(f"{where}: {_described(value)}: expected a {kind}")
        words.append(_address_of(value))
        words += value.shape
    elif isinstance(kind, Pointer):
        if not isinstance(value, kind.cls):
            raise TypeError(f"{where}: {_described(value)}: expected a {kind}")
        words.append(value.kernel_address)  # type: ignore[attr-defined]
    elif isinstance(kind, Tuple):
        if len(value) != len(kind.items):
            raise TypeError(f"{where}: {_described(value)}: expected {len(kind.items)} items")
        for index, item in enumerate(kind.items):
            if isinstance(item, Scalar):
                words.append(value[index])
            else:
                add_words(words, item, value[index], f"{where}[{index}]")


def _address_of(array: Any) -> int:
    """Return where an array's first number lies, by the quickest way that there is for it."""
    flags = array.flags
    if flags.writeable and array.size:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))
    return cast("int", array.__array_interface__["data"][0])


def _described(value: object) -> str:
    """Describe a wrong argument for a message."""
    if isinstance(value, np.ndarray):
        order = "" if value.flags.c_contiguous else ", not C-contiguous"
        return f"an array of {value.ndim} axes, dtype {value.dtype}{order}"
    return f"a {type(value).__name__}"


def is_of_numbers(kind: Kind) -> bool:
    """Tell whether a result consists of numbers, so that Python can be given it."""
    if isinstance(kind, Tuple):
        return all(map(is_of_numbers, kind.items))
    return isinstance(kind, Scalar | Nothing)


def value_of(kind: Kind, words: Iterator[Any]) -> Any:
    """Return the value that the next words of a result stand for."""
    if isinstance(kind, Tuple):
        items = [value_of(item, words) for item in kind.items]
        return kind.cls(*items) if kind.cls else tuple(items)
    if isinstance(kind, Nothing):
        return None
    value = next(words)
    return bool(value) if kind == Scalar("b") else value


def fingerprint(kind: Kind) -> str:
    """Return a text that changes whenever generated code has to, also with the layout of a structure."""
    if isinstance(kind, Pointer):
        return _struct_fingerprint(kind.cls)
    if isinstance(kind, Tuple):
        name = kind.cls.__qualname__ if kind.cls else ""
        return f"{name}({','.join(map(fingerprint, kind.items))})"
    return repr(kind)


@cache
def _struct_fingerprint(cls: type) -> str:
    fields = ",".join(f"{name}:{fingerprint(kind)}" for name, kind in layout(cls).items())
    return f"{cls.__module__}.{cls.__qualname__}:{hashlib.sha256(fields.encode()).hexdigest()}"

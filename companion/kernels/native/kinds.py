"""The types that kernels know, read from annotations, and how their values lie in memory.

Every value is a row of 8-byte words: a number is one word, an array its address and its shape, a structure the
address of its own words, and a tuple its items one after the other.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np

__all__ = ["Array", "Kind", "Nothing", "Pointer", "Scalar", "Signature", "Tuple", "kind_of", "signature_of"]

DTYPES = {"f": np.dtype(np.float64), "i": np.dtype(np.int64), "b": np.dtype(np.bool_)}
SCALARS = {float: "f", int: "i", bool: "b"}


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number: ``code`` f is a float, i an integer, b a truth value."""

    code: str

    def __str__(self) -> str:
        return {"f": "float", "i": "int", "b": "bool"}[self.code]


@dataclass(frozen=True, slots=True)
class Array:
    """A C-contiguous array of ``ndim`` axes; ``code`` as in :class:`Scalar`."""

    code: str
    ndim: int

    def __str__(self) -> str:
        return f"C-contiguous array of {self.ndim} axes, dtype {DTYPES[self.code]}"


@dataclass(frozen=True, slots=True)
class Pointer:
    """A structure, ``cls``, that is handed over by its address."""

    cls: type

    def __str__(self) -> str:
        return self.cls.__name__


@dataclass(frozen=True, slots=True)
class Tuple:
    """A tuple of such values; ``cls`` where it is a named one."""

    items: tuple[Kind, ...]
    cls: type | None = None

    def __str__(self) -> str:
        return self.cls.__name__ if self.cls else f"({', '.join(map(str, self.items))})"


@dataclass(frozen=True, slots=True)
class Nothing:
    """What a kernel returns that returns nothing."""

    def __str__(self) -> str:
        return "None"


Kind = Scalar | Array | Pointer | Tuple | Nothing


@dataclass(frozen=True, slots=True)
class Signature:
    """``names`` of a kernel's parameters, their ``kinds``, and what it ``returns``."""

    names: tuple[str, ...]
    kinds: tuple[Kind, ...]
    returns: Kind


@cache
def hints_of(owner: Any) -> dict[str, Any]:
    """The annotations of a function or class, evaluated."""
    return typing.get_type_hints(owner, include_extras=True)


@cache
def kind_of(annotation: Any) -> Kind:
    """The kind of value that an annotation stands for.

    Raises
    ------
    TypeError
        If kernels know no such value.
    """
    if annotation is None or annotation is type(None):
        return Nothing()
    if annotation in SCALARS:
        return Scalar(SCALARS[annotation])
    origin = typing.get_origin(annotation)
    if origin is Annotated:
        (kind,) = annotation.__metadata__
        if isinstance(kind, Array):
            return kind
    if origin is tuple:
        return Tuple(tuple(kind_of(item) for item in typing.get_args(annotation)))
    if isinstance(annotation, type):
        if hasattr(annotation, "kernel_words"):
            return Pointer(annotation)
        if issubclass(annotation, tuple) and hasattr(annotation, "_fields"):
            return Tuple(tuple(kind_of(hint) for hint in hints_of(annotation).values()), annotation)
    raise TypeError(
        f"{annotation!r} is no type of a kernel: expected float, int, bool, an array with its number of axes, "
        "a Struct, a NamedTuple or a tuple of these"
    )


def signature_of(function: Callable[..., Any]) -> Signature:
    """The signature that a function's annotations give.

    Raises
    ------
    TypeError
        If one is missing or names a type that kernels do not know.
    """
    hints, code = hints_of(function), function.__code__
    names = code.co_varnames[: code.co_argcount]
    missing = [name for name in (*names, "return") if name not in hints]
    if missing:
        raise TypeError(f"{function.__module__}.{function.__qualname__}: {', '.join(missing)}: no annotation")
    return Signature(names, tuple(kind_of(hints[name]) for name in names), kind_of(hints["return"]))


def num_words(kind: Kind) -> int:
    """How many words a value takes."""
    if isinstance(kind, Array):
        return 1 + kind.ndim
    if isinstance(kind, Tuple):
        return sum(map(num_words, kind.items))
    return 0 if isinstance(kind, Nothing) else 1


def word_format(kind: Kind) -> str:
    """The value's words as the format of :mod:`struct`."""
    if isinstance(kind, Tuple):
        return "".join(map(word_format, kind.items))
    return "d" if kind == Scalar("f") else "q" * num_words(kind)


def add_words(words: list[Any], kind: Kind, value: Any, where: str) -> None:
    """Append the words of a value, numbers as they are.

    Raises
    ------
    TypeError
        If it is not of that kind; ``where`` names it.
    """
    if isinstance(kind, Scalar):
        words.append(value)
    elif isinstance(kind, Array):
        if (
            not isinstance(value, np.ndarray)
            or value.ndim != kind.ndim
            or (value.dtype is not DTYPES[kind.code] and value.dtype != DTYPES[kind.code])
            or not value.flags.c_contiguous
        ):
            raise TypeError(f"{where}: {_described(value)}: expected a {kind}")
        words.append(value.__array_interface__["data"][0])
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


def _described(value: Any) -> str:
    """What was handed over, for a message."""
    if isinstance(value, np.ndarray):
        order = "" if value.flags.c_contiguous else ", not C-contiguous"
        return f"an array of {value.ndim} axes, dtype {value.dtype}{order}"
    return f"a {type(value).__name__}"


def values_from(kind: Kind, words: Iterator[Any]) -> Any:
    """The value of a result's words."""
    if isinstance(kind, Tuple):
        items = [values_from(item, words) for item in kind.items]
        return kind.cls(*items) if kind.cls else tuple(items)
    if isinstance(kind, Nothing):
        return None
    value = next(words)
    return bool(value) if kind == Scalar("b") else value


def fingerprint(kind: Kind) -> str:
    """The kind in words that change with whatever generated code depends on, the layout of structures too."""
    if isinstance(kind, Pointer):
        return _struct_fingerprint(kind.cls)
    if isinstance(kind, Tuple):
        name = kind.cls.__qualname__ if kind.cls else ""
        return f"{name}({','.join(map(fingerprint, kind.items))})"
    return repr(kind)


@cache
def layout(cls: type) -> dict[str, Kind]:
    """The kinds of a structure's fields, by name, in the order of their words."""
    hints = hints_of(cls)
    return {field.name: kind_of(hints[field.name]) for field in dataclasses.fields(cls)}


@cache
def struct_format(cls: type) -> str:
    """A structure's words as the format of :mod:`struct`."""
    return "".join(map(word_format, layout(cls).values()))


def offset_of(cls: type, name: str) -> int:
    """The first word of a structure's field."""
    offset = 0
    for field, kind in layout(cls).items():
        if field == name:
            return offset
        offset += num_words(kind)
    raise AttributeError(name)


@cache
def _struct_fingerprint(cls: type) -> str:
    fields = (f"{name}:{fingerprint(kind)}" for name, kind in layout(cls).items())
    return f"{cls.__module__}.{cls.__qualname__}{{{','.join(fields)}}}"

"""Kernels: functions with one signature, compiled each for itself, that Python may call as well.

:func:`kernel` makes object code of its own, which others call by its symbol: a change in it compiles it alone.
:func:`inlined` is copied into whatever calls it, and a change in it compiles these again: it is for what is
smaller than a call. With ``NUMBA_DISABLE_JIT=1`` both leave a function as it is, so that coverage and a debugger
see its lines.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import pickle
import types
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from struct import error as StructError
from struct import pack_into, unpack_from
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from companion.kernels.native import kinds, machine
from companion.kernels.native.store import kernel_store

__all__ = [
    "IS_COMPILED",
    "Kernel",
    "inlined",
    "inlined_numpy_errors",
    "kernel",
    "kernel_numpy_errors",
    "local_floats",
    "local_ints",
    "local_table",
    "refuse_compiling",
]

IS_COMPILED = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
GENERATORS = ("compiler.py", "kinds.py", "numba_types.py")  # a change in one of these is one in every kernel
CONSTANTS = (int, float, str, bool, types.NoneType)

Report = Callable[[int, int], None]  # told how many of how many are compiled

_P = ParamSpec("_P")
_R = TypeVar("_R")


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile for itself; a division by zero raises, as in Python."""
    return _made(function, is_inlined=False, has_numpy_errors=False)


def kernel_numpy_errors(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile for itself; a division by zero gives infinity: no branch at every division."""
    return _made(function, is_inlined=False, has_numpy_errors=True)


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Copy into all that call it; a division by zero raises, as in Python."""
    return _made(function, is_inlined=True, has_numpy_errors=False)


def inlined_numpy_errors(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Copy into all that call it; a division by zero gives infinity: no branch at every division."""
    return _made(function, is_inlined=True, has_numpy_errors=True)


def _made(function: Callable[_P, _R], *, is_inlined: bool, has_numpy_errors: bool) -> Callable[_P, _R]:
    if not IS_COMPILED:
        return function
    return cast(
        "Callable[_P, _R]", Kernel(function, is_inlined=is_inlined, has_numpy_errors=has_numpy_errors)
    )


def local_floats(n: int) -> NDArray[np.float64]:
    """An array (n,) that lives until the kernel returns; in kernels ``n`` is constant. It holds nothing yet."""
    return np.empty(n)


def local_ints(n: int) -> NDArray[np.int64]:
    """:func:`local_floats` of integers (n,)."""
    return np.empty(n, dtype=np.int64)


def local_table(rows: int, columns: int) -> NDArray[np.float64]:
    """:func:`local_floats` with two axes, (rows, columns)."""
    return np.empty((rows, columns))


INTRINSICS = (local_floats, local_ints, local_table)  # what the compiler knows by itself

_may_compile = True


def refuse_compiling() -> None:
    """Raise from now on where something would have to be compiled."""
    global _may_compile
    _may_compile = False


class Kernel:
    """A function with one signature that runs as machine code.

    Parameters
    ----------
    function : callable
        Annotated throughout; refers to constants, kernels and :mod:`math` only.
    is_inlined : bool
        Copied into callers.
    has_numpy_errors : bool
        A division by zero does not raise.
    """

    def __init__(self, function: Callable[..., Any], *, is_inlined: bool, has_numpy_errors: bool) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self.is_inlined = is_inlined
        self.has_numpy_errors = has_numpy_errors
        self.symbol = f"{function.__module__}.{function.__qualname__}"
        self._call: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        """Run it; its machine code is read, or made, the first time."""
        return (self._call or self.open())(*arguments)

    def __repr__(self) -> str:
        return f"<kernel {self.symbol}>"

    def __reduce__(self) -> str:
        """By its name, as functions are."""
        return self.py_func.__qualname__

    @functools.cached_property
    def signature(self) -> kinds.Signature:
        """Its signature."""
        return kinds.signature_of(self.py_func)

    @functools.cached_property
    def callees(self) -> tuple[Kernel, ...]:
        """Kernels that it calls itself."""
        return tuple(value for _, value in self._globals() if isinstance(value, Kernel))

    @functools.cached_property
    def linked(self) -> tuple[Kernel, ...]:
        """Kernels whose symbols its object code calls: its callees, and those of what is copied into it."""
        found: dict[Kernel, None] = {}
        for callee in self.callees:
            found |= dict.fromkeys(callee.linked) if callee.is_inlined else {callee: None}
        return tuple(found)

    @functools.cached_property
    def interface(self) -> str:
        """What its callers depend on unless it is copied into them."""
        signature = self.signature
        of = ",".join(map(kinds.fingerprint, signature.kinds))
        return f"{self.symbol}({of})->{kinds.fingerprint(signature.returns)}"

    @functools.cached_property
    def key(self) -> str:
        """Digest of all that its machine code depends on."""
        parts = [_generator(), self.interface, str(self.is_inlined), str(self.has_numpy_errors)]
        parts += _code_parts(self.py_func.__code__, self.py_func.__doc__)
        for name, value in self._globals():
            if isinstance(value, Kernel):
                parts.append(f"{name}={value.key if value.is_inlined else value.interface}")
            elif isinstance(value, type):
                parts.append(f"{name}={kinds.fingerprint(kinds.kind_of(value))}")
            else:
                parts.append(f"{name}={value.__name__ if callable(value) else repr(value)}")
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:40]

    def file(self, kind: str) -> str:
        """Name of the file that keeps it: ``o`` of object code, ``bc`` of what is copied into callers."""
        return f"{self.py_func.__name__}-{self.key}.{kind}"

    def _globals(self) -> Iterator[tuple[str, Any]]:
        """What the code refers to outside itself, by name.

        Raises
        ------
        TypeError
            If it is of a kind whose changes could not be told.
        """
        if self.py_func.__closure__:
            raise TypeError(f"{self.symbol}: a kernel has no variables of a function round it")
        yield from _referred(self.py_func.__code__.co_names, self.py_func.__globals__, self.symbol)

    def open(self) -> Callable[..., Any]:
        """Read its machine code and that of all it calls, or compile it; how Python calls it."""
        with machine.LOCK:
            if self._call is None:
                load([self])
                self._call = _caller(self, machine.door_of(f"door.{self.symbol}"))
        return self._call


_loaded: set[Kernel] = set()


def load(kernels: Iterable[Kernel], report: Report | None = None) -> None:
    """Have the machine code of some kernels, and of all they call, in this process.

    What is not kept is compiled, on all processors where it is much; ``report`` is told how many of how many are.

    Raises
    ------
    RuntimeError
        If something has to be compiled after :func:`refuse_compiling`, or cannot be.
    """
    with machine.LOCK:
        wanted: dict[Kernel, None] = {}
        waiting = list(kernels)
        while waiting:
            one = waiting.pop()
            if one not in wanted and one not in _loaded:
                wanted[one] = None
                waiting += one.linked
        found = {one: kernel_store().read(one.file("o")) for one in wanted}
        missing = [one for one, code in found.items() if code is None]
        if missing:
            if not _may_compile:
                raise RuntimeError(f"{missing[0].symbol} would have to be compiled now")
            from companion.kernels.native import build

            found |= build.built(missing, report)
        machine.load(code for code in found.values() if code is not None)
        _loaded.update(wanted)


def kept_or_compiled(one: Kernel) -> bytes:
    """The object code of one kernel, read or compiled and kept."""
    found = kernel_store().read(one.file("o"))
    if found is None:
        from companion.kernels.native import compiler

        found = compiler.compiled(one)
        kernel_store().write(one.file("o"), found)
    return found


def _caller(one: Kernel, door: Callable[[Any], int]) -> Callable[..., Any]:
    """A function that lays the arguments out in words, goes through the door and reads the result."""
    signature = one.signature
    entry = "".join(map(kinds.word_format, signature.kinds))
    result = kinds.word_format(signature.returns)
    frame_of = ctypes.c_int64 * max(2, len(entry) + len(result))
    parameters = [
        (kind, f"{one.__name__}: {name}") for name, kind in zip(signature.names, signature.kinds, strict=True)
    ]
    returns, at, num = signature.returns, 8 * len(entry), len(parameters)
    is_one, is_flag = isinstance(returns, kinds.Scalar), returns == kinds.Scalar("b")

    def call(*arguments: Any) -> Any:
        if len(arguments) != num:
            raise TypeError(f"{one.__name__}: {len(arguments)} arguments: expected {num}, {signature.names}")
        words: list[Any] = []
        for value, (kind, where) in zip(arguments, parameters, strict=True):
            kinds.add_words(words, kind, value, where)
        frame = frame_of()
        try:
            pack_into(entry, frame, 0, *words)
        except StructError as error:
            raise TypeError(f"{one.__name__}{signature.names}: {arguments}: {error}") from None
        if door(frame):
            raise _error_in(frame)
        if not result:
            return None
        found = unpack_from(result, frame, at)
        if is_one:
            return bool(found[0]) if is_flag else found[0]
        return kinds.values_from(returns, iter(found))

    return call


def _error_in(frame: Any) -> BaseException:
    """The exception that a kernel ended with: the first words of its frame say where it is described."""
    about, size = frame[0], frame[1]
    error, arguments, _ = pickle.loads(ctypes.string_at(about, size))
    return cast("BaseException", error(*(arguments or ())))


@functools.cache
def _generator() -> str:
    """What machine code depends on but for the kernels: the machine, and the code here that generates it."""
    digest = hashlib.sha256(machine.about_machine().encode())
    for name in GENERATORS:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()


def _code_parts(code: types.CodeType, docstring: str | None) -> Iterator[str]:
    """What a function's code does, whatever lines it stands in and whatever is said of it."""
    yield code.co_code.hex()
    yield repr((code.co_names, code.co_varnames, code.co_argcount))
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _code_parts(constant, None)
        elif docstring is None or constant != docstring:
            yield repr(constant)


def _referred(names: tuple[str, ...], within: dict[str, Any], where: str) -> Iterator[tuple[str, Any]]:
    """What stands behind ``names`` in a module, and behind them in modules of ours that it names.

    A name that the module lacks is a built-in one, or that of an attribute.
    """
    for name in names:
        if name not in within:
            continue
        value = within[name]
        if isinstance(value, types.ModuleType):
            if value.__name__.partition(".")[0] not in ("math", "numpy"):
                yield from (
                    (f"{name}.{inner}", found) for inner, found in _referred(names, vars(value), where)
                )
        elif (
            isinstance(value, (Kernel, *CONSTANTS))
            or any(value is one for one in INTRINSICS)
            or _is_named_type(value)
        ):
            yield name, value
        elif isinstance(value, tuple) and all(isinstance(item, CONSTANTS) for item in value):
            yield name, value
        else:
            raise TypeError(
                f"{where}: {name} is a {type(value).__name__}: a kernel refers to kernels and constants"
            )


def _is_named_type(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, tuple)

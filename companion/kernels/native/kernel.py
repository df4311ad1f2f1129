"""Kernels: functions with one signature that run as machine code and can be called from Python.

:func:`kernel` gives a function object code of its own. Other kernels call it by its symbol, so a change in it
compiles it alone. :func:`inlined` copies a function into the kernels that call it, so a change in it compiles
those. It is meant for functions that are smaller than a call. With ``NUMBA_DISABLE_JIT=1`` both return the
function itself, so that coverage and a debugger see its lines.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib
import opcode
import os
import pickle
import types
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from struct import error as StructError
from struct import pack_into, unpack_from
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from companion.kernels.native import kinds, machine
from companion.kernels.native.store import kernel_store

__all__ = [
    "Kernel",
    "Report",
    "inlined",
    "inlined_numpy_errors",
    "kernel",
    "kernel_numpy_errors",
    "load",
    "local_floats",
    "local_ints",
    "local_table",
    "refuse_compiling",
    "stored_or_compiled",
]

IS_COMPILED = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
GENERATORS = "compiler.py", "kinds.py", "numba_types.py"  # They generate code: a change compiles everything.
LOAD_GLOBAL, EXTENDED_ARG = opcode.opmap["LOAD_GLOBAL"], opcode.opmap["EXTENDED_ARG"]
CONSTANTS = (int, float, str, bool, types.NoneType)
LIBRARIES = ("math", "numpy")  # Their versions are in every key already.
COMPILER, BUILD = "companion.kernels.native.compiler", "companion.kernels.native.build"  # They load slowly.

Report = Callable[[int, int], None]  # It receives how many kernels are compiled, and how many have to be.

_P = ParamSpec("_P")
_R = TypeVar("_R")


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function by itself. A division by zero raises, as in Python."""
    return _kernel_of(function, is_inlined=False, has_numpy_errors=False)


def kernel_numpy_errors(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function by itself. A division by zero gives infinity, which saves a branch."""
    return _kernel_of(function, is_inlined=False, has_numpy_errors=True)


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Copy a function into its callers. A division by zero raises, as in Python."""
    return _kernel_of(function, is_inlined=True, has_numpy_errors=False)


def inlined_numpy_errors(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Copy a function into its callers. A division by zero gives infinity, which saves a branch."""
    return _kernel_of(function, is_inlined=True, has_numpy_errors=True)


def _kernel_of(function: Callable[_P, _R], *, is_inlined: bool, has_numpy_errors: bool) -> Callable[_P, _R]:
    if not IS_COMPILED:
        return function
    return cast(
        "Callable[_P, _R]", Kernel(function, is_inlined=is_inlined, has_numpy_errors=has_numpy_errors)
    )


def local_floats(n: int) -> NDArray[np.float64]:
    """Return an uninitialised array (n,) that lives until the kernel returns. In a kernel, n is constant."""
    return np.empty(n)


def local_ints(n: int) -> NDArray[np.int64]:
    """Return an array (n,) of integers, else as :func:`local_floats`."""
    return np.empty(n, dtype=np.int64)


def local_table(rows: int, columns: int) -> NDArray[np.float64]:
    """Return an array (rows, columns), else as :func:`local_floats`."""
    return np.empty((rows, columns))


INTRINSICS = (local_floats, local_ints, local_table)  # The compiler has code of its own for these.


class Kernel:
    """A function that runs as machine code.

    Parameters
    ----------
    function : callable
        It has annotations, and refers only to constants, types, kernels and the module :mod:`math`.
    is_inlined : bool
        Whether its code is copied into its callers.
    has_numpy_errors : bool
        Whether a division by zero gives infinity instead of raising.

    Attributes
    ----------
    py_func : callable
        The function as Python.
    symbol : str
        The module and the name of the function.
    """

    def __init__(self, function: Callable[..., Any], *, is_inlined: bool, has_numpy_errors: bool) -> None:
        functools.update_wrapper(self, function)
        self.py_func = function
        self.is_inlined = is_inlined
        self.has_numpy_errors = has_numpy_errors
        self.symbol = f"{function.__module__}.{function.__qualname__}"
        self._call: Callable[..., Any] | None = None

    def __call__(self, *arguments: object) -> Any:
        """Run the machine code. The first call loads or compiles it."""
        return (self._call or self._open())(*arguments)

    def __repr__(self) -> str:
        return f"<kernel {self.symbol}>"

    def __reduce__(self) -> str:
        """Pickle the name, as functions do."""
        return self.py_func.__qualname__

    @functools.cached_property
    def signature(self) -> kinds.Signature:
        """The signature that the annotations give."""
        return kinds.signature_of(self.py_func)

    @functools.cached_property
    def callees(self) -> tuple[Kernel, ...]:
        """The kernels that the function calls."""
        return tuple(value for _, value in self._globals() if isinstance(value, Kernel))

    @functools.cached_property
    def linked(self) -> tuple[Kernel, ...]:
        """The kernels whose symbols the object code calls: its callees, and those of inlined callees."""
        found: dict[Kernel, None] = {}
        for callee in self.callees:
            found |= dict.fromkeys(callee.linked) if callee.is_inlined else {callee: None}
        return tuple(found)

    @functools.cached_property
    def interface(self) -> str:
        """Everything that the code of a caller depends on, unless the kernel is inlined."""
        signature = self.signature
        parameters = ",".join(map(kinds.fingerprint, signature.kinds))
        errors = "numpy" if self.has_numpy_errors else "python"  # numba puts it into the symbol
        return f"{self.symbol}({parameters})->{kinds.fingerprint(signature.returns)} {errors}"

    @functools.cached_property
    def key(self) -> str:
        """The digest of everything that the machine code depends on.

        Raises
        ------
        TypeError
            If the function refers to something whose changes the digest could not show.
        """
        parts = [_generator(), self.interface, str(self.is_inlined)]
        parts += _code_parts(self.py_func.__code__, self.py_func.__doc__)
        for name, value in self._globals():
            if isinstance(value, Kernel):
                parts.append(f"{name}={value.key if value.is_inlined else value.interface}")
            elif isinstance(value, type):
                parts.append(f"{name}={kinds.fingerprint(kinds.kind_of(value))}")
            else:
                parts.append(f"{name}={value.__name__ if callable(value) else repr(value)}")
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:40]

    def file(self, suffix: str) -> str:
        """Return a file name in the store: ``o`` for object code, ``bc`` for code that callers copy."""
        return f"{self.py_func.__name__}-{self.key}.{suffix}"

    def _globals(self) -> Iterator[tuple[str, Any]]:
        """Go through what the code refers to outside the function, by name."""
        if self.py_func.__closure__:
            raise TypeError(f"{self.symbol}: a kernel has no variables of an enclosing function")
        within, names = self.py_func.__globals__, set(self.py_func.__code__.co_names)
        for name in sorted(_global_names(self.py_func.__code__) & within.keys()):
            value = within[name]
            if not isinstance(value, types.ModuleType):
                yield name, _known(value, f"{self.symbol}: {name}")
            elif value.__name__.partition(".")[0] not in LIBRARIES:
                for inner in sorted(names & vars(value).keys()):
                    if not isinstance(vars(value)[inner], types.ModuleType):
                        yield f"{name}.{inner}", _known(vars(value)[inner], f"{self.symbol}: {name}.{inner}")

    def _open(self) -> Callable[..., Any]:
        """Load or compile the machine code, and return the function that calls it.

        Raises
        ------
        TypeError
            If the kernel returns more than numbers: then only other kernels can call it.
        """
        if not kinds.is_of_numbers(self.signature.returns):
            raise TypeError(
                f"{self.symbol} returns a {self.signature.returns}: expected numbers to call it from Python"
            )
        with machine.LOCK:
            if self._call is None:
                load([self])
                self._call = _caller(self, machine.door_of(f"door.{self.symbol}"))
        return self._call


@dataclass
class _Process:
    """The kernels that this process has loaded, and whether it may compile."""

    loaded: set[Kernel] = field(default_factory=set)
    may_compile: bool = True

    def refuse_compiling(self) -> None:
        """Do not compile from now on."""
        self.may_compile = False


_process = _Process()


def refuse_compiling() -> None:
    """Make this process raise from now on wherever it would compile."""
    _process.refuse_compiling()


def load(kernels: Iterable[Kernel], report: Report | None = None) -> None:
    """Load the machine code of kernels and of everything that they call.

    Code that is not in the store is compiled: a lot of it on all processors.

    Parameters
    ----------
    kernels : iterable of Kernel
        The kernels.
    report : callable, optional
        Called whenever another kernel is compiled.

    Raises
    ------
    RuntimeError
        If a kernel cannot be compiled, or would have to be after :func:`refuse_compiling`.
    """
    with machine.LOCK:
        wanted: dict[Kernel, None] = {}
        waiting = list(kernels)
        while waiting:
            one = waiting.pop()
            if one not in wanted and one not in _process.loaded:
                wanted[one] = None
                waiting += one.linked
        found = {one: kernel_store().read(one.file("o")) for one in wanted}
        missing = [one for one, code in found.items() if code is None]
        if missing:
            if not _process.may_compile:
                raise RuntimeError(f"{missing[0].symbol} would have to be compiled now")
            found |= importlib.import_module(BUILD).built(missing, report)
        machine.load(code for code in found.values() if code is not None)
        _process.loaded.update(wanted)


def stored_or_compiled(one: Kernel) -> bytes:
    """Return a kernel's object code from the store, or compile and store it.

    Raises
    ------
    RuntimeError
        If the kernel cannot be compiled.
    """
    found = kernel_store().read(one.file("o"))
    if found is None:
        found = cast("bytes", importlib.import_module(COMPILER).compiled(one))
        kernel_store().write(one.file("o"), found)
    return found


def _caller(one: Kernel, door: Callable[[Any], int]) -> Callable[..., Any]:
    """Return a function that writes the arguments as words, calls the door, and reads the result."""
    name, signature = one.py_func.__name__, one.signature
    entry = "".join(map(kinds.word_format, signature.kinds))
    result = kinds.word_format(signature.returns)
    frame_type = ctypes.c_int64 * max(2, len(entry) + len(result))
    parameters = [(kind, f"{name}: {of}") for of, kind in zip(signature.names, signature.kinds, strict=True)]
    returns, at, num = signature.returns, 8 * len(entry), len(parameters)
    is_number = isinstance(returns, kinds.Scalar) and returns.code != "b"

    def call(*arguments: object) -> Any:
        if len(arguments) != num:
            raise TypeError(f"{name}: {len(arguments)} arguments: expected {num}, {signature.names}")
        words: list[Any] = []
        for value, (kind, where) in zip(arguments, parameters, strict=True):
            kinds.add_words(words, kind, value, where)
        frame = frame_type()
        try:
            pack_into(entry, frame, 0, *words)
        except StructError as error:
            raise TypeError(f"{name}{signature.names}: {arguments}: {error}") from None
        if door(frame):
            raise _error_in(frame)
        found = unpack_from(result, frame, at)
        return found[0] if is_number else kinds.value_of(returns, iter(found))

    return call


def _error_in(frame: ctypes.Array[ctypes.c_int64]) -> BaseException:
    """Return the exception that a kernel ended with. The first two words say where numba describes it."""
    error, arguments, _ = pickle.loads(ctypes.string_at(frame[0], frame[1]))
    return cast("BaseException", error(*(arguments or ())))


@functools.cache
def _generator() -> str:
    """Return a digest of the machine and of the modules here that generate code."""
    digest = hashlib.sha256(machine.about_machine().encode())
    for name in GENERATORS:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()


def _code_parts(code: types.CodeType, docstring: str | None) -> Iterator[str]:
    """Describe what code does, without its line numbers and its docstring."""
    yield code.co_code.hex()
    yield repr((code.co_names, code.co_varnames, code.co_argcount))
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _code_parts(constant, None)
        elif docstring is None or constant != docstring:
            yield repr(constant)


def _global_names(code: types.CodeType) -> set[str]:
    """Return the names of the globals that code loads, built-in functions included."""
    raw, found = code.co_code, set()
    at = raw.find(LOAD_GLOBAL)
    while at >= 0:
        if at % 2 == 0:  # Each instruction is two bytes, its code and its argument.
            argument = raw[at + 1] | (raw[at - 1] << 8 if at and raw[at - 2] == EXTENDED_ARG else 0)
            found.add(code.co_names[argument >> 1])
        at = raw.find(LOAD_GLOBAL, at + 1)
    return found


def _known(value: Any, where: str) -> Any:
    """Return a value that the key of a kernel can describe.

    Raises
    ------
    TypeError
        If it is of another kind. The message begins with ``where``.
    """
    if (
        isinstance(value, Kernel)
        or _is_constant(value)
        or (isinstance(value, type) and issubclass(value, tuple))
    ):
        return value
    kind = type(value).__name__
    raise TypeError(f"{where} is a {kind}: a kernel refers to kernels and constants")


def _is_constant(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return isinstance(value, CONSTANTS) or any(value is one for one in INTRINSICS)

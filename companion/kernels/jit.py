"""How kernels are compiled: once, kept on disk, without the interpreter's lock.

With ``NUMBA_DISABLE_JIT=1`` both decorators leave a function as it is, so that coverage and a debugger
see its lines.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba as nb

__all__ = ["kernel", "kernel_numpy_errors"]

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: _Function) -> _Function:
    """Compile a kernel; a division by zero raises, as in Python."""
    return cast("_Function", nb.njit(cache=True, nogil=True)(function))


def kernel_numpy_errors(function: _Function) -> _Function:
    """Compile a kernel in which a division by zero gives infinity: no branch at every division."""
    return cast("_Function", nb.njit(cache=True, nogil=True, error_model="numpy")(function))

"""Loads object code into this process, by LLVM's own linker and without numba."""

from __future__ import annotations

import ctypes
import importlib
import os
import platform
import sys
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import version
from threading import RLock
from typing import Any

__all__ = ["LOCK", "about_machine", "door_of", "load"]

DOOR = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)  # ctypes releases the interpreter's lock in a call.
LOCK = RLock()


@cache
def about_machine() -> str:
    """Describe the processor, the libraries and the settings that object code depends on."""
    llvm = _llvm()
    processor = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        is_generic = processor.lower() == "generic"  # numba then uses what every processor has
        features = "" if is_generic else llvm.get_host_cpu_features().flatten()
    libraries = [f"{name} {version(name)}" for name in ("numba", "llvmlite")]
    settings = [f"{key}={os.environ[key]}" for key in sorted(os.environ) if key.startswith("NUMBA_OPT")]
    python = f"Python {sys.version_info[0]}.{sys.version_info[1]}"
    return "\n".join([platform.machine(), sys.platform, python, processor, features, *libraries, *settings])


def load(objects: Iterable[bytes]) -> None:
    """Add object code to this process. What it calls must come with it or be there already."""
    with LOCK:
        engine = _engine()
        for code in objects:
            engine.add_object_file(_llvm().ObjectFileRef.from_data(code))
        engine.finalize_object()


def door_of(symbol: str) -> Callable[[Any], int]:
    """Return the function of that name. It takes the address of its words, and returns 0 for success.

    The object code that defines it must be loaded: LLVM ends the process if it is not.
    """
    with LOCK:
        return DOOR(_engine().get_function_address(symbol))


@cache
def _llvm() -> Any:
    """Import llvmlite when it is first needed: many commands never run a kernel."""
    llvm = importlib.import_module("llvmlite.binding")
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


@cache
def _engine() -> Any:
    llvm = _llvm()
    machine = llvm.Target.from_default_triple().create_target_machine(opt=3, jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)

"""Loads or compiles all kernels of the program before anything is planned."""

from __future__ import annotations

import importlib
import pkgutil

import companion.kernels
from companion.kernels.native.kernel import Kernel, Report, load

__all__ = ["kernels", "make_ready"]


def kernels() -> list[Kernel]:
    """Return every kernel of the program that has object code of its own."""
    found: dict[str, Kernel] = {}
    for module in pkgutil.walk_packages(companion.kernels.__path__, "companion.kernels."):
        if not module.name.startswith(f"{__package__}."):
            for value in vars(importlib.import_module(module.name)).values():
                if isinstance(value, Kernel) and not value.is_inlined:
                    found[value.symbol] = value
    return [found[symbol] for symbol in sorted(found)]


def make_ready(report: Report | None = None) -> None:
    """Load all kernels, so that nothing is compiled or read while something is planned.

    Parameters
    ----------
    report : callable, optional
        Called whenever another kernel is compiled. It receives how many are, and how many have to be.

    Raises
    ------
    RuntimeError
        If a kernel cannot be compiled.
    """
    load(kernels(), report)

"""Compiled code that is read in flight, and no other: an eighth of what compiling leaves behind."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numba

from companion.config import MissionConfig
from companion.service.warm_up import warm_up

__all__ = ["make_lean"]

COMPILED = ".nbc"  # numba's files of machine code, one a signature


def make_lean(mission: MissionConfig) -> int:
    """Remove compiled kernels that only other kernels call; the number of megabytes that this frees.

    Numba links a kernel's callees into it and caches each of them as well, for whoever calls it next.
    Everything has to be compiled before: a new process warms up and tells which files it has read. What
    is needed after all, of another signature or after a change, is compiled as ever.
    """
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as another:
        read = another.submit(_files_read, mission).result()
    folder = Path(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
    unread = [path for path in folder.rglob(f"*{COMPILED}") if str(path) not in read]
    freed = sum(path.stat().st_size for path in unread)
    for path in unread:
        path.unlink()
    return round(freed / 1e6)


def _files_read(mission: MissionConfig) -> set[str]:
    """Warm up; the files of machine code that this opens."""
    read: set[str] = set()

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and str(arguments[0]).endswith(COMPILED):
            read.add(str(arguments[0]))

    sys.addaudithook(note)
    warm_up(mission)
    return read

"""Compiling on all processors: ``python -m companion.kernels.native.build`` is one of the processes that do it."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from queue import Empty, SimpleQueue
from typing import BinaryIO

from companion.kernels.native.kernel import Kernel, Report, kept_or_compiled
from companion.kernels.native.store import kernel_store

__all__ = ["built"]

FEW = 8  # kernels that this process compiles itself: another one takes as long to start


def built(kernels: list[Kernel], report: Report | None) -> dict[Kernel, bytes]:
    """Compile kernels and keep them.

    Parameters
    ----------
    kernels : list of Kernel
        None of them is kept yet.
    report : callable, optional
        Told how many of how many are done.

    Returns
    -------
    dict
        The object code of each.

    Raises
    ------
    RuntimeError
        If one cannot be compiled.
    """
    waiting: SimpleQueue[Kernel] = SimpleQueue()
    for one in sorted(kernels, key=lambda one: -len(one.py_func.__code__.co_code)):
        waiting.put(one)  # the longest first, so that all processes end at about the same time
    made: dict[Kernel, bytes] = {}

    def take(compile_one: Callable[[Kernel], bytes]) -> None:
        while True:
            try:
                one = waiting.get_nowait()
            except Empty:
                return
            made[one] = compile_one(one)
            if report is not None:
                report(len(made), len(kernels))

    processors = len(os.sched_getaffinity(0))
    if len(kernels) <= FEW or processors == 1:
        take(kept_or_compiled)
        return made
    with ThreadPoolExecutor(processors) as threads:
        for done in [threads.submit(_in_another_process, take) for _ in range(processors)]:
            done.result()
    return made


def _in_another_process(take: Callable[[Callable[[Kernel], bytes]], None]) -> None:
    """Take one kernel after the other, and have another process compile it."""
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(kernel_store().folder.parent),
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    command = [sys.executable, "-m", __name__]
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        take(partial(_asked, process.stdin, process.stdout))
        process.stdin.close()


def _asked(questions: BinaryIO, answers: BinaryIO, one: Kernel) -> bytes:
    """Object code from the other process: how many bytes it is, and then these, or a line that says why not."""
    questions.write(f"{one.py_func.__module__} {one.py_func.__qualname__}\n".encode())
    questions.flush()
    size = answers.readline().decode().strip()
    if not size.isdigit():
        raise RuntimeError(f"{one.symbol} cannot be compiled: {size or 'the compiler ended'}")
    return answers.read(int(size))


def _answer(questions: BinaryIO, answers: BinaryIO) -> None:
    """Compile what is asked for, a line each."""
    for line in questions:
        module, name = line.decode().split()
        try:
            code = kept_or_compiled(getattr(importlib.import_module(module), name))
        except (RuntimeError, TypeError, LookupError, ImportError, AttributeError) as error:
            answers.write(f"{type(error).__name__}: {error}".replace("\n", " ").encode() + b"\n")
        else:
            answers.write(b"%d\n" % len(code) + code)
        answers.flush()


if __name__ == "__main__":
    _answer(sys.stdin.buffer, sys.stdout.buffer)

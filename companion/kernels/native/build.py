"""Compiles kernels on all processors.

``python -m companion.kernels.native.build`` is one of the processes that do it. It reads a kernel's module
and name from each line of its input, and answers with object code.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from queue import Empty, SimpleQueue
from typing import IO

from companion.kernels.native.kernel import Kernel, Report, stored_or_compiled
from companion.kernels.native.store import kernel_store

__all__ = ["built"]

FEW = 8  # Starting a process takes as long as compiling this many kernels.
WORKER_BYTES = 250_000_000  # Memory of a process that compiles.


def built(kernels: list[Kernel], report: Report | None) -> dict[Kernel, bytes]:
    """Compile and store kernels, and remove from the store what nobody has read for long.

    Parameters
    ----------
    kernels : list of Kernel
        Kernels that are not in the store.
    report : callable, optional
        Called whenever another kernel is compiled. It receives how many are, and how many have to be.

    Returns
    -------
    dict
        The object code of each kernel.

    Raises
    ------
    RuntimeError
        If a kernel cannot be compiled.
    """
    waiting: SimpleQueue[Kernel] = SimpleQueue()
    for one in sorted(kernels, key=lambda one: -len(one.py_func.__code__.co_code)):
        waiting.put(one)  # Long kernels come first, so that all processes end at about the same time.
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

    workers = num_workers(len(kernels))
    if workers <= 1:
        take(stored_or_compiled)
    else:
        with ThreadPoolExecutor(workers) as threads:
            for done in [threads.submit(_in_another_process, take) for _ in range(workers)]:
                done.result()
    kernel_store().prune(time.time())
    return made


def num_workers(num_kernels: int) -> int:
    """Return how many processes are worth starting. Together they take at most half of the memory."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return min(processors, num_kernels // FEW, memory // 2 // WORKER_BYTES)


def _in_another_process(take: Callable[[Callable[[Kernel], bytes]], None]) -> None:
    """Take kernels one after the other, and let another process compile them."""
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(kernel_store().folder.parent),
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    command = [sys.executable, "-m", "companion.kernels.native.build"]
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        take(partial(_compile_in_process, process.stdin, process.stdout))
        process.stdin.close()


def _compile_in_process(questions: IO[bytes], answers: IO[bytes], one: Kernel) -> bytes:
    """Ask the other process for object code. It answers with a length and the code, or with an error."""
    questions.write(f"{one.py_func.__module__} {one.py_func.__qualname__}\n".encode())
    questions.flush()
    size = answers.readline().decode().strip()
    if not size.isdigit():
        raise RuntimeError(f"{one.symbol}: {size or 'the process that compiles it has ended'}")
    return answers.read(int(size))


def _answer(questions: IO[bytes], answers: IO[bytes]) -> None:
    """Compile what each line asks for."""
    for line in questions:
        module, name = line.decode().split()
        try:
            code = stored_or_compiled(getattr(importlib.import_module(module), name))
        except (RuntimeError, TypeError, LookupError, ImportError, AttributeError) as error:
            answers.write(f"{type(error).__name__}: {error}".replace("\n", " ").encode() + b"\n")
        else:
            answers.write(b"%d\n" % len(code) + code)
        answers.flush()


if __name__ == "__main__":
    _answer(sys.stdin.buffer, sys.stdout.buffer)

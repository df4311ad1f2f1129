"""What made a row, and where: the source's commit, the version, and the computer."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path

from companion import __version__

_SOURCE = Path(__file__).parents[2]
_PROCESSORS = Path("/proc/cpuinfo")
NO_COMMIT = "unknown"


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where rows come from.

    Parameters
    ----------
    commit : str
        The source's, with ``-changed`` where it was changed since; ``unknown`` outside a checkout.
    version : str
        The project's.
    machine : str
        Processor, number of cores, and Python.
    """

    commit: str
    version: str
    machine: str


def provenance() -> Provenance:
    """Where rows that are made here and now come from."""
    machine = f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return Provenance(_commit(), __version__, machine)


def _commit() -> str:
    if not (_SOURCE / ".git").exists():  # installed, perhaps in a folder of somebody else's checkout
        return NO_COMMIT
    head, changed = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no")
    return f"{head}{'-changed' if changed else ''}" if head else NO_COMMIT


def _git(*arguments: str) -> str:
    """What git says; nothing where there is none, or it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(_SOURCE), *arguments], capture_output=True, text=True, check=False, timeout=30.0
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _processor() -> str:
    try:
        lines = _PROCESSORS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.machine())

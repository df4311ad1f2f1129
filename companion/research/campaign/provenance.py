"""Provenance of a row: the source's commit, the version, and the computer."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path

from companion import __version__

_SOURCE = Path(__file__).parents[3]
_PROCESSORS = Path("/proc/cpuinfo")
NO_COMMIT = "unknown"


@dataclass(frozen=True, slots=True)
class Provenance:
    """Provenance of rows.

    Parameters
    ----------
    commit : str
        Commit of the source, with ``-changed`` if the source differs from it; ``unknown`` outside a checkout.
    version : str
        Version of the project.
    machine : str
        Processor, number of cores, and Python.
    """

    commit: str
    version: str
    machine: str


def provenance() -> Provenance:
    """Return the provenance of rows made by this program on this computer."""
    machine = f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return Provenance(_commit(), __version__, machine)


def _commit() -> str:
    if not (_SOURCE / ".git").exists():  # The program is installed, perhaps in a folder of another checkout.
        return NO_COMMIT
    head, changed = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no")
    return f"{head}{'-changed' if changed else ''}" if head else NO_COMMIT


def _git(*arguments: str) -> str:
    """Return the output of git; empty if there is no git, or if it fails."""
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

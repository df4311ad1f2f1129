"""Programs of the system that a test needs, and programs of ours that no package holds."""

import importlib
import os
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def needed(program):
    """Skip where a program is not installed; ``.ci/run`` installs it, so there its absence is a failure."""
    if shutil.which(program) is None:
        refuse = pytest.fail if os.environ.get("CI") else pytest.skip
        refuse(f"{program} is not installed")
    return program


def loaded(name, folder="packaging"):
    """A program of a folder, which finds what lies beside it."""
    sys.path.insert(0, str(ROOT / folder))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(ROOT / folder))

"""Programs of the system that a test needs."""

import os
import shutil

import pytest


def needed(program):
    """Skip where a program is not installed; ``.ci/run`` installs it, so there its absence is a failure."""
    if shutil.which(program) is None:
        refuse = pytest.fail if os.environ.get("CI") else pytest.skip
        refuse(f"{program} is not installed")
    return program

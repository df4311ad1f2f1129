"""MAVSDK is ended in any moment of a call without taking the process along (4.1.0 by itself crashes it)."""

import subprocess
import sys

import pytest

# Ten times after each of ten delays; a hundred times among the slow tests.
KINDS = {"discovery": 100, "asked": 100, "answered": 100, "rally points": 2}
LONG = [pytest.param(kind, 1_000, marks=pytest.mark.slow) for kind in ("discovery", "asked")]


@pytest.mark.parametrize(("kind", "number"), [*KINDS.items(), *LONG])
@pytest.mark.thorough
def test_a_call_that_is_cancelled_at_any_moment_ends_alone(kind, number):
    done = subprocess.run(
        [sys.executable, "-m", "tests.link.missions.mavsdk_endings", kind, str(number)],
        capture_output=True, text=True, check=False, timeout=300.0,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == f"{number} ended, 0 left alone\n"

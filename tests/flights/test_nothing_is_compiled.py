"""Whatever a flight does is compiled before it."""

import re
import subprocess
import sys

import pytest

from companion.kernels.native.ready import make_ready
from tests.support.ready_flights import FLIGHTS

DECIDED = {"handed back": "handback", "surprised": "emergency", "in the plane": "arrived", "PX4": "arrived"}


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_compiles_nothing_and_does_without_the_compiler(name):
    """It runs where compiling raises, and ends with a plan for an emergency."""
    make_ready()
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.ready_flights", name],
        capture_output=True, text=True, timeout=600.0, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    plans, numba, decided = re.fullmatch(r"(\d+) plans, numba: (\w+), (.*)\n", done.stdout).groups()
    assert int(plans) >= 2
    assert numba == "False"
    assert DECIDED.get(name, "takeover") in decided

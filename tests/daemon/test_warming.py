"""What is compiled before a flight: everything, or the first plan in flight would wait for it."""

import re
import subprocess
import sys

import pytest

from companion.config import mission_from_text
from companion.daemon.warming import warm_up
from tests.daemon.deck import FIRST_FLIGHT
from tests.sim.client import CONFIGS


@pytest.mark.parametrize("name", ["first-flight", "paper-2d", "paper-3d"])
def test_a_flight_compiles_nothing(name):
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.signatures", CONFIGS / f"{name}.yaml"],
        capture_output=True, text=True, check=True, timeout=600.0,
    )  # fmt: skip
    kernels, plans, late = re.fullmatch(r"(\d+) kernels, (\d+) plans, late: (.*)\n", done.stdout).groups()
    assert int(kernels) > 20
    assert int(plans) >= 4
    assert late == "[]"


@pytest.mark.parametrize(
    "goals", ["goals: from_autopilot\n", "goals:\n  - {east_m: 160, north_m: 750, up_m: 100}\n"],
    ids=["the autopilot's", "at the start"],
)  # fmt: skip
def test_it_does_for_every_mission(goals):
    head, _, rest = FIRST_FLIGHT.partition("goals:\n")
    text = head + goals + rest.partition("\n")[2]
    warm_up(mission_from_text(text, "mission.yaml"))

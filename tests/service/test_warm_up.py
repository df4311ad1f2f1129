"""What is compiled before a flight: everything, or the first plan in flight would wait for it."""

import re
import subprocess
import sys

import pytest

from companion.config import mission_from_text
from companion.service import warm_up as warming
from companion.service.warm_up import NUM_PLANS, warm_up
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import FIRST_FLIGHT


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
def test_for_every_mission_it_finds_a_plan_at_once_and_improves_on_it(goals, monkeypatch):
    plans = []
    monkeypatch.setattr(warming, "judge", lambda state, plan, start: plans.append(plan))
    head, _, rest = FIRST_FLIGHT.partition("goals:\n")
    text = head + goals + rest.partition("\n")[2]
    warm_up(mission_from_text(text, "mission.yaml"))
    assert [plan.reaches_goal for plan in plans] == [True] * NUM_PLANS
    assert plans[1].flown_cost is not None

"""What is compiled before a flight: everything, or the first plan in flight would wait for it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from companion.config import mission_from_text
from companion.service import warm_up as warming
from companion.service.warm_up import NUM_PLANS, warm_up
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import FIRST_FLIGHT


def compiled_late(mission, *seconds):
    """Kernels that a flight compiles after the warm-up, and how many plans it makes."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.signatures", mission, *map(str, seconds)],
        capture_output=True, text=True, check=True, timeout=600.0,
    )  # fmt: skip
    kernels, plans, late = re.fullmatch(r"(\d+) kernels, (\d+) plans, late: (.*)\n", done.stdout).groups()
    assert int(kernels) > 20
    return late, int(plans)


@pytest.mark.parametrize(
    "name",
    ["first-flight", *(pytest.param(name, marks=pytest.mark.slow) for name in ("paper-2d", "paper-3d"))],
)
def test_a_flight_compiles_nothing(name, tmp_path):
    text = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8")
    often, changed = re.subn(r"  time_horizon_s: \d+", "  time_horizon_s: 10", text)
    assert changed == 1
    mission = tmp_path / "often.yaml"
    mission.write_text(often, encoding="utf-8")
    late, plans = compiled_late(mission)
    assert plans >= 4
    assert late == "[]"


PARKED = "east_m: 950, north_m: 750, speed_m_s: 0, max_threat_radius_m: 250"
PURSUERS = {
    "from aside": "east_m: 1500, north_m: 200, speed_m_s: 10, max_threat_radius_m: 100",
    "in the way": "east_m: 950, north_m: 750, speed_m_s: 12, max_threat_radius_m: 250",
}


@pytest.mark.parametrize("where", ["from aside", pytest.param("in the way", marks=pytest.mark.slow)])
def test_a_flight_that_is_pursued_compiles_nothing(where, tmp_path):
    """From aside it is raced past; in the way it leaves none, so that plans end where they begin."""
    assert PARKED in FIRST_FLIGHT
    mission = tmp_path / "pursued.yaml"
    mission.write_text(FIRST_FLIGHT.replace(PARKED, PURSUERS[where]), encoding="utf-8")
    late, plans = compiled_late(mission, 100)
    assert plans >= 3
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


def test_of_lean_compiled_code_everything_is_read_and_nothing_is_missing(tmp_path):
    compiled = Path(numba.config.CACHE_DIR)
    folder = tmp_path / compiled.name
    shutil.copytree(compiled, folder)

    def files():
        return {path.relative_to(folder) for path in folder.rglob("*.nbc")}

    def warmed(*more):
        return subprocess.run(
            [sys.executable, "-m", "companion", "warm-up", *more, CONFIGS / "first-flight.yaml"],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True, text=True, check=True, timeout=600.0,
        ).stdout  # fmt: skip

    warmed()
    full = files()
    assert "MB of parts that are in others are removed" in warmed("--lean")
    lean = files()
    assert lean < full
    assert len(lean) < len(full) / 2
    warmed()
    assert files() == lean

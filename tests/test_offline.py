"""Plans and flights from Python: the same as by the commands, and clear words where something lacks."""

import asyncio
import importlib.metadata
import json

import pytest

import companion
from companion import load_mission, offline, plan, run_places
from companion.cli import EXTRA_COMMANDS
from companion.config import mission_from_text
from companion.errors import ConfigError
from companion.types.plan import PlanStatus
from tests.sim.client import CONFIGS

FIRST = CONFIGS / "first-flight.yaml"


def test_a_plan_is_that_of_the_command(companion_command):
    planned = plan(load_mission(FIRST), method="edbm", seed=3)
    done = companion_command("plan", FIRST, "--method", "edbm", "--seed", "3", "--json", "-")
    (told,) = json.loads(done.out)
    timed = ("PST", "TSI")
    assert planned.path.rows() == told.pop("path")
    assert {key: value for key, value in planned.measures.items() if key not in timed} == {
        key: value for key, value in told.items() if key not in timed
    }
    assert planned.reaches_goal


def test_a_plan_without_a_path_says_so():
    planned = plan(load_mission(FIRST), seed=1)
    answer = type(planned.answer)(PlanStatus.INVALID_START, None, planned.answer.measures, 1, "safe-rrt", 0)
    with pytest.raises(ValueError, match="there is no path: invalid_start"):
        _ = offline.Planned(planned.mission, planned.world, answer).path


def test_who_asks_for_the_unknown_is_told():
    with pytest.raises(ConfigError, match="method: got teleport; expected one of"):
        plan(load_mission(FIRST), method="teleport")
    with pytest.raises(AttributeError, match="no attribute 'teleport'"):
        _ = companion.teleport


def test_goals_that_only_an_autopilot_knows_are_refused():
    text = FIRST.read_text(encoding="utf-8").splitlines()
    lines = [line for line in text if not line.startswith("  - {east_m")]
    mission = mission_from_text("\n".join(lines).replace("goals:", "goals: from_autopilot"), "operator.yaml")
    for asked in (offline.plan, offline.fly):
        with pytest.raises(ConfigError, match="goals: got from_autopilot; expected a list of goals"):
            asked(mission)


def test_without_a_simulator_nothing_flies(monkeypatch):
    monkeypatch.delitem(run_places._PLACES, run_places.FLIGHT, raising=False)
    monkeypatch.setattr(run_places, "entry_points", lambda group: ())
    with pytest.raises(ConfigError, match="fly: got no simulator installed; expected pip install"):
        offline.fly(load_mission(FIRST))


def test_who_flies_is_found_where_commands_are(monkeypatch):
    assert run_places.EXTRA_COMMANDS == EXTRA_COMMANDS
    assert importlib.metadata.entry_points(group=EXTRA_COMMANDS)
    monkeypatch.delitem(run_places._PLACES, run_places.FLIGHT, raising=False)
    assert offline._simulator().__module__ == "sim.bench.offline_flight"


def test_a_flight_can_be_asked_for_where_a_loop_runs(monkeypatch):
    """As in a notebook."""

    def loops(_mission, seed, autopilot):
        async def told():
            return seed, autopilot

        return asyncio.run(told())

    monkeypatch.setattr(offline, "_simulator", lambda: loops)

    async def asked():
        return offline.fly(load_mission(FIRST), seed=4, autopilot="px4")

    assert asyncio.run(asked()) == (4, "px4")

"""What the simulator gives to campaigns: flights with their measures, and threats driven against plans."""

import asyncio
import math

import numpy as np
import pytest
import shapely
from rich.console import Console

from companion import run_places
from companion.config import load_mission
from companion.config.models import DynamicThreatConfig
from companion.errors import ConfigError, NoAutopilotError
from companion.research.campaign.campaign_progress import run_campaign
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.runs import plan_runs
from sim.bench.campaign_runs import FlightRunner, _flat, driven
from sim.sitl import Flight
from tests.mission.made import path_along
from tests.sim.client import CONFIGS

SPEC = f"""\
name: flown
kind: flights
missions: [{CONFIGS / "first-flight.yaml"}]
methods: [edbm]
seeds: [4]
settings:
  windy: {{simulation.wind_speed_m_s: 6.0}}
"""


@pytest.fixture
def campaign(tmp_path):
    file = tmp_path / "spec.yaml"
    file.write_text(SPEC, encoding="utf-8")
    return load_campaign(file)


def threatened(behaviour, **more):
    threat = DynamicThreatConfig(
        name="t", east_m=600.0, north_m=100.0, speed_m_s=20.0, max_threat_radius_m=100.0, behaviour=behaviour,
        **more,
    )  # fmt: skip
    mission = load_mission(CONFIGS / "first-flight.yaml")
    return mission.model_copy(update={"dynamic_threats": (threat,), "obstacles": ()})


def test_a_pursuer_drives_from_its_start_no_faster_than_it_can_towards_the_path():
    path = path_along((750.0, 30), course=0.5 * math.pi)  # east, past the threat 100 m aside
    (track,) = driven(threatened("pursue"), path)
    assert track[0] == pytest.approx((path.times_s[0], 600.0, 100.0))
    np.testing.assert_allclose(np.diff(track[:, 0]), 0.1)
    assert track[-1, 0] >= path.times_s[-1]
    steps = np.hypot(*np.diff(track[:, 1:], axis=0).T)
    assert steps.max() <= 20.0 * 0.1 + 1e-9
    places = path.positions_enu_m[:, :2]
    away = [math.dist(row[1:], places[min(int(row[0]), 30)]) for row in track]
    assert min(away) < 30.0  # it waits where it arrives first


def test_what_stands_stays_and_what_drives_knows_no_path():
    path = path_along((750.0, 31))
    (standing,) = driven(threatened("stand"), path)
    assert np.ptp(standing[:, 1:], axis=0).tolist() == [0.0, 0.0]
    (driving,) = driven(threatened("drive", route_enu_m=((600.0, 400.0),)), path)
    assert driving[-1, 1:] == pytest.approx((600.0, 400.0), abs=15.0)


def test_measures_of_inner_tables_have_both_names():
    assert _flat("a", {"b": 1.0, "c": {"d": None}}) == {"a.b": 1.0, "a.c.d": None}


@pytest.mark.slow
@pytest.mark.compiled
def test_a_row_has_all_that_sitl_tells_of_the_same_flight(campaign):
    runner, run = FlightRunner(campaign, {}), campaign.runs[0]
    found = runner.outcome(run)
    mission = load_mission(CONFIGS / "first-flight.yaml")
    mission = mission.model_copy(
        update={
            "simulation": mission.simulation.model_copy(update={"wind_speed_m_s": 6.0}),
            "planning": mission.planning.model_copy(update={"method": "edbm"}),
        }
    )
    flight = Flight(mission, 4)
    asyncio.run(flight.fly())
    told = flight.document()
    timed = {name: told.pop(name) for name in ("plan_ms", "track_to_mission_ms", "wall_s")}
    assert found.paths == {name: told.pop(name) for name in ("true_path", "dt_path", "dt_paths")}
    assert found.measures == {
        key: of for name, value in told.items() for key, of in _flat(name, value).items()
    }
    assert found.timings.keys() == {key for name, value in timed.items() for key in _flat(name, value)}


def flown_spec(tmp_path, methods, seeds="[4]", settings="default: {}", autopilot="ardupilot"):
    file = tmp_path / "flown.yaml"
    head, settings = SPEC.partition("settings:")[0], f"settings:\n  {settings}\n"
    head = head.replace("[edbm]", f"[{methods}]").replace("[4]", seeds)
    file.write_text(f"{head}autopilot: {autopilot}\n{settings}", encoding="utf-8")
    return load_campaign(file)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_the_straight_line_is_straight_and_nobody_replans(tmp_path, autopilot):
    made = flown_spec(tmp_path, "straight-line", autopilot=autopilot)
    found = FlightRunner(made, {}).outcome(made.runs[0])
    assert (found.measures["replans"], found.measures["missions_uploaded"]) == (0, 0)
    assert found.measures["goal_reached"]
    mission = load_mission(CONFIGS / "first-flight.yaml")
    start, goal = mission.start, mission.goals[-1]
    way = np.array([goal.east_m - start.east_m, goal.north_m - start.north_m])
    places = np.array(found.paths["true_path"])[:, 1:3] - (start.east_m, start.north_m)
    aside = np.abs(places @ np.array([-way[1], way[0]])) / np.linalg.norm(way)
    assert aside[len(aside) // 2 :].max() < 25.0  # after the turn onto it, in 3 m/s of wind


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_plan_once_flies_the_offline_plan_and_nobody_replans(tmp_path, autopilot):
    made = flown_spec(tmp_path, "plan-once", autopilot=autopilot)
    found = FlightRunner(made, {}).outcome(made.runs[0])
    assert (found.measures["replans"], found.measures["missions_uploaded"]) == (0, 0)
    assert found.measures["goal_reached"]
    mission = load_mission(CONFIGS / "first-flight.yaml")
    _, (plan,) = plan_runs(mission, method=None, first_seed=4, runs=1, time_limit_s=None)
    line = shapely.LineString(plan.path.positions_enu_m[:, :2])
    away = shapely.distance(line, shapely.points(np.array(found.paths["true_path"])[:, 1:3]))
    assert away.max() < 60.0
    assert np.median(away) < 10.0


@pytest.mark.slow
@pytest.mark.compiled
def test_a_link_that_loses_everything_leaves_the_service_without_an_autopilot(tmp_path):
    made = flown_spec(tmp_path, "safe-rrt", settings="deaf: {faults.loss: 1.0}")
    with pytest.raises(NoAutopilotError, match="within 10 s"):
        FlightRunner(made, {}).outcome(made.runs[0])
    made = flown_spec(tmp_path, "safe-rrt", settings="late: {faults.delay_s: 0.2}")
    assert FlightRunner(made, {}).outcome(made.runs[0]).measures["success"] is True


def test_flights_without_a_simulator_are_refused(campaign, tmp_path, monkeypatch):
    monkeypatch.delitem(run_places._PLACES, "flights", raising=False)
    monkeypatch.setattr(run_places, "entry_points", lambda group: ())
    with pytest.raises(ConfigError, match=r"campaign of flights: got no simulator installed; expected pip"):
        run_campaign(campaign, tmp_path / "out", jobs=1, resumes=False, console=Console(quiet=True))
    assert not (tmp_path / "out").exists()

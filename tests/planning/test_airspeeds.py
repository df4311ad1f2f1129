"""Airspeeds above cruise, flown where no slower path is ahead of all pursuers; beside plans at cruise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.assurance.checker import Checker
from companion.config import load_mission, mission_from_text
from companion.config.offline_problem import offline_problem, offline_world
from companion.config.rules import rules_of
from companion.errors import ConfigError
from companion.flight.construction.mission_construction import commanded_airspeed_m_s
from companion.planning.solver import solve
from companion.types.plan import PlanStatus
from companion.types.state import AutopilotSettings
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.games.generator import random_game
from tests.games.oracle import first_threatened_s, game_of
from tests.sim.client import CONFIGS
from tests.support.paths import check_limits
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled
SEEDS = (6, 200)  # of games that the oracle wins by a faster flight alone


def mission_of(seed, **vehicle):
    text = random_game(seed, "speed")
    for key, value in vehicle.items():
        text = text.replace("vehicle:\n", f"vehicle:\n  {key}: {value}\n")
    return mission_from_text(text, "game.yaml")


def planned(mission, method="safe-rrt"):
    return solve(offline_problem(mission, offline_world(mission), method, 1))


@pytest.mark.parametrize("seed", SEEDS)
def test_who_may_fly_faster_is_safe_and_who_may_not_is_caught(seed):
    mission = mission_of(seed)
    game, ours, cruising = game_of(mission), planned(mission), planned(mission, "safe-rrt-cruise")
    for plan, is_safe in ((ours, True), (cruising, False)):
        rows = np.column_stack([plan.path.times_s, plan.path.positions_enu_m[:, :2]])
        assert math.isinf(first_threatened_s(rows, game)) is is_safe
        assert (plan.pursuit.total_s == 0.0) is is_safe
    assert cruising.path.speeds_m_s.max() == pytest.approx(25.0)
    assert "flown at 31 m/s, ahead of pursuers" in ours.notes


@pytest.mark.parametrize("seed", SEEDS)
def test_a_faster_path_keeps_what_the_aircraft_can_do(seed):
    mission = mission_of(seed)
    path, rules = planned(mission).path, rules_of(mission)
    steps_s = np.diff(path.times_s)
    assert 25.0 < path.speeds_m_s.max() <= 37.5
    assert (np.abs(np.diff(path.speeds_m_s)) <= 0.5 * steps_s + 1e-6).all()
    lengths = np.hypot(*np.diff(path.positions_enu_m[:, :2], axis=0).T)
    mean = 0.5 * (path.speeds_m_s[1:] + path.speeds_m_s[:-1])
    assert lengths == pytest.approx(mean * steps_s, rel=0.02)
    found = rules.checker.check_path(path)
    assert [str(violation) for violation in found if violation.rule != "threat"] == []


def test_what_is_safe_at_cruise_is_flown_at_cruise():
    assert planned(mission_from_text(random_game(9, "route"), "g")).path.speeds_m_s.max() < 25.0 + 1e-6
    assert solve(problem()).path.speeds_m_s.max() < 25.0 + 1e-6


def test_no_faster_than_the_mission_file_and_the_autopilot_allow():
    allowed = mission_of(6, airspeed_fast_m_s=25)
    assert planned(allowed).path.speeds_m_s.max() == pytest.approx(25.0)
    told = rules_of(mission_of(6), reported=AutopilotSettings(airspeed_max_m_s=30.0))
    assert told.vehicle.faster_m_s == pytest.approx((27.5, 30.0))
    assert rules_of(mission_of(6)).vehicle.faster_m_s == pytest.approx((31.25, 37.5))
    with pytest.raises(
        ConfigError, match=r"airspeed_fast_m_s.*between airspeed_cruise_m_s and airspeed_max_m_s"
    ):
        mission_of(6, airspeed_fast_m_s=40)


def test_faster_the_turns_are_wider_by_hand():
    """At 37.5 m/s and 40° of bank: 37.5² / (9.80665 · tan 40°) = 170.9 m; at 30 m/s it is below 125 m."""
    vehicle = VehicleModel()
    assert vehicle.at_speed(37.5).turn_radius_min_m == pytest.approx(170.9, abs=0.05)
    assert vehicle.at_speed(30.0).turn_radius_min_m == 125.0
    assert vehicle.at_speed(20.0) is vehicle
    assert replace(vehicle, airspeed_fast_m_s=25.9).faster_m_s == ()


def test_the_mission_commands_the_speed_and_gives_it_back():
    mission = mission_of(6)
    path, vehicle = planned(mission).path, rules_of(mission).vehicle
    assert commanded_airspeed_m_s(path, vehicle) == pytest.approx(31.25)
    slow = replace(path, speeds_m_s=np.full(len(path), 25.3))
    assert commanded_airspeed_m_s(slow, vehicle) == 25.0


@pytest.mark.parametrize("wind", [(0.0, 0.0), (-6.0, 4.0)])
def test_who_still_flies_fast_turns_wide_until_it_is_slow(wind):
    """Once a plan at cruise, begun at 36 m/s, turned as at cruise, and was refused until it was too late."""
    mission = mission_of(6)
    asked = offline_problem(mission, offline_world(mission), "safe-rrt-cruise", 1)
    fast = replace(asked.start, airspeed_m_s=36.0, direction_rad=asked.start.direction_rad + 2.0)
    world = replace(asked.snapshot, tracks=(), wind_enu_m_s=wind)
    path = solve(replace(asked, start=fast, snapshot=world)).path
    assert path.speeds_m_s[0] == 36.0
    assert path.speeds_m_s[-1] == pytest.approx(25.0, abs=0.1)
    found = rules_of(mission).checker.check_path(path, wind_enu_m_s=wind)
    assert [str(violation) for violation in found] == []


@pytest.mark.parametrize("goal_up_m", [100.0, 1400.0])
@pytest.mark.parametrize(("first_m_s", "speed_m_s"), [(18.0, 25.0), (25.0, 37.5), (36.0, 25.0)])
def test_climbs_and_descents_are_possible_while_the_aircraft_is_still_slow(first_m_s, speed_m_s, goal_up_m):
    """In 8 m/s of wind astern.

    A plan that was to be flown at 37.5 m/s was once given the slope of that speed from its first second,
    and the check refused it.
    """
    wind = (8.0, 0.0)
    asked = problem(
        dimension=3, bounds=(-6000.0, 6000.0, -6000.0, 6000.0, 50.0, 1500.0), start=(0.0, 0.0, 750.0),
        direction=0.0, goal=(3500.0, 0.0, goal_up_m),
    )  # fmt: skip
    start = replace(asked.start, airspeed_m_s=first_m_s)
    vehicle = asked.vehicle.at_speed(speed_m_s)
    world = replace(asked.snapshot, wind_enu_m_s=wind)
    path = solve(replace(asked, start=start, vehicle=vehicle, snapshot=world)).path
    assert path.speeds_m_s[0] == first_m_s
    assert np.ptp(path.positions_enu_m[:20, 2]) > 40.0
    limits = check_limits(bounds=asked.snapshot.bounds, margin_m=asked.settings.clearance_min_m)
    assert [str(found) for found in Checker((), limits).check_path(path, wind_enu_m_s=wind)] == []


def test_where_no_path_is_safe_the_seconds_under_threat_have_a_price():
    """On paper-2d, whose pursuer can wait at the goal: beside the plan at cruise."""
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    ours, cruising = planned(mission), planned(mission, "safe-rrt-cruise")
    assert "no path that pursuers could not bar was found" in ours.notes
    assert ours.pursuit.total_s < 20.0
    assert cruising.pursuit.total_s > 40.0


@pytest.mark.parametrize(("price", "speed", "at_least_s", "at_most_s"), [
    (0.0, 37.5, 10.0, 20.0), (2.0, 25.0, 40.0, 60.0),
])  # fmt: skip
def test_the_mission_file_says_what_energy_is_worth(price, speed, at_least_s, at_most_s):
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    planning = mission.planning.model_copy(update={"price_energy": price})
    plan = planned(mission.model_copy(update={"planning": planning}))
    assert plan.path.speeds_m_s.max() == pytest.approx(speed, abs=0.1)
    assert at_least_s < plan.pursuit.total_s < at_most_s


def test_a_plan_that_is_told_to_stop_at_once_is_a_plan():
    mission = mission_of(6)
    late = solve(offline_problem(mission, offline_world(mission), "safe-rrt", 1), lambda: True)
    assert late.status is PlanStatus.EXACT


def test_who_starts_within_reach_leaves_it():
    """The straight way to the goal is within its reach for longer."""
    pursuer = track(330.0, 60.0, speed=10.0, radius=200.0)
    asked = problem(tracks=[pursuer])
    unaware = solve(problem()).path
    plan = solve(asked, flown=unaware)
    assert plan.pursuit.first_s <= 2.0
    assert plan.pursuit.total_s <= 6.0
    assert plan.flown_pursuit.total_s > 15.0


def test_near_the_goal_a_pursuer_is_planned_for_as_elsewhere():
    """On the coarse field V is 0 here: no share of it says how expensive an airspeed may be."""
    near = problem(
        tracks=[track(1225.0, 1348.0, speed=25.0, radius=100.0)],
        start=(1348.0, 1354.0, 150.0), goal=(1350.0, 1350.0, 150.0), direction=0.5 * math.pi,
    )  # fmt: skip
    assert solve(near).status is PlanStatus.EXACT

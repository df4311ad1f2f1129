"""What a plan may know of radars: those that are listed, and those sensed from where the aircraft is."""

from dataclasses import replace

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from companion.types.threat import Radar
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled

FAR = Radar("far", (1200.0, 1200.0, 60.0), 350.0)  # about the goal; 1556 m from the start, which senses 600


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_sensed_only_when_near_is_not_known_from_a_sub_goal_on_the_way(dimension):
    plan = solve(problem(radars=[FAR], dimension=dimension))
    empty = solve(problem(dimension=dimension))
    assert plan.reaches_goal
    np.testing.assert_array_equal(plan.path.positions_enu_m, empty.path.positions_enu_m)
    assert plan.path.threat_levels.max() == 0.0
    assert plan.measures.total_threat_amount > 0.0  # though it is there, and the measures know


def test_nor_from_a_goal_that_a_race_passes():
    hunted = problem(radars=[FAR], tracks=[track(1450.0, 80.0, speed=1.0, radius=50.0)])
    first = GoalRegion((900.0, 900.0, 150.0), 60.0)
    plan = solve(replace(hunted, goals=(first, *hunted.goals)))
    near = np.hypot(*(plan.path.positions_enu_m[:, :2] - 1200.0).T) < 300.0
    assert near.any()
    assert plan.path.threat_levels[near].max() == 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_listed_is_known_from_the_start(dimension):
    plan = solve(problem(radars=[replace(FAR, is_listed=True)], dimension=dimension))
    assert plan.reaches_goal
    assert plan.path.threat_levels.max() > 0.0


def test_a_mission_file_says_which_radars_are_listed():
    mission = load_mission("mission_configs/radar-valley.yaml")
    entry = mission.radars[0].model_copy(update={"known_beforehand": False})
    secret = mission.model_copy(update={"radars": (entry,)})
    assert [radar.is_listed for radar in (*mission.radar_list, *secret.radar_list)] == [True, False]
    known = [offline_world(one).threats.known.tolist() for one in (mission, secret)]
    assert known == [[1], [0]]


def test_offline_what_is_near_the_start_is_sensed_there():
    mission = load_mission("mission_configs/paper-2d.yaml")
    horizon, start = float(mission.planning.sensing_horizon_m), mission.start
    asked = offline_problem(mission, offline_world(mission), None, 1)
    away = [
        np.hypot(radar.east_m - start.east_m, radar.north_m - start.north_m) - radar.max_threat_radius_m
        for radar in mission.radars
    ]
    assert asked.snapshot.threats.known.tolist() == [int(one <= horizon) for one in away]
    assert not all(asked.snapshot.threats.known)

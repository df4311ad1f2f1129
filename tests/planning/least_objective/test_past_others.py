"""Plans past aircraft that fly on: how large the search becomes, and V where a cheaper path may lead."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.config.sections.team_section import TeamConfig
from companion.planning.explore import Exploration
from companion.planning.least_objective.cost_field import MOST_DANGER, field_before_pursuers, least_s
from companion.planning.least_objective.prices import objective_of
from companion.planning.least_objective.short_cuts import loses_well_clear
from companion.planning.route import route_from_path
from companion.planning.solver import solve
from tests.mission.team.planning_cost import others, tracks_of
from tests.sim.client import CONFIGS
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled
WORLD = (-500.0, 4000.0, -2000.0, 2000.0, 0.0, 400.0)


def beside(name, num):
    """A problem of a shipped mission without its pursuers, with members of a team on ways of their own."""
    mission, team = load_mission(CONFIGS / f"{name}.yaml"), TeamConfig(members=(1, 2))
    up_m = float(mission.start.up_m)
    tracks = tracks_of(mission, others(mission, num, [up_m, up_m + 100.0, up_m - 100.0], team), team)
    return offline_problem(mission, offline_world(mission).with_tracks(0.0, tracks), None, 1)


def test_a_path_that_others_hardly_touch_needs_no_larger_search():
    alone, ours = (solve(beside("paper-3d", num)) for num in (0, 10))
    assert ours.reaches_goal
    assert ours.objective_s < 1.02 * alone.objective_s
    assert ours.measures.num_collision_checks < 1.5 * alone.measures.num_collision_checks


@pytest.mark.parametrize(("name", "num"), [("paper-2d", 10), ("paper-2d", 50), ("paper-3d", 50)])
def test_among_many_others_a_path_clear_of_all_is_found_by_a_small_search(name, num):
    asked = beside(name, num)
    plan = solve(asked)
    exploration = Exploration(asked, np.random.default_rng(1))
    assert plan.reaches_goal
    assert not loses_well_clear(objective_of(exploration), route_from_path(exploration, plan.path))
    assert plan.measures.num_collision_checks < 60_000


def crossing(seed):
    """A flight to the east that one to four aircraft cross at random places and heights."""
    random, tracks = np.random.default_rng(seed), []
    for number in range(random.integers(1, 5)):
        direction, speed = random.uniform(0.0, 2.0 * math.pi), random.uniform(20.0, 60.0)
        velocity = speed * np.array([math.cos(direction), math.sin(direction)])
        place = np.array([random.uniform(500.0, 3000.0), 0.0]) - random.uniform(20.0, 100.0) * velocity
        seen = track(
            *place, velocity=tuple(velocity), airborne=True, up=random.uniform(80.0, 220.0), radius=610.0
        )
        tracks.append(replace(seen, identity=f"icao:{number}", flies_on=True, height_std_m=8.0))
    return problem(
        tracks=tracks, dimension=3, start=(0.0, 0.0, 150.0), direction=0.0, goal=(3500.0, 0.0, 150.0),
        bounds=WORLD, sensing_horizon_m=5000.0,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(8))
def test_v_is_the_same_along_a_path_that_is_cheap_enough_and_infinite_where_straight_flight_takes_too_long(
    seed,
):
    asked = crossing(seed)
    objective = objective_of(Exploration(asked, np.random.default_rng(1)))
    whole = field_before_pursuers(asked, objective, MOST_DANGER)
    plan = solve(asked)
    part = field_before_pursuers(asked, objective, MOST_DANGER, plan.objective_s)
    for place in plan.path.positions_enu_m[::10]:
        assert least_s(part, tuple(place)) == pytest.approx(least_s(whole, tuple(place)), rel=0.03)
    cheap = field_before_pursuers(asked, objective, MOST_DANGER, 145.0)
    grid, levels = cheap.grid, cheap.values.shape[3]
    for i, j in np.ndindex(cheap.values.shape[1:3]):
        east, north = grid[0] + i * grid[3], grid[1] + j * grid[4]
        straight_s = (math.hypot(east, north) + math.hypot(3500.0 - east, north)) / 25.0
        if straight_s > 1.1 * 145.0:
            assert np.isinf(cheap.values[0, i, j]).sum() == levels


def test_no_way_is_left_where_no_path_is_cheap_enough():
    asked = crossing(1)
    objective = objective_of(Exploration(asked, np.random.default_rng(1)))
    field = field_before_pursuers(asked, objective, MOST_DANGER, 100.0)  # Straight flight takes 140 s.
    assert math.isinf(least_s(field, asked.start.position_enu_m))

"""Plans against a DT that knows the path (paper 2.3), beside plans without that game."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import load_mission, mission_from_text
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.comparators import Strategies
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from companion.types.plan import PlanStatus, PursuitRisk
from companion.types.threat import Obstacle
from tests.games.generator import random_game
from tests.games.oracle import first_threatened_s, game_of, threatened_at
from tests.support import exact_pursuit
from tests.support.exact_paths import memberships
from tests.support.exact_pursuit import PursuedGrid
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled

WALL = Obstacle(
    "wall", np.array([(700.0, 300.0), (760.0, 300.0), (760.0, 1100.0), (700.0, 1100.0)]), 0.0, 300.0
)


def without_game(asked):
    """The same problem for a planner that goes by threat levels alone."""
    chosen = replace(asked.settings.strategies, plays_game=False)
    return replace(asked, settings=replace(asked.settings, strategies=chosen))


def rows_of(plan):
    return np.column_stack([plan.path.times_s, plan.path.positions_enu_m[:, :2]])


@pytest.mark.parametrize("seed", [9, 13, 16, 22])
def test_a_game_that_can_be_won_is_won_and_lost_by_a_planner_that_does_not_play(seed):
    mission = mission_from_text(random_game(seed, "route"), "game.yaml")
    game = game_of(mission)
    asked = offline_problem(mission, offline_world(mission), None, 1)
    plan, plain = solve(asked), solve(without_game(asked))
    assert plan.reaches_goal
    assert plan.pursuit == PursuitRisk(math.inf, 0.0)
    assert first_threatened_s(rows_of(plan), game) == math.inf  # says who has not computed it
    assert first_threatened_s(rows_of(plain), game) < math.inf


def test_the_numbers_of_a_path_under_threat():
    """A DT that stands on the way: the path that minds it not is in its reach meanwhile."""
    standing = track(725.0, 725.0, speed=0.0, radius=200.0)
    plan = solve(problem(tracks=[standing]))
    assert plan.pursuit.total_s == 0.0
    away = np.hypot(*(plan.path.positions_enu_m[:, :2] - 725.0).T)
    assert away.min() > 200.0
    flown = solve(problem()).path
    seen = solve(problem(tracks=[standing]), flown=flown)
    within = np.hypot(*(flown.positions_enu_m[:, :2] - 725.0).T) <= 202.0
    assert seen.flown_pursuit.total_s == pytest.approx(within.sum(), abs=2.0)
    assert seen.flown_pursuit.first_s == pytest.approx(flown.times_s[within][0], abs=1.0)
    assert seen.pursuit.total_s == 0.0


def test_out_of_a_threat_the_shortest_way_is_taken():
    """The start lies in the reach of a DT that stands: out of it, and then not into it again."""
    plan = solve(problem(tracks=[track(250.0, 100.0, speed=0.0, radius=220.0)]))
    away = np.hypot(*(plan.path.positions_enu_m[:, :2] - (250.0, 100.0)).T)
    inside = away <= 220.0
    assert plan.reaches_goal
    assert inside[0]
    assert not inside[np.argmin(inside) :].any()
    assert inside.sum() < 15


def test_where_nothing_is_safe_there_is_a_plan_all_the_same():
    plan = solve(problem(tracks=[track(1300.0, 1300.0, speed=20.0, radius=200.0)]))
    assert plan.status is PlanStatus.EXACT
    assert plan.pursuit.total_s > 0.0
    assert any("pursuers could not bar" in note for note in plan.notes)


def test_goals_on_the_way_are_passed_in_their_order():
    asked = problem([WALL], tracks=[track(1200.0, 100.0, speed=3.0, radius=150.0)])
    first = GoalRegion((300.0, 1200.0, 150.0), 60.0)
    plan = solve(replace(asked, goals=(first, *asked.goals)))
    assert plan.reaches_goal
    assert plan.pursuit.total_s == 0.0
    away = np.hypot(*(plan.path.positions_enu_m[:, :2] - first.position_enu_m[:2]).T)
    assert away.min() <= 60.0


def test_in_space_a_pursuer_is_avoided_too():
    asked = problem(tracks=[track(725.0, 725.0, speed=2.0, radius=250.0)], dimension=3)
    plan, plain = solve(asked), solve(asked, flown=solve(without_game(asked)).path)
    assert plan.reaches_goal
    assert plan.pursuit.total_s == 0.0
    assert plain.flown_pursuit.total_s > 0.0


def test_on_the_papers_map_in_space_no_path_is_within_reach():
    """A path above 500 m is out of the pursuer's reach; the planner that does not play is within it."""
    mission = load_mission("mission_configs/paper-3d.yaml")
    asked = offline_problem(mission, offline_world(mission), None, 1)
    plan = solve(asked, flown=solve(without_game(asked)).path)
    assert plan.pursuit.total_s == 0.0
    assert plan.flown_pursuit.total_s > 30.0


@given(st.integers(0, 1000))
@settings(max_examples=12, deadline=None)
def test_shortening_never_leads_into_a_threat(seed):
    rng = np.random.default_rng(seed)
    place = rng.uniform(500.0, 1000.0, 2)
    asked = problem([WALL], tracks=[track(*place, speed=rng.uniform(0.0, 8.0), radius=150.0)], seed=seed)
    plain = solve(replace(asked, settings=replace(asked.settings, smooth_iterations=0)))
    plan = solve(asked)
    assert plan.objective_s <= plain.objective_s + 1e-6
    assert plan.pursuit.total_s <= plain.pursuit.total_s + 1e-6


@pytest.mark.parametrize(
    ("east", "north", "speed", "radius"),
    [
        (1300.0, 1300.0, 20.0, 200.0),  # it can wait at the goal: no way is safe
        (725.0, 725.0, 0.0, 200.0),  # it stands on the straight way
        (900.0, 500.0, 8.0, 250.0),
        (1300.0, 700.0, 15.0, 150.0),
    ],
)
def test_before_a_pursuer_j_is_nearly_the_least_of_an_exact_search(east, north, speed, radius):
    """In open country, at cruise; the exact search knows no turns, and danger of 5/6 bars no way there."""
    pursuer = track(east, north, speed=speed, radius=radius)
    asked = problem(tracks=[pursuer], strategies=replace(Strategies(), may_fly_fast=False))
    plan = solve(asked)

    def begins_at(places):
        way = np.maximum(0.0, np.hypot(*(places - (east, north)).T) - radius)
        return way / speed if speed > 0.0 else np.where(way > 0.0, math.inf, 0.0)

    grid = PursuedGrid(
        (0.0, 1500.0, 0.0, 1500.0), 62.5, [], 0.0,
        seen_at=lambda places: np.zeros(len(places)), begins_at=begins_at,
    )  # fmt: skip
    exact = grid.least(
        (125.0, 125.0), (1312.5, 1312.5), fly_s=lambda metres: metres / 25.0, seen=3.0, pursued=3.0
    ).cost_s
    ends_s = (
        math.dist((100.0, 100.0), (125.0, 125.0)) + math.dist((1350.0, 1350.0), (1312.5, 1312.5))
    ) / 25.0
    assert plan.reaches_goal
    assert plan.objective_s <= 1.15 * (exact + 4.0 * ends_s)
    assert plan.objective_s >= 0.9 * exact


CRUISE_M_S, ACCELERATION_M_S2, ENERGY_PRICE = 25.0, 0.5, 0.35  # of paper-2d
START, GOAL = (250.0, 2250.0), (2375.0, 125.0)
RADARS = ("radar_1", "radar_2", "radar_3", "radar_4")


@pytest.fixture(scope="module")
def trap():
    """The paper's map in the plane with its pursuer and some radars, on an exact grid."""
    mission = load_mission(Path("mission_configs/paper-2d.yaml"))
    game = game_of(mission)

    def grid_of(names):
        radars = [radar for radar in mission.radar_list if radar.name in names]
        bounds, obstacles = mission.bounds, mission.obstacle_list

        def seen_at(places):
            at = np.column_stack([places, np.full(len(places), 100.0)])
            return memberships(at, radars, obstacles, is_plane=True)

        return PursuedGrid(
            (*bounds.east_m, *bounds.north_m), 25.0, [each.polygon_enu_m for each in obstacles], 20.0,
            seen_at=seen_at, begins_at=lambda places: np.asarray(threatened_at(game, places)),
        )  # fmt: skip

    return grid_of


def flights_to(speed):
    """How long a flight takes that begins at cruise and gets faster as soon as it can; metres to seconds."""
    gains_s = (speed - CRUISE_M_S) / ACCELERATION_M_S2
    gaining_m = 0.5 * (speed + CRUISE_M_S) * gains_s

    def fly_s(metres):
        early = np.sqrt(CRUISE_M_S**2 + 2.0 * ACCELERATION_M_S2 * metres) - CRUISE_M_S
        return np.where(metres < gaining_m, early / ACCELERATION_M_S2, gains_s + (metres - gaining_m) / speed)

    return fly_s


def energy_at(speed):
    """What a second costs more at an airspeed: power grows with its cube."""
    return ENERGY_PRICE * ((speed / CRUISE_M_S) ** 3 - 1.0)


def least_of_airspeeds(grid, **prices):
    """The cheapest way from the map's start to its goal at any of the airspeeds that the planner tries."""
    ways = [
        grid.least(
            (250.0, 2250.0),
            (2375.0, 125.0),
            fly_s=flights_to(share * CRUISE_M_S),
            energy_at=energy_at,
            **prices,
        )
        for share in (1.0, 1.25, 1.5)
    ]
    return min(ways, key=lambda way: way.cost_s)


@pytest.mark.slow
def test_on_the_papers_map_nobody_flies_both_out_of_sight_and_out_of_reach(trap):
    """Why the paths that ``docs/measured.md`` tells of are seen for so long: there are no better ones."""
    grid = trap(RADARS)
    weighed = least_of_airspeeds(grid, seen=3.0, pursued=3.0)
    assert (round(weighed.seen_s), round(weighed.threatened_s)) == (11, 48)
    out_of_reach = least_of_airspeeds(grid, seen=3.0, pursued=1000.0)
    assert (round(out_of_reach.seen_s), round(out_of_reach.threatened_s)) == (53, 11)


@pytest.mark.slow
def test_on_the_papers_map_whoever_is_seen_for_half_as_long_is_long_under_threat(trap, monkeypatch):
    """By duality: no flight costs less than the least at these prices, which bounds the time under threat.

    Nobody passes a place sooner than at the highest airspeed from the start, at no cost of energy.
    """
    monkeypatch.setattr(exact_pursuit, "SLACK_S", 1e-6)  # Only what is under threat has a price.
    least = trap(RADARS).least(
        START, GOAL, fly_s=flights_to(1.5 * CRUISE_M_S), energy_at=lambda _speed: 0.0, seen=5.0, pursued=10.0
    )
    half_seen_s, latest_s = 0.5 * 57.5, 1.08 * 112.9
    assert (least.cost_s - latest_s - 5.0 * half_seen_s) / 10.0 > 19.0


@pytest.mark.slow
@pytest.mark.parametrize("num_known", [3, 4])
def test_on_the_papers_map_j_is_nearly_the_least_of_an_exact_search(trap, num_known):
    """At the start three radars are known; the fourth is sensed in flight."""
    mission = load_mission(Path("mission_configs/paper-2d.yaml"))
    world = offline_world(mission)
    if num_known == 4:
        world = world.with_known(np.ones_like(world.threats.known))
    plan = solve(offline_problem(mission, world, None, 1))
    exact = least_of_airspeeds(trap(RADARS[:num_known]), seen=3.0, pursued=3.0)
    assert plan.objective_s <= 1.10 * exact.cost_s

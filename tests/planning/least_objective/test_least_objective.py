"""Paths of the least objective J beside an exact grid search that shares no code with the planner."""

import math

import numpy as np
import pytest
import shapely

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.comparators import METHODS, Certainty
from companion.planning.settings import settings_for
from companion.planning.solver import solve
from companion.types.threat import Radar
from tests.support.exact_paths import ExactGrid, memberships
from tests.support.paths import box
from tests.support.random_maps import BOUNDS, RandomMap
from tests.support.worlds import problem

MEDIAN_MOST, P95_MOST = 1.10, 1.25  # J over the exact grid's
SEEN_TIMES, SEEN_MORE_M, SEEN_SHARE = 1.5, 50.0, 0.9
BOUND_ERROR = 0.03  # by which the bound was above the exact grid's J at most: both see shadows on grids


def metres_seen(plan, world):
    """The integral of m along a path, by the oracle's own membership."""
    places = plan.path.positions_enu_m
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return float(lengths @ memberships(places, world.radars, world.obstacles, world.dimension == 2)[1:])


def assert_as_good_as_exact(seeds, dimension):
    """J and metres seen beside the exact answer, over maps.

    The exact search knows no turning limit. So a flight begins as the exact way does: else what it costs to
    turn there is all the difference on a map in seven.
    """
    ratios, seen, bounds = [], [], []
    for seed in seeds:
        world = RandomMap(seed, dimension)
        exact = world.exact()
        if math.isinf(exact.least_s):
            continue  # a box closes the way: there is nothing to compare with
        plan = solve(world.problem(exact.direction_rad()))
        assert plan.reaches_goal, seed
        ratios.append(plan.objective_s / exact.least_s)
        seen.append(metres_seen(plan, world) <= SEEN_TIMES * exact.seen_m() + SEEN_MORE_M)
        bounds.append(plan.bound_s / exact.least_s)
    assert len(ratios) >= 0.9 * len(seeds)
    assert np.median(ratios) <= MEDIAN_MOST
    assert np.quantile(ratios, 0.95) <= P95_MOST
    assert np.mean(seen) >= SEEN_SHARE
    assert max(bounds) <= 1.0 + BOUND_ERROR


# An exact answer in space takes 15 s.
@pytest.mark.parametrize(
    ("seeds", "dimension"), [(range(6), 2), pytest.param(range(3), 3, marks=pytest.mark.slow)]
)
def test_a_few_random_maps_are_flown_nearly_as_cheaply_as_can_be(seeds, dimension):
    assert_as_good_as_exact(seeds, dimension)


def test_a_random_map_in_space_is_flown_nearly_as_cheaply_as_the_bound_says():
    """The slow tests compare the bound with the exact answer."""
    plan = solve(RandomMap(1, 3).problem())
    assert plan.reaches_goal
    assert plan.objective_s <= P95_MOST * plan.bound_s


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_hundred_random_maps_are_flown_nearly_as_cheaply_as_can_be(dimension):
    assert_as_good_as_exact(range(100), dimension)


def test_a_higher_price_is_seen_less_and_takes_longer():
    """One radar on the straight way: at price 0 it is crossed, at a high price it is flown round."""
    radar = Radar("radar", (725.0, 725.0, 150.0), 400.0, is_listed=True)
    plans = [solve(problem(radars=[radar], price_seen=price)) for price in (0.0, 1.0, 3.0, 10.0)]
    seen = [plan.seen_s for plan in plans]
    took = [plan.path.times_s[-1] for plan in plans]
    # Through the middle, exp(-(r/R)^4) integrates to 2·Γ(5/4)·R less its tails beyond R: 1.69 R.
    assert seen[0] == pytest.approx(1.69 * 400.0 / 25.0, rel=0.03)
    assert seen == sorted(seen, reverse=True)
    assert seen[2] < 0.5 * seen[0]
    assert took == sorted(took)


def test_nothing_is_paid_for_where_nothing_is_wrong():
    """In open air J is the straight way's time, and the bound says that nothing is shorter."""
    plan = solve(problem())
    straight_s = math.dist((100.0, 100.0), (1350.0, 1350.0)) / 25.0
    assert plan.objective_s == pytest.approx(straight_s, rel=1e-3)
    assert plan.seen_s == 0.0
    assert 0.0 <= plan.gap < 0.01


def longest_in_sight_s(plan, radars):
    places, times = plan.path.positions_enu_m, plan.path.times_s
    in_sight = memberships(places, radars, [], is_plane=True) >= 0.5
    longest = run = 0.0
    for k in range(1, len(places)):
        run = run + times[k] - times[k - 1] if in_sight[k] else 0.0
        longest = max(longest, run)
    return longest


def test_the_longest_time_in_sight_is_a_limit():
    """Three radars bar the way. Through the middle one it is 33 s in sight, between two of them 11 s."""
    radars = [
        Radar(f"radar_{k}", (200.0 + 547.0 * k, 1300.0 - 547.0 * k, 150.0), 450.0, is_listed=True)
        for k in range(3)
    ]
    free, limited = (
        solve(problem(radars=radars, price_seen=0.0, seen_max_s=limit_s)) for limit_s in (math.inf, 15.0)
    )
    assert limited.reaches_goal
    assert longest_in_sight_s(free, radars) > 25.0
    assert 5.0 < longest_in_sight_s(limited, radars) <= 15.0 + 1.0  # A step is a second.


def test_the_oracle_flies_straight_where_nothing_is_in_the_way():
    world = RandomMap(0, 2)
    world.obstacles, world.radars = [], []
    assert world.exact().least_s == pytest.approx(math.dist(world.start, world.goal) / 25.0, rel=1e-6)
    assert BOUNDS[1] > world.goal[0]


def nearest(path, obstacles):
    """How near a path's rows come to obstacles [m], by shapely."""
    shapes = shapely.MultiPolygon([shapely.Polygon(obstacle.polygon_enu_m) for obstacle in obstacles])
    return min(shapes.distance(shapely.Point(place)) for place in path.positions_enu_m[:, :2])


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_corner_is_passed_farther_off_where_there_is_room(dimension):
    wall = box("wall", 700.0, 300.0, 760.0, 1100.0)
    narrow, wide = (
        solve(problem([wall], dimension=dimension, clearance_wanted_m=wanted)) for wanted in (0.0, 60.0)
    )
    assert nearest(narrow.path, [wall]) < 30.0
    assert nearest(wide.path, [wall]) > 50.0
    assert wide.path.times_s[-1] < 1.04 * narrow.path.times_s[-1]


def test_a_gap_that_is_narrower_is_flown_all_the_same():
    gates = [box("south", 700.0, 0.0, 760.0, 680.0), box("north", 700.0, 760.0, 760.0, 1500.0)]
    plan = solve(problem(gates, clearance_wanted_m=60.0))
    assert plan.reaches_goal
    assert 15.0 <= nearest(plan.path, gates) <= 40.0


def test_a_gap_too_narrow_to_be_flown_to_is_flown_around():
    """On this map V leads through a slit of 4 m between the margin of a box and the bounds."""
    plan = solve(RandomMap(99, 2).problem(2.16))
    assert plan.reaches_goal
    assert plan.objective_s < 1.1 * plan.bound_s


def test_goals_on_the_way_stay_on_it():
    mission = load_mission("mission_configs/city-block.yaml")
    for seed in range(1, 5):
        plan = solve(offline_problem(mission, offline_world(mission), None, seed))
        assert plan.reaches_goal
        for goal in mission.goals[:-1]:
            away = np.linalg.norm(plan.path.positions_enu_m - goal.position_enu_m, axis=1).min()
            assert away <= goal.acceptance_radius_m


def test_nearness_has_a_price_where_the_objective_decides():
    """Comparators are what was printed."""
    for name, method in METHODS.items():
        chosen = settings_for(
            name, certainty=Certainty.SHIFTED, clearance_min_m=15.0, sensing_horizon_m=600.0,
            max_iterations=1000, clearance_wanted_m=60.0,
        )  # fmt: skip
        assert chosen.soft_clearance_m == (60.0 if method.by_objective else 0.0), name


@pytest.mark.slow
@pytest.mark.parametrize(("name", "spacing", "rise"), [("paper-2d", 25.0, None), ("paper-3d", 75.0, 12.0)])
def test_the_papers_maps_without_pursuers_are_flown_nearly_as_cheaply_as_can_be(name, spacing, rise):
    """All their radars known."""
    mission = load_mission(f"mission_configs/{name}.yaml").model_copy(update={"dynamic_threats": ()})
    world = offline_world(mission)
    asked = offline_problem(mission, world.with_known(np.ones_like(world.threats.known)), None, 1)
    settings = asked.settings
    exact = ExactGrid(
        mission.obstacle_list, mission.radar_list, asked.snapshot.bounds, start=asked.start.position_enu_m,
        goal=asked.goals[0].position_enu_m, margin=settings.clearance_min_m, spacing=spacing,
        speed=asked.vehicle.airspeed_cruise_m_s,
        prices=(settings.price_seen, settings.price_near, settings.soft_clearance_m), rise=rise,
    )  # fmt: skip
    plan = solve(asked)
    assert plan.objective_s <= 1.10 * exact.least_s
    places = plan.path.positions_enu_m
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    seen_m = lengths @ memberships(places, mission.radar_list, mission.obstacle_list, rise is None)[1:]
    assert seen_m <= SEEN_TIMES * exact.seen_m() + SEEN_MORE_M

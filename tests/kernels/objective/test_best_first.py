"""The tree that grows best first along V, on a small map."""

import math

import numpy as np
import pytest

from companion.kernels.objective.best_first import (
    EXHAUSTED,
    FULL,
    UNFINISHED,
    BestFirst,
    Cells,
    Nodes,
    Rules,
    fly_on,
    grow_best_first,
    turning_share,
)
from companion.kernels.objective.cost_to_go import (
    CostField,
    Heap,
    cost_to_go,
    fill_cost_to_go,
    fill_rate,
)
from companion.kernels.objective.row_costs import Objective, Prices
from companion.types.threat import Obstacle
from companion.world.obstacles import packed_obstacles
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.worlds import scene_of, work_for

BOUNDS = (0.0, 1000.0, 0.0, 1000.0, 50.0, 250.0)
START, GOAL = (100.0, 500.0, 100.0), (900.0, 500.0, 100.0)
CORNERS = np.array([[480.0, 300.0], [520.0, 300.0], [520.0, 1000.0], [480.0, 1000.0]])
WALL = Obstacle("wall", CORNERS, 0.0, 300.0)


def search_for(*, dimension=2, obstacles=(), room=4000, weight=1.2, goals=(GOAL,), stride=1, beyond=30):
    """A search through open space or round walls, past goals; each goal has its own layer of V."""
    limits = VehicleModel().limits(dimension, BOUNDS, 15.0, 1.0)
    packed = packed_obstacles(obstacles, BOUNDS)
    scene = scene_of(limits, obstacles=packed, bounds=BOUNDS)
    objective = Objective(
        prices=Prices(3.0, 3.0, 0.0, 0.35, 0.0, 0.0, 25.0), obstacles=packed, threats=scene.threats,
        game=scene.game, pursuers=scene.pursuers, limits=limits, deviations=np.ones(1), start=0.0,
    )  # fmt: skip
    shape = (21, 21, 1 if dimension == 2 else 5)
    grid = np.array([0.0, 0.0, 100.0 if dimension == 2 else 50.0, 50.0, 50.0, 50.0])
    num = len(goals)
    field = CostField(grid, np.zeros(shape[:2]), np.empty(shape), np.empty((num, *shape)), np.zeros(num))
    fill_rate(field, objective, 100.0)
    heap = Heap(np.empty(20_000), np.empty(20_000, dtype=np.int64))
    for g in range(num - 1, -1, -1):
        fill_cost_to_go(field, g, np.array(goals[g]), limits, heap)
        if g > 0:
            field.rest[g - 1] = field.rest[g] + cost_to_go(field, g, *goals[g - 1])
    nodes = Nodes(
        *(np.zeros((room, 6)), np.zeros(room, dtype=np.int64), np.zeros(room), np.zeros(room)),
        *(np.zeros(room, dtype=np.int64), np.full(room, limits.straight_min), np.zeros((room, 2))),
        *(np.zeros(room, dtype=np.int64), np.zeros(room), np.zeros(room)),
    )
    nodes.state[0], nodes.parent[0] = (*START, 0.0, 0.0, 25.0), -1
    heap.keys[0], heap.nodes[0] = 0.0, 0
    return BestFirst(
        nodes=nodes, heap=heap,
        cells=Cells(np.zeros(2**14, dtype=np.int64), np.empty(2**14), np.empty(2**14)),
        sizes=np.ones(2, dtype=np.int64), extended=np.zeros(num, dtype=np.int64),
        field=field, objective=objective,
        rules=Rules(
            np.array([[*goal, 45.0] for goal in goals]), weight, math.inf, 1.0, math.inf, stride, beyond
        ),
        scene=scene, work=work_for(10),
    )  # fmt: skip


def path_to(search, end):
    rows = []
    while end >= 0:
        rows.append(end)
        end = search.nodes.parent[end]
    return search.nodes.state[rows[::-1]]


def test_nothing_in_the_way_is_flown_straight():
    search = search_for()
    end = grow_best_first(search, 1000)
    path = path_to(search, end)
    assert np.ptp(path[:, 1]) <= 2.5  # The last step may be the beginning of a turn, into the goal's region.
    assert search.nodes.cost[end] == search.nodes.time[end] == len(path) - 1
    assert math.dist(path[-1, :3], GOAL) <= 45.0


def test_a_wall_is_flown_round_and_no_path_costs_less_than_v():
    search = search_for(obstacles=[WALL])
    end = grow_best_first(search, 3000)
    path = path_to(search, end)
    crossing = path[(path[:, 0] > 480.0) & (path[:, 0] < 520.0)]
    assert (crossing[:, 1] <= 300.0 - 15.0 + 1e-6).all()
    # Before the goal's own region of 45 m the way is as long as V says, but for V's error on this grid.
    assert search.nodes.cost[end] >= 0.9 * cost_to_go(search.field, 0, *START) - 45.0 / 25.0


def test_a_goal_above_is_climbed_to():
    above = (900.0, 500.0, 180.0)
    search = search_for(dimension=3, goals=[above])
    path = path_to(search, grow_best_first(search, 3000))
    assert math.dist(path[-1, :3], above) <= 45.0
    assert path[:, 4].max() <= math.radians(10.0) + 1e-9


@pytest.mark.parametrize("stride", [1, 3])
def test_a_motion_has_so_many_steps(stride):
    """A turn has as many as the stride, straight flight two at least; each takes a second."""
    search = search_for(stride=stride)
    nodes, limits = search.nodes, search.objective.limits
    for way, steps in ((1, stride), (-1, stride), (0, max(2, stride))):
        last = fly_on(nodes, 1, 0, way, 0.0, limits, search.rules)
        assert last == steps
        turned = way * steps * limits.v_cruise / RHO
        assert nodes.state[last, 3] == pytest.approx(turned, rel=1e-6)


def test_with_longer_motions_a_wall_is_flown_round_by_fewer_nodes():
    short, long = (search_for(obstacles=[WALL], stride=stride) for stride in (1, 3))
    costs = [search.nodes.cost[grow_best_first(search, 3000)] for search in (short, long)]
    assert costs[1] <= 1.1 * costs[0]
    assert long.work.stats[3] < short.work.stats[3]


def test_it_says_why_it_ends():
    assert grow_best_first(search_for(obstacles=[WALL]), 1) == UNFINISHED
    assert grow_best_first(search_for(obstacles=[WALL], room=30), 1000) == FULL
    closed = Obstacle(
        "closed", np.array([[480.0, 0.0], [520.0, 0.0], [520.0, 1000.0], [480.0, 1000.0]]), 0.0, 300.0
    )
    assert grow_best_first(search_for(obstacles=[closed]), 1000) == EXHAUSTED


@pytest.mark.parametrize("weight", [1.0, 2.0])
def test_a_larger_weight_costs_at_most_so_many_times_more(weight):
    """But for the cells, of which each keeps one node only."""
    costs = []
    for weighed in (1.0, weight):
        search = search_for(obstacles=[WALL], weight=weighed)
        costs.append(search.nodes.cost[grow_best_first(search, 4000)])
    assert costs[1] <= weight * costs[0] * 1.1


def test_nodes_before_a_goal_come_last_as_soon_as_some_beyond_it_are_extended():
    """The way back from a goal costs a turn that V does not know: every node before the goal costs less."""
    goals = [(800.0, 300.0, 100.0), (200.0, 700.0, 100.0), (800.0, 700.0, 100.0), (200.0, 300.0, 100.0)]
    searches = [search_for(goals=goals, weight=1.0, room=100_000, beyond=num) for num in (30, 10**9)]
    ends = [grow_best_first(search, 9_000) for search in searches]
    assert min(ends) >= 0
    totals = [search.extended.sum() for search in searches]
    assert totals[0] < 0.75 * totals[1]
    assert totals[0] == searches[0].work.stats[3]
    costs = [search.nodes.cost[end] for search, end in zip(searches, ends, strict=True)]
    assert costs[0] <= 1.02 * costs[1]


def test_where_nothing_leads_on_from_a_goal_the_nodes_before_it_are_taken_up_again():
    """Straight on from the first goal there is a wall. Who turned well before it keeps clear."""
    ahead = np.array([[530.0, 0.0], [900.0, 0.0], [900.0, 1000.0], [530.0, 1000.0]])
    goals = [(500.0, 500.0, 100.0), (500.0, 900.0, 100.0)]
    obstacles = [Obstacle("ahead", ahead, 0.0, 300.0)]
    search = search_for(goals=goals, obstacles=obstacles, weight=2.0, room=60_000, beyond=1)
    while search.extended[1] == 0:
        assert grow_best_first(search, 1) == UNFINISHED
    before = search.extended[0]
    end = grow_best_first(search, 8_000)
    assert search.nodes.stage[end] == len(goals)
    assert search.extended[0] > 2 * before


LIMITS = VehicleModel().limits(3, (0.0, 3000.0, 0.0, 3000.0, 0.0, 900.0), 15.0, 1.0)
RHO = VehicleModel().turn_radius_min_m


def share_of_way(*, flat, up, direction=0.0):
    """:func:`turning_share` of a goal to the east, with a rim of 0 m, from a height below it."""
    state = np.array([1000.0, 1500.0, 400.0, direction, 0.0, 25.0])
    return turning_share(state, np.array([1000.0 + flat, 1500.0, 400.0 + up, 0.0]), LIMITS)


def test_a_goal_that_is_climbed_to_on_the_straight_way_is_as_far_as_v_says():
    rise = 500.0 * math.tan(LIMITS.climb_max)
    assert share_of_way(flat=500.0, up=0.99 * rise) == pytest.approx(1.0)
    assert share_of_way(flat=500.0, up=-0.99 * 500.0 * math.tan(LIMITS.descent_max)) == pytest.approx(1.0)


def test_a_goal_behind_is_farther_by_the_turn():
    """A turn on a circle whose centre is one radius aside, to the tangent that leads to the goal."""
    flat = 3.0 * RHO
    away, seen = math.hypot(flat, RHO), math.atan2(RHO, flat)  # of the goal from the centre
    way = RHO * (math.pi + seen + math.asin(RHO / away)) + math.sqrt(away * away - RHO * RHO)
    assert share_of_way(flat=flat, up=0.0, direction=math.pi) == pytest.approx(way / flat, rel=1e-6)


def test_a_goal_too_high_for_the_way_is_farther_by_a_loop():
    rise = 500.0 * math.tan(LIMITS.climb_max)
    climbing = 1.1 * 500.0
    loop = 500.0 + 2.0 * math.pi * RHO
    assert share_of_way(flat=500.0, up=1.1 * rise) == pytest.approx(loop / climbing)
    assert share_of_way(flat=500.0, up=4.0 * rise) == pytest.approx(1.0)  # it takes longer than that anyhow


def test_after_a_turn_it_flies_straight_until_it_may_turn_the_other_way():
    # 125 m at 25 m/s, a second a row: five rows after a left turn, then a right one may begin.
    search = search_for()
    nodes, limits = search.nodes, VehicleModel().limits(2, BOUNDS, 15.0, 1.0)
    assert limits.straight_min == 125.0
    nodes.turn[0], nodes.straight[0] = 1, 0.0
    assert fly_on(nodes, 1, 0, -1, 0.0, limits, search.rules) == -1
    assert fly_on(nodes, 1, 0, 0, 0.0, limits, search.rules) == 5
    assert nodes.straight[1:6] == pytest.approx([25.0, 50.0, 75.0, 100.0, 125.0])
    assert fly_on(nodes, 6, 4, -1, 0.0, limits, search.rules) == -1
    assert fly_on(nodes, 6, 5, -1, 0.0, limits, search.rules) == 6

"""RRT* on the remaining tree: its bookkeeping, bounds and pruning, and that it never makes a path worse."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from companion.kernels.arrays import empty_branches
from companion.kernels.printed import branches as below_root
from companion.kernels.printed import rrt_star as k
from companion.kernels.search.growth import next_stage
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.printed.optimise import _with_last_edge, branches_below, free_node, rrt_star_route
from companion.planning.printed.sub_tasks import SubTasks
from companion.planning.route import assess_route, finished_route, path_from_route, route_from_tree
from companion.types.threat import Radar
from tests.planning.test_solver import checker_for
from tests.support.paths import box
from tests.support.worlds import problem, track

WALLS = [box("west", 0.0, 600.0, 700.0, 650.0), box("east", 850.0, 600.0, 1500.0, 650.0)]
RADARS = [Radar("r", (900.0, 1000.0, 0.0), 400.0)]


def searched(seed, dimension=2, tracks=(), **changes):
    asked = problem(WALLS, RADARS, tracks, dimension=dimension, seed=seed, **changes)
    exploration = Exploration(asked, np.random.default_rng(seed))
    reached, route, end = SubTasks(exploration).through_goals(lambda: False)
    assert reached
    return exploration, finished_route(exploration, route, np.array(asked.goals[-1].position_enu_m)), end


def prepared(seed, dimension=2, tracks=()):
    exploration, route, end = searched(seed, dimension, tracks)
    scene = exploration.scene()
    goal = _with_last_edge(exploration, scene, route, end)
    assert goal >= 0
    return exploration, scene, goal, branches_below(exploration, 0)


def below(branches, top):
    """All nodes below one, by the lists of children."""
    found, stack = [], [top]
    while stack:
        c = branches.first[stack.pop()]
        while c >= 0:
            found.append(int(c))
            stack.append(c)
            c = branches.following[c]
    return found


def assert_hangs_together(exploration, branches, root):
    """Every searched node hangs below the root, once, after its parent, and costs what its edges cost."""
    tree, limits = exploration.tree, exploration.limits
    nodes = below(branches, root)
    assert len(nodes) == len(set(nodes))
    assert set(nodes) | {root} == set(np.flatnonzero(tree.active[: tree.count[0]]).tolist())
    for i in nodes:
        up = tree.parent[i]
        assert tree.time[i] > tree.time[up]
        assert tree.cost[i] > tree.cost[up]
        step = tree.state[i, :3] - tree.state[up, :3]
        assert np.linalg.norm(step) <= limits.v_cruise * limits.tau * (1.0 + 1e-6)
    counted = np.bincount(tree.parent[nodes], minlength=int(tree.count[0]))
    assert (tree.children[[root, *nodes]] == counted[[root, *nodes]]).all()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_rewiring_keeps_the_tree_whole_and_the_goal_gets_no_dearer(seed, dimension):
    tracks = [track(1200.0, 300.0, radius=150.0)] if seed % 2 else []
    exploration, scene, goal, branches = prepared(seed, dimension, tracks)
    tree, rng = exploration.tree, np.random.default_rng(seed)
    costs, work = [float(tree.cost[goal])], exploration.star_work
    total = 0
    for _ in range(6):
        rewired, pruned = k.rrt_star(tree, branches, scene, 0, goal, rng.random((15, k.STAR_DRAWS)), work)
        assert pruned >= 0
        total += rewired
        costs.append(float(tree.cost[goal]))
        assert_hangs_together(exploration, branches, 0)
    assert costs == sorted(costs, reverse=True)
    assert total > 0
    assert costs[-1] < costs[0]
    route = route_from_tree(exploration, goal)
    path = path_from_route(exploration, route, assess_route(exploration, route))
    found = checker_for(exploration.problem).check_path(path)
    assert [str(violation) for violation in found] == []


@pytest.mark.parametrize("seed", range(4))
def test_no_edge_gains_airspeed_faster_than_the_aircraft_can(seed):
    # From 23.3 m/s the tree reaches the cruise of 25 m/s over its first steps; edges laid over them may not
    # jump there.
    asked = problem(WALLS, RADARS, seed=seed)
    asked = replace(asked, start=replace(asked.start, airspeed_m_s=23.3))
    exploration = Exploration(asked, np.random.default_rng(seed))
    _, route, end = SubTasks(exploration).through_goals(lambda: False)
    goal = _with_last_edge(exploration, exploration.scene(), route, end)
    tree, branches, star = exploration.tree, branches_below(exploration, 0), exploration.star_work
    draws = np.random.default_rng(seed).random((400, k.STAR_DRAWS))
    rewired, _ = k.rrt_star(tree, branches, exploration.scene(), 0, goal, draws, star)
    assert rewired > 0
    nodes = np.array(below(branches, 0))
    up = tree.parent[nodes]
    assert (tree.state[up, 5] < 24.9).sum() > 5
    ways = 0.5 * (tree.state[nodes, 5] + tree.state[up, 5]) * (tree.time[nodes] - tree.time[up])
    gained = tree.state[nodes, 5] ** 2 - tree.state[up, 5] ** 2
    assert (np.abs(gained) <= 2.0 * 0.5 * ways + 0.06).all()  # a = 0.5 m/s², and 1 mm/s of tolerance
    # The tree keeps a node's airspeed when it is given another parent: the edge must come to it with that.
    rows, gaps = empty_rows(128), 0
    for a, b in itertools.product(np.flatnonzero(tree.state[: tree.count[0], 5] < 24.9), nodes):
        n = k.lay_edge(tree, exploration.scene(), a, b, rows, np.zeros(4, dtype=np.int64))
        if n:
            assert rows.states[n - 1, 5] == tree.state[b, 5]
            gaps += tree.state[a, 5] != tree.state[b, 5]
    assert gaps > 5


def chain(exploration, goal):
    nodes = [goal]
    while nodes[-1] != 0:
        nodes.append(int(exploration.tree.parent[nodes[-1]]))
    return nodes


def test_upper_bounds_are_what_is_left_to_pay():
    exploration, scene, goal, branches = prepared(1)
    tree, path = exploration.tree, np.array(chain(exploration, goal))
    work = exploration.star_work
    k.prune_by_bounds(tree, branches, scene, path, len(path), work)
    assert branches.upper[path] == pytest.approx(tree.cost[goal] - tree.cost[path])
    # A second time nothing falls, and nothing more is pruned.
    assert k.prune_by_bounds(tree, branches, scene, path, len(path), work) == 0


def test_a_branch_whose_lower_bound_is_above_the_upper_goes_with_all_below_it():
    # UB of the third waypoint from the goal is what its two edges cost. A branch from it that flies away
    # and has LB = D_C to the goal above that goes; brought to the goal's door, it stays.
    for far in (True, False):
        exploration, scene, goal, branches = prepared(2)
        tree, path = exploration.tree, np.array(chain(exploration, goal))
        up = int(path[2])
        known = set(below(branches, 0))
        branch = int(tree.count[0])
        for i, parent in ((branch, up), (branch + 1, branch)):
            tree.count[0] += 1
            tree.state[i] = tree.state[goal]
            tree.state[i, 0] -= 500.0 if far else 0.1
            tree.parent[i], tree.active[i] = parent, 1
            tree.children[parent] += 1
            tree.children[i] = 0
            tree.cost[i], tree.time[i] = tree.cost[parent] + 0.01, tree.time[parent] + 1.0
            branches.first[i] = -1
            below_root.attach_child(tree, branches, i)
        removed = k.prune_by_bounds(tree, branches, scene, path, len(path), exploration.star_work)
        left = set(below(branches, 0))
        assert {branch, branch + 1} & left == (set() if far else {branch, branch + 1})
        assert tree.active[branch] == (0 if far else 1)
        assert set(path[:-1].tolist()) <= left
        assert len(known) + 2 - len(left) == removed


def test_goals_are_passed_in_order():
    goals = np.array([[100.0, 0.0, 50.0, 20.0], [200.0, 0.0, 50.0, 20.0]])
    assert next_stage(0, 110.0, 0.0, 50.0, goals) == 1
    assert next_stage(0, 200.0, 0.0, 50.0, goals) == 0  # the second before the first
    assert next_stage(1, 200.0, 19.0, 50.0, goals) == 2
    assert next_stage(1, 200.0, 0.0, 75.0, goals) == 1  # 25 m above
    assert next_stage(2, 100.0, 0.0, 50.0, goals) == 2


def small_family():
    """A root with children 1 and 2; 3 below 1."""
    branches = empty_branches(5, np.empty((0, 4)))
    exploration, _, _ = searched(0)
    tree = exploration.tree
    tree.parent[:4], tree.children[:4] = (-1, 0, 0, 1), (2, 1, 0, 0)
    for i in (1, 2, 3):
        below_root.attach_child(tree, branches, i)
    return tree, branches


def test_nodes_are_attached_and_detached():
    tree, branches = small_family()
    assert sorted(below(branches, 0)) == [1, 2, 3]
    below_root.detach_child(tree, branches, 1)
    assert below(branches, 0) == [2]
    assert tree.children[0] == 1
    below_root.detach_child(tree, branches, 2)
    assert below(branches, 0) == []


def test_what_is_flown_meanwhile_stays_as_it_is():
    exploration, route, end = searched(3)
    free = rrt_star_route(exploration, route, end, lambda: False).route
    exploration, route, end = searched(3)
    object.__setattr__(exploration.problem.settings, "flown_meanwhile_s", 20.0)
    later = rrt_star_route(exploration, route, end, lambda: False).route
    assert (later.states[:21] == route.states[:21]).all()
    assert not np.array_equal(free.states[:21], route.states[:21])


def test_root_r_is_the_first_waypoint_not_reached_in_time():
    exploration, route, end = searched(3)
    goal = _with_last_edge(exploration, exploration.scene(), route, end)
    tree = exploration.tree
    assert free_node(exploration, goal, 0.0) == 0
    node = free_node(exploration, goal, 12.5)  # edges of the search take a second
    assert tree.time[node] - tree.time[0] == pytest.approx(13.0)
    assert free_node(exploration, goal, 1e6) == goal


def test_a_lower_bound_is_below_the_cost_of_every_edge():
    exploration, scene, _, _ = prepared(1, dimension=3)
    tree, stats = exploration.tree, np.zeros(4, dtype=np.int64)
    rows = empty_rows(128)
    laid = 0
    rng = np.random.default_rng(5)
    for a, b in rng.integers(0, tree.count[0], (600, 2)):
        n = k.lay_edge(tree, scene, a, b, rows, stats)
        if n:
            laid += 1
            steps = np.linalg.norm(np.diff(rows.states[:n, :3], axis=0), axis=1)
            length_cost = 0.5 * steps.sum() / scene.search.unit
            assert k.lower_bound(tree.state[a], tree.state[b], scene, np.empty(3)) <= length_cost + 1e-9
            # The Dubins edge ends in the pose of b, heading and climb angle included.
            assert rows.states[n - 1, :3] == pytest.approx(tree.state[b, :3], abs=1e-3)
            assert math.remainder(rows.states[n - 1, 3] - tree.state[b, 3], 2 * math.pi) == pytest.approx(
                0.0, abs=1e-6
            )
            assert rows.states[n - 1, 4] == tree.state[b, 4]
    assert laid > 20

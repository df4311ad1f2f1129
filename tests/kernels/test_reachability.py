"""Reachability of path nodes by moving threats, against a plain search over the same circle."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels import reachability as r
from companion.kernels.dubins import distance_to_point
from companion.kernels.layout import empty_pursuers, empty_tree
from companion.world.reachability import STEP_S, observe, threat_trees
from tests.support.paths import box
from tests.support.worlds import is_blocked, packed, track

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
WORLD = (
    box("wall", 0.0, -200.0, 30.0, 200.0, 0.0, 60.0),
    box("house", -300.0, 200.0, -150.0, 300.0, 0.0, 40.0),
    box("tower", 200.0, 250.0, 250.0, 300.0, 0.0, 200.0),
)
PACKED = packed(WORLD, BOUNDS)
SPEED, RADIUS, TURN = 20.0, 150.0, 15.0
COORDINATE = st.floats(-500.0, 500.0)


def pursuers_at(x, y, heading, *, time=0.0, airborne=0.0, speed=SPEED, up=0.0, capacity=200):
    models = np.array([[speed, RADIUS, TURN, airborne, STEP_S * speed]])
    trees = empty_pursuers(capacity, models, np.array(BOUNDS))
    trees.position[0, 0] = x, y, up
    trees.heading[0, 0], trees.time[0, 0], trees.count[0] = heading, time, 1
    return trees


def ask(trees, x, y, z, time, j=0):
    boundary, estimate = np.zeros(2), np.zeros(3)
    answer = r.is_reachable(trees, 0, j, x, y, z, time, PACKED, boundary, estimate)
    return answer, boundary, estimate


def test_reachable_by_hand():
    # 400 m west of the node; the circle of 150 m begins 250 m ahead: 12.5 s at 20 m/s.
    trees = pursuers_at(-500.0, -400.0, 0.0)
    assert not ask(trees, -100.0, -400.0, 100.0, 12.4)[0]
    answer, boundary, estimate = ask(trees, -100.0, -400.0, 100.0, 12.6)
    assert answer
    assert boundary == pytest.approx([-250.0, -400.0])
    assert estimate[:2] == pytest.approx([-250.0, -400.0])  # 2 m more are not worth a step
    _, _, estimate = ask(trees, -100.0, -400.0, 100.0, 17.5)
    assert estimate[:2] == pytest.approx([-150.0, -400.0])  # 5 s are left: 100 m farther
    answer, _, estimate = ask(trees, -100.0, -400.0, 100.0, 100.0)
    assert answer
    assert estimate[:2] == pytest.approx([-100.0, -400.0])  # right below


def test_a_threat_inside_the_circle_needs_only_to_see_the_node():
    trees = pursuers_at(-100.0, 0.0, 0.0, time=5.0)
    assert ask(trees, -80.0, 0.0, 50.0, 5.0)[0]
    assert not ask(trees, -80.0, 0.0, 50.0, 4.9)[0]
    # Behind the wall, 20 m up and 110 m away: the wall of 60 m hides it, and there is no time to go round.
    assert not ask(trees, 60.0, 0.0, 20.0, 6.0)[0]


def test_a_parked_threat_reaches_only_what_is_inside_its_circle():
    trees = pursuers_at(-400.0, -400.0, 0.0, speed=0.0)
    assert ask(trees, -300.0, -400.0, 50.0, 1.0)[0]
    assert not ask(trees, -200.0, -400.0, 50.0, 1e6)[0]


def plain_answer(x0, y0, heading, x, y, z, slack):
    """The definition of Fig. 2 over the same 16 bearings, with shapely's lines of sight."""
    eye = 2.0
    if slack < 0.0:
        return False
    if math.hypot(x0 - x, y0 - y) <= RADIUS and not is_blocked((x0, y0, eye), (x, y, z), WORLD):
        return True
    base = math.atan2(y0 - y, x0 - x)
    for n in range(16):
        bx = x + RADIUS * math.cos(base + 2.0 * math.pi * n / 16)
        by = y + RADIUS * math.sin(base + 2.0 * math.pi * n / 16)
        if (
            distance_to_point(x0, y0, heading, bx, by, TURN) / SPEED <= slack
            and not is_blocked((bx, by, eye), (x, y, z), WORLD)
            and not is_blocked((x0, y0, 0.0), (bx, by, 0.0), WORLD)
        ):
            return True
    return False


@settings(max_examples=250, deadline=None)
@given(
    COORDINATE,
    COORDINATE,
    st.floats(-3.1, 3.1),
    COORDINATE,
    COORDINATE,
    st.floats(5.0, 150.0),
    st.floats(-1.0, 60.0),
)
def test_reachable_agrees_with_the_definition(x0, y0, heading, x, y, z, slack):
    trees = pursuers_at(x0, y0, heading, time=7.0)
    answer, boundary, estimate = ask(trees, x, y, z, 7.0 + slack)
    expected = plain_answer(x0, y0, heading, x, y, z, slack)
    # Answers that a millimetre or a millisecond would change are not compared.
    nearly = {
        plain_answer(x0, y0, heading, x + dx, y + dy, z + 1e-3, slack + e)
        for dx, dy, e in ((1e-3, 0.0, 1e-3), (-1e-3, 0.0, -1e-3), (0.0, 1e-3, -1e-3), (0.0, -1e-3, 1e-3))
    }
    if len(nearly) == 1:
        assert answer == expected
    if answer:
        on_circle = math.isclose(math.hypot(boundary[0] - x, boundary[1] - y), RADIUS, abs_tol=1e-6)
        assert on_circle or (boundary[0], boundary[1]) == (x0, y0)
        # The estimate is no farther than the boundary point, and the DT gets there in time.
        assert math.hypot(estimate[0] - x, estimate[1] - y) <= math.hypot(*(boundary - (x, y))) + 1e-6
        assert math.hypot(estimate[0] - x0, estimate[1] - y0) <= SPEED * slack + 1e-6


def grown(seed, n=60):
    rng = np.random.default_rng(seed)
    trees = pursuers_at(-250.0, -250.0, 0.3, capacity=400)
    for x, y in rng.uniform(-580.0, 580.0, (n, 2)):
        near = np.empty(r.MAX_NEAR, dtype=np.int64)
        r.near_pursuer_nodes(trees, 0, x, y, 1, near)
        r.connect(trees, 0, near[0], x, y, bool(rng.random() < 0.3), PACKED)
    return trees


def assert_sound(trees, d=0):
    """Every node hangs below an earlier one, later than it, on a free line; the root alone has no parent."""
    n = trees.count[d]
    assert trees.parent[d, 0] == -1
    for j in range(1, n):
        up = trees.parent[d, j]
        assert 0 <= up < j
        assert trees.time[d, j] > trees.time[d, up]
        way = np.linalg.norm(trees.position[d, j, :2] - trees.position[d, up, :2])
        assert trees.time[d, j] - trees.time[d, up] >= way / trees.model[d, 0] - 1e-9
        assert not is_blocked(trees.position[d, up], trees.position[d, j], WORLD)


@pytest.mark.parametrize("seed", range(5))
def test_trees_grow_sound_and_inside_their_bounds(seed):
    trees = grown(seed)
    assert trees.count[0] > 30
    assert_sound(trees)
    assert np.abs(trees.position[0, : trees.count[0], :2]).max() <= 600.0


@pytest.mark.parametrize("seed", range(5))
def test_a_new_observation_leaves_no_orphan_and_stamps_grow(seed):
    trees = grown(seed)
    before = trees.position[0, : trees.count[0]].copy()
    stamps = trees.time[0, : trees.count[0]].copy()
    for n in range(1, 4):
        r.re_root(trees, 0, -250.0 + 30.0 * n, -240.0, 0.0, 0.2, 2.0 * n, 40.0, PACKED)
        assert trees.position[0, 0] == pytest.approx([-250.0 + 30.0 * n, -240.0, 0.0])
        assert trees.time[0, 0] == 2.0 * n
        assert trees.parent[0, 1] == 0
        assert trees.position[0, 1, 0] == pytest.approx(-250.0 + 30.0 * n + 40.0 * math.cos(0.2))
        assert trees.time[0, 1] == pytest.approx(2.0 * n + 2.0)
        assert_sound(trees)
        if n == 1:
            kept = {tuple(p) for p in trees.position[0, 2 : trees.count[0]]}
            assert kept
            assert kept <= {tuple(p) for p, t in zip(before, stamps, strict=True) if t > 4.0}


def test_a_root_in_front_of_a_wall_has_a_shorter_first_step():
    trees = pursuers_at(0.0, 0.0, 0.0)
    r.re_root(trees, 0, -25.0, 0.0, 0.0, 0.0, 1.0, 40.0, PACKED)  # the wall is 25 m ahead
    assert trees.count[0] == 2
    assert trees.position[0, 1, 0] == pytest.approx(-5.0)
    r.re_root(trees, 0, -1.0, 0.0, 0.0, 0.0, 2.0, 40.0, PACKED)
    assert trees.count[0] == 1


def test_a_tree_from_a_track_is_moved_on_by_its_age():
    tracks = [track(-300.0, -300.0, velocity=(6.0, 8.0), stamp=10.0)]
    trees = threat_trees(tracks, 13.0, PACKED, None, BOUNDS)
    assert trees.position[0, 0] == pytest.approx([-282.0, -276.0, 0.0])
    assert trees.heading[0, 0] == pytest.approx(math.atan2(8.0, 6.0))
    assert trees.time[0, 0] == 13.0
    assert trees.time[0, 1] == pytest.approx(13.0 + 10.0 * STEP_S / 20.0)  # 20 m at up to 20 m/s
    observe(trees, 0, track(-250.0, -250.0, stamp=20.0), 20.0, PACKED, 120.0)
    assert trees.position[0, 0] == pytest.approx([-250.0, -250.0, 120.0])


def path_tree(points, times):
    tree = empty_tree(len(points) + 2, 1)
    n = len(points)
    tree.count[0] = n
    tree.state[:n, :3] = points
    tree.time[:n] = times
    tree.active[:n] = 1
    tree.parent[:n] = np.arange(-1, n - 1)
    return tree


@pytest.mark.parametrize("kind", [r.EX_RRT, r.RRT_REACH, r.RRT])
def test_every_estimator_finds_only_what_can_be_reached(kind):
    rng = np.random.default_rng(4)
    points = np.column_stack([np.linspace(-400.0, 400.0, 30), np.full(30, -350.0), np.full(30, 100.0)])
    times = np.linspace(0.0, 40.0, 30)
    tree, trees = path_tree(points, times), pursuers_at(-500.0, -100.0, -1.0, speed=30.0, capacity=800)
    changed = np.empty(4 * r.MAX_NEAR, dtype=np.int64)
    for _ in range(20):
        for i in range(30):
            num = r.estimate_reachability(
                tree, trees, i, kind, 0.5, 3, np.array(BOUNDS), rng.random(3), PACKED, changed
            )
            assert set(changed[:num]) <= set(range(30))
    reached = tree.threat_point[:30, 0, 3] > 0.0
    assert reached.any()
    assert not reached.all()  # the first nodes are passed before it can be there
    for i in np.flatnonzero(reached):
        x, y = tree.threat_point[i, 0, :2]
        # No faster than straight ahead, near enough, and in sight.
        assert math.hypot(x + 500.0, y + 100.0) <= 30.0 * times[i] + 1e-6
        assert math.hypot(x - points[i, 0], y - points[i, 1]) <= RADIUS + 1e-6
        assert not is_blocked((x, y, 2.0), points[i], WORLD)
    assert_sound(trees)


def test_what_a_threat_reaches_by_driving_straight_is_found():
    # Asked in flight order, nodes that are too early for it draw the tree along behind the aircraft. Its
    # branches there stand late; the nodes that it reaches straight from its root have to be found anyhow.
    points = np.column_stack([np.linspace(-400.0, 400.0, 30), np.full(30, -350.0), np.full(30, 100.0)])
    times, rng = np.linspace(0.0, 40.0, 30), np.random.default_rng(4)
    tree, trees = path_tree(points, times), pursuers_at(-500.0, -100.0, -1.0, speed=30.0, capacity=800)
    straight = [ask(trees, *points[i], times[i])[0] for i in range(30)]
    changed = np.empty(4 * r.MAX_NEAR, dtype=np.int64)
    for i in range(30):
        r.estimate_reachability(
            tree, trees, i, r.EX_RRT, 0.5, 3, np.array(BOUNDS), rng.random(3), PACKED, changed
        )
    assert straight == [False] * 5 + [True] * 25
    assert (tree.threat_point[:30, 0, 3] > 0.0)[5:].all()
    assert not (tree.threat_point[:4, 0, 3] > 0.0).any()


def test_the_nearest_nodes_come_by_rising_time():
    trees = grown(1)
    near = np.empty(r.MAX_NEAR, dtype=np.int64)
    found = r.near_pursuer_nodes(trees, 0, 100.0, -300.0, 5, near)
    away = np.hypot(*(trees.position[0, : trees.count[0], :2] - (100.0, -300.0)).T)
    assert found == 5
    assert set(near[:5]) == set(np.argsort(away, kind="stable")[:5])
    assert np.all(np.diff(trees.time[0, near[:5]]) >= 0.0)


def test_airborne_threats_fly_over_what_stops_ground_vehicles():
    ground, air = pursuers_at(-200.0, 0.0, 0.0), pursuers_at(-200.0, 0.0, 0.0, airborne=1.0, up=100.0)
    assert r.connect(ground, 0, 0, 300.0, 0.0, True, PACKED) > 0
    assert ground.position[0, : ground.count[0], 0].max() <= 0.0
    r.connect(air, 0, 0, 300.0, 0.0, True, PACKED)
    assert air.position[0, : air.count[0], 0].max() == pytest.approx(300.0)

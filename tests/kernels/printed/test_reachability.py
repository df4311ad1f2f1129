"""Reachability of path nodes by moving threats, against a plain search over the same circle."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.aircraft.dubins import distance_to_point
from companion.kernels.arrays import empty_pursuers, empty_tree
from companion.kernels.printed import reachability as r
from companion.kernels.printed.intercept import AIR_CLIMB
from companion.kernels.printed.threat_tree import re_root
from companion.kernels.workspace import reach_scratch
from companion.world.pursuer_trees import STEP_S, observe, threat_trees
from tests.support.paths import box
from tests.support.worlds import is_blocked, packed, track

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
WORLD = (
    box("wall", 0.0, -200.0, 30.0, 200.0, 0.0, 60.0),
    box("house", -300.0, 200.0, -150.0, 300.0, 0.0, 40.0),
    box("tower", 200.0, 250.0, 250.0, 300.0, 0.0, 200.0),
)
PACKED = packed(WORLD, BOUNDS)
PRISMS = PACKED
SPEED, RADIUS, TURN = 20.0, 150.0, 15.0
BESIDE = st.integers(-500, 500).map(lambda n: n + 0.37)  # never on a wall's face


def pursuers_at(x, y, heading, *, time=0.0, airborne=0.0, speed=SPEED, up=0.0, capacity=200):
    models = np.array([[speed, RADIUS, TURN, airborne, STEP_S * speed]])
    trees = empty_pursuers(capacity, models, np.array(BOUNDS))
    trees.position[0, 0] = x, y, up
    trees.heading[0, 0], trees.time[0, 0], trees.count[0] = heading, time, 1
    return trees


def ask(trees, x, y, z, time, j=0, d=0):
    """Whether the place is reachable; q_B, and the DT's nearest position."""
    out = np.zeros(6)
    answer = r.gets_to(trees, d, j, x, y, z, time, PRISMS, out)
    return answer, out[:2], out[3:]


def test_reachable_by_hand():
    # 400 m west of the node; the circle of 150 m begins 250 m ahead: 12.5 s at 20 m/s.
    trees = pursuers_at(-500.0, -400.0, 0.0)
    assert not ask(trees, -100.0, -400.0, 100.0, 12.4)[0]
    answer, boundary, estimate = ask(trees, -100.0, -400.0, 100.0, 12.6)
    assert answer
    assert boundary == pytest.approx([-250.0, -400.0])
    assert estimate[:2] == pytest.approx([-248.0, -400.0])  # 0.1 s are left: 2 m farther
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
@given(BESIDE, BESIDE, st.floats(-3.1, 3.1), BESIDE, BESIDE, st.floats(5.0, 150.0), st.floats(-1.0, 60.0))
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


def nearest(trees, x, y, k):
    scratch = reach_scratch()
    found = r.near_pursuer_nodes(trees, 0, x, y, k, scratch.everything, scratch.near)
    return scratch.near.rows[:found]


def grown(seed, n=60):
    rng = np.random.default_rng(seed)
    trees = pursuers_at(-250.0, -250.0, 0.3, capacity=400)
    for x, y in rng.uniform(-580.0, 580.0, (n, 2)):
        near = nearest(trees, x, y, 1)
        r.connect(trees, 0, near[0], x, y, 0.0, bool(rng.random() < 0.3), PRISMS)
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
        re_root(trees, 0, (-250.0 + 30.0 * n, -240.0, 0.0), 0.2, 2.0 * n, 40.0, False, PACKED)
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
    re_root(trees, 0, (-25.0, 0.0, 0.0), 0.0, 1.0, 40.0, False, PACKED)  # the wall is 25 m ahead
    assert trees.count[0] == 2
    assert trees.position[0, 1, 0] == pytest.approx(-5.0)
    re_root(trees, 0, (-1.0, 0.0, 0.0), 0.0, 2.0, 40.0, False, PACKED)
    assert trees.count[0] == 1


def test_a_tree_starts_where_and_when_its_track_is():
    tracks = [track(-300.0, -300.0, velocity=(6.0, 8.0), stamp=10.0)]
    trees = threat_trees(tracks, PACKED, None, BOUNDS)
    assert trees.position[0, 0] == pytest.approx([-300.0, -300.0, 0.0])
    assert trees.heading[0, 0] == pytest.approx(math.atan2(8.0, 6.0))
    assert trees.time[0, 0] == 10.0
    # Driving on at 10 m/s it would be at (-288, -284) in 2 s; it could be there in 1 s, at 20 m/s.
    assert trees.position[0, 1] == pytest.approx([-300.0 + 6.0 * STEP_S, -300.0 + 8.0 * STEP_S, 0.0])
    assert trees.time[0, 1] == pytest.approx(10.0 + 10.0 * STEP_S / 20.0)
    observe(trees, 0, track(-250.0, -250.0, stamp=20.0), PACKED, 120.0)
    assert trees.position[0, 0] == pytest.approx([-250.0, -250.0, 120.0])
    assert trees.time[0, 0] == 20.0


def path_tree(points, times, num_threats=1):
    tree = empty_tree(len(points) + 2, num_threats)
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
    scratch = reach_scratch()
    for _ in range(20):
        for i in range(30):
            num = r.estimate_reachability(
                tree, trees, i, r.Estimator(kind, 0.5, 3), np.array(BOUNDS), rng.random(3), PACKED, scratch
            )
            assert set(scratch.changed[:num]) <= set(range(30))
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
    scratch = reach_scratch()
    for i in range(30):
        r.estimate_reachability(
            tree, trees, i, r.Estimator(r.EX_RRT, 0.5, 3), np.array(BOUNDS), rng.random(3), PACKED, scratch
        )
    assert straight == [False] * 5 + [True] * 25
    assert (tree.threat_point[:30, 0, 3] > 0.0)[5:].all()
    assert not (tree.threat_point[:4, 0, 3] > 0.0).any()


def test_the_nearest_nodes_come_by_rising_time():
    trees = grown(1)
    near = nearest(trees, 100.0, -300.0, 5)
    away = np.hypot(*(trees.position[0, : trees.count[0], :2] - (100.0, -300.0)).T)
    assert len(near) == 5
    assert set(near) == set(np.argsort(away, kind="stable")[:5])
    assert np.all(np.diff(trees.time[0, near]) >= 0.0)


def test_waiting_at_the_boundary_is_left_as_far_as_the_way_is_free_and_the_node_is_seen():
    # The node is above the wall's middle, (15, 0, 100); q_B = (-135, 0), and 135 m would be free to the
    # wall's face at x = 0. From s metres before it the line of sight, from 2 m up, passes the face at
    # 2 + 98·s/(s + 15), which is the wall's 60 m for s = 870/40 = 21.75 m: 113.25 m from q_B. Halving the
    # 150 m to below the node four times comes within 1/16 of that way.
    trees = pursuers_at(-300.0, 0.0, 0.0)
    answer, boundary, estimate = ask(trees, 15.0, 0.0, 100.0, 100.0)
    assert answer
    assert boundary == pytest.approx([-135.0, 0.0])
    assert estimate[1] == pytest.approx(0.0)
    assert 113.25 - 150.0 / 16.0 <= estimate[0] + 135.0 <= 113.25


@settings(max_examples=200, deadline=None)
@given(BESIDE, BESIDE, BESIDE, BESIDE, st.floats(5.0, 150.0), st.floats(0.0, 60.0))
def test_the_estimate_is_the_nearest_place_on_the_way_but_for_the_last_halving(x0, y0, x, y, z, slack):
    trees = pursuers_at(x0, y0, 0.0)
    answer, boundary, estimate = ask(trees, x, y, z, slack)
    if not answer:
        return
    b = np.array(boundary)
    left = math.hypot(x - b[0], y - b[1])
    spare = SPEED * slack - distance_to_point(x0, y0, 0.0, *b, TURN)
    whole = min(spare, left)
    gone = math.hypot(*(estimate[:2] - b))
    assert gone <= whole + 1e-6
    assert not is_blocked((*estimate[:2], 2.0), (x, y, z), WORLD)
    # One sixteenth farther on, the way or the sight was barred (or its end has been reached).
    if left > 1.0 and gone < whole - whole / 16.0 - 1e-6:
        barred = []
        for share in np.linspace(gone / left, min(1.0, gone / left + whole / left / 15.0), 40):
            place = b + share * (np.array([x, y]) - b)
            barred.append(
                is_blocked((*b, 0.0), (*place, 0.0), WORLD) or is_blocked((*place, 2.0), (x, y, z), WORLD)
            )
        assert any(barred)


def test_airborne_threats_fly_over_what_stops_ground_vehicles():
    ground, air = pursuers_at(-200.0, 0.0, 0.0), pursuers_at(-200.0, 0.0, 0.0, airborne=1.0, up=100.0)
    assert r.connect(ground, 0, 0, 300.0, 0.0, 100.0, True, PRISMS) > 0
    assert ground.position[0, : ground.count[0], 0].max() <= 0.0
    r.connect(air, 0, 0, 300.0, 0.0, 100.0, True, PRISMS)
    assert air.position[0, : air.count[0], 0].max() == pytest.approx(300.0)


def test_airborne_threats_climb_while_they_come_by_hand():
    # 400 m west and 200 m below; v = 20 m/s, RD_max = 150 m, vertically 10 m/s.
    trees = pursuers_at(-500.0, -400.0, 0.0, airborne=1.0, up=50.0)
    # After t seconds it has risen 10·t; the sphere's circle at its height has the radius
    # sqrt(150² − (200 − 10·t)²), and 20·t + that has to be 400. t = 12.5: 150 m up to 175, 75 m short
    # of 250: radius 129.9 m, 250 + 129.9 < 400. t = 13.2: 68 m short, radius 133.7 m; 264 + 133.7 < 400;
    # t = 13.4: 66 m short, 134.7 m; 268 + 134.7 > 400.
    assert not ask(trees, -100.0, -400.0, 250.0, 13.2)[0]
    answer, boundary, estimate = ask(trees, -100.0, -400.0, 250.0, 13.4)
    assert answer
    assert boundary == pytest.approx([-100.0 - math.sqrt(150.0**2 - 66.0**2), -400.0])
    assert estimate[2] == pytest.approx(50.0 + 134.0)
    assert math.dist(estimate, (-100.0, -400.0, 250.0)) <= 150.0
    # Given time it comes to the node itself; a ground vehicle would stay below it.
    answer, _, estimate = ask(trees, -100.0, -400.0, 250.0, 60.0)
    assert answer
    assert estimate == pytest.approx([-100.0, -400.0, 250.0])
    # Its reach is a sphere: right above it by more than RD_max it cannot, by less it can.
    trees = pursuers_at(-100.0, -400.0, 0.0, airborne=1.0, up=50.0)
    assert not ask(trees, -100.0, -400.0, 250.0, 4.9)[0]
    assert ask(trees, -100.0, -400.0, 250.0, 5.1)[0]


def plain_answer_in_the_air(p, heading, q, slack):
    """The definition with a sphere: at the height nearest to the node's that it can have by then."""
    if slack < 0.0:
        return False
    rise = AIR_CLIMB * SPEED * slack
    height = float(np.clip(q[2], p[2] - rise, p[2] + rise))
    if abs(q[2] - height) > RADIUS:
        return False
    radius = math.sqrt(RADIUS**2 - (q[2] - height) ** 2)
    above = (p[0], p[1], height)
    if math.dist(above, q) <= RADIUS and not is_blocked(above, q, WORLD) and not is_blocked(p, above, WORLD):
        return True
    base = math.atan2(p[1] - q[1], p[0] - q[0])
    for n in range(16):
        b = (
            q[0] + radius * math.cos(base + 2.0 * math.pi * n / 16),
            q[1] + radius * math.sin(base + 2.0 * math.pi * n / 16),
            height,
        )
        if (
            distance_to_point(p[0], p[1], heading, b[0], b[1], TURN) <= SPEED * slack
            and not is_blocked(b, q, WORLD)
            and not is_blocked(p, b, WORLD)
        ):
            return True
    return False


@settings(max_examples=250, deadline=None)
@given(
    st.tuples(BESIDE, BESIDE, st.floats(5.0, 250.0)),
    st.floats(-3.1, 3.1),
    st.tuples(BESIDE, BESIDE, st.floats(5.0, 250.0)),
    st.floats(-1.0, 40.0),
)
def test_reachable_in_the_air_agrees_with_the_definition(p, heading, q, slack):
    trees = pursuers_at(p[0], p[1], heading, airborne=1.0, up=p[2], time=7.0)
    answer, _, estimate = ask(trees, *q, 7.0 + slack)
    nearly = {
        plain_answer_in_the_air(p, heading, (q[0] + dx, q[1] + dy, q[2] + dz), slack + e)
        for dx, dy, dz, e in (
            (0.0, 0.0, 0.0, 0.0), (1e-3, 0.0, 1e-3, 1e-3), (-1e-3, 0.0, -1e-3, -1e-3),
            (0.0, 1e-3, 1e-3, -1e-3), (0.0, -1e-3, -1e-3, 1e-3),
        )
    }  # fmt: skip
    if len(nearly) == 1:
        assert answer == nearly.pop()
    if answer:
        assert math.dist(estimate, q) <= RADIUS + 1e-6
        assert math.hypot(*(estimate[:2] - p[:2])) <= SPEED * slack + 1e-6
        assert abs(estimate[2] - p[2]) <= AIR_CLIMB * SPEED * slack + 1e-6
        assert not is_blocked(estimate, q, WORLD)


def test_several_threats_are_told_apart_and_each_counts():
    models = np.array(
        [
            [SPEED, RADIUS, TURN, 0.0, STEP_S * SPEED],
            [2.0 * SPEED, RADIUS, TURN, 1.0, 2.0 * STEP_S * SPEED],
            [0.0, RADIUS, TURN, 0.0, 0.0],
        ]
    )
    trees = empty_pursuers(400, models, np.array(BOUNDS), 40)
    places = np.array([(-500.0, -400.0, 0.0), (500.0, 400.0, 200.0), (0.0, 400.0, 0.0)])
    trees.position[:, 0], trees.count[:] = places, 1
    points = np.column_stack([np.full(40, -300.0), np.linspace(-500.0, 500.0, 40), np.full(40, 100.0)])
    times = np.linspace(0.0, 40.0, 40)
    tree = path_tree(points, times, num_threats=3)
    scratch = reach_scratch()
    rng = np.random.default_rng(8)
    for _ in range(30):
        for i in range(40):
            r.estimate_reachability(
                tree,
                trees,
                i,
                r.Estimator(r.EX_RRT, 0.5, 3),
                np.array(BOUNDS),
                rng.random(3),
                PACKED,
                scratch,
            )
    for d in range(3):
        found = tree.threat_point[:40, d, 3] > 0.0
        assert d == 2 or found.any()
        assert not found[:2].any()
        for i in np.flatnonzero(found):
            gone = tree.threat_point[i, d, :3] - places[d]
            assert math.hypot(*gone[:2]) <= models[d, 0] * times[i] + 1e-6
            assert abs(gone[2]) <= (AIR_CLIMB * models[d, 0] * times[i] if d == 1 else 0.0) + 1e-6
    # The parked one reaches what lies inside its circle: (-300, y) is 300 m away, so nothing.
    assert not (tree.threat_point[:40, 2, 3] > 0.0).any()
    assert trees.count[2] == 1
    assert trees.count[0] > 5
    assert trees.count[1] > 5
    assert np.ptp(trees.position[1, : trees.count[1], 2]) > 20.0  # it uses all three dimensions
    assert np.ptp(trees.position[0, : trees.count[0], 2]) == 0.0


def test_positions_along_a_path_are_the_nearest_over_all_ways():
    rng = np.random.default_rng(6)
    tracks = [track(-400.0, -300.0, velocity=(10.0, 0.0)), track(300.0, 400.0, airborne=True, up=150.0)]
    trees = threat_trees(tracks, PACKED, None, BOUNDS)
    out, found = np.empty((2, 4)), 0
    scratch = reach_scratch()
    for x, y, z, time in rng.uniform((-500.0, -500.0, 20.0, 0.0), (500.0, 500.0, 200.0, 60.0), (150, 4)):
        r.dt_positions(trees, x, y, z, time, 3, PACKED, out, scratch)
        for d in range(2):
            asked = [ask(trees, x, y, z, time, j, d) for j in range(trees.count[d])]  # every node
            through = [math.dist(estimate, (x, y, z)) for answer, _, estimate in asked if answer]
            assert not (out[d, 3] > 0.0 and not through)
            if not through:
                continue
            found += 1
            assert out[d, 3] == 1.0
            assert math.dist(out[d, :3], (x, y, z)) >= min(through) - 1e-9
            assert math.dist(out[d, :3], (x, y, z)) <= trees.model[d, 1] + 1e-6 or d == 0
            assert not is_blocked((*out[d, :2], out[d, 2] + (2.0 if d == 0 else 0.0)), (x, y, z), WORLD)
    assert found > 80


def test_without_threats_nothing_is_estimated():
    trees = empty_pursuers(10, np.empty((0, 5)), np.array(BOUNDS))
    out = np.zeros((1, 4))
    r.dt_positions(trees, 0.0, 0.0, 0.0, 5.0, 3, PACKED, out, reach_scratch())
    assert not out.any()

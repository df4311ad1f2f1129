"""The DTs' trees from observation to observation (paper Fig. 1), and from plan to plan."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.native.struct import Struct
from companion.kernels.printed import reachability as r
from companion.kernels.workspace import reach_scratch
from companion.planning.comparators import Estimator, Strategies
from companion.planning.explore import Exploration
from companion.planning.solver import solve
from companion.world.pursuer_trees import CAPACITY, KEPT_MAX, grown_trees, threat_trees
from tests.support.paths import box
from tests.support.worlds import is_blocked, packed, problem, track

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
WORLD = (
    box("wall", 0.0, -200.0, 30.0, 200.0, 0.0, 60.0),
    box("house", -300.0, 200.0, -150.0, 300.0, 0.0, 40.0),
)
PACKED = packed(WORLD, BOUNDS)
PRISMS = PACKED


def assert_sound(trees, d):
    """One root; all others hang below earlier rows, later, no sooner than straight, on free lines."""
    n, speed = int(trees.count[d]), trees.model[d, 0]
    assert n >= 1
    assert trees.parent[d, 0] == -1
    root = trees.position[d, 0]
    for j in range(1, n):
        up = trees.parent[d, j]
        assert 0 <= up < j
        assert trees.time[d, j] > trees.time[d, up]
        away = np.linalg.norm(trees.position[d, j, :2] - root[:2])
        assert trees.time[d, j] - trees.time[d, 0] >= away / speed - 1e-9
        assert not is_blocked(trees.position[d, up], trees.position[d, j], WORLD)


def arrays_in(trees):
    """Every array of a structure, those of its indices included."""
    for part in trees:
        yield from arrays_in(part) if isinstance(part, tuple | Struct) else [part]


def grow(trees, rng, n):
    scratch = reach_scratch()
    for d in range(len(trees.count)):
        for x, y, z in rng.uniform((-580.0, -580.0, 0.0), (580.0, 580.0, 300.0), (n, 3)):
            r.near_pursuer_nodes(trees, d, x, y, 1, scratch.everything, scratch.near)
            r.connect(trees, d, scratch.near.rows[0], x, y, z, bool(rng.random() < 0.3), PRISMS)


STEPS = st.lists(
    st.tuples(
        st.floats(0.2, 8.0),  # time to the next observation
        st.floats(-60.0, 60.0),  # how far the DT is found from where it was
        st.floats(-60.0, 60.0),
        st.floats(-25.0, 25.0),  # and how fast
        st.floats(-25.0, 25.0),
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=40, deadline=None)
@given(STEPS, st.integers(0, 2**32 - 1), st.booleans())
def test_updates_leave_no_orphan_stamps_grow_and_nothing_is_sooner_than_possible(steps, seed, corners):
    rng = np.random.default_rng(seed)
    places, stamp = [(-400.0, -400.0), (400.0, -300.0)], 0.0
    carried = ()
    for wait, east, north, *velocity in steps:
        stamp += wait
        places = [(min(500.0, max(-500.0, x + east)), min(500.0, max(-500.0, y + north))) for x, y in places]
        places = [
            (x, y) if not is_blocked((x, y, 0.0), (x, y, 0.0), WORLD) else (x, 400.0) for x, y in places
        ]
        tracks = [
            track(*places[0], velocity=tuple(velocity), stamp=stamp),
            track(*places[1], velocity=tuple(velocity), stamp=stamp, airborne=True, up=120.0),
        ]
        trees = threat_trees(tracks, PACKED, None, BOUNDS, carried, with_corners=corners)
        for d in range(2):
            assert_sound(trees, d)
            assert trees.position[d, 0, :2] == pytest.approx(places[d])
            assert trees.time[d, 0] == stamp
            n = int(trees.count[d])
            first_corner, num_corners = trees.corners[d]
            assert num_corners == (0 if d == 1 or not corners else 8)
            base = first_corner + num_corners
            if not carried:
                assert n == base <= 2 + num_corners
                continue
            # What is there was there before, and was to be reached later than the root's child.
            first = trees.time[d, 1] if first_corner > 1 else stamp
            older = {
                tuple(place[:2])
                for place, time in zip(carried[d].position_enu_m, carried[d].time_s, strict=True)
                if time > first
            }
            assert {tuple(place) for place in trees.position[d, base:n, :2]} <= older
        again = threat_trees(tracks, PACKED, None, BOUNDS, carried, with_corners=corners)
        for one, other in zip(arrays_in(trees), arrays_in(again), strict=True):
            assert np.array_equal(one, other)
        grow(trees, rng, 60)
        for d in range(2):
            assert_sound(trees, d)
        carried = grown_trees(trees, tracks)


def test_carried_trees_leave_room_and_keep_the_earliest_with_their_parents():
    rng = np.random.default_rng(2)
    tracks = [track(-400.0, -400.0, velocity=(10.0, 0.0))]
    trees = threat_trees(tracks, PACKED, None, BOUNDS)
    while trees.count[0] < CAPACITY:
        grow(trees, rng, 200)
    carried = grown_trees(trees, tracks)
    assert len(carried[0].time_s) == CAPACITY
    with pytest.raises(ValueError, match="read-only"):
        carried[0].time_s[0] = 1.0
    again = threat_trees(
        [track(-390.0, -400.0, velocity=(10.0, 0.0), stamp=1.0)], PACKED, None, BOUNDS, carried
    )
    n = int(again.count[0])
    base = int(again.corners[0].sum())
    assert 0.5 * KEPT_MAX < n <= KEPT_MAX + base
    assert_sound(again, 0)
    # None of those kept was later than one left out.
    latest = np.sort(carried[0].time_s)[KEPT_MAX]
    stamps = {
        tuple(place): time for place, time in zip(carried[0].position_enu_m, carried[0].time_s, strict=True)
    }
    assert max(stamps[tuple(place)] for place in again.position[0, base:n]) <= latest


def test_trees_of_other_threats_are_not_taken_over():
    tracks = [track(-400.0, -400.0)]
    trees = threat_trees(tracks, PACKED, None, BOUNDS)
    grow(trees, np.random.default_rng(1), 50)
    carried = grown_trees(trees, tracks)
    flying = threat_trees([track(-400.0, -400.0, airborne=True, up=80.0)], PACKED, None, BOUNDS, carried)
    assert flying.count[0] == 1


def test_a_plan_hands_its_trees_on_and_equal_problems_give_equal_plans():
    asked = problem(
        (box("wall", 600.0, 0.0, 650.0, 900.0),),
        tracks=(track(1300.0, 300.0, speed=15.0, velocity=(0.0, 9.0)),),
    )
    first = solve(asked)
    assert len(first.threat_trees) == 1
    tree = first.threat_trees[0]
    assert tree.identity == "system:42"
    assert len(tree.time_s) > 20
    moved = asked.snapshot.with_tracks(
        5.0, [track(1300.0, 345.0, speed=15.0, velocity=(0.0, 9.0), stamp=5.0)]
    )
    start = replace(asked.start, stamp_s=5.0)
    carrying = replace(asked, start=start, snapshot=moved.with_threat_trees(first.threat_trees))
    second, again = solve(carrying), solve(carrying)
    assert np.array_equal(second.path.positions_enu_m, again.path.positions_enu_m)
    assert np.array_equal(second.threat_trees[0].time_s, again.threat_trees[0].time_s)
    # Places of the first plan's tree live on in the second's, later by what the way from the root says.
    before = {tuple(place) for place in tree.position_enu_m}
    kept = [
        (place, time)
        for place, time in zip(
            second.threat_trees[0].position_enu_m, second.threat_trees[0].time_s, strict=True
        )
        if tuple(place) in before
    ]
    assert len(kept) > 10
    for place, time in kept:
        assert time >= 5.0 + math.dist(place[:2], (1300.0, 345.0)) / 15.0 - 1e-9
    fresh = solve(replace(carrying, snapshot=moved))
    assert not np.array_equal(fresh.threat_trees[0].time_s, second.threat_trees[0].time_s)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_the_comparators_trees_start_without_corners(estimator):
    asked = problem(
        (box("wall", 600.0, 0.0, 650.0, 900.0),), tracks=(track(1300.0, 300.0),),
        strategies=Strategies(estimator=estimator),
    )  # fmt: skip
    exploration = Exploration(asked, np.random.default_rng(1))
    assert exploration.pursuers.corners[0, 1] == (2 if estimator is Estimator.EX_RRT else 0)

"""Corners of obstacles and shortest ways round them, against shapely and SciPy's Dijkstra."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

from companion.kernels.arrays import empty_pursuers
from companion.kernels.printed import threat_tree as d
from companion.types.threat import Obstacle
from tests.support.paths import box
from tests.support.worlds import is_blocked, packed

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
SPEED = 20.0


def pursuers_at(x, y, heading=0.0, *, turn=1e-6, up=0.0, airborne=0.0):
    """One DT with a tiny turn radius, so that ways are as long as their lines."""
    trees = empty_pursuers(300, np.array([[SPEED, 150.0, turn, airborne, 40.0]]), np.array(BOUNDS))
    trees.position[0, 0], trees.heading[0, 0], trees.count[0] = (x, y, up), heading, 1
    return trees


def test_corners_of_a_box_by_hand():
    # Out along the diagonal by 3 m: 2.12 m each way.
    out = np.empty((d.MAX_CORNERS, 2))
    prisms = packed((box("b", 0.0, 0.0, 100.0, 50.0, 10.0, 60.0),), BOUNDS)
    bounds = np.array(BOUNDS[:4])
    assert d.corners_of(30.0, prisms, bounds, out) == 4
    a = 3.0 / math.sqrt(2.0)
    assert {(round(x, 6), round(y, 6)) for x, y in out[:4]} == {
        (round(x, 6), round(y, 6)) for x, y in ((-a, -a), (100 + a, -a), (100 + a, 50 + a), (-a, 50 + a))
    }
    assert d.corners_of(5.0, prisms, bounds, out) == 0  # it is driven under
    assert d.corners_of(70.0, prisms, bounds, out) == 0  # and over


@pytest.mark.parametrize("turned", [False, True])
def test_corners_lie_outside_whichever_way_the_polygon_runs(turned):
    shape = ((0.0, 0.0), (200.0, 0.0), (200.0, 60.0), (60.0, 60.0), (60.0, 200.0), (0.0, 200.0))
    polygon = np.array(shape[::-1] if turned else shape)
    prisms = packed((Obstacle("l", polygon, 0.0, 50.0),), BOUNDS)
    out = np.empty((d.MAX_CORNERS, 2))
    n = d.corners_of(0.0, prisms, np.array(BOUNDS[:4]), out)
    assert n == 5  # the inner corner's bisector points into the wall
    ground = shapely.Polygon(shape)
    for place in out[:n]:
        assert 1.0 < ground.distance(shapely.Point(place)) <= 3.0 + 1e-9


def test_the_way_round_a_wall_by_hand():
    # From (-30, 0) to behind a wall of 200 m: over its end at (-3/√2, 100 + 3/√2), then (30 + 3/√2, ...).
    world = packed((box("w", 0.0, -100.0, 30.0, 100.0),), BOUNDS)
    trees = pursuers_at(-30.0, 0.0, math.pi / 2.0)
    d.re_root(trees, 0, (-30.0, 0.0, 0.0), math.pi / 2.0, 5.0, 0.0, True, world)
    assert trees.corners[0].tolist() == [1, 4]
    a = 3.0 / math.sqrt(2.0)
    near = math.hypot(30.0 - a, 100.0 + a)
    assert trees.time[0, 1:5] == pytest.approx(
        5.0 + np.array([near, near, near + 30.0 + 2.0 * a, near + 30.0 + 2.0 * a]) / SPEED, abs=1e-4
    )
    assert (np.diff(trees.time[0, 1:5]) >= 0.0).all()
    # The place (60, 90) is hidden from the corner before the wall by its end, not from the one behind it.
    row = d.corner_towards(trees, 0, 60.0, 90.0, world)
    assert trees.position[0, row, :2] == pytest.approx([30.0 + a, 100.0 + a])
    # Airborne threats fly over; for them there are no corners, nor without being asked for.
    air = pursuers_at(-30.0, 0.0, airborne=1.0, up=50.0)
    d.re_root(air, 0, (-30.0, 0.0, 50.0), 0.0, 5.0, 0.0, True, world)
    assert air.corners[0, 1] == 0
    d.re_root(trees, 0, (-30.0, 0.0, 0.0), 0.0, 6.0, 0.0, False, world)
    assert trees.corners[0, 1] == 0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_corners_are_reached_by_shortest_ways(seed):
    rng = np.random.default_rng(seed)
    boxes = []
    for n in range(int(rng.integers(1, 6))):
        west, south = rng.uniform(-450.0, 250.0, 2)
        boxes.append(
            box(str(n), west, south, west + rng.uniform(20.0, 200.0), south + rng.uniform(20.0, 200.0))
        )
    start = rng.uniform(-550.0, 550.0, 2)
    if is_blocked((*start, 0.0), (*start, 0.0), boxes):
        return
    world = packed(boxes, BOUNDS)
    trees = pursuers_at(*start)
    d.re_root(trees, 0, (*start, 0.0), 0.0, 0.0, 0.0, True, world)
    first, num = trees.corners[0]
    found = trees.position[0, first : first + num, :2]
    places = np.empty((d.MAX_CORNERS, 2))
    everything = places[: d.corners_of(0.0, world, np.array(BOUNDS[:4]), places)]
    # An oracle that shares nothing: lines by shapely, ways by SciPy.
    points = np.vstack([start, everything])
    walls = shapely.union_all([shapely.Polygon(o.polygon_enu_m) for o in boxes])
    n = len(points)
    lengths = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            if i != j and not walls.intersects(shapely.LineString([points[i], points[j]])):
                lengths[i, j] = np.linalg.norm(points[i] - points[j])
    ways = dijkstra(lengths, indices=0)[1:]
    reached = np.isfinite(ways)
    assert num == reached.sum()
    order = np.argsort(ways[reached], kind="stable")
    assert trees.time[0, first : first + num] * SPEED == pytest.approx(ways[reached][order], abs=1e-3)
    assert {tuple(p) for p in found} == {tuple(p) for p in everything[reached]}
    # And the corner that leads to any other place is the one of the shortest way there.
    for x, y in rng.uniform(-550.0, 550.0, (5, 2)):
        through = [
            trees.time[0, j] + math.dist(trees.position[0, j, :2], (x, y)) / SPEED
            for j in range(first, first + num)
            if not is_blocked(trees.position[0, j], (x, y, 0.0), boxes)
        ]
        row = d.corner_towards(trees, 0, x, y, world)
        assert (row >= 0) == bool(through)
        if through:
            at = trees.time[0, row] + math.dist(trees.position[0, row, :2], (x, y)) / SPEED
            assert at == pytest.approx(min(through))


def test_carried_corners_are_not_doubled():
    world = packed((box("w", 0.0, -100.0, 30.0, 100.0),), BOUNDS)
    trees = pursuers_at(-30.0, 0.0)
    for stamp in range(5):
        d.re_root(trees, 0, (-30.0 - stamp, 0.0, 0.0), 0.0, float(stamp), 0.0, True, world)
        assert trees.count[0] == 5
        assert trees.corners[0].tolist() == [1, 4]

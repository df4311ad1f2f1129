"""Distances and intersections with prisms, against shapely and by hand."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from companion.kernels.geometry import prism_distance as g
from companion.kernels.geometry.line_of_sight import line_blocked
from companion.types.threat import Obstacle
from tests.support.paths import box, prism_distance
from tests.support.worlds import is_blocked, packed

# A hook: not convex, with a notch open to the east, standing from 20 to 80 m.
HOOK = Obstacle(
    "hook",
    np.array([[0, 0], [90, 0], [90, 30], [30, 30], [30, 60], [90, 60], [90, 90], [0, 90]], dtype=float),
    20.0,
    80.0,
)
WEDGE = Obstacle("wedge", np.array([[-150.0, -100.0], [-50.0, 20.0], [-150.0, 120.0]]), 0.0, 120.0)
WORLD = (HOOK, WEDGE, box("slab", -200.0, -220.0, 220.0, -200.0, 0.0, 60.0))
PACKED = packed(WORLD)
PRISMS = PACKED
COORDINATE = st.floats(-300.0, 300.0)
HEIGHT = st.floats(0.0, 160.0)
POINT = st.tuples(COORDINATE, COORDINATE, HEIGHT)


def test_distance_to_a_prism_by_hand():
    # Beside the slab's end at (250, -210): 30 m east of its east side. Above it at 100 m: 40 m over its top.
    # At (250, -210, 100): √(30² + 40²) = 50 m.
    assert g.clearance(250.0, -210.0, 30.0, PACKED, 1e4) == pytest.approx(30.0)
    assert g.clearance(200.0, -210.0, 100.0, PACKED, 1e4) == pytest.approx(40.0)
    assert g.clearance(250.0, -210.0, 100.0, PACKED, 1e4) == pytest.approx(50.0)
    assert g.clearance(0.0, -210.0, 30.0, PACKED, 1e4) == 0.0
    # In the notch of the hook, half way between its arms: 15 m.
    assert g.clearance(80.0, 45.0, 50.0, PACKED, 1e4) == pytest.approx(15.0)
    # Below the hook's base: 20 − 5.
    assert g.clearance(15.0, 45.0, 5.0, PACKED, 1e4) == pytest.approx(15.0)


def test_the_limit_is_returned_where_nothing_is_nearer():
    assert g.clearance(250.0, -210.0, 30.0, PACKED, 29.0) == 29.0
    assert g.clearance(1e4, 1e4, 30.0, packed([]), 123.0) == 123.0


@settings(max_examples=300, deadline=None)
@given(POINT)
def test_distance_agrees_with_shapely(point):
    x, y, z = point
    flat = [shapely.Polygon(o.polygon_enu_m).distance(shapely.Point(x, y)) for o in WORLD]
    gaps = [max(o.base_m - z, z - o.top_m, 0.0) for o in WORLD]
    expected = min(math.hypot(f, h) for f, h in zip(flat, gaps, strict=True))
    assert g.clearance(x, y, z, PACKED, 1e4) == pytest.approx(expected, abs=1e-6)
    assert min(prism_distance(point, o) for o in WORLD) == pytest.approx(expected, abs=1e-6)


@settings(max_examples=300, deadline=None)
@given(POINT)
def test_the_distance_field_never_promises_too_much(point):
    exact = g.clearance(*point, PACKED, 1e4)
    bound = g.clearance_bound(*point, PACKED)
    assert bound <= exact + 1e-9
    # Nodes are 7.5 m, 7.5 m and 25 m apart: the nearest is at most 13.6 m away, twice that is lost.
    assert bound >= exact - 2.0 * math.sqrt(3.75**2 + 3.75**2 + 12.5**2) - 1e-9


def test_outside_its_grid_the_field_promises_nothing():
    assert g.clearance_bound(700.0, 0.0, 100.0, PACKED) == 0.0
    assert g.clearance_bound(0.0, 0.0, -100.0, PACKED) == 0.0
    assert g.clearance_bound(0.0, 0.0, 0.0, packed([])) == 0.0


def test_points_in_a_polygon_by_hand():
    first, last = PACKED.offsets[0], PACKED.offsets[1]
    for point, inside in (
        ((15, 45), True),
        ((60, 45), False),
        ((60, 15), True),
        ((60, 75), True),
        ((-1, 45), False),
    ):
        assert g.point_in_polygon(*map(float, point), PACKED.edges, first, last) is inside


@pytest.mark.parametrize(
    ("p", "q", "blocked"),
    [
        ((60, 45, 50), (140, 45, 50), False),  # out of the notch
        ((60, 45, 50), (60, 200, 50), True),  # through the northern arm
        ((60, 45, 50), (60, 200, 300), True),  # at north 60 at 50 + 250·15/155 = 74 m, below the top
        ((60, 45, 50), (60, 200, 400), False),  # at north 60 at 84 m, above it
        ((15, 45, 5), (15, 45, 15), False),  # upright, below the base
        ((15, 45, 5), (15, 45, 30), True),  # upright, into it
        ((-100, 200, 50), (-100, -150, 50), True),  # through the wedge
        ((-100, 200, 130), (-100, -150, 121), False),  # above it
        ((0, -250, 100), (0, -150, 0), True),  # at north -210 at 60 m: touches the top's south part
    ],
)
def test_lines_by_hand(p, q, blocked):
    assert line_blocked(*map(float, p), *map(float, q), PRISMS) is blocked


def offset(obstacle, by):
    """A prism grown on all sides, or shrunk."""
    polygon = shapely.Polygon(obstacle.polygon_enu_m).buffer(by, join_style="mitre")
    corners = np.array(polygon.exterior.coords)[:-1]
    return Obstacle(obstacle.name, corners, obstacle.base_m - by, obstacle.top_m + by)


@settings(max_examples=500, deadline=None)
@given(POINT, POINT)
@example((60.0, 45.0, 50.0), (60.0, 45.0, 100.0))
@example((0.0, 0.0, 2e-311), (0.0, -200.0, 0.0))  # all but level
@example((-60.0, 90.0, 0.0), (-60.0, 90.0, 100.0))  # upright beside the wedge's slope, in its bounding box
def test_lines_agree_with_shapely(p, q):
    grown, shrunk = [offset(o, 1e-6) for o in WORLD], [offset(o, -1e-6) for o in WORLD]
    answer = line_blocked(*p, *q, PRISMS)
    assume(is_blocked(p, q, grown) == is_blocked(p, q, shrunk))  # nothing that only just touches
    assert answer == is_blocked(p, q, WORLD)
    assert answer == line_blocked(*q, *p, PRISMS)


@settings(max_examples=300, deadline=None)
@given(POINT, POINT, st.floats(0.0, 40.0))
def test_a_clear_segment_is_clear_at_every_point(p, q, margin):
    p, q = np.array(p), np.array(q)
    dense = p + np.linspace(0.0, 1.0, 400)[:, None] * (q - p)
    nearest = min(g.clearance(*point, PACKED, 1e4) for point in dense)
    clear = g.segment_clear(*p, *q, PACKED, margin)
    spacing = float(np.linalg.norm(q - p)) / 399
    # It may pass a corner between two of its steps of at least 0.5 m, and no nearer than 0.25 m.
    if nearest < margin - 0.25 - 1e-6:
        assert not clear
    if nearest > margin + 0.5 * spacing + 1e-6:
        assert clear


def test_a_segment_of_no_length_is_a_point():
    assert g.segment_clear(250.0, -210.0, 30.0, 250.0, -210.0, 30.0, PACKED, 29.9)
    assert not g.segment_clear(250.0, -210.0, 30.0, 250.0, -210.0, 30.0, PACKED, 30.1)


SMALL = st.integers(-4, 4).map(float)


@settings(max_examples=500, deadline=None)
@given(st.tuples(SMALL, SMALL, SMALL, SMALL), st.tuples(SMALL, SMALL, SMALL, SMALL))
@example((1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 2.0, 3.0))  # a point in the other's bounding box
@example((0.0, 0.0, 2.0, 2.0), (1.0, 1.0, 4.0, 4.0))  # on one line, overlapping
@example((0.0, 0.0, 1.0, 1.0), (2.0, 2.0, 4.0, 4.0))  # on one line, apart
def test_segments_of_the_plane_on_a_grid_agree_with_shapely(a, b):
    # Whole numbers: every product is exact, so touching and parallel cases are decided, not rounded.
    assume(b[:2] != b[2:])  # edges of polygons have a length
    line = shapely.LineString([b[:2], b[2:]])
    other = shapely.Point(a[:2]) if a[:2] == a[2:] else shapely.LineString([a[:2], a[2:]])
    assert g.edges_cross(*a, *b) == line.intersects(other)


def test_boxes_crossed_by_hand():
    # A line east at north 45, 50 m up, from -40 to 140: crosses the hook's box only, 60 m high, 90 m wide.
    out = np.zeros((4, 2))
    assert g.boxes_on_segment(-40.0, 45.0, 50.0, 140.0, 45.0, 50.0, PACKED, out) == 1
    assert out[0] == pytest.approx([60.0, 90.0])
    # Diagonally, at 45°: the box of 90 by 90 is 90·√2 = 127.28 m wide across the line.
    assert g.boxes_on_segment(-40.0, -40.0, 50.0, 140.0, 140.0, 50.0, PACKED, out) == 1
    assert out[0] == pytest.approx([60.0, 90.0 * math.sqrt(2.0)])
    assert g.boxes_on_segment(-40.0, 45.0, 81.0, 140.0, 45.0, 81.0, PACKED, out) == 0
    assert (
        g.boxes_on_segment(45.0, 45.0, 0.0, 45.0, 45.0, 100.0, PACKED, out) == 1
    )  # upright through the notch


@settings(max_examples=200, deadline=None)
@given(POINT, POINT)
def test_boxes_crossed_agree_with_shapely(p, q):
    bounding = [
        box(o.name, *o.polygon_enu_m.min(axis=0), *o.polygon_enu_m.max(axis=0), o.base_m, o.top_m)
        for o in WORLD
    ]
    expected = sum(is_blocked(p, q, [obstacle]) for obstacle in bounding)
    touching = min(
        prism_distance(np.array(p) + t * (np.array(q) - np.array(p)), o) for o in bounding for t in (0, 1)
    )
    assume(touching > 1e-6 or touching == 0.0)
    assert g.boxes_on_segment(*p, *q, PACKED, np.zeros((4, 2))) == expected

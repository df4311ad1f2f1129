"""Lines among prisms: the kernel against the definition in plain Python and against shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.geometry.line_of_sight import is_rectangle, line_blocked
from companion.kernels.geometry.prism_distance import edges_cross, point_in_polygon
from companion.types.threat import Obstacle
from tests.support.paths import box
from tests.support.worlds import is_blocked, packed

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
SHAPES = (
    box("wall", 0.0, -200.0, 30.0, 200.0, 0.0, 60.0),
    box("bridge", -300.0, 200.0, -150.0, 300.0, 40.0, 80.0),
    Obstacle("wedge", ((100.0, 100.0), (300.0, 150.0), (120.0, 280.0)), 0.0, 120.0),
    Obstacle(  # an L: its box is half empty
        "corner",
        (
            (-400.0, -400.0),
            (-200.0, -400.0),
            (-200.0, -350.0),
            (-350.0, -350.0),
            (-350.0, -200.0),
            (-400.0, -200.0),
        ),
        0.0,
        90.0,
    ),
)
PACKED = packed(SHAPES, BOUNDS)
PRISMS = PACKED
# To a nanometre: nearer to a wall the two tests' rounding errors differ.
POINT = st.tuples(
    *(st.floats(*ends).map(lambda x: round(x, 9)) for ends in ((-500.0, 500.0),) * 2 + ((0.0, 150.0),))
)
COARSE = st.tuples(
    st.sampled_from([-400.0, -300.0, -200.0, 0.0, 15.0, 30.0, 100.0, 300.0]),
    st.sampled_from([-400.0, -350.0, -200.0, 0.0, 200.0, 250.0, 300.0]),
    st.sampled_from([0.0, 20.0, 40.0, 60.0, 80.0, 120.0]),
)


def plainly_blocked(p, q):
    """The definition: the piece between base and top begins in a polygon or crosses one of its sides.

    No boxes and no rectangles: each prism's polygon is looked at in full.
    """
    for o, (base, top) in enumerate(PRISMS.heights.tolist()):
        t0, t1 = 0.0, 1.0
        if p[2] == q[2]:
            if not base <= p[2] <= top:
                continue
        else:
            ends = sorted(((base - p[2]) / (q[2] - p[2]), (top - p[2]) / (q[2] - p[2])))
            t0, t1 = max(t0, ends[0]), min(t1, ends[1])
            if t0 > t1:
                continue
        ax, ay = (p[i] + t0 * (q[i] - p[i]) for i in range(2))
        bx, by = (p[i] + t1 * (q[i] - p[i]) for i in range(2))
        first, last = PRISMS.offsets[o], PRISMS.offsets[o + 1]
        if point_in_polygon(ax, ay, PRISMS.edges, first, last):
            return True
        if any(edges_cross(ax, ay, bx, by, *PRISMS.edges[e]) for e in range(first, last)):
            return True
    return False


@settings(max_examples=500, deadline=None)
@given(POINT, POINT)
def test_lines_agree_with_the_plain_test_and_with_shapely(p, q):
    answer = line_blocked(*p, *q, PRISMS)
    assert answer == plainly_blocked(p, q)
    shifted = [tuple(np.array(q) + offset) for offset in ((1e-6, 1e-6, 1e-6), (-1e-6, 1e-6, -1e-6))]
    if len({is_blocked(p, end, SHAPES) for end in (q, *shifted)}) == 1:  # no touching
        assert answer == is_blocked(p, q, SHAPES)


@settings(max_examples=300, deadline=None)
@given(COARSE, COARSE)
def test_lines_along_walls_and_through_corners_agree_with_the_plain_test(p, q):
    assert line_blocked(*p, *q, PRISMS) == plainly_blocked(p, q)


@pytest.mark.parametrize(("row", "expected"), [(0, True), (1, True), (2, False), (3, False)])
def test_boxes_are_told_from_other_polygons(row, expected):
    first, last = PRISMS.offsets[row], PRISMS.offsets[row + 1]
    assert is_rectangle(PRISMS.edges, first, last) == expected
    polygon = shapely.Polygon(SHAPES[row].polygon_enu_m)
    assert polygon.equals(polygon.envelope) == expected


def test_a_polygon_that_folds_onto_itself_fills_no_box():
    # Four sides along the axes, and yet no rectangle: there and back.
    edges = np.array([[0.0, 0, 10, 0], [10.0, 0, 10, 5], [10.0, 5, 10, 0], [10.0, 0, 0, 0]])
    assert not is_rectangle(edges, 0, 4)

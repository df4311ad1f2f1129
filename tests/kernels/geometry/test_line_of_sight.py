"""Lines among prisms: the quick test against the plain one and against shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.geometry.line_of_sight import is_rectangle, line_blocked, prisms_of
from companion.kernels.geometry.prism_distance import segment_blocked
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
PRISMS = prisms_of(PACKED)
POINT = st.tuples(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(0.0, 150.0))
COARSE = st.tuples(
    st.sampled_from([-400.0, -300.0, -200.0, 0.0, 15.0, 30.0, 100.0, 300.0]),
    st.sampled_from([-400.0, -350.0, -200.0, 0.0, 200.0, 250.0, 300.0]),
    st.sampled_from([0.0, 20.0, 40.0, 60.0, 80.0, 120.0]),
)


@settings(max_examples=500, deadline=None)
@given(POINT, POINT)
def test_lines_agree_with_the_plain_test_and_with_shapely(p, q):
    answer = line_blocked(*p, *q, PRISMS)
    assert answer == segment_blocked(*p, *q, PACKED)
    shifted = [tuple(np.array(q) + offset) for offset in ((1e-6, 1e-6, 1e-6), (-1e-6, 1e-6, -1e-6))]
    if len({is_blocked(p, end, SHAPES) for end in (q, *shifted)}) == 1:  # no touching
        assert answer == is_blocked(p, q, SHAPES)


@settings(max_examples=300, deadline=None)
@given(COARSE, COARSE)
def test_lines_along_walls_and_through_corners_agree_with_the_plain_test(p, q):
    assert line_blocked(*p, *q, PRISMS) == segment_blocked(*p, *q, PACKED)


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

"""Circles that a mission may end in."""

import math

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission.loiter import FIT_TOLERANCE_M, ROUND_PATH, TOUCHING, circles_along
from tests.support.paths import box

BOUNDS = (0.0, 1000.0, 0.0, 1000.0, 50.0, 300.0)
RADIUS, MARGIN, EAST = 125.0, 10.0, 0.5 * math.pi


def circles(place, course=0.0, obstacles=(), offsets=TOUCHING):
    """The circles at one place of a path."""
    places, courses = np.array([place]), np.array([course])
    return circles_along(places, courses, RADIUS, obstacles, BOUNDS, MARGIN, offsets=offsets)[0]


def test_on_both_sides_of_the_path_and_to_the_right_where_both_are_as_free():
    first, second = circles((500.0, 500.0, 100.0))
    np.testing.assert_allclose(first.centre_enu_m, [625.0, 500.0, 100.0])
    np.testing.assert_allclose(second.centre_enu_m, [375.0, 500.0, 100.0])
    assert (first.direction, second.direction) == (1.0, -1.0)


def test_eastwards_the_right_is_the_south():
    first, _ = circles((500.0, 500.0, 100.0), EAST)
    np.testing.assert_allclose(first.centre_enu_m, [500.0, 375.0, 100.0], atol=1e-9)


def test_first_the_side_with_more_room_and_none_where_an_obstacle_stands():
    far, near = (box("wall", east, 300.0, east + 20.0, 700.0) for east in (780.0, 700.0))
    left, right = circles((500.0, 500.0, 100.0), obstacles=[far])
    assert (left.direction, right.direction) == (-1.0, 1.0)
    (only,) = circles((500.0, 500.0, 100.0), obstacles=[near])
    assert only.direction == -1.0


def test_obstacles_far_below_do_not_count():
    low, near = (box("low", 700.0, 300.0, 720.0, 700.0, top=top) for top in (79.0, 81.0))
    assert len(circles((500.0, 500.0, 100.0), obstacles=[low])) == 2
    assert len(circles((500.0, 500.0, 100.0), obstacles=[near])) == 1


def test_a_circle_that_would_leave_the_bounds_is_moved_inside_and_flown_either_way():
    """The left is taken, so the right it is: its centre at 1025 m moves to 875 m, left of the path at 900."""
    wall = box("wall", 680.0, 400.0, 700.0, 600.0)
    first, second = circles((900.0, 500.0, 100.0), obstacles=[wall])
    np.testing.assert_allclose(first.centre_enu_m, [875.0, 500.0, 100.0])
    np.testing.assert_allclose(second.centre_enu_m, first.centre_enu_m)
    assert (first.direction, second.direction) == (-1.0, 1.0)


def test_in_a_street_only_circles_round_the_path_have_room():
    """290 m between two walls, of which a circle needs 270: in the middle, it may be flown either way."""
    street = [box("west", 300.0, 0.0, 355.0, 1000.0), box("east", 645.0, 0.0, 700.0, 1000.0)]
    assert circles((500.0, 500.0, 100.0), obstacles=street) == []
    either = circles((500.0, 500.0, 100.0), obstacles=street, offsets=ROUND_PATH)
    assert [circle.direction for circle in either] == [1.0, -1.0]
    for circle in either:
        np.testing.assert_allclose(circle.centre_enu_m, [500.0, 500.0, 100.0])
    (left,) = circles((560.0, 500.0, 100.0), obstacles=street, offsets=ROUND_PATH)
    np.testing.assert_allclose(left.centre_enu_m, [497.5, 500.0, 100.0])
    assert left.direction == -1.0


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([TOUCHING, ROUND_PATH]), st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 1000.0),
    st.floats(0.0, 1000.0), st.floats(100.0, 900.0), st.floats(100.0, 900.0),
)  # fmt: skip
def test_every_circle_keeps_clear_and_lies_in_the_bounds(offsets, course, east, north, wall_east, wall_north):
    """The first way round a circle is the one that the path leads into."""
    wall = box("wall", wall_east, wall_north, wall_east + 50.0, wall_north + 100.0)
    place, right = np.array([east, north, 100.0]), np.array([math.cos(course), -math.sin(course), 0.0])
    seen = set()
    for circle in circles(place, course, [wall], offsets):
        centre = circle.centre_enu_m
        assert all(RADIUS <= centre[axis] <= 1000.0 - RADIUS for axis in (0, 1))
        away = shapely.Polygon(wall.polygon_enu_m).distance(shapely.Point(centre[:2]))
        assert away >= RADIUS + MARGIN - FIT_TOLERANCE_M
        if tuple(centre) not in seen:
            assert circle.direction * float((centre - place) @ right) >= -1e-6
        seen.add(tuple(centre))

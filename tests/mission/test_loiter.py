"""Where a mission ends in a circle."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission.loiter import circles_beside
from tests.support.paths import box

BOUNDS = (0.0, 1000.0, 0.0, 1000.0, 50.0, 300.0)
RADIUS = 125.0


def beside(*points, course=0.0, obstacles=(), bounds=BOUNDS):
    centre, side, _ = circles(*points, course=course, obstacles=obstacles, bounds=bounds)[0]
    return centre, side


def circles(*points, course=0.0, obstacles=(), bounds=BOUNDS):
    return circles_beside(np.array(points, dtype=float), course, RADIUS, obstacles, bounds)


def test_to_the_right_where_both_sides_are_as_free():
    centre, side = beside((500.0, 300.0, 100.0), (500.0, 500.0, 100.0))
    np.testing.assert_allclose(centre, [625.0, 500.0, 100.0])
    assert side == 1.0


def test_away_from_an_obstacle():
    wall = box("wall", 700.0, 300.0, 720.0, 700.0)
    centre, side = beside((500.0, 300.0, 100.0), (500.0, 500.0, 100.0), obstacles=[wall])
    np.testing.assert_allclose(centre, [375.0, 500.0, 100.0])
    assert side == -1.0


def test_obstacles_far_below_do_not_count():
    low = box("low", 700.0, 300.0, 720.0, 700.0, top=79.0)
    assert beside((500.0, 300.0, 100.0), (500.0, 500.0, 100.0), obstacles=[low])[1] == 1.0
    near = box("near", 700.0, 300.0, 720.0, 700.0, top=81.0)
    assert beside((500.0, 300.0, 100.0), (500.0, 500.0, 100.0), obstacles=[near])[1] == -1.0


def test_away_from_the_bounds():
    assert beside((900.0, 300.0, 100.0), (900.0, 500.0, 100.0))[1] == -1.0


def test_a_circle_that_would_leave_the_bounds_is_moved_inside_and_flown_either_way():
    """The left is taken, so the right it is: its centre at 1025 m moves to 875 m, left of the leg at 900."""
    wall = box("wall", 760.0, 400.0, 780.0, 600.0)
    first, second, third = circles((900.0, 300.0, 100.0), (900.0, 500.0, 100.0), obstacles=[wall])
    np.testing.assert_allclose(first.centre_enu_m, [875.0, 500.0, 100.0])
    np.testing.assert_allclose(second.centre_enu_m, first.centre_enu_m)
    assert (first.direction, second.direction) == (-1.0, 1.0)
    assert first.is_moved
    assert second.is_moved
    np.testing.assert_allclose(third.centre_enu_m, [775.0, 500.0, 100.0])
    assert (third.direction, third.is_moved) == (-1.0, False)


def test_one_waypoint_is_reached_on_the_course_given():
    """Coming from the west, the right is the south."""
    centre, side = beside((500.0, 500.0, 100.0), course=0.5 * math.pi)
    np.testing.assert_allclose(centre, [500.0, 375.0, 100.0], atol=1e-9)
    assert side == 1.0


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 2.0 * math.pi), st.floats(300.0, 700.0), st.floats(300.0, 700.0), st.booleans())
def test_the_last_leg_touches_the_circle_and_turns_its_way(course, east, north, is_walled):
    """Where the bounds leave room: the point reached is on the circle, the leg its tangent there."""
    end = np.array([east, north, 100.0])
    along = np.array([math.sin(course), math.cos(course), 0.0])
    right = np.array([math.cos(course), -math.sin(course), 0.0])
    beacon = end + 200.0 * right
    walls = [box("beacon", *(beacon[:2] - 1.0), *(beacon[:2] + 1.0))] if is_walled else []
    centre, side = beside(end - 100.0 * along, end, obstacles=walls)
    assert np.linalg.norm(centre - end) == pytest.approx(RADIUS)
    assert (centre - end) @ along == pytest.approx(0.0, abs=1e-6)
    assert (centre - end) @ right == pytest.approx(side * RADIUS)
    if is_walled and max(abs(east - 500.0), abs(north - 500.0)) < 50.0:
        assert side == -1.0


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 1000.0), st.floats(0.0, 1000.0))
def test_circles_lie_in_the_bounds_and_are_first_turned_to_their_side(course, east, north):
    """Wherever the leg ends: flown the other way round, the aircraft would have to turn out of it first."""
    end = np.array([east, north, 100.0])
    right = np.array([math.cos(course), -math.sin(course), 0.0])
    found = circles(end - 100.0 * np.array([math.sin(course), math.cos(course), 0.0]), end)
    assert 2 <= len(found) <= 4
    for before, circle in zip([None, *found], found, strict=False):
        centre = circle.centre_enu_m
        assert all(RADIUS <= centre[axis] <= 1000.0 - RADIUS for axis in (0, 1))
        if before is not None and before.centre_enu_m is centre:
            assert circle.direction == -before.direction
        else:
            assert circle.direction * float((centre - end) @ right) >= -1e-6

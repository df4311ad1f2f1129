"""Where an aircraft is on a path, and what is left of it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission.path_progress import Progress, progress_on, rest_of_path, time_at
from tests.mission.made import path_along

STRAIGHT = path_along((250.0, 10))  # a row every 25 m and second, to the north


def test_progress_beside_a_straight():
    progress = progress_on(STRAIGHT, (3.0, 60.0, 100.0))
    assert (progress.row, progress.share, progress.off_track_m) == pytest.approx((2, 0.4, 3.0))
    assert time_at(STRAIGHT, progress) == pytest.approx(2.4)


def test_distance_off_the_path_counts_height():
    assert progress_on(STRAIGHT, (3.0, 60.0, 104.0)).off_track_m == pytest.approx(5.0)


@pytest.mark.parametrize(("north", "row", "share"), [(-40.0, 0, 0.0), (400.0, 9, 1.0)])
def test_before_the_start_and_behind_the_end(north, row, share):
    progress = progress_on(STRAIGHT, (0.0, north, 100.0))
    assert (progress.row, progress.share) == (row, share)
    assert progress.off_track_m == pytest.approx(40.0 if north < 0.0 else 150.0)


def there_and_back():
    """North 500 m, round by half a circle of 20 m, and back 40 m beside."""
    return path_along((500.0, 20), (20.0, math.pi, 4), (500.0, 20))


def test_rows_already_flown_are_not_gone_back_to():
    path = there_and_back()
    assert progress_on(path, (5.0, 250.0, 100.0)).row in (9, 10)
    later = progress_on(path, (5.0, 250.0, 100.0), from_row=24)
    assert later.row >= 24
    assert later.off_track_m == pytest.approx(35.0)


def test_rows_far_ahead_are_not_jumped_to():
    path = there_and_back()
    assert progress_on(path, (36.0, 250.0, 100.0)).row > 24
    near = progress_on(path, (36.0, 250.0, 100.0), 5, 10)
    assert near.row in (9, 10)
    assert near.off_track_m == pytest.approx(36.0)


def test_a_row_beyond_the_last_edge_is_the_last_edge():
    assert progress_on(STRAIGHT, (0.0, 250.0, 100.0), from_row=99).row == 9


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 43), st.floats(0.01, 0.99))
def test_a_point_of_the_path_is_found_on_it(row, share):
    path = there_and_back()
    point = (1.0 - share) * path.positions_enu_m[row] + share * path.positions_enu_m[row + 1]
    progress = progress_on(path, tuple(point), from_row=row)
    assert progress.off_track_m == pytest.approx(0.0, abs=1e-6)
    expected = path.times_s[row] + share * (path.times_s[row + 1] - path.times_s[row])
    assert time_at(path, progress) == pytest.approx(expected, abs=1e-6)


def test_time_between_rows():
    assert time_at(STRAIGHT, Progress(3, 0.25, 0.0)) == pytest.approx(3.25)


def test_the_rest_begins_at_the_next_row_and_is_restamped():
    rest = rest_of_path(STRAIGHT, 2.4, 100.0)
    np.testing.assert_allclose(rest.times_s, 100.0 + np.arange(3, 11) - 2.4)
    np.testing.assert_array_equal(rest.positions_enu_m, STRAIGHT.positions_enu_m[3:])
    columns = ("courses_rad", "climb_angles_rad", "speeds_m_s", "position_covariances_m2")
    for column in (*columns, "collision_free", "threat_levels"):
        np.testing.assert_array_equal(getattr(rest, column), getattr(STRAIGHT, column)[3:])


def test_the_rest_from_a_row_on_keeps_that_row():
    assert len(rest_of_path(STRAIGHT, 4.0, 0.0)) == 7


@pytest.mark.parametrize(("time_s", "rows"), [(8.0, 3), (8.01, None), (10.0, None), (99.0, None)])
def test_fewer_than_three_rows_are_nothing(time_s, rows):
    rest = rest_of_path(STRAIGHT, time_s, 0.0)
    assert (None if rest is None else len(rest)) == rows

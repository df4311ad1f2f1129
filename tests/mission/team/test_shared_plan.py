"""What a shared plan says of where its member is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.mission.team.shared_plan import (
    SharedPlan,
    entering_circle,
    is_newer,
    largest_distance,
    simplified,
)
from tests.mission.team.team_plans import BEGIN_S, plan, zigzag


def test_numbers_begin_again():
    assert is_newer(2, 1)
    assert not is_newer(1, 2)
    assert not is_newer(7, 7)
    assert is_newer(3, 65_530)
    assert not is_newer(65_530, 3)


def test_the_place_before_on_and_after_the_path():
    flown = plan((0, 0, 100), (400, 0, 120))
    assert flown.place_at(BEGIN_S - 5.0) == (0.0, 0.0, 100.0)
    assert flown.place_at(0.5 * (flown.start_s + flown.end_s)) == pytest.approx((200.0, 0.0, 110.0))
    assert flown.place_at(flown.end_s + 1000.0) == (400.0, 0.0, 120.0)


def test_who_circles_is_on_the_plan_anywhere_in_the_disc_and_nowhere_else():
    flown = plan((0, 0, 100), (400, 0, 100))
    assert not flown.is_flown_at((480.0, 0.0, 100.0), flown.end_s - 1.0)
    assert flown.is_flown_at((480.0, 0.0, 107.0), flown.end_s + 1.0)
    assert not flown.is_flown_at((500.0, 0.0, 100.0), flown.end_s + 1.0)
    assert not flown.is_flown_at((400.0, 0.0, 110.0), flown.end_s + 1.0)


@pytest.mark.parametrize(
    "rows", [[], [(0.0, 1.0, 2.0)], [(1.0, 0, 0, 0), (0.0, 0, 0, 0)], [(np.nan, 0, 0, 0)]]
)
def test_rows_that_are_no_path_are_refused(rows):
    with pytest.raises(ValueError, match="rows"):
        SharedPlan(1, 1, np.array(rows, dtype=float), 80.0, 1.0, 1.0)


def test_a_path_to_the_centre_ends_where_it_enters_the_circle():
    rows = plan((0, 0, 100), (1000, 0, 100), (1100, 0, 100)).rows
    entered = entering_circle(rows, 300.0)
    assert entered[:, 1] == pytest.approx([0.0, 800.0, 1100.0])
    assert entered[-1, 0] == entered[-2, 0] == pytest.approx(BEGIN_S + 40.0)
    at_once = entering_circle(rows[1:], 300.0)
    assert at_once[:, 0] == pytest.approx([BEGIN_S + 50.0] * 2)


COORDINATE = st.floats(-2000.0, 2000.0)


@given(
    st.lists(st.tuples(st.floats(1.0, 60.0), COORDINATE, COORDINATE, st.floats(0.0, 300.0)), min_size=1),
    st.floats(0.0, 200.0),
)
def test_a_simplified_path_is_as_near_as_was_asked(steps, within_m):
    rows = np.array(steps)
    rows[:, 0] = np.cumsum(rows[:, 0])
    full, short = (SharedPlan(1, 1, each, 80.0, 1.0, 1.0) for each in (rows, simplified(rows, within_m)))
    level, up = largest_distance(full, short)
    assert max(level, up) <= within_m + 1e-3
    assert len(short.rows) <= len(rows)


def test_rows_on_a_straight_line_at_one_speed_are_left_out():
    places = [(100.0 * k, 0.0, 50.0) for k in range(40)]
    assert len(simplified(plan(*places).rows, 1.0)) == 2
    assert len(simplified(plan(*zigzag(10)).rows, 1.0)) == 11

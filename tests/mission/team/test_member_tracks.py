"""A member as a moving volume: where it told that it flies, and then anywhere in its circle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.mission.team.member_tracks import STOPS_S, may_come_into, track_of_plan
from companion.mission.team.shared_plan import SharedPlan, entering_circle

CENTRE = np.array([700.0, 700.0, 100.0])
LEGS = np.array([[10.0, 700.0, -700.0, 100.0], [80.0, *CENTRE]])
PLAN = SharedPlan(2, 1, entering_circle(LEGS, 80.0), 80.0, 50.0, 10.0)
AREA = np.array([[-1000.0, 1000.0], [-1000.0, 1000.0], [0.0, 200.0]])


@given(st.floats(0.0, 300.0), st.floats(0.0, 200.0), st.floats(0.0, 2.0 * math.pi), st.floats(0.0, 1.0))
def test_the_volume_holds_the_member_at_all_times(now_s, later_s, bearing, share):
    """A member on its legs, and from where it enters its circle on anywhere in it."""
    track, time_s = track_of_plan(PLAN, now_s, 0.0, 150.0, 40.0), now_s + later_s
    place = np.array(PLAN.place_at(time_s))
    if time_s >= PLAN.end_s:
        away = 80.0 * share
        place = CENTRE + np.array([away * math.cos(bearing), away * math.sin(bearing), 0.0])
    volume = track.places_enu_m(np.array([time_s]))[0]
    within = track.circles_m(np.array([time_s]))[0]
    # In the second in which its place moves from the rim to the centre it may be a diameter away.
    slack = 80.0 if PLAN.end_s <= time_s < PLAN.end_s + STOPS_S else 0.0
    assert math.dist(volume[:2], place[:2]) <= within + slack + 1e-6
    assert volume[2] == pytest.approx(100.0)


def test_a_member_whose_plan_has_ended_is_in_its_circle():
    track = track_of_plan(PLAN, 500.0, 0.0, 150.0, 40.0)
    assert track.position_enu_m == tuple(CENTRE)
    assert track.velocity_enu_m_s == (0.0, 0.0, 0.0)
    assert track.circles_m(np.array([500.0, 900.0])) == pytest.approx(80.0)


@pytest.mark.parametrize(
    ("moved", "comes"),
    [
        ((0.0, 0.0, 0.0), True),
        ((0.0, 0.0, 160.0), False),  # 100 + 160 is 60 m above the area: more than 40 m and a margin of 15 m
        ((0.0, 0.0, 150.0), True),
        ((-2300.0, 0.0, 0.0), False),
        (
            (-2000.0, 0.0, 0.0),
            True,
        ),  # Its circle is 220 m beside the area, of 300 m that count.
    ],
)
def test_a_member_far_from_an_area_endangers_nobody_in_it(moved, comes):
    rows = PLAN.rows + np.array([0.0, *moved])
    assert may_come_into(AREA, SharedPlan(2, 1, rows, 80.0, 50.0, 10.0), 150.0, 40.0) is comes

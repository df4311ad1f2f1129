"""A mission does not end in a circle that another member of a team will come near."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from companion.flight.construction.mission_construction import construct
from companion.flight.construction.mission_simulation import is_circle_taken
from companion.mission.team.member_tracks import track_of_plan
from companion.mission.team.shared_plan import SharedPlan
from companion.types.threat import ThreatPicture
from tests.flight.construction.test_cycle import begun, straight
from tests.support.worlds import track

# It flies north at 20 m/s from (0, -1000), is at the origin after 50 s, and ends after 100 s.
ROUTE = np.array([[0.0, 0.0, -1000.0, 100.0], [100.0, 0.0, 1000.0, 100.0], [101.0, 0.0, 1000.0, 100.0]])
MEMBER = replace(
    track(0.0, -1000.0, velocity=(0.0, 20.0), airborne=True, up=100.0, radius=150.0), flies_on=True,
    route=ROUTE, keeps_route=True, clear_up_m=40.0,
)  # fmt: skip


def taken(centre, arrival_s, other=MEMBER, radius=80.0):
    state = SimpleNamespace(picture=ThreatPicture(tracks=(other,)), turn_radius_m=80.0)
    return is_circle_taken(state, np.array(centre), radius, arrival_s)


@pytest.mark.parametrize(
    ("centre", "arrival_s", "expected"),
    [
        ((0.0, 0.0, 100.0), 20.0, True),  # it comes in 30 s,
        ((0.0, 0.0, 100.0), 70.0, False),  # and has passed, 400 m on.
        ((229.0, 0.0, 100.0), 20.0, True),  # 150 m and a radius of 80 m
        ((231.0, 0.0, 100.0), 20.0, False),
        ((0.0, 0.0, 139.0), 20.0, True),
        ((0.0, 0.0, 141.0), 20.0, False),
        ((0.0, 1000.0, 100.0), 500.0, True),  # where it stays
    ],
)
def test_all_later_times_count(centre, arrival_s, expected):
    assert taken(centre, arrival_s) is expected


def test_the_autopilots_own_radius_counts_where_the_mission_names_none():
    assert taken((229.0, 0.0, 100.0), 20.0, radius=0.0)


def test_an_aircraft_that_may_fly_elsewhere_takes_no_circle():
    assert not taken((0.0, 0.0, 100.0), 20.0, replace(MEMBER, keeps_route=False))


def circling(member, east, north):
    """A member that circles at a place for ever, 100 m from its centre."""
    rows = np.array([[0.0, east, north, 100.0], [1.0, east, north, 100.0]])
    return track_of_plan(SharedPlan(member, 0, rows, 100.0, 50.0, 10.0), 0.0, 0.0, 165.0, 40.0)


@pytest.mark.parametrize("sides", [(-300.0, 300.0), (-300.0,), ()])
def test_a_goal_between_circles_of_others_is_passed_to_a_circle_that_is_free(sides):
    others = tuple(circling(2 + number, 1500.0, north) for number, north in enumerate(sides))
    state = replace(begun("team: {members: [1, 2, 3]}"), picture=ThreatPicture(tracks=others))
    found = construct(state, straight(), 37)
    centre, radius = found.waypoints.circle
    assert (found.violations, found.faults.at_end) == ((), False)
    assert found.covered_until_s == pytest.approx(60.0)  # The whole path.
    assert (centre[0] > 1600.0) == (len(sides) == 2)
    for north in sides:
        assert np.hypot(centre[0] - 1500.0, centre[1] - north) > abs(radius) + 100.0 + 165.0


def test_between_two_rows_of_circles_only_one_round_the_path_is_free():
    """One that touches the path would be nearer to a row by its radius."""
    rows = [(east, north) for east in range(0, 2100, 100) for north in (-420.0, 420.0)]
    others = tuple(circling(2 + number, float(east), north) for number, (east, north) in enumerate(rows))
    state = replace(begun("team: {members: [1, 2, 3]}"), picture=ThreatPicture(tracks=others))
    found = construct(state, straight(), 37)
    centre, radius = found.waypoints.circle
    assert (found.violations, found.faults.at_end) == ((), False)
    assert found.covered_until_s == pytest.approx(60.0)
    assert abs(centre[1]) < 1.0
    assert 420.0 - abs(radius) < abs(radius) + 100.0 + 165.0 < 420.0  # Beside the path, and round it.


@pytest.mark.parametrize("landing", [(2500.0, 0.0, 80.0), None])
def test_at_a_goal_that_a_landing_follows_nobody_circles(landing):
    """Then the circles of others count only for what ends before the goal."""
    others = tuple(circling(2 + number, 1500.0, north) for number, north in enumerate((-300.0, 300.0)))
    made = begun("team: {members: [1, 2, 3]}")
    state = replace(made, picture=ThreatPicture(tracks=others), tail_enu_m=landing)
    found = construct(state, straight(), 37)
    assert (found.violations, found.faults.at_end) == ((), False)
    assert found.waypoints.continues_with_operator_items == (landing is not None)
    assert (found.waypoints.positions_enu_m[-1, 0] > 1510.0) == (landing is None)

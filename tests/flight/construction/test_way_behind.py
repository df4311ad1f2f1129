"""The way on behind the last goal belongs to what a team's member flies."""

from dataclasses import replace

import numpy as np
import pytest

from companion.flight.construction.cycle import conclude
from companion.flight.construction.mission_construction import construct
from companion.flight.construction.way_behind import is_way_behind_taken, with_way_behind
from companion.flight.exchange.announced_plan import proposed_plan
from companion.flight.exchange.circle_aside import wanted_plan
from companion.flight.state.decision import Verdict
from companion.flight.state.progress import Start
from companion.mission.operator import Operator
from companion.types.mission import Command, MavFrame, MissionItem
from companion.types.threat import ThreatPicture
from tests.flight.construction.test_circle_taken import circling
from tests.flight.construction.test_cycle import begun, flying, plan, start, state, straight

RADIUS_M = 150.0
CIRCLE = (3500.0, 0.0, 100.0)  # 2 km behind the goal, straight on at 25 m/s.
GOAL_M, PATH_S = 1500.0, 60.0
NEAR = straight().since(16)  # 44 s to the goal


def ended_by(*places):
    """A state whose mission goes on with items at places, each with its command, and a landing far away."""
    made = begun("team: {members: [1, 2]}")
    items = [MissionItem(0, Command.DO_LAND_START, MavFrame.MISSION, (0.0,) * 4, 0, 0, 0.0)]
    for command, place in (*places, (Command.NAV_LAND, (4500.0, 0.0, 0.0))):
        latitude, longitude, altitude = made.mission.frame.global_from_local(*place)
        whole = round(1e7 * latitude), round(1e7 * longitude)
        radius = (0.0, RADIUS_M, 0.0, 0.0) if command == Command.NAV_LOITER_TO_ALT else (0.0,) * 4
        items.append(MissionItem(len(items), command, MavFrame.GLOBAL, radius, *whole, altitude))
    listed = replace(made.mission_list, operator=Operator(tuple(items), 0))
    first = places[0][1] if places else (4500.0, 0.0, 0.0)
    return replace(made, mission_list=listed, tail_enu_m=first, flies_by=False)


IN_A_CIRCLE = (Command.NAV_LOITER_TO_ALT, CIRCLE)


def flown_to_goal(made):
    rows = np.array([[PATH_S, GOAL_M, 0.0, 100.0]])
    return with_way_behind(made, straight(), rows)


def test_it_ends_in_the_circle_with_which_a_landing_begins():
    rows, radius_m = flown_to_goal(ended_by(IN_A_CIRCLE))
    assert radius_m == pytest.approx(RADIUS_M, abs=10.0)
    assert rows[-1, 1:] == pytest.approx(CIRCLE, abs=10.0)
    assert rows[-1, 0] == rows[-2, 0]  # It enters the circle there, which it turns into before its rim.
    assert rows[-1, 0] - PATH_S == pytest.approx((CIRCLE[0] - GOAL_M - radius_m) / 25.0, abs=6.0)
    assert (np.diff(rows[:-1, 0]) > 0.0).all()


def test_it_ends_before_a_landing_that_begins_without_a_circle():
    rows, radius_m = flown_to_goal(ended_by((Command.NAV_WAYPOINT, CIRCLE)))
    assert radius_m == 0.0
    assert rows[-1, 0] - PATH_S == pytest.approx((CIRCLE[0] - GOAL_M) / 25.0, abs=2.0)
    assert rows[-1, 1] == pytest.approx(CIRCLE[0], abs=40.0)


@pytest.mark.parametrize("made", [ended_by(), begun()], ids=["a landing only", "nothing"])
def test_without_a_place_before_the_landing_it_is_not_known(made):
    rows, radius_m = flown_to_goal(made)
    assert (rows.tolist(), radius_m) == ([[PATH_S, GOAL_M, 0.0, 100.0]], 0.0)


def beside(made, *others):
    return replace(made, picture=ThreatPicture(tracks=others))


def crossing(at_s):
    """A member that flies north through (2500, 0) at a time, 25 m/s, and far on."""
    other = circling(2, 2500.0, 5000.0)
    rows = [[at_s - 200.0, 2500.0, -5000.0, 100.0], [at_s + 200.0, 2500.0, 5000.0, 100.0]]
    return replace(other, route=np.array([*rows, [at_s + 201.0, 2500.0, 5000.0, 100.0]]))


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (crossing(PATH_S + 40.0), True),  # The aircraft is there 40 s after the goal.
        (crossing(PATH_S + 60.0), False),  # 20 s and 500 m later
        (crossing(PATH_S + 20.0), False),
        (circling(2, 3500.0, 300.0), True),  # The two circles meet,
        (circling(2, 3500.0, 600.0), False),  # and 600 > 150 + 100 + 165.
        (replace(crossing(PATH_S + 40.0), keeps_route=False), False),  # It passes, and is planned round.
    ],
)
def test_it_is_taken_where_and_when_another_member_comes_near(other, expected):
    assert is_way_behind_taken(beside(ended_by(IN_A_CIRCLE), other), straight()) is expected


def test_while_it_is_taken_a_mission_ends_in_a_circle_from_which_the_goal_is_not_reached():
    free = construct(ended_by(IN_A_CIRCLE), straight(), 37)
    assert free.waypoints.continues_with_operator_items
    assert not free.is_waiting
    made = beside(ended_by(IN_A_CIRCLE), circling(2, 3500.0, 300.0))
    found = construct(made, NEAR, 37)
    assert (found.violations, found.faults.at_end, found.is_waiting) == ((), False, True)
    assert not construct(made, straight(), 37).is_waiting  # The goal is far away still.
    assert not found.waypoints.continues_with_operator_items
    centre, signed_m = found.waypoints.circle
    away_m = np.hypot(centre[0] - GOAL_M, centre[1])
    assert away_m > abs(signed_m) + made.goals[-1].acceptance_radius_m


def test_beside_the_goal_no_mission_waits_any_more():
    made = beside(ended_by(IN_A_CIRCLE), circling(2, 3500.0, 300.0))
    found = construct(made, straight().since(50), 37)
    assert [entry.rule for entry in found.violations] == ["ending"]


def test_an_aircraft_that_waits_already_keeps_its_circle():
    made = beside(ended_by(IN_A_CIRCLE), circling(2, 3500.0, 300.0))
    first = conclude(made, plan(NEAR), start(), None)
    waits = first.constructed.path
    assert first.is_waiting
    assert not made.leads_to_goal(waits)
    circles = flying(made, waits, first.constructed.covered_until_s)
    again = conclude(circles, plan(NEAR), start(), None)
    assert (again.decision.verdict, again.constructed, again.is_waiting) == (Verdict.REJECTED, None, True)
    goes_on = conclude(beside(circles), plan(NEAR), start(), None)
    assert goes_on.constructed.waypoints.continues_with_operator_items
    assert not goes_on.is_waiting


def test_it_is_proposed_and_requested_with_the_path_to_the_goal():
    made = ended_by(IN_A_CIRCLE)
    begins = Start(state(stamp=0.0), None)
    constructed = conclude(made, plan(straight()), begins, None).constructed
    proposed = proposed_plan(made, constructed, state(stamp=-1.0), None, 0.0)
    requested = wanted_plan(made, straight(), 0.0)
    for found in (proposed, requested):
        assert found.radius_m == pytest.approx(RADIUS_M, abs=10.0)
        assert found.rows[-1, 1:] == pytest.approx(CIRCLE, abs=10.0)
        assert found.place_at(PATH_S)[0] == pytest.approx(GOAL_M, abs=30.0)
        assert found.place_at(PATH_S + 40.0)[0] == pytest.approx(2500.0, abs=60.0)

"""A circle out of another member's way: shapely looks whether it is clear of everything, and the nearest."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from companion.config import mission_from_text
from companion.config.sections.team_section import TeamConfig
from companion.flight.exchange.circle_aside import (
    ASIDE_S,
    STEP_M,
    CircleAside,
    circle_aside,
    may_move_aside,
    wanted_plan,
)
from companion.flight.state.flight_state import GOAL_RADIUS_M, StateOwner, after_position, first_state
from companion.flight.state.list_state import FlownPath, ListState, MissionPosition
from companion.flight.state.modes import Mode
from companion.flight.state.team_part import settings_of
from companion.mission.list_layout import new_banks
from companion.mission.team.agreement import Agreement
from companion.types.events import Motion
from companion.types.mission import Command, MavFrame, Mission, MissionItem
from companion.types.state import Ownship
from tests.flight.construction.test_cycle import TWO_GOALS, straight
from tests.mission.team.team_plans import BEGIN_S, FRAME
from tests.mission.team.team_plans import plan as plan_through
from tests.support.paths import path_of

TEAM = TeamConfig(members=(1, 2, 3))
APART_M = TEAM.apart_m + 2.0 * TEAM.tolerance_m
RADIUS_M = 80.0
TOLERANCES_M = (TEAM.tolerance_m, TEAM.tolerance_up_m)
LATER_S = BEGIN_S + 1.0
HERE = (500.0, 0.0, 100.0)
WALL = shapely.box(200.0, 150.0, 800.0, 200.0)
WALLED = """
obstacles:
  - {name: wall, base_m: 0, top_m: 300, polygon_enu_m: [[200, 150], [800, 150], [800, 200], [200, 200]]}
"""


def circling(*others, text=TWO_GOALS):
    """A member that circles at its last goal, and its agreement with two others."""
    mission = mission_from_text(text, "aside.yaml").model_copy(update={"team": TEAM})
    state = first_state(mission, 0.0)
    state = replace(state, mode=Mode.ARRIVED, motion=Motion.MISSION, next_goal=len(state.goals))
    members = {
        member: Agreement(member, TEAM.members, FRAME, settings_of(TEAM), started_s=BEGIN_S)
        for member in TEAM.members
    }
    members[1].announce(circle_at(HERE))
    for other in others:
        members[other.member].announce(other)
        for payload in members[other.member].outgoing(LATER_S):
            members[1].receive(other.member, payload, LATER_S)
    return state, members[1]


def circle_at(place, member=1):
    return plan_through(
        place, place, speed_m_s=1.0, member=member, radius_m=RADIUS_M, tolerances_m=TOLERANCES_M
    )


def through(*places):
    """What member 2 would fly."""
    return plan_through(*places, member=2, radius_m=RADIUS_M, tolerances_m=TOLERANCES_M)


PASSES = through((-800.0, 0.0, 100.0), (1500.0, 0.0, 100.0))


def room_at(place, requested, others=(), wall=None):
    """How much more than needed a circle about a place keeps, by plane geometry [m]."""
    point, wide_m = shapely.Point(place[:2]), RADIUS_M + GOAL_RADIUS_M
    path = shapely.LineString(requested.rows[:, 1:3])
    rooms = [point.distance(path) - wide_m - APART_M]
    rooms.append(point.distance(shapely.Point(requested.rows[-1, 1:3])) - wide_m - APART_M - RADIUS_M)
    rooms += [math.dist(place[:2], other[:2]) - wide_m - APART_M - RADIUS_M for other in others]
    if wall is not None:
        rooms.append(point.distance(wall) - wide_m)
    return min(rooms)


@pytest.mark.parametrize("walled", [False, True])
def test_the_place_is_clear_of_the_request_of_others_and_of_walls_and_hardly_any_is_nearer(walled):
    other = (500.0, -420.0, 100.0)
    state, agreement = circling(circle_at(other, 3), text=TWO_GOALS + WALLED * walled)
    wall = WALL if walled else None
    found = circle_aside(state, agreement, [PASSES], LATER_S)
    assert found[2] == HERE[2]
    assert room_at(found, PASSES, [other], wall) >= -1.0
    nearest_m = math.dist(found, HERE)
    assert nearest_m > APART_M + RADIUS_M
    bearings = np.radians(np.arange(0.0, 360.0, 1.0))
    for away_m in np.arange(5.0, nearest_m - 1.5 * STEP_M, 5.0):
        for bearing in bearings:
            nearer = (HERE[0] + away_m * math.sin(bearing), HERE[1] + away_m * math.cos(bearing), HERE[2])
            assert room_at(nearer, PASSES, [other], wall) < 10.0, nearer


def test_there_may_be_no_such_place():
    """Circles are wanted every 400 m all around."""
    state, agreement = circling()
    steps = range(-2000, 2001, 400)
    places = [(500.0 + east, float(north), 100.0) for east in steps for north in steps]
    assert circle_aside(state, agreement, [through(place, place) for place in places], LATER_S) is None


LEADS_ON = FlownPath(straight(), Mission((), 1, 1), 60.0)  # To the last goal.


def test_only_an_aircraft_that_circles_with_no_way_on_and_that_no_pilot_flies_moves():
    state, agreement = circling()
    assert may_move_aside(state, agreement, None, LATER_S)
    assert not may_move_aside(state, agreement, None, BEGIN_S - 1.0)  # It is on its way there.
    waits = replace(state, mode=Mode.ACTIVE, next_goal=0)
    for other in (
        replace(state, mode=Mode.SUSPENDED),
        replace(waits, flown=LEADS_ON),
        replace(state, motion=Motion.STEERED),
        replace(state, tail_enu_m=(0.0, 0.0, 0.0)),
        replace(state, is_returning=True),
    ):
        assert not may_move_aside(other, agreement, None, LATER_S)
    assert may_move_aside(replace(state, mode=Mode.ACTIVE, is_on_call=True), agreement, None, LATER_S)
    assert may_move_aside(waits, agreement, None, LATER_S)
    assert may_move_aside(replace(waits, tail_enu_m=(0.0, 0.0, 0.0)), agreement, None, LATER_S)
    # The path leads to the goal. The mission covers 40 of its 60 s, and the aircraft is in the circle there.
    ends_before = replace(waits, flown=replace(LEADS_ON, covered_until_s=40.0, row=40))
    assert may_move_aside(ends_before, agreement, None, LATER_S)
    assert not may_move_aside(ends_before, agreement, None, BEGIN_S - 1.0)  # Its next mission may come yet.


@pytest.mark.parametrize("last", [Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM])
def test_one_that_cannot_go_on_to_its_landing_circles_for_good(last):
    """Then its mission ends in a circle, although the operator's items follow it."""
    state, agreement = circling()
    latitude, longitude, altitude = FRAME.global_from_local(*HERE)
    end = MissionItem(
        1, last, MavFrame.GLOBAL, (0.0,) * 4, round(1e7 * latitude), round(1e7 * longitude), altitude
    )
    state = replace(
        state, tail_enu_m=(0.0, 0.0, 60.0), flown=FlownPath(straight(), Mission((end,), 1, 1), 60.0),
        mission_list=replace(state.mission_list, layout=new_banks((end,))),
    )  # fmt: skip
    assert may_move_aside(state, agreement, None, LATER_S) is (last is Command.NAV_LOITER_UNLIM)


class Asked:
    """A member that is requested to move, and what its pilot reads."""

    def __init__(self, **changes):
        state, self.agreement = circling()
        self.owner = StateOwner(replace(state, **changes))
        self.told, self.now_s = [], LATER_S
        asker = Agreement(2, TEAM.members, FRAME, settings_of(TEAM), started_s=BEGIN_S)
        self.asker = asker
        self.aside = CircleAside(
            self.owner, SimpleNamespace(autopilot=SimpleNamespace(current=None)),
            SimpleNamespace(decide=lambda _kind, text, **_more: self.told.append(text)),
        )  # fmt: skip

    def ask(self):
        """Member 2 requests its path once more."""
        self.asker.request(PASSES, self.now_s)
        for payload in self.asker.outgoing(self.now_s):
            self.agreement.receive(2, payload, self.now_s)

    def look(self, after_s=1.0):
        self.now_s += after_s
        return self.aside.look(self.agreement, self.now_s)

    @property
    def left(self):
        return [goal.position_enu_m for goal in self.owner.state.goals_left]


WAITS = {"mode": Mode.ACTIVE, "next_goal": 0}


def test_who_waits_with_goals_left_moves_once_and_flies_them_afterwards():
    asked = Asked(**WAITS)
    own = asked.left
    assert not asked.look()
    asked.ask()
    assert asked.look()
    (place,) = asked.left
    assert place not in own
    assert room_at(place, PASSES) >= -1.0
    asked.ask()
    assert not asked.look()
    assert asked.left == [place]
    assert asked.told == ["moving out of the way of system 2"]
    asked.owner.apply(after_position, Ownship(0.0, place, 0.0, 0.0, 25.0, 25.0))
    assert asked.left == own


def test_a_place_to_which_no_mission_leads_is_given_up_and_not_tried_again_from_the_same_circle():
    asked = Asked(**WAITS)
    own = asked.left
    asked.ask()
    assert asked.look()
    assert not asked.look(ASIDE_S - 1.0)
    assert asked.look(1.0)
    assert asked.left == own
    asked.ask()
    assert not asked.look()
    assert asked.told[1:] == [
        "in the way of system 2: no mission leads to another circle",
        "in the way of system 2, and does not move by itself",
    ]
    asked.agreement.announce(circle_at(HERE))  # It circles anew.
    asked.ask()
    assert asked.look()


def test_who_has_flown_all_its_goals_does_not_give_a_place_up():
    asked = Asked()
    asked.ask()
    assert asked.look()
    place = asked.left
    assert not asked.look(10.0 * ASIDE_S)
    assert asked.left == place


def test_who_is_on_its_way_to_a_goal_is_not_asked():
    asked = Asked(**WAITS, flown=LEADS_ON)
    asked.ask()
    assert not asked.look()
    assert asked.told == []


@pytest.mark.parametrize(("position", "is_told"), [("PAST_GOAL", False), ("ELSEWHERE", True)])
def test_the_pilot_of_one_that_flies_on_to_its_landing_is_not_told_each_time(position, is_told, monkeypatch):
    found = MissionPosition[position]
    monkeypatch.setattr(ListState, "position", lambda _listed, _current: found)
    asked = Asked(motion=Motion.MISSION, tail_enu_m=(0.0, 0.0, 60.0))
    asked.ask()
    assert not asked.look()
    assert bool(asked.told) is is_told


def test_what_is_wanted_is_the_path_from_now_on_and_a_circle_at_its_end():
    state, _ = circling()
    path = path_of(np.array([7.0, 57.0]), np.array([(0.0, 0.0, 100.0), (1000.0, 0.0, 100.0)]), np.zeros(2))
    wanted = wanted_plan(state, path, BEGIN_S)
    assert (wanted.start_s, wanted.end_s) == (BEGIN_S, BEGIN_S + 50.0)
    assert wanted.radius_m == pytest.approx(state.turn_radius_m)
    assert (wanted.tolerance_m, wanted.tolerance_up_m) == TOLERANCES_M

"""The goals of a flight: a place that comes before them, and goals that are won in a team."""

from dataclasses import replace

from companion.flight.state.flight_state import (
    after_goal_dropped,
    after_mode_event,
    after_position,
    after_reload,
)
from companion.flight.state.goals_state import after_auction, after_goal_added, after_return_begun
from companion.flight.state.modes import Mode, ModeEvent
from companion.flight.state.team_part import reached_goals
from tests.flight.construction.test_cycle import OPEN, TWO_GOALS
from tests.flight.construction.test_cycle import state as ownship_at
from tests.flight.state.test_flight_state import begun

ASIDE = (5.0, 5.0, 100.0)


def moving_aside():
    """The state of an aircraft that was at both goals of its mission and then had to circle elsewhere."""
    state = begun(TWO_GOALS)
    state = replace(state, next_goal=2, mode=Mode.ACTIVE)
    return after_goal_added(state, state.region_at(ASIDE))


def test_a_goal_that_is_added_is_the_only_one_left_and_another_one_replaces_it():
    state = moving_aside()
    assert [goal.position_enu_m for goal in state.goals_left] == [ASIDE]
    assert not state.has_arrived
    there = (900.0, 5.0, 100.0)
    state = after_goal_added(replace(state, next_goal=3), state.region_at(there))
    assert [goal.position_enu_m for goal in state.goals_left] == [there]
    assert state.own_goals == begun(TWO_GOALS).goals == state.goals[:2]


def test_a_goal_that_was_added_is_forgotten_with_the_landing_and_with_other_goals():
    state = moving_aside()
    landed = after_mode_event(state, ModeEvent.LANDED)
    assert (landed.goals, landed.next_own, landed.next_goal) == (begun(TWO_GOALS).goals, None, 0)
    same = after_reload(state, state.mission)
    assert [goal.position_enu_m for goal in same.goals_left] == [ASIDE]
    other = after_reload(state, begun(OPEN).mission)
    assert (other.goals, other.next_own, other.next_goal) == (begun(OPEN).goals, None, 0)


def test_a_goal_that_was_added_is_none_of_the_teams():
    """It stays while nothing is won, is not reported as flown, and a goal that is won later follows it."""
    state = replace(moving_aside(), is_on_call=True)
    kept = after_auction(state, (), is_over=False)
    assert kept.goals == state.goals
    at_place = replace(kept, next_goal=3)
    assert reached_goals(at_place) == (0, 1)
    won = after_auction(at_place, (1,), is_over=False)
    assert (won.goals, won.next_own, won.next_goal) == ((*state.own_goals, state.rules.goals[1]), None, 2)


def waiting_aside(tail_enu_m=None):
    """The state of an aircraft that has to circle elsewhere before the second goal of its mission."""
    state = replace(begun(TWO_GOALS), next_goal=1, mode=Mode.ACTIVE, tail_enu_m=tail_enu_m)
    return after_goal_added(state, state.region_at(ASIDE))


def test_at_a_place_that_was_added_the_flight_goes_on_with_the_goals_that_are_left():
    state = waiting_aside()
    assert [goal.position_enu_m for goal in state.goals_left] == [ASIDE]
    assert (state.num_reached, state.num_done, state.has_arrived) == (1, 1, False)
    own = begun(TWO_GOALS).goals
    again = after_position(state, ownship_at(ASIDE[0], ASIDE[1]))
    assert (again.goals, again.next_goal, again.next_own) == (own, 1, None)
    assert again.goals_left[0].position_enu_m == own[1].position_enu_m
    dropped = after_goal_dropped(state)
    assert (dropped.goals, dropped.next_goal, dropped.next_own) == (own, 1, None)


def test_a_mission_ends_at_a_place_that_was_added_and_goes_on_at_the_last_goal():
    """At a place aside the operator's landing does not follow. At the end of a return it may."""
    tail = (2000.0, 0.0, 50.0)
    state = waiting_aside(tail)
    assert not state.continues_behind
    assert after_goal_dropped(state).continues_behind
    ending = after_return_begun(after_goal_dropped(state), state.region_at(ASIDE), None, is_landing=True)
    assert ending.continues_behind


def test_goals_that_are_won_on_the_way_to_a_place_that_was_added_follow_it():
    state = replace(waiting_aside(), is_on_call=True)
    goals = state.rules.goals
    same = after_auction(state, (1,), is_over=False)
    assert (same.goals, same.next_goal, same.next_own) == (state.goals, state.next_goal, state.next_own)
    none = after_auction(state, (), is_over=False)
    assert [goal.position_enu_m for goal in none.goals_left] == [ASIDE]
    there = after_position(none, ownship_at(ASIDE[0], ASIDE[1]))
    assert (there.own_goals, there.goals_left) == (goals[:1], ())
    more = after_auction(there, (1,), is_over=False)
    assert (more.goals, more.next_goal, more.next_own) == (goals, 1, None)


def test_goals_that_are_left_at_a_return_are_given_up_and_not_reached():
    state = replace(begun(TWO_GOALS), next_goal=1, mode=Mode.ACTIVE)
    state = after_return_begun(state, state.region_at(ASIDE), None, is_landing=False)
    assert [goal.position_enu_m for goal in state.goals_left] == [ASIDE]
    at_end = after_position(state, ownship_at(ASIDE[0], ASIDE[1]))
    assert (at_end.goals_left, at_end.is_returning) == ((), True)
    assert at_end.num_done > at_end.num_reached == 1

"""How the goals of a flight change: the operator's, those won in a team, and a place that comes before them.

A place that is not the mission's comes first where a return is planned, or where a member of a team has to
circle elsewhere. Each function maps the state and one event to the next state, as in
:mod:`companion.flight.state.flight_state`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from companion.flight.state.flight_state import FlightState
from companion.flight.state.list_state import FlownPath
from companion.mission.operator import OperatorGoal
from companion.planning.problem import GoalRegion


def after_operator_goals(state: FlightState, goals: Sequence[OperatorGoal]) -> FlightState:
    """Return the state with the operator's waypoints as goals; in the plane, at the mission's level."""
    regions = tuple(state.region_at(goal.position_enu_m) for goal in goals)
    actions, items = tuple(goal.actions for goal in goals), tuple(goal.sequence for goal in goals)
    return replace(state, goals=regions, actions=actions, goal_items=items, next_goal=0, next_own=None)


def after_auction(state: FlightState, won: Sequence[int], *, is_over: bool) -> FlightState:
    """Return the state with the goals that this member has won; it waits until the team's are all flown.

    A place that was added is flown to before them.
    """
    passed, left = state.own_goals[: state.num_reached], tuple(state.rules.goals[number] for number in won)
    is_on_call = not is_over and (not (*passed, *left) or state.tail_enu_m is None)
    after = replace(
        state, goals=(*passed, *left), next_own=None, next_goal=len(passed), is_on_call=is_on_call
    )  # fmt: skip
    if state.next_own is None or (left and not state.goals_left):
        return after
    added = after_goal_added(after, state.goals[-1])
    return added if state.goals_left else replace(added, next_goal=len(added.goals))


def after_goal_added(state: FlightState, place: GoalRegion) -> FlightState:
    """Return the state with a place that is not the mission's as the only goal, until it is reached."""
    own = state.own_goals
    return replace(state, goals=(*own, place), next_own=state.num_reached, next_goal=len(own))


def after_return_begun(
    state: FlightState, place: GoalRegion, flown: FlownPath | None, *, is_landing: bool
) -> FlightState:
    """Return the state with the end of a return as the only goal left; a landing may follow there."""
    tail = state.tail_enu_m if is_landing else None
    return replace(after_goal_added(state, place), is_returning=True, tail_enu_m=tail, flown=flown)


def after_takeover(state: FlightState, sequence: int) -> FlightState:
    """Return the state after the takeover at an item: the goals before it are passed already.

    The item itself is also passed if the operator lets the aircraft hold at it.
    """
    if state.mission_list.was_found_flown:
        return state
    is_held = state.mission.takeover.when == "holding"
    passed = sum(item < sequence or (is_held and item == sequence) for item in state.goal_items)
    return replace(state, next_goal=max(state.next_goal, passed))


def bound_for(state: FlightState, place: GoalRegion) -> FlightState:
    """Return the state as if a place were the only goal, and nothing were flown yet."""
    return replace(
        state, goals=(place,), actions=((),), next_goal=0, next_own=None, flown=None, tail_enu_m=None
    )

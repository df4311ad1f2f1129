"""The state of a flight: each event by one function, and nobody else who writes."""

import ast
import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import mission_from_text
from companion.flight.state import flight_state, goals_state, list_state
from companion.flight.state.flight_state import (
    FlightState,
    StateOwner,
    after_armed_reported,
    after_fences,
    after_mode_event,
    after_position,
    after_reload,
    after_restart,
    after_settings_reported,
    after_swap,
    first_state,
)
from companion.flight.state.goals_state import after_operator_goals
from companion.flight.state.list_state import FlownPath, ListState, after_asked, after_swap_ended
from companion.flight.state.modes import Mode, ModeEvent
from companion.mission.list_layout import new_banks
from companion.mission.mission_id import mission_id
from companion.mission.operator import OperatorGoal
from companion.types.mission import Mission
from companion.types.state import AutopilotSettings, Ownship
from companion.types.threat import Obstacle
from tests.flight.construction.test_cycle import OPEN, TWO_GOALS, WALL, straight
from tests.mission.made import item
from tests.support.paths import box
from tests.support.sources import ROOT, SOURCES, nodes_of

pytestmark = pytest.mark.xdist_group("sources")

COMPANION = ROOT / "companion"
WRITERS = {
    COMPANION / "flight" / "state" / "flight_state.py",
    COMPANION / "flight" / "state" / "goals_state.py",
    COMPANION / "flight" / "state" / "list_state.py",
}


def begun(text=OPEN):
    return first_state(mission_from_text(text, "open.yaml"), 0.0)


def listed(**changes):
    """A list of a home slot and two banks, as it was read."""
    items = tuple(item(n) for n in range(5))
    return replace(ListState(), layout=new_banks(items[:1]), stored=items, **changes)


def changed(before, after):
    """Names of the fields that two values differ in."""
    return {
        field.name
        for field in dataclasses.fields(before)
        if getattr(before, field.name) is not getattr(after, field.name)
    }


# --- takeover


def test_a_takeover_changes_the_mode_alone():
    active = replace(begun(), mode=Mode.ACTIVE)
    taken = after_mode_event(active, ModeEvent.MISSION_NOT_FLOWN)
    assert taken.mode is Mode.SUSPENDED
    assert changed(active, taken) == {"mode"}


def test_handed_back_the_list_is_read_anew_since_others_may_have_used_the_pause():
    suspended = replace(begun(), mode=Mode.SUSPENDED, mission_list=listed())
    back = after_mode_event(suspended, ModeEvent.MISSION_FLOWN)
    assert (back.mode, back.mission_list.suspected) == (Mode.ACTIVE, "a pause")
    assert changed(suspended, back) == {"mode", "mission_list"}


def test_handed_back_with_a_swap_unanswered_that_is_settled_first():
    flown = FlownPath(straight(), Mission((), 1, 1), 60.0)
    order = list_state.PendingSwap(5.0, new_banks((item(0),)), flown, None, 0)
    suspended = replace(begun(), mode=Mode.SUSPENDED, mission_list=after_asked(listed(), order))
    assert after_mode_event(suspended, ModeEvent.MISSION_FLOWN).mission_list.suspected == ""


def test_an_event_without_a_row_changes_nothing():
    state = begun()
    assert after_mode_event(state, ModeEvent.GOAL_REACHED) is state


# --- reload


def test_a_reload_with_a_wall_changes_the_rules_and_nothing_flown():
    state = replace(begun(), flown=FlownPath(straight(), Mission((), 1, 1), 60.0), mission_list=listed())
    assert state.violations_of(straight()) == ()
    again = after_reload(state, mission_from_text(OPEN + WALL, "open.yaml"))
    assert changed(state, again) == {"rules"}
    assert {entry.rule for entry in again.violations_of(straight())} == {"clearance"}


def test_a_reload_with_other_goals_begins_at_the_first_and_lays_the_list_out_anew():
    state = replace(begun(TWO_GOALS), next_goal=1, mission_list=listed())
    again = after_reload(state, mission_from_text(OPEN, "open.yaml"))
    assert (len(again.goals), again.next_goal, again.mission_list.layout) == (1, 0, None)
    same = after_reload(state, mission_from_text(TWO_GOALS, "open.yaml"))
    assert (same.next_goal, same.mission_list.layout) == (1, state.mission_list.layout)


def test_a_reload_keeps_the_fences():
    corners = np.array([[700.0, -100.0], [750.0, -100.0], [750.0, 100.0], [700.0, 100.0]])
    fenced = after_fences(begun(), (Obstacle("fence 1", corners, 0.0, 300.0),))
    again = after_reload(fenced, mission_from_text(OPEN, "open.yaml"))
    assert again.rules.fences == fenced.rules.fences
    assert {entry.rule for entry in again.violations_of(straight())} == {"clearance"}


# --- landing


def test_ten_seconds_disarmed_after_a_flight_are_a_landing():
    state = begun()
    for now_s, is_armed in ((1.0, False), (2.0, True), (60.0, True), (61.0, False)):
        state = after_armed_reported(state, now_s, is_armed=is_armed)
    assert not state.phase.is_over(70.9)
    assert state.phase.is_over(71.0)
    assert changed(begun(), state) >= {"phase"}


# --- restart


def test_a_restart_takes_up_the_path_and_the_goals_reached():
    state, flown = begun(TWO_GOALS), FlownPath(straight(), Mission((), 1, 1), 60.0, 12)
    again = after_restart(after_restart(state, flown), num_goals_reached=1)
    assert (again.flown, again.next_goal) == (flown, 1)
    assert after_restart(again, num_goals_reached=0).next_goal == 1


# --- swaps, goals, positions


def test_once_a_mission_is_flown_it_is_what_is_stored_and_known():
    items = tuple(item(n) for n in range(1, 4))
    flown = FlownPath(straight(), Mission(items, 1, 7), 45.0)
    layout = new_banks((item(0),))
    state = after_swap(replace(begun(), mission_list=listed(is_mixed=True)), layout, flown, None)
    assert (state.flown, state.mission_list.layout) == (flown, layout)
    assert (state.mission_list.stored, state.mission_list.is_mixed) == (items, False)
    assert state.mission_list.identities == {mission_id(items)}


def test_a_swap_broken_off_leaves_no_exchange_and_counts_what_is_pending_from_its_end():
    flown = FlownPath(straight(), Mission((), 1, 1), 60.0)
    order = list_state.PendingSwap(5.0, new_banks((item(0),)), flown, None, 0)
    ended = after_swap_ended(after_asked(listed(is_exchanging=True), order), 9.0)
    assert (ended.is_exchanging, ended.pending.asked_s) == (False, 9.0)


def test_in_the_plane_the_operators_goals_lie_on_the_missions_level():
    state = after_operator_goals(begun(), [OperatorGoal((900.0, 50.0, 340.0), 3, (item(3),))])
    assert [goal.position_enu_m for goal in state.goals] == [(900.0, 50.0, 100.0)]
    assert (state.actions, state.next_goal) == (((item(3),),), 0)


@given(st.lists(st.tuples(st.floats(-200.0, 1800.0), st.floats(-300.0, 300.0)), min_size=1, max_size=20))
def test_goals_passed_and_the_way_along_the_path_never_go_back(places):
    state = replace(begun(TWO_GOALS), flown=FlownPath(straight(), Mission((), 1, 1), 60.0))
    for stamp_s, (east, north) in enumerate(places):
        after = after_position(state, Ownship(stamp_s, (east, north, 100.0), 0.0, 0.0, 25.0, 25.0))
        assert after.next_goal >= state.next_goal
        assert after.flown.row >= state.flown.row
        assert changed(state, after) <= {"next_goal", "flown", "wind_enu_m_s", "wind_std_m_s", "coordination"}
        state = after


# --- one writer


def test_the_state_cannot_be_changed():
    for value in (begun(), ListState(), begun().rules, begun().phase):
        field = dataclasses.fields(value)[0].name
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, field, None)


def test_the_owner_hands_out_what_the_last_transition_made():
    owner = StateOwner(begun())
    assert owner.apply(after_armed_reported, 1.0, is_armed=True) is owner.state
    assert owner.apply_to_list(list_state.after_swap_begun) is owner.listed
    assert owner.state.phase.is_armed
    assert owner.listed.is_exchanging


MODULES = [path for path in SOURCES if path.is_relative_to(COMPANION)]


def calls(path, *names):
    for node in nodes_of(path):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in names:
            yield node


def test_only_transitions_are_applied():
    """What is applied is a function of the three modules, by its name: nothing made up on the spot."""
    modules = (flight_state, goals_state, list_state)
    transitions = {name for module in modules for name in vars(module) if "after_" in name}
    applied = []
    for path in MODULES:
        if path not in WRITERS:
            applied += [ast.unparse(node.args[0]) for node in calls(path, "apply", "apply_to_list")]
    assert len(applied) > 20
    assert set(applied) <= transitions


def test_nobody_else_makes_or_replaces_the_state():
    made = {
        (path.name, ast.unparse(node.func))
        for path in MODULES
        for node in calls(path, FlightState.__name__, ListState.__name__, StateOwner.__name__)
    }
    assert made == {
        ("flight_state.py", "FlightState"),
        ("list_state.py", "ListState"),
        ("composition.py", "StateOwner"),
        ("mission_checks.py", "StateOwner"),  # the doctor's own, of no flight
    }
    fields = {
        field.name
        for kind in (FlightState, ListState)
        for field in dataclasses.fields(kind)
        if field.name not in ("rules", "phase", "goals", "mode", "layout", "operator")
    }
    for path in MODULES:
        if path not in WRITERS:
            for node in calls(path, "replace"):
                named = {keyword.arg for keyword in node.keywords}
                assert not (named & fields and ast.unparse(node.args[0]) in ("state", "listed")), path


def turning(coordination, state):
    return after_position(
        state, Ownship(0.0, (0.0, 0.0, 100.0), 0.0, 0.0, 25.0, 25.0, coordination=coordination)
    )


def test_rules_follow_how_the_aircraft_turns_and_keep_through_other_events():
    first = first_state(mission_from_text(OPEN, "open.yaml"), 0.0)
    same = turning(0.96, first)
    assert same.coordination == 0.96
    assert same.rules is first.rules  # Estimates vary by as much.
    slips = turning(0.7, same)
    assert slips.rules.vehicle.coordination == 0.7
    assert turning(0.74, slips).rules is slips.rules
    assert turning(0.76, slips).rules.vehicle.coordination == 0.76
    fenced = after_fences(slips, (box("fence", 0.0, 0.0, 50.0, 50.0),))
    for after in (
        fenced,
        after_reload(slips, slips.mission),
        after_settings_reported(slips, AutopilotSettings(35.0)),
    ):
        assert after.rules.vehicle.coordination == 0.7


def test_before_the_first_turn_the_mission_file_says_how_the_aircraft_turns():
    text = OPEN.replace("vehicle:", "vehicle:\n  coordination: 0.8", 1)
    state = first_state(mission_from_text(text, "open.yaml"), 0.0)
    assert state.coordination == state.rules.vehicle.coordination == 0.8

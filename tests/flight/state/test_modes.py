"""Who flies: every row of the state table, and that there are no others."""

import itertools
import re

import pytest

from companion.flight.state import modes
from companion.flight.state.modes import Mode, ModeEvent, next_mode

ROWS = {
    (Mode.WAITING, ModeEvent.MISSION_FLOWN): Mode.DEPARTING,
    (Mode.WAITING, ModeEvent.MISSION_NOT_FLOWN): Mode.STANDBY,
    (Mode.STANDBY, ModeEvent.MISSION_FLOWN): Mode.DEPARTING,
    (Mode.STANDBY, ModeEvent.AUTOPILOT_SILENT): Mode.WAITING,
    (Mode.DEPARTING, ModeEvent.TAKEOVER_DUE): Mode.ACTIVE,
    (Mode.DEPARTING, ModeEvent.MISSION_NOT_FLOWN): Mode.STANDBY,
    (Mode.DEPARTING, ModeEvent.AUTOPILOT_SILENT): Mode.WAITING,
    (Mode.ACTIVE, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.ACTIVE, ModeEvent.GOAL_REACHED): Mode.ARRIVED,
    (Mode.ACTIVE, ModeEvent.OTHER_MISSION): Mode.YIELDED,
    (Mode.ACTIVE, ModeEvent.RETURN_FLOWN): Mode.YIELDED,
    (Mode.ACTIVE, ModeEvent.AUTOPILOT_SILENT): Mode.LOST,
    (Mode.ACTIVE, ModeEvent.LANDED): Mode.STANDBY,
    (Mode.LOST, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.LOST, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.LOST, ModeEvent.LANDED): Mode.STANDBY,
    (Mode.YIELDED, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.YIELDED, ModeEvent.LANDED): Mode.STANDBY,
    (Mode.YIELDED, ModeEvent.RETURN_RENEWED): Mode.ACTIVE,
    (Mode.SUSPENDED, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.SUSPENDED, ModeEvent.RETURN_FLOWN): Mode.YIELDED,
    (Mode.SUSPENDED, ModeEvent.LANDED): Mode.STANDBY,
    (Mode.ARRIVED, ModeEvent.GLIDE_BEGUN): Mode.ACTIVE,
    (Mode.ARRIVED, ModeEvent.OTHER_GOALS): Mode.ACTIVE,
    (Mode.ARRIVED, ModeEvent.LANDED): Mode.STANDBY,
}
BACK = (Mode.SUSPENDED, ModeEvent.MISSION_FLOWN)


@pytest.mark.parametrize("may_resume", [True, False])
def test_each_row_is_a_transition_and_what_has_none_changes_nothing(may_resume):
    """Only suspension asks whether it may resume."""
    for mode, event in itertools.product(Mode, ModeEvent):
        has_row = (mode, event) in ROWS and (may_resume or (mode, event) != BACK)
        expected = ROWS[mode, event] if has_row else mode
        assert next_mode(mode, event, may_resume=may_resume) is expected, (mode, event)


def test_arrival_lasts_until_the_landing_a_glide_or_another_goal():
    others = set(ModeEvent) - {ModeEvent.LANDED, ModeEvent.GLIDE_BEGUN, ModeEvent.OTHER_GOALS}
    assert {next_mode(Mode.ARRIVED, event, may_resume=True) for event in others} == {Mode.ARRIVED}


ON_THE_GROUND = [event for event in ModeEvent if event is not ModeEvent.TAKEOVER_DUE]


@pytest.mark.parametrize("before", [Mode.WAITING, Mode.STANDBY, Mode.DEPARTING], ids=lambda mode: mode.name)
def test_nothing_before_the_takeover_suspends(before):
    """Whatever happens in whatever order: uploads, switches, arming and disarming."""
    found = {before}
    while True:
        after = found | {next_mode(mode, event, may_resume=True) for mode in found for event in ON_THE_GROUND}
        if after == found:
            break
        found = after
    assert found <= {Mode.WAITING, Mode.STANDBY, Mode.DEPARTING}


def test_the_docstring_has_the_same_rows():
    """The table a pilot reads is the one that is flown."""
    lines = re.findall(r"^([A-Z]+) {2,}([a-z ]+?) {2,}([A-Z]+)", modes.__doc__, re.MULTILINE)
    pairs = {(Mode[before], ModeEvent(event)): Mode[after] for before, event, after in lines}
    assert pairs == ROWS

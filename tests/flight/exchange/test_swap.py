"""Upload, read back, compare, enter: how each step can fail, and what then is known."""

import asyncio
from dataclasses import replace

import pytest

from companion.errors import NoAutopilotError
from companion.flight.exchange.swap_arduplane import store
from companion.mission.item_difference import difference
from companion.mission.swap import SwapOutcome, enter
from companion.types.mission import Command, MavFrame, Mission
from tests.mission.made import ScriptedLink, item

SPEED = item(
    2, Command.DO_CHANGE_SPEED, frame=MavFrame.MISSION, parameters=(0.0, 24.2, -1.0, 0.0), altitude_m=0.0
)
ITEMS = (item(0), item(1, is_current=True), SPEED, item(3), item(4, Command.NAV_LOITER_UNLIM))
MISSION = Mission(ITEMS, 1, 7)


def changed(sequence, **changes):
    """A list with one item stored differently."""
    return tuple(replace(entry, **changes) if entry.sequence == sequence else entry for entry in ITEMS)


def stored(link):
    return asyncio.run(store(link, MISSION))


def entered(link, entry=lambda: 3, may_act=lambda: True):
    return asyncio.run(enter(link, MISSION, entry, may_act))


def test_a_list_stored_as_sent():
    link = ScriptedLink()
    assert stored(link) == (None, "")
    assert link.calls == ["upload", "read_back"]
    assert link.stored == ITEMS


def test_a_part_of_a_list_is_written_and_the_whole_is_read_back():
    link = ScriptedLink()
    link.stored = changed(3, altitude_m=1.0)
    assert asyncio.run(store(link, MISSION, slice(3, 5))) == (None, "")
    assert link.calls == ["write", "read_back"]
    assert link.stored == ITEMS


def test_a_part_beside_which_something_else_was_changed():
    link = ScriptedLink()
    link.stored = changed(1, altitude_m=1.0)
    outcome, reason = asyncio.run(store(link, MISSION, slice(3, 5)))
    assert outcome is SwapOutcome.DIFFERS
    assert "item 1" in reason


def test_a_refused_upload():
    link = ScriptedLink(upload="TIMEOUT before anything")
    outcome, reason = stored(link)
    assert outcome is SwapOutcome.REFUSED
    assert "TIMEOUT" in reason
    assert link.calls == ["upload", "read_back"]


def test_a_lost_last_acknowledgement_is_seen_to_be_stored():
    assert stored(ScriptedLink(upload="TIMEOUT")) == (None, "")


def test_an_upload_that_broke_off_and_cannot_be_read_back():
    outcome, reason = stored(ScriptedLink(upload="TIMEOUT", read_back="no answer"))
    assert outcome is SwapOutcome.REFUSED
    assert "TIMEOUT" in reason
    assert "no answer" in reason


def test_a_list_that_cannot_be_read_back_is_not_trusted():
    outcome, reason = stored(ScriptedLink(read_back="TIMEOUT"))
    assert (outcome, reason) == (SwapOutcome.REFUSED, "mission read_back: TIMEOUT")


def test_a_list_stored_differently():
    link = ScriptedLink(alter=lambda items: items[:-1])
    assert stored(link) == (SwapOutcome.DIFFERS, "4 items instead of 5")


@pytest.mark.parametrize("call", ["upload", "read_back"])
def test_a_link_without_an_autopilot_refuses(call):
    outcome, reason = stored(ScriptedLink(**{call: NoAutopilotError("MAVSDK did not find the autopilot")}))
    expected = SwapOutcome.REFUSED if call == "read_back" else None  # what was stored reads back as sent
    assert outcome is expected
    assert ("did not find" in reason) is (call == "read_back")


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (ITEMS[:-1], "4 items instead of 5"),
        ((*ITEMS, item(5)), "6 items instead of 5"),
        (changed(3, command=Command.NAV_LOITER_TURNS), "item 3: command 18 instead of 16"),
        (changed(2, command=Command.DO_JUMP), "item 2: command 177 instead of 178"),
        (changed(3, frame=MavFrame.GLOBAL_RELATIVE_ALT), "item 3: frame 3 instead of 5"),
        (changed(3, latitude_e7=ITEMS[3].latitude_e7 + 1), "item 3: stands elsewhere"),
        (changed(4, longitude_e7=0), "item 4: stands elsewhere"),
        (changed(1, altitude_m=684.02), "item 1: altitude 684.02 m instead of 684.0 m"),
    ],
)
def test_what_counts_as_different(read, words):
    assert difference(ITEMS, read) == words


@pytest.mark.parametrize(
    "read",
    [
        ITEMS,
        changed(0, latitude_e7=1, longitude_e7=2, altitude_m=584.0),  # the home slot is the autopilot's
        changed(1, frame=MavFrame.GLOBAL),  # the float form of the same frame
        changed(1, is_current=False),
        changed(1, altitude_m=683.99),  # cut to centimetres
        changed(3, parameters=(0.0, 0.0, 0.0, 0.0)),  # a yaw that was not set
        changed(2, frame=MavFrame.GLOBAL, latitude_e7=9, altitude_m=7.0),  # it has no place
    ],
)
def test_known_roundings_do_not_count(read):
    assert difference(ITEMS, read) == ""


def test_a_terrain_frame_comes_back_in_its_float_form():
    sent = (ITEMS[0], replace(ITEMS[1], frame=MavFrame.GLOBAL_TERRAIN_ALT_INT))
    assert difference(sent, (ITEMS[0], replace(sent[1], frame=MavFrame.GLOBAL_TERRAIN_ALT))) == ""
    assert difference(sent, (ITEMS[0], replace(sent[1], frame=MavFrame.GLOBAL))) != ""


def test_a_relative_frame_comes_back_in_its_float_form():
    sent = (ITEMS[0], replace(ITEMS[1], frame=MavFrame.GLOBAL_RELATIVE_ALT_INT))
    assert difference(sent, (ITEMS[0], replace(sent[1], frame=MavFrame.GLOBAL_RELATIVE_ALT))) == ""
    assert (
        difference(sent, (ITEMS[0], replace(sent[1], frame=MavFrame.GLOBAL)))
        == "item 1: frame 0 instead of 6"
    )


LOITER = replace(ITEMS[4], parameters=(0.0, 0.0, -125.4, None))


@pytest.mark.parametrize(
    ("radius", "words"),
    [
        (-125.0, ""),  # whole metres are kept
        (125.0, "item 4: parameter 3 125 instead of -125.4"),
        (0.0, "item 4: parameter 3 0 instead of -125.4"),
    ],
)
def test_a_loiter_turns_the_way_it_was_checked(radius, words):
    read = replace(LOITER, parameters=(0.0, 0.0, radius, 0.0))
    assert difference((*ITEMS[:4], LOITER), (*ITEMS[:4], read)) == words


@pytest.mark.parametrize(("airspeed", "is_same"), [(24.200001, True), (24.0, False), (34.2, False)])
def test_the_airspeed_is_the_one_sent(airspeed, is_same):
    assert (difference(ITEMS, changed(2, parameters=(0.0, airspeed, -1.0, 0.0))) == "") is is_same


def test_heights_over_terrain_are_the_operators_to_use():
    sent = (ITEMS[0], replace(ITEMS[1], frame=10))
    assert difference(sent, sent) == ""
    assert difference(sent, ITEMS[:2]) == "item 1: frame 5 instead of 10"


@pytest.mark.parametrize("command", [999, Command.NAV_LAND])
def test_commands_that_are_the_operators_own_are_compared_as_others(command):
    sent = (ITEMS[0], item(1, command, parameters=(1.0, 2.0, 3.0, 4.0)))
    assert difference(sent, sent) == ""


def test_entering():
    link = ScriptedLink()
    assert entered(link) == (SwapOutcome.FLOWN, "item 3 of 5")
    assert link.current == 3


def test_a_pilot_who_took_over_meanwhile():
    link = ScriptedLink()
    outcome, _ = entered(
        link, entry=lambda: pytest.fail("asked although it may not act"), may_act=lambda: False
    )
    assert outcome is SwapOutcome.WITHDRAWN
    assert link.calls == []


def test_an_entry_that_was_passed_meanwhile():
    link = ScriptedLink()
    assert entered(link, entry=lambda: None)[0] is SwapOutcome.STALE
    assert link.calls == []


@pytest.mark.parametrize("fault", ["DENIED", NoAutopilotError("no heartbeat of an autopilot was heard")])
def test_a_refused_entry(fault):
    outcome, reason = entered(ScriptedLink(set_current=fault))
    assert outcome is SwapOutcome.REFUSED
    assert str(fault) in reason

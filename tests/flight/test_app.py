"""The whole service against the simulator: what it says on the wire, and that the pilot always wins."""

import itertools
import re

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.flight.state.modes import Mode, ModeEvent
from companion.mission.item_difference import difference
from companion.types.events import MissionCurrent
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

VITAL_STREAMS = {33, 42, 74}  # position, current item, air data
PILOTS = ["FBWA", "LOITER", "RTL"]


def mission(resume="auto"):
    return mission_from_text(FIRST_FLIGHT + f"authority: {{resume: {resume}}}\n", "first-flight.yaml")


def flown(until_s, on_step=lambda harness: None, resume="auto"):
    return SitlHarness(mission(resume)).fly(until_s, on_step)


def at(stamp_s, act):
    """Do something once, at an instant."""
    done = []

    def on_step(harness):
        if harness.now_s >= stamp_s and not done:
            done.append(harness.now_s)
            act(harness)

    return on_step


def switch(stamp_s, mode):
    return at(stamp_s, lambda harness: harness.simulator.set_mode(mode))


def both(*steps):
    return lambda harness: [step(harness) for step in steps]


@pytest.fixture(scope="module")
def undisturbed():
    """25 s in which nobody interferes."""
    return flown(25.0)


def test_heartbeats_every_second_as_a_component_of_the_vehicle(undisturbed):
    beats = undisturbed.said("HEARTBEAT")
    assert {(m.get_srcSystem(), m.get_srcComponent()) for _, m in beats} == {(1, 195)}
    assert {m.type for _, m in beats} == {mavlink.MAV_TYPE_ONBOARD_CONTROLLER}
    assert {m.autopilot for _, m in beats} == {mavlink.MAV_AUTOPILOT_INVALID}
    gaps = np.diff([stamp for stamp, _ in beats])
    assert 23 <= len(beats) <= 25
    np.testing.assert_allclose(gaps, 1.0, atol=0.05)


def test_everything_sent_is_under_the_same_ids_and_numbered_without_gaps(undisturbed):
    messages = [message for _, message in undisturbed.heard]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(1, 195)}
    numbers = [m.get_seq() for m in messages]
    assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(numbers))


def test_streams_are_asked_for(undisturbed):
    asked = {
        int(m.param1): (stamp, m.param2)
        for stamp, m in undisturbed.said("COMMAND_LONG")
        if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
    }
    assert asked.keys() >= VITAL_STREAMS
    assert asked[33][1] == pytest.approx(100_000.0)  # 10 Hz
    assert max(stamp for stamp, _ in asked.values()) < 3.0


def test_what_is_told_is_recorded_with_its_decision(undisturbed):
    texts = [(stamp, m.text) for stamp, m in undisturbed.said("STATUSTEXT")]
    told = [decision for decision in undisturbed.recorder.decisions if decision.told]
    assert [kind for kind in undisturbed.kinds() if kind in ("mode", "swap")][:3] == ["mode", "mode", "swap"]
    for (stamp, text), decision in zip(texts, told, strict=True):
        assert stamp == pytest.approx(decision.stamp_s, abs=0.05)
        assert text == decision.told


def test_a_pilot_reads_little_and_what_matters(undisturbed):
    """A quiet flight of half a minute or so: who flies, and one path."""
    texts = [m.text for _, m in undisturbed.said("STATUSTEXT")]
    paths = [text for text in texts if text.startswith("New path")]
    assert "Planner flies the mission" in texts
    assert len(paths) == 1
    assert re.fullmatch(r"New path, safe\. (Straight on|(Left|Right) turn .+), goal in \d+:\d\d", paths[0])
    assert not any(word in text for text in texts for word in ("cost", "keep", "verdict"))


def test_nobody_is_armed_and_no_mode_is_changed(undisturbed):
    commands = {m.command for _, m in undisturbed.said("COMMAND_LONG")}
    assert commands == {
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_REQUEST_MESSAGE,
        mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
    }
    assert undisturbed.said("SET_MODE") == []
    assert undisturbed.said("ADSB_VEHICLE") == []


def test_what_was_decided_is_what_the_autopilot_holds_and_flies(undisturbed):
    app, autopilot = undisturbed.app, undisturbed.simulator.autopilot
    assert app.num_swaps == len(undisturbed.recorder.missions) >= 1
    first = app.state.mission_list.layout.first_of(app.state.mission_list.layout.flown_index)
    stored = autopilot.mission_items[first : first + app.state.mission_list.layout.size]
    assert difference((None, *app.state.mission_list.layout.flown), (None, *stored)) == ""
    assert first <= autopilot.current_sequence < first + app.state.mission_list.layout.size
    frame = app.state.mission.frame
    uploaded = undisturbed.recorder.missions[-1].positions_enu_m
    places = [
        frame.local_from_global(entry.latitude_e7 * 1e-7, entry.longitude_e7 * 1e-7, entry.altitude_m)
        for entry in stored
        if entry.command == 16
    ]
    np.testing.assert_allclose(places, uploaded, atol=0.03)


@pytest.mark.parametrize("mode", PILOTS)
def test_the_pilot_wins_at_once_and_for_as_long(mode):
    harness = flown(28.0, switch(12.0, mode))
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.changes(before_s=12.0) != []
    assert harness.changes(after_s=12.05) == []
    suspended = [entry for entry in harness.recorder.decisions if entry.kind == "suspended"]
    assert [entry.stamp_s for entry in suspended] == pytest.approx([12.0], abs=0.05)
    assert mode in suspended[0].text
    assert harness.simulator.autopilot.mode == mode
    beats = [stamp for stamp, _ in harness.said("HEARTBEAT") if stamp > 12.5]
    assert len(beats) >= 15


def ending(harness):
    """Decisions, but for what is said of the way back while the pilot flies."""
    aside = ("handback", "no plan", "ready")
    return [entry for entry in harness.recorder.decisions if entry.kind not in aside]


def when(condition, act):
    """Do something once, as soon as something is so; the returned list tells when."""
    done = []

    def on_step(harness):
        if not done and condition(harness):
            done.append(harness.now_s)
            act(harness)

    return on_step, done


@pytest.mark.parametrize(
    ("kind", "number"), [("MISSION_REQUEST_LIST", 1), ("MISSION_ITEM_INT", 1), ("MISSION_ITEM_INT", 20)]
)
def test_the_pilot_wins_in_the_middle_of_a_transfer(kind, number):
    """Once so many messages of it are sent, the pilot switches; not another one follows."""
    step, switched = when(
        lambda harness: len(harness.said(kind)) >= number, lambda harness: harness.simulator.set_mode("FBWA")
    )
    harness = flown(20.0, step)
    assert switched
    is_before = kind == "MISSION_REQUEST_LIST"  # the list is read before the takeover: nothing to suspend
    assert harness.app.mode is (Mode.STANDBY if is_before else Mode.SUSPENDED)
    assert harness.changes(after_s=switched[0] + 0.02) == []
    assert harness.app.num_swaps == 0
    if is_before:
        return
    assert ending(harness)[-1].kind in ("rejected", "suspended")
    if kind == "MISSION_ITEM_INT":
        assert ending(harness)[-1].text.startswith("withdrawn")


def test_an_upload_broken_off_by_the_pilot_is_made_good_later():
    step, broken = when(
        lambda harness: len(harness.said("MISSION_ITEM_INT")) >= 10,
        lambda harness: harness.simulator.set_mode("LOITER"),
    )
    harness = flown(30.0, both(step, switch(8.0, "AUTO")))
    assert broken[0] < 8.0
    assert harness.app.num_swaps >= 1
    banks, items = harness.app.state.mission_list.layout, harness.simulator.autopilot.mission_items
    assert (
        difference((None, *banks.flown), (None, *items[banks.first_of(banks.flown_index) :][: banks.size]))
        == ""
    )


def test_the_pilot_wins_between_the_upload_and_the_entry():
    def is_read_back(harness):
        counts, acks = harness.said("MISSION_COUNT"), harness.said("MISSION_ACK")
        return len(counts) == 2 and harness.app.num_swaps == 1 and acks[-1][0] > counts[-1][0]

    step, switched = when(is_read_back, lambda harness: harness.simulator.set_mode("LOITER"))
    harness = flown(60.0, step)
    assert switched
    assert harness.changes(after_s=switched[0] + 0.02) == []
    assert harness.app.num_swaps == 1
    assert ending(harness)[-1].kind in ("rejected", "suspended")


def test_it_resumes_when_the_pilot_gives_back():
    harness = flown(45.0, both(switch(10.0, "LOITER"), switch(15.0, "AUTO")))
    assert harness.app.mode is Mode.ACTIVE
    assert harness.changes(10.05, 15.0) == []
    planned = [entry.stamp_s for entry in harness.recorder.decisions if entry.plan_ms is not None]
    # At once, from where the pilot left it: reading the list, the plan, the upload and reading it back.
    assert any(15.0 < stamp < 22.0 for stamp in planned)
    assert harness.changes(after_s=15.0) != []
    swaps = [entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "swap"]
    assert any(stamp > 15.0 for stamp in swaps)


def test_it_never_resumes_where_the_mission_file_says_so():
    harness = flown(30.0, both(switch(10.0, "LOITER"), switch(15.0, "AUTO")), resume="never")
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.changes(after_s=10.05) == []


def test_an_entry_whose_answer_is_lost_is_not_overwritten():
    """No answer to DO_SET_MISSION_CURRENT is heard in time; what is flown stays as it is."""
    last, changed = [None], []

    def lose_answers(harness):
        link = harness.app.link.autopilot
        notify = type(link)._notify

        def notify_some(what):
            if getattr(what, "command", 0) != 224 and not isinstance(what, MissionCurrent):
                notify(link, what)

        link._notify = notify_some

    def watch(harness):
        autopilot = harness.simulator.autopilot
        now = autopilot.current_sequence, autopilot.mission_items[autopilot.current_sequence]
        if last[0] is not None and last[0][0] == now[0] and last[0][1] != now[1]:
            changed.append(harness.now_s)
        last[0] = now

    harness = flown(46.0, both(at(0.0, lose_answers), watch))
    assert changed == []
    assert harness.app.num_swaps == len(harness.recorder.missions) >= 1
    assert "no answer" in next(entry.text for entry in harness.recorder.decisions if entry.kind == "rejected")
    banks, current = harness.app.state.mission_list.layout, harness.simulator.autopilot.current_sequence
    first = banks.first_of(banks.flown_index)
    assert first <= current < first + banks.size


def cut(begin_s, end_s):
    def on_step(harness):
        harness.is_cut = begin_s <= harness.now_s < end_s

    return on_step


def test_a_silent_autopilot_is_waited_for():
    modes = {}

    def watch(harness):
        modes.setdefault(harness.app.mode, []).append(harness.now_s)

    harness = flown(45.0, both(cut(11.0, 20.0), watch))
    waiting = [stamp for stamp in modes[Mode.LOST] if stamp > 2.0]
    assert 16.0 < waiting[0] < 18.0  # 5 s after the last heartbeat, seen once a second
    assert 20.0 < waiting[-1] < 21.5
    assert harness.app.mode is Mode.ACTIVE
    assert harness.changes(after_s=20.0) != []
    assert Mode.SUSPENDED not in modes


def test_a_pilot_who_took_over_during_the_silence_is_not_overruled():
    harness = flown(26.0, both(cut(11.0, 20.0), switch(14.0, "FBWA")))
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.changes(after_s=20.0) == []


def test_before_the_first_heartbeat_nothing_is_said():
    harness = flown(5.0, cut(0.0, 99.0))
    spoken = [stamp for stamp, _ in harness.heard if stamp > 0.05]
    assert spoken == []


def test_an_autopilot_that_reboots_is_asked_again():
    harness = flown(20.0, at(10.0, lambda harness: harness.simulator.reboot()))
    asked = [
        stamp
        for stamp, m in harness.said("COMMAND_LONG")
        if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and int(m.param1) == 33
    ]
    assert any(10.0 < stamp < 13.0 for stamp in asked)
    assert harness.app.mode is Mode.ACTIVE


def test_goals_before_the_last_that_were_not_reached_are_told():
    on_the_way = "goals:\n  - {east_m: 900, north_m: 600, up_m: 100}\n"
    two_goals = mission_from_text(FIRST_FLIGHT.replace("goals:\n", on_the_way, 1), "first-flight.yaml")
    past_the_last = at(14.0, lambda harness: harness.app.change(ModeEvent.GOAL_REACHED))
    harness = SitlHarness(two_goals).fly(16.0, past_the_last)
    assert harness.texts("arrived") == ["at the last goal, but 1 before it not reached (AUTO)"]
    assert "At the last goal, 1 before it not reached" in [m.text for _, m in harness.said("STATUSTEXT")]

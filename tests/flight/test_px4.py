"""The whole service against the simulated PX4."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.flight.state.modes import Mode
from companion.mission.mission_id import mission_id
from companion.types.events import Dialect
from sim.mission_types import MissionKind
from tests.flight.test_app import at, both, switch, when
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness


def mission(resume="auto"):
    return mission_from_text(FIRST_FLIGHT + f"authority: {{resume: {resume}}}\n", "first-flight.yaml")


def flown(until_s, on_step=lambda harness: None, prepare=lambda harness: None, resume="auto"):
    harness = SitlHarness(mission(resume), dialect=Dialect.PX4)
    prepare(harness)
    return harness.fly(until_s, on_step)


@pytest.fixture(scope="module")
def undisturbed():
    """45 s in which nobody interferes."""
    return flown(45.0)


def test_missions_are_replaced_and_flown(undisturbed):
    autopilot = undisturbed.simulator.autopilot
    assert undisturbed.app.num_swaps >= 2
    assert undisturbed.texts("rejected") == []
    assert autopilot.mode == "MISSION"
    first, end = undisturbed.app.state.mission_list.layout.flown_span
    assert first <= autopilot.current_sequence < end
    assert (
        mission_id(undisturbed.app.state.flown.mission.items)
        == autopilot.stored_list(MissionKind.MISSION).identity
    )


def test_every_upload_marks_one_item_of_ours(undisturbed):
    items = [m for _, m in undisturbed.said("MISSION_ITEM_INT") if m.current]
    counts = undisturbed.said("MISSION_COUNT")
    assert len(items) == len(counts) == undisturbed.app.num_swaps
    first = undisturbed.app.state.mission_list.layout.flown_span[0]
    assert {m.seq >= first for m in items} == {True}


def test_no_identical_list_is_sent_twice(undisturbed):
    ids = [text.rsplit(" ", 1)[-1] for text in undisturbed.texts("swap")]
    assert len(set(ids)) == len(ids)


def test_the_operators_takeoff_and_landing_survive_every_swap(undisturbed):
    commands = [entry.command for entry in undisturbed.simulator.autopilot.mission_items]
    assert commands[:3] == [22, 16, 17]
    assert commands[-3:] == [189, 31, 21]


def test_nothing_but_missions_and_streams_is_asked(undisturbed):
    assert {m.command for _, m in undisturbed.said("COMMAND_LONG")} <= {
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_REQUEST_MESSAGE,
    }
    assert undisturbed.said("SET_MODE") == []


@pytest.mark.parametrize("mode", ["STABILIZED", "RTL"])
def test_the_pilot_wins_at_once_and_for_as_long(mode):
    harness = flown(28.0, switch(12.0, mode))
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.changes(after_s=12.05) == []


@pytest.mark.parametrize("number", [1, 10])
def test_the_pilot_wins_in_the_middle_of_an_upload_and_the_old_mission_stays(number):
    kept = []

    def take_over(harness):
        kept.append(harness.simulator.autopilot.mission_items)
        harness.simulator.set_mode("LOITER")

    step, switched = when(lambda harness: len(harness.said("MISSION_ITEM_INT")) >= number, take_over)
    harness = flown(12.0, step)
    assert switched
    # The cancellation of the transfer frees the autopilot; it changes nothing.
    assert harness.changes(after_s=switched[0] + 0.025) == []
    assert harness.simulator.autopilot.mission_items == kept[0]


def test_a_mission_that_is_accepted_as_the_pilot_takes_over_is_known_afterwards():
    """The heartbeat of the other mode comes before the MISSION_CURRENT that confirms the upload."""
    before, is_switched = [], []

    def take_over(harness):
        autopilot = harness.simulator.autopilot
        before.append(autopilot.mission_items)
        if not is_switched and len(before) > 1 and before[-1] != before[-2] and harness.app.num_swaps == 1:
            is_switched.append(harness.now_s)
            harness.simulator.set_mode("RTL")

    harness = flown(40.0, take_over)
    assert is_switched
    assert harness.app.mode is Mode.SUSPENDED
    assert "withdrawn: the mode was changed" in harness.texts("rejected")
    assert harness.texts("swap")[-1].endswith("though unanswered")
    listed, autopilot = harness.app.state.mission_list, harness.simulator.autopilot
    assert mission_id(listed.stored) == autopilot.stored_list(MissionKind.MISSION).identity
    assert harness.changes(after_s=is_switched[0] + 0.05) == []


def test_it_resumes_when_the_pilot_gives_back():
    harness = flown(40.0, both(switch(10.0, "LOITER"), switch(15.0, "MISSION")))
    assert harness.app.mode is Mode.ACTIVE
    assert harness.changes(10.05, 15.0) == []
    swaps = [entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "swap"]
    assert any(stamp > 15.0 for stamp in swaps)


def without_landing(harness):
    autopilot = harness.simulator.autopilot
    autopilot.parameters["MIS_TKO_LAND_REQ"] = 0
    autopilot.start(list(autopilot.mission_items[:3]), "MISSION", 1)


def test_a_missing_landing_is_said():
    harness = flown(7.0, prepare=without_landing)
    assert harness.texts("landing") == ["no landing in the autopilot's mission"]
    assert harness.app.num_swaps == 1


def test_a_missing_landing_is_said_before_the_flight():
    def on_the_ground(harness):
        without_landing(harness)
        harness.simulator.set_mode("LOITER")

    harness = flown(6.0, prepare=on_the_ground)
    assert harness.app.mode is Mode.STANDBY
    assert harness.texts("landing") == ["no landing in the autopilot's mission"]
    assert harness.said("MISSION_COUNT") == []


def test_a_mission_that_the_autopilot_will_not_fly_is_told_and_not_fought():
    """Somebody demands a landing after ours has been removed from what is required."""

    def demand(harness):
        harness.simulator.autopilot.parameters["MIS_TKO_LAND_REQ"] = 2

    harness = flown(12.0, at(1.2, demand), prepare=without_landing)
    assert harness.simulator.autopilot.mode == "LOITER"
    assert harness.app.mode is Mode.SUSPENDED
    changes = harness.changes()
    assert harness.changes(after_s=max(stamp for stamp, _ in changes) + 0.02) == []


def test_a_lost_last_acknowledgement_is_made_good_by_mission_current():
    def lose(harness):
        link = harness.app.link.autopilot
        receive = link.receive
        link.receive = lambda frame: None if frame.message_id == 47 else receive(frame)

    harness = flown(20.0, at(0.0, lose))
    assert harness.app.num_swaps >= 1
    autopilot = harness.simulator.autopilot
    identity = autopilot.stored_list(MissionKind.MISSION).identity
    assert mission_id(harness.app.state.flown.mission.items) == identity

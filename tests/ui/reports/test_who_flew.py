"""Who flew when: every state of the service's has its words, and a day is told from its decisions alone."""

from companion.flight.state.decision import MODE_ANNOUNCEMENTS
from companion.flight.state.modes import Mode
from companion.recording.reader import load_recording
from companion.types.record import Decision
from companion.ui.reports.who_flew import WHO, watches, who_flew_table, who_of
from tests.flight.test_app import at, both
from tests.flight.test_flight_day import MISSION_MODE, off, uploaded
from tests.sim.client import plain_mission
from tests.support.sitl_harness import SitlHarness


def test_every_state_says_who_flies():
    """The words that a change is told with, for each of the states."""
    for mode in Mode:
        words = MODE_ANNOUNCEMENTS[mode][1] if mode in MODE_ANNOUNCEMENTS else mode.value
        assert who_of(f"{words} (AUTO)") in WHO.values()


def test_stretches_follow_each_other():
    decisions = [
        Decision(1.0, "mode", "standing by: no mission is flown (LOITER)"),
        Decision(2.0, "takeover", "after item 1"),
        Decision(5.0, "mode", "planning (AUTO)"),
        Decision(6.0, "swap", "first plan, cost 3; item 4"),
        Decision(9.0, "suspended", "another mode is flown (<FBWA>)"),
        Decision(9.0, "handback", "AUTO hands back"),
        Decision(9.5, "handback", "safe, to item 3"),
    ]
    found = watches(decisions, 20.0)
    assert [(watch.from_s, watch.to_s) for watch in found] == [(1.0, 5.0), (5.0, 9.0), (9.0, 20.0)]
    assert [watch.who for watch in found][1:] == ["the service", "the pilot"]
    assert found[0].texts == ("takeover: after item 1",)
    assert found[2].texts == ("handback: AUTO hands back", "handback: safe, to item 3")
    page = who_flew_table(decisions, 20.0, 0.0)
    assert page.count("<tr>") == 4
    assert "&lt;FBWA&gt;" in page


def test_of_a_flight_that_changes_all_the_time_the_first_thousand_stretches_are_told():
    decisions = [Decision(float(k), "mode", "planning (AUTO)") for k in range(1100)]
    found = watches(decisions, 2000.0)
    assert (len(found), found[-1].from_s, found[-1].to_s) == (1000, 999.0, 2000.0)


def test_nothing_recorded_is_said():
    assert "No change" in who_flew_table([], 0.0, 0.0)


def test_a_day_of_three_uploads_and_a_takeover_is_told_from_its_recording(tmp_path):
    harness = SitlHarness(plain_mission(), folder=tmp_path, on_ground=True)
    harness.fly(
        75.0,
        both(
            uploaded(2.0), uploaded(5.0), uploaded(8.0), off(12.0),
            at(40.0, lambda h: h.simulator.set_mode("LOITER")),
            at(60.0, lambda h: h.simulator.set_mode(MISSION_MODE[h.flight.dialect])),
        ),
    )  # fmt: skip
    decisions = load_recording(tmp_path / "flight.tlog").decisions
    assert [watch.who for watch in watches(decisions, 75.0)] == [
        WHO["standing by"], WHO["the operator's mission"], WHO["planning"], WHO["another mode"],
        WHO["planning"],
    ]  # fmt: skip

"""Somebody else flies: what is met ahead is told in time, and a handback is called safe only if it lasts.

Recordings of a real ArduPlane 4.7 in valley.yaml (tests/data/README.md), replayed, and the same in the
simulator, where the flight goes on to its end.
"""

import functools
import re

import pytest

from companion.config import load_mission
from tests.flight.test_app import at, both, switch
from tests.flight.test_operator import BOTH
from tests.sim.client import CONFIGS
from tests.support.recorded import replayed
from tests.support.sitl_harness import SitlHarness

DATA = CONFIGS.parent / "tests" / "data"
VALLEY = load_mission(CONFIGS / "valley.yaml")
SOON_S = re.compile(r"meets .* in (\d+) s: (.*)")


@functools.cache
def decisions(recording):
    _, found = replayed(DATA / f"arduplane-4.7dev-{recording}.tlog", VALLEY)
    return found.decisions


def decided(recording, kind):
    return [(entry.stamp_s, entry.text) for entry in decisions(recording) if entry.kind == kind]


def test_a_real_failsafes_return_into_a_ridge_is_told_at_once():
    """Return begins at 72.2 s and ends in the ridge at 86.2 s of the recording."""
    (stamp, text), *_ = decided("rtl-into-ridge", "ahead")
    assert text.startswith("RTL meets north_ridge_west in ")
    assert 72.2 <= stamp <= 73.2
    assert stamp <= 86.2 - 10.0
    (paused, how), *_ = [entry for entry in decided("rtl-into-ridge", "suspended") if entry[0] > 60.0]
    assert paused == pytest.approx(72.2, abs=0.1)
    assert how == "a failsafe of the autopilot (RTL)"


def test_a_real_circle_beside_a_knoll_is_told_and_its_handback_never_called_safe():
    """LOITER from 120.8 s on leads into the knoll at 127 s; AUTO was chosen at 124.8 s."""
    met = [text for stamp, text in decided("handback-into-knoll", "ahead") if stamp > 120.8]
    assert met[0].startswith("LOITER meets knoll in ")
    told = [text for stamp, text in decided("handback-into-knoll", "handback") if stamp > 120.8]
    assert told
    assert not [text for text in told if text.startswith("safe")]


def test_a_real_engines_stop_is_told_within_five_seconds():
    """The motor's current falls to nothing at 81.1 s; the recorded service says nothing before the impact."""
    (stamp, text), *_ = decided("engine-out", "engine")
    assert text.startswith("no thrust")
    assert 80.6 <= stamp <= 80.6 + 5.0


def texts(harness, after_s=0.0):
    """What the pilot reads, chunks put together."""
    decisions = harness.recorder.decisions
    return [(entry.stamp_s, entry.told) for entry in decisions if entry.told and entry.stamp_s >= after_s]


def until_it_hits(harness):
    harness.is_over = harness.simulator.truth.collision


def engine_stops(harness):
    harness.simulator._scenario.flight.has_thrust = False


@BOTH
@pytest.mark.parametrize("stops_s", [30.0, 49.3, 61.2])
@pytest.mark.thorough
def test_an_engine_that_stops_is_told_within_five_seconds(dialect, stops_s):
    harness = SitlHarness(VALLEY, dialect=dialect).fly(stops_s + 6.0, at(stops_s, engine_stops))
    told = [stamp for stamp, text in texts(harness) if text.startswith("NO THRUST")]
    assert told
    assert stops_s < told[0] <= stops_s + 5.0


@BOTH
def test_a_failsafe_is_not_called_a_pilot(dialect):
    failsafe = at(45.0, lambda harness: harness.simulator.autopilot.fail_safe("RTL"))
    harness = SitlHarness(VALLEY, dialect=dialect).fly(47.0, failsafe)
    told = [text for _, text in texts(harness, 45.0)]
    assert any(text.startswith("Failsafe: autopilot flies RTL") for text in told)
    assert not [text for text in told if text.startswith("Planner paused")]


@pytest.mark.thorough
def test_a_return_that_hits_is_told_ten_seconds_before_and_what_is_advised_keeps_clear():
    """Straight home from here leads through the knoll, twenty seconds later."""
    home = at(100.0, lambda harness: harness.simulator.autopilot.fail_safe("RTL"))
    harness = SitlHarness(VALLEY).fly(150.0, both(until_it_hits, home))
    assert harness.simulator.truth.collision
    hit_s = harness.now_s
    met = [(stamp, SOON_S.search(text)) for stamp, text in texts(harness, 100.0) if " meets " in text]
    stamp, found = met[0]
    assert stamp <= hit_s - 10.0
    assert stamp + float(found[1]) == pytest.approx(hit_s, abs=4.0)
    assert found[2] == "climb or turn"

    def turns(harness):
        harness.simulator.autopilot._go_to((2300.0, 1500.0, 200.0), 150.0)

    obeyed = both(until_it_hits, home, switch(stamp + 3.0, "GUIDED"), at(stamp + 3.1, turns))
    assert not SitlHarness(VALLEY).fly(hit_s + 15.0, obeyed).simulator.truth.collision


@pytest.mark.parametrize("taken_s", [42.0, 48.0, 54.0, 66.0, 72.0])
@pytest.mark.thorough
def test_after_safe_a_handback_within_ten_seconds_hits_nothing(taken_s):
    """The pilot circles; whenever the pilot's last word was safe, AUTO is chosen ten seconds after it."""
    looked = SitlHarness(VALLEY).fly(taken_s + 60.0, switch(taken_s, "LOITER"))
    words = [(stamp, "NOT" not in text) for stamp, text in texts(looked, taken_s) if " from here is " in text]
    spans = zip(words, [*words[1:], (taken_s + 60.0, False)], strict=True)
    lasting = [(begin, end) for (begin, is_safe), (end, _) in spans if is_safe]
    assert lasting
    begin, end = lasting[0]
    back_s = min(end, begin + 10.0) - 0.1
    flown = SitlHarness(VALLEY).fly(
        back_s + 40.0, both(until_it_hits, switch(taken_s, "LOITER"), switch(back_s, "AUTO"))
    )
    assert not flown.simulator.truth.collision


def test_a_return_by_the_checked_path_is_left_alone_until_an_item_of_the_mission_is_chosen():
    def leaves(harness):
        autopilot = harness.simulator.autopilot
        autopilot._set_current(harness.app.state.mission_list.layout.flown_span[0] + 1)

    returns = at(50.0, lambda harness: harness.simulator.autopilot.fail_safe("RTL"))
    reselected = both(switch(60.0, "LOITER"), switch(62.0, "AUTO"))
    ended = both(switch(70.0, "LOITER"), both(at(72.0, leaves), switch(74.0, "AUTO")))
    harness = SitlHarness(VALLEY)
    harness.simulator.autopilot.parameters["RTL_AUTOLAND"] = 4.0
    harness.fly(76.0, both(returns, both(reselected, ended)))
    told = [text for stamp, text in texts(harness, 50.0) if text.startswith(("Auto", "Fail", "Planner"))]
    assert told == [
        "Failsafe: autopilot flies RTL. AUTO resumes", "Autopilot returns by the checked path",
        "Planner flies the mission",
    ]  # fmt: skip
    assert harness.changes(after_s=50.0, before_s=74.0) == []

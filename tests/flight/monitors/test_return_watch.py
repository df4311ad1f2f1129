"""Where a return from here would lead: what is announced in flight, beside the return itself."""

import math
from types import SimpleNamespace

import pytest

from companion.assurance.violation import Violation
from companion.config import load_mission
from companion.flight.monitors import return_watch
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from tests.flight.test_app import at, both, switch
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

VALLEY = load_mission(CONFIGS / "valley.yaml")


def returned(begun_s):
    """The last word about returns before one begins, and whether it hits something."""
    home = at(begun_s, lambda harness: harness.simulator.autopilot.fail_safe("RTL"))

    def hits(harness):
        harness.is_over = harness.simulator.truth.collision

    harness = SitlHarness(VALLEY).fly(begun_s + 60.0, both(hits, home))
    words = [
        entry.text for entry in harness.recorder.decisions
        if entry.kind == "return" and entry.text.startswith("RTL") and entry.stamp_s <= begun_s
    ]  # fmt: skip
    return words[-1] if words else "", harness.simulator.truth.collision


@pytest.mark.parametrize("begun_s", [30.0, 80.0])
def test_where_nothing_was_announced_a_return_hits_nothing(begun_s):
    assert returned(begun_s) == ("", False)


@pytest.mark.parametrize("begun_s", [100.0, 120.0])
def test_where_it_was_called_not_safe_it_hits(begun_s):
    words, has_hit = returned(begun_s)
    assert words.startswith("RTL from here is NOT safe: distance to ")
    assert has_hit


@pytest.mark.thorough
def test_with_a_checked_path_in_the_autopilot_nothing_is_announced():
    harness = SitlHarness(VALLEY, dialect=Dialect.ARDUPILOT)
    harness.simulator.autopilot.parameters["RTL_AUTOLAND"] = 4.0
    harness.fly(130.0)
    assert not [text for text in harness.texts("return") if "NOT safe" in text]
    assert [text for text in harness.texts("return") if text.startswith("stored, ")]


@pytest.mark.parametrize("knows_paths", [True, False])
def test_an_autopilot_that_joins_no_return_path_is_noticed(monkeypatch, knows_paths):
    harness = SitlHarness(VALLEY, dialect=Dialect.ARDUPILOT)
    autopilot = harness.simulator.autopilot
    autopilot.parameters["RTL_AUTOLAND"] = 4.0
    if not knows_paths:
        monkeypatch.setattr(autopilot, "_leave_return", lambda: None)
    harness.fly(36.0, switch(30.0, "RTL"))
    assert [text for text in harness.texts("return") if text.startswith("stored, ")]
    assert harness.texts("return").count("RTL does not join the return path") == (not knows_paths)
    sent = [message.text for _, message in harness.said("STATUSTEXT")]
    assert ("RTL is straight, not by the checked path" in sent) is not knows_paths


def test_in_a_circle_from_one_side_of_which_it_is_not_safe_that_is_read_once(monkeypatch):
    """Three laps of 40 s, each not safe for 12 s; then it is safe for good."""
    wall = Violation("clearance", 0, 4.0, 15.0, "distance to wall [m]")
    monkeypatch.setattr(return_watch, "return_tracks", lambda *_: [])
    monkeypatch.setattr(return_watch, "violations_of", lambda state, _: [wall] if state.is_towards else [])
    state = SimpleNamespace(
        mode=Mode.ACTIVE, phase=SimpleNamespace(is_airborne=True), is_towards=False, turn_radius_m=150.0,
        mission_list=SimpleNamespace(stored=()),
        rules=SimpleNamespace(vehicle=SimpleNamespace(airspeed_cruise_m_s=22.0)),
    )  # fmt: skip
    told = []
    watch = return_watch.ReturnWatch(
        SimpleNamespace(state=state),
        SimpleNamespace(ownship=SimpleNamespace(state=lambda now_s: now_s)),
        SimpleNamespace(current=None),
        SimpleNamespace(decide=lambda _kind, _text, *, tell, **_more: told.append((now_s, tell))),
    )
    for now_s in range(200):
        state.is_towards = now_s < 120 and now_s % 40 < 12
        watch.look(float(now_s))
    lap_s = 2.0 * math.pi * 150.0 / 22.0
    assert told == [(3, "return unsafe"), (92 + math.ceil(lap_s), "return safe")]

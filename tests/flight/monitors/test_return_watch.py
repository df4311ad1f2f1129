"""Where a return from here would lead: what is announced in flight, beside the return itself."""

import pytest

from companion.config import load_mission
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

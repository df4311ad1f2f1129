"""What may happen while a plan is made."""

from dataclasses import replace

from companion.config import mission_from_text
from companion.flight.replanning import replanning
from companion.flight.state.decision import Verdict
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness


def test_no_emergency_plan_is_made_if_the_last_goal_is_gone_while_a_plan_fails(monkeypatch):
    """In a team that shares goals another member took it; a plan to no goal ended the service."""
    harness = SitlHarness(mission_from_text(FIRST_FLIGHT, "first-flight.yaml"))
    conclude, failed_s = replanning.conclude_either, []

    def failing(*arguments, **named):
        found, least_threat = conclude(*arguments, **named)
        if harness.now_s < 20.0:
            return found, least_threat
        failed_s.append(harness.now_s)
        flight = harness.app.replanning._flight
        flight.apply(lambda state: replace(state, goals=(), is_on_call=True))
        refused = replace(found.decision, verdict=Verdict.REJECTED)
        return replace(found, decision=refused, constructed=None), None

    monkeypatch.setattr(replanning, "conclude_either", failing)
    monkeypatch.setattr(replanning, "flown_passes", lambda *_: False)
    harness.fly(40.0)
    assert len(failed_s) == 1

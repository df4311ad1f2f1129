"""What may happen while a plan is made."""

from dataclasses import replace

from companion.config import mission_from_text
from companion.flight.replanning import replanning
from companion.flight.state.decision import Verdict
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness


def refused(found):
    """A conclusion as if the check had refused its path."""
    return replace(found, decision=replace(found.decision, verdict=Verdict.REJECTED), constructed=None)


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
        return refused(found), None

    monkeypatch.setattr(replanning, "conclude_either", failing)
    monkeypatch.setattr(replanning, "flown_passes", lambda *_: False)
    harness.fly(40.0)
    assert len(failed_s) == 1


def test_a_plan_that_does_not_pass_is_made_again_soon_although_the_flown_path_passes(monkeypatch):
    """In an encounter an urgent plan was refused, and the risen threat was left unanswered for 18 s."""
    harness = SitlHarness(mission_from_text(FIRST_FLIGHT, "first-flight.yaml"))
    conclude, judged_s = replanning.conclude_either, []

    def failing_once(*arguments, **named):
        found, least_threat = conclude(*arguments, **named)
        if harness.now_s < 10.0:
            return found, least_threat
        judged_s.append(harness.now_s)
        return (refused(found), None) if len(judged_s) == 1 else (found, least_threat)

    monkeypatch.setattr(replanning, "conclude_either", failing_once)
    harness.fly(60.0)
    first, second, third = judged_s[:3]
    assert 3.0 <= second - first <= 5.0
    assert third - second > 10.0  # the time horizon, because the second one passes

"""When a search ends: by a clock, broken off, or as it was recorded."""

import asyncio
from types import SimpleNamespace

import pytest

from companion.clock import ManualClock
from companion.flight.replanning.plan_maker import LOOK_INTERVAL_S, PlanMaker, plan_request
from companion.planning.plan_runner import (
    InlineRunner,
    PlanBrokenOffError,
    RecordedPlanTiming,
    RecordedRunner,
    StopRule,
    ThreadRunner,
)
from companion.recording.reader import _plan_timing_of


def test_what_is_broken_off_stops_at_the_next_question_and_for_good():
    rule = StopRule(lambda _asked: False)
    assert not rule()
    rule.break_off()
    assert rule()
    assert rule()
    assert (rule.asked, rule.is_stopped, rule.is_broken_off) == (2, True, True)


def test_whoever_lets_its_time_run_out_did_not_break_it_off():
    clock = ManualClock()
    timing = ThreadRunner().timing(clock, 0.5, 1)
    assert not timing.rule()
    clock.advance_to(0.5)
    assert timing.rule()
    assert not timing.is_broken_off


@pytest.mark.parametrize("was", [False, True])
def test_a_replay_stops_where_the_flight_did_and_knows_why(was):
    taken = _plan_timing_of({"asked": 3, "is_stopped": True, "took_s": 0.2, "is_broken_off": was})
    timing = RecordedRunner({7: taken}).timing(ManualClock(1.0), 5.0, 7)
    assert [timing.rule() for _ in range(3)] == [False, False, True]
    assert timing.until_s == pytest.approx(1.2)
    assert timing.is_broken_off is was
    timing.rule.break_off()  # what surprises in a replay ends no search
    assert timing.is_broken_off is was


def made(runner, monkeypatch, *, may_break_off, broken_off_s=None):
    """What comes of a plan that finds nothing to do, and when by the clock."""
    clock, records = ManualClock(), []
    recorder = SimpleNamespace(plan=lambda _now_s, record, _snapshot: records.append(record))
    observer = SimpleNamespace(progress=lambda: None, planned=lambda *_: None)
    maker = PlanMaker(1, runner, clock, recorder, observer)
    run = SimpleNamespace(plan="a plan", plan_ms=1.0, asked=1, is_stopped=False)
    monkeypatch.setattr(maker._planner, "run", lambda _request, _rule: run)
    planning = SimpleNamespace(planning_budget_s=1.0)
    state = SimpleNamespace(
        stamp_s=0.0, position_enu_m=(0.0, 0.0, 0.0), direction_rad=0.0, climb_rad=0.0, airspeed_m_s=25.0
    )
    start = SimpleNamespace(state=state, rest=None)
    flight = SimpleNamespace(rules=SimpleNamespace(mission=SimpleNamespace(planning=planning)), goals_left=())
    request = plan_request(flight, start, SimpleNamespace(stamp_s=0.0))

    async def fly():
        making = asyncio.create_task(maker.make(request, str.upper, may_break_off=may_break_off))
        while not making.done():
            for _ in range(5):
                await asyncio.sleep(0)
            if broken_off_s is not None and clock.now_s() >= broken_off_s and maker.may_break_off:
                maker.break_off("a fence")
            clock.advance_to(round(clock.now_s() + 0.05, 6))
        return await making

    try:
        found = asyncio.run(fly())[1]
    except PlanBrokenOffError as fault:
        found = str(fault)
    return found, clock.now_s(), records[0].is_broken_off


def test_a_plan_is_broken_off_only_where_that_was_allowed(monkeypatch):
    found, at_s, is_reported = made(InlineRunner(), monkeypatch, may_break_off=True, broken_off_s=0.4)
    assert (found, is_reported) == ("a fence", True)
    assert at_s <= 0.4 + LOOK_INTERVAL_S + 0.1
    found, at_s, is_reported = made(InlineRunner(), monkeypatch, may_break_off=False, broken_off_s=0.4)
    assert (found, is_reported) == ("A PLAN", False)
    assert at_s >= 1.0


def test_in_a_replay_it_is_broken_off_as_recorded(monkeypatch):
    for was in (True, False):
        runner = RecordedRunner({1: RecordedPlanTiming(1, 0.3, is_broken_off=was)})
        found, at_s, is_reported = made(
            runner, monkeypatch, may_break_off=True, broken_off_s=None if was else 0.1
        )
        assert is_reported is was
        assert found == ("" if was else "A PLAN")
        assert at_s == pytest.approx(0.35, abs=0.06)

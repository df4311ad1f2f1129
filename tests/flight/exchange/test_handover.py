"""However a handover ends, nobody is asked for its mission any more, unless the autopilot may yet fly it."""

from types import SimpleNamespace

import pytest

from companion.clock import ManualClock
from companion.flight.exchange.handover import Handover
from companion.mission.swap import SwapOutcome
from companion.planning.plan_runner import PlanBrokenOffError

CONSTRUCTED = SimpleNamespace(
    start=SimpleNamespace(state=SimpleNamespace(stamp_s=10.0)), why={},
    waypoints=SimpleNamespace(positions_enu_m=()),
)  # fmt: skip


class Asked:
    """A team that notes what it is told."""

    def __init__(self, conflict=""):
        self.conflict, self.ended = conflict, []

    def propose(self, _constructed):
        return self.conflict

    def end(self, *, is_flown):
        self.ended.append(is_flown)


def handover_of(team, pending=None):
    state = SimpleNamespace(may_act=True, may_write=True, flown=None)
    flight = SimpleNamespace(state=state, listed=SimpleNamespace(pending=pending))
    parts = SimpleNamespace(flight=flight, link=None, clock=ManualClock(), ownship=None)
    announcer = SimpleNamespace(count_rejected=lambda: None, decide=lambda *_args, **_more: None)
    observer = SimpleNamespace(exchanged=lambda _outcome: None)
    protocols = SimpleNamespace(parts=parts, team=team)
    return Handover(protocols, announcer, checkpoint=None, recorder=None, observer=observer)


async def handed_over(handover, monkeypatch, ends):
    async def swap(*_args, **_more):
        if isinstance(ends, Exception):
            raise ends
        return ends, "as it was told"

    monkeypatch.setattr(handover, "swap", swap)
    return await handover.hand_over(CONSTRUCTED, 1, 0.0, 0.0, "")


async def test_a_mission_that_is_given_up_is_withdrawn(monkeypatch):
    team = Asked()
    with pytest.raises(PlanBrokenOffError):
        await handed_over(handover_of(team), monkeypatch, PlanBrokenOffError("a surprise"))
    assert team.ended == [False]


async def test_a_mission_that_is_refused_is_withdrawn(monkeypatch):
    team = Asked()
    assert await handed_over(handover_of(team), monkeypatch, SwapOutcome.REFUSED) is SwapOutcome.REFUSED
    assert team.ended == [False]


async def test_a_mission_that_conflicts_is_not_sent(monkeypatch):
    team = Asked("the path of system 2")
    outcome = await handed_over(handover_of(team), monkeypatch, AssertionError("it was sent"))
    assert outcome is SwapOutcome.REFUSED
    assert team.ended == [False]


async def test_a_mission_that_the_autopilot_may_yet_fly_is_still_asked_for(monkeypatch):
    team = Asked()
    await handed_over(handover_of(team, pending=object()), monkeypatch, SwapOutcome.REFUSED)
    assert team.ended == []

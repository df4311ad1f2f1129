"""Goals that a team shares: all agree whose each is, nothing swings, and all end flown while one lives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import mission_from_text
from companion.config.reload import check_change
from companion.errors import ConfigError
from companion.mission.team.agreement import Agreement
from companion.mission.team.goal_auction import GoalAuction
from companion.mission.team.standing import PayloadError, Standing
from companion.mission.team.wire import GoalBid, bid_payload, read_payload
from tests.mission.team.all_orders import DRAFT
from tests.mission.team.auction_games import AuctionGame, Weather
from tests.mission.team.shared_goal_flights import TEXT, mission_of
from tests.mission.team.team_plans import BEGIN_S, FRAME, SETTINGS

PLACE = st.tuples(st.floats(-3000.0, 3000.0), st.floats(-3000.0, 3000.0))
# Goals are farther apart than two circles (docs/team-agreement.md).
SPOTS = st.tuples(st.integers(-6, 6), st.integers(-6, 6), st.floats(-0.08, 0.08), st.floats(-0.08, 0.08))
GOALS = st.lists(SPOTS, min_size=1, max_size=9, unique_by=lambda spot: spot[:2]).map(
    lambda spots: [(500.0 * (column + east), 500.0 * (row + north)) for column, row, east, north in spots]
)
STARTS = st.lists(PLACE, min_size=2, max_size=5)
WEATHER = st.builds(Weather, loss=st.floats(0.0, 0.4), late_s=st.floats(0.0, 6.0), twice=st.floats(0.0, 0.5))
PACES = st.lists(st.floats(0.5, 1.2), min_size=5, max_size=5)


def in_agreement(game):
    """Whether all believe the same, each goal that is left has one owner, and no flown one has any."""
    found = list(game.lists().values())
    flown = {one.auction.flown for one in game.members.values() if game.now_s < one.dies_s}
    shared = sorted(goal for goals in found[0].values() for goal in goals)
    left = sorted(set(range(len(game.goals))) - set(next(iter(flown))))
    return all(lists == found[0] for lists in found) and len(flown) == 1 and shared == left


def settles(kind, goals, starts, weather, seed):
    """Whether a team agrees after a while in which nobody arrives or is lost, and then bids no more."""
    far = [(40.0 * east, 40.0 * north) for east, north in goals]
    game = AuctionGame(
        [(east + 9000.0, north) for east, north in far], starts, weather, seed, kind=kind, lost_s=math.inf
    )
    game.pass_time(60, moves=False)
    bids = {number: one.auction.transmitted for number, one in game.members.items()}
    agrees = in_agreement(game)
    game.pass_time(30, moves=False)
    return agrees and bids == {number: one.auction.transmitted for number, one in game.members.items()}


FAR = st.tuples(st.floats(300.0, 3000.0), st.floats(-3000.0, 3000.0))


@settings(max_examples=60)
@given(st.lists(FAR, min_size=1, max_size=9), STARTS, WEATHER, st.integers(0, 10**6))
def test_all_agree_whose_each_goal_is_and_then_nothing_changes(goals, starts, weather, seed):
    weather = replace(
        weather, loss=min(weather.loss, 0.25)
    )  # Else a minute is too short for all to hear all.
    assert settles(GoalAuction, goals, starts, weather, seed)


@settings(max_examples=60)
@given(GOALS, STARTS, WEATHER, PACES, st.lists(st.integers(1, 250), max_size=4), st.integers(0, 10**6))
def test_all_goals_end_flown_while_one_lives(goals, starts, weather, paces, deaths, seed):
    game = AuctionGame(goals, starts, weather, seed, paces=paces[: len(starts)])
    for number, at_s in zip(sorted(game.members)[1:], deaths, strict=False):
        game.members[number].dies_s = BEGIN_S + at_s
    assert game.until_over(12_000)
    flown = {goal for one in game.members.values() for goal in one.reached}
    assert flown == set(range(len(goals)))


def as_transmitted(places):
    """Places as bids tell them, so that a flight can be exactly as it was foreseen."""
    latitude, longitude = FRAME.places_from_local(*np.array(places, dtype=float).T)
    return np.column_stack(FRAME.places_from_global(np.round(latitude, 7), np.round(longitude, 7)))


@settings(max_examples=60)
@given(GOALS, STARTS)
def test_while_all_fly_as_foreseen_no_goal_changes_its_owner(goals, starts):
    goals, starts = as_transmitted(goals), as_transmitted(starts)
    ids = range(1, len(starts) + 1)
    members = {m: GoalAuction(m, goals, FRAME, 20.0) for m in ids}

    def look(number, now_s, place, **more):
        members[number].look(now_s, tuple(place), ids, **more)
        for other in members.values():
            other.receive(number, members[number].transmitted, now_s)

    for _ in range(2 * len(starts)):
        for number in ids:
            look(number, BEGIN_S, starts[number - 1])
    foreseen = members[1].lists(ids)
    reached = {number: [] for number in ids}
    while any(len(reached[number]) < len(foreseen[number]) for number in ids):
        flying = [(one._bids[number].arrives, number) for number, one in members.items()
                  if one.transmitted.goal is not None]  # fmt: skip
        tick, number = min(flying)
        reached[number].append(members[number].transmitted.goal)
        look(number, 0.1 * tick, goals[reached[number][-1]], reached=reached[number])
        for one in members.values():
            left = {m: foreseen[m][len(reached[m]):] for m in ids}  # fmt: skip
            assert one.lists(ids) == left


class KeepsWhatCameFirst(GoalAuction):
    """Does not believe that another one has bid again."""

    def receive(self, sender, bid, now_s):
        if sender not in self._bids:
            super().receive(sender, bid, now_s)


class KeepsWhatItWants(GoalAuction):
    """Flies on to its goal although another member is there first."""

    def lists(self, living):
        own = self._bids.get(self._member)
        found = dict(super().lists(living))
        if own is not None and own.bid.goal is not None:
            found[self._member] = (own.bid.goal,)
        return found


class ForgetsToRepeat(GoalAuction):
    """Says everything once."""

    def payloads(self, standing, pacing, now_s):
        if not self._transmissions_left:
            return []
        self._transmissions_left = 0
        return [bid_payload(standing, self.transmitted)]


BESIDE = [(500.0 + 40.0 * n, 30.0 * n) for n in range(6)]


@pytest.mark.parametrize("kind", [KeepsWhatCameFirst, KeepsWhatItWants, ForgetsToRepeat])
def test_members_with_a_fault_do_not_agree(kind):
    weather, starts = Weather(loss=0.3, late_s=20.0), [(0.0, 50.0 * n) for n in range(4)]
    assert all(settles(GoalAuction, BESIDE, starts, replace(weather, loss=0.2), seed) for seed in range(5))
    assert not all(settles(kind, BESIDE, starts, weather, seed) for seed in range(20))


def test_the_goals_of_one_that_is_lost_are_won_by_the_others_and_it_gets_them_back_if_it_comes_first():
    goals = [(1000.0 * n, 500.0) for n in range(6)]
    game = AuctionGame(goals, [(0.0, 0.0), (2500.0, 0.0), (5000.0, 0.0)], Weather(), 1)
    game.pass_time(3)
    orphans = set(game.members[3].goals)
    assert orphans == {4, 5}
    game.members[3].dies_s = game.now_s
    assert game.until_over(2000)
    assert orphans <= {*game.members[1].reached, *game.members[2].reached}


def test_who_returns_home_holds_no_goal_and_what_it_has_flown_stays_flown():
    one, other = (GoalAuction(m, np.array([[900.0, 0.0], [2000.0, 0.0]]), FRAME, 20.0) for m in (1, 2))
    assert one.look(BEGIN_S, (0.0, 0.0), {1}) == (0, 1)
    other.receive(1, one.transmitted, BEGIN_S)
    assert other.look(BEGIN_S, (500.0, 500.0), {1, 2}) == (1,)
    assert one.look(BEGIN_S + 45.0, (900.0, 0.0), {1}, reached=[0], is_available=False) == ()
    other.receive(1, one.transmitted, BEGIN_S + 45.0)
    assert other.flown == (0,)
    assert other.look(BEGIN_S + 46.0, (500.0, 500.0), {1, 2}) == (1,)
    assert other.lists({1, 2}) == {2: (1,)}
    assert one.look(BEGIN_S + 50.0, (900.0, 0.0), {1}) == (1,)  # It is back.


def test_goals_behind_one_that_is_not_reached_go_to_another_member():
    goals = np.array([[1000.0, 0.0], [1300.0, 0.0]])
    one, other = (GoalAuction(m, goals, FRAME, 20.0) for m in (1, 2))
    for seconds in range(200):
        now_s = BEGIN_S + seconds
        mine = one.look(now_s, (600.0, 0.0), {1, 2})
        other.receive(1, one.transmitted, now_s)
        theirs = other.look(now_s, (2600.0, 0.0), {1, 2}, is_available=seconds > 50)
        if seconds > 50:
            one.receive(2, other.transmitted, now_s)
    assert mine == (0,)
    assert theirs == (1,)


def test_a_bid_is_read_as_it_was_written_and_nonsense_is_refused():
    bid = GoalBid(3_000_000_000, 474_000_000, 85_000_000, 44, 7, 1234, True, 1 << 9 | 1)
    payload = bid_payload(Standing(3, 4, is_pending=True), bid)
    assert len(payload) == 24
    message = read_payload(payload)
    assert (message.bid, message.standing) == (bid, Standing(3, 4, is_pending=True))
    away = replace(bid, goal=None, takes_ticks=0, is_available=False)
    assert read_payload(bid_payload(Standing(), away)).bid == away
    for wrong, why in (
        (payload[:20], "bid_length"), (payload + bytes(30), "bid_length"),
        (bid_payload(Standing(), replace(bid, airspeed_steps=0)), "bid"),
        (bid_payload(Standing(), replace(bid, latitude_e7=1_000_000_000)), "bid"),
        (bid_payload(Standing(), replace(bid, goal=220)), "bid"),
    ):  # fmt: skip
        with pytest.raises(PayloadError, match=why):
            read_payload(wrong)


def test_bids_travel_with_the_agreement_and_a_goal_that_there_is_not_is_nobodys():
    goals = np.array([[900.0, 0.0], [900.0, 900.0]])
    members = {
        m: Agreement(
            m, (1, 2), FRAME, SETTINGS, started_s=BEGIN_S, auction=GoalAuction(m, goals, FRAME, 20.0)
        )
        for m in (1, 2)
    }
    for one in members.values():
        one.auction.look(BEGIN_S, (0.0, 0.0), {1, 2})
    for number, one in members.items():
        for payload in one.outgoing(BEGIN_S + 1.0):
            members[3 - number].receive(number, payload, BEGIN_S + 1.0)
    found = [one.auction.look(BEGIN_S + 2.0, (0.0, 0.0), {1, 2}) for one in members.values()]
    assert found == [(0,), (1,)]
    strange = replace(
        members[1].auction.transmitted, tick=members[1].auction.transmitted.tick + 1, goal=99, flown=1 << 80
    )
    members[2].receive(1, bid_payload(Standing(), strange), BEGIN_S + 3.0)
    assert members[2].auction.lists({1, 2}) == {1: (0,), 2: (1,)}


def test_a_lost_member_that_is_forgotten_is_not_kept_clear_of_until_its_plan_is_heard_again():
    one, other = (Agreement(m, (1, 2), FRAME, SETTINGS, started_s=BEGIN_S) for m in (1, 2))
    other.announce(DRAFT)

    def talk(from_s, until_s):
        for now_s in np.arange(BEGIN_S + from_s, BEGIN_S + until_s):
            for payload in other.outgoing(now_s):
                one.receive(2, payload, now_s)
            for payload in one.outgoing(now_s):
                other.receive(1, payload, now_s)

    talk(1.0, 10.0)
    (known,) = one.plans_to_clear()
    one.forget(2)
    assert one.plans_to_clear() == ()
    talk(10.0, 30.0)
    assert [plan.number for plan in one.plans_to_clear()] == [known.number]


def test_shared_goals_have_to_be_listed_once_and_stay_as_they_are_in_flight():
    goal = "  - {east_m: 900, north_m: 900, up_m: 100}"
    for goals, wrong in (("\n".join([goal, goal]), "goals.1"), ("  from_autopilot", "team.share_goals")):
        with pytest.raises(ConfigError) as refused:
            mission_from_text(TEXT.format(goals=goals), "shared.yaml")
        assert refused.value.key == wrong
    running = mission_of(1)
    check_change(running, running.model_copy(update={"description": "another"}), "shared.yaml")
    alone = running.model_copy(update={"team": running.team.model_copy(update={"share_goals": False})})
    for other, wrong in ((mission_of(2), "goals"), (alone, "team.share_goals")):
        with pytest.raises(ConfigError) as refused:
            check_change(running, other, "shared.yaml")
        assert refused.value.key == wrong

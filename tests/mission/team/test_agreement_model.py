"""No order of messages makes three members break the agreement; members with a fault are found out."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission.team.agreement import Agreement, Outcome
from tests.mission.team.all_orders import DRAFT, Game, searched
from tests.mission.team.team_plans import BEGIN_S, FRAME, SETTINGS


def pairs(*found):
    return frozenset(frozenset(pair) for pair in found)


A1, A2, B1, B2, C1 = (1, 1), (1, 2), (2, 1), (2, 2), (3, 1)

GAMES = {
    "two propose": Game({1: (5,), 2: (4,)}, pairs((A1, B1))),
    "two propose, and may withdraw": Game({1: (5,), 2: (4,)}, pairs((A1, B1)), may_withdraw=(1, 2)),
    "one proposes twice": Game({1: (5, 5), 2: (4,)}, pairs((A1, B1), (A2, B1))),
    "one stops hearing": Game({1: (5,), 2: (4,)}, pairs((A1, B1)), may_jump=(1,)),
}
LONG_GAMES = {
    "three propose": Game({1: (5,), 2: (4,), 3: (3,)}, pairs((A1, B1), (B1, C1), (A1, C1))),
    "three propose in a chain": Game({1: (5,), 2: (3,), 3: (4,)}, pairs((A1, B1), (B1, C1))),
    "both propose twice": Game({1: (5, 2), 2: (4, 3)}, pairs((A1, B1), (A2, B2), (A1, B2))),
    "two stop hearing": Game({1: (5,), 2: (4,)}, pairs((A1, B1)), may_jump=(1, 2)),
    "one proposes twice and stops hearing": Game(
        {1: (5, 5), 2: (4,)}, pairs((A1, B1), (A2, B1)), may_jump=(1,)
    ),
}


@pytest.mark.parametrize("name", GAMES)
def test_no_order_of_messages_leads_to_two_committed_plans_that_conflict(name):
    num_states, ends, fault = searched(GAMES[name])
    assert fault is None
    assert num_states > 5000
    assert {numbers[0] for numbers in ends} >= {None, 1}  # Either may be the one that is committed.
    assert {numbers[1] for numbers in ends} == {None, 1}


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG_GAMES)
def test_no_order_of_many_messages_leads_to_it_either(name):
    num_states, _, fault = searched(LONG_GAMES[name])
    assert fault is None
    assert num_states > 50_000


class CommitsWithOneApprovalMissing(Agreement):
    """Takes one approval less than there are others."""

    def _settle(self, now_s):
        own = self._proposal
        if own is not None and len(own.approvals) >= len(self._peers) - 1:
            self._committed = own.plan
            self._end_proposal(Outcome.COMMITTED)


class CommitsAtOnce(Agreement):
    """Tells its plan and does not wait: what RMADER was made to mend."""

    def _settle(self, now_s):
        if self._proposal is not None:
            self._committed = self._proposal.plan
            self._end_proposal(Outcome.COMMITTED)


class ApprovesBesideItsOwnProposal(Agreement):
    """Compares a proposal with its committed plan only."""

    def _answer(self, sender, plan, now_s):
        own, self._proposal = self._proposal, None
        super()._answer(sender, plan, now_s)
        self._proposal = own


class ForgetsWhatItApproved(Agreement):
    """Keeps clear of committed plans only."""

    def plans_to_clear(self):
        return tuple(peer.committed for peer in self._peers.values() if peer.committed is not None)


FAULTY = [CommitsWithOneApprovalMissing, CommitsAtOnce, ApprovesBesideItsOwnProposal, ForgetsWhatItApproved]


@pytest.mark.parametrize("kind", FAULTY, ids=lambda kind: kind.__name__)
def test_the_search_finds_members_with_a_fault(kind):
    _, _, fault = searched(replace(GAMES["two propose, and may withdraw"], kind=kind))
    assert fault is not None
    assert "conflict" in fault or "breaks" in fault


@pytest.mark.slow
def test_the_search_says_what_lost_members_may_come_to():
    """Two that have counted each other lost may be committed to plans that conflict, and nobody else."""
    _, ends, fault = searched(LONG_GAMES["two stop hearing"])
    assert fault is None
    assert ends[1, 1, None] > 0


class Delivery:
    """Members whose messages are lost and late by chance, and in any order."""

    def __init__(self, ranks, conflicts, seed):
        def margin(one, other, since_s):
            return -1.0 if frozenset({one.member, other.member}) in conflicts else 1.0

        ids = range(1, len(ranks) + 1)
        self.members = {m: Agreement(m, ids, FRAME, SETTINGS, started_s=BEGIN_S, margin=margin) for m in ids}
        self.rng, self.now_s, self.late = np.random.default_rng(seed), BEGIN_S, []
        for m, (is_emergency, room) in zip(ids, ranks, strict=True):
            self.members[m].propose(replace(DRAFT, is_emergency=is_emergency, room=room), BEGIN_S)

    def pass_time(self, seconds):
        for _ in range(seconds):
            self.now_s += 1.0
            said = [(m, payload) for m, one in self.members.items() for payload in one.outgoing(self.now_s)]
            self.late += [
                (self.now_s + self.rng.uniform(0.0, 3.0), receiver, sender, payload)
                for sender, payload in said for receiver in self.members
                if receiver != sender and self.rng.random() > 0.3
            ]  # fmt: skip
            due = [each for each in self.late if each[0] <= self.now_s]
            self.late = [each for each in self.late if each[0] > self.now_s]
            for place in self.rng.permutation(len(due)):
                _, receiver, sender, payload = due[place]
                self.members[receiver].receive(sender, payload, self.now_s)
        return [one.outcome() for one in self.members.values()]


RANK = st.tuples(st.booleans(), st.integers(0, 3))


@settings(max_examples=60)
@given(RANK, RANK, st.integers(0, 10**6))
def test_of_two_proposals_at_once_that_conflict_one_is_committed(rank, other_rank, seed):
    outcomes = Delivery([rank, other_rank, (False, 255)], pairs((1, 2)), seed)
    outcomes.members[3].withdraw()
    found = outcomes.pass_time(80)[:2]
    assert sorted(outcome is Outcome.COMMITTED for outcome in found) == [False, True]
    assert Outcome.PENDING not in found
    first = (not rank[0], rank[1], 1) < (not other_rank[0], other_rank[1], 2)
    assert found[0 if first else 1] is Outcome.COMMITTED


@settings(max_examples=40)
@given(st.lists(RANK, min_size=3, max_size=5), st.integers(0, 10**6))
def test_of_many_proposals_at_once_the_first_in_the_order_is_committed(ranks, seed):
    all_pairs = pairs(*itertools.combinations(range(1, len(ranks) + 1), 2))
    found = Delivery(ranks, all_pairs, seed).pass_time(100)
    order = sorted(range(len(ranks)), key=lambda n: (not ranks[n][0], ranks[n][1], n))
    assert [n for n, outcome in enumerate(found) if outcome is Outcome.COMMITTED] == order[:1]


def test_proposals_that_do_not_conflict_are_all_committed():
    assert set(Delivery([(False, 9)] * 6, frozenset(), 5).pass_time(80)) == {Outcome.COMMITTED}

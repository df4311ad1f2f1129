"""What a member does with what the others say. `test_agreement_model.py` tries all orders."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from companion.mission.team.agreement import Agreement, Outcome
from companion.mission.team.separation import PackedPlans, margin_between, margin_of
from companion.mission.team.standing import Standing
from companion.mission.team.wire import Report, report_payloads
from tests.mission.team.team_plans import BEGIN_S, FRAME, SETTINGS, plan, zigzag

EAST = plan((-1000, 0, 100), (1000, 0, 100))
NORTH = plan((0, -1000, 100), (0, 1000, 100))  # It meets EAST in the middle.
HIGH = plan((-1000, 0, 200), (1000, 0, 200))
LONG = plan(*zigzag(30))


class Team:
    """Members that hear each other, or not."""

    def __init__(self, num=3, **settings):
        members = range(1, num + 1)
        settings = replace(SETTINGS, **settings)
        self.now_s = BEGIN_S
        self.members = {m: Agreement(m, members, FRAME, settings, started_s=BEGIN_S) for m in members}
        self.deaf = set()
        self.sent = []

    def pass_time(self, seconds):
        for _ in range(seconds):
            self.now_s += 1.0
            said = [(m, payload) for m, one in self.members.items() for payload in one.outgoing(self.now_s)]
            self.sent += said
            for sender, payload in said:
                for member, one in self.members.items():
                    if member != sender and not {member, sender} & self.deaf:
                        one.receive(sender, payload, self.now_s)

    def outcomes(self):
        return [one.outcome() for one in self.members.values()]

    def numbers(self):
        return [one.committed and one.committed.number for one in self.members.values()]

    def conflicts(self):
        """Pairs of members whose committed plans conflict."""
        plans = [one.committed for one in self.members.values() if one.committed is not None]
        margin = margin_of(SETTINGS)
        pairs = itertools.combinations(plans, 2)
        return [(one.member, other.member) for one, other in pairs if margin(one, other, self.now_s) < 0.0]


def test_a_plan_is_committed_when_all_have_approved_it():
    team = Team()
    told = team.members[1].propose(EAST, team.now_s)
    assert team.members[1].outcome() is Outcome.PENDING
    assert team.members[1].proposed is told
    team.pass_time(1)
    assert team.numbers() == [None, None, None]
    team.pass_time(4)
    assert team.numbers() == [1, None, None]
    assert [len(one.plans_to_clear()) for one in team.members.values()] == [0, 1, 1]
    assert team.conflicts() == []


def test_a_member_keeps_clear_of_the_old_plan_and_of_the_proposal_until_it_is_committed():
    team = Team(num=2)
    team.members[1].propose(EAST, team.now_s)
    team.pass_time(5)
    team.members[1].propose(HIGH, team.now_s)
    (payload,) = team.members[1].outgoing(team.now_s)
    team.members[2].receive(1, payload, team.now_s)
    assert [each.number for each in team.members[2].plans_to_clear()] == [1, 2]
    assert team.members[2].propose(NORTH, team.now_s) is None
    assert team.members[2].outcome() is Outcome.REFUSED
    assert team.members[2].refused_by == {1}
    team.pass_time(5)
    assert [each.number for each in team.members[2].plans_to_clear()] == [2]
    assert team.members[2].propose(NORTH, team.now_s) is not None


def test_a_withdrawn_proposal_is_forgotten():
    team = Team()
    team.members[1].propose(EAST, team.now_s)
    team.pass_time(1)
    assert len(team.members[2].plans_to_clear()) == 1
    team.members[1].withdraw()
    assert team.members[1].outcome() is Outcome.WITHDRAWN
    team.pass_time(3)
    assert team.members[2].plans_to_clear() == ()
    assert team.numbers() == [None, None, None]


def test_a_proposal_that_conflicts_with_a_committed_plan_is_refused():
    team = Team()
    team.members[2].propose(NORTH, team.now_s)
    team.pass_time(5)
    deaf = Agreement(1, (1, 2, 3), FRAME, SETTINGS, started_s=BEGIN_S)  # It knows nothing of that plan.
    team.members[1] = deaf
    assert deaf.propose(EAST, team.now_s) is not None
    team.pass_time(3)
    assert deaf.outcome() is Outcome.REFUSED
    assert deaf.refused_by == {2}


@pytest.mark.parametrize(
    ("first", "second", "winner"),
    [
        (EAST, NORTH, 1),
        (EAST, replace(NORTH, is_emergency=True), 2),
        (replace(EAST, room=9), replace(NORTH, room=3), 2),
        (replace(EAST, room=9, is_emergency=True), replace(NORTH, room=3), 1),
    ],
    ids=["smaller system id", "emergency", "less room", "emergency before room"],
)
def test_of_two_proposals_at_once_the_order_takes_one(first, second, winner):
    team = Team()
    team.members[1].propose(first, team.now_s)
    team.members[2].propose(second, team.now_s)
    team.pass_time(6)
    expected = [Outcome.WITHDRAWN, Outcome.WITHDRAWN, Outcome.NONE]
    expected[winner - 1] = Outcome.COMMITTED
    assert team.outcomes() == expected


def test_what_is_announced_is_kept_clear_of_without_being_approved():
    team = Team()
    team.members[2].propose(NORTH, team.now_s)
    team.members[1].announce(EAST)
    team.pass_time(3)
    assert team.members[2].outcome() is Outcome.REFUSED
    assert team.members[2].refused_by == {1}
    assert team.numbers() == [1, None, None]
    assert [len(one.plans_to_clear()) for one in team.members.values()] == [0, 1, 1]


WAITING = plan((500, 0, 100), (500, 0, 100), speed_m_s=1.0)  # A circle that EAST would meet.


def test_a_request_reaches_whoever_is_in_its_way_and_is_never_committed():
    team = Team()
    team.members[2].announce(WAITING)
    team.members[3].announce(plan((0, 2000, 100), (1, 2000, 100)))
    team.pass_time(3)
    team.members[1].request(EAST, team.now_s)
    for _ in range(10):
        team.pass_time(1)
        assert team.members[1].outcome() is not Outcome.APPROVED
    assert [len(one.requests(team.now_s)) for one in team.members.values()] == [0, 1, 0]
    (requested,) = team.members[2].requests(team.now_s)
    assert (requested.member, requested.is_request) == (1, True)
    assert requested.place_at(BEGIN_S + 50.0) == pytest.approx((0.0, 0.0, 100.0), abs=25.0)
    assert team.members[1].committed is None
    assert [len(one.plans_to_clear()) for one in team.members.values()] == [2, 1, 1]
    team.pass_time(25)
    assert team.members[2].requests(team.now_s) == ()  # It was long ago.


def test_a_request_ends_unanswered_and_even_the_lost_do_not_let_it_be_committed():
    team = Team(lost_after_s=2.0)
    team.members[2].announce(WAITING)
    team.pass_time(1)
    team.deaf = {1}
    team.pass_time(4)
    assert team.members[1].members_lost(team.now_s) == {2, 3}
    team.members[1].request(EAST, team.now_s)
    team.pass_time(8)
    assert team.members[1].outcome() is Outcome.WITHDRAWN
    assert team.members[1].committed is None


def test_a_request_takes_the_place_of_no_proposal():
    """A proposal of member 1 would go before that of member 2; a request does not."""
    team = Team()
    team.members[2].propose(NORTH, team.now_s)
    team.members[1].request(EAST, team.now_s)
    team.pass_time(6)
    assert team.outcomes() == [Outcome.WITHDRAWN, Outcome.COMMITTED, Outcome.NONE]


def test_two_that_are_too_near_to_each_other_may_part_but_come_no_nearer():
    """Two fly side by side, 50 m apart. One may turn away from the other, and not into its way."""
    team = Team(num=2)
    side_by_side = [plan((0, north, 100), (4000, north, 100), radius_m=0.0) for north in (0, 50)]
    for member, each in zip(team.members.values(), side_by_side, strict=True):
        member.announce(each)
    team.pass_time(3)
    assert team.conflicts() == [(1, 2)]
    nearer, farther = (plan((0, 50, 100), (2000, north, 100)) for north in (-200, 1000))
    assert team.members[2].propose(nearer, team.now_s) is None
    assert team.members[2].refused_by == {1}
    assert team.members[2].propose(farther, team.now_s) is not None
    team.pass_time(3)
    assert team.members[2].outcome() is Outcome.COMMITTED


def test_a_plan_is_withdrawn_when_it_is_too_late_for_it():
    team = Team()
    team.deaf = {3}
    team.members[1].propose(EAST, team.now_s, commit_before_s=team.now_s + 10.0)
    team.pass_time(12)
    assert team.members[1].outcome() is Outcome.WITHDRAWN
    team.deaf = set()
    team.pass_time(20)
    assert team.numbers() == [None, None, None]


def test_a_plan_that_has_not_begun_is_refused():
    with pytest.raises(ValueError, match="begun"):
        Team().members[1].propose(EAST, BEGIN_S - 1.0)


def test_a_lost_members_approval_is_not_waited_for_and_its_plans_are_kept_clear_of():
    team = Team(lost_after_s=60.0)
    slow = plan((0, -1000, 100), (0, 1000, 100), speed_m_s=8.0)
    team.members[3].propose(slow, team.now_s)
    team.pass_time(5)
    team.deaf = {3}
    team.pass_time(70)
    assert team.members[1].members_lost(team.now_s) == {3}
    waiting = plan((0, 0, 100), begin_s=team.now_s)
    assert team.members[1].propose(waiting, team.now_s) is None  # the lost member's plan leads through there.
    later = replace(HIGH, rows=HIGH.rows + np.array([60.0, 0, 0, 0]))
    assert team.members[1].propose(later, team.now_s) is not None
    team.pass_time(5)
    assert team.numbers() == [team.members[1].committed.number, None, 1]
    assert [each.member for each in team.members[2].plans_to_clear()] == [1, 3]


def test_nothing_is_committed_until_the_plan_of_a_member_that_is_heard_again_is_known():
    team = Team(num=2, lost_after_s=60.0)
    team.pass_time(1)
    team.deaf = {1, 2}
    team.pass_time(61)
    # Each is alone: both commit, and the two plans conflict. No protocol can know of that.
    shift = np.array([60.0, 0, 0, 0])
    team.members[1].propose(replace(EAST, rows=EAST.rows + shift), team.now_s)
    team.members[2].propose(replace(NORTH, rows=NORTH.rows + shift), team.now_s)
    assert team.outcomes() == [Outcome.COMMITTED] * 2
    team.deaf = set()
    (payload,) = report_payloads(Report(Standing(1, 1)))
    team.members[1].receive(2, payload, team.now_s)
    assert team.members[1].members_lost(team.now_s) == frozenset()
    team.members[1].propose(replace(HIGH, rows=HIGH.rows + shift), team.now_s)
    (approval,) = report_payloads(Report(Standing(1, 1), approved=((1, 2),)))
    team.members[1].receive(2, approval, team.now_s)
    assert team.members[1].outcome() is Outcome.PENDING
    team.pass_time(6)  # It asks for the plan, which clears its proposal.
    assert team.members[1].outcome() is Outcome.COMMITTED
    assert team.conflicts() == []


def test_two_that_were_lost_to_each_other_hear_that_their_plans_conflict():
    team = Team(num=2, lost_after_s=60.0)
    team.deaf = {1, 2}
    team.pass_time(61)
    shift = np.array([60.0, 0, 0, 0])
    for member, flown in ((1, EAST), (2, NORTH)):
        team.members[member].propose(replace(flown, rows=flown.rows + shift), team.now_s)
    team.deaf = set()
    team.pass_time(12)
    assert team.conflicts() == [(1, 2)]
    assert [len(one.plans_to_clear()) for one in team.members.values()] == [1, 1]


def test_a_member_that_does_not_fly_its_plan_is_deviating_until_it_does():
    team = Team()
    team.members[1].propose(EAST, team.now_s)
    team.pass_time(5)
    other = team.members[2]
    for after_s in range(8):
        other.observe(1, (-1000.0 + 20.0 * after_s, 200.0, 100.0), BEGIN_S + after_s)
        assert other.members_deviating(BEGIN_S + after_s) == ({1} if after_s >= 5 else frozenset())
    other.observe(1, (-1000.0 + 20.0 * 9.0, 10.0, 100.0), BEGIN_S + 9.0)
    assert other.members_deviating(BEGIN_S + 20.0) == frozenset()
    other.observe(3, (0.0, 0.0, 0.0), BEGIN_S)  # It has told nothing that it could deviate from.
    other.observe(99, (0.0, 0.0, 0.0), BEGIN_S)
    assert other.members_deviating(BEGIN_S + 20.0) == frozenset()


def test_a_long_plan_arrives_in_parts_in_any_order_and_twice():
    one, other = (Agreement(m, (1, 2), FRAME, SETTINGS, started_s=BEGIN_S) for m in (1, 2))
    told = one.propose(LONG, BEGIN_S)
    parts = one.outgoing(BEGIN_S)
    assert len(parts) == 3
    for part in (parts[2], parts[2], parts[0]):
        other.receive(1, part, BEGIN_S)
        assert other.plans_to_clear() == ()
    other.receive(1, parts[1], BEGIN_S)
    (read,) = other.plans_to_clear()
    assert np.array_equal(read.rows, told.rows)


def test_what_is_wrong_is_counted_and_changes_nothing():
    one = Agreement(1, (1, 2), FRAME, SETTINGS, started_s=BEGIN_S)
    one.receive(2, b"", BEGIN_S)
    one.receive(2, b"\x91" + bytes(9), BEGIN_S)
    one.receive(2, b"\x12\x06\x00\x00\x07\x00\x07\x00\x01abc", BEGIN_S)  # a plan of three bytes
    one.receive(1, b"", BEGIN_S)
    one.receive(77, b"", BEGIN_S)
    assert one.counters == {
        "refused_length": 1, "refused_version": 1, "refused_plan_length": 1, "own": 1, "stranger": 1,
    }  # fmt: skip
    assert one.plans_to_clear() == ()


def test_what_is_late_is_not_believed():
    team = Team(num=2)
    team.members[1].propose(EAST, team.now_s)
    old = team.members[1].outgoing(team.now_s)
    team.members[1].propose(HIGH, team.now_s)
    team.pass_time(5)
    for payload in old:
        team.members[2].receive(1, payload, team.now_s)
    (kept,) = team.members[2].plans_to_clear()
    assert kept.number == 2


def test_a_quiet_team_sends_little_and_a_busy_one_keeps_to_its_budget():
    team = Team(num=20, channel_bytes_s=2000.0)  # 100 bytes a second each
    team.pass_time(100)
    assert sum(len(payload) + 17 for _, payload in team.sent) / 20 / 100 < 5.0
    team.sent.clear()
    team.deaf = {20}  # It never answers, so that everybody asks again and again.
    for member, one in team.members.items():
        places = [(east, 3000.0 * member + north, up) for east, north, up in zigzag(25)]
        one.propose(plan(*places), team.now_s)
    team.pass_time(60)
    for member in team.members:
        assert sum(len(p) + 17 for sender, p in team.sent if sender == member) <= 100.0 * (60 + 10) + 600.0


def test_the_first_conflict_among_many_is_that_of_the_margins():
    plans = [replace(each, number=n) for n, each in enumerate((HIGH, LONG, NORTH))]
    found = PackedPlans(plans, SETTINGS).first_conflict(EAST, BEGIN_S)
    assert found is next(each for each in plans if margin_between(EAST, each, SETTINGS, BEGIN_S) < 0.0)
    assert PackedPlans([], SETTINGS).first_conflict(EAST, BEGIN_S) is None

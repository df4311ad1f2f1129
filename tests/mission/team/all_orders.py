"""Every order in which three members can hear, miss, hear late and hear twice what each other said.

The members are the program's own. A state is what each of them knows, and all payloads that were ever sent.
Any of these may arrive at any member next, or never. So losses, delays, copies and all orders are among the
ways through the states. A state that was met before is not looked at again.

A payload says several things, which a member takes in one after the other. Here each of them arrives by
itself. That allows all that whole payloads do, and more, with far fewer states. What asks others to repeat
something is left out, because all that was ever sent may be repeated anyway.
"""

from collections import Counter, deque
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from companion.mission.team.agreement import Agreement
from companion.mission.team.plan_parts import PlanParts
from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.standing import HEADER, Standing
from companion.mission.team.wire import Fragment, Report, read_payload, report_payloads
from tests.mission.team.team_plans import BEGIN_S, FRAME, SETTINGS

AT_ONCE = replace(
    SETTINGS,
    reply_s=0.0,
    repeat_s=0.0,
    quiet_s=0.0,
    channel_bytes_s=1e12,
    member_bytes_s=1e12,
    lost_after_s=100.0,
)
LATER_S = BEGIN_S + 200.0  # The clock of a member that counts everybody lost who was not heard since.
MEMBERS = (1, 2, 3)
DRAFT = SharedPlan(0, 0, np.array([[BEGIN_S, 0.0, 0.0, 100.0]]), 80.0, 15.0, 8.0)


@dataclass(frozen=True)
class Game:
    """What may happen.

    ``proposals`` has the ranks of each member's proposals, one after the other; ``conflicts`` has pairs of
    (member, number) whose plans conflict; members in ``may_jump`` may stop hearing others for long.
    """

    proposals: dict
    conflicts: frozenset
    may_jump: tuple = ()
    may_withdraw: tuple = ()
    kind: type = Agreement


def conflicts_of(game):
    return lambda one, other, since_s: (
        frozenset({(one.member, one.number), (other.member, other.number)}) in game.conflicts
    )


def margins_of(game):
    are_in_conflict = conflicts_of(game)
    return lambda one, other, since_s: -1.0 if are_in_conflict(one, other, since_s) else 1.0


def copied(one):
    """A copy of a member. Its pacing has no memory, because everything may be sent at once."""
    other = object.__new__(type(one))
    own = {
        "counters": Counter(),
        "_peers": dict(one._peers),
        "_received_s": dict(one._received_s),
        "_parts": PlanParts(),
    }
    vars(other).update(vars(one) | own)
    return other


def number_of(plan):
    return None if plan is None else plan.number


def known_by(one):
    """Everything that a member's behaviour depends on."""
    peers = tuple(
        (peer.standing, number_of(peer.committed), number_of(peer.proposed), peer.is_approved)
        for peer in one._peers.values()
    )
    own = one._proposal and (one._proposal.plan.number, one._proposal.approvals)
    return number_of(one.committed), own, one._standing, one._missing, peers, tuple(one._received_s.values())


@cache
def parts_of(payload):
    """The single things that a payload says, as payloads."""
    message, none = read_payload(payload), Standing()
    reports = [Report(message.standing)]
    if isinstance(message, Fragment):
        kept = payload[HEADER.size :]
        return (*report_payloads(reports[0]), bytes([payload[0]]) + bytes(HEADER.size - 1) + kept)
    reports += [Report(none, approved=(pair,)) for pair in message.approved]
    reports += [Report(none, refused=(pair,)) for pair in message.refused]
    return tuple(part for report in reports for part in report_payloads(report))


class Locals:
    """All states of one member that were met, by number, and what follows from each: worked out once.

    A local state is the member, its clock, and whom it ever counted lost.
    """

    def __init__(self, game, member, messages):
        self.game, self.member, self.messages = game, member, messages
        self.met, self.states, self.inert, self.heard, self.acted = {}, [], [], [], []
        make = {"frame": FRAME, "settings": AT_ONCE, "started_s": BEGIN_S, "margin": margins_of(game)}
        self.first = self.number(game.kind(member, MEMBERS, **make), BEGIN_S, frozenset())

    def number(self, one, clock_s, ever_lost):
        key = (known_by(one), clock_s, ever_lost)
        if key not in self.met:
            self.met[key] = len(self.states)
            self.states.append((one, clock_s, ever_lost))
            self.inert.append(0)
            self.heard.append({})
            self.acted.append(None)
        return self.met[key]

    def after(self, state, change, clock_s=None):
        """The next local state, and what is said then as a set of bits."""
        one, now_s, ever_lost = self.states[state]
        one, now_s = copied(one), clock_s or now_s
        change(one, now_s)
        parts = {(self.member, part) for payload in one.outgoing(now_s) for part in parts_of(payload)}
        said = sum(1 << self.messages.setdefault(part, len(self.messages)) for part in parts)
        return self.number(one, now_s, ever_lost | one.members_lost(now_s)), said

    def hearing(self, state, bit, sender, payload):
        """The next local state, and what is said then."""
        if bit not in self.heard[state]:
            found, said = self.after(state, lambda one, now_s: one.receive(sender, payload, now_s))
            self.heard[state][bit] = (found, said)
        return self.heard[state][bit]

    def actions(self, state):
        """What the member may do by itself."""
        if self.acted[state] is None:
            self.acted[state] = list(self._actions(state))
        return self.acted[state]

    def _actions(self, state):
        one, clock_s, _ = self.states[state]
        ranks, done = self.game.proposals.get(self.member, ()), one._next - 1
        if done < len(ranks):
            draft = replace(DRAFT, room=ranks[done])
            yield self.after(state, lambda one, now_s: one.propose(draft, now_s))
        if self.member in self.game.may_withdraw and one.proposed is not None:
            yield self.after(state, lambda one, now_s: one.withdraw())
        if self.member in self.game.may_jump and clock_s < LATER_S:
            yield self.after(state, lambda one, now_s: None, LATER_S)


def broken_approval(game, locals_of, state):
    """What is wrong in a local state; None if nothing is."""
    one, _, ever_lost = locals_of.states[state]
    for plan in one.plans_to_clear():
        for own in (one.committed, one.proposed):
            if own is not None and plan.member not in ever_lost and conflicts_of(game)(own, plan, 0.0):
                return f"{one.member} breaks its approval of plan {plan.number} of {plan.member}"
    return None


def broken_separation(game, members, state):
    """Which two members are committed to plans that conflict though one never counted the other lost."""
    found = [each.states[number] for each, number in zip(members, state, strict=True)]
    for n, (one, _, lost) in enumerate(found):
        for other, _, other_lost in found[:n]:
            lost_each_other = one.member in other_lost and other.member in lost
            if lost_each_other or None in (one.committed, other.committed):
                continue
            if conflicts_of(game)(one.committed, other.committed, 0.0):
                return f"{other.member} and {one.member} are committed to plans that conflict"
    return None


def next_states(members, state, sent, messages):
    """States that follow: of a state, the members' local states, and everything sent as a set of bits."""
    for n, each in enumerate(members):
        for found, said in each.actions(state[n]):
            yield (*state[:n], found, *state[n + 1 :]), sent | said
        new = sent & ~each.inert[state[n]]
        while new:
            bit = (new & -new).bit_length() - 1
            new &= new - 1
            sender, payload = messages[bit]
            if sender == each.member:
                each.inert[state[n]] |= 1 << bit
                continue
            found, said = each.hearing(state[n], bit, sender, payload)
            if found == state[n] and not said & ~sent:
                continue
            yield (*state[:n], found, *state[n + 1 :]), sent | said


def searched(game, most=10**7):
    """Number of states, how many ended in which committed numbers, and the first fault."""
    messages = {}
    members = [Locals(game, member, messages) for member in MEMBERS]
    first = (tuple(each.first for each in members), 0)
    met, waiting, ends, checked = {first}, deque([first]), Counter(), {}
    listed = []
    while waiting:
        state, sent = waiting.popleft()
        listed = list(messages) if len(listed) != len(messages) else listed
        for found in next_states(members, state, sent, listed):
            if found in met:
                continue
            met.add(found)
            if found[0] not in checked:
                local = (broken_approval(game, *each) for each in zip(members, found[0], strict=True))
                checked[found[0]] = broken_separation(game, members, found[0]) or next(
                    filter(None, local), None
                )
                numbers = (each.states[n][0].committed for each, n in zip(members, found[0], strict=True))
                ends[tuple(plan and plan.number for plan in numbers)] += 1
            if checked[found[0]] is not None:
                return len(met), ends, checked[found[0]]
            assert len(met) < most, "more states than expected"
            waiting.append(found)
    return len(met), ends, None

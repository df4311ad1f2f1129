"""The agreement of a team: a member takes a new plan only when every other member has approved it.

Each member has at most one committed plan, which it flies, and at most one proposed plan. It sends the
proposal, and flies the committed plan meanwhile. A member that approves a proposal keeps its own plans
clear of it, and of the sender's committed plan, until the sender says that the proposal is committed,
withdrawn or replaced. The proposer commits when every member that is not lost has approved exactly this plan.

No two committed plans conflict then, whatever messages are lost, late, doubled or out of order. Let one
member commit P with the other's approval. At its approval the other had compared P with the plan it was
committed to and with its own proposal, and all that it proposed later is clear of P. So whatever it is
committed to when P is committed is clear of P. ``docs/team-agreement.md`` has the whole argument, and what it
says of lost members.

References
----------
Tordesillas and How, "MADER: Trajectory Planner in Multi-Agent and Dynamic Environments", T-RO 2022.
Kondo, Figueroa, Rached, Tordesillas, Lusk and How, "Robust MADER: Decentralized Multiagent Trajectory Planner
Robust to Communication Delay in Dynamic Environments", RA-L 2023: publish before committing, and keep to both
the old and the new plan meanwhile. There a fixed delay check stands for what approvals do here.
"""

from __future__ import annotations

import enum
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from companion.frames import LocalFrame
from companion.mission.team.goal_auction import GoalAuction
from companion.mission.team.pacing import Pacing
from companion.mission.team.peer import Deviations, Peer, Proposal
from companion.mission.team.plan_parts import PlanParts
from companion.mission.team.separation import Margin, is_too_near, margin_of
from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.standing import PayloadError, Standing
from companion.mission.team.team_settings import TeamSettings
from companion.mission.team.wire import (
    BidMessage,
    Fragment,
    Report,
    ReturnAltitude,
    next_number,
    plan_payloads,
    read_payload,
    read_plan,
    report_payloads,
    return_payload,
    transmitted_plan,
)

REQUEST_SIMPLIFY_M = 20.0  # A request is no promise, so its path may be coarse and short.
REQUESTED_S = 5.0  # A request is sent for this time, at most once a second.
REQUEST_LASTS_S = 30.0  # It is answered within this time: the circle may be in use for something else.


class Outcome(enum.Enum):
    """The result of a member's latest proposal."""

    NONE = "none"
    PENDING = "pending"
    COMMITTED = "committed"
    REFUSED = "refused"
    WITHDRAWN = "withdrawn"
    APPROVED = "approved"


class Agreement:
    """One member's part in the agreement of a team. Times are UTC seconds and come in as arguments.

    Parameters
    ----------
    member : int
        System id of this member.
    members : iterable of int
        System ids of all members of the team.
    frame : LocalFrame
        Frame of the plans' places.
    settings : TeamSettings
        Distances, times and bytes that all members share.
    started_s : float
        UTC time of the beginning: a member of which nothing is received is lost ``lost_after_s`` later [s].
    first_number : int
        Number of the first plan. After a restart it has to be newer than any number used before.
    margin : callable, optional
        Least margin of two plans from an instant on, negative if they conflict [m]; by default
        :func:`margin_of` the settings.
    commits_itself : bool
        Whether a proposal is committed as soon as everybody has approved it. Otherwise its owner calls
        :meth:`commit` once it is flown; until then both plans are kept clear of.
    auction : GoalAuction, optional
        The member's part in the auction of goals, if the team shares its goals.

    Attributes
    ----------
    return_altitude_m : float or None
        Altitude above mean sea level of this member's return to launch [m], which it sends; None if unknown.
    return_altitudes_m : dict of int to float
        Those of the others that were received [m].
    """

    def __init__(
        self,
        member: int,
        members: Iterable[int],
        frame: LocalFrame,
        settings: TeamSettings,
        *,
        started_s: float,
        first_number: int = 1,
        margin: Margin | None = None,
        commits_itself: bool = True,
        auction: GoalAuction | None = None,
    ) -> None:
        self.member = member
        self.auction = auction
        self.counters: Counter[str] = Counter()
        self.return_altitude_m: float | None = None
        self.return_altitudes_m: dict[int, float] = {}
        self._members = tuple(sorted({*members, member}))
        self._frame, self._settings = frame, settings
        self._margin = margin or margin_of(settings)
        self._commits_itself = commits_itself
        self._peers = {other: Peer() for other in self._members if other != member}
        self._received_s = dict.fromkeys(self._peers, started_s)
        self._deviations = Deviations()
        self._requests: dict[int, tuple[SharedPlan, float]] = {}  # With the time of receipt [s].
        self._parts = PlanParts()
        self._next = first_number
        self._committed: SharedPlan | None = None
        self._proposal: Proposal | None = None
        self._standing = Standing()
        self._outcome, self._refused_by = Outcome.NONE, frozenset[int]()
        self._owed: frozenset[int] = frozenset()  # Members whose proposals are answered in the next report.
        self._missing: frozenset[int] = frozenset()  # Members whose committed plan is not here.
        self._pacing = Pacing(settings, len(self._members))

    @property
    def committed(self) -> SharedPlan | None:
        """The plan that this member flies, as the others read it; None before the first."""
        return self._committed

    @property
    def proposed(self) -> SharedPlan | None:
        """The plan that this member proposes, as the others read it."""
        return None if self._proposal is None else self._proposal.plan

    @property
    def refused_by(self) -> frozenset[int]:
        """Members with whose plans the latest proposal conflicted."""
        return self._refused_by

    def outcome(self) -> Outcome:
        """Return what became of the latest proposal."""
        return self._outcome

    def plans_to_clear(self) -> tuple[SharedPlan, ...]:
        """Return the plans of others from which this member's next plan has to keep clear.

        These are the committed plans that are known, and the proposals that this member approved.
        """
        return tuple(
            plan
            for peer in self._peers.values()
            for plan in (peer.committed, peer.proposed if peer.is_approved else None)
            if plan is not None
        )

    def members_lost(self, now_s: float) -> frozenset[int]:
        """Return the members whose approval is not waited for, because they were silent for too long."""
        since_s = now_s - self._settings.lost_after_s
        return frozenset(other for other, at_s in self._received_s.items() if at_s <= since_s)

    def members_deviating(self, now_s: float) -> frozenset[int]:
        """Return members that deviate from their announced plans: they are treated as any other aircraft."""
        return self._deviations.members(now_s - self._settings.deviating_after_s)

    def members_as_announced(self, now_s: float) -> frozenset[int]:
        """Return the members that announced a plan, are not lost, and do not deviate."""
        announced = {plan.member for plan in self.plans_to_clear()}
        return frozenset(announced - self.members_deviating(now_s) - self.members_lost(now_s))

    def propose(self, plan: SharedPlan, now_s: float, commit_before_s: float = math.inf) -> SharedPlan | None:
        """Propose a plan to the team; one that is still proposed is withdrawn for it.

        Parameters
        ----------
        plan : SharedPlan
            The plan. It has begun: until ``commit_before_s`` it is the same as the committed plan. Its member
            and number are filled in here.
        now_s : float
            UTC time [s].
        commit_before_s : float
            UTC time at which the plan leaves the committed one; from then on it is withdrawn [s].

        Returns
        -------
        SharedPlan or None
            The plan as the others read it; None if it conflicts with a plan of :meth:`plans_to_clear`, unless
            the committed plan already comes as near to that.

        Raises
        ------
        ValueError
            If the plan has not begun, or lies beyond what the format holds.
        """
        if plan.start_s > now_s:
            raise ValueError("plan: expected one that has begun")
        transmitted = self._as_told(plan, self._settings.simplify_m)
        against = {
            other.member
            for other in self.plans_to_clear()
            if is_too_near(self._margin, transmitted, self._committed, other, now_s)
        }
        if against:
            self._end_proposal(Outcome.REFUSED, frozenset(against))
            return None
        self._begin_proposal(Proposal(transmitted, commit_before_s), now_s)
        return transmitted

    def request(self, plan: SharedPlan, now_s: float) -> None:
        """Request that members whose circles are in the way of a plan fly a circle elsewhere.

        A request is told like a proposal from a UTC time [s] on, for ``REQUESTED_S`` or until all have
        answered. Nobody approves it, and it is never committed.
        """
        transmitted = self._as_told(replace(plan, is_request=True), REQUEST_SIMPLIFY_M)
        self._begin_proposal(Proposal(transmitted, now_s + REQUESTED_S), now_s)

    def _as_told(self, plan: SharedPlan, simplify_m: float) -> SharedPlan:
        """Return a plan of this member with the next number, as the others will read it."""
        numbered = replace(plan, member=self.member, number=self._next)
        return transmitted_plan(numbered, self._frame, simplify_m)

    def _begin_proposal(self, proposal: Proposal, now_s: float) -> None:
        """Tell a proposal, or a request, with the next number."""
        self._next = next_number(self._next)
        self._proposal = proposal
        self._outcome, self._refused_by = Outcome.PENDING, frozenset()
        self._standing = Standing(self._standing.committed, proposal.plan.number, is_pending=True)
        self._pacing.note_proposal(now_s)
        self._settle(now_s)

    def requests(self, now_s: float) -> tuple[SharedPlan, ...]:
        """Return what others requested in the last ``REQUEST_LASTS_S`` that this member's circle bars."""
        own, recent_s = self._committed, now_s - REQUEST_LASTS_S
        recent = [plan for plan, received_s in self._requests.values() if received_s >= recent_s]
        return tuple(plan for plan in recent if own is not None and self._margin(own, plan, now_s) < 0.0)

    def announce(self, plan: SharedPlan) -> SharedPlan:
        """Announce what is flown although nobody has approved it, instead of the committed plan.

        That is for what cannot be changed or was not agreed on: the first seconds of a flight, a return, a
        pilot's own flying. It may conflict with what others have committed before. From now on nobody
        approves, and nobody who received it proposes, what comes too near to it.

        Parameters
        ----------
        plan : SharedPlan
            What is flown from now on. Its member and number are filled in here.

        Returns
        -------
        SharedPlan
            The plan as the others read it.

        Raises
        ------
        ValueError
            If the plan lies beyond what the format holds.
        """
        transmitted = self._as_told(plan, self._settings.simplify_m)
        self._next = next_number(self._next)
        if self._proposal is not None:
            self._end_proposal(Outcome.WITHDRAWN)
        self._committed, self._standing = transmitted, Standing(transmitted.number, transmitted.number)
        self._pacing.note_news()
        self._pacing.note_wanted()
        return transmitted

    def hold(self) -> None:
        """Keep what is proposed however late it is: it is being entered."""
        if self._proposal is not None:
            self._proposal = replace(self._proposal, commit_before_s=math.inf)

    def commit(self) -> None:
        """Commit a proposal that everybody has approved."""
        if self._proposal is not None and self._outcome is Outcome.APPROVED:
            self._committed = self._proposal.plan
            self._end_proposal(Outcome.COMMITTED)

    def withdraw(self) -> None:
        """Withdraw what is proposed, if anything is."""
        self._end_proposal(Outcome.WITHDRAWN)

    def forget(self, member: int) -> None:
        """Keep clear of a lost member's plans no longer, until its committed plan is received again."""
        peer = self._peers[member]
        if peer.committed is not None or peer.proposed is not None:
            self._peers[member] = Peer(peer.standing)
            self._missing = self._missing | {member}
            self._owed = self._owed - {member}

    def observe(self, member: int, place_enu_m: tuple[float, float, float], time_s: float) -> None:
        """Compare a member's reported position with its plans.

        Parameters
        ----------
        member : int
            System id of the member.
        place_enu_m : tuple of float
            East, north, up [m].
        time_s : float
            UTC time of the position [s].
        """
        peer = self._peers.get(member)
        if peer is not None:
            self._deviations.note(member, peer, place_enu_m, time_s)

    def receive(self, sender: int, payload: bytes, now_s: float) -> None:
        """Take in a payload of another member. What is wrong is dropped and counted in ``counters``.

        Parameters
        ----------
        sender : int
            System id of the frame's sender.
        payload : bytes
            Payload of its TUNNEL message.
        now_s : float
            UTC time [s].
        """
        peer = self._peers.get(sender)
        if peer is None:
            self.counters["own" if sender == self.member else "stranger"] += 1
            return
        try:
            message = read_payload(payload)
        except PayloadError as error:
            self.counters[f"refused_{error}"] += 1
            return
        self._received_s[sender] = now_s
        if message.standing is not peer.standing:  # The same standing is the same object nearly always.
            self._take_standing(sender, message.standing, now_s)
        if isinstance(message, Fragment):
            self._take_fragment(sender, message, now_s)
        elif isinstance(message, BidMessage):
            if self.auction is not None:
                self.auction.receive(sender, message.bid, now_s)
        elif isinstance(message, ReturnAltitude):
            self.return_altitudes_m[sender] = message.altitude_m
        elif self.member in message.concerned:
            self._take_report(sender, message, now_s)

    def outgoing(self, now_s: float) -> list[bytes]:
        """Return the payloads that are to be broadcast now, within the budget of bytes.

        Parameters
        ----------
        now_s : float
            UTC time [s].
        """
        self._settle(now_s)
        payloads: list[bytes] = []
        is_missing = bool(self._missing) and not self._missing <= self.members_lost(now_s)
        waits = is_missing or self._proposal is not None
        if self._pacing.takes_report(now_s, has_answers=bool(self._owed), waits=waits):
            payloads += self._report(now_s)
        if self._proposal is not None and self._pacing.takes_plan(now_s):
            payloads += plan_payloads(self._standing, self._proposal.plan, self._frame)
        if self._committed is not None and self._pacing.takes_repetition(now_s):
            payloads += plan_payloads(self._standing, self._committed, self._frame)
        if self.auction is not None:
            payloads += self.auction.payloads(self._standing, self._pacing, now_s)
        if self.return_altitude_m is not None and self._pacing.takes_return(now_s):
            payloads.append(return_payload(self._standing, self.return_altitude_m))
        if payloads:
            self._pacing.spend(payloads)
        return payloads

    def _report(self, now_s: float) -> list[bytes]:
        """Return the report: answers that are owed, own numbers, whom it waits for."""
        answers: dict[bool, list[tuple[int, int]]] = {True: [], False: []}
        for other in sorted(self._owed):
            peer = self._peers[other]
            if peer.proposed is not None:
                answers[peer.is_approved].append((other, peer.proposed.number))
        self._owed = frozenset()
        awaited = frozenset[int]()
        if self._proposal is not None:
            awaited = frozenset(self._peers) - self.members_lost(now_s) - self._proposal.approvals
        report = Report(
            self._standing, tuple(answers[True]), tuple(answers[False]), tuple(sorted(self._missing)), awaited
        )
        return report_payloads(report)

    def _take_standing(self, sender: int, standing: Standing, now_s: float) -> None:
        """Take in what a member says of itself, if it is later than what is known."""
        before = self._peers[sender]
        peer = before.after(standing)
        if peer is before:
            return
        self._peers[sender] = peer
        self._missing = self._missing - {sender} if peer.is_known else self._missing | {sender}
        if peer.committed is not None and peer.committed is not before.committed and not before.is_approved:
            self._make_way(peer.committed, now_s)

    def _take_fragment(self, sender: int, part: Fragment, now_s: float) -> None:
        """Take in a part of a plan. Once all are here, the plan is committed or has to be answered."""
        peer, number = self._peers[sender], part.number
        standing = peer.standing or Standing()
        is_committed = number == standing.committed and not peer.is_known
        is_proposed = number == standing.latest and standing.is_pending and peer.proposed is None
        if not is_committed and not is_proposed:
            return
        body = self._parts.joined(sender, part)
        if body is None:
            return
        try:
            plan = read_plan(body, sender, number, self._frame, now_s)
        except PayloadError as error:
            self.counters[f"refused_{error}"] += 1
            return
        if is_committed:
            self._peers[sender], self._missing = replace(peer, committed=plan), self._missing - {sender}
            self._make_way(plan, now_s)
        else:
            self._answer(sender, plan, now_s)

    def _answer(self, sender: int, plan: SharedPlan, now_s: float) -> None:
        """Approve a proposal, or refuse it.

        It is refused if it conflicts with the committed plan, unless what it replaces already comes as near.
        Of two proposals that conflict, the one that comes later in the order is withdrawn. A request is
        always refused, and competes with none.
        """
        own, committed = self._proposal, self._committed
        if plan.is_request:
            self._requests[sender] = plan, now_s
        replaced = self._peers[sender].committed
        is_approved = not plan.is_request and (
            committed is None or not is_too_near(self._margin, plan, replaced, committed, now_s)
        )
        own = None if own is None or own.plan.is_request else own
        if is_approved and own is not None and self._margin(own.plan, plan, now_s) < 0.0:
            is_approved = plan.rank < own.plan.rank
            if is_approved:
                self._end_proposal(Outcome.WITHDRAWN)
        self._peers[sender] = replace(self._peers[sender], proposed=plan, is_approved=is_approved)
        self._owed |= {sender}

    def _make_way(self, plan: SharedPlan, now_s: float) -> None:
        """Withdraw what is proposed if it conflicts with a committed plan that was not approved here."""
        own = self._proposal
        if own is not None and is_too_near(self._margin, own.plan, self._committed, plan, now_s):
            self._end_proposal(Outcome.REFUSED, frozenset({plan.member}))

    def _take_report(self, sender: int, report: Report, now_s: float) -> None:
        """Take in a report that says something to this member."""
        peer, own = self._peers[sender], self._proposal
        if self.member in report.missing:
            self._pacing.note_wanted()
        if self.member in report.awaited and peer.proposed is not None and report.standing == peer.standing:
            self._owed |= {sender}
        if own is None:
            return
        answer = (self.member, own.plan.number)
        if answer in report.refused and not own.plan.is_request:
            self._end_proposal(Outcome.REFUSED, frozenset({sender}))
        elif answer in (*report.approved, *report.refused):
            self._proposal = replace(own, approvals=own.approvals | {sender})
            self._settle(now_s)

    def _settle(self, now_s: float) -> None:
        """Commit the proposal if everybody has approved it, or withdraw it if it is too late."""
        own = self._proposal
        if own is None:
            return
        if now_s >= own.commit_before_s:
            self._end_proposal(Outcome.WITHDRAWN)
            return
        since_s, has = now_s - self._settings.lost_after_s, own.approvals - self._missing
        if not all(other in has or at_s <= since_s for other, at_s in self._received_s.items()):
            return
        if own.plan.is_request:
            self._end_proposal(Outcome.WITHDRAWN)
        else:
            self._outcome = Outcome.APPROVED
            if self._commits_itself:
                self.commit()

    def _end_proposal(self, outcome: Outcome, refused_by: frozenset[int] = frozenset()) -> None:
        """End what is proposed; its number is never committed later."""
        self._outcome, self._refused_by = outcome, refused_by
        if self._proposal is None:
            return
        self._proposal = None
        committed = None if self._committed is None else self._committed.number
        self._standing = Standing(committed, self._standing.latest)
        self._pacing.note_news()

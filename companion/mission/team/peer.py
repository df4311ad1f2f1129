"""A team member's knowledge of another member and of its own proposal."""

from __future__ import annotations

from dataclasses import dataclass

from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.wire import Standing


@dataclass(frozen=True, slots=True)
class Peer:
    """The knowledge of another member.

    Parameters
    ----------
    standing : Standing or None
        The latest that it sent of itself; None if nothing was received.
    committed : SharedPlan or None
        The latest of its committed plans that arrived.
    proposed : SharedPlan or None
        The proposal, if that arrived.
    is_approved : bool
        True if the proposal is approved, False if it is refused.
    """

    standing: Standing | None = None
    committed: SharedPlan | None = None
    proposed: SharedPlan | None = None
    is_approved: bool = False

    @property
    def is_known(self) -> bool:
        """True if the plan is here to which the member says it is committed."""
        if self.standing is None or self.standing.committed is None:
            return True
        return self.committed is not None and self.committed.number == self.standing.committed

    def after(self, standing: Standing) -> Peer:
        """Return what is known once the member has said more of itself."""
        if not standing.is_later_than(self.standing):
            return self
        proposed, committed = self.proposed, self.committed
        if proposed is not None and proposed.number == standing.committed:
            committed = proposed
        is_proposed = standing.is_pending and proposed is not None and proposed.number == standing.latest
        return Peer(standing, committed, proposed if is_proposed else None, is_proposed and self.is_approved)


@dataclass(frozen=True, slots=True)
class Proposal:
    """A member's own proposal.

    Parameters
    ----------
    plan : SharedPlan
        The plan as the others read it.
    commit_before_s : float
        UTC time from which on it is too late to commit it [s].
    approvals : frozenset of int
        Members that approved it.
    """

    plan: SharedPlan
    commit_before_s: float
    approvals: frozenset[int] = frozenset()

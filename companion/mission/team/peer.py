"""A team member's knowledge of another member and of its own proposal."""

from __future__ import annotations

from dataclasses import dataclass

from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.standing import Standing


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
        """True if the plan to which the member is committed has arrived."""
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
        Members that approved it; of a request, those that answered it.
    """

    plan: SharedPlan
    commit_before_s: float
    approvals: frozenset[int] = frozenset()


class Deviations:
    """Which members are off all of their plans that are known, and since when."""

    def __init__(self) -> None:
        self._since_s: dict[int, float] = {}

    def note(self, member: int, peer: Peer, place_enu_m: tuple[float, float, float], time_s: float) -> None:
        """Compare a member's place [m] at a UTC time [s] with what is known of its plans."""
        plans = [plan for plan in (peer.committed, peer.proposed) if plan is not None]
        if not plans or any(plan.is_flown_at(place_enu_m, time_s) for plan in plans):
            self._since_s.pop(member, None)
        else:
            self._since_s.setdefault(member, time_s)

    def members(self, since_s: float) -> frozenset[int]:
        """Return the members that have been off their plans since a UTC time [s] or longer."""
        return frozenset(member for member, off_s in self._since_s.items() if off_s <= since_s)

"""When a plan is due, and why."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

SUSPICION_S = 1.0  # soonest after a plan that signs of another uploader are looked into
RETRY_S = 3.0  # between plans while nothing safe is flown
EARLY_REPLAN_S = 5.0  # soonest after a plan that news of threats makes another
SURPRISE_S = 1.0  # soonest after a plan that what is flown, having become worse, makes another
ENDS_S = 5.0  # sooner than a plan would take effect: then the mission is extended before it ends
BEGIN = "the mission is flown"


@dataclass(frozen=True, slots=True)
class KnownThreats:
    """Which threats a plan knew: how many static ones, and the identities of moving ones."""

    num_static: int = 0
    identities: tuple[str, ...] = ()

    def news(self, now: KnownThreats) -> str:
        """Which threat is known now that was not then; '' if none is."""
        fresh = sorted(set(now.identities) - set(self.identities))
        if fresh:
            return f"news of {', '.join(fresh)}"
        return "news of a static threat" if now.num_static > self.num_static else ""


class PlanSchedule:
    """Decides when to plan next.

    Attributes
    ----------
    occasion : str
        Why the plan that is due, or was made last, is made.
    due_s : float
        When it was found to be due, by the clock [s].
    planned_for : KnownThreats
        What the last plan knew.
    is_urgent : bool
        Whether the plan that is due, or was made last, answers a surprise.
    """

    def __init__(self) -> None:
        self.occasion = BEGIN
        self.due_s = 0.0
        self.planned_for = KnownThreats()
        self._last_s = -math.inf
        self._retry, self._retry_s = "", math.inf
        self.is_urgent = False

    def plan_at_once(self, why: str = BEGIN) -> None:
        """Whatever was flown meanwhile, plan from here at once."""
        self._last_s = -math.inf
        self.occasion = why

    def plan_urgently(self, surprise: str) -> None:
        """What was planned just now is of no use any more: plan at once, in answer to a surprise."""
        self.occasion, self.is_urgent = surprise, True

    def begin(self, now_s: float) -> None:
        """A plan is being made."""
        self._last_s, self._retry, self._retry_s = now_s, "", math.inf
        self.due_s = now_s

    def knows(self, threats: KnownThreats) -> None:
        """The plan being made knows these threats."""
        self.planned_for = threats

    def retry(self, at_s: float, why: str) -> None:
        """Plan again at an instant of the clock [s], whatever the time horizon says."""
        self._retry, self._retry_s = why, at_s

    def is_due(
        self,
        now_s: float,
        horizon_s: float,
        known: KnownThreats,
        suspected: str,
        *,
        flies_to_goal: bool,
        surprise: str = "",
        ends_soon: bool = False,
    ) -> bool:
        """Whether a plan is due now; then :attr:`occasion` tells why.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        horizon_s : float
            The time horizon [s].
        known : KnownThreats
            What is known now.
        suspected : str
            Signs of another uploader, '' without any.
        flies_to_goal : bool
            Whether what is flown leads to the last goal, and passes.
        surprise : str
            How what is flown has become worse since it was judged last; '' if it has not.
        ends_soon : bool
            Whether the mission in the autopilot ends before a later plan could extend it.
        """
        since = now_s - self._last_s
        self.is_urgent = bool(surprise) and since >= SURPRISE_S
        wanted = horizon_s if flies_to_goal else RETRY_S
        if since == math.inf:
            return True
        sooner = (
            (SURPRISE_S, surprise),
            (SUSPICION_S, f"another uploader? {suspected}" if suspected else ""),
            (EARLY_REPLAN_S, self.planned_for.news(known)),
        )
        later = (
            (RETRY_S, "the mission ends" if ends_soon else ""),
            (wanted, f"{wanted:g} s since the last plan"),
        )
        occasion = _first(sooner, since)
        if not occasion and self._retry:
            occasion = self._retry if now_s >= self._retry_s else ""
        elif not occasion:
            occasion = _first(later, since)
        self.occasion = occasion or self.occasion
        return bool(occasion)


def _first(occasions: Iterable[tuple[float, str]], since_s: float) -> str:
    """The first of several occasions, each with when it counts after the last plan [s]; '' if none does."""
    return next((occasion for after_s, occasion in occasions if occasion and since_s >= after_s), "")

"""The times at which plans are due, and their occasions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from companion.flight.state.flight_state import FlightState
from companion.flight.state.world_model import WorldModel

SUSPICION_S = 1.0  # Signs of another uploader cause a plan at the earliest this long after the last.
RETRY_S = 3.0  # Time between plans while no safe path is flown.
EARLY_REPLAN_S = 5.0  # New threats cause a plan at the earliest this long after the last.
SURPRISE_S = 1.0  # A surprise causes a plan at the earliest this long after the last.
ENDS_S = 5.0  # A mission that ends within this time after the next plan takes effect is extended.
WIND_SHARE_MAX = 0.6  # No plans are made in a wind above this share of the cruise airspeed.
BEGIN = "the mission is flown"  # The recorded occasion of a first plan.


@dataclass(frozen=True, slots=True)
class KnownThreats:
    """The threats that a plan knew: the number of static ones, and the identities of moving ones."""

    num_static: int = 0
    identities: tuple[str, ...] = ()

    def news(self, now: KnownThreats) -> str:
        """Return in words which threat is newly known; '' if none is."""
        fresh = sorted(set(now.identities) - set(self.identities))
        if fresh:
            return f"news of {', '.join(fresh)}"
        return "news of a static threat" if now.num_static > self.num_static else ""


class PlanSchedule:
    """Determines when to plan next.

    Attributes
    ----------
    occasion : str
        Reason of the plan that is due, or was made last.
    due_s : float
        When the plan became due, by the clock [s].
    planned_for : KnownThreats
        The threats that the last plan knew.
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
        """Plan at once, whatever has been flown since the last plan."""
        self._last_s = -math.inf
        self.occasion = why

    def plan_urgently(self, surprise: str) -> None:
        """Plan at once in answer to a surprise, because the plan under way has become useless."""
        self.occasion, self.is_urgent = surprise, True

    def begin(self, now_s: float) -> None:
        """Note that a plan is being made."""
        self._last_s, self._retry, self._retry_s = now_s, "", math.inf
        self.due_s = now_s

    def note_known(self, threats: KnownThreats) -> None:
        """Note the threats that the plan under way knows."""
        self.planned_for = threats

    def retry(self, at_s: float, why: str) -> None:
        """Plan again at a time of the clock [s], whatever the time horizon is."""
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
        """Return whether a plan is due now; :attr:`occasion` is then its reason.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        horizon_s : float
            The time horizon [s].
        known : KnownThreats
            The threats known now.
        suspected : str
            Signs of another uploader, '' without any.
        flies_to_goal : bool
            Whether the flown path leads to the last goal, and passes.
        surprise : str
            How the flown path has become worse since it was last judged; '' if it has not.
        ends_soon : bool
            Whether the autopilot's mission ends before a later plan could extend it.
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
    """Return the first occasion whose time [s] since the last plan has passed; '' if there is none."""
    return next((occasion for after_s, occasion in occasions if occasion and since_s >= after_s), "")


def known_threats(world_model: WorldModel, now_s: float) -> KnownThreats:
    """Return the threats that are known now."""
    return KnownThreats(world_model.num_known_threats, tuple(world_model.tracker.received_s(now_s)))


def wind_fault(state: FlightState) -> str:
    """Return why the wind is too strong for planning, '' if it is not."""
    wind = math.hypot(*state.wind_enu_m_s)
    if wind <= WIND_SHARE_MAX * state.rules.vehicle.airspeed_cruise_m_s:
        return ""
    return f"wind of {wind:.0f} m/s, over {100.0 * WIND_SHARE_MAX:.0f} % of cruise"

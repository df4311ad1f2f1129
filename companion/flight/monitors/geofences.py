"""The autopilot's fences, its list and its parameters, looked at again and again and made obstacles of."""

from __future__ import annotations

import logging
import math

from companion.clock import Clock
from companion.config.compose import bounds_of
from companion.errors import CompanionError
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner, after_fences
from companion.flight.state.situation import Situation
from companion.flight.takeover.capability import FENCE_CIRCLE, FENCE_HEIGHT
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.fences import FenceError, FenceLimits, fence_obstacles, fences_of
from companion.types.mission import MissionItem

# Between two readings of a list that has no name. A PX4 that is being read denies uploads meanwhile.
AGAIN_S, AGAIN_BUSY_S = 0.25, 1.0
NAMED_AGAIN_S = 30.0  # of one whose name the autopilot tells, and that is the same
OUTDATED_S = 60.0  # from then on a plan waits for a reading: nobody has kept them up, between two flights say
READING_SHARE = 10.0  # times as long as a reading took is waited for the next: others need the link, too

_log = logging.getLogger(__name__)


class Geofences:
    """Keeps the flight's rules, and the world that plans are made in, up to date with the fences.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, whose rules are to have them.
    situation : Situation
        The situation, with the snapshots that are to have them.
    link : AutopilotLink
        To the autopilot.
    announcer : Announcer
        Told how many there are.
    clock : Clock
        The service's.
    """

    def __init__(
        self,
        flight: StateOwner,
        situation: Situation,
        link: AutopilotLink,
        announcer: Announcer,
        clock: Clock,
    ) -> None:
        self._flight = flight
        self._situation = situation
        self._link = link
        self._announcer = announcer
        self._items: tuple[MissionItem, ...] = ()
        self._limits = FenceLimits()
        self._clock = clock
        self._read_s, self._took_s, self._name, self._has_failed = -math.inf, 0.0, 0, False

    async def catch_up(self) -> None:
        """Read the fences if that is long ago, as at a first plan: :meth:`keep_up` was not asked to."""
        if self._clock.now_s() - self._read_s > max(OUTDATED_S, 2.0 * READING_SHARE * self._took_s):
            await self._read()

    async def keep_up(self) -> None:
        """Read the fences where they are others, or may be; not while a mission is exchanged."""
        since_s, name = self._clock.now_s() - self._read_s, self._name_told()
        dialect = self._link.dialect
        wanted_s = AGAIN_BUSY_S if dialect is None or dialect.stays_busy else AGAIN_S
        if name and name == self._name:
            wanted_s = NAMED_AGAIN_S
        elif name != self._name and not self._has_failed:
            wanted_s = 0.0
        if since_s >= max(wanted_s, READING_SHARE * self._took_s) and not self._link.is_exchanging:
            await self._read()

    def _name_told(self) -> int:
        """The name that the autopilot gives its fences; 0 for none."""
        return 0 if self._link.current is None else self._link.current.fence_id

    async def _read(self) -> None:
        """Read the fences; what cannot be read or understood leaves those that are known."""
        items, limits, name = self._items, self._limits_told(), self._name_told()
        self._read_s = self._clock.now_s()
        try:
            items = await self._link.download_fence()
            self._name, self._has_failed = name, False
        except CompanionError as error:
            self._has_failed = True
            _log.debug("fences: %s", error)
        self._took_s = self._clock.now_s() - self._read_s
        if (items, limits) == (self._items, self._limits):
            return
        self._items, self._limits = items, limits
        self._apply()

    def follow_limits(self) -> bool:
        """Go by the fences that are parameters as they are told now; whether they changed."""
        limits = self._limits_told()
        if limits == self._limits:
            return False
        self._limits = limits
        self._apply()
        return True

    def lay_anew(self) -> None:
        """Fit the fences into the bounds of another mission file."""
        if self._items or self._limits != FenceLimits():
            self._apply()

    def _limits_told(self) -> FenceLimits:
        """What the autopilot's parameters say, once it has told where home is."""
        state = self._flight.state
        told = state.settings
        radius = told.fence_limit_m(told.fence_radius_m, FENCE_CIRCLE)
        height = told.fence_limit_m(told.fence_height_m, FENCE_HEIGHT)
        if state.home_enu_m is None or (radius is None and height is None):
            return FenceLimits()
        # Home is told again and again, a little elsewhere perhaps.
        east, north, up = (float(round(value)) for value in state.home_enu_m)
        return FenceLimits((east, north, up), radius, height)

    def _apply(self) -> None:
        mission = self._flight.state.mission
        try:
            fences = self._limits.added_to(fences_of(self._items, mission.frame))
        except FenceError as error:
            text = f"not understood: {error}"
            self._announcer.decide(DecisionKind.FENCE, text, tell="bad fence", reason=error)
            return
        state = self._flight.apply(after_fences, fence_obstacles(fences, bounds_of(mission)))
        self._situation.follow_fences(state.rules)
        words = f"{len(fences.exclusions)} to stay out of, {len(fences.inclusions)} to stay in{self._limits}"
        self._announcer.decide(DecisionKind.FENCE, words, tell="fences", fences=words)

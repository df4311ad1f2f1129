"""Read the autopilot's fences, its list and its parameters, repeatedly, and make them obstacles."""

from __future__ import annotations

import logging
import math

from companion.clock import Clock
from companion.config.compose import bounds_of
from companion.errors import CompanionError
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner, after_fences
from companion.flight.state.world_model import WorldModel
from companion.flight.takeover.capability import FENCE_CIRCLE, FENCE_HEIGHT
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.fences import FenceError, FenceLimits, fence_obstacles, fences_of
from companion.types.mission import MissionItem

# Time between two readings of a list without an identifier. A PX4 that is being read refuses uploads
# meanwhile.
REPEAT_MIN_S, REPEAT_BUSY_S = 0.25, 1.0
NAMED_REPEAT_S = 30.0  # Time between two readings of a list whose reported identifier stays the same.
READING_MAX_AGE_S = 60.0  # A plan waits for a reading if the last is older, as after a time on the ground.
READING_SHARE = 10.0  # The pause is this multiple of a reading's duration, since others need the link, too.

_log = logging.getLogger(__name__)


class Geofences:
    """Updates the flight's rules and the known world with the autopilot's fences.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, whose rules contain the fences.
    world_model : Situation
        The known world, whose snapshots contain the fences.
    link : AutopilotLink
        The link to the autopilot.
    announcer : Announcer
        Announces the number of fences.
    clock : Clock
        The service's clock.
    """

    def __init__(
        self,
        flight: StateOwner,
        world_model: WorldModel,
        link: AutopilotLink,
        announcer: Announcer,
        clock: Clock,
    ) -> None:
        self._flight = flight
        self._world_model = world_model
        self._link = link
        self._announcer = announcer
        self._items: tuple[MissionItem, ...] = ()
        self._limits = FenceLimits()
        self._clock = clock
        self._read_s, self._took_s, self._name, self._has_failed = -math.inf, 0.0, 0, False

    async def catch_up(self) -> None:
        """Read the fences if the last reading is old, as before a first plan."""
        if self._clock.now_s() - self._read_s > max(READING_MAX_AGE_S, 2.0 * READING_SHARE * self._took_s):
            await self._read()

    async def keep_up(self) -> None:
        """Read the fences if they have changed or may have, but not during a mission exchange."""
        since_s, name = self._clock.now_s() - self._read_s, self._reported_id()
        dialect = self._link.dialect
        wanted_s = REPEAT_BUSY_S if dialect is None or dialect.stays_busy else REPEAT_MIN_S
        if name and name == self._name:
            wanted_s = NAMED_REPEAT_S
        elif name != self._name and not self._has_failed:
            wanted_s = 0.0
        if since_s >= max(wanted_s, READING_SHARE * self._took_s) and not self._link.is_exchanging:
            await self._read()

    def _reported_id(self) -> int:
        """Return the autopilot's identifier of its fences; 0 if it has none."""
        return 0 if self._link.current is None else self._link.current.fence_id

    async def _read(self) -> None:
        """Read the fences; if they cannot be read or interpreted, the known ones stay."""
        items, limits, name = self._items, self._reported_limits(), self._reported_id()
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
        """Apply the fences that are parameters as reported now; return whether they changed."""
        limits = self._reported_limits()
        if limits == self._limits:
            return False
        self._limits = limits
        self._apply()
        return True

    def refit(self) -> None:
        """Fit the fences into the bounds of another mission file."""
        if self._items or self._limits != FenceLimits():
            self._apply()

    def _reported_limits(self) -> FenceLimits:
        """Return the fences in the autopilot's parameters, once its home is known."""
        state = self._flight.state
        settings = state.settings
        radius = settings.fence_limit_m(settings.fence_radius_m, FENCE_CIRCLE)
        height = settings.fence_limit_m(settings.fence_height_m, FENCE_HEIGHT)
        if state.home_enu_m is None or (radius is None and height is None):
            return FenceLimits()
        # Home is reported repeatedly, and may vary a little.
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
        self._world_model.follow_fences(state.rules)
        words = f"{len(fences.exclusions)} to stay out of, {len(fences.inclusions)} to stay in{self._limits}"
        self._announcer.decide(DecisionKind.FENCE, words, tell="fences", fences=words)

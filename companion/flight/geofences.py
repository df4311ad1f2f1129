"""The autopilot's fences, read once a cycle and made obstacles of."""

from __future__ import annotations

import logging
from collections.abc import Callable

from companion.config import MissionConfig
from companion.config.compose import bounds_of
from companion.errors import CompanionError
from companion.flight.cycle import Cycle
from companion.flight.situation import Picture
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.fences import FenceError, fence_obstacles, fences_of
from companion.types.mission import MissionItem

_log = logging.getLogger(__name__)


class Fencing:
    """Keeps cycle and picture up to date with the autopilot's fences.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    link : AutopilotLink
        To the autopilot.
    cycle : Cycle
        Its checker is to know them.
    picture : Picture
        Its snapshots are to have them.
    say : callable
        Takes the kind and text of a decision.
    """

    def __init__(
        self,
        mission: MissionConfig,
        link: AutopilotLink,
        cycle: Cycle,
        picture: Picture,
        say: Callable[[str, str], None],
    ) -> None:
        self._frame = mission.frame
        self._bounds = bounds_of(mission)
        self._link = link
        self._cycle = cycle
        self._picture = picture
        self._say = say
        self._items: tuple[MissionItem, ...] = ()

    async def renew(self) -> None:
        """Read the fences; what cannot be read or understood leaves those that are known."""
        try:
            items = await self._link.download_fence()
        except CompanionError as error:
            _log.debug("fences: %s", error)
            return
        if items == self._items:
            return
        self._items = items
        self._apply()

    def adopt(self, mission: MissionConfig) -> None:
        """Go by another mission file's bounds from now on."""
        self._bounds = bounds_of(mission)
        if self._items:
            self._apply()

    def _apply(self) -> None:
        try:
            fences = fences_of(self._items, self._frame)
        except FenceError as error:
            self._say("fence", f"not understood: {error}")
            return
        obstacles = fence_obstacles(fences, self._bounds)
        self._cycle.set_fences(obstacles)
        self._picture.set_fences(obstacles)
        self._say("fence", f"{len(fences.exclusions)} to stay out of, {len(fences.inclusions)} to stay in")

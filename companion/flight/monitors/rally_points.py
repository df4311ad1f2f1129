"""Read the autopilot's rally points when it reports that they have changed."""

from __future__ import annotations

import logging
import math

from companion.clock import Clock
from companion.errors import CompanionError
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner, after_rally_points, after_rally_reported
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.rally import rally_points_of
from companion.types.mission import MissionItem

REPEAT_MIN_S = 30.0  # Time between two readings, whatever is reported.

_log = logging.getLogger(__name__)


class RallyPoints:
    """Keeps the flight's rally points up to date.

    A PX4 reports an identifier of its list in MISSION_CURRENT; an ArduPlane has the number of points as a
    parameter. If both are 0, nothing is read.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, which contains the rally points.
    link : AutopilotLink
        The link to the autopilot.
    announcer : Announcer
        Announces the number of points.
    clock : Clock
        The service's clock.
    """

    def __init__(self, flight: StateOwner, link: AutopilotLink, announcer: Announcer, clock: Clock) -> None:
        self._flight, self._link = flight, link
        self._announcer, self._clock = announcer, clock
        self._items: tuple[MissionItem, ...] = ()
        self._last_reported: tuple[int, int] = (0, 0)
        self._asked_s = -math.inf

    async def renew(self, *, includes_unnamed: bool = False) -> None:
        """Read the rally points if the autopilot reports that they have changed.

        Parameters
        ----------
        includes_unnamed : bool
            Whether to read also a list without an identifier whose number of points is the same.
        """
        reported, now = self._reported_now(), self._clock.now_s()
        self._flight.apply(after_rally_reported, holds_any=reported != (0, 0))
        is_news = reported != self._last_reported or (includes_unnamed and reported[0] > 0)
        if reported == (0, 0):
            self._items, self._last_reported = (), reported
        elif is_news and now - self._asked_s >= REPEAT_MIN_S:
            self._asked_s = now
            try:
                self._items = await self._link.download_rally_points()
                self._last_reported = reported
            except CompanionError as error:
                _log.debug("rally points: %s", error)
        self._apply()

    def _reported_now(self) -> tuple[int, int]:
        """Return an ArduPlane's number of points, and a PX4's identifier of the list."""
        current = self._link.current
        number = self._flight.state.settings.num_rally_points or 0.0
        return int(number), 0 if current is None else current.rally_id

    def _apply(self) -> None:
        state = self._flight.state
        home_amsl_m = self._link.home_altitude_amsl_m
        places = rally_points_of(self._items, state.mission.frame, home_amsl_m)
        if len(places) == len(state.rally_points) and all(
            math.dist(new, known) < 1.0 for new, known in zip(places, state.rally_points, strict=True)
        ):  # Home's height is reported with every position.
            return
        self._flight.apply(after_rally_points, places)
        num_unplaced = len(self._items) - len(places)
        text = f"{len(places)} rally point{'s' * (len(places) != 1)}"
        unplaced = f", {num_unplaced} at a height that is not known" if num_unplaced else ""
        points = f"{len(places)}{unplaced}"
        self._announcer.decide(DecisionKind.RALLY, text + unplaced, tell="rally points", points=points)

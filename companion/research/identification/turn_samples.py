"""Turns of a recording, and what each tells of how well turns are coordinated."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray, true_airspeed
from companion.tracking.ownship import turned_between
from companion.types.events import AirData, Attitude, Event, GlobalPosition

TURN_S = 10.0  # A longer turn counts as several: it tells more.
GAP_MAX_S = 1.0  # An older airspeed or height is not used.


class TurnListener:
    """Collects the turns of a recording from its events, in their order.

    Attributes
    ----------
    turns : list of ndarray, shape (3,)
        A turn's duration [s], and the two sums of :func:`~companion.tracking.ownship.turned_between`.
    """

    def __init__(self) -> None:
        self.turns: list[FloatArray] = []
        self._air: AirData | None = None
        self._position: GlobalPosition | None = None
        self._before: Attitude | None = None
        self._goes_on = False

    def note(self, event: Event) -> None:
        """Take an event."""
        match event:
            case AirData():
                self._air = event
            case GlobalPosition():
                self._position = event
            case Attitude():
                self._note_attitude(event)

    def _note_attitude(self, attitude: Attitude) -> None:
        before, self._before = self._before, attitude
        air, position = self._air, self._position
        turned = None
        if before is not None and air is not None and position is not None:
            oldest_s = attitude.stamp_s - GAP_MAX_S
            if air.stamp_s >= oldest_s and position.stamp_s >= oldest_s:
                airspeed_m_s = true_airspeed(air.airspeed_m_s, position.altitude_amsl_m)
                turned = turned_between(before, attitude, airspeed_m_s)
        if turned is None or before is None:
            self._goes_on = False
            return
        if not self._goes_on or self.turns[-1][0] >= TURN_S:
            self.turns.append(np.zeros(3))
        self.turns[-1] += (attitude.stamp_s - before.stamp_s, *turned)
        self._goes_on = True

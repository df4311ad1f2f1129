"""Whether the autopilot's positions can be believed: they go on from each other, and it stands by them.

Theory of operation. Between two positions the aircraft has moved by the mean of the velocities told with
them; what is left over is a jump. Jumps add up: where they cancel, the position is back where it was, and is
believed at once. Otherwise nobody here can tell a glitch from its correction, and the position is doubted
until it has gone on without another jump for a while.

References
----------
MAVLink common.xml: EKF_STATUS_REPORT, ESTIMATOR_STATUS, GPS_RAW_INT.
"""

from __future__ import annotations

import math

import numpy as np

from companion.frames import FloatArray
from companion.types.events import EstimatorHealth, GlobalPosition

JUMP_M = 10.0  # estimators correct themselves by less all the time
COMPARED_S = 2.0  # apart at most: over longer times the mean of two velocities tells too little
RECOVERED_S = 3.0  # an estimator that found fault with itself is believed again, so long after

Place = tuple[float, float, float]


class PositionIntegrity:
    """Doubts positions that jump, or that the autopilot's own estimator finds fault with."""

    def __init__(self) -> None:
        self._last: tuple[GlobalPosition, Place] | None = None
        self._offset_m: FloatArray = np.zeros(3)
        self._jumped_s = -math.inf
        self._faults: dict[str, tuple[float, str]] = {}  # by message: when it was found last, and which

    def note_position(self, position: GlobalPosition, place_enu_m: Place, confirm_s: float) -> None:
        """Compare a position with the one before.

        Parameters
        ----------
        position : GlobalPosition
            As it was told.
        place_enu_m : tuple of float
            The same, east, north, up [m].
        confirm_s : float
            How long positions have to go on from each other after a jump, until they are believed [s].
        """
        before, self._last = self._last, (position, place_enu_m)
        if before is None:
            return
        step_s = position.boot_s - before[0].boot_s
        if not 0.0 < step_s <= COMPARED_S:
            return
        if position.stamp_s - self._jumped_s >= confirm_s:
            self._offset_m = np.zeros(3)
        velocity = 0.5 * np.add(position.velocity_enu_m_s, before[0].velocity_enu_m_s)
        gap = np.subtract(place_enu_m, before[1]) - step_s * velocity
        if np.linalg.norm(gap) <= JUMP_M:
            return
        self._offset_m = self._offset_m + gap
        is_back = np.linalg.norm(self._offset_m) <= JUMP_M
        self._jumped_s = -math.inf if is_back else position.stamp_s

    def note_health(self, health: EstimatorHealth) -> None:
        """Take what the estimator, or the receiver, says of itself."""
        if health.fault:
            self._faults[health.source] = (health.stamp_s, health.fault)

    def doubt(self, now_s: float, confirm_s: float) -> str:
        """Why the position is not to be believed now; '' if it is. Times in seconds, as above."""
        if now_s - self._jumped_s < confirm_s:
            return f"it jumped by {np.linalg.norm(self._offset_m):.0f} m"
        return next((fault for at, fault in self._faults.values() if now_s - at < RECOVERED_S), "")

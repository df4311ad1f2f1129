"""Plausibility of the autopilot's positions: they must be continuous, and its estimator must report no fault.

Theory of operation. Between two positions the aircraft moves by the mean of the two reported velocities. Any
remaining difference is a jump. Jumps are added: if the sum is zero, the position is back where it was and is
trusted at once. Otherwise a glitch cannot be distinguished from its correction, and the position is not
trusted until it has continued without another jump for a while.

References
----------
MAVLink common.xml: EKF_STATUS_REPORT, ESTIMATOR_STATUS, GPS_RAW_INT.
"""

from __future__ import annotations

import math

import numpy as np

from companion.frames import FloatArray
from companion.types.events import EstimatorHealth, GlobalPosition

JUMP_M = 10.0  # Estimators correct themselves by smaller amounts all the time.
COMPARED_S = 2.0  # Over longer times the mean of two velocities is too inaccurate.
RECOVERED_S = 3.0  # A position is trusted again this long after the estimator's last fault.

Place = tuple[float, float, float]


class PositionIntegrity:
    """Detects positions that jump, or that the autopilot's estimator reports as faulty."""

    def __init__(self) -> None:
        self._last: tuple[GlobalPosition, Place] | None = None
        self._offset_m: FloatArray = np.zeros(3)
        self._jumped_s = -math.inf
        self._faults: dict[str, tuple[float, str]] = {}  # Time and text of the last fault, by message.

    def note_position(self, position: GlobalPosition, place_enu_m: Place, confirm_s: float) -> None:
        """Compare a position with the previous one.

        Parameters
        ----------
        position : GlobalPosition
            Position as reported.
        place_enu_m : tuple of float
            The same position, east, north, up [m].
        confirm_s : float
            Time without another jump after which positions are trusted again [s].
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
        """Take a health report of the estimator or of the GPS receiver."""
        if health.fault:
            self._faults[health.source] = (health.stamp_s, health.fault)

    def doubt(self, now_s: float, confirm_s: float) -> str:
        """Return why the position is not trusted now; '' if it is. Times are in seconds."""
        if now_s - self._jumped_s < confirm_s:
            return f"it jumped by {np.linalg.norm(self._offset_m):.0f} m"
        return next((fault for at, fault in self._faults.values() if now_s - at < RECOVERED_S), "")

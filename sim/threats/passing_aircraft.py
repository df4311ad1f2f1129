"""An aircraft that flies a given track, and how it is reported."""

from __future__ import annotations

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.frames import FloatArray
from .pursuer import TargetEstimate
from .reports import PROMPT, ReportSource

VELOCITY = 4  # The first column of a track's velocity.


class PassingAircraft:
    """Flies a track, whoever is near. Its place is that which its reports say: where it was when they began.

    Parameters
    ----------
    track : ndarray, shape (N, 7)
        Time [s], east, north, up [m], and the velocity in these [m/s]; behind its end it flies straight on.
    source : ReportSource, optional
        How it is reported; without it nothing is late and nothing lost.
    """

    emitter = mavlink.ADSB_EMITTER_TYPE_LIGHT

    def __init__(self, track: FloatArray, source: ReportSource = PROMPT) -> None:
        self._track, self.source = track, source
        self._now_s = 0.0

    def step(self, now_us: int, duration_s: float, target: TargetEstimate) -> None:
        """Fly on, until ``now_us`` of simulated time."""
        del duration_s, target  # It knows nobody.
        self._now_s = now_us * 1e-6

    @property
    def position(self) -> tuple[float, float]:
        """East and north [m]."""
        return self._at(1), self._at(2)

    @property
    def up_m(self) -> float:
        """Height [m]."""
        return self._at(3)

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        """East and north velocity [m/s]."""
        return self._at(4), self._at(5)

    @property
    def climb_m_s(self) -> float:
        """Upward velocity [m/s]."""
        return self._at(6)

    def _at(self, column: int) -> float:
        track, now_s = self._track, self._now_s - self.source.delay_s
        value = float(np.interp(now_s, track[:, 0], track[:, column]))
        if column >= VELOCITY:
            return value
        return value + max(now_s - float(track[-1, 0]), 0.0) * float(track[-1, column + 3])

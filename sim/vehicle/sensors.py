"""The autopilot's estimate of the true state: noise, and a drift that GPS does not remove."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .fdm import TrueState


@dataclass(frozen=True, slots=True)
class Accuracy:
    """One-sigma errors of the estimate; the drift is a first-order Gauss-Markov process.

    Parameters
    ----------
    horizontal_drift_m, vertical_drift_m : float
        One-sigma error of each horizontal axis and of the height [m].
    drift_time_s : float
        Correlation time of the drift.
    position_m, velocity_m_s, airspeed_m_s, attitude_rad : float
        Standard deviation of the white noise on top.
    """

    horizontal_drift_m: float = 1.0
    vertical_drift_m: float = 1.2
    drift_time_s: float = 60.0
    position_m: float = 0.15
    velocity_m_s: float = 0.1
    airspeed_m_s: float = 0.25
    attitude_rad: float = 0.003


@dataclass(slots=True)
class Estimate:
    """The estimator's output; axes and signs as in :class:`sim.vehicle.fdm.TrueState`.

    ``airspeed_m_s`` is the pitot's, equivalent airspeed; the wind is the velocity of the air.
    """

    east_m: float
    north_m: float
    up_m: float
    velocity_east_m_s: float
    velocity_north_m_s: float
    velocity_up_m_s: float
    bank_rad: float
    pitch_rad: float
    yaw_rad: float
    roll_rate_rad_s: float
    pitch_rate_rad_s: float
    yaw_rate_rad_s: float
    airspeed_m_s: float
    true_airspeed_m_s: float
    wind_east_m_s: float
    wind_north_m_s: float

    @property
    def ground_speed_m_s(self) -> float:
        """Horizontal speed over the ground [m/s]."""
        return math.hypot(self.velocity_east_m_s, self.velocity_north_m_s)

    @property
    def course_rad(self) -> float:
        """Course over the ground, clockwise from north, in [0, 2π) [rad]."""
        return math.atan2(self.velocity_east_m_s, self.velocity_north_m_s) % (2.0 * math.pi)


class Sensors:
    """Makes estimates from true states.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of all its randomness.
    period_s : float
        Time between two calls of :meth:`estimate`.
    accuracy : Accuracy
        Errors of the estimator.
    """

    _WIND_TIME_S = 8.0

    def __init__(
        self, generator: np.random.Generator, period_s: float, accuracy: Accuracy | None = None
    ) -> None:
        self.accuracy = accuracy or Accuracy()
        self._generator = generator
        self._decay = math.exp(-period_s / self.accuracy.drift_time_s)
        self._excitation = math.sqrt(1.0 - self._decay**2)
        self._wind_gain = 1.0 - math.exp(-period_s / self._WIND_TIME_S)
        first = generator.standard_normal(3)
        self._drift = [float(value) for value in first]
        self._wind: tuple[float, float] | None = None
        self._displaced_m = (0.0, 0.0)

    def displace(self, east_m: float, north_m: float) -> None:
        """Shift the estimate against the truth from now on [m], as a faulty receiver does."""
        self._displaced_m = east_m, north_m

    def estimate(self, true: TrueState) -> Estimate:
        """Estimate a state; to be called once in each period."""
        accuracy = self.accuracy
        n = self._generator.standard_normal(13).tolist()
        drift = self._drift = [
            self._decay * old + self._excitation * new for old, new in zip(self._drift, n[:3], strict=True)
        ]
        ratio = true.true_airspeed_m_s / max(true.equivalent_airspeed_m_s, 0.1)
        airspeed = true.equivalent_airspeed_m_s + accuracy.airspeed_m_s * n[3]
        yaw = true.yaw_rad + accuracy.attitude_rad * n[4]
        east_speed = true.velocity_east_m_s + accuracy.velocity_m_s * n[5]
        north_speed = true.velocity_north_m_s + accuracy.velocity_m_s * n[6]
        wind = self._filtered_wind(true, airspeed * ratio, yaw, east_speed, north_speed)
        return Estimate(
            true.east_m
            + self._displaced_m[0]
            + accuracy.horizontal_drift_m * drift[0]
            + accuracy.position_m * n[7],
            true.north_m
            + self._displaced_m[1]
            + accuracy.horizontal_drift_m * drift[1]
            + accuracy.position_m * n[8],
            true.up_m + accuracy.vertical_drift_m * drift[2] + accuracy.position_m * n[9],
            east_speed,
            north_speed,
            true.velocity_up_m_s + accuracy.velocity_m_s * n[10],
            true.bank_rad + accuracy.attitude_rad * n[11],
            true.pitch_rad + accuracy.attitude_rad * n[12],
            yaw,
            true.roll_rate_rad_s,
            true.pitch_rate_rad_s,
            true.yaw_rate_rad_s,
            airspeed,
            airspeed * ratio,
            *wind,
        )

    def _filtered_wind(
        self, true: TrueState, airspeed_m_s: float, yaw_rad: float, east_m_s: float, north_m_s: float
    ) -> tuple[float, float]:
        """Ground velocity less air velocity, smoothed [m/s]."""
        horizontal = airspeed_m_s * math.cos(true.pitch_rad)
        east = east_m_s - horizontal * math.sin(yaw_rad)
        north = north_m_s - horizontal * math.cos(yaw_rad)
        if self._wind is None:
            self._wind = (east, north)
        gain = self._wind_gain
        self._wind = (
            self._wind[0] + gain * (east - self._wind[0]),
            self._wind[1] + gain * (north - self._wind[1]),
        )
        return self._wind

"""Outer loops: L1 guidance of the course, total-energy control of height and airspeed.

References
----------
S. Park, J. Deyst, J. P. How, "A New Nonlinear Guidance Logic for Trajectory Tracking", AIAA
Guidance, Navigation, and Control Conference, 2004 (equation 3; the damping-scaled form with period
and damping ratio as parameters is ArduPlane's, which also adds the loiter law).

A. A. Lambregts, "Vertical Flight Path and Speed Control Autopilot Design Using Total Energy
Principles", AIAA 83-2239, 1983.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.frames import wrapped_angle
from .attitude import GRAVITY_M_S2, Airframe, load_factor
from .sensors import Estimate

Point = tuple[float, float]


class LateralGuidance:
    """L1 guidance along legs and round circles.

    Parameters
    ----------
    period_s, damping : float
        Period [s] and damping of the tracking loop (``NAVL1_PERIOD``, ``NAVL1_DAMPING``).

    Attributes
    ----------
    bearing_rad : float
        Course it steers for, clockwise from north.
    cross_track_m : float
        Distance off the leg, positive to the right of it, or off the circle, positive outside.
    """

    def __init__(self, period_s: float = 17.0, damping: float = 0.75) -> None:
        self.period_s = period_s
        self.damping = damping
        self.bearing_rad = 0.0
        self.cross_track_m = 0.0

    def distance_m(self, ground_speed_m_s: float) -> float:
        """Distance ahead at which the path is steered for, at a speed over the ground."""
        return self.damping * self.period_s * ground_speed_m_s / math.pi

    def _acceleration(self, angle_rad: float, speed: float, distance: float) -> float:
        """Lateral acceleration towards a reference point at the L1 distance, by equation 3."""
        bounded = max(-0.5 * math.pi, min(0.5 * math.pi, angle_rad))
        return 4.0 * self.damping**2 * speed * speed / distance * math.sin(bounded)

    def along(self, estimate: Estimate, start: Point, end: Point, *, beyond: bool = False) -> float:
        """Acceleration to the right [m/s²] along the leg from start to end.

        With ``beyond`` the leg's line goes on past its end; else an end left behind is turned back to.
        """
        speed = max(estimate.ground_speed_m_s, 3.0)
        distance = max(self.distance_m(speed), 1.0)
        leg = (end[0] - start[0], end[1] - start[1])
        length = math.hypot(*leg)
        away = (estimate.east_m - start[0], estimate.north_m - start[1])
        if length < 1.0:
            return self.towards(estimate, end)
        unit = (leg[0] / length, leg[1] / length)
        progress = away[0] * unit[0] + away[1] * unit[1]
        self.cross_track_m = away[0] * unit[1] - away[1] * unit[0]
        gap = math.hypot(*away)
        if gap > distance and progress < -0.7071 * gap:
            return self.towards(estimate, start)
        if progress > length + 3.0 * speed and not beyond:
            return self.towards(estimate, end)
        intercept = math.asin(max(-0.7071, min(0.7071, self.cross_track_m / distance)))
        self.bearing_rad = math.atan2(unit[0], unit[1]) - intercept
        return self._acceleration(wrapped_angle(self.bearing_rad - estimate.course_rad), speed, distance)

    def towards(self, estimate: Estimate, point: Point) -> float:
        """Acceleration to the right [m/s²] straight to a point."""
        speed = max(estimate.ground_speed_m_s, 3.0)
        self.bearing_rad = math.atan2(point[0] - estimate.east_m, point[1] - estimate.north_m)
        angle = wrapped_angle(self.bearing_rad - estimate.course_rad)
        return self._acceleration(angle, speed, max(self.distance_m(speed), 1.0))

    def circle(self, estimate: Estimate, centre: Point, radius_m: float, direction: int) -> float:
        """Acceleration to the right [m/s²] onto and round a circle; direction 1 is clockwise."""
        out = (estimate.east_m - centre[0], estimate.north_m - centre[1])
        gap = max(math.hypot(*out), 1.0)
        capture = self.towards(estimate, centre)
        outward = (estimate.velocity_east_m_s * out[0] + estimate.velocity_north_m_s * out[1]) / gap
        tangent = (
            direction * (estimate.velocity_east_m_s * out[1] - estimate.velocity_north_m_s * out[0]) / gap
        )
        self.cross_track_m = gap - radius_m
        frequency = 2.0 * math.pi / self.period_s
        spring = self.cross_track_m * frequency**2 + outward * 2.0 * self.damping * frequency
        if outward > 0.0 and tangent < 0.0:  # Otherwise a flight towards the centre would pass through it.
            spring = max(spring, 0.0)
        centripetal = tangent * tangent / max(0.5 * radius_m, gap)
        law = direction * (spring + centripetal)
        towards_centre = direction * capture
        if gap > radius_m and towards_centre < direction * law:
            return capture
        self.bearing_rad = math.atan2(out[0], out[1]) + direction * 0.5 * math.pi
        return law


def bank_for(acceleration_m_s2: float, limit_rad: float) -> float:
    """Bank of a level turn with a lateral acceleration [rad], within a limit."""
    return max(-limit_rad, min(limit_rad, math.atan(acceleration_m_s2 / GRAVITY_M_S2)))


@dataclass(slots=True)
class EnergyLimits:
    """Greatest climb and sink rate [m/s], acceleration [m/s²], pitch [rad], lowest airspeed [m/s]."""

    climb_m_s: float = 7.0
    sink_m_s: float = 7.0
    acceleration_m_s2: float = 1.0
    pitch_max_rad: float = math.radians(20.0)
    pitch_min_rad: float = math.radians(-20.0)
    airspeed_min_m_s: float = 12.0


# ArduPlane's TECS counts as underspeed an airspeed below this share of AIRSPEED_MIN, with this throttle.
UNDERSPEED_SHARE, THROTTLE_OPEN = 0.9, 0.95


class EnergyControl:
    """Total energy by throttle, its split into height and speed by pitch.

    Without thrust, pitch alone keeps an airspeed, as in ArduPlane's TECS (``AP_TECS``, its speed weight then
    is 2): the lowest one while the aircraft is too slow at full throttle and too low, the commanded one in
    descents. Close to the ground of a landing it keeps the height more and more (``TECS_LAND_SPDWGT`` -1).

    Parameters
    ----------
    airframe : Airframe
        Flight dynamics, for the feed-forward of drag and angle of attack.
    period_s : float
        Time between two updates.
    height_m : float
        Height at the start; demands move from there no faster than the climb rate allows.
    """

    _HEIGHT_TIME_S = 3.0
    _SPEED_TIME_S = 2.5
    _ENERGY_TIME_S = 2.0

    def __init__(self, airframe: Airframe, period_s: float, height_m: float) -> None:
        self.limits = EnergyLimits()
        self._airframe = airframe
        self._period_s = period_s
        self._height_m = height_m
        self._climb_m_s = 0.0
        self._speed_m_s: float | None = None
        self._pitch_integral = 0.0
        self._throttle_integral = 0.0
        self._is_underspeed = False
        self._energy_m: float | None = None
        self._energy_rate_m_s = 0.0

    def update(
        self,
        estimate: Estimate,
        height_m: float,
        airspeed_m_s: float,
        *,
        has_thrust: bool = True,
        speed_share: float = 0.0,
    ) -> tuple[float, float]:
        """Pitch [rad] and throttle for a height [m] and an equivalent airspeed [m/s].

        ``speed_share`` is the share of pitch that keeps the airspeed instead of the height, without thrust.
        """
        limits, airframe, period = self.limits, self._airframe, self._period_s
        climb = self._climb_demand(estimate, height_m)
        # The pitot's noise is not to shake the throttle.
        previous = estimate.airspeed_m_s if self._speed_m_s is None else self._speed_m_s
        speed = self._speed_m_s = previous + 0.3 * (estimate.airspeed_m_s - previous)
        self._note_energy(estimate)
        speed_error = airspeed_m_s - speed
        acceleration = speed_error / self._SPEED_TIME_S
        acceleration = max(-limits.acceleration_m_s2, min(limits.acceleration_m_s2, acceleration))
        true_speed = max(estimate.true_airspeed_m_s, 8.0)
        lift = airframe.lift_coefficient(max(speed, 8.0), load_factor(estimate.bank_rad))
        available = min(airframe.thrust_max_n, airframe.power_max_w / true_speed)
        spare = (available - airframe.drag_n(speed, lift)) / (airframe.mass_kg * GRAVITY_M_S2)
        # Short of power, speed comes first: what is left of it may go into the climb.
        gamma = min(climb / true_speed, spare - max(0.0, 0.5 * acceleration) / GRAVITY_M_S2)
        # Near the stall no height is worth the speed.
        slow = max(0.0, 1.12 * airframe.stall_speed_m_s - estimate.airspeed_m_s)
        gamma -= 0.06 * slow
        acceleration += slow
        throttle = self._throttle(estimate, gamma, acceleration, (available, lift, speed_error, true_speed))
        if not has_thrust:
            self._note_underspeed(estimate, throttle)
            share = 1.0 if self._is_underspeed else speed_share
            gamma += share * (self._glide_angle(estimate, airspeed_m_s) - gamma)
        error = gamma - estimate.velocity_up_m_s / true_speed
        integral = self._pitch_integral + 0.25 * error * period
        self._pitch_integral = max(-0.12, min(0.12, integral))
        pitch = min(airframe.angle_of_attack_rad(lift), 0.19) * math.cos(estimate.bank_rad)
        pitch += gamma + 0.4 * error + self._pitch_integral
        return max(limits.pitch_min_rad, min(limits.pitch_max_rad, pitch)), throttle

    def _note_underspeed(self, estimate: Estimate, throttle: float) -> None:
        """Note whether the aircraft is too slow at full throttle; it stays so until the height is reached."""
        is_slow = estimate.airspeed_m_s < UNDERSPEED_SHARE * self.limits.airspeed_min_m_s
        is_below = estimate.up_m < self._height_m
        self._is_underspeed = (is_slow and throttle >= THROTTLE_OPEN) or (self._is_underspeed and is_below)

    def _note_energy(self, estimate: Estimate) -> None:
        """Estimate how fast height and speed are lost together, by the lag of a filter."""
        energy = estimate.up_m + estimate.true_airspeed_m_s**2 / (2.0 * GRAVITY_M_S2)
        lagging = energy if self._energy_m is None else self._energy_m
        self._energy_rate_m_s = (energy - lagging) / self._ENERGY_TIME_S
        self._energy_m = lagging + self._energy_rate_m_s * self._period_s

    def _glide_angle(self, estimate: Estimate, airspeed_m_s: float) -> float:
        """Flight path angle [rad] that keeps an airspeed without thrust: in underspeed the lowest one.

        What is lost is measured, since in sinking air more is lost than by drag.
        """
        wanted = self.limits.airspeed_min_m_s if self._is_underspeed else airspeed_m_s
        speed = estimate.airspeed_m_s if self._speed_m_s is None else self._speed_m_s
        most = self.limits.acceleration_m_s2
        acceleration = max(-most, min(most, (wanted - speed) / self._SPEED_TIME_S))
        return self._energy_rate_m_s / max(estimate.true_airspeed_m_s, 8.0) - acceleration / GRAVITY_M_S2

    def _climb_demand(self, estimate: Estimate, height_m: float) -> float:
        """Climb rate [m/s] that follows the demanded height, moved no faster than the limits."""
        limits, period = self.limits, self._period_s
        if abs(self._height_m - estimate.up_m) > 15.0:
            self._height_m = estimate.up_m + math.copysign(15.0, self._height_m - estimate.up_m)
        change = max(-limits.sink_m_s * period, min(limits.climb_m_s * period, height_m - self._height_m))
        self._height_m += change
        self._climb_m_s += 0.05 * (change / period - self._climb_m_s)
        climb = self._climb_m_s + (self._height_m - estimate.up_m) / self._HEIGHT_TIME_S
        return max(-limits.sink_m_s, min(limits.climb_m_s, climb))

    def _throttle(
        self,
        estimate: Estimate,
        gamma_rad: float,
        acceleration_m_s2: float,
        flight: tuple[float, float, float, float],
    ) -> float:
        """Throttle in [0, 1] from the demanded energy rate; ``flight``: thrust, lift, speed error, speed."""
        available, lift, speed_error, true_speed = flight
        airframe = self._airframe
        weight = airframe.mass_kg * GRAVITY_M_S2
        wanted = airframe.drag_n(estimate.airspeed_m_s, lift) + weight * gamma_rad
        wanted += airframe.mass_kg * acceleration_m_s2
        energy_error = true_speed * speed_error / GRAVITY_M_S2 + 0.3 * (self._height_m - estimate.up_m)
        energy_error = max(-15.0, min(15.0, energy_error))
        large = energy_error - max(-4.0, min(4.0, energy_error))
        throttle = wanted / available + 0.004 * energy_error + 0.06 * large + self._throttle_integral
        if 0.0 < throttle < 1.0:
            integral = self._throttle_integral + 0.001 * energy_error * self._period_s
            self._throttle_integral = max(-0.2, min(0.2, integral))
        return max(0.0, min(1.0, throttle))

"""Inner loops: bank and pitch to servo deflections, with turn coordination and yaw damping."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .sensors import Estimate

GRAVITY_M_S2 = 9.80665
_REFERENCE_SPEED_M_S = 25.0


@dataclass(frozen=True, slots=True)
class Airframe:
    """The airframe that the autopilot is tuned for: figures of ``sim/aircraft/small_uav``.

    Parameters
    ----------
    mass_kg, wing_area_m2, wing_span_m, chord_m : float
        Size.
    lift_zero, lift_slope_per_rad : float
        Lift coefficient at no angle of attack, and its slope.
    drag_parasitic, drag_induced : float
        Drag coefficient is ``drag_parasitic + drag_induced · C_L²``.
    thrust_max_n, power_max_w : float
        Greatest thrust, and greatest thrust times airspeed.
    stall_speed_m_s : float
        Equivalent airspeed at which level flight stalls.
    """

    mass_kg: float = 6.0
    wing_area_m2: float = 0.55
    wing_span_m: float = 2.9
    chord_m: float = 0.19
    lift_zero: float = 0.23
    lift_slope_per_rad: float = 5.61
    drag_parasitic: float = 0.043
    drag_induced: float = 0.0231
    thrust_max_n: float = 50.0
    power_max_w: float = 1300.0
    stall_speed_m_s: float = 10.8

    def lift_coefficient(self, airspeed_m_s: float, load_factor: float) -> float:
        """Lift coefficient of flight at an equivalent airspeed [m/s], at most that of the stall."""
        pressure = 0.6125 * airspeed_m_s * airspeed_m_s
        return min(load_factor * self.mass_kg * GRAVITY_M_S2 / (pressure * self.wing_area_m2), 1.5)

    def angle_of_attack_rad(self, lift_coefficient: float) -> float:
        """Angle of attack of a lift coefficient [rad]."""
        return (lift_coefficient - self.lift_zero) / self.lift_slope_per_rad

    def drag_n(self, airspeed_m_s: float, lift_coefficient: float) -> float:
        """Drag at an equivalent airspeed [N]."""
        coefficient = self.drag_parasitic + self.drag_induced * lift_coefficient**2
        return 0.6125 * airspeed_m_s**2 * self.wing_area_m2 * coefficient


def load_factor(bank_rad: float) -> float:
    """Load factor of a level turn, at most 2.5."""
    return min(1.0 / max(math.cos(bank_rad), 0.4), 2.5)


@dataclass(frozen=True, slots=True)
class Servos:
    """Deflections [rad], signs as in the aircraft's file, and throttle in [0, 1]."""

    aileron_rad: float
    elevator_rad: float
    rudder_rad: float
    throttle: float


class AttitudeController:
    """Bank and pitch by rate loops whose gains scale with dynamic pressure.

    Parameters
    ----------
    airframe : Airframe
        Flight dynamics, for the feed-forward parts.
    period_s : float
        Time between two updates.
    """

    _TIME_CONSTANT_S = 0.35
    _ROLL_RATE_MAX = math.radians(75.0)
    _PITCH_RATE_MAX = math.radians(25.0)
    _INTEGRAL_MAX = 0.15

    def __init__(self, airframe: Airframe, period_s: float) -> None:
        self._airframe = airframe
        self._period_s = period_s
        self._roll_integral = 0.0
        self._pitch_integral = 0.0

    def update(self, estimate: Estimate, bank_rad: float, pitch_rad: float, throttle: float) -> Servos:
        """Servo positions that bring the aircraft to a bank and a pitch [rad]."""
        speed = max(estimate.airspeed_m_s, 11.0)
        scale = (_REFERENCE_SPEED_M_S / speed) ** 2
        return Servos(
            self._aileron(estimate, bank_rad, speed, scale),
            self._elevator(estimate, pitch_rad, speed, scale),
            self._rudder(estimate, scale),
            throttle,
        )

    def _aileron(self, estimate: Estimate, bank_rad: float, speed: float, scale: float) -> float:
        wanted = (bank_rad - estimate.bank_rad) / self._TIME_CONSTANT_S
        wanted = max(-self._ROLL_RATE_MAX, min(self._ROLL_RATE_MAX, wanted))
        error = wanted - estimate.roll_rate_rad_s
        integral = self._roll_integral + 0.05 * error * self._period_s
        self._roll_integral = max(-self._INTEGRAL_MAX, min(self._INTEGRAL_MAX, integral))
        # Steady roll rate is 2V/b · (0.17/0.51) a radian of aileron.
        forward = 3.0 * wanted * self._airframe.wing_span_m / (2.0 * speed)
        return forward + 0.05 * scale * error + scale * self._roll_integral

    def _elevator(self, estimate: Estimate, pitch_rad: float, speed: float, scale: float) -> float:
        wanted = (pitch_rad - estimate.pitch_rad) / self._TIME_CONSTANT_S
        wanted = max(-self._PITCH_RATE_MAX, min(self._PITCH_RATE_MAX, wanted))
        bank = max(-1.1, min(1.1, estimate.bank_rad))
        turning = GRAVITY_M_S2 / max(estimate.true_airspeed_m_s, 11.0) * math.tan(bank) * math.sin(bank)
        wanted += turning * math.cos(estimate.pitch_rad)
        error = wanted - estimate.pitch_rate_rad_s
        integral = self._pitch_integral + 0.3 * error * self._period_s
        self._pitch_integral = max(-self._INTEGRAL_MAX, min(self._INTEGRAL_MAX, integral))
        lift = self._airframe.lift_coefficient(speed, load_factor(bank))
        trim = (0.0135 - 1.12 * self._airframe.angle_of_attack_rad(lift)) / 0.99
        damping = 38.6 * wanted * self._airframe.chord_m / (2.0 * speed)
        return trim - damping - scale * (0.12 * error + self._pitch_integral)

    def _rudder(self, estimate: Estimate, scale: float) -> float:
        """Damp yaw about the rate of a coordinated turn, and hold the rudder that such a turn takes."""
        speed = max(estimate.true_airspeed_m_s, 11.0)
        coordinated = GRAVITY_M_S2 / speed * math.sin(estimate.bank_rad) * math.cos(estimate.pitch_rad)
        forward = -1.38 * coordinated * self._airframe.wing_span_m / (2.0 * speed)
        rudder = forward + 0.25 * scale * (estimate.yaw_rate_rad_s - coordinated)
        return max(-0.3, min(0.3, rudder))

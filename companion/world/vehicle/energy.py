"""The power that an aircraft takes, by airspeed, climb and turn.

References
----------
Anderson, *Aircraft Performance and Design*, McGraw-Hill 1999: chapter 5 on the power required (parasite drag
grows with v², induced drag with the square of the lift and with 1/v²), chapter 6 on the level turn and on
energy height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, speed_made_good
from companion.types.path import Path
from companion.world.vehicle.vehicle_model import GRAVITY_M_S2, VehicleModel

# At a lower airspeed no wing flies, and b/v would have no limit: the model takes this one instead.
AIRSPEED_MIN_M_S = 1.0
# A path's step that would need a steeper bank is a corner of its waypoints, not a turn that is flown.
BANK_MAX_RAD = math.radians(75.0)


def level_power_range(airspeed_m_s: float, power_w: float, faster_m_s: float) -> tuple[float, float]:
    """Return the lowest and the highest power of level flight at a higher airspeed that the model can have.

    At the lowest all power is induced and ``P·v`` is constant; at the highest it is parasite and ``P/v³`` is.

    Parameters
    ----------
    airspeed_m_s, power_w : float
        An airspeed [m/s] and the power of level flight there [W].
    faster_m_s : float
        The higher airspeed [m/s].
    """
    ratio = faster_m_s / airspeed_m_s
    return power_w / ratio, power_w * ratio**3


@dataclass(frozen=True, slots=True)
class PowerModel:
    """Power P = a·v³ + b·n²/v + c·ḣ drawn from the battery or the tank, and never below zero.

    The airspeed v is the one that the autopilot reports and is commanded. The load factor n is 1/cos(bank) in
    a level turn. The height h includes v²/2g, so that an acceleration takes as much as the climb to the same
    energy. The losses of motor and propeller are part of the three numbers.

    Parameters
    ----------
    parasite_w_s3_m3 : float
        a, of the drag of the body and the wing's friction, at least 0 [W·s³/m³].
    induced_w_m_s : float
        b, of the drag that lift causes, at least 0 [W·m/s].
    climb_j_m : float
        c, the energy of each metre of climb, at least 0 [J/m].

    Raises
    ------
    ValueError
        For a negative or infinite number.
    """

    parasite_w_s3_m3: float
    induced_w_m_s: float
    climb_j_m: float

    def __post_init__(self) -> None:
        numbers = (self.parasite_w_s3_m3, self.induced_w_m_s, self.climb_j_m)
        if not all(0.0 <= number < math.inf for number in numbers):
            raise ValueError(f"coefficients of power count from zero up: {numbers}")

    @classmethod
    def from_level_flight(
        cls, slow: tuple[float, float], fast: tuple[float, float], climb_j_m: float
    ) -> PowerModel:
        """Return the model with two measured powers.

        Parameters
        ----------
        slow, fast : tuple of float
            Two different airspeeds [m/s], each with the power of level flight at it [W].
        climb_j_m : float
            Energy of each metre of climb [J/m].

        Raises
        ------
        ValueError
            If no a and b of at least zero give these powers; see :func:`level_power_range`.
        """
        (v1, p1), (v2, p2) = slow, fast
        if v1 == v2:
            raise ValueError("the powers of two different airspeeds are needed")
        parasite = (p2 * v2 - p1 * v1) / (v2**4 - v1**4)
        return cls(parasite, v1 * (p1 - parasite * v1**3), climb_j_m)

    def power_w(self, airspeed_m_s: float, climb_rate_m_s: float = 0.0, bank_rad: float = 0.0) -> float:
        """Return the power at an airspeed [m/s], a rate of climb [m/s] and a bank [rad], in watts.

        Airspeeds below :data:`AIRSPEED_MIN_M_S` and banks beyond :data:`BANK_MAX_RAD` count as those.
        """
        airspeed = max(airspeed_m_s, AIRSPEED_MIN_M_S)
        load = 1.0 / math.cos(min(abs(bank_rad), BANK_MAX_RAD))
        level = self.parasite_w_s3_m3 * airspeed**3 + self.induced_w_m_s * load**2 / airspeed
        return max(0.0, level + self.climb_j_m * climb_rate_m_s)

    def energy_j(self, path: Path) -> float:
        """Return the energy of a path with its times, airspeeds and wind [J]; see :meth:`step_energies_j`."""
        return float(self.step_energies_j(path).sum())

    def step_energies_j(self, path: Path) -> FloatArray:
        """Return the energy of each step from one row of a path to the next, shape (N - 1,) [J].

        The bank of each step is that of a coordinated turn by the change of heading, which is the course less
        the drift of the wind triangle.
        """
        steps_s = np.diff(path.times_s)
        airspeed = np.maximum(path.speeds_m_s, AIRSPEED_MIN_M_S)
        turned = np.diff(_headings(path, airspeed))
        turned -= 2.0 * math.pi * np.round(turned / (2.0 * math.pi))
        mean = 0.5 * (airspeed[1:] + airspeed[:-1])
        sideways = mean * turned / np.maximum(steps_s, 1e-9) / GRAVITY_M_S2
        load_square = 1.0 + np.minimum(sideways**2, math.tan(BANK_MAX_RAD) ** 2)
        level_w = self.parasite_w_s3_m3 * mean**3 + self.induced_w_m_s * load_square / mean
        heights = path.positions_enu_m[:, 2] + airspeed**2 / (2.0 * GRAVITY_M_S2)
        energies: FloatArray = np.maximum(level_w * steps_s + self.climb_j_m * np.diff(heights), 0.0)
        return energies

    def leg_energy_j(
        self,
        begin_enu_m: tuple[float, float, float],
        end_enu_m: tuple[float, float, float],
        vehicle: VehicleModel,
        wind_enu_m_s: tuple[float, float],
    ) -> float:
        """Return the energy of a straight leg at cruise in wind [J].

        A leg that is steeper than the aircraft climbs or descends takes as long as that height does.

        Parameters
        ----------
        begin_enu_m, end_enu_m : tuple of float
            East, north, up [m].
        vehicle : VehicleModel
            The aircraft's airspeed at cruise, and its steepest climb and descent.
        wind_enu_m_s : tuple of float
            Velocity of the air, east and north, below the airspeed at cruise [m/s].
        """
        east, north, up = (end - begin for begin, end in zip(begin_enu_m, end_enu_m, strict=True))
        steepest = vehicle.climb_angle_max_rad if up > 0.0 else vehicle.descent_angle_max_rad
        level_m, airspeed = math.hypot(east, north), vehicle.airspeed_cruise_m_s
        slope = min(math.atan2(abs(up), level_m), steepest)
        made_good = speed_made_good(math.atan2(east, north), airspeed * math.cos(slope), wind_enu_m_s)
        seconds = max(level_m / made_good, abs(up) / (airspeed * math.sin(steepest)))
        return max(0.0, self.power_w(airspeed) * seconds + self.climb_j_m * up)


def _headings(path: Path, airspeed_m_s: FloatArray) -> FloatArray:
    """Heading of each row, shape (N,), by the wind triangle; ``airspeed_m_s`` (N,) is above zero."""
    east, north = path.wind_enu_m_s
    courses = path.courses_rad
    across = east * np.cos(courses) - north * np.sin(courses)
    level = airspeed_m_s * np.cos(path.climb_angles_rad)
    headings: FloatArray = courses - np.arcsin(np.clip(across / np.maximum(level, 1e-9), -1.0, 1.0))
    return headings

"""Predict the track that the aircraft flies under the autopilot's guidance along legs and round circles.

A planned path is an intention. The autopilot's guidance flies the mission from the aircraft's present bank
and in the present wind, and this module simulates that flight. Heights change linearly from one waypoint to
the next, no faster than the aircraft climbs; those over ground change likewise. The airspeed stays constant
unless another is commanded.

References
----------
S. Park, J. Deyst, J. P. How, "A New Nonlinear Guidance Logic for Trajectory Tracking", AIAA Guidance,
Navigation, and Control Conference, 2004: the L1 guidance of ArduPlane (``AP_L1_Control``).

T. Stastny, R. Siegwart, "On Flying Backwards: Preventing Run-away of Small, Low-speed, Fixed-wing UAVs in
Strong Winds", IROS 2019: PX4's NPFG. Period and damping mean the same in both laws: for small angles both
turn at 4·pi·damping/period times the ground speed and the angle to the course that leads back to the leg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.steering import STEP, SteeringLaw, fly_targets
from companion.kernels.arrays import FollowedGround, IntArray
from companion.types.mission import ALL_SLOPES, ARDUPLANE_SLOPES, SlopeMin
from companion.types.state import Ownship
from companion.world.vehicle.vehicle_model import VehicleModel

ROLL_LIMIT_RAD = math.radians(50.0)  # A common value of ROLL_LIMIT_DEG, and the default of PX4's FW_R_LIM.
ROLL_RATE_RAD_S = math.radians(60.0)  # The assumed roll rate if no parameter limits it.
# The time constant of the roll is RLL2SRV_TCONST 0.5 s or FW_R_TC 0.4 s, and the delay of the servos.
ROLL_TIME_S = 0.55
L1_PERIOD_S, L1_DAMPING = 17.0, 0.75  # ArduPlane's defaults of NAVL1_PERIOD and NAVL1_DAMPING.
NPFG_PERIOD_S, NPFG_DAMPING = 10.0, 0.7  # PX4's defaults of NPFG_PERIOD and NPFG_DAMPING.
WP_RADIUS_M, NAV_ACC_RAD_M = 50.0, 10.0  # Distances at which ArduPlane and PX4 accept a waypoint.
NAV_FW_ALT_RAD_M = 10.0  # PX4's default: how near its height a waypoint is accepted.
NO_FOLLOWED_GROUND = FollowedGround(np.zeros((2, 2)), np.array([0.0, 0.0, 1.0]), 0.0, 0.0, 0.0)
UNLIMITED_M = 1e6  # A height acceptance beyond all heights: ArduPlane accepts a waypoint at any height.


@dataclass(frozen=True, slots=True)
class Guidance:
    """Parameters of the autopilot's guidance.

    Parameters
    ----------
    flies_by : bool
        Whether the autopilot turns well before a waypoint, as ArduPlane does at WP_RADIUS. A PX4 flies to
        within NAV_ACC_RAD of it.
    l1_period_s : float
        Period of the tracking loop: NAVL1_PERIOD or NPFG_PERIOD [s].
    l1_damping : float
        Damping of the tracking loop: NAVL1_DAMPING or NPFG_DAMPING.
    bank_max_rad : float
        Largest bank angle: ROLL_LIMIT_DEG or FW_R_LIM [rad].
    roll_rate_max_rad_s : float
        Largest rate of change of the bank angle [rad/s].
    acceptance_radius_m : float
        Distance at which a waypoint is accepted: NAV_ACC_RAD, or WP_RADIUS before a right angle [m].
        Before a lesser turn, ArduPlane's is less in proportion (``AP_L1_Control::turn_distance``).
    loiter_radius_m : float
        Radius of circles that name none: WP_LOITER_RAD or NAV_LOITER_RAD, positive clockwise [m].
    roll_time_s : float
        Time constant with which the bank follows its command [s].
    coordination : float
        Rate of turn as a share of that of a coordinated turn with the same bank.
    climb_rate_max_m_s, sink_rate_max_m_s : float
        Largest rates of climb and descent [m/s].
    height_acceptance_m : float
        Height difference at which a waypoint is accepted: NAV_FW_ALT_RAD [m].
    slope_min : SlopeMin
        A smaller change of height is made at once instead of along the leg.
    circle_stretch : float
        Ratio of flown to commanded circle radius: ArduPlane widens circles, and WP_RADIUS, by the square of
        true over equivalent airspeed (``AP_L1_Control::loiter_radius``, ``turn_distance``).
    airspeed_m_s : float
        True airspeed commanded after the first target; 0 keeps the present airspeed [m/s].
    acceleration_m_s2 : float
        Acceleration towards the commanded airspeed [m/s²].
    ground : FollowedGround
        The ground, if the targets' heights are kept over it.
    """

    flies_by: bool
    l1_period_s: float
    l1_damping: float
    bank_max_rad: float
    roll_rate_max_rad_s: float
    acceptance_radius_m: float
    loiter_radius_m: float
    roll_time_s: float = ROLL_TIME_S
    coordination: float = 1.0
    climb_rate_max_m_s: float = 5.0
    sink_rate_max_m_s: float = 5.0
    height_acceptance_m: float = UNLIMITED_M
    slope_min: SlopeMin = ALL_SLOPES
    circle_stretch: float = 1.0
    airspeed_m_s: float = 0.0
    acceleration_m_s2: float = 0.0
    ground: FollowedGround = NO_FOLLOWED_GROUND

    def __post_init__(self) -> None:
        positive = (
            self.l1_period_s, self.l1_damping, self.bank_max_rad, self.roll_rate_max_rad_s, self.roll_time_s,
            self.climb_rate_max_m_s, self.sink_rate_max_m_s, self.coordination,
        )  # fmt: skip
        if not min(positive) > 0.0 or not self.bank_max_rad < 0.5 * math.pi:
            raise ValueError("period, damping, rates and the bank count from above zero")

    def law(self) -> SteeringLaw:
        """Return the kernels' form."""
        return SteeringLaw(
            period=self.l1_period_s,
            damping=self.l1_damping,
            bank_max=self.bank_max_rad,
            roll_rate_max=self.roll_rate_max_rad_s,
            roll_time=self.roll_time_s,
            coordination=self.coordination,
            acceptance=self.circle_stretch * self.acceptance_radius_m,
            height_acceptance=self.height_acceptance_m,
            waits_for_turns=self.flies_by,
            climb_rate_max=self.climb_rate_max_m_s,
            sink_rate_max=self.sink_rate_max_m_s,
            climb_slope_min=self.slope_min.climb_m,
            descent_slope_min=self.slope_min.descent_m,
            airspeed=self.airspeed_m_s,
            acceleration=self.acceleration_m_s2,
        )


def default_guidance(*, flies_by: bool, vehicle: VehicleModel) -> Guidance:
    """Return the guidance assumed until the parameters are read: the autopilot's defaults.

    Parameters
    ----------
    flies_by : bool
        Whether the autopilot turns before a waypoint, as ArduPlane does.
    vehicle : VehicleModel
        The aircraft's radius of turn and climb angle.
    """
    return Guidance(
        flies_by=flies_by,
        l1_period_s=L1_PERIOD_S if flies_by else NPFG_PERIOD_S,
        l1_damping=L1_DAMPING if flies_by else NPFG_DAMPING,
        bank_max_rad=ROLL_LIMIT_RAD,
        roll_rate_max_rad_s=ROLL_RATE_RAD_S,
        acceptance_radius_m=WP_RADIUS_M if flies_by else NAV_ACC_RAD_M,
        loiter_radius_m=vehicle.turn_radius_min_m,
        climb_rate_max_m_s=vehicle.airspeed_cruise_m_s * math.sin(vehicle.climb_angle_max_rad),
        sink_rate_max_m_s=vehicle.airspeed_cruise_m_s * math.sin(vehicle.descent_angle_max_rad),
        height_acceptance_m=UNLIMITED_M if flies_by else NAV_FW_ALT_RAD_M,
        slope_min=ARDUPLANE_SLOPES if flies_by else ALL_SLOPES,
    )


@dataclass(frozen=True, slots=True)
class Track:
    """A predicted track, row by row; the first row is its start.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Time since the start [s].
    positions_enu_m : ndarray, shape (K, 3)
        Positions [m].
    courses_rad : ndarray, shape (K,)
        Courses over the ground, clockwise from north.
    banks_rad : ndarray, shape (K,)
        Bank angles, positive to the right.
    climb_angles_rad : ndarray, shape (K,)
        Flight path angles, positive up.
    reached : ndarray, shape (K,)
        Number of the target that the aircraft flies to. The number of targets means that the last is passed:
        the aircraft is on the final circle, or beyond the last leg.
    """

    times_s: FloatArray
    positions_enu_m: FloatArray
    courses_rad: FloatArray
    banks_rad: FloatArray
    climb_angles_rad: FloatArray
    reached: IntArray

    def __len__(self) -> int:
        return len(self.times_s)

    def until(self, row: int) -> Track:
        """Return the track up to and including a row."""
        end = row + 1
        return Track(
            self.times_s[:end], self.positions_enu_m[:end], self.courses_rad[:end], self.banks_rad[:end],
            self.climb_angles_rad[:end], self.reached[:end],
        )  # fmt: skip

    def aircraft_at(self, row: int, ownship: Ownship) -> Ownship:
        """Return the aircraft at a row after the first: place, course, bank and ground speed are the row's.

        Parameters
        ----------
        row : int
            The row.
        ownship : Ownship
            The aircraft that flies the track, for everything else.
        """
        east, north, up = (float(value) for value in self.positions_enu_m[row])
        step = self.positions_enu_m[row] - self.positions_enu_m[row - 1]
        step_s = float(self.times_s[row] - self.times_s[row - 1])
        return replace(
            ownship,
            position_enu_m=(east, north, up),
            course_rad=float(self.courses_rad[row]),
            bank_rad=float(self.banks_rad[row]),
            ground_speed_m_s=float(np.hypot(step[0], step[1])) / step_s,
        )


def track_of_legs(
    guidance: Guidance,
    ownship: Ownship,
    targets_enu_m: FloatArray,
    *,
    before_enu_m: FloatArray | None = None,
    loiter: tuple[FloatArray, float] | None = None,
    ends_s: float,
    step_s: float = 0.25,
) -> Track:
    """Simulate the flight to targets one after the other, and round the circle after the last.

    Parameters
    ----------
    guidance : Guidance
        The guidance's parameters.
    ownship : Ownship
        Position, ground velocity, wind and bank at the start.
    targets_enu_m : ndarray, shape (M, 3)
        Positions of the targets in their order, at least one [m].
    before_enu_m : ndarray, shape (3,), optional
        Start of the leg to the first target [m]. If omitted, the aircraft flies to it directly.
    loiter : tuple of (ndarray, shape (3,), float), optional
        Centre and radius of the final circle, positive clockwise [m]. A radius of 0 means the autopilot's
        own. If omitted, the last leg continues.
    ends_s : float
        Duration of the flight [s].
    step_s : float
        Time between two rows, rounded to whole integration steps [s].
    """
    targets = np.asarray(targets_enu_m, dtype=np.float64).reshape(-1, 3)
    before = np.asarray(ownship.position_enu_m if before_enu_m is None else before_enu_m, dtype=np.float64)
    circle = np.zeros(4)
    if loiter is not None:
        circle[:3] = loiter[0]
        circle[3] = guidance.circle_stretch * (loiter[1] or guidance.loiter_radius_m)
    return _flown(guidance, ownship, np.vstack([before[None, :], targets]), circle, ends_s, step_s)


def track_of_circle(
    guidance: Guidance,
    ownship: Ownship,
    centre_enu_m: FloatArray,
    radius_m: float,
    ends_s: float,
    step_s: float = 0.25,
) -> Track:
    """Simulate the flight onto a circle and round it.

    Parameters
    ----------
    guidance : Guidance
        The guidance's parameters.
    ownship : Ownship
        Position, ground velocity, wind and bank at the start.
    centre_enu_m : ndarray, shape (3,)
        Centre of the circle, at its height [m].
    radius_m : float
        Radius, positive clockwise [m]; 0 means the autopilot's own.
    ends_s : float
        Duration of the flight [s].
    step_s : float
        Time between two rows, rounded to whole integration steps [s].
    """
    radius = guidance.circle_stretch * (radius_m or guidance.loiter_radius_m)
    circle = np.array([*np.asarray(centre_enu_m, dtype=np.float64), radius])
    return _flown(guidance, ownship, circle[None, :3].copy(), circle, ends_s, step_s)


def _flown(
    guidance: Guidance,
    ownship: Ownship,
    places: FloatArray,
    circle: FloatArray,
    ends_s: float,
    step_s: float,
) -> Track:
    """Simulate the flight along ``places`` (M + 1, 3) [m], then round ``circle`` (4,) [m]."""
    wind_east, wind_north = ownship.wind_enu_m_s
    air_east = ownship.ground_speed_m_s * math.sin(ownship.course_rad) - wind_east
    air_north = ownship.ground_speed_m_s * math.cos(ownship.course_rad) - wind_north
    state = np.array(
        [
            *ownship.position_enu_m,
            math.atan2(air_east, air_north),
            ownship.bank_rad,
            math.hypot(air_east, air_north),
        ]
    )
    every = max(1, round(step_s / STEP))
    rows = np.empty((1 + max(0, math.ceil(ends_s / (every * STEP) - 1e-9)), 7))
    fly_targets(state, (wind_east, wind_north), places, circle, guidance.law(), guidance.ground, every, rows)
    rows[0, 3] = ownship.course_rad
    rows[0, 5] = ownship.flight_path_angle_rad
    courses = rows[:, 3] % (2.0 * math.pi)
    courses[courses >= 2.0 * math.pi] = 0.0  # The remainder of a tiny negative angle rounds up to 2π.
    return Track(
        times_s=np.arange(len(rows), dtype=np.float64) * (every * STEP),
        positions_enu_m=rows[:, :3].copy(),
        courses_rad=courses,
        banks_rad=rows[:, 4].copy(),
        climb_angles_rad=rows[:, 5].copy(),
        reached=rows[:, 6].astype(np.int64),
    )

"""The aircraft under its autopilot's control loops: steered along legs, round circles, or level."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..autopilot.autopilot_parameters import Parameters
from .attitude import Airframe, AttitudeController, load_factor
from .fdm import STEP_S, FlightDynamics, Start
from .outer_loops import EnergyControl, LateralGuidance, Point, bank_for
from .sensors import Estimate, Sensors
from .simulated_battery import SimulatedBattery
from .true_ground import StoredGround, TrueGround

FDM_STEPS_A_TICK = 2
TICK_S = FDM_STEPS_A_TICK * STEP_S
_TICKS_A_GUIDANCE = 3
CATAPULT_M = 2.0
_LOAD_MARGIN = 0.8
_RPM_FULL = 7_000.0  # Speed of the motor at full throttle.
_LANDING_M = 15.0  # Below this height over a landing, pitch is more and more for the height.
_BANK_LIMIT_MIN = math.radians(15.0)
_PREVENTED_BANK_MIN = math.radians(25.0)  # ArduPlane's stall prevention allows this much at any airspeed.


@dataclass(frozen=True, slots=True)
class FirstClimb:
    """A climb towards ``target_m`` with little bank, which ends above ``until_m`` [m]."""

    until_m: float
    target_m: float
    bank_max_rad: float


@dataclass(frozen=True, slots=True)
class Leg:
    """From start to end [m]; the height changes along it from ``start_height_m`` to ``height_m``.

    With ``follows_ground`` the height over ground changes so.
    """

    start: Point
    end: Point
    start_height_m: float
    height_m: float
    follows_ground: bool = False


@dataclass(frozen=True, slots=True)
class Circle:
    """Round a centre; direction 1 is clockwise.

    From ``begins``, east, north, up [m], the change of height is spread over the way to the centre.
    """

    centre: Point
    radius_m: float
    direction: int
    height_m: float
    begins: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Level:
    """A bank held, at a height."""

    bank_rad: float
    height_m: float


Steering = Leg | Circle | Level


@dataclass(slots=True)
class NavigationOutput:
    """The loops' last demands and errors."""

    bank_rad: float = 0.0
    pitch_rad: float = 0.0
    throttle: float = 0.0
    bearing_rad: float = 0.0
    cross_track_m: float = 0.0
    height_error_m: float = 0.0


class Flight:
    """Flight dynamics, sensors and control loops, advanced together.

    Parameters
    ----------
    dynamics : FlightDynamics
        The aircraft.
    sensors : Sensors
        The autopilot's estimator.
    parameters : Parameters
        Limits and tuning, read at every guidance update.
    battery : SimulatedBattery, optional
        Gives the power of the thrust; without one nothing is used up.
    ground : TrueGround, optional
        The ground, of which the autopilot stores heights; by default it is flat at the origin's height.

    Attributes
    ----------
    sensors : Sensors
        The same.
    steering : Steering
        Target to fly to.
    airspeed_m_s : float
        Demanded equivalent airspeed.
    goes_beyond : bool
        Whether a leg is flown on past its end.
    climb_slope_min_m, descent_slope_min_m : float
        Climb and descent from which a leg is flown as a slope; lesser ones are made at once.
    first_climb : FirstClimb or None
        Climb that is made before anything else.
    is_standing : bool
        Whether the aircraft stands on the ground.
    has_thrust : bool
        Whether the engine runs; without thrust the throttle has no effect.
    stored_ground : StoredGround or None
        Heights of the ground that the autopilot has.
    """

    def __init__(
        self,
        dynamics: FlightDynamics,
        sensors: Sensors,
        parameters: Parameters,
        battery: SimulatedBattery | None = None,
        ground: TrueGround | None = None,
    ) -> None:
        self.dynamics = dynamics
        self.ground = ground
        self.sensors = sensors
        self.battery = battery
        self._parameters = parameters
        self._airframe = Airframe()
        self._attitude = AttitudeController(self._airframe, TICK_S)
        self.lateral = LateralGuidance()
        self.energy = EnergyControl(self._airframe, _TICKS_A_GUIDANCE * TICK_S, dynamics.state.up_m)
        self.estimate: Estimate = sensors.estimate(dynamics.state)
        self.output = NavigationOutput(throttle=dynamics.trim_throttle)
        self.steering: Steering = Level(0.0, dynamics.state.up_m)
        self.airspeed_m_s = dynamics.state.equivalent_airspeed_m_s
        self.goes_beyond = False
        self.climb_slope_min_m, self.descent_slope_min_m = 0.0, 0.0
        self.first_climb: FirstClimb | None = None
        self.is_standing = False
        self.has_thrust = True
        self.stored_ground = None if ground is None else ground.stored()
        self._ticks = 0

    @property
    def ground_up_m(self) -> float:
        """Height of the ground below the aircraft [m]."""
        true = self.dynamics.state
        return 0.0 if self.ground is None else self.ground.up_m(true.east_m, true.north_m)

    @property
    def position(self) -> Point:
        """Estimated east and north [m]."""
        return self.estimate.east_m, self.estimate.north_m

    @property
    def motor_rpm(self) -> float:
        """Speed of the motor [1/min]."""
        return _RPM_FULL * self.output.throttle**0.5 if self.has_thrust and not self.is_standing else 0.0

    def tick(self) -> None:
        """Sense, guide (every third time), move the servos, and fly for one tick; on the ground, nothing."""
        if self.battery is not None:
            thrust_power_w = 0.0 if self.is_standing else self.dynamics.thrust_power_w
            self.battery.drain(thrust_power_w, TICK_S)
        if self.is_standing:
            return
        estimate = self.estimate = self.sensors.estimate(self.dynamics.state)
        if self._ticks % _TICKS_A_GUIDANCE == 0:
            self._end_first_climb(estimate)
            self._guide(estimate)
        self._ticks += 1
        output = self.output
        servos = self._attitude.update(estimate, output.bank_rad, output.pitch_rad, output.throttle)
        throttle = servos.throttle if self.has_thrust else 0.0
        self.dynamics.command(servos.aileron_rad, servos.elevator_rad, servos.rudder_rad, throttle)
        self.dynamics.run(FDM_STEPS_A_TICK)

    def stand(self, up_m: float) -> None:
        """Come to rest at the aircraft's place, on ground of a height [m]."""
        self.is_standing = True
        self.dynamics.state = replace(
            self.dynamics.state, up_m=up_m, bank_rad=0.0, pitch_rad=0.0, true_airspeed_m_s=0.0,
            velocity_east_m_s=0.0, velocity_north_m_s=0.0, velocity_up_m_s=0.0, equivalent_airspeed_m_s=0.0,
        )  # fmt: skip
        self.estimate = replace(
            self.estimate, up_m=up_m, bank_rad=0.0, pitch_rad=0.0, airspeed_m_s=0.0, true_airspeed_m_s=0.0,
            velocity_east_m_s=0.0, velocity_north_m_s=0.0, velocity_up_m_s=0.0,
        )  # fmt: skip

    def launch(self) -> None:
        """Leave the ground by a catapult, straight ahead at cruising speed."""
        true = self.dynamics.state
        self.dynamics.launch(
            Start(true.east_m, true.north_m, true.up_m + CATAPULT_M, true.yaw_rad, self.airspeed_m_s)
        )
        self.is_standing = False
        self.estimate = self.sensors.estimate(self.dynamics.state)
        self.energy = EnergyControl(self._airframe, _TICKS_A_GUIDANCE * TICK_S, self.estimate.up_m)

    def target_height_m(self) -> float:
        """Height to fly at now: along a leg that climbs or descends more than a little, a slope."""
        steering = self.steering
        if isinstance(steering, Circle) and steering.begins is not None:
            *begin, height = steering.begins
            steering = Leg((begin[0], begin[1]), steering.centre, height, steering.height_m)
        if not isinstance(steering, Leg):
            return steering.height_m
        if steering.follows_ground and self.stored_ground is not None:
            return self._height_over_ground(steering, self.stored_ground)
        change = steering.height_m - steering.start_height_m
        if -self.descent_slope_min_m < change < self.climb_slope_min_m:
            return steering.height_m
        return steering.start_height_m + change * max(0.0, min(1.0, progress_on(steering, self.position)))

    def _height_over_ground(self, leg: Leg, ground: StoredGround) -> float:
        """Height over ground between those at the leg's ends, and more where it rises steeply ahead."""
        first, last = leg.start_height_m - ground.up_m(*leg.start), leg.height_m - ground.up_m(*leg.end)
        share = max(0.0, min(1.0, progress_on(leg, self.position)))
        slope = self._parameters["TECS_CLMB_MAX"] / max(self.estimate.ground_speed_m_s, 3.0)
        ahead = ground.climb_ahead_m(self.position, leg.end, self._parameters["TERRAIN_LOOKAHD"], slope)
        if last - first <= -self.descent_slope_min_m:
            ahead = max(0.0, ahead + last - first)
        return first + share * (last - first) + ground.up_m(*self.position) + ahead

    def _guide(self, estimate: Estimate) -> None:
        parameters, output, steering = self._parameters, self.output, self.steering
        self.lateral.period_s = max(parameters["NAVL1_PERIOD"], 5.0)
        self.lateral.damping = max(parameters["NAVL1_DAMPING"], 0.4)
        limit = self._bank_limit(estimate)
        climb = self.first_climb
        if climb is not None:
            limit = min(limit, climb.bank_max_rad)
        if isinstance(steering, Level):
            output.bank_rad = max(-limit, min(limit, steering.bank_rad))
            self.lateral.cross_track_m = 0.0
        elif isinstance(steering, Leg):
            turn = self.lateral.along(estimate, steering.start, steering.end, beyond=self.goes_beyond)
            output.bank_rad = bank_for(turn, limit)
        else:
            turn = self.lateral.circle(estimate, steering.centre, steering.radius_m, steering.direction)
            output.bank_rad = bank_for(turn, limit)
        airspeed_m_s = self._prevent_stall(estimate)
        limits = self.energy.limits
        limits.climb_m_s, limits.sink_m_s = parameters.climb_rates_m_s
        limits.pitch_max_rad = math.radians(parameters["PTCH_LIM_MAX_DEG"])
        limits.pitch_min_rad = math.radians(parameters["PTCH_LIM_MIN_DEG"])
        limits.airspeed_min_m_s = parameters["AIRSPEED_MIN"]
        height = self.target_height_m() if climb is None else climb.target_m
        output.pitch_rad, output.throttle = self.energy.update(
            estimate, height, airspeed_m_s, has_thrust=self.has_thrust,
            speed_share=self._speed_share(steering),
        )  # fmt: skip
        output.bearing_rad = self.lateral.bearing_rad
        output.cross_track_m = self.lateral.cross_track_m
        output.height_error_m = height - estimate.up_m

    def _end_first_climb(self, estimate: Estimate) -> None:
        """End the first climb once it is high enough; a descent begins there."""
        climb, circle = self.first_climb, self.steering
        if climb is None or estimate.up_m <= climb.until_m:
            return
        self.first_climb = None
        if isinstance(circle, Circle):
            begins = (*self.position, estimate.up_m) if circle.height_m < estimate.up_m else None
            self.steering = replace(circle, begins=begins)

    def _speed_share(self, steering: Steering) -> float:
        """Return the share of pitch that holds the airspeed without thrust: 1, but less near a landing."""
        left = self.estimate.up_m - steering.height_m
        if isinstance(steering, Leg) and self.goes_beyond:
            return max(0.0, min(1.0, left / _LANDING_M))
        return 1.0 if left > 0.0 else 0.0

    def _bank_limit(self, estimate: Estimate) -> float:
        """Bank whose load factor stays clear of the stall at this airspeed [rad]."""
        load = _LOAD_MARGIN * (estimate.airspeed_m_s / self._airframe.stall_speed_m_s) ** 2
        limit = math.radians(self._parameters["ROLL_LIMIT_DEG"])
        return min(limit, max(_BANK_LIMIT_MIN, math.acos(min(1.0, 1.0 / max(load, 1.0)))))

    def _prevent_stall(self, estimate: Estimate) -> float:
        """Limit the bank as ArduPlane's stall prevention does; return the airspeed to be held [m/s].

        Its TECS holds AIRSPEED_MIN times the root of the load factor that guidance asks for.
        """
        slowest_m_s, wanted = self._parameters.stall_prevention_m_s, self.output.bank_rad
        if slowest_m_s:
            cosine = min(1.0, (slowest_m_s / max(estimate.airspeed_m_s, 1.0)) ** 2)
            limit = max(_PREVENTED_BANK_MIN, math.acos(cosine))
            self.output.bank_rad = max(-limit, min(limit, wanted))
        return max(self.airspeed_m_s, slowest_m_s * math.sqrt(load_factor(wanted)))


def progress_on(leg: Leg, position: Point) -> float:
    """Part of the leg that lies behind a position: 0 at the start, 1 at the end or abeam of it."""
    along = (leg.end[0] - leg.start[0], leg.end[1] - leg.start[1])
    square = along[0] ** 2 + along[1] ** 2
    if square < 1.0:
        return 1.0
    away = (position[0] - leg.start[0], position[1] - leg.start[1])
    return (away[0] * along[0] + away[1] * along[1]) / square

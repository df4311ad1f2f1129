"""The flight dynamics: JSBSim with the small UAV of ``sim/vehicle/aircraft``, wind and turbulence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import jsbsim
import numpy as np

from companion.frames import FloatArray, LocalFrame
from ..projection import FastProjection

STEP_S = 1.0 / 120.0
AIRCRAFT_PATH = Path(__file__).parent / "aircraft"

_FOOT_M = 0.3048
_KNOT_M_S = 0.514444
_MILSPEC = 3
_TRIM_STEPS_MAX = 20
_TRIM_CHANGE_RAD = 1e-4  # Differences over this angle give the derivatives.
_TRIM_TOLERANCE_RAD = 1e-9
_SETTLING_RUNS = 300
# MIL-F-8785C: wind at 20 ft [ft/s], which rules below 2000 ft, and the severity index that rules above.
# JSBSim takes the altitude above the sea for the height above ground, so over high ground the second
# one applies: 1 and 3 give gusts (1.0 and 2.0 m/s, one sigma) like those of the first one near the ground.
_TURBULENCE = {"light": (25.0, 1.0), "moderate": (50.0, 3.0)}
_READ = (
    "position/lat-geod-deg",
    "position/long-gc-deg",
    "position/geod-alt-ft",
    "velocities/v-east-fps",
    "velocities/v-north-fps",
    "velocities/v-down-fps",
    "attitude/phi-rad",
    "attitude/theta-rad",
    "attitude/psi-rad",
    "velocities/p-rad_sec",
    "velocities/q-rad_sec",
    "velocities/r-rad_sec",
    "velocities/vt-fps",
    "velocities/ve-fps",
)
_THRUST = "propulsion/thrust-lbs"
_POUND_N = 4.4482216
_COMMANDS = ("fcs/aileron-cmd-rad", "fcs/elevator-cmd-rad", "fcs/rudder-cmd-rad", "fcs/throttle-cmd")


@dataclass(frozen=True, slots=True)
class Weather:
    """Steady wind, the velocity of the air over the ground [m/s], and ``none|light|moderate`` turbulence."""

    wind_east_m_s: float = 0.0
    wind_north_m_s: float = 0.0
    turbulence: str = "none"


@dataclass(slots=True)
class TrueState:
    """The true state; angles in radians, yaw clockwise from north, body rates about x, y, z."""

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
    true_airspeed_m_s: float
    equivalent_airspeed_m_s: float


@dataclass(frozen=True, slots=True)
class Start:
    """The start of a flight: course over the ground clockwise from north, equivalent airspeed."""

    east_m: float
    north_m: float
    up_m: float
    course_rad: float
    equivalent_airspeed_m_s: float


def _node(manager: jsbsim.FGPropertyManager, name: str) -> jsbsim.FGPropertyNode:
    """Property by its name; looked up once, as it is read at every step."""
    node = manager.get_node(name)
    if node is None:
        raise KeyError(name)
    return node


class FlightDynamics:
    """One JSBSim aircraft in the air, trimmed.

    Parameters
    ----------
    frame : LocalFrame
        Local frame in which its state is read.
    start : Start
        Position, course and speed that it begins with.
    weather : Weather
        Wind and turbulence.
    seed : int
        Seed of the turbulence.
    lowest_m : float
        JSBSim's own ground is flat at this height; what lies above it is judged elsewhere [m].
    """

    def __init__(
        self, frame: LocalFrame, start: Start, weather: Weather, *, seed: int, projection: FastProjection,
        lowest_m: float = 0.0,
    ) -> None:  # fmt: skip
        self._projection, self._frame, self._weather = projection, frame, weather
        self._origin_amsl_m = frame.altitude_amsl_m
        jsbsim.FGJSBBase().debug_lvl = 0  # type: ignore[no-untyped-call]  # silences the banner
        self._executive = jsbsim.FGFDMExec(None)
        self._executive.set_debug_level(0)
        self._executive.set_aircraft_path(str(AIRCRAFT_PATH))
        self._executive.set_dt(STEP_S)
        if not self._executive.load_model("small_uav"):
            raise RuntimeError(f"JSBSim cannot load the aircraft in {AIRCRAFT_PATH}")
        self._airspeed_knots = start.equivalent_airspeed_m_s / _KNOT_M_S
        self._lowest_m = lowest_m
        self._place(frame, start, lowest_m)
        manager = self._executive.get_property_manager()
        self._readers = tuple(_node(manager, name).get_double_value for name in _READ)
        self._thrust = _node(manager, _THRUST).get_double_value
        self._writers = tuple(_node(manager, name).set_double_value for name in _COMMANDS)
        self.trim_alpha_rad, self.trim_elevator_rad, self.trim_throttle = self._trim()
        self._add_wind(start, weather)
        self._start_turbulence(weather, seed)
        self.state = self._read()

    def _place(self, frame: LocalFrame, start: Start, lowest_m: float) -> None:
        """Set position, course and airspeed, in still air."""
        latitude, longitude, altitude = frame.global_from_local(start.east_m, start.north_m, start.up_m)
        fdm = self._executive
        fdm["ic/lat-geod-deg"], fdm["ic/long-gc-deg"] = latitude, longitude
        fdm["ic/terrain-elevation-ft"] = (frame.altitude_amsl_m + lowest_m) / _FOOT_M
        fdm["ic/h-sl-ft"] = altitude / _FOOT_M
        fdm["ic/psi-true-deg"] = math.degrees(start.course_rad)
        fdm["ic/vw-mag-fps"] = 0.0

    def _settle(self, alpha_rad: float, elevator_rad: float, throttle: float) -> None:
        """Let the servos' lag filters, which only move when run, reach their commands at time zero."""
        fdm = self._executive
        fdm["ic/ve-kts"] = self._airspeed_knots
        fdm["ic/alpha-rad"] = fdm["ic/theta-rad"] = alpha_rad
        fdm["fcs/elevator-cmd-rad"], fdm["fcs/throttle-cmd"] = elevator_rad, throttle
        for _ in range(_SETTLING_RUNS):
            fdm.run_ic()

    def _residual(self, unknowns: FloatArray) -> FloatArray:
        """Accelerations across the thrust that trim makes vanish, shape (2,).

        ``unknowns``, shape (2,), are angle of attack and elevator [rad].
        """
        self._settle(float(unknowns[0]), float(unknowns[1]), 0.0)
        return np.array(
            [self._executive[name] for name in ("accelerations/wdot-ft_sec2", "accelerations/qdot-rad_sec2")]
        )

    def _trim_angles(self) -> tuple[float, float]:
        """Find the zero of :meth:`_residual` by Newton's method, with central differences.

        The residual is smooth and nearly linear. SciPy's solver finds the same angles, but loading it takes
        longer than anything else at the start of a simulation.

        Raises
        ------
        RuntimeError
            If the aircraft cannot be trimmed.
        """
        angles = np.array([0.05, -0.05])
        for _ in range(_TRIM_STEPS_MAX):
            columns = [
                (self._residual(angles + change) - self._residual(angles - change)) / (2.0 * _TRIM_CHANGE_RAD)
                for change in _TRIM_CHANGE_RAD * np.eye(2)
            ]
            step = np.linalg.solve(np.column_stack(columns), self._residual(angles))
            angles -= step
            if np.max(np.abs(step)) < _TRIM_TOLERANCE_RAD:
                return float(angles[0]), float(angles[1])
        raise RuntimeError("JSBSim cannot trim the aircraft at its start")

    def _trim(self) -> tuple[float, float, float]:
        """Angle of attack, elevator [rad] and throttle of straight level flight.

        JSBSim's own trim wants an engine, which this model has not. The thrust acts along the body's
        x axis only, so it follows from the acceleration that is left without it.
        """
        fdm = self._executive
        alpha, elevator = self._trim_angles()
        self._settle(alpha, elevator, 0.0)
        deceleration = -fdm["accelerations/udot-ft_sec2"]
        self._settle(alpha, elevator, 1.0)
        throttle = deceleration / (deceleration + fdm["accelerations/udot-ft_sec2"])
        self._settle(alpha, elevator, throttle)
        return float(alpha), float(elevator), float(throttle)

    def _add_wind(self, start: Start, weather: Weather) -> None:
        """Keep the trimmed airspeed, and turn the nose so that the course is the one asked for."""
        fdm = self._executive
        airspeed = fdm["velocities/vt-fps"] * _FOOT_M
        sine, cosine = math.sin(start.course_rad), math.cos(start.course_rad)
        cross = weather.wind_east_m_s * cosine - weather.wind_north_m_s * sine
        drift = math.asin(max(-0.9, min(0.9, -cross / airspeed)))
        heading = start.course_rad + drift
        wind_to = math.degrees(math.atan2(weather.wind_east_m_s, weather.wind_north_m_s)) % 360.0
        fdm["ic/vw-mag-fps"] = math.hypot(weather.wind_east_m_s, weather.wind_north_m_s) / _FOOT_M
        fdm["ic/vw-dir-deg"] = wind_to  # after the magnitude: a wind of no strength has no direction
        fdm["ic/psi-true-rad"], fdm["ic/theta-rad"] = heading, self.trim_alpha_rad
        fdm["ic/ve-fps"] = (airspeed * math.sin(heading) + weather.wind_east_m_s) / _FOOT_M
        fdm["ic/vn-fps"] = (airspeed * math.cos(heading) + weather.wind_north_m_s) / _FOOT_M
        fdm["ic/vd-fps"] = 0.0
        fdm.run_ic()

    def _start_turbulence(self, weather: Weather, seed: int) -> None:
        strength = _TURBULENCE.get(weather.turbulence)
        self._executive["simulation/randomseed"] = float(seed % (2**31 - 1))
        if strength is not None:
            self._executive["atmosphere/turb-type"] = float(_MILSPEC)
            self._executive["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = strength[0]
            self._executive["atmosphere/turbulence/milspec/severity"] = strength[1]

    def launch(self, start: Start) -> None:
        """Begin again in the air, trimmed, as a catapult leaves the aircraft."""
        self._airspeed_knots = start.equivalent_airspeed_m_s / _KNOT_M_S
        self._place(self._frame, start, self._lowest_m)
        self._settle(self.trim_alpha_rad, self.trim_elevator_rad, self.trim_throttle)
        self._add_wind(start, self._weather)
        self.state = self._read()

    def command(self, aileron_rad: float, elevator_rad: float, rudder_rad: float, throttle: float) -> None:
        """Move the servos; signs as in the aircraft's file, throttle in [0, 1]."""
        write = self._writers
        write[0](aileron_rad)
        write[1](elevator_rad)
        write[2](rudder_rad)
        write[3](throttle)

    def run(self, steps: int) -> TrueState:
        """Advance by steps of 1/120 s and read the state."""
        for _ in range(steps):
            self._executive.run()
        self.state = self._read()
        return self.state

    @property
    def thrust_power_w(self) -> float:
        """Power that the thrust gives to the aircraft: thrust times true airspeed [W]."""
        return self._thrust() * _POUND_N * self.state.true_airspeed_m_s

    def _read(self) -> TrueState:
        values = [read() for read in self._readers]
        east, north = self._projection.local(values[0], values[1])
        return TrueState(
            east,
            north,
            values[2] * _FOOT_M - self._origin_amsl_m,
            values[3] * _FOOT_M,
            values[4] * _FOOT_M,
            -values[5] * _FOOT_M,
            values[6],
            values[7],
            values[8],
            values[9],
            values[10],
            values[11],
            values[12] * _FOOT_M,
            values[13] * _FOOT_M,
        )

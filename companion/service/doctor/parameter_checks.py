"""Checks of the autopilot parameters that matter to the service.

The effects were measured on ArduPlane 4.7 and PX4 1.17 in their own simulations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from companion.config import MissionConfig
from companion.config.compose import measured_airspeed_m_s
from companion.flight.takeover.capability import TOLERANCE
from companion.link.wire.decoded_frame import AutopilotVersion
from companion.mission.waypoints import FLY_BY_M
from companion.service.doctor.failsafe_checks import ARDUPLANE_FAILSAFES, PX4_FAILSAFES
from companion.service.doctor.finding import Finding, fail, ok, warn
from companion.types.events import Dialect
from companion.types.state import (
    BY_RETURN_PATH,
    LANDING_AT_ONCE,
    RETURNS_OVER_GROUND,
    AutopilotSettings,
)

MEASURED = {Dialect.ARDUPILOT: (4, 7), Dialect.PX4: (1, 17)}
NAMES = {Dialect.ARDUPILOT: "ArduPilot", Dialect.PX4: "PX4"}
RELEASES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}
SERIAL_PORTS = range(1, 7)
MAVLINK_PROTOCOLS = (1.0, 2.0)
# SERIALn_BAUD of ArduPilot is in thousands, except for these values.
BAUD_RATES = {1: 1200, 2: 2400, 4: 4800, 9: 9600, 19: 19200, 38: 38400, 57: 57600, 111: 111100}
BAUD_RATES |= {115: 115200, 230: 230400, 256: 256000, 460: 460800, 500: 500000, 921: 921600, 1500: 1500000}
# MAV_n_CONFIG of PX4 gives the port of each MAVLink instance; these are the telemetry ports.
PX4_INSTANCES = range(3)
PX4_PORTS = {101.0: "TEL1", 102.0: "TEL2", 103.0: "TEL3", 104.0: "TEL4"}
ONBOARD = 2.0  # A value of MAV_n_MODE.
SERIAL_PARAMETERS = {
    Dialect.ARDUPILOT: "SERIALn_PROTOCOL 2 and SERIALn_BAUD",
    Dialect.PX4: "MAV_1_CONFIG 102 (TELEM 2) and SER_TEL2_BAUD",
}


@dataclass(frozen=True, slots=True)
class ParameterCheck:
    """The required value of a parameter.

    Parameters
    ----------
    name : str
        Name of the parameter in the autopilot.
    is_good : callable
        Takes the value and returns whether it is as required.
    advice : str
        What to do if it is not, and what would happen.
    is_grave : bool
        True if another value is dangerous, not only inconvenient.
    """

    name: str
    is_good: Callable[[float], bool]
    advice: str
    is_grave: bool = False

    def finding(self, value: float) -> Finding:
        """Return the finding for a value."""
        if self.is_good(value):
            return ok(self.name, f"{value:g}")
        return (fail if self.is_grave else warn)(self.name, f"{value:g}", self.advice)


ARDUPLANE = (
    ParameterCheck(
        "MIS_RESTART", lambda v: v == 0.0, "set 0: AUTO would begin at item 1, not on our path", True
    ),
    ParameterCheck(
        "RTL_AUTOLAND",
        lambda v: v in (LANDING_AT_ONCE, BY_RETURN_PATH),
        "set 4, or 2 before version 4.6.2 (authority.set_return does), and the planner keeps a checked path: "
        "others return straight, and with 0 it does not arm while the mission has a DO_LAND_START",
    ),
    ParameterCheck(
        "AVD_ENABLE",
        lambda v: v == 0.0,
        "set 0, or AVD_F_ACTION and AVD_W_ACTION to 1: its own avoidance flies against the planner's",
    ),
    ParameterCheck("AVD_F_ACTION", lambda v: v <= 1.0, "set 1 (report only), or AVD_ENABLE 0", True),
    ParameterCheck("AVD_W_ACTION", lambda v: v <= 1.0, "set 1 (report only), or AVD_ENABLE 0", True),
    ParameterCheck(
        "ADSB_TYPE",
        lambda v: v == 0.0,
        "set 0 unless an ADS-B receiver is wired to the autopilot: "
        "it consumes the reports of other sources and sends its own list at its own rate",
    ),
    ParameterCheck(
        "TERRAIN_FOLLOW",
        lambda v: not int(v) & RETURNS_OVER_GROUND,
        "set 0: a straight return to launch would follow the ground, which is not foreseen",
    ),
    ParameterCheck(
        "WP_RADIUS",
        lambda v: 0.5 * FLY_BY_M <= v <= 3.0 * FLY_BY_M,
        "set 0.8 times turn_radius_min_m: paths are followed best with it",
    ),
    ParameterCheck(
        "ALT_OFFSET", lambda v: v == 0.0, "set 0: missions would be flown that much higher or lower", True
    ),
    ParameterCheck(
        "WP_MAX_RADIUS",
        lambda v: v == 0.0,
        "set 0: it would turn back to waypoints that it passes on the inside of a turn",
        True,
    ),
)
PX4 = (
    ParameterCheck(
        "MIS_TKO_LAND_REQ",
        lambda v: v == 0.0,
        "set 0, or let the mission end in a landing: one without is "
        "accepted and then not flown, and the aircraft loiters",
    ),
    ParameterCheck(
        "NAV_TRAFF_AVOID",
        lambda v: v <= 1.0,
        "set 1 (warn only) or 0: it would leave the mission for any "
        "vehicle that is reported, ground vehicles too",
        True,
    ),
    ParameterCheck(
        "NAV_ACC_RAD",
        lambda v: v <= FLY_BY_M,
        f"set at most {FLY_BY_M:g}: corners would be cut that were not checked so",
    ),
)
SPEEDS = {
    Dialect.ARDUPILOT: ("AIRSPEED_MIN", "AIRSPEED_MAX", "AIRSPEED_CRUISE"),
    Dialect.PX4: ("FW_AIRSPD_MIN", "FW_AIRSPD_MAX", "FW_AIRSPD_TRIM"),
}
RATES = {
    Dialect.ARDUPILOT: ("TECS_CLMB_MAX", "TECS_SINK_MAX"),
    Dialect.PX4: ("FW_T_CLMB_R_SP", "FW_T_SINK_R_SP"),
}
BANKS = {
    Dialect.ARDUPILOT: ("ROLL_LIMIT_DEG", "AIRSPEED_MIN", "STALL_PREVENTION"),
    Dialect.PX4: ("FW_R_LIM",),
}
FAILSAFES = {Dialect.ARDUPILOT: ARDUPLANE_FAILSAFES, Dialect.PX4: PX4_FAILSAFES}
PARAMETER_CHECKS = {Dialect.ARDUPILOT: ARDUPLANE, Dialect.PX4: PX4}
# These parameters exist only if the other one enables avoidance.
ONLY_WITH = {"AVD_F_ACTION": "AVD_ENABLE", "AVD_W_ACTION": "AVD_ENABLE"}


def parameter_names(dialect: Dialect) -> tuple[str, ...]:
    """Return the names of the parameters to read."""
    checked = (check.name for check in PARAMETER_CHECKS[dialect])
    return (*checked, *SPEEDS[dialect], *RATES[dialect], *BANKS[dialect], *_serial_names(dialect))


def _serial_names(dialect: Dialect) -> list[str]:
    if dialect is Dialect.ARDUPILOT:
        return [f"SERIAL{n}_{what}" for n in SERIAL_PORTS for what in ("PROTOCOL", "BAUD")]
    names = [f"MAV_{n}_{what}" for n in PX4_INSTANCES for what in ("CONFIG", "MODE")]
    return names + [f"SER_{port}_BAUD" for port in PX4_PORTS.values()]


def version(dialect: Dialect, reported: AutopilotVersion | None) -> Finding:
    """Check that the behaviour of the autopilot's version is known."""
    check, name = "autopilot", NAMES[dialect]
    major, minor = MEASURED[dialect]
    advice = f"its missions were measured with {major}.{minor}: try this one in its own simulation first"
    if reported is None:
        return warn(check, f"{name}; it does not report its version", advice)
    numbers = ".".join(map(str, reported.numbers))
    found = f"{name} {numbers}{RELEASES.get(reported.release, '?')}"
    return ok(check, found) if reported.numbers[:2] == (major, minor) else warn(check, found, advice)


def return_findings(
    dialect: Dialect, values: Mapping[str, float], reported: AutopilotVersion | None
) -> list[Finding]:
    """Check that the autopilot's version knows the return to launch that its parameter asks for."""
    is_known = reported is None or dialect.knows_return_paths(reported.numbers)
    if is_known or values.get("RTL_AUTOLAND") != BY_RETURN_PATH:
        return []
    advice = "set 2: versions before 4.6.2 do not know 4, and return straight home"
    return [warn("return", f"RTL_AUTOLAND {BY_RETURN_PATH:g}", advice)]


def parameter_findings(
    dialect: Dialect, values: Mapping[str, float], mission: MissionConfig | None, baud_rate: int | None
) -> list[Finding]:
    """Check the parameters that were read; ``baud_rate`` is that of the serial line, if there is one."""
    findings = []
    for check in PARAMETER_CHECKS[dialect]:
        switch = ONLY_WITH.get(check.name)
        if switch is not None and values.get(switch) == 0.0:
            continue
        value = values.get(check.name)
        findings.append(_not_reported(check.name) if value is None else check.finding(value))
    findings += _speeds(dialect, values, mission)
    findings += _rates(dialect, values, mission)
    findings += _banks(dialect, values, mission)
    findings.append(_serial(dialect, values, baud_rate))
    return findings


def _not_reported(name: str) -> Finding:
    return warn(name, "not reported", "the link loses too much, or this version has another name for it")


def _speeds(dialect: Dialect, values: Mapping[str, float], mission: MissionConfig | None) -> list[Finding]:
    slow, fast, cruise = (values.get(name, math.nan) for name in SPEEDS[dialect])
    if mission is None:
        return []
    if not all(map(math.isfinite, (slow, fast, cruise))):
        return [_not_reported(name) for name in SPEEDS[dialect] if name not in values]
    found, vehicle = f"{slow:g} to {fast:g} m/s, cruise {cruise:g}", mission.vehicle
    wanted = f"{vehicle.airspeed_min_m_s:g} to {vehicle.airspeed_max_m_s:g}, {vehicle.airspeed_cruise_m_s:g}"
    advice = f"let vehicle.airspeed_* of the mission file ({wanted}) and the autopilot agree"
    if not slow <= measured_airspeed_m_s(mission) <= fast:
        return [fail("airspeeds", found, f"{advice}: it cannot fly so")]
    return [ok("airspeeds", found)]


def _rates(dialect: Dialect, values: Mapping[str, float], mission: MissionConfig | None) -> list[Finding]:
    """Check that the autopilot climbs and descends as steeply as the mission file allows."""
    if mission is None or mission.dimension != 3:
        return []
    names, vehicle = RATES[dialect], mission.vehicle
    missing = [name for name in names if name not in values]
    if missing:
        return [_not_reported(name) for name in missing]
    angles = float(vehicle.climb_angle_max_deg), float(vehicle.descent_angle_max_deg)
    asked = [float(vehicle.airspeed_cruise_m_s) * math.sin(math.radians(angle)) for angle in angles]
    climb, sink = (values[name] for name in names)
    found = f"{climb:g} m/s up, {sink:g} m/s down"
    if climb * TOLERANCE >= asked[0] and sink * TOLERANCE >= asked[1]:
        return [ok("climb rates", found)]
    advice = (
        f"set {names[0]} {asked[0]:.1f} and {names[1]} {asked[1]:.1f}, as the mission file's angles ask: "
    )
    return [warn("climb rates", found, advice + "otherwise paths are flatter than it allows")]


def _banks(dialect: Dialect, values: Mapping[str, float], mission: MissionConfig | None) -> list[Finding]:
    """Check that the autopilot banks as far as the mission file allows."""
    if mission is None:
        return []
    missing = [name for name in BANKS[dialect] if name not in values]
    if missing:
        return [_not_reported(name) for name in missing]
    cruise, asked = measured_airspeed_m_s(mission), float(mission.vehicle.bank_max_deg)
    limit, *others = (values[name] for name in BANKS[dialect])
    slowest, prevention = others or (None, None)
    reported = AutopilotSettings(bank_max_deg=limit, airspeed_min_m_s=slowest, stall_prevention=prevention)
    bank = math.degrees(reported.bank_limit_rad(cruise))
    found = f"{bank:.0f}° at {cruise:.1f} m/s EAS"
    if bank * TOLERANCE >= asked:
        return [ok("bank", found)]
    advice = f"set {BANKS[dialect][0]} {asked:g}"
    if limit * TOLERANCE >= asked:
        enough = cruise * math.sqrt(math.cos(math.radians(asked)))
        advice = f"set AIRSPEED_MIN {math.floor(enough)} or less, if the aircraft flies safely with it"
    return [warn("bank", found, f"{advice}: otherwise turns are wider than the mission file allows")]


def _serial(dialect: Dialect, values: Mapping[str, float], baud_rate: int | None) -> Finding:
    check = "serial ports"
    if not values.keys() & set(_serial_names(dialect)):
        return ok(check, "not reported") if baud_rate is None else _not_reported(check)
    is_px4 = dialect is Dialect.PX4
    rates = _px4_rates(values) if is_px4 else _ardupilot_rates(values)
    found = ", ".join(f"{port} MAVLink {rate}" for port, rate in rates.items()) or "no port speaks MAVLink"
    if baud_rate is not None and baud_rate not in rates.values():
        return warn(check, found, f"set {SERIAL_PARAMETERS[dialect]} for {baud_rate}")
    advice = _px4_advice(values, rates, baud_rate) if is_px4 else _ardupilot_advice(values, rates)
    return warn(check, found, advice) if advice else ok(check, found)


def _px4_advice(values: Mapping[str, float], rates: Mapping[str, int], baud_rate: int | None) -> str:
    """Return what to change if no instance at our baud rate is for a companion; '' for nothing."""
    modes = [values.get(f"{port}_MODE") for port, rate in rates.items() if rate == baud_rate]
    if not modes or ONBOARD in modes:
        return ""
    return "set MAV_n_MODE 2 (Onboard): the others spend the line on a ground station"


def _ardupilot_advice(values: Mapping[str, float], rates: Mapping[str, int]) -> str:
    """Return what to change if a port sends MAVLink 1; '' for nothing."""
    if not any(values.get(f"{port}_PROTOCOL") == 1.0 for port in rates):
        return ""
    return "set SERIALn_PROTOCOL 2: MAVLink 1 carries no signatures"


def _ardupilot_rates(values: Mapping[str, float]) -> dict[str, int]:
    """Return the baud rates of the ports with MAVLink."""
    ports = [f"SERIAL{n}" for n in SERIAL_PORTS if values.get(f"SERIAL{n}_PROTOCOL") in MAVLINK_PROTOCOLS]
    codes = {port: values.get(f"{port}_BAUD", math.nan) for port in ports}
    return {
        port: BAUD_RATES.get(int(code), int(code) * 1000)
        for port, code in codes.items()
        if math.isfinite(code)
    }


def _px4_rates(values: Mapping[str, float]) -> dict[str, int]:
    """Return the baud rates of the MAVLink instances that have a telemetry port."""
    ports = {f"MAV_{n}": PX4_PORTS.get(values.get(f"MAV_{n}_CONFIG", 0.0)) for n in PX4_INSTANCES}
    rates = {name: values.get(f"SER_{port}_BAUD", math.nan) for name, port in ports.items()}
    return {name: int(rate) for name, rate in rates.items() if math.isfinite(rate)}

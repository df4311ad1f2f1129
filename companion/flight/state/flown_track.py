"""How the autopilot will fly what a mission carries, as far as the service foresees it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.state.flight_state import FlightState
from companion.frames import speed_made_good
from companion.mission.waypoints import Waypoints, density_ratio
from companion.types.path import FASTER_M_S, Path
from companion.types.state import Ownship
from companion.world.vehicle.guidance import Guidance, Track, default_guidance, track_of_circle, track_of_legs
from companion.world.vehicle.vehicle_model import VehicleModel

BANK_MAX_DEG = 80.0  # whatever the parameter says
CIRCLE_PLACES = 13
SLOWEST_M_S = 3.0  # over the ground, of a circle in strong wind
STEP_S = 0.5
NEARLY = 0.1
UNSURE_M = 15.0  # of the way into a circle that the last leg does not touch
PASSED_BY_M = 5.0  # bounds, which are no walls, in the turn into a circle that the last leg does not touch


def guidance_of(state: FlightState) -> Guidance:
    """What the autopilot steers by, as far as its parameters were told."""
    usual = default_guidance(flies_by=state.flies_by, vehicle=state.rules.vehicle)
    told = state.settings
    bank = usual.bank_max_rad if not told.bank_max_deg else math.radians(min(told.bank_max_deg, BANK_MAX_DEG))
    return replace(
        usual,
        acceptance_radius_m=told.acceptance_radius_m or usual.acceptance_radius_m,
        l1_period_s=told.guidance_period_s or usual.l1_period_s,
        l1_damping=told.guidance_damping or usual.l1_damping,
        bank_max_rad=bank,
        loiter_radius_m=told.loiter_radius_m or usual.loiter_radius_m,
        climb_rate_max_m_s=min(told.climb_max_m_s or math.inf, usual.climb_rate_max_m_s),
        circle_stretch=circle_stretch(state),
    )


def circle_stretch(state: FlightState) -> float:
    """How much wider than commanded an ArduPlane circles in standard air, about the mission's height.

    Parameters
    ----------
    state : FlightState
        Which autopilot, and the mission's heights.
    """
    mission = state.mission
    altitude = float(mission.origin.altitude_amsl_m) + float(mission.start.up_m)
    return 1.0 / density_ratio(altitude) if state.flies_by else 1.0


def at_row(path: Path, wind_enu_m_s: tuple[float, float], row: int = 0) -> Ownship:
    """The aircraft at a row of a path, by default where it begins, not banked.

    Parameters
    ----------
    path : Path
        What is to be flown.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    row : int
        Which row.
    """
    course, airspeed = float(path.courses_rad[row]), max(float(path.speeds_m_s[row]), 1.0)
    east, north, up = (float(value) for value in path.positions_enu_m[row])
    return Ownship(
        stamp_s=float(path.times_s[row]),
        position_enu_m=(east, north, up),
        course_rad=course,
        flight_path_angle_rad=float(path.climb_angles_rad[row]),
        airspeed_m_s=airspeed,
        ground_speed_m_s=speed_made_good(course, airspeed, wind_enu_m_s),
        wind_enu_m_s=wind_enu_m_s,
    )


def is_circle_exposed(state: FlightState, waypoints: Waypoints, arrival_s: float) -> bool:
    """Whether the first lap on the circle at the end of a mission is above the limit of the threat level.

    Parameters
    ----------
    state : FlightState
        Threats and rules.
    waypoints : Waypoints
        With the circle.
    arrival_s : float
        When it is come to, by the clock [s].
    """
    limit, centre = state.rules.checker.limits.threat_level_max, waypoints.loiter_centre_enu_m
    if centre is None or limit >= 1.0:
        return False
    speed, radius = float(state.rules.vehicle.airspeed_cruise_m_s), abs(waypoints.loiter_radius_m)
    angles = np.linspace(0.0, 2.0 * math.pi, CIRCLE_PLACES)
    ring = radius * np.column_stack([np.sin(angles), np.cos(angles), 0.0 * angles])
    lap = Path(
        times_s=arrival_s + angles * radius / speed,
        positions_enu_m=centre + ring,
        courses_rad=(angles + 0.5 * math.pi) % (2.0 * math.pi),
        climb_angles_rad=0.0 * angles,
        speeds_m_s=0.0 * angles + speed,
        position_covariances_m2=np.zeros((len(angles), 3, 3)),
        collision_free=np.ones(len(angles)),
        threat_levels=0.0 * angles,
    )
    return bool(state.rules.exposure.levels(lap, state.picture).max() > limit)


def blown_off(state: FlightState, part: Path, waypoints: Waypoints) -> tuple[Violation, ...]:
    """What the circle at the end comes to in the wind, as the autopilot will fly it.

    Parameters
    ----------
    state : FlightState
        Rules and wind.
    part : Path
        What leads there.
    waypoints : Waypoints
        With the circle.
    """
    if waypoints.loiter_centre_enu_m is None:
        return ()
    begin = at_row(part, state.wind_enu_m_s, len(part) - 1)
    slowest = max(begin.airspeed_m_s - math.hypot(*state.wind_enu_m_s), SLOWEST_M_S)
    around_s = 2.0 * math.pi * abs(waypoints.loiter_radius_m) / slowest
    track = track_of_circle(
        guidance_of(state), begin, waypoints.loiter_centre_enu_m, waypoints.loiter_radius_m, around_s, STEP_S
    )
    return state.rules.checker.check_track(track.positions_enu_m, state.rules.checker.limits.margin_m)


def commanded_airspeed_m_s(path: Path, vehicle: VehicleModel) -> float:
    """Cruise, or what a path comes to that is flown faster, before moving threats.

    Parameters
    ----------
    path : Path
        As planned.
    vehicle : VehicleModel
        The aircraft.
    """
    fastest, cruise = float(path.speeds_m_s[-1]), vehicle.airspeed_cruise_m_s
    return fastest if fastest > cruise + FASTER_M_S else cruise


def airspeed_at_end(part: Path, vehicle: VehicleModel, commanded_m_s: float) -> float:
    """What is left at the end of a part of the speed that it begins with, where less is commanded [m/s].

    Parameters
    ----------
    part : Path
        What is flown.
    vehicle : VehicleModel
        How fast it slows down.
    commanded_m_s : float
        The airspeed that the mission commands [m/s].
    """
    slowed = float(part.speeds_m_s[0]) ** 2 - 2.0 * vehicle.acceleration_max_m_s2 * part.length_m
    return max(commanded_m_s, math.sqrt(max(slowed, 0.0)))


def track_over(
    state: FlightState, path: Path, waypoints: Waypoints, circled_s: float, airspeed_m_s: float | None = None
) -> Track:
    """Fly from a path's begin over the waypoints made of it, and on round the circle at their end.

    Parameters
    ----------
    state : FlightState
        How the autopilot flies, and the wind.
    path : Path
        Which begins where the flight does.
    waypoints : Waypoints
        What a mission carries.
    circled_s : float
        How long the circle is flown, about [s].
    airspeed_m_s : float, optional
        At which all of it is flown; left out, that with which the path begins [m/s].
    """
    begin, loiter = at_row(path, state.wind_enu_m_s), waypoints.loiter_centre_enu_m
    if airspeed_m_s is not None:
        made_good = speed_made_good(begin.course_rad, airspeed_m_s, state.wind_enu_m_s)
        begin = replace(begin, airspeed_m_s=airspeed_m_s, ground_speed_m_s=made_good)
    circle = None if loiter is None else (loiter, waypoints.loiter_radius_m)
    ends_s = float(waypoints.distances_m[-1]) / begin.ground_speed_m_s + circled_s
    return track_of_legs(
        guidance_of(state), begin, waypoints.positions_enu_m, loiter=circle, ends_s=ends_s, step_s=STEP_S
    )


def is_circle_met(waypoints: Waypoints) -> bool:
    """Whether the last leg runs into the circle at the end along its tangent, or nearly.

    Parameters
    ----------
    waypoints : Waypoints
        What a mission carries, with the circle.
    """
    centre, places = waypoints.loiter_centre_enu_m, waypoints.positions_enu_m
    if centre is None or len(places) < 2:
        return True
    along, away = (places[-1] - places[-2])[:2], (centre - places[-1])[:2]
    distance = float(np.hypot(*away))
    is_aside = abs(float(along @ away)) <= NEARLY * distance * float(np.hypot(*along))
    return is_aside and distance >= (1.0 - NEARLY) * abs(waypoints.loiter_radius_m)


def astray(state: FlightState, path: Path, waypoints: Waypoints) -> tuple[float, float]:
    """By how much the aircraft comes too near to something, and out of bounds, on the last leg and circle.

    Asked of circles that were moved into the bounds, whose track is known less well. It is flown at the
    speed that the aircraft has there.

    Parameters
    ----------
    state : FlightState
        Rules, and how the autopilot flies.
    path : Path
        Which begins where the flight does.
    waypoints : Waypoints
        What a mission carries, with the circle.

    Returns
    -------
    float
        By which it is nearer than it should be to an obstacle or a fence [m].
    float
        By which it passes the bounds farther than a turn may [m].
    """
    checker, end = state.rules.checker, at_row(path, state.wind_enu_m_s, len(path) - 1)
    lap_s = 2.0 * math.pi * abs(waypoints.loiter_radius_m) / end.ground_speed_m_s
    airspeed = airspeed_at_end(path, state.rules.vehicle, waypoints.airspeed_m_s)
    track = track_over(state, path, waypoints, lap_s, airspeed)
    clearance = float(state.mission.planning.clearance_min_m) + UNSURE_M
    on_last = track.reached >= len(waypoints.positions_enu_m) - 1
    wrong = checker.check_track(track.positions_enu_m[on_last], clearance)
    near = max((clearance - entry.value for entry in wrong if entry.rule != "bounds"), default=0.0)
    out = max((abs(entry.value - entry.limit) for entry in wrong if entry.rule == "bounds"), default=0.0)
    return near, max(0.0, out - PASSED_BY_M)

"""Simulation of how the autopilot will fly a mission, and what is wrong with that flight."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from companion.assurance.violation import Violation
from companion.config.compose import measured_airspeed_m_s, start_altitude_m
from companion.config.sections.terrain_map import autopilot_ground_of
from companion.flight.state.flight_state import FlightState
from companion.frames import FloatArray, density_ratio, speed_made_good
from companion.mission.waypoints import Waypoints
from companion.types.path import FASTER_M_S, Path
from companion.types.state import Ownship
from companion.world.ground.autopilot_ground import AutopilotGround, ClimbAhead
from companion.world.vehicle.guidance import (
    NO_FOLLOWED_GROUND,
    Guidance,
    Track,
    default_guidance,
    track_of_legs,
)
from companion.world.vehicle.vehicle_model import VehicleModel

TERRAIN_SPACING_M, TERRAIN_LOOKAHD_M = 100.0, 2_000.0  # ArduPlane's defaults.
LOOK_AHEAD_SHARE = 0.5  # ArduPlane looks ahead for ground that rises faster than at this share of its climb.
LAP_PLACES = 13  # Places on a circle at which the threat level is looked up.
SLOWEST_M_S = 3.0  # The ground speed by which a lap is timed is at least this.
AT_ONCE_M_S2 = 100.0  # Any change of airspeed is over within a quarter of a second.
STEP_S = 0.5  # Time between two rows of a simulated track.
DETOUR_MAX_M = 500.0  # A flight over waypoints is longer than their path by less than that.
GUSTS_M = 3.0  # Turbulence moves an aircraft up to this far off its track.
TOUCHING_M = 1.0  # A track that comes nearer to something is not flown.
BOUNDS_TOLERANCE_M = 5.0  # A turn may leave the bounds by this distance, since they are no walls.
# Largest difference of the wind at a mission's end from the wind now, east and north [m/s].
OTHER_WINDS_M_S = ((2.5, 0.0), (-2.5, 0.0), (0.0, 2.5), (0.0, -2.5))
LAST_S = 15.0  # The flight in other winds begins this long before the circle.
DEVIATION_TOLERANCE_M = 10.0  # A track that follows its path more closely needs no correction.


class Faults(NamedTuple):
    """Faults of a simulated flight; all 0 for none, and compared in this order.

    Parameters
    ----------
    on_circle_m : float
        By how much the circle, or the turn into it, lacks the wanted clearance or leaves the bounds [m].
    is_exposed : bool
        Whether the circle is above the limit of the threat level.
    before_m : float
        By how much the track before the circle lacks the hard margin or leaves the bounds [m].
    short_m : float
        By how much the track before the circle lacks the wanted clearance [m].
    deviation_m : float
        By how much it is farther from the path than :data:`DEVIATION_TOLERANCE_M` [m].
    """

    on_circle_m: float
    is_exposed: bool
    before_m: float
    short_m: float
    deviation_m: float

    def worst(self, other: Faults) -> Faults:
        """Return the larger of each of two flights' faults."""
        return Faults(
            max(self.on_circle_m, other.on_circle_m),
            self.is_exposed or other.is_exposed,
            max(self.before_m, other.before_m),
            max(self.short_m, other.short_m),
            max(self.deviation_m, other.deviation_m),
        )

    @property
    def at_end(self) -> bool:
        """Whether another end of the mission may be better."""
        return self.on_circle_m > 0.0 or self.is_exposed

    @property
    def before_circle(self) -> bool:
        """Whether other waypoints may be better."""
        return self.before_m > 0.0 or self.short_m > 0.0 or self.deviation_m > 0.0

    @property
    def is_serious(self) -> bool:
        """Whether the mission should be flown only where there is no other."""
        return self.at_end or self.before_m > 0.0


NO_FAULTS = Faults(0.0, False, 0.0, 0.0, 0.0)


def guidance_of(state: FlightState, airspeed_m_s: float | None = None) -> Guidance:
    """Return the autopilot's guidance, by its own parameters as far as they were read.

    Parameters
    ----------
    state : FlightState
        The autopilot's parameters and the aircraft.
    airspeed_m_s : float, optional
        True airspeed of the turns, on which the largest bank may depend; by default that of cruise [m/s].
    """
    usual = default_guidance(flies_by=state.flies_by, vehicle=state.rules.vehicle)
    settings = state.settings
    bank = settings.bank_limit_rad(measured_airspeed_m_s(state.mission, airspeed_m_s))
    return replace(
        usual,
        acceptance_radius_m=settings.acceptance_radius_m or usual.acceptance_radius_m,
        height_acceptance_m=settings.height_acceptance_m or usual.height_acceptance_m,
        l1_period_s=settings.guidance_period_s or usual.l1_period_s,
        l1_damping=settings.guidance_damping or usual.l1_damping,
        bank_max_rad=bank if settings.bank_max_deg else min(usual.bank_max_rad, bank),
        coordination=state.coordination,
        loiter_radius_m=settings.loiter_radius_m or usual.loiter_radius_m,
        slope_min=settings.slope_min or usual.slope_min,
        circle_stretch=circle_stretch(state),
    )


def followed_ground(state: FlightState) -> AutopilotGround | None:
    """The ground over which the autopilot keeps the heights of waypoints; None unless that is asked for.

    Parameters
    ----------
    state : FlightState
        The mission file, and the autopilot's parameters.
    """
    terrain = state.mission.terrain
    return stored_ground(state) if terrain is not None and terrain.item_frame == "terrain" else None


def stored_ground(state: FlightState) -> AutopilotGround | None:
    """Return the ground as the autopilot stores it that was served; None without a map, and for a PX4.

    Parameters
    ----------
    state : FlightState
        The mission file, and the autopilot's parameters.
    """
    settings = state.settings
    if state.mission.terrain is None or not state.flies_by:
        return None
    distance = TERRAIN_LOOKAHD_M if settings.look_ahead_m is None else max(settings.look_ahead_m, 0.0)
    climb = settings.climb_max_m_s or guidance_of(state).climb_rate_max_m_s
    return autopilot_ground_of(
        state.mission,
        settings.terrain_spacing_m or TERRAIN_SPACING_M,
        ClimbAhead(distance, LOOK_AHEAD_SHARE * climb),
    )


def guidance_over(state: FlightState, waypoints: Waypoints, *, at_once: bool = False) -> Guidance:
    """Return the autopilot's guidance over a mission, with the airspeed that the mission commands.

    Parameters
    ----------
    state : FlightState
        The autopilot's parameters and the aircraft.
    waypoints : Waypoints
        The mission.
    at_once : bool
        Whether the aircraft changes its airspeed at once: a gust or a strong engine may change it faster than
        the aircraft's limits say.
    """
    acceleration = AT_ONCE_M_S2 if at_once else state.rules.vehicle.acceleration_max_m_s2
    ground = NO_FOLLOWED_GROUND if waypoints.ground is None else waypoints.ground.followed
    return replace(
        guidance_of(state, waypoints.airspeed_m_s),
        airspeed_m_s=waypoints.airspeed_m_s,
        acceleration_m_s2=acceleration,
        ground=ground,
    )


def circle_stretch(state: FlightState) -> float:
    """Ratio of a circle's flown radius to the commanded one: above 1 for an ArduPlane high above the sea.

    Parameters
    ----------
    state : FlightState
        Which autopilot, and the mission's heights.
    """
    return 1.0 / density_ratio(start_altitude_m(state.mission)) if state.flies_by else 1.0


def at_start(path: Path, wind_enu_m_s: tuple[float, float]) -> Ownship:
    """Return the aircraft at the start of a path, with its wings level.

    Parameters
    ----------
    path : Path
        The path to be flown.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    course, airspeed = float(path.courses_rad[0]), max(float(path.speeds_m_s[0]), 1.0)
    east, north, up = (float(value) for value in path.positions_enu_m[0])
    return Ownship(
        stamp_s=float(path.times_s[0]),
        position_enu_m=(east, north, up),
        course_rad=course,
        flight_path_angle_rad=float(path.climb_angles_rad[0]),
        airspeed_m_s=airspeed,
        ground_speed_m_s=speed_made_good(course, airspeed, wind_enu_m_s),
        wind_enu_m_s=wind_enu_m_s,
    )


def is_circle_exposed(state: FlightState, waypoints: Waypoints, arrival_s: float) -> bool:
    """Return whether the first lap on a mission's last circle exceeds the limit of the threat level.

    Parameters
    ----------
    state : FlightState
        Threats and rules.
    waypoints : Waypoints
        With the circle.
    arrival_s : float
        Time of arrival at the circle, by the clock [s].
    """
    limit, centre = state.rules.checker.limits.threat_level_max, waypoints.loiter_centre_enu_m
    if centre is None or limit >= 1.0:
        return False
    speed, radius = float(state.rules.vehicle.airspeed_cruise_m_s), abs(waypoints.loiter_radius_m)
    angles = np.linspace(0.0, 2.0 * math.pi, LAP_PLACES)
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


def is_circle_taken(state: FlightState, centre: FloatArray, radius_m: float, arrival_s: float) -> bool:
    """Return whether an aircraft that keeps its route ever comes near a mission's last circle.

    Parameters
    ----------
    state : FlightState
        Other aircraft.
    centre : ndarray, shape (3,)
        Centre of the circle [m].
    radius_m : float
        Radius of the circle [m]; 0 for the autopilot's own.
    arrival_s : float
        Time of arrival at the circle, by the clock [s].
    """
    return is_taken(state, np.array([[arrival_s, *centre]]), abs(radius_m) or state.turn_radius_m)


def is_taken(state: FlightState, rows: FloatArray, radius_m: float) -> bool:
    """Return whether an aircraft that keeps its route comes near a flight, or ever near its last circle.

    The circle is flown until the next mission is entered, so that all later times count.

    Parameters
    ----------
    state : FlightState
        Other aircraft.
    rows : ndarray, shape (N, 4)
        Clock reading [s], east, north, up [m]; the last place is the centre of the circle.
    radius_m : float
        Radius of the circle [m].
    """
    end_s, own_m = float(rows[-1, 0]), np.append(np.zeros(len(rows) - 1), radius_m)
    for track in state.picture.tracks:
        if track.keeps_route and track.route is not None:
            later = np.arange(end_s, max(end_s, float(track.route[-1, 0])) + STEP_S, STEP_S)
            times = np.append(rows[:-1, 0], later)
            at = np.minimum(np.arange(len(times)), len(rows) - 1)
            away = track.places_enu_m(times) - rows[at, 1:]
            reach_m = track.max_threat_radius_m + track.circles_m(times)
            is_near = np.hypot(away[:, 0], away[:, 1]) < own_m[at] + reach_m
            if (is_near & (np.abs(away[:, 2]) < track.clear_up_m)).any():
                return True
    return False


def commanded_airspeed_m_s(path: Path, vehicle: VehicleModel) -> float:
    """Return the airspeed to command for a path: its last one, but never less than cruise [m/s].

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
    """Return the airspeed at the end of a part of a path, for an aircraft that slows down along it [m/s].

    Parameters
    ----------
    part : Path
        The part.
    vehicle : VehicleModel
        The aircraft, for its deceleration.
    commanded_m_s : float
        The airspeed that the mission commands [m/s].
    """
    slowed = float(part.speeds_m_s[0]) ** 2 - 2.0 * vehicle.acceleration_max_m_s2 * part.length_m
    return max(commanded_m_s, math.sqrt(max(slowed, 0.0)))


def simulated(state: FlightState, path: Path, waypoints: Waypoints, *, at_once: bool = False) -> Track:
    """Fly from where a path begins over the waypoints made of it, and once round the circle at their end.

    Parameters
    ----------
    state : FlightState
        The autopilot's guidance, and the wind.
    path : Path
        The path, for its beginning.
    waypoints : Waypoints
        The mission.
    at_once : bool
        Whether the aircraft changes to the commanded airspeed at once.
    """
    guidance, wind = guidance_over(state, waypoints, at_once=at_once), math.hypot(*state.wind_enu_m_s)
    radius = abs(waypoints.loiter_radius_m) * guidance.circle_stretch
    lap_s = 2.0 * math.pi * radius / max(waypoints.airspeed_m_s - wind, SLOWEST_M_S)
    slowest = max(min(waypoints.airspeed_m_s, float(path.speeds_m_s[0])) - wind, SLOWEST_M_S)
    track = track_of_legs(
        guidance, at_start(path, state.wind_enu_m_s), waypoints.positions_enu_m,
        loiter=waypoints.circle,
        ends_s=(float(waypoints.distances_m[-1]) + DETOUR_MAX_M) / slowest + lap_s, step_s=STEP_S,
    )  # fmt: skip
    at_circle = int(np.searchsorted(track.reached, len(waypoints.positions_enu_m)))
    return track.until(at_circle + math.ceil(lap_s / STEP_S))


def faults_of(
    state: FlightState, part: Path, waypoints: Waypoints, track: Track
) -> tuple[Faults, tuple[Violation, ...]]:
    """Return the faults of the simulated flight over a mission, and those that forbid the mission.

    Parameters
    ----------
    state : FlightState
        The rules.
    part : Path
        The part of the path that the mission covers.
    waypoints : Waypoints
        The mission's waypoints and circle.
    track : Track
        The simulated flight over the mission, see :func:`simulated`.

    Returns
    -------
    Faults
        By how much wanted distances are missed. The threat level of the circle is not looked up.
    tuple of Violation
        Where the track touches something, or its circle lacks the hard margin.
    """
    checker, places = state.rules.checker, track.positions_enu_m
    margin = checker.limits.margin_m
    wanted = float(state.mission.planning.clearance_min_m) + GUSTS_M
    is_on_circle = track.reached >= len(waypoints.positions_enu_m)
    lacking, beyond, forbidden = {True: 0.0, False: 0.0}, {True: 0.0, False: 0.0}, []
    for entry in checker.check_track(places, wanted, may_come_back=True, keeps_height=True):
        on_circle = bool(is_on_circle[entry.row])
        if entry.rule == "bounds":
            beyond[on_circle] = max(beyond[on_circle], abs(entry.value - entry.limit) - BOUNDS_TOLERANCE_M)
            continue
        lacking[on_circle] = max(lacking[on_circle], wanted - entry.value)
        if entry.value < (margin if on_circle else TOUCHING_M):
            forbidden.append(replace(entry, limit=margin))
    between = part.positions_enu_m[:, None, :2] - places[None, :, :2]
    if checker.ground is not None:  # An ArduPlane makes small changes of height at once, and not along a leg.
        forbidden += checker.ground.track_violations(places, checker.limits.altitude_tolerance_m)
    deviation = float(np.linalg.norm(between, axis=2).min(axis=1).max())
    faults = Faults(
        on_circle_m=max(lacking[True], beyond[True]),
        is_exposed=False,
        before_m=max(0.0, lacking[False] - (wanted - margin), beyond[False]),
        short_m=lacking[False],
        deviation_m=max(0.0, deviation - DEVIATION_TOLERANCE_M),
    )
    return faults, tuple(forbidden)


def lacking_in_other_winds(state: FlightState, waypoints: Waypoints, track: Track) -> float:
    """By how much the circle at a mission's end lacks the hard margin in winds like the present one [m].

    A circle that the last leg does not touch is entered in a turn that the wind changes much.

    Parameters
    ----------
    state : FlightState
        The autopilot's guidance, and the wind now.
    waypoints : Waypoints
        The mission.
    track : Track
        The simulated flight over the mission in the wind now.
    """
    checker, num = state.rules.checker, len(waypoints.positions_enu_m)
    guidance = replace(guidance_over(state, waypoints), airspeed_m_s=0.0)
    margin, lacking = checker.limits.margin_m, 0.0
    begin = max(int(np.searchsorted(track.reached, num)) - round(LAST_S / STEP_S), 0)
    number, lap = int(track.reached[begin]), len(track) - begin
    (east, north, up), course = track.positions_enu_m[begin].tolist(), float(track.courses_rad[begin])
    for wind in OTHER_WINDS_M_S:
        blown = state.wind_enu_m_s[0] + wind[0], state.wind_enu_m_s[1] + wind[1]
        own = Ownship(
            0.0, (east, north, up), course, 0.0, waypoints.airspeed_m_s,
            speed_made_good(course, waypoints.airspeed_m_s, blown), blown,
            bank_rad=float(track.banks_rad[begin]),
        )  # fmt: skip
        other = track_of_legs(
            guidance, own, waypoints.positions_enu_m[number:],
            before_enu_m=waypoints.positions_enu_m[number - 1] if number > 0 else None,
            loiter=waypoints.circle, ends_s=lap * STEP_S, step_s=STEP_S,
        )  # fmt: skip
        found = checker.check_track(other.positions_enu_m, margin, may_come_back=True)
        near = [entry.value for entry in found if entry.rule == "clearance"]
        lacking = max(lacking, margin - min(near, default=margin))
    return lacking

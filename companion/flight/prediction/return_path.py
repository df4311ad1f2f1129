"""The path that the autopilot flies by itself in return to launch, and its violations.

References
----------
ArduPlane 4.6 ``ModeRTL``, ``Plane::do_RTL``, ``AP_Rally::calc_best_rally_or_home_location``: straight to the
circle about the nearest rally point within RALLY_LIMIT_KM, else about home. It climbs at once and descends
along the way. RTL_CLIMB_MIN or an option of FLIGHT_OPTIONS has it climb first, with hardly any bank
(``ModeRTL::update``; ``Plane::update_alt`` has the height). With RTL_AUTOLAND 2 it flies to the closest
landing sequence instead, with 4 it joins the closest leg of a return path
(:mod:`companion.mission.return_bank`).

PX4 1.17 ``RTL::findRtlDestination``, ``RtlDirect``, ``RtlDirectMissionLand``: it climbs in a circle to
RTL_RETURN_ALT above the destination, then flies straight there. With RTL_TYPE 0 the destination is home; with
1, a fixed wing's default, the mission's landing, or home without one; with 3 the nearer of both. With 2 it
flies its mission on to the landing, and loiters are waypoints (``RtlMissionFast``). Rally points change that:
a PX4 accepts them in any global frame, does not report which, and flies off anywhere with those that are not
in frame 0 or 3 ("RTL: unsupported MAV_FRAME", measured). If it has any, its path is not known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.construction.loiter_circles import circle_of, place_of
from companion.flight.construction.mission_simulation import guidance_of
from companion.flight.construction.way_behind import SLOWEST_M_S
from companion.flight.construction.way_on import BY_MISSION
from companion.flight.state.flight_state import FlightState
from companion.frames import FloatArray, speed_made_good, true_airspeed, wrapped_angle
from companion.mission.list_layout import TwoBankLayout
from companion.mission.return_bank import followed, joined_item
from companion.types.events import MissionCurrent
from companion.types.mission import Command, MissionItem, SlopeMin
from companion.types.state import BY_RETURN_PATH, CLIMBS_FIRST, LANDING_AT_ONCE, Ownship
from companion.world.vehicle.guidance import Guidance, Track, track_of_circle, track_of_legs

JOINED_S = 20.0  # The aircraft joins the final circle in this time; then it flies round it once.
RETURN_MAX_S = 1200.0  # At most this much flight is simulated.
STEP_S = 0.5  # Time between two rows of a simulated track.
# A destination at a larger angle off the course lies behind the aircraft; it may then turn to either side,
# which is simulated by changing the course by the second angle.
BEHIND_RAD, TURN_SIDE_RAD = math.radians(130.0), math.radians(25.0)
# ArduPlane's default, and the least bank that is simulated; its climb aims this much above its end.
LEVEL_ROLL_LIMIT_DEG, LEVEL_BANK_MIN_DEG, FIRST_CLIMB_MORE_M = 5.0, 1.0, 10.0
FIRST_CLIMB_SHARES = (1.0, 0.8, 0.6, 0.4)  # The aircraft may climb faster, and end its climb sooner.
CLIMB_ENDS = 36  # A climb in a circle may end at this many moments over one and a half turns.
# The command with which the return paths begin that an ArduPlane joins, by RTL_AUTOLAND.
_STARTS = {LANDING_AT_ONCE: Command.DO_LAND_START, BY_RETURN_PATH: Command.DO_RETURN_PATH_START}
HOME, LANDING, NEAREST = 0.0, 1.0, 3.0  # RTL_TYPE; by the mission is 2.
LANDINGS = frozenset({Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH})

Place = tuple[float, float, float]


def return_path(
    state: FlightState, ownship: Ownship, current: MissionCurrent | None = None
) -> tuple[Violation, ...] | None:
    """Return the violations of the return path from here; None if the path is not known.

    Parameters
    ----------
    state : FlightState
        Home, rally points, the autopilot's parameters and the rules.
    ownship : Ownship
        The aircraft now.
    current : MissionCurrent, optional
        The mission item being flown, from which a PX4 may return by its mission.
    """
    tracks = return_tracks(state, ownship, current)
    return None if tracks is None else violations_of(state, tracks)


def violations_of(state: FlightState, tracks: Sequence[FloatArray]) -> tuple[Violation, ...]:
    """Return the violations of the first return path that has any.

    Parameters
    ----------
    state : FlightState
        The rules.
    tracks : sequence of ndarray, each of shape (K, 3)
        East, north, up along each path [m].
    """
    checker = state.rules.checker
    wrong = (tuple(checker.check_track(places, checker.limits.margin_m)) for places in tracks)
    return next(filter(None, wrong), ())


def return_tracks(
    state: FlightState, ownship: Ownship, current: MissionCurrent | None = None
) -> list[FloatArray] | None:
    """Return positions on each of the possible return paths; None if they are not known.

    Small differences decide to which side the aircraft turns if home lies behind it, and when a PX4 ends its
    climb. Both sides, and all moments of a turn, are therefore included.

    Parameters
    ----------
    state, ownship, current
        Same as in :func:`return_path`.

    Returns
    -------
    list of ndarray, shape (K, 3)
        East, north, up along each path [m]; the most likely first.
    """
    home, height = state.home_enu_m, state.settings.return_height_m
    if home is None or height is None or is_unpredictable(state):
        return None
    ownship = _at_cruise(state, ownship)
    if state.flies_by:
        return _arduplane_tracks(state, ownship, _arduplane_end(state, ownship, home))
    if state.settings.return_kind == BY_MISSION:
        return None if current is None else _tracks_by_mission(state, ownship, current)
    end = _px4_end(state, ownship, home)
    return _px4_tracks(state, ownship, end, max(ownship.position_enu_m[2], end[2] + height))


def _at_cruise(state: FlightState, ownship: Ownship) -> Ownship:
    """Return the aircraft at the airspeed of a return, the autopilot's cruise, unless it is faster now.

    The faster aircraft turns wider. A mission's airspeed ends with the mission mode (``Mode::enter``).
    """
    airspeed = true_airspeed(
        state.settings.airspeed_cruise_m_s or 0.0,
        float(state.mission.origin.altitude_amsl_m) + ownship.position_enu_m[2],
    )
    if airspeed <= ownship.airspeed_m_s:
        return ownship
    over_ground = speed_made_good(ownship.course_rad, airspeed, ownship.wind_enu_m_s)
    return replace(ownship, airspeed_m_s=airspeed, ground_speed_m_s=over_ground)


def is_unpredictable(state: FlightState) -> bool:
    """Return whether the autopilot returns on paths that are not predicted here, or are not known."""
    kind = state.settings.return_kind
    if state.flies_by:
        is_unread = state.holds_rally_points and not state.rally_points
        return is_unread or kind is None or kind > BY_RETURN_PATH or state.settings.returns_over_ground
    if kind == BY_MISSION:
        operator = state.mission_list.operator
        return operator is None or not operator.has_landing
    return state.holds_rally_points or kind not in (HOME, LANDING, NEAREST)


def return_altitude_m(state: FlightState, ownship: Ownship) -> float | None:
    """Return the altitude above mean sea level at which a return to launch circles at its end [m].

    Parameters
    ----------
    state : FlightState
        Home, rally points, and the autopilot's parameters.
    ownship : Ownship
        The aircraft now: it may return to the nearest of several places.

    Returns
    -------
    float or None
        None if the altitude is not known, is that of the flight, or the return ends in a landing.
    """
    home, height, kind = state.home_enu_m, state.settings.return_height_m, state.settings.return_kind
    if home is None or height is None or height < 0.0 or is_unpredictable(state):
        return None
    if state.flies_by:
        ends_in_landing = kind in (LANDING_AT_ONCE, BY_RETURN_PATH) and state.tail_enu_m is not None
        up_m = _arduplane_end(state, ownship, home)[2]
    else:
        ends_in_landing = kind == BY_MISSION
        up_m = _px4_end(state, ownship, home)[2] + height
    return None if ends_in_landing else float(state.mission.origin.altitude_amsl_m) + up_m


def start_of_return(state: FlightState) -> Command | None:
    """Return the command with which return paths begin that the autopilot joins; None if it joins none."""
    joins = state.flies_by and state.joins_returns
    return _STARTS.get(state.settings.return_kind or 0.0) if joins else None


def _arduplane_tracks(state: FlightState, ownship: Ownship, end: Place) -> list[FloatArray]:
    """Return positions (K, 3) on an ArduPlane's paths to the end, the landing, or by a return path [m]."""
    radius, layout = _radius(state), state.mission_list.layout
    keeps_returns = isinstance(layout, TwoBankLayout) and bool(layout.returns)
    if keeps_returns or state.settings.return_kind == BY_RETURN_PATH:
        joined = tracks_by_return_path(state, ownship, state.mission_list.stored)
        if joined:
            return joined
    if state.settings.return_kind == LANDING_AT_ONCE and state.tail_enu_m is not None:
        return circling_tracks(state, ownship, state.tail_enu_m, 0.0)
    climb = _first_climb(state, ownship, end)
    if climb is None:
        return circling_tracks(state, ownship, end, radius)
    rows = [max(round(share * (len(climb) - 1)), 1) for share in FIRST_CLIMB_SHARES]
    return _with_ends(climb, rows, ownship, lambda begun: circling_tracks(state, begun, end, radius))


def _first_climb(state: FlightState, ownship: Ownship, end: Place) -> Track | None:
    """Return the climb with which an ArduPlane's return to an end [m] begins; None without one."""
    settings, up_m = state.settings, ownship.position_enu_m[2]
    climb_m = settings.return_climb_m or 0.0
    until_m = end[2] if settings.has_option(CLIMBS_FIRST) else up_m + climb_m
    if until_m <= up_m:
        return None
    usual = guidance_of(state)
    limit_deg = LEVEL_ROLL_LIMIT_DEG if settings.level_bank_deg is None else settings.level_bank_deg
    bank = math.radians(max(limit_deg, LEVEL_BANK_MIN_DEG))
    high = np.array([*end[:2], max(up_m, end[2]) + climb_m + FIRST_CLIMB_MORE_M])
    climb_s = (until_m - up_m) / usual.climb_rate_max_m_s + JOINED_S
    track = track_of_circle(replace(usual, bank_max_rad=bank), ownship, high, 0.0, climb_s, STEP_S)
    return track.until(max(int(np.argmax(track.positions_enu_m[:, 2] > until_m)), 1))


def tracks_by_return_path(
    state: FlightState, ownship: Ownship, items: Sequence[MissionItem]
) -> list[FloatArray]:
    """Return positions on the tracks by the closest return path in a list, to a circle or a landing.

    Parameters
    ----------
    state : FlightState
        The autopilot's parameters, and home's height.
    ownship : Ownship
        The aircraft now.
    items : sequence of MissionItem
        The whole list.

    Returns
    -------
    list of ndarray, shape (K, 3)
        East, north, up along each track [m], the most likely first; empty without a return path.
    """
    frame, home_amsl_m = state.mission.frame, state.mission_list.home_amsl_m
    start, ownship = start_of_return(state), _at_cruise(state, ownship)
    joined = None if start is None else joined_item(items, frame, home_amsl_m, ownship.position_enu_m, start)
    return [] if joined is None else _tracks_over(state, ownship, followed(items, joined), passes=False)


def _tracks_by_mission(state: FlightState, ownship: Ownship, current: MissionCurrent) -> list[FloatArray]:
    """Return positions (K, 3) on the track of a PX4 that flies its mission on to the landing [m]."""
    return _tracks_over(state, ownship, state.mission_list.stored[current.sequence :], passes=True)


def _tracks_over(
    state: FlightState, ownship: Ownship, items: Sequence[MissionItem], *, passes: bool
) -> list[FloatArray]:
    """Return positions (K, 3) on the tracks over items, up to a circle or a landing [m].

    With ``passes`` a circle is a waypoint, other than that in which height is lost.
    """
    legs, circle = _legs_over(state, ownship, items, passes=passes)
    if not legs:
        return [] if circle is None else circling_tracks(state, ownship, *circle)
    guidance = guidance_of(state)
    loiter = None if circle is None else (np.asarray(circle[0]), circle[1])
    route = np.vstack([ownship.position_enu_m, *legs, *([] if loiter is None else [loiter[0]])])
    length_m = float(np.linalg.norm(np.diff(route, axis=0), axis=1).sum())
    circle_m = 0.0 if circle is None else 2.0 * math.pi * guidance.circle_stretch * abs(circle[1])
    speed = max(ownship.airspeed_m_s - math.hypot(*ownship.wind_enu_m_s), SLOWEST_M_S)
    ends_s = min((length_m + circle_m) / speed + JOINED_S, RETURN_MAX_S)
    first = (float(legs[0][0]), float(legs[0][1]), float(legs[0][2]))
    tracks = (
        track_of_legs(guidance, begun, np.array(legs), loiter=loiter, ends_s=ends_s, step_s=STEP_S)
        for begun in _headings(ownship, first)
    )
    if circle is not None:
        return [track.positions_enu_m for track in tracks]
    return [track.positions_enu_m[track.reached < len(legs)] for track in tracks]  # Up to the landing.


def _legs_over(
    state: FlightState, ownship: Ownship, items: Sequence[MissionItem], *, passes: bool
) -> tuple[list[FloatArray], tuple[Place, float] | None]:
    """Return positions (3,) that are flown to over items [m], and the final circle; None up to a landing.

    The rest is as in :func:`_tracks_over`.
    """
    legs = list[FloatArray]()
    for item in items:
        is_flown = not passes or item.command == Command.NAV_LOITER_TO_ALT
        circle = circle_of(state, item, ownship.position_enu_m[2]) if is_flown else None
        if circle is not None:
            return legs, circle
        if item.command in LANDINGS:
            break
        place = place_of(state, item)
        if place is not None and not (legs and np.array_equal(legs[-1], place)):
            legs.append(np.asarray(place))
    return legs, None


def circling_tracks(state: FlightState, ownship: Ownship, end: Place, radius_m: float) -> list[FloatArray]:
    """Return positions on the paths straight to a circle and round it, one or, if it lies behind, three.

    Parameters
    ----------
    state : FlightState
        The autopilot's parameters.
    ownship : Ownship
        The aircraft now.
    end : tuple of float
        Centre of the circle [m]. A descent is spread over the way there.
    radius_m : float
        Radius, positive clockwise; 0 for the usual loiter radius [m].

    Returns
    -------
    list of ndarray, shape (K, 3)
        East, north, up along each path [m]; the most likely first.
    """
    guidance = guidance_of(state)
    tracks = (_track_to(guidance, begun, end, radius_m).positions_enu_m for begun in _headings(ownship, end))
    return [_with_glide(track, end, guidance.slope_min) for track in tracks]


def _px4_tracks(state: FlightState, ownship: Ownship, end: Place, up_m: float) -> list[FloatArray]:
    """Return positions (K, 3) on a PX4's paths to the end, at a height to which it climbs first [m]."""
    guidance, radius, tail = guidance_of(state), _radius(state), state.tail_enu_m
    high = (*end[:2], up_m)
    # Before a landing the aircraft descends in the circle with which it begins, or already on the way there.
    ends = [high] if tail is None or tail[:2] != end[:2] else [high, tail]
    tracks: list[FloatArray] = []
    for place in ends:
        if ownship.position_enu_m[2] >= up_m - guidance.height_acceptance_m:
            tracks += [
                _track_to(guidance, begun, place, radius).positions_enu_m
                for begun in _headings(ownship, place)
            ]
        else:
            tracks += _climbed_first(guidance, ownship, up_m, place, radius)
    return tracks


def _radius(state: FlightState) -> float:
    """Return the radius of the final circle, positive clockwise [m]; 0 for the usual loiter radius."""
    return state.settings.return_radius_m or 0.0


def _arduplane_end(state: FlightState, ownship: Ownship, home: Place) -> Place:
    """Return the centre of ArduPlane's circle: the nearest rally point within RALLY_LIMIT_KM, or home [m]."""
    settings, here = state.settings, ownship.position_enu_m
    height = settings.return_height_m or 0.0
    end = (*home[:2], here[2] if height < 0.0 else home[2] + height)
    rally = min(state.rally_points, key=lambda place: math.dist(place[:2], here[:2]), default=None)
    if rally is None:
        return end
    away, limit_m = math.dist(rally[:2], here[:2]), 1e3 * (settings.rally_limit_km or 0.0)
    is_far = limit_m > 0.0 and away > limit_m
    is_home_nearer = bool(settings.rally_includes_home) and math.dist(home[:2], here[:2]) <= away
    return end if is_far or is_home_nearer else rally


def _px4_end(state: FlightState, ownship: Ownship, home: Place) -> Place:
    """Return the destination of a PX4, at the height from which RTL_RETURN_ALT counts [m]."""
    kind, here = state.settings.return_kind, ownship.position_enu_m
    landing = None if kind == HOME else _landing_of(state)
    if landing is None:
        return home
    touchdown, begins = landing
    is_nearer = math.dist(touchdown[:2], here[:2]) < math.dist(home[:2], here[:2])
    return (*begins[:2], touchdown[2]) if kind == LANDING or is_nearer else home


def _landing_of(state: FlightState) -> tuple[Place, Place] | None:
    """Return where the mission's landing touches down, and where it begins [m]; None without a landing."""
    listed = state.mission_list
    if listed.operator is None or state.tail_enu_m is None:
        return None
    tail = listed.operator.items[listed.operator.tail :]
    if not any(item.command == Command.DO_LAND_START for item in tail):
        return None
    for item in tail:
        place = place_of(state, item)
        if item.command == Command.NAV_LAND and place is not None:
            return place, state.tail_enu_m
    return None


def _track_to(guidance: Guidance, ownship: Ownship, end: Place, radius_m: float) -> Track:
    """Simulate the straight flight to a circle, and round it."""
    wind = math.hypot(*ownship.wind_enu_m_s)
    speed = max(ownship.airspeed_m_s - wind, SLOWEST_M_S)
    circle_m = 2.0 * math.pi * guidance.circle_stretch * abs(radius_m or guidance.loiter_radius_m)
    duration_s = min((math.dist(ownship.position_enu_m, end) + circle_m) / speed + JOINED_S, RETURN_MAX_S)
    return track_of_circle(guidance, ownship, np.asarray(end), radius_m, duration_s, STEP_S)


def _headings(ownship: Ownship, end: Place) -> list[Ownship]:
    """Return the aircraft; if the end lies behind it, also with its course changed to either side."""
    east, north, _ = ownship.position_enu_m
    bearing = math.atan2(end[0] - east, end[1] - north)
    if abs(wrapped_angle(bearing - ownship.course_rad)) < BEHIND_RAD:
        return [ownship]
    turns = (0.0, -TURN_SIDE_RAD, TURN_SIDE_RAD)
    return [replace(ownship, course_rad=(ownship.course_rad + turn) % (2.0 * math.pi)) for turn in turns]


def _with_glide(positions: FloatArray, end: Place, slope_min: SlopeMin) -> FloatArray:
    """Return ``positions`` (K, 3) [m] with the descent spread over the path as by ArduPlane, (K, 3).

    A descent that it does not fly as a slope stays as it is.
    """
    begin = positions[0]
    along = np.subtract(end[:2], begin[:2])
    square = float(along @ along)
    if end[2] >= begin[2] or square < 1.0 or slope_min.is_level(end[2] - begin[2]):
        return positions
    share = np.clip((positions[:, :2] - begin[:2]) @ along / square, 0.0, 1.0)
    heights = begin[2] + share * (end[2] - begin[2])
    return np.column_stack([positions[:, :2], np.minimum.accumulate(heights)])


def _climbed_first(
    guidance: Guidance, ownship: Ownship, up_m: float, end: Place, radius_m: float
) -> list[FloatArray]:
    """Return positions (K, 3) of a climb in a circle here and of the flight from each possible end [m]."""
    here = np.array([*ownship.position_enu_m[:2], up_m])
    climb_s = (up_m - ownship.position_enu_m[2]) / guidance.climb_rate_max_m_s
    turn_s = 2.0 * math.pi * abs(guidance.loiter_radius_m) / max(ownship.airspeed_m_s, SLOWEST_M_S)
    climb = track_of_circle(guidance, ownship, here, 0.0, climb_s + 1.5 * turn_s, STEP_S)
    first = int(np.argmax(climb.positions_enu_m[:, 2] >= up_m - guidance.height_acceptance_m))
    # The aircraft may climb faster.
    rows = np.linspace(max(first // 2, 1), len(climb) - 1, CLIMB_ENDS).astype(int)
    return _with_ends(
        climb, rows, ownship, lambda begun: [_track_to(guidance, begun, end, radius_m).positions_enu_m]
    )


def _with_ends(
    climb: Track, rows: Iterable[int], ownship: Ownship, onward: Callable[[Ownship], list[FloatArray]]
) -> list[FloatArray]:
    """Return positions (K, 3) of a climb that may end at any of its rows, and of each flight on from there.

    ``onward`` returns positions (L, 3) of the flights on from an aircraft, whose first is where it is [m].
    """
    return [
        np.vstack([climb.positions_enu_m[:row], track])
        for row in rows
        for track in onward(climb.aircraft_at(row, ownship))
    ]

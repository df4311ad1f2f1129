"""The waypoint at which a mission is entered: ahead of the aircraft, with a clear track to it and past it.

The track is simulated with the autopilot's guidance (:mod:`companion.world.vehicle.guidance`), from the
aircraft's present bank and in the present wind, until the aircraft is established on the path. Variations are
simulated as well: a moment later, with another bank, offset from the estimated position, and in another wind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from companion.flight.construction.mission_simulation import at_start, guidance_over
from companion.flight.state.flight_state import FlightState
from companion.frames import wrapped_angle
from companion.mission.path_progress import distance_along, progress_on
from companion.mission.waypoints import Waypoints
from companion.tracking.ownship import predicted
from companion.types.path import Path
from companion.types.state import Ownship
from companion.world.vehicle.guidance import Guidance, Track, track_of_legs

ENTRY_ROWS = 8  # The aircraft is searched in this many rows from the start of a new path.
AHEAD_MIN_M = 30.0  # A waypoint nearer than this along the path counts as passed.
ALTERNATIVES_MAX_M = 120.0  # Later waypoints than the first are tried up to this distance beyond it.
BEHIND_RAD = math.radians(110.0)  # A waypoint at a larger angle off the course is behind the aircraft.
MOTION_VALID_S = 2.0  # The present turn predicts the aircraft this long; beyond, the path's start does.
SIMULATED_MAX_S = 60.0  # At most this much flight is simulated.
MARGIN_SHARE = 0.9  # The expected track keeps this share of clearance_min_m.
VARIATION_MARGIN_SHARE = 0.6  # The variations keep this share of clearance_min_m.
DELAY_VARIATION_S = 0.5  # Variation of the time at which the aircraft turns to the mission.
BANK_VARIATION_RAD = math.radians(6.0)  # Variation of the bank.
LATERAL_VARIATION_M = 4.0  # Variation of the position to either side.
WIND_VARIATION_M_S = 1.5  # Variation of the wind to either side.
HEIGHT_VARIATION_M, CLIMB_FACTOR = 4.0, 0.4  # Variation of the height, and the share of the climb rate then.
# Variations of the roll's time constant and of the roll rate, as factors.
ROLL_TIME_FACTOR, ROLL_RATE_FACTOR = 1.6, 0.7
PERIOD_FACTOR = 0.8  # Variation of the guidance's period, as a factor.
STEP_S = 0.5  # Time between two rows of a simulated track.


def entry_of(
    state: FlightState,
    ownship: Ownship,
    path: Path,
    waypoints: Waypoints,
    in_s: float = 0.0,
    *,
    number: int | None = None,
) -> int | None:
    """Return the number of a waypoint that the aircraft can enter safely; None if there is none.

    The waypoint is ahead, and the track to it and through the turns after it is clear. None is possible
    because the aircraft may have turned away during an upload.

    Parameters
    ----------
    state : FlightState
        The rules, and the autopilot's guidance.
    ownship : Ownship
        The aircraft now.
    path : Path
        The path to be flown.
    waypoints : Waypoints
        The mission's waypoints.
    in_s : float
        Time until the aircraft is sent to the waypoint [s].
    number : int, optional
        The only waypoint to be tested; if omitted, the first safe one is returned.
    """
    there = _predicted(ownship, path, in_s)
    here = distance_along(path, progress_on(path, there.position_enu_m, 0, ENTRY_ROWS))
    for k in _ahead(waypoints, here):
        if number in (None, k) and _is_entry_clear(state, there, waypoints, k):
            return k
    return None


def may_be_entered(state: FlightState, ownship: Ownship, path: Path, waypoints: Waypoints) -> bool:
    """Return whether a mission can be entered at all from its path's start, with the present bank or none.

    This is checked before anything is sent, to avoid exchanges that cannot succeed.

    Parameters
    ----------
    state : FlightState
        The rules, and the autopilot's guidance.
    ownship : Ownship
        The aircraft, for its bank and the wind.
    path : Path
        The path to be flown.
    waypoints : Waypoints
        The mission's waypoints.
    """
    begin = _at_start(ownship, path, 0.0)
    return any(
        _is_entry_clear(state, replace(begin, bank_rad=bank), waypoints, k, with_variations=False)
        for bank in (begin.bank_rad, 0.0)
        for k in _ahead(waypoints, 0.0)
    )


def _ahead(waypoints: Waypoints, here_m: float) -> Iterator[int]:
    """Yield the numbers of waypoints at which a mission may be entered, ``here_m`` along its path [m].

    The first is the next waypoint on the path. Later ones follow only if no action is skipped. None is later
    than the last airspeed command of the mission.
    """
    last, first_m = len(waypoints.distances_m) - 1, math.inf
    with_actions = {number for number, _ in waypoints.actions}
    for k, distance in enumerate(waypoints.distances_m):
        if distance < here_m + AHEAD_MIN_M and k < last:
            continue
        first_m = min(first_m, float(distance))
        if distance > first_m + ALTERNATIVES_MAX_M or 0 < waypoints.airspeed_again < k:
            return
        yield k
        if k in with_actions:
            return


def _predicted(ownship: Ownship, path: Path, in_s: float) -> Ownship:
    """Return the predicted aircraft: by its own motion for a short time, later at the path's start."""
    if in_s <= MOTION_VALID_S:
        return predicted(ownship, in_s) if in_s > 0.0 else ownship
    return _at_start(ownship, path, float(path.times_s[0]) - ownship.stamp_s - in_s)


def _at_start(ownship: Ownship, path: Path, before_s: float) -> Ownship:
    """Return the aircraft at a path's start, or a time before it [s], with the present wind and bank."""
    begin = at_start(path, ownship.wind_enu_m_s)
    (east, north, up), back = begin.position_enu_m, before_s * begin.ground_speed_m_s
    return replace(
        begin,
        position_enu_m=(
            east - back * math.sin(begin.course_rad), north - back * math.cos(begin.course_rad), up
        ),
        bank_rad=ownship.bank_rad,
    )  # fmt: skip


def _is_entry_clear(
    state: FlightState, ownship: Ownship, waypoints: Waypoints, number: int, *, with_variations: bool = True
) -> bool:
    """Return whether the tracks to a waypoint, and on until the aircraft is established, are clear."""
    away = waypoints.positions_enu_m[number] - np.asarray(ownship.position_enu_m)
    if abs(wrapped_angle(math.atan2(away[0], away[1]) - ownship.course_rad)) > BEHIND_RAD:
        return False
    guidance, clearance = guidance_over(state, waypoints), float(state.mission.planning.clearance_min_m)
    track = _entry_track(guidance, ownship, waypoints, number, SIMULATED_MAX_S)
    passed = np.flatnonzero(track.reached > 0)
    ends_s = SIMULATED_MAX_S if len(passed) == 0 else float(track.times_s[passed[0]]) + guidance.l1_period_s
    check = partial(state.rules.checker.check_track, may_come_back=True, keeps_height=True)
    if check(track.positions_enu_m[track.times_s <= ends_s], MARGIN_SHARE * clearance):
        return False
    variations = [(guidance_over(state, waypoints, at_once=True), ownship)]
    if with_variations:
        variations += _variations(guidance, ownship)
    ends_s = min(ends_s, SIMULATED_MAX_S)
    others = (_entry_track(law, own, waypoints, number, ends_s) for law, own in variations)
    return not any(check(other.positions_enu_m, VARIATION_MARGIN_SHARE * clearance) for other in others)


def _entry_track(
    guidance: Guidance, ownship: Ownship, waypoints: Waypoints, number: int, ends_s: float
) -> Track:
    """Simulate the direct flight to a waypoint, and on over the following waypoints."""
    return track_of_legs(
        guidance, ownship, waypoints.positions_enu_m[number:], loiter=waypoints.circle, ends_s=ends_s,
        step_s=STEP_S,
    )  # fmt: skip


def _variations(guidance: Guidance, ownship: Ownship) -> Iterator[tuple[Guidance, Ownship]]:
    """Yield variations of the flight into the mission: each with its guidance and its start."""
    yield guidance, predicted(ownship, DELAY_VARIATION_S)
    yield replace(guidance, roll_time_s=ROLL_TIME_FACTOR * guidance.roll_time_s), ownship
    wide = replace(  # In a fast change from one turn to the other the aircraft swings wide.
        guidance,
        l1_period_s=PERIOD_FACTOR * guidance.l1_period_s,
        roll_rate_max_rad_s=ROLL_RATE_FACTOR * guidance.roll_rate_max_rad_s,
    )
    yield wide, ownship
    east, north, up = ownship.position_enu_m
    course, (wind_east, wind_north) = ownship.course_rad, ownship.wind_enu_m_s
    for side in (-1.0, 1.0):
        sideways = (side * math.cos(course), -side * math.sin(course))
        yield guidance, replace(ownship, bank_rad=ownship.bank_rad + side * BANK_VARIATION_RAD)
        displaced = (east + LATERAL_VARIATION_M * sideways[0], north + LATERAL_VARIATION_M * sideways[1], up)
        yield guidance, replace(ownship, position_enu_m=displaced)
        wind = (wind_east + WIND_VARIATION_M_S * sideways[0], wind_north + WIND_VARIATION_M_S * sideways[1])
        yield guidance, replace(ownship, wind_enu_m_s=wind)
    if not guidance.flies_by:  # A PX4 that is too low accepts its waypoints late.
        slower = replace(
            guidance,
            climb_rate_max_m_s=CLIMB_FACTOR * guidance.climb_rate_max_m_s,
            sink_rate_max_m_s=CLIMB_FACTOR * guidance.sink_rate_max_m_s,
        )
        yield slower, replace(ownship, position_enu_m=(east, north, up - HEIGHT_VARIATION_M))

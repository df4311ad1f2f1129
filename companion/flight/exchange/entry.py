"""Where a mission is entered: a waypoint ahead to which, and past which, the aircraft flies without harm.

The way there is the one that this aircraft flies under its autopilot's guidance, from the bank it has, in
the wind there is (:mod:`companion.world.vehicle.guidance`), until it is established on the path. A few others
are looked at that it might as well fly: a moment later, banked otherwise, beside its place, in another wind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from companion.flight.state.flight_state import FlightState
from companion.flight.state.mission_simulation import AT_ONCE_M_S2, at_row, guidance_over
from companion.frames import wrapped_angle
from companion.mission.path_progress import distance_along, progress_on
from companion.mission.waypoints import Waypoints
from companion.tracking.ownship import predicted
from companion.types.path import Path
from companion.types.state import Ownship
from companion.world.vehicle.guidance import Guidance, Track, track_of_legs

ENTRY_ROWS = 8  # of a new path in which the aircraft is looked for when it is entered
AHEAD_MIN_M = 30.0  # of the aircraft, along the path: a nearer waypoint counts as passed
AHEAD_MORE_M = 120.0  # beyond which no further waypoint is tried in place of the first
BEHIND_RAD = math.radians(110.0)  # off the course a waypoint lies behind
BY_MOTION_S = 2.0  # the present turn is believed to go on for so long; the path's start is, for longer
LONGEST_S = 60.0  # of a way that is looked at
MARGIN_SHARE = 0.9  # of clearance_min_m, kept by the way that is expected
FAN_MARGIN_SHARE = 0.4  # of the same, kept by those that are less likely
LATER_S = 0.5
OTHERWISE_RAD = math.radians(6.0)  # of bank
BESIDE_M = 4.0
OTHER_WIND_M_S = 1.5
LOWER_M, CLIMBS_LESS = 4.0, 0.4
ROLLS_LESS, ROLLS_SLOWER = 1.6, 0.7
STEERS_SOONER = 0.8
STEP_S = 0.5


def entry_of(
    state: FlightState,
    ownship: Ownship,
    path: Path,
    waypoints: Waypoints,
    in_s: float = 0.0,
    *,
    number: int | None = None,
) -> int | None:
    """Number of a waypoint that lies ahead and is flown to without harm, the turns at it included.

    None where none is. An upload may have lasted, and the aircraft have turned away meanwhile.

    Parameters
    ----------
    state : FlightState
        Rules, and how the autopilot flies.
    ownship : Ownship
        Where the aircraft is.
    path : Path
        What is to be flown.
    waypoints : Waypoints
        What the mission carries of it.
    in_s : float
        How long the aircraft still flies on before it is sent there [s].
    number : int, optional
        The only waypoint asked for; left out, the first is chosen that will do.
    """
    there = _moved_on(ownship, path, in_s)
    here = distance_along(path, progress_on(path, there.position_enu_m, 0, ENTRY_ROWS))
    for k in _ahead(waypoints, here):
        if number in (None, k) and _is_harmless(state, there, waypoints, k):
            return k
    return None


def may_be_entered(state: FlightState, ownship: Ownship, path: Path, waypoints: Waypoints) -> bool:
    """Whether a mission can be entered at all from where its path begins, banked as now or not.

    Asked before anything is sent: what cannot succeed is not worth an exchange.

    Parameters
    ----------
    state : FlightState
        Rules, and how the autopilot flies.
    ownship : Ownship
        The aircraft's bank, and the wind.
    path : Path
        What is to be flown.
    waypoints : Waypoints
        What the mission carries of it.
    """
    begin = _at_start(ownship, path, 0.0)
    return any(
        _is_harmless(state, replace(begin, bank_rad=bank), waypoints, k, with_fan=False)
        for bank in (begin.bank_rad, 0.0)
        for k in _ahead(waypoints, 0.0)
    )


def _ahead(waypoints: Waypoints, here_m: float) -> Iterator[int]:
    """Numbers of waypoints at which a mission may be entered, ``here_m`` along its path [m].

    The first is that which the path comes to; others in its place only if nothing is to be done at those
    before them. None lies behind where the mission commands its airspeed for the last time.
    """
    last, first_m = len(waypoints.distances_m) - 1, math.inf
    busy = {number for number, _ in waypoints.actions}
    for k, distance in enumerate(waypoints.distances_m):
        if distance < here_m + AHEAD_MIN_M and k < last:
            continue
        first_m = min(first_m, float(distance))
        if distance > first_m + AHEAD_MORE_M or 0 < waypoints.airspeed_again < k:
            return
        yield k
        if k in busy:
            return


def _moved_on(ownship: Ownship, path: Path, in_s: float) -> Ownship:
    """The aircraft in a while: by its own motion, or where the new path expects it."""
    if in_s <= BY_MOTION_S:
        return predicted(ownship, in_s) if in_s > 0.0 else ownship
    return _at_start(ownship, path, float(path.times_s[0]) - ownship.stamp_s - in_s)


def _at_start(ownship: Ownship, path: Path, before_s: float) -> Ownship:
    """The aircraft where a path begins, or so long before it [s]; wind and bank as they are now."""
    begin = at_row(path, ownship.wind_enu_m_s)
    (east, north, up), back = begin.position_enu_m, before_s * begin.ground_speed_m_s
    return replace(
        begin,
        position_enu_m=(
            east - back * math.sin(begin.course_rad), north - back * math.cos(begin.course_rad), up
        ),
        bank_rad=ownship.bank_rad,
    )  # fmt: skip


def _is_harmless(
    state: FlightState, ownship: Ownship, waypoints: Waypoints, number: int, *, with_fan: bool = True
) -> bool:
    """Whether the ways to a waypoint, and on until the aircraft is established, keep clear."""
    away = waypoints.positions_enu_m[number] - np.asarray(ownship.position_enu_m)
    if abs(wrapped_angle(math.atan2(away[0], away[1]) - ownship.course_rad)) > BEHIND_RAD:
        return False
    guidance, clearance = guidance_over(state, waypoints), float(state.mission.planning.clearance_min_m)
    way = _way_in(guidance, ownship, waypoints, number, LONGEST_S)
    passed = np.flatnonzero(way.reached > 0)
    ends_s = LONGEST_S if len(passed) == 0 else float(way.times_s[passed[0]]) + guidance.l1_period_s
    check = partial(state.rules.checker.check_track, may_come_back=True)
    if check(way.positions_enu_m[way.times_s <= ends_s], MARGIN_SHARE * clearance):
        return False
    at_once = replace(guidance, acceleration_m_s2=AT_ONCE_M_S2)
    fan = _fan(guidance, ownship) if with_fan else iter([(at_once, ownship)])
    others = (_way_in(law, own, waypoints, number, min(ends_s, LONGEST_S)) for law, own in fan)
    return not any(check(other.positions_enu_m, FAN_MARGIN_SHARE * clearance) for other in others)


def _way_in(guidance: Guidance, ownship: Ownship, waypoints: Waypoints, number: int, ends_s: float) -> Track:
    """Fly to a waypoint directly, and on over those that follow."""
    loiter = waypoints.loiter_centre_enu_m
    circle = (waypoints.positions_enu_m[-1] if loiter is None else loiter, waypoints.loiter_radius_m)
    return track_of_legs(
        guidance, ownship, waypoints.positions_enu_m[number:], loiter=circle, ends_s=ends_s, step_s=STEP_S
    )


def _fan(guidance: Guidance, ownship: Ownship) -> Iterator[tuple[Guidance, Ownship]]:
    """How the aircraft might as well fly in: each with what it is steered by and where it begins."""
    yield replace(guidance, acceleration_m_s2=AT_ONCE_M_S2), ownship
    yield guidance, predicted(ownship, LATER_S)
    yield replace(guidance, roll_time_s=ROLLS_LESS * guidance.roll_time_s), ownship
    swinging = replace(  # out of one turn into another, fast, it goes wide
        guidance,
        l1_period_s=STEERS_SOONER * guidance.l1_period_s,
        roll_rate_max_rad_s=ROLLS_SLOWER * guidance.roll_rate_max_rad_s,
    )
    yield swinging, ownship
    east, north, up = ownship.position_enu_m
    course, (wind_east, wind_north) = ownship.course_rad, ownship.wind_enu_m_s
    for side in (-1.0, 1.0):
        aside = (side * math.cos(course), -side * math.sin(course))
        yield guidance, replace(ownship, bank_rad=ownship.bank_rad + side * OTHERWISE_RAD)
        beside = (east + BESIDE_M * aside[0], north + BESIDE_M * aside[1], up)
        yield guidance, replace(ownship, position_enu_m=beside)
        wind = (wind_east + OTHER_WIND_M_S * aside[0], wind_north + OTHER_WIND_M_S * aside[1])
        yield guidance, replace(ownship, wind_enu_m_s=wind)
    if not guidance.flies_by:  # low, its waypoints count as reached late
        slower = replace(guidance, climb_rate_max_m_s=CLIMBS_LESS * guidance.climb_rate_max_m_s)
        yield slower, replace(ownship, position_enu_m=(east, north, up - LOWER_M))

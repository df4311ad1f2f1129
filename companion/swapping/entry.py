"""Where a mission is entered: the first waypoint ahead that is flown to without harm."""

from __future__ import annotations

import math

import numpy as np

from companion.flight.flight_state import FlightState
from companion.frames import FloatArray, wrapped_angle
from companion.mission.path_progress import distance_along, progress_on, way_to
from companion.mission.waypoints import FLY_BY_M, Waypoints
from companion.types.path import Path
from companion.types.state import Ownship

ENTRY_ROWS = 8  # of a new path in which the aircraft is looked for when it is entered
AHEAD_MIN_M = 30.0  # of the aircraft, along the path: a nearer waypoint counts as passed
ENTRY_RULES = frozenset({"clearance", "bounds"})
ALIGNED_RAD = math.radians(10.0)  # an entry flown to like this is flown to as the path does
WIDENED = 1.6  # of the smallest radius, in which an autopilot turns to a new point for certain


def entry_of(
    state: FlightState, ownship: Ownship, path: Path, waypoints: Waypoints, in_s: float = 0.0
) -> int | None:
    """Number of the first waypoint that lies ahead and is flown to without harm, the turn included.

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
    """
    here = distance_along(path, progress_on(path, ownship.position_enu_m, 0, ENTRY_ROWS))
    here += in_s * ownship.ground_speed_m_s
    last = len(waypoints.distances_m) - 1
    for k, distance in enumerate(waypoints.distances_m):
        if distance >= here + AHEAD_MIN_M or k == last:
            return k if _is_harmless(state, ownship, path, waypoints, k) else None
    return None


def _is_harmless(state: FlightState, ownship: Ownship, path: Path, waypoints: Waypoints, number: int) -> bool:
    """Whether the way to a waypoint, and the turns from there on, keep clear."""
    legs = way_to(
        ownship.position_enu_m, ownship.course_rad, waypoints.positions_enu_m[number],
        WIDENED * state.rules.vehicle.turn_radius_min_m,
    )  # fmt: skip
    if legs is None:
        return False
    before = path.positions_enu_m[0] if number == 0 else waypoints.positions_enu_m[number - 1]
    onwards = turns_after(state, legs, waypoints.positions_enu_m[number + 1 :], before)
    if onwards is None:
        return False
    ways = [legs, legs[[0, -1]], *onwards]  # the wide turn, and what a tight one comes to
    wrong = [
        entry
        for way in ways
        for entry in state.rules.checker.check_legs(
            way,
            ends_in_loiter=True,
            loiter_radius_m=waypoints.loiter_radius_m,
            loiter_centre_enu_m=waypoints.loiter_centre_enu_m,
        )
    ]
    return not any(entry.rule in ENTRY_RULES for entry in wrong)


def turns_after(
    state: FlightState, legs: FloatArray, following: FloatArray, before: FloatArray
) -> list[FloatArray] | None:
    """Turns at an entry reached over ``legs`` to the waypoints after it; None if one is behind.

    The path comes to its entry from the waypoint ``before``; who enters it may come from elsewhere. A
    waypoint that is nearer than the turn then counts as reached beside it, in the middle of the turn:
    so the way to the one after it is looked at, too, until the turn is over.

    Parameters
    ----------
    state : FlightState
        Rules, and how the autopilot flies.
    legs : ndarray, shape (K, 3)
        Corners of the way to the entry, the entry last [m].
    following : ndarray, shape (M, 3)
        Waypoints after it [m].
    before : ndarray, shape (3,)
        The path's waypoint before it [m].

    Returns
    -------
    list of ndarray, shape (J, 3), or None
        Corners of the way to each waypoint that is looked at [m].
    """
    way, radius = legs[-1] - legs[-2], WIDENED * state.rules.vehicle.turn_radius_min_m
    length = max(float(np.linalg.norm(way)), 1e-9)
    reached = legs[-1] - way * min(1.0, (FLY_BY_M if state.flies_by else 0.0) / length)
    place = (float(reached[0]), float(reached[1]), float(reached[2]))
    course = math.atan2(way[0], way[1])
    usual = legs[-1] - before
    is_usual = abs(wrapped_angle(math.atan2(usual[0], usual[1]) - course)) < ALIGNED_RAD
    found: list[FloatArray] = []
    for after in following[:1] if is_usual else following:
        turn = way_to(place, course, after, radius)
        if turn is None:
            return None
        found.append(turn)
        if len(turn) > 2 or float(np.hypot(*(after - reached)[:2])) >= radius:
            break
    return found

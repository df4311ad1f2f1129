"""The way on behind a mission's last goal, where the autopilot flies on with the operator's items.

A mission may end at its last goal without a circle if the way on is clear: the autopilot then flies the
operator's items, most often an approach, up to the circle with which a landing begins, or to the landing
itself. In a team that way and that circle belong to the plan that the others approve or refuse. While another
member flies there, the mission ends in a circle before the goal.
"""

from __future__ import annotations

import math

import numpy as np

from companion.flight.construction.loiter_circles import circle_of, end_circle, place_of
from companion.flight.construction.mission_simulation import STEP_S, at_start, guidance_of, is_taken
from companion.flight.state.flight_state import FlightState
from companion.frames import FloatArray
from companion.mission.team.shared_plan import circled
from companion.types.mission import Command
from companion.types.path import Path
from companion.world.vehicle.guidance import track_of_circle, track_of_legs

GOAL_TOLERANCE_M = 5.0  # A path reaches the goal if it ends this close to the goal's region.
JOINED_S = 90.0  # The aircraft has joined the circle and flown a lap of it in this time.
SLOWEST_M_S = 5.0  # The assumed ground speed is not lower.
DESCENT_M_S = 1.0  # An aircraft sinks at this rate at least.
WAY_MAX_S = 900.0  # A longer way on is cut off.
# After these items the aircraft leaves the air, or the list does not go on with the next one.
LAST = frozenset({Command.DO_JUMP, Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH})


def may_go_on(state: FlightState, last_enu_m: FloatArray) -> bool:
    """Return whether a path ends at the last goal, and the leg on to the operator's items is clear.

    Parameters
    ----------
    state : FlightState
        Goals, the operator's items, obstacles and fences.
    last_enu_m : ndarray, shape (3,)
        The end of the path [m].
    """
    if state.tail_enu_m is None or not state.continues_behind or not state.goals:
        return False
    goal = state.goals[-1]
    if (
        np.linalg.norm(last_enu_m - np.asarray(goal.position_enu_m))
        > goal.acceptance_radius_m + GOAL_TOLERANCE_M
    ):
        return False  # The path ends in a safe loiter: the next plan begins there.
    legs: FloatArray = np.vstack([last_enu_m, state.tail_enu_m])
    wrong = state.rules.checker.check_legs(legs, ends_in_loiter=True, loiter_radius_m=state.turn_radius_m)
    return not any(entry.rule == "clearance" for entry in wrong)


def goes_on_behind(state: FlightState) -> bool:
    """Return whether the flown mission leads on to the operator's items behind it, not into a circle."""
    return state.continues_behind and end_circle(state, 0.0) is None


def with_way_behind(state: FlightState, path: Path, rows: FloatArray) -> tuple[FloatArray, float]:
    """Return the rows of a flight to the last goal with those of the way on behind it.

    Parameters
    ----------
    state : FlightState
        The operator's items and the autopilot's guidance.
    path : Path
        A path to the last goal.
    rows : ndarray, shape (N, 4)
        The flight to the end of the path: time [s], east, north, up [m].

    Returns
    -------
    rows : ndarray, shape (M, 4)
        The whole flight. If it ends in a circle, the last row is the circle's centre.
    radius_m : float
        Radius of that circle; 0 if there is none [m].
    """
    legs, circle = _legs_behind(state)
    if not legs and circle is None:
        return rows, 0.0
    begun, guidance = at_start(path.since(len(path) - 1), state.wind_enu_m_s), guidance_of(state)
    places = np.array([begun.position_enu_m, *legs, *([] if circle is None else [circle[0]])])
    legs_m = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    speed = max(begun.airspeed_m_s - math.hypot(*state.wind_enu_m_s), SLOWEST_M_S)
    sinks_m = abs(float(places[-1, 2] - places[0, 2]))
    ends_s = min(float(legs_m) / speed + sinks_m / DESCENT_M_S + JOINED_S, WAY_MAX_S)
    if not legs and circle is not None:
        track = track_of_circle(guidance, begun, np.asarray(circle[0]), circle[1], ends_s, STEP_S)
    else:
        track = track_of_legs(guidance, begun, np.array(legs), loiter=circle, ends_s=ends_s, step_s=STEP_S)
    is_flown = track.reached < len(legs)
    if circle is None and not is_flown.all():
        track = track.until(int(np.argmin(is_flown)))
    times = rows[-1, 0] + track.times_s
    behind = np.column_stack([times, track.positions_enu_m])[1:]
    whole = np.vstack([rows, behind])
    return (whole, 0.0) if circle is None else circled(whole)


def is_way_behind_taken(state: FlightState, path: Path) -> bool:
    """Return whether an aircraft that keeps its route comes near the way on behind a path to the last goal.

    Parameters
    ----------
    state : FlightState
        Other aircraft, and the operator's items.
    path : Path
        A path to the last goal.
    """
    if not any(track.keeps_route for track in state.picture.tracks):
        return False
    last = np.array([[path.times_s[-1], *path.positions_enu_m[-1]]])
    return is_taken(state, *with_way_behind(state, path, last))


def _legs_behind(state: FlightState) -> tuple[list[FloatArray], tuple[FloatArray, float] | None]:
    """Return positions (3,) that are flown to behind the last goal, and the final circle [m]."""
    operator, tail, legs = state.mission_list.operator, state.tail_enu_m, list[FloatArray]()
    if operator is None or tail is None:
        return legs, None
    for item in operator.items[operator.tail :]:
        circle = circle_of(state, item, tail[2])
        if circle is not None:
            return legs, (np.asarray(circle[0]), circle[1])
        if item.command in LAST:
            break
        place = place_of(state, item)
        if place is not None:
            legs.append(np.asarray(place))
    return legs, None

"""The description of a return to launch, in words for the pilot on the ground."""

from __future__ import annotations

import math

from companion.flight.construction.way_on import BY_MISSION
from companion.flight.prediction.obstacle_ahead import first_met
from companion.flight.prediction.return_path import (
    HOME,
    is_unpredictable,
    return_tracks,
    start_of_return,
)
from companion.flight.state.flight_state import FlightState
from companion.types.state import LANDING_AT_ONCE, Ownship


def return_in_words(state: FlightState) -> str:
    """Return what a return to launch does, by the autopilot's parameters; '' while they are not known.

    Parameters
    ----------
    state : FlightState
        Home, rally points, the operator's landing, and the autopilot's parameters.
    """
    kind, operator = state.settings.return_kind, state.mission_list.operator
    if kind is None or state.home_enu_m is None:
        return ""
    if is_unpredictable(state):
        return "leads where the planner cannot tell"
    has_landing = operator is not None and operator.has_landing
    if is_kept(state):
        return "follows a path that the planner keeps checked"
    if not state.flies_by and kind == BY_MISSION:
        return "flies the mission on to its landing"
    is_landing = kind == LANDING_AT_ONCE if state.flies_by else kind != HOME
    if has_landing and is_landing:
        return "flies straight to the landing"
    return "flies straight " + ("to a rally point or home" if state.rally_points else "home")


def is_kept(state: FlightState) -> bool:
    """Return whether the service keeps a return path in an ArduPlane's list."""
    return start_of_return(state) is not None and state.mission.authority.keep_return_path


def goals_without_return(state: FlightState) -> list[str]:
    """Return the goals from which a return would come too near to something, in words.

    Parameters
    ----------
    state : FlightState
        The goals and the rules. A return path that the service keeps is not there yet, and not judged.
    """
    if is_kept(state) or not state.goals:
        return []
    start, cruise = state.mission.start, state.rules.vehicle.airspeed_cruise_m_s
    before = (float(start.east_m), float(start.north_m))
    found = []
    for number, goal in enumerate(state.goals, 1):
        east, north, up = goal.position_enu_m
        course = math.atan2(east - before[0], north - before[1]) % (2.0 * math.pi)
        at_goal = Ownship(0.0, (east, north, up), course, 0.0, cruise, cruise, state.wind_enu_m_s)
        for track in return_tracks(state, at_goal) or []:
            met = first_met(state, track)
            if met is not None:
                found.append(f"RTL from goal {number} is not safe: {met.in_short}")
                break
        before = (east, north)
    return found

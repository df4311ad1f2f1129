"""Make a return path for an ArduPlane's list, and judge how long it covers the flown path.

A return to launch may begin at any place of the flown path. From each of them, some seconds apart, the flight
to the return path and along it is simulated by the autopilot's guidance and checked. The return path covers
the flown path up to the first place from which this flight comes too near to something.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.flight.construction.loiter_circles import end_circle, place_of
from companion.flight.construction.mission_construction import construct
from companion.flight.prediction.mode_tracks import state_on
from companion.flight.prediction.obstacle_ahead import is_clear
from companion.flight.prediction.return_path import (
    STEP_S,
    circling_tracks,
    start_of_return,
    tracks_by_return_path,
)
from companion.flight.state.flight_state import FlightState
from companion.flight.state.goals_state import bound_for
from companion.frames import FloatArray, wrapped_angle
from companion.mission.return_bank import (
    RETURN_WAYPOINTS_MAX,
    followed,
    joined_item,
    joined_items,
    landing_start,
    path_start,
    return_bank,
    start_places,
)
from companion.mission.waypoints import loiter_item, path_items, placed_item, speed_item
from companion.planning.problem import GoalRegion
from companion.types.mission import Command, MissionItem
from companion.types.path import Path
from companion.types.state import Ownship
from companion.world.ground.autopilot_ground import AutopilotGround

# A return is simulated from each place of the flown path from which it joins another leg than from the place
# before, and at least this often along the path.
PLACES_S = 3.0
COVERED_MAX_S = 20.0  # The flown path is looked at this far ahead.
LANDING_NEAR_M = 60.0  # A waypoint this near to the operator's first item of the landing is left out.


@dataclass(frozen=True, slots=True)
class ReturnMission:
    """A return path as items.

    Parameters
    ----------
    bank : tuple of MissionItem
        The return bank, armed.
    speed : MissionItem
        The item that commands the airspeed, in the places of the starts while the bank is not armed.
    path : Path
        The planned path.
    place : GoalRegion
        Where the path ends.
    is_landing : bool
        Whether the operator's landing follows there.
    covered_s : float
        For how long a return from the flown path keeps clear, from now on [s]; infinite if to its end.
    """

    bank: tuple[MissionItem, ...]
    speed: MissionItem
    path: Path
    place: GoalRegion
    is_landing: bool
    covered_s: float


def return_mission(
    state: FlightState, ownship: Ownship, path: Path, flown_m: float, place: GoalRegion, *, is_landing: bool
) -> ReturnMission | None:
    """Return a path to a place as a return path; None if no mission carries it.

    Parameters
    ----------
    state : FlightState
        The flown mission, the list and the rules.
    ownship : Ownship
        The aircraft now.
    path : Path
        A path to the place.
    flown_m : float
        Length of its first part, which is the flown path [m].
    place : GoalRegion
        Where the return path ends.
    is_landing : bool
        Whether the operator's landing follows; otherwise the path ends in a circle.
    """
    start = start_of_return(state)
    found = construct(bound_for(state, place), path, RETURN_WAYPOINTS_MAX, is_whole=True)
    if start is None or found.violations or found.covered_until_s < float(path.times_s[-1]):
        return None
    frame, waypoints = state.mission.frame, found.waypoints
    items = tuple(item for item in path_items(waypoints, frame) if item.command == Command.NAV_WAYPOINT)
    operator, landing = state.mission_list.operator, None
    if is_landing and operator is not None and state.tail_enu_m is not None:
        landing = operator.tail
        if math.dist(waypoints.positions_enu_m[-1][:2], state.tail_enu_m[:2]) < LANDING_NEAR_M:
            items = items[: max(len(items) - 1, 1)]
    end = None if landing is not None else loiter_item(waypoints, frame)
    starts = [(0, path_start())]
    if start is Command.DO_LAND_START:
        corners = np.vstack([path.positions_enu_m[0], waypoints.positions_enu_m[: len(items)]])
        num_flown = int(np.searchsorted(waypoints.distances_m, flown_m))
        starts = _landing_starts(state, corners, num_flown, waypoints.ground)
    bank = return_bank(items, starts, end, landing)
    covers_s = covered_s(state, ownship, with_bank(state, bank))
    return ReturnMission(bank, speed_item(waypoints, frame), path, place, landing is not None, covers_s)


def _landing_starts(
    state: FlightState, corners_enu_m: FloatArray, num_flown: int, ground: AutopilotGround | None
) -> list[tuple[int, MissionItem]]:
    """Return starts of a return path as items; ``corners_enu_m`` (N + 1, 3) are its begin and waypoints."""
    items = (
        (number, placed_item(Command.NAV_WAYPOINT, place, state.mission.frame, ground))
        for number, place in start_places(corners_enu_m, num_flown)
    )
    return [(number, landing_start(item)) for number, item in items]


def covered_s(state: FlightState, ownship: Ownship, items: Sequence[MissionItem]) -> float:
    """Return for how long a return from the flown path keeps clear, from now on [s].

    Parameters
    ----------
    state : FlightState
        The flown path and the rules.
    ownship : Ownship
        The aircraft now.
    items : sequence of MissionItem
        The list with a return path.

    Returns
    -------
    float
        0 if a return from here does not keep clear, at most :data:`COVERED_MAX_S`; infinite if each one up to
        the mission's end does.
    """
    start = start_of_return(state)
    if start is None or not _returns_clear(state, ownship, items):
        return 0.0
    track = _track_ahead(state, ownship)
    joined = joined_items(items, state.mission.frame, state.mission_list.home_amsl_m, track, start)
    before, last = 0, len(track) - 1
    for row in range(1, last):
        if joined[row] == joined[before] and row - before < round(PLACES_S / STEP_S):
            continue
        if not _returns_clear(state, state_on(track, row, ownship), items):
            return STEP_S * before
        before = row
    return math.inf if len(track) * STEP_S < COVERED_MAX_S else COVERED_MAX_S


def turns_about(state: FlightState, ownship: Ownship, items: Sequence[MissionItem], after_s: float) -> bool:
    """Return whether a return that begins soon on the flown path turns about to join the return path.

    It does if the first waypoint that it flies to lies behind the aircraft, or inside its tightest turn.

    Parameters
    ----------
    state : FlightState
        The flown path.
    ownship : Ownship
        The aircraft now.
    items : sequence of MissionItem
        The list with a return path.
    after_s : float
        Time from now to the begin of the return [s].
    """
    start, frame, home_amsl_m = start_of_return(state), state.mission.frame, state.mission_list.home_amsl_m
    later = state_on(_track_ahead(state, ownship), round(after_s / STEP_S), ownship)
    here = later.position_enu_m
    joined = None if start is None else joined_item(items, frame, home_amsl_m, here, start)
    places = () if joined is None else (place_of(state, item) for item in followed(items, joined))
    first = next((place for place in places if place is not None), None)
    if first is None:
        return False
    east, north = first[0] - here[0], first[1] - here[1]
    angle = abs(wrapped_angle(math.atan2(east, north) - later.course_rad))
    return angle > 0.5 * math.pi or math.hypot(east, north) < 2.0 * state.turn_radius_m * math.sin(angle)


def with_bank(state: FlightState, bank: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    """Return the list with a return bank in the place of those that it has."""
    layout = state.mission_list.layout
    first = len(state.mission_list.stored) if layout is None else layout.return_span[0]
    kept = state.mission_list.stored[:first]
    return (*kept, *(replace(item, sequence=len(kept) + n) for n, item in enumerate(bank)))


def _returns_clear(state: FlightState, ownship: Ownship, items: Sequence[MissionItem]) -> bool:
    """Return whether a return that begins here keeps clear on each track that it may take."""
    tracks = tracks_by_return_path(state, ownship, items)
    return bool(tracks) and all(is_clear(state, track[::2]) for track in tracks)


def _track_ahead(state: FlightState, ownship: Ownship) -> FloatArray:
    """Return positions (K, 3) on the flown path from here, and once round the circle at its end [m]."""
    here = np.array([ownship.position_enu_m])
    flown = state.flown
    if flown is None or state.mission_list.layout is None:
        return here
    row = min(flown.row, len(flown.path) - 2)
    begin_s = float(flown.path.times_s[row])
    ahead_s = min(flown.covered_until_s - begin_s, COVERED_MAX_S)
    at = begin_s + np.arange(0.0, max(ahead_s, STEP_S), STEP_S)
    places = np.column_stack(
        [np.interp(at, flown.path.times_s, flown.path.positions_enu_m[:, axis]) for axis in range(3)]
    )
    circle = end_circle(state, ownship.position_enu_m[2])
    if circle is None or ahead_s >= COVERED_MAX_S or len(places) < 3:
        return places
    entered = state_on(places, len(places) - 2, ownship)
    return np.vstack([places, *(track[1:] for track in circling_tracks(state, entered, *circle)[:1])])

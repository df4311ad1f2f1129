"""Summary of the operator's list for the pilot on the ground: what is flown, and what is wrong."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from companion.config.sections.terrain_map import ground_heights_of
from companion.flight.construction.loiter_circles import place_of
from companion.flight.prediction.return_path import is_unpredictable
from companion.flight.prediction.return_words import goals_without_return, return_in_words
from companion.flight.state.flight_state import FlightState
from companion.flight.takeover.capability import shortfalls
from companion.flight.takeover.takeover import described, last_item_of, takeoff_of
from companion.mission.operator import FIRST_WITHOUT_PLACE, TERRAIN_FRAMES, Operator
from companion.types.mission import Command, MissionItem
from companion.types.state import Ownship

FAR_M = 50_000.0  # An aircraft this far from the mission file's origin is at another airfield.
FAULTS_MAX = 4  # At most this many faults are sent to the pilot.


@dataclass(frozen=True, slots=True)
class OperatorSummary:
    """Summary of a list.

    Parameters
    ----------
    plan : str
        What will be flown.
    takeover : str
        When the service takes over.
    landing : str
        How the flight ends.
    has_end : bool
        Whether items follow the goal.
    faults : tuple of str
        What is wrong, the most serious first.
    returns : str
        What a return to launch does; '' while it is not known.
    lowest : str
        The item that is lowest over the ground of the map; '' without a map.
    """

    plan: str
    takeover: str
    landing: str
    has_end: bool
    faults: tuple[str, ...]
    returns: str = ""
    lowest: str = ""


def operator_summary_of(state: FlightState, ownship: Ownship | None, num_home_items: int) -> OperatorSummary:
    """Return the summary of the list as it was read.

    Parameters
    ----------
    state : FlightState
        Mission file and list.
    ownship : Ownship or None
        The aircraft on the ground.
    num_home_items : int
        Number of items at the start of the list that the ground station does not number.
    """
    operator = state.mission_list.operator
    if operator is None or len(operator.items) <= num_home_items:
        return OperatorSummary("", "", "", has_end=False, faults=("no mission in the autopilot",))
    goals = state.rules.goals if state.mission.shares_goals else state.goals_left
    count = len(operator.items) - num_home_items
    plan = f"{count} items, {len(goals)} goal{'s' * (len(goals) != 1)}"
    if goals:
        here = (state.mission.start.east_m, state.mission.start.north_m)
        places = [here if ownship is None else ownship.position_enu_m[:2]]
        places += [goal.position_enu_m[:2] for goal in goals]
        length = sum(math.dist(a, b) for a, b in itertools.pairwise(places))
        plan += f", {1e-3 * length:.1f} km"
    faults = tuple(_faults(state, operator, ownship))
    has_end = operator.tail < len(operator.items)
    return OperatorSummary(
        plan, described(state), _landing(operator), has_end, faults, return_in_words(state),
        _lowest(state, operator),
    )  # fmt: skip


def _landing(operator: Operator) -> str:
    """Return in words how the flight ends."""
    if operator.tail >= len(operator.items):
        return "none: it circles at the goal"
    item = operator.items[operator.tail]
    number = operator.tail + 1 - operator.first
    ends = "landing" if operator.has_landing else "the operator's items"
    return f"{ends} from item {number}" + (
        " (DO_LAND_START)" if item.command == Command.DO_LAND_START else ""
    )


def _lowest(state: FlightState, operator: Operator) -> str:
    """Return the item that is lowest over the ground of the map, take-off and landing left out."""
    ground = ground_heights_of(state.mission)
    airborne = [
        item
        for item in operator.items[operator.first :]
        if item.command not in (Command.NAV_LAND, Command.NAV_TAKEOFF)
    ]
    placed = _places(state, tuple(airborne))
    if ground is None or not placed:
        return ""
    places = np.array([place for _, place in placed])
    heights = places[:, 2] - ground.up_m(places)
    item = placed[int(np.argmin(heights))][0]
    number = 0 if item is None else item.sequence + 1 - operator.first
    return f"lowest item {number}, {float(heights.min()):.0f} m over ground"


def _faults(state: FlightState, operator: Operator, ownship: Ownship | None) -> list[str]:
    """Return what is wrong with a list, the most serious first."""
    found = list(shortfalls(state.mission, state.settings, state.home_enu_m, flies_by=state.flies_by))
    if ownship is not None and math.hypot(*ownship.position_enu_m[:2]) > FAR_M:
        away = 1e-3 * math.hypot(*ownship.position_enu_m[:2])
        found.append(f"the mission file's origin is {away:.0f} km from here")
    if not state.goals and not state.mission.shares_goals:
        found.append("no waypoint to fly to")
    last = last_item_of(state)
    is_item = state.mission.takeover.when == "item"
    if is_item and last is not None and last + 1 >= min(operator.tail, len(operator.items)):
        found.append(f"takeover after item {last + 1 - operator.first}, and none follows before the landing")
    if takeoff_of(operator) is None and not state.phase.is_airborne:
        found.append("no take-off item")
    found += _return(state)
    found += goals_without_return(state)[:1]
    found += _unplaced(state, operator)
    found += _legs(state, operator)
    return found[:FAULTS_MAX]


def _return(state: FlightState) -> list[str]:
    """Return a fault if the mission file allows a return to launch that cannot be predicted."""
    kind = state.settings.return_kind
    if not state.mission.authority.allow_rtl or kind is None or not is_unpredictable(state):
        return []
    if state.flies_by and state.settings.returns_over_ground:
        return [f"no return to launch with TERRAIN_FOLLOW {state.settings.terrain_follow:g}"]
    name = "RTL_AUTOLAND" if state.flies_by else "rally points, or RTL_TYPE"
    return [f"no return to launch with {name} {kind:g}"]


def _unplaced(state: FlightState, operator: Operator) -> list[str]:
    """Return a fault for the first item over terrain, if there is no map for it."""
    listed = [
        item
        for item in operator.items[operator.first :]
        if item.command < FIRST_WITHOUT_PLACE
        and (item.latitude_e7 or item.longitude_e7)
        and item.frame in TERRAIN_FRAMES
        and place_of(state, item) is None
    ]
    return [f"item {item.sequence + 1 - operator.first}: height over terrain" for item in listed[:1]]


def _legs(state: FlightState, operator: Operator) -> list[str]:
    """Return legs of the operator's items that are too near to something.

    These are the legs up to the takeover, and those from the last goal to the ground.
    """
    last = last_item_of(state)
    before = [] if last is None else _places(state, operator.items[operator.first : last + 1])
    after = _places(state, operator.items[operator.tail :])
    if state.goals and after:
        after.insert(0, (None, state.goals[-1].position_enu_m))
    found = []
    for (_, begin), (item, end) in (*itertools.pairwise(before), *itertools.pairwise(after)):
        if item is None:
            continue
        rules, leg = state.rules, np.array([begin, end])
        if item.command == Command.NAV_LAND:
            wrong = rules.obstacle_checker.check_track(leg, rules.checker.limits.margin_m)
        else:
            wrong = rules.checker.check_legs(
                leg, ends_in_loiter=True, loiter_radius_m=rules.vehicle.turn_radius_min_m,
                follows_ground=item.frame in TERRAIN_FRAMES,
            )  # fmt: skip
        entry = next((entry for entry in wrong if entry.rule == "clearance"), None)
        if entry is not None:
            number = item.sequence + 1 - operator.first
            found.append(f"to item {number}: {entry.in_short}")
    return found


def _places(
    state: FlightState, items: tuple[MissionItem, ...]
) -> list[tuple[MissionItem | None, tuple[float, float, float]]]:
    """Return items that have a position, with it [m]."""
    placed = [(item, place_of(state, item)) for item in items]
    return [(item, place) for item, place in placed if place is not None]

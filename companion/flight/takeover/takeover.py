"""The time of the takeover: the mission file's ``takeover``, applied to the operator's list.

References
----------
MAVLink ``common.xml``: MAV_CMD_NAV_TAKEOFF, MAV_CMD_NAV_LOITER_*.
"""

from __future__ import annotations

import math

from companion.flight.construction.loiter_circles import circle_of
from companion.flight.state.flight_state import FlightState
from companion.flight.takeover.capability import shortfalls
from companion.mission.operator import Operator
from companion.types.events import MissionCurrent
from companion.types.mission import Command
from companion.types.state import Ownship

TAKEOFFS = frozenset({Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF})
CIRCLE_RADII = 1.5  # An aircraft within this many radii of a circle's centre has reached the circle.


def takeoff_of(operator: Operator) -> int | None:
    """Return the index of the last take-off item before the goal; None without one."""
    takeoffs = [item.sequence for item in operator.items[: operator.tail] if item.command in TAKEOFFS]
    return takeoffs[-1] if takeoffs else None


def last_item_of(state: FlightState) -> int | None:
    """Return the sequence of the last item flown before the takeover; None if there is none."""
    operator, takeover = state.mission_list.operator, state.mission.takeover
    if operator is None:
        return None
    takeoff = takeoff_of(operator)
    if takeover.when != "item" or takeover.item is None:
        return takeoff
    return max(takeover.item - 1 + operator.first, -1 if takeoff is None else takeoff)


def is_due(state: FlightState, current: MissionCurrent | None, ownship: Ownship | None) -> bool:
    """Return whether the service may take over now: in the air, and at the right place of a known list.

    Parameters
    ----------
    state : FlightState
        Mission file, list, and whether the aircraft flies.
    current : MissionCurrent or None
        The item being flown.
    ownship : Ownship or None
        The aircraft now.
    """
    operator = state.mission_list.operator
    if current is None or ownship is None or operator is None or not _is_list_known(state):
        return False
    if len(operator.items) <= operator.first:
        return False
    return state.mission_list.was_found_flown or _is_reached(state, operator, current, ownship)


def _is_list_known(state: FlightState) -> bool:
    """Return whether the aircraft flies a known list, and can do what the mission file asks."""
    listed = state.mission_list
    if shortfalls(state.mission, state.settings, state.home_enu_m, flies_by=state.flies_by):
        return False
    return state.phase.is_airborne and listed.layout is not None and not listed.suspected


def _is_reached(state: FlightState, operator: Operator, current: MissionCurrent, ownship: Ownship) -> bool:
    """Return whether the operator's mission has reached the point of the takeover."""
    takeover, last = state.mission.takeover, last_item_of(state)
    is_landing = operator.tail <= current.sequence < len(operator.items)  # A go-around leaves the landing.
    if is_landing or (last is not None and current.sequence <= last):
        return False
    if takeover.when == "height" and takeover.up_m is not None:
        return ownship.position_enu_m[2] >= takeover.up_m
    return takeover.when != "holding" or _is_holding(state, operator, current, ownship)


def _is_holding(state: FlightState, operator: Operator, current: MissionCurrent, ownship: Ownship) -> bool:
    """Return whether the aircraft circles where the operator lets it hold."""
    if current.sequence >= len(operator.items):
        return False
    item = operator.items[current.sequence]
    circle = circle_of(state, item, ownship.position_enu_m[2])
    if circle is None:
        return False
    (east, north, _), radius = circle
    away = math.hypot(ownship.position_enu_m[0] - east, ownship.position_enu_m[1] - north)
    return away <= CIRCLE_RADII * abs(radius)


def described(state: FlightState) -> str:
    """Return the time of the takeover in a few words."""
    takeover, operator = state.mission.takeover, state.mission_list.operator
    if operator is None:
        return "not known: no list"
    last = last_item_of(state)
    behind = "in the air" if last is None else f"after item {last + 1 - operator.first}"
    if takeover.when == "height":
        return f"{behind}, above {takeover.up_m:g} m"
    return f"{behind}, in the circle" if takeover.when == "holding" else behind

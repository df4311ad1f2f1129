"""Places of items, and the circles that loiter items command.

References
----------
MAVLink ``common.xml``: MAV_CMD_NAV_LOITER_*, and the parameters that hold a radius.
"""

from __future__ import annotations

import math

from companion.flight.construction.mission_simulation import stored_ground
from companion.flight.state.flight_state import FlightState
from companion.mission.operator import FIRST_WITHOUT_PLACE, TERRAIN_FRAMES, position_of
from companion.types.mission import Command, MissionItem

RADIUS_PARAMETER: dict[int, int] = {  # The number, from 0, of the parameter that is a loiter's radius.
    Command.NAV_LOITER_UNLIM: 2,
    Command.NAV_LOITER_TURNS: 2,
    Command.NAV_LOITER_TIME: 2,
    Command.NAV_LOITER_TO_ALT: 1,
}


def place_of(state: FlightState, item: MissionItem) -> tuple[float, float, float] | None:
    """Return east, north, up of an item [m]; None if it has no position or its height is not known.

    Parameters
    ----------
    state : FlightState
        Mission file, home, and the ground for items over terrain.
    item : MissionItem
        An item of the autopilot's list.
    """
    ground = stored_ground(state) if item.frame in TERRAIN_FRAMES else None
    return position_of(item, state.mission.frame, state.mission_list.home_amsl_m, ground)


def circle_of(
    state: FlightState, item: MissionItem, up_m: float
) -> tuple[tuple[float, float, float], float] | None:
    """Return centre [m] and signed radius [m], positive clockwise, of a loiter item; None for any other.

    Parameters
    ----------
    state : FlightState
        Mission file, with the smallest radius for an item without a radius.
    item : MissionItem
        An item of the operator's list.
    up_m : float
        Height for an item of unknown height [m].
    """
    number = RADIUS_PARAMETER.get(item.command)
    if number is None:
        return None
    place = place_of(state, item)
    if place is None:
        return None
    radius = item.parameters[number] or float(state.rules.vehicle.turn_radius_min_m)
    return (place[0], place[1], place[2] if math.isfinite(place[2]) else up_m), radius


def end_circle(state: FlightState, up_m: float) -> tuple[tuple[float, float, float], float] | None:
    """Return centre and radius, positive clockwise [m], of the circle in which the flown mission ends.

    The result is None if no mission of the service is flown, or if it does not end in a circle.

    Parameters
    ----------
    state : FlightState
        The flown path and its list.
    up_m : float
        Height for a circle of unknown height [m].
    """
    flown, layout = state.flown, state.mission_list.layout
    if flown is None or layout is None:
        return None
    return circle_of(state, (layout.flown or flown.mission.items)[-1], up_m)


def landing_circle(state: FlightState) -> tuple[tuple[float, float, float], float] | None:
    """Return centre and radius, positive clockwise [m], of the circle with which the landing begins.

    The result is None if it begins otherwise, or if there is no landing.

    Parameters
    ----------
    state : FlightState
        The operator's items.
    """
    operator, tail = state.mission_list.operator, state.tail_enu_m
    if operator is None or tail is None:
        return None
    items = operator.items[operator.tail :]
    first = next((item for item in items if item.command < FIRST_WITHOUT_PLACE), None)
    if first is None or first.command != Command.NAV_LOITER_TO_ALT:
        return None
    return circle_of(state, first, tail[2])

"""The places where an ArduPlane's return path may end, and whether the service keeps one."""

from __future__ import annotations

from collections.abc import Iterator

from companion.flight.construction.cycle import rally_points_near
from companion.flight.construction.way_on import landing_region
from companion.flight.prediction.return_path import start_of_return
from companion.flight.state.flight_state import FlightState
from companion.mission.list_layout import TwoBankLayout
from companion.planning.problem import GoalRegion
from companion.types.mission import Command


def is_return_wanted(state: FlightState) -> bool:
    """Return whether a return path is to be kept: an ArduPlane would join it, and no other one.

    Parameters
    ----------
    state : FlightState
        Mode, the autopilot's parameters and list, and the mission file.
    """
    listed, operator = state.mission_list, state.mission_list.operator
    start = start_of_return(state)
    if not (state.may_act and start is not None and state.mission.authority.keep_return_path):
        return False
    if listed.pending is not None or listed.is_mixed:
        return False
    if operator is None or not isinstance(listed.layout, TwoBankLayout) or state.flown is None:
        return False
    # Of landings the autopilot flies to the closest, whoever's it is.
    return start is Command.DO_LAND_START or all(item.command != start for item in operator.items)


def return_places(
    state: FlightState, from_enu_m: tuple[float, float, float]
) -> Iterator[tuple[GoalRegion, bool]]:
    """Yield where a return may end, the preferred place first, and whether it is the operator's landing.

    Parameters
    ----------
    state : FlightState
        The operator's landing, home and rally points.
    from_enu_m : tuple of float
        Where the return begins [m].
    """
    operator = state.mission_list.operator
    if operator is not None and operator.has_landing and state.tail_enu_m is not None:
        yield landing_region(state, state.tail_enu_m), True
    if state.home_enu_m is not None:
        east, north, up = state.home_enu_m
        height = state.settings.return_height_m
        above = from_enu_m[2] if height is None or height < 0.0 else up + height
        low, high = state.rules.checker.limits.bounds[4:6]
        yield state.region_at((east, north, min(max(above, low), high))), False
    for place in rally_points_near(state, from_enu_m):
        yield place, False

"""Return paths: whether one is kept, where it may end, and how its rest becomes the flown path."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.flight.construction.cycle import rally_points_near
from companion.flight.construction.way_on import landing_region
from companion.flight.prediction.return_mission import ReturnMission
from companion.flight.prediction.return_path import start_of_return
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.flight.state.goals_state import after_return_begun
from companion.flight.state.list_state import FlownPath
from companion.mission.list_layout import TwoBankLayout
from companion.mission.return_bank import RETURN_ITEMS
from companion.planning.problem import GoalRegion
from companion.types.events import MissionCurrent
from companion.types.mission import Command, Mission
from companion.types.state import Ownship


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
    if state.is_returning:  # The autopilot may still fly the one that it has.
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


def may_renew(state: FlightState) -> bool:
    """Return whether the service may plan the rest of a return that follows its return path.

    The goals of a member of a team that shares them go to the others, and not to its return.

    Parameters
    ----------
    state : FlightState
        The mission file, and the autopilot's list.
    """
    is_known = state.mission_list.layout is not None
    return is_known and state.mission.authority.renew_return and not state.mission.shares_goals


def begin_return(
    flight: StateOwner, ownship: Ownship, stored: ReturnMission, current: MissionCurrent
) -> None:
    """Let the service plan the rest of a return that follows the stored return path.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    ownship : Ownship
        The aircraft now.
    stored : ReturnMission
        The return path, which is in the list.
    current : MissionCurrent
        The item of it that is flown.
    """
    flown = _flown_return(flight.state, ownship, stored, current)
    flight.apply(after_return_begun, stored.place, flown, is_landing=stored.is_landing)


def _flown_return(
    state: FlightState, ownship: Ownship, stored: ReturnMission, current: MissionCurrent
) -> FlownPath | None:
    """Return the return path as the flown path; None if the rest of it does not pass the check of a plan.

    A return path may turn sooner behind the flown part than a plan would.
    """
    first = 0 if state.mission_list.layout is None else state.mission_list.layout.return_span[0]
    entry = current.sequence - (current.sequence - first) % RETURN_ITEMS
    mission = Mission(state.mission_list.stored, entry, 0)
    away = np.linalg.norm(stored.path.positions_enu_m - ownship.position_enu_m, axis=1)
    row = min(int(away.argmin()), len(stored.path) - 2)
    if state.violations_to(stored.place, stored.path.since(row)):
        return None
    return FlownPath(stored.path, mission, float(stored.path.times_s[-1]), row)

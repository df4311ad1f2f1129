"""A circle out of another member's way, for an aircraft that has nothing left to fly.

An aircraft at its last goal circles there for ever. Another member whose goal lies behind such circles could
then never pass. It requests the path that it would fly, and whoever circles in its way goes elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from companion.flight.state.flight_state import GOAL_RADIUS_M, FlightState
from companion.flight.state.list_state import MissionPosition
from companion.flight.state.modes import Mode
from companion.flight.state.team_part import settings_of
from companion.frames import FloatArray
from companion.mission.team.agreement import Agreement
from companion.mission.team.separation import PackedPlans, margin_of
from companion.mission.team.shared_plan import SharedPlan
from companion.planning.problem import GoalRegion
from companion.types.events import MissionCurrent, Motion
from companion.types.path import Path

STEP_M, FARTHEST_M = 60.0, 1_500.0  # Circles are tried in rings so far apart, up to the last.
BEARINGS = 24  # Circles of one ring.


def may_move_aside(
    state: FlightState, agreement: Agreement, current: MissionCurrent | None, utc_s: float
) -> bool:
    """Return whether the aircraft circles at its last goal, and no pilot has taken over.

    Parameters
    ----------
    state : FlightState
        Goals, mode and list.
    agreement : Agreement
        The member's part in the agreement.
    current : MissionCurrent or None
        The mission item being flown.
    utc_s : float
        UTC time [s].
    """
    has_nothing_left = state.mode in (Mode.ARRIVED, Mode.ACTIVE) and not state.goals_left
    is_in_list = state.motion is Motion.MISSION and state.tail_enu_m is None
    is_at_end = state.mission_list.position(current) is MissionPosition.OURS
    plan = agreement.committed
    is_circling = plan is not None and plan.circles_at(utc_s)
    return has_nothing_left and is_in_list and is_at_end and is_circling and not state.is_returning


def circle_aside(
    state: FlightState, agreement: Agreement, requests: Sequence[SharedPlan], utc_s: float
) -> GoalRegion | None:
    """Return the nearest place whose circle is clear of everything, and of what others request.

    Parameters
    ----------
    state : FlightState
        Obstacles, fences and bounds.
    agreement : Agreement
        The plans of the others, and the circle that is flown.
    requests : sequence of SharedPlan
        What others would fly.
    utc_s : float
        UTC time [s].

    Returns
    -------
    GoalRegion or None
        The place; None if there is none within ``FARTHEST_M``.
    """
    flown, config = agreement.committed, state.mission.team
    assert flown is not None  # It circles.
    assert config is not None  # There is an agreement.
    plans = PackedPlans((*agreement.plans_to_clear(), *requests), settings_of(config))
    wide_m = flown.radius_m + GOAL_RADIUS_M  # A mission may end anywhere in the goal's region.
    for centre in _centres(flown.rows[-1, 1:]):
        circle = SharedPlan(
            0, 0, np.array([[utc_s, *centre]]), wide_m, flown.tolerance_m, flown.tolerance_up_m
        )
        if plans.first_conflict(circle, utc_s) is None and _is_clear(state, centre, (flown.radius_m, wide_m)):
            east, north, up = (float(value) for value in centre)
            return state.region_at((east, north, up))
    return None


def wanted_plan(state: FlightState, path: Path, utc_s: float) -> SharedPlan:
    """Return a path to the goal as a plan that is requested, and begins at a UTC time [s].

    Parameters
    ----------
    state : FlightState
        The state of a team's member.
    path : Path
        The path, to the place where the aircraft would circle.
    utc_s : float
        UTC time [s].
    """
    config = state.mission.team
    assert config is not None  # There is an agreement.
    times = utc_s + path.times_s - path.times_s[0]
    rows = np.column_stack([times, path.positions_enu_m])
    return SharedPlan(0, 0, rows, float(state.turn_radius_m), config.tolerance_m, config.tolerance_up_m)


def circles_of(agreement: Agreement, utc_s: float) -> tuple[SharedPlan, ...]:
    """Return the plans of the members that circle at their ends, at a UTC time [s]."""
    there, plans = agreement.members_as_announced(utc_s), agreement.plans_to_clear()
    return tuple(plan for plan in plans if plan.member in there and plan.circles_at(utc_s))


def members_barring(
    state: FlightState, path: Path, circles: Sequence[SharedPlan], utc_s: float
) -> frozenset[int]:
    """Return the members whose circles are in the way of a path.

    Parameters
    ----------
    state : FlightState
        The state of a team's member.
    path : Path
        A path to the goal that is flown from now on.
    circles : sequence of SharedPlan
        The plans of members that circle.
    utc_s : float
        UTC time [s].
    """
    config = state.mission.team
    if config is None or not circles:
        return frozenset()
    wanted, margin = wanted_plan(state, path, utc_s), margin_of(settings_of(config))
    return frozenset(circle.member for circle in circles if margin(wanted, circle, utc_s) < 0.0)


def _is_clear(state: FlightState, centre: FloatArray, radii_m: Sequence[float]) -> bool:
    """Return whether circles about ``centre`` (3,) [m] keep clear of obstacles and within the bounds."""
    checker = state.rules.checker
    return not any(any(checker.circle_violations(centre, radius_m, 0)) for radius_m in radii_m)


def _centres(about: FloatArray) -> Iterator[FloatArray]:
    """Yield places (3,) round ``about`` (3,), the nearest first [m]."""
    bearings = np.linspace(0.0, 2.0 * math.pi, BEARINGS, endpoint=False)
    for away_m in np.arange(STEP_M, FARTHEST_M + STEP_M, STEP_M):
        for bearing in bearings:
            yield about + away_m * np.array([math.sin(bearing), math.cos(bearing), 0.0])

"""A circle out of another member's way, for an aircraft whose mission leads nowhere from its circle.

An aircraft at its last goal circles there for ever, and so does one whose way on is barred. Another member
whose goal lies behind such circles could then never pass. It requests the path that it would fly, and whoever
circles in its way goes elsewhere. Of two that bar each other, the one that is asked first goes. If it cannot,
it stays, requests its own path, and the other one goes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from companion.flight.construction.way_behind import goes_on_behind, may_go_on, with_way_behind
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import GOAL_RADIUS_M, FlightState, StateOwner, after_goal_dropped
from companion.flight.state.goals_state import after_goal_added
from companion.flight.state.list_state import MissionPosition
from companion.flight.state.modes import Mode
from companion.flight.state.team_part import settings_of
from companion.frames import FloatArray
from companion.mission.team.agreement import Agreement
from companion.mission.team.separation import PackedPlans, margin_of
from companion.mission.team.shared_plan import SharedPlan
from companion.types.events import MissionCurrent, Motion
from companion.types.path import Path

STEP_M, FARTHEST_M = 60.0, 1_500.0  # Circles are tried in rings this far apart, up to the second distance.
BEARINGS = 24  # Circles of one ring.
ASIDE_S = 30.0  # Ten plans are made in this time; one of them has to lead to the other circle.


class CircleAside:
    """Answers requests to fly a circle elsewhere.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    link : VehicleLink
        Knows the mission item being flown.
    announcer : Announcer
        Informs the pilot.
    """

    def __init__(self, flight: StateOwner, link: VehicleLink, announcer: Announcer) -> None:
        self._flight, self._link, self._announcer = flight, link, announcer
        self._asked = frozenset[tuple[int, int]]()  # Member and number of the requests that are known.
        self._until_s = 0.0  # Until then a mission has to lead to the circle elsewhere.
        self._stays_in: SharedPlan | None = None  # From this plan's circle no mission led to another one.

    def look(self, agreement: Agreement, utc_s: float) -> bool:
        """Answer new requests; return whether this member flies to another place from now on.

        Each request is answered once. If the aircraft circles for good and cannot be moved, its pilot is
        told. If no mission leads to the circle elsewhere, it is given up, and not tried again from the same
        circle.

        Parameters
        ----------
        agreement : Agreement
            The member's part in the agreement.
        utc_s : float
            UTC time [s].
        """
        state = self._flight.state
        if state.next_own is not None and state.goals_left:
            return self._give_up(agreement, utc_s)
        requests = agreement.requests(utc_s)
        asked = frozenset((plan.member, plan.number) for plan in requests)
        if asked <= self._asked or _leaves_by_itself(state, agreement, self._link.autopilot.current, utc_s):
            return False
        self._asked = asked
        who, place = listed(plan.member for plan in requests), None
        may_move = may_move_aside(state, agreement, self._link.autopilot.current, utc_s)
        if may_move and agreement.committed is not self._stays_in:
            place = circle_aside(state, agreement, requests, utc_s)
        if place is None:
            self._decide("in the way", f"in the way of system {who}, and does not move by itself", who)
            return False
        self._until_s = utc_s + ASIDE_S
        self._flight.apply(after_goal_added, state.region_at(place))
        self._decide("moves aside", f"moving out of the way of system {who}", who)
        return True

    def _give_up(self, agreement: Agreement, utc_s: float) -> bool:
        """Go on with the own goals if no mission leads to the circle elsewhere; return whether it is so."""
        state = self._flight.state
        is_late = utc_s >= self._until_s and not state.flies_to_goal
        if not is_late or state.is_returning or state.num_reached == len(state.own_goals):
            return False
        self._stays_in = agreement.committed
        self._flight.apply(after_goal_dropped)
        who = listed(member for member, _ in self._asked)
        self._decide("in the way", f"in the way of system {who}: no mission leads to another circle", who)
        return True

    def _decide(self, tell: str, text: str, who: str) -> None:
        """Record a decision, and tell the pilot who asked."""
        self._announcer.decide(DecisionKind.TEAM, text, tell=tell, about=who, member=who)


def _leaves_by_itself(
    state: FlightState, agreement: Agreement, current: MissionCurrent | None, utc_s: float
) -> bool:
    """Return whether the aircraft flies a mission that leads to a goal, or the operator's items behind it."""
    if state.goals_left:
        is_on_way = _leads_on(state) or not _is_circling(agreement, utc_s)
        return state.may_act and state.flies_to_goal and is_on_way
    is_behind = state.mission_list.position(current) is MissionPosition.PAST_GOAL
    return is_behind and state.motion is Motion.MISSION


def _leads_on(state: FlightState) -> bool:
    """Return whether the flown mission leads to the last goal, or on behind it, and not into a circle."""
    flown = state.flown
    if not state.goals_left:
        return goes_on_behind(state)
    return flown is not None and state.flies_to_goal and math.isinf(flown.covered_s(flown.row))


def _is_circling(agreement: Agreement, utc_s: float) -> bool:
    """Return whether a member is in the circle at the end of its committed plan."""
    return agreement.committed is not None and agreement.committed.circles_at(utc_s)


def may_move_aside(
    state: FlightState, agreement: Agreement, current: MissionCurrent | None, utc_s: float
) -> bool:
    """Return whether the aircraft circles for good, as far as it knows, and no pilot has taken over.

    It circles at its last goal, or its flown mission does not lead to one.

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
    is_planned = state.mode in (Mode.ARRIVED, Mode.ACTIVE)
    is_in_list = state.motion is Motion.MISSION
    is_at_end = state.mission_list.position(current) is MissionPosition.OURS
    is_settled = is_planned and not _leads_on(state) and not state.is_returning
    return is_settled and is_in_list and is_at_end and _is_circling(agreement, utc_s)


def circle_aside(
    state: FlightState, agreement: Agreement, requests: Sequence[SharedPlan], utc_s: float
) -> tuple[float, float, float] | None:
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
    tuple of float, or None
        East, north, up of the place [m]; None if there is none within ``FARTHEST_M``.
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
            return east, north, up
    return None


def wanted_plan(state: FlightState, path: Path, utc_s: float) -> SharedPlan:
    """Return a path to the goal as a plan that is requested, and begins at a UTC time [s].

    Parameters
    ----------
    state : FlightState
        The state of a team's member.
    path : Path
        The path, to the place where the aircraft would circle or fly on with the operator's items.
    utc_s : float
        UTC time [s].
    """
    config = state.mission.team
    assert config is not None  # There is an agreement.
    times = utc_s + path.times_s - path.times_s[0]
    rows, radius_m = np.column_stack([times, path.positions_enu_m]), float(state.turn_radius_m)
    if may_go_on(state, path.positions_enu_m[-1]):
        rows, radius_m = with_way_behind(state, path, rows)
    return SharedPlan(0, 0, rows, radius_m, config.tolerance_m, config.tolerance_up_m)


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


def listed(members: Iterable[int]) -> str:
    """Return the system ids of members for a text."""
    return ", ".join(str(member) for member in sorted(members))


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

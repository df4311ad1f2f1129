"""A member of a team as an aircraft that passes and keeps its route."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import lru_cache

import numpy as np

from companion.frames import FloatArray
from companion.kernels.threat.near_aircraft import MARGIN_M, MARGIN_UP_M
from companion.mission.team.shared_plan import SharedPlan
from companion.types.threat import TrackState, places_on_route

IDENTITY = "system:"  # What a vehicle's own position reports are tracked under, with its system id.
STOPS_S = 1.0  # A member of a team is in its circle from this time after the end of its path at the latest.


def member_named(identity: str, members: Collection[int]) -> int | None:
    """Return the system id of the member that is tracked under an identity; None if it is no member's."""
    number = identity.removeprefix(IDENTITY)
    is_system = number != identity and number.isdecimal()
    return int(number) if is_system and int(number) in members else None


def members_among(
    tracks: Iterable[TrackState], members: Collection[int]
) -> tuple[dict[int, TrackState], list[TrackState]]:
    """Return the tracks of members by system id, and all others.

    Parameters
    ----------
    tracks : iterable of TrackState
        All vehicles as they were sighted.
    members : collection of int
        System ids of the members.
    """
    found: dict[int, TrackState] = {}
    others = []
    for track in tracks:
        member = member_named(track.identity, members)
        if member is None:
            others.append(track)
        else:
            found[member] = track
    return found, others


def may_come_into(area: FloatArray, plan: SharedPlan, reach_m: float, up_m: float) -> bool:
    """Return whether a member ever endangers an aircraft that is in an area.

    Parameters
    ----------
    area : ndarray, shape (3, 2)
        Least and largest east, north and up [m].
    plan : SharedPlan
        The plan of the member.
    reach_m, up_m : float
        Horizontal and vertical distance to be kept [m].
    """
    level_m = reach_m + float(plan.discs_m.max()) + MARGIN_M
    margins = np.array([level_m, level_m, up_m + MARGIN_UP_M])
    low, high = plan.rows[:, 1:].min(axis=0) - margins, plan.rows[:, 1:].max(axis=0) + margins
    return bool((low <= area[:, 1]).all() and (high >= area[:, 0]).all())


class PlansNear:
    """The plans that may come near to an aircraft in an area; they are looked for when something changes."""

    def __init__(self) -> None:
        self._key: object = None
        self._found: list[SharedPlan] = []

    def of(
        self,
        plans: tuple[SharedPlan, ...],
        area: tuple[tuple[float, float], ...],
        reach_m: float,
        up_m: float,
    ) -> list[SharedPlan]:
        """Return the plans for which :func:`may_come_into` holds, of an area as rows of it [m]."""
        key = (plans, area, reach_m, up_m)
        if self._key != key:
            self._found = [plan for plan in plans if may_come_into(np.array(area), plan, reach_m, up_m)]
            self._key = key
        return self._found


def track_of_plan(plan: SharedPlan, now_s: float, ahead_s: float, reach_m: float, up_m: float) -> TrackState:
    """Return a member that flies its plan as an aircraft that passes.

    Parameters
    ----------
    plan : SharedPlan
        The plan.
    now_s, ahead_s : float
        The clock's reading, and UTC less that [s].
    reach_m, up_m : float
        Horizontal and vertical distance to be kept [m].
    """
    end_s = max(float(plan.rows[-1, 0]) - ahead_s, now_s)
    route = _route_of(plan, ahead_s) if end_s > now_s else _stay(plan.rows[-1, 1:], now_s)
    place, then = places_on_route(route, now_s + np.array([0.0, STOPS_S]))
    velocity = (then - place) / STOPS_S
    return TrackState(
        stamp_s=now_s,
        identity=f"{IDENTITY}{plan.member}",
        position_enu_m=(float(place[0]), float(place[1]), float(place[2])),
        velocity_enu_m_s=(float(velocity[0]), float(velocity[1]), float(velocity[2])),
        covariance=np.zeros((4, 4)),
        speed_max_m_s=float(np.hypot(velocity[0], velocity[1])),
        max_threat_radius_m=reach_m,
        turn_radius_m=reach_m,
        is_airborne=True,
        observed_s=now_s,
        flies_on=True,
        clear_up_m=up_m,
        height_std_m=0.0,
        route=route,
        keeps_route=True,
        circle_m=plan.radius_m,
        circles_from_s=end_s - STOPS_S,
    )


@lru_cache(maxsize=512)
def _route_of(plan: SharedPlan, ahead_s: float) -> FloatArray:
    """Return the route (M, 4) of a plan by the clock: time [s] and place [m], up to its circle's centre."""
    rows = plan.rows - np.array([ahead_s, 0.0, 0.0, 0.0])
    stays = _stay(rows[-1, 1:], float(rows[-1, 0]))[1:]
    if len(rows) > 1 and rows[-2, 0] == rows[-1, 0]:
        rows = rows[:-1]  # It enters its circle there.
    both = np.vstack([rows, stays])
    route: FloatArray = both[np.append(True, np.diff(both[:, 0]) > 0.0)]
    return route


def _stay(place: FloatArray, since_s: float) -> FloatArray:
    """Return the route (3, 4) of a member in its circle about a ``place`` (3,) [m]."""
    return np.array([[since_s + STOPS_S * number, *place] for number in range(3)])

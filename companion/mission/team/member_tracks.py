"""A member of a team as an aircraft that passes and keeps its route."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np

from companion.frames import FloatArray
from companion.kernels.threat.near_aircraft import MARGIN_M, MARGIN_UP_M
from companion.mission.team.shared_plan import SharedPlan
from companion.types.threat import TrackState, places_on_route

IDENTITY = "system:"  # What a vehicle's own position reports are tracked under, with its system id.
STOPS_S = 1.0  # A member of a team is in its circle from this time after the end of its path at the latest.


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
        number = track.identity.removeprefix(IDENTITY)
        if number != track.identity and number.isdecimal() and int(number) in members:
            found[int(number)] = track
        else:
            others.append(track)
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
    rows = plan.rows.copy()
    rows[:, 0] -= ahead_s
    centre, end_s = rows[-1, 1:], max(float(rows[-1, 0]), now_s)
    if end_s > rows[-1, 0]:
        rows = np.array([[now_s, *centre]])
    elif len(rows) > 1 and rows[-2, 0] == end_s:
        rows = rows[:-1]  # It enters its circle there.
    route = np.array([*rows, (end_s + STOPS_S, *centre), (end_s + 2.0 * STOPS_S, *centre)])
    route = route[np.append(True, np.diff(route[:, 0]) > 0.0)]
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

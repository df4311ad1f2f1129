"""What a team's member tells the others: the plan of a mission, or what it flies without one.

Before its first plan, in a return, in a landing, and while a pilot flies, the flight mode says where the
aircraft flies next. That is announced.
"""

from __future__ import annotations

import math

import numpy as np

from companion.config.sections.team_section import TeamConfig
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.construction.way_behind import with_way_behind
from companion.flight.prediction.mode_tracks import mode_tracks
from companion.flight.prediction.obstacle_ahead import is_clear
from companion.flight.prediction.return_path import STEP_S, return_altitude_m
from companion.flight.state.decision import Verdict
from companion.flight.state.flight_state import FlightState
from companion.frames import FloatArray
from companion.mission.team.agreement import Agreement
from companion.mission.team.member_tracks import STOPS_S
from companion.mission.team.shared_plan import SharedPlan, circled, entering_circle
from companion.types.events import MissionCurrent
from companion.types.state import Ownship

# What a pilot steers is announced 30 s ahead, what an autopilot flies by itself 120 s: one that circles has
# come round by then. Each is announced again after half of that.
STEERED_S, KNOWN_S = 30.0, 120.0
OFF_S = 2.0  # An aircraft that is off its plan for this time flies something else.
STANDS_M_S = 3.0  # An aircraft that is slower than this stands on the ground.
WAITS_S = 15.0  # Approval takes up to 7 s in a team of eight that loses every fifth message, a turn 8 s.


def announced_rows(state: FlightState, ownship: Ownship, current: MissionCurrent | None) -> FloatArray:
    """Return where the aircraft flies next in its present flight mode.

    Parameters
    ----------
    state : FlightState
        Flight mode, target, the autopilot's parameters and list.
    ownship : Ownship
        The aircraft now.
    current : MissionCurrent or None
        The mission item being flown.

    Returns
    -------
    ndarray, shape (N, 4)
        Time by the service's clock [s], east, north, up [m]. It is a single row for an aircraft that stands.
    """
    here = np.array([[ownship.stamp_s, *ownship.position_enu_m]])
    if ownship.ground_speed_m_s < STANDS_M_S:
        return here
    tracks = mode_tracks(state, ownship, current, KNOWN_S)
    # Of a pilot's tracks the last one is straight.
    ahead_s = STEERED_S if tracks.is_steered else KNOWN_S
    track = tracks.positions_enu_m[-1][: round(ahead_s / STEP_S) + 1]
    times = ownship.stamp_s + STEP_S * np.arange(1, len(track))
    return np.vstack([here, np.column_stack([times, track[1:]])])


def proposed_plan(
    state: FlightState,
    constructed: ConstructedMission,
    ownship: Ownship,
    current: MissionCurrent | None,
    ahead_s: float,
) -> SharedPlan:
    """Return what is flown from now on: the flown path up to the start, the mission, and its circle.

    If the operator's items follow the goal, the plan ends where the way on over them does. The agreement
    fills in the plan's member and number.

    Parameters
    ----------
    state : FlightState
        The flown path; of a team's member.
    constructed : ConstructedMission
        The mission that is to be entered.
    ownship : Ownship
        The aircraft now.
    current : MissionCurrent or None
        The mission item being flown.
    ahead_s : float
        UTC less the service's clock [s].
    """
    config, now_s, flown = state.mission.team, ownship.stamp_s, state.flown
    assert config is not None  # There is an agreement.
    start_s, path = constructed.start.state.stamp_s, constructed.path
    if flown is None:
        before = announced_rows(state, ownship, current)
    else:
        before = np.column_stack([flown.path.times_s, flown.path.positions_enu_m])
    is_before = (before[:, 0] > now_s) & (before[:, 0] < start_s - STOPS_S)
    parts = [np.array([[now_s, *ownship.position_enu_m]]), before[is_before]]
    is_carried = (path.times_s > now_s) & (path.times_s <= constructed.covered_until_s)
    parts.append(np.column_stack([path.times_s, path.positions_enu_m])[is_carried])
    rows, radius_m = np.vstack(parts), 0.0
    if constructed.waypoints.continues_with_operator_items:
        rows, radius_m = with_way_behind(state, path, rows)
    else:
        centre, signed_m = constructed.waypoints.circle
        radius_m = abs(signed_m) or float(state.turn_radius_m)
        away_m = max(math.dist(rows[-1, 1:3], centre[:2]) - radius_m, 0.0)
        entered_s = rows[-1, 0] + away_m / max(ownship.airspeed_m_s, 1.0)
        rows = entering_circle(np.vstack([rows, [entered_s, *centre]]), radius_m)
    rows[:, 0] += ahead_s
    return SharedPlan(
        0, 0, rows, radius_m, config.tolerance_m, config.tolerance_up_m,
        is_emergency=constructed.verdict is Verdict.EMERGENCY,
    )  # fmt: skip


def can_wait(state: FlightState, ownship: Ownship, current: MissionCurrent | None) -> bool:
    """Return whether what is flown keeps clear of obstacles and fences until others have approved a plan.

    Parameters
    ----------
    state : FlightState
        Flight mode, target, the autopilot's parameters and list, obstacles and fences.
    ownship : Ownship
        The aircraft now.
    current : MissionCurrent or None
        The mission item being flown.
    """
    tracks = mode_tracks(state, ownship, current, WAITS_S)
    clear = [is_clear(state, track) for track in tracks.positions_enu_m]
    return any(clear) if tracks.is_steered else all(clear)


def returns_near(
    state: FlightState, ownship: Ownship, agreement: Agreement, config: TeamConfig
) -> frozenset[int]:
    """Let the member send the altitude of its return; return the others that return at nearly the same one.

    Nobody approves a return, so that only its altitude keeps two apart that return at once.

    Parameters
    ----------
    state : FlightState
        Home, rally points, and the autopilot's parameters.
    ownship : Ownship
        The aircraft now.
    agreement : Agreement
        The member's part in the agreement.
    config : TeamConfig
        The distances.
    """
    own_m = agreement.return_altitude_m = return_altitude_m(state, ownship)
    if own_m is None:
        return frozenset()
    others = agreement.return_altitudes_m.items()
    return frozenset(other for other, up_m in others if abs(up_m - own_m) < config.paths_apart_up_m)


class AnnouncedPlan:
    """Announces what is flown while that is not the committed plan."""

    def __init__(self) -> None:
        self._off_since_s: float | None = None

    def is_due(self, agreement: Agreement, ownship: Ownship, utc_s: float) -> bool:
        """Return whether what is flown has to be announced now.

        While a proposal waits for approval, the committed plan is left as it is.

        Parameters
        ----------
        agreement : Agreement
            The member's part in the agreement.
        ownship : Ownship
            The aircraft now.
        utc_s : float
            UTC time [s].
        """
        plan = agreement.committed
        if agreement.proposed is not None:
            return False
        if plan is None:
            return True
        if plan.is_flown_at(ownship.position_enu_m, utc_s):
            self._off_since_s = None
            left_s = 0.5 * min(plan.end_s - plan.start_s, KNOWN_S)
            ends_soon = not plan.radius_m and utc_s > plan.end_s - left_s
            return ends_soon and ownship.ground_speed_m_s >= STANDS_M_S
        if self._off_since_s is None:
            self._off_since_s = utc_s
        return utc_s >= self._off_since_s + OFF_S

    def plan(self, rows: FloatArray, config: TeamConfig, ahead_s: float) -> SharedPlan:
        """Return a plan of what is flown; unless that is a circle, its end is not known.

        Parameters
        ----------
        rows : ndarray, shape (N, 4)
            Time by the service's clock [s], east, north, up [m].
        config : TeamConfig
            The tolerances.
        ahead_s : float
            UTC less the service's clock [s].
        """
        self._off_since_s = None
        rows, radius_m = circled(rows + np.array([ahead_s, 0.0, 0.0, 0.0]))
        return SharedPlan(0, 0, rows, radius_m, config.tolerance_m, config.tolerance_up_m)

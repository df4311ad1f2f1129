"""Predicted tracks in flight modes that the service did not choose.

The autopilot reports the position that it flies to (POSITION_TARGET_GLOBAL_INT): home or a rally point in a
return, the centre of a circle in LOITER, GUIDED or PX4's Hold. It flies there and round it. A PX4 that
returns first climbs in a circle, so its return is predicted from its parameters. In all other modes a pilot
steers: the aircraft then keeps its bank, or flies straight on.

References
----------
ArduPlane 4.7 ``GCS_MAVLINK_Plane::send_position_target_global_int`` (``next_WP_loc``); PX4 1.17
``MavlinkStreamPositionTargetGlobalInt`` (the current position of the triplet).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.flight.prediction.return_path import STEP_S, circling_tracks, return_tracks
from companion.flight.state.flight_state import FlightState
from companion.flight.state.list_state import MissionPosition
from companion.flight.takeover.start_prediction import list_track
from companion.frames import FloatArray, wrapped_angle
from companion.tracking.ownship import GRAVITY_M_S2, predicted
from companion.types.events import MissionCurrent, Motion
from companion.types.state import Ownship

AHEAD_S = 20.0  # The aircraft's motion is predicted for this time.


@dataclass(frozen=True, slots=True)
class ModeTracks:
    """The tracks that an aircraft may fly next.

    Parameters
    ----------
    positions_enu_m : tuple of ndarray, shape (K, 3)
        Positions on each track, ``STEP_S`` apart in time [m]; the first row is the aircraft's.
    is_steered : bool
        Whether a pilot chooses between the tracks; otherwise small differences decide.
    """

    positions_enu_m: tuple[FloatArray, ...]
    is_steered: bool


def state_on(track: FloatArray, row: int, ownship: Ownship) -> Ownship:
    """Return the aircraft at a row of a track.

    Parameters
    ----------
    track : ndarray, shape (K, 3)
        Positions, ``STEP_S`` apart in time [m].
    row : int
        Row, between 1 and the last but one; a row outside is moved there.
    ownship : Ownship
        The aircraft at the first row, for all that the positions do not show. It is returned if the track
        has fewer than three rows.
    """
    if len(track) < 3:
        return ownship
    row = min(max(row, 1), len(track) - 2)
    before, after = (track[row] - track[row - 1]) / STEP_S, (track[row + 1] - track[row]) / STEP_S
    course = math.atan2(before[0] + after[0], before[1] + after[1])
    turned = wrapped_angle(math.atan2(after[0], after[1]) - math.atan2(before[0], before[1]))
    speed = 0.5 * (math.hypot(before[0], before[1]) + math.hypot(after[0], after[1]))
    east, north, up = (float(value) for value in track[row])
    return replace(
        ownship,
        stamp_s=ownship.stamp_s + row * STEP_S,
        position_enu_m=(east, north, up),
        course_rad=course % (2.0 * math.pi),
        ground_speed_m_s=speed,
        flight_path_angle_rad=math.atan2(0.5 * float(before[2] + after[2]), max(speed, 1.0)),
        bank_rad=math.atan(speed * turned / STEP_S / GRAVITY_M_S2),
    )


def mode_tracks(
    state: FlightState, ownship: Ownship, current: MissionCurrent | None, ahead_s: float = AHEAD_S
) -> ModeTracks:
    """Return what the aircraft flies next in its present flight mode.

    Parameters
    ----------
    state : FlightState
        Flight mode, target, the autopilot's parameters and list.
    ownship : Ownship
        The aircraft now.
    current : MissionCurrent or None
        The mission item being flown.
    ahead_s : float
        Duration of the tracks [s].
    """
    rows = round(ahead_s / STEP_S) + 1
    by_autopilot = _tracks_by_autopilot(state, ownship, current)
    if by_autopilot:
        return ModeTracks(tuple(track[:rows] for track in by_autopilot), is_steered=False)
    straight = replace(ownship, bank_rad=0.0)
    times = STEP_S * np.arange(rows)
    return ModeTracks(
        tuple(
            np.array([predicted(begin, float(time)).position_enu_m for time in times])
            for begin in (ownship, straight)
        ),
        is_steered=True,
    )


def _tracks_by_autopilot(
    state: FlightState, ownship: Ownship, current: MissionCurrent | None
) -> list[FloatArray]:
    """Return positions (K, 3) on the tracks of an autopilot that flies by itself [m]; none if not known."""
    target, motion = state.target_enu_m, state.motion
    if motion is Motion.MISSION:
        if current is None:
            return []
        is_returning = state.mission_list.position(current) is MissionPosition.RETURNING
        track = list_track(state, current, ownship, is_direct=is_returning)
        return [] if track is None else [track.positions_enu_m]
    if motion is Motion.RETURN and (target is None or not state.flies_by):
        known = return_tracks(state, ownship, current)
        if known is not None:
            return known
    if target is None or motion is Motion.STEERED:
        return []
    radius = state.settings.return_radius_m or 0.0 if motion is Motion.RETURN else 0.0
    return circling_tracks(state, ownship, target, radius)

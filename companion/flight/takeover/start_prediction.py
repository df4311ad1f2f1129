"""Predict the aircraft on what the autopilot flies: the operator's legs, circles and climbs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.flight.construction.loiter_circles import circle_of, place_of
from companion.flight.construction.mission_simulation import guidance_of, stored_ground
from companion.flight.state.flight_state import FlightState
from companion.flight.state.progress import Start, as_of_now, lead_s, start_after, start_at
from companion.flight.takeover.takeover import TAKEOFFS, last_item_of, takeoff_of
from companion.frames import FloatArray
from companion.mission.operator import FIRST_WITHOUT_PLACE, TERRAIN_FRAMES, altitude_amsl_of
from companion.types.events import MissionCurrent
from companion.types.mission import Command, MissionItem
from companion.types.state import Ownship
from companion.world.snapshot import Snapshot
from companion.world.vehicle.guidance import Guidance, Track, track_of_circle, track_of_legs

TAKEOVER_MARGIN_S = 1.0  # Time from the takeover to the entry, in addition to the exchange.
PREDICTED_MAX_S = 120.0  # At most this much flight is predicted; a plan for later is made later.
CLIMB_MIN_M_S = 2.0  # The assumed climb rate of an aircraft that has not begun to climb.
STEP_S = 0.5  # Time between two rows of a simulated track.
# After these items the list does not continue with the next one, or leaves the air.
LIST_ENDINGS = frozenset(
    {Command.DO_JUMP, Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH, Command.DO_LAND_START}
)
TAKEOFF_MAX_M = 5_000.0  # A take-off leads straight ahead by at most this distance.


def begin(
    state: FlightState, ownship: Ownship, current: MissionCurrent | None, *, is_urgent: bool = False
) -> Start:
    """Return where a plan made now takes effect: on the flown path, or on what the autopilot flies."""
    ahead_s = lead_s(state, is_urgent=is_urgent)
    start = start_after(state, ownship, ahead_s)
    if start.rest is not None or current is None or not state.may_act:
        return start
    track = list_track(state, current, ownship)
    return start if track is None else start_on(state, ownship, track, ahead_s)


def begin_now(
    state: FlightState,
    ownship: Ownship,
    current: MissionCurrent | None,
    snapshot: Snapshot,
    *,
    is_urgent: bool = False,
) -> Start:
    """Return the same as :func:`begin`, with the rest of the flown path reassessed in a snapshot's world."""
    return as_of_now(state, begin(state, ownship, current, is_urgent=is_urgent), snapshot)


def start_at_takeover(state: FlightState, current: MissionCurrent, ownship: Ownship) -> Start | None:
    """Return the start of a plan that is flown from the takeover on; None while that is far ahead.

    Parameters
    ----------
    state : FlightState
        Mission file and list.
    current : MissionCurrent
        The item being flown.
    ownship : Ownship
        The aircraft now.
    """
    track = list_track(state, current, ownship)
    if track is None:
        return None
    row = _takeover_row(state, current, track)
    if row is None:
        return None
    exchange_s = state.mission_list.exchange_s + TAKEOVER_MARGIN_S
    soonest_s = lead_s(state)
    ahead_s = max(float(track.times_s[row]) + exchange_s, soonest_s)
    return start_on(state, ownship, track, ahead_s)


def start_on(state: FlightState, ownship: Ownship, track: Track, ahead_s: float) -> Start:
    """Return the start of a plan on a predicted track, ``ahead_s`` from now [s]."""
    row = min(int(np.searchsorted(track.times_s, ahead_s)), len(track) - 1)
    east, north, up = (float(value) for value in track.positions_enu_m[row])
    return start_at(
        state.rules,
        ownship,
        ownship.stamp_s + float(track.times_s[row]),
        (east, north, up),
        course_rad=float(track.courses_rad[row]),
        climb_rad=float(track.climb_angles_rad[row]),
        airspeed_m_s=ownship.airspeed_m_s,
    )


def list_track(
    state: FlightState, current: MissionCurrent, ownship: Ownship, *, is_direct: bool = False
) -> Track | None:
    """Return the predicted track of the autopilot along its list; None if it is not known.

    The track ends at the first circle without an end, or at the first item after which the list does not
    state what follows.

    Parameters
    ----------
    state : FlightState
        Mission file and list.
    current : MissionCurrent
        The item being flown, or to be resumed.
    ownship : Ownship
        The aircraft now.
    is_direct : bool
        Whether that item is flown to directly from here, not along the leg that leads to it.
    """
    legs, circle = _legs_ahead(state, current, ownship)
    guidance = _guidance_to(state, current)
    climb_m_s = ownship.climb_m_s
    if climb_m_s > guidance.climb_rate_max_m_s:  # In a take-off the aircraft climbs faster than in missions.
        guidance = replace(guidance, climb_rate_max_m_s=climb_m_s)
    if circle is not None and not legs:
        return track_of_circle(guidance, ownship, circle[0], circle[1], PREDICTED_MAX_S, STEP_S)
    if not legs:
        return None
    before = None if is_direct else _place_before(state, current)
    return track_of_legs(
        guidance, ownship, np.array(legs), before_enu_m=before, loiter=circle, ends_s=PREDICTED_MAX_S,
        step_s=STEP_S,
    )  # fmt: skip


def _guidance_to(state: FlightState, current: MissionCurrent) -> Guidance:
    """Return the guidance; over ground if the current item is."""
    item = next((item for item in state.mission_list.stored if item.sequence == current.sequence), None)
    ground = stored_ground(state) if item is not None and item.frame in TERRAIN_FRAMES else None
    usual = guidance_of(state)
    return usual if ground is None else replace(usual, ground=ground.followed)


def _legs_ahead(
    state: FlightState, current: MissionCurrent, ownship: Ownship
) -> tuple[list[FloatArray], tuple[FloatArray, float] | None]:
    """Return positions (3,) that are flown to from the current item on, and the final circle [m]."""
    listed, legs = state.mission_list, list[FloatArray]()
    takeoff = None if listed.operator is None else takeoff_of(listed.operator)
    for item in listed.stored[current.sequence :]:
        circle = circle_of(state, item, ownship.position_enu_m[2])
        if circle is not None:
            return legs, (np.asarray(circle[0]), circle[1])
        if takeoff is not None and item.sequence <= takeoff:
            legs.append(_takeoff_end(state, ownship, item))
            continue
        place = place_of(state, item)
        if item.command in LIST_ENDINGS:
            break
        if place is not None:
            legs.append(np.asarray(place))
    return legs, None


def _place_before(state: FlightState, current: MissionCurrent) -> FloatArray | None:
    """Return where the leg to the current item begins, shape (3,) [m]; None if it is flown to from here."""
    listed = state.mission_list
    first = 0 if listed.operator is None else listed.operator.first
    for item in reversed(listed.stored[first : current.sequence]):
        place = place_of(state, item)
        if place is not None:
            return None if item.command in TAKEOFFS else np.asarray(place)
    return None


def _takeoff_end(state: FlightState, ownship: Ownship, item: MissionItem) -> FloatArray:
    """Return where a climb straight ahead reaches a take-off's height, shape (3,) [m]."""
    east, north, up = ownship.position_enu_m
    altitude = altitude_amsl_of(item, state.mission_list.home_amsl_m)
    height_m = up if altitude is None else altitude - float(state.mission.origin.altitude_amsl_m)
    climb_m_s = max(ownship.climb_m_s, CLIMB_MIN_M_S)
    away = ownship.ground_speed_m_s * max(height_m - up, 0.0) / climb_m_s
    away = min(away, TAKEOFF_MAX_M)
    return np.array(
        [
            east + away * math.sin(ownship.course_rad),
            north + away * math.cos(ownship.course_rad),
            height_m,
        ]
    )


def _takeover_row(state: FlightState, current: MissionCurrent, track: Track) -> int | None:
    """Return the row of a predicted track from which the service may fly; None if it is after its end."""
    takeover, operator, last = state.mission.takeover, state.mission_list.operator, last_item_of(state)
    row = 0
    if operator is not None and last is not None and current.sequence <= last:
        placed = sum(
            item.sequence <= last and item.command < FIRST_WITHOUT_PLACE
            for item in operator.items[current.sequence : operator.tail]
        )
        behind = np.flatnonzero(track.reached >= placed)
        if not len(behind):
            return None
        row = int(behind[0])
    if takeover.when == "height" and takeover.up_m is not None:
        above = np.flatnonzero(track.positions_enu_m[row:, 2] >= takeover.up_m)
        return row + int(above[0]) if len(above) else None
    return row

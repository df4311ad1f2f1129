"""The energy of the way home, from here and from places ahead, and the time at which to turn back.

The way home is the track that the autopilot flies in a return to launch, up to and including one round of the
circle at its end, at cruise in the present wind. That cruise counts as true airspeed for the time and as
reported airspeed for the power: a return may be flown at either, and so the larger cost is taken. The energy
left at a place ahead is that of now less that of the flown path up to there. Both are multiplied by how many
times as fast as modelled the battery falls.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.config.compose import power_model_of
from companion.flight.prediction.return_path import return_tracks, tracks_by_return_path
from companion.flight.state.flight_state import SEARCH_ROWS, FlightState
from companion.frames import FloatArray, equivalent_airspeed, speed_made_good
from companion.mission.energy_budget import JOULES_PER_WH
from companion.mission.path_progress import progress_on, time_at
from companion.types.events import MissionCurrent
from companion.types.mission import MissionItem
from companion.types.path import Path
from companion.types.state import Ownship
from companion.world.vehicle.energy import PowerModel

# Where the autopilot's way home is not known, it is assumed to cost this many times the straight one.
STRAIGHT_FACTOR = 1.3
PLACES_S = 10.0  # The way home is computed from places of the flown path that are this far apart in time.
CIRCLE_TOLERANCE = 0.25  # The rows of a circle are at its radius to within this share.
JOINED_SHARE = 1.15  # The circle at the end is joined within this share of its radius.


@dataclass(frozen=True, slots=True)
class EnergyNow:
    """The known state of the battery or tank.

    Parameters
    ----------
    left_wh : float
        Energy left [Wh].
    ratio : float
        How many times as fast as modelled it falls, at least 1.
    """

    left_wh: float
    ratio: float = 1.0


@dataclass(frozen=True, slots=True)
class EnergyOutlook:
    """The energy of the way home, and what is left for it.

    Parameters
    ----------
    home_wh : float
        Energy of the way home from here [Wh].
    margin_wh : float
        What is left beyond the way home and the reserve [Wh]; negative if that is missed.
    turn_back_in_s : float
        When the aircraft must turn back at the latest if it flies on along its path, from now on [s];
        infinite if home can still be reached from the path's end, or nothing is flown.
    at_end_wh, at_home_wh : float or None
        Energy left at the end of the flown path, and at home after the way home from there [Wh]; None if
        nothing is flown.
    """

    home_wh: float
    margin_wh: float
    turn_back_in_s: float = math.inf
    at_end_wh: float | None = None
    at_home_wh: float | None = None


def energy_outlook(
    state: FlightState, ownship: Ownship, current: MissionCurrent | None, now: EnergyNow
) -> EnergyOutlook | None:
    """Return the outlook along the flown path; None without a section ``energy``, or if home is not known.

    Parameters
    ----------
    state : FlightState
        The flown path, home, and the autopilot's parameters.
    ownship : Ownship
        The aircraft now.
    current : MissionCurrent or None
        The mission item being flown.
    now : EnergyNow
        What is left, and how fast it falls.
    """
    model, energy = power_model_of(state.mission), state.mission.energy
    here_j = None if model is None else way_home_j(state, ownship, model, current)
    if model is None or energy is None or here_j is None:
        return None
    per_j, reserve_wh = now.ratio / JOULES_PER_WH, float(energy.reserve_wh)
    home_wh = per_j * here_j
    margin_wh = now.left_wh - home_wh - reserve_wh
    if state.flown is None:
        return EnergyOutlook(home_wh, margin_wh)
    path, begin_s = state.flown.path, _time_on_path(state, ownship)
    steps_j = model.step_energies_j(_as_commanded(state, path))
    used_j = np.concatenate([[0.0], np.cumsum(steps_j)])
    used_j -= np.interp(begin_s, path.times_s, used_j)
    at_end_wh = now.left_wh - per_j * float(used_j[-1])
    after_end_j = _way_after_end_j(state, _aircraft_at(path, math.inf, ownship), model, current) or 0.0
    at_home_wh = at_end_wh - per_j * after_end_j
    if at_home_wh >= reserve_wh:
        return EnergyOutlook(home_wh, margin_wh, math.inf, at_end_wh, at_home_wh)
    after_s, margins_wh = [0.0], [margin_wh]
    ends_s = max(float(path.times_s[-1]) - begin_s, 0.0)
    while margins_wh[-1] > 0.0 and after_s[-1] < ends_s:
        at_s = min(after_s[-1] + PLACES_S, ends_s)
        ahead_j = way_home_j(state, _aircraft_at(path, begin_s + at_s, ownship), model, current) or 0.0
        left_wh = now.left_wh - per_j * float(np.interp(begin_s + at_s, path.times_s, used_j))
        after_s.append(at_s)
        margins_wh.append(left_wh - per_j * ahead_j - reserve_wh)
    return EnergyOutlook(home_wh, margin_wh, zero_of(after_s, margins_wh), at_end_wh, at_home_wh)


def energy_at_ends_wh(
    state: FlightState, ownship: Ownship, path: Path, current: MissionCurrent | None, now: EnergyNow
) -> tuple[float, float] | None:
    """Return what is left at the end of a planned path, and at home after the way home from there [Wh].

    Up to the path's start, which lies ahead, the aircraft flies as now.

    Parameters
    ----------
    state, ownship, current, now
        Same as in :func:`energy_outlook`, which also says when the result is None.
    path : Path
        A path from a place ahead of the aircraft to the last goal.
    """
    model = power_model_of(state.mission)
    if model is None:
        return None
    begin_s = max(float(path.times_s[0]) - ownship.stamp_s, 0.0)
    until_begin_j = model.power_w(reported_airspeed_m_s(state, ownship)) * begin_s
    after_j = _way_after_end_j(state, _aircraft_at(path, math.inf, ownship), model, current)
    if after_j is None:
        return None
    per_j = now.ratio / JOULES_PER_WH
    at_end_wh = now.left_wh - per_j * (until_begin_j + model.energy_j(_as_commanded(state, path)))
    return at_end_wh, at_end_wh - per_j * after_j


def zero_of(times_s: Sequence[float], margins_wh: Sequence[float]) -> float:
    """Return when a margin becomes zero, linear between its values [s]; infinite if it never does.

    Parameters
    ----------
    times_s : sequence of float
        Increasing times [s].
    margins_wh : sequence of float
        Margin at each time [Wh].
    """
    before: tuple[float, float] | None = None
    for at_s, margin in zip(times_s, margins_wh, strict=True):
        if margin <= 0.0:
            if before is None:
                return at_s
            return before[0] + (at_s - before[0]) * before[1] / (before[1] - margin)
        before = at_s, margin
    return math.inf


def way_home_j(
    state: FlightState, ownship: Ownship, model: PowerModel, current: MissionCurrent | None = None
) -> float | None:
    """Return the energy of the return to launch from here [J]; None if home is not known.

    Parameters
    ----------
    state : FlightState
        Home, the autopilot's parameters and its list.
    ownship : Ownship
        The aircraft at the start of the return, and the wind.
    model : PowerModel
        The aircraft's power.
    current : MissionCurrent, optional
        The mission item being flown.
    """
    vehicle, home = state.rules.vehicle, state.home_enu_m
    tracks = return_tracks(state, ownship, current)
    if tracks:
        return _return_j(state, ownship, model, tracks[0])
    if home is None:
        return None
    here, height = ownship.position_enu_m, state.settings.return_height_m
    up = here[2] if height is None or height < 0.0 else home[2] + height
    straight_j = model.leg_energy_j(here, (*home[:2], up), vehicle, ownship.wind_enu_m_s)
    return STRAIGHT_FACTOR * straight_j


def affords(
    state: FlightState, ownship: Ownship, items: Sequence[MissionItem], now: EnergyNow | None
) -> bool:
    """Return whether what is left suffices for a return by a list's return path, and the reserve.

    Parameters
    ----------
    state, ownship
        Same as in :func:`energy_outlook`.
    items : sequence of MissionItem
        The whole list.
    now : EnergyNow or None
        The energy left and its rate. If these are unknown, or there is no section ``energy`` or no return
        path, the result is True.
    """
    model, energy = power_model_of(state.mission), state.mission.energy
    tracks = tracks_by_return_path(state, ownship, items)
    if now is None or model is None or energy is None or not tracks:
        return True
    used_wh = now.ratio / JOULES_PER_WH * _return_j(state, ownship, model, tracks[0])
    return now.left_wh - used_wh >= float(energy.reserve_wh)


def _return_j(state: FlightState, ownship: Ownship, model: PowerModel, track: FloatArray) -> float:
    """Return the energy of a return's ``track``, (K, 3) [m], up to one round of the final circle [J]."""
    cruise_m_s = state.rules.vehicle.airspeed_cruise_m_s
    return track_energy_j(model, until_once_round(track), cruise_m_s, ownship.wind_enu_m_s)


def track_energy_j(
    model: PowerModel, positions_enu_m: FloatArray, airspeed_m_s: float, wind_enu_m_s: tuple[float, float]
) -> float:
    """Return the energy of a track that is flown at one airspeed [J].

    Parameters
    ----------
    model : PowerModel
        The aircraft's power.
    positions_enu_m : ndarray, shape (K, 3)
        East, north, up along the track [m].
    airspeed_m_s : float
        True airspeed [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    moves = np.diff(positions_enu_m, axis=0)
    moves = moves[np.hypot(moves[:, 0], moves[:, 1]) > 0.0]
    if len(moves) == 0:
        return 0.0
    level_m = np.hypot(moves[:, 0], moves[:, 1])
    courses, climbs = np.arctan2(moves[:, 0], moves[:, 1]), np.arctan2(moves[:, 2], level_m)
    speeds = [
        speed_made_good(course, airspeed_m_s * math.cos(climb), wind_enu_m_s)
        for course, climb in zip(courses, climbs, strict=True)
    ]
    num_rows = len(moves) + 1
    path = Path(
        times_s=np.concatenate([[0.0], np.cumsum(level_m / speeds)]),
        positions_enu_m=np.vstack([np.zeros(3), np.cumsum(moves, axis=0)]),
        courses_rad=np.append(courses, courses[-1]) % (2.0 * math.pi),
        climb_angles_rad=np.append(climbs, climbs[-1]),
        speeds_m_s=np.full(num_rows, airspeed_m_s),
        position_covariances_m2=np.zeros((num_rows, 3, 3)),
        collision_free=np.ones(num_rows),
        threat_levels=np.zeros(num_rows),
        wind_enu_m_s=wind_enu_m_s,
    )
    return model.energy_j(path)


def until_once_round(positions_enu_m: FloatArray) -> FloatArray:
    """Return a track up to one round of the circle at its end; the whole track if there is no such circle.

    Simulated returns last long enough for any wind, and so go round more often.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (K, 3)
        East, north, up along the track, equally far apart in time [m].

    Returns
    -------
    ndarray, shape (L, 3)
        Its first rows [m].
    """
    moves = np.diff(positions_enu_m[:, :2], axis=0)
    if len(moves) < 2:
        return positions_enu_m
    courses = np.unwrap(np.arctan2(moves[:, 0], moves[:, 1]))
    rounds = np.flatnonzero(np.abs(courses[-1] - courses) >= 2.0 * math.pi)
    if len(rounds) == 0:
        return positions_enu_m
    last = positions_enu_m[rounds[-1] :, :2]
    centre = 0.5 * (last.min(axis=0) + last.max(axis=0))
    radii = np.linalg.norm(last - centre, axis=1)
    radius = float(radii.mean())
    if float(np.abs(radii - radius).max()) > CIRCLE_TOLERANCE * radius:
        return positions_enu_m
    away = np.linalg.norm(positions_enu_m[:-1, :2] - centre, axis=1)
    joined = int(np.argmax(away <= JOINED_SHARE * radius))
    is_round = np.abs(courses[joined:] - courses[joined]) >= 2.0 * math.pi
    return positions_enu_m[: joined + int(np.argmax(is_round)) + 2] if is_round.any() else positions_enu_m


def reported_airspeed_m_s(state: FlightState, ownship: Ownship) -> float:
    """Return the airspeed that the autopilot reports, by which the model of power counts [m/s].

    Parameters
    ----------
    state : FlightState
        Has the frame.
    ownship : Ownship
        The aircraft, with its true airspeed.
    """
    altitude_m = state.mission.frame.altitude_amsl_m + ownship.position_enu_m[2]
    return equivalent_airspeed(ownship.airspeed_m_s, altitude_m)


def _as_commanded(state: FlightState, path: Path) -> Path:
    """Return a path with the airspeeds that are commanded and reported, by which the model of power counts.

    A path has true airspeeds. In thin air they are higher.
    """
    altitude_m = state.mission.frame.altitude_amsl_m + float(path.positions_enu_m[:, 2].mean())
    return replace(path, speeds_m_s=equivalent_airspeed(1.0, altitude_m) * path.speeds_m_s)


def _time_on_path(state: FlightState, ownship: Ownship) -> float:
    """Return the flown path's time at the point nearest to the aircraft [s]."""
    flown = state.flown
    assert flown is not None
    return time_at(flown.path, progress_on(flown.path, ownship.position_enu_m, flown.row, SEARCH_ROWS))


def _aircraft_at(path: Path, time_s: float, ownship: Ownship) -> Ownship:
    """Return the aircraft at a time of a path, in the present wind; after its last row, at its end."""
    time_s = min(time_s, float(path.times_s[-1]))
    row = min(int(np.searchsorted(path.times_s, time_s)), len(path) - 1)
    east, north, up = (
        float(np.interp(time_s, path.times_s, path.positions_enu_m[:, axis])) for axis in range(3)
    )
    course, climb = float(path.courses_rad[row]), float(path.climb_angles_rad[row])
    airspeed = float(path.speeds_m_s[row])
    return replace(
        ownship,
        position_enu_m=(east, north, up),
        course_rad=course,
        flight_path_angle_rad=climb,
        airspeed_m_s=airspeed,
        ground_speed_m_s=speed_made_good(course, airspeed * math.cos(climb), ownship.wind_enu_m_s),
        bank_rad=0.0,
    )


def _way_after_end_j(
    state: FlightState, aircraft: Ownship, model: PowerModel, current: MissionCurrent | None
) -> float | None:
    """Return the energy of the way after the last goal: to the operator's landing, else home [J].

    The result is None if home is not known.
    """
    operator, tail = state.mission_list.operator, state.tail_enu_m
    if operator is not None and operator.has_landing and tail is not None:
        return model.leg_energy_j(aircraft.position_enu_m, tail, state.rules.vehicle, aircraft.wind_enu_m_s)
    return way_home_j(state, aircraft, model, current)

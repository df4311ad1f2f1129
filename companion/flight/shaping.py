"""From a plan to what is handed over of it: waypoints that a mission carries, and a circle at their end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.decision import SwapDecision, Verdict, judge
from companion.flight.flight_state import FlightState
from companion.flight.progress import Start
from companion.frames import FloatArray, speed_made_good
from companion.mission.loiter import loiter_beside
from companion.mission.waypoints import (
    CHORD_STYLES,
    FLY_BY_STYLES,
    MissionPart,
    TurnStyle,
    Waypoints,
    density_ratio,
    merge_close_waypoints,
    mission_part,
    waypoints_from_path,
)
from companion.types.mission import MissionItem
from companion.types.path import Path, straight_path
from companion.types.plan import Plan
from companion.types.state import Ownship
from companion.vehicle.guidance import Guidance, default_guidance, track_of_circle, track_of_legs
from companion.vehicle.vehicle_model import VehicleModel

CARRIED_HORIZONS = 3.0  # of a path are uploaded at once
HOT_STRETCH = 1.12  # of a circle in air 30 K warmer than the standard's, as thin at the same pressure
BANK_MAX_DEG = 80.0  # whatever the parameter says
SAFER_ROWS = 6  # are tried for a circle that is under no threat
CIRCLE_PLACES = 13
SLOWEST_M_S = 3.0  # over the ground, of a circle in strong wind
STYLED_ROWS = 3  # at which other styles are tried where the usual one's mission breaks a rule
SHORTEST_ROWS = 12
GUSTS_M = 3.0  # beside its track an aircraft flies in turbulence
RUN_ON_M = (0.0, 100.0, 200.0, 300.0, 400.0)  # beyond the goal, where it has no room for a circle
RUN_ON_STEP_M = 25.0
CIRCLED_S = 15.0  # of the circle at the end are looked at
FASTER_M_S = 0.5  # than cruise: less is how a path settles
NEAR_M = 5.0  # of the goal's region a path to it ends
NO_ROOM = Violation("bank", 0, 0.0, 0.0, "no part of the path fits the bank")

Actions = tuple[MissionItem, ...]


@dataclass(frozen=True, slots=True)
class ShapedPath:
    """A path in the shape that a mission carries it in, and why it is to be flown.

    Parameters
    ----------
    path : Path
        What is to be flown.
    waypoints : Waypoints
        What the mission carries of it.
    part : MissionPart
        The waypoints as mission items.
    carried_until_s : float
        The path's time at their end [s].
    start : Start
        Where the plan began.
    verdict : Verdict
        Why it is to be flown.
    text : str
        The same in words.
    why : mapping
        The numbers that led to it.
    """

    path: Path
    waypoints: Waypoints
    part: MissionPart
    carried_until_s: float
    start: Start
    verdict: Verdict
    text: str
    why: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Conclusion:
    """What a plan comes to.

    Parameters
    ----------
    decision : SwapDecision
        What is said of it.
    shaped : ShapedPath or None
        What is to be handed over; None where nothing is.
    is_unflyable : bool
        Whether it would be flown, but no mission can carry it.
    """

    decision: SwapDecision
    shaped: ShapedPath | None = None
    is_unflyable: bool = False


def conclude(state: FlightState, plan: Plan, start: Start) -> Conclusion:
    """Judge a plan, and shape what is to be flown of it."""
    decision = judge(state, plan, start)
    if not decision.verdict.is_swap or plan.path is None:
        return Conclusion(decision)
    path = plan.path
    if decision.verdict is Verdict.EXTEND and decision.holds_flown and start.rest is not None:
        path = start.rest
    waypoints, carried_s, violations = waypoints_of(state, path, state.mission_list.max_waypoints)
    if violations:
        refused = SwapDecision(Verdict.REJECTED, f"mission: {violations[0]}", decision.why)
        return Conclusion(refused, is_unflyable=True)
    part = mission_part(waypoints, state.mission.frame, state.rules.vehicle.airspeed_cruise_m_s)
    shaped = ShapedPath(
        path, waypoints, part, carried_s, start, decision.verdict, decision.text, decision.why
    )
    return Conclusion(decision, shaped)


def guidance_of(state: FlightState) -> Guidance:
    """What the autopilot steers by, as far as its parameters were told."""
    usual = default_guidance(flies_by=state.flies_by, vehicle=state.rules.vehicle)
    told = state.settings
    bank = usual.bank_max_rad if not told.bank_max_deg else math.radians(min(told.bank_max_deg, BANK_MAX_DEG))
    return replace(
        usual,
        acceptance_radius_m=told.acceptance_radius_m or usual.acceptance_radius_m,
        l1_period_s=told.guidance_period_s or usual.l1_period_s,
        l1_damping=told.guidance_damping or usual.l1_damping,
        bank_max_rad=bank,
        loiter_radius_m=told.loiter_radius_m or usual.loiter_radius_m,
        climb_rate_max_m_s=min(told.climb_max_m_s or math.inf, usual.climb_rate_max_m_s),
        circle_stretch=_circle_stretch(state),
    )


def _circle_stretch(state: FlightState) -> float:
    """How much wider than commanded an ArduPlane circles in standard air, about the mission's height."""
    mission = state.mission
    altitude = float(mission.origin.altitude_amsl_m) + float(mission.start.up_m)
    return 1.0 / density_ratio(altitude) if state.flies_by else 1.0


def waypoints_of(
    state: FlightState, path: Path, max_waypoints: int, *, is_whole: bool = False
) -> tuple[Waypoints, float, tuple[Violation, ...]]:
    """Waypoints of the part of a path that a mission carries, and a loiter at its end.

    Beyond a few time horizons a path is a guess: threats there are still to be sensed. The mission
    carries no more than :data:`CARRIED_HORIZONS` of it where a clear circle can end it there, else
    the nearest row at which one can; should the service fall silent, the aircraft circles at a
    place that was checked.

    Parameters
    ----------
    state : FlightState
        Goals and rules.
    path : Path
        What is to be flown.
    max_waypoints : int
        Room in the autopilot's list.
    is_whole : bool
        Whether as much of it is wanted as there is room for.

    Returns
    -------
    Waypoints
        What to upload.
    float
        The path's time at their end [s].
    tuple of Violation
        What is wrong with them, if no part of the path can be carried.
    """
    wanted = math.inf if is_whole else CARRIED_HORIZONS * state.rules.time_horizon_s
    last = len(path) - 1
    row = min(last, int(np.searchsorted(path.times_s, path.times_s[0] + wanted)))
    first_wrong: tuple[Violation, ...] = ()
    exposed: list[tuple[Waypoints, float]] = []
    for end, waypoints, violations in _carried_to_rows(state, path, row):
        if violations or _num_items(waypoints) > max_waypoints:
            first_wrong = first_wrong or violations
            continue
        until_s = float(path.times_s[end])
        if end == last or len(exposed) == SAFER_ROWS or not is_circle_exposed(state, waypoints, until_s):
            return waypoints, until_s, ()
        exposed.append((waypoints, until_s))
    if exposed:
        return *exposed[0], ()
    return _carried_otherwise(state, path, max_waypoints, (waypoints, first_wrong or (NO_ROOM,)))


def _num_items(waypoints: Waypoints) -> int:
    """How much room waypoints take in the autopilot's list, and the operator's items among them."""
    return len(waypoints.positions_enu_m) + sum(len(items) for _, items in waypoints.actions)


def _carried_otherwise(
    state: FlightState, path: Path, max_waypoints: int, failed: tuple[Waypoints, tuple[Violation, ...]]
) -> tuple[Waypoints, float, tuple[Violation, ...]]:
    """The whole path where no row has room for the circle at the end of a part; if that fails, too, what did.

    At cruise where it was faster, since slower circles are narrower; and, where nothing of the operator's
    follows the goal, straight on beyond it, to where there is room.
    """
    vehicle, until_s = state.rules.vehicle, float(path.times_s[-1])
    airspeeds = sorted({commanded_airspeed_m_s(path, vehicle), vehicle.airspeed_cruise_m_s}, reverse=True)
    for metres in RUN_ON_M if state.tail_enu_m is None else RUN_ON_M[:1]:
        whole = _run_on(path, metres) if metres > 0.0 else path
        for style in _styles(state):
            for airspeed in airspeeds:
                waypoints, violations = _with_some_circle(state, whole, whole, style, airspeed)
                violations = violations or _blown_off(state, whole, waypoints)
                if not violations and _num_items(waypoints) <= max_waypoints:
                    return waypoints, until_s, ()
    return failed[0], until_s, failed[1]


def _run_on(path: Path, metres: float) -> Path:
    """The path and so much straight and level flight behind it."""
    course, airspeed = float(path.courses_rad[-1]), float(path.speeds_m_s[-1])
    made_good = speed_made_good(course, airspeed, path.wind_enu_m_s)
    ahead = straight_path(
        np.arange(1.0 + math.ceil(metres / RUN_ON_STEP_M)) * RUN_ON_STEP_M / made_good,
        float(path.times_s[-1]), path.positions_enu_m[-1], course, airspeed,
        covariance_m2=path.position_covariances_m2[-1], threat_level=float(path.threat_levels[-1]),
        wind_enu_m_s=path.wind_enu_m_s,
    )  # fmt: skip
    return path.followed_by(ahead)


def _carried_to_rows(
    state: FlightState, path: Path, row: int
) -> Iterator[tuple[int, Waypoints, tuple[Violation, ...]]]:
    """Rows at which a mission may end, the wanted one first, its waypoints, and what is wrong with them."""
    last = len(path) - 1
    tries = [row, *(row + k for k in range(2, last - row, 2)), last]
    tries += list(range(row - 2, min(row, SHORTEST_ROWS) - 1, -2))
    styled = 0
    for end in tries:
        usual = _carried_in_style(state, path, end, _styles(state)[0])
        if usual[1] and styled >= STYLED_ROWS:  # at most rows it is the circle that has no room
            continue
        styled += bool(usual[1])
        yield end, *_best_carried(state, path, end, usual)


def is_circle_exposed(state: FlightState, waypoints: Waypoints, arrival_s: float) -> bool:
    """Whether the first lap on the circle at the end of a mission is above the limit of the threat level.

    Parameters
    ----------
    state : FlightState
        Threats and rules.
    waypoints : Waypoints
        With the circle.
    arrival_s : float
        When it is come to, by the clock [s].
    """
    limit, centre = state.rules.checker.limits.threat_level_max, waypoints.loiter_centre_enu_m
    if centre is None or limit >= 1.0:
        return False
    speed, radius = float(state.rules.vehicle.airspeed_cruise_m_s), abs(waypoints.loiter_radius_m)
    angles = np.linspace(0.0, 2.0 * math.pi, CIRCLE_PLACES)
    ring = radius * np.column_stack([np.sin(angles), np.cos(angles), 0.0 * angles])
    lap = Path(
        times_s=arrival_s + angles * radius / speed,
        positions_enu_m=centre + ring,
        courses_rad=(angles + 0.5 * math.pi) % (2.0 * math.pi),
        climb_angles_rad=0.0 * angles,
        speeds_m_s=0.0 * angles + speed,
        position_covariances_m2=np.zeros((len(angles), 3, 3)),
        collision_free=np.ones(len(angles)),
        threat_levels=0.0 * angles,
    )
    return bool(state.rules.exposure.levels(lap, state.picture).max() > limit)


def carried(state: FlightState, path: Path, end: int) -> tuple[Waypoints, tuple[Violation, ...]]:
    """Waypoints of a path up to a row with the loiter beside it, and what is wrong with them.

    Those are taken whose track, as the autopilot will fly it, keeps its distance; where none does, those
    that keep most.
    """
    return _best_carried(state, path, end, _carried_in_style(state, path, end, _styles(state)[0]))


def _styles(state: FlightState) -> tuple[TurnStyle, ...]:
    """How waypoints may lie in turns, the usual style first."""
    return FLY_BY_STYLES if state.flies_by else CHORD_STYLES


def _best_carried(
    state: FlightState, path: Path, end: int, usual: tuple[Waypoints, tuple[Violation, ...]]
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """As :func:`carried`, beginning with what the usual style comes to."""
    clearance = float(state.mission.planning.clearance_min_m) + GUSTS_M
    best, found = usual, _room_flown(state, path, usual, clearance)
    for style in _styles(state)[1:]:
        if found >= clearance:
            break
        other = _carried_in_style(state, path, end, style)
        room = -math.inf if other[1] else _room_flown(state, path, other, clearance)
        if room > found:
            best, found = other, room
    return best


def _room_flown(
    state: FlightState, path: Path, shaped: tuple[Waypoints, tuple[Violation, ...]], clearance_m: float
) -> float:
    """How near the flown track comes to anything [m], ``clearance_m`` at most; negative for no mission."""
    waypoints, violations = shaped
    if violations:
        return -1.0
    begin = at_row(path, state.wind_enu_m_s)
    loiter = waypoints.loiter_centre_enu_m
    circle = None if loiter is None else (loiter, waypoints.loiter_radius_m)
    ends_s = float(waypoints.distances_m[-1]) / begin.ground_speed_m_s + CIRCLED_S
    track = track_of_legs(
        guidance_of(state), begin, waypoints.positions_enu_m, loiter=circle, ends_s=ends_s, step_s=0.5
    )
    wrong = state.rules.checker.check_track(track.positions_enu_m, clearance_m)
    return min((entry.value for entry in wrong if entry.rule == "clearance"), default=clearance_m)


def at_row(path: Path, wind_enu_m_s: tuple[float, float], row: int = 0) -> Ownship:
    """The aircraft at a row of a path, by default where it begins, not banked.

    Parameters
    ----------
    path : Path
        What is to be flown.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    row : int
        Which row.
    """
    course, airspeed = float(path.courses_rad[row]), max(float(path.speeds_m_s[row]), 1.0)
    east, north, up = (float(value) for value in path.positions_enu_m[row])
    return Ownship(
        stamp_s=float(path.times_s[row]),
        position_enu_m=(east, north, up),
        course_rad=course,
        flight_path_angle_rad=float(path.climb_angles_rad[row]),
        airspeed_m_s=airspeed,
        ground_speed_m_s=speed_made_good(course, airspeed, wind_enu_m_s),
        wind_enu_m_s=wind_enu_m_s,
    )


def _carried_in_style(
    state: FlightState, path: Path, end: int, style: TurnStyle
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """As :func:`carried`, with turns in one style.

    A part that is flown faster than at cruise ends in a wider circle.
    """
    part = path.until(end)
    return _with_some_circle(state, path, part, style, commanded_airspeed_m_s(part, state.rules.vehicle))


def _with_some_circle(
    state: FlightState, path: Path, part: Path, style: TurnStyle, airspeed_m_s: float
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """As :func:`_with_circle`, at a commanded airspeed.

    In the wind the circle at the end is as wide as is easily flown there, or, where that has no room, as
    wide as in still air if its track in the wind has. Faster than at cruise the track into any is looked at.
    """
    vehicle = state.rules.vehicle.at_speed(_airspeed_at_end(part, state.rules.vehicle, airspeed_m_s))
    radius, narrow = vehicle.turn_radius_in(math.hypot(*state.wind_enu_m_s)), vehicle.turn_radius_min_m
    usual = _with_circle(state, path, part, style, radius, airspeed_m_s)
    if not usual[1] and vehicle.airspeed_cruise_m_s > state.rules.vehicle.airspeed_cruise_m_s:
        usual = usual[0], _blown_off(state, part, usual[0])
    if not usual[1] or radius <= narrow:
        return usual
    waypoints, violations = _with_circle(state, path, part, style, narrow, airspeed_m_s)
    return waypoints, violations or _blown_off(state, part, waypoints)


def _airspeed_at_end(part: Path, vehicle: VehicleModel, commanded_m_s: float) -> float:
    """What is left at the end of a part of the speed that it begins with, where less is commanded [m/s]."""
    slowed = float(part.speeds_m_s[0]) ** 2 - 2.0 * vehicle.acceleration_max_m_s2 * part.length_m
    return max(commanded_m_s, math.sqrt(max(slowed, 0.0)))


def _blown_off(state: FlightState, part: Path, waypoints: Waypoints) -> tuple[Violation, ...]:
    """What the circle at the end comes to in the wind, as the autopilot will fly it."""
    if waypoints.loiter_centre_enu_m is None:
        return ()
    begin = at_row(part, state.wind_enu_m_s, len(part) - 1)
    slowest = max(begin.airspeed_m_s - math.hypot(*state.wind_enu_m_s), SLOWEST_M_S)
    around_s = 2.0 * math.pi * abs(waypoints.loiter_radius_m) / slowest
    track = track_of_circle(
        guidance_of(state), begin, waypoints.loiter_centre_enu_m, waypoints.loiter_radius_m, around_s, 0.5
    )
    return state.rules.checker.check_track(track.positions_enu_m, state.rules.checker.limits.margin_m)


def commanded_airspeed_m_s(path: Path, vehicle: VehicleModel) -> float:
    """Cruise, or what a path comes to that is flown faster, before moving threats."""
    fastest, cruise = float(path.speeds_m_s[-1]), vehicle.airspeed_cruise_m_s
    return fastest if fastest > cruise + FASTER_M_S else cruise


def _with_circle(
    state: FlightState, path: Path, part: Path, style: TurnStyle, radius: float, airspeed_m_s: float
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """Waypoints of a part of a path, a circle of a radius at their end, and what is wrong with them."""
    rules = state.rules
    actions = _actions_along(state, part)
    flown = waypoints_from_path(
        part,
        airspeed_m_s,
        flies_by=state.flies_by,
        marked_m=[length for length, _ in actions],
        style=style,
    )
    commanded = round(radius / _circle_stretch(state))
    if state.flies_by:  # wider in hot air, in which the circle is to keep clear, too
        radius *= HOT_STRETCH
    centre, direction = loiter_beside(
        flown.positions_enu_m, float(part.courses_rad[-1]), radius, rules.obstacles,
        rules.checker.limits.bounds,
    )  # fmt: skip

    def wrong_with(waypoints: Waypoints) -> tuple[Violation, ...]:
        legs: FloatArray = np.vstack([part.positions_enu_m[:1], waypoints.positions_enu_m])
        return rules.checker.check_legs(
            legs,
            ends_in_loiter=True,
            loiter_radius_m=radius,
            loiter_centre_enu_m=centre,
            may_come_back=True,
            wind_enu_m_s=state.wind_enu_m_s,
            airspeed_m_s=float(part.speeds_m_s.min()),
        )

    flown, violations = merge_close_waypoints(flown, wrong_with)
    waypoints = replace(
        flown,
        loiter_centre_enu_m=centre,
        loiter_radius_m=direction * commanded,
        continues_with_operator_items=(
            len(part) == len(path) and _may_go_on(state, flown.positions_enu_m[-1])
        ),
        actions=_actions_at(actions, flown),
    )
    return waypoints, violations


def _may_go_on(state: FlightState, last_enu_m: FloatArray) -> bool:
    """Whether ``last_enu_m`` (3,) [m] is the goal, and the operator's items behind it can be flown to."""
    if state.tail_enu_m is None or not state.goals:
        return False
    goal = state.goals[-1]
    if np.linalg.norm(last_enu_m - np.asarray(goal.position_enu_m)) > goal.acceptance_radius_m + NEAR_M:
        return False  # a refuge: from there it is planned on
    legs: FloatArray = np.vstack([last_enu_m, state.tail_enu_m])
    wrong = state.rules.checker.check_legs(legs, ends_in_loiter=True, loiter_radius_m=state.turn_radius_m)
    return not any(entry.rule == "clearance" for entry in wrong)


def _actions_along(state: FlightState, part: Path) -> list[tuple[float, Actions]]:
    """The operator's DO_ items of goals that a part of a path reaches, and how far along they are [m]."""
    found: list[tuple[float, Actions]] = []
    row = 0
    for goal, items in zip(state.goals[state.next_goal :], state.actions[state.next_goal :], strict=False):
        away = np.linalg.norm(part.positions_enu_m[row:] - np.asarray(goal.position_enu_m), axis=1)
        if not away.min() <= goal.acceptance_radius_m:
            break
        row += int(np.argmin(away))
        steps = np.linalg.norm(np.diff(part.positions_enu_m[: row + 1, :2], axis=0), axis=1)
        if items:
            found.append((float(steps.sum()), items))
    return found


def _actions_at(
    actions: Sequence[tuple[float, Actions]], waypoints: Waypoints
) -> tuple[tuple[int, Actions], ...]:
    """What is to be done by the number of the waypoint that it is done at."""
    found: dict[int, Actions] = {}
    for length, items in actions:
        behind = np.flatnonzero(waypoints.distances_m >= length - 1.0)
        number = int(behind[0]) if len(behind) else len(waypoints.distances_m) - 1
        found[number] = found.get(number, ()) + items
    return tuple(sorted(found.items()))

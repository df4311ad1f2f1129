"""What to fly when no plan passes: the candidates of the emergency strategy, and the step they allow.

Synchronous and without a clock, like the cycle. The service carries the step out and announces it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.assurance.checker import Violation
from companion.assurance.emergency import (
    EmergencyDecision,
    EmergencyStep,
    Situation,
    emergency_decision,
    keeps_hard_constraints,
)
from companion.flight.cycle import Cycle, Start
from companion.frames import course_from_direction
from companion.mission.waypoints import Waypoints
from companion.planning.problem import StartState
from companion.types.path import Path
from companion.types.plan import Plan

AHEAD_ROWS = 24  # of straight flight, tried where no plan leads anywhere
ROWS_TO_LOITER = 4  # at least
ROWS_BETWEEN = 2  # places that are tried
ROW_S = 1.0


@dataclass(frozen=True, slots=True)
class EscapeRoute:
    """A path, its waypoints, and the path's time at their end [s]."""

    path: Path
    waypoints: Waypoints
    carried_until_s: float


@dataclass(frozen=True, slots=True)
class Response:
    """The step to take, why, and what is flown by it."""

    decision: EmergencyDecision
    way: EscapeRoute | None


def flown_violations(cycle: Cycle, start: Start) -> tuple[Violation, ...] | None:
    """What the rest of the flown path breaks; None where nothing of ours is flown.

    A refuge that was taken before is judged by itself: the way to it and the circle, not the goal.
    """
    if cycle.flown is None:
        return None
    if cycle.flies_to_goal:
        return None if start.rest is None else cycle.check(start.rest)
    _, violations = cycle.carried(cycle.flown.path, len(cycle.flown.path) - 1)
    return violations


def respond(
    cycle: Cycle,
    start: Start,
    least_threat: Plan,
    failed: Sequence[Path | None],
    room: int,
    *,
    may_return: bool,
) -> Response:
    """Choose the step, and what to fly by it.

    Parameters
    ----------
    cycle : Cycle
        Whose checker judges.
    start : Start
        From where a new mission would be flown.
    least_threat : Plan
        The plan that weighs threats most and has no limit to them.
    failed : sequence of Path or None
        Other paths, from other starts or refused, along which a refuge may lie.
    room : int
        Waypoints that a mission may have.
    may_return : bool
        Whether the mission file allows return to launch.
    """
    straight_on, by_threat = _least_threat(cycle, least_threat, room)
    refuge, by_loiter = _refuge(cycle, start, (least_threat.path, *failed), room)
    decision = emergency_decision(
        Situation(
            flown=flown_violations(cycle, start), least_threat=by_threat, loiter=by_loiter,
            may_return=may_return,
        )
    )  # fmt: skip
    ways = {EmergencyStep.LEAST_THREAT: straight_on, EmergencyStep.LOITER: refuge}
    return Response(decision, ways.get(decision.step))


def _least_threat(
    cycle: Cycle, plan: Plan, room: int
) -> tuple[EscapeRoute | None, tuple[Violation, ...] | None]:
    """The least-threat plan as a mission, and what is wrong with it; None where none reaches the goal."""
    if plan.path is None or not plan.reaches_goal:
        return None, None
    waypoints, carried_s, violations = cycle.waypoints(plan.path, room)
    return EscapeRoute(plan.path, waypoints, carried_s), (*cycle.check(plan.path), *violations)


def _refuge(
    cycle: Cycle, start: Start, paths: Sequence[Path | None], room: int
) -> tuple[EscapeRoute | None, tuple[Violation, ...] | None]:
    """The reachable place to circle with the least threat, and what is wrong with it.

    Places lie along paths that begin at the start, as far as these keep the hard constraints, and
    straight ahead. Without any that passes, the violations of the one tried first.
    """
    wrong: tuple[Violation, ...] | None = None
    for _, path, row in _places(cycle, start, paths):
        waypoints, violations = cycle.carried(path, row)
        if not violations and len(waypoints.positions_enu_m) <= room:
            return EscapeRoute(path.until(row), waypoints, float(path.times_s[row])), ()
        wrong = wrong or violations
    return None, wrong


def _places(cycle: Cycle, start: Start, paths: Sequence[Path | None]) -> list[tuple[float, Path, int]]:
    """Threat level, path and row of every place to try, the safest first."""
    begin = np.asarray(start.state.position_enu_m)
    places = []
    for path in (*paths, straight_ahead(start.state)):
        if (
            path is None
            or len(path) <= ROWS_TO_LOITER
            or np.linalg.norm(path.positions_enu_m[0] - begin) > 1.0
        ):
            continue
        hard = [entry.row for entry in cycle.checker.check_path(path) if not keeps_hard_constraints([entry])]
        last = min([len(path) - 1, *(row - 1 for row in hard)])
        rows = range(ROWS_TO_LOITER, last + 1, ROWS_BETWEEN)
        places += [(float(path.threat_levels[row]), path, row) for row in rows]
    return sorted(places, key=lambda place: (place[0], place[2]))


def straight_ahead(state: StartState) -> Path:
    """Level flight on from a start at its speed; nothing is known of threats along it."""
    rows = np.arange(AHEAD_ROWS + 1.0)
    along = np.array([np.cos(state.direction_rad), np.sin(state.direction_rad), 0.0])
    count = len(rows)
    return Path(
        times_s=np.asarray(state.stamp_s + ROW_S * rows, dtype=np.float64),
        positions_enu_m=np.asarray(state.position_enu_m)
        + ROW_S * state.airspeed_m_s * rows[:, None] * along[None, :],
        courses_rad=np.full(count, course_from_direction(state.direction_rad)),
        climb_angles_rad=np.zeros(count),
        speeds_m_s=np.full(count, state.airspeed_m_s),
        position_covariances_m2=np.repeat(state.error_covariance[None, :3, :3], count, axis=0),
        collision_free=np.ones(count),
        threat_levels=np.full(count, 1.0),  # not known: every place that is known comes first
    )

"""One planning cycle: predict, plan, check, judge, and make the mission. Nothing here waits.

Synchronous and without a clock, so that a replay decides the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.checker import Checker, Violation
from companion.config import MissionConfig
from companion.config.compose import check_limits_of, goals_of, planner_settings_of, vehicle_of
from companion.flight.decision import Judgement
from companion.frames import FloatArray, direction_from_course, wrapped_angle
from companion.mission.list_layout import Layout
from companion.mission.loiter import loiter_beside
from companion.mission.operator import OperatorGoal
from companion.mission.path_progress import distance_along, progress_on, rest_of_path, time_at, way_to
from companion.mission.waypoints import Waypoints, mended, waypoints_from_path
from companion.planning.problem import GoalRegion, Problem, StartState, initial_covariances
from companion.planning.settings import PlannerSettings
from companion.planning.solver import solve
from companion.tracking.ownship import predicted
from companion.types.mission import Mission, MissionItem
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.state import Ownship
from companion.types.threat import Obstacle, ThreatTree
from companion.world.snapshot import Snapshot

OFF_TRACK_MAX_M = 80.0
LAST_LEG_S = 10.0
CARRIED_HORIZONS = 3.0  # of a path are uploaded at once
EXTENDED_HORIZONS = 1.5  # carried ahead: with less left the mission is extended
SHORTEST_ROWS = 12
VIOLATIONS_TOLD = 5
WINDOW_ROWS = 20  # of the path ahead in which the aircraft is looked for
ENTRY_ROWS = 8  # of a new path in which the aircraft is looked for when it is entered
ENTRY_AHEAD_M = 30.0
FLY_BY_M = 50.0  # WP_RADIUS, at which ArduPlane turns to the next waypoint
ENTRY_RULES = frozenset({"clearance", "bounds"})
ALIGNED_RAD = math.radians(10.0)  # an entry flown to like this is flown to as the path does
WIDENED = 1.6  # of the smallest radius, in which an autopilot turns to a new point for certain
REPLAN_SHARE = 0.3
NARROWED = 0.6
LEAST_THREAT_WEIGHTS = (0.1, 0.1, 0.8)  # D_γ of (9) in an emergency
GOAL_RADIUS_M = 60.0  # of goals that the operator's waypoints are
NO_ROOM = Violation("bank", 0, 0.0, 0.0, "no part of the path fits the bank")


@dataclass(frozen=True, slots=True)
class Flown:
    """The path being flown, the mission that carries it, and the path's time at which that one ends."""

    path: Path
    mission: Mission
    carried_until_s: float
    row: int = 0


@dataclass(frozen=True, slots=True)
class Start:
    """Where a plan begins, and what is left of the flown path from there."""

    state: StartState
    rest: Path | None


class Cycle:
    """The decisions of one flight.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    seed : int
        Of the flight; each plan has its own, counted from it.
    """

    def __init__(self, mission: MissionConfig, seed: int) -> None:
        self._seed = seed
        self._fences: tuple[Obstacle, ...] = ()
        self._read(mission)
        self.goals = goals_of(mission)
        self.flown: Flown | None = None
        self.next_goal = 0
        self.num_plans = 0
        self.flies_by = True  # as ArduPlane does at its waypoints
        self.tail_enu_m: tuple[float, float, float] | None = None  # where the operator goes on after the goal
        self._actions: tuple[tuple[MissionItem, ...], ...] = ()

    def _read(self, mission: MissionConfig) -> None:
        """Take limits, settings and obstacles from a mission file."""
        self._mission = mission
        self.vehicle = vehicle_of(mission)
        self.settings = planner_settings_of(mission)
        # With a flown path to improve on, a search that finds nothing is not worth the whole budget.
        self._replan_settings = replace(
            self.settings, max_iterations=int(REPLAN_SHARE * self.settings.max_iterations)
        )
        self._obstacles = (*mission.obstacle_list, *self._fences)
        self.checker = Checker(self._obstacles, check_limits_of(mission))
        self._threat_trees: tuple[ThreatTree, ...] = ()  # they grew round other obstacles

    def adopt(self, mission: MissionConfig) -> None:
        """Go by another mission file from now on; a changed list of goals begins at its first."""
        self._read(mission)
        if not mission.goals_from_autopilot and goals_of(mission) != self.goals:
            self.goals, self.next_goal = goals_of(mission), 0

    @property
    def goals_left(self) -> tuple[GoalRegion, ...]:
        """Goals not reached yet.

        Those to fly on from are planned for more narrowly than they count as reached: a path that just
        touches one is flown a few metres beside it, and the aircraft would turn back.
        """
        left = self.goals[self.next_goal :]
        num_passed = len(left) if self.tail_enu_m is not None else len(left) - 1
        narrowed = [
            replace(goal, acceptance_radius_m=NARROWED * goal.acceptance_radius_m)
            for goal in left[: max(num_passed, 0)]
        ]
        return (*narrowed, *left[len(narrowed) :])

    def set_fences(self, fences: tuple[Obstacle, ...]) -> None:
        """Hold plans and missions to the autopilot's fences, besides the mission file's obstacles."""
        self._fences = fences
        self._read(self._mission)

    def set_goals(self, goals: Sequence[OperatorGoal]) -> None:
        """Take the operator's goals in place of the mission file's; in the plane at the mission's level."""
        level = float(self._mission.start.up_m)
        places = [
            (*goal.position_enu_m[:2], level) if self._mission.dimension == 2 else goal.position_enu_m
            for goal in goals
        ]
        self.goals = tuple(GoalRegion(place, GOAL_RADIUS_M) for place in places)
        self._actions = tuple(goal.actions for goal in goals)
        self.next_goal = 0

    def note_position(self, state: Ownship) -> bool:
        """Count goals passed, and the way along the flown path. Returns whether the last was reached."""
        while self.next_goal < len(self.goals):
            goal = self.goals[self.next_goal]
            away = np.linalg.norm(np.subtract(goal.position_enu_m, state.position_enu_m))
            if away > goal.acceptance_radius_m:
                break
            self.next_goal += 1
        if self.flown is not None:
            row = progress_on(self.flown.path, state.position_enu_m, self.flown.row, WINDOW_ROWS).row
            self.flown = replace(self.flown, row=row)
        return bool(self.goals) and self.next_goal == len(self.goals)

    def lead_s(self, exchange_s: float) -> float:
        """How long until a plan begun now is flown: planning, the exchange with the autopilot, margin."""
        planning = self._mission.planning
        return float(planning.planning_budget_s + planning.swap_margin_s) + exchange_s

    @property
    def flies_to_goal(self) -> bool:
        """Whether what is flown leads to the last goal, and not to a place to circle at meanwhile."""
        if self.flown is None or not self.goals:
            return False
        away = np.linalg.norm(self.flown.path.positions_enu_m[-1] - self.goals[-1].position_enu_m)
        return bool(away <= self.goals[-1].acceptance_radius_m + 1.0)

    def is_on_last_leg(self, state: Ownship, lead_s: float) -> bool:
        """Whether the flown path ends before a new one could be of use."""
        if self.flown is None or not self.flies_to_goal:
            return False
        if self.flown.carried_until_s < self.flown.path.times_s[-1]:
            return False
        progress = progress_on(self.flown.path, state.position_enu_m, self.flown.row, WINDOW_ROWS)
        left = float(self.flown.path.times_s[-1]) - time_at(self.flown.path, progress)
        return progress.off_track_m <= OFF_TRACK_MAX_M and left < lead_s + LAST_LEG_S

    def start_after(self, state: Ownship, lead_s: float) -> Start:
        """Where the aircraft will be in ``lead_s``: along the flown path, else by its own motion."""
        rest = self._rest_after(state, lead_s)
        if rest is not None:
            east, north, up = (float(value) for value in rest.positions_enu_m[0])
            begin = self._begin(
                state, float(rest.times_s[0]), (east, north, up), float(rest.courses_rad[0]),
                float(rest.climb_angles_rad[0]), float(rest.speeds_m_s[0]),
            )  # fmt: skip
            return Start(begin, rest)
        ahead = predicted(state, lead_s)
        begin = self._begin(
            state, state.stamp_s + lead_s, ahead.position_enu_m, ahead.course_rad,
            ahead.flight_path_angle_rad, state.airspeed_m_s,
        )  # fmt: skip
        return Start(begin, None)

    def _rest_after(self, state: Ownship, lead_s: float) -> Path | None:
        """What is left of the flown path in ``lead_s``; None off it, or near its end."""
        if self.flown is None:
            return None
        path = self.flown.path
        progress = progress_on(path, state.position_enu_m, self.flown.row, WINDOW_ROWS)
        if progress.off_track_m > OFF_TRACK_MAX_M:
            return None
        share = state.ground_speed_m_s / max(float(path.speeds_m_s[progress.row]), 1.0)
        return rest_of_path(path, time_at(path, progress) + lead_s * share, state.stamp_s + lead_s)

    def _begin(
        self, state: Ownship, stamp_s: float, position: tuple[float, float, float], course_rad: float,
        climb_rad: float, airspeed_m_s: float,
    ) -> StartState:  # fmt: skip
        """A start state within the aircraft's limits; in the plane on the mission's level."""
        vehicle = self.vehicle
        if self._mission.dimension == 2:
            position, climb_rad = (*position[:2], float(self._mission.start.up_m)), 0.0
        climb = min(vehicle.climb_angle_max_rad, max(-vehicle.descent_angle_max_rad, climb_rad))
        return StartState(
            stamp_s=stamp_s,
            position_enu_m=position,
            direction_rad=direction_from_course(course_rad),
            climb_rad=climb,
            airspeed_m_s=min(vehicle.airspeed_max_m_s, max(vehicle.airspeed_min_m_s, airspeed_m_s)),
            error_covariance=initial_covariances(vehicle, *state.position_std_m),
            estimate_covariance=np.zeros((6, 6)),
        )

    def plan(self, start: Start, snapshot: Snapshot, should_stop: Callable[[], bool]) -> Plan:
        """Plan from a start; the same snapshots and starts, in the same order, give the same plans."""
        # A flown path that fails the check, since the world has changed, is nothing to improve on.
        rest = start.rest if start.rest is not None and not self.check(start.rest) else None
        settings = self.settings if rest is None else self._replan_settings
        return self._solved(start, snapshot, should_stop, settings, rest)

    def plan_least_threat(self, start: Start, snapshot: Snapshot, should_stop: Callable[[], bool]) -> Plan:
        """A plan that weighs threats most and has no limit to them: the emergency strategy's first."""
        settings = replace(self.settings, threat_level_max=1.0, weights_cost=LEAST_THREAT_WEIGHTS)
        return self._solved(start, snapshot, should_stop, settings, None)

    def _solved(
        self, start: Start, snapshot: Snapshot, should_stop: Callable[[], bool], settings: PlannerSettings,
        rest: Path | None,
    ) -> Plan:  # fmt: skip
        self.num_plans += 1
        problem = Problem(
            start=start.state,
            goals=self.goals_left,
            snapshot=snapshot.with_threat_trees(self._threat_trees),
            vehicle=self.vehicle,
            settings=settings,
            seed=self._seed * 100_003 + self.num_plans,
        )
        plan = solve(problem, should_stop, flown=rest)
        self._threat_trees = plan.threat_trees
        return plan

    def check(self, path: Path) -> tuple[Violation, ...]:
        """What is wrong with a path that should reach the last goal."""
        goal = self.goals[-1]
        return self.checker.check_path(
            path, goal_enu_m=goal.position_enu_m, acceptance_radius_m=goal.acceptance_radius_m + 1.0
        )

    def judge(self, plan: Plan, start: Start) -> Judgement:
        """Whether the new plan replaces what is flown: no dithering.

        It does when nothing is flown yet, when the rest of the flown path fails the check or its
        threat level passes the limit, or when it is cheaper by the mission file's ``swap_gain``.
        """
        planning = self._mission.planning
        gain_min, level_max = float(planning.swap_gain), float(planning.threat_level_max)
        why: dict[str, object] = {
            "status": plan.status.value,
            "cost": plan.measures.path_cost,
            "flown_cost": plan.flown_cost,
            "flown_threat": plan.flown_threat,
            "swap_gain": gain_min,
            "threat_level_max": level_max,
        }
        if plan.path is None or not plan.reaches_goal:
            return Judgement(False, "no plan", "; ".join((plan.status.value, *plan.notes)), why)
        threat = float(plan.path.threat_levels.max())
        why["threat"] = threat
        violations = self.check(plan.path)
        if plan.path.threat_levels[0] > self.checker.limits.threat_level_max:
            # Already under the threat: a way out begins above the limit.
            violations = tuple(entry for entry in violations if entry.rule != "threat")
        if violations:
            why["violations"] = [str(entry) for entry in violations[:VIOLATIONS_TOLD]]
            return Judgement(False, "rejected", f"{violations[0]} ({len(violations)} violations)", why)
        cost = plan.measures.path_cost
        flown = () if start.rest is None else self.check(start.rest)
        if flown:
            why["flown_violations"] = [str(entry) for entry in flown[:VIOLATIONS_TOLD]]
            return Judgement(True, "unsafe", f"flown plan: {flown[0]}", why)
        if start.rest is None or plan.flown_cost is None:
            return Judgement(True, "first plan", f"cost {cost:.1f}", why)
        level = plan.flown_threat or 0.0
        if level > level_max and threat < level:
            return Judgement(True, "threat", f"level {level:.2f} on the flown plan", why)
        gain = 1.0 - cost / plan.flown_cost if plan.flown_cost > 0.0 else 0.0
        carried_s, wanted_s = self._carried_s(start), EXTENDED_HORIZONS * float(planning.time_horizon_s)
        why |= {"gain": gain, "carried_s": carried_s, "carried_min_s": wanted_s}
        if gain >= gain_min:
            instead = f" instead of {plan.flown_cost:.1f}"
            if plan.flown_cost == math.inf:  # so (9) counts what passes the limit
                instead = ", and the flown path passes threat_level_max"
            return Judgement(True, "better", f"cost {cost:.1f}{instead}", why)
        is_short = carried_s < wanted_s
        return Judgement(
            is_short, "extend" if is_short else "keep", f"cost {cost:.1f}, flown {plan.flown_cost:.1f}", why
        )

    def _carried_s(self, start: Start) -> float:
        """How long the mission in the autopilot still carries on from a start [s]; to the goal: endless."""
        if self.flown is None or start.rest is None:
            return 0.0
        path = self.flown.path
        if self.flown.carried_until_s >= path.times_s[-1]:
            return math.inf
        return self.flown.carried_until_s - float(path.times_s[len(path) - len(start.rest)])

    def waypoints(self, path: Path, max_waypoints: int) -> tuple[Waypoints, float, tuple[Violation, ...]]:
        """Waypoints of the part of a path that a mission carries, and a loiter at its end.

        Beyond a few time horizons a path is a guess: threats there are still to be sensed. The mission
        carries no more than :data:`CARRIED_HORIZONS` of it where a clear circle can end it there, else
        the nearest row at which one can; should the service fall silent, the aircraft circles at a
        place that was checked.

        Returns
        -------
        Waypoints
            What to upload.
        float
            The path's time at their end [s].
        tuple of Violation
            What is wrong with them, if no part of the path can be carried.
        """
        wanted = CARRIED_HORIZONS * float(self._mission.planning.time_horizon_s)
        last = len(path) - 1
        row = min(last, int(np.searchsorted(path.times_s, path.times_s[0] + wanted)))
        tries = [row, *(row + k for k in range(2, last - row, 2)), last]
        tries += list(range(row - 2, min(row, SHORTEST_ROWS) - 1, -2))
        first_wrong: tuple[Violation, ...] = ()
        for end in tries:
            waypoints, violations = self.carried(path, end)
            num_items = len(waypoints.positions_enu_m) + sum(len(items) for _, items in waypoints.actions)
            if not violations and num_items <= max_waypoints:
                return waypoints, float(path.times_s[end]), ()
            first_wrong = first_wrong or violations
        return waypoints, float(path.times_s[last]), first_wrong or (NO_ROOM,)

    def carried(self, path: Path, end: int) -> tuple[Waypoints, tuple[Violation, ...]]:
        """Waypoints up to a row with the loiter beside it, and what is wrong with them."""
        part = path.until(end)
        actions = self._actions_along(part)
        flown = waypoints_from_path(
            part, float(self.vehicle.airspeed_cruise_m_s), flies_by=self.flies_by,
            marked_m=[length for length, _ in actions],
        )  # fmt: skip
        radius = self.vehicle.turn_radius_min_m
        centre, direction = loiter_beside(
            flown.positions_enu_m, float(part.courses_rad[-1]), radius, self._obstacles,
            self.checker.limits.bounds,
        )  # fmt: skip

        def wrong_with(waypoints: Waypoints) -> tuple[Violation, ...]:
            legs: FloatArray = np.vstack([part.positions_enu_m[:1], waypoints.positions_enu_m])
            return self.checker.check_legs(
                legs, ends_in_loiter=True, loiter_radius_m=radius, loiter_centre_enu_m=centre
            )

        flown, violations = mended(flown, wrong_with)
        carried = replace(
            flown, loiter_centre_enu_m=centre, loiter_radius_m=direction * radius,
            goes_on=end == len(path) - 1 and self._may_go_on(flown.positions_enu_m[-1]),
            actions=_actions_at(actions, flown),
        )  # fmt: skip
        return carried, violations

    def _may_go_on(self, last_enu_m: FloatArray) -> bool:
        """Whether the operator's items that follow the goal can be flown to from there."""
        if self.tail_enu_m is None:
            return False
        legs: FloatArray = np.vstack([last_enu_m, self.tail_enu_m])
        wrong = self.checker.check_legs(
            legs, ends_in_loiter=True, loiter_radius_m=self.vehicle.turn_radius_min_m
        )
        return not any(entry.rule == "clearance" for entry in wrong)

    def _actions_along(self, part: Path) -> list[tuple[float, tuple[MissionItem, ...]]]:
        """The operator's DO_ items of goals that a part of a path reaches, and how far along they are [m]."""
        found: list[tuple[float, tuple[MissionItem, ...]]] = []
        row = 0
        for goal, items in zip(self.goals[self.next_goal :], self._actions[self.next_goal :], strict=False):
            away = np.linalg.norm(part.positions_enu_m[row:] - np.asarray(goal.position_enu_m), axis=1)
            if not away.min() <= goal.acceptance_radius_m:
                break
            row += int(np.argmin(away))
            steps = np.linalg.norm(np.diff(part.positions_enu_m[: row + 1, :2], axis=0), axis=1)
            if items:
                found.append((float(steps.sum()), items))
        return found

    def entry(self, state: Ownship, path: Path, waypoints: Waypoints, in_s: float = 0.0) -> int | None:
        """First waypoint that lies ahead and is flown to without harm, the turn towards it included.

        None where none is. An upload may have lasted, and the aircraft have turned away meanwhile.

        ``in_s`` is how long the aircraft still flies on before it is sent there [s].
        """
        here = distance_along(path, progress_on(path, state.position_enu_m, 0, ENTRY_ROWS))
        here += in_s * state.ground_speed_m_s
        for k, distance in enumerate(waypoints.distances_m):
            if distance < here + ENTRY_AHEAD_M and k < len(waypoints.distances_m) - 1:
                continue
            legs = way_to(
                state.position_enu_m, state.course_rad, waypoints.positions_enu_m[k],
                WIDENED * self.vehicle.turn_radius_min_m,
            )  # fmt: skip
            if legs is None:
                return None
            before = path.positions_enu_m[0] if k == 0 else waypoints.positions_enu_m[k - 1]
            onwards = self._turns_at(legs, waypoints.positions_enu_m[k + 1 :], before)
            if onwards is None:
                return None
            ways = [legs, legs[[0, -1]], *onwards]  # the wide turn, and what a tight one comes to
            wrong = [
                entry
                for way in ways
                for entry in self.checker.check_legs(
                    way, ends_in_loiter=True, loiter_radius_m=waypoints.loiter_radius_m,
                    loiter_centre_enu_m=waypoints.loiter_centre_enu_m,
                )
            ]  # fmt: skip
            return None if any(entry.rule in ENTRY_RULES for entry in wrong) else k
        return None

    def _turns_at(
        self, legs: FloatArray, following: FloatArray, before: FloatArray
    ) -> list[FloatArray] | None:
        """Turns at an entry reached over ``legs`` to the waypoints after it; None if one is behind.

        The path comes to its entry from the waypoint ``before``; who enters it may come from elsewhere. A
        waypoint that is nearer than the turn then counts as reached beside it, in the middle of the turn:
        so the way to the one after it is looked at, too, until the turn is over.
        """
        way, radius = legs[-1] - legs[-2], WIDENED * self.vehicle.turn_radius_min_m
        length = max(float(np.linalg.norm(way)), 1e-9)
        reached = legs[-1] - way * min(1.0, (FLY_BY_M if self.flies_by else 0.0) / length)
        place = (float(reached[0]), float(reached[1]), float(reached[2]))
        course = math.atan2(way[0], way[1])
        usual = legs[-1] - before
        is_usual = abs(wrapped_angle(math.atan2(usual[0], usual[1]) - course)) < ALIGNED_RAD
        found: list[FloatArray] = []
        for after in following[:1] if is_usual else following:
            turn = way_to(place, course, after, radius)
            if turn is None:
                return None
            found.append(turn)
            if len(turn) > 2 or float(np.hypot(*(after - reached)[:2])) >= radius:
                break
        return found

    def mission_for(self, waypoints: Waypoints, layout: Layout) -> tuple[Mission, Layout]:
        """The mission list with the waypoints in it, and the layout once they are flown."""
        ours = layout.items_for(waypoints, self._mission.frame)
        return layout.with_new(ours, self.num_plans)


def _actions_at(
    actions: Sequence[tuple[float, tuple[MissionItem, ...]]], waypoints: Waypoints
) -> tuple[tuple[int, tuple[MissionItem, ...]], ...]:
    """What is to be done by the number of the waypoint that it is done at."""
    found: dict[int, tuple[MissionItem, ...]] = {}
    for length, items in actions:
        behind = np.flatnonzero(waypoints.distances_m >= length - 1.0)
        number = int(behind[0]) if len(behind) else len(waypoints.distances_m) - 1
        found[number] = found.get(number, ()) + items
    return tuple(sorted(found.items()))

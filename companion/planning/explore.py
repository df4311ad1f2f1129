"""Local path searching: sub tasks on one growing tree (paper 4.3, 4.4.1)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation
from companion.kernels.aircraft.motion import OK, state_status
from companion.kernels.arrays import FloatArray, Guide, IntArray, Limits, Scene, Tree, empty_tree
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.search.branches import activate
from companion.kernels.search.dynamic_domain_rrt import DRAWS, FULL, REACHED, explore
from companion.kernels.search.growth import FAR, assess
from companion.kernels.workspace import ThreatScene, workspace
from companion.planning.guides import (
    ABOVE_LIMIT,
    NO_GUIDE,
    Ways,
    distances_to_go,
    guide_home,
    guide_to,
    has_way,
    raced_with_room,
    ways_before,
    ways_clear,
)
from companion.planning.problem import Problem
from companion.planning.sub_goal import choose_sub_goal
from companion.vehicle.lqg import tables_once, with_gusts
from companion.world.pursuer_trees import threat_trees
from companion.world.pursuit import Chase, pursuit_game

ShouldStop = Callable[[], bool]
RESTART_AFTER = 6  # failed sub tasks in a row after which the tree starts afresh


@dataclass
class Exploration:
    """One plan's search: the tree, the DTs' trees and what has been counted.

    Parameters
    ----------
    problem : Problem
        What is planned.
    rng : numpy.random.Generator
        All the search draws from.
    stats : ndarray, shape (4,)
        Collision checks, samples dropped by TUDD, failed extensions and iterations of the path search.
    star_stats : ndarray, shape (4,)
        The same counts of RRT*.
    sub_goals : list of ndarray, shape (3,)
        Sub goals in the order they were chosen [m].
    centres : list of ndarray, shape (3,)
        Centres of the sensing horizon of each sub task [m].
    notes : list of str
        What had to be given up on the way.
    num_nodes : int
        Nodes of trees that were started afresh.
    ways : Ways or None
        Where no DT could bar the way to the present goal; before a race that weighs them, how dear it is.
    airspeeds_m_s : tuple of float
        Airspeeds that may be flown, cruise first.
    is_above_limit : bool
        Whether a race that weighs threats was given up since its first way comes above ``threat_level_max``.
    """

    problem: Problem
    rng: np.random.Generator
    stats: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    star_stats: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    sub_goals: list[FloatArray] = field(default_factory=list)
    centres: list[FloatArray] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    num_nodes: int = 0
    ways: Ways | None = None
    is_above_limit: bool = False

    def __post_init__(self) -> None:
        problem, settings = self.problem, self.problem.settings
        snapshot = problem.snapshot
        self.plane_up_m = problem.start.position_enu_m[2] if snapshot.dimension == 2 else None
        self.limits = self._limits_at(problem.vehicle.airspeed_cruise_m_s)
        still = tables_once(problem.vehicle, settings.tau_s, snapshot.dimension)
        wind = math.hypot(*snapshot.wind_enu_m_s)
        faster = problem.vehicle.faster_m_s if settings.strategies.may_hurry else ()
        self.airspeeds_m_s = (problem.vehicle.airspeed_cruise_m_s, *faster)
        self._left = list(faster)
        self.tables = with_gusts(still, problem.vehicle, wind, settings.tau_s)
        self.model = settings.threat_model(problem.vehicle, snapshot.unit_m)
        self.pursuers = threat_trees(
            snapshot.tracks, snapshot.walls, self.plane_up_m, snapshot.bounds, snapshot.threat_trees,
            with_corners=settings.strategies.uses_corners,
        )  # fmt: skip
        hunters = snapshot.tracks if settings.strategies.plays_game else ()
        full_game = pursuit_game(
            hunters, snapshot.walls, self.plane_up_m, snapshot.bounds, settings.pursuit_slack_s
        )
        is_by_tree = not settings.strategies.races
        self.chase = Chase(full_game, settings.pursuit_shares, settings.pursuit_slack_min_s, is_by_tree)
        self._is_barred = False
        self._budget_end = settings.max_iterations
        self.tree: Tree = empty_tree(settings.tree_capacity, len(snapshot.tracks))
        scratch = workspace(settings.tree_capacity, len(snapshot.tracks), len(self.tables.normals))
        self.work = scratch._replace(stats=self.stats)
        self.star_work = scratch._replace(stats=self.star_stats)
        self._scene: Scene | None = None
        self._homes: dict[tuple[float, ...], tuple[Ways | None, Guide]] = {}
        self.reset_tree()

    def reset_tree(self) -> None:
        """Start the tree afresh at the root."""
        start, tree, snapshot = self.problem.start, self.tree, self.problem.snapshot
        self.num_nodes += int(tree.count[0])
        tree.count[0] = 1
        tree.state[0] = (*start.position_enu_m, start.direction_rad, start.climb_rad, start.airspeed_m_s)
        tree.parent[0], tree.children[0], tree.turn[0], tree.blocked[0] = -1, 0, 0, 0
        tree.time[0], tree.cost[0] = start.stamp_s, 0.0
        tree.straight[0] = self.limits.straight_min
        tree.cov_error[0], tree.cov_estimate[0] = start.error_covariance, start.estimate_covariance
        deviation = position_deviation(start.error_covariance, start.estimate_covariance, snapshot.dimension)
        tree.delta[0] = deviation / snapshot.unit_m
        free = clearance(*start.position_enu_m, snapshot.obstacles, FAR)
        tree.clear[0] = collision_free(free, deviation, snapshot.dimension)
        tree.active[:] = 0
        tree.active[0] = 1
        tree.caught[0] = int(self.chase.is_caught(start.position_enu_m, start.stamp_s))
        tree.threat_point[0] = 0.0
        scene, scratch = self.scene(), self.work.growth
        threats = ThreatScene(
            scene.threats, self.work.points, scene.pursuers.reach, scene.model, scratch.threat
        )
        assess(
            tree, 0, snapshot.dimension, scene.search, scene.tables.normals, threats, scratch.factor,
            scratch.levels,
        )  # fmt: skip

    @property
    def goes_by_objective(self) -> bool:
        """Whether J decides: the method goes by it, and nothing pursues the aircraft."""
        return self.problem.settings.strategies.by_objective and not self.chase.is_hunted

    @property
    def start_is_valid(self) -> bool:
        """Whether the root keeps the state constraints and stands outside obstacles."""
        state = self.tree.state[0]
        free = clearance(state[0], state[1], state[2], self.problem.snapshot.obstacles, 1.0)
        return state_status(state, self.limits) == OK and free > 0.0

    @property
    def start_is_clear(self) -> bool:
        """Whether the root keeps the state constraints, and the margin from everything: steps do, too."""
        x, y, z = self.problem.start.position_enu_m
        free = clearance(x, y, z, self.problem.snapshot.obstacles, self.limits.margin + 1.0)
        return state_status(self.tree.state[0], self.limits) == OK and free >= self.limits.margin

    @property
    def given_up(self) -> list[str]:
        """What had to be given up on the way, before the DTs too."""
        speed, cruise = self.limits.v_cruise, self.problem.vehicle.airspeed_cruise_m_s
        hurry = f"flown at {speed:.0f} m/s, before moving threats" if speed > cruise else ""
        return [note for note in (*self.notes, hurry, self.chase.note) if note]

    @property
    def iterations(self) -> int:
        """Iterations used up so far."""
        return int(self.stats[3])

    def is_spent(self, should_stop: ShouldStop) -> bool:
        """Whether the budget has ended, or DTs that are to be avoided bar the way."""
        return self._is_barred or self.iterations >= self._budget_end or should_stop()

    def run_sub_task(
        self, sub_goal: FloatArray, tolerance_m: float, centre: FloatArray, should_stop: ShouldStop
    ) -> int:
        """Grow towards one sub goal within its time horizon; the node that reaches it, or -1.

        Parameters
        ----------
        sub_goal : ndarray, shape (3,)
            Where to [m].
        tolerance_m : float
            Distance at which it is reached.
        centre : ndarray, shape (3,)
            Centre of the sensing horizon, which the search does not leave [m].
        should_stop : callable
            Asked between bursts of iterations.
        """
        settings = self.problem.settings
        scene = self.scene(sub_goal, tolerance_m)
        left, stalled, nearest = settings.sub_task_iterations, 0, np.inf
        while left > 0 and stalled < settings.stall_iterations and not self.is_spent(should_stop):
            burst = min(settings.burst, left)
            left -= burst
            status, node = explore(
                self.tree, scene, centre, settings.sensing_horizon_m, sub_goal,
                self.rng.random((burst, DRAWS)), self.work,
            )  # fmt: skip
            if status == REACHED:
                return int(node)
            if status == FULL:
                break
            away = float(np.linalg.norm(self.tree.state[self.nearest_node(sub_goal), :3] - sub_goal))
            stalled = 0 if away < nearest - 0.5 * self.limits.v_cruise * self.limits.tau else stalled + burst
            nearest = min(nearest, away)
        return -1

    def scene(self, sub_goal: FloatArray | None = None, tolerance_m: float = 0.0) -> Scene:
        """What the kernels read, with the distance field of a sub goal if there is one.

        Parameters
        ----------
        sub_goal : ndarray, shape (3,), optional
            Where a sub task leads to [m].
        tolerance_m : float
            Distance at which it is reached.
        """
        if self._scene is None:
            snapshot = self.problem.snapshot
            self._scene = Scene(
                pursuers=self.pursuers,
                obstacles=snapshot.obstacles,
                walls=snapshot.walls,
                threats=snapshot.threats,  # what will be sensed from a sub goal is known to nobody yet
                model=self.model,
                limits=self.limits,
                tables=self.tables,
                search=self.problem.settings.search(self.limits, snapshot.unit_m, 0.0, self.chase.pursuit),
                guide=NO_GUIDE,
                game=self.chase.game,
            )
        if sub_goal is None:
            return self._scene
        search = self._scene.search._replace(tolerance=tolerance_m)
        return self._scene._replace(search=search, guide=self.guide_to(sub_goal))

    def nearest_node(self, point: FloatArray) -> int:
        """The searched node nearest to a point.

        Parameters
        ----------
        point : ndarray, shape (3,)
            Any place [m].
        """
        n = int(self.tree.count[0])
        away = np.linalg.norm(self.tree.state[:n, :3] - point, axis=1)
        return int(np.argmin(np.where(self.tree.active[:n] == 1, away, np.inf)))

    def guide_to(self, point: FloatArray) -> Guide:
        """The distance field of a point, over twice the sensing horizon about it.

        Parameters
        ----------
        point : ndarray, shape (3,)
            A sub goal [m].
        """
        obstacles = self.problem.snapshot.obstacles
        return guide_to(point, self.limits, self.problem.settings, obstacles, self.ways)

    def guide_home(self, goal: FloatArray, root: int = 0) -> Guide:
        """The distance field of a goal, over everything within the bounds.

        While DTs are avoided it leads where they cannot be in time, and so do those of sub goals.

        Parameters
        ----------
        goal : ndarray, shape (3,)
            Centre of a goal region [m].
        root : int
            The node from which it is to be reached.
        """
        homes = self._homes if root == 0 else {}  # no other node is come back to
        asked = (*goal, self.limits.v_cruise)
        if asked not in homes:
            ways, before = ways_clear(goal, self.limits, self.problem.snapshot.obstacles), None
            if self.chase.is_avoided or self.chase.is_raced:
                settings, unit_m = self.problem.settings, self.problem.snapshot.unit_m
                dear = 0.0 if self.chase.is_avoided else settings.times_as_dear(self.limits.v_cruise, unit_m)
                state, stamp_s = self.tree.state[root], float(self.tree.time[root])
                ways = before = ways_before(ways, self.chase.game, state, stamp_s, self.limits, dear)
            homes[asked] = before, guide_home(goal, ways)
        self.ways, home = homes[asked]
        return home

    def hurry(self, should_stop: ShouldStop) -> bool:
        """Start afresh, flying faster, where DTs bar the way; whether that can be tried.

        Speed costs energy: cruise is tried first.

        Parameters
        ----------
        should_stop : callable
            Whether the budget has ended.
        """
        if not (self._left and self.chase.is_avoided) or should_stop():
            return False
        self.start_afresh(self._left.pop(0))
        return True

    def _limits_at(self, airspeed_m_s: float) -> Limits:
        """What can be flown at an airspeed of at least the cruise's [m/s]."""
        asked, world = self.problem.settings, self.problem.snapshot
        return self.problem.vehicle.at_speed(airspeed_m_s).limits(
            world.dimension, world.bounds, asked.clearance_min_m, asked.tau_s, world.wind_enu_m_s
        )

    def start_afresh(self, airspeed_m_s: float) -> None:
        """Search again from the start, at an airspeed of :attr:`airspeeds_m_s`."""
        self.limits = self._limits_at(airspeed_m_s)
        self.ways, self._scene, self._is_barred = None, None, False
        self.reset_tree()

    def kept(self) -> Callable[[], None]:
        """What goes back to the search as it is now: the next is grown in its place."""
        limits, ways, is_barred = self.limits, self.ways, self._is_barred
        rows = [array[: self.tree.count[0]].copy() for array in self.tree]

        def go_back() -> None:
            self.limits, self.ways, self._scene, self._is_barred = limits, ways, None, is_barred
            for array, row in zip(self.tree, rows, strict=True):
                array[: len(row)] = row

        return go_back

    def give_in(self, should_stop: ShouldStop) -> None:
        """Start afresh at cruise with less asked of the path before the DTs, with little if time is short.

        Parameters
        ----------
        should_stop : callable
            Whether the budget has ended.
        """
        self.chase.give_in(is_late=should_stop())
        self._homes.clear()
        if self.chase.is_by_tree:  # races take nothing of the budget: so each try has the whole of it
            self._budget_end = self.iterations + self.problem.settings.max_iterations
        self._left = list(self.airspeeds_m_s[1:])
        self.start_afresh(self.airspeeds_m_s[0])

    def nearest_to_go(self, point: FloatArray) -> int:
        """The searched node with the least distance to go to a point, round obstacles.

        The paper keeps the branch nearest to the sub goal; taken as the crow flies that is often one
        that ends at the wrong side of a wall.

        Parameters
        ----------
        point : ndarray, shape (3,)
            A sub goal [m].
        """
        guide, n = self.guide_to(point), int(self.tree.count[0])
        to_go = np.where(self.tree.active[:n] == 1, distances_to_go(guide, self.tree.state[:n, :2]), np.inf)
        return int(np.argmin(to_go)) if np.isfinite(to_go).any() else self.nearest_node(point)

    def reach_goal(
        self, goal: FloatArray, radius_m: float, root: int, should_stop: ShouldStop
    ) -> tuple[bool, int]:
        """Sub task after sub task until the goal is reached or the budget ends.

        A sub task that fails hands over its branch nearest to the sub goal (paper Fig. 6); after several
        in a row the tree starts afresh from the root, which RRTs profit from (their run times are
        heavy-tailed).

        Parameters
        ----------
        goal : ndarray, shape (3,)
            Centre of the goal region [m].
        radius_m : float
            Radius of the goal region.
        root : int
            The node from which the goal is to be reached.
        should_stop : callable
            Asked between bursts of iterations.

        Returns
        -------
        bool
            Whether the goal was reached.
        int
            The node at which the path ends.
        """
        end, in_a_row = root, 0
        used: list[FloatArray] = []
        settings, home = self.problem.settings, self.guide_home(goal, root)
        if self.chase.is_raced:
            node = self._raced(goal, radius_m, root, home, should_stop)
            return node >= 0, max(node, root)
        self._is_barred = self._has_no_way(home, root)
        while not self.is_spent(should_stop):
            centre = self.tree.state[end, :3].copy()
            sub_goal = self._next_sub_goal(end, centre, goal, home, used)
            is_goal = bool(np.array_equal(sub_goal, goal))
            steps = settings.sub_goal_tolerance_steps
            tolerance = radius_m if is_goal else steps * self.limits.v_cruise * self.limits.tau
            activate(self.tree, centre, settings.sensing_horizon_m, end, root, self.work.walk.stack)
            node = self.run_sub_task(sub_goal, tolerance, centre, should_stop)
            if node >= 0:
                if is_goal:
                    return True, node
                end, in_a_row = node, 0
                continue
            in_a_row += 1
            end = self.nearest_to_go(sub_goal)
            is_full = int(self.tree.count[0]) == settings.tree_capacity
            if in_a_row >= RESTART_AFTER or is_full:
                if root != 0:
                    break
                self.reset_tree()
                end, in_a_row, used = root, 0, []
        return False, end

    def _raced(
        self, goal: FloatArray, radius_m: float, root: int, home: Guide, should_stop: ShouldStop
    ) -> int:
        """The node at a goal of the earliest way there that no DT could bar; negative where none was found.

        Parameters
        ----------
        goal : ndarray, shape (3,)
            Centre of the goal region [m].
        radius_m : float
            Radius of the goal region.
        root : int
            The node from which it is to be reached.
        home : Guide
            The goal's distance field.
        should_stop : callable
            Whether the budget has ended.
        """
        node = raced_with_room(
            self.tree, root, np.append(goal, radius_m), home, self.scene(), self.work, rng=self.rng,
            should_stop=should_stop, is_weighed=not self.chase.is_avoided,
            shuns_risk=self.problem.settings.weight_collision > 0.0,
            is_brief=self.problem.settings.races_briefly,
        )  # fmt: skip
        self._is_barred, self.is_above_limit = node < 0, node == ABOVE_LIMIT
        if node >= 0:
            self.sub_goals.append(goal)
            self.centres.append(self.tree.state[root, :3].copy())
        return node

    def _has_no_way(self, home: Guide, root: int) -> bool:
        """Whether DTs that are avoided in the plane bar all ways from a node; ``home`` leads to the goal."""
        if not self.chase.is_avoided or self.limits.dimension == 3:
            return False
        return not has_way(home, self.tree.state[root])

    def _next_sub_goal(
        self, end: int, centre: FloatArray, goal: FloatArray, home: Guide, used: list[FloatArray]
    ) -> FloatArray:
        """Choose a sub goal and note it.

        Parameters
        ----------
        end : int
            The node at which the path ends so far.
        centre : ndarray, shape (3,)
            Where that is [m].
        goal : ndarray, shape (3,)
            Centre of the goal region [m].
        home : Guide
            The goal's distance field.
        used : list of ndarray, shape (3,)
            Sub goals that were tried since the tree began [m]; the new one is added.

        Returns
        -------
        ndarray, shape (3,)
            The sub goal, or the goal itself [m].
        """
        chosen = choose_sub_goal(
            end=self.tree.state[end].copy(),
            goal=goal,
            stamp_s=float(self.tree.time[end]),
            elapsed_s=float(self.tree.time[end] - self.tree.time[0]),
            scene=self.scene(),
            settings=self.problem.settings,
            home=home,
            used=used,
        )
        if not np.array_equal(chosen.position_enu_m, goal):
            used.append(chosen.position_enu_m)
        self.sub_goals.append(chosen.position_enu_m)
        self.centres.append(centre)
        if chosen.note and chosen.note not in self.notes:
            self.notes.append(chosen.note)
        return chosen.position_enu_m

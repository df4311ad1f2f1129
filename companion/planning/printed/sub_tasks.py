"""Local path searching: sub tasks on one growing tree (paper 4.3, 4.4.1)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import DistanceField, Scene
from companion.kernels.printed.branches import activate
from companion.kernels.printed.dynamic_domain_rrt import FULL, REACHED, explore
from companion.kernels.search.growth import DRAWS
from companion.planning.explore import Exploration
from companion.planning.printed.distance_fields import distances_to_go, goal_distances, sub_goal_distances
from companion.planning.printed.sub_goal import choose_sub_goal
from companion.planning.route import Route, route_from_tree

ShouldStop = Callable[[], bool]
RESTART_AFTER = 6  # After this many failed sub tasks in a row a new tree begins.

Found = tuple[bool, Route, int]  # Whether all goals were passed, the route, and the node at its end.


class SubTasks:
    """The search from sub goal to sub goal.

    Parameters
    ----------
    exploration : Exploration
        Has the tree, and counts the work.

    Attributes
    ----------
    sub_goals : list of ndarray, shape (3,)
        Sub goals in the order they were chosen [m].
    centres : list of ndarray, shape (3,)
        Centres of the sensing horizon of each sub task [m].
    notes : list of str
        Which rules sub goals on the way break.
    """

    def __init__(self, exploration: Exploration) -> None:
        self.exploration = exploration
        self.sub_goals: list[FloatArray] = []
        self.centres: list[FloatArray] = []
        self.notes: list[str] = []
        self._tree, self._limits, self._problem = exploration.tree, exploration.limits, exploration.problem
        self._budget_end = exploration.problem.settings.max_iterations
        self._homes: dict[tuple[float, ...], DistanceField] = {}

    def is_spent(self, should_stop: ShouldStop) -> bool:
        """Return whether the budget has ended."""
        return int(self.exploration.stats[3]) >= self._budget_end or should_stop()

    def allow_threatened_nodes(self) -> None:
        """Search again from the start; pursuers bar no way any more, because they barred all."""
        self.notes.append("no path that pursuers could not bar was found")
        self._budget_end = int(self.exploration.stats[3]) + self._problem.settings.max_iterations
        self.exploration.allow_threatened_nodes()

    def through_goals(self, should_stop: ShouldStop) -> Found:
        """Whether all goals were passed in order; the route there or the one that passed the most; its end.

        A goal can be reached in a pose from which the next one cannot be; then the search starts afresh.
        """
        most, best = -1, None
        while best is None or not self.is_spent(should_stop):
            node, reached, passed = 0, True, 0
            for goal in self._problem.goals:
                position = np.array(goal.position_enu_m, dtype=np.float64)
                reached, node = self.reach_goal(position, goal.acceptance_radius_m, node, should_stop)
                if not reached:
                    break
                passed += 1
            if reached:
                return True, route_from_tree(self.exploration, node), node
            if passed > most:
                most, best = passed, route_from_tree(self.exploration, node)
            if not self.is_spent(should_stop):
                self.exploration.reset_tree()
        return False, best, -1

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
        settings = self._problem.settings
        scene = self.scene_to(sub_goal, tolerance_m)
        left, stalled, nearest = settings.sub_task_iterations, 0, np.inf
        while left > 0 and stalled < settings.stall_iterations and not self.is_spent(should_stop):
            burst = min(settings.burst, left)
            left -= burst
            status, node = explore(
                self._tree, scene, centre, settings.sensing_horizon_m, sub_goal,
                self.exploration.rng.random((burst, DRAWS)), self.exploration.work,
            )  # fmt: skip
            if status == REACHED:
                return int(node)
            if status == FULL:
                break
            away = float(np.linalg.norm(self._tree.state[self.nearest_node(sub_goal), :3] - sub_goal))
            stalled = (
                0 if away < nearest - 0.5 * self._limits.v_cruise * self._limits.tau else stalled + burst
            )
            nearest = min(nearest, away)
        return -1

    def scene_to(self, sub_goal: FloatArray, tolerance_m: float) -> Scene:
        """Return the kernels' scene with the distance field of a sub goal.

        Parameters
        ----------
        sub_goal : ndarray, shape (3,)
            Where a sub task leads to [m].
        tolerance_m : float
            Distance at which it is reached.
        """
        scene = self.exploration.scene()
        search = scene.search._replace(tolerance=tolerance_m)
        return scene._replace(search=search, distances=self.sub_goal_distances(sub_goal))

    def nearest_node(self, point: FloatArray) -> int:
        """Return the searched node nearest to a point.

        Parameters
        ----------
        point : ndarray, shape (3,)
            Any place [m].
        """
        n = int(self._tree.count[0])
        away = np.linalg.norm(self._tree.state[:n, :3] - point, axis=1)
        return int(np.argmin(np.where(self._tree.active[:n] == 1, away, np.inf)))

    def sub_goal_distances(self, point: FloatArray) -> DistanceField:
        """Return the distance field of a point, over twice the sensing horizon about it.

        Parameters
        ----------
        point : ndarray, shape (3,)
            A sub goal [m].
        """
        obstacles = self._problem.snapshot.obstacles
        return sub_goal_distances(point, self._limits, self._problem.settings, obstacles)

    def goal_distances(self, goal: FloatArray) -> DistanceField:
        """Return the distance field of a goal, over everything within the bounds.

        Parameters
        ----------
        goal : ndarray, shape (3,)
            Centre of a goal region [m].
        """
        asked = tuple(float(value) for value in goal)
        if asked not in self._homes:
            self._homes[asked] = goal_distances(goal, self._limits, self._problem.snapshot.obstacles)
        return self._homes[asked]

    def nearest_to_go(self, point: FloatArray) -> int:
        """Return the searched node with the least distance to go to a point, round obstacles.

        The paper keeps the branch nearest to the sub goal; taken as the crow flies that is often one
        that ends at the wrong side of a wall.

        Parameters
        ----------
        point : ndarray, shape (3,)
            A sub goal [m].
        """
        distances, n = self.sub_goal_distances(point), int(self._tree.count[0])
        to_go = np.where(
            self._tree.active[:n] == 1,
            distances_to_go(distances, self._tree.state[:n, :2]),
            np.inf,
        )
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
        settings, home = self._problem.settings, self.goal_distances(goal)
        while not self.is_spent(should_stop):
            centre = self._tree.state[end, :3].copy()
            sub_goal = self._next_sub_goal(end, centre, goal, home, used)
            is_goal = bool(np.array_equal(sub_goal, goal))
            steps = settings.sub_goal_tolerance_steps
            tolerance = radius_m if is_goal else steps * self._limits.v_cruise * self._limits.tau
            activate(
                self._tree,
                centre,
                settings.sensing_horizon_m,
                end,
                root,
                self.exploration.work.walk.stack,
            )
            node = self.run_sub_task(sub_goal, tolerance, centre, should_stop)
            if node >= 0:
                if is_goal:
                    return True, node
                end, in_a_row = node, 0
                continue
            in_a_row += 1
            end = self.nearest_to_go(sub_goal)
            is_full = int(self._tree.count[0]) == settings.tree_capacity
            if in_a_row >= RESTART_AFTER or is_full:
                if root != 0:
                    break
                self.exploration.reset_tree()
                end, in_a_row, used = root, 0, []
        return False, end

    def _next_sub_goal(
        self, end: int, centre: FloatArray, goal: FloatArray, home: DistanceField, used: list[FloatArray]
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
        home : DistanceField
            The goal's distance field.
        used : list of ndarray, shape (3,)
            Sub goals that were tried since the tree began [m]; the new one is added.

        Returns
        -------
        ndarray, shape (3,)
            The sub goal, or the goal itself [m].
        """
        chosen = choose_sub_goal(
            end=self._tree.state[end].copy(),
            goal=goal,
            elapsed_s=float(self._tree.time[end] - self._tree.time[0]),
            scene=self.exploration.scene(),
            settings=self._problem.settings,
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

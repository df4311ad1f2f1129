"""Local path searching: sub tasks on one growing tree (paper 4.3, 4.4.1)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation
from companion.kernels.aircraft.motion import OK, state_status
from companion.kernels.arrays import Guide, IntArray, Scene, Tree, Uncertainty, empty_tree
from companion.kernels.geometry.distance_field import spread_wave
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.search.dynamic_domain_rrt import DRAWS, FULL, REACHED, assess, explore
from companion.kernels.threat.fuzzy_threat import MAX_THREATS
from companion.planning.problem import Problem
from companion.planning.settings import Estimator
from companion.planning.sub_goal import choose_sub_goal
from companion.vehicle.lqg import uncertainty_tables
from companion.vehicle.vehicle_model import VehicleModel
from companion.world.pursuer_trees import threat_trees
from companion.world.threats import known_within

ShouldStop = Callable[[], bool]
WAVE_CELLS = 97  # each way, of the grid about a sub goal
CELL_MIN_M, CELLS_MAX = 30.0, 256  # of the grid over the bounds
NO_GUIDE = Guide(np.full((1, 1), np.inf), np.zeros(2), 1.0, 0.0, 0.0)
RESTART_AFTER = 6  # failed sub tasks in a row after which the tree starts afresh


@dataclass
class Exploration:
    """One plan's search: the tree, the DTs' trees and what has been counted.

    ``stats`` (4,): collision checks, samples dropped by TUDD, failed extensions, iterations of the path
    search; ``star_stats`` (4,) the same of RRT*.
    """

    problem: Problem
    rng: np.random.Generator
    stats: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    star_stats: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    sub_goals: list[FloatArray] = field(default_factory=list)
    centres: list[FloatArray] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    num_nodes: int = 0

    def __post_init__(self) -> None:
        problem, settings = self.problem, self.problem.settings
        snapshot = problem.snapshot
        self.plane_up_m = problem.start.position_enu_m[2] if snapshot.dimension == 2 else None
        self.limits = problem.vehicle.limits(
            snapshot.dimension, snapshot.bounds, settings.clearance_min_m, settings.tau_s
        )
        self.tables = _tables(problem.vehicle, settings.tau_s, snapshot.dimension)
        self.model = settings.threat_model(problem.vehicle, snapshot.unit_m)
        self.pursuers = threat_trees(
            snapshot.tracks, snapshot.walls, self.plane_up_m, snapshot.bounds, snapshot.threat_trees,
            with_corners=settings.strategies.estimator is Estimator.EX_RRT,
        )  # fmt: skip
        self.tree: Tree = empty_tree(settings.tree_capacity, len(snapshot.tracks))
        self.plant()

    def plant(self) -> None:
        """Start the tree afresh at the root, with the threats known there."""
        self.threats = self.problem.snapshot.threats
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
        free = clearance(*start.position_enu_m, snapshot.obstacles, 1e4)
        tree.clear[0] = collision_free(free, deviation, snapshot.dimension)
        tree.active[:] = 0
        tree.active[0] = 1
        tree.threat_point[0] = 0.0
        assess(
            tree, 0, self.threats, self.pursuers.model[:, 1].copy(), self.model, self.tables.normals,
            self.problem.settings.search(self.limits, snapshot.unit_m, 0.0), snapshot.dimension,
            np.empty((MAX_THREATS, 2)), np.empty(len(self.tables.normals)),
        )  # fmt: skip

    @property
    def start_is_valid(self) -> bool:
        """Whether the root keeps the state constraints and stands outside obstacles."""
        state = self.tree.state[0]
        free = clearance(state[0], state[1], state[2], self.problem.snapshot.obstacles, 1.0)
        return state_status(state, self.limits) == OK and free > 0.0

    @property
    def iterations(self) -> int:
        """Iterations used up so far."""
        return int(self.stats[3])

    def is_spent(self, should_stop: ShouldStop) -> bool:
        """Whether the budget has ended."""
        return self.iterations >= self.problem.settings.max_iterations or should_stop()

    def sense(self, centre: FloatArray) -> None:
        """Static threats about a sub task's centre become known, and stay so."""
        snapshot = self.problem.snapshot
        near = known_within(snapshot.threats, centre[0], centre[1], self.problem.settings.sensing_horizon_m)
        self.threats = self.threats._replace(known=np.maximum(self.threats.known, near))

    def activate(self, centre: FloatArray, end: int, whole: bool, root: int = 0) -> None:
        """Which nodes the sub task searches: those of the horizon, and after a success the end alone.

        Only what hangs below ``root`` counts: other branches have not passed the goals before it.
        """
        tree, n = self.tree, int(self.tree.count[0])
        tree.active[:n] = 0
        if whole:
            away = np.linalg.norm(tree.state[:n, :3] - centre, axis=1)
            tree.active[:n] = away <= self.problem.settings.sensing_horizon_m
        if root > 0:
            below = np.zeros(n, dtype=np.int64)
            below[root] = 1
            for i in range(root + 1, n):
                below[i] = below[tree.parent[i]]
            tree.active[:n] *= below
        tree.active[end] = 1

    def run_sub_task(
        self, sub_goal: FloatArray, tolerance_m: float, centre: FloatArray, should_stop: ShouldStop
    ) -> int:
        """Grow towards one sub goal within its time horizon; the node that reaches it, or -1."""
        settings = self.problem.settings
        scene = self.scene(sub_goal, tolerance_m)
        left, stalled, nearest = settings.sub_task_iterations, 0, np.inf
        while left > 0 and stalled < settings.stall_iterations and not self.is_spent(should_stop):
            burst = min(settings.burst, left)
            left -= burst
            status, node = explore(
                self.tree, scene, centre, settings.sensing_horizon_m, sub_goal,
                self.rng.random((burst, DRAWS)), self.stats,
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
        """What the kernels read, with the way to a sub goal if there is one."""
        snapshot = self.problem.snapshot
        guide = NO_GUIDE if sub_goal is None else self.guide_to(sub_goal)
        return Scene(
            self.pursuers, snapshot.obstacles, snapshot.walls, self.threats, self.model, self.limits,
            self.tables, self.problem.settings.search(self.limits, snapshot.unit_m, tolerance_m), guide,
        )  # fmt: skip

    def nearest_node(self, point: FloatArray) -> int:
        """The searched node nearest to a point."""
        n = int(self.tree.count[0])
        away = np.linalg.norm(self.tree.state[:n, :3] - point, axis=1)
        return int(np.argmin(np.where(self.tree.active[:n] == 1, away, np.inf)))

    def guide_to(self, point: FloatArray) -> Guide:
        """The way round obstacles to a point, from twice the sensing horizon about it."""
        settings, le = self.problem.settings, self.limits.v_cruise * self.limits.tau
        radius = 2.0 * settings.sensing_horizon_m
        cell = 2.0 * radius / (WAVE_CELLS - 1)
        wave, origin = np.empty((WAVE_CELLS, WAVE_CELLS)), point[:2] - radius
        self._spread(point, radius, origin, cell, wave)
        share = settings.way_share if settings.strategies.follow_way else 0.0
        return Guide(wave, origin, cell, share, settings.way_steps * le)

    def way_home(self, goal: FloatArray) -> Guide:
        """The way round obstacles to a goal, from everywhere within the bounds."""
        b = self.limits.bounds
        cell = max(CELL_MIN_M, max(b[1] - b[0], b[3] - b[2]) / CELLS_MAX)
        wave = np.empty((int((b[1] - b[0]) / cell) + 1, int((b[3] - b[2]) / cell) + 1))
        origin = np.array([b[0], b[2]])
        self._spread(goal, np.inf, origin, cell, wave)
        return Guide(wave, origin, cell, 0.0, 0.0)

    def _spread(
        self, point: FloatArray, radius: float, origin: FloatArray, cell: float, wave: FloatArray
    ) -> None:
        spread_wave(
            point[0], point[1], point[2], radius, self.limits.margin, self.limits.bounds,
            self.problem.snapshot.obstacles, origin, cell, wave,
        )  # fmt: skip

    def nearest_by_way(self, point: FloatArray) -> int:
        """The searched node with the shortest way round obstacles to a point.

        The paper keeps the branch nearest to the sub goal; taken as the crow flies that is often one
        that ends at the wrong side of a wall.
        """
        guide, n = self.guide_to(point), int(self.tree.count[0])
        index = np.rint((self.tree.state[:n, :2] - guide.origin) / guide.cell).astype(np.int64)
        index = np.clip(index, 0, WAVE_CELLS - 1)
        ways = np.where(self.tree.active[:n] == 1, guide.wave[index[:, 0], index[:, 1]], np.inf)
        return int(np.argmin(ways)) if np.isfinite(ways).any() else self.nearest_node(point)

    def reach_goal(
        self, goal: FloatArray, radius_m: float, root: int, should_stop: ShouldStop
    ) -> tuple[bool, int]:
        """Sub task after sub task until the goal is reached or the budget ends.

        Returns whether it was, and the node at which the path ends. A sub task that fails hands over
        its branch nearest to the sub goal (paper Fig. 6); after several in a row the tree starts
        afresh from the root, which RRTs profit from (their run times are heavy-tailed).
        """
        end, in_a_row = root, 0
        used: list[FloatArray] = []
        settings, home = self.problem.settings, self.way_home(goal)
        while not self.is_spent(should_stop):
            centre = self.tree.state[end, :3].copy()
            self.sense(centre)
            chosen = choose_sub_goal(
                end=self.tree.state[end].copy(), goal=goal,
                elapsed_s=float(self.tree.time[end] - self.tree.time[0]),
                obstacles=self.problem.snapshot.obstacles, threats=self.threats, pursuers=self.pursuers,
                model=self.model, limits=self.limits, settings=settings, home=home, used=used,
            )  # fmt: skip
            if not np.array_equal(chosen.position_enu_m, goal):
                used.append(chosen.position_enu_m)
            self.sub_goals.append(chosen.position_enu_m)
            self.centres.append(centre)
            if chosen.note and chosen.note not in self.notes:
                self.notes.append(chosen.note)
            is_goal = bool(np.array_equal(chosen.position_enu_m, goal))
            tolerance = (
                radius_m
                if is_goal
                else settings.sub_goal_tolerance_steps * self.limits.v_cruise * self.limits.tau
            )
            self.activate(centre, end, whole=True, root=root)
            node = self.run_sub_task(chosen.position_enu_m, tolerance, centre, should_stop)
            if node >= 0:
                if is_goal:
                    return True, node
                end, in_a_row = node, 0
                continue
            in_a_row += 1
            end = self.nearest_by_way(chosen.position_enu_m)
            full = int(self.tree.count[0]) == settings.tree_capacity
            if in_a_row >= RESTART_AFTER or full:
                if root != 0:
                    break
                self.plant()
                end, in_a_row, used = root, 0, []
        return False, end


@functools.cache
def _tables(vehicle: VehicleModel, tau_s: float, dimension: int) -> Uncertainty:
    """LQG-MP tables of a vehicle, made once: the paper's "off-line" part."""
    return uncertainty_tables(vehicle, tau_s, dimension)

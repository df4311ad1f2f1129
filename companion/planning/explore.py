"""The working state of one plan's search: limits, pursuers, the path tree and counters."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation
from companion.kernels.aircraft.motion import OK, state_status
from companion.kernels.arrays import DistanceField, IntArray, Limits, Scene, Tree, empty_tree
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.search.growth import FAR, assess
from companion.kernels.threat.pursuit_game import PASSES_BY, is_threatened
from companion.kernels.workspace import ThreatScene, workspace
from companion.planning.problem import Problem
from companion.world.pursuer_trees import threat_trees
from companion.world.pursuit import pursuit_game
from companion.world.right_of_way import with_wrong_sides
from companion.world.vehicle.lqg import tables_once, with_gusts

NO_DISTANCES = DistanceField(np.full((1, 1), np.inf), np.zeros(2), 1.0, 0.0, 0.0)


@dataclass
class Exploration:
    """The working state of one plan's search.

    Parameters
    ----------
    problem : Problem
        What is planned.
    rng : numpy.random.Generator
        Source of all random draws of the search.
    stats : ndarray, shape (4,)
        Collision checks, samples dropped by TUDD, failed extensions and iterations of the path search.
    star_stats : ndarray, shape (4,)
        The same counts for RRT*.
    num_nodes : int
        Number of nodes of earlier trees, which were discarded.
    airspeeds_m_s : tuple of float
        Airspeeds that may be flown, cruise first.
    game : Game
        The pursuit game; it has no vehicles if the method does not use it.
    is_pursued : bool
        Whether any tracked threat is a pursuer.
    bars_pursued : bool
        Whether no node grows where a pursuer could threaten it.
    """

    problem: Problem
    rng: np.random.Generator
    stats: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    star_stats: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    num_nodes: int = 0

    def __post_init__(self) -> None:
        problem, settings = self.problem, self.problem.settings
        snapshot = problem.snapshot
        self.plane_up_m = problem.start.position_enu_m[2] if snapshot.dimension == 2 else None
        self.limits = self._limits_at(problem.vehicle.airspeed_cruise_m_s)
        still = tables_once(problem.vehicle, settings.tau_s, snapshot.dimension)
        wind = math.hypot(*snapshot.wind_enu_m_s)
        faster = problem.vehicle.faster_m_s if settings.strategies.may_fly_fast else ()
        self.airspeeds_m_s = (problem.vehicle.airspeed_cruise_m_s, *faster)
        self.tables = with_gusts(still, problem.vehicle, wind, settings.tau_s)
        self.model = settings.threat_model(problem.vehicle, snapshot.unit_m)
        trees = threat_trees(
            snapshot.tracks, snapshot.walls, self.plane_up_m, snapshot.bounds, snapshot.threat_trees,
            with_corners=settings.strategies.uses_corners,
        )  # fmt: skip
        self.pursuers = with_wrong_sides(trees, snapshot.tracks, *self._straight_to_goal())
        vehicles = snapshot.tracks if settings.strategies.plays_game else ()
        self.game = pursuit_game(
            vehicles, snapshot.walls, self.plane_up_m, snapshot.bounds, settings.pursuit_slack_s
        )
        self.is_pursued = bool((self.game.vehicles[:, 7] != PASSES_BY).any())
        self.bars_pursued = self.is_pursued and not settings.strategies.by_objective
        self.tree: Tree = empty_tree(settings.tree_capacity, len(snapshot.tracks))
        scratch = workspace(settings.tree_capacity, len(snapshot.tracks), len(self.tables.normals))
        self.work = scratch._replace(stats=self.stats)
        self.star_work = scratch._replace(stats=self.star_stats)
        self._scene: Scene | None = None
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
        tree.threatened[0] = int(is_threatened(self.game, *start.position_enu_m, start.stamp_s))
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
    def danger_max(self) -> float:
        """Danger from pursuers (g of J) above which a place counts as under threat."""
        settings = self.problem.settings
        return 1.0 - settings.pursuit_slack_min_s / settings.pursuit_slack_s

    @property
    def start_is_valid(self) -> bool:
        """Whether the root keeps the state constraints and stands outside obstacles."""
        state = self.tree.state[0]
        free = clearance(state[0], state[1], state[2], self.problem.snapshot.obstacles, 1.0)
        return state_status(state, self.limits) == OK and free > 0.0

    @property
    def start_is_clear(self) -> bool:
        """Whether the root keeps the state constraints and the clearance margin, as every step has to."""
        x, y, z = self.problem.start.position_enu_m
        free = clearance(x, y, z, self.problem.snapshot.obstacles, self.limits.margin + 1.0)
        return state_status(self.tree.state[0], self.limits) == OK and free >= self.limits.margin

    def scene(self) -> Scene:
        """Return the scene: all that the kernels read."""
        if self._scene is None:
            snapshot = self.problem.snapshot
            self._scene = Scene(
                pursuers=self.pursuers,
                obstacles=snapshot.obstacles,
                walls=snapshot.walls,
                threats=snapshot.threats,  # Radars that will be sensed from a sub goal are not known yet.
                model=self.model,
                limits=self.limits,
                tables=self.tables,
                search=self.problem.settings.search(
                    self.limits, snapshot.unit_m, 0.0, bars_pursued=self.bars_pursued
                ),
                distances=NO_DISTANCES,
                game=self.game,
            )
        return self._scene

    def _straight_to_goal(self) -> tuple[FloatArray, FloatArray]:
        """Return the start (2,) [m] and the ground velocity (2,) of a straight flight to the goal [m/s]."""
        problem = self.problem
        here = np.asarray(problem.start.position_enu_m[:2])
        way = np.asarray(problem.goals[0].position_enu_m[:2]) - here
        air = problem.vehicle.airspeed_cruise_m_s * way / max(float(np.hypot(*way)), 1.0)
        return here, air + problem.snapshot.wind_enu_m_s

    def _limits_at(self, airspeed_m_s: float) -> Limits:
        """Return the limits of motion at an airspeed [m/s], at least the cruise airspeed."""
        problem, world = self.problem, self.problem.snapshot
        margin_m, tau_s = problem.settings.clearance_min_m, problem.settings.tau_s
        return problem.vehicle.at_speed(airspeed_m_s).limits(
            world.dimension, world.bounds, margin_m, tau_s, world.wind_enu_m_s, problem.start.airspeed_m_s
        )

    def start_afresh(self, airspeed_m_s: float) -> None:
        """Begin a new tree at the start, for one of :attr:`airspeeds_m_s`."""
        self.limits, self._scene = self._limits_at(airspeed_m_s), None
        self.reset_tree()

    def allow_threatened_nodes(self) -> None:
        """Begin a new tree that may also grow where a pursuer could threaten it."""
        self.bars_pursued, self._scene = False, None
        self.reset_tree()

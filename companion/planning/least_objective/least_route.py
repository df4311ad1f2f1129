"""The search for the path with the least objective J, where nothing pursues the aircraft."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.kernels.objective.best_first import (
    UNFINISHED,
    BestFirst,
    Cells,
    Nodes,
    Rules,
    grow_best_first,
)
from companion.kernels.objective.cost_to_go import CostField, Heap
from companion.kernels.objective.row_costs import Objective, longest_seen
from companion.planning.explore import Exploration
from companion.planning.least_objective.cost_field import cost_to_go_of
from companion.planning.least_objective.prices import objective_between
from companion.planning.optimise import short_cut
from companion.planning.route import Route, assess_route, cost_between, visits_goals
from companion.types.plan import SearchTrace

GOAL_SHARE = 0.75  # of a goal's radius, within which it counts as passed: the rest is the autopilot's
WEIGHTS = (1.15, 1.02, 1.5)  # of V: the first finds a path soon, the next a better one, the last is for mazes
EXTENDED_MOST = 20_000  # nodes, by each weight
BURST = 500  # nodes extended between two looks at the time
LEAST_GAIN_S = 1e-9  # of J, below which a short cut gains nothing
NODES, TABLE = 400_000, 2**20
NODES_EACH = 100  # rows of the tree for each node that may be extended


@dataclass(frozen=True, slots=True)
class Searched:
    """What a search has come to.

    Parameters
    ----------
    route : Route
        A path to the last goal.
    bound_s : float
        V at the start with its error taken off: no path costs less.
    trace : SearchTrace
        The last tree.
    num_nodes : int
        Nodes of all trees.
    """

    route: Route
    bound_s: float
    trace: SearchTrace
    num_nodes: int


def best_first_route(
    exploration: Exploration, objective: Objective, should_stop: Callable[[], bool]
) -> Searched | None:
    """Grow trees along V, each with a smaller weight of it, until time is over; the cheapest path of all.

    None where V leads to no goal, or no tree comes to the last one.

    Parameters
    ----------
    exploration : Exploration
        Has the start, and counts the work.
    objective : Objective
        What a path costs.
    should_stop : callable
        Asked between bursts whether the time is over.
    """
    cost_to_goals = cost_to_go_of(exploration.problem, objective)
    bound_s = cost_to_goals.bound_s(exploration.problem.start.position_enu_m)
    if math.isinf(bound_s):
        return None
    best: Route | None = None
    cheapest, num_nodes = math.inf, 0
    for weight in WEIGHTS:
        if best is not None and weight > WEIGHTS[0]:
            break
        tree = _Tree(exploration, objective, cost_to_goals.fine, weight)
        end = tree.grow(should_stop)
        num_nodes += tree.num_nodes
        if end >= 0 and tree.nodes.cost[end] < cheapest:
            cheapest, best = float(tree.nodes.cost[end]), tree.route_to(end)
        if should_stop():
            break
    if best is None:
        exploration.stats[3] = 0  # The search by sub tasks has all its iterations.
        return None
    return Searched(best, bound_s, tree.trace(), num_nodes)


def _empty_nodes(num: int) -> Nodes:
    """Room for so many nodes."""
    return Nodes(
        state=np.empty((num, 6)),
        parent=np.empty(num, dtype=np.int64),
        time=np.empty(num),
        cost=np.empty(num),
        turn=np.empty(num, dtype=np.int64),
        straight=np.empty(num),
        rate=np.empty((num, 2)),
        pace=np.empty(num, dtype=np.int64),
        stage=np.empty(num, dtype=np.int64),
        seen=np.empty(num),
        level=np.empty(num),
    )


class _Tree:
    """One tree.

    Parameters
    ----------
    exploration : Exploration
        Has its root, and counts the work.
    objective : Objective
        What a path costs.
    field : CostField
        V.
    weight : float
        Times which V counts.
    """

    def __init__(
        self, exploration: Exploration, objective: Objective, field: CostField, weight: float
    ) -> None:
        problem, root = exploration.problem, exploration.tree
        self._iterations_most = problem.settings.max_iterations
        num = min(NODES, NODES_EACH * self._iterations_most)
        self.nodes = nodes = _empty_nodes(num)
        nodes.state[0], nodes.time[0], nodes.rate[0] = root.state[0], root.time[0], 0.0
        nodes.turn[0], nodes.straight[0], nodes.parent[0] = root.turn[0], root.straight[0], -1
        nodes.cost[0], nodes.pace[0], nodes.stage[0], nodes.seen[0] = 0.0, 0, 0, 0.0
        nodes.level[0] = root.level[0]
        heap = Heap(np.zeros(num), np.zeros(num, dtype=np.int64))
        goals = [[*goal.position_enu_m, GOAL_SHARE * goal.acceptance_radius_m] for goal in problem.goals]
        self._search = BestFirst(
            nodes=nodes,
            cells=Cells(np.zeros(TABLE, dtype=np.int64), np.empty(TABLE), np.empty(TABLE)),
            heap=heap,
            sizes=np.ones(2, dtype=np.int64),
            field=field,
            objective=objective,
            rules=Rules(
                goals=np.array(goals, dtype=np.float64),
                paces=np.array([exploration.limits.v_cruise]),
                weight=weight,
                seen_max=problem.settings.seen_max_s,
            ),
            scene=exploration.scene(),
            work=exploration.work,
        )

    @property
    def num_nodes(self) -> int:
        """How many nodes it has."""
        return int(self._search.sizes[0])

    def grow(self, should_stop: Callable[[], bool]) -> int:
        """Grow to the last goal; the node there, or a negative number."""
        left, end = min(self._iterations_most, EXTENDED_MOST), UNFINISHED
        while end == UNFINISHED and left > 0:
            end = int(grow_best_first(self._search, min(BURST, left)))
            left -= BURST
            if should_stop():
                break
        return end

    def route_to(self, end: int) -> Route:
        """The path from the root to a node."""
        rows: list[int] = []
        while end >= 0:
            rows.append(end)
            end = int(self.nodes.parent[end])
        index = np.array(rows[::-1])
        return Route(self.nodes.state[index], self.nodes.time[index], self.nodes.rate[index])

    def trace(self) -> SearchTrace:
        """The tree for pictures."""
        num = self.num_nodes
        return SearchTrace(
            tree_enu_m=self.nodes.state[:num, :3].copy(), tree_parents=self.nodes.parent[:num].copy()
        )


def _keeps_limits(exploration: Exploration, objective: Objective, route: Route) -> bool:
    """Whether a route keeps below the limits of time in sight, threat level and collisions."""
    settings = exploration.problem.settings
    if longest_seen(route.rows, len(route), objective.threats) > settings.seen_max_s:
        return False
    if settings.threat_level_max < 1.0 and math.isinf(cost_between(exploration, route)):
        return False
    if settings.quality_min == 0.0:
        return True
    return math.exp(-assess_route(exploration, route).log_risk()) >= settings.quality_min


def shortened_route(
    exploration: Exploration, objective: Objective, route: Route, should_stop: Callable[[], bool]
) -> tuple[Route, int]:
    """Replace stretches of a route by Dubins edges where that lowers J; the route, and how many were.

    Stretches are drawn at random, wide ones first.
    """
    problem, kept = exploration.problem, 0
    rounds = problem.settings.smooth_iterations
    for iteration in range(rounds):
        n = len(route)
        if n < 4 or should_stop():
            break
        widest = max(4, int(n * (1.0 - iteration / rounds)))
        i = int(exploration.rng.integers(0, n - 3))
        j = min(n - 1, i + 3 + int(exploration.rng.integers(0, widest)))
        cut = short_cut(exploration, route, i, j)
        if cut is None or not visits_goals(cut[0].states, problem.goals):
            continue
        gain_s = objective_between(objective, route, i + 1) - objective_between(objective, cut[0], i + 1)
        if gain_s > LEAST_GAIN_S and _keeps_limits(exploration, objective, cut[0]):
            route, kept = Route.of(cut[0].rows, len(cut[0])), kept + 1
    return route, kept

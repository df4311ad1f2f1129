"""A tree that grows best first along V."""

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
    node_nearest_to_goal,
)
from companion.kernels.objective.cost_to_go import CostField, Heap
from companion.kernels.objective.row_costs import Objective
from companion.planning.explore import Exploration
from companion.planning.route import Route
from companion.types.plan import SearchTrace

# A goal counts as passed within this share of its radius: the rest is the autopilot's error.
GOAL_SHARE = 0.75
LEAST_EXTENDED = 2_000  # Nodes that are extended even if the time is over; they take about 10 ms.
BEYOND_GOAL = 30  # After so many extended nodes beyond a goal, those before it come last.
BURST = 500  # Nodes that are extended between two checks of the time.
MOTIONS = 9  # A node is extended by at most this many motions, each to a cell.
# Room of the tree: rows for each extended node and each step of a motion.
ROWS_EACH = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthRules:
    """The rules by which a tree grows.

    Parameters
    ----------
    weight : float
        Factor by which V is multiplied.
    danger_max : float
        Most danger from pursuers at which a place may be passed.
    most : int
        How many nodes may be extended for each goal.
    cost_max : float
        A path that costs this much or more is not sought [s].
    stride : int
        How many steps a motion has at least. A cell is as long, and keeps one node.
    """

    weight: float
    danger_max: float
    most: int
    cost_max: float = math.inf
    stride: int = 1


class ObjectiveTree:
    """A tree that grows best first along V.

    Parameters
    ----------
    exploration : Exploration
        Has its root, and counts the work; left at the airspeed that is flown.
    objective : Objective
        What a path costs.
    field : CostField
        V.
    rules : GrowthRules
        How it is grown.

    Attributes
    ----------
    end : int
        The node at the last goal; negative while there is none.
    """

    def __init__(
        self,
        exploration: Exploration,
        objective: Objective,
        field: CostField,
        rules: GrowthRules,
    ) -> None:
        problem, root = exploration.problem, exploration.tree
        self._most = min(rules.most * len(problem.goals), problem.settings.max_iterations)
        self.end = UNFINISHED
        num = ROWS_EACH * rules.stride * (self._most + 1)
        self.nodes = nodes = _empty_nodes(num)
        nodes.state[0], nodes.time[0], nodes.rate[0] = root.state[0], root.time[0], 0.0
        nodes.turn[0], nodes.straight[0], nodes.parent[0] = root.turn[0], root.straight[0], -1
        nodes.cost[0], nodes.stage[0], nodes.seen[0] = 0.0, 0, 0.0
        nodes.level[0] = root.level[0]
        size = 1 << (MOTIONS * self._most).bit_length()  # More cells than the tree can have.
        goals = [[*goal.position_enu_m, GOAL_SHARE * goal.acceptance_radius_m] for goal in problem.goals]
        self._search = BestFirst(
            nodes=nodes,
            cells=Cells(np.zeros(size, dtype=np.int64), np.empty(size), np.empty(size)),
            heap=Heap(np.zeros(num), np.zeros(num, dtype=np.int64)),
            sizes=np.ones(2, dtype=np.int64),
            extended=np.zeros(len(goals), dtype=np.int64),
            field=field,
            objective=objective,
            rules=Rules(
                goals=np.array(goals, dtype=np.float64),
                weight=rules.weight,
                seen_max=problem.settings.seen_max_s,
                danger_max=rules.danger_max,
                cost_max=rules.cost_max,
                stride=rules.stride,
                beyond=BEYOND_GOAL,
            ),
            scene=exploration.scene(),
            work=exploration.work,
        )

    @property
    def num_nodes(self) -> int:
        """Number of nodes of the tree."""
        return int(self._search.sizes[0])

    @property
    def cost_s(self) -> float:
        """J of the path; infinite where none was found."""
        return float(self.nodes.cost[self.end]) if self.end >= 0 else math.inf

    def grow(self, should_stop: Callable[[], bool]) -> None:
        """Grow to the last goal, or until time is over and :data:`LEAST_EXTENDED` nodes are extended."""
        extended = 0
        while self.end == UNFINISHED and extended < self._most:
            self.end = int(grow_best_first(self._search, min(BURST, self._most - extended)))
            extended += BURST
            if extended >= LEAST_EXTENDED and should_stop():
                break

    def route(self) -> Route:
        """Return the path to the last goal, or to the node with the least V."""
        node = self.end if self.end >= 0 else int(node_nearest_to_goal(self._search))
        rows: list[int] = []
        while node >= 0:
            rows.append(node)
            node = int(self.nodes.parent[node])
        index = np.array(rows[::-1])
        return Route(self.nodes.state[index], self.nodes.time[index], self.nodes.rate[index])

    def trace(self) -> SearchTrace:
        """Return the tree for pictures."""
        num = self.num_nodes
        return SearchTrace(
            tree_enu_m=self.nodes.state[:num, :3].copy(), tree_parents=self.nodes.parent[:num].copy()
        )


def _empty_nodes(num: int) -> Nodes:
    """Return room for ``num`` nodes."""
    return Nodes(
        state=np.empty((num, 6)),
        parent=np.empty(num, dtype=np.int64),
        time=np.empty(num),
        cost=np.empty(num),
        turn=np.empty(num, dtype=np.int64),
        straight=np.empty(num),
        rate=np.empty((num, 2)),
        stage=np.empty(num, dtype=np.int64),
        seen=np.empty(num),
        level=np.empty(num),
    )

"""The PathTree's links, and the update of nodes below a changed one.

Symbols: ``i`` a node's row, ``up`` its parent, ``c`` a child.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.motion import distance_to, slowness, straight_after
from companion.kernels.arrays import Branches, Float1D, Int1D, Limits, Scene, Tree
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.search.growth import next_stage, renew_covariance
from companion.kernels.search.path_edit import breaks_turn_rule
from companion.kernels.workspace import FilterScratch, Walk

SETTLED = 1e-4  # If δ_q changes by less than this, the nodes below keep their covariance.


@inlined
def attach_child(tree: Tree, branches: Branches, i: int) -> None:
    """Enter node ``i`` among its parent's children."""
    up = tree.parent[i]
    branches.following[i] = branches.first[up]
    branches.first[up] = i


@kernel
def detach_child(tree: Tree, branches: Branches, i: int) -> None:
    """Take node ``i`` from its parent's children."""
    up = tree.parent[i]
    tree.children[up] -= 1
    c = branches.first[up]
    if c == i:
        branches.first[up] = branches.following[i]
        return
    while branches.following[c] != i:
        c = branches.following[c]
    branches.following[c] = branches.following[i]


@kernel
def enter(tree: Tree, branches: Branches, i: int) -> None:
    """Enter a new node: its place among the branches, its bounds and goals passed."""
    branches.first[i], branches.upper[i] = -1, math.inf
    up = tree.parent[i]
    branches.stage[i] = next_stage(
        branches.stage[up], tree.state[i, 0], tree.state[i, 1], tree.state[i, 2], branches.goals
    )
    attach_child(tree, branches, i)


@kernel
def enter_below(tree: Tree, branches: Branches, root: int) -> None:
    """Enter all nodes of a tree that was not rearranged yet; what is below ``root`` alone is searched."""
    for i in range(tree.count[0]):
        tree.active[i] = 0
    tree.active[root] = 1
    for i in range(1, tree.count[0]):  # parents come before children until rewiring begins
        up = tree.parent[i]
        attach_child(tree, branches, i)
        x, y, z = tree.state[i, 0], tree.state[i, 1], tree.state[i, 2]
        branches.stage[i] = next_stage(branches.stage[up], x, y, z, branches.goals)
        if i != root:
            tree.active[i] = tree.active[up]


@kernel
def activate(tree: Tree, centre: Float1D, horizon: float, end: int, root: int, below: Int1D) -> None:
    """Search ``end``, and the nodes below ``root`` within ``horizon`` metres of ``centre`` (3,) [m].

    Other branches have not passed the goals before ``root``. ``below`` (N,) is overwritten.
    """
    for i in range(tree.count[0]):
        tree.active[i] = 1 if distance_to(tree.state[i], centre) <= horizon else 0
        if root > 0:  # parents come before children
            below[i] = 1 if i == root or (i > root and below[tree.parent[i]] == 1) else 0
            tree.active[i] *= below[i]
    tree.active[end] = 1


@kernel
def path_to(tree: Tree, root: int, goal: int, path: Int1D) -> int:
    """Write the nodes from the goal back to ``root`` to ``path`` (P,); return how many there are."""
    n, i = 0, goal
    while n < path.shape[0]:
        path[n] = i
        n += 1
        if i == root:
            break
        i = tree.parent[i]
    return n


@kernel
def remove_below(tree: Tree, branches: Branches, top_node: int, stack: Int1D) -> int:
    """Remove a node and all below it from the search; return how many. ``stack`` (N,) is overwritten."""
    detach_child(tree, branches, top_node)
    stack[0], top, n = top_node, 1, 0
    while top > 0:
        top -= 1
        i = stack[top]
        tree.active[i] = 0
        n += 1
        c = branches.first[i]
        while c >= 0:
            stack[top] = c
            top += 1
            c = branches.following[c]
    return n


@kernel
def still_time(tree: Tree, i: int, limits: Limits) -> float:
    """Return the duration of the edge to node ``i`` in still air [s]."""
    parent = tree.parent[i]
    taken = tree.time[i] - tree.time[parent]
    return taken / slowness(tree.state[parent], tree.state[i], limits)


@kernel
def keeps_turn_rule_below(
    tree: Tree, branches: Branches, b: int, turn: int, straight: float, limits: Limits, walk: Walk
) -> bool:
    """Return whether all edges below ``b`` stay flyable when it is reached after another turn.

    The walk goes down as far as the change matters: not past ``sl_min`` of straight flight, or past a turn.
    """
    stack, turns, straights = walk.stack, walk.turns, walk.lengths
    stack[0], top = b, 1
    turns[0], straights[0] = turn, straight
    while top > 0:
        top -= 1
        i, turn, straight = stack[top], turns[top], straights[top]
        c = branches.first[i]
        while c >= 0:
            w = tree.rate[c, 0]
            if breaks_turn_rule(turn, straight, w, limits):
                return False
            length = still_time(tree, c, limits) * 0.5 * (tree.state[c, 5] + tree.state[i, 5])
            after, flown = straight_after(turn, straight, w, length)
            enough = limits.straight_min
            if after != tree.turn[c] or min(flown, enough) != min(tree.straight[c], enough):
                if top + 1 >= stack.shape[0]:
                    return False
                stack[top], turns[top], straights[top] = c, after, flown
                top += 1
            c = branches.following[c]
    return True


@kernel
def shift_below(
    tree: Tree,
    branches: Branches,
    b: int,
    cost: float,
    time: float,
    scene: Scene,
    walk: Walk,
    scratch: FilterScratch,
) -> None:
    """Carry a change of cost and time stamp at ``b`` to all nodes below it.

    The turn rule and the covariance change with it. The filter forgets its start: from a node on whose δ_q
    hardly changes, all nodes below keep their covariance.
    """
    stack, felt = walk.stack, walk.felt
    stack[0], felt[0], top = b, 1, 1
    while top > 0:
        top -= 1
        i, renew = stack[top], felt[top]
        c = branches.first[i]
        while c >= 0:
            tree.cost[c] += cost
            tree.time[c] += time
            dt = still_time(tree, c, scene.limits)
            length = dt * 0.5 * (tree.state[c, 5] + tree.state[i, 5])
            tree.turn[c], tree.straight[c] = straight_after(
                tree.turn[i], tree.straight[i], tree.rate[c, 0], length
            )
            stack[top], felt[top] = c, 0
            if renew == 1 and change_of_delta(tree, i, c, dt, scene, scratch) > SETTLED:
                felt[top] = 1
            top += 1
            c = branches.following[c]


@kernel
def change_of_delta(
    tree: Tree, parent: int, i: int, dt: float, scene: Scene, scratch: FilterScratch
) -> float:
    """Renew δ_q of node ``i`` after an edge of ``dt`` seconds; return its change."""
    control = ((tree.state[i, 5] - tree.state[parent, 5]) / dt, tree.rate[i, 0], tree.rate[i, 1])
    old = tree.delta[i]
    renew_covariance(
        tree, parent, i, control, dt, scene.tables, scene.limits.dimension, scene.search.unit, scratch
    )
    return abs(tree.delta[i] - old)

"""The choice of the PathTree's node to which a sample is joined (paper 4.4.1).

Symbols: ``q_s`` a sample, ``k`` how many near nodes are compared.

References
----------
Karaman, Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 30(7), 2011 (k-nearest).
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Search, Tree
from companion.kernels.native.kernel import kernel
from companion.kernels.printed.grid_index import keep
from companion.kernels.search.costs import cost_distance, turn_cost
from companion.kernels.workspace import MAX_K, KNearest, ThreatScene

NONE, OUTSIDE = -1, -2  # no node is searched; the sample is in no near node's domain


@kernel
def near_nodes(tree: Tree, q_s: Float1D, k: int, near: KNearest) -> int:
    """Find the ``k`` searched nodes nearest to ``q_s`` (≥ 3,) [m], nearest first; return how many."""
    state, active, squares = tree.state, tree.active, near.squares
    x, y, z = q_s[0], q_s[1], q_s[2]
    found = 0
    for i in range(tree.count[0]):
        if active[i] == 0:
            continue
        d2 = (state[i, 0] - x) ** 2 + (state[i, 1] - y) ** 2 + (state[i, 2] - z) ** 2
        if found < k or d2 < squares[k - 1]:
            found = keep(near, found, k, d2, i)
    return found


@kernel
def num_near(n: int, dimension: int) -> int:
    """Number of neighbours, max(3, ceil(e·(1 + 1/d)·ln n)), of a tree of n nodes."""
    return min(MAX_K, max(3, int(math.ceil(math.e * (1.0 + 1.0 / dimension) * math.log(max(n, 2))))))


@kernel
def choose_node(
    tree: Tree, q_s: Float1D, search: Search, dimension: int, threats: ThreatScene, nearest: KNearest
) -> int:
    """Return the node of least cost distance to ``q_s`` (3,) [m] among the k nearest searched nodes.

    k is :func:`num_near`, or 1 without the k-near strategy. ``NONE``
    where no node is searched, ``OUTSIDE`` where the sample lies in the domain of none of the k: it
    would be dropped whichever was chosen.
    """
    squares, near = nearest.squares, nearest.rows
    k = num_near(tree.count[0], dimension) if search.use_k_near == 1 else 1
    found = near_nodes(tree, q_s, k, nearest)
    if found == 0:
        return NONE
    inside = False
    for m in range(found):
        inside = inside or squares[m] <= tree.domain[near[m]] ** 2
    if not inside:
        return OUTSIDE
    if search.use_k_near == 0:
        return int(near[0])
    best, chosen = math.inf, -1
    for m in range(found):
        i = near[m]
        bound = search.cost_distance * math.sqrt(squares[m]) / search.unit
        if bound >= best:
            break  # nodes come by distance, which bounds their cost from below
        if bound + search.cost_turn * turn_cost(tree.state[i], q_s[0], q_s[1], q_s[2]) >= best:
            continue
        cost = cost_distance(tree, i, q_s[0], q_s[1], q_s[2], search, threats)
        if cost < best:
            best, chosen = cost, i
    return int(chosen)

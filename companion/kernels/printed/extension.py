"""One step from a node of the tree towards a sample (paper 4.4.1)."""

from __future__ import annotations

from companion.kernels.aircraft.motion import OK, advance, distance_to, state_status, steer
from companion.kernels.arrays import Float1D, Int1D, Limits, Obstacles, Tree
from companion.kernels.native.kernel import kernel
from companion.kernels.search.growth import is_edge_clear
from companion.kernels.workspace import Step

DROPPED, BLOCKED, LEFT_HORIZON, REPEATED, EXTENDED = 0, 1, 2, 3, 4
MAX_DESCENT = 8  # Children that are followed if the control towards a sample was tried before.


@kernel
def child_by(tree: Tree, i: int, w: float, wp: float) -> int:
    """The child node ``i`` already has by the same control, or -1."""
    if tree.children[i] > 0:
        for c in range(i + 1, tree.count[0]):
            if tree.parent[c] == i and abs(tree.rate[c, 0] - w) < 1e-6 and abs(tree.rate[c, 1] - wp) < 1e-6:
                return c
    return -1


@kernel
def extend(
    tree: Tree, i: int, q_s: Float1D, centre: Float1D, horizon: float, obstacles: Obstacles,
    limits: Limits, step: Step, stats: Int1D,
) -> int:  # fmt: skip
    """Take a step from node ``i`` towards ``q_s`` (3,) [m]; return ``EXTENDED``, or why it failed.

    It stays within ``horizon`` metres of ``centre`` (3,) [m]. ``stats`` (4,): the first counts collision
    checks (NCDC).
    """
    control, out = step.control, step.state
    state = tree.state[i]
    a, w, wp = steer(state, tree.turn[i], tree.straight[i], q_s[0], q_s[1], q_s[2], limits)
    control[0], control[1], control[2] = a, w, wp
    if child_by(tree, i, w, wp) >= 0:
        return REPEATED
    advance(state, a, w, wp, limits.tau, out)
    if state_status(out, limits) != OK:
        return BLOCKED
    away = (out[0] - centre[0]) ** 2 + (out[1] - centre[1]) ** 2 + (out[2] - centre[2]) ** 2
    if away > horizon * horizon:
        return LEFT_HORIZON
    stats[0] += 1
    return EXTENDED if is_edge_clear(state, out, w, obstacles, limits) else BLOCKED


@kernel
def extend_or_descend(
    tree: Tree, q_n: int, q_s: Float1D, centre: Float1D, horizon: float, obstacles: Obstacles,
    limits: Limits, step: Step, stats: Int1D,
) -> tuple[int, int]:  # fmt: skip
    """Extend a node, or a child that was made by the same control; return the node and the outcome.

    ``q_s`` (3,) the sample and ``centre`` (3,) of the horizon [m]; ``stats`` (4,) as there.
    """
    outcome = REPEATED
    for _ in range(MAX_DESCENT + 1):
        outcome = extend(tree, q_n, q_s, centre, horizon, obstacles, limits, step, stats)
        if outcome != REPEATED:
            break
        child = child_by(tree, q_n, step.control[1], step.control[2])
        if tree.active[child] == 0 or distance_to(tree.state[child], q_s) > tree.domain[child]:
            break
        q_n = child
    return q_n, outcome

"""TreeExplore: the threat- and uncertainty-based dynamic-domain RRT (paper 4.4.1, formulas (7), (9)).

Symbols: ``q_s`` a sample, ``q_n`` the node extended, ``i`` a node's row.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.motion import OK, advance, distance_to, state_status, steer, straight_after
from companion.kernels.arrays import Float1D, Float2D, Int1D, Limits, Scene, Tree
from companion.kernels.geometry.distance_field import distance_to_go, draw_ahead
from companion.kernels.geometry.line_of_sight import line_blocked
from companion.kernels.native.kernel import kernel
from companion.kernels.printed.extension import BLOCKED, EXTENDED, extend_or_descend
from companion.kernels.printed.near_nodes import NONE, OUTSIDE, choose_node
from companion.kernels.search.costs import threats_at
from companion.kernels.search.growth import domain_radius, grow, is_edge_clear
from companion.kernels.threat.fuzzy_threat import point_threat
from companion.kernels.workspace import MAX_STRAIGHT, Straight, Workspace

RUNNING, REACHED, FULL = 0, 1, 2
TURN_STEPS = 12  # Most steps for which a greedy connection turns towards the sub goal.


@kernel
def draw_sample(
    draws: Float1D, zoom: float, centre: Float1D, horizon: float, sub_goal: Float1D, nearest: float,
    limits: Limits, q_s: Float1D,
) -> None:  # fmt: skip
    """A sample in the horizon, or (GoalZoom) in the ball about the sub goal, into ``q_s`` (3,) [m].

    Uniform in the disc (radius by the square root); in space its height is uniform over the wedge
    that climb and descent angle leave from the origin, within the ball: what lies outside cannot be
    flown to in this horizon. ``draws`` (≥ 4,) uniform numbers; ``centre`` (3,) of the horizon and
    ``sub_goal`` (3,) [m].
    """
    zooming = draws[0] < zoom
    radius = nearest if zooming else horizon
    r = radius * math.sqrt(draws[1])
    angle = 2.0 * math.pi * draws[2]
    b = limits.bounds
    origin = sub_goal if zooming else centre
    q_s[0] = min(b[1], max(b[0], origin[0] + r * math.cos(angle)))
    q_s[1] = min(b[3], max(b[2], origin[1] + r * math.sin(angle)))
    q_s[2] = origin[2]
    if limits.dimension == 3:
        up, down = limits.climb_max, limits.descent_max
        if zooming:  # towards the sub goal the wedge opens backwards
            up, down = down, up
        high, low = math.tan(up) * r, -math.tan(down) * r
        q_s[2] = min(b[5], max(b[4], origin[2] + low + draws[3] * (high - low)))


@kernel
def greedy_connect(
    tree: Tree, scene: Scene, i: int, centre: Float1D, horizon: float, sub_goal: Float1D,
    straight: Straight, stats: Int1D,
) -> int:  # fmt: skip
    """Steps from node ``i`` to the sub goal, each with the sub goal in its domain; 0 where there are none.

    ``Greedy-Connect`` (paper 3.2.2) for the aircraft: what (7) allows one step it allows the next. The
    domain is judged from the threat at the step itself. ``centre`` (3,) of the horizon and
    ``sub_goal`` (3,) [m]; ``stats`` (4,): the first counts collision checks.
    """
    limits, search = scene.limits, scene.search
    gx, gy, gz = sub_goal[0], sub_goal[1], sub_goal[2]
    left = distance_to(tree.state[i], sub_goal)
    if left > tree.domain[i] or left <= search.tolerance:
        return 0
    stats[0] += 1
    x, y, z = tree.state[i, 0], tree.state[i, 1], tree.state[i, 2]
    if line_blocked(x, y, z, gx, gy, gz, scene.obstacles):
        return 0
    most = min(MAX_STRAIGHT, int(left / (limits.v_min * limits.tau)) + TURN_STEPS)
    turn, flown, state = tree.turn[i], tree.straight[i], tree.state[i]
    threats = threats_at(scene, tree.threat_point[i], straight.threat)
    for k in range(most):
        out, control = straight.states[k], straight.controls[k]
        a, w, wp = steer(state, turn, flown, gx, gy, gz, limits)
        control[0], control[1], control[2] = a, w, wp
        advance(state, a, w, wp, limits.tau, out)
        if state_status(out, limits) != OK or distance_to(out, centre) > horizon:
            return 0
        stats[0] += 1
        if not is_edge_clear(state, out, w, scene.obstacles, limits):
            return 0
        left = distance_to(out, sub_goal)
        if left <= search.tolerance:
            return k + 1
        mu, nu = point_threat(out[0], out[1], out[2], out[3], out[4], out[5], tree.delta[i], threats)
        if left > domain_radius(1.0, max(0.0, mu - nu), 0, search):
            return 0
        turn, flown = straight_after(turn, flown, w, limits.tau * 0.5 * (out[5] + state[5]))
        state = out
    return 0


@kernel
def grow_straight(
    tree: Tree, scene: Scene, i: int, steps: int, sub_goal: Float1D, draws: Float1D, work: Workspace
) -> tuple[int, float]:
    """Add the steps of a greedy connection as long as the sub goal lies in the last one's domain.

    Returns the last node and the least distance to the sub goal before it. ``sub_goal`` (3,) [m];
    ``draws`` (≥ 7,) uniform numbers.
    """
    nearest, straight, tau = math.inf, work.straight, scene.limits.tau
    for k in range(steps):
        left = distance_to(tree.state[i], sub_goal)
        nearest = min(nearest, left)
        if left > tree.domain[i]:
            break
        state, control = straight.states[k], straight.controls[k]
        added = grow(tree, scene, i, state, control, tau, draws, work.growth, work.stats)
        if added < 0:
            break
        i = added
    return i, nearest


@kernel
def enter_sub_task(tree: Tree, scene: Scene, sub_goal: Float1D) -> float:
    """Note each searched node's distance to go; return the least one to ``sub_goal`` (3,) [m]."""
    nearest = math.inf
    for i in range(tree.count[0]):
        if tree.active[i] == 1:
            nearest = min(nearest, distance_to(tree.state[i], sub_goal))
            tree.to_go[i] = distance_to_go(scene.distances, tree.state[i, 0], tree.state[i, 1])
    return nearest


@kernel
def explore(
    tree: Tree, scene: Scene, centre: Float1D, horizon: float, sub_goal: Float1D, draws: Float2D,
    work: Workspace,
) -> tuple[int, int]:  # fmt: skip
    """Grow the tree by one iteration a row of ``draws`` (M, DRAWS), until the sub goal is reached.

    Returns ``REACHED`` and the node, else ``RUNNING`` or ``FULL`` and -1. ``centre`` (3,) of the horizon
    and ``sub_goal`` (3,) [m]; ``work.stats`` counts.
    """
    search, distances, limits, obstacles = scene.search, scene.distances, scene.limits, scene.obstacles
    q_s, step, stats = work.sample, work.step, work.stats
    threats = threats_at(scene, work.points, work.growth.threat)
    nearest = enter_sub_task(tree, scene, sub_goal)
    for m in range(draws.shape[0]):
        if tree.count[0] + MAX_STRAIGHT >= tree.parent.shape[0]:
            return FULL, -1
        stats[3] += 1
        follows = draws[m, 0] > 1.0 - distances.share
        if not (follows and draw_ahead(draws[m], tree, distances, sub_goal, limits, q_s)):
            draw_sample(draws[m], search.zoom, centre, horizon, sub_goal, nearest, limits, q_s)
        q_n = choose_node(tree, q_s, search, limits.dimension, threats, work.near)
        if q_n == NONE:
            return RUNNING, -1
        if q_n == OUTSIDE or distance_to(tree.state[q_n], q_s) > tree.domain[q_n]:
            stats[1] += 1
            continue
        q_n, outcome = extend_or_descend(tree, q_n, q_s, centre, horizon, obstacles, limits, step, stats)
        if outcome == BLOCKED:
            stats[2] += 1
            tree.blocked[q_n] = 1
            tree.domain[q_n] = min(search.domain, tree.domain[q_n]) if search.use_domain == 1 else math.inf
        if outcome != EXTENDED:
            continue
        i = grow(tree, scene, q_n, step.state, step.control, limits.tau, draws[m], work.growth, stats)
        if i < 0:
            continue
        if search.straight_in == 1:
            steps = greedy_connect(tree, scene, i, centre, horizon, sub_goal, work.straight, stats)
            if steps > 0:
                i, passed = grow_straight(tree, scene, i, steps, sub_goal, draws[m], work)
                nearest = min(nearest, passed)
        away = distance_to(tree.state[i], sub_goal)
        nearest = min(nearest, away)
        if away <= search.tolerance:
            return REACHED, i
    return RUNNING, -1

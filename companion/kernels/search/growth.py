"""The growth of the PathTree by a node: the check of its edge, and the values of the node.

Symbols: ``q_n`` the node extended, ``i`` a node's row.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation, position_factor, propagate
from companion.kernels.aircraft.motion import (
    distance_to,
    slowness,
    straight_after,
)
from companion.kernels.arrays import (
    Float1D,
    Float2D,
    Int1D,
    Limits,
    Obstacles,
    Pursuers,
    Scene,
    Search,
    Tree,
    Uncertainty,
)
from companion.kernels.geometry.distance_field import distance_to_go
from companion.kernels.geometry.line_of_sight import sight_blocked
from companion.kernels.geometry.prism_distance import clearance, segment_clear
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.printed.intercept import EYE_M
from companion.kernels.printed.reachability import Estimator, estimate_reachability
from companion.kernels.printed.threat_tree import FLIES_ON
from companion.kernels.search.costs import cost_distance, threats_at, threats_when
from companion.kernels.threat.fuzzy_threat import node_threat
from companion.kernels.threat.pursuit_game import is_threatened
from companion.kernels.workspace import FilterScratch, GrowthScratch, ThreatScene

# Uniform random numbers of an extension; the paper's search draws its sample with some of them.
DRAWS = 16
LEAST_DOMAIN = 0.3  # Threat leaves at least this share of DD: with less, several DTs would stop the search.
LEAST_CLEAR = 1e-12  # A smaller p_c counts as this one.
FAR = 1.0e4  # Beyond this clearance p_c is 1 [m].


@kernel
def domain_radius(clear: float, level: float, blocked: int, search: Search) -> float:
    """TUDD of (7) [m].

    A node never blocked has no limit from DD alone: its uncertainty limits it only where p_c is
    below ``search.certain``, its threat wherever TI > 0.
    """
    if search.use_domain == 0:
        return math.inf
    radius = math.inf
    p_c = clear if search.use_uncertainty == 1 else 1.0
    if blocked == 1 or p_c < search.certain:
        radius = search.k_clear * p_c * search.domain
    if level > 0.0:
        radius = min(radius, max(search.domain / (search.k_threat * level), LEAST_DOMAIN * search.domain))
    return min(radius, search.domain) if blocked == 1 else radius


@kernel
def is_edge_clear(state: Float1D, out: Float1D, w: float, obstacles: Obstacles, limits: Limits) -> bool:
    """Return whether one step keeps the margin: its chord does, widened by the arc's sagitta.

    It leads from ``state`` (6,) to ``out`` (6,) at the turn rate ``w``.
    """
    sagitta = 0.125 * distance_to(state, out) * abs(w) * limits.tau
    return segment_clear(
        state[0], state[1], state[2], out[0], out[1], out[2], obstacles, limits.margin + sagitta
    )


@kernel
def assess(
    tree: Tree, i: int, dimension: int, search: Search, normals: Float2D, threats: ThreatScene,
    factor: Float2D, levels: Float1D,
) -> None:  # fmt: skip
    """Threat level and TUDD of a node, from its covariance and the DTs' present estimate.

    ``normals`` (M, 3): common standard-normal points; ``factor`` (3, 3), ``levels`` (M,) are overwritten.
    """
    here = threats_when(tree, i, threats)
    if search.use_uncertainty == 1:
        position_factor(tree.cov_error[i], tree.cov_estimate[i], dimension, factor)
        tree.level[i] = node_threat(tree.state[i], factor, tree.delta[i], normals, levels, here)
    else:
        factor[:] = 0.0
        tree.level[i] = node_threat(tree.state[i], factor, 0.0, normals[:1], levels, here)
    tree.domain[i] = domain_radius(tree.clear[i], tree.level[i], tree.blocked[i], search)
    if search.no_fly == 1:
        for d in range(threats.reach.shape[0]):
            if tree.threat_point[i, d, 3] > 0.0:
                tree.domain[i] = 0.0


@kernel
def renew_covariance(
    tree: Tree, parent: int, i: int, control: tuple[float, float, float], dt: float, tables: Uncertainty,
    dimension: int, unit: float, scratch: FilterScratch,
) -> float:  # fmt: skip
    """Compute P, Λ and δ_q of node ``i``, ``dt`` seconds after its parent; return its largest deviation [m].

    ``control`` a, w, wp; ``unit`` metres in a planning unit.
    """
    propagate(
        tree.state[parent], control, dt, tables, tree.cov_error[parent], tree.cov_estimate[parent],
        tree.cov_error[i], tree.cov_estimate[i], scratch,
    )  # fmt: skip
    deviation = position_deviation(tree.cov_error[i], tree.cov_estimate[i], dimension)
    tree.delta[i] = deviation / unit
    return deviation


@kernel
def add_node(
    tree: Tree, parent: int, state: Float1D, control: Float1D, dt: float, scene: Scene,
    scratch: FilterScratch,
) -> int:  # fmt: skip
    """Append a node with its time, turn rule, covariance and clearance; returns its row.

    ``state`` (6,) of the node, reached by ``control`` (3,) a, w, wp, which acts for ``dt``
    seconds in still air.
    """
    dimension = scene.limits.dimension
    i = tree.count[0]
    tree.count[0] = i + 1
    tree.state[i] = state
    tree.parent[i] = parent
    tree.children[parent] += 1
    tree.children[i] = 0
    tree.time[i] = tree.time[parent] + dt * slowness(tree.state[parent], state, scene.limits)
    tree.rate[i, 0], tree.rate[i, 1] = control[1], control[2]
    length = dt * 0.5 * (state[5] + tree.state[parent, 5])
    tree.turn[i], tree.straight[i] = straight_after(
        tree.turn[parent], tree.straight[parent], control[1], length
    )
    flown = (control[0], control[1], control[2])
    deviation = renew_covariance(
        tree, parent, i, flown, dt, scene.tables, dimension, scene.search.unit, scratch
    )
    free = clearance(state[0], state[1], state[2], scene.obstacles, FAR)
    tree.clear[i] = collision_free(free, deviation, dimension)
    tree.blocked[i] = 0
    tree.active[i] = 1
    tree.threat_point[i] = 0.0
    return int(i)


@inlined
def drop_last(tree: Tree, parent: int) -> None:
    """Take back the node added last."""
    tree.count[0] -= 1
    tree.active[tree.count[0]] = 0
    tree.children[parent] -= 1


@kernel
def inherit_threats(tree: Tree, i: int, parent: int, pursuers: Pursuers, walls: Obstacles) -> None:
    """A DT that could be somewhere for the parent can wait there for the child, if it sees it."""
    state, prisms = tree.state[i], walls
    for d in range(pursuers.model.shape[0]):
        point = tree.threat_point[parent, d]
        if (
            point[3] > 0.0
            and pursuers.model[d, 3] != FLIES_ON
            and not sight_blocked(point[0], point[1], point[2] + EYE_M, state[0], state[1], state[2], prisms)
        ):
            tree.threat_point[i, d] = point


@inlined
def collision_cost(search: Search, clear: float) -> float:
    """Return the cost of a node's p_c, ``clear``; over a path the sum is −log Q of (8), weighted."""
    if search.cost_collision == 0.0 or clear >= 1.0:
        return 0.0
    return -search.cost_collision * math.log(max(clear, LEAST_CLEAR))


@kernel
def next_stage(stage: int, x: float, y: float, z: float, goals: Float2D) -> int:
    """Goals passed at a point reached with ``stage`` of them passed; ``goals`` (G, 4) x y z radius [m]."""
    if stage < goals.shape[0]:
        g = goals[stage]
        if (x - g[0]) ** 2 + (y - g[1]) ** 2 + (z - g[2]) ** 2 <= g[3] * g[3]:
            return stage + 1
    return stage


@kernel
def grow(
    tree: Tree, scene: Scene, q_n: int, state: Float1D, control: Float1D, dt: float, draws: Float1D,
    scratch: GrowthScratch, stats: Int1D,
) -> int:  # fmt: skip
    """Add a node below ``q_n`` and all that is known of it (Algorithm 2, lines 9 to 16).

    Returns its row, or -1 where its threat level passes ``level_max``, or a DT could threaten it and such
    nodes are not grown; ways out of a threat already entered stay open. ``state`` (6,) of the node, reached
    by ``control`` (3,) a, w, wp, which acts for ``dt`` seconds; ``draws`` (≥ 7,) uniform numbers; ``stats``
    (4,): the third counts failed extensions.
    """
    search, dimension, normals = scene.search, scene.limits.dimension, scene.tables.normals
    factor, levels, changed = scratch.factor, scratch.levels, scratch.reach.changed
    i = add_node(tree, q_n, state, control, dt, scene, scratch.lqg)
    is_barred = search.bars_pursued == 1
    is_threatened_here = is_barred and is_threatened(scene.game, state[0], state[1], state[2], tree.time[i])
    tree.threatened[i] = 1 if is_threatened_here else 0
    if tree.threatened[i] > tree.threatened[q_n]:
        drop_last(tree, q_n)
        stats[2] += 1
        return -1
    inherit_threats(tree, i, q_n, scene.pursuers, scene.walls)
    num = estimate_reachability(
        tree, scene.pursuers, i, Estimator(search.estimator, search.p_tid, search.k_pursuer),
        scene.limits.bounds, draws[4:7], scene.walls, scratch.reach,
    )  # fmt: skip
    threats = threats_at(scene, tree.threat_point[i], scratch.threat)
    assess(tree, i, dimension, search, normals, threats, factor, levels)
    if tree.level[i] > search.level_max and tree.level[i] >= tree.level[q_n]:
        drop_last(tree, q_n)
        stats[2] += 1
        return -1
    for c in range(num):
        if changed[c] != i:
            assess(tree, changed[c], dimension, search, normals, threats, factor, levels)
    tree.cost[i] = tree.cost[q_n] + cost_distance(tree, q_n, state[0], state[1], state[2], search, threats)
    tree.cost[i] += collision_cost(search, tree.clear[i])
    tree.to_go[i] = distance_to_go(scene.distances, state[0], state[1])
    return i

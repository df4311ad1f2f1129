"""Safe-RRT's tree, grown best first along the cost-to-go field.

A node is a state with its time and the objective J so far. The node with the least ``J + weight·V`` is
extended by a few motions: a turn to either side or straight flight, in space with three climb angles, at
cruise or changing to it. A cell is a place, a direction and a turn. A node is dropped if another one in its
cell is as cheap and as early. V knows no limits on turns. With ``weight`` 1 the first node at the goal is the
best of the tree but for the cells and for V's error. With more it is found sooner and costs at most
``weight`` times as much. With several goals the turns at them make every path more expensive than V says, so
that the tree would grow through all states before each goal. So nodes before a goal come last as soon as some
nodes beyond it have been extended.

Symbols: ``at`` the node that is extended, ``v`` airspeed, ``w`` turn rate, ``wp`` climb rate.

References
----------
Dolgov, Thrun, Montemerlo, Diebel, "Path planning for autonomous vehicles in unknown semi-structured
environments", IJRR 29(5), 2010 (search over states guided by a field without turning limits).
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.dubins import distance_to_point
from companion.kernels.aircraft.motion import (
    OK,
    advance,
    slowness,
    state_status,
    straight_after,
    turn_radius,
)
from companion.kernels.arrays import Float1D, Float2D, Int1D, Limits, Scene
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.native.struct import Struct
from companion.kernels.objective.cost_to_go import CostField, Heap, cost_to_go, cost_to_go_on
from companion.kernels.objective.row_costs import SEEN, Objective, exposure, pursuit_danger, row_cost
from companion.kernels.printed.reachability import passes_by
from companion.kernels.printed.threat_tree import FLIES_ON
from companion.kernels.search.costs import threats_at
from companion.kernels.search.growth import is_edge_clear, next_stage
from companion.kernels.threat.fuzzy_threat import point_threat
from companion.kernels.threat.pursuit_game import pop_least, push
from companion.kernels.workspace import Workspace

DIRECTIONS, TURNS = 16, 3
STRAIGHT_STEPS = 2  # Fewest steps of a straight motion; longer motions need fewer nodes.
HEIGHT_CELLS = 0.5  # Height of a cell, as a share of a step.
NEAR_RADII = 6.0  # Turns count within this many turn radii of a goal.
EARLIER_S = 2.0  # A node that costs more than another in its cell is kept if it is this much earlier.
PRIME = 1_048_573  # The largest prime below 2^20: a cell's place in the table is its number modulo this.
LAST_S = 1e9  # Nodes that come last cost this much more in the queue.
EXHAUSTED, UNFINISHED, FULL = -1, -2, -3


class Nodes(Struct):
    """The tree, a row each.

    ``state`` (N, 6) x y z theta phi v; ``parent`` (N,) -1 at the root; ``time`` (N,) [s]; ``cost`` (N,) J
    from the root [s]; ``turn``, ``straight`` (N,) the turn flown last and the straight length since [m];
    ``rate`` (N, 2) turn and climb rate of the edge before it [rad/s]; ``stage`` (N,) goals passed; ``seen``
    (N,) unbroken time in radars' sight [s]; ``level`` (N,) TI, where that is limited.
    """

    state: Float2D
    parent: Int1D
    time: Float1D
    cost: Float1D
    turn: Int1D
    straight: Float1D
    rate: Float2D
    stage: Int1D
    seen: Float1D
    level: Float1D


class Cells(Struct):
    """A hash table of cells: ``keys`` (H,) 0 where free; the least ``cost`` (H,) and ``time`` (H,) there.

    H is a power of two.
    """

    keys: Int1D
    cost: Float1D
    time: Float1D


class Rules(Struct):
    """The rules by which the tree grows.

    ``goals`` (G, 4) x y z and the radius [m] within which each counts as passed; ``weight`` times which V
    counts; ``seen_max`` longest unbroken time in radars' sight [s]; ``danger_max`` most danger from pursuers
    (g of J) at which a place may be passed; ``cost_max`` a path that costs as much is not worth finding [s];
    ``stride`` how many steps a motion has at least, and a cell is long and wide; ``beyond`` after how many
    extended nodes beyond a goal those before it come last.
    """

    goals: Float2D
    weight: float
    seen_max: float
    danger_max: float
    cost_max: float
    stride: int
    beyond: int


class BestFirst(Struct):
    """A tree that is grown, and what it is grown by.

    ``sizes`` (2,) counts its nodes, and those queued in ``heap``; ``extended`` (G,) the nodes that were
    extended, by the goals that they had passed. Of ``work.stats`` the first counts
    collision checks and the fourth nodes that were extended.
    """

    nodes: Nodes
    cells: Cells
    heap: Heap
    sizes: Int1D
    extended: Int1D
    field: CostField
    objective: Objective
    rules: Rules
    scene: Scene
    work: Workspace


@inlined
def _cell(nodes: Nodes, i: int, limits: Limits, stride: int) -> int:
    """Number of the cell of node ``i``, from 1 on."""
    b, state = limits.bounds, nodes.state[i]
    side = stride * limits.v_cruise * limits.tau
    x, y = int((state[0] - b[0]) / side), int((state[1] - b[2]) / side)
    level = HEIGHT_CELLS * limits.v_cruise * limits.tau
    z = int((state[2] - b[4]) / level) if limits.dimension == 3 else 0
    theta = int(math.floor((state[3] / (2.0 * math.pi) + 1.0) * DIRECTIONS)) % DIRECTIONS
    place = ((x * 4096 + y) * 1024 + z) * DIRECTIONS + theta
    return (place * TURNS + nodes.turn[i] + 1) * 16 + nodes.stage[i] + 1


@inlined
def _slot(cells: Cells, key: int) -> int:
    """Return the slot of a cell in the table, or the free slot in which it belongs."""
    mask = cells.keys.shape[0] - 1
    at = (key % PRIME) & mask
    while cells.keys[at] != 0 and cells.keys[at] != key:
        at = (at + 1) & mask
    return at


@kernel
def fly_on(nodes: Nodes, first: int, at: int, way: int, phi: float, limits: Limits, rules: Rules) -> int:
    """Write one motion from node ``at`` to the rows from ``first`` on; return the last row.

    The answer is -1 if the motion breaks a limit. ``way`` turns left (1), right (-1) or flies straight (0);
    ``phi`` is the climb angle that is gone to [rad]. A turn has ``rules.stride`` steps; straight flight goes
    on until another turn may begin. The motion ends at the goal. Only states, rates, the turn rule and the
    goals passed are filled in.
    """
    tau, stage = limits.tau, nodes.stage[at]
    straight = nodes.straight[at] if nodes.turn[at] == 0 else 0.0
    if way != 0 and nodes.turn[at] != way and (nodes.turn[at] != 0 or straight < limits.straight_min - 1e-6):
        return -1
    steps = rules.stride
    if way == 0:
        left = limits.straight_min - straight
        steps = max(STRAIGHT_STEPS, steps, int(math.ceil(left / (nodes.state[at, 5] * tau) - 1e-6)))
    before = at
    for n in range(first, first + steps):
        here, out = nodes.state[before], nodes.state[n]
        a = min(limits.a_max, max(-limits.a_max, (limits.v_cruise - here[5]) / tau))
        slow, fast = min(here[5], here[5] + a * tau), max(here[5], here[5] + a * tau)
        w = way * slow * math.cos(here[4]) / turn_radius(fast, limits)
        wp = 0.0
        if limits.dimension == 3:
            wp = min(limits.pitch_rate_max, max(-limits.pitch_rate_max, (phi - here[4]) / tau))
        advance(here, a, w, wp, tau, out)
        if state_status(out, limits) != OK:
            return -1
        nodes.parent[n], nodes.rate[n, 0], nodes.rate[n, 1] = before, w, wp
        nodes.turn[n], nodes.straight[n] = straight_after(
            nodes.turn[before], nodes.straight[before], w, tau * 0.5 * (out[5] + here[5])
        )
        nodes.stage[n] = next_stage(stage, out[0], out[1], out[2], rules.goals)
        before = n
        if nodes.stage[n] > stage:
            break
    return before


@kernel
def level_at(out: Float1D, time: float, scene: Scene, work: Workspace) -> float:
    """Threat level of radars, and of aircraft that fly on, to the state ``out`` (6,).

    Pursuers are left out: ``danger_max`` keeps paths away from them.
    """
    trees = scene.pursuers
    for d in range(scene.pursuers.count.shape[0]):
        if scene.pursuers.model[d, 3] == FLIES_ON:
            passes_by(trees, d, out[0], out[1], out[2], time, work.points)
    threats = threats_at(scene, work.points, work.growth.threat)
    mu, nu = point_threat(out[0], out[1], out[2], out[3], out[4], out[5], 0.0, threats)
    return max(mu - nu, 0.0)


@kernel
def judge(search: BestFirst, first: int, last: int, at: int) -> bool:
    """Return whether rows ``first`` to ``last`` after node ``at`` keep all limits; set their times and J."""
    nodes, objective, scene, before = search.nodes, search.objective, search.scene, at
    limits, rules, level_max = objective.limits, search.rules, scene.search.level_max
    for n in range(first, last + 1):
        here, out = nodes.state[before], nodes.state[n]
        search.work.stats[0] += 1
        if not is_edge_clear(here, out, nodes.rate[n, 0], objective.obstacles, limits):
            return False
        dt = limits.tau * slowness(here, out, limits)
        nodes.time[n] = nodes.time[before] + dt
        danger = pursuit_danger(out[0], out[1], out[2], nodes.time[n], objective)
        if danger > rules.danger_max:
            return False
        nodes.cost[n] = nodes.cost[before] + row_cost(out, nodes.time[n], dt, danger, objective)
        nodes.seen[n] = 0.0
        if rules.seen_max < math.inf and exposure(out[0], out[1], out[2], objective.threats) >= SEEN:
            nodes.seen[n] = nodes.seen[before] + dt
        if nodes.seen[n] > rules.seen_max:
            return False
        nodes.level[n] = level_at(out, nodes.time[n], scene, search.work) if level_max <= 1.0 else 0.0
        if nodes.level[n] > level_max and nodes.level[n] >= nodes.level[before]:
            return False
        before = n
    return True


@kernel
def turning_share(state: Float1D, goal: Float1D, limits: Limits) -> float:
    """Return the length of the way to a near goal over the length that V assumes; at least 1.

    ``state`` (6,); ``goal`` (4,) x y z and the radius [m]. V knows no turns: without this the tree tries all
    ways past the goal, and back, that V takes for cheap. The way leads to the nearest of three places: the
    centre, and two lateral ones on the rim. Where the height takes longer than the way, it has a loop.
    """
    x, y, up, rho = goal[0] - state[0], goal[1] - state[1], goal[2] - state[2], turn_radius(state[5], limits)
    flat = math.hypot(x, y)
    if flat <= goal[3] or flat > NEAR_RADII * rho:
        return 1.0
    offset, least = goal[3] / flat, math.inf
    for side in range(-1, 2):
        gx, gy = goal[0] - side * offset * y, goal[1] + side * offset * x
        least = min(least, distance_to_point(state[0], state[1], state[3], gx, gy, rho))
    climbing = max(0.0, abs(up) - goal[3]) / math.tan(limits.climb_max if up > 0.0 else limits.descent_max)
    if climbing > least:
        least = max(climbing, least + 2.0 * math.pi * rho)
    return max(1.0, least / max(flat, climbing))


@kernel
def enter(search: BestFirst, last: int) -> bool:
    """Queue node ``last`` unless its cell has one that is as good; return whether it was queued."""
    nodes, cells, field, heap, sizes = search.nodes, search.cells, search.field, search.heap, search.sizes
    state, stage = nodes.state[last], nodes.stage[last]
    key = _cell(nodes, last, search.objective.limits, search.rules.stride)
    slot = _slot(cells, key)
    is_known = cells.keys[slot] != 0
    is_later = is_known and nodes.time[last] > cells.time[slot] - EARLIER_S
    if is_later and nodes.cost[last] >= cells.cost[slot]:
        return False
    left = cost_to_go_on(field, stage, state[0], state[1], state[2], state[3])
    left = left * turning_share(state, search.rules.goals[stage], search.objective.limits) + field.rest[stage]
    if nodes.cost[last] + left >= search.rules.cost_max:
        return False
    cells.cost[slot] = min(cells.cost[slot], nodes.cost[last]) if is_known else nodes.cost[last]
    cells.time[slot] = min(cells.time[slot], nodes.time[last]) if is_known else nodes.time[last]
    cells.keys[slot] = key
    order = nodes.cost[last] + search.rules.weight * left
    sizes[1] = push(heap.keys, heap.nodes, sizes[1], order, last)
    return True


@kernel
def extend_by_one(search: BestFirst, at: int, way: int) -> int:
    """Extend node ``at`` one way, with each climb angle; as :func:`grow_best_first`."""
    nodes, sizes, limits, goals = search.nodes, search.sizes, search.objective.limits, search.rules.goals
    longest = (
        STRAIGHT_STEPS + search.rules.stride + 2 + int(limits.straight_min / (limits.v_min * limits.tau))
    )
    for c in range(3 if limits.dimension == 3 else 1):
        phi = 0.0 if c == 0 else limits.climb_max if c == 1 else -limits.descent_max
        first = sizes[0]
        if first + longest >= nodes.parent.shape[0] or sizes[1] >= search.heap.keys.shape[0] - 1:
            return FULL
        last = fly_on(nodes, first, at, way, phi, limits, search.rules)
        if last < 0 or not judge(search, first, last, at):
            continue
        if nodes.stage[last] == goals.shape[0]:
            sizes[0] = last + 1
            return last
        if enter(search, last):
            sizes[0] = last + 1
    return UNFINISHED


@kernel
def grow_best_first(search: BestFirst, most: int) -> int:
    """Grow the tree until the last goal is reached; return the node there, or why there is none.

    :data:`EXHAUSTED` where no way leads there, :data:`FULL` where there is no room for more nodes,
    :data:`UNFINISHED` after ``most`` nodes were extended: then it goes on if it is called again.
    """
    heap, sizes, extended, num = search.heap, search.sizes, search.extended, 0
    while num < most:
        if sizes[1] == 0:
            return EXHAUSTED
        order, at = heap.keys[0], heap.nodes[0]
        sizes[1] = pop_least(heap.keys, heap.nodes, sizes[1])
        stage = search.nodes.stage[at]
        is_behind = stage + 1 < extended.shape[0] and extended[stage + 1] >= search.rules.beyond
        if is_behind and order < LAST_S:
            sizes[1] = push(heap.keys, heap.nodes, sizes[1], order + LAST_S, at)
            continue
        num += 1
        extended[stage] += 1
        search.work.stats[3] += 1
        for way in range(-1, 2):
            end = extend_by_one(search, at, way)
            if end != UNFINISHED:
                return end
    return UNFINISHED


@kernel
def node_nearest_to_goal(search: BestFirst) -> int:
    """Return the node from which V through all goals that are left is the least."""
    nodes, field = search.nodes, search.field
    best, nearest = math.inf, 0
    for i in range(search.sizes[0]):
        state, stage = nodes.state[i], nodes.stage[i]
        if stage < field.rest.shape[0]:
            left = cost_to_go(field, stage, state[0], state[1], state[2]) + field.rest[stage]
            if left < best:
                best, nearest = left, i
    return nearest

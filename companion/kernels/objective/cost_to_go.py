"""The cost-to-go field V: the least J from a place to a goal, without limits on turns.

V solves ``v·|∇V| − W·∇V + climbing = c`` on a grid, ``v`` the airspeed, ``W`` the wind and ``c`` the cost of
a second. An aircraft that climbs at most by the angle γ gains at most ``d·tan γ`` of height on ``d`` metres
of ground. In the norm ``max(flat distance, height / tan γ)`` a climb is free as long as there is way for it,
and beyond that a spiral. The dual of that norm gives the scheme below. Nodes are settled in the order of V,
each from its upwind neighbours by differences of the first or the second order (Sethian, "A fast marching
level set method", PNAS 93, 1996; "Fast marching methods", SIAM Review 41, 1999). V is too large by a share
of the spacing. That a climb makes the way longer is left out.

Symbols: ``i, j, k`` a node east, north, up; ``a, b, d`` V of its neighbours in these directions; ``s`` what
crossing the spacing costs [s]; ``w`` wind over airspeed.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, Float3D, Float4D, Int1D, Limits
from companion.kernels.geometry.ground_surface import over_ground
from companion.kernels.native.kernel import (
    inlined,
    inlined_numpy_errors,
    kernel,
    kernel_numpy_errors,
    local_floats,
)
from companion.kernels.native.struct import Struct
from companion.kernels.objective.row_costs import (
    Objective,
    collision_price,
    exposure,
    lack_of_clearance,
    prism_clearance_up_to,
)
from companion.kernels.threat.pursuit_game import pop_least, push

SETTLED_S = 1e-6  # A smaller change of V does not count.
LEAST_PART = 1e-6  # Each node has at least this weight, so that a point on a barred node has a value.
# This many spacings from its origin, the front is straight enough for second-order differences.
BENT_CELLS = 4.0
GOAL_CELLS = 1.5  # V begins at the nodes within this many spacings of the goal.


class CostField(Struct):
    """Fields over a grid.

    ``grid`` (6,) is x0 y0 z0 and the spacings [m]; ``floor`` (NX, NY) how much higher each column of nodes
    begins [m]; ``rate`` (NX, NY, NZ) what a second costs there, infinite where nothing flies;
    ``values`` (G·D, NX, NY, NZ) V of each goal [s], infinite where no way leads to it, for each of D
    directions of flight where it depends on them, else once; ``rest`` (G,) the V of all goals after it, each
    from the one before [s].
    """

    grid: Float1D
    floor: Float2D
    rate: Float3D
    values: Float4D
    rest: Float1D


class Heap(Struct):
    """A heap of nodes: ``keys`` (H,) what they are ordered by, ``nodes`` (H,) their numbers."""

    keys: Float1D
    nodes: Int1D


@inlined
def height_of(field: CostField, i: int, j: int, k: int) -> float:
    """Height of a node [m]."""
    return field.grid[2] + field.floor[i, j] + k * field.grid[5]


@kernel
def fill_rate(field: CostField, objective: Objective, enough: float) -> None:
    """Set ``field.rate`` to the cost of a second at cruise, without pursuers, at every node.

    Nothing depends on more clearance than ``enough`` [m].
    """
    grid, rate, obstacles = field.grid, field.rate, objective.obstacles
    prices, margin = objective.prices, objective.limits.margin
    for i in range(rate.shape[0]):
        x = grid[0] + i * grid[3]
        for j in range(rate.shape[1]):
            y = grid[1] + j * grid[4]
            for k in range(rate.shape[2]):
                z = height_of(field, i, j, k)
                from_prisms = prism_clearance_up_to(x, y, z, enough, obstacles)
                free = min(from_prisms, over_ground(x, y, z, obstacles.ground))
                if free < margin:
                    rate[i, j, k] = math.inf
                    continue
                cost = 1.0 + prices.near * lack_of_clearance(x, y, z, from_prisms, objective)
                if prices.seen > 0.0:
                    cost += prices.seen * exposure(x, y, z, objective.threats)
                cost += collision_price(free, objective.start, objective) / objective.limits.tau
                rate[i, j, k] = cost


@inlined_numpy_errors
def _upwind(value: Float3D, i: int, j: int, k: int) -> float:
    """Return V of a node; infinite outside the grid."""
    n, m, p = value.shape
    if i < 0 or j < 0 or k < 0 or i >= n or j >= m or k >= p:
        return math.inf
    return float(value[i, j, k])


@kernel_numpy_errors
def solved(a: float, b: float, d: float, wa: float, wb: float, climb: float, s: float) -> float:
    """Return V from the upwind neighbours ``a``, ``b`` and ``d``, any of which may be infinite.

    It solves ``√((V−a)⁺² + (V−b)⁺²) + wa·(V−a)⁺ + wb·(V−b)⁺ + climb·(V−d)⁺ = s`` where all neighbours that
    count lie below V. ``wa`` and ``wb`` are the wind's components towards them over the airspeed.
    """
    best = solved_flat(a, b, wa, wb, 0.0, 0.0, -math.inf, s)
    if climb > 0.0 and d < best:
        best = min(best, solved_flat(a, b, wa, wb, climb, climb * d, d, s), d + s / climb)
    return best


@kernel_numpy_errors
def solved_flat(
    a: float, b: float, wa: float, wb: float, climb: float, from_level: float, least: float, s: float
) -> float:
    """:func:`solved` with ``a``, ``b`` or both counting, and ``climb·V − from_level`` of the third.

    Only an answer of at least ``least`` and of all neighbours that count is one; else it is infinite.
    """
    best = math.inf
    if a < math.inf and b < math.inf:
        p, q = s + wa * a + wb * b + from_level, wa + wb + climb
        two, one, zero = 2.0 - q * q, p * q - a - b, a * a + b * b - p * p
        under = one * one - two * zero
        if two > 0.0 and under >= 0.0:
            found = (math.sqrt(under) - one) / two
            best = found if found >= max(a, b, least) else math.inf
    for side in range(2):
        near, wind = (a, wa) if side == 0 else (b, wb)
        if near < math.inf:
            found = (s + (1.0 + wind) * near + from_level) / (1.0 + wind + climb)
            best = min(best, found) if found >= max(near, least) else best
    return best


@inlined_numpy_errors
def _second_order_value(near: float, far: float, least: float) -> float:
    """Return the value that replaces two neighbours in a second-order difference; infinite without them.

    ``(3·V − 4·near + far) / 2`` is ``3/2`` times ``V`` less this. Where ``far`` is below ``least`` the front
    is too bent for it, so close to where V begins.
    """
    return near + (near - far) / 3.0 if least <= far <= near < math.inf else math.inf


@kernel_numpy_errors
def renewed(value: Float3D, i: int, j: int, k: int, s: float, pace: Float1D) -> float:
    """Return V of a node from its present neighbours, by first- or second-order differences.

    ``value`` (NX, NY, NZ) V so far [s]; ``s`` what crossing the spacing costs there [s]; ``pace`` (4,) the
    wind east and north over the airspeed, and the spacings climbed and sunk on the way of one. The lesser of
    the two is taken: those of the second order need two nodes on each side from which V comes.
    """
    wx, wy, least = pace[0], pace[1], BENT_CELLS * s
    west, east = _upwind(value, i - 1, j, k), _upwind(value, i + 1, j, k)
    south, north = _upwind(value, i, j - 1, k), _upwind(value, i, j + 1, k)
    below, above = _upwind(value, i, j, k - 1), _upwind(value, i, j, k + 1)
    vertical, climb, up = (below, pace[3], -1) if below <= above else (above, pace[2], 1)
    beyond = _second_order_value(vertical, _upwind(value, i, j, k + 2 * up), least)
    best = math.inf
    for side in range(4):
        a, wa, across = (west, -wx, -1) if side % 2 == 0 else (east, wx, 1)
        b, wb, along = (south, -wy, -1) if side < 2 else (north, wy, 1)
        if wx == 0.0 and wy == 0.0 and (a > min(west, east) or b > min(south, north)):
            continue
        best = min(best, solved(a, b, vertical, wa, wb, climb, s))
        a = _second_order_value(a, _upwind(value, i + 2 * across, j, k), least)
        b = _second_order_value(b, _upwind(value, i, j + 2 * along, k), least)
        best = min(best, solved(a, b, beyond, wa, wb, climb, s / 1.5))
        if wx == 0.0 and wy == 0.0:
            break
    return best


@kernel_numpy_errors
def begin_at(field: CostField, g: int, goal: Float1D, limits: Limits, heap: Heap) -> int:
    """Set V at goal ``g``, ``goal`` (≥ 3,) [m], and infinity elsewhere; return the heap's size."""
    grid, value, size = field.grid, field.values[g], 0
    value[:] = math.inf
    slope = math.tan(limits.climb_max)
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            flat = math.hypot(grid[0] + i * grid[3] - goal[0], grid[1] + j * grid[4] - goal[1])
            if flat > GOAL_CELLS * grid[3]:
                continue
            for k in range(value.shape[2]):
                up = abs(height_of(field, i, j, k) - goal[2]) if value.shape[2] > 1 else 0.0
                if up > GOAL_CELLS * grid[5] or math.isinf(field.rate[i, j, k]):
                    continue
                away = max(flat, up / slope) if up > 0.0 else flat
                value[i, j, k] = field.rate[i, j, k] * away / limits.v_cruise
                number = (i * value.shape[1] + j) * value.shape[2] + k
                size = push(heap.keys, heap.nodes, size, value[i, j, k], number)
    return size


@kernel_numpy_errors
def fill_cost_to_go(field: CostField, g: int, goal: Float1D, limits: Limits, heap: Heap) -> int:
    """Set V of goal ``g`` at every node that is connected with it; return the number of these nodes.

    ``goal`` (≥ 3,) is its centre [m].
    """
    value, grid, pace = field.values[g], field.grid, local_floats(4)
    slope, crossing = grid[3] / grid[5], grid[3] / limits.v_cruise
    pace[0], pace[1] = limits.wind_x / limits.v_cruise, limits.wind_y / limits.v_cruise
    pace[2], pace[3] = math.tan(limits.climb_max) * slope, math.tan(limits.descent_max) * slope
    size, num = begin_at(field, g, goal, limits, heap), 0
    while size > 0:
        key, node = heap.keys[0], heap.nodes[0]
        size = pop_least(heap.keys, heap.nodes, size)
        i, j, k = place_of(value, node)
        if key > value[i, j, k] + SETTLED_S:
            continue
        num += 1
        size = offer(value, field.rate, node, crossing, pace, heap, size)
    return num


@inlined
def place_of(value: Float3D, node: int) -> tuple[int, int, int]:
    """Return the node of a number in the grid of ``value`` (NX, NY, NZ)."""
    m, p = value.shape[1], value.shape[2]
    row = node // p
    return row // m, row % m, node % p


@inlined
def adjacent(i: int, j: int, k: int, side: int) -> tuple[int, int, int]:
    """Return the adjacent node on one of six sides of a node, the first four of them in the plane."""
    step = 1 - 2 * (side % 2)
    if side < 2:
        return i + step, j, k
    if side < 4:
        return i, j + step, k
    return i, j, k + step


@inlined
def is_inside(value: Float3D, i: int, j: int, k: int) -> bool:
    """Return whether a node lies in the grid of ``value`` (NX, NY, NZ)."""
    n, m, p = value.shape
    return 0 <= i < n and 0 <= j < m and 0 <= k < p


@kernel_numpy_errors
def offer(
    value: Float3D, rate: Float3D, node: int, crossing: float, pace: Float1D, heap: Heap, size: int
) -> int:  # fmt: skip
    """Renew the neighbours of a node that was settled; return the heap's new size.

    ``value`` and ``rate`` (NX, NY, NZ) as in :class:`CostField`; ``node`` is the node's number; ``crossing``
    is the time that crossing the spacing takes [s]; ``pace`` (4,) as in :func:`renewed`.
    """
    m, p = value.shape[1], value.shape[2]
    a, b, c = place_of(value, node)
    settled = value[a, b, c]
    for side in range(6 if p > 1 else 4):
        i, j, k = adjacent(a, b, c, side)
        if not is_inside(value, i, j, k):
            continue
        if value[i, j, k] <= settled or rate[i, j, k] == math.inf or size >= heap.keys.shape[0] - 1:
            continue
        found = renewed(value, i, j, k, rate[i, j, k] * crossing, pace)
        if found < value[i, j, k] - SETTLED_S:
            value[i, j, k] = found
            size = push(heap.keys, heap.nodes, size, found, (i * m + j) * p + k)
    return size


@kernel
def cost_to_go(field: CostField, g: int, x: float, y: float, z: float) -> float:
    """Return V of goal ``g`` at a point, the least of all directions; infinite if no path leads to it."""
    num = field.values.shape[0] // field.rest.shape[0]
    least = math.inf
    for layer in range(g * num, g * num + num):
        least = min(least, cost_at(field, layer, x, y, z))
    return least


@kernel
def cost_to_go_on(field: CostField, g: int, x: float, y: float, z: float, theta: float) -> float:
    """Return V of goal ``g`` at a point passed in direction ``theta`` [rad], interpolated between two."""
    num = field.values.shape[0] // field.rest.shape[0]
    if num == 1:
        return cost_at(field, g, x, y, z)
    turns = (theta / (2.0 * math.pi) * num) % num
    first = int(turns) % num
    after, share = (first + 1) % num, turns - int(turns)
    here = cost_at(field, g * num + first, x, y, z)
    there = cost_at(field, g * num + after, x, y, z)
    if math.isinf(here) or math.isinf(there):
        return min(here, there)
    return (1.0 - share) * here + share * there


@kernel
def cost_at(field: CostField, layer: int, x: float, y: float, z: float) -> float:
    """Interpolate a layer of ``field.values`` at a point between the connected nodes about it."""
    grid, value = field.grid, field.values[layer]
    n, m, p = value.shape
    u, v = (x - grid[0]) / grid[3], (y - grid[1]) / grid[4]
    i, j = min(n - 2, max(0, int(u))), min(m - 2, max(0, int(v)))
    u, v = min(1.0, max(0.0, u - i)), min(1.0, max(0.0, v - j))
    k, w, total, share = 0, 0.0, 0.0, 0.0
    for corner in range(8 if p > 1 else 4):
        du, dv, dw = corner & 1, (corner >> 1) & 1, corner >> 2
        if p > 1:
            w = (z - height_of(field, i + du, j + dv, 0)) / grid[5]
            k = min(p - 2, max(0, int(w)))
            w = min(1.0, max(0.0, w - k))
        at = value[i + du, j + dv, k + dw]
        if at == math.inf:
            continue
        part = (u if du == 1 else 1.0 - u) * (v if dv == 1 else 1.0 - v)
        if p > 1:
            part *= w if dw == 1 else 1.0 - w
        part = max(part, LEAST_PART)
        total += part * at
        share += part
    return total / share if share > 0.0 else math.inf

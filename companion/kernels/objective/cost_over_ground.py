"""The cost-to-go field V over ground between a lowest and a highest height.

There the nodes of a column begin at the lowest height over its ground. Slopes may be steeper than the
aircraft climbs, and valleys too narrow to turn in, so that V depends on the direction of flight. It is the
cheapest way over a graph of nodes and eight directions. A step leads one column on,
after a turn of an eighth at most, to each level that is not too steep for it.

Ways in eight directions are too long by up to 8 %. This is taken off, so that V errs on the low side.

References
----------
Dial, "Algorithm 360: shortest-path forest with topological ordering", Communications of the ACM 12, 1969.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Int1D, Limits
from companion.kernels.native.kernel import inlined, kernel_numpy_errors, local_floats
from companion.kernels.native.struct import Struct
from companion.kernels.objective.cost_to_go import (
    SETTLED_S,
    CostField,
    Heap,
    begin_at,
    height_of,
    is_inside,
    place_of,
)

DIRECTIONS = 8
SHORTENED = 0.924  # cos(22.5°): no way is longer in eight directions by more than its inverse.
BITS = 20  # There are fewer nodes along each axis than 2 to the power of this.
STEEPER = 1.1  # A step may be steeper than a climb by this factor: a flight need not begin at the nodes.


class Buckets(Struct):
    """A queue of nodes in buckets by their keys, which is faster than a heap where no step costs little.

    ``keys`` (Q,) and ``nodes`` (Q,) of the entries; ``after`` (Q,) the next entry of the same bucket, or of
    those that are free, -1 at the end; ``firsts`` (B,) the first entry of each bucket; ``sizes`` (2,) how
    many entries were ever in use, and the first that is free, from 1 on; ``width`` (1,) of a bucket. If no
    step costs less than that, nodes are settled in the order of their buckets. Keys beyond all buckets are in
    the last one, where a node may be settled more than once.
    """

    keys: Float1D
    nodes: Int1D
    after: Int1D
    firsts: Int1D
    sizes: Int1D
    width: Float1D


@inlined
def has_room(queue: Buckets) -> bool:
    """Return whether another entry has room."""
    return queue.sizes[1] > 0 or queue.sizes[0] < queue.keys.shape[0]


@inlined
def put(queue: Buckets, key: float, node: int) -> None:
    """Queue a node."""
    at = queue.sizes[1] - 1
    if at >= 0:
        queue.sizes[1] = queue.after[at] + 1
    else:
        at = queue.sizes[0]
        queue.sizes[0] = at + 1
    bucket = min(queue.firsts.shape[0] - 1, int(key / queue.width[0]))
    queue.keys[at], queue.nodes[at], queue.after[at] = key, node, queue.firsts[bucket]
    queue.firsts[bucket] = at


@inlined
def take(queue: Buckets, bucket: int) -> tuple[float, int]:
    """Take the first entry of a bucket that is not empty: its key and its node."""
    at = queue.firsts[bucket]
    queue.firsts[bucket] = queue.after[at]
    queue.after[at] = queue.sizes[1] - 1
    queue.sizes[1] = at + 1
    return queue.keys[at], queue.nodes[at]


@inlined
def entry_of(direction: int, i: int, j: int, k: int) -> int:
    """Return a node and its direction as one number, taken apart without a division."""
    return (((direction << BITS | i) << BITS) | j) << BITS | k


@inlined
def numbers_in(entry: int) -> tuple[int, int, int, int]:
    """Return the direction and the node of :func:`entry_of`."""
    mask = (1 << BITS) - 1
    return entry >> 3 * BITS, entry >> 2 * BITS & mask, entry >> BITS & mask, entry & mask


@inlined
def step_of(direction: int) -> tuple[int, int]:
    """Return the columns east and north of a step in one of eight directions, counter-clockwise from east."""
    d = direction % DIRECTIONS
    east = 1 if d == 0 or d == 1 or d == 7 else (0 if d == 2 or d == 6 else -1)
    north = 1 if d == 1 or d == 2 or d == 3 else (0 if d == 0 or d == 4 else -1)
    return east, north


@kernel_numpy_errors
def time_along(dx: float, dy: float, limits: Limits) -> float:
    """Time of a flight over (dx, dy) [m] at cruise in the wind [s]."""
    flat, v = math.hypot(dx, dy), limits.v_cruise
    along = (limits.wind_x * dx + limits.wind_y * dy) / flat
    across = (limits.wind_x * dy - limits.wind_y * dx) / flat
    return flat / max(along + math.sqrt(max(v * v - across * across, 0.0)), 0.1 * v)


@kernel_numpy_errors
def fill_cost_over_ground(
    field: CostField, g: int, goal: Float1D, limits: Limits, heap: Heap, queue: Buckets
) -> int:  # fmt: skip
    """Set V of goal ``g`` in every direction at every connected node; return the number settled.

    ``goal`` (≥ 3,) is its centre [m].
    """
    values, rate, grid, first = field.values, field.rate, field.grid, g * DIRECTIONS
    num, p, queue.sizes[:] = 0, rate.shape[2], 0
    queue.firsts[:] = -1
    queue.width[0] = (
        SHORTENED * min(grid[3], grid[4]) / (limits.v_cruise + math.hypot(limits.wind_x, limits.wind_y))
    )
    _begin(field, first, goal, limits, heap, queue)
    up_most, down_most = STEEPER * math.tan(limits.climb_max), STEEPER * math.tan(limits.descent_max)
    times, flats = local_floats(DIRECTIONS), local_floats(DIRECTIONS)
    for d in range(DIRECTIONS):
        di, dj = step_of(d)
        dx, dy = di * grid[3], dj * grid[4]
        times[d], flats[d] = 0.5 * SHORTENED * time_along(dx, dy, limits), math.hypot(dx, dy) / grid[5]
    for bucket in range(queue.firsts.shape[0]):
        while queue.firsts[bucket] >= 0:
            key, entry = take(queue, bucket)
            arrives, i, j, k = numbers_in(entry)
            if key > values[first + arrives, i, j, k] + SETTLED_S:
                continue
            num += 1
            di, dj = step_of(arrives)
            a, b = i - di, j - dj
            if not is_inside(rate, a, b, 0):
                continue
            above = (height_of(field, i, j, k) - height_of(field, a, b, 0)) / grid[5]
            lowest = max(0, int(math.ceil(above - up_most * flats[arrives])))
            highest = min(p - 1, int(math.floor(above + down_most * flats[arrives])))
            here = rate[i, j, k]
            for turn in range(-1, 2):
                d = (arrives + turn) % DIRECTIONS
                for c in range(lowest, highest + 1):
                    found = key + times[arrives] * (here + rate[a, b, c])
                    if found < values[first + d, a, b, c] - SETTLED_S and has_room(queue):
                        values[first + d, a, b, c] = found
                        put(queue, found, entry_of(d, a, b, c))
    return num


@kernel_numpy_errors
def _begin(field: CostField, first: int, goal: Float1D, limits: Limits, heap: Heap, queue: Buckets) -> None:
    """Begin at the nodes about the goal in each direction, all others infinite."""
    value = field.values[first]
    begin_at(field, first, goal, limits, heap)
    for d in range(1, DIRECTIONS):
        field.values[first + d] = value
    for node in range(value.size):
        i, j, k = place_of(value, node)
        if value[i, j, k] < math.inf:
            for d in range(DIRECTIONS):
                put(queue, value[i, j, k], entry_of(d, i, j, k))

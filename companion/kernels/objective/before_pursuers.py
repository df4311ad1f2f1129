"""A wave from the aircraft: the places that it reaches before pursuers, and the cost of all others.

A place can be passed in safety only before the moment C from which on pursuers could threaten it. Two waves
are made by the same scheme as V. Where places after C are barred, the wave goes by time: it reaches every
place as early as a flight at that airspeed can, and passes no barred one, so that V is infinite where no
safe way leads to the goal. Where they have a price, the wave goes by J and carries the time with it: it
reaches every place when the cheapest flight would, which tells what a second there will cost.

Symbols: ``i, j, k`` a node east, north, up.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.dubins import distance_to_point
from companion.kernels.arrays import Float1D, Float3D, Limits
from companion.kernels.native.kernel import kernel, kernel_numpy_errors, local_floats
from companion.kernels.native.struct import Struct
from companion.kernels.objective.cost_to_go import (
    GOAL_CELLS,
    SETTLED_S,
    CostField,
    Heap,
    adjacent,
    height_of,
    is_inside,
    place_of,
    renewed,
)
from companion.kernels.objective.row_costs import Objective, pursuit_danger
from companion.kernels.threat.pursuit_game import pop_least, push

BEGUN_RADII = 4.0  # The wave begins with exact times within this many turn radii of the start.
EARLY = 0.98  # Upwind differences overestimate times by less than 2 %; this factor takes that off.


class Wave(Struct):
    """A wave over the nodes of a field.

    ``start`` (6,) is where it begins: x y z [m], when [s], the airspeed [m/s] and the direction [rad].
    ``rate`` (NX, NY, NZ) is the cost of a second at each node, infinite where nothing flies. ``value`` (NX,
    NY, NZ) receives the cost of the way to a node, ``time`` (NX, NY, NZ) its duration at cruise [s], and
    ``danger`` (NX, NY, NZ) the danger at the node on arrival. The wave stops at nodes with more danger than
    ``danger_max``. Less danger costs ``price`` times itself a second. No turn is narrower than ``radius``
    [m].
    """

    start: Float1D
    rate: Float3D
    value: Float3D
    time: Float3D
    danger: Float3D
    danger_max: float
    price: float
    radius: float


@kernel
def time_to_fly(length: float, v: float, limits: Limits) -> float:
    """Time to fly ``length`` [m], beginning with airspeed ``v`` [m/s] and changing to cruise at once [s]."""
    change = limits.v_cruise - v
    a = limits.a_max if change >= 0.0 else -limits.a_max
    settling = (limits.v_cruise * limits.v_cruise - v * v) / (2.0 * a)
    if length >= settling:
        return change / a + (length - settling) / limits.v_cruise
    return (math.sqrt(v * v + 2.0 * a * length) - v) / a


@kernel_numpy_errors
def is_in_sight(rate: Float3D, u: float, v: float, i: int, j: int, k: int) -> bool:
    """Return whether something flies at every node between (u, v), in nodes, and node (i, j) at level ``k``.

    ``rate`` (NX, NY, NZ) as in :class:`Wave`.
    """
    steps = int(max(abs(i - u), abs(j - v))) + 1
    for step in range(1, steps + 1):
        a, b = int(u + (i - u) * step / steps + 0.5), int(v + (j - v) * step / steps + 0.5)
        if rate[a, b, k] == math.inf:
            return False
    return True


@kernel_numpy_errors
def begin_wave(wave: Wave, field: CostField, limits: Limits, heap: Heap) -> int:
    """Begin at the nodes in sight about the start, all others infinite; return the heap's size.

    Near a point a wave's front is too bent for upwind differences, so that it
    begins with the exact times as far as :data:`BEGUN_RADII` turning radii.
    """
    value, time, start, grid, size = wave.value, wave.time, wave.start, field.grid, 0
    reach = max(BEGUN_RADII * wave.radius, GOAL_CELLS * grid[3])
    u, v = (start[0] - grid[0]) / grid[3], (start[1] - grid[1]) / grid[4]
    slope = math.tan(limits.climb_max)
    value[:] = math.inf
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            x, y = grid[0] + i * grid[3] - start[0], grid[1] + j * grid[4] - start[1]
            if x * x + y * y > reach * reach:
                continue
            way = distance_to_point(0.0, 0.0, start[5], x, y, wave.radius)
            for k in range(value.shape[2]):
                up = abs(height_of(field, i, j, k) - start[2]) if value.shape[2] > 1 else 0.0
                if not is_in_sight(wave.rate, u, v, i, j, k):
                    continue
                time[i, j, k] = EARLY * max(way, up / slope) / limits.v_cruise
                value[i, j, k] = wave.rate[i, j, k] * time[i, j, k]
                number = (i * value.shape[1] + j) * value.shape[2] + k
                size = push(heap.keys, heap.nodes, size, value[i, j, k], number)
    return size


@kernel_numpy_errors
def fill_before_pursuers(wave: Wave, field: CostField, objective: Objective, heap: Heap) -> None:
    """Add what pursuers cost to ``field.rate``, infinite where the wave does not come.

    ``wave`` has its start, its rates and room for the rest.
    """
    grid, limits, pace, value = field.grid, objective.limits, local_floats(4), wave.value
    m, p = value.shape[1], value.shape[2]
    slope = grid[3] / grid[5]
    speed = limits.v_cruise / EARLY
    pace[0], pace[1] = -limits.wind_x / speed, -limits.wind_y / speed
    pace[2], pace[3] = math.tan(limits.descent_max) * slope, math.tan(limits.climb_max) * slope
    size = begin_wave(wave, field, limits, heap)
    while size > 0:
        key, node = heap.keys[0], heap.nodes[0]
        size = pop_least(heap.keys, heap.nodes, size)
        i, j, k = place_of(value, node)
        if key > value[i, j, k] + SETTLED_S:
            continue
        due = wave.start[3] + time_to_fly(wave.time[i, j, k] * limits.v_cruise, wave.start[4], limits)
        x, y, z = grid[0] + i * grid[3], grid[1] + j * grid[4], height_of(field, i, j, k)
        danger = pursuit_danger(x, y, z, due, objective)
        if danger > wave.danger_max:
            wave.rate[i, j, k] = value[i, j, k] = math.inf
            continue
        wave.danger[i, j, k] = danger
        size = spread(wave, node, wave.price * danger, grid[3] / speed, pace, grid, heap, size)
    for i in range(value.shape[0]):
        for j in range(m):
            for k in range(p):
                if value[i, j, k] == math.inf:
                    field.rate[i, j, k] = math.inf
                else:
                    field.rate[i, j, k] += objective.prices.pursued * wave.danger[i, j, k]


@kernel_numpy_errors
def spread(
    wave: Wave,
    node: int,
    danger: float,
    crossing: float,
    pace: Float1D,
    grid: Float1D,
    heap: Heap,
    size: int,
) -> int:
    """Renew the neighbours of a node that the wave has reached; return the heap's new size.

    ``danger`` is what a second costs more there; ``crossing`` is the time that crossing the spacing takes
    [s]; ``pace`` (4,) as in :func:`renewed`; ``grid`` (6,) is the field's.
    """
    value, time, m, p = wave.value, wave.time, wave.value.shape[1], wave.value.shape[2]
    i, j, k = place_of(value, node)
    for side in range(6 if p > 1 else 4):
        a, b, c = adjacent(i, j, k, side)
        if not is_inside(value, a, b, c):
            continue
        rate = wave.rate[a, b, c] + danger
        if value[a, b, c] <= value[i, j, k] or rate == math.inf or size >= heap.keys.shape[0] - 1:
            continue
        found = renewed(value, a, b, c, rate * crossing, pace)
        if not value[i, j, k] <= found < value[a, b, c] - SETTLED_S:
            continue
        x, y = grid[0] + a * grid[3] - wave.start[0], grid[1] + b * grid[4] - wave.start[1]
        soonest = distance_to_point(0.0, 0.0, wave.start[5], x, y, wave.radius) * crossing / grid[3]
        due = time[i, j, k] + (found - value[i, j, k]) / rate
        if due < soonest:
            found += rate * (soonest - due)
            due = soonest
        if found < value[a, b, c] - SETTLED_S:
            value[a, b, c], time[a, b, c] = found, due
            size = push(heap.keys, heap.nodes, size, found, (a * m + b) * p + c)
    return size

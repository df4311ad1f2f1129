"""The game of paper 2.3: where a DT that knows the whole path could threaten the aircraft, and from when on.

``T_D(p)`` is a DT's earliest arrival at ``p`` by the shortest way round obstacles; ``C(q)``, the least
``T_D(p)`` over the places within RD_max of ``q`` with a free line of sight to it, is the earliest moment at
which ``q`` is under threat. A path that passes all its places before their ``C`` is safe against every
strategy of that DT. Here both are found on a grid; every rounding errs on the near side, but for walls, whose
outlines are those of the cells with their centre inside.

Symbols: ``q`` = (x, y, z) a place of the aircraft, ``d`` the DT.

References
----------
Zhao, "A fast sweeping method for Eikonal equations", Math. Comp. 74, 2005.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, Game, Int1D, Obstacles
from companion.kernels.geometry.ground_surface import DEEP, cell_along
from companion.kernels.geometry.prism_distance import point_in_polygon
from companion.kernels.native.kernel import inlined, kernel

DRIVES, FLIES, PASSES_BY = 0.0, 1.0, 2.0  # kinds of DT
SHORTENED = 0.98  # Sweeping overestimates distances by less than 2 %; this factor takes that off.
SEED_CELLS = 6  # Within this many cells of a DT its paths are straight lines.
# A wall whose base is higher does not stand on the ground: vehicles pass under it and see through.
STANDS_M = 1.0
BEARING_CELLS = 1.5  # Largest distance of two lines of sight at the rim of a DT's reach, in cells.
# The difference of two cells' arrivals overestimates their distance by at most this many cells.
ROUNDED_CELLS = 3.0
NEAR_M = 1e-9  # A distance that is divided by is at least this.
# Cells along each side of a block: where a DT reaches none of them in time, no line of sight is cast.
BLOCK = 8


@kernel
def fill_tops(obstacles: Obstacles, plane_up: float, grid: Float1D, tops: Float2D) -> None:
    """Height of the wall over every cell's centre, in place.

    ``grid`` (3,) x0 y0 and the spacing [m]; ``tops`` (NX, NY) receives heights [m], minus infinity where no
    wall stands. In the plane, at height ``plane_up`` (else NaN), a wall hides whatever its height.
    """
    tops[:] = -math.inf
    is_plane = not math.isnan(plane_up)
    for o in range(obstacles.heights.shape[0]):
        base, top, box = obstacles.heights[o, 0], obstacles.heights[o, 1], obstacles.boxes[o]
        if (base > plane_up or top < plane_up) if is_plane else base > STANDS_M:
            continue
        first, last = obstacles.offsets[o], obstacles.offsets[o + 1]
        for i in range(_cell(box[0], grid[0], grid[2], tops.shape[0]), tops.shape[0]):
            x = grid[0] + i * grid[2]
            if x > box[2]:
                break
            for j in range(_cell(box[1], grid[1], grid[2], tops.shape[1]), tops.shape[1]):
                y = grid[1] + j * grid[2]
                if y > box[3]:
                    break
                if point_in_polygon(x, y, obstacles.edges, first, last):
                    tops[i, j] = math.inf if is_plane else max(tops[i, j], top)


@inlined
def _cell(x: float, origin: float, spacing: float, n: int) -> int:
    """The cell whose centre is nearest to ``x``, within 0 to ``n - 1``."""
    return min(n - 1, max(0, int(math.floor((x - origin) / spacing + 0.5))))


@kernel
def fill_arrivals(x: float, y: float, game: Game, d: int) -> None:
    """``T_D`` of DT ``d``, which is at (x, y), into ``game.arrival[d]`` [s]."""
    grid, tops, way = game.grid, game.tops, game.arrival[d]
    stamp, v, nearer = game.vehicles[d, 3], game.vehicles[d, 4], game.vehicles[d, 6]
    nx, ny = tops.shape
    way[:] = math.inf
    a, b = _cell(x, grid[0], grid[2], nx), _cell(y, grid[1], grid[2], ny)
    for i in range(max(0, a - SEED_CELLS), min(nx, a + SEED_CELLS + 1)):
        for j in range(max(0, b - SEED_CELLS), min(ny, b + SEED_CELLS + 1)):
            px, py = grid[0] + i * grid[2], grid[1] + j * grid[2]
            if tops[i, j] == -math.inf and _is_free(x, y, px, py, grid, tops):
                way[i, j] = math.hypot(px - x, py - y)
    way[a, b] = math.hypot(grid[0] + a * grid[2] - x, grid[1] + b * grid[2] - y)
    if v > 0.0:
        while _sweep(way, tops, grid[2], 1, 1) | _sweep(way, tops, grid[2], -1, -1):
            _sweep(way, tops, grid[2], 1, -1)
            _sweep(way, tops, grid[2], -1, 1)
    for i in range(nx):
        for j in range(ny):
            left = max(0.0, SHORTENED * way[i, j] - nearer - 0.5 * grid[2])
            if left == 0.0:
                way[i, j] = stamp
            else:
                way[i, j] = stamp + left / v if v > 0.0 else math.inf


@kernel
def _is_free(ax: float, ay: float, bx: float, by: float, grid: Float1D, tops: Float2D) -> bool:
    """Return whether no cell between two places has a wall; ``grid`` (3,), ``tops`` (NX, NY) as in Game."""
    steps = int(2.0 * math.hypot(bx - ax, by - ay) / grid[2])
    for k in range(1, steps + 1):
        share = k / (steps + 1)
        i = _cell(ax + share * (bx - ax), grid[0], grid[2], tops.shape[0])
        j = _cell(ay + share * (by - ay), grid[1], grid[2], tops.shape[1])
        if tops[i, j] > -math.inf:
            return False
    return True


@kernel
def _sweep(way: Float2D, tops: Float2D, cell: float, right: int, up: int) -> bool:
    """Sweep over ``way`` (NX, NY) [m] by Godunov's scheme (Gauss-Seidel); return whether anything changed.

    ``tops`` (NX, NY) as in Game.
    """
    nx, ny = tops.shape
    changed = False
    for s in range(nx):
        i = s if right > 0 else nx - 1 - s
        for t in range(ny):
            j = t if up > 0 else ny - 1 - t
            if tops[i, j] > -math.inf:
                continue
            a = min(way[i - 1, j] if i > 0 else math.inf, way[i + 1, j] if i < nx - 1 else math.inf)
            b = min(way[i, j - 1] if j > 0 else math.inf, way[i, j + 1] if j < ny - 1 else math.inf)
            least = min(a, b)
            if least >= way[i, j]:
                continue
            found = least + cell
            if abs(a - b) < cell:
                found = 0.5 * (a + b + math.sqrt(2.0 * cell * cell - (a - b) ** 2))
            if found < way[i, j] - 1e-6:
                way[i, j] = found
                changed = True
    return changed


@kernel
def threatened_from(game: Game, x: float, y: float, z: float, soon: float, late: float) -> float:
    """``C(q)``, the earliest moment at which a place is under a DT's threat [s].

    It is infinite if the place never is. To save time, any moment up to ``soon`` may be returned for the
    earliest, and infinity for any moment after ``late``.
    """
    best = math.inf
    vehicles = game.vehicles
    for d in range(vehicles.shape[0]):
        kind, v = vehicles[d, 7], vehicles[d, 4]
        if kind == PASSES_BY:
            continue
        flat = math.hypot(x - vehicles[d, 0], y - vehicles[d, 1])
        up = z - vehicles[d, 2] if game.is_plane == 0 else 0.0
        radius = _reach_in_plane(game, d, up)
        if radius < 0.0:
            continue
        away = flat if kind == DRIVES else math.hypot(flat, up)
        left = max(0.0, away - radius - vehicles[d, 6] - 0.5 * game.grid[2])
        soonest = vehicles[d, 3]
        if left > 0.0:
            soonest = soonest + left / v if v > 0.0 else math.inf
        if soonest > late or soonest >= best:
            continue
        if kind == DRIVES:
            soonest = _seen_from(game, d, x, y, z, radius, soon, late)
        best = min(best, soonest)
        if best <= soon:
            break
    return best


@inlined
def _reach_in_plane(game: Game, d: int, up: float) -> float:
    """Reach in the plane of DT ``d`` to places ``up`` metres above it; negative where it has none.

    Over ground its height changes as it drives: all places within reach in the plane are looked at.
    """
    reach = game.vehicles[d, 5]
    if game.vehicles[d, 7] != DRIVES or game.ground.low[0, 0] > DEEP:
        return reach
    return math.sqrt(reach * reach - up * up) if abs(up) <= reach else -1.0


@kernel
def _seen_from(
    game: Game, d: int, x: float, y: float, z: float, radius: float, soon: float, late: float
) -> float:
    """Earliest arrival of DT ``d`` at a place within ``radius`` that sees (x, y, z) [s].

    No line of sight is looked along where the arrival below the place decides: a DT that is there by ``soon``
    sees it, and one that sees it, where no wall is so low that it is seen over, has only to drive there.
    """
    below = _arrival_below(game, d, x, y)
    if below <= soon:
        return below
    drives = radius + ROUNDED_CELLS * game.grid[2]
    is_late = below < math.inf and (below - late) * game.vehicles[d, 4] > drives
    if is_late and z <= game.lowest:
        return math.inf
    away = math.hypot(game.vehicles[d, 0] - x, game.vehicles[d, 1] - y)
    first, wide = _bearings_to(game, d, x, y, radius, late)
    best = math.inf
    if wide < 0.0:
        return best
    if away <= radius:  # Its present position lies on one of the lines, too.
        towards = math.atan2(game.vehicles[d, 1] - y, game.vehicles[d, 0] - x)
        best = _seen_along(game, d, x, y, z, towards, away)
    if best <= soon or game.vehicles[d, 4] <= 0.0:
        return best
    count = max(16, int(2.0 * math.pi * radius / (BEARING_CELLS * game.grid[2])))
    begin = int(math.ceil(count * first / (2.0 * math.pi)))
    end = int(math.floor(count * (first + wide) / (2.0 * math.pi)))
    for k in range(begin, begin + min(count, end - begin + 1)):
        angle = 2.0 * math.pi * (k % count) / count
        best = min(best, _seen_along(game, d, x, y, z, angle, radius))
        if best <= soon:
            break
    return best


@kernel
def _arrival_below(game: Game, d: int, x: float, y: float) -> float:
    """Earliest arrival of DT ``d`` in the cell of a place; infinite outside the grid and in a wall [s]."""
    i = int(math.floor((x - game.grid[0]) / game.grid[2] + 0.5))
    j = int(math.floor((y - game.grid[1]) / game.grid[2] + 0.5))
    is_inside = 0 <= i < game.tops.shape[0] and 0 <= j < game.tops.shape[1]
    return float(game.arrival[d, i, j]) if is_inside else math.inf


@kernel
def _bearings_to(game: Game, d: int, x: float, y: float, radius: float, late: float) -> tuple[float, float]:
    """Bearings under which DT ``d`` could be by ``late`` within ``radius``: the first, and how wide they are.

    Counter-clockwise from east [rad]; less than 0 wide where it could be nowhere there, a whole turn or more
    where it could be all round.
    """
    side = BLOCK * game.grid[2]
    west, south = game.grid[0] - 0.5 * game.grid[2], game.grid[1] - 0.5 * game.grid[2]
    half = side * math.sqrt(0.5)
    about, low, high = 0.0, 0.0, -1.0
    for i in range(
        max(0, int((x - radius - west) / side)), min(game.least.shape[1], int((x + radius - west) / side) + 1)
    ):
        for j in range(
            max(0, int((y - radius - south) / side)),
            min(game.least.shape[2], int((y + radius - south) / side) + 1),
        ):
            if game.least[d, i, j] > late:
                continue
            east, north = west + (i + 0.5) * side - x, south + (j + 0.5) * side - y
            away = math.hypot(east, north)
            if away > radius + half:
                continue
            if away <= 1.001 * half:
                return 0.0, 2.0 * math.pi
            bearing, spread = math.atan2(north, east), math.asin(half / away) + 1e-9
            if high < low:
                about, low, high = bearing, -spread, spread
                continue
            offset = (bearing - about + math.pi) % (2.0 * math.pi) - math.pi
            low, high = min(low, offset - spread), max(high, offset + spread)
    return about + low, high - low


@inlined
def _ground_at(game: Game, d: int, x: float, y: float) -> tuple[float, float]:
    """Lowest ground of a cell, and how high DT ``d`` would be there: without ground, as high as it is [m]."""
    ground = game.ground
    i = cell_along(x, ground.grid[0], ground.grid[2], ground.low.shape[0])
    j = cell_along(y, ground.grid[1], ground.grid[2], ground.low.shape[1])
    low = float(ground.low[i, j])
    return low, game.vehicles[d, 2] if low == DEEP else float(ground.high[i, j])


@kernel
def _seen_along(game: Game, d: int, x: float, y: float, z: float, angle: float, length: float) -> float:
    """:func:`_seen_from` of the places on one line of sight, ``length`` metres long at ``angle``.

    A place is seen over all that is nearer if no line to the tops of that is less steep downwards.
    """
    grid, tops, cell, reach = game.grid, game.tops, game.grid[2], game.vehicles[d, 5]
    east, north, best, steepest, r = math.cos(angle), math.sin(angle), math.inf, -math.inf, 0.0
    z = game.vehicles[d, 2] if game.is_plane == 1 else z
    while True:
        px, py = x + r * east, y + r * north
        i, j = int(math.floor((px - grid[0]) / cell + 0.5)), int(math.floor((py - grid[1]) / cell + 0.5))
        if i < 0 or j < 0 or i >= tops.shape[0] or j >= tops.shape[1]:
            break
        low, there = _ground_at(game, d, px, py)
        up = there - z
        if tops[i, j] > -math.inf and r > 0.0:
            if tops[i, j] >= z:
                break
            steepest = max(steepest, (tops[i, j] - z) / r)
        elif up >= steepest * r and r * r + up * up <= reach * reach:
            best = min(best, game.arrival[d, i, j])
        steepest = max(steepest, (low - z) / max(r, NEAR_M))
        if r >= length:
            break
        r = min(r + cell, length)
    return best


@kernel
def is_threatened(game: Game, x: float, y: float, z: float, time: float) -> bool:
    """Return whether a DT could threaten a place at a moment, ``game.slack`` taken off."""
    if game.vehicles.shape[0] == 0:
        return False
    until = time + game.slack
    return threatened_from(game, x, y, z, until, until) <= until


@kernel
def push(keys: Float1D, values: Int1D, size: int, key: float, value: int) -> int:
    """Put an entry into a binary heap of ``keys`` and ``values`` (S,); return the heap's new size."""
    at = size
    while at > 0 and keys[(at - 1) // 2] > key:
        keys[at], values[at] = keys[(at - 1) // 2], values[(at - 1) // 2]
        at = (at - 1) // 2
    keys[at], values[at] = key, value
    return size + 1


@kernel
def pop_least(keys: Float1D, values: Int1D, size: int) -> int:
    """Remove the least entry of a binary heap of ``keys`` and ``values`` (S,); return the heap's new size."""
    size -= 1
    key, value, at = keys[size], values[size], 0
    while 2 * at + 1 < size:
        child = 2 * at + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at], values[at] = keys[child], values[child]
        at = child
    keys[at], values[at] = key, value
    return size


@kernel
def threatened_rows(states: Float2D, times: Float1D, first: int, n: int, game: Game) -> tuple[float, float]:
    """Return when a path is first under threat, and for how long altogether [s].

    Of rows ``first`` to ``n - 1`` of ``states`` (N, 6) at ``times`` (N,) [s]; infinite and 0 where it never
    does.
    """
    begins, total = math.inf, 0.0
    if game.vehicles.shape[0] == 0:
        return begins, total
    for k in range(first, n):
        if is_threatened(game, states[k, 0], states[k, 1], states[k, 2], times[k]):
            begins = min(begins, times[k])
            total += times[k] - times[max(k - 1, 0)]
    return begins, total

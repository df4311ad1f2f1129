"""Compiled loops of the oracle: sight, distances, arrival, and the search over the lattice.

Edges are rows ``(ax, ay, bx, by)``. All stand in one file, since numba's cache looks at no other.
"""

import math

import numba as nb
import numpy as np

NUM_COURSES = 24
STEPS = 4  # places looked at along a piece


@nb.njit(cache=True)
def is_seen(px, py, qx, qy, edges):
    """Whether the line from p to q meets no edge."""
    dx, dy = qx - px, qy - py
    low_x, high_x = min(px, qx), max(px, qx)
    low_y, high_y = min(py, qy), max(py, qy)
    for index in range(len(edges)):
        ax, ay, bx, by = edges[index, 0], edges[index, 1], edges[index, 2], edges[index, 3]
        if max(ax, bx) < low_x or min(ax, bx) > high_x or max(ay, by) < low_y or min(ay, by) > high_y:
            continue
        of_a = dx * (ay - py) - dy * (ax - px)
        of_b = dx * (by - py) - dy * (bx - px)
        if (of_a > 0.0) == (of_b > 0.0) and of_a != 0.0 and of_b != 0.0:
            continue
        of_p = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        of_q = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
        if (of_p > 0.0) == (of_q > 0.0) and of_p != 0.0 and of_q != 0.0:
            continue
        return False
    return True


@nb.njit(cache=True)
def edge_distance(x, y, edge):
    """Distance of a place from an edge."""
    dx, dy = edge[2] - edge[0], edge[3] - edge[1]
    part = ((x - edge[0]) * dx + (y - edge[1]) * dy) / (dx * dx + dy * dy)
    part = min(1.0, max(0.0, part))
    return math.hypot(x - edge[0] - part * dx, y - edge[1] - part * dy)


@nb.njit(cache=True)
def clearance(x, y, edges):
    """Distance of a place from the nearest edge."""
    best = np.inf
    for index in range(len(edges)):
        best = min(best, edge_distance(x, y, edges[index]))
    return best


@nb.njit(cache=True)
def clearances(places, edges):
    """Distance of each place from the nearest edge."""
    found = np.empty(len(places))
    for index in range(len(places)):
        found[index] = clearance(places[index, 0], places[index, 1], edges)
    return found


@nb.njit(cache=True)
def sight_lengths(nodes, edges):
    """Straight distances between nodes that see each other; 0 between others, as scipy's graphs have it."""
    count = len(nodes)
    lengths = np.zeros((count, count))
    for one in range(count):
        for other in range(one):
            if is_seen(nodes[one, 0], nodes[one, 1], nodes[other, 0], nodes[other, 1], edges):
                length = math.hypot(nodes[one, 0] - nodes[other, 0], nodes[one, 1] - nodes[other, 1])
                lengths[one, other] = lengths[other, one] = length
    return lengths


@nb.njit(cache=True)
def soonest(x, y, nodes, node_times, pace, edges, known):
    """When a place is reached over the last node it is seen from, if before what is known; else that."""
    for node in range(len(nodes)):
        when = node_times[node] + pace * math.hypot(x - nodes[node, 0], y - nodes[node, 1])
        if when < known and is_seen(nodes[node, 0], nodes[node, 1], x, y, edges):
            known = when
    return known


@nb.njit(cache=True)
def soonest_all(places, nodes, node_times, pace, edges):
    """When each place is reached; infinite if it cannot be."""
    found = np.empty(len(places))
    for index in range(len(places)):
        found[index] = soonest(places[index, 0], places[index, 1], nodes, node_times, pace, edges, np.inf)
    return found


@nb.njit(cache=True)
def _polished(x, y, reach, px, py, best, nodes, node_times, pace, edges, walls, step):
    """A time no later than the best of a place in reach and in sight, by ever shorter steps from it."""
    while step > 0.5:
        is_better = False
        for choice in range(8):
            angle = choice * math.pi / 4.0
            tx, ty = px + step * math.sin(angle), py + step * math.cos(angle)
            away = math.hypot(tx - x, ty - y)
            if away > reach:  # then on the circle
                tx, ty = x + (tx - x) * reach / away, y + (ty - y) * reach / away
            when = soonest(tx, ty, nodes, node_times, pace, edges, best)
            if when < best - 1e-9 and is_seen(tx, ty, x, y, walls):
                px, py, best, is_better = tx, ty, when, True
        if not is_better:
            step *= 0.5
    return best


@nb.njit(cache=True)
def _grid_window(place, reach, origin, spacing, count):
    """First grid line in reach, and the one after the last."""
    first = max(0, math.ceil((place - reach - origin) / spacing))
    return first, min(count - 1, math.floor((place + reach - origin) / spacing)) + 1


@nb.njit(cache=True)
def least_seen(places, reach, nodes, node_times, pace, grid, west, south, spacing, edges):
    """Of each place the least time of all that are in reach and see it, from the best of nodes and grid."""
    found = np.full(len(places), np.inf)
    near, last, last_times = np.empty_like(edges), np.empty_like(nodes), np.empty_like(node_times)
    for index in range(len(places)):
        x, y = places[index, 0], places[index, 1]
        count = 0
        for edge in range(len(edges)):
            if edge_distance(x, y, edges[edge]) <= reach:
                near[count] = edges[edge]
                count += 1
        walls = near[:count]
        best, bx, by = np.inf, x, y
        for node in range(len(nodes)):
            nx, ny = nodes[node, 0], nodes[node, 1]
            is_near = node_times[node] < best and math.hypot(x - nx, y - ny) <= reach
            if is_near and is_seen(nx, ny, x, y, walls):
                best, bx, by = node_times[node], nx, ny
        first_i, end_i = _grid_window(x, reach, west, spacing, grid.shape[0])
        first_j, end_j = _grid_window(y, reach, south, spacing, grid.shape[1])
        for i in range(first_i, end_i):
            for j in range(first_j, end_j):
                px, py = west + i * spacing, south + j * spacing
                is_near = grid[i, j] < best and (px - x) ** 2 + (py - y) ** 2 <= reach * reach
                if is_near and is_seen(px, py, x, y, walls):
                    best, bx, by = grid[i, j], px, py
        if 0.0 < best < np.inf:
            num_last = 0
            for node in range(len(nodes)):  # over which a place in reach may be had sooner
                away = math.hypot(x - nodes[node, 0], y - nodes[node, 1])
                if node_times[node] + pace * max(0.0, away - reach) < best:
                    last[num_last], last_times[num_last] = nodes[node], node_times[node]
                    num_last += 1
            best = _polished(
                x, y, reach, bx, by, best, last[:num_last], last_times[:num_last], pace, edges, walls,
                0.5 * spacing,
            )  # fmt: skip
        found[index] = best
    return found


@nb.njit(cache=True)
def time_of_length(length, cruise, speed, acceleration):
    """When so much has been flown, if speed changes evenly from cruise to another."""
    ramp = abs(speed * speed - cruise * cruise) / (2.0 * acceleration)
    if length >= ramp:
        return abs(speed - cruise) / acceleration + (length - ramp) / speed
    change = acceleration if speed > cruise else -acceleration
    return (math.sqrt(cruise * cruise + 2.0 * change * length) - cruise) / change


@nb.njit(cache=True)
def moved(x, y, course, turn, length, radius):
    """Place after so much of a piece: straight, or a turn to the right (1) or the left (-1)."""
    if turn == 0:
        return x + length * math.sin(course), y + length * math.cos(course)
    angle = length / radius
    ahead, aside = radius * math.sin(angle), turn * radius * (1.0 - math.cos(angle))
    return (
        x + ahead * math.sin(course) + aside * math.cos(course),
        y + ahead * math.cos(course) - aside * math.sin(course),
    )


@nb.njit(cache=True)
def _is_clear(x, y, box, clear_m, gaps, spacing, faces):
    """Whether a place is in the bounds and clear; asks the edges only where the grid leaves it open."""
    if x < box[0] or x > box[1] or y < box[2] or y > box[3]:
        return False
    gap = gaps[round((x - box[0]) / spacing), round((y - box[2]) / spacing)]
    if abs(gap - clear_m) > 0.75 * spacing:  # further than from any place to its grid point
        return gap > clear_m
    return clearance(x, y, faces) >= clear_m


@nb.njit(cache=True)
def _least_around(x, y, box, grid, spacing):
    """Least value at the four grid points round a place."""
    i = min(int((x - box[0]) / spacing), grid.shape[0] - 2)
    j = min(int((y - box[2]) / spacing), grid.shape[1] - 2)
    return min(grid[i, j], grid[i + 1, j], grid[i, j + 1], grid[i + 1, j + 1])


@nb.njit(cache=True)
def lattice_way(start, goal, box, motion, limits, faces, gaps, gap_spacing, latest, spacing, cell):
    """First way to the goal, breadth first, since all pieces are of one length and so of one time.

    ``start`` is x, y, course; ``goal`` x, y, radius; ``motion`` cruise, speed, acceleration, turn radius;
    ``limits`` slack and clearance; ``latest`` the times by which the grid's points must have been passed.
    A state is given up where another was in its cell on its course before. Returns the turns that are
    flown, one by one, and how many steps of the last; none if there is no way.
    """
    radius = motion[3]
    angle = 2.0 * math.pi / NUM_COURSES
    piece = radius * angle
    columns, rows = int((box[1] - box[0]) / cell) + 2, int((box[3] - box[2]) / cell) + 2
    was_there = np.zeros((columns, rows, NUM_COURSES), dtype=np.bool_)
    most = columns * rows * NUM_COURSES + 1
    xs, ys = np.empty(most), np.empty(most)
    courses, turns = np.empty(most, dtype=np.int16), np.empty(most, dtype=np.int8)
    parents, depths = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    xs[0], ys[0], courses[0], turns[0], parents[0], depths[0] = start[0], start[1], 0, 0, -1, 0
    count, node = 1, 0
    while node < count:
        course = start[2] + angle * courses[node]
        for choice in range(3):
            turn = (0, 1, -1)[choice]
            is_open = True
            x, y = xs[node], ys[node]
            for step in range(1, STEPS + 1):
                x, y = moved(xs[node], ys[node], course, turn, piece * step / STEPS, radius)
                when = time_of_length(piece * (depths[node] + step / STEPS), motion[0], motion[1], motion[2])
                is_open = (
                    _is_clear(x, y, box, limits[1], gaps, gap_spacing, faces)
                    and when + limits[0] < _least_around(x, y, box, latest, spacing)
                )  # fmt: skip
                if not is_open:
                    break
                if math.hypot(x - goal[0], y - goal[1]) <= goal[2]:
                    flown = np.empty(depths[node] + 1, dtype=np.int8)
                    flown[depths[node]] = turn
                    while parents[node] >= 0:
                        flown[depths[node] - 1] = turns[node]
                        node = parents[node]
                    return flown, step
            if not is_open:
                continue
            i, j = round((x - box[0]) / cell), round((y - box[2]) / cell)
            heading = (courses[node] + turn) % NUM_COURSES
            if was_there[i, j, heading]:
                continue
            was_there[i, j, heading] = True
            xs[count], ys[count], courses[count], turns[count] = x, y, heading, turn
            parents[count], depths[count] = node, depths[node] + 1
            count += 1
        node += 1
    return np.empty(0, dtype=np.int8), 0

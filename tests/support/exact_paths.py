"""The least objective J on a grid, exactly: an oracle that shares no code with the planner.

Dijkstra's algorithm (SciPy) over the nodes of a grid. Each is joined to the nodes within four spacings in
every direction that is not a multiple of a shorter one. A flight has no turning limit here. Obstacles are
Shapely's. A line of sight that crosses one is masked. In space a prism hides what lies below its top as seen
from the radar, and an edge climbs by one level at most.
"""

import math

import numpy as np
import shapely
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

REACH = 4  # spacings
BEGINNING_M = 200.0


def directions(reach=REACH):
    """Steps (dx, dy) in both senses, none a multiple of another."""
    span = range(-reach, reach + 1)
    return [(i, j) for i in span for j in span if math.gcd(i, j) == 1]


def memberships(places, radars, obstacles, is_plane):
    """m = 1 − Π(1 − μ) at places (N, 3) [m], by (1), 0 where an obstacle hides a place."""
    return memberships_where(places, radars, lambda rows, eye: hidden(rows, eye, obstacles, is_plane))


def memberships_where(places, radars, is_hidden):
    """m at places (N, 3) [m]; ``is_hidden`` tells which of some places (K, 3) are not seen from a radar."""
    unseen = np.ones(len(places))
    for radar in radars:
        offset = places - np.array(radar.position_enu_m)
        flat, slant = np.hypot(offset[:, 0], offset[:, 1]), np.linalg.norm(offset, axis=1)
        r_max, k_r = radar.max_threat_radius_m, radar.boundary_coefficient_per_m
        mu = np.where(
            (slant <= r_max) & (offset[:, 2] >= k_r * flat**2), np.exp(-((slant / r_max) ** 4)), 0.0
        )
        rows = np.flatnonzero(mu > 0.0)
        mu[rows[is_hidden(places[rows], radar.position_enu_m)]] = 0.0
        unseen *= 1.0 - mu
    return 1.0 - unseen


def hidden(places, radar, obstacles, is_plane):
    """Whether an obstacle stands between a radar and each of places (N, 3) [m]."""
    found = np.zeros(len(places), dtype=bool)
    if not len(places):
        return found
    ends = np.broadcast_to(np.array(radar[:2]), (len(places), 2))
    lines = shapely.linestrings(np.stack([ends, places[:, :2]], axis=1))
    for obstacle in obstacles:
        shape = shapely.Polygon(obstacle.polygon_enu_m)
        shapely.prepare(shape)
        crossed = np.flatnonzero(shapely.intersects(shape, lines) & ~found)
        if is_plane:
            found[crossed] = True
            continue
        for row in crossed:  # hidden if the sight line enters the prism's shape below its top
            inside = shapely.intersection(lines[row], shape)
            far = max(shapely.Point(radar[:2]).distance(shapely.Point(xy)) for xy in np.array(inside.coords))
            near = shapely.Point(radar[:2]).distance(inside)
            length = shapely.length(lines[row])
            heights = [radar[2] + (places[row, 2] - radar[2]) * d / max(length, 1e-9) for d in (near, far)]
            found[row] = min(heights) <= obstacle.top_m
    return found


class LeastPath:
    """The path of least J that a search from the goal has found.

    ``places`` (N, 3) of the nodes, ``seen`` (N,) their membership, ``start`` and ``goal`` the numbers of two.
    """

    def nodes(self):
        """Numbers of the nodes along the path of least J."""
        nodes = [self.start]
        while nodes[-1] != self.goal:
            nodes.append(int(self._before[nodes[-1]]))
        return np.array(nodes)

    def seen_m(self):
        """Metres seen along it: the integral of m."""
        nodes = self.nodes()
        lengths = np.linalg.norm(np.diff(self.places[nodes], axis=0), axis=1)
        return float(lengths @ (0.5 * (self.seen[nodes[1:]] + self.seen[nodes[:-1]])))

    def direction_rad(self):
        """Where the path leads at first."""
        gone = self.places[self.nodes()] - self.places[self.start]
        away = np.hypot(gone[:, 0], gone[:, 1])
        first = np.argmax(away >= BEGINNING_M)
        return math.atan2(gone[first, 1], gone[first, 0])


class ExactGrid(LeastPath):
    """The grid of one map.

    ``rate`` (N,) is what a second costs at a node; ``costs`` the least J from every node to the goal [s].
    """

    def __init__(self, obstacles, radars, bounds, *, start, goal, margin, spacing, speed, prices, rise=None):
        seen_price, near_price, wanted = prices
        is_plane = rise is None
        x = np.arange(bounds[0], bounds[1] + 1e-6, spacing)
        y = np.arange(bounds[2], bounds[3] + 1e-6, spacing)
        z = np.array([start[2]]) if is_plane else np.arange(bounds[4], bounds[5] + 1e-6, rise)
        self.shape = (len(x), len(y), len(z))
        places = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
        free = np.full(len(places), np.inf)
        points = shapely.points(places[:, :2])
        for obstacle in obstacles:
            flat = shapely.distance(shapely.Polygon(obstacle.polygon_enu_m), points)
            up = np.maximum(places[:, 2] - obstacle.top_m, 0.0)
            free = np.minimum(free, np.hypot(flat, up))
        self.seen = memberships(places, radars, obstacles, is_plane)
        near = np.clip((wanted - free) / wanted, 0.0, 1.0) if wanted > 0.0 else 0.0
        self.rate = 1.0 + seen_price * self.seen + near_price * near
        self.places = places
        number = np.arange(len(places)).reshape(self.shape)
        walls = [shapely.Polygon(o.polygon_enu_m).buffer(margin) for o in obstacles]
        heads, tails, rates = [], [], []
        grid_rate = self.rate.reshape(self.shape)
        for dx, dy in directions():
            for dz in (0,) if is_plane else (-1, 0, 1):
                parts = [
                    slice(max(0, -d), n - max(0, d)) for d, n in zip((dx, dy, dz), self.shape, strict=True)
                ]
                moved = [
                    slice(max(0, d), n - max(0, -d)) for d, n in zip((dx, dy, dz), self.shape, strict=True)
                ]
                heads.append(number[tuple(parts)].ravel())
                tails.append(number[tuple(moved)].ravel())
                rates.append(self._mean_rate(grid_rate, parts, (dx, dy, dz)))
        head, tail, rate = np.concatenate(heads), np.concatenate(tails), np.concatenate(rates)
        keep = (free[head] >= margin) & (free[tail] >= margin)
        head, tail, rate = head[keep], tail[keep], rate[keep]
        close = np.flatnonzero(np.minimum(free[head], free[tail]) < margin + REACH * spacing)
        lines = shapely.linestrings(np.stack([places[head[close], :2], places[tail[close], :2]], axis=1))
        barred = np.zeros(len(head), dtype=bool)
        lowest = np.minimum(places[head[close], 2], places[tail[close], 2])
        for wall, obstacle in zip(walls, obstacles, strict=True):
            shapely.prepare(wall)
            low = np.flatnonzero(lowest < obstacle.top_m + margin) if not is_plane else np.arange(len(close))
            barred[close[low[shapely.intersects(wall, lines[low])]]] = True
        head, tail, rate = head[~barred], tail[~barred], rate[~barred]
        length = np.linalg.norm(places[head] - places[tail], axis=1)
        cost = length / speed * rate
        graph = csr_matrix((cost, (head, tail)), shape=(len(places), len(places)))
        self.start, self.goal = self._nearest(start, free, margin), self._nearest(goal, free, margin)
        found, before = dijkstra(graph, indices=self.goal, return_predecessors=True)
        self.least_s, self._before, self._speed = float(found[self.start]), before, speed

    @staticmethod
    def _mean_rate(rate, parts, step):
        """What a second costs on average on the edges of one direction, from nodes in ``parts``: by the
        midpoint rule, as many points as spacings, each interpolated."""
        first = np.stack(np.meshgrid(*(np.arange(p.start, p.stop) for p in parts), indexing="ij")).reshape(
            3, -1
        )
        num = 2 * max(abs(step[0]), abs(step[1]))
        total = np.zeros(first.shape[1])
        for k in range(num):
            share = (k + 0.5) / num
            total += map_coordinates(rate, first + share * np.array(step)[:, None], order=1, mode="nearest")
        return total / num

    def _nearest(self, place, free, margin):
        away = np.linalg.norm(self.places - np.array(place), axis=1)
        return int(np.argmin(np.where(free >= margin, away, np.inf)))

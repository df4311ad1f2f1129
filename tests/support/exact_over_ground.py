"""The least objective J over ground, on a grid: an oracle that shares no code with the planner.

Dijkstra's algorithm (SciPy) over columns of nodes that stand on the ground. Each node is joined to the nodes
within three spacings in every direction that is not a multiple of a shorter one, as far as the slope of the
edge can be flown and the edge stays between the limits. Nothing limits turns. A radar sees a node if the
line of sight passes over the ground, sampled along the line.
"""

import math

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from tests.support.exact_paths import LeastPath, directions, memberships_where

REACH = 3  # spacings
SIGHT_STEP_M, SIGHT_NEAR_M = 10.0, 5.0


def memberships_over_ground(places, radars, ups_m):
    """m = 1 − Π(1 − μ) at places (N, 3) [m], by (1), 0 where the ground hides a place.

    ``ups_m`` gives the heights of the ground at places east (N,) and north (N,).
    """
    return memberships_where(places, radars, lambda rows, eye: hidden_by_ground(rows, eye, ups_m))


def hidden_by_ground(places, eye, ups_m):
    """Whether the ground stands between ``eye`` (3,) and each of places (N, 3) [m]."""
    lengths = np.linalg.norm(places - eye, axis=1)
    hidden = np.zeros(len(places), dtype=bool)
    for away in np.arange(SIGHT_NEAR_M, float(lengths.max(initial=0.0)), SIGHT_STEP_M):
        rows = np.flatnonzero(~hidden & (away < lengths - SIGHT_NEAR_M))
        at = eye + (away / lengths[rows])[:, None] * (places[rows] - eye)
        hidden[rows] = at[:, 2] < ups_m(at[:, 0], at[:, 1])
    return hidden


class ExactGridOverGround(LeastPath):
    """The grid of one map.

    ``limits_m`` (lowest, highest) height over ground; ``slopes`` (up, down) that can be flown; ``rise``
    between the nodes of a column. ``least_s`` is the least J, ``seen`` (N,) the membership of each node.
    """

    def __init__(
        self, ups_m, radars, bounds, *, start, goal, limits_m, slopes, speed, price_seen, spacing, rise
    ):
        self._ups_m = ups_m
        x = np.arange(bounds[0], bounds[1] + 1e-6, spacing)
        y = np.arange(bounds[2], bounds[3] + 1e-6, spacing)
        self._over_m = np.linspace(*limits_m, 1 + round((limits_m[1] - limits_m[0]) / rise))
        self.shape = (len(x), len(y), len(self._over_m))
        east, north = np.meshgrid(x, y, indexing="ij")
        ground = ups_m(east.ravel(), north.ravel()).reshape(east.shape)
        up = ground[:, :, None] + self._over_m
        flat = np.broadcast_to(east[:, :, None], up.shape), np.broadcast_to(north[:, :, None], up.shape)
        self.places = np.stack([*flat, up], axis=-1).reshape(-1, 3)
        self.seen = memberships_over_ground(self.places, radars, ups_m)
        rate = 1.0 + price_seen * self.seen
        heads, tails, costs = [], [], []
        for step in directions(REACH):
            for head, tail in self._edges(step, ground, spacing * math.hypot(*step), slopes):
                way = np.linalg.norm(self.places[tail] - self.places[head], axis=1)
                heads.append(head)
                tails.append(tail)
                costs.append(way / speed * 0.5 * (rate[head] + rate[tail]))
        # From the goal backwards: an edge's row is where it leads to.
        graph = csr_matrix(
            (np.concatenate(costs), (np.concatenate(tails), np.concatenate(heads))), shape=(len(rate),) * 2
        )
        self.start, self.goal = self._nearest(start), self._nearest(goal)
        found, self._before = dijkstra(graph, indices=self.goal, return_predecessors=True)
        self.least_s = float(found[self.start])

    def _edges(self, step, ground, length, slopes):
        """Numbers of nodes and of those one step on, for each pair of levels.

        ``ground`` (X, Y) is the ground below the columns. Edges that leave the limits are left out; each is
        looked at every eighth of its length.
        """
        number = np.arange(len(self.places)).reshape(self.shape)
        parts = tuple(slice(max(0, -d), n - max(0, d)) for d, n in zip(step, self.shape, strict=False))
        moved = tuple(slice(max(0, d), n - max(0, -d)) for d, n in zip(step, self.shape, strict=False))
        east, north = (self.places[:, axis].reshape(self.shape)[:, :, 0] for axis in range(2))
        shares = np.arange(1, 8)[:, None, None] / 8.0
        below = self._ups_m(
            *(((1.0 - shares) * axis[parts] + shares * axis[moved]).ravel() for axis in (east, north))
        ).reshape(len(shares), *east[parts].shape)
        for first, here in enumerate(self._over_m):
            for last, there in enumerate(self._over_m):
                begin, end = ground[parts] + here, ground[moved] + there
                over = (1.0 - shares) * begin + shares * end - below
                flown = (end - begin <= slopes[0] * length) & (begin - end <= slopes[1] * length)
                flown &= (over >= self._over_m[0] - 1e-6).all(axis=0)
                flown &= (over <= self._over_m[-1] + 1e-6).all(axis=0)
                yield number[parts][:, :, first][flown], number[moved][:, :, last][flown]

    def _nearest(self, place):
        return int(np.argmin(np.linalg.norm(self.places - np.array(place), axis=1)))

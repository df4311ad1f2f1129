"""The least J before one pursuer, on a grid: an oracle that shares no code with the planner.

A node keeps the cheapest way of each length, to the spacing, so that a detour that comes later is weighed
rightly. Edges lead to the nodes within four spacings. A second after C, from which on the pursuer could
threaten a place, costs ``pursued`` more; one of the ``SLACK_S`` before it in proportion. Obstacles are
Shapely's. A flight is in the plane, and has no turning limit.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from tests.support.exact_paths import directions

SLACK_S = 3.0
LONGEST_M = 5_000.0
FINER = 2  # values are looked up at the nearest of so many places a spacing


@dataclass
class Way:
    """The cheapest way: its J, how long it takes, and how long it is seen and under threat [s]."""

    cost_s: float
    time_s: float
    seen_s: float
    threatened_s: float


class PursuedGrid:
    """A map with a pursuer; ``seen_at`` and ``begins_at`` give m and C [s] of places (N, 2)."""

    def __init__(self, bounds, spacing, polygons, margin, *, seen_at, begins_at):
        self._spacing, self._corner = spacing, np.array([bounds[0], bounds[2]])
        self._shape = tuple(
            int((high - low) / spacing) + 1 for low, high in ((bounds[0], bounds[1]), (bounds[2], bounds[3]))
        )
        index = np.stack(np.meshgrid(*map(np.arange, self._shape), indexing="ij"), axis=-1).reshape(-1, 2)
        places = self._corner + spacing * index
        walls = shapely.union_all([shapely.Polygon(polygon).buffer(margin) for polygon in polygons])
        shapely.prepare(walls)
        seen, begins = (self._sampled(value_at) for value_at in (seen_at, begins_at))
        free = ~shapely.intersects(walls, shapely.points(places))
        self._edges = []
        for step in directions():
            there = index + step
            inside = ((there >= 0) & (there < self._shape)).all(axis=1) & free
            heads, tails = places[inside], places[inside] + spacing * np.array(step)
            lines = shapely.linestrings(np.stack([heads, tails], axis=1))
            is_open = ~shapely.intersects(walls, lines)
            shares = (np.arange(2 * max(map(abs, step))) + 0.5) / (2 * max(map(abs, step)))
            middles = index[inside][is_open][:, None] + shares[:, None] * np.array(step)
            at = tuple(np.round(FINER * middles).astype(int).transpose(2, 0, 1))
            self._edges.append(
                (np.ravel_multi_index(index[inside][is_open].T, self._shape),
                 np.ravel_multi_index(there[inside][is_open].T, self._shape),
                 spacing * math.hypot(*step), shares, seen[at].mean(axis=1), begins[at])
            )  # fmt: skip

    def _sampled(self, value_at):
        """Values at the nodes and between them."""
        num = [FINER * (n - 1) + 1 for n in self._shape]
        index = np.stack(np.meshgrid(*map(np.arange, num), indexing="ij"), axis=-1)
        places = self._corner + self._spacing / FINER * index.reshape(-1, 2)
        return value_at(places).reshape(num)

    def _node(self, place):
        return int(
            np.ravel_multi_index(
                np.round((np.array(place) - self._corner) / self._spacing).astype(int), self._shape
            )
        )

    def least(self, start, goal, *, fly_s, energy_at=lambda _speed: 0.0, seen, pursued):
        """The cheapest way from one place to another, both on the grid.

        ``fly_s`` gives the time that a flight of so many metres takes [s], ``energy_at`` what a second costs
        more at an airspeed.
        """
        bins, num = int(LONGEST_M / self._spacing), math.prod(self._shape)
        cost = np.full((bins, num), math.inf)
        sums = np.zeros((3, bins, num))  # metres flown, seconds seen and seconds under threat on the way
        cost[0, self._node(start)] = 0.0
        for now in range(bins):
            for heads, tails, length, shares, m, begins in self._edges:
                live = np.flatnonzero(np.isfinite(cost[now, heads]))
                head, tail, gone = heads[live], tails[live], sums[0, now, heads[live]]
                took = fly_s(gone + length) - fly_s(gone)
                at = fly_s(gone[:, None] + shares * length)
                danger = np.clip((at + SLACK_S - begins[live]) / SLACK_S, 0.0, 1.0).mean(axis=1)
                rate = 1.0 + energy_at(length / took) + seen * m[live] + pursued * danger
                found = cost[now, head] + took * rate
                then = ((gone + length) / self._spacing + 1e-9).astype(int)
                better = np.flatnonzero(then < bins)
                better = better[found[better] < cost[then[better], tail[better]]]
                to = then[better], tail[better]
                cost[to] = found[better]
                more = np.full(len(live), length), took * m[live], took * (at >= begins[live]).mean(axis=1)
                for part in range(3):
                    sums[part][to] = sums[part, now, head[better]] + more[part][better]
        end = self._node(goal)
        best = int(np.argmin(cost[:, end]))
        metres, seen_s, threatened_s = (float(value) for value in sums[:, best, end])
        return Way(float(cost[best, end]), float(fly_s(metres)), seen_s, threatened_s)

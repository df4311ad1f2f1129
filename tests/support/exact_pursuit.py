"""The least J before one pursuer in open country, on a grid: an oracle that shares no code with the planner.

Each node keeps all pairs of cost and time of which none is both cheaper and earlier than another, so that a
detour that comes later is weighed rightly. An edge leads to the nodes within three spacings. A second after
C, the moment from which on the pursuer could threaten a place, costs ``price`` more; the ``slack`` before it
in proportion.
"""

import heapq
import math

import numpy as np

from tests.support.exact_paths import directions

STEP_S = 1.0  # along an edge, at which danger is looked at


class Pursued:
    """A map with one pursuer that drives straight to wherever it wants."""

    def __init__(self, *, side, spacing, speed, pursuer, pursuer_speed, reach, price, slack):
        self._num, self._spacing, self._speed = int(side / spacing) + 1, spacing, speed
        self._pursuer, self._pursuer_speed, self._reach = np.array(pursuer), pursuer_speed, reach
        self._price, self._slack = price, slack

    def danger(self, place, time):
        """g: 1 from C on, and before it how little of the slack is left."""
        way = max(0.0, math.dist(place, self._pursuer) - self._reach)
        begins = way / self._pursuer_speed if self._pursuer_speed > 0.0 else math.inf if way > 0.0 else 0.0
        return min(1.0, max(0.0, (time + self._slack - begins) / self._slack))

    def _edge(self, here, there, time):
        took = math.dist(here, there) / self._speed
        num = max(1, round(took / STEP_S))
        cost = 0.0
        for k in range(1, num + 1):
            share = k / num
            place = (here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1]))
            cost += took / num * (1.0 + self._price * self.danger(place, time + share * took))
        return cost, took

    def least(self, start, goal):
        """J of the cheapest way from one place to another, both on the grid [s]."""
        nodes = [tuple(round(value / self._spacing) for value in place) for place in (start, goal)]
        fronts, queue = {}, [(0.0, 0.0, nodes[0])]
        while queue:
            cost, time, node = heapq.heappop(queue)
            if node == nodes[1]:
                return cost
            front = fronts.setdefault(node, [])
            if any(c <= cost and t <= time + 0.5 for c, t in front):
                continue
            front.append((cost, time))
            here = (node[0] * self._spacing, node[1] * self._spacing)
            for dx, dy in directions(3):
                other = (node[0] + dx, node[1] + dy)
                if not (0 <= other[0] < self._num and 0 <= other[1] < self._num):
                    continue
                more, took = self._edge(here, (other[0] * self._spacing, other[1] * self._spacing), time)
                heapq.heappush(queue, (cost + more, time + took, other))
        return math.inf

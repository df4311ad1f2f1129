"""Improving a path that reaches the goal.

The rewiring step of RRT* (Karaman, Frazzoli, IJRR 30(7), 2011) on the nodes of the path: a later node
takes an earlier one as its parent wherever a Dubins edge between them is flyable, clear, sooner there
and cheaper by (9). Sampling new nodes, and the bounds of paper 4.4.3, are not part of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from companion.kernels.splice import JOINED, is_clear, is_flyable, splice
from companion.planning.explore import Exploration
from companion.planning.route import Route, cost_between, visits_goals

SPARE_ROWS = 64


def optimised_route(
    exploration: Exploration, route: Route, should_stop: Callable[[], bool]
) -> tuple[Route, int]:
    """Rewire until the iterations are used up.

    Pairs are drawn at random, wide ones first: the reach shrinks from the whole path to a few steps.

    Returns
    -------
    Route
        The cheaper route.
    int
        How many rewirings were kept.
    """
    problem, limits = exploration.problem, exploration.limits
    settings, obstacles = problem.settings, exploration.problem.snapshot.obstacles
    kept = 0
    nowhere = np.zeros(6)
    for iteration in range(settings.optimise_iterations):
        if len(route) < 4 or should_stop():
            break
        n = len(route)
        widest = max(4, int(n * (1.0 - iteration / settings.optimise_iterations)))
        i = int(exploration.rng.integers(0, n - 3))
        j = min(n - 1, i + 3 + int(exploration.rng.integers(0, widest)))
        capacity = n + SPARE_ROWS
        states, times, rates = np.empty((capacity, 6)), np.empty(capacity), np.empty((capacity, 2))
        status, m, at = splice(
            route.states, route.times, route.rates, n, i, nowhere, False, j, limits, states, times, rates
        )
        if status != JOINED or times[at] >= route.times[j]:
            continue
        if not is_flyable(states, times, rates, m, i + 1, limits):
            continue
        if not is_clear(states, rates, times, i + 1, at + 1, obstacles, limits.margin):
            continue
        if not visits_goals(states[:m], problem.goals):
            continue
        # Rows after j keep their shape; passed sooner, they are within reach of the DTs no more than before.
        old = cost_between(exploration, route, i + 1, j + 1)
        new = cost_between(exploration, Route(states, times, rates), i + 1, at + 1)
        if new < old - 1e-9:
            route = Route(states[:m].copy(), times[:m].copy(), rates[:m].copy())
            kept += 1
    return route, kept

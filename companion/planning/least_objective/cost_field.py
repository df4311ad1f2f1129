"""The cost-to-go field V of a plan's goals, kept between plans while the world stays the same."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock

import numpy as np

from companion.kernels.arrays import Limits
from companion.kernels.objective.cost_to_go import (
    CostField,
    Heap,
    cost_to_go,
    fill_clearance,
    fill_cost_to_go,
    fill_rate,
)
from companion.kernels.objective.row_costs import Objective
from companion.planning.problem import Problem

CELLS_2D, CELLS_3D = 200, 100  # along the longer side of the bounds
CELL_MIN_M = 12.5
LEVELS_MAX, LEVEL_MIN_M = 24, 15.0
HEAP_SHARE = 8  # of the nodes: how often each may wait to be settled
ERROR_TIMES = 2.0  # what V falls by when the spacing is halved, to be taken off
KEPT = 4  # fields of some megabytes each

_fields: OrderedDict[tuple[object, ...], CostToGo] = OrderedDict()
_lock = Lock()


@dataclass(frozen=True, slots=True)
class CostToGo:
    """V, and the same at twice the spacing.

    Parameters
    ----------
    fine, coarse : CostField
        The fields of all goals.
    """

    fine: CostField
    coarse: CostField

    def bound_s(self, position_enu_m: tuple[float, float, float]) -> float:
        """A lower bound of J from a place through all goals [s]; infinite where no way leads to them.

        Upwind differences make V too large by an error of the order of ``h·log(1/h)``, ``h`` the spacing.
        Across a hundred nodes that is 1.4 times what V falls by when the spacing is halved. Twice as much is
        taken off. Where no way leads through the coarse field the error is not known, and nothing is.

        Parameters
        ----------
        position_enu_m : tuple of float
            East, north, up [m].
        """
        fine, coarse = (_least_s(field, position_enu_m) for field in (self.fine, self.coarse))
        if math.isinf(coarse):
            return fine
        return max(0.0, fine - ERROR_TIMES * max(0.0, coarse - fine))


def cost_to_go_of(problem: Problem, objective: Objective) -> CostToGo:
    """V of all goals over the bounds, the same for the same world, prices, limits and goals.

    Parameters
    ----------
    problem : Problem
        Has the goals and the world.
    objective : Objective
        What V adds up.
    """
    key = _key(problem, objective)
    with _lock:
        if key not in _fields:
            _fields[key] = CostToGo(_filled(problem, objective, 1.0), _filled(problem, objective, 2.0))
            while len(_fields) > KEPT:
                _fields.popitem(last=False)
        _fields.move_to_end(key)
        return _fields[key]


def _least_s(field: CostField, position_enu_m: tuple[float, float, float]) -> float:
    """V through all goals from a place [s]; infinite where no way leads to them."""
    return float(cost_to_go(field, 0, *position_enu_m)) + float(field.rest[0])


def _key(problem: Problem, objective: Objective) -> tuple[object, ...]:
    """What V depends on."""
    obstacles, threats, limits = objective.obstacles, objective.threats, objective.limits
    arrays = (obstacles.edges, obstacles.heights, threats.radars, threats.known, limits.bounds)
    level_m = problem.start.position_enu_m[2] if limits.dimension == 2 else None
    speeds = (limits.v_cruise, limits.climb_max, limits.descent_max, limits.wind_x, limits.wind_y)
    return (
        *(array.tobytes() for array in arrays), tuple(objective.prices), *speeds, limits.margin, level_m,
        problem.goals,
    )  # fmt: skip


def _empty(problem: Problem, limits: Limits, times: float) -> CostField:
    """A field over the bounds with nothing in it, at so many times the usual spacing."""
    west, east, south, north, low, high = (float(bound) for bound in limits.bounds)
    is_plane, longer = limits.dimension == 2, max(east - west, north - south)
    cell = times * max(CELL_MIN_M, longer / (CELLS_2D if is_plane else CELLS_3D))
    if is_plane:
        low, level, levels = problem.start.position_enu_m[2], 1.0, 1
    else:
        level = times * max(LEVEL_MIN_M, (high - low) / LEVELS_MAX)
        levels = max(2, math.ceil((high - low) / level) + 1)
    shape = (
        max(2, math.ceil((east - west) / cell) + 1),
        max(2, math.ceil((north - south) / cell) + 1),
        levels,
    )
    return CostField(
        grid=np.array([west, south, low, cell, cell, level]),
        free=np.empty(shape),
        rate=np.empty(shape),
        values=np.empty((len(problem.goals), *shape)),
        rest=np.zeros(len(problem.goals)),
    )


def _filled(problem: Problem, objective: Objective, times: float) -> CostField:
    """The field made anew, at so many times the usual spacing."""
    field = _empty(problem, objective.limits, times)
    enough = max(objective.prices.wanted, objective.limits.margin + 1.0)
    fill_clearance(field, objective.obstacles, enough)
    fill_rate(field, objective)
    room = HEAP_SHARE * field.free.size + 1
    heap = Heap(np.empty(room), np.empty(room, dtype=np.int64))
    for g, goal in reversed(list(enumerate(problem.goals))):
        centre = np.array(goal.position_enu_m)
        fill_cost_to_go(field, g, centre, objective.limits, heap)
        if g + 1 < len(problem.goals):
            field.rest[g] = field.rest[g + 1] + cost_to_go(field, g + 1, *goal.position_enu_m)
    return field

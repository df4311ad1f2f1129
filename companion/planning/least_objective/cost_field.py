"""The cost-to-go field V of a plan's goals; what does not change with pursuers is kept between plans."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import RLock
from typing import TypeVar

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.motion import turn_radius
from companion.kernels.arrays import Ground, Limits
from companion.kernels.objective.before_pursuers import Wave, fill_before_pursuers, time_to_fly
from companion.kernels.objective.cost_over_ground import DIRECTIONS, Buckets, fill_cost_over_ground
from companion.kernels.objective.cost_to_go import (
    CostField,
    Heap,
    cost_to_go,
    fill_cost_to_go,
    fill_rate,
)
from companion.kernels.objective.row_costs import DEVIATIONS_FREE, Objective, energy_excess
from companion.planning.problem import GoalRegion, Problem, StartState
from companion.world.ground.cell_lookup import cells_along

# Along the longer side of the bounds. Over ground between two heights there are as many as in a plane.
CELLS_2D, CELLS_3D = 120, 50
CELL_MIN_M = 12.5
LEVELS_MAX, LEVEL_MIN_M = 16, 15.0
LEVELS_OVER_GROUND = 6  # Levels between the limits of height over ground.
TURN_SHARE = 0.8  # Over ground, columns are at least this many turn radii apart: a step turns by an eighth.
WIND_STEP_M_S = 0.5
ROUNDED_M = 0.01  # The lowest nodes lie this far above the lowest height.
HEAP_SHARE = 8  # Each node may be in the heap this many times.
QUEUE_SHARE, NUM_BUCKETS = 2, 4096  # Each node may be in the buckets this many times a direction.
V_ERROR = 1.05  # On the grid, V of places that the best path passes is too large by less than this factor.
ERROR_UNKNOWN = 0.1  # Relative error of V where the coarse field has no value.
DEVIATION_STEP_M = 0.5
KEPT = 8  # Fields of each kind that are kept; each takes a megabyte.
ANY_COURSE_M = 1.0  # The turn radius of a wave from a goal, which may be passed on any course.
MOST_DANGER = math.inf  # Nothing is barred.

_Key = tuple[object, ...]
_Made = TypeVar("_Made")

_worlds: OrderedDict[_Key, tuple[CostField, CostField]] = OrderedDict()
_fields: OrderedDict[_Key, CostToGo] = OrderedDict()
_lock = RLock()  # The lock is re-entrant: a field needs a world, which the same function stores.


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
        """Return a lower bound of J from a place through all goals [s]; infinite where no way leads to them.

        V is too large by an error that halves at least when the spacing is halved. So it is at most what V
        falls by from the coarse field to the fine one, and that is taken off. Where no way leads through the
        coarse field the error is not known; a tenth is taken off.

        Parameters
        ----------
        position_enu_m : tuple of float
            East, north, up [m].
        """
        fine, coarse = (least_s(field, position_enu_m) for field in (self.fine, self.coarse))
        if math.isinf(coarse):
            return (1.0 - ERROR_UNKNOWN) * fine
        return max(0.0, fine - max(0.0, coarse - fine))


def cost_to_go_of(problem: Problem, objective: Objective) -> CostToGo:
    """Return V of all goals without pursuers, stored by world, prices, limits and goals.

    Parameters
    ----------
    problem : Problem
        Has the goals and the world.
    objective : Objective
        What V adds up.
    """
    if is_near_ground(problem):  # There V takes longer, and is kept while the wind hardly changes.
        limits = objective.limits
        wind_x, wind_y = (WIND_STEP_M_S * round(w / WIND_STEP_M_S) for w in (limits.wind_x, limits.wind_y))
        objective = objective._replace(limits=limits._replace(wind_x=wind_x, wind_y=wind_y))

    def make() -> CostToGo:
        fields = (_at_airspeed(field, objective) for field in _world(problem, objective))
        return CostToGo(
            *(
                _with_values(field, [field.rate] * len(problem.goals), problem, objective.limits)
                for field in fields
            )
        )

    return _get_or_create(_fields, _key(problem, objective), make)


def _get_or_create(known: OrderedDict[_Key, _Made], key: _Key, make: Callable[[], _Made]) -> _Made:
    """Return the stored value, or make and store it."""
    with _lock:
        if key not in known:
            known[key] = make()
            while len(known) > KEPT:
                known.popitem(last=False)
        known.move_to_end(key)
        return known[key]


def least_s(field: CostField, position_enu_m: tuple[float, float, float]) -> float:
    """Return V through all goals from a place [s]; infinite if no path leads to them."""
    return float(cost_to_go(field, 0, *position_enu_m)) + float(field.rest[0])


def _world_key(problem: Problem, objective: Objective) -> tuple[object, ...]:
    """Return a key of all that the cost of a second depends on, apart from pursuers and the airspeed."""
    obstacles, threats, limits = objective.obstacles, objective.threats, objective.limits
    arrays = (obstacles.edges, obstacles.heights, threats.radars, threats.known, limits.bounds)
    level_m = problem.start.position_enu_m[2] if limits.dimension == 2 else None
    steady = (tuple(objective.prices), limits.margin, level_m, _least_deviation_m(objective))
    return (*(array.tobytes() for array in arrays), *steady, obstacles.ground)


def _least_deviation_m(objective: Objective) -> float:
    """The least deviation of the position, rounded down: the field is kept while it hardly changes [m]."""
    return math.floor(float(objective.deviations.min()) / DEVIATION_STEP_M) * DEVIATION_STEP_M


def _key(problem: Problem, objective: Objective) -> tuple[object, ...]:
    """Return a key of all that V without pursuers depends on."""
    limits = objective.limits
    speeds = (limits.v_cruise, limits.climb_max, limits.descent_max, limits.wind_x, limits.wind_y)
    return (*_world_key(problem, objective), *speeds, problem.goals)


def _empty(problem: Problem, limits: Limits, times: float) -> CostField:
    """Return an empty field without goals over the bounds; ``times`` multiplies the usual spacing."""
    west, east, south, north, low, high = (float(bound) for bound in limits.bounds)
    is_plane, longer = limits.dimension == 2, max(east - west, north - south)
    ground = problem.snapshot.obstacles.ground
    is_low = is_near_ground(problem)
    turn_m = TURN_SHARE * limits.r_min if is_low else 0.0
    cell = times * max(CELL_MIN_M, turn_m, longer / (CELLS_2D if is_plane or is_low else CELLS_3D))
    if is_plane:
        low, level, levels = problem.start.position_enu_m[2], 1.0, 1
    else:
        band_m = ground.most - ground.least - 2.0 * limits.margin
        over_m = band_m / LEVELS_OVER_GROUND if is_low else (high - low) / LEVELS_MAX
        level = times * max(LEVEL_MIN_M, over_m)
        levels = max(2, math.ceil((band_m if is_low else high - low) / level) + 1)
    columns = max(2, math.ceil((east - west) / cell) + 1), max(2, math.ceil((north - south) / cell) + 1)
    floor = np.zeros(columns)
    if is_low:
        low, floor = 0.0, _lowest_over(ground, (west, south, cell), columns) + limits.margin
    shape = (*columns, levels)
    return CostField(
        grid=np.array([west, south, low, cell, cell, level]),
        floor=floor,
        rate=np.empty(shape),
        values=np.empty((0, *shape)),
        rest=np.zeros(0),
    )


def is_near_ground(problem: Problem) -> bool:
    """Return whether the height over ground is limited upwards, in space."""
    return problem.snapshot.dimension == 3 and math.isfinite(problem.snapshot.obstacles.ground.most)


def _lowest_over(ground: Ground, grid: tuple[float, float, float], columns: tuple[int, int]) -> FloatArray:
    """Return the heights at which nothing is left over ground [m], at nodes of a grid, (X, Y)."""
    at = [np.asarray(grid[axis] + grid[2] * np.arange(columns[axis])) for axis in range(2)]
    cells = [cells_along(ground, axis, at[axis]) for axis in range(2)]
    return np.asarray(ground.high[np.ix_(*cells)].astype(np.float64) + ground.least + ROUNDED_M)


def _cost_rate_fields(problem: Problem, objective: Objective) -> tuple[CostField, CostField]:
    """The cost of a second at cruise without pursuers, on grids of the usual spacing and of twice that."""
    fine, coarse = (_empty(problem, objective.limits, times) for times in (1.0, 2.0))
    least_m = _least_deviation_m(objective)
    enough = max(objective.prices.wanted, objective.limits.margin + 1.0, DEVIATIONS_FREE * least_m)
    steady = objective._replace(deviations=np.array([least_m]))
    for field in (fine, coarse):
        fill_rate(field, steady, enough)
    return fine, coarse


def _world(problem: Problem, objective: Objective) -> tuple[CostField, CostField]:
    """Return the cost of a second at cruise without pursuers, stored from plan to plan."""
    return _get_or_create(
        _worlds, _world_key(problem, objective), lambda: _cost_rate_fields(problem, objective)
    )


def _at_airspeed(world: CostField, objective: Objective) -> CostField:
    """Return the cost of a second at the airspeed of ``objective``, with the energy beyond cruise."""
    excess = energy_excess(objective.limits.v_cruise, objective.prices)
    return world._replace(rate=world.rate + objective.prices.energy * excess)


def _heap(field: CostField) -> Heap:
    """Room for the nodes that wait to be settled."""
    room = HEAP_SHARE * field.rate.size + 1
    return Heap(np.empty(room), np.empty(room, dtype=np.int64))


def buckets(num_nodes: int) -> Buckets:
    """Room for the nodes that wait to be settled in V over ground, which has ``num_nodes``."""
    room = QUEUE_SHARE * DIRECTIONS * num_nodes
    entries = (np.empty(room), np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64))
    return Buckets(*entries, np.empty(NUM_BUCKETS, np.int64), np.zeros(2, np.int64), np.ones(1))


def field_before_pursuers(
    problem: Problem,
    objective: Objective,
    danger_max: float,
    cost_max: float = math.inf,
    *,
    is_coarse: bool = False,
) -> CostField:
    """Return V of all goals with the cost of pursuers; V is infinite where they bar the way.

    Pursuers cost what they do when the aircraft is there, on the way to the first goal, or from one goal to
    the next.

    V is infinite, too, at places through which no path costs at most ``cost_max``, by V without pursuers from
    there on and a straight flight to there.

    Parameters
    ----------
    problem : Problem
        Has the start, the goals and the world.
    objective : Objective
        What V adds up.
    danger_max : float
        Most danger from pursuers at which a place may be passed; :data:`MOST_DANGER` bars nothing.
    cost_max : float
        A path that costs more than this is not sought [s].
    is_coarse : bool
        Whether twice the usual spacing is enough.
    """
    start, limits = problem.start, objective.limits
    field = _at_airspeed(_world(problem, objective)[is_coarse], objective)
    if math.isfinite(cost_max):
        alone = cost_to_go_of(problem, objective)
        is_near = (
            _least_through(alone.coarse if is_coarse else alone.fine, start, limits) <= V_ERROR * cost_max
        )
        field = field._replace(rate=np.where(is_near, field.rate, np.inf))
    begin = np.array([*start.position_enu_m, start.stamp_s, start.airspeed_m_s, start.direction_rad])
    radius = turn_radius(min(start.airspeed_m_s, limits.v_cruise), limits)
    rates = list[FloatArray]()
    for goal in problem.goals:
        if math.isinf(begin[3]):  # Nothing comes to the goal before, and V is infinite everywhere.
            rates.append(rates[-1])
            continue
        wave = _wave(field, begin, radius, objective.prices.pursued, danger_max)
        is_last = len(rates) == len(problem.goals) - 1
        priced = field if is_last else field._replace(rate=field.rate.copy())
        fill_before_pursuers(wave, priced, objective, _heap(field))
        rates.append(priced.rate)
        if not is_last:
            begin, radius = _beyond(goal, wave, field, limits), ANY_COURSE_M
    return _with_values(field, rates, problem, limits)


def _wave(field: CostField, begin: FloatArray, radius_m: float, price: float, danger_max: float) -> Wave:
    """Return a wave that begins at ``begin``, shape (6,), and has room for its results."""
    is_barred = danger_max < MOST_DANGER
    return Wave(
        start=begin,
        rate=np.where(np.isinf(field.rate), np.inf, 1.0) if is_barred else field.rate.copy(),
        value=np.empty_like(field.rate),
        time=np.empty_like(field.rate),
        danger=np.empty_like(field.rate),
        danger_max=danger_max,
        price=0.0 if is_barred else price,
        radius=radius_m,
    )


def _beyond(goal: GoalRegion, wave: Wave, field: CostField, limits: Limits) -> FloatArray:
    """Return where and when a wave begins that goes on from a goal, shape (6,); its time may be infinite."""
    times = field._replace(
        values=np.where(np.isinf(wave.value), np.inf, wave.time)[np.newaxis], rest=np.zeros(1)
    )
    flown_m = float(cost_to_go(times, 0, *goal.position_enu_m)) * limits.v_cruise
    due_s = wave.start[3] + time_to_fly(flown_m, wave.start[4], limits) if flown_m < math.inf else math.inf
    return np.array([*goal.position_enu_m, due_s, limits.v_cruise, 0.0])


def _least_through(field: CostField, start: StartState, limits: Limits) -> FloatArray:
    """Return the least J through each node of V without pursuers: straight flight there, and V from there.

    Returns
    -------
    ndarray, shape (X, Y, Z)
        In seconds.
    """
    num = len(field.rest)
    to_go = field.values.reshape(num, -1, *field.rate.shape).min(axis=1)
    x, y = (
        field.grid[axis]
        + field.grid[3 + axis] * np.arange(field.rate.shape[axis])
        - start.position_enu_m[axis]
        for axis in range(2)
    )
    fastest = limits.v_cruise + math.hypot(limits.wind_x, limits.wind_y)
    there_s = np.hypot(x[:, None], y[None, :]) / fastest
    return np.asarray((to_go + field.rest[:, None, None, None]).min(axis=0) + there_s[:, :, None])


def _with_values(
    field: CostField, rates: Sequence[FloatArray], problem: Problem, limits: Limits
) -> CostField:
    """Return V of all goals; ``rates``, each (X, Y, Z), are the cost of a second on the way to each goal."""
    num, is_low = len(problem.goals), bool(field.floor.any())
    heap, layers = _heap(field), num * (DIRECTIONS if is_low else 1)
    queue = buckets(field.rate.size) if is_low else None
    field = field._replace(values=np.empty((layers, *field.rate.shape)), rest=np.zeros(num))
    for g, goal in reversed(list(enumerate(problem.goals))):
        centre, field = np.array(goal.position_enu_m), field._replace(rate=rates[g])
        if queue is not None:
            fill_cost_over_ground(field, g, centre, limits, heap, queue)
        else:
            fill_cost_to_go(field, g, centre, limits, heap)
        if g + 1 < num:
            field.rest[g] = field.rest[g + 1] + cost_to_go(field, g + 1, *goal.position_enu_m)
    return field

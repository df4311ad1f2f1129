"""Distance fields round obstacles, by which samples and hand-overs find their way, and races along them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import position_deviation
from companion.kernels.arrays import Game, Guide, Limits, Obstacles, Scene, Tree
from companion.kernels.geometry.distance_field import distance_to_go, fill_distances, fill_free
from companion.kernels.search.dynamic_domain_rrt import DRAWS
from companion.kernels.search.growth import LEAST_CLEAR, grow
from companion.kernels.search.path_edit import air_time, path_cost
from companion.kernels.search.state_lattice import UNFINISHED, num_cells, race, race_from
from companion.kernels.threat.pursuit_game import fill_ways_free
from companion.kernels.workspace import PathRows, Workspace, empty_rows
from companion.planning.settings import PlannerSettings

FIELD_CELLS = 97  # each way, of the grid about a sub goal
CELL_MIN_M, CELLS_MAX = 30.0, 256  # of the grid over the bounds
RACE_SHARE = 0.75  # of a goal's radius
RACED_ASIDE = (3.0, 2.0)  # deviations that a race keeps from walls where one along them is too risky
RISK_RACED = 0.05  # of -log Q
MAX_RACE = 2048  # steps of a race
ABOVE_LIMIT = -2  # instead of a node: the way that was found first comes above the limit of the threat level
BURST = 4_000  # poses of a race between which it is asked whether time is over
# Times the way to go is counted: more finds a way sooner, dearer by no more than that.
EAGER, KEEN, GREEDY = 1.1, 3.0, 5.0
BRIEF_BURSTS = 5  # after which a race is given up that is not to take long
NO_GUIDE = Guide(np.full((1, 1), np.inf), np.zeros(2), 1.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Ways:
    """Where an aircraft may fly within the bounds.

    Parameters
    ----------
    free : ndarray, shape (N, M)
        How many times its length each cell of a grid counts that it may pass, else 0.
    origin : ndarray, shape (2,)
        The first cell's centre, east and north [m].
    cell : float
        The spacing [m].
    """

    free: FloatArray
    origin: FloatArray
    cell: float

    def at(self, guide: Guide) -> FloatArray:
        """What is free at each cell of another grid.

        Parameters
        ----------
        guide : Guide
            Has that grid.

        Returns
        -------
        ndarray, shape (N, M)
            0 outside the bounds.
        """
        num, across = self.free.shape
        rows, columns = (
            np.rint((guide.origin[axis] + np.arange(count) * guide.cell - self.origin[axis]) / self.cell)
            for axis, count in enumerate(guide.field.shape)
        )
        inside = np.outer((rows >= 0) & (rows < num), (columns >= 0) & (columns < across))
        clipped = np.clip(rows, 0, num - 1).astype(np.int64), np.clip(columns, 0, across - 1).astype(np.int64)
        return np.where(inside, self.free[np.ix_(*clipped)], 0.0)


def ways_clear(goal: FloatArray, limits: Limits, obstacles: Obstacles) -> Ways:
    """Where obstacles leave room at the height of a goal.

    Parameters
    ----------
    goal : ndarray, shape (3,)
        Centre of a goal region [m].
    limits : Limits
        Margin and bounds.
    obstacles : Obstacles
        What is gone round.
    """
    guide = _over_bounds(limits)
    free = np.zeros(guide.field.shape)
    fill_free(goal, np.inf, limits.margin, limits.bounds, obstacles, guide, free)
    return Ways(free, guide.origin, guide.cell)


def ways_before(
    ways: Ways, game: Game, state: FloatArray, stamp_s: float, limits: Limits, dear: float = 0.0
) -> Ways:
    """Those of the ways that can be flown before a DT could threaten them; or all, the others ``dear``.

    Parameters
    ----------
    ways : Ways
        Clear of obstacles.
    game : Game
        What the DTs could do.
    state : ndarray, shape (6,)
        Where the aircraft begins.
    stamp_s : float
        When it is there [s].
    limits : Limits
        The aircraft's speed, and the wind.
    dear : float
        How many times their length others count; 0 if they are none.
    """
    free = ways.free.copy()
    speed = max(limits.v_cruise, state[5]) + math.hypot(limits.wind_x, limits.wind_y)
    start = (float(state[0]), float(state[1]), float(state[2]), stamp_s)
    fill_ways_free(free, ways.origin, ways.cell, game, start, speed, dear)
    return Ways(free, ways.origin, ways.cell)


def guide_to(
    point: FloatArray, limits: Limits, settings: PlannerSettings, obstacles: Obstacles,
    ways: Ways | None = None,
) -> Guide:  # fmt: skip
    """The distance field of a point, over twice the sensing horizon about it.

    Parameters
    ----------
    point : ndarray, shape (3,)
        A sub goal [m].
    limits : Limits
        Margin, bounds and the length of a step.
    settings : PlannerSettings
        The sensing horizon, and how many samples follow the field.
    obstacles : Obstacles
        What is gone round.
    ways : Ways, optional
        Where alone it leads.
    """
    radius = 2.0 * settings.sensing_horizon_m
    cell = 2.0 * radius / (FIELD_CELLS - 1)
    share = settings.guided_share if settings.strategies.follow_field else 0.0
    steps_m = settings.guided_steps * (limits.v_cruise * limits.tau)
    guide = Guide(np.empty((FIELD_CELLS, FIELD_CELLS)), point[:2] - radius, cell, share, steps_m)
    free = np.empty(guide.field.shape)
    fill_free(point, radius, limits.margin, limits.bounds, obstacles, guide, free)
    if ways is not None:
        free *= ways.at(guide)
    fill_distances(point, guide, free)
    return guide


def guide_home(goal: FloatArray, ways: Ways) -> Guide:
    """The distance field of a goal, over everything within the bounds.

    Parameters
    ----------
    goal : ndarray, shape (3,)
        Centre of a goal region [m].
    ways : Ways
        Where it leads.
    """
    guide = Guide(np.empty(ways.free.shape), ways.origin, ways.cell, 0.0, 0.0)
    fill_distances(goal, guide, ways.free.copy())
    return guide


def _over_bounds(limits: Limits) -> Guide:
    """An empty field over everything within the bounds."""
    b = limits.bounds
    cell = max(CELL_MIN_M, max(b[1] - b[0], b[3] - b[2]) / CELLS_MAX)
    empty = np.empty((int((b[1] - b[0]) / cell) + 1, int((b[3] - b[2]) / cell) + 1))
    return Guide(empty, np.array([b[0], b[2]]), cell, 0.0, 0.0)


def distances_to_go(guide: Guide, places: FloatArray) -> FloatArray:
    """Distance to go from places near a sub goal, by the nearest node of its field.

    Parameters
    ----------
    guide : Guide
        Made by :func:`guide_to`.
    places : ndarray, shape (N, 2)
        East and north [m].

    Returns
    -------
    ndarray, shape (N,)
        Infinite where there is no way [m].
    """
    index = np.rint((places - guide.origin) / guide.cell).astype(np.int64)
    index = np.clip(index, 0, FIELD_CELLS - 1)
    return guide.field[index[:, 0], index[:, 1]]


def has_way(guide: Guide, state: FloatArray) -> bool:
    """Whether a field leads from somewhere to where it belongs to.

    Parameters
    ----------
    guide : Guide
        The distance field.
    state : ndarray, shape (≥ 2,)
        East and north first [m].
    """
    return math.isfinite(distance_to_go(guide, state[0], state[1]))


def raced_with_room(
    tree: Tree, root: int, goal: FloatArray, home: Guide, scene: Scene, work: Workspace, *,
    rng: np.random.Generator, should_stop: Callable[[], bool], is_weighed: bool, shuns_risk: bool,
    is_brief: bool,
) -> int:  # fmt: skip
    """As :func:`raced`, and where that way leads along walls again, farther from them; the less risky one.

    Parameters
    ----------
    goal : ndarray, shape (4,)
        Centre and radius of the goal region [m].
    tree, root, home, scene, work, rng, should_stop, is_weighed, is_brief
        As there.
    shuns_risk : bool
        Whether risk counts at all.
    """
    race_to = partial(raced, tree, root, goal, home, work=work, rng=rng, should_stop=should_stop)
    node, limits = race_to(scene=scene, is_weighed=is_weighed, is_brief=is_brief), scene.limits
    for deviations in RACED_ASIDE if shuns_risk else ():
        if node < 0 or log_risk(tree, node) < RISK_RACED:
            break
        spread = position_deviation(tree.cov_error[node], tree.cov_estimate[node], limits.dimension)
        aside = limits._replace(margin=max(limits.margin, deviations * spread))
        another = race_to(scene=scene._replace(limits=aside))
        if another >= 0 and log_risk(tree, another) < log_risk(tree, node):
            node = another
    return node


def log_risk(tree: Tree, node: int) -> float:
    """-log Q of (8) over the branch to a node.

    Parameters
    ----------
    tree : Tree
        What it belongs to.
    node : int
        The branch's end.
    """
    total = 0.0
    while node >= 0:
        total -= math.log(max(float(tree.clear[node]), LEAST_CLEAR))
        node = int(tree.parent[node])
    return total


def raced(
    tree: Tree, root: int, goal: FloatArray, home: Guide, scene: Scene, work: Workspace, *,
    rng: np.random.Generator, should_stop: Callable[[], bool], is_weighed: bool = False,
    is_brief: bool = False,
) -> int:  # fmt: skip
    """Grow the earliest way to a goal that no DT could bar; its last node, or -1 where none was found.

    In the plane only. Where threats are weighed the cheapest, but for a tenth; where time or room is over
    before that is known, one that is found sooner, or far sooner: among pursuers that wait everywhere the way
    to go says little of what is still to come, and who minds it less looks at all there is.

    Parameters
    ----------
    tree : Tree
        Receives the way's nodes.
    root : int
        The node from which the goal is to be reached.
    goal : ndarray, shape (4,)
        Centre and radius of the goal region [m].
    home : Guide
        The goal's distance field, where no DT could be in time.
    scene : Scene
        What the search reads.
    work : Workspace
        The scratch, which counts.
    rng : numpy.random.Generator
        The source of what the estimator of reachable nodes draws.
    should_stop : callable
        Asked now and then whether time is over.
    is_weighed : bool
        Whether places that a DT could threaten are dear, else barred.
    is_brief : bool
        Whether, weighed, no cheaper way is looked for where the first comes above the limit of the threat
        level; :data:`ABOVE_LIMIT` is returned.
    """
    if not has_way(home, tree.state[root]):
        return -1
    run = partial(_run, tree, root, goal, scene=scene, work=work)
    if is_weighed:
        is_above = partial(_is_above_limit, float(tree.delta[root]), scene, work) if is_brief else None
        rows, n = _weighed(run, home, should_stop, is_above)
        if n < 0:
            return ABOVE_LIMIT
    else:
        rows, n = run(home, should_stop=should_stop)
    if n == 0 or int(tree.count[0]) + n > len(tree.parent):
        return -1
    node, draws = root, rng.random((n, DRAWS))
    for k in range(1, n):
        dt = float(air_time(rows, k, scene.limits))
        control = np.array([(rows.states[k, 5] - rows.states[k - 1, 5]) / dt, *rows.rates[k]])
        node = grow(tree, scene, node, rows.states[k], control, dt, draws[k], work.growth, work.stats)
        if node < 0:
            break
    return int(node)


def _weighed(
    run: Callable[..., tuple[PathRows, int]], home: Guide, should_stop: Callable[[], bool],
    is_above: Callable[[PathRows, int], bool] | None,
) -> tuple[PathRows, int]:  # fmt: skip
    """The cheapest way that races find until time is over: a greedy one first, and a keener one after it.

    Parameters
    ----------
    run : callable
        Races along a distance field, until a stopping rule holds; rows, and how many, 0 without a way.
    home : Guide
        The goal's distance field.
    should_stop : callable
        Asked now and then whether time is over; some way is looked for however late it is.
    is_above : callable or None
        In a hurry: whether a way comes above the limit of the threat level; where the first does, it is
        :data:`ABOVE_LIMIT` rows.
    """

    def counted(times: float, until: Callable[[], bool]) -> tuple[PathRows, int]:
        return run(home._replace(field=times * home.field), should_stop=until)

    rows, n = counted(GREEDY, _after(BRIEF_BURSTS))
    until = should_stop if is_above is None else _after(BRIEF_BURSTS)
    keen, m = counted(KEEN, until if n > 0 else lambda: False)
    rows, n = (keen, m) if m > 0 else (rows, n)
    if is_above is not None and n > 0 and is_above(rows, n):
        return rows, ABOVE_LIMIT
    if m == 0:
        return rows, n
    eager, k = counted(EAGER, should_stop)
    return (eager, k) if k > 0 else (rows, n)


def _is_above_limit(deviation: float, scene: Scene, work: Workspace, rows: PathRows, n: int) -> bool:
    """Whether a way of ``n`` rows comes above the threat limit; ``deviation`` at its start, in units."""
    return math.isinf(path_cost(rows, 1, n, deviation, scene, work))


def _after(bursts: int) -> Callable[[], bool]:
    """A stopping rule that holds once it was asked so many times."""
    asked = itertools.count(1)
    return lambda: next(asked) >= bursts


def _run(
    tree: Tree, root: int, goal: FloatArray, home: Guide, scene: Scene, work: Workspace, *,
    should_stop: Callable[[], bool],
) -> tuple[PathRows, int]:  # fmt: skip
    """A race to ``goal`` (4,) [m] until time is over; its steps, and how many they are, 0 without a way."""
    rows, field = empty_rows(MAX_RACE), race_from(tree, root, np.zeros(num_cells(scene.limits)))
    while True:
        n = race(field, goal, RACE_SHARE * goal[3], home, scene, rows, BURST, work)
        if n != UNFINISHED or should_stop():
            return rows, max(n, 0)

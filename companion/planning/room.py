"""Room that a path is given where it costs little (not in the paper).

Theory of operation. p_c (7) keeps a path as far from obstacles as the filter's uncertainty asks for. A
position that is wrong by more than any filter says, after a GNSS jump say, is met by nothing but distance:
while it is doubted nothing is planned, and the autopilot flies its mission beside where it should. A path
that is short touches every corner's margin. So the room that waypoints lack, to ``clearance_wanted_m``, has
a price in (9), beside that of way and of seconds that a DT could threaten: for trees, races that weigh,
short cuts, and the choice between paths. At last waypoints near obstacles are moved away from them, and
joined to the path again by Dubins edges, where that is worth it.
"""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.kernels.search.lay_aside import Aside, fill_rooms, lack_of_room, lay_aside
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.route import Assessment, Route, assess_route, visits_goals, weighed_between

MOVES = 24  # tried on one path
SHARES = (1.0, 0.6, 0.3)  # of the room that is lacking, tried in turn
LEADS = np.array([4, 6, 8, 10, 13, 16, 20, 25, 32])  # rows laid anew before and after the one that is moved
TURNS = np.array([0.0, 0.2, -0.2, 0.4, -0.4, 0.7, -0.7])  # of its direction [rad]
LEAST_M = 5.0  # of room that is lacking; less is let be
LEAST_GAIN_M = 10.0  # of room, over all rows: less is not worth a move
SPARE_ROWS = 96


def widened_route(exploration: Exploration, route: Route, known: Assessment) -> tuple[Route, Assessment, int]:
    """Move waypoints away from obstacles, the nearest first, to where there is the room that is wanted.

    Returns
    -------
    Route
        The route with more room.
    Assessment
        What is known along it, as ``known`` is of the route given.
    int
        How many moves were made.
    """
    wanted, obstacles = exploration.problem.settings.room_wanted_m, exploration.problem.snapshot.obstacles
    moved, tried = 0, set[tuple[float, ...]]()
    for _ in range(MOVES if wanted > 0.0 else 0):
        rooms = np.empty((len(route), 3))
        fill_rooms(route.states, obstacles, wanted, rooms)
        places = [tuple(place) for place in route.states[:, :3]]
        may_move = rooms[:, 1:].any(axis=1) & np.array([place not in tried for place in places])
        k = int(np.argmin(np.where(may_move, rooms[:, 0], wanted)))
        if not may_move[k] or rooms[k, 0] > wanted - LEAST_M:
            break
        found = _with_more_room(exploration, route, k, (wanted - rooms[k, 0]) * rooms[k, 1:])
        if found is None:
            tried.update(places[max(k - 1, 0) : k + 2])
            continue
        route, moved = found[0], moved + 1
        known = assess_route(exploration, route, known, found[1])
    return route, known, moved


def price_of_room(exploration: Exploration, route: Route, first: int = 0, last: int | None = None) -> float:
    """What the room costs that is lacking on rows ``first`` to ``last``, by default all, by (9).

    Parameters
    ----------
    exploration : Exploration
        The search that it belongs to.
    route : Route
        A path.
    first, last : int
        Rows that count.
    """
    search, obstacles = exploration.scene().search, exploration.problem.snapshot.obstacles
    if search.cost_room == 0.0:
        return 0.0
    end = len(route) - 1 if last is None else last
    return search.cost_room * float(lack_of_room(route.states, first, end, obstacles, search.room))


def least_room(exploration: Exploration, route: Route) -> float:
    """How near a route comes to anything, up to the room that is wanted [m]."""
    wanted, rooms = exploration.problem.settings.room_wanted_m, np.empty((len(route), 3))
    fill_rooms(route.states, exploration.problem.snapshot.obstacles, wanted, rooms)
    return float(rooms[:, 0].min())


def _with_more_room(
    exploration: Exploration, route: Route, k: int, aside: FloatArray
) -> tuple[Route, int] | None:
    """The route with row ``k`` moved by as much of ``aside`` (2,) [m] as is worth it; None where nothing is.

    With it the first row that is another.
    """
    problem, settings, limits = exploration.problem, exploration.problem.settings, exploration.limits
    trial, best = empty_rows(len(route) + SPARE_ROWS), empty_rows(len(route) + SPARE_ROWS)
    search = Aside(LEADS, TURNS, settings.room_wanted_m, settings.way_for_room(limits), LEAST_GAIN_M)
    for share in SHARES:
        n, first, last, at = lay_aside(
            route.rows, k, share * aside, search, limits, problem.snapshot.obstacles, trial, best
        )
        if n == 0:
            continue
        moved = Route.of(best, n)
        after = weighed_between(exploration, moved, first + 1)
        after += price_of_room(exploration, moved, first + 1, at)
        before = weighed_between(exploration, route, first + 1)
        before += price_of_room(exploration, route, first + 1, last)
        if after <= before and visits_goals(moved.states, problem.goals):
            return moved, first + 1
    return None

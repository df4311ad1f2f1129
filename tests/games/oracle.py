"""Which pursuit games can be won, worked out apart from everything that plans.

The pursuer drives at full speed at once, in any direction, along walls but not through them. Where it can
be first is known everywhere (T), and so from when on it can threaten a place (C), whatever it does before.
A way on which the aircraft is at every place before C of it is safe from a pursuer that knew it all along.
Waiting is of no use to the aircraft, since C is a latest time.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.sparse.csgraph import dijkstra
from shapely import Polygon

from tests.games import geometry

SPACING_M = 25.0
CELL_M = 12.5  # of the lattice
FINE_M = 12.5  # between the places the pursuer is first taken to look from
FAST_M_S = 33.75
SLACK_S = 5.0
CLEAR_M = 30.0
ROUGH_S = 3.0  # by which the lattice's ways may be late: two in a hundred
REPAIRS = 20
EDGE_S = 5.0  # by which the edge of the goal may be open longer than its middle
# The pursuer may touch walls and look along them: what stops it is the walls less a centimetre.
_SKIN_M = 0.01


@dataclass(frozen=True)
class Field:
    """Values (columns east, rows north) at the points of a grid."""

    values: np.ndarray
    west_m: float
    south_m: float
    spacing_m: float

    def nearest(self, east_m, north_m):
        """Value at the grid point next to a place."""
        i, j = (
            round((east_m - self.west_m) / self.spacing_m),
            round((north_m - self.south_m) / self.spacing_m),
        )
        return float(self.values[i, j])


@dataclass(frozen=True, eq=False)
class Game:
    """What the oracle knows of a mission.

    ``bounds_m`` west, east, south, north; ``start`` east, north, course; ``goal`` east, north, radius.
    """

    bounds_m: tuple[float, float, float, float]
    start: tuple[float, float, float]
    goal: tuple[float, float, float]
    polygons: tuple
    pursuer: tuple[float, float]
    pursuer_m_s: float
    reach_m: float
    turn_radius_m: float = 125.0
    cruise_m_s: float = 25.0
    acceleration_m_s2: float = 0.5

    @functools.cached_property
    def walls(self):
        """All obstacles in one."""
        return shapely.union_all([Polygon(corners) for corners in self.polygons])

    @functools.cached_property
    def faces(self):
        """Edges of the obstacles, from which the aircraft keeps clear."""
        return edges_of(self.walls)

    @functools.cached_property
    def blinds(self):
        """Edges through which the pursuer neither drives nor sees."""
        return edges_of(self.walls.buffer(-_SKIN_M, join_style="mitre"))

    @functools.cached_property
    def nodes(self):
        """The pursuer's place and the corners it may turn about, and when it can be there.

        Corners on the bounds are none: beyond them there is no way.
        """
        west, east, south, north = self.bounds_m
        corners = self.faces[:, :2]
        is_inside = (corners[:, 0] > west) & (corners[:, 0] < east)
        is_inside &= (corners[:, 1] > south) & (corners[:, 1] < north)
        nodes = np.vstack([[self.pursuer], corners[is_inside]])
        ways = dijkstra(geometry.sight_lengths(nodes, self.blinds), directed=False, indices=0)
        return nodes, ways / self.pursuer_m_s

    @functools.cached_property
    def fine_arrival(self):
        """T at the places the pursuer is taken to look from."""
        return arrival(self, FINE_M)

    @functools.cached_property
    def gaps(self):
        """Distances from the obstacles."""
        places, shape = grid_of(self.bounds_m, FINE_M)
        return geometry.clearances(places, self.faces).reshape(shape)

    @functools.cached_property
    def latest(self):
        """C on the grid."""
        return threatened_from(self)

    @functools.cached_property
    def shortest(self):
        """The soonest way at cruise that minds no pursuer, as from :func:`solve`."""
        return solve(self, self.cruise_m_s, slack_s=-math.inf)


def game_of(mission):
    """The game in a mission file with one goal and one pursuer."""
    (threat,), (goal,) = mission.dynamic_threats, mission.goals
    start, vehicle, bounds = mission.start, mission.vehicle, mission.bounds
    return Game(
        bounds_m=(*map(float, bounds.east_m), *map(float, bounds.north_m)),
        start=(float(start.east_m), float(start.north_m), math.radians(start.course_deg)),
        goal=(float(goal.east_m), float(goal.north_m), float(goal.acceptance_radius_m)),
        polygons=tuple(np.array(entry.polygon_enu_m, dtype=float) for entry in mission.obstacles),
        pursuer=(float(threat.east_m), float(threat.north_m)),
        pursuer_m_s=float(threat.speed_m_s),
        reach_m=float(threat.max_threat_radius_m),
        turn_radius_m=float(vehicle.turn_radius_min_m),
        cruise_m_s=float(vehicle.airspeed_cruise_m_s),
        acceleration_m_s2=float(vehicle.acceleration_max_m_s2),
    )


def edges_of(walls):
    """Rows ``(ax, ay, bx, by)`` of all rings."""
    found = [np.empty((0, 4))]
    for polygon in getattr(walls, "geoms", [walls]):
        for ring in (polygon.exterior, *polygon.interiors) if not polygon.is_empty else ():
            corners = shapely.get_coordinates(ring)
            found.append(np.hstack([corners[:-1], corners[1:]]))
    return np.ascontiguousarray(np.vstack(found))


def grid_of(bounds_m, spacing_m):
    """Places of a grid that covers the bounds, and how many columns and rows they make."""
    west, east, south, north = bounds_m
    columns = west + spacing_m * np.arange(math.ceil((east - west) / spacing_m - 1e-9) + 1)
    rows = south + spacing_m * np.arange(math.ceil((north - south) / spacing_m - 1e-9) + 1)
    places = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1)
    return places.reshape(-1, 2), places.shape[:2]


def arrival(game, spacing_m=SPACING_M):
    """T: when the pursuer can first be at each place, by the shortest way round the obstacles.

    Exact, by a visibility graph; infinite in obstacles and where it cannot get to.
    """
    places, shape = grid_of(game.bounds_m, spacing_m)
    found = geometry.soonest_all(places, *game.nodes, 1.0 / game.pursuer_m_s, game.blinds)
    return Field(found.reshape(shape), game.bounds_m[0], game.bounds_m[2], spacing_m)


def threatened_at(game, places):
    """C of places (N, 2): the least T of where they are within reach and in sight.

    T, sight and reach are exact. The best of the pursuer's start, all corners and a grid of 12.5 m is
    looked for, and from there on in steps down to a metre; only a slit of sight that shows none of them
    is missed.
    """
    fine = game.fine_arrival
    return geometry.least_seen(
        np.ascontiguousarray(places, dtype=float), game.reach_m, *game.nodes, 1.0 / game.pursuer_m_s,
        fine.values, fine.west_m, fine.south_m, FINE_M, game.blinds,
    )  # fmt: skip


def threatened_from(game):
    """C on the grid: from when on the pursuer can threaten each place, whatever it does before."""
    places, shape = grid_of(game.bounds_m, SPACING_M)
    return Field(threatened_at(game, places).reshape(shape), game.bounds_m[0], game.bounds_m[2], SPACING_M)


def solve(game, speed, slack_s=SLACK_S, clear_m=CLEAR_M):
    """The soonest way over the lattice that is safe, in rows (t, east, north); ``None`` if there is none.

    Turns are of the least radius, pieces of 15 degrees or straight of the same length. The speed changes
    from cruise by the vehicle's acceleration until it is ``speed``. Between grid points the least C of the
    four around counts; a way is then looked at exactly, and where it is caught all the same, the grid is
    put right and the search repeated. A ``slack_s`` of minus infinity leaves the pursuer out.
    """
    motion = np.array([game.cruise_m_s, speed, game.acceleration_m_s2, game.turn_radius_m])
    _, shape = grid_of(game.bounds_m, SPACING_M)
    is_pursued = slack_s > -math.inf
    latest = game.latest.values.copy() if is_pursued else np.full(shape, np.inf)
    for _ in range(REPAIRS):
        turns, last = geometry.lattice_way(
            np.array(game.start), np.array(game.goal), np.array(game.bounds_m), motion,
            np.array([slack_s, clear_m]), game.faces, game.gaps, FINE_M, latest, SPACING_M, CELL_M,
        )  # fmt: skip
        if not len(turns):
            return None
        rows = _rows(game, motion, turns, last)
        caught = threatened_at(game, rows[:, 1:]) if is_pursued else np.full(len(rows), np.inf)
        is_late = ~(rows[:, 0] + slack_s < caught)
        if not is_late.any():
            return rows
        for (_, east, north), value in zip(rows[is_late], caught[is_late], strict=True):
            i, j = int((east - game.bounds_m[0]) / SPACING_M), int((north - game.bounds_m[2]) / SPACING_M)
            latest[i, j] = min(latest[i, j], value)
    return None


def _rows(game, motion, turns, last):
    """Rows (t, east, north) along the pieces."""
    x, y, course = game.start
    angle = 2.0 * math.pi / geometry.NUM_COURSES
    piece = game.turn_radius_m * angle
    rows = [(0.0, x, y)]
    for index, turn in enumerate(turns):
        steps = last if index == len(turns) - 1 else geometry.STEPS
        for step in range(1, steps + 1):
            part = step / geometry.STEPS
            place = geometry.moved(x, y, course, int(turn), piece * part, game.turn_radius_m)
            rows.append((geometry.time_of_length(piece * (index + part), *motion[:3]), *place))
        x, y = rows[-1][1:]
        course += turn * angle
    return np.array(rows)


def first_threatened_s(rows, game):
    """First time of rows (t, east, north) that is not before C of its place; infinite if there is none."""
    rows = np.asarray(rows, dtype=float)
    is_threatened = rows[:, 0] >= threatened_at(game, rows[:, 1:3])
    return float(rows[np.argmax(is_threatened), 0]) if is_threatened.any() else math.inf


def kind_of(game):
    """What wins: ``route``, another way at cruise; ``speed``, only a faster flight; else nothing.

    In both the shortest way is caught. Since the lattice's ways are a little longer than others, one that
    only just fails at cruise is none of speed.
    """
    straight_m = math.dist(game.start[:2], game.goal[:2]) - game.goal[2]
    if threatened_at(game, np.array([game.goal[:2]]))[0] < straight_m / FAST_M_S - EDGE_S:
        return ""  # nobody is there in time: no need to search
    if game.shortest is None or first_threatened_s(game.shortest, game) == math.inf:
        return ""
    if solve(game, game.cruise_m_s) is not None:
        return "route"
    if solve(game, game.cruise_m_s, slack_s=SLACK_S - ROUGH_S) is not None:
        return ""
    return "speed" if solve(game, FAST_M_S) is not None else ""


def seconds_under_threat(truth_path, threat_path, polygons, reach_m):
    """Seconds of rows (t, east, north, …) with the pursuer within reach, over the ground, and in sight.

    ``threat_path`` has rows (t, east, north). Each row counts until the next.
    """
    path, threat = np.asarray(truth_path, dtype=float), np.asarray(threat_path, dtype=float)
    there = np.column_stack([np.interp(path[:, 0], threat[:, 0], threat[:, axis]) for axis in (1, 2)])
    is_near = np.hypot(*(path[:, 1:3] - there).T) <= reach_m
    walls = shapely.union_all([Polygon(corners) for corners in polygons])
    shapely.prepare(walls)
    lines = shapely.linestrings(np.stack([path[:, 1:3], there], axis=1))
    is_threatened = is_near & ~shapely.intersects(walls, lines)
    return float(np.diff(path[:, 0])[is_threatened[:-1]].sum())

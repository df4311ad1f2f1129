"""Random maps for pursuit games: mission files with walls to hide behind and one pursuer."""

import math

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import rotate, translate

KINDS = ("route", "speed")
PURSUER_SPEEDS_M_S = {"route": (12.0, 25.0), "speed": (20.0, 27.0)}
REACHES_M = (230.0, 300.0)
GRID_M = 25
SIDES = (3000 // GRID_M, 4500 // GRID_M)
NUM_OBSTACLES = (8, 21)
CLEAR_M = 60.0  # of start, goal and the first leg
AHEAD_M = 300.0
GAP_M = 100.0  # between obstacles: 30 m on either side, and room to steer
ON_THE_ROAD_M = 25.0  # simulated pursuers keep 12 m from walls
AREA_MIN_M2 = 2000.0
TRIES = 400
GOAL_RADIUS_M = 60.0
CRUISE_M_S = 25.0
BEST_M_S = {"route": 25.0, "speed": 31.0}  # what may be flown on average
EARLY = {"route": 1.0, "speed": 0.8}  # the pursuer may have had so much of that time; walls make up for it
MARGIN_M = 50.0
AWAY_M = 150.0
UP_M = 100

HEAD = """\
name: {kind}_{seed:05d}
description: random pursuit game, seed {seed}
dimension: 2
unit_m: 25
origin: {{latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}}
bounds: {{east_m: [0, {width}], north_m: [0, {height}], up_m: [60, 160]}}
start: {{east_m: {start[0]:g}, north_m: {start[1]:g}, up_m: 100, course_deg: {course_deg:g}}}
goals:
  - {{east_m: {goal[0]:g}, north_m: {goal[1]:g}, up_m: 100, acceptance_radius_m: 60}}
vehicle:
  airspeed_min_m_s: 12.5
  airspeed_max_m_s: 37.5
  airspeed_cruise_m_s: 25
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 125
  straight_length_min_m: 125
  penetration_speed_m_s: 25
planning:
  sensing_horizon_m: 825
  time_horizon_s: 15
  total_planning_time_s: {budget_s}
"""
TAIL = """\
simulation:
  wind_speed_m_s: 0
  turbulence: none
"""


def random_game(seed, kind):
    """Mission file of a map with one pursuer; the same seed makes the same text."""
    random = np.random.default_rng((seed, KINDS.index(kind)))
    width, height = (GRID_M * int(side) for side in random.integers(*SIDES, 2, endpoint=True))
    start, goal = _ends(random, width, height)
    bearing = math.degrees(math.atan2(goal[0] - start[0], goal[1] - start[1]))
    course_deg = round((bearing + float(random.uniform(-35.0, 35.0))) % 360.0, 1) % 360.0
    obstacles = _obstacles(random, (width, height), _kept_free(start, goal, course_deg))
    pursuer, speed_m_s, reach_m = _pursuer(random, kind, (width, height), start, goal, obstacles)
    text = HEAD.format(
        kind=kind, seed=seed, width=width, height=height, start=start, goal=goal, course_deg=course_deg,
        budget_s=round(2.5 * math.dist(start, goal) / CRUISE_M_S),
    )  # fmt: skip
    text += _radar(random, (width, height), start, goal)
    text += (
        "dynamic_threats:\n"
        f"  - {{name: pursuer_1, east_m: {pursuer[0]:g}, north_m: {pursuer[1]:g}, "
        f"speed_m_s: {speed_m_s:g}, max_threat_radius_m: {reach_m}}}\nobstacles:\n"
    )
    for index, (name, corners) in enumerate(obstacles):
        listed = ", ".join(f"[{east:g}, {north:g}]" for east, north in corners)
        text += f"  - {{name: {name}_{index}, polygon_enu_m: [{listed}], base_m: 0, top_m: 300}}\n"
    return text + TAIL


def _ends(random, width, height):
    """Start near one side, goal near the opposite one, on the grid."""
    sides = (width, height)
    axis = int(random.integers(2))
    along = [float(random.uniform(0.07, 0.13)), float(random.uniform(0.75, 0.92))]
    across = random.uniform(0.2, 0.8, 2)
    if random.random() < 0.5:
        along = [1.0 - part for part in along]
    ends = []
    for part, other in zip(along, across, strict=True):
        place = [0.0, 0.0]
        place[axis], place[1 - axis] = part * sides[axis], float(other) * sides[1 - axis]
        ends.append(tuple(float(GRID_M * round(value / GRID_M)) for value in place))
    return ends


def _kept_free(start, goal, course_deg):
    """Where no obstacle may stand."""
    course = math.radians(course_deg)
    ahead = (start[0] + AHEAD_M * math.sin(course), start[1] + AHEAD_M * math.cos(course))
    return shapely.union_all([shapely.LineString([start, ahead]), shapely.Point(goal)]).buffer(CLEAR_M + 1.0)


def _obstacles(random, sides, kept_free):
    """Names and corners of obstacles that stand apart."""
    wanted = int(random.integers(NUM_OBSTACLES[0], NUM_OBSTACLES[1] + 1))
    box = shapely.box(0.0, 0.0, *sides)
    placed, polygons = [], []
    for _ in range(TRIES):
        if len(placed) == wanted:
            break
        name, polygon = _shape(random, box)
        if polygon is None or polygon.intersects(kept_free):
            continue
        if any(polygon.distance(other) < GAP_M for other in polygons):
            continue
        polygons.append(polygon)
        placed.append((name, list(polygon.exterior.coords)[:-1]))
    return placed


def _shape(random, box):
    """A named polygon somewhere in the box, cut off at its sides; ``None`` in place of what is no use."""
    names = list(SHAPES)
    name = names[int(random.choice(len(names), p=[0.3, 0.14, 0.22, 0.12, 0.1, 0.12]))]
    polygon = Polygon(SHAPES[name](random))
    is_straight = random.random() < 0.6
    angle = 90.0 * int(random.integers(4)) if is_straight else float(random.uniform(0.0, 360.0))
    place = random.uniform(0.0, 1.0, 2) * box.bounds[2:]
    middle = polygon.envelope.centroid
    moved = translate(rotate(polygon, angle, origin=middle), place[0] - middle.x, place[1] - middle.y)
    if not moved.is_valid:
        return name, None
    cut = moved.intersection(box)
    parts = [part for part in getattr(cut, "geoms", [cut]) if isinstance(part, Polygon)]
    if not parts:
        return name, None
    corners = np.round(shapely.get_coordinates(max(parts, key=lambda part: part.area))[:-1], 1)
    is_new = np.any(corners != np.roll(corners, 1, axis=0), axis=1)
    if is_new.sum() < 3:
        return name, None
    rounded = Polygon(corners[is_new])
    is_fit = rounded.is_valid and rounded.area >= AREA_MIN_M2 and not rounded.interiors
    return name, rounded if is_fit else None


def _wall(random):
    length, thickness = random.uniform(500.0, 1350.0), random.uniform(45.0, 80.0)
    return [(0.0, 0.0), (length, 0.0), (length, thickness), (0.0, thickness)]


def _box(random):
    length, width = random.uniform(110.0, 380.0), random.uniform(90.0, 330.0)
    return [(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)]


def _ell(random):
    length, width = random.uniform(280.0, 850.0, 2)
    thickness = random.uniform(45.0, 80.0)
    return [(0, 0), (length, 0), (length, thickness), (thickness, thickness), (thickness, width), (0, width)]


def _cup(random):
    length = random.uniform(300.0, 750.0)
    left, right = random.uniform(250.0, 750.0, 2)
    wall = random.uniform(45.0, 80.0)
    return [
        (0, 0), (length, 0), (length, right), (length - wall, right), (length - wall, wall), (wall, wall),
        (wall, left), (0, left),
    ]  # fmt: skip


def _triangle(random):
    angles = np.sort(random.uniform(0.0, 2.0 * math.pi, 3))
    radii = random.uniform(80.0, 260.0, 3)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def _boulder(random):
    angles = np.sort(random.uniform(0.0, 2.0 * math.pi, int(random.integers(6, 10))))
    radius = random.uniform(70.0, 230.0)
    points = radius * np.column_stack([np.cos(angles), np.sin(angles) * random.uniform(0.5, 1.0)])
    return shapely.get_coordinates(shapely.MultiPoint(points).convex_hull)[:-1]


SHAPES = {"wall": _wall, "box": _box, "ell": _ell, "cup": _cup, "triangle": _triangle, "boulder": _boulder}


def _pursuer(random, kind, sides, start, goal, obstacles):
    """Where the pursuer waits, its speed and its reach.

    Without walls it would cut off the straight way, but not be at the goal long before the aircraft: most
    other places make maps that nobody wins.
    """
    walls = shapely.union_all([Polygon(corners) for _, corners in obstacles])
    parts = np.linspace(0.0, 1.0, 50)[:, None]
    way = (1.0 - parts) * np.array(start) + parts * np.array(goal)
    flown_m = parts[:, 0] * math.dist(start, goal)
    while True:
        place = tuple(round(float(random.uniform(MARGIN_M, side - MARGIN_M)), 1) for side in sides)
        speed_m_s = round(float(random.uniform(*PURSUER_SPEEDS_M_S[kind])), 1)
        reach_m = int(random.integers(int(REACHES_M[0]), int(REACHES_M[1]) + 1))
        driven_s = (np.hypot(*(way - place).T) - reach_m) / speed_m_s
        is_cut_off = np.any(driven_s <= flown_m / CRUISE_M_S)
        is_open = driven_s[-1] >= EARLY[kind] * flown_m[-1] / BEST_M_S[kind]
        is_away = math.dist(place, start) > reach_m + AWAY_M
        if is_cut_off and is_open and is_away and walls.distance(shapely.Point(place)) > ON_THE_ROAD_M:
            return place, speed_m_s, reach_m


def _radar(random, sides, start, goal):
    """A radar in one map of three, that sees neither start nor goal."""
    if random.random() > 1.0 / 3.0:
        return ""
    place = [round(float(random.uniform(0.0, side))) for side in sides]
    reach_m = round(float(random.uniform(500.0, 900.0)))
    if min(math.dist(place, start), math.dist(place, goal)) < reach_m + 100.0:
        return ""
    return (
        f"radars:\n  - {{name: radar_1, east_m: {place[0]}, north_m: {place[1]}, up_m: {UP_M}, "
        f"max_threat_radius_m: {reach_m}}}\n"
    )

"""Drawing primitives of Foxglove: entities of a SceneUpdate in the mission's frame, ``map``.

References
----------
Foxglove SDK, schemas: SceneUpdate, SceneEntity and its primitives; also FrameTransform and Log.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from companion.frames import FloatArray
from companion.recording.mcap_reader import number
from companion.types.threat import Obstacle, Radar

Entity = dict[str, object]
Colour = tuple[float, float, float, float]

MAP, AIRCRAFT = "map", "aircraft"
STRIP, LOOP, LIST = 0, 1, 2  # Types of a line primitive.
OBSTACLE: Colour = (0.36, 0.40, 0.45, 0.6)  # Translucent, so that what lies behind is visible.
FENCE: Colour = (0.54, 0.35, 0.0, 0.25)
RADAR: Colour = (0.60, 0.17, 0.03, 1.0)
GOAL: Colour = (0.78, 0.06, 0.18, 0.8)
THREAT: Colour = (0.69, 0.07, 0.48, 1.0)
PASSING: Colour = (0.40, 0.45, 0.50, 1.0)
MISSION: Colour = (0.42, 0.25, 0.69, 1.0)
CANDIDATE: Colour = (0.70, 0.42, 0.0, 1.0)
FLOWN: Colour = (0.04, 0.31, 0.64, 1.0)
TREE: Colour = (0.31, 0.56, 0.84, 0.5)
THREAT_TREE: Colour = (0.78, 0.39, 0.65, 0.6)
HORIZON: Colour = (0.12, 0.31, 0.85, 0.6)
SUB_GOAL: Colour = (0.10, 0.60, 0.31, 1.0)
BANDS = (0.05, 0.25, 0.5, 0.75)  # Lower limits of the bands of threat levels.
_SIDES = 64
_SUB_GOAL_M = 25.0
_DEVIATIONS = 2.0  # Standard deviations of an uncertainty ellipse, as on the page.
_PARTS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models", "metadata")
_LEVEL = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def time_of(utc_s: float) -> dict[str, int]:
    """Convert UTC [s] to a Foxglove time."""
    seconds = math.floor(utc_s)
    return {"sec": seconds, "nsec": min(999_999_999, round(1e9 * (utc_s - seconds)))}


def pose_of(place: Sequence[float], course_rad: float | None = None) -> dict[str, object]:
    """Return a pose at a position [m] that is level and heads along a course."""
    turn = None if course_rad is None else 0.5 * (0.5 * math.pi - course_rad)
    heading = _LEVEL if turn is None else {"x": 0.0, "y": 0.0, "z": math.sin(turn), "w": math.cos(turn)}
    return {"position": _point(place), "orientation": heading}


def entity(name: str, utc_s: float, *, frame: str = MAP, **parts: list[dict[str, object]]) -> Entity:
    """Return an entity with its primitives; it replaces an earlier entity of the same name."""
    return {
        "timestamp": time_of(utc_s), "frame_id": frame, "id": name, "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": frame != MAP, **{part: parts.get(part, []) for part in _PARTS},
    }  # fmt: skip


def scene(*entities: Entity, gone: Sequence[str] = (), utc_s: float = 0.0) -> dict[str, object]:
    """Return a SceneUpdate with new or changed entities and the names of deleted ones."""
    deletions = [{"timestamp": time_of(utc_s), "type": 0, "id": name} for name in gone]
    return {"deletions": deletions, "entities": list(entities)}


def line(points: Sequence[Sequence[float]], colour: Colour, kind: int = STRIP, width: float = 3.0) -> Entity:
    """Return a line through points [m], with constant width on the screen."""
    return {
        "type": kind, "pose": pose_of((0.0, 0.0, 0.0)), "thickness": width, "scale_invariant": True,
        "points": [_point(point) for point in points], "color": _colour(colour), "colors": [], "indices": [],
    }  # fmt: skip


def text(words: str, place: Sequence[float], colour: Colour) -> Entity:
    """Return a text that faces the viewer."""
    return {
        "pose": pose_of(place), "billboard": True, "font_size": 14.0, "scale_invariant": True,
        "color": _colour(colour), "text": words,
    }  # fmt: skip


def ball(place: Sequence[float], radius_m: float, colour: Colour) -> Entity:
    """Return a sphere."""
    size = 2.0 * radius_m
    return {"pose": pose_of(place), "size": {"x": size, "y": size, "z": size}, "color": _colour(colour)}


def spread(place: Sequence[float], covariance: object, colour: Colour) -> Entity:
    """Return a flat two-sigma ellipse about a position [m] for a track's covariance (4, 4)."""
    rows = covariance if isinstance(covariance, list) else []
    east, north = [_numbers(row) for row in (*rows, [], [], [])[:3:2]]
    mean, half = 0.5 * (east[0] + north[2]), 0.5 * (east[0] - north[2])
    radius = math.hypot(half, east[2])
    wide, thin = (2.0 * _DEVIATIONS * math.sqrt(max(0.0, mean + part)) for part in (radius, -radius))
    pose = pose_of(place, 0.5 * math.pi - 0.5 * math.atan2(east[2], half))
    return {"pose": pose, "size": {"x": wide, "y": thin, "z": 1.0}, "color": _colour((*colour[:3], 0.35))}


def circle(centre: Sequence[float], radius_m: float, colour: Colour, width: float = 3.0) -> Entity:
    """Return a level circle."""
    angles = [2.0 * math.pi * side / _SIDES for side in range(_SIDES)]
    points = [
        (centre[0] + radius_m * math.cos(angle), centre[1] + radius_m * math.sin(angle), centre[2])
        for angle in angles
    ]
    return line(points, colour, LOOP, width)


def prism(wall: Obstacle, ceiling_m: float, colour: Colour) -> Entity:
    """Return walls and roof of an obstacle, cut off at the ceiling, as triangles."""
    base, top = max(wall.base_m, 0.0), min(wall.top_m, ceiling_m)
    corners = wall.polygon_enu_m
    points = list[tuple[float, float, float]]()
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        points += [(x0, y0, base), (x1, y1, base), (x1, y1, top)]
        points += [(x0, y0, base), (x1, y1, top), (x0, y0, top)]
    points += [(float(x), float(y), top) for triangle in _roof(corners) for x, y in triangle]
    return {
        "pose": pose_of((0.0, 0.0, 0.0)), "points": [_point(point) for point in points],
        "color": _colour(colour), "colors": [], "indices": [],
    }  # fmt: skip


def _roof(corners: FloatArray) -> list[FloatArray]:
    """Return triangles (3, 2) that cover a polygon, ``corners`` (N, 2) [m]."""
    polygon = shapely.Polygon(corners)
    found = shapely.delaunay_triangles(polygon).geoms
    inside = [part for part in found if polygon.covers(part.representative_point())]
    return [np.asarray(part.exterior.coords)[:3] for part in inside]


def radar_entity(radar: Radar, utc_s: float) -> Entity:
    """Return a radar with its range and name."""
    place = radar.position_enu_m
    return entity(
        f"radar {radar.name}", utc_s, spheres=[ball(place, 0.02 * radar.max_threat_radius_m, RADAR)],
        lines=[circle(place, radar.max_threat_radius_m, RADAR)], texts=[text(radar.name, place, RADAR)],
    )  # fmt: skip


def track_entity(track: Mapping[str, object], utc_s: float) -> Entity:
    """Return a recorded track: position, uncertainty, reach of a pursuer, and predicted position in 10 s."""
    place, velocity = _numbers(track.get("position_enu_m")), _numbers(track.get("velocity_enu_m_s"))
    reach, name = number(track.get("max_threat_radius_m")) or 0.0, str(track.get("identity"))
    flies_on = bool(track.get("flies_on"))  # Such a vehicle threatens nobody.
    colour = PASSING if flies_on else THREAT
    ahead = [here + 10.0 * speed for here, speed in zip(place, velocity, strict=True)]
    rings = [] if flies_on else [circle(place, reach, colour)]
    return entity(
        f"track {name}", utc_s,
        spheres=[ball(place, max(5.0, 0.04 * reach), colour), spread(place, track.get("covariance"), colour)],
        lines=[*rings, line([place, ahead], colour)], texts=[text(name, place, colour)],
    )  # fmt: skip


def search_entities(trees: Mapping[str, object], utc_s: float) -> list[Entity]:
    """Return the recorded search of a plan: both trees, and the sub goals."""
    goals = trees.get("sub_goals_enu_m")
    places = [_numbers(place) for place in goals] if isinstance(goals, list) else []
    branches = _branches(trees.get("tree_enu_m"), trees.get("tree_parents"))
    driven = _branches(trees.get("threat_tree_enu_m"), trees.get("threat_tree_parents"))
    return [
        entity("search tree", utc_s, lines=[line(branches, TREE, LIST, 1.0)]),
        entity("search threat tree", utc_s, lines=[line(driven, THREAT_TREE, LIST, 1.0)]),
        entity("search sub goals", utc_s, spheres=[ball(place, _SUB_GOAL_M, SUB_GOAL) for place in places]),
    ]


def _branches(places: object, parents: object) -> list[list[float]]:
    """Return the end points of a tree's edges, in pairs; a two-dimensional tree lies on the ground."""
    points = list[list[float]]()
    if isinstance(places, list) and isinstance(parents, list):
        rows = [_numbers(place) for place in places]
        for row, parent in zip(rows, parents, strict=False):
            if isinstance(parent, int) and 0 <= parent < len(rows):
                points += [rows[parent], row]
    return points


def field_entities(
    east_m: FloatArray, north_m: FloatArray, levels: FloatArray, height_m: float, utc_s: float
) -> list[Entity]:
    """Return the radars' threat field at a height: an entity for each occupied band of levels.

    Parameters
    ----------
    east_m, north_m : ndarray, shape (NX,) and (NY,)
        Centres of the cells [m].
    levels : ndarray, shape (NY, NX)
        Threat level of each cell.
    height_m : float
        Up coordinate of the section [m].
    utc_s : float
        Time of the picture [s].

    Returns
    -------
    list of dict
        Entities that contain a rectangle for each run of cells in a row.
    """
    bands, half = np.digitize(levels, BANDS), 0.5 * (east_m[1] - east_m[0])
    found = list[Entity]()
    for band, low in enumerate(BANDS, 1):
        points = list[dict[str, float]]()
        for row, north in zip(bands == band, north_m, strict=True):
            edges = np.flatnonzero(np.diff(row, prepend=False, append=False)).reshape(-1, 2)
            for first, last in edges:
                points += _rectangle(
                    east_m[first] - half, east_m[last - 1] + half, north - half, north + half, height_m
                )
        if points:
            colour = _colour((*RADAR[:3], 0.15 * band))
            solid: Entity = {
                "pose": pose_of((0, 0, 0)),
                "points": points,
                "color": colour,
                "colors": [],
                "indices": [],
            }
            found.append(entity(f"field over {low:g}", utc_s, triangles=[solid]))
    return found


def _rectangle(west: float, east: float, south: float, north: float, up: float) -> list[dict[str, float]]:
    """Return two level triangles that form a rectangle."""
    corners = [
        _point(place)
        for place in ((west, south, up), (east, south, up), (east, north, up), (west, north, up))
    ]
    return [corners[count] for count in (0, 1, 2, 0, 2, 3)]


def _numbers(value: object) -> list[float]:
    """Return three numbers of a document; missing ones are 0."""
    given = value if isinstance(value, list) else []
    return [number(entry) or 0.0 for entry in (*given, 0.0, 0.0, 0.0)[:3]]


def _point(place: Sequence[float]) -> dict[str, float]:
    return {"x": float(place[0]), "y": float(place[1]), "z": float(place[2])}


def _colour(colour: Colour) -> dict[str, float]:
    return dict(zip("rgba", colour, strict=True))

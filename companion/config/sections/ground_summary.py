"""The summary of the ground in ``companion check``: its heights, and those of the mission's places."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.config.compose import bounds_of
from companion.config.models import MissionConfig
from companion.config.sections.terrain_map import ground_heights_of, ground_of, posts_of, spacing_m
from companion.frames import FloatArray
from companion.plain_text import printable


def straight_way(mission: MissionConfig) -> FloatArray:
    """Return the start and the goals in their order, east, north, up, shape (N, 3) [m]."""
    start = mission.start
    places = [(start.east_m, start.north_m, start.up_m)]
    places += [(goal.east_m, goal.north_m, goal.up_m) for goal in mission.goals]
    return np.array(places, dtype=np.float64)


def ground_document(mission: MissionConfig) -> dict[str, object] | None:
    """Return what the map of heights holds over the bounds; None without a map.

    ``start_over_ground_m`` and ``goals_over_ground_m`` are heights over the ground below these places. The
    straight way leads from the start to each goal in turn; below the ground its height is negative.
    """
    posts, heights, bounds = posts_of(mission), ground_heights_of(mission), bounds_of(mission)
    if posts is None or heights is None:
        return None
    ground = ground_of(mission)
    lowest, highest = round(float(ground.low.min())), round(float(ground.high.max()))
    document: dict[str, object] = {
        "map": posts.name,
        "lowest_up_m": lowest,
        "highest_up_m": highest,
        "highest_amsl_m": highest + round(mission.frame.altitude_amsl_m),
        "spacing_m": round(spacing_m(posts, bounds)),
    }
    if mission.goals_from_autopilot:
        return document
    places = straight_way(mission)
    start_m, *goals_m = (round(height, 1) for height in (places[:, 2] - heights.up_m(places)).tolist())
    along_m, up_m, ground_m = heights.profile(places).T
    lowest_at = int(np.argmin(up_m - ground_m))
    return document | {
        "start_over_ground_m": start_m,
        "goals_over_ground_m": goals_m,
        "straight_way_over_ground_m": round(float(up_m[lowest_at] - ground_m[lowest_at]), 1),
        "straight_way_lowest_after_m": round(float(along_m[lowest_at])),
    }


def ground_words(mission: MissionConfig) -> str:
    """Return the map and the heights of its ground in words."""
    ground = ground_document(mission) or {}
    return (
        f"{ground['lowest_up_m']} to {ground['highest_up_m']} m up, posts {ground['spacing_m']} m apart, "
        f"{printable(str(ground['map']))}; highest {ground['highest_amsl_m']} m AMSL"
    )


def over_ground_words(mission: MissionConfig) -> Iterator[str]:
    """Yield a phrase for the start, for each goal, and for the straight way; empty ones without a map."""
    ground = ground_document(mission)
    if ground is None:
        yield from [""] * (2 + len(mission.goals))
        return
    goals_m = ground["goals_over_ground_m"]
    for height in (ground["start_over_ground_m"], *(goals_m if isinstance(goals_m, list) else [])):
        yield f", {height:.0f} m over ground"
    least, after = ground["straight_way_over_ground_m"], ground["straight_way_lowest_after_m"]
    yield f"; lowest {least:.0f} m over ground, after {after} m"

"""The places of a mission file in degrees, for export; the opposite of the composition."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from companion.config import MissionConfig
from companion.config.conversion.found_places import Degrees, FoundPlace, Kind
from companion.frames import LocalFrame


def places_of(mission: MissionConfig) -> tuple[FoundPlace, ...]:
    """Return all places of a mission with their properties: origin, bounds, start, goals, threats, areas.

    Parameters
    ----------
    mission : MissionConfig
        The mission; goals that are left to the autopilot are not known.
    """
    write = _Writer(mission.frame)
    origin, bounds, start = mission.origin, mission.bounds, mission.start
    (west, east), (south, north) = bounds.east_m, bounds.north_m
    heights = {"lowest_up_m": bounds.up_m[0], "highest_up_m": bounds.up_m[1]}
    begin = {"up_m": start.up_m, "course_deg": start.course_deg}
    places = [
        write.place(Kind.ORIGIN, [(0.0, 0.0)], mission.name, {"altitude_amsl_m": origin.altitude_amsl_m}),
        write.place(Kind.BOUNDS, [(west, south), (east, south), (east, north), (west, north)], "", heights),
        write.place(Kind.START, [(start.east_m, start.north_m)], "", begin),
    ]
    for goal in mission.goals:
        values = {"up_m": goal.up_m, "acceptance_radius_m": goal.acceptance_radius_m}
        places.append(write.place(Kind.GOAL, [(goal.east_m, goal.north_m)], "", values))
    for radar in mission.radars:
        seen = radar.model_dump(exclude={"name", "east_m", "north_m", "model", "model_values"})
        if radar.model:
            seen |= {"model": radar.model, "model_values": " ".join(map(repr, radar.model_values))}
        places.append(write.place(Kind.RADAR, [(radar.east_m, radar.north_m)], radar.name, seen))
    for threat in mission.dynamic_threats:
        values = threat.model_dump(exclude={"name", "east_m", "north_m", "route_enu_m"}, exclude_none=True)
        line = [(threat.east_m, threat.north_m), *threat.route_enu_m]
        places.append(write.place(Kind.MOVING_THREAT, line, threat.name, values))
    for obstacle in mission.obstacles:
        values = {"base_m": obstacle.base_m, "top_m": obstacle.top_m}
        places.append(write.place(Kind.OBSTACLE, obstacle.polygon_enu_m, obstacle.name, values))
    return (*places, *_glide_places(mission, write))


def _glide_places(mission: MissionConfig, write: _Writer) -> list[FoundPlace]:
    if mission.glide is None:
        return []
    places = []
    for field in mission.glide.fields:
        values = field.model_dump(include={"up_m", "radius_m"}, exclude_none=True)
        places.append(write.place(Kind.FIELD, [(field.east_m, field.north_m)], field.name, values))
    people = mission.glide.people
    return places + [write.place(Kind.PEOPLE, area.polygon_enu_m, area.name, {}) for area in people]


class _Writer:
    """Writes places in metres as places in degrees."""

    def __init__(self, frame: LocalFrame) -> None:
        self._frame = frame

    def place(
        self, kind: Kind, points: Iterable[Degrees], name: str, values: Mapping[str, object]
    ) -> FoundPlace:
        """Return a place, given its points east and north [m]."""
        east, north = np.array(tuple(points), dtype=np.float64).T
        latitudes, longitudes = self._frame.places_from_local(east, north)
        corners = tuple(zip(latitudes.tolist(), longitudes.tolist(), strict=True))
        return FoundPlace(kind, corners, name, values, name or kind.value)

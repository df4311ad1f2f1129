"""Pictures of recorded messages in Foxglove's schemas; the export for rerun draws the same pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from companion.config import MissionConfig, mission_from_text
from companion.config.compose import goals_of, world_of
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.mcap_reader import Document, number, text
from companion.types.threat import Obstacle
from companion.world.snapshot import Snapshot
from companion.world.threat_field import threat_field

TRANSFORM, LOG = "/tf", "/log"
# The last message of each of these topics holds the complete scene, so that a viewer may start anywhere.
WORLD, FIELD, FENCES, THREATS = "/scene/world", "/scene/field", "/scene/fences", "/scene/threats"
FLOWN, MISSION, CANDIDATE, SEARCH = "/scene/flown", "/scene/mission", "/scene/candidate", "/scene/search"
SCENES = (WORLD, FIELD, FENCES, THREATS, FLOWN, MISSION, CANDIDATE, SEARCH)
MISSION_MAX = 2_000_000  # Characters of a mission file.
WARNING_KINDS = frozenset(
    {"emergency", "no plan", "rejected", "suspended", "fault", "stale", "link", "stopped"}
)
INFO, WARNING = 2, 3  # Levels of foxglove.Log.
_FLOWN_S, _THREATS_S = 1.0, 0.5  # Intervals between pictures.
_FLOWN_MAX = 1_000  # Points of the flown path in one picture.
_FIELD_STEP_M = 20.0  # The radars' field is drawn again after a change of height by this much.
_FIELD_CELLS = 120  # Cells along the longer side.


class Pictures:
    """Draws recorded messages, one by one."""

    def __init__(self) -> None:
        self.epoch_s = 0.0
        self.mission: MissionConfig | None = None
        self._snapshot: Snapshot | None = None
        self._field_m = math.inf
        self._flown: list[object] = []
        self._shown: dict[str, set[str]] = {}
        self._walls: set[str] = set()
        self._drawn_s: dict[str, float] = {}

    def of(self, topic: str, document: Document) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Yield topic, UTC [s] and content of the messages that show a recorded message."""
        utc_s = self.epoch_s + (number(document.get("stamp_s")) or 0.0)
        match topic:
            case channels.MISSION:
                yield from self._world(document)
            case channels.SNAPSHOT if isinstance(document.get("obstacles"), list):
                yield FENCES, utc_s, self._fences(document, utc_s)
            case channels.OWNSHIP:
                yield from self._ownship(document, utc_s)
            case channels.TRACKS if self._is_due("threats", utc_s, _THREATS_S):
                yield THREATS, utc_s, self._threats(document, utc_s)
            case channels.PLAN:
                yield (
                    CANDIDATE,
                    utc_s,
                    self._line("candidate", _places_of(document), scenes.CANDIDATE, utc_s, 2.0),
                )
            case channels.TREES:
                yield SEARCH, utc_s, scenes.scene(*scenes.search_entities(document, utc_s))
            case channels.SWAP if document.get("outcome") == "flown":
                way = self._line("mission", document.get("waypoints_enu_m"), scenes.MISSION, utc_s, 5.0)
                yield MISSION, utc_s, way
            case channels.DECISION:
                yield LOG, utc_s, _log_entry(document, utc_s)

    def _ownship(self, document: Document, utc_s: float) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Draw the aircraft, the radars' field at its height and, at intervals, the flown path."""
        transform = self._transform(document, utc_s)
        yield TRANSFORM, utc_s, transform
        yield from self._field(transform["translation"]["z"], utc_s)
        self._flown.append(document.get("position_enu_m"))
        if self._is_due("flown", utc_s, _FLOWN_S):
            places = self._flown[:: 1 + len(self._flown) // _FLOWN_MAX]
            yield FLOWN, utc_s, self._line("flown", places, scenes.FLOWN, utc_s)

    def _field(self, up_m: float, utc_s: float) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Draw the radars' field at a height, masked by obstacles, if the height changed enough."""
        if self._snapshot is None or abs(up_m - self._field_m) < _FIELD_STEP_M:
            return
        self._field_m = up_m
        section = threat_field(self._snapshot, up_m, _FIELD_CELLS)
        yield FIELD, utc_s, self._renewed("field", scenes.field_entities(*section, up_m, utc_s), utc_s)

    def _renewed(self, group: str, shown: list[scenes.Entity], utc_s: float) -> Mapping[str, object]:
        """Return a scene that replaces all entities of a group."""
        names = {str(entry["id"]) for entry in shown}
        gone = sorted(self._shown.get(group, set()) - names)
        self._shown[group] = names
        return scenes.scene(*shown, gone=gone, utc_s=utc_s)

    def _is_due(self, what: str, utc_s: float, period_s: float) -> bool:
        if 0.0 <= utc_s - self._drawn_s.get(what, -1e12) < period_s:
            return False
        self._drawn_s[what] = utc_s
        return True

    def _line(
        self, name: str, places: object, colour: scenes.Colour, utc_s: float, width: float = 3.0
    ) -> Mapping[str, object]:
        drawn = scenes.line(_rows(places, 3), colour, width=width)
        return scenes.scene(scenes.entity(name, utc_s, lines=[drawn]))

    def _world(self, document: Document) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Draw obstacles, radars and goals of the mission file, and the sensing horizon."""
        self.epoch_s = number(document.get("epoch_s"), 1e11) or 0.0
        utc_s = self.epoch_s + (number(document.get("stamp_s")) or 0.0)
        mission = mission_from_text(text(document.get("mission_file"), MISSION_MAX), "the recording")
        self.mission = mission
        self._snapshot = world_of(mission, none_known=False) if mission.radar_list else None
        self._field_m = math.inf
        walls = [self._wall(wall, scenes.OBSTACLE, utc_s) for wall in mission.obstacle_list]
        self._walls = {wall.name for wall in mission.obstacle_list}
        radars = [scenes.radar_entity(radar, utc_s) for radar in mission.radar_list]
        ends = [
            scenes.entity(
                f"goal {count}", utc_s,
                spheres=[scenes.ball(goal.position_enu_m, goal.acceptance_radius_m, scenes.GOAL)],
            )
            for count, goal in enumerate(goals_of(mission), 1)
        ]  # fmt: skip
        senses = scenes.circle(
            (0.0, 0.0, 0.0), float(mission.planning.sensing_horizon_m), scenes.HORIZON, 1.0
        )
        horizon = scenes.entity("horizon", utc_s, frame=scenes.AIRCRAFT, lines=[senses])
        yield WORLD, utc_s, self._renewed("world", [*walls, *radars, *ends, horizon], utc_s)
        if self._snapshot is None:
            yield FIELD, utc_s, self._renewed("field", [], utc_s)

    def _wall(self, wall: Obstacle, colour: scenes.Colour, utc_s: float) -> scenes.Entity:
        assert self.mission is not None
        ceiling_m = float(self.mission.bounds.up_m[1])
        solid = [scenes.prism(wall, ceiling_m, colour)]
        return scenes.entity(f"obstacle {wall.name}", utc_s, triangles=solid)

    def _fences(self, document: Document, utc_s: float) -> Mapping[str, object]:
        """Draw the obstacles of a plan that are not in the mission file, which are fences."""
        found = []
        listed = document.get("obstacles")
        for entry in listed if isinstance(listed, list) and self.mission is not None else ():
            if not isinstance(entry, dict) or (name := text(entry.get("name"))) in self._walls:
                continue
            base, top = number(entry.get("base_m")), number(entry.get("top_m"))
            corners = _rows(entry.get("polygon_enu_m"), 2)
            if len(corners) > 2:
                wall = Obstacle(name, np.array(corners), base or 0.0, top or 0.0)
                found.append(self._wall(wall, scenes.FENCE, utc_s))
        return self._renewed("fences", found, utc_s)

    def _threats(self, document: Document, utc_s: float) -> Mapping[str, object]:
        tracks = document.get("tracks")
        rows = [row for row in tracks if isinstance(row, dict)] if isinstance(tracks, list) else []
        return self._renewed("tracks", [scenes.track_entity(row, utc_s) for row in rows], utc_s)

    def _transform(self, document: Document, utc_s: float) -> dict[str, Any]:
        """Return the pose of the aircraft's frame."""
        place = document.get("position_enu_m")
        row = place if isinstance(place, list) and len(place) == 3 else [0.0, 0.0, 0.0]
        pose = scenes.pose_of(
            [number(value) or 0.0 for value in row], number(document.get("course_rad")) or 0.0
        )
        return {
            "timestamp": scenes.time_of(utc_s), "parent_frame_id": scenes.MAP,
            "child_frame_id": scenes.AIRCRAFT, "translation": pose["position"],
            "rotation": pose["orientation"],
        }  # fmt: skip


def extent_of(mission: MissionConfig) -> tuple[float, float, float]:
    """Return the centre of a mission's bounds, east and north, and their longer side [m].

    Parameters
    ----------
    mission : MissionConfig
        Mission of the flight.
    """
    sides = (mission.bounds.east_m, mission.bounds.north_m)
    east, north = (float(0.5 * (side[0] + side[1])) for side in sides)
    return east, north, float(max(side[1] - side[0] for side in sides))


def _rows(places: object, length: int) -> list[list[float]]:
    """Return the valid rows of a document's list of positions."""
    rows = places if isinstance(places, list) else []
    return [
        row
        for row in rows
        if isinstance(row, list) and len(row) == length and all(number(value) is not None for value in row)
    ]


def _places_of(document: Document) -> list[object]:
    """Return the positions of a plan's path; its rows begin with the time."""
    path = document.get("path")
    return [row[1:4] for row in path if isinstance(row, list)] if isinstance(path, list) else []


def _log_entry(document: Document, utc_s: float) -> Mapping[str, object]:
    kind = text(document.get("kind"), 100)
    return {
        "timestamp": scenes.time_of(utc_s), "level": WARNING if kind in WARNING_KINDS else INFO,
        "message": f"{kind}: {text(document.get('text'))}", "name": "companion", "file": "", "line": 0,
    }  # fmt: skip

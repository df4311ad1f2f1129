"""A recording as a picture: an MCAP with Foxglove's schemas, and a layout that opens it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from companion.config import MissionConfig, mission_from_text
from companion.config.compose import goals_of
from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.mcap_reader import Document, messages_of, number, text
from companion.recording.mcap_writer import plain
from companion.safe_files import open_to_write
from companion.types.threat import Obstacle

SCENE, TRANSFORM, LOG = "/scene", "/tf", "/log"
NAMES = {
    SCENE: "foxglove.SceneUpdate",
    TRANSFORM: "foxglove.FrameTransform",
    LOG: "foxglove.Log",
    channels.LOCATION: "foxglove.LocationFix",
}
MISSION_MAX = 2_000_000  # characters of a mission file
LOUD = frozenset({"emergency", "no plan", "rejected", "suspended", "fault", "stale", "link", "stopped"})
_INFO, _WARNING = 2, 3  # of Log
_FLOWN_S, _THREATS_S = 1.0, 0.5  # between pictures of them
_FLOWN_MAX = 1_000  # places of the flown path in one of them


class _Pictures:
    """Makes pictures of what is recorded, message by message."""

    def __init__(self) -> None:
        self.epoch_s = 0.0
        self._mission: MissionConfig | None = None
        self._flown: list[object] = []
        self._seen: set[str] = set()
        self._walls: set[str] = set()
        self._drawn_s: dict[str, float] = {}

    def of(self, topic: str, told: Document) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Messages that show one that was recorded, with their topics and UTC [s]."""
        utc_s = self.epoch_s + (number(told.get("stamp_s")) or 0.0)
        match topic:
            case channels.MISSION:
                yield from self._world(told)
            case channels.SNAPSHOT if isinstance(told.get("obstacles"), list):
                yield SCENE, utc_s, self._fences(told, utc_s)
            case channels.OWNSHIP:
                yield from self._ownship(told, utc_s)
            case channels.TRACKS if self._is_due("threats", utc_s, _THREATS_S):
                yield SCENE, utc_s, self._threats(told, utc_s)
            case channels.PLAN:
                yield SCENE, utc_s, self._line("candidate", _places_of(told), scenes.CANDIDATE, utc_s)
            case channels.TREES:
                yield SCENE, utc_s, scenes.scene(scenes.tree_entity(told, utc_s))
            case channels.SWAP if told.get("outcome") == "flown":
                yield SCENE, utc_s, self._line("mission", told.get("waypoints_enu_m"), scenes.MISSION, utc_s)
            case channels.DECISION:
                yield LOG, utc_s, _log_entry(told, utc_s)

    def _ownship(self, told: Document, utc_s: float) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Where the aircraft is, and now and then the way that it has flown."""
        yield TRANSFORM, utc_s, self._transform(told, utc_s)
        self._flown.append(told.get("position_enu_m"))
        if self._is_due("flown", utc_s, _FLOWN_S):
            places = self._flown[:: 1 + len(self._flown) // _FLOWN_MAX]
            yield SCENE, utc_s, self._line("flown", places, scenes.FLOWN, utc_s)

    def _is_due(self, what: str, utc_s: float, period_s: float) -> bool:
        if 0.0 <= utc_s - self._drawn_s.get(what, -1e12) < period_s:
            return False
        self._drawn_s[what] = utc_s
        return True

    def _line(self, name: str, places: object, colour: scenes.Colour, utc_s: float) -> Mapping[str, object]:
        rows = places if isinstance(places, list) else []
        points = [row for row in rows if isinstance(row, list) and len(row) == 3 and None not in row]
        return scenes.scene(scenes.entity(name, utc_s, lines=[scenes.line(points, colour)]))

    def _world(self, told: Document) -> Iterator[tuple[str, float, Mapping[str, object]]]:
        """Obstacles, radars and goals of the mission file."""
        self.epoch_s = number(told.get("epoch_s"), 1e11) or 0.0
        utc_s = self.epoch_s + (number(told.get("stamp_s")) or 0.0)
        mission = mission_from_text(text(told.get("mission_file"), MISSION_MAX), "the recording")
        self._mission = mission
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
        yield SCENE, utc_s, scenes.scene(*walls, *radars, *ends)

    def _wall(self, wall: Obstacle, colour: scenes.Colour, utc_s: float) -> scenes.Entity:
        assert self._mission is not None
        ceiling_m = float(self._mission.bounds.up_m[1])
        solid = [scenes.prism(wall, ceiling_m, colour)]
        return scenes.entity(f"obstacle {wall.name}", utc_s, triangles=solid)

    def _fences(self, told: Document, utc_s: float) -> Mapping[str, object]:
        """What of the obstacles a plan was made among is not the mission file's."""
        found = []
        listed = told.get("obstacles")
        for entry in listed if isinstance(listed, list) and self._mission is not None else ():
            if not isinstance(entry, dict) or entry.get("name") in self._walls:
                continue
            base, top = number(entry.get("base_m")), number(entry.get("top_m"))
            wall = Obstacle(text(entry.get("name")), entry["polygon_enu_m"], base or 0.0, top or 0.0)
            found.append(self._wall(wall, scenes.FENCE, utc_s))
        return scenes.scene(*found)

    def _threats(self, told: Document, utc_s: float) -> Mapping[str, object]:
        tracks = told.get("tracks")
        rows = [row for row in tracks if isinstance(row, dict)] if isinstance(tracks, list) else []
        shown = [scenes.track_entity(row, utc_s) for row in rows]
        names = {str(entry["id"]) for entry in shown}
        gone, self._seen = sorted(self._seen - names), names
        return scenes.scene(*shown, gone=gone, utc_s=utc_s)

    def _transform(self, told: Document, utc_s: float) -> Mapping[str, object]:
        """Where the aircraft is, for what is drawn in its frame, and to follow it."""
        place = told.get("position_enu_m")
        row = place if isinstance(place, list) and len(place) == 3 else [0.0, 0.0, 0.0]
        pose = scenes.pose_of([number(value) or 0.0 for value in row], number(told.get("course_rad")) or 0.0)
        return {
            "timestamp": scenes.time_of(utc_s), "parent_frame_id": scenes.MAP,
            "child_frame_id": scenes.AIRCRAFT, "translation": pose["position"],
            "rotation": pose["orientation"],
        }  # fmt: skip


def _places_of(told: Document) -> list[object]:
    """Places of a plan's path: its rows begin with the time."""
    path = told.get("path")
    return [row[1:4] for row in path if isinstance(row, list)] if isinstance(path, list) else []


def _log_entry(told: Document, utc_s: float) -> Mapping[str, object]:
    kind = text(told.get("kind"), 100)
    return {
        "timestamp": scenes.time_of(utc_s), "level": _WARNING if kind in LOUD else _INFO,
        "message": f"{kind}: {text(told.get('text'))}", "name": "companion", "file": "", "line": 0,
    }  # fmt: skip


def export_flight(flight: Path, target: Path) -> Path:
    """Write a flight's recording as a picture for Foxglove, and beside it a layout.

    What was recorded is in it, too, under its own topics.

    Parameters
    ----------
    flight : Path
        ``flight.mcap``.
    target : Path
        The picture, made anew.

    Returns
    -------
    Path
        The layout, to be imported in Foxglove.

    Raises
    ------
    RecordError
        If there is no message in the recording, or the target cannot be written.
    """
    pictures, layout = _Pictures(), target.with_suffix(".layout.json")
    num_messages = 0
    try:
        with open_to_write(target) as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start("", "companion")
            ids = _registered(writer)
            for topic, told in messages_of(flight, Counter()):
                if topic not in ids:
                    continue
                num_messages += 1
                shown = list(pictures.of(topic, told))
                utc_s = pictures.epoch_s + (number(told.get("stamp_s")) or 0.0)
                if "timestamp" in told and isinstance(at := told["timestamp"], dict):
                    utc_s = float(at.get("sec", 0)) + 1e-9 * float(at.get("nsec", 0))
                for name, stamp_s, message in ((topic, utc_s, told), *shown):
                    stamp = max(0, round(1e9 * stamp_s))
                    data = json.dumps(plain(message), allow_nan=False, separators=(",", ":")).encode("ascii")
                    writer.add_message(ids[name], stamp, data, stamp)
            writer.finish()
        layout.write_text(json.dumps(LAYOUT, indent=1) + "\n", encoding="ascii")
    except OSError as error:
        raise RecordError(f"{target}: {error.strerror or error}") from error
    if not num_messages:
        raise RecordError(f"{flight}: no message in it")
    return layout


def _registered(writer: Writer) -> dict[str, int]:
    """Channels of what was recorded and of the pictures, by topic."""
    schemas = {channel.topic: (channel.name, channel.schema) for channel in channels.CHANNELS}
    schemas |= {
        topic: (name, {"title": name, "type": "object"})
        for topic, name in NAMES.items()
        if topic not in schemas
    }
    return {
        topic: writer.register_channel(
            topic, "json", writer.register_schema(name, "jsonschema", json.dumps(schema).encode("ascii"))
        )
        for topic, (name, schema) in schemas.items()
    }


def _plot(title: str, path: str) -> dict[str, object]:
    return {
        "title": title, "paths": [{"value": path, "enabled": True, "timestampMethod": "receiveTime"}],
        "showXAxisLabels": True, "showYAxisLabels": True, "showLegend": False, "isSynced": True,
        "xAxisVal": "timestamp",
    }  # fmt: skip


LAYOUT: dict[str, object] = {
    "configById": {
        "3D!flight": {
            "followTf": scenes.MAP, "followMode": "follow-none", "topics": {SCENE: {"visible": True}},
            "cameraState": {
                "perspective": True, "distance": 6500.0, "phi": 45.0, "thetaOffset": 0.0, "fovy": 45.0,
                "near": 1.0, "far": 60000.0, "target": [0.0, 0.0, 0.0], "targetOffset": [2500.0, 2500.0, 0.0],
                "targetOrientation": [0.0, 0.0, 0.0, 1.0],
            },
            "layers": {}, "publish": {}, "scene": {}, "transforms": {}, "imageMode": {},
        },
        "map!flight": {"topics": {channels.LOCATION: {"enabled": True}}, "followTopic": channels.LOCATION},
        "RosOut!flight": {"topicToRender": LOG, "searchTerms": [], "minLogLevel": 1},
        "Plot!altitude": _plot("Altitude [m]", f"{channels.OWNSHIP}.position_enu_m[2]"),
        "Plot!threat": _plot("Threat level", f"{channels.THREAT}.level"),
    },
    "globalVariables": {},
    "userNodes": {},
    "playbackConfig": {"speed": 1},
    "layout": {
        "direction": "row", "splitPercentage": 62, "first": "3D!flight",
        "second": {
            "direction": "column", "splitPercentage": 50,
            "first": {"direction": "column", "first": "Plot!altitude", "second": "Plot!threat"},
            "second": {"direction": "column", "first": "RosOut!flight", "second": "map!flight"},
        },
    },
}  # fmt: skip

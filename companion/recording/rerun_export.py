"""Export of a recording for rerun's viewer: the pictures for Foxglove, drawn as rerun's archetypes.

The package ``rerun`` is an extra and is imported only when a picture is made.

References
----------
Rerun SDK, archetypes and blueprints. The timeline is the flight's clock, in seconds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from companion.config import MissionConfig
from companion.errors import RecordError
from companion.frames import FloatArray
from companion.plain_text import printable
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.flight_pictures import LOG, SCENES, TRANSFORM, WARNING, Pictures, extent_of
from companion.recording.mcap_reader import Document, messages_of, number, utc_of
from companion.safe_files import open_to_write

TIMELINE = "flight time"  # Seconds of the flight's clock.
WORLD, DECISIONS, GEO = "world", "decisions", "geo"
ALTITUDE, AIRSPEED, GROUND_SPEED = "altitude_m", "speed_m_s/air", "speed_m_s/ground"
THREAT, SAFE = "threat_level", "until_t_f_s"
SCALARS = (
    (channels.OWNSHIP, "airspeed_m_s", AIRSPEED),
    (channels.OWNSHIP, "ground_speed_m_s", GROUND_SPEED),
    (channels.THREAT, "level", THREAT),
)
# The viewer is dark: these colours of the page's dark theme replace those of the light theme.
_GROUND, _GRID = (17, 22, 27), (57, 68, 80)
_DARK = {
    scenes.OBSTACLE[:3]: (108, 121, 134),
    scenes.FENCE[:3]: (224, 176, 80),
    scenes.RADAR[:3]: (255, 138, 92),
    scenes.GOAL[:3]: (255, 97, 115),
    scenes.THREAT[:3]: (255, 110, 199),
    scenes.PASSING[:3]: (154, 167, 180),
    scenes.MISSION[:3]: (183, 155, 255),
    scenes.CANDIDATE[:3]: (255, 184, 77),
    scenes.FLOWN[:3]: (109, 177, 255),
    scenes.TREE[:3]: (63, 120, 184),
    scenes.THREAT_TREE[:3]: (168, 80, 139),
    scenes.HORIZON[:3]: (127, 159, 255),
    scenes.SUB_GOAL[:3]: (87, 211, 137),
}
# Name and colour of each plotted value; then the plots, with their ranges if these are fixed.
_SERIES = {
    ALTITUDE: ("altitude", scenes.FLOWN),
    AIRSPEED: ("airspeed", scenes.SUB_GOAL),
    GROUND_SPEED: ("ground speed", scenes.PASSING),
    THREAT: ("threat level", scenes.RADAR),
    SAFE: ("until t_f", scenes.THREAT),
}
_PLOTS = (
    ("Altitude [m]", ALTITUDE, (ALTITUDE,), None),
    ("Speed [m/s]", "speed_m_s", (AIRSPEED, GROUND_SPEED), None),
    ("Threat level", THREAT, (THREAT,), (-0.05, 1.05)),
    ("Until t_f: the earliest a pursuer could threaten the way [s]", SAFE, (SAFE,), None),
)
_MARK_M = 120.0  # Length of the arrow that marks the aircraft.
_GRID_M = 500.0
_WALLS = 0.4  # Opacity of obstacles.


class _Safety:
    """Tracks t_f, the time until which the flown path is safe from pursuers, from plans and swaps."""

    def __init__(self) -> None:
        self.until_s: float | None = None
        self._plans_part: dict[object, float | None] = {}

    def observe(self, topic: str, document: Document) -> None:
        """Take a message."""
        if topic == channels.PLAN:
            of_plan, of_flown = document.get("pursuit"), document.get("flown_pursuit")
            if isinstance(of_plan, dict):
                self._plans_part[number(document.get("number"))] = number(of_plan.get("first_s"))
            if isinstance(of_flown, dict) and "first_s" in of_flown:
                self.until_s = number(of_flown["first_s"])
        elif topic == channels.SWAP and document.get("outcome") == "flown":
            plan = number(document.get("plan_number"))
            if plan in self._plans_part:
                self.until_s = self._plans_part[plan]

    def left_s(self, now_s: float) -> float | None:
        """Return how long the flown path is still safe [s]; None if nobody could threaten it."""
        return None if self.until_s is None else max(0.0, self.until_s - now_s)


class _Drawing:
    """Draws messages into a stream. Only this class and the export call the package ``rerun``.

    Parameters
    ----------
    rr : Any
        The package ``rerun``.
    stream : Any
        Recording stream of the package.
    """

    def __init__(self, rr: Any, stream: Any) -> None:  # noqa: ANN401
        self._rr, self._stream, self._pictures, self._safety = rr, stream, Pictures(), _Safety()
        self._kinds: dict[tuple[str, ...], set[str]] = {}
        self._plotted: dict[str, bool] = {}
        self._is_located = False

    def begin(self) -> None:
        """Draw what does not change: the axes and the shape of the aircraft."""
        rr = self._rr
        self._stream.log([WORLD], rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        mark = rr.Arrows3D(
            vectors=[[_MARK_M, 0.0, 0.0]], colors=[_rgba(scenes.FLOWN)], radii=rr.Radius.ui_points(4.0)
        )
        self._stream.log([WORLD, scenes.AIRCRAFT], mark, static=True)
        for path, (name, colour) in _SERIES.items():
            self._stream.log(path, rr.SeriesLines(colors=_rgba(colour), names=name, widths=1.5), static=True)

    def draw(self, topic: str, document: Document) -> None:
        """Draw a recorded message."""
        now_s = self._stamp_s(document)
        self._stream.set_time(TIMELINE, duration=now_s)
        for picture, _, message in self._pictures.of(topic, document):
            self._show(picture, message)
        self._safety.observe(topic, document)
        if topic == channels.OWNSHIP:
            place = document.get("position_enu_m")
            self._plot(ALTITUDE, place[2] if isinstance(place, list) and len(place) == 3 else None)
            self._plot(SAFE, self._safety.left_s(now_s))
        for source, key, path in SCALARS:
            if source == topic:
                self._plot(path, document.get(key))
        if topic == channels.LOCATION:
            self._locate(document)

    def end(self) -> None:
        """Write the blueprint: the view of the flight, and the plots that have data."""
        blueprint, ends = self._rr.blueprint, self._rr.TimeRangeBoundary.infinite()
        whole = blueprint.TimeAxis(view_range=self._rr.TimeRange(start=ends, end=ends))
        views = [
            blueprint.TimeSeriesView(
                origin=origin, name=name, axis_x=whole, axis_y=limits and blueprint.ScalarAxis(range=limits),
                plot_legend=blueprint.PlotLegend(visible=len(paths) > 1),
            )
            for name, origin, paths, limits in _PLOTS
            if self._plotted.keys() & set(paths)
        ]  # fmt: skip
        log = blueprint.TextLogView(
            origin=DECISIONS, name="Decisions", columns=blueprint.TextLogColumns(text_log_columns=["Body"])
        )
        # Map tiles are loaded from the internet, so the map's tab is not active at first.
        earth = [blueprint.MapView(origin=GEO, name="Map")] if self._is_located else []
        panel = blueprint.Vertical(
            *views, blueprint.Tabs(log, *earth, active_tab=0), row_shares=[*(2 for _ in views), 3]
        )
        space = blueprint.Spatial3DView(
            origin=WORLD, name="Flight [m]: east, north, up", eye_controls=self._eye(), background=[*_GROUND],
            line_grid=blueprint.LineGrid3D(spacing=_GRID_M, color=[*_GRID]),
        )  # fmt: skip
        self._stream.send_blueprint(
            blueprint.Blueprint(
                blueprint.Horizontal(space, panel, column_shares=[64, 36]),
                blueprint.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
                blueprint.BlueprintPanel(state="collapsed"), blueprint.SelectionPanel(state="collapsed"),
            )
        )  # fmt: skip

    def _eye(self) -> Any:  # noqa: ANN401
        """Return a viewpoint above the south of the mission's bounds; None if they are unknown."""
        mission: MissionConfig | None = self._pictures.mission
        if mission is None:
            return None
        east, north, size = extent_of(mission)
        return self._rr.blueprint.EyeControls3D(
            position=[east, north - 0.85 * size, 0.85 * size],
            look_target=[east, north - 0.05 * size, 0.0],
            eye_up=[0.0, 0.0, 1.0],
        )

    def _stamp_s(self, document: Document) -> float:
        """Return the time of a message on the flight's clock [s]."""
        utc_s = utc_of(document)
        return (number(document.get("stamp_s")) or 0.0) if utc_s is None else utc_s - self._pictures.epoch_s

    def _show(self, picture: str, message: Mapping[str, Any]) -> None:
        rr, stream = self._rr, self._stream
        if picture in SCENES:
            for gone in message["deletions"]:
                path = _path_of(gone["id"])
                self._kinds.pop(tuple(path), None)
                stream.log(path, rr.Clear(recursive=True))
            for entity in message["entities"]:
                self._entity(_path_of(entity["id"], entity["frame_id"]), entity)
        elif picture == TRANSFORM:
            turn = rr.Quaternion(xyzw=_turn(message["rotation"]))
            place = _row(message["translation"])
            stream.log([WORLD, scenes.AIRCRAFT], rr.Transform3D(translation=place, quaternion=turn))
        elif picture == LOG:
            level = "WARN" if message["level"] >= WARNING else "INFO"
            stream.log([DECISIONS], rr.TextLog(printable(message["message"]), level=level))

    def _entity(self, path: list[str], entity: Mapping[str, Any]) -> None:
        """Draw an entity; each kind of its primitives has a path below the entity's path."""
        drawn = self._drawn(entity)
        for kind, shown in drawn.items():
            self._stream.log([*path, kind], shown)
        for kind in sorted(self._kinds.get(tuple(path), set()) - drawn.keys()):
            self._stream.log([*path, kind], self._rr.Clear(recursive=False))
        self._kinds[tuple(path)] = set(drawn)

    def _drawn(self, entity: Mapping[str, Any]) -> dict[str, Any]:
        """Convert an entity's primitives to archetypes, by kind."""
        found = {
            "solid" if count == 0 else f"solid_{count}": self._solid(part)
            for count, part in enumerate(entity["triangles"])
        }
        if lines := [(entry, strip) for entry in entity["lines"] for strip in _strips(entry)]:
            found["lines"] = self._rr.LineStrips3D(
                [strip for _, strip in lines], colors=[_rgba(_colour(entry)) for entry, _ in lines],
                radii=self._rr.Radius.ui_points([0.5 * entry["thickness"] for entry, _ in lines]),
            )  # fmt: skip
        if entity["spheres"]:
            found["spheres"] = self._balls(entity["spheres"])
        if entity["texts"]:
            found["name"] = self._words(entity["texts"])
        return found

    def _solid(self, part: Mapping[str, Any]) -> Any:  # noqa: ANN401
        corners = _rows(part["points"])
        return self._rr.Mesh3D(
            vertex_positions=corners, vertex_normals=_normals(corners), albedo_factor=_glass(_colour(part))
        )

    def _balls(self, parts: Sequence[Mapping[str, Any]]) -> Any:  # noqa: ANN401
        return self._rr.Ellipsoids3D(
            centers=[_row(part["pose"]["position"]) for part in parts],
            half_sizes=[[0.5 * size for size in _row(part["size"])] for part in parts],
            quaternions=[self._rr.Quaternion(xyzw=_turn(part["pose"]["orientation"])) for part in parts],
            colors=[_rgba(_colour(part)) for part in parts], fill_mode="solid",
        )  # fmt: skip

    def _words(self, parts: Sequence[Mapping[str, Any]]) -> Any:  # noqa: ANN401
        return self._rr.Points3D(
            [_row(part["pose"]["position"]) for part in parts],
            colors=[_rgba(_colour(part)) for part in parts],
            labels=[printable(part["text"]) for part in parts], show_labels=True,
            radii=self._rr.Radius.ui_points(1.0),
        )  # fmt: skip

    def _plot(self, path: str, value: object) -> None:
        """Plot a value; a missing value makes a gap."""
        found = number(value)
        if found is not None:
            self._stream.log(path, self._rr.Scalars(found))
        elif self._plotted.get(path):
            self._stream.log(path, self._rr.Clear(recursive=False))
        if found is not None or path in self._plotted:
            self._plotted[path] = found is not None

    def _locate(self, document: Document) -> None:
        """Mark the aircraft on the map."""
        latitude, longitude = number(document.get("latitude"), 90.0), number(document.get("longitude"), 360.0)
        if latitude is not None and longitude is not None:
            self._is_located = True
            place = self._rr.GeoPoints(
                lat_lon=[[latitude, longitude]], colors=[_rgba(scenes.FLOWN)],
                radii=self._rr.Radius.ui_points(6.0),
            )  # fmt: skip
            self._stream.log([GEO, scenes.AIRCRAFT], place)


def _path_of(name: str, frame: str = scenes.MAP) -> list[str]:
    """Return the path of an entity: its kind and its name, which may contain any character."""
    kind, _, rest = name.partition(" ")
    return [WORLD, *([] if frame == scenes.MAP else [frame]), kind, *([rest] if rest else [])]


def _turn(quaternion: Mapping[str, float]) -> list[float]:
    return [quaternion[axis] for axis in "xyzw"]


def _row(place: Mapping[str, float]) -> list[float]:
    return [place["x"], place["y"], place["z"]]


def _rows(places: Sequence[Mapping[str, float]]) -> FloatArray:
    """Convert positions to rows (N, 3) [m]."""
    return np.array([_row(place) for place in places], dtype=np.float64).reshape(-1, 3)


def _strips(line: Mapping[str, Any]) -> list[FloatArray]:
    """Return the line strips (N, 3) of a line primitive [m]; none if it has fewer than two points."""
    places = _rows(line["points"])
    if line["type"] == scenes.LIST:
        return list(places[: len(places) // 2 * 2].reshape(-1, 2, 3))
    if line["type"] == scenes.LOOP:
        places = np.vstack([places, places[:1]])
    return [places] if len(places) > 1 else []


def _normals(corners: FloatArray) -> FloatArray:
    """Return unit normals of triangles, rows (M, 3), one for each of their ``corners`` (M, 3) [m].

    The normals of level triangles point up.
    """
    first, second, third = corners.reshape(-1, 3, 3).transpose(1, 0, 2)
    facing = np.cross(second - first, third - first)
    lengths = np.linalg.norm(facing, axis=1, keepdims=True)
    unit = np.divide(facing, lengths, out=np.zeros_like(facing), where=lengths > 0.0)
    return np.repeat(np.where(unit[:, 2:] < 0.0, -unit, unit), 3, axis=0)


def _colour(part: Mapping[str, Any]) -> scenes.Colour:
    colour = part["color"]
    return colour["r"], colour["g"], colour["b"], colour["a"]


def _rgba(colour: scenes.Colour) -> list[int]:
    """Return a scene colour as shown on a dark background."""
    red, green, blue, opacity = colour
    dark = _DARK.get((red, green, blue), tuple(round(255.0 * share) for share in (red, green, blue)))
    return [*dark, round(255.0 * opacity)]


def _glass(colour: scenes.Colour) -> list[int]:
    """Return the colour of a surface; the viewer mixes light, so surfaces are more transparent."""
    *dark, opacity = _rgba(colour)
    if colour == scenes.OBSTACLE:
        return [*dark, round(255.0 * _WALLS)]
    return [*dark, round(opacity**2 / 255.0)]


def export_rerun(flight: Path, target: Path) -> int:
    """Write the picture of a recording for rerun, with a blueprint that shows it.

    Parameters
    ----------
    flight : Path
        ``flight.mcap``.
    target : Path
        The picture; an existing file is replaced.

    Returns
    -------
    int
        Number of messages drawn.

    Raises
    ------
    ModuleNotFoundError
        If the extra ``rerun`` is not installed.
    RecordError
        If the recording contains no message, or the target cannot be written.
    """
    import rerun  # The package is an extra.  # noqa: PLC0415

    known = {channel.topic for channel in channels.CHANNELS}
    stream = rerun.RecordingStream("companion", send_properties=False)
    stream.set_log_time_enabled(enabled=False)
    stream.set_log_tick_enabled(enabled=False)
    # The package would not report a full disk if it wrote the file; and only one read gives a valid file.
    made = stream.binary_stream()
    drawing, num_messages = _Drawing(rerun, stream), 0
    try:
        with open_to_write(target) as file:
            stream.send_recording_name(printable(flight.resolve().parent.name))
            drawing.begin()
            for topic, document in messages_of(flight, Counter()):
                if topic in known:
                    drawing.draw(topic, document)
                    num_messages += 1
            drawing.end()
            file.write(made.read() or b"")
    except OSError as error:
        raise RecordError(f"{target}: {error.strerror or error}") from error
    finally:
        # The stream must be read after disconnecting: otherwise the package waits for a reader for ever.
        stream.disconnect()
        made.read(flush=False)
    if not num_messages:
        raise RecordError(f"{flight}: no message in it")
    return num_messages

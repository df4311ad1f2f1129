"""The recorder, which writes a flight to disk and to memory. It makes no decisions."""

from __future__ import annotations

import contextlib
import importlib.metadata
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from companion import __version__
from companion.config import MissionConfig
from companion.config.load import recorded_text
from companion.errors import RecordError
from companion.frames import LocalFrame
from companion.link.wire.tlog import TlogWriter
from companion.recording import mcap_schema as channels
from companion.recording.mcap_writer import FlightLog, encoded
from companion.safe_files import SHARED, make_folder, replace_file
from companion.types.record import Decision, FlightRecord, PlanRecord, SwapRecord, UploadedMission
from companion.types.state import Ownship
from companion.types.threat import Obstacle, TrackState
from companion.world.snapshot import Snapshot

TRACK_ROWS_MAX = 30_000  # Rows of all vehicles: a few megabytes, and 100 minutes of one vehicle at 5 Hz.
STATE_ROWS_MAX = 72_000  # Four hours at 5 Hz. Of longer flights every second row is kept in memory.
DECISIONS_MAX = 20_000
TRACK = "/track"  # State of one vehicle between two rows of all; sent to the page only, and not recorded.
TLOG, MCAP, MISSION_FILE = "flight.tlog", "flight.mcap", "mission.yaml"
LIBRARIES = ("numpy", "numba", "scipy", "pymavlink", "mavsdk", "mcap")
_LOCATION_S = 1.0
_COVARIANCE_DIAGONAL = 2  # Value of foxglove.LocationFix for a known diagonal.

Listener = Callable[[str, float, Mapping[str, object], bytes], None]
Onlooker = Callable[[str, bytes], None]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class About:
    """Description of a recording.

    Parameters
    ----------
    mission : MissionConfig
        Mission of the flight.
    seed : int
        Seed of plans and filters.
    mission_text : str
        Text of the mission file; by default it is written from the mission.
    step_s : float or None
        Step of simulated time [s]; None for a wall clock.
    """

    mission: MissionConfig
    seed: int
    mission_text: str = ""
    step_s: float | None = None


@dataclass
class Recorder:
    """Records a flight.

    Parameters
    ----------
    folder : Path or None
        Folder of ``flight.tlog``, ``flight.mcap`` and the mission file; None records in memory only.
    epoch_s : float
        UTC at clock reading 0 [s].
    about : About, optional
        Description of the recording; without it, only frames are written.

    Attributes
    ----------
    failure : str
        Why the recording ended before the flight; '' while it continues.
    tracks : dict
        Rows of time [s], east, north, up and reach [m] by identity; the reach of a vehicle that is no pursuer
        is 0.
    """

    folder: Path | None = None
    epoch_s: float = 0.0
    about: About | None = None
    failure: str = ""
    flown: list[list[float]] = field(default_factory=list)
    tracks: dict[str, list[list[float]]] = field(default_factory=dict)
    missions: list[UploadedMission] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    threat: list[list[float]] = field(default_factory=list)
    plan_ms: list[float] = field(default_factory=list)
    track_to_mission_ms: list[float] = field(default_factory=list)
    num_rejected: int = 0
    energy_left: list[list[float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._tlog: TlogWriter | None = None
        self._log: FlightLog | None = None
        self._listener: Listener | None = None
        self._onlooker: Onlooker | None = None
        self._num_track_rows = 0
        self._located_s = -math.inf
        self._obstacles: tuple[Obstacle, ...] | None = None
        if self.folder is not None:
            try:
                make_folder(self.folder)
                if self.about is not None:
                    text = recorded_text(self.about.mission_text, self.about.mission)
                    replace_file(self.folder / MISSION_FILE, text.encode(), SHARED)
            except OSError as error:
                raise RecordError(f"{self.folder}: {error.strerror}") from error
            self._tlog = TlogWriter(self.folder / TLOG)
            if self.about is not None:
                self._log = FlightLog(self.folder / MCAP, self.epoch_s)

    def listen(self, listener: Listener, onlooker: Onlooker | None = None) -> None:
        """Set the function that gets each recorded message: topic, clock reading [s], content, JSON.

        The onlooker also gets the topic and JSON of unrecorded messages. Both functions are called during a
        flight: they must not wait or raise.
        """
        self._listener, self._onlooker = listener, onlooker

    @property
    def has_onlooker(self) -> bool:
        """Whether an onlooker gets unrecorded messages."""
        return self._onlooker is not None

    def notice(self, topic: str, now_s: float, message: Mapping[str, object]) -> None:
        """Send a message to the onlooker only."""
        if self._onlooker is not None:
            self._onlooker(topic, encoded(now_s, message))

    def begin(self, now_s: float, remembered: Mapping[str, object] | None = None) -> None:
        """Record the description."""
        if self.about is None:
            return
        about = self.about
        self._note(
            channels.MISSION, now_s,
            {
                "name": about.mission.name,
                "mission_file": recorded_text(about.mission_text, about.mission),
                "seed": about.seed,
                "epoch_s": self.epoch_s,
                "clock": "wall" if about.step_s is None else "simulated",
                "step_s": about.step_s,
                "versions": versions_now(),
                "remembered": remembered or {},
            },
        )  # fmt: skip

    def reloaded(self, now_s: float, mission: MissionConfig, mission_text: str) -> None:
        """Record that another mission file is in force from now on."""
        if self.about is not None:
            self.about = replace(self.about, mission=mission, mission_text=mission_text)
            self.begin(now_s)

    @property
    def is_recording(self) -> bool:
        """Whether the flight is written to disk."""
        return self._tlog is not None

    def frame(self, now_s: float, raw: bytes) -> None:
        """Write a received or sent frame; a full disk ends the recording, not the flight."""
        tlog = self._tlog
        if tlog is not None:
            self._write(lambda: tlog.write(self.epoch_s + now_s, raw))

    @property
    def _is_noted(self) -> bool:
        """Whether anybody uses messages."""
        return self._log is not None or self._listener is not None

    def _note(self, topic: str, now_s: float, message: Mapping[str, object]) -> None:
        log, listener = self._log, self._listener
        if not self._is_noted:
            return
        data = encoded(now_s, message)
        if listener is not None:
            listener(topic, now_s, message, data)
        if log is not None:
            self._write(lambda: log.write(topic, now_s, data))

    def _write(self, write: Callable[[], None]) -> None:
        """Write; an error ends the whole recording and is logged once."""
        try:
            write()
        except RecordError as error:
            _log.error("recording stopped: %s", error)
            self.failure = str(error)
            tlog, log, self._tlog, self._log = self._tlog, self._log, None, None
            for file in (tlog, log):
                if file is not None:
                    with contextlib.suppress(RecordError):
                        file.close()

    def state(self, now_s: float, ownship: Ownship, tracks: tuple[TrackState, ...], level: float) -> None:
        """Add a row of the flight's state as estimated on board."""
        self.flown.append(
            [
                now_s, *ownship.position_enu_m, ownship.course_rad, ownship.flight_path_angle_rad,
                ownship.airspeed_m_s,
            ]
        )  # fmt: skip
        self.threat.append([now_s, level])
        if len(self.flown) > STATE_ROWS_MAX:
            self.flown, self.threat = self.flown[1::2], self.threat[1::2]
        for track in tracks:
            reach = 0.0 if track.flies_on else track.max_threat_radius_m
            self.tracks.setdefault(track.identity, []).append([now_s, *track.position_enu_m, reach])
        self._num_track_rows += len(tracks)
        if self._num_track_rows > TRACK_ROWS_MAX:
            self._thin_tracks()
        if self._is_noted:
            self._note(channels.OWNSHIP, now_s, channels.table_of(ownship, leave=("stamp_s",)))
            self._note(channels.TRACKS, now_s, {"tracks": [channels.table_of(track) for track in tracks]})
            self._note(channels.THREAT, now_s, {"level": level})
            if self.about is not None and now_s - self._located_s >= _LOCATION_S:
                self._located_s = now_s
                fix = _fix(self.about.mission.frame, ownship, self.epoch_s + now_s)
                self._note(channels.LOCATION, now_s, fix)

    def _thin_tracks(self) -> None:
        """Keep every second row; drop vehicles with a single row, which fill the memory in a flood."""
        self.tracks = {identity: rows[1::2] for identity, rows in self.tracks.items() if len(rows) > 1}
        self._num_track_rows = sum(map(len, self.tracks.values()))

    def decide(
        self, now_s: float, kind: str, text: str, plan_ms: float | None = None,
        track_to_mission_ms: float | None = None, why: Mapping[str, object] | None = None, *, told: str = "",
    ) -> Decision:  # fmt: skip
        """Add a decision, the values that led to it, and the text sent to the pilot."""
        _log.info("%7.1f s  %s: %s", now_s, kind, text, extra={"decision": kind})
        decision = Decision(now_s, kind, text, plan_ms, track_to_mission_ms, why or {}, told)
        self.decisions.append(decision)
        if len(self.decisions) > DECISIONS_MAX:
            del self.decisions[: DECISIONS_MAX // 2]
        self._note(channels.DECISION, now_s, channels.table_of(decision, leave=("stamp_s",)))
        return decision

    def plan(self, now_s: float, made: PlanRecord, snapshot: Snapshot) -> None:
        """Add a plan and the world that it was made in."""
        self.plan_ms.append(made.plan_ms)
        if not self._is_noted:
            return
        world: dict[str, object] = {
            "number": snapshot.number,
            "known_threats": [
                radar.name
                for radar, known in zip(snapshot.radar_list, snapshot.threats.known, strict=True)
                if known
            ],
            "tracks": [channels.table_of(track) for track in snapshot.tracks],
        }
        if snapshot.obstacle_list is not self._obstacles:
            self._obstacles = snapshot.obstacle_list
            world["obstacles"] = [channels.table_of(obstacle) for obstacle in snapshot.obstacle_list]
        self._note(channels.SNAPSHOT, made.begun_s, world)
        self._note(channels.PLAN, now_s, channels.plan_table(made))
        self._note(channels.TREES, now_s, channels.trees_table(made))

    def mission_flown(self, mission: UploadedMission, latency_ms: float | None = None) -> None:
        """Add a mission that is flown, and the age of the newest track at that time [ms]."""
        self.missions.append(mission)
        if latency_ms is not None:
            self.track_to_mission_ms.append(latency_ms)

    def plan_rejected(self) -> None:
        """Count a plan or mission that was refused."""
        self.num_rejected += 1

    def swap(self, now_s: float, made: SwapRecord) -> None:
        """Add a mission transfer to the autopilot and its result."""
        self._note(channels.SWAP, now_s, channels.table_of(made))

    def link(self, now_s: float, document: Mapping[str, object]) -> None:
        """Add the state of the link."""
        self._note(channels.LINK, now_s, document)

    def energy(self, now_s: float, document: Mapping[str, object]) -> None:
        """Add what is left of the battery or tank, and what the way home costs."""
        left_wh, margin_wh = document["left_wh"], document["margin_wh"]
        if isinstance(left_wh, float):
            margin = margin_wh if isinstance(margin_wh, float) else math.nan
            self.energy_left.append([now_s, left_wh, left_wh - margin])
        if len(self.energy_left) > STATE_ROWS_MAX:
            self.energy_left = self.energy_left[1::2]
        self._note(channels.ENERGY, now_s, document)

    def standing(self, now_s: float, document: Mapping[str, object]) -> None:
        """Add the state of the service and the pilot's options."""
        self._note(channels.STANDING, now_s, document)

    def record(self, summary: dict[str, float | int | bool | str]) -> FlightRecord:
        """Return the flight so far, for the report."""
        return FlightRecord(
            flown=np.array(self.flown, dtype=np.float64).reshape(-1, 7),
            dt_paths=(),
            dt_tracks=tuple(np.array(rows)[:, :3] for rows in self.tracks.values()),
            missions=tuple(self.missions),
            decisions=tuple(self.decisions),
            threat=np.array(self.threat, dtype=np.float64).reshape(-1, 2),
            plan_ms=tuple(self.plan_ms),
            summary=summary,
            epoch_s=self.epoch_s or None,
            energy=np.array(self.energy_left, dtype=np.float64).reshape(-1, 3),
        )

    def close(self) -> None:
        """Close the files; data that cannot be written is lost, and an error is logged."""
        for file in (self._tlog, self._log):
            if file is not None:
                self._write(file.close)
        self._tlog = self._log = None


def versions_now() -> dict[str, str]:
    """Return the versions of the program and of the libraries that its results depend on."""
    return {"companion": __version__} | {name: importlib.metadata.version(name) for name in LIBRARIES}


def _fix(frame: LocalFrame, ownship: Ownship, utc_s: float) -> dict[str, object]:
    """Return the aircraft's position as a foxglove.LocationFix."""
    latitude, longitude, altitude = frame.global_from_local(*ownship.position_enu_m)
    seconds = int(utc_s)
    wide, high = (std**2 for std in ownship.position_std_m)
    return {
        "timestamp": {"sec": seconds, "nsec": round(1e9 * (utc_s - seconds))},
        "frame_id": "wgs84",
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "position_covariance": [wide, 0.0, 0.0, 0.0, wide, 0.0, 0.0, 0.0, high],
        "position_covariance_type": _COVARIANCE_DIAGONAL,
    }

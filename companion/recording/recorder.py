"""The recorder: listens, and decides nothing."""

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
from companion.config.load import text_of
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

TRACK_ROWS_MAX = 30_000  # of all vehicles: a few megabytes, and 100 minutes of one at 5 Hz
STATE_ROWS_MAX = 72_000  # four hours at 5 Hz; of longer flights every second row is kept in memory
DECISIONS_MAX = 20_000
TRACK = "/track"  # one vehicle, between two rows of all: told to an onlooker, and not written down
TLOG, MCAP, MISSION_FILE = "flight.tlog", "flight.mcap", "mission.yaml"
LIBRARIES = ("numpy", "numba", "scipy", "pymavlink", "mavsdk", "mcap")
_LOCATION_S = 1.0
_COVARIANCE_DIAGONAL = 2  # foxglove.LocationFix: only the diagonal is known

Listener = Callable[[str, float, Mapping[str, object], bytes], None]
Onlooker = Callable[[str, bytes], None]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class About:
    """What a recording says of itself.

    Parameters
    ----------
    mission : MissionConfig
        Mission that is flown.
    seed : int
        Seed of plans and filters.
    mission_text : str
        The mission file, to be copied; left out, it is written anew from what was understood.
    step_s : float or None
        Step of simulated time [s]; None where a wall clock is gone by.
    """

    mission: MissionConfig
    seed: int
    mission_text: str = ""
    step_s: float | None = None


@dataclass
class Recorder:
    """Collects a flight.

    Parameters
    ----------
    folder : Path or None
        Folder of ``flight.tlog``, ``flight.mcap`` and the mission file; None records in memory only.
    epoch_s : float
        UTC seconds at clock reading 0, for the stamps.
    about : About, optional
        What is recorded; left out, only what is on the wire is.

    Attributes
    ----------
    failure : str
        Why the recording ended before the flight; '' while it has not.
    tracks : dict
        By identity rows of time [s], east, north, up and reach [m], which is 0 of what hunts nobody.
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
                    text = self.about.mission_text or text_of(self.about.mission)
                    replace_file(self.folder / MISSION_FILE, text.encode(), SHARED)
            except OSError as error:
                raise RecordError(f"{self.folder}: {error.strerror}") from error
            self._tlog = TlogWriter(self.folder / TLOG)
            if self.about is not None:
                self._log = FlightLog(self.folder / MCAP, self.epoch_s)

    def listen(self, listener: Listener, onlooker: Onlooker | None = None) -> None:
        """Tell somebody each message as it is written down: topic, stamp [s], what it says, that as JSON.

        An onlooker is told topic and JSON of what is heard between these, too, and is not written down.
        They are told in the middle of a flight: they neither wait nor raise.
        """
        self._listener, self._onlooker = listener, onlooker

    @property
    def has_onlooker(self) -> bool:
        """Whether somebody wants to know what is heard between two rows of the recording."""
        return self._onlooker is not None

    def notice(self, topic: str, now_s: float, message: Mapping[str, object]) -> None:
        """Tell the onlooker alone."""
        if self._onlooker is not None:
            self._onlooker(topic, encoded(now_s, message))

    def begin(self, now_s: float, remembered: Mapping[str, object] | None = None) -> None:
        """Write what the recording is about."""
        if self.about is None:
            return
        about = self.about
        self._note(
            channels.MISSION, now_s,
            {
                "name": about.mission.name,
                "mission_file": about.mission_text or text_of(about.mission),
                "seed": about.seed,
                "epoch_s": self.epoch_s,
                "clock": "wall" if about.step_s is None else "simulated",
                "step_s": about.step_s,
                "versions": versions_now(),
                "remembered": remembered or {},
            },
        )  # fmt: skip

    def reloaded(self, now_s: float, mission: MissionConfig, mission_text: str) -> None:
        """Write that another mission file is gone by from now on."""
        if self.about is not None:
            self.about = replace(self.about, mission=mission, mission_text=mission_text)
            self.begin(now_s)

    @property
    def is_recording(self) -> bool:
        """Whether the flight goes to a disk."""
        return self._tlog is not None

    def frame(self, now_s: float, raw: bytes) -> None:
        """Write what was received or sent; a full disk ends the recording, not the flight."""
        tlog = self._tlog
        if tlog is not None:
            self._write(lambda: tlog.write(self.epoch_s + now_s, raw))

    @property
    def _is_noted(self) -> bool:
        """Whether anything comes of a message."""
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
        """Write; what fails ends the whole recording, and is told once."""
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
        """Add a row of the flight as it is known on board."""
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
        """Keep every second row; vehicles of a single one, with which a flood fills the memory, go."""
        self.tracks = {identity: rows[1::2] for identity, rows in self.tracks.items() if len(rows) > 1}
        self._num_track_rows = sum(map(len, self.tracks.values()))

    def decide(
        self, now_s: float, kind: str, text: str, plan_ms: float | None = None,
        track_to_mission_ms: float | None = None, why: Mapping[str, object] | None = None, *, told: str = "",
    ) -> Decision:  # fmt: skip
        """Add a decision, the numbers that led to it, and what the pilot is told."""
        _log.info("%7.1f s  %s: %s", now_s, kind, text, extra={"decision": kind})
        decision = Decision(now_s, kind, text, plan_ms, track_to_mission_ms, why or {}, told)
        self.decisions.append(decision)
        if len(self.decisions) > DECISIONS_MAX:
            del self.decisions[: DECISIONS_MAX // 2]
        self._note(channels.DECISION, now_s, channels.table_of(decision, leave=("stamp_s",)))
        return decision

    def plan(self, now_s: float, made: PlanRecord, snapshot: Snapshot) -> None:
        """Add a plan and the world it was made in."""
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
        """Add a mission that is flown, and how old the newest track was by then [ms]."""
        self.missions.append(mission)
        if latency_ms is not None:
            self.track_to_mission_ms.append(latency_ms)

    def plan_rejected(self) -> None:
        """Count a plan or mission that was refused."""
        self.num_rejected += 1

    def swap(self, now_s: float, made: SwapRecord) -> None:
        """Add a mission that was handed to the autopilot, and how that ended."""
        self._note(channels.SWAP, now_s, channels.table_of(made))

    def link(self, now_s: float, told: Mapping[str, object]) -> None:
        """Add what the link tells of itself."""
        self._note(channels.LINK, now_s, told)

    def standing(self, now_s: float, told: Mapping[str, object]) -> None:
        """Add how the service stands, and what the pilot can do."""
        self._note(channels.STANDING, now_s, told)

    def record(self, summary: dict[str, float | int | bool | str]) -> FlightRecord:
        """The flight so far, for the report."""
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
        )

    def close(self) -> None:
        """End the files; what cannot be written any more is lost, and said."""
        for file in (self._tlog, self._log):
            if file is not None:
                self._write(file.close)
        self._tlog = self._log = None


def versions_now() -> dict[str, str]:
    """Of the program and of what its results hang on, by name."""
    return {"companion": __version__} | {name: importlib.metadata.version(name) for name in LIBRARIES}


def _fix(frame: LocalFrame, ownship: Ownship, utc_s: float) -> dict[str, object]:
    """Own place as Foxglove's map takes it."""
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

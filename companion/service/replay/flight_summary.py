"""Makes the data of a flight's report from its recording."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from companion.assurance.encounters import known_encounters
from companion.config import MissionConfig, load_mission
from companion.config.compose import world_of
from companion.config.load import mission_from_text
from companion.config.sections.terrain_map import ground_heights_of
from companion.errors import RecordError
from companion.frames import FloatArray
from companion.recording import mcap_reader
from companion.recording import mcap_schema as channels
from companion.recording.reader import (
    DECISIONS_MAX,
    SEED_MAX,
    SIMULATED,
    about_of,
    decision_of,
    load_recording,
    stamp_of,
)
from companion.recording.recorder import MCAP, MISSION_FILE, TLOG
from companion.service.replay.frames_record import ON_BOARD, record_of_frames
from companion.types.record import Decision, FlightRecord, UploadedMission
from companion.types.threat import Obstacle
from companion.world.obstacles import packed_obstacles
from companion.world.snapshot import Snapshot

ROWS_MAX = 1_000_000  # Rows of all kinds together: 16 hours with ten vehicles in sight.
TRACKS_MAX = 1_000  # Tracks at one instant.
OBSTACLES_MAX = 5_000
POINTS_MAX = 2_000  # Points of a mission or an obstacle.
FAR = 1e7  # Largest plausible coordinate [m] or other value.


def flight_of(folder: Path) -> tuple[MissionConfig, Snapshot, FlightRecord]:
    """Return mission, world and record of a flight's folder.

    Raises
    ------
    RecordError
        If it contains no recording, or one without a position of the aircraft.
    ConfigError
        If its mission file cannot be read.
    """
    mission, world, record = _read(folder)
    if not len(record.flown):
        raise RecordError(f"{folder}: nothing was flown: no place of the aircraft is in the recording")
    return mission, world, record


def _read(folder: Path) -> tuple[MissionConfig, Snapshot, FlightRecord]:
    counters: Counter[str] = Counter()
    if (folder / MCAP).exists():
        data = _ReportData(counters)
        for topic, row in mcap_reader.messages_of(folder / MCAP, counters):
            data.take(topic, row)
        if data.about:
            return _from_messages(folder, data)
    if not (folder / TLOG).exists():
        raise RecordError(f"{folder}: neither {MCAP} nor {TLOG} with a flight in it")
    mission = load_mission(folder / MISSION_FILE)
    return (
        mission,
        world_of(mission, none_known=False),
        record_of_frames(mission, load_recording(folder / TLOG)),
    )


class _ReportData:
    """The part of an MCAP file's messages that a report shows; the file may be large and of any origin.

    Parameters
    ----------
    counters : Counter
        Counts skipped messages.
    """

    def __init__(self, counters: Counter[str]) -> None:
        self.counters = counters
        self.about: mcap_reader.Document = {}
        self.flown: list[list[float]] = []
        self.threat: list[list[float]] = []
        self.energy: list[list[float]] = []
        self.plan_ms: list[float] = []
        self.missions: list[UploadedMission] = []
        self.num_not_entered = 0
        self.decisions: list[Decision] = []
        self.tracks: dict[str, list[list[float]]] = {}
        self.fences: object = None
        self._num_rows = 0
        self._takers = {
            channels.MISSION: self._mission,
            channels.OWNSHIP: self._ownship,
            channels.THREAT: self._level,
            channels.PLAN: self._plan,
            channels.SWAP: self._swap,
            channels.DECISION: self._decision,
            channels.TRACKS: self._tracks,
            channels.SNAPSHOT: self._snapshot,
            channels.ENERGY: self._energy,
        }

    def take(self, topic: str, row: mcap_reader.Document) -> None:
        """Take a message; messages beyond the limits are skipped and counted."""
        taker = self._takers.get(topic)
        if taker is not None:
            if self._num_rows < ROWS_MAX:
                self._num_rows += 1
                taker(row)
            else:
                self.counters["beyond_the_longest_flight"] += 1

    def _mission(self, row: mcap_reader.Document) -> None:
        self.about = self.about or about_of(row)

    def _ownship(self, row: mcap_reader.Document) -> None:
        place = _floats(row.get("position_enu_m"), 3)
        if math.isfinite(sum(place)):
            angles = (_float(row.get(key)) for key in ("course_rad", "flight_path_angle_rad"))
            self.flown.append([stamp_of(row), *place, *angles, _float(row.get("airspeed_m_s"))])

    def _level(self, row: mcap_reader.Document) -> None:
        self.threat.append([stamp_of(row), _float(row.get("level"))])

    def _plan(self, row: mcap_reader.Document) -> None:
        self.plan_ms.append(_float(row.get("plan_ms")))

    def _swap(self, row: mcap_reader.Document) -> None:
        if row.get("outcome") != "flown":
            self.num_not_entered += 1
            return
        places = _table(row.get("waypoints_enu_m"), 3)
        places = places[np.isfinite(places).all(axis=1)]
        self._num_rows += len(places)
        if len(places):
            self.missions.append(
                UploadedMission(_float(row.get("ended_s")), places, mcap_reader.text(row.get("reason")))
            )

    def _decision(self, row: mcap_reader.Document) -> None:
        if len(self.decisions) < DECISIONS_MAX:
            self.decisions.append(decision_of(row))

    def _tracks(self, row: mcap_reader.Document) -> None:
        tracks = row.get("tracks")
        for track in tracks[:TRACKS_MAX] if isinstance(tracks, list) else ():
            if not isinstance(track, dict):
                continue
            place = _floats(track.get("position_enu_m"), 3)
            rows = self.tracks.setdefault(mcap_reader.text(track.get("identity"), 100), [])
            reach = 0.0 if track.get("flies_on") is True else _float(track.get("max_threat_radius_m"))
            rows.append([stamp_of(row), *place, reach])
            self._num_rows += 1

    def _energy(self, row: mcap_reader.Document) -> None:
        left, margin = _float(row.get("left_wh")), _float(row.get("margin_wh"))
        if math.isfinite(left):
            self.energy.append([stamp_of(row), left, left - margin])

    def _snapshot(self, row: mcap_reader.Document) -> None:
        self.fences = row.get("obstacles", self.fences)


def _from_messages(folder: Path, data: _ReportData) -> tuple[MissionConfig, Snapshot, FlightRecord]:
    about = data.about
    mission = mission_from_text(str(about["mission_file"]), str(folder / MCAP))
    flown = _table(data.flown, 7, ROWS_MAX)
    record = FlightRecord(
        flown=flown,
        dt_paths=(),
        dt_tracks=tuple(np.array(rows)[:, :3] for rows in data.tracks.values()),
        missions=tuple(data.missions),
        decisions=tuple(data.decisions),
        threat=_table(data.threat, 2, ROWS_MAX),
        plan_ms=tuple(data.plan_ms),
        summary=_summary(data, flown) | _over_ground(mission, flown),
        epoch_s=mcap_reader.number(about["epoch_s"]),
        note=ON_BOARD,
        begin_s=mcap_reader.number(about["stamp_s"]),
        encounters=known_encounters(
            flown, data.tracks.items(), mission.radar_list, mission.obstacle_list, ground_heights_of(mission)
        ),
        energy=_table(data.energy, 3, ROWS_MAX),
    )
    return mission, _with_fences(world_of(mission, none_known=False), data.fences), record


def report_name(record: FlightRecord) -> str:
    """Return the name of a report from a recording, next to the simulator's own."""
    return "report-on-board" if record.summary.get("clock") == SIMULATED else "report"


def _with_fences(world: Snapshot, rows: object) -> Snapshot:
    """Return the world with the obstacles of the autopilot's fences."""
    if not isinstance(rows, list) or not 0 < len(rows) <= OBSTACLES_MAX:
        return world
    obstacles = tuple(
        Obstacle(
            mcap_reader.text(row.get("name"), 100),
            _table(row.get("polygon_enu_m"), 2),
            _float(row.get("base_m")),
            _float(row.get("top_m")),
        )
        for row in rows
        if isinstance(row, dict)
    )
    whole = tuple(entry for entry in obstacles if _is_whole(entry))
    packed = packed_obstacles(whole, world.bounds, world.walls.ground)
    return replace(world, obstacle_list=whole, obstacles=packed)


def _is_whole(obstacle: Obstacle) -> bool:
    """Return whether an obstacle's shape is completely known."""
    corners = obstacle.polygon_enu_m
    sides = np.array([obstacle.base_m, obstacle.top_m])
    return len(corners) >= 3 and bool(np.isfinite(corners).all() and np.isfinite(sides).all())


def _summary(data: _ReportData, flown: FloatArray) -> dict[str, float | int | bool | str]:
    """Return the values of the flight; ``flown`` (N, 7) has the columns of :attr:`FlightRecord.flown`."""
    about = data.about
    times = np.array(data.plan_ms or [np.nan])
    versions = about.get("versions")
    program = versions.get("companion", "") if isinstance(versions, dict) else ""
    summary: dict[str, float | int | bool | str] = {
        "mission": str(about["name"]),
        "seed": int(mcap_reader.number(about.get("seed"), SEED_MAX) or 0),
        "clock": str(about["clock"]),
        "program": str(program),
        "missions_entered": len(data.missions),
        "missions_not_entered": data.num_not_entered,
        "plans": len(data.plan_ms),
        "plan_ms": float(np.median(times)),
        "plan_p95_ms": float(np.percentile(times, 95)),
        "flight_s": float(flown[-1, 0] - flown[0, 0]) if len(flown) else 0.0,
    }
    return summary | {reason: count for reason, count in data.counters.items() if count}


def _over_ground(mission: MissionConfig, flown: FloatArray) -> dict[str, float | int | bool | str]:
    """Return the least height over ground of ``flown`` (N, 7), columns as before; nothing without a map."""
    ground = ground_heights_of(mission)
    if ground is None or not len(flown):
        return {}
    return {"min_ground_height_m": round(float((flown[:, 3] - ground.up_m(flown[:, 1:3])).min()), 1)}


def _float(value: object) -> float:
    found = mcap_reader.number(value, FAR)
    return float("nan") if found is None else found


def _floats(value: object, count: int) -> list[float]:
    rows = value if isinstance(value, list) and len(value) == count else [None] * count
    return [_float(entry) for entry in rows]


def _table(rows: object, columns: int, rows_max: int = POINTS_MAX) -> FloatArray:
    """Return lists of numbers as rows, (N, C) with C ``columns``; NaN where a number is missing."""
    listed = rows[:rows_max] if isinstance(rows, list) else []
    table = [_floats(row, columns) for row in listed]
    return np.array(table, dtype=np.float64).reshape(-1, columns)

"""What a report shows of a flight, from its recording alone."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from companion.config import MissionConfig, load_mission
from companion.config.compose import world_of
from companion.config.load import mission_from_text
from companion.config.rules import rules_of
from companion.errors import RecordError
from companion.flight.situation import Situation
from companion.frames import FloatArray
from companion.link.messages.codec import Codec
from companion.recording import mcap_schema as channels
from companion.recording.reader import (
    SIMULATED,
    Document,
    Recording,
    decision_of,
    load_recording,
    number,
    read_messages,
)
from companion.recording.recorder import MCAP, MISSION_FILE, TLOG, Recorder
from companion.types.record import FlightRecord, UploadedMission
from companion.types.threat import Obstacle
from companion.world.obstacles import packed_obstacles
from companion.world.snapshot import Snapshot

ON_BOARD = "Places are those known on board: a recording knows no others."
FROM_TLOG = "There is no flight.mcap: decisions are as the pilot was told, which cuts them short."
STATE_S = 0.2

Documents = dict[str, list[Document]]


def flight_of(folder: Path) -> tuple[MissionConfig, Snapshot, FlightRecord]:
    """Mission, world and record of a flight's folder.

    Raises
    ------
    RecordError
        If there is no recording in it, or one in which no place of the aircraft is known.
    ConfigError
        If the mission file in it cannot be read.
    """
    mission, world, record = _read(folder)
    if not len(record.flown):
        raise RecordError(f"{folder}: nothing was flown: no place of the aircraft is in the recording")
    return mission, world, record


def _read(folder: Path) -> tuple[MissionConfig, Snapshot, FlightRecord]:
    counters: Counter[str] = Counter()
    if (folder / MCAP).exists():
        documents = read_messages(folder / MCAP, counters)
        if documents.get(channels.MISSION):
            return _from_messages(folder, documents, counters)
    if not (folder / TLOG).exists():
        raise RecordError(f"{folder}: neither {MCAP} nor {TLOG} with a flight in it")
    mission = load_mission(folder / MISSION_FILE)
    return mission, world_of(mission, none_known=False), _from_frames(mission, load_recording(folder / TLOG))


def _from_messages(
    folder: Path, documents: Documents, counters: Counter[str]
) -> tuple[MissionConfig, Snapshot, FlightRecord]:
    about = documents[channels.MISSION][0]
    mission = mission_from_text(str(about.get("mission_file", "")), str(folder / MCAP))
    flown = [
        [
            _float(row.get("stamp_s")), *_floats(row.get("position_enu_m"), 3), _float(row.get("course_rad")),
            _float(row.get("flight_path_angle_rad")), _float(row.get("airspeed_m_s")),
        ]
        for row in documents.get(channels.OWNSHIP, [])
    ]  # fmt: skip
    threat = [
        [_float(row.get("stamp_s")), _float(row.get("level"))] for row in documents.get(channels.THREAT, [])
    ]
    plan_ms = tuple(_float(row.get("plan_ms")) for row in documents.get(channels.PLAN, []))
    swaps = documents.get(channels.SWAP, [])
    decisions = tuple(decision_of(row) for row in documents.get(channels.DECISION, []))
    record = FlightRecord(
        flown=_table(flown, 7),
        dt_paths=(),
        dt_tracks=_tracks(documents.get(channels.TRACKS, [])),
        missions=tuple(_uploaded(row) for row in swaps if row.get("outcome") == "flown"),
        decisions=decisions,
        threat=_table(threat, 2),
        plan_ms=plan_ms,
        summary=_summary(about, plan_ms, swaps, _table(flown, 7), counters),
        epoch_s=number(about.get("epoch_s")),
        note=ON_BOARD,
        begin_s=number(about.get("stamp_s")),
    )
    return mission, _with_fences(world_of(mission, none_known=False), documents), record


def report_name(record: FlightRecord) -> str:
    """Name of the report made of a recording: the simulator's own, with the true paths, may lie beside it."""
    return "report-on-board" if record.summary.get("clock") == SIMULATED else "report"


def _with_fences(world: Snapshot, documents: Documents) -> Snapshot:
    """The world with what the autopilot's fences added to it."""
    told = [row["obstacles"] for row in documents.get(channels.SNAPSHOT, []) if "obstacles" in row]
    rows = told[-1] if told else None
    if not isinstance(rows, list) or not rows:
        return world
    obstacles = tuple(
        Obstacle(
            str(row.get("name", "")),
            _table(row.get("polygon_enu_m"), 2),
            _float(row.get("base_m")),
            _float(row.get("top_m")),
        )
        for row in rows
        if isinstance(row, dict)
    )
    return replace(world, obstacle_list=obstacles, obstacles=packed_obstacles(obstacles, world.bounds))


def _from_frames(mission: MissionConfig, recording: Recording) -> FlightRecord:
    """From a tlog alone: what the estimators make of its frames."""
    codec, situation, recorder = Codec(), Situation(rules_of(mission), 1), Recorder()
    due_s = 0.0
    for heard in recording.frames:
        now = heard.at_us * 1e-6
        if heard.is_ours:
            continue
        for frame in codec.feed(heard.frame.raw, now):
            for event in frame.events:
                situation.observe(event, now)
        state = situation.ownship.state(now)
        if state is not None and now >= due_s:
            due_s = now + STATE_S
            tracks = situation.tracker.tracks(now)
            recorder.state(now, state, tracks, situation.threat_at(state, tracks))
    recorder.decisions += recording.decisions
    known = recorder.record({"frames": len(recording.frames), "flight_s": round(recording.duration_s, 1)})
    return replace(
        known, epoch_s=recording.epoch_s, note=f"{ON_BOARD} {FROM_TLOG}", begin_s=recording.start_us * 1e-6
    )


def _summary(
    about: Document, plan_ms: tuple[float, ...], swaps: list[Document], flown: FloatArray,
    counters: Counter[str],
) -> dict[str, float | int | bool | str]:  # fmt: skip
    """Figures of the flight; ``flown`` (N, 7) has the columns of :attr:`FlightRecord.flown`."""
    times = np.array(plan_ms or [np.nan])
    versions = about.get("versions")
    program = versions.get("companion", "") if isinstance(versions, dict) else ""
    summary: dict[str, float | int | bool | str] = {
        "mission": str(about.get("name", "")),
        "seed": int(number(about.get("seed")) or 0),
        "clock": str(about.get("clock", "")),
        "program": str(program),
        "missions_entered": sum(row.get("outcome") == "flown" for row in swaps),
        "missions_not_entered": sum(row.get("outcome") != "flown" for row in swaps),
        "plans": len(plan_ms),
        "plan_ms": float(np.median(times)),
        "plan_p95_ms": float(np.percentile(times, 95)),
        "flight_s": float(flown[-1, 0] - flown[0, 0]) if len(flown) else 0.0,
    }
    return summary | {reason: count for reason, count in counters.items() if count}


def _uploaded(row: Document) -> UploadedMission:
    places = _table(row.get("waypoints_enu_m"), 3)
    return UploadedMission(_float(row.get("ended_s")), places, str(row.get("reason", "")))


def _tracks(rows: list[Document]) -> tuple[FloatArray, ...]:
    """Time [s], east and north [m] of each tracked vehicle, (M, 3)."""
    found: dict[str, list[list[float]]] = {}
    for row in rows:
        tracks = row.get("tracks")
        for track in tracks if isinstance(tracks, list) else ():
            place = _floats(track.get("position_enu_m"), 3)
            found.setdefault(str(track.get("identity")), []).append([_float(row.get("stamp_s")), *place[:2]])
    return tuple(np.array(places) for places in found.values())


def _float(value: object) -> float:
    found = number(value)
    return float("nan") if found is None else found


def _floats(value: object, count: int) -> list[float]:
    rows = value if isinstance(value, list) and len(value) == count else [None] * count
    return [_float(entry) for entry in rows]


def _table(rows: object, columns: int) -> FloatArray:
    """Lists of numbers as rows, (N, C) with as many ``columns``; NaN where a number is missing."""
    listed = rows if isinstance(rows, list) else []
    table = [_floats(row, columns) for row in listed]
    return np.array(table, dtype=np.float64).reshape(-1, columns)

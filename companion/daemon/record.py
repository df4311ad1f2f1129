"""The recorder: listens, and decides nothing."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from companion.errors import RecordError
from companion.link.tlog import TlogWriter
from companion.types.record import Decision, FlightRecord, UploadedMission
from companion.types.state import Ownship
from companion.types.threat import TrackState

TRACK_ROWS_MAX = 30_000  # of all vehicles: a few megabytes, and 100 minutes of one at 5 Hz

_log = logging.getLogger(__name__)


@dataclass
class Recorder:
    """Collects a flight.

    Parameters
    ----------
    folder : Path or None
        Where ``flight.tlog`` goes; None records in memory only.
    epoch_s : float
        UTC seconds at clock reading 0, for the tlog's stamps.
    """

    folder: Path | None = None
    epoch_s: float = 0.0
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
        self._num_track_rows = 0
        if self.folder is not None:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise RecordError(f"{self.folder}: {error.strerror}") from error
            self._tlog = TlogWriter(self.folder / "flight.tlog")

    @property
    def is_recording(self) -> bool:
        """Whether the flight goes to a disk."""
        return self._tlog is not None

    def frame(self, now_s: float, raw: bytes) -> None:
        """Write what was received or sent; a full disk ends the recording, not the flight."""
        if self._tlog is None:
            return
        try:
            self._tlog.write(self.epoch_s + now_s, raw)
        except RecordError as error:
            _log.error("recording stopped: %s", error)
            self._tlog = None

    def state(self, now_s: float, ownship: Ownship, tracks: tuple[TrackState, ...], level: float) -> None:
        """Add a row of the flight as it is known on board."""
        self.flown.append(
            [
                now_s, *ownship.position_enu_m, ownship.course_rad, ownship.flight_path_angle_rad,
                ownship.airspeed_m_s,
            ]
        )  # fmt: skip
        self.threat.append([now_s, level])
        for track in tracks:
            self.tracks.setdefault(track.identity, []).append([now_s, *track.position_enu_m[:2]])
        self._num_track_rows += len(tracks)
        if self._num_track_rows > TRACK_ROWS_MAX:
            self._thin_tracks()

    def _thin_tracks(self) -> None:
        """Keep every second row; vehicles of a single one, with which a flood fills the memory, go."""
        self.tracks = {identity: rows[1::2] for identity, rows in self.tracks.items() if len(rows) > 1}
        self._num_track_rows = sum(map(len, self.tracks.values()))

    def decide(
        self, now_s: float, kind: str, text: str, plan_ms: float | None = None,
        track_to_mission_ms: float | None = None,
    ) -> None:  # fmt: skip
        """Add a decision."""
        _log.info("%7.1f s  %s: %s", now_s, kind, text, extra={"decision": kind})
        self.decisions.append(Decision(now_s, kind, text, plan_ms, track_to_mission_ms))

    def record(self, summary: dict[str, float | int | bool | str]) -> FlightRecord:
        """The flight so far, for the report."""
        return FlightRecord(
            flown=np.array(self.flown, dtype=np.float64).reshape(-1, 7),
            dt_paths=(),
            dt_tracks=tuple(np.array(rows) for rows in self.tracks.values()),
            missions=tuple(self.missions),
            decisions=tuple(self.decisions),
            threat=np.array(self.threat, dtype=np.float64).reshape(-1, 2),
            plan_ms=tuple(self.plan_ms),
            summary=summary,
        )

    def close(self) -> None:
        """End the tlog; what cannot be written any more is lost, and said."""
        tlog, self._tlog = self._tlog, None
        if tlog is None:
            return
        try:
            tlog.close()
        except RecordError as error:
            _log.error("recording stopped: %s", error)

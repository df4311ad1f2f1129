"""Noise samples of a recording: deviations from the flown plans, and errors of the reported positions."""

from __future__ import annotations

import math
import struct
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from companion.config import MissionConfig, load_mission, mission_from_text
from companion.errors import RecordError
from companion.frames import FloatArray, LocalFrame, true_airspeed, wrapped_angle
from companion.link.messages.codec import Codec
from companion.link.wire.framing import RawFrame
from companion.mission.path_progress import MIN_ROWS, Progress, progress_on, time_at
from companion.recording import mcap_schema as channels
from companion.recording.mcap_reader import Document, messages_of, number
from companion.recording.reader import Recording, load_recording
from companion.recording.recorder import MISSION_FILE, TLOG
from companion.research.identification.energy_samples import EnergyListener, EnergyWindow
from companion.research.identification.turn_samples import TurnListener
from companion.types.events import AirData, EstimatorAccuracy, Event, GlobalPosition, Heartbeat
from companion.types.mavlink_enums import ComponentId, GpsFix, MessageId
from companion.types.path import Path as FlownPath

LOOK_AHEAD_ROWS = 20
# Beyond this distance the aircraft flies something else: a pilot's mode, an operator's circle.
OFF_PATH_M = 100.0
CLOCKS_APART_S = 5.0  # A fix and a position that both count from the autopilot's boot differ by at most this.
GAP_MAX_S = 2.5  # Longest time between two fixes.
POSITION_GAP_MAX_S = 0.5
ROWS_MAX = 5_000  # Most rows of a plan.
# GPS_RAW_INT: time, latitude, longitude, altitude, dilutions, speed, course, fix type, satellites, height
# above the ellipsoid, and the accuracies in mm.
_FIX = struct.Struct("<Q3i4H2Bi3I")


@dataclass(frozen=True, slots=True)
class Deviations:
    """Deviations of an aircraft from the plan that it flies, in their order.

    Parameters
    ----------
    times_s : ndarray, shape (N,)
        Clock readings.
    values : ndarray, shape (N, 6)
        To the left of the path, ahead of its times, above it [m]; course and climb angle [rad], positive
        left and up; airspeed [m/s].
    """

    times_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, slots=True)
class ReportedErrors:
    """Errors of the reported positions.

    Parameters
    ----------
    accuracies : ndarray, shape (M, 3)
        Standard deviations that the autopilot reports for its position, its height [m] and its velocity
        [m/s]; NaN where it reports none.
    innovations : ndarray, shape (K, 3)
        East, north, up from one fix to the next, less the integral of the reported velocities [m].
    jerks : ndarray, shape (J, 3)
        Second differences of the reported velocities, east, north, up [m/s].
    """

    accuracies: FloatArray
    innovations: FloatArray
    jerks: FloatArray


@dataclass(frozen=True, slots=True)
class Flown:
    """The samples of one recording; ``deviations`` has an element for each flown plan.

    ``windows`` are those in which the battery's monitor reported the energy used. Each of the ``turns``,
    shape (3,), is one of :class:`~companion.research.identification.turn_samples.TurnListener`.
    """

    name: str
    mission: MissionConfig
    deviations: tuple[Deviations, ...]
    reported_errors: ReportedErrors
    num_left_out: int
    windows: tuple[EnergyWindow, ...] = ()
    turns: tuple[FloatArray, ...] = ()


def flown_of(source: Path, mission_file: Path | None = None) -> Flown:
    """Read a recording: a flight's folder, or a tlog and the mcap next to it, if there is one.

    Parameters
    ----------
    source : Path
        The folder or the tlog.
    mission_file : Path, optional
        The mission file, if the recording has none.

    Raises
    ------
    RecordError
        If the recording cannot be read, or does not have its mission.
    ConfigError
        If the mission file cannot be read.
    """
    log = source / TLOG if source.is_dir() else source
    if not log.is_file():
        raise RecordError(f"{source}: neither a tlog nor a folder with {TLOG} in it")
    recording = load_recording(log)
    mission = _mission_of(recording, log, mission_file)
    reports = _Reports(mission.frame)
    reports.listen(recording)
    plans = _plans_flown(log.with_suffix(".mcap"))
    found = [_deviations(reports, path, begin_s, end_s) for path, begin_s, end_s in plans]
    kept = tuple(entry for entry, _ in found if len(entry.times_s) > 1)
    return Flown(
        str(source), mission, kept, reports.errors(), sum(left_out for _, left_out in found),
        tuple(reports.energy.windows), tuple(reports.turning.turns),
    )  # fmt: skip


def _mission_of(recording: Recording, log: Path, mission_file: Path | None) -> MissionConfig:
    if mission_file is not None:
        return load_mission(mission_file)
    text = recording.about.get("mission_file")
    if isinstance(text, str):
        return mission_from_text(text, recording.name)
    if (log.parent / MISSION_FILE).is_file():
        return load_mission(log.parent / MISSION_FILE)
    raise RecordError(f"{log}: it does not say which mission was flown; name the file with --mission")


@dataclass
class _Reports:
    """The autopilot's reports, with the clock readings of their arrival."""

    frame: LocalFrame
    positions: list[list[float]] = field(default_factory=list)  # clock, boot, place, velocity, airspeed
    fixes: list[list[float]] = field(default_factory=list)  # boot, place
    accuracies: list[tuple[float, float, float]] = field(default_factory=list)
    energy: EnergyListener = field(default_factory=EnergyListener)
    turning: TurnListener = field(default_factory=TurnListener)
    _airspeed_m_s: float = math.nan
    _is_flying_mission: bool = False

    def listen(self, recording: Recording) -> None:
        """Read all messages of a recording."""
        codec, vehicle = Codec(), (recording.vehicle, ComponentId.AUTOPILOT1)
        for recorded in recording.frames:
            if recorded.is_ours:
                continue
            if (recorded.frame.system_id, recorded.frame.component_id) == vehicle:
                self._note_fix(recorded.frame)
            for frame in codec.feed(recorded.frame.raw, recorded.at_us * 1e-6):
                for event in frame.events:
                    self._note(event)
                    self.energy.note(event)
                    self.turning.note(event)

    def _note(self, event: Event) -> None:
        match event:
            case Heartbeat():
                self._is_flying_mission = event.is_mission_mode and event.is_armed
            case AirData():
                self._airspeed_m_s = event.airspeed_m_s
            case EstimatorAccuracy():
                self._note_accuracy(event.position_horizontal_std_m, event.position_vertical_std_m, math.nan)
            case GlobalPosition() if self._is_flying_mission:
                place = self.frame.local_from_global(
                    event.latitude_deg, event.longitude_deg, event.altitude_amsl_m
                )
                airspeed_m_s = true_airspeed(self._airspeed_m_s, event.altitude_amsl_m)
                self.positions.append(
                    [event.stamp_s, event.boot_s, *place, *event.velocity_enu_m_s, airspeed_m_s]
                )

    def _note_fix(self, frame: RawFrame) -> None:
        if frame.message_id != MessageId.GPS_RAW_INT or not self._is_flying_mission:
            return
        row = _FIX.unpack(frame.payload.ljust(_FIX.size, b"\0")[: _FIX.size])
        if row[8] < GpsFix.TYPE_3D_FIX:
            return
        self._note_accuracy(*(1e-3 * value for value in row[11:14]))
        place = self.frame.local_from_global(1e-7 * row[1], 1e-7 * row[2], 1e-3 * row[3])
        if self.positions and abs(1e-6 * row[0] - self.positions[-1][1]) <= CLOCKS_APART_S:
            self.fixes.append([1e-6 * row[0], *place])

    def _note_accuracy(self, horizontal: float, vertical: float, speed: float) -> None:
        """Note a reported accuracy; autopilots report zero where they know none."""
        accuracy = (horizontal, vertical, speed)
        self.accuracies.append(tuple(value if value > 0.0 else math.nan for value in accuracy))  # type: ignore[arg-type]

    def errors(self) -> ReportedErrors:
        """Return the errors that follow from fixes, positions and velocities together."""
        rows = np.array(self.positions).reshape(-1, 9)
        fixes = np.array(self.fixes).reshape(-1, 4)
        return ReportedErrors(
            np.array(self.accuracies).reshape(-1, 3),
            _innovations(rows, fixes),
            _jerks(rows[:, 1], rows[:, 5:8]),
        )


def _innovations(rows: FloatArray, fixes: FloatArray) -> FloatArray:
    """Distance of each fix from its prediction by the fix before and the velocities since.

    Parameters
    ----------
    rows : ndarray, shape (N, 9)
        Reported positions: clock, boot [s], east, north, up [m], their velocities, airspeed [m/s].
    fixes : ndarray, shape (M, 4)
        Time since boot [s], east, north, up [m].

    Returns
    -------
    ndarray, shape (K, 3)
        East, north, up [m].
    """
    if len(rows) < 2 or len(fixes) < 2:
        return np.empty((0, 3))
    boot, velocities = rows[:, 1], rows[:, 5:8]
    steps = np.diff(boot)[:, None]
    flown = np.vstack([np.zeros(3), np.cumsum(0.5 * steps * (velocities[1:] + velocities[:-1]), axis=0)])
    at = np.column_stack([np.interp(fixes[:, 0], boot, flown[:, axis]) for axis in range(3)])
    apart = np.diff(fixes[:, 0])
    first, last = np.searchsorted(boot, fixes[:-1, 0]), np.searchsorted(boot, fixes[1:, 0])
    # Where a position is missing meanwhile, the velocities do not add up to the way.
    num_missing = np.append(0, np.cumsum(steps[:, 0] > POSITION_GAP_MAX_S))
    is_whole = num_missing[np.minimum(last, len(boot) - 1)] == num_missing[np.maximum(first - 1, 0)]
    is_covered = (fixes[:-1, 0] >= boot[0]) & (fixes[1:, 0] <= boot[-1])
    kept = (apart > 0.0) & (apart <= GAP_MAX_S) & is_covered & is_whole
    found: FloatArray = (np.diff(fixes[:, 1:], axis=0) - np.diff(at, axis=0))[kept]
    return found


def _jerks(boot_s: FloatArray, velocities: FloatArray) -> FloatArray:
    """Second differences of velocities that were reported at even intervals.

    Parameters
    ----------
    boot_s : ndarray, shape (N,)
        Times since boot.
    velocities : ndarray, shape (N, 3)
        East, north, up [m/s].

    Returns
    -------
    ndarray, shape (J, 3)
        East, north, up [m/s].
    """
    if len(boot_s) < 3:
        return np.empty((0, 3))
    steps = np.diff(boot_s)
    is_even = (steps > 0.0) & (steps <= POSITION_GAP_MAX_S)
    kept = is_even[:-1] & is_even[1:] & (np.abs(np.diff(steps)) <= 0.2 * steps[:-1])
    found: FloatArray = np.diff(velocities, n=2, axis=0)[kept]
    return found


def _plans_flown(mcap: Path) -> list[tuple[FlownPath, float, float]]:
    """Flown plans, each with the clock readings of its begin and end [s]; none without an mcap."""
    if not mcap.is_file():
        return []
    paths: dict[int, FlownPath] = {}
    swaps: list[tuple[float, int]] = []
    for topic, row in messages_of(mcap, Counter()):
        if topic == channels.PLAN:
            path, made = _path_of(row), number(row.get("number"))
            if path is not None and made is not None:
                paths[int(made)] = path
        elif topic == channels.SWAP:
            swaps += _swap_of(row)
    ends = [begin_s for begin_s, _ in swaps[1:]] + [math.inf]
    flown = zip(swaps, ends, strict=True) if swaps else ()
    return [(paths[made], begin_s, end_s) for (begin_s, made), end_s in flown if made in paths]


def _swap_of(row: Document) -> list[tuple[float, int]]:
    """Return when the flight of a mission began, and its plan's number; empty if it was not flown."""
    ended_s, made = number(row.get("ended_s")), number(row.get("plan_number"))
    if row.get("outcome") != "flown" or ended_s is None or made is None:
        return []
    return [(ended_s, int(made))]


def _path_of(row: Document) -> FlownPath | None:
    """Return the recorded path of a plan."""
    listed = row.get("path")
    rows = listed[:ROWS_MAX] if isinstance(listed, list) else []
    if len(rows) < MIN_ROWS or not all(isinstance(entry, list) and len(entry) == 7 for entry in rows):
        return None
    table = np.array([[number(value, 1e9) for value in entry] for entry in rows], dtype=np.float64)
    if not np.isfinite(table).all() or (np.diff(table[:, 0]) <= 0.0).any():
        return None
    unknown = np.ones(len(table))
    return FlownPath(
        times_s=table[:, 0], positions_enu_m=table[:, 1:4], courses_rad=table[:, 4],
        climb_angles_rad=table[:, 5], speeds_m_s=table[:, 6],
        position_covariances_m2=np.zeros((len(table), 3, 3)), collision_free=unknown,
        threat_levels=0.0 * unknown,
    )  # fmt: skip


def _deviations(reports: _Reports, path: FlownPath, begin_s: float, end_s: float) -> tuple[Deviations, int]:
    """Deviations from a path between two clock readings [s], and the number of positions left out."""
    times: list[float] = []
    values: list[list[float]] = []
    row, left_out = 0, 0
    for position in reports.positions:
        if not begin_s <= position[0] < end_s:
            continue
        place = (position[2], position[3], position[4])
        found = progress_on(path, place, row, LOOK_AHEAD_ROWS if times else None)
        is_along_row = 0.0 < found.share < 1.0
        if not is_along_row and found.row in (0, len(path) - 2):
            continue  # before the path's beginning, or beyond its end
        deviation = _deviation(path, found, position)
        if abs(deviation[0]) > OFF_PATH_M:
            left_out += 1
            continue
        row = found.row
        times.append(position[0])
        values.append(deviation)
    return Deviations(np.array(times), np.array(values).reshape(-1, 6)), left_out


def _deviation(path: FlownPath, at: Progress, position: list[float]) -> list[float]:
    """Return a row of :attr:`Deviations.values`."""
    row, share = at.row, at.share
    start, end = path.positions_enu_m[row], path.positions_enu_m[row + 1]
    along = end - start
    flat = math.hypot(along[0], along[1])
    offset = np.array(position[2:5]) - (start + share * along)
    left = (along[0] * offset[1] - along[1] * offset[0]) / max(flat, 1e-6)
    speed = (1.0 - share) * path.speeds_m_s[row] + share * path.speeds_m_s[row + 1]
    turn = wrapped_angle(path.courses_rad[row + 1] - path.courses_rad[row])
    course = path.courses_rad[row] + share * turn
    climb = (1.0 - share) * path.climb_angles_rad[row] + share * path.climb_angles_rad[row + 1]
    east, north, up = position[5:8]
    return [
        left,
        speed * (time_at(path, at) - position[0]),
        float(offset[2]),
        -wrapped_angle(math.atan2(east, north) - course),
        math.atan2(up, max(math.hypot(east, north), 1e-6)) - climb,
        position[8] - speed,
    ]

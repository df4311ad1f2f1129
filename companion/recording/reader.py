"""Reads recordings: the frames, on the service's clock, and what the service recorded about its decisions.

Nothing in a recording is trusted. Damaged parts are skipped and counted. A clock that jumped is corrected as
far as the order of the frames allows.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from companion.config.source import SIZE_MAX
from companion.link.messages.codec import COMPONENT_ID, STATUSTEXT_CHARACTERS, is_intact
from companion.link.wire.framing import RawFrame, raw_frame
from companion.link.wire.tlog import Entry, read_tlog
from companion.planning.plan_runner import RecordedPlanTiming
from companion.recording import mcap_schema as channels
from companion.recording.mcap_reader import Document, messages_of, number, text
from companion.types.mavlink_enums import Autopilot, ComponentId, MessageId
from companion.types.pilot_texts import kind_of
from companion.types.record import Decision

GAP_MAX_S = 120.0  # A longer gap between two frames is a clock that jumped, or a pause without events.
# The clock of our own recordings never jumps: a gap may be as long as the service waited for an autopilot.
OWN_GAP_MAX_S = 86_400.0
ORDER_S = (
    1.0  # A frame may be this much earlier than the previous one, if it waited while others were answered.
)
FRAMES_MAX = 3_000_000  # Eight hours at 100 frames per second, and a gigabyte of memory.
DECISIONS_MAX = 50_000
PLANS_MAX = 100_000
RELOADS_MAX = 20
STAMP_MAX_S = 1e9  # No computer runs for 30 years.
EPOCH_MAX_S = 4_102_444_800.0  # 2100-01-01
SEED_MAX = 2**63
_REASONS_MAX = 50  # Reasons of a decision.
_REMEMBERED_MAX = 4_000_000  # Characters in base64.
SIMULATED = "simulated"


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A recorded frame, its time on the service's clock [µs], and whether the service sent it."""

    at_us: int
    frame: RawFrame
    is_ours: bool


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded flight.

    Parameters
    ----------
    name : str
        Name of the tlog file.
    frames : tuple of RecordedFrame
        Recorded frames; times never decrease.
    vehicle : int
        System id of the vehicle; 1 without an autopilot.
    epoch_s : float
        UTC at clock reading 0 [s].
    about : dict
        Description of the recording; empty for a tlog alone, for example one of a ground station.
    decisions : tuple of Decision
        Decisions as recorded; for a tlog alone, as sent to the pilot, which truncates them.
    taken : dict
        Timing of each plan, by the plan's number.
    counters : Counter
        Number of skipped parts by reason.
    start_us : int
        Clock reading at which the service started [µs].
    reloads : tuple
        Clock reading [s] and text of the mission file, for each time it was reloaded.
    until_s : float
        Clock reading up to which both files are complete if the service was killed [s]. What either file
        has beyond it cannot be compared.
    """

    name: str
    frames: tuple[RecordedFrame, ...]
    vehicle: int
    epoch_s: float
    about: Document = field(default_factory=dict)
    decisions: tuple[Decision, ...] = ()
    taken: dict[int, RecordedPlanTiming] = field(default_factory=dict)
    counters: Counter[str] = field(default_factory=Counter)
    until_s: float = math.inf
    start_us: int = 0
    reloads: tuple[tuple[float, str], ...] = ()

    @property
    def is_simulated(self) -> bool:
        """Whether the flight was flown on simulated time, so that its replay is byte-identical."""
        return self.about.get("clock") == SIMULATED

    @property
    def is_ours(self) -> bool:
        """Whether the service took part in the flight."""
        return bool(self.about or self.decisions)

    @property
    def duration_s(self) -> float:
        """Time from the start of the service to the last frame [s]."""
        return (self.frames[-1].at_us - self.start_us) * 1e-6 if self.frames else 0.0

    @property
    def are_texts_cut(self) -> bool:
        """Whether decisions are known only as sent to the pilot."""
        return not self.about


def load_recording(log: Path) -> Recording:
    """Read a tlog, and the MCAP file of the same name next to it if there is one.

    Raises
    ------
    RecordError
        If the tlog cannot be read at all.
    """
    counters: Counter[str] = Counter()
    entries = _intact(list(itertools.islice(read_tlog(log, counters), FRAMES_MAX)), counters)
    if len(entries) == FRAMES_MAX:
        counters["tlog_too_large"] += 1
    mcap = log.with_suffix(".mcap")
    record = _ServiceRecord()
    if mcap != log and mcap.exists():
        record.read(mcap, counters)
    about = record.about
    frames = [raw_frame(entry.raw) for entry in entries]
    vehicle = _vehicle_of(frames)
    epoch_s = _epoch_s(about, entries)
    start_us = _start_us(about)
    gap_s = OWN_GAP_MAX_S if about else GAP_MAX_S
    times = _corrected_times(entries, epoch_s, start_us, gap_s, counters)
    ours = (vehicle, COMPONENT_ID)
    recorded = [
        RecordedFrame(at, frame, (frame.system_id, frame.component_id) == ours)
        for at, frame in zip(times, frames, strict=True)
    ]
    recorded.sort(key=lambda entry: entry.at_us)
    is_cut_off = bool(about and counters["mcap_ends_early"] and recorded)
    return Recording(
        name=log.name,
        frames=tuple(recorded),
        vehicle=vehicle,
        epoch_s=epoch_s,
        about=about,
        decisions=tuple(record.decisions) if about else sent_decisions(recorded),
        taken=record.taken,
        counters=counters,
        until_s=min(recorded[-1].at_us * 1e-6, record.newest_s) if is_cut_off else math.inf,
        start_us=start_us,
        reloads=tuple(record.reloads),
    )


class _ServiceRecord:
    """The part of an MCAP file that a replay needs; the file itself may be too large to keep."""

    def __init__(self) -> None:
        self.about: Document = {}
        self.reloads: list[tuple[float, str]] = []
        self.decisions: list[Decision] = []
        self.taken: dict[int, RecordedPlanTiming] = {}
        self.newest_s = 0.0

    def read(self, path: Path, counters: Counter[str]) -> None:
        """Read an MCAP file."""
        for topic, document in messages_of(path, counters):
            self.newest_s = max(self.newest_s, stamp_of(document))
            if topic == channels.MISSION:
                self._note_mission(document)
            elif topic == channels.DECISION and len(self.decisions) < DECISIONS_MAX:
                self.decisions.append(decision_of(document))
            elif topic == channels.PLAN and len(self.taken) < PLANS_MAX:
                count = number(document.get("number"))
                if count is not None:
                    self.taken[int(count)] = _plan_timing_of(document)

    def _note_mission(self, document: Document) -> None:
        if not self.about:
            self.about = about_of(document)
        elif len(self.reloads) < RELOADS_MAX:
            self.reloads.append((stamp_of(document), text(document.get("mission_file"), SIZE_MAX)))


def about_of(document: Document) -> Document:
    """Return the plausible part of a recording's description."""
    seed, versions = document.get("seed"), document.get("versions")
    header: Document = {key: text(document.get(key)) for key in ("name", "clock")}
    header["mission_file"] = text(document.get("mission_file"), SIZE_MAX)
    header["stamp_s"] = stamp_of(document)
    header["epoch_s"] = number(document.get("epoch_s"), EPOCH_MAX_S)
    header["step_s"] = number(document.get("step_s"), 10.0)
    if isinstance(seed, int) and not isinstance(seed, bool) and 0 <= seed < SEED_MAX:
        header["seed"] = seed
    if isinstance(versions, dict):
        header["versions"] = {name: text(version) for name, version in [*versions.items()][:100]}
    header["remembered"] = _remembered_of(document.get("remembered"))
    return header


def _remembered_of(remembered: object) -> Document:
    """Return what the service remembered when the recording began."""
    kept = remembered if isinstance(remembered, dict) else {}
    parameters, memory = kept.get("parameters"), kept.get("memory")
    return {
        "goals_reached": number(kept.get("goals_reached")),
        "parameters": {
            name: value
            for name, recorded in (parameters.items() if isinstance(parameters, dict) else ())
            if (value := number(recorded)) is not None
        },
        "memory": {
            end: text(coded, _REMEMBERED_MAX)
            for end, coded in (memory.items() if isinstance(memory, dict) else ())
        },
    }


def _intact(entries: Sequence[Entry], counters: Counter[str]) -> list[Entry]:
    """Return the entries with correct checksums; count the others."""
    kept = [entry for entry in entries if is_intact(entry.raw)]
    if len(kept) < len(entries):
        counters["bad_checksum"] += len(entries) - len(kept)
    return kept


def _epoch_s(about: Document, entries: Sequence[Entry]) -> float:
    """Return the UTC at clock reading 0 [s]: as recorded, else that of the first frame."""
    recorded = number(about.get("epoch_s"))
    if recorded is not None:
        return recorded
    return entries[0].time_s if entries else 0.0


def _start_us(about: Document) -> int:
    """Return the clock reading at which the service started [µs]; in the simulator its first step."""
    start_us = round(1e6 * stamp_of(about))
    if about.get("clock") == SIMULATED:
        start_us = max(0, start_us - round(1e6 * (number(about.get("step_s")) or 0.0)))
    return start_us


def stamp_of(document: Document) -> float:
    """Return the clock reading of a document [s]; 0 if it has none."""
    return number(document.get("stamp_s"), STAMP_MAX_S) or 0.0


def decision_of(document: Document) -> Decision:
    """Return a recorded decision."""
    why = document.get("why")
    return Decision(
        stamp_of(document),
        text(document.get("kind"), 100),
        text(document.get("text")),
        number(document.get("plan_ms")),
        number(document.get("track_to_mission_ms")),
        _reasons(why) if isinstance(why, dict) else {},
        text(document.get("told"), 300),
    )


def _reasons(why: Document) -> Document:
    """Return the numbers and texts that led to a decision."""
    return {
        key[:100]: [*map(_reason, value[:_REASONS_MAX])] if isinstance(value, list) else _reason(value)
        for key, value in [*why.items()][:_REASONS_MAX]
    }


def _reason(value: object) -> object:
    """Return a number, flag or text; None for anything else."""
    if isinstance(value, str):
        return text(value)
    return value if isinstance(value, bool) or number(value) is not None else None


def _plan_timing_of(document: Document) -> RecordedPlanTiming:
    asked = number(document.get("asked"))
    is_stopped = document.get("is_stopped") is True and asked is not None
    took_s = max(0.0, number(document.get("took_s"), STAMP_MAX_S) or 0.0)
    instants = (number(document.get("due_s"), STAMP_MAX_S), number(document.get("seen_s"), STAMP_MAX_S))
    is_broken_off = document.get("is_broken_off") is True
    return RecordedPlanTiming(int(asked or 0) if is_stopped else None, took_s, *instants, is_broken_off)


def sent_decisions(frames: Sequence[RecordedFrame]) -> tuple[Decision, ...]:
    """Return the decisions that the service sent to the pilot as STATUSTEXT, with chunks joined."""
    found: list[Decision] = []
    joined = ""
    for recorded in frames:
        if not recorded.is_ours or recorded.frame.message_id != MessageId.STATUSTEXT:
            continue
        payload = recorded.frame.payload.ljust(54, b"\0")  # MAVLink 2 omits trailing zeros.
        chunk = payload[1:51].rstrip(b"\0").decode("ascii", "replace")
        is_chunked, number = payload[51:53] != bytes(2), payload[53]
        joined = joined + chunk if is_chunked and number else chunk
        is_whole = not is_chunked or len(chunk) < STATUSTEXT_CHARACTERS
        if is_whole and (kind := kind_of(joined)) is not None:
            found.append(Decision(recorded.at_us * 1e-6, kind, joined, told=joined))
    return tuple(found)


def _vehicle_of(frames: Sequence[RawFrame]) -> int:
    """Return the system id of the first autopilot in the recording."""
    for frame in frames:
        payload = frame.payload
        is_heartbeat = (frame.message_id, frame.component_id) == (MessageId.HEARTBEAT, ComponentId.AUTOPILOT1)
        if is_heartbeat and len(payload) > 5 and payload[5] in frozenset(Autopilot):
            return frame.system_id
    return 1


def _corrected_times(
    entries: Sequence[Entry], epoch_s: float, start_us: int, gap_s: float, counters: Counter[str]
) -> Iterator[int]:
    """Yield clock readings of entries [µs] that hardly decrease and contain no long pauses.

    A frame that is answered while others wait is recorded before them, with a later timestamp. A timestamp
    that fits neither its predecessor nor its successor is damage and gets the predecessor's time. After a
    jump of the clock, time continues from the predecessor.
    """
    gap, now = round(1e6 * gap_s), start_us
    stamps = [round(1e6 * entry.time_s) for entry in entries]
    offset = -round(1e6 * epoch_s)
    for index, stamp in enumerate(stamps):
        at = stamp + offset
        if 0 < now - at <= 1e6 * ORDER_S:
            yield max(at, start_us)
            continue
        if not now <= at <= now + gap:
            after = stamps[index + 1] + offset if index + 1 < len(stamps) else None
            if after is not None and now <= after <= now + gap:
                counters["wrong_stamps"] += 1
                yield now
                continue
            counters["clock_jumps"] += 1
            offset = now - stamp
            at = now
        now = at
        yield at

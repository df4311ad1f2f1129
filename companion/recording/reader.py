"""Recordings, read back: the frames on the service's clock, and what the service wrote down beside them.

Nothing in a recording is trusted: what is damaged is left out and counted, and a clock that jumped is put
right as far as the order of the frames tells.
"""

from __future__ import annotations

import json
import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from companion.errors import RecordError
from companion.link.messages.codec import COMPONENT_ID, is_intact
from companion.link.wire.framing import RawFrame, raw_frame
from companion.link.wire.tlog import Entry, read_tlog
from companion.planning.plan_runner import RecordedPlanTiming
from companion.recording import mcap_schema as channels
from companion.types.mavlink_enums import Autopilot, ComponentId, MessageId
from companion.types.record import SPOKEN, Decision

GAP_MAX_S = 120.0  # between two frames; a longer one is a clock that jumped, or nothing to wait for
OWN_GAP_MAX_S = 86_400.0  # in our own, whose clock never jumps: as long as an autopilot was awaited
ORDER_S = 1.0  # a stamp so little before another is that of a frame which waited while others were answered
RECORD_MAX = 64 * 1024 * 1024  # bytes; a longer record of an mcap is damage
SIMULATED = "simulated"
_DAMAGE = (McapError, struct.error, ValueError, KeyError, zstandard.ZstdError, MemoryError, OverflowError)

Document = dict[str, object]


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A recorded frame: when, by the service's clock in microseconds, and whether the service sent it."""

    at_us: int
    frame: RawFrame
    is_ours: bool


@dataclass(frozen=True, slots=True)
class Recording:
    """A flight as recorded.

    Parameters
    ----------
    name : str
        Name of the log's file.
    frames : tuple of RecordedFrame
        Recorded frames in order; times never go back.
    vehicle : int
        System id of the vehicle, 1 where no autopilot is heard.
    epoch_s : float
        UTC at clock reading 0.
    about : dict
        What the recording says of itself; empty where there is only a tlog, as of a ground station.
    decisions : tuple of Decision
        Decisions as written down; from a tlog alone, as they were told to the pilot, which cuts them short.
    taken : dict
        What each plan took, by the plan's number.
    counters : Counter
        What was left out, and why.
    start_us : int
        Clock reading at which the service began [µs].
    reloads : tuple
        Each time that the mission file was read again: clock reading [s], and what the file said then.
    until_s : float
        Clock reading to which both files go, where the service was killed [s]; what either has beyond
        it cannot be compared.
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
        """Whether it was flown on simulated time: what is replayed is then the same to the byte."""
        return self.about.get("clock") == SIMULATED

    @property
    def is_ours(self) -> bool:
        """Whether the service took part in the flight."""
        return bool(self.about or self.decisions)

    @property
    def duration_s(self) -> float:
        """From the service's beginning to the last frame [s]."""
        return (self.frames[-1].at_us - self.start_us) * 1e-6 if self.frames else 0.0

    @property
    def are_texts_cut(self) -> bool:
        """Whether decisions are known as told to the pilot only."""
        return not self.about


def load_recording(log: Path) -> Recording:
    """Read a tlog, and the mcap of the same name beside it where there is one.

    Raises
    ------
    RecordError
        When the tlog cannot be read at all.
    """
    counters: Counter[str] = Counter()
    entries = _intact(list(read_tlog(log, counters)), counters)
    beside = log.with_suffix(".mcap")
    documents = read_messages(beside, counters) if beside != log and beside.exists() else {}
    missions = documents.get(channels.MISSION, [{}])
    about = missions[0]
    frames = [raw_frame(entry.raw) for entry in entries]
    vehicle = _vehicle_of(frames)
    epoch_s = _epoch_s(about, entries)
    start_us = _start_us(about)
    gap_s = OWN_GAP_MAX_S if about else GAP_MAX_S
    times = _straightened(entries, epoch_s, start_us, gap_s, counters)
    ours = (vehicle, COMPONENT_ID)
    heard = [
        RecordedFrame(at, frame, (frame.system_id, frame.component_id) == ours)
        for at, frame in zip(times, frames, strict=True)
    ]
    heard.sort(key=lambda entry: entry.at_us)
    decided = tuple(decision_of(document) for document in documents.get(channels.DECISION, []))
    is_cut_off = bool(about and counters["mcap_ends_early"] and heard)
    return Recording(
        name=log.name,
        frames=tuple(heard),
        vehicle=vehicle,
        epoch_s=epoch_s,
        about=about,
        decisions=decided if about else told_decisions(heard),
        taken=_taken_by_number(documents.get(channels.PLAN, [])),
        counters=counters,
        until_s=min(heard[-1].at_us * 1e-6, _newest_s(documents)) if is_cut_off else math.inf,
        start_us=start_us,
        reloads=tuple((_stamp_s(entry), str(entry.get("mission_file", ""))) for entry in missions[1:]),
    )


def _intact(entries: Sequence[Entry], counters: Counter[str]) -> list[Entry]:
    """Entries whose checksums fit; the others are counted."""
    kept = [entry for entry in entries if is_intact(entry.raw)]
    if len(kept) < len(entries):
        counters["bad_checksum"] += len(entries) - len(kept)
    return kept


def _epoch_s(about: Document, entries: Sequence[Entry]) -> float:
    """UTC at clock reading 0 [s]: as was written down, else that of the first frame."""
    told = number(about.get("epoch_s"))
    if told is not None:
        return told
    return entries[0].time_s if entries else 0.0


def _start_us(about: Document) -> int:
    """Clock reading at which the service began [µs]; in the simulator that is with its first step."""
    start_us = round(1e6 * _stamp_s(about))
    if about.get("clock") == SIMULATED:
        start_us = max(0, start_us - round(1e6 * (number(about.get("step_s")) or 0.0)))
    return start_us


def _stamp_s(document: Document) -> float:
    return number(document.get("stamp_s")) or 0.0


def _newest_s(documents: Mapping[str, Sequence[Document]]) -> float:
    """The last instant that any document tells of [s]."""
    return max((_stamp_s(document) for rows in documents.values() for document in rows), default=0.0)


def _taken_by_number(documents: Sequence[Document]) -> dict[int, RecordedPlanTiming]:
    """What each plan took, by the plan's number."""
    return {
        int(count): _taken_of(document)
        for document in documents
        if (count := number(document.get("number"))) is not None
    }


def read_messages(path: Path, counters: Counter[str]) -> dict[str, list[Document]]:
    """Messages of an mcap by topic, in order, as far as it can be read.

    One whose end is missing, since the process was killed, is read to there; damaged chunks are left out
    and counted as ``damaged_chunks``.

    Raises
    ------
    RecordError
        When the file cannot be opened.
    """
    found: dict[str, list[Document]] = {}
    topics: dict[int, str] = {}
    try:
        with path.open("rb") as file:
            reader = StreamReader(file, emit_chunks=True, record_size_limit=RECORD_MAX)
            for record in _records(reader.records, counters):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message) and record.channel_id in topics:
                    document = _document_of(record, counters)
                    if document is not None:
                        found.setdefault(topics[record.channel_id], []).append(document)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from error
    return found


def _records(records: Iterator[McapRecord], counters: Counter[str]) -> Iterator[McapRecord]:
    """Records with those of chunks; ends where the file does, wherever that is."""
    while True:
        try:
            record = next(records)
        except StopIteration:
            return
        except _DAMAGE:
            counters["mcap_ends_early"] += 1
            return
        if not isinstance(record, Chunk):
            yield record
            continue
        try:
            if record.uncompressed_size > RECORD_MAX:
                raise ValueError("a chunk that large was never written")
            inside = breakup_chunk(record, validate_crc=True)
        except _DAMAGE:
            counters["damaged_chunks"] += 1
            continue
        yield from (entry for entry in inside if isinstance(entry, Channel | Schema | Message))


def _document_of(message: Message, counters: Counter[str]) -> Document | None:
    try:
        document = json.loads(message.data)
    except ValueError:
        document = None
    if not isinstance(document, dict):
        counters["damaged_messages"] += 1
        return None
    return document


def number(value: object) -> float | None:
    """A number of a document, None for anything else."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def decision_of(document: Document) -> Decision:
    """A decision as it was written down."""
    why = document.get("why")
    return Decision(
        _stamp_s(document),
        str(document.get("kind", "")),
        str(document.get("text", "")),
        number(document.get("plan_ms")),
        number(document.get("track_to_mission_ms")),
        why if isinstance(why, dict) else {},
    )


def _taken_of(document: Document) -> RecordedPlanTiming:
    asked = number(document.get("asked"))
    is_stopped = document.get("is_stopped") is True and asked is not None
    took_s = max(0.0, number(document.get("took_s")) or 0.0)
    instants = (number(document.get("due_s")), number(document.get("seen_s")))
    return RecordedPlanTiming(int(asked or 0) if is_stopped else None, took_s, *instants)


def told_decisions(frames: Sequence[RecordedFrame]) -> tuple[Decision, ...]:
    """Decisions as the service told them to the pilot, from its STATUSTEXTs."""
    found = []
    for heard in frames:
        if not heard.is_ours or heard.frame.message_id != MessageId.STATUSTEXT:
            continue
        text = heard.frame.payload[1:51].rstrip(b"\0").decode("ascii", "replace")
        kind, colon, rest = text.removeprefix(SPOKEN).partition(": ")
        if text.startswith(SPOKEN) and colon:
            found.append(Decision(heard.at_us * 1e-6, kind, rest))
    return tuple(found)


def _vehicle_of(frames: Sequence[RawFrame]) -> int:
    """System id of the first autopilot that is heard."""
    for frame in frames:
        payload = frame.payload
        is_heartbeat = (frame.message_id, frame.component_id) == (MessageId.HEARTBEAT, ComponentId.AUTOPILOT1)
        if is_heartbeat and len(payload) > 5 and payload[5] in frozenset(Autopilot):
            return frame.system_id
    return 1


def _straightened(
    entries: Sequence[Entry], epoch_s: float, start_us: int, gap_s: float, counters: Counter[str]
) -> Iterator[int]:
    """Clock readings of entries [µs], which hardly go back and make no long pauses.

    What is answered while other frames wait is recorded before these, with a later stamp.

    A stamp that fits neither the one before nor the one after is damage, and takes the time before it; a
    clock that was set goes on from there.
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

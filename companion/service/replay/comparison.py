"""Comparison of a recorded flight with its replay, as text."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TypeVar

from companion.link.missions.mission_sniffer import Upload
from companion.recording.reader import Recording
from companion.service.replay.engine import Replayed
from companion.types.mission import MissionItem
from companion.types.record import Decision

FROM_OUTSIDE = frozenset(
    {"stopped", "reload", "recording"}
)  # Caused by signals and disks, which no tlog has.
Stamped = TypeVar("Stamped", Decision, Upload)


@dataclass(frozen=True, slots=True)
class Difference:
    """The first difference: its time on the flight's clock and in UTC, and what was flown and is replayed."""

    stamp_s: float
    utc: str
    flown: str
    now: str

    def __str__(self) -> str:
        return f"at {self.stamp_s:.1f} s ({self.utc}): flown {self.flown}, now {self.now}"


def first_difference(recording: Recording, result: Replayed) -> Difference | None:
    """Return the first decision or mission that differs; None if all are equal.

    On simulated time the instants must be equal, too.
    """
    found = [_compare_decisions(recording, result), _compare_missions(recording, result)]
    if recording.is_simulated and result.diverged_s is not None:
        found.append((result.diverged_s, "as recorded", result.apart))
    differing = sorted((entry for entry in found if entry is not None), key=lambda entry: entry[0])
    if not differing:
        return None
    # If a decision and a mission differ at first, the decision is reported.
    stamp, flown, now = next((entry for entry in found if entry is not None), differing[0])
    return Difference(stamp, utc_text(recording.epoch_s + stamp), flown, now)


def _compare_decisions(recording: Recording, result: Replayed) -> tuple[float, str, str] | None:
    flown_decisions, decisions = (
        [
            entry
            for entry in entries
            if entry.kind not in FROM_OUTSIDE and (entry.told or not recording.are_texts_cut)
        ]
        for entries in (result.flown_decisions, result.decisions)
    )
    for flown, now in _pairs(flown_decisions, decisions, recording.until_s):
        if flown is not None and now is not None and _is_same(flown, now, recording):
            continue
        stamp = min(entry.stamp_s for entry in (flown, now) if entry is not None)
        return stamp, _quoted(flown, stamp), _quoted(now, stamp)
    return None


def _pairs(
    flown: Iterable[Stamped], now: Iterable[Stamped], until_s: float
) -> Iterator[tuple[Stamped | None, Stamped | None]]:
    """Pair what was flown with what is replayed, as far as both are known."""
    return itertools.zip_longest(
        (entry for entry in flown if entry.stamp_s <= until_s),
        (entry for entry in now if entry.stamp_s <= until_s),
    )


def _is_same(flown: Decision, now: Decision, recording: Recording) -> bool:
    if recording.is_simulated and abs(flown.stamp_s - now.stamp_s) > 1e-6:
        return False
    if recording.are_texts_cut:
        return flown.told == now.told
    return (flown.kind, flown.text) == (now.kind, now.text)


def _quoted(decision: Decision | None, stamp_s: float) -> str:
    if decision is None:
        return "nothing"
    later = f" at {decision.stamp_s:.1f} s" if decision.stamp_s > stamp_s + 0.05 else ""
    return f"'{decision.kind}: {decision.text}'{later}"


def _compare_missions(recording: Recording, result: Replayed) -> tuple[float, str, str] | None:
    pairs = _pairs(result.flown_uploads, result.uploads, recording.until_s)
    for number, (flown, now) in enumerate(pairs, 1):
        if flown is not None and now is not None and _is_same_upload(flown, now, recording):
            continue
        stamp = min(entry.stamp_s for entry in (flown, now) if entry is not None)
        return stamp, *_mission_words(number, flown, now)
    return None


def _is_same_upload(flown: Upload, now: Upload, recording: Recording) -> bool:
    is_then = not recording.is_simulated or abs(flown.stamp_s - now.stamp_s) < 1e-6
    return is_then and flown.items == now.items


def _mission_words(number: int, flown: Upload | None, now: Upload | None) -> tuple[str, str]:
    """Describe two differing missions by the first item that differs."""
    if flown is None or now is None:
        sizes = ["no" if entry is None else f"{len(entry.items)} items as" for entry in (flown, now)]
        return f"{sizes[0]} mission {number}", f"{sizes[1]} mission {number}"
    for one, other in itertools.zip_longest(flown.items, now.items):
        if one != other:
            words = ["nothing" if entry is None else item_line(entry) for entry in (one, other)]
            return f"mission {number} with {words[0]}", f"with {words[1]}"
    return f"mission {number} at {flown.stamp_s:.2f} s", f"at {now.stamp_s:.2f} s"


def utc_text(utc_s: float) -> str:
    """Return the time of day, ``12:03:11Z``; an impossible time is returned in seconds."""
    try:
        return f"{datetime.fromtimestamp(utc_s, UTC):%H:%M:%SZ}"
    except (OverflowError, ValueError, OSError):
        return f"{utc_s:.0f} s"


def item_line(item: MissionItem) -> str:
    """Describe a mission item in a line."""
    parameters = " ".join("nan" if value is None else f"{value:.9g}" for value in item.parameters)
    place = f"{item.latitude_e7 * 1e-7:.7f} {item.longitude_e7 * 1e-7:.7f} {item.altitude_m:.9g} m"
    mark = " current" if item.is_current else ""
    return f"item {item.sequence}: command {item.command} frame {item.frame} ({parameters}) {place}{mark}"


def document_of(recording: Recording, result: Replayed) -> dict[str, object]:
    """Return the JSON of ``companion replay``."""
    differs = first_difference(recording, result)
    return {
        "log": recording.name,
        "simulated": recording.is_simulated,
        "duration_s": round(result.duration_s, 3),
        "wall_s": round(result.wall_s, 3),
        "equal": differs is None,
        "first_difference": None
        if differs is None
        else {"t_s": differs.stamp_s, "utc": differs.utc, "flown": differs.flown, "now": differs.now},
        "apart_s": result.diverged_s,
        "apart": result.apart,
        "decisions": [_decision_row(entry) for entry in result.decisions],
        "flown_decisions": [_decision_row(entry) for entry in result.flown_decisions],
        "missions": [_mission_row(entry) for entry in result.uploads],
        "flown_missions": [_mission_row(entry) for entry in result.flown_uploads],
        "counters": result.counters,
    }


def _decision_row(decision: Decision) -> dict[str, object]:
    return {"t_s": round(decision.stamp_s, 3), "kind": decision.kind, "text": decision.text}


def _mission_row(upload: Upload) -> dict[str, object]:
    return {"t_s": round(upload.stamp_s, 3), "items": [item_line(item) for item in upload.items]}

"""The beginning of every payload of a team: a version, a kind, and the sender's standing."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

from companion.mission.team.shared_plan import is_newer

PAYLOAD_BYTES = 128  # of a TUNNEL message
VERSION = 1
HAS_COMMITTED, HAS_LATEST, IS_PENDING = 1, 2, 4
HEADER = struct.Struct("<BBHH")  # version and kind, flags, committed number, latest number
CACHED = 4096  # Payloads are repeated, and a decoded plan is the same object for all who ask for it.


class PayloadError(ValueError):
    """A payload that cannot be what it says; its argument is the reason it is counted under."""


@dataclass(frozen=True, slots=True)
class Standing:
    """The part of every payload in which a member describes its own plans.

    Parameters
    ----------
    committed : int or None
        Number of its committed plan; None if it has none.
    latest : int or None
        Number of its latest plan, proposed or not; None if it never proposed one.
    is_pending : bool
        True while the latest plan is proposed; then it is neither committed nor withdrawn.
    """

    committed: int | None = None
    latest: int | None = None
    is_pending: bool = False

    def is_later_than(self, other: Standing | None) -> bool:
        """Return whether a member said this after it said the other; what it says only ever moves on."""
        if self.latest is None or other is None or other.latest is None:
            return other is None or (other.latest is None and self.latest is not None)
        if self.latest == other.latest:
            return other.is_pending and not self.is_pending
        return is_newer(self.latest, other.latest)


def packed_header(kind: int, standing: Standing) -> bytes:
    """Return the bytes with which a payload of a kind, 1 to 15, begins."""
    flags = (
        (HAS_COMMITTED if standing.committed is not None else 0)
        | (HAS_LATEST if standing.latest is not None else 0)
        | (IS_PENDING if standing.is_pending else 0)
    )
    return HEADER.pack(VERSION << 4 | kind, flags, standing.committed or 0, standing.latest or 0)


def read_header(payload: bytes) -> tuple[int, Standing]:
    """Return the kind of a payload, 1 to 15, and the standing of its sender.

    Raises
    ------
    PayloadError
        If the length is impossible, or the header cannot be what it says.
    """
    if not HEADER.size <= len(payload) <= PAYLOAD_BYTES:
        raise PayloadError("length")
    kind, flags, committed, latest = HEADER.unpack_from(payload)
    if kind >> 4 != VERSION:
        raise PayloadError("version")
    return kind & 0xF, _read_standing(flags, committed, latest)


@lru_cache(maxsize=CACHED)
def _read_standing(flags: int, committed: int, latest: int) -> Standing:
    """Return what a header says of its sender; numbers that no member can have are refused."""
    is_pending = bool(flags & IS_PENDING)
    if not flags & HAS_LATEST:
        is_possible = not flags & HAS_COMMITTED and not is_pending
    elif not flags & HAS_COMMITTED:
        is_possible = True
    else:
        is_possible = is_newer(latest, committed) or (latest == committed and not is_pending)
    if not is_possible:
        raise PayloadError("standing")
    return Standing(
        committed if flags & HAS_COMMITTED else None, latest if flags & HAS_LATEST else None, is_pending
    )

"""MAVLink 2 signatures: outgoing frames are signed, incoming frames are verified.

A frame is accepted if its signature matches the key and its timestamp is later than that of the previous
frame of the same stream (system, component, link). A recorded frame therefore cannot be sent again.
Timestamps are kept in a file, our own ahead of the last one used, so that neither a crash nor a clock that is
set back repeats one.

The computer's clock is trusted if it is synchronised and its year is plausible. It is then the reference: a
new stream may lag behind it by a minute, and no stream may be ahead of it by more than a minute. A peer can
thus move our time by at most a minute. A clock that is not synchronised usually runs behind, since a computer
without a battery for its clock continues from the time at which it was switched off. It still shows which
frames are too old. Only one stream, the leader, may show how far time has advanced since: the first stream
accepted, usually the vehicle's. Its time may jump once, with its first GPS fix. All other streams are
compared with the leader's time.

References
----------
MAVLink guide, *Message Signing*: the signature is the first 48 bits of SHA-256 over key, header, payload,
checksum, link id and timestamp; the timestamp counts 10 µs since 2015-01-01 UTC; a new stream may lag behind
the newest timestamp by a minute at most.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import logging
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from companion.link.wire.framing import MAGIC_V1, MAGIC_V2, SIGNATURE, RawFrame, checksum, frames_in
from companion.safe_files import read_file, rename_damaged, replace_file
from companion.types.mavlink_enums import MessageId

SETUP_SIGNING = MessageId.SETUP_SIGNING
STREAMS_MAX = 100  # The vehicles, ground stations and components on one link form about a dozen streams.
_SIGNED = 0x01
_HEADER = 10
_EPOCH_S = 1_420_070_400.0  # 2015-01-01T00:00:00Z
_UNITS_A_SECOND = 100_000
_MINUTE = 60 * _UNITS_A_SECOND
_JUMP_CONFIRMED = (
    3 * _UNITS_A_SECOND
)  # The leader's time must continue for this long after a jump to be accepted.
_DAY = 86_400 * _UNITS_A_SECOND
_EARLIEST = int(1_704_067_200.0 - _EPOCH_S) * _UNITS_A_SECOND  # 2024-01-01; this program is not older.
_LATEST = int(4_102_444_800.0 - _EPOCH_S) * _UNITS_A_SECOND  # 2100-01-01; the 48 bits end in 2104.
_RESERVED = 10 * _UNITS_A_SECOND  # The file holds our own time this far ahead of the last one used.
_WRITE_INTERVAL = _UNITS_A_SECOND
_FILE_MAX = 100_000  # Bytes. A file of 100 streams has 5,000.

_log = logging.getLogger(__name__)

Stream = tuple[int, int, int]  # System id, component id, link id.


class Timestamps:
    """Timestamps of signed and verified frames, kept in a file of mode 0600.

    A damaged file is renamed and logged; the clock is then the reference.

    Parameters
    ----------
    path : Path or None
        The file; None keeps the timestamps in memory only.
    epoch_s : callable
        Returns the computer's time, in seconds since 1970 UTC.
    is_synchronised : callable, optional
        Returns whether the computer's clock is synchronised; by default it counts as synchronised.
    """

    def __init__(
        self,
        path: Path | None,
        epoch_s: Callable[[], float],
        is_synchronised: Callable[[], bool] = lambda: True,
    ) -> None:
        self._path = path
        self._epoch_s = epoch_s
        self._is_synchronised = is_synchronised
        own, streams = self._read()
        self._own, self.streams = self._plausible(own, streams)
        self._reserved = self._own
        self._newest = self._floor = max([0, *self.streams.values()])
        self._leader: Stream | None = None
        self._lead = 0  # Difference between the leader's time and the clock.
        self._jump: tuple[int, int] | None = None  # The clock's time and the leader's time of a jump.
        self._written = self._clock()
        self._was_trusted = self._is_trusted(self._written)
        self._first: dict[Stream, int] = {}  # First accepted timestamp of each stream.
        self._used: dict[Stream, tuple[int, int]] = {}  # First and last timestamp of forgotten streams.

    @property
    def reference(self) -> int:
        """Time that a new stream is compared with: the clock's, or the best other knowledge of the time."""
        clock = self._clock()
        if self._is_trusted(clock):
            return clock
        led = 0 if self._leader is None else clock + self._lead
        return max(_sendable(clock), self._floor, led)

    def next(self) -> int:
        """Return the next timestamp: later than all before, and at most a minute behind any peer's."""
        newest = min(self._newest, self.reference + _MINUTE)
        self._own = max(self._own + 1, _sendable(self._clock()), newest + 1)
        if self._own >= self._reserved:
            self._reserved = self._own + _RESERVED
            self._write()
        return self._own

    def refusal(self, stream: Stream, time: int) -> str:
        """Return why a frame with this timestamp is refused, '' if it is accepted."""
        self._follow_clock()
        reference, last = self.reference, self.streams.get(stream)
        if time > (_LATEST if self._may_lead(stream, time) else reference + _MINUTE):
            return "too_new"
        low, high = self._used.get(stream, (_LATEST, 0))
        if low <= time <= high:
            return "replayed"
        if last is not None:
            return "replayed" if time <= last else ""
        if time + _MINUTE < reference:
            return "too_old"
        return "" if self._has_room(reference) else "too_many_streams"

    def note(self, stream: Stream, time: int) -> None:
        """Record the timestamp of an accepted frame."""
        clock = self._clock()
        self._first.setdefault(stream, time)
        self.streams[stream] = time
        self._newest = max(self._newest, time)
        if not self._is_trusted(clock) and self._leader in (None, stream):
            self._leader, self._lead, self._jump = stream, time - clock, None
        # The interval is measured by the clock: otherwise a peer could make us write with every frame.
        if abs(clock - self._written) >= _WRITE_INTERVAL:
            self._write()

    def close(self) -> None:
        """Write the timestamps to the file."""
        self._write()

    def _may_lead(self, stream: Stream, time: int) -> bool:
        """Return whether a stream may set the time because the clock is not trusted.

        The first accepted stream may. Its time may jump, for example with its first GPS fix, once it has
        continued from there for a while without any frame of the earlier time in between.
        """
        clock = self._clock()
        if self._is_trusted(clock) or self._leader not in (None, stream):
            return False
        if self._leader is None or time <= self.reference + _MINUTE:
            return True
        held = self._jump
        if held is None or abs((time - held[1]) - (clock - held[0])) > _MINUTE:
            self._jump = clock, time
            return False
        return clock - held[0] >= _JUMP_CONFIRMED

    def _follow_clock(self) -> None:
        """Forget timestamps beyond the clock once it is right: they were accepted while it was wrong.

        The frames accepted then are still refused when the clock reaches their timestamps.
        """
        clock, was_trusted = self._clock(), self._was_trusted
        self._was_trusted = self._is_trusted(clock)
        if not self._was_trusted or was_trusted:
            return
        beyond = [stream for stream, time in self.streams.items() if time > clock + _MINUTE]
        for stream in beyond:
            last = self.streams.pop(stream)
            first = self._first.pop(stream, last)
            low, high = self._used.get(stream, (first, last))
            self._used[stream] = min(low, first), max(high, last)
        while len(self._used) > STREAMS_MAX:
            del self._used[next(iter(self._used))]

    def _clock(self) -> int:
        """Return the computer's clock, which may show any time."""
        return int((self._epoch_s() - _EPOCH_S) * _UNITS_A_SECOND)

    def _is_trusted(self, clock: int) -> bool:
        """Return whether the clock is trusted."""
        return _EARLIEST <= clock < _LATEST and self._is_synchronised()

    def _has_room(self, reference: int) -> bool:
        """Return whether another stream can be stored; a stream too old to be a new one is dropped for it."""
        if len(self.streams) < STREAMS_MAX:
            return True
        oldest = min(self.streams, key=lambda stream: self.streams[stream])
        if self.streams[oldest] + _MINUTE >= reference:
            return False
        del self.streams[oldest]
        self._first.pop(oldest, None)
        return True

    def _plausible(self, own: int, streams: dict[Stream, int]) -> tuple[int, dict[Stream, int]]:
        """Return the plausible part of what was read.

        Streams beyond a trusted clock were accepted while the clock was wrong. Our own time may be a day
        ahead: a clock that was corrected must not make us repeat a timestamp.
        """
        clock = self._clock()
        limit, own_limit = _LATEST, _LATEST
        if self._is_trusted(clock):
            limit, own_limit = clock + _MINUTE, clock + _DAY
        kept = {stream: time for stream, time in streams.items() if 0 <= time <= limit}
        newest = sorted(kept, key=lambda stream: kept[stream])[-STREAMS_MAX:]
        is_own_plausible = 0 <= own <= own_limit
        if len(kept) < len(streams) or not is_own_plausible:
            _log.error(
                "%s: %d times of signatures lie beyond the clock and are forgotten",
                self._path, len(streams) - len(kept) + (not is_own_plausible),
            )  # fmt: skip
        return own if is_own_plausible else 0, {stream: kept[stream] for stream in newest}

    def _read(self) -> tuple[int, dict[Stream, int]]:
        if self._path is None:
            return 0, {}
        try:
            kept = json.loads(read_file(self._path, _FILE_MAX))
            streams = {
                (int(a), int(b), int(c)): int(time)
                for (a, b, c), time in ((name.split("/"), time) for name, time in kept["streams"].items())
            }
            return int(kept["own"]), streams
        except FileNotFoundError:
            return 0, {}
        except (OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError):
            renamed = rename_damaged(self._path)
            found = "cannot be read" if renamed is None else f"was damaged and is now {renamed}"
            _log.error("%s %s: times of signatures begin at the clock", self._path, found)
            return 0, {}

    def _write(self) -> None:
        self._written = self._clock()
        if self._path is None:
            return
        streams = {"/".join(map(str, stream)): time for stream, time in self.streams.items()}
        kept = json.dumps({"own": self._reserved, "streams": streams}).encode("ascii")
        try:
            # Not synced: it happens every second in the event loop, and heartbeats must not wait for it.
            replace_file(self._path, kept, is_synced=False)
        except OSError as error:  # A full disk must not stop the link.
            _log.error("timestamps of signatures cannot be written: %s", error)


def _sendable(clock: int) -> int:
    """Return the clock's time if a timestamp can hold it, else 0."""
    return clock if 0 <= clock < _LATEST else 0


class Signer:
    """Signs and verifies the frames of one link.

    Parameters
    ----------
    key : bytes
        Secret key, 32 bytes.
    link_id : int
        Link id of outgoing frames.
    timestamps : Timestamps
        Timestamps of both directions.
    extras : mapping of int to int
        CRC extra byte of each message id.
    allow_unsigned : collection of int
        System ids that are accepted without a signature, in MAVLink 2 frames.
    allow_mavlink1 : bool
        True if these systems are accepted in MAVLink 1 frames, too.
    """

    def __init__(
        self,
        key: bytes,
        link_id: int,
        timestamps: Timestamps,
        extras: Mapping[int, int],
        allow_unsigned: Collection[int] = (),
        *,
        allow_mavlink1: bool = False,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._key = key
        self._link_id = link_id
        self._timestamps = timestamps
        self._extras = extras
        self._allow_unsigned = frozenset(allow_unsigned)
        self._allow_mavlink1 = allow_mavlink1
        self._has_warned_of_clock = False

    def count_in(self, counters: Counter[str]) -> None:
        """Count refused frames in another counter from now on."""
        self.counters = counters

    def signed(self, data: bytes) -> bytes:
        """Sign one or several frames."""
        return b"".join(self._signed(raw) for raw in frames_in(data))

    def _signed(self, raw: bytes) -> bytes:
        if raw[0] != MAGIC_V2:
            self.counters["not_signable"] += 1  # MAVLink 1 has no room for it
            return raw
        body = _with_flags(raw, raw[2] | _SIGNED, self._extras[int.from_bytes(raw[7:10], "little")])
        tail = bytes([self._link_id]) + self._timestamps.next().to_bytes(6, "little")
        return body + tail + self._digest(body + tail)

    def _digest(self, data: bytes) -> bytes:
        return hashlib.sha256(self._key + data).digest()[:6]

    def accepts(self, frame: RawFrame) -> bool:
        """Return whether a received frame is accepted; counts the reason if not."""
        reason = self._refusal(frame)
        if reason:
            self.counters[reason] += 1
        return not reason

    def _refusal(self, frame: RawFrame) -> str:
        """Return why a frame is refused, '' if it is accepted."""
        raw = frame.raw
        if raw[0] != MAGIC_V2 or not raw[2] & _SIGNED:
            return self._refusal_unsigned(frame)
        if not hmac.compare_digest(self._digest(raw[:-6]), raw[-6:]):
            return "bad_signature"
        stream = (frame.system_id, frame.component_id, raw[-SIGNATURE])
        time = int.from_bytes(raw[-12:-6], "little")
        reason = self._timestamps.refusal(stream, time)
        if not reason:
            self._timestamps.note(stream, time)
        elif reason == "too_new" and not self._has_warned_of_clock:
            self._has_warned_of_clock = True
            ahead_s = (time - self._timestamps.reference) / _UNITS_A_SECOND
            _log.warning(
                "signed frames of system %d are %.0f s ahead and refused: its clock or this one is wrong",
                frame.system_id, ahead_s,
            )  # fmt: skip
        return reason

    def _refusal_unsigned(self, frame: RawFrame) -> str:
        if frame.system_id not in self._allow_unsigned:
            return "unsigned"
        if frame.raw[0] == MAGIC_V1 and not self._allow_mavlink1:
            return "mavlink1"
        self.counters["allowed_unsigned"] += 1
        return ""


def without_signature(raw: bytes, extras: Mapping[int, int]) -> bytes:
    """Return a frame without its signature."""
    if raw[0] != MAGIC_V2 or not raw[2] & _SIGNED:
        return raw
    extra = extras.get(int.from_bytes(raw[7:10], "little"))
    return raw if extra is None else _with_flags(raw, raw[2] & ~_SIGNED, extra)


def _with_flags(raw: bytes, flags: int, extra: int) -> bytes:
    """Return a MAVLink 2 frame with other incompatibility flags, without a signature."""
    body = bytes([raw[0], raw[1], flags]) + raw[3 : _HEADER + raw[1]]
    return body + checksum(body[1:], extra).to_bytes(2, "little")

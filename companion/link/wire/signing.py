"""MAVLink 2 signatures: what we send is signed, what comes in is verified.

A frame is believed when its signature fits the key and its time is later than that of the last one of
the same stream (system, component, link), so that a recorded frame cannot be sent again. Times outlive
the service: they are kept in a file, ours ahead of what was used, so that neither a crash nor a clock
set back makes one come twice.

The computer's clock is believed where it is synchronised and tells a year in which this program existed.
Then it is the reference: a new stream may lag behind it by a minute, and nobody may be ahead by more, so
that no peer moves our time by more than that. A clock that is not synchronised mostly runs behind (a
computer without a battery for it goes on from when it was last switched off), so that it still tells what
is too old. How far time has gone on since, one stream alone may tell: the first one believed, which mostly
is the vehicle's, and which may make up its time later, with its first GPS fix. All others are held against
that one's.

References
----------
MAVLink guide, *Message Signing*: signature is the first 48 bits of SHA-256 over key, header, payload,
checksum, link id and time; the time counts 10 µs since 2015-01-01 UTC; a new stream may lag behind the
newest time heard by a minute at most.
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
from companion.safe_files import read_file, replace_file, set_aside
from companion.types.mavlink_enums import MessageId

SETUP_SIGNING = MessageId.SETUP_SIGNING
STREAMS_MAX = 100  # vehicles, ground stations and their components on one link are a dozen
_SIGNED = 0x01
_HEADER = 10
_EPOCH_S = 1_420_070_400.0  # 2015-01-01T00:00:00Z
_UNITS_A_SECOND = 100_000
_MINUTE = 60 * _UNITS_A_SECOND
_JUMPED = 3 * _UNITS_A_SECOND
_DAY = 86_400 * _UNITS_A_SECOND
_BUILT = int(1_704_067_200.0 - _EPOCH_S) * _UNITS_A_SECOND  # 2024-01-01: no computer ran this program before
_LATEST = int(4_102_444_800.0 - _EPOCH_S) * _UNITS_A_SECOND  # 2100-01-01; 48 bits end in 2104
_RESERVED = 10 * _UNITS_A_SECOND  # of ours, kept in the file ahead of what was used
_KEEP_EVERY = _UNITS_A_SECOND
_FILE_MAX = 100_000  # bytes; a hundred streams take a twentieth

_log = logging.getLogger(__name__)

Stream = tuple[int, int, int]  # system, component, link


class Timestamps:
    """Times of what was signed and heard, kept in a file of mode 0600.

    A file that is damaged is set aside, and told; the clock is the reference then.

    Parameters
    ----------
    path : Path or None
        The file; None keeps them for the service's life only.
    epoch_s : callable
        Seconds since 1970 UTC, as far as the computer knows.
    is_synchronised : callable, optional
        Whether something keeps the computer's clock right; left out, it counts as kept so.
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
        self._own, self.streams = self._sane(own, streams)
        self._reserved = self._own
        self._newest = self._floor = max([0, *self.streams.values()])
        self._leader: Stream | None = None
        self._lead = 0  # of the leader's time over the clock
        self._jump: tuple[int, int] | None = None  # of the leader's time: when, by the clock, and to when
        self._written = self._clock()
        self._was_believed = self._is_believed(self._written)
        self._first: dict[Stream, int] = {}  # time of each stream that was believed first
        self._used: dict[Stream, tuple[int, int]] = {}  # first and last time of what is forgotten

    @property
    def reference(self) -> int:
        """What a new stream's time is held against: the clock, or what else is known of the time."""
        clock = self._clock()
        if self._is_believed(clock):
            return clock
        led = 0 if self._leader is None else clock + self._lead
        return max(_sendable(clock), self._floor, led)

    def next(self) -> int:
        """Time of the next frame: later than all before, the clock's, and behind no peer's by a minute."""
        newest = min(self._newest, self.reference + _MINUTE)
        self._own = max(self._own + 1, _sendable(self._clock()), newest + 1)
        if self._own >= self._reserved:
            self._reserved = self._own + _RESERVED
            self._write()
        return self._own

    def refusal(self, stream: Stream, time: int) -> str:
        """Why a frame of a stream with such a time is not believed, in a word; '' where it is."""
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
        """Take note of a frame that was believed."""
        clock = self._clock()
        self._first.setdefault(stream, time)
        self.streams[stream] = time
        self._newest = max(self._newest, time)
        if not self._is_believed(clock) and self._leader in (None, stream):
            self._leader, self._lead, self._jump = stream, time - clock, None
        if abs(clock - self._written) >= _KEEP_EVERY:  # by the clock, or a peer could have us write always
            self._write()

    def close(self) -> None:
        """Keep what is known now."""
        self._write()

    def _may_lead(self, stream: Stream, time: int) -> bool:
        """Whether a stream tells what time it is, for want of a clock that does.

        The first that is believed does. Its time may jump, as with the first fix of its GPS: once it has
        gone on from there for a while, and no frame of the time before came in between.
        """
        clock = self._clock()
        if self._is_believed(clock) or self._leader not in (None, stream):
            return False
        if self._leader is None or time <= self.reference + _MINUTE:
            return True
        held = self._jump
        if held is None or abs((time - held[1]) - (clock - held[0])) > _MINUTE:
            self._jump = clock, time
            return False
        return clock - held[0] >= _JUMPED

    def _follow_clock(self) -> None:
        """Once the clock is right, times beyond it are forgotten: they were heard when it was not.

        Only what was believed then is not believed a second time, once the clock comes to it.
        """
        clock, was_believed = self._clock(), self._was_believed
        self._was_believed = self._is_believed(clock)
        if not self._was_believed or was_believed:
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
        """The computer's clock, which may tell any time."""
        return int((self._epoch_s() - _EPOCH_S) * _UNITS_A_SECOND)

    def _is_believed(self, clock: int) -> bool:
        """Whether the clock tells the present."""
        return _BUILT <= clock < _LATEST and self._is_synchronised()

    def _has_room(self, reference: int) -> bool:
        """Whether another stream may be remembered; one that would be too old as a new one need not be."""
        if len(self.streams) < STREAMS_MAX:
            return True
        oldest = min(self.streams, key=lambda stream: self.streams[stream])
        if self.streams[oldest] + _MINUTE >= reference:
            return False
        del self.streams[oldest]
        self._first.pop(oldest, None)
        return True

    def _sane(self, own: int, streams: dict[Stream, int]) -> tuple[int, dict[Stream, int]]:
        """What can be true of what was read.

        Streams beyond a clock that is believed were heard when it was wrong. Our own may be a day ahead:
        a clock that was put right must not make us repeat ourselves.
        """
        clock = self._clock()
        limit, own_limit = _LATEST, _LATEST
        if self._is_believed(clock):
            limit, own_limit = clock + _MINUTE, clock + _DAY
        kept = {stream: time for stream, time in streams.items() if 0 <= time <= limit}
        newest = sorted(kept, key=lambda stream: kept[stream])[-STREAMS_MAX:]
        is_own_sane = 0 <= own <= own_limit
        if len(kept) < len(streams) or not is_own_sane:
            _log.error(
                "%s: %d times of signatures lie beyond the clock and are forgotten",
                self._path, len(streams) - len(kept) + (not is_own_sane),
            )  # fmt: skip
        return own if is_own_sane else 0, {stream: kept[stream] for stream in newest}

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
            aside = set_aside(self._path)
            found = "cannot be read" if aside is None else f"was damaged and is now {aside}"
            _log.error("%s %s: times of signatures begin at the clock", self._path, found)
            return 0, {}

    def _write(self) -> None:
        self._written = self._clock()
        if self._path is None:
            return
        streams = {"/".join(map(str, stream)): time for stream, time in self.streams.items()}
        kept = json.dumps({"own": self._reserved, "streams": streams}).encode("ascii")
        try:
            # Once a second and in the loop: a heartbeat must not wait for a slow disk.
            replace_file(self._path, kept, is_synced=False)
        except OSError as error:  # a full disk must not silence the link
            _log.error("times of signatures are not kept: %s", error)


def _sendable(clock: int) -> int:
    """A clock's time where it can be sent, else 0."""
    return clock if 0 <= clock < _LATEST else 0


class Signer:
    """Signs and verifies the frames of one link.

    Parameters
    ----------
    key : bytes
        Secret key, 32 bytes.
    link_id : int
        Link id that our frames carry.
    timestamps : Timestamps
        Times of what was signed and verified, in both directions.
    extras : mapping of int to int
        CRC extra byte of each message id, for the checksum of what is signed.
    allow_unsigned : collection of int
        System ids that are believed without a signature, in frames of MAVLink 2.
    allow_mavlink1 : bool
        Whether those are believed in frames of MAVLink 1, too.
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
        self._has_told_of_clock = False

    def count_in(self, counters: Counter[str]) -> None:
        """Count what is refused among somebody else's figures from now on."""
        self.counters = counters

    def signed(self, data: bytes) -> bytes:
        """One frame or several, each with its signature."""
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
        """Whether a received frame may be believed; why not is counted."""
        reason = self._refusal(frame)
        if reason:
            self.counters[reason] += 1
        return not reason

    def _refusal(self, frame: RawFrame) -> str:
        """Why a frame is not believed, in a word; '' where it is."""
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
        elif reason == "too_new" and not self._has_told_of_clock:
            self._has_told_of_clock = True
            ahead_s = (time - self._timestamps.reference) / _UNITS_A_SECOND
            _log.warning(
                "signed frames of system %d are %.0f s ahead, not believed: its clock is wrong, or this one",
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
    """A frame as it would be unsigned, for a reader that knows no keys."""
    if raw[0] != MAGIC_V2 or not raw[2] & _SIGNED:
        return raw
    extra = extras.get(int.from_bytes(raw[7:10], "little"))
    return raw if extra is None else _with_flags(raw, raw[2] & ~_SIGNED, extra)


def _with_flags(raw: bytes, flags: int, extra: int) -> bytes:
    """Return a MAVLink 2 frame with other incompatibility flags, without a signature."""
    body = bytes([raw[0], raw[1], flags]) + raw[3 : _HEADER + raw[1]]
    return body + checksum(body[1:], extra).to_bytes(2, "little")

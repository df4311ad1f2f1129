"""MAVLink 2 signatures: what we send is signed, what comes in is verified.

A frame is believed when its signature fits the key and its time is later than that of the last one of
the same stream (system, component, link), so that a recorded frame cannot be sent again. Times outlive
the service: they are kept in a file, ours ahead of what was used, so that neither a crash nor a clock
set back makes one come twice.

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
import stat
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from companion.errors import ConfigError
from companion.link.wire.framing import MAGIC_V2, SIGNATURE, RawFrame, checksum, frames_in
from companion.types.mavlink_enums import MessageId

KEY_BYTES = 32
SETUP_SIGNING = MessageId.SETUP_SIGNING
_SIGNED = 0x01
_HEADER = 10
_EPOCH_S = 1_420_070_400.0  # 2015-01-01T00:00:00Z
_UNITS_A_SECOND = 100_000
_LAG_MAX = 60 * _UNITS_A_SECOND
_RESERVED = 10 * _UNITS_A_SECOND  # of ours, kept in the file ahead of what was used
_KEEP_EVERY = _UNITS_A_SECOND

_log = logging.getLogger(__name__)

Stream = tuple[int, int, int]  # system, component, link


def read_key(path: Path) -> bytes:
    """Key of a file: 32 bytes, or 64 hexadecimal digits.

    Raises
    ------
    ConfigError
        If it cannot be read, others than its owner may read or write it, or it is no key.
    """
    place = "link.signing.key_file"
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(
            str(path), None, place, (error.strerror or str(error)).lower(), "a key file"
        ) from None
    if mode & 0o077:
        raise ConfigError(str(path), None, place, f"mode {mode:04o}", "mode 0600: the owner's alone")
    if len(data) == KEY_BYTES:
        return data
    try:
        key = bytes.fromhex(data.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise ConfigError(str(path), None, place, f"{len(data)} bytes", "32 bytes, or 64 hexadecimal digits")
    return key


class Timestamps:
    """Times of what was signed and heard, kept in a file of mode 0600.

    Parameters
    ----------
    path : Path or None
        The file; None keeps them for the service's life only.
    epoch_s : callable
        Seconds since 1970 UTC, as far as the computer knows.
    """

    def __init__(self, path: Path | None, epoch_s: Callable[[], float]) -> None:
        self._path = path
        self._epoch_s = epoch_s
        self._own, self.streams = self._read()
        self._reserved = self._kept = self._own
        self._heard_kept = self.newest_heard

    @property
    def newest_heard(self) -> int:
        """Latest time of any stream, 0 before the first."""
        return max(self.streams.values(), default=0)

    def next(self) -> int:
        """Time of the next frame: later than all before, and the clock's where that has gone on."""
        now = int((self._epoch_s() - _EPOCH_S) * _UNITS_A_SECOND)
        self._own = max(self._own + 1, now, self.newest_heard + 1)
        if self._own >= self._reserved:
            self._reserved = self._own + _RESERVED
            self._write()
        return self._own

    def note(self, stream: Stream, time: int) -> None:
        """Take note of a frame that was believed."""
        self.streams[stream] = time
        if time - self._heard_kept >= _KEEP_EVERY:
            self._write()

    def close(self) -> None:
        """Keep what is known now."""
        self._write()

    @property
    def reference(self) -> int:
        """What a new stream's time is held against."""
        return max(self._own, self.newest_heard)

    def _read(self) -> tuple[int, dict[Stream, int]]:
        if self._path is None:
            return 0, {}
        try:
            kept = json.loads(self._path.read_text(encoding="ascii"))
            streams = {
                (int(a), int(b), int(c)): int(time)
                for (a, b, c), time in ((name.split("/"), time) for name, time in kept["streams"].items())
            }
            return int(kept["own"]), streams
        except FileNotFoundError:
            return 0, {}
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise ConfigError(
                str(self._path), None, "link.signing.timestamp_file", "what is no record of times",
                f"a file that the service wrote, or none ({type(error).__name__})",
            ) from None  # fmt: skip

    def _write(self) -> None:
        if self._path is None:
            return
        self._heard_kept = self.newest_heard
        streams = {"/".join(map(str, stream)): time for stream, time in self.streams.items()}
        part = self._path.with_name(self._path.name + ".part")
        try:
            part.touch(mode=0o600)
            part.chmod(0o600)
            part.write_text(json.dumps({"own": self._reserved, "streams": streams}), encoding="ascii")
            part.replace(self._path)
        except OSError as error:  # a full disk must not silence the link
            _log.error("times of signatures are not kept: %s", error)


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
        System ids that are believed without a signature.
    """

    def __init__(
        self,
        key: bytes,
        link_id: int,
        timestamps: Timestamps,
        extras: Mapping[int, int],
        allow_unsigned: Collection[int] = (),
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._key = key
        self._link_id = link_id
        self._timestamps = timestamps
        self._extras = extras
        self._allow_unsigned = frozenset(allow_unsigned)

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
        end = _HEADER + raw[1]
        extra = self._extras[int.from_bytes(raw[7:10], "little")]
        body = bytes([raw[0], raw[1], raw[2] | _SIGNED]) + raw[3:end]
        body += checksum(body[1:], extra).to_bytes(2, "little")
        tail = bytes([self._link_id]) + self._timestamps.next().to_bytes(6, "little")
        return body + tail + self._digest(body + tail)

    def _digest(self, data: bytes) -> bytes:
        return hashlib.sha256(self._key + data).digest()[:6]

    def accepts(self, frame: RawFrame) -> bool:
        """Whether a received frame may be believed; why not is counted."""
        raw = frame.raw
        if raw[0] != MAGIC_V2 or not raw[2] & _SIGNED:
            if frame.system_id in self._allow_unsigned:
                self.counters["allowed_unsigned"] += 1
                return True
            self.counters["unsigned"] += 1
            return False
        if not hmac.compare_digest(self._digest(raw[:-6]), raw[-6:]):
            self.counters["bad_signature"] += 1
            return False
        stream = (frame.system_id, frame.component_id, raw[-SIGNATURE])
        time = int.from_bytes(raw[-12:-6], "little")
        last = self._timestamps.streams.get(stream)
        if last is not None and time <= last:
            self.counters["replayed"] += 1
            return False
        if last is None and time + _LAG_MAX < self._timestamps.reference:
            self.counters["too_old"] += 1
            return False
        self._timestamps.note(stream, time)
        return True


def without_signature(raw: bytes, extras: Mapping[int, int]) -> bytes:
    """A frame as it would be unsigned, for a reader that knows no keys."""
    if raw[0] != MAGIC_V2 or not raw[2] & _SIGNED:
        return raw
    end = _HEADER + raw[1]
    extra = extras.get(int.from_bytes(raw[7:10], "little"))
    if extra is None:
        return raw
    body = bytes([raw[0], raw[1], raw[2] & ~_SIGNED]) + raw[3:end]
    return body + checksum(body[1:], extra).to_bytes(2, "little")

"""A few files to read over the link, by MAVLink FTP: nothing is written, and no disk is looked at.

Files are named by the mapping alone, so that no path leads elsewhere. Each asker has one session, which
ends when it is not used; what does not fit the protocol is counted as ``refused_file``.

References
----------
MAVLink guide, *File Transfer Protocol*: payload, operations, errors, and the checksum.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum

Asker = tuple[int, int]  # system, component

DATA_MAX = 239  # bytes of data in a payload
SESSIONS_MAX = 4
SESSION_S = 30.0  # after which a session that nobody used makes room
BURST_MAX = 4  # answers to one request; who wants more asks again
_HEADER = struct.Struct("<HBBBBBBI")  # number, session, operation, size, answered operation, end, 0, offset
_ALL_BITS = 0xFFFFFFFF


class FileOperation(IntEnum):
    """Operations that are carried out, and the two answers."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FileError(IntEnum):
    """First byte of a refusal's data."""

    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_NOT_FOUND = 10


def file_checksum(data: bytes) -> int:
    """The CRC-32 that MAVLink FTP tells: zlib's polynomial, begun at 0 and not inverted."""
    return zlib.crc32(data, _ALL_BITS) ^ _ALL_BITS


@dataclass(slots=True)
class _Session:
    number: int
    data: bytes
    used_s: float


@dataclass(frozen=True, slots=True)
class _Asked:
    number: int
    session: int
    operation: int
    size: int
    offset: int
    data: bytes


class _Refused(Exception):
    def __init__(self, error: FileError) -> None:
        super().__init__(error.name)
        self.error = error


class FileServer:
    """Answers to MAVLink FTP.

    Parameters
    ----------
    files : callable
        Returns what there is now, by path; a file that is open stays what it was.
    counters : Counter
        Counts ``refused_file``.
    """

    def __init__(self, files: Callable[[], Mapping[str, bytes]], counters: Counter[str]) -> None:
        self.files = files
        self._counters = counters
        self._sessions: dict[Asker, _Session] = {}

    def answers(self, payload: bytes, asker: Asker, now_s: float) -> list[bytes]:
        """Payloads that answer one.

        Parameters
        ----------
        payload : bytes
            What a FILE_TRANSFER_PROTOCOL message carries.
        asker : tuple of int
            System and component that sent it.
        now_s : float
            Clock reading [s].
        """
        asked = _asked(payload)
        if asked is None:
            self._counters["refused_file"] += 1
            return []
        if asked.size > DATA_MAX or (len(asked.data) < asked.size and asked.operation in _NAMED):
            return [self._refusal(asked, FileError.INVALID_DATA_SIZE)]
        try:
            return self._carried_out(asked, asker, now_s)
        except _Refused as refused:
            return [self._refusal(asked, refused.error)]

    def _carried_out(self, asked: _Asked, asker: Asker, now_s: float) -> list[bytes]:
        match asked.operation:
            case FileOperation.OPEN_FILE_RO:
                return [self._opened(asked, asker, now_s)]
            case FileOperation.READ_FILE:
                return self._read(asked, self._session(asked, asker, now_s), 1)
            case FileOperation.BURST_READ_FILE:
                return self._read(asked, self._session(asked, asker, now_s), BURST_MAX)
            case FileOperation.CALC_FILE_CRC32:
                return [_packed(asked, struct.pack("<I", file_checksum(self._file(asked))))]
            case FileOperation.LIST_DIRECTORY:
                return [_packed(asked, self._listed(asked))]
            case FileOperation.TERMINATE_SESSION:
                self._session(asked, asker, now_s)
                del self._sessions[asker]
                return [_packed(asked)]
            case FileOperation.RESET_SESSIONS:  # the asker's: others may be reading
                self._sessions.pop(asker, None)
                return [_packed(asked)]
        raise _Refused(FileError.UNKNOWN_COMMAND)

    def _refusal(self, asked: _Asked, error: FileError) -> bytes:
        if error != FileError.END_OF_FILE:  # by which every reading ends
            self._counters["refused_file"] += 1
        return _packed(asked, bytes((error,)), FileOperation.NAK)

    def _file(self, asked: _Asked) -> bytes:
        files, path = self.files(), _path_in(asked)
        if path not in files:
            raise _Refused(FileError.FILE_NOT_FOUND)
        return files[path]

    def _opened(self, asked: _Asked, asker: Asker, now_s: float) -> bytes:
        """Open a file in the asker's session, so that a question that is repeated opens no second one."""
        data = self._file(asked)
        for other, session in list(self._sessions.items()):
            if abs(now_s - session.used_s) > SESSION_S:
                del self._sessions[other]
        session_now = self._sessions.get(asker)
        if session_now is None:
            taken = {session.number for session in self._sessions.values()}
            free = next((number for number in range(SESSIONS_MAX) if number not in taken), None)
            if free is None:
                raise _Refused(FileError.NO_SESSIONS_AVAILABLE)
            session_now = _Session(free, data, now_s)
        self._sessions[asker] = _Session(session_now.number, data, now_s)
        return _packed(asked, struct.pack("<I", len(data)), session=session_now.number)

    def _session(self, asked: _Asked, asker: Asker, now_s: float) -> _Session:
        session = self._sessions.get(asker)
        if session is None or session.number != asked.session or abs(now_s - session.used_s) > SESSION_S:
            raise _Refused(FileError.INVALID_SESSION)
        renewed = _Session(session.number, session.data, now_s)
        self._sessions[asker] = renewed
        return renewed

    def _read(self, asked: _Asked, session: _Session, most: int) -> list[bytes]:
        """Read in as many answers as there may be, each with its own number; the last says that it is."""
        if asked.offset >= len(session.data):
            raise _Refused(FileError.END_OF_FILE)
        step = asked.size or DATA_MAX
        starts = range(asked.offset, len(session.data), step)[:most]
        return [
            _packed(
                asked,
                session.data[start : start + step],
                offset=start,
                ahead=index,
                is_last=most > 1 and index == len(starts) - 1,
            )
            for index, start in enumerate(starts)
        ]

    def _listed(self, asked: _Asked) -> bytes:
        """List what stands in the one folder there is: kind, name, size, each ended by a zero byte."""
        if _path_in(asked) != "/":
            raise _Refused(FileError.FILE_NOT_FOUND)
        files = self.files()
        entries = [f"F{path.removeprefix('/')}\t{len(files[path])}\0".encode("ascii") for path in files]
        if asked.offset >= len(entries):
            raise _Refused(FileError.END_OF_FILE)
        listed = b""
        for entry in entries[asked.offset :]:
            if len(listed) + len(entry) > DATA_MAX:
                break
            listed += entry
        return listed


_NAMED = frozenset({FileOperation.OPEN_FILE_RO, FileOperation.LIST_DIRECTORY, FileOperation.CALC_FILE_CRC32})


def _asked(payload: bytes) -> _Asked | None:
    """Read a payload; None for an answer, which is not answered, and for one cut short."""
    if len(payload) < _HEADER.size:
        return None
    number, session, operation, size, _, _, _, offset = _HEADER.unpack_from(payload)
    if operation in (FileOperation.ACK, FileOperation.NAK):
        return None
    return _Asked(number, session, operation, size, offset, payload[_HEADER.size : _HEADER.size + size])


def _path_in(asked: _Asked) -> str:
    """The path that is asked for, with the folder it is in; '' for what is no path."""
    name = asked.data.split(b"\0", 1)[0]
    return "/" + name.decode("ascii").removeprefix("/") if name.isascii() else ""


def _packed(
    asked: _Asked,
    data: bytes = b"",
    operation: FileOperation = FileOperation.ACK,
    *,
    session: int | None = None,
    offset: int | None = None,
    ahead: int = 0,
    is_last: bool = False,
) -> bytes:
    header = _HEADER.pack(
        (asked.number + 1 + ahead) % 2**16,
        asked.session if session is None else session,
        operation,
        len(data),
        asked.operation,
        int(is_last),
        0,
        asked.offset if offset is None else offset,
    )
    return header + data.ljust(DATA_MAX, b"\0")

"""Serves a few files in memory by MAVLink FTP, for reading only; the disk is not accessed.

Files are found by exact path in a mapping, so that no path leads elsewhere. Each client has one session,
which expires if it is not used. Requests that violate the protocol are counted as ``refused_file``.

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

Client = tuple[int, int]  # System id and component id.

DATA_MAX = 239  # Bytes of data in a payload.
SESSIONS_MAX = 4
SESSION_S = 30.0  # A session that is not used for this time expires.
BURST_MAX = 4  # Payloads that answer one burst request. The client requests the rest again.
# Sequence number, session, operation, size, answered operation, end of burst, padding, offset.
_HEADER = struct.Struct("<HBBBBBBI")
_ALL_BITS = 0xFFFFFFFF


class FileOperation(IntEnum):
    """Supported operations, and the two kinds of answer."""

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
    """Error code: the first data byte of a NAK."""

    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_NOT_FOUND = 10


def file_checksum(data: bytes) -> int:
    """Return the CRC-32 of MAVLink FTP: zlib's polynomial, with initial value 0 and without inversion."""
    return zlib.crc32(data, _ALL_BITS) ^ _ALL_BITS


@dataclass(slots=True)
class _Session:
    number: int
    data: bytes
    used_s: float


@dataclass(frozen=True, slots=True)
class _Request:
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
    """Answers requests of MAVLink FTP.

    Parameters
    ----------
    files : callable
        Returns the present files by path; an open file keeps the content that it had.
    counters : Counter
        Counts ``refused_file``.
    """

    def __init__(self, files: Callable[[], Mapping[str, bytes]], counters: Counter[str]) -> None:
        self.files = files
        self._counters = counters
        self._sessions: dict[Client, _Session] = {}

    def answers(self, payload: bytes, client: Client, now_s: float) -> list[bytes]:
        """Return the payloads that answer a payload.

        Parameters
        ----------
        payload : bytes
            Payload of the received FILE_TRANSFER_PROTOCOL message.
        client : tuple of int
            System id and component id of the sender.
        now_s : float
            Clock reading [s].
        """
        request = _request(payload)
        if request is None:
            self._counters["refused_file"] += 1
            return []
        if request.size > DATA_MAX or (len(request.data) < request.size and request.operation in _NAMED):
            return [self._refusal(request, FileError.INVALID_DATA_SIZE)]
        try:
            return self._carried_out(request, client, now_s)
        except _Refused as refused:
            return [self._refusal(request, refused.error)]

    def _carried_out(self, request: _Request, client: Client, now_s: float) -> list[bytes]:
        match request.operation:
            case FileOperation.OPEN_FILE_RO:
                return [self._opened(request, client, now_s)]
            case FileOperation.READ_FILE:
                return self._read(request, self._session(request, client, now_s), 1)
            case FileOperation.BURST_READ_FILE:
                return self._read(request, self._session(request, client, now_s), BURST_MAX)
            case FileOperation.CALC_FILE_CRC32:
                return [_packed(request, struct.pack("<I", file_checksum(self._file(request))))]
            case FileOperation.LIST_DIRECTORY:
                return [_packed(request, self._listed(request))]
            case FileOperation.TERMINATE_SESSION:
                self._session(request, client, now_s)
                del self._sessions[client]
                return [_packed(request)]
            case FileOperation.RESET_SESSIONS:  # Only the client's own session: others may be reading.
                self._sessions.pop(client, None)
                return [_packed(request)]
        raise _Refused(FileError.UNKNOWN_COMMAND)

    def _refusal(self, request: _Request, error: FileError) -> bytes:
        if error != FileError.END_OF_FILE:  # Every download ends with this error.
            self._counters["refused_file"] += 1
        return _packed(request, bytes((error,)), FileOperation.NAK)

    def _file(self, request: _Request) -> bytes:
        files, path = self.files(), _path_in(request)
        if path not in files:
            raise _Refused(FileError.FILE_NOT_FOUND)
        return files[path]

    def _opened(self, request: _Request, client: Client, now_s: float) -> bytes:
        """Open a file in the client's only session, so that a repeated request opens no second one."""
        data = self._file(request)
        for other, session in list(self._sessions.items()):
            if abs(now_s - session.used_s) > SESSION_S:
                del self._sessions[other]
        session_now = self._sessions.get(client)
        if session_now is None:
            taken = {session.number for session in self._sessions.values()}
            free = next((number for number in range(SESSIONS_MAX) if number not in taken), None)
            if free is None:
                raise _Refused(FileError.NO_SESSIONS_AVAILABLE)
            session_now = _Session(free, data, now_s)
        self._sessions[client] = _Session(session_now.number, data, now_s)
        return _packed(request, struct.pack("<I", len(data)), session=session_now.number)

    def _session(self, request: _Request, client: Client, now_s: float) -> _Session:
        session = self._sessions.get(client)
        if session is None or session.number != request.session or abs(now_s - session.used_s) > SESSION_S:
            raise _Refused(FileError.INVALID_SESSION)
        renewed = _Session(session.number, session.data, now_s)
        self._sessions[client] = renewed
        return renewed

    def _read(self, request: _Request, session: _Session, most: int) -> list[bytes]:
        """Read up to ``most`` payloads, each with its own sequence number; the last is marked."""
        if request.offset >= len(session.data):
            raise _Refused(FileError.END_OF_FILE)
        step = request.size or DATA_MAX
        starts = range(request.offset, len(session.data), step)[:most]
        return [
            _packed(
                request,
                session.data[start : start + step],
                offset=start,
                ahead=index,
                is_last=most > 1 and index == len(starts) - 1,
            )
            for index, start in enumerate(starts)
        ]

    def _listed(self, request: _Request) -> bytes:
        """List the only folder: type, name and size of each file, each entry ended by a zero byte."""
        if _path_in(request) != "/":
            raise _Refused(FileError.FILE_NOT_FOUND)
        files = self.files()
        entries = [f"F{path.removeprefix('/')}\t{len(files[path])}\0".encode("ascii") for path in files]
        if request.offset >= len(entries):
            raise _Refused(FileError.END_OF_FILE)
        listed = b""
        for entry in entries[request.offset :]:
            if len(listed) + len(entry) > DATA_MAX:
                break
            listed += entry
        return listed


_NAMED = frozenset({FileOperation.OPEN_FILE_RO, FileOperation.LIST_DIRECTORY, FileOperation.CALC_FILE_CRC32})


def _request(payload: bytes) -> _Request | None:
    """Parse a payload; None for an answer and for a truncated payload."""
    if len(payload) < _HEADER.size:
        return None
    number, session, operation, size, _, _, _, offset = _HEADER.unpack_from(payload)
    if operation in (FileOperation.ACK, FileOperation.NAK):
        return None
    return _Request(number, session, operation, size, offset, payload[_HEADER.size : _HEADER.size + size])


def _path_in(request: _Request) -> str:
    """Return the requested path with a leading slash; '' for an invalid path."""
    name = request.data.split(b"\0", 1)[0]
    return "/" + name.decode("ascii").removeprefix("/") if name.isascii() else ""


def _packed(
    request: _Request,
    data: bytes = b"",
    operation: FileOperation = FileOperation.ACK,
    *,
    session: int | None = None,
    offset: int | None = None,
    ahead: int = 0,
    is_last: bool = False,
) -> bytes:
    header = _HEADER.pack(
        (request.number + 1 + ahead) % 2**16,
        request.session if session is None else session,
        operation,
        len(data),
        request.operation,
        int(is_last),
        0,
        request.offset if offset is None else offset,
    )
    return header + data.ljust(DATA_MAX, b"\0")

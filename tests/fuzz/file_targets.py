"""Recordings that somebody made up: mcap files and telemetry logs."""

import functools
import json
import math
import struct
import tempfile
import zlib
from collections import Counter
from pathlib import Path

import lz4.frame
import zstandard

from companion.errors import ConfigError, RecordError
from companion.link.wire.tlog import read_tlog
from companion.recording import mcap_schema as channels
from companion.recording.reader import load_recording
from companion.service.replay.flight_summary import flight_of
from tests.fuzz.mission_targets import MISSION
from tests.fuzz.scripts import Reader, packed, pieces_of
from tests.fuzz.targets import Target, Work, promise
from tests.support.messages import read_messages

FILE_MIN = 4096  # bytes: a shorter file is charged as the block that it takes on a disk
RECORDS_MAX = 300
BOMB_MIN, BOMB_STEPS = 10, 8  # powers of two: bytes that a chunk of a few unpacks to
UNPACKED_MAX = 2**18  # so that many are tried in a second; what far more does is measured, see HEAVY
MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 2, 3, 4, 5, 6, 15
TOPICS = (*(known.topic for known in channels.CHANNELS), "")
LOG = [(1_790_000_000_000_000 + 200_000 * n, packed(0, b"\0\0\0\0\1\3\x51\4\3", 1, 1)) for n in range(8)]
EMPTY = MISSION.partition("radars:")[0]  # a world with nothing in it, which is quickly made
ABOUT = json.dumps({"stamp_s": 0.0, "epoch_s": 1.79e9, "clock": "wall", "mission_file": EMPTY}).encode()
NUMBERS = (
    "0", "1", "-1", "0.5", "1e9", "1e308", "-1e308", "1e309", "Infinity", "-Infinity", "NaN", "null",
    "true", '"x"', "[]", "{}", "9" * 400, "9" * 5000, '[1.0, 2.0, 3.0]', "[[1, 2], [3]]", '[{"id": 1}]',
    '"simulated"', '"flown"', "[null]",
)  # fmt: skip
KEYS = (
    "stamp_s", "epoch_s", "clock", "step_s", "number", "asked", "took_s", "due_s", "seen_s", "is_stopped",
    "kind", "text", "why", "plan_ms", "track_to_mission_ms", "mission_file", "position_enu_m",
    "course_rad", "level", "tracks", "outcome", "items", "waypoints_enu_m", "obstacles", "path", "name",
    "seed", "remembered", "airspeed_m_s",
)  # fmt: skip


UNPACK = {
    b"": bytes,
    b"lz4": lz4.frame.decompress,
    b"zstd": lambda data: zstandard.ZstdDecompressor().decompress(data, max_output_size=2**26),
}


@functools.cache
def scratch():
    """A folder for the files of this process; it goes with the process."""
    folder = tempfile.TemporaryDirectory(prefix="fuzzed-")
    return folder, Path(folder.name)


def _string(text):
    data = text if isinstance(text, bytes) else text.encode()
    return struct.pack("<I", len(data)) + data


def record(kind, content, length=None):
    """A record of an mcap, perhaps with another length than it has."""
    return struct.pack("<BQ", kind, len(content) if length is None else length) + content


def channel(number, topic):
    return record(CHANNEL, struct.pack("<HH", number, 1) + _string(topic) + _string("json") + _string(b""))


def message(number, stamp_ns, data):
    return record(MESSAGE, struct.pack("<HIQQ", number, 0, stamp_ns, stamp_ns) + data)


def chunk(inside, compression, *, size=None, crc=None):
    """Records in a chunk, perhaps with another size or checksum than they have."""
    squeezed = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.compress}[compression](inside)
    return _chunk(
        squeezed,
        compression,
        len(inside) if size is None else size,
        zlib.crc32(inside) if crc is None else crc,
    )


def _chunk(squeezed, compression, size, crc):
    head = struct.pack("<QQQI", 0, 0, size, crc) + _string(compression)
    return record(CHUNK, head + struct.pack("<Q", len(squeezed)) + squeezed)


@functools.lru_cache(maxsize=32)
def bomb(compression, power, document):
    """Few bytes that become many: zeros, or one message again and again."""
    inside = (
        bytes(2**power) if document is None else message(1, 0, document) * (2**power // (len(document) + 31))
    )
    return chunk(inside, compression)


def _document(reader):
    """What a message of an mcap says: any bytes, something deep, or an object with odd values."""
    kind = reader.number() % 8
    if kind == 0:
        return reader.take(reader.number())
    if kind == 1:
        return (b"[", b'{"a":')[reader.number() % 2] * (reader.number(2) % 20_000)
    pairs = [
        f'"{KEYS[reader.number() % len(KEYS)]}": {NUMBERS[reader.number() % len(NUMBERS)]}'
        for _ in range(reader.number() % 6)
    ]
    clock = ', "clock": "simulated"' if kind == 2 else ""
    return ("{" + ", ".join(['"stamp_s": 1.0', *pairs]) + clock + "}").encode()


class McapScript:
    """An mcap file that a script makes, and the documents in those of its messages that are sound."""

    def __init__(self, data):
        self._reader = Reader(data)
        self.topics = {}
        self.is_sound = True  # whether all of it was written as it must be
        self.told = []  # topic and bytes of each message on a channel that was told before
        self._num_unpacked = 0
        self._num = 0
        start = self._reader.number()
        self.is_sound &= start != AS_IT_IS
        self.has_mission = start % 16 == 1  # so that a report can be made of it
        self.data = data[1:] if start == AS_IT_IS else self._file()

    def _file(self):
        made = [MAGIC, record(HEADER, _string("") + _string(""))]
        if self.has_mission:
            made += [channel(9, channels.MISSION), message(9, 0, ABOUT)]
            self.topics[9] = channels.MISSION
            self.told.append((channels.MISSION, ABOUT))
        while not self._reader.is_at_end and self._num < RECORDS_MAX:
            made.append(self._record(self._reader.number() % 12, is_inside=False))
        end = record(DATA_END, bytes(4)) + record(FOOTER, bytes(20)) + MAGIC
        return b"".join(made) + (end if self.is_sound else b"")

    def _record(self, kind, *, is_inside):
        self._num += 1
        reader = self._reader
        if kind < 2:
            number, topic = reader.number() % 4, TOPICS[reader.number() % len(TOPICS)]
            # One channel has one topic; another file is damaged.
            self.is_sound &= self.topics.setdefault(number, topic) == topic
            return channel(number, topic)
        if kind < 7:
            number, data = reader.number() % 4, _document(reader)
            self.told.append((self.topics.get(number), data))
            return message(number, reader.number(3), data)
        if kind < 10 and not is_inside:
            return self._chunk()
        if kind == 10 and not is_inside:
            return self._bomb()
        self.is_sound = False
        content = reader.take(reader.number())
        sizes = (len(content), reader.number(), reader.number(2), 2**30, 2**63, 2**64 - 1)
        return record(reader.number() % 18, content, sizes[reader.number() % len(sizes)])

    def _chunk(self):
        reader, inside = self._reader, b""
        for _ in range(reader.number() % 12):
            if not reader.is_at_end:
                inside += self._record(reader.number() % 12, is_inside=True)
        compression = ("", "lz4", "zstd")[reader.number() % 3]
        sizes = (None, None, None, 0, reader.number(), 2**26, 2**40, 2**63)
        size, crc = sizes[reader.number() % len(sizes)], (None, None, 0, 1)[reader.number() % 4]
        self.is_sound &= size is None and crc != 1
        return chunk(inside, compression, size=size, crc=crc)

    def _bomb(self):
        reader = self._reader
        self.is_sound = False
        document = (None, b"{}", b'{"a":[[],[],[],[],[],[],[],[]]}', b"[" * 900 + b"]" * 900)[
            reader.number() % 4
        ]
        compression, power = ("lz4", "zstd")[reader.number() % 2], BOMB_MIN + reader.number() % BOMB_STEPS
        self._num_unpacked += 2**power
        if self._num_unpacked > UNPACKED_MAX:
            return b""
        return bomb(compression, power, document)


AS_IT_IS = 255


def written(name, data):
    path = scratch()[1] / name
    path.write_bytes(data)
    return path


def log_of(entries):
    return b"".join(stamp.to_bytes(8, "big") + raw for stamp, raw in entries)


def documents_in(path, counters):
    """Documents of an mcap by topic, as the code under test reads them."""
    return read_messages(path, counters)


def _check_documents(told, found, num_refused):
    """Of a sound file every message is there, in its order, or counted as refused."""
    known = [row for row in told if row[0] is not None]
    num_found = sum(map(len, found.values()))
    promise(num_found + num_refused == len(known), "a sound file was not read as it was written: messages")
    for topic, rows in _documents(told).items():
        left = iter(map(repr, rows))
        is_in_order = all(any(repr(row) == other for other in left) for row in found.get(topic, ()))
        promise(is_in_order, "a sound file was not read as it was written: what they say")


def _documents(told):
    """Objects among the messages, by topic, as the json module reads them."""
    found = {}
    for topic, data in told:
        try:
            document = json.loads(data)
        except (ValueError, RecursionError):
            continue
        if topic is not None and isinstance(document, dict):
            found.setdefault(topic, []).append(document)
    return found


def check_mcap(data):
    script = McapScript(data)
    path, counters = written("flight.mcap", script.data), Counter()
    log = written("flight.tlog", log_of(LOG))
    try:
        found = documents_in(path, counters)
        recording = load_recording(log)
    except RecordError as error:
        promise(str(error), "an error that says nothing")
        return
    if script.has_mission:
        _check_report(path.parent)
    promise(
        all(isinstance(row, dict) for rows in found.values() for row in rows), "a message that is no object"
    )
    if script.is_sound:
        _check_documents(script.told, found, counters["damaged_messages"])
    check_recording(recording, [raw for _, raw in LOG])


def _check_report(folder):
    """What a report is made of can be read, or it is said why not."""
    try:
        flight_of(folder)
    except (RecordError, ConfigError) as error:
        promise(str(error), "an error that says nothing")


def check_recording(recording, frames):
    """What must hold of a flight, whatever its files say."""
    times = [heard.at_us for heard in recording.frames]
    promise(times == sorted(times), "time goes back")
    promise(len(times) <= len(frames), "frames that nobody recorded")
    promise(math.isfinite(recording.duration_s), "a flight without an end")
    promise(
        all(plan.took_s >= 0.0 for plan in recording.taken.values()), "a plan that took less than no time"
    )


def _reading(path, read, raw):
    def start():
        path.write_bytes(raw)

        def run():
            try:
                read(path)
            except RecordError:
                return

        return run

    return start


def unpacked_bytes(raw):
    """How many bytes the chunks of a file hold, as far as it is one."""
    at, found = len(MAGIC), 0
    while at + 9 <= len(raw):
        kind, length = struct.unpack_from("<BQ", raw, at)
        content = raw[at + 9 : at + 9 + length]
        at += 9 + length
        if kind != CHUNK or len(content) < 32:
            continue
        name_end = 32 + int.from_bytes(content[28:32], "little")
        squeezed = content[name_end + 8 :]
        try:
            found += len(UNPACK[content[32:name_end]](squeezed))
        except (KeyError, RuntimeError, zstandard.ZstdError, MemoryError):
            continue  # no chunk that anybody can unpack
    return found


def work_mcap(data):
    """A byte is one that is unpacked: how many these may be is limited by the reader, not by a time."""
    raw, path = McapScript(data).data, scratch()[1] / "flight.mcap"
    log = written("flight.tlog", b"")

    def read(_):
        load_recording(log)

    num_bytes = max(FILE_MIN, len(raw), unpacked_bytes(raw))
    return Work(num_bytes, _reading(path, read, raw), _reading(path, read, b""))


def _tlog_input(data):
    """A log that a script makes: its bytes, and its entries if all of it is sound."""
    reader = Reader(data)
    if reader.number() == AS_IT_IS:
        return data[1:], None
    stamps, stamp, made, entries = Reader(data[1:9]), 1_790_000_000_000_000, b"", []
    reader.take(8)
    for piece in pieces_of(reader):
        kind = stamps.number()
        stamp += 100_000
        odd = {
            250: 0,
            251: 2**64 - 1,
            252: 4_102_444_800_000_001,
            253: stamp - 10**9,
            254: stamp + 10**10,
        }.get(kind, stamp)
        if piece.is_sound:
            made += odd.to_bytes(8, "big") + piece.raw
            entries.append((odd, piece.raw))
        else:
            made += piece.raw
            entries.append(None)
    is_whole = all(entry is not None and entry[0] <= 4_102_444_800_000_000 for entry in entries)
    return made, entries if is_whole else None


def check_tlog(data):
    raw, entries = _tlog_input(data)
    path, counters = written("alone.tlog", raw), Counter()
    try:
        read = list(read_tlog(path, counters))
        recording = load_recording(path)
    except RecordError as error:
        promise(str(error), "an error that says nothing")
        return
    at = 0
    for entry in read:
        place = raw.find(entry.raw, at + 8)
        promise(place >= 0, "a frame that is not in the log, or is out of order")
        at = place + len(entry.raw)
        promise(math.isfinite(entry.time_s), "an entry at no time")
    told = sum(8 + len(entry.raw) for entry in read) + counters["skipped_bytes"]
    promise(told == len(raw), "bytes that were neither read nor counted")
    if entries is not None:
        promise(
            [entry.raw for entry in read] == [frame for _, frame in entries], "a sound log was not read whole"
        )
    check_recording(recording, read)


def work_tlog(data):
    raw, path = _tlog_input(data)[0], scratch()[1] / "alone.tlog"

    def read(path):
        for _ in read_tlog(path, Counter()):
            pass

    return Work(max(FILE_MIN, len(raw)), _reading(path, read, raw), _reading(path, read, b""))


FILE_TARGETS = (
    Target("mcap", check_mcap, work_mcap, ("companion.recording.reader", "companion.recording.mcap_reader")),
    Target("tlog", check_tlog, work_tlog, ("companion.link.wire.tlog", "companion.recording.reader")),
)

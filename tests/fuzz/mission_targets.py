"""Exchanges of missions with an autopilot that says anything, missions overheard, and mission files."""

import math
from pathlib import Path

from companion.config import mission_from_text
from companion.config.load import text_of
from companion.errors import ConfigError
from companion.link.missions.mission_sniffer import MissionSniffer
from companion.link.missions.mission_transfer import (
    OPENING,
    REPEAT_MAX_S,
    REPEAT_MIN_S,
    TRANSFER_TIMEOUT_S,
    MissionDownload,
    RoundTrip,
    Upload,
)
from companion.link.wire.decoded_frame import (
    MissionAck,
    MissionCount,
    MissionItemReceived,
    MissionItemRequest,
)
from companion.link.wire.framing import raw_frame
from companion.types.events import Dialect
from companion.types.mission import MissionItem
from tests.fuzz.scripts import EXTRAS, Reader, pieces_of
from tests.fuzz.targets import Target, Work, promise

ROOT = Path(__file__).parents[2]
SMALLEST_FRAME = 13  # bytes on the wire; what a round of the loop costs is charged to one
STEPS_MAX = 500
ANSWER, REFUSAL, TELLING, WAITING, LONG_WAIT, AGAIN = range(6)


def item_numbered(number, command=16):
    return MissionItem(number, command, 3, (0.0, 0.0, 0.0, 0.0), -353_632_610, 1_491_652_300, 100.0)


class UploadRun:
    """An upload, what it was told, and what it has sent."""

    def __init__(self, data):
        self._reader = reader = Reader(data)
        first, count = reader.number() % 4, 1 + reader.number() % 20
        self._may_finish = bool(reader.number() % 4)
        self.now_s = 0.0
        self.items = tuple(item_numbered(first + n) for n in range(count))
        self.round_trip = RoundTrip()
        window = 1 + 5 * (first % 2)  # As for a PX4, and for an ArduPlane.
        self.upload = Upload(self.items, self.round_trip, 0.0, lambda: self._may_finish, window)
        self.sent = set()

    def steps(self):
        """What an autopilot says and when, as calls on the upload; each with its bytes on the wire."""
        reader, count = self._reader, 0
        while not reader.is_at_end and count < STEPS_MAX:
            count += 1
            kind = reader.number() % 6
            if kind == ANSWER:
                number, mission = reader.number(), reader.number() % 8 if reader.number() % 8 == 0 else 0
                yield "note_request", MissionItemRequest(number, mission), 16
            elif kind == AGAIN:
                yield "note_request", MissionItemRequest(reader.number(2), 0), 16
            elif kind == REFUSAL:
                yield "note_ack", MissionAck(self.now_s, reader.number() % 18, 0, reader.number(4)), 20
            elif kind == TELLING:
                yield "note_ack", MissionAck(self.now_s, 0, reader.number() % 3, reader.number(4)), 20
            else:
                self.now_s += reader.number() * (0.005 if kind == WAITING else 0.2)
                self._may_finish ^= reader.number() == 255
                yield None, None, SMALLEST_FRAME

    def finish(self):
        """Nothing more comes: it ends."""
        for _ in range(4):
            self.now_s += TRANSFER_TIMEOUT_S
            self.ask()
        promise(self.upload.failure is not None, "an upload that nobody answers goes on for ever")

    def ask(self):
        """Let it send what is due."""
        before = self.upload.failure
        due = self.upload.due(self.now_s)
        promise(before is None or not due, "an upload that has ended sends on")
        promise(len(set(due)) == len(due), "an item twice at once")
        numbers = {item.sequence for item in self.items} | {OPENING}
        promise(numbers.issuperset(due), "an item that there is not")
        promise(self._may_finish or self.items[-1].sequence not in due, "the last item left, and may not")
        self.sent.update(due)


def check_upload(data):
    run = UploadRun(data)
    run.ask()
    for call, told, _ in run.steps():
        before, was_all_sent = run.upload.failure, run.sent.issuperset(item.sequence for item in run.items)
        if call is not None:
            getattr(run.upload, call)(told, run.now_s)
        promise(before is None or run.upload.failure == before, "an upload that had ended ended otherwise")
        is_new_success = before is None and run.upload.failure == ""
        promise(not is_new_success or was_all_sent, "accepted, though not every item was sent")
        promise(REPEAT_MIN_S <= run.round_trip.repeat_s <= REPEAT_MAX_S, "repeated too soon or too late")
        run.ask()
    run.finish()


class DownloadRun:
    """A reading of the autopilot's list, and what it was told."""

    def __init__(self, data):
        self._reader = reader = Reader(data)
        self.now_s = 0.0
        self.round_trip = RoundTrip()
        self.window = 1 + reader.number() % 8
        self.download = MissionDownload(self.round_trip, 0.0, self.window)
        self.asked = set()
        self.told = {}
        self.counts = set()

    def steps(self):
        """What an autopilot says and when, as calls on the reading; each with its bytes on the wire."""
        reader, count = self._reader, 0
        while not reader.is_at_end and count < STEPS_MAX:
            count += 1
            kind = reader.number() % 6
            if kind == ANSWER:
                item = item_numbered(reader.number(), reader.number())
                yield "note_item", MissionItemReceived(item, 0 if reader.number() % 8 else 1), 50
            elif kind == AGAIN:
                yield "note_item", MissionItemReceived(item_numbered(reader.number(2)), 0), 50
            elif kind == TELLING:
                number = reader.number() if reader.number() % 4 else reader.number(2)
                yield "note_count", MissionCount(number, 0 if reader.number() % 8 else 1), 17
            elif kind == REFUSAL:
                yield "note_ack", MissionAck(self.now_s, reader.number() % 18, reader.number() % 3, 0), 20
            else:
                self.now_s += reader.number() * (0.005 if kind == WAITING else 0.2)
                yield None, None, SMALLEST_FRAME

    def ask(self):
        """Let it ask what is due."""
        before = self.download.failure
        due = self.download.due(self.now_s)
        promise(before is None or not due, "a reading that has ended asks on")
        promise(len(due) <= max(1, self.window), "more is asked for at once than the window allows")
        self.asked.update(due)

    def hear(self, call, told):
        """Tell it something, and remember what a list read whole must hold."""
        if call == "note_item" and told.mission_type == 0 and told.item.sequence in self.asked:
            self.told.setdefault(told.item.sequence, []).append(told.item)
        elif call == "note_count" and told.mission_type == 0:
            self.counts.add(told.count)
        getattr(self.download, call)(told, self.now_s)


def check_download(data):
    run = DownloadRun(data)
    run.ask()
    for call, told, _ in run.steps():
        before = run.download.failure
        if call is not None:
            run.hear(call, told)
        promise(before is None or run.download.failure == before, "a reading that had ended ended otherwise")
        if before is None and run.download.failure == "":
            items = run.download.items
            promise([item.sequence for item in items] == list(range(len(items))), "a list with gaps was read")
            promise(len(items) in run.counts, "a list of another length than was told")
            promise(all(item in run.told[item.sequence] for item in items), "an item that nobody told")
        promise(REPEAT_MIN_S <= run.round_trip.repeat_s <= REPEAT_MAX_S, "repeated too soon or too late")
        run.ask()
    for _ in range(4):
        run.now_s += TRANSFER_TIMEOUT_S
        run.ask()
    promise(run.download.failure is not None, "a reading that nobody answers goes on for ever")


def check_transfer(data):
    (check_upload if data[:1] < b"\x80" else check_download)(data[1:])


def work_transfer(data):
    make, subject = (UploadRun, "upload") if data[:1] < b"\x80" else (DownloadRun, "download")
    recorded = make(data[1:])
    steps = [(call, told, recorded.now_s, size) for call, told, size in recorded.steps()]
    times = max(1, -(-4096 // max(1, sum(size for *_, size in steps))))

    def start():
        machines = [getattr(make(data[1:]), subject) for _ in range(times)]

        def run():
            for machine in machines:
                for call, told, now_s, _ in steps:
                    if call is not None:
                        getattr(machine, call)(told, now_s)
                    machine.due(now_s)

        return run

    return Work(times * sum(size for *_, size in steps), start)


# MISSION_ITEM, _WRITE_PARTIAL_LIST, _COUNT, _CLEAR_ALL, _ACK, _ITEM_INT, _REQUEST_INT; and two others.
EXCHANGED = [number for number in (39, 38, 44, 44, 45, 47, 47, 73, 73, 73, 51, 0, 30) if number in EXTRAS]
COUNT, PART = 44, 38
DIALECTS = (None, Dialect.ARDUPILOT, Dialect.PX4)


def _sniffer_input(data):
    reader = Reader(data)
    sniffer = MissionSniffer()
    sniffer.set_dialect(DIALECTS[reader.number() % 3])
    return sniffer, pieces_of(reader, EXCHANGED)


def opens_for(frame, vehicle):
    """Whether a frame begins a client's upload to a vehicle; of a part, where that does not end before it."""
    payload = frame.payload.ljust(40, b"\0")
    if frame.message_id == PART:
        first, last = int.from_bytes(payload[:2], "little"), int.from_bytes(payload[2:4], "little")
        return payload[4] in (0, vehicle) and payload[6] == 0 and first <= last
    return frame.message_id == COUNT and payload[2] in (0, vehicle) and payload[4] == 0


def check_sniffer(data):
    sniffer, pieces = _sniffer_input(data)
    opened = {}
    for number, piece in enumerate(pieces):
        if not piece.is_sound:
            continue
        frame = raw_frame(piece.raw)
        client, before = (frame.system_id, frame.component_id), list(sniffer.uploads)
        sniffer.feed(frame, 1, float(number))
        if client != (1, 1) and opens_for(frame, 1):
            opened[client] = number
        _check_uploads(before, sniffer.uploads, opened, client, frame)
        known = sniffer.settled or ()
        promise(all(isinstance(item, MissionItem) for item in known), "a list settled with a gap in it")
        promise(len(sniffer.items or ()) <= 2**16, "a list longer than any")


def _check_uploads(before, now, opened, client, frame):
    """What became of the uploads by one frame."""
    promise(len(before) <= len(now) <= len(before) + 1, "uploads vanished, or came in pairs")
    for old, new in zip(before, now, strict=False):
        if old.is_accepted != new.is_accepted:
            promise(frame.message_id == 47 and client == (1, 1), "accepted, and not by the vehicle")
            promise(opened[new.client] <= new.stamp_s, "accepted, though another upload began since")
    for new in now[len(before) :]:
        promise(
            new.client == client and not new.is_accepted, "an upload of somebody else's, or accepted unheard"
        )
        numbers = [item.sequence for item in new.items]
        promise(numbers == list(range(numbers[0], numbers[0] + len(numbers))), "an upload with gaps")


def work_sniffer(data):
    dialect = DIALECTS[Reader(data).number() % 3]
    _, pieces = _sniffer_input(data)
    wire = [piece.raw for piece in pieces if piece.is_sound]
    times = max(1, -(-4096 // max(1, sum(map(len, wire)))))
    frames = [raw_frame(raw) for raw in wire * times]

    def start():
        sniffer = MissionSniffer()
        sniffer.set_dialect(dialect)

        def run():
            for frame in frames:
                sniffer.feed(frame, 1, 0.0)

        return run

    return Work(sum(len(frame.raw) for frame in frames), start)


# A small mission, of which a script changes lines; a script that begins with FF is the file itself.
MISSION = """name: a
dimension: 2
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {east_m: [0, 2000], north_m: [0, 1500], up_m: [60, 160]}
start: {east_m: 150, north_m: 750, up_m: 100, course_deg: 90}
goals:
  - {east_m: 1750, north_m: 750, up_m: 100, acceptance_radius_m: 60}
vehicle:
  airspeed_min_m_s: 12.5
  airspeed_max_m_s: 37.5
  airspeed_cruise_m_s: 25
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 125
  straight_length_min_m: 125
  penetration_speed_m_s: 30
planning:
  sensing_horizon_m: 825
  time_horizon_s: 15
  total_planning_time_s: 80
radars:
  - {name: r, east_m: 1100, north_m: 1350, up_m: 100, max_threat_radius_m: 500}
dynamic_threats:
  - {name: p, east_m: 950, north_m: 750, speed_m_s: 0, max_threat_radius_m: 250}
obstacles:
  - {name: w, polygon_enu_m: [[1000, 1050], [1300, 1050], [1300, 1100]], base_m: 0, top_m: 300}
link:
  systems: [1, 200]
"""
VALUES = (
    "", "0", "-1", "1e309", "1" * 5000, ".nan", ".inf", "2026-13-45", "2026-01-01", "!!timestamp foo",
    "!!int x", "!!binary x", "!!python/name:os.system", "&a 1", "*a", "[" * 30, "{a: 1, a: 2}", "0x10",
    "1:30", "~", "yes", "'\\u0000'", '"\\x1b[2J"', "!!set {a}", "!!omap [a: 1]", "? a", "|\n  x", "- a",
    "%YAML 1.1\n---", "<<: {a: 1}", "!!float 1_0", "0b1", "1_000", "!!pairs [a: 1]", "!!str 1", "=", "\t",
    "\ufeff", "---", "...", "!!null x", "!!bool x", "!<tag:yaml.org,2002:map> x",
)  # fmt: skip
AS_IT_IS = 255
SCALE = 2.0**16
FILE_MIN = 4096  # bytes: a shorter file is charged as the block that it takes on a disk


def mission_text(data):
    """The file that a script makes."""
    reader = Reader(data)
    if reader.number() == AS_IT_IS:
        return data[1:].decode("utf-8", "replace")
    lines = MISSION.splitlines()
    while not reader.is_at_end and len(lines) < 400:
        kind, place = reader.number() % 9, reader.number() % len(lines)
        if kind == 8:  # the same again and again
            lines[place:place] = [lines[place]] * reader.number()
            continue
        value = (
            VALUES[reader.number() % len(VALUES)] if kind % 2 else str(reader.number(4, signed=True) / SCALE)
        )
        if kind < 2:  # what stands behind a key
            lines[place] = lines[place].partition(":")[0] + ": " + value
        elif kind < 4:
            lines.insert(place, "  " * (reader.number() % 8) + value)
        elif kind < 6:
            before, colon, after = lines[place].partition(": ")
            lines[place] = before + colon + after.replace(after[: reader.number() % 12], value, 1)
        else:
            lines.insert(place, reader.take(reader.number() % 40).decode("utf-8", "replace"))
    return "\n".join(lines) + "\n"


def check_mission_file(data):
    text = mission_text(data)
    try:
        config = mission_from_text(text, "fuzzed.yaml")
    except ConfigError as error:
        promise(str(error), "an error that says nothing")
        return
    again = mission_from_text(text_of(config), "again.yaml")
    promise(again == config, "written out and read again, the mission is another")
    promise(math.isfinite(config.origin.latitude_deg), "a mission at no place")


def work_mission_file(data):
    text = mission_text(data)

    def start():
        def run():
            try:
                mission_from_text(text, "fuzzed.yaml")
            except ConfigError:
                return

        return run

    return Work(max(FILE_MIN, len(text.encode("utf-8", "replace"))), start)


WORDS = (
    b"name:", b"origin:", b"bounds:", b"goals:", b"vehicle:", b"planning:", b"radars:", b"obstacles:",
    b"link:", b"east_m", b"north_m", b"up_m", b"!!timestamp ", b"!!int ", b"!!float ", b"&a ", b"*a",
    b"<<: ", b"? ", b"|\n", b"2026-13-45", b".inf",
    b"latitude_deg", b"longitude_deg", b"polygon_lat_lon_deg",
    b"utm: {zone: 55H, easting_m: 698485, northing_m: 6085231}",
)  # fmt: skip

MISSION_MODULES = ("source", "load", "explain", "checks", "rules", "models", "sections.geographic_places")

MISSION_TARGETS = (
    Target(
        "transfer",
        check_transfer,
        work_transfer,
        ("companion.link.missions.mission_transfer",),
        length_max=2048,
    ),
    Target(
        "sniffer",
        check_sniffer,
        work_sniffer,
        ("companion.link.missions.mission_sniffer", "companion.link.missions.mission_items"),
    ),
    Target(
        "mission_file",
        check_mission_file,
        work_mission_file,
        tuple(f"companion.config.{name}" for name in MISSION_MODULES),
        length_max=2048,
        words=WORDS,
    ),
)

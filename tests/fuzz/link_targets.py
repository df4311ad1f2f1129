"""The framer, the decoder and the signer, under bytes that others chose."""

import hashlib
import math
from collections import Counter
from dataclasses import fields, is_dataclass

from companion.link.messages.codec import Codec, signer_of
from companion.link.wire.framing import Framer, raw_frame
from companion.link.wire.signing import Timestamps
from companion.link.wire.source_limits import SourceLimits
from tests.fuzz.scripts import EXTRAS, IDS, Reader, crc, packed, pieces_of, portions, repeated
from tests.fuzz.targets import Target, Work, promise

HEADERS = {0xFE: 6, 0xFD: 10}
FLUSH = bytes(300)  # longer than any frame: behind it nothing is waited for
READ, DATAGRAM = 64, 1400  # bytes that a serial port gives at once, and a network
KEY, OTHER_KEY = bytes(range(32)), bytes(32)
EPOCH_S = 1_420_070_400.0
NOW_S = 1_790_000_000.0  # a day in 2026
BUILT_S = 1_704_067_200.0  # 2024-01-01: a clock before is not believed
UNITS = 100_000  # of a signature's time, in a second
TIME_MAX = 2**48 - 1


def sound_frames(wire):
    """Places and lengths of all whole frames whose checksums fit, of known messages, one in another too."""
    for place, byte in enumerate(wire):
        header = HEADERS.get(byte)
        if header is None or place + header > len(wire) or (byte == 0xFD and wire[place + 2] & ~1):
            continue
        number = int.from_bytes(wire[place + 7 : place + 10], "little") if byte == 0xFD else wire[place + 5]
        body = place + header + wire[place + 1]
        end = body + 2 + (13 if byte == 0xFD and wire[place + 2] & 1 else 0)
        if number not in EXTRAS or end > len(wire):
            continue
        if crc(wire[place + 1 : body] + bytes((EXTRAS[number],))) == int.from_bytes(
            wire[body : body + 2], "little"
        ):
            yield place, end - place


def _framer_input(data):
    reader = Reader(data)
    sizes = [1 + reader.number() % 97 for _ in range(3)]
    return sizes, b"".join(piece.raw for piece in pieces_of(reader))


def framed(chunks):
    """Frames that a new framer finds, and its counters."""
    counters = Counter()
    framer = Framer(EXTRAS, counters)
    return [frame for chunk in chunks for frame in framer.feed(chunk)], counters


def check_framer(data):
    sizes, wire = _framer_input(data)
    check_frames(wire, sizes)


def check_frames(wire, sizes):
    """What must hold of the frames that are found in a wire, fed at once and in portions."""
    wire += FLUSH
    sound = dict(sound_frames(wire))
    found, counters = framed([wire])
    at, taken = 0, []
    for frame in found:
        place = wire.find(frame.raw, at)
        while frame.is_verified and place >= 0 and sound.get(place) != len(frame.raw):
            place = wire.find(frame.raw, place + 1)
        promise(place >= 0, "a frame that is not in the input, does not fit its checksum, or is out of order")
        promise(
            frame == raw_frame(frame.raw, is_verified=frame.is_verified), "a header that was read wrongly"
        )
        promise(frame.is_verified == (frame.message_id in EXTRAS), "believed without its checksum, or not")
        at = place + len(frame.raw)
        taken.append((place, at, frame.is_verified))
    for place in sound:
        is_taken = any(
            first == place or (is_verified and first < place < last) for first, last, is_verified in taken
        )
        promise(is_taken, "a sound frame was lost, and not to another sound one before it")
    promise(
        sum(last - first for first, last, _ in taken) + counters["garbage_bytes"] <= len(wire),
        "bytes were counted twice",
    )
    again, _ = framed(portions(wire, sizes))
    promise(believed(again) == believed(found), "other believed frames where they come in other portions")
    promise(again == found, "other unknown messages where they come in other portions")


def believed(frames):
    """Those whose checksums fit."""
    return [frame for frame in frames if frame.is_verified]


def work_framer(data):
    sizes, wire = _framer_input(data)
    wire = repeated(wire)
    chunks = list(portions(wire, [DATAGRAM if sizes[0] > READ else READ]))

    def start():
        framer = Framer(EXTRAS, Counter())

        def run():
            for chunk in chunks:
                for _ in framer.feed(chunk):
                    pass

        return run

    return Work(len(wire), start)


def _numbers(value):
    """Numbers with a fraction in an event, wherever they stand."""
    if isinstance(value, float):
        yield value
    elif is_dataclass(value):
        for field in fields(value):
            yield from _numbers(getattr(value, field.name))
    elif isinstance(value, tuple):
        for entry in value:
            yield from _numbers(entry)


# The messages that are listened to, several times as often as any other.
HEARD = [
    0, 0, 1, 2, 4, 22, 22, 23, 20, 21, 24, 26, 30, 33, 33, 39, 42, 43, 44, 45, 46, 47, 51, 73, 74, 75, 76,
    77, 147, 148, 168, 230, 231, 241, 242, 245, 246, 246, 253, 253, 256, 300, 301,
]  # fmt: skip
LISTENED = [number for number in HEARD if number in EXTRAS] * 8 + IDS


def _codec_input(data):
    reader = Reader(data)
    return reader.number(), pieces_of(reader, LISTENED)


def _codec_of(options):
    vehicle = 1 if options & 1 else None
    limits = SourceLimits(50.0, range(200) if options & 4 else None) if options & 2 else None
    return Codec(vehicle, frozenset((1, 200)) if options & 8 else None, limits=limits)


def check_codec(data):
    options, pieces = _codec_input(data)
    codec = _codec_of(options)
    wire, at, now_s = b"".join(piece.raw for piece in pieces), 0, 0.0
    for piece in pieces:
        for frame in codec.feed(piece.raw, now_s):
            place = wire.find(frame.raw, at)
            promise(place >= 0, "a decoded frame that is not in the input, or is out of order")
            at = place + len(frame.raw)
            head = raw_frame(frame.raw)
            named = (head.system_id, head.component_id, head.message_id)
            promise(
                named == (frame.system_id, frame.component_id, frame.message_id),
                "a frame under another's name",
            )
            promise(frame.message_id != 256, "a key on the wire was passed on")
            values = [
                *_numbers(frame.events),
                *_numbers(() if frame.request is None else frame.request.parameters),
            ]
            is_set = frame.request is not None and frame.request.kind == "parameter_set"
            promise(is_set or all(map(math.isfinite, values)), "an event or a request with no finite number")
            promise(
                frame.reply is None or frame.system_id == codec.vehicle_system_id,
                "an answer of somebody else was taken for the vehicle's",
            )
        now_s += 0.02


def work_codec(data):
    options, pieces = _codec_input(data)
    wire = repeated(b"".join(piece.raw for piece in pieces))
    size = DATAGRAM if options & 16 else READ

    def start():
        codec = _codec_of(options & ~2)  # no limit on the rate: each frame is to cost what it can

        def run():
            for chunk in portions(wire, [size]):
                codec.feed(chunk, 0.0)

        return run

    return Work(len(wire), start)


class Sender:
    """Signs as MAVLink's guide says, apart from the code under test."""

    def __init__(self, key):
        self._key = key

    def signed(self, number, payload, ids, link, time):
        frame = packed(number, payload, *ids, flags=1)
        tail = bytes((link,)) + time.to_bytes(6, "little")
        return frame + tail + hashlib.sha256(self._key + frame + tail).digest()[:6]


GENUINE, TIMED, REPLAYED, MUTATED, FORGED, UNSIGNED, OWN, CLOCK = range(8)


class SignerScript:
    """Frames that a script has somebody send, and what the key's holder has really signed."""

    def __init__(self, data):
        self._reader = Reader(data)
        self._sender, self._stranger = Sender(KEY), Sender(OTHER_KEY)
        self._time = round((NOW_S - EPOCH_S) * UNITS)
        self.genuine = []

    def steps(self):
        """Pairs of what is done and with what: a frame that comes, or seconds that the clock goes on."""
        for _ in range(300):
            if self._reader.is_at_end:
                return
            yield self._step(self._reader.number() % 8)

    def _step(self, kind):
        reader = self._reader
        if kind == CLOCK:
            return kind, float(reader.number(3, signed=True))
        if kind == OWN:
            return kind, packed(0, reader.take(9), 1, 195)
        if kind in (REPLAYED, MUTATED) and self.genuine:
            raw = self.genuine[reader.number() % len(self.genuine)]
            return kind, self._mutated(raw) if kind == MUTATED else raw
        ids, link = (1 + reader.number() % 3, 1 + reader.number() % 2), reader.number() % 3
        number, payload = IDS[reader.number(2) % len(IDS)], reader.take(reader.number() % 64)
        if kind == UNSIGNED:
            version = 1 if number < 256 and reader.number() % 2 else 2
            return kind, packed(number, payload, *ids, version=version)
        if kind == FORGED:
            return kind, self._stranger.signed(number, payload, ids, link, reader.number(6))
        self._time += 1 + reader.number()
        time = reader.number(6) if kind == TIMED else self._time
        raw = self._sender.signed(number, payload, ids, link, time)
        self.genuine.append(raw)
        return kind, raw

    def _mutated(self, raw):
        """A frame with some bytes changed, and perhaps its checksum put right."""
        reader, changed = self._reader, bytearray(raw)
        for _ in range(1 + reader.number() % 3):
            place = 3 + reader.number(2) % (len(raw) - 3)  # not its length, which a framer would see
            changed[place] ^= reader.number()
        if reader.number() % 2:
            end = 10 + changed[1]
            extra = EXTRAS.get(int.from_bytes(changed[7:10], "little"), 0)
            changed[end : end + 2] = crc(bytes(changed[1:end]) + bytes((extra,))).to_bytes(2, "little")
        return bytes(changed)


class MovingClock:
    """Seconds since 1970, as a script moves them."""

    def __init__(self):
        self.now_s = NOW_S

    def __call__(self):
        return self.now_s


def check_signer(data):
    clock = MovingClock()
    script, signer = SignerScript(data), signer_of(KEY, 7, Timestamps(None, clock))
    accepted, newest, own, was_right = set(), {}, 0, True
    for kind, what in script.steps():
        if kind == CLOCK:
            clock.now_s = max(0.0, clock.now_s + what)
            continue
        if kind == OWN:
            own = check_own(signer.signed(what), own)
            continue
        frame = raw_frame(what)
        is_right = clock.now_s >= BUILT_S
        if is_right and not was_right:  # what was heard by a clock from before the program was built may go
            limit = (clock.now_s + 60.0 - EPOCH_S) * UNITS
            newest = {stream: time for stream, time in newest.items() if time <= limit}
        was_right = is_right
        if not signer.accepts(frame):
            continue
        promise(what in script.genuine, "a frame was accepted that nobody with the key has signed")
        promise(what not in accepted, "a frame was accepted twice")
        stream, time = (what[5], what[6], what[-13]), int.from_bytes(what[-12:-6], "little")
        promise(time > newest.get(stream, -1), "a frame was accepted that is no later than one before")
        accepted.add(what)
        newest[stream] = time


def check_own(raw, before):
    """The time of a frame of ours, which is signed and later than all before."""
    time = int.from_bytes(raw[-12:-6], "little")
    promise(raw[-6:] == hashlib.sha256(KEY + raw[:-6]).digest()[:6], "our own signature does not fit")
    promise(before < time <= TIME_MAX, "a time of ours came twice")
    return time


def work_signer(data):
    script = SignerScript(data)
    steps = [(kind, what) for kind, what in script.steps() if kind != CLOCK]
    frames = [(kind, what if kind == OWN else raw_frame(what)) for kind, what in steps]
    num_bytes = sum(len(what) for _, what in steps)

    def start():
        signer = signer_of(KEY, 7, Timestamps(None, MovingClock()))

        def run():
            for kind, what in frames:
                if kind != OWN:
                    signer.accepts(what)

        return run

    return Work(num_bytes, start)


LINK_TARGETS = (
    Target("framer", check_framer, work_framer, ("companion.link.wire.framing",), length_max=1024),
    Target(
        "codec", check_codec, work_codec,
        (
            "companion.link.messages.codec", "companion.link.messages.vehicle_telemetry",
            "companion.link.messages.track_messages", "companion.link.missions.mission_items",
            "companion.link.wire.source_limits",
        ),
    ),
    Target("signer", check_signer, work_signer, ("companion.link.wire.signing",), length_max=2048),
)  # fmt: skip

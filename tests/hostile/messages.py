"""Hostile traffic: seeded, at any rate, of every sort that a link may bring."""

import math
import random
import re
import struct
from collections import Counter, deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

NUM_TRACKS = 10_000
AUTOPILOT = (1, 1)
NUMBER_OF = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}
TRACKS = (
    *("ADSB_VEHICLE", "AIS_VESSEL", "OPEN_DRONE_ID_LOCATION"),
    *("UTM_GLOBAL_POSITION", "GLOBAL_POSITION_INT", "FOLLOW_TARGET"),
)
READ = (
    *("HEARTBEAT", "GLOBAL_POSITION_INT", "ATTITUDE", "SYSTEM_TIME", "VFR_HUD", "WIND", "WIND_COV"),
    *("ESTIMATOR_STATUS", "MISSION_CURRENT", "MISSION_ITEM_REACHED", "HOME_POSITION", "STATUSTEXT"),
    *("COMMAND_ACK", "MISSION_ACK", "COMMAND_LONG", "COMMAND_INT", "PING", "PARAM_REQUEST_LIST"),
    *("PARAM_REQUEST_READ", "PARAM_SET", "SETUP_SIGNING", *TRACKS),
)
MISSION = (
    *("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_REQUEST_LIST", "MISSION_COUNT", "MISSION_ACK"),
    *("MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_CLEAR_ALL", "MISSION_SET_CURRENT", "MISSION_CURRENT"),
)
FLOATS = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, -0.0, 1e10, 360.0, 1.0)
BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}
LATITUDE_E7, LONGITUDE_E7 = -353_632_610, 1_491_652_300  # of the first flight's origin
NEAR_E7 = 1_800_000  # 20 km


def layout_of(kind):
    """Type of each field on the wire, arrays unfolded."""
    parts = re.findall(r"(\d*)([a-zA-Z])", kind.unpacker.format)
    return [code for count, code in parts for _ in range(int(count or 1))]


LAYOUTS = {number: layout_of(kind) for number, kind in mavlink.mavlink_map.items()}


def _checksum(data, extra):
    return mavlink.x25crc(data + bytes([extra])).crc


class Hostile:
    """A source of hostile frames.

    ``counts`` tells how many of each sort were made.
    """

    def __init__(self, seed):
        self.counts = Counter()
        self.identities = set()
        self._random = random.Random(seed)
        self._real = deque(maxlen=200)
        self._sorts = (
            (self._track, 45), (self._hostile_values, 22), (self._mission, 12),
            (self._damaged, 10), (self._random_bytes, 8), (self._any_message, 3),
        )  # fmt: skip

    def messages(self, count):
        """So many messages, one behind the other, in portions as a line might deliver them."""
        makers, weights = zip(*self._sorts, strict=True)
        portions, pending = [], b""
        for maker in self._random.choices(makers, weights, k=count):
            self.counts[maker.__name__.strip("_")] += 1
            pending += maker()
            if self._random.random() < 0.5:
                cut = self._random.randrange(len(pending) + 1)
                portions.append(pending[:cut])
                pending = pending[cut:]
        return [*portions, pending]

    def _frame(self, number, payload, source):
        """MAVLink 2, or 1 where that can say it; whole, with a checksum that fits."""
        kind = mavlink.mavlink_map.get(number)
        extra = self._random.randrange(256) if kind is None else kind.crc_extra
        sequence = self._random.randrange(256)
        if number < 256 and self._random.random() < 0.1:
            body = bytes([len(payload), sequence, *source, number]) + payload
            start = b"\xfe"
        else:
            payload = payload.rstrip(b"\0") or b"\0"
            body = bytes([len(payload), 0, 0, sequence, *source]) + number.to_bytes(3, "little") + payload
            start = b"\xfd"
        whole = start + body + _checksum(body, extra).to_bytes(2, "little")
        self._real.append(whole)
        return whole

    def _value(self, code):
        pick = self._random
        if code in "fd":
            return pick.choice((*FLOATS, pick.uniform(-1e4, 1e4)))
        if code in "sc":
            return bytes([pick.randrange(256)])
        bits = BITS[code]
        low, high = (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return pick.choice((low, high, 0, 1, high - 1, low + 1, pick.randint(low, high)))

    def _payload(self, number):
        return b"".join(
            struct.pack("<" + code.replace("s", "c"), self._value(code)) for code in LAYOUTS[number]
        )

    def _anyone(self):
        return self._random.randrange(1, 256), self._random.randrange(1, 256)

    def _source(self):
        return AUTOPILOT if self._random.random() < 0.5 else self._anyone()

    def _hostile_values(self):
        number = NUMBER_OF[self._random.choice(READ)]
        return self._frame(number, self._payload(number), self._source())

    def _any_message(self):
        if self._random.random() < 0.3:  # one that the dialect does not know
            return self._frame(60_000, self._random.randbytes(self._random.randrange(256)), self._anyone())
        number = self._random.choice(list(LAYOUTS))
        return self._frame(number, self._payload(number), self._anyone())

    def _random_bytes(self):
        return self._random.randbytes(self._random.randrange(1, 300))

    def _damaged(self):
        if not self._real:
            return self._random_bytes()
        whole = bytearray(self._random.choice(self._real))
        how = self._random.randrange(3)
        if how == 0:
            return bytes(whole[: self._random.randrange(len(whole))])
        if how == 1:
            whole[self._random.randrange(len(whole))] ^= 1 << self._random.randrange(8)
            return bytes(whole)
        return bytes(whole) * self._random.randrange(2, 5)

    def _mission(self):
        """The mission protocol out of its order, for us or for nobody, from the autopilot's ids mostly."""
        number = NUMBER_OF[self._random.choice(MISSION)]
        kind = mavlink.mavlink_map[number]
        values = dict(zip(kind.ordered_fieldnames, map(self._value, LAYOUTS[number]), strict=True))
        if "target_system" in values:
            values["target_system"], values["target_component"] = 1, self._random.choice((0, 195, 195))
        codes = zip(LAYOUTS[number], kind.ordered_fieldnames, strict=True)
        payload = b"".join(struct.pack("<" + code, values[name]) for code, name in codes)
        frame = self._frame(number, payload, AUTOPILOT if self._random.random() < 0.8 else self._anyone())
        return frame * self._random.choice((1, 1, 1, 5))

    def _track(self):
        """One of ten thousand vehicles, mostly where one may be, now and then nowhere."""
        pick = self._random
        identity = pick.randrange(NUM_TRACKS)
        self.identities.add(identity)
        latitude = LATITUDE_E7 + pick.randint(-NEAR_E7, NEAR_E7)
        longitude = LONGITUDE_E7 + pick.randint(-NEAR_E7, NEAR_E7)
        if pick.random() < 0.1:
            latitude, longitude = self._value("i"), self._value("i")
        altitude_mm = pick.choice((600_000, 700_000, self._value("i")))
        speed, course = pick.randrange(5_000), pick.randrange(36_000)
        if pick.random() < 0.2:
            message = mavlink.MAVLink_ais_vessel_message(
                identity + 1, latitude, longitude, course, 0, speed, 0, 0, 0, 0, 0, 0, 0, b"", b"",
                pick.randrange(200), 0x0F,
            )  # fmt: skip
        else:
            message = mavlink.MAVLink_adsb_vehicle_message(
                identity, latitude, longitude, 0, altitude_mm, course, speed, 0, b"", pick.randrange(20),
                pick.randrange(70), pick.choice((0x0F, pick.randrange(1 << 16))), 0,
            )  # fmt: skip
        writer = mavlink.MAVLink(None, *self._anyone())
        whole = bytes(message.pack(writer))
        self._real.append(whole)
        return whole

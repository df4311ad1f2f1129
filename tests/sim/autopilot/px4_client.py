"""A client of the simulated PX4: missions with landings, and the extension fields of its messages."""

from __future__ import annotations

import math

from companion.types.events import Dialect
from sim.simulator import Simulator
from tests.sim.client import LOITER, TAKEOFF, WAYPOINT, Client, item, plain_mission

INT = 6
LAND, TO_ALT, LAND_START = 21, 31, 189
ACCEPTED, ERROR, UNSUPPORTED_FRAME, UNSUPPORTED, NO_SPACE = 0, 1, 2, 3, 4
CANCELLED = 15
NAN = math.nan
AHEAD, SECOND, THIRD = (600.0, 0.0), (1200.0, 300.0), (1800.0, 0.0)


def landing() -> list:
    """A pattern and a landing 1 km north of home: 60 m of height over some 990 m, 3.5 degrees."""
    return [
        item(LAND_START, 0.0, 0.0, 0.0, frame=2) | {"is_bare": True},
        item(TO_ALT, 0.0, 1000.0, 60.0, frame=INT, p1=1.0, p2=100.0, p4=1.0),
        item(LAND, 0.0, 0.0, 0.0, frame=INT, p4=NAN),
    ]


def px4_route(*places, current=None, loiter=None, tail=None) -> list:
    """Takeoff, waypoints, perhaps a loiter, and a landing; the flag on item ``current``."""
    items = [item(TAKEOFF, 0.0, 0.0, frame=INT, p4=NAN)]
    items += [item(WAYPOINT, east, north, frame=INT, p4=NAN) for east, north in places]
    if loiter is not None:
        items.append(item(LOITER, *loiter, frame=INT, p3=125.0, p4=NAN))
    items += landing() if tail is None else tail
    if current is not None:
        items[current] = items[current] | {"current": 1}
    return items


class Px4Client(Client):
    """Bare items are sent without a place; ids are read from the raw payload."""

    def __init__(self, simulator=None, system=1, component=195):
        super().__init__(
            simulator or Simulator(plain_mission(), seed=1, dialect=Dialect.PX4), system, component
        )

    def depart(self) -> None:
        """Fly to item 1 of a mission of its own, 600 m ahead."""
        assert self.upload(px4_route(AHEAD, SECOND, THIRD, current=1)) == ACCEPTED
        self.step(0.2)

    def item_message(self, sequence, entry, kind=0):
        message = super().item_message(sequence, entry, kind)
        if entry.get("is_bare"):
            message.x = message.y = 0
        return message

    @property
    def autopilot(self):
        return self.simulator.autopilot

    def opaque_id(self) -> int:
        """Of the last MISSION_ACK."""
        return extension_of(self.all("MISSION_ACK")[-1], 4)

    def told(self):
        """The next MISSION_CURRENT, and its mission_id."""
        self.clear()
        message = self.wait("MISSION_CURRENT", 1.5)
        return message, extension_of(message, 6)


def extension_of(message, offset: int) -> int:
    """A 32-bit extension field behind the payload that the dialect knows."""
    frame = bytes(message.get_msgbuf())
    payload = frame[10 : 10 + frame[1]].ljust(offset + 4, b"\0")
    return int.from_bytes(payload[offset : offset + 4], "little")

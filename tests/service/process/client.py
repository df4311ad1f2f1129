"""A second client of the simulator's, which looks at what the autopilot holds."""

import socket
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.mission import MissionItem

PATIENCE_S = 30.0


def connected(port):
    """A connection, as soon as somebody listens."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


class Client:
    """MAVLink over TCP, from another component."""

    def __init__(self, port, component=190):
        self._line = connected(port)
        self._line.settimeout(PATIENCE_S)
        self._mavlink = mavlink.MAVLink(None, srcSystem=255, srcComponent=component)
        self._mavlink.robust_parsing = True
        self._waiting = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._line.close()

    def send(self, message):
        self._line.sendall(message.pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256

    def hear(self, kind, is_it=lambda message: True):
        """The next message of a kind; raises when none comes."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            while self._waiting:
                message = self._waiting.pop(0)
                if message.get_type() == kind and is_it(message):
                    return message
            self._waiting += self._mavlink.parse_buffer(self._line.recv(4096)) or []
        raise TimeoutError(kind)

    def current(self):
        """Sequence of the item that is flown."""
        return self.hear("MISSION_CURRENT").seq

    def mission(self):
        """The autopilot's list."""
        self.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
        count = self.hear("MISSION_COUNT").count
        items = []
        for number in range(count):
            self.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, 0))
            item = self.hear("MISSION_ITEM_INT", lambda message, number=number: message.seq == number)
            items.append(
                MissionItem(
                    item.seq, item.command, item.frame,
                    (item.param1, item.param2, item.param3, item.param4), item.x, item.y, item.z,
                )
            )  # fmt: skip
        self.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
        return tuple(items)

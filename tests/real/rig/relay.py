"""What stands between the autopilot and the service: it records every frame, and may lose some."""

import random
import select
import socket
import struct
import threading
import time

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
SIGNED = 1


class Tlog:
    """Frames with their times, as ground stations keep them."""

    def __init__(self, path):
        self._file = path.open("wb")
        self._lock = threading.Lock()

    def write(self, frame, stamp_s=None):
        stamp = time.time() if stamp_s is None else stamp_s
        with self._lock:
            if not self._file.closed:
                self._file.write(struct.pack(">Q", int(1e6 * stamp)) + bytes(frame))

    def close(self):
        with self._lock:
            self._file.close()


class Framer:
    """Cuts a stream of bytes into MAVLink frames; what is none is passed over."""

    def __init__(self):
        self._rest = b""

    def frames(self, data):
        """Whole frames so far."""
        self._rest += data
        found, rest = [], self._rest
        while rest:
            if rest[0] not in (MAGIC_1, MAGIC_2):
                rest = rest[1:]
                continue
            if len(rest) < 3:
                break
            length = rest[1] + (8 if rest[0] == MAGIC_1 else 12 + 13 * (rest[2] & SIGNED))
            if len(rest) < length:
                break
            found.append(rest[:length])
            rest = rest[length:]
        self._rest = rest
        return found


class Relay(threading.Thread):
    """Passes frames on between the autopilot's port and the service's, losing a share of them.

    Parameters
    ----------
    autopilot_port : int
        To which the autopilot sends.
    service_port : int
        On which the service listens.
    tlog : Tlog
        Gets what is passed on, both ways.
    loss : float
        Share of the frames that is lost, each way.
    seed : int
        Which are lost.
    """

    def __init__(self, autopilot_port, service_port, tlog, *, loss=0.0, seed=0):
        super().__init__(name="relay", daemon=True)
        self._outer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outer.bind(("127.0.0.1", autopilot_port))
        self._inner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._inner.bind(("127.0.0.1", 0))
        self._service = ("127.0.0.1", service_port)
        self._autopilot = None
        self._tlog, self._loss, self._chance = tlog, loss, random.Random(seed)
        self._framers = {self._outer: Framer(), self._inner: Framer()}
        self._is_ending = False
        self.num_passed = self.num_lost = 0

    def run(self):
        while not self._is_ending:
            ready, _, _ = select.select([self._outer, self._inner], [], [], 0.2)
            for source in ready:
                try:
                    data, address = source.recvfrom(65_535)
                except OSError:
                    continue
                self._pass(source, data, address)

    def _pass(self, source, data, address):
        """Pass on what has come from one side."""
        if source is self._outer:
            self._autopilot = address
        target = (self._inner, self._service) if source is self._outer else (self._outer, self._autopilot)
        for frame in self._framers[source].frames(data):
            if self._chance.random() < self._loss:
                self.num_lost += 1
            elif target[1] is not None:
                self.num_passed += 1
                self._tlog.write(frame)
                target[0].sendto(frame, target[1])

    def end(self):
        self._is_ending = True
        self.join(2.0)
        self._outer.close()
        self._inner.close()

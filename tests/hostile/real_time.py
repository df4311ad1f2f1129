"""A flight in the computer's own time on loopback, and an attacker beside it.

Three processes: the simulator, the service (``companion run`` on ``udpin``) and this one, which passes the
datagrams of the first two on to each other, sees what the service says, and attacks from addresses of
its own.
"""

import contextlib
import itertools
import os
import selectors
import signal
import socket
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import RecordError
from companion.link.messages.codec import signer_of
from companion.link.wire.framing import frames_in, raw_frame
from companion.link.wire.signing import Timestamps
from companion.recording import mcap_schema
from tests.service.process.processes import FIRST_FLIGHT, Manager, free_port, process
from tests.support.messages import read_messages

OURS = (1, 195)
PATIENCE_S = 600.0
FRAMES_A_DATAGRAM = 20
MEBIBYTE = 2.0**20


def resident_mib(process_id):
    pages = Path(f"/proc/{process_id}/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE") / MEBIBYTE


@dataclass
class Heard:
    """What the service said."""

    heartbeats_s: list = field(default_factory=list)
    texts: list = field(default_factory=list)
    counts: Counter = field(default_factory=Counter)

    def gaps_s(self, begin_s, end_s):
        """Times between heartbeats, from one instant to another, both of which count as one."""
        stamps = [begin_s, *(stamp for stamp in self.heartbeats_s if begin_s < stamp < end_s), end_s]
        return [later - earlier for earlier, later in itertools.pairwise(stamps)]


class Relay(threading.Thread):
    """Passes datagrams on between the simulator and the service; with a signer, signs for the simulator."""

    def __init__(self, service_port, signer=None):
        super().__init__(daemon=True)
        self.heard = Heard()
        self._signer = signer
        self._service = ("127.0.0.1", service_port)
        self.outer, self.inner = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        for line in (self.outer, self.inner):
            line.bind(("127.0.0.1", 0))
        self.port = self.outer.getsockname()[1]
        self._simulator = None
        self._is_over = False

    def run(self):
        with selectors.DefaultSelector() as ready:
            ready.register(self.outer, selectors.EVENT_READ)
            ready.register(self.inner, selectors.EVENT_READ)
            while not self._is_over:
                for key, _ in ready.select(0.1):
                    self._pass_on(key.fileobj)

    def _pass_on(self, line):
        data, sender = line.recvfrom(65_536)
        if line is self.outer:
            self._simulator = sender
            self.inner.sendto(data if self._signer is None else self._signer.signed(data), self._service)
            return
        for raw in frames_in(data):
            self._note(raw)
        if self._simulator is not None:
            self.outer.sendto(data, self._simulator)

    def _note(self, raw):
        frame = raw_frame(raw)
        if (frame.system_id, frame.component_id) != OURS:
            return
        self.heard.counts[frame.message_id] += 1
        if frame.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self.heard.heartbeats_s.append(time.monotonic())
        elif frame.message_id == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            text = frame.payload[1:51].split(b"\0")[0].decode("ascii", "replace")
            self.heard.texts.append((time.monotonic(), text))

    def end(self):
        self._is_over = True
        self.join(2.0)
        self.outer.close()
        self.inner.close()


class Attacker:
    """Sends to the service from an address of its own."""

    def __init__(self, port):
        self._to = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))

    def send(self, data):
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            self.socket.sendto(data, self._to)

    def flood(self, portions, rate_hz, until_s):
        """Send portions one after the other, so many a second, until an instant."""
        began, sent = time.monotonic(), 0
        while (now := time.monotonic()) < until_s:
            for _ in range(max(0, round((now - began) * rate_hz) - sent)):
                self.send(next(portions))
                sent += 1
            time.sleep(2e-3)
        return sent

    def close(self):
        self.socket.close()


def datagrams(message_of, *, system=77, component=1):
    """Endless datagrams of twenty messages each; ``message_of`` takes a running number."""
    writer, numbers = mavlink.MAVLink(None, srcSystem=system, srcComponent=component), itertools.count()
    while True:
        yield b"".join(bytes(message_of(next(numbers)).pack(writer)) for _ in range(FRAMES_A_DATAGRAM))


def signed_mission(folder, mission, key):
    """The mission file, with a key beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    key_file, file = folder / "key", folder / "signed.yaml"
    key_file.write_bytes(key)
    key_file.chmod(0o600)
    file.write_text(
        Path(mission).read_text(encoding="utf-8") + f"\nlink: {{signing: {{key_file: {key_file}}}}}\n",
        encoding="utf-8",
    )
    return file


class Bench:
    """The three of them; a context.

    ``key`` signs both ways; ``before`` is what an attacker does before the aircraft is switched on.
    """

    def __init__(self, folder, mission=FIRST_FLIGHT, *, key=None, before=lambda attacker: None):
        self.port = free_port(socket.SOCK_DGRAM)
        self.folder = folder
        self.said = ""
        self.exit_code = None
        self.ended_in_s = None
        self._mission = mission if key is None else signed_mission(Path(folder), mission, key)
        self._signer = None if key is None else signer_of(key, 1, Timestamps(None, time.time))
        self._before = before
        self._parts = contextlib.ExitStack()

    def __enter__(self):
        self.relay = Relay(self.port, self._signer)
        self.relay.start()
        self._parts.callback(self.relay.end)
        self.manager = Manager()
        self._parts.callback(self.manager.close)
        self.service = self._parts.enter_context(
            process(
                "-m", "companion", "run", self._mission, "--link", f"udpin://127.0.0.1:{self.port}",
                "--record", self.folder, environment=self.manager.environment,
            )
        )  # fmt: skip
        self._said = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        # Warm first, and an aircraft in the air then: kernels may have to be compiled.
        self.manager.hear_until(lambda words: "waiting for the first" in words.get("STATUS", ""))
        self._before(self.attacker())
        self._parts.enter_context(
            process("-m", "sim", self._mission, "--listen", f"udpout://127.0.0.1:{self.relay.port}")
        )
        self.manager.hear_until(lambda words: "READY" in words)
        self.begun_s = time.monotonic()
        return self

    def _read(self):
        with self.service.stdout as lines:
            self._said.extend(lines)

    def __exit__(self, *_):
        if self.service.poll() is None:
            self.service.kill()
        self._reader.join()
        self._parts.close()

    @property
    def heard(self):
        return self.relay.heard

    def attacker(self):
        attacker = Attacker(self.port)
        self._parts.callback(attacker.close)
        return attacker

    def until(self, after_s):
        """Let time pass, up to so long after the service became ready."""
        time.sleep(max(0.0, self.begun_s + after_s - time.monotonic()))

    def stop(self):
        """SIGTERM; how long it took to obey [s]."""
        began = time.monotonic()
        self.service.send_signal(signal.SIGTERM)
        self.exit_code = self.service.wait(PATIENCE_S)
        self.ended_in_s = time.monotonic() - began
        self._reader.join()
        self.said = "".join(self._said)
        return self.ended_in_s

    def memory_mib(self):
        return resident_mib(self.service.pid)

    def documents(self, topic):
        """What the service wrote down, after its end."""
        found = []
        for file in sorted(Path(self.folder).glob("*/*.mcap")):
            with contextlib.suppress(RecordError):
                found += read_messages(file, Counter()).get(topic, [])
        return found

    def lateness_s(self):
        """How long after it was due each plan was begun [s]."""
        plans = self.documents(mcap_schema.PLAN)
        return [plan["seen_s"] - plan["due_s"] for plan in plans if plan.get("due_s") is not None]

    def decisions(self):
        return [(entry["kind"], entry["text"]) for entry in self.documents(mcap_schema.DECISION)]

"""The service and the simulator as processes of their own, and the service manager they would have."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from tests.sim.client import CONFIGS

FIRST_FLIGHT = CONFIGS / "first-flight.yaml"
ROOT = Path(__file__).parents[3]
PATIENCE_S = 300.0  # kernels may have to be compiled; only what has failed takes so long


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Manager:
    """The end of the notify socket that systemd has."""

    def __init__(self, folder=None, *, watchdog_s=60.0):
        self.words = []
        self.watchdog_s = watchdog_s
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        name = f"companion-{os.getpid()}-{id(self)}"
        self.address = f"@{name}" if folder is None else str(folder / "notify")
        self._socket.bind("\0" + name if folder is None else self.address)

    @property
    def environment(self):
        return {"NOTIFY_SOCKET": self.address, "WATCHDOG_USEC": str(int(self.watchdog_s * 1e6))}

    def hear(self, within_s=PATIENCE_S):
        """The next message as a dict; None if none comes in time."""
        self._socket.settimeout(within_s)
        try:
            message = self._socket.recv(4096).decode()
        except TimeoutError:
            return None
        words = dict(line.split("=", 1) for line in message.splitlines())
        self.words.append(words)
        return words

    def hear_until(self, is_it):
        end_s = time.monotonic() + PATIENCE_S
        while (left_s := end_s - time.monotonic()) > 0.0 and (words := self.hear(left_s)) is not None:
            if is_it(words):
                return words
        raise AssertionError(f"never said; last: {self.words[-3:]}")

    def rest(self):
        """What is still to be read once the process has ended."""
        while self.hear(0.001) is not None:
            pass
        return self.words

    def close(self):
        self._socket.close()


@contextlib.contextmanager
def process(*arguments, environment=None, **options):
    """A process that is ended, whatever happens."""
    running = subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200", **(environment or {})},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT, **options,
    )  # fmt: skip
    try:
        yield running
    finally:
        if running.poll() is None:
            running.kill()
        if running.stdout.closed:  # by a thread that read it
            running.wait()
        else:
            running.communicate()


def simulator(port, mission=FIRST_FLIGHT, speed=4.0, *more):
    return process(
        "-m", "sim", mission, "--listen", f"tcp://127.0.0.1:{port}", "--speed", speed, *more,
    )  # fmt: skip


def service(port, flights, *more, mission=FIRST_FLIGHT, environment=None, before=""):
    """``companion run``; ``before`` is code that runs in its process first."""
    start = f"{before}\nfrom companion.cli import main\nmain()"
    return process(
        "-c", start, "run", mission, "--link", f"tcp://127.0.0.1:{port}", "--record", flights, *more,
        environment=environment,
    )  # fmt: skip


def ended(running, number=signal.SIGTERM):
    """Send a signal; the exit code and everything it said."""
    running.send_signal(number)
    said, _ = running.communicate(timeout=PATIENCE_S)
    return running.returncode, said

"""What the service manager is told: ready, alive, stopping, and in words what is being done.

A datagram of ``KEY=value`` lines to the socket that ``NOTIFY_SOCKET`` names. Without one, nobody
asks, and nothing is sent. A manager that does not read loses messages; the flight does not wait for it.

References
----------
systemd, *sd_notify(3)* and *sd_watchdog_enabled(3)*.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import time
from collections.abc import Mapping

_log = logging.getLogger(__name__)


class Notifier:
    """Sends to a service manager.

    Parameters
    ----------
    address : str
        Address of systemd's socket: a path, or ``@`` and a name in the abstract namespace; empty for none.
    """

    def __init__(self, address: str = "") -> None:
        self._socket: socket.socket | None = None
        if not address:
            return
        target = "\0" + address[1:] if address.startswith("@") else address
        opened = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        opened.setblocking(False)
        try:
            opened.connect(target)
        except OSError as error:
            _log.warning("the service manager is not told anything: %s: %s", address, error)
            opened.close()
        else:
            self._socket = opened

    @property
    def is_heard(self) -> bool:
        """Whether there is somebody to tell."""
        return self._socket is not None

    def tell(self, **words: str | int) -> None:
        """Send one message, for instance ``READY=1``; line breaks in values become spaces."""
        if self._socket is None:
            return
        lines = "\n".join(f"{key}={' '.join(str(value).splitlines())}" for key, value in words.items())
        try:
            self._socket.send(lines.encode())
        except OSError as error:
            _log.debug("the service manager did not take %r: %s", lines, error)

    def reloading(self) -> None:
        """Say that a reload begins; it ends with ``READY=1``."""
        self.tell(RELOADING=1, MONOTONIC_USEC=time.monotonic_ns() // 1000)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
            self._socket = None


def watchdog_of(environment: Mapping[str, str]) -> float | None:
    """Seconds within which the manager wants to hear from this process; None if it does not watch it."""
    try:
        microseconds = int(environment.get("WATCHDOG_USEC", "0"))
        process = int(environment.get("WATCHDOG_PID", str(os.getpid())))
    except ValueError:
        return None
    return microseconds * 1e-6 if microseconds > 0 and process == os.getpid() else None

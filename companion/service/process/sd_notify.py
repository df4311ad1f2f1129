"""Notifications to the service manager: ready, alive, stopping, and a status text.

A notification is a datagram of ``KEY=value`` lines to the socket in ``NOTIFY_SOCKET``. Without one, nothing
is sent. If the manager does not read, messages are lost; the flight does not wait.

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
    """Sends notifications to a service manager.

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

    def tell(self, **words: str | int) -> None:
        """Send one notification, for instance ``READY=1``; line breaks in values become spaces."""
        if self._socket is None:
            return
        lines = "\n".join(f"{key}={' '.join(str(value).splitlines())}" for key, value in words.items())
        try:
            self._socket.send(lines.encode())
        except OSError as error:
            _log.debug("the service manager did not take %r: %s", lines, error)

    def reloading(self) -> None:
        """Report the start of a reload, which ends with ``READY=1``."""
        self.tell(RELOADING=1, MONOTONIC_USEC=time.monotonic_ns() // 1000)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
            self._socket = None


def watchdog_of(environment: Mapping[str, str]) -> float | None:
    """Return the manager's watchdog time for this process [s]; None without a watchdog."""
    try:
        microseconds = int(environment.get("WATCHDOG_USEC", "0"))
        process = int(environment.get("WATCHDOG_PID", str(os.getpid())))
    except ValueError:
        return None
    return microseconds * 1e-6 if microseconds > 0 and process == os.getpid() else None

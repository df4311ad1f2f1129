"""Supervision of the planning loop: reports readiness, progress and status to the service manager.

Theory of operation. The planning loop calls :meth:`Supervision.progress` in each iteration, before and after
each plan, and with each message of a mission transfer. Nothing else feeds the watchdog. A planner that does
not return, a transfer that does not end, and an event loop that hangs all stop the calls; the service manager
then restarts the process while the autopilot flies on. Without anything to plan, the iterations continue.

Before the service is ready, each iteration asks for more time for the start, since kernels may have to be
compiled, and the autopilot may have no power yet. Compiling has a time limit; waiting for the autopilot has
none. Readiness is reported as soon as it is reached, not in the next iteration. The manager begins to
supervise then, so that this report cannot hide a planning loop that hangs.
"""

from __future__ import annotations

import contextlib
import faulthandler
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.clock import Clock
from companion.safe_files import open_to_write
from companion.service.process.sd_notify import Notifier

CRASH_LOG = "crash.log"
NOTIFY_INTERVAL_S = 1.0  # Interval of messages to the manager; shorter if its watchdog requires it.
EXTENSION_S = 30.0  # Each extension of the start's time limit.
WARM_UP_MAX_S = 1_800.0  # Compiling takes a minute or two on a fast computer, about ten on a small one.
STALL_S = 60.0  # Without a watchdog, the loop counts as stalled after this time without progress.


@dataclass(frozen=True, slots=True)
class Report:
    """The present state of the service.

    Parameters
    ----------
    is_warm : bool
        True if the kernels are compiled.
    knows_autopilot : bool
        True if an autopilot has been received; its next heartbeat may still have to confirm it.
    mode : str
        What the service may do, and the autopilot's mode.
    last_decision : str
        Last decision; '' before the first one.
    """

    is_warm: bool
    knows_autopilot: bool
    mode: str
    last_decision: str = ""

    @property
    def is_ready(self) -> bool:
        """Whether the service can plan for an autopilot that is present."""
        return self.is_warm and self.knows_autopilot

    def __str__(self) -> str:
        if not self.is_warm:
            return "loading or compiling the planner's kernels"
        if not self.knows_autopilot:
            return "waiting for the first heartbeat of an autopilot"
        return f"{self.mode}; last: {self.last_decision}" if self.last_decision else self.mode


class Supervision:
    """Reports to the service manager.

    Parameters
    ----------
    notifier : Notifier
        Sends the messages.
    clock : Clock
        Clock that limits their rate.
    report : callable
        Returns the present state of the service.
    watchdog_s : float, optional
        Time within which the manager requires progress.
    """

    def __init__(
        self,
        notifier: Notifier,
        clock: Clock,
        report: Callable[[], Report],
        watchdog_s: float | None = None,
    ) -> None:
        self.is_ready = False
        self.progress_s = self._begun_s = clock.now_s()
        self._notifier = notifier
        self._clock = clock
        self._report = report
        self._stall_s = watchdog_s or STALL_S
        self._notify_interval_s = min(NOTIFY_INTERVAL_S, self._stall_s / 4.0)
        self._notified_s = -math.inf
        self._status = ""
        self._is_leaving = False

    def leave(self) -> None:
        """Report that the service stops, and nothing afterwards."""
        self._is_leaving = True
        self._notifier.tell(STOPPING=1, STATUS="leaving the autopilot with its mission")

    def progress(self) -> None:
        """Record an iteration of the planning loop."""
        now = self._clock.now_s()
        self.progress_s = now
        if now - self._notified_s < self._notify_interval_s:
            self.note_ready()  # It is reported before the next plan.
        elif not self._is_leaving:
            self._tell(self._report(), now)

    def note_ready(self) -> None:
        """Report that the service has become ready, if it has."""
        report = self._report()
        if report.is_ready and not self.is_ready and not self._is_leaving:
            self._tell(report, self._clock.now_s())

    def _tell(self, report: Report, now: float) -> None:
        self._notified_s = now
        words: dict[str, str | int] = {}
        if report.is_ready and not self.is_ready:
            self.is_ready = True
            words["READY"] = 1
        if self.is_ready:
            words["WATCHDOG"] = 1
        elif report.is_warm or now - self._begun_s < WARM_UP_MAX_S:
            words["EXTEND_TIMEOUT_USEC"] = int(EXTENSION_S * 1e6)
        if str(report) != self._status:
            self._status = words["STATUS"] = str(report)
        if words:
            self._notifier.tell(**words)

    @property
    def is_stalled(self) -> bool:
        """Whether the planning loop has made no progress for too long."""
        return self._clock.now_s() - self.progress_s > self._stall_s

    @property
    def status(self) -> str:
        """Last status that was reported."""
        return self._status


@contextlib.contextmanager
def stacks_logged(folder: Path | None) -> Iterator[None]:
    """Write the stacks of all threads when the watchdog ends the process, or it crashes."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # The disk is full, or the folder is not writable.
            log = None if folder is None else open_to_write(folder / CRASH_LOG, append=True)
            faulthandler.enable(sys.stderr if log is None else stack.enter_context(log))
        stack.callback(faulthandler.disable)
        yield

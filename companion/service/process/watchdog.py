"""From the planning loop's rounds to what supervisors see: ready, alive, and what is awaited.

Theory of operation. The planning loop calls :meth:`Supervision.progress` in each of its rounds, before
and after each plan, and with each message of a mission exchange. Nothing else feeds the watchdog: a
planner that does not return, an exchange that does not end and an event loop that stands still all
end the calls, and the service manager restarts the process while the autopilot flies on. With
nothing to plan, the rounds go on.

Before the service is ready, each round asks for a little more time to start in: kernels may have to be
compiled, and the autopilot may not have power yet. Compiling has a limit, waiting for the autopilot none.
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
TELL_S = 1.0  # between two words to the manager; sooner where its watchdog wants it
EXTENSION_S = 30.0  # of the time to start in
WARM_UP_MAX_S = 1_800.0  # compiling takes a minute or two on a fast computer, some ten on a small one
STALL_S = 60.0  # without progress, and no watchdog to say otherwise


@dataclass(frozen=True, slots=True)
class Report:
    """What the service does now.

    Parameters
    ----------
    is_warm : bool
        Whether the kernels are compiled.
    has_heard : bool
        Whether the autopilot has been heard.
    mode : str
        What the service may do, and the autopilot's mode.
    last_decision : str
        '' before the first.
    """

    is_warm: bool
    has_heard: bool
    mode: str
    last_decision: str = ""

    @property
    def is_ready(self) -> bool:
        """Whether it can plan for an autopilot that is there."""
        return self.is_warm and self.has_heard

    def __str__(self) -> str:
        if not self.is_warm:
            return "loading or compiling the planner's kernels"
        if not self.has_heard:
            return "waiting for the first heartbeat of an autopilot"
        return f"{self.mode}; last: {self.last_decision}" if self.last_decision else self.mode


class Supervision:
    """Tells the service manager how it goes.

    Parameters
    ----------
    notifier : Notifier
        Takes the messages.
    clock : Clock
        Bounds their rate.
    report : callable
        What the service does now.
    watchdog_s : float, optional
        Time within which the manager wants to hear of progress.
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
        self._tell_s = min(TELL_S, self._stall_s / 4.0)
        self._told_s = -math.inf
        self._status = ""
        self._is_leaving = False

    def leave(self) -> None:
        """Tell the manager that the service stops; from now on nothing else is told."""
        self._is_leaving = True
        self._notifier.tell(STOPPING=1, STATUS="leaving the autopilot with its mission")

    def progress(self) -> None:
        """Take note that the planning loop has come round."""
        now = self._clock.now_s()
        self.progress_s = now
        if self._is_leaving:
            return
        report = self._report()
        has_become_ready = not self.is_ready and report.is_ready  # told before the plan that follows
        if now - self._told_s < self._tell_s and not has_become_ready:
            return
        self._told_s = now
        words: dict[str, str | int] = {}
        if has_become_ready:
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
        """Whether the planning loop has not come round for too long."""
        return self._clock.now_s() - self.progress_s > self._stall_s

    @property
    def status(self) -> str:
        """What was told last, in words."""
        return self._status


@contextlib.contextmanager
def stacks_told(folder: Path | None) -> Iterator[None]:
    """Tell the stacks of all threads when the watchdog ends the process, or it crashes."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # a full disk, or nothing to write to
            log = None if folder is None else open_to_write(folder / CRASH_LOG, append=True)
            faulthandler.enable(sys.stderr if log is None else stack.enter_context(log))
        stack.callback(faulthandler.disable)
        yield

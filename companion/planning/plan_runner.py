"""Runners that decide when a plan begins and ends: in step with a simulation, in a thread, or as recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from companion.clock import Clock
from companion.errors import CompanionError

POLL_S = 0.2  # Period with which it is checked whether a plan is due.
NEAR_S = 2.0


class PlanBrokenOffError(CompanionError):
    """The plan is not needed any more; the message says why."""


class StopRule:
    """A stopping rule that counts its questions; after the first yes the answer stays yes.

    Parameters
    ----------
    is_over : callable
        Returns whether to stop, by the number of the question.

    Attributes
    ----------
    asked : int
        Number of questions.
    is_stopped : bool
        Whether the answer was yes.
    is_broken_off : bool
        Whether the plan is not needed any more.
    """

    def __init__(self, is_over: Callable[[int], bool]) -> None:
        self.asked = 0
        self.is_stopped = False
        self.is_broken_off = False
        self._is_over = is_over

    def break_off(self) -> None:
        """Stop at the next question."""
        self.is_broken_off = True

    def __call__(self) -> bool:
        """Return whether to stop."""
        if not self.is_stopped:
            self.asked += 1
            self.is_stopped = self.is_broken_off or self._is_over(self.asked)
        return self.is_stopped


@dataclass(frozen=True, slots=True)
class PlanTiming:
    """The timing of one plan.

    Parameters
    ----------
    rule : StopRule
        When the search ends.
    is_threaded : bool
        Whether the search runs in a thread of its own; otherwise it runs in the event loop.
    until_s : float or None
        The clock's reading at which the plan counts as complete [s]; None if that is when the search ends.
    was_broken_off : bool or None
        Whether the plan was broken off in the replayed flight; None if this is no replay.
    """

    rule: StopRule
    is_threaded: bool = False
    until_s: float | None = None
    was_broken_off: bool | None = None

    @property
    def is_broken_off(self) -> bool:
        """Whether the result of the plan is not needed any more."""
        return self.rule.is_broken_off if self.was_broken_off is None else self.was_broken_off


class PlanRunner(Protocol):
    """Decides when plans begin, and their timing."""

    def next_look_s(self, now_s: float) -> float:
        """Return when to check next whether a plan is due [s]."""
        ...

    async def until_begun(self, clock: Clock, number: int, /) -> None:
        """Wait until the plan with this number begins."""
        ...

    def timing(self, clock: Clock, budget_s: float, number: int, /) -> PlanTiming:
        """Return the timing of the plan with this number, which begins now and has a budget [s]."""
        ...


def _never(_asked: int) -> bool:
    """Never stop: the iteration budget ends the search."""
    return False


class _LiveRunner:
    """Plans begin as soon as they are due."""

    def next_look_s(self, now_s: float) -> float:
        """Check again after a short time."""
        return now_s + POLL_S

    async def until_begun(self, _clock: Clock, _number: int, /) -> None:
        """Begin at once."""


class InlineRunner(_LiveRunner):
    """Runs plans in the event loop up to the iteration budget; by the clock, each takes its whole budget."""

    def timing(self, clock: Clock, budget_s: float, _number: int, /) -> PlanTiming:
        """Let the search end by its iteration budget, however long the computer takes."""
        return PlanTiming(StopRule(_never), until_s=clock.now_s() + budget_s)


class ThreadRunner(_LiveRunner):
    """Runs plans in a thread until their budget is spent by the clock."""

    def timing(self, clock: Clock, budget_s: float, _number: int, /) -> PlanTiming:
        """Stop the search at the deadline."""
        due_s = clock.now_s() + budget_s
        return PlanTiming(StopRule(lambda _asked: clock.now_s() >= due_s), is_threaded=True)


@dataclass(frozen=True, slots=True)
class RecordedPlanTiming:
    """The timing of a recorded plan.

    Parameters
    ----------
    stopped_at : int or None
        Number of the question whose answer was to stop; None if there was none.
    took_s : float
        Duration by the clock [s].
    due_s, seen_s : float or None
        When the plan was found to be due, and when the snapshot of its world was taken.
    is_broken_off : bool
        Whether the plan was broken off.
    """

    stopped_at: int | None
    took_s: float
    due_s: float | None = None
    seen_s: float | None = None
    is_broken_off: bool = False


class RecordedRunner:
    """Runs plans in the event loop; each stops, and ends by the clock, as the recorded one did.

    Parameters
    ----------
    taken : mapping
        Recorded timings by the plan's number; a plan that was not recorded runs as in a simulation.
    """

    def __init__(self, taken: Mapping[int, RecordedPlanTiming]) -> None:
        self._taken = taken

    def next_look_s(self, now_s: float) -> float:
        """Check again after a short time, or when a recorded plan was due."""
        due = [entry.due_s for entry in self._taken.values() if entry.due_s is not None]
        return min([now_s + POLL_S, *(at for at in due if at > now_s)])

    async def until_begun(self, clock: Clock, number: int, /) -> None:
        """Begin when the recorded plan began, unless that is far off: then it is another plan."""
        taken = self._taken.get(number)
        seen_s = None if taken is None else taken.seen_s
        if seen_s is not None and 0.0 < seen_s - clock.now_s() < NEAR_S:
            await clock.sleep_until(seen_s)

    def timing(self, clock: Clock, budget_s: float, number: int, /) -> PlanTiming:
        """Return the timing that the plan had in flight."""
        timing = self._taken.get(number)
        if timing is None:
            return PlanTiming(StopRule(_never), until_s=clock.now_s() + budget_s)
        last = timing.stopped_at
        rule = StopRule(_never if last is None else lambda asked: asked >= last)
        return PlanTiming(rule, False, clock.now_s() + timing.took_s, timing.is_broken_off)

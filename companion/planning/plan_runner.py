"""How long a plan may take, and by whose clock: in step with a simulation, in a thread, or as recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from companion.clock import Clock
from companion.errors import CompanionError

POLL_S = 0.2  # Time between two looks at whether a plan is due.
NEAR_S = 2.0


class PlanBrokenOffError(CompanionError):
    """Nobody wants the plan any more; the message says why."""


class StopRule:
    """A stopping rule that counts how often it was asked; once it said so, it keeps to it.

    Parameters
    ----------
    is_over : callable
        Whether to stop, by the number of the question.

    Attributes
    ----------
    asked : int
        How often it was asked.
    is_stopped : bool
        Whether it said so.
    is_broken_off : bool
        Whether nobody wants the plan any more.
    """

    def __init__(self, is_over: Callable[[int], bool]) -> None:
        self.asked = 0
        self.is_stopped = False
        self.is_broken_off = False
        self._is_over = is_over

    def break_off(self) -> None:
        """Have it stop at the next question."""
        self.is_broken_off = True

    def __call__(self) -> bool:
        """Return whether to stop."""
        if not self.is_stopped:
            self.asked += 1
            self.is_stopped = self.is_broken_off or self._is_over(self.asked)
        return self.is_stopped


@dataclass(frozen=True, slots=True)
class PlanTiming:
    """How one plan is to be made.

    Parameters
    ----------
    rule : StopRule
        When the search ends.
    is_threaded : bool
        Whether it runs in a thread, parallel to everything else; else in the event loop.
    until_s : float or None
        The clock's reading at which the plan counts as made [s]; None for as soon as it is.
    was_broken_off : bool or None
        Whether it was, in the flight that is replayed; None where whoever wants may break it off.
    """

    rule: StopRule
    is_threaded: bool = False
    until_s: float | None = None
    was_broken_off: bool | None = None

    @property
    def is_broken_off(self) -> bool:
        """Whether nobody wants what comes of it."""
        return self.rule.is_broken_off if self.was_broken_off is None else self.was_broken_off


class PlanRunner(Protocol):
    """Says when plans are made, and how."""

    def next_look_s(self, now_s: float) -> float:
        """When to look next whether a plan is due."""
        ...

    async def until_begun(self, clock: Clock, number: int, /) -> None:
        """Wait until the plan of this number is to be made."""
        ...

    def timing(self, clock: Clock, budget_s: float, number: int, /) -> PlanTiming:
        """How the plan of this number, which begins now, is made within a budget of the clock's time."""
        ...


def _never(_asked: int) -> bool:
    """To the iteration budget."""
    return False


class _LiveRunner:
    """A plan is made once it is due."""

    def next_look_s(self, now_s: float) -> float:
        """After a short while."""
        return now_s + POLL_S

    async def until_begun(self, _clock: Clock, _number: int, /) -> None:
        """Begin at once."""


class InlineRunner(_LiveRunner):
    """In the event loop, to the iteration budget; the plan takes its budget of a clock that others move."""

    def timing(self, clock: Clock, budget_s: float, _number: int, /) -> PlanTiming:
        """However long the computer needs."""
        return PlanTiming(StopRule(_never), until_s=clock.now_s() + budget_s)


class ThreadRunner(_LiveRunner):
    """In a thread, until the clock says that the budget is spent."""

    def timing(self, clock: Clock, budget_s: float, _number: int, /) -> PlanTiming:
        """To its deadline."""
        due_s = clock.now_s() + budget_s
        return PlanTiming(StopRule(lambda _asked: clock.now_s() >= due_s), is_threaded=True)


@dataclass(frozen=True, slots=True)
class RecordedPlanTiming:
    """A recorded plan.

    Parameters
    ----------
    stopped_at : int or None
        The question at which it was asked to stop; None if it never was.
    took_s : float
        By the clock.
    due_s, seen_s : float or None
        When it was found to be due, and when the world was seen that it was made in.
    is_broken_off : bool
        Whether it was of no use any more before it was made.
    """

    stopped_at: int | None
    took_s: float
    due_s: float | None = None
    seen_s: float | None = None
    is_broken_off: bool = False


class RecordedRunner:
    """In the event loop, stopped where the recorded search was stopped, and as long by the clock.

    Parameters
    ----------
    taken : mapping
        By the plan's number; a plan that was not recorded is made as in a simulation.
    """

    def __init__(self, taken: Mapping[int, RecordedPlanTiming]) -> None:
        self._taken = taken

    def next_look_s(self, now_s: float) -> float:
        """After a short while, or when a plan was found to be due."""
        due = [entry.due_s for entry in self._taken.values() if entry.due_s is not None]
        return min([now_s + POLL_S, *(at for at in due if at > now_s)])

    async def until_begun(self, clock: Clock, number: int, /) -> None:
        """Begin when it was begun, unless that is far off: then it is another plan."""
        taken = self._taken.get(number)
        seen_s = None if taken is None else taken.seen_s
        if seen_s is not None and 0.0 < seen_s - clock.now_s() < NEAR_S:
            await clock.sleep_until(seen_s)

    def timing(self, clock: Clock, budget_s: float, number: int, /) -> PlanTiming:
        """As it was made in flight."""
        timing = self._taken.get(number)
        if timing is None:
            return PlanTiming(StopRule(_never), until_s=clock.now_s() + budget_s)
        last = timing.stopped_at
        rule = StopRule(_never if last is None else lambda asked: asked >= last)
        return PlanTiming(rule, False, clock.now_s() + timing.took_s, timing.is_broken_off)

"""How long a plan may take, and by whose clock: in step with a simulation, in a thread, or as recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

from companion.clock import Clock
from companion.threads import in_thread
from companion.types.plan import Plan

POLL_S = 0.2  # between looks at whether a plan is due
NEAR_S = 2.0

Request = TypeVar("Request")
Search = Callable[[Request, Callable[[], bool]], Plan]  # takes what is asked, and a stopping rule


@dataclass(frozen=True, slots=True)
class PlanRun:
    """A plan, and what it took.

    Parameters
    ----------
    plan : Plan
        The planner's answer.
    plan_ms : float
        Of the computer's time.
    asked : int
        How often the search asked whether to stop.
    is_stopped : bool
        Whether it was told to.
    """

    plan: Plan
    plan_ms: float
    asked: int
    is_stopped: bool


class PlanRunner(Protocol):
    """Says when plans are made, and runs the search."""

    def next_look_s(self, now_s: float) -> float:
        """When to look next whether a plan is due."""
        ...

    async def until_begun(self, clock: Clock, number: int, /) -> None:
        """Wait until the plan of this number is to be made."""
        ...

    async def run(
        self, search: Search[Request], request: Request, clock: Clock, budget_s: float, number: int, /
    ) -> PlanRun:
        """Run the search for the plan of this number within a budget of the clock's time."""
        ...


class _Rule:
    """A stopping rule that counts how often it was asked; once it said so, it keeps to it."""

    def __init__(self, is_over: Callable[[int], bool]) -> None:
        self.asked = 0
        self.is_stopped = False
        self._is_over = is_over

    def __call__(self) -> bool:
        if not self.is_stopped:
            self.asked += 1
            self.is_stopped = self._is_over(self.asked)
        return self.is_stopped


def _searched(search: Search[Request], request: Request, rule: _Rule) -> PlanRun:
    began = time.perf_counter()
    plan = search(request, rule)
    return PlanRun(plan, 1e3 * (time.perf_counter() - began), rule.asked, rule.is_stopped)


class _LiveRunner:
    """A plan is made once it is due."""

    def next_look_s(self, now_s: float) -> float:
        """After a short while."""
        return now_s + POLL_S

    async def until_begun(self, _clock: Clock, _number: int, /) -> None:
        """Begin at once."""


class InlineRunner(_LiveRunner):
    """In the event loop, to the iteration budget; the plan takes its budget of a clock that others move."""

    async def run(
        self, search: Search[Request], request: Request, clock: Clock, budget_s: float, _number: int, /
    ) -> PlanRun:
        """Run the search, however long the computer needs."""
        due = clock.now_s() + budget_s
        paced = _searched(search, request, _Rule(lambda _asked: False))
        await clock.sleep_until(due)
        return paced


class ThreadRunner(_LiveRunner):
    """In a thread, until the clock says that the budget is spent."""

    async def run(
        self, search: Search[Request], request: Request, clock: Clock, budget_s: float, _number: int, /
    ) -> PlanRun:
        """Run the search to its deadline."""
        due = clock.now_s() + budget_s
        return await in_thread(_searched, search, request, _Rule(lambda _asked: clock.now_s() >= due))


@dataclass(frozen=True, slots=True)
class RecordedPlanTiming:
    """A recorded plan.

    Parameters
    ----------
    stopped_at : int or None
        The question at which it was told to stop; None if it never was.
    took_s : float
        By the clock.
    due_s, seen_s : float or None
        When it was found to be due, and when the world was seen that it was made in.
    """

    stopped_at: int | None
    took_s: float
    due_s: float | None = None
    seen_s: float | None = None


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

    async def run(
        self, search: Search[Request], request: Request, clock: Clock, budget_s: float, number: int, /
    ) -> PlanRun:
        """Run the search as it was run in flight."""
        taken = self._taken.get(number, RecordedPlanTiming(None, budget_s))
        due = clock.now_s() + taken.took_s
        last = taken.stopped_at
        paced = _searched(search, request, _Rule(lambda asked: last is not None and asked >= last))
        await clock.sleep_until(due)
        return paced

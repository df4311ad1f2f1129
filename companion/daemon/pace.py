"""How long a plan may take, and by whose clock: in step with a simulation, in a thread, or as recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from companion.clock import Clock
from companion.daemon.watch import in_thread
from companion.types.plan import Plan

Search = Callable[[Callable[[], bool]], Plan]  # takes a stopping rule


@dataclass(frozen=True, slots=True)
class Paced:
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


class Pace(Protocol):
    """Runs a search."""

    async def run(self, search: Search, clock: Clock, budget_s: float, number: int) -> Paced:
        """Run the search for the plan of this number within a budget of the clock's time."""
        ...


class _Rule:
    """A stopping rule that counts how often it was asked; once it said so, it keeps to it."""

    def __init__(self, is_over: Callable[[int], bool]) -> None:
        self.asked = 0
        self.is_stopped = False
        self._is_over = is_over

    def __call__(self) -> bool:
        self.asked += 1
        self.is_stopped = self.is_stopped or self._is_over(self.asked)
        return self.is_stopped


def _searched(search: Search, rule: _Rule) -> Paced:
    began = time.perf_counter()
    plan = search(rule)
    return Paced(plan, 1e3 * (time.perf_counter() - began), rule.asked, rule.is_stopped)


class InStep:
    """In the event loop, to the iteration budget; the plan takes its budget of a clock that others move."""

    async def run(self, search: Search, clock: Clock, budget_s: float, number: int) -> Paced:
        """Run the search, however long the computer needs."""
        due = clock.now_s() + budget_s
        paced = _searched(search, _Rule(lambda asked: False))
        await clock.sleep_until(due)
        return paced


class InThread:
    """In a thread, until the clock says that the budget is spent."""

    async def run(self, search: Search, clock: Clock, budget_s: float, number: int) -> Paced:
        """Run the search to its deadline."""
        due = clock.now_s() + budget_s
        return await in_thread(_searched, search, _Rule(lambda asked: clock.now_s() >= due))


@dataclass(frozen=True, slots=True)
class Taken:
    """What a recorded plan took: the question at which it was told to stop, None if never, and its time."""

    stopped_at: int | None
    took_s: float


class AsRecorded:
    """In the event loop, stopped where the recorded search was stopped, and as long by the clock.

    Parameters
    ----------
    taken : mapping
        By the plan's number; a plan that was not recorded is made as in a simulation.
    """

    def __init__(self, taken: Mapping[int, Taken]) -> None:
        self._taken = taken

    async def run(self, search: Search, clock: Clock, budget_s: float, number: int) -> Paced:
        """Run the search as it was run in flight."""
        taken = self._taken.get(number, Taken(None, budget_s))
        due = clock.now_s() + taken.took_s
        last = taken.stopped_at
        paced = _searched(search, _Rule(lambda asked: last is not None and asked >= last))
        await clock.sleep_until(due)
        return paced

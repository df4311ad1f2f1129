"""Who looks on while the service works, and a thread that may be left behind."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import TypeVar

from companion.mission.swap import SwapOutcome
from companion.types.plan import Plan

Result = TypeVar("Result")


class Watch:
    """Is told of what happens; this one takes no notice. Nothing decides on it."""

    def progress(self) -> None:
        """The planning loop came round, or an exchange with the autopilot got on."""

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """A plan was made, in so many milliseconds of the computer's time."""

    def exchanged(self, outcome: SwapOutcome) -> None:
        """A mission was handed over, or was not."""


async def in_thread(function: Callable[..., Result], *values: object) -> Result:
    """Await a function in a thread that does not keep the program from ending, should it never return."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[Result] = loop.create_future()

    def settle(result: Result | None, fault: Exception | None) -> None:
        if future.done():
            return
        if fault is not None:
            future.set_exception(fault)
        else:
            future.set_result(result)  # type: ignore[arg-type]

    def work() -> None:
        result, fault = None, None
        try:
            result = function(*values)
        except Exception as error:
            fault = error
        if not loop.is_closed():
            loop.call_soon_threadsafe(settle, result, fault)

    threading.Thread(target=work, name=getattr(function, "__name__", "work"), daemon=True).start()
    return await future

"""Runs of a campaign on the workers of a Dask scheduler, on as many computers as there are.

A worker makes one run at a time, whatever its number of threads. If a worker dies, another
makes its run; a run that several workers died of becomes a row with that error. Each row names the commit and
the computer of the worker that made it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

from distributed import Client, KilledWorker, as_completed

from companion.errors import CompanionError
from companion.research.campaign.campaign_spec import Campaign, Run
from companion.research.campaign.engines.finished import Finished
from companion.research.campaign.engines.process_engine import outcome_of
from companion.research.campaign.engines.runners import Packed, Runner, json_text, runner_at
from companion.research.campaign.provenance import Provenance, provenance

CONNECT_S = 10
AHEAD = 2  # Each thread of a worker gets this many runs at a time, so that it never waits.
_Typed = Any  # Dask's objects

_lock = threading.Lock()
_runners: dict[str, tuple[Runner, Provenance]] = {}


class DaskEngine:
    """Engine on a scheduler's workers, which have the same version of the project.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    places : dict
        Places of the code that makes runs, by kind.
    address : str
        The scheduler's address, such as ``tcp://host:8786``.
    """

    def __init__(self, campaign: Campaign, places: dict[str, str], address: str) -> None:
        self._campaign, self._places, self._address = campaign, places, address

    def finished(self, runs: Sequence[Run]) -> Iterator[Finished]:
        """Make the runs, and yield each when it is finished, in no particular order.

        Raises
        ------
        CompanionError
            If there is no such scheduler.
        """
        try:
            client: _Typed = Client(self._address, timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ValueError) as error:
            raise CompanionError(f"no Dask scheduler at {self._address}: {error}") from None
        try:
            yield from self._over(client, runs)
        finally:
            client.close()

    def _over(self, client: _Typed, runs: Sequence[Run]) -> Iterator[Finished]:
        waiting, begun = deque(runs), dict[str, tuple[Run, datetime, float]]()
        campaign = client.scatter(self._campaign, broadcast=True, hash=False)
        over: _Typed = as_completed(loop=client.loop)  # type: ignore[no-untyped-call]

        def hand_out() -> None:
            run = waiting.popleft()
            future = client.submit(_outcome_on_worker, campaign, self._places, run, pure=False)
            begun[future.key] = run, datetime.now(UTC), time.perf_counter()
            over.add(future)

        threads = sum(client.nthreads().values())
        for _ in range(min(len(waiting), AHEAD * max(threads, 1))):
            hand_out()
        for future in over:
            run, started, began_s = begun.pop(future.key)
            outcome, made_by = _result(future)
            duration_s = time.perf_counter() - began_s
            if waiting:
                hand_out()
            yield Finished(run, outcome, started, duration_s, 1, made_by)


def _result(future: _Typed) -> tuple[Packed, Provenance | None]:
    """Return the outcome of a run; a run that ended its workers has an outcome, too."""
    try:
        outcome, made_by = future.result()
    except KilledWorker as error:
        return Packed(error=f"the workers that made it died: {error}"), None
    return outcome, made_by


def _outcome_on_worker(campaign: Campaign, places: dict[str, str], run: Run) -> tuple[Packed, Provenance]:
    """Make a run on a worker; the runner is kept for the next run of the same campaign."""
    with _lock:
        key = json_text(campaign.identity())
        if key not in _runners:
            runner = runner_at(places[campaign.config.kind], campaign, places)
            runner.warm_up()
            _runners.clear()
            _runners[key] = runner, provenance()
        runner, made_by = _runners[key]
        return outcome_of(runner, run), made_by

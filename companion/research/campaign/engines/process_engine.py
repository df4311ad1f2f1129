"""Runs of a campaign in processes of this computer, which stay, one run after the other.

A run's fault becomes its outcome. One whose process dies is tried once more, for that can be somebody
else's doing (the computer was short of memory, the whole campaign is being killed); when it dies again,
that is the outcome.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from companion.errors import CompanionError
from companion.research.campaign.campaign_spec import Campaign, Run
from companion.research.campaign.engines.finished import Finished
from companion.research.campaign.engines.runners import Packed, Runner, packed, runner_at

ATTEMPTS_MAX = 2
ERROR_CHARACTERS = 2_000


@dataclass(slots=True)
class _Worker:
    """A process, and the run that it is at: none while it warms up or waits."""

    process: BaseProcess
    connection: Connection
    is_ready: bool = False
    run: Run | None = None
    started: datetime = datetime.min
    began_s: float = 0.0

    def be_ready(self) -> None:
        """Be warm from now on."""
        self.is_ready = True

    def begin(self, run: Run) -> None:
        """Hand it a run."""
        self.run, self.started, self.began_s = run, datetime.now(UTC), time.perf_counter()
        self.connection.send(run)

    def rest(self) -> None:
        """Have no run any more."""
        self.run = None

    def end(self) -> None:
        """End the process, whatever it is at."""
        self.connection.close()
        self.process.kill()
        self.process.join()


class ProcessEngine:
    """Makes runs in processes that are started anew, and so share nothing with this one.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    places : dict
        Places of the code that makes runs, by kind.
    jobs : int
        How many processes.
    """

    def __init__(self, campaign: Campaign, places: dict[str, str], jobs: int) -> None:
        self._campaign, self._places, self._jobs = campaign, places, jobs
        self._workers: list[_Worker] = []
        self._attempts: dict[int, int] = {}

    def finished(self, runs: Sequence[Run]) -> Iterator[Finished]:
        """Make the runs, and tell of each as it is over; in no particular order.

        Raises
        ------
        CompanionError
            If no process comes as far as its first run.
        """
        waiting = deque(runs)
        try:
            # One alone, so that what is compiled is compiled once; it works while the others warm up.
            self._greet(self._started(), waiting)
            while len(self._workers) < min(self._jobs, len(runs)):
                self._started()
            while waiting or any(worker.run is not None for worker in self._workers):
                for worker in self._talking():
                    over = self._heard(worker, waiting)
                    if over is not None:
                        yield over
        finally:
            for worker in self._workers:
                worker.end()

    def _started(self) -> _Worker:
        """Start a process, which says when it is warm."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=_work, args=(theirs, self._campaign, self._places), daemon=True, name="campaign"
        )
        process.start()
        theirs.close()
        self._workers.append(_Worker(process, ours))
        return self._workers[-1]

    def _greet(self, worker: _Worker, waiting: deque[Run]) -> None:
        """Take a process's word that it is warm, and give it a run if there is one.

        Raises
        ------
        CompanionError
            If it ended before.
        """
        try:
            fault = worker.connection.recv()
        except (EOFError, OSError):
            worker.process.join()
            fault = f"it {_end_of(worker.process)}"
        if fault:
            raise CompanionError(f"a process could not get ready for the campaign: {fault}")
        worker.be_ready()
        if waiting:
            worker.begin(waiting.popleft())

    def _talking(self) -> list[_Worker]:
        """Processes that have something to tell; waits for one."""
        busy = [worker for worker in self._workers if worker.run is not None or not worker.is_ready]
        told = wait([worker.connection for worker in busy])
        return [worker for worker in busy if worker.connection in told]

    def _heard(self, worker: _Worker, waiting: deque[Run]) -> Finished | None:
        """What a process tells: that it is warm, which is of no run, or what came of one."""
        if worker.is_ready:
            return self._taken(worker, waiting)
        self._greet(worker, waiting)
        return None

    def _taken(self, worker: _Worker, waiting: deque[Run]) -> Finished | None:
        """What a process has to tell; None where its run is to be tried again."""
        run, started, began_s = worker.run, worker.started, worker.began_s
        assert run is not None
        attempts = self._attempts.get(run.number, 0) + 1
        self._attempts[run.number] = attempts
        try:
            outcome: Packed = worker.connection.recv()
        except (EOFError, OSError):
            self._workers.remove(worker)
            worker.process.join()
            outcome = Packed(error=f"the process that made it {_end_of(worker.process)}")
            worker.end()
            is_over = attempts >= ATTEMPTS_MAX
            if not is_over:
                waiting.appendleft(run)
            duration_s = time.perf_counter() - began_s
            if waiting:
                self._started()
            return Finished(run, outcome, started, duration_s, attempts) if is_over else None
        duration_s = time.perf_counter() - began_s
        worker.rest()
        if waiting:
            worker.begin(waiting.popleft())
        return Finished(run, outcome, started, duration_s, attempts)


def _end_of(process: BaseProcess) -> str:
    """How a process ended, in words."""
    code = process.exitcode
    return f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with code {code}"


def _work(connection: Connection, campaign: Campaign, places: dict[str, str]) -> None:
    """Make runs until there are no more, or the campaign's own process is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the campaign's own process ends this one
    logging.disable(logging.CRITICAL)
    runner = runner_at(places[campaign.config.kind], campaign, places)
    runner.warm_up()
    try:
        connection.send("")
        while True:
            connection.send(outcome_of(runner, connection.recv()))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def outcome_of(runner: Runner, run: Run) -> Packed:
    """What comes of a run, its faults included."""
    try:
        return packed(runner.outcome(run))
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename.rpartition('/')[2]}, {place.name}"
        return Packed(error=f"{type(error).__name__}: {error} ({where})"[:ERROR_CHARACTERS])

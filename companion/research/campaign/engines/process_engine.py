"""Runs of a campaign in processes of this computer; each process makes one run after the other.

An error of a run becomes its outcome. A run whose process dies is tried once more, because the cause may lie
elsewhere (too little memory, or the whole campaign is being killed). If it dies again, that is the outcome.
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
    """A process, and its present run: none while it warms up or waits."""

    process: BaseProcess
    connection: Connection
    is_ready: bool = False
    run: Run | None = None
    started: datetime = datetime.min
    began_s: float = 0.0

    def be_ready(self) -> None:
        """Note that the process has warmed up."""
        self.is_ready = True

    def begin(self, run: Run) -> None:
        """Give the process a run."""
        self.run, self.started, self.began_s = run, datetime.now(UTC), time.perf_counter()
        self.connection.send(run)

    def rest(self) -> None:
        """Note that the run is finished."""
        self.run = None

    def end(self) -> None:
        """End the process, whatever it does."""
        self.connection.close()
        self.process.kill()
        self.process.join()


class ProcessEngine:
    """Engine with newly started processes, which share nothing with this one.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    places : dict
        Places of the code that makes runs, by kind.
    jobs : int
        Number of processes.
    """

    def __init__(self, campaign: Campaign, places: dict[str, str], jobs: int) -> None:
        self._campaign, self._places, self._jobs = campaign, places, jobs
        self._workers: list[_Worker] = []
        self._attempts: dict[int, int] = {}

    def finished(self, runs: Sequence[Run]) -> Iterator[Finished]:
        """Make the runs, and yield each when it is finished, in no particular order.

        Raises
        ------
        CompanionError
            If no process gets to its first run.
        """
        waiting = deque(runs)
        try:
            # One process starts first, so that kernels are compiled once; it works while the others warm up.
            self._greet(self._started(), waiting)
            while len(self._workers) < min(self._jobs, len(runs)):
                self._started()
            while waiting or any(worker.run is not None for worker in self._workers):
                for worker in self._talking():
                    over = self._received(worker, waiting)
                    if over is not None:
                        yield over
        finally:
            for worker in self._workers:
                worker.end()

    def _started(self) -> _Worker:
        """Start a process, which reports when it has warmed up."""
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
        """Note that a process has warmed up, and give it a run if there is one.

        Raises
        ------
        CompanionError
            If the process ended before that.
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
        """Wait until processes have messages, and return those processes."""
        busy = [worker for worker in self._workers if worker.run is not None or not worker.is_ready]
        ready = wait([worker.connection for worker in busy])
        return [worker for worker in busy if worker.connection in ready]

    def _received(self, worker: _Worker, waiting: deque[Run]) -> Finished | None:
        """Return the message of a process: that it has warmed up, or the outcome of a run."""
        if worker.is_ready:
            return self._result_of_worker(worker, waiting)
        self._greet(worker, waiting)
        return None

    def _result_of_worker(self, worker: _Worker, waiting: deque[Run]) -> Finished | None:
        """Return the outcome that a process reports; None if its run should be tried again."""
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
    """Return the way a process ended, in words."""
    code = process.exitcode
    return f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with code {code}"


def _work(connection: Connection, campaign: Campaign, places: dict[str, str]) -> None:
    """Make runs until there are no more, or the campaign's own process is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The campaign's main process ends this one.
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
    """Return the outcome of a run, errors included."""
    try:
        return packed(runner.outcome(run))
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename.rpartition('/')[2]}, {place.name}"
        return Packed(error=f"{type(error).__name__}: {error} ({where})"[:ERROR_CHARACTERS])

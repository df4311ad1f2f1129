"""``companion run``: the service on the computer's own clock."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
from collections.abc import Mapping
from pathlib import Path

from companion.clock import Clock, WallClock
from companion.config import MissionConfig, mission_from_text, mission_text, require_own_system
from companion.config.reload import prepared_mission
from companion.errors import CompanionError, ConfigError
from companion.flight.tasks.app import App
from companion.kernels.native.ready import make_ready
from companion.link.wire.transport import Transport, transport_from_url
from companion.planning.threads import in_thread
from companion.recording.retention import FLIGHTS_MAX_BYTES, discard, keep_pruned
from companion.service.process.metrics import Endpoint, Metrics
from companion.service.process.observers import LivePage, Observers, page_of
from companion.service.process.recorded_flight import RecordedFlight
from companion.service.process.sd_notify import Notifier, watchdog_of
from companion.service.process.signing_setup import signing_of
from companion.service.process.watchdog import Report, Supervision, stacks_logged

STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT)

_log = logging.getLogger(__name__)


class Service:
    """One run of the service, with its flights, its supervision and the operator's requests.

    Parameters
    ----------
    file : Path
        The mission file.
    url : str
        URL of the autopilot's link, for ``transport_from_url``.
    flights : Path
        Folder of the recordings, and of the state for a restart.
    environment : mapping of str to str
        Environment variables, in which systemd passes sockets and folders.
    metrics_port : int, optional
        Port of metrics and health for this computer only; by default none.
    flights_max_bytes : int
        Limit of all recordings; the oldest flights are deleted first.
    page : LivePage, optional
        Page that shows the flights in browsers; by default none. It ends with the service.
    clock : Clock, optional
        Clock of the service; by default the computer's.
    line : Transport, optional
        Transport to the autopilot; by default that of the URL.
    """

    def __init__(
        self,
        file: Path,
        url: str,
        flights: Path,
        environment: Mapping[str, str],
        *,
        metrics_port: int | None = None,
        flights_max_bytes: int = FLIGHTS_MAX_BYTES,
        page: LivePage | None = None,
        clock: Clock | None = None,
        line: Transport | None = None,
    ) -> None:
        self._file = file
        self._url = url
        self._flights = flights
        self._flights_max_bytes = flights_max_bytes
        self._text = mission_text(file)
        self._mission = mission_from_text(self._text, str(file))
        require_own_system(self._mission, str(file))
        self._clock = clock or WallClock()
        self._line = line or transport_from_url(url, self._clock)
        self._begun_s = self._clock.now_s()
        self._watchdog_s = watchdog_of(environment)
        _check_budget(self._mission, file, self._watchdog_s)
        state = _folder_of("STATE_DIRECTORY", environment)
        self._timestamps, self._signer = signing_of(self._mission, state)
        self._is_warm = False
        self._wants_reload = asyncio.Event()
        self._on_ground: Path | None = None
        self._metrics = None if metrics_port is None else Metrics()
        self._notifier = Notifier(environment.get("NOTIFY_SOCKET", ""))
        self._supervision = Supervision(self._notifier, self._clock, self.report, self._watchdog_s)
        self._metrics_port = metrics_port
        self._endpoint: Endpoint | None = None
        self._observers = Observers(self._supervision, self._metrics, page)
        self._flight = self._begun()

    @property
    def app(self) -> App:
        """App of the present flight."""
        return self._flight.app

    def _begun(self) -> RecordedFlight:
        return RecordedFlight.begun(
            self._mission,
            self._text,
            self._line,
            self._clock,
            self._flights,
            observers=self._observers,
            signer=self._signer,
            begun_s=self._begun_s,
            is_warm=self._is_warm,
        )

    def report(self) -> Report:
        """Return the present state of the service."""
        app, decisions = self.app, self.app.recorder.decisions
        last = f"{decisions[-1].kind}: {decisions[-1].text}" if decisions else ""
        has_autopilot = app.link.knows_autopilot
        autopilot = app.autopilot_mode or (
            "its next heartbeat confirms it" if has_autopilot else "no autopilot"
        )
        return Report(app.is_warm, has_autopilot, f"{app.mode.value} ({autopilot})", last)

    async def run(self) -> None:
        """Run until a stop signal, then end in order.

        Raises
        ------
        LinkError
            If the link's address or the port for metrics cannot be used.
        """
        loop, stopping = asyncio.get_running_loop(), asyncio.Event()
        for number in STOP_SIGNALS:
            loop.add_signal_handler(number, stopping.set)
        loop.add_signal_handler(signal.SIGHUP, self.reload)
        try:
            if self._metrics is not None and self._metrics_port is not None:
                self._endpoint = Endpoint(self._metrics_port, self._metrics, self._supervision)
            async with asyncio.TaskGroup() as tasks:
                background = [tasks.create_task(self._warm()), tasks.create_task(self._reload_on_request())]
                while True:
                    await self._fly(stopping)
                    if stopping.is_set():
                        break
                    self._flight = self._begun()
                for task in background:
                    task.cancel()
        except* CompanionError as group:
            raise _first(group) from None
        finally:
            for number in (*STOP_SIGNALS, signal.SIGHUP):
                loop.remove_signal_handler(number)
            self.close()
            await self._line.close()
        _log.info("stopped; the autopilot keeps the mission it flies")

    def close(self) -> None:
        """Close all files and sockets except the link."""
        self._flight.close()
        if self._timestamps is not None:
            self._timestamps.close()
        self._notifier.close()
        self._observers.close()
        if self._endpoint is not None:
            self._endpoint.close()

    async def _fly(self, stopping: asyncio.Event) -> None:
        """Run the flight until it is over, or the service must stop."""
        flight, clock, epoch_s = self._flight, self._clock, self.app.recorder.epoch_s
        _log.info("listening on %s; recording to %s", self._url, flight.folder)
        async with asyncio.TaskGroup() as tasks:
            running = [
                tasks.create_task(flight.app.run()),
                tasks.create_task(flight.reporting.run()),
                tasks.create_task(flight.report_silence(self._url)),
                tasks.create_task(
                    keep_pruned(self._flights, self._flights_max_bytes, flight.folder, clock, epoch_s)
                ),
            ]
            ends = [tasks.create_task(stopping.wait()), tasks.create_task(flight.over())]
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            if stopping.is_set():
                self._supervision.leave()
                await flight.app.withdraw()
            for task in running + ends:
                task.cancel()
        flight.close()
        self._discard_idle(flight)

    def _discard_idle(self, ended: RecordedFlight) -> None:
        """Delete recordings without a flight, except the last one before a flight."""
        if ended.app.state.phase.has_flown or not ended.folder.exists():
            self._on_ground = None
            return
        if self._on_ground is not None:
            discard(self._on_ground)
        self._on_ground = ended.folder

    async def _warm(self) -> None:
        """Load or compile the kernels in a thread; the first plan waits for them."""
        await in_thread(make_ready, _log_progress)
        self._is_warm = True
        self.app.warmed_up()
        self._supervision.note_ready()
        _log.info("ready to plan")

    def reload(self) -> None:
        """Reload the mission file soon; an invalid file, or one that needs a restart, changes nothing."""
        if self._supervision.is_ready and not self._wants_reload.is_set():
            self._notifier.reloading()  # Before that, the READY=1 that ends a reload would be wrong.
        self._wants_reload.set()

    async def _reload_on_request(self) -> None:
        """Read and check the file in a thread at each request, and use it if it is valid."""
        while True:
            await self._wants_reload.wait()
            self._wants_reload.clear()
            try:
                fences = self.app.state.rules.fences
                mission, text = await in_thread(prepared_mission, self._mission, self._file, fences)
                require_own_system(mission, str(self._file))
                _check_budget(mission, self._file, self._watchdog_s)
            except ConfigError as error:
                _log.error("not reloaded: %s", error)
                self.app.refuse_reload(error.key)
            else:
                self._mission, self._text = mission, text
                self.app.reload(mission, text)
            if self._supervision.is_ready and not self._wants_reload.is_set():
                self._notifier.tell(READY=1, STATUS=str(self.report()))


async def serve(
    file: Path,
    url: str,
    flights: Path,
    metrics_port: int | None = None,
    flights_max_bytes: int = FLIGHTS_MAX_BYTES,
    *,
    page_port: int | None = None,
    page_host: str = "",
    page_token: str = "",
    page_ground: Path | None = None,
) -> None:
    """Run the service until it is stopped; logs within seconds if no autopilot is received.

    Raises
    ------
    CompanionError
        If it cannot start.
    """
    with stacks_logged(_folder_of("LOGS_DIRECTORY", os.environ)):
        page = page_of(page_port, page_host, page_token, page_ground)
        if page is not None:
            _log.info("page: %s", page.address)
        service = Service(
            file, url, flights, os.environ, metrics_port=metrics_port, flights_max_bytes=flights_max_bytes,
            page=page,
        )  # fmt: skip
        await service.run()


def _log_progress(done: int, total: int) -> None:
    """Log the progress of compiling ten times."""
    if done == total or done % max(1, total // 10) == 0:
        _log.info("compiling the planner's kernels: %d of %d", done, total)


def _first(group: BaseExceptionGroup[CompanionError]) -> CompanionError:
    """Return the first error of a group of errors or groups."""
    error = group.exceptions[0]
    return _first(error) if isinstance(error, BaseExceptionGroup) else error


def _folder_of(name: str, environment: Mapping[str, str]) -> Path | None:
    """Return a folder that systemd created for the service; None without one."""
    value = environment.get(name, "").partition(":")[0]
    return Path(value) if value else None


def _check_budget(mission: MissionConfig, file: Path, watchdog_s: float | None) -> None:
    """Check that a plan takes much less time than the watchdog allows."""
    budget = float(mission.planning.planning_budget_s)
    if watchdog_s is not None and budget > 0.5 * watchdog_s:
        expected = f"at most {0.5 * watchdog_s:g}, half of the unit's WatchdogSec"
        raise ConfigError(str(file), None, "planning.planning_budget_s", f"{budget:g}", expected)

"""One flight of the service, or a period on the ground: its app, its recording, and its end."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from companion.clock import Clock
from companion.config import MissionConfig
from companion.errors import RecordError
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.tasks.app import App
from companion.flight.tasks.composition import composed
from companion.link.wire.signing import Signer
from companion.link.wire.transport import Transport
from companion.planning.plan_runner import ThreadRunner
from companion.recording.recorder import About, Recorder
from companion.recording.retention import discard, folder_for
from companion.service.process.observers import Observers
from companion.service.process.telemetry_out import TelemetryReporter

REPORT_SILENCE_S = 5.0
LOOK_S = 1.0  # Interval of checks for the end of a flight.

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RecordedFlight:
    """A flight with its app and recording.

    Parameters
    ----------
    app : App
        App of this flight only, so that its recording can be replayed by itself.
    reporting : TelemetryReporter
        Reports the app's values once a second.
    folder : Path
        Folder of the recording, even if it cannot be written.
    clock : Clock
        Clock of the app.
    """

    app: App
    reporting: TelemetryReporter
    folder: Path
    clock: Clock

    @classmethod
    def begun(
        cls,
        mission: MissionConfig,
        text: str,
        line: Transport,
        clock: Clock,
        flights: Path,
        *,
        observers: Observers,
        signer: Signer | None,
        begun_s: float,
        is_warm: bool,
    ) -> RecordedFlight:
        """Begin a flight.

        Parameters
        ----------
        mission : MissionConfig
            Mission of the flight.
        text : str
            Text of the mission file, which is recorded unchanged.
        line : Transport
            Transport to the autopilot.
        clock : Clock
            Clock of the flight.
        flights : Path
            Folder of all flights; the flight's own folder is created in it.
        observers : Observers
            Get notifications of plans and transfers.
        signer : Signer or None
            Signs and verifies frames; None without a key.
        begun_s : float
            Clock reading at which the service started [s].
        is_warm : bool
            True if every kernel is compiled.
        """
        seed, epoch_s = int(mission.planning.seed), round(time.time() - clock.now_s(), 6)
        folder = folder_for(flights, mission.name, datetime.now(UTC))
        recorder = _recorder(folder, epoch_s, About(mission, seed, text))
        observers.begin_recording(recorder)
        link = VehicleLink(mission, line, clock, recorder, signer=signer, observer=observers)
        parts = composed(
            mission,
            link,
            clock,
            recorder,
            seed=seed,
            runner=ThreadRunner(),
            checkpoint=Checkpoint(flights / mission.name, is_threaded=True),
            observer=observers,
            parameters_file=flights / f"{mission.name}.parameters.json",
        )
        app = App(parts, is_warm=is_warm)
        reporting = TelemetryReporter(app, clock, flights, observers.metrics, begun_s)
        observers.report_to(reporting)
        return cls(app, reporting, folder, clock)

    def close(self) -> None:
        """Close the recording; delete it if no frame was received."""
        self.app.recorder.close()
        if not self.app.link.codec.counters and self.folder.exists():
            discard(self.folder)

    async def over(self) -> None:
        """Wait for the end of the flight, or of an hour on the ground."""
        while True:
            now = self.clock.now_s()
            phase = self.app.state.phase
            if phase.is_over(now) or phase.is_idle(now) or self.app.has_lost_vehicle(now):
                return
            await self.clock.sleep_until(now + LOOK_S)

    async def report_silence(self, url: str) -> None:
        """Log every few seconds that no autopilot is received on a link."""
        app = self.app
        while True:
            await self.clock.sleep_until(self.clock.now_s() + REPORT_SILENCE_S)
            if not app.receives_autopilot:
                why = f" ({app.link.transport.trouble})" if app.link.transport.trouble else ""
                _log.warning(
                    "no autopilot heard on %s for %.0f s; still trying%s", url, REPORT_SILENCE_S, why
                )


def _recorder(folder: Path, epoch_s: float, about: About) -> Recorder:
    """Return a recorder into a folder, or one without files, with an error in the log."""
    try:
        return Recorder(folder, epoch_s, about)
    except RecordError as error:
        _log.error("not recorded: %s", error)
        return Recorder(None, epoch_s, about, failure=str(error))

"""One flight of the service, or a time on the ground: its app, its recording, and when it is over."""

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
LOOK_S = 1.0  # for the end of a flight

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RecordedFlight:
    """A flight, and what goes with it.

    Parameters
    ----------
    app : App
        Begun anew for it, so that its recording can be replayed by itself.
    reporting : TelemetryReporter
        Tells the app's figures, once a second.
    folder : Path
        Folder of the recording, whether it could be written to or not.
    clock : Clock
        Clock that the app goes by.
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
            Mission to be flown.
        text : str
            The mission file, which is recorded as it is.
        line : Transport
            Transport to the autopilot.
        clock : Clock
            Clock that the flight goes by.
        flights : Path
            Folder of all flights; its own is made in it.
        observers : Observers
            Told of plans and exchanges; the flight's figures are told to them.
        signer : Signer or None
            Signs and verifies frames; None where there is no key.
        begun_s : float
            Clock reading at which the service began [s].
        is_warm : bool
            Whether every kernel is compiled.
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
            checkpoint=Checkpoint(flights / mission.name),
            observer=observers,
            parameters_file=flights / f"{mission.name}.parameters.json",
        )
        app = App(parts, is_warm=is_warm)
        reporting = TelemetryReporter(app, clock, flights, observers.metrics, begun_s)
        observers.report_to(reporting)
        return cls(app, reporting, folder, clock)

    def close(self) -> None:
        """End the recording; one of which not a byte was heard is none."""
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
        """Say every few seconds that no autopilot is heard on a link, while that is so."""
        app = self.app
        while True:
            await self.clock.sleep_until(self.clock.now_s() + REPORT_SILENCE_S)
            if not app.hears_autopilot:
                why = f" ({app.link.transport.trouble})" if app.link.transport.trouble else ""
                _log.warning(
                    "no autopilot heard on %s for %.0f s; still trying%s", url, REPORT_SILENCE_S, why
                )


def _recorder(folder: Path, epoch_s: float, about: About) -> Recorder:
    """A recorder into a folder; where it cannot write, the flight goes without and that is said."""
    try:
        return Recorder(folder, epoch_s, about)
    except RecordError as error:
        _log.error("not recorded: %s", error)
        return Recorder(None, epoch_s, about, failure=str(error))

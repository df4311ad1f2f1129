"""Sets up the service as at the start of a recording, over a link with the recorded autopilot's answers."""

from __future__ import annotations

import base64
import contextlib
import json
from pathlib import Path

from companion.clock import Clock
from companion.config import MissionConfig
from companion.flight.messages.vehicle_link import LinkKind, VehicleLink
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.tasks.app import App
from companion.flight.tasks.composition import composed
from companion.link.wire.transport import Transport
from companion.planning.plan_runner import InlineRunner, RecordedRunner
from companion.recording.reader import Recording
from companion.recording.recorder import Recorder
from companion.safe_files import replace_file


def replayed_app(
    recording: Recording,
    mission: MissionConfig,
    transport: Transport,
    clock: Clock,
    link_kind: LinkKind,
    *,
    seed: int | None,
    folder: Path,
) -> App:
    """Create the app as it was at the start of a recording.

    Parameters
    ----------
    recording : Recording
        The recorded flight, with what the service remembered.
    mission : MissionConfig
        Mission file, which may differ from the recorded one.
    transport : Transport
        Transport over which the recorded frames arrive.
    clock : Clock
        Clock of the replay.
    link_kind : callable
        Makes the link that answers for the recorded autopilot.
    seed : int or None
        Seed of plans and filters; None for the recorded one, else that of the mission file.
    folder : Path
        Folder for the parameters that the pilot had set before the recording.
    """
    about, recorder = recording.about, Recorder()
    if seed is None:
        flown_seed = about.get("seed")
        seed = flown_seed if isinstance(flown_seed, int) else int(mission.planning.seed)
    parameters_file = folder / "parameters.json"
    replace_file(parameters_file, json.dumps(_remembered(about).get("parameters", {})).encode("ascii"))
    link = VehicleLink(mission, transport, clock, recorder, link_kind=link_kind)
    parts = composed(
        mission,
        link,
        clock,
        recorder,
        seed=seed,
        runner=InlineRunner() if recording.is_simulated else RecordedRunner(recording.taken),
        checkpoint=checkpoint_of(about),
        parameters_file=parameters_file,
    )
    return App(parts)


def _remembered(about: dict[str, object]) -> dict[str, object]:
    remembered = about.get("remembered")
    return remembered if isinstance(remembered, dict) else {}


def checkpoint_of(about: dict[str, object]) -> Checkpoint:
    """Return what the service remembered when the recording began; damaged parts are ignored."""
    kept = _remembered(about).get("memory")
    entries = kept.items() if isinstance(kept, dict) else ()
    kept_bytes = {}
    for end, text in entries:
        with contextlib.suppress(ValueError, TypeError):
            kept_bytes[str(end)] = base64.b64decode(text)
    return Checkpoint(contents=kept_bytes)

"""Makes the record of a flight for a report from frames only."""

from __future__ import annotations

from dataclasses import replace

from companion.assurance.encounters import known_encounters
from companion.config import MissionConfig
from companion.config.rules import rules_of
from companion.config.sections.terrain_map import ground_heights_of
from companion.flight.state.world_model import WorldModel
from companion.link.messages.codec import Codec
from companion.recording.reader import Recording
from companion.recording.recorder import Recorder
from companion.types.record import FlightRecord

ON_BOARD = "Places are those known on board: a recording knows no others."
FROM_TLOG = "There is no flight.mcap: decisions are as the pilot was told, which cuts them short."
STATE_S = 0.2


def record_of_frames(mission: MissionConfig, recording: Recording) -> FlightRecord:
    """Return the record that the estimators make of a tlog's frames."""
    codec, world_model, recorder = Codec(), WorldModel(rules_of(mission), 1), Recorder()
    due_s = 0.0
    for recorded in recording.frames:
        now = recorded.at_us * 1e-6
        if recorded.is_ours:
            continue
        for frame in codec.feed(recorded.frame.raw, now):
            for event in frame.events:
                world_model.observe(event, now)
        state = world_model.ownship.state(now)
        if state is not None and now >= due_s:
            due_s = now + STATE_S
            tracks = world_model.tracks(now)
            recorder.state(now, state, tracks, world_model.threat_at(state, tracks))
    recorder.decisions += recording.decisions
    known = recorder.record({"frames": len(recording.frames), "flight_s": round(recording.duration_s, 1)})
    return replace(
        known, epoch_s=recording.epoch_s, note=f"{ON_BOARD} {FROM_TLOG}", begin_s=recording.start_us * 1e-6,
        encounters=known_encounters(
            known.flown, recorder.tracks.items(), mission.radar_list, mission.obstacle_list,
            ground_heights_of(mission),
        ),
    )  # fmt: skip

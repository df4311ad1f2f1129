"""Notices to onlookers between two rows of the recording. No decision depends on them."""

from __future__ import annotations

from companion.flight.tasks.composition import Composition
from companion.mission.team.member_tracks import members_among
from companion.recording import mcap_schema as channels
from companion.recording.recorder import TRACK, Recorder
from companion.token_bucket import TokenBucket
from companion.types.events import Event, GlobalPosition, TrackReport

POSITIONS_HZ, TRACKS_HZ = 10.0, 20.0  # Largest rates of notices; the recording's next row has the rest.
_BURST_S = 0.2  # A budget of notices may be saved up for this time.


class ProgressNotices:
    """Sends an own position or a detected vehicle as soon as it is processed.

    Parameters
    ----------
    parts : Composition
        The parts of the service.
    """

    def __init__(self, parts: Composition) -> None:
        self._world_model, self._flight = parts.world_model, parts.flight
        self._recorder: Recorder = parts.recorder
        self._positions = TokenBucket(POSITIONS_HZ, max(1.0, _BURST_S * POSITIONS_HZ))
        self._tracks = TokenBucket(TRACKS_HZ, _BURST_S * TRACKS_HZ)

    def note(self, event: Event, now_s: float) -> None:
        """Send what an event has changed, if there is an onlooker, within the budgets."""
        if not self._recorder.has_onlooker:
            return
        if isinstance(event, GlobalPosition) and self._positions.takes(now_s):
            ownship = self._world_model.ownship.state(now_s)
            if ownship is not None:
                self._recorder.notice(channels.OWNSHIP, now_s, channels.table_of(ownship, leave=("stamp_s",)))
        elif isinstance(event, TrackReport) and self._tracks.takes(now_s):
            track = self._world_model.tracker.track(event.identity, now_s)
            # A member of a team flies its announced plan. The next row of the recording says so.
            if track is not None and not members_among((track,), self._flight.state.mission.team_members)[0]:
                self._recorder.notice(TRACK, now_s, {"track": channels.table_of(track)})

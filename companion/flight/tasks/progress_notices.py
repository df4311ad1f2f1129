"""What is heard between two rows of the recording, for who looks on: at once. Nothing decides on it."""

from __future__ import annotations

from companion.flight.tasks.composition import Composition
from companion.recording import mcap_schema as channels
from companion.recording.recorder import TRACK, Recorder
from companion.token_bucket import TokenBucket
from companion.types.events import Event, GlobalPosition, TrackReport

POSITIONS_HZ, TRACKS_HZ = 10.0, 20.0  # more are seen with the recording's next row
_BURST_S = 0.2


class ProgressNotices:
    """Tells an own position, or a vehicle that was detected, as soon as it was taken in.

    Parameters
    ----------
    parts : Composition
        What the service is composed of.
    """

    def __init__(self, parts: Composition) -> None:
        self._situation = parts.situation
        self._recorder: Recorder = parts.recorder
        self._positions = TokenBucket(POSITIONS_HZ, max(1.0, _BURST_S * POSITIONS_HZ))
        self._tracks = TokenBucket(TRACKS_HZ, _BURST_S * TRACKS_HZ)

    def note(self, event: Event, now_s: float) -> None:
        """Tell what an event has changed, where somebody looks on and is not told too much already."""
        if not self._recorder.has_onlooker:
            return
        if isinstance(event, GlobalPosition) and self._positions.takes(now_s):
            ownship = self._situation.ownship.state(now_s)
            if ownship is not None:
                self._recorder.notice(channels.OWNSHIP, now_s, channels.table_of(ownship, leave=("stamp_s",)))
        elif isinstance(event, TrackReport) and self._tracks.takes(now_s):
            track = self._situation.tracker.track(event.identity, now_s)
            if track is not None:
                self._recorder.notice(TRACK, now_s, {"track": channels.table_of(track)})

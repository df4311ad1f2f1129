"""While somebody else flies: inform the pilot of what is met ahead, and whether a handback is safe.

While the service flies, only a return to launch is predicted (:mod:`companion.flight.monitors.return_watch`).

Somebody else is a pilot, a failsafe, or a ground station that has chosen another item. Twice a second the
aircraft is predicted on what it flies in its flight mode, and the tracks are checked.
"""

from __future__ import annotations

import math

from companion.flight.monitors.return_watch import ReturnWatch
from companion.flight.prediction.mode_tracks import ModeTracks, mode_tracks
from companion.flight.prediction.obstacle_ahead import ObstacleAhead, obstacle_ahead
from companion.flight.prediction.resume_path import ResumePath, lasting_resume_path
from companion.flight.prediction.return_path import start_of_return
from companion.flight.replanning.replanning_parts import ReplanningParts
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState, after_straight_return
from companion.flight.state.modes import Mode
from companion.types.events import Motion
from companion.types.state import Ownship

SAFE_AGAIN_S = 5.0  # A handback is called safe again only this long after the last text about it.
CLEAR_AGAIN_S = 2.0  # What is flown is called clear again once nothing was met for this time.
NEARER_S = 5.0  # A meeting is announced again if it is nearer by this time, or is with something else.
JOINED_S = 3.0  # An ArduPlane joins a return path at once, if at all; heartbeats come once a second.
SOMEBODY_ELSE = frozenset({Mode.STANDBY, Mode.SUSPENDED, Mode.YIELDED, Mode.ARRIVED})


class OtherModes:
    """Predicts what is flown in modes that the service did not choose.

    Parameters
    ----------
    parts : ReplanningParts
        The parts of replanning.

    Attributes
    ----------
    return_watch : ReturnWatch
        Where a return would lead while the service flies.
    resume : ResumePath or None
        The last resume path; None unless the service is suspended.
    tracks : ModeTracks or None
        What is flown next; None while the service flies.
    """

    def __init__(self, parts: ReplanningParts) -> None:
        self._flight, self._world_model, self._clock = parts.flight, parts.world_model, parts.clock
        self._announcer, self._handover = parts.announcer, parts.handover
        self._reader, self._link = parts.handover.reader, parts.handover.protocols.parts.link
        self.return_watch = ReturnWatch(parts.flight, parts.world_model, self._link, parts.announcer)
        self.resume: ResumePath | None = None
        self.tracks: ModeTracks | None = None
        self._is_called_safe: bool | None = None
        self._called_s = -math.inf
        self._met: ObstacleAhead | None = None
        self._met_s = self._announced_s = -math.inf
        self._straight_s = math.inf

    def look(self) -> None:
        """Predict and check what is flown next, and inform the pilot of changes; twice a second."""
        if self._flight.state.mode is Mode.SUSPENDED and not self._flight.listed.is_exchanging:
            self._handover.is_settled()  # A mission may have been entered just before somebody took over.
        state, now = self._flight.state, self._clock.now_s()
        ownship = self._world_model.ownship.state(now)
        self.return_watch.look(now)
        self._look_at_return(state, now)
        if ownship is None or state.mode not in SOMEBODY_ELSE or not state.phase.is_airborne:
            self.tracks = self.resume = self._is_called_safe = self._met = None
            return
        self.tracks = tracks = mode_tracks(state, ownship, self._reader.current)
        self._look_ahead(state, ownship, tracks, now)
        if state.mode is Mode.SUSPENDED:
            self._look_back(state, ownship, tracks, now)
        else:
            self.resume = self._is_called_safe = None

    def _look_at_return(self, state: FlightState, now: float) -> None:
        """Notice a return to launch that does not join the return path in the autopilot's list."""
        start = start_of_return(state) if state.motion is Motion.RETURN else None
        if start is None or all(item.command != start for item in state.mission_list.stored):
            self._straight_s = math.inf
            return
        self._straight_s = min(self._straight_s, now)
        if now - self._straight_s >= JOINED_S:
            self._flight.apply(after_straight_return)
            mode = state.autopilot_mode
            self._announcer.decide(
                DecisionKind.RETURN,
                f"{mode} does not join the return path",
                tell="return straight",
                mode=mode,
            )

    def _look_ahead(self, state: FlightState, ownship: Ownship, tracks: ModeTracks, now: float) -> None:
        """Announce what is met on the tracks, and that nothing is met any more."""
        mode = state.autopilot_mode
        met = obstacle_ahead(state, ownship, tracks)
        if met is not None:
            self._met_s = now
            before = self._met
            is_nearer = now + met.after_s < self._announced_s - NEARER_S
            if before is None or met.name != before.name or is_nearer:
                self._announced_s = now + met.after_s
                self._met = met
                self._announcer.decide(
                    DecisionKind.AHEAD, f"{mode} meets {met.name} in {met.after_s:.0f} s: {met.advice}",
                    tell="meets", mode=mode, what=met.name, time=f"{met.after_s:.0f}", advice=met.advice,
                )  # fmt: skip
        elif self._met is not None and now - self._met_s >= CLEAR_AGAIN_S:
            self._met = None
            self._announcer.decide(
                DecisionKind.AHEAD, f"{mode} keeps clear again", tell="meets nothing", mode=mode
            )

    def _look_back(self, state: FlightState, ownship: Ownship, tracks: ModeTracks, now: float) -> None:
        """Announce whether the mission mode may be selected, now and in the next seconds."""
        self.resume = found = lasting_resume_path(state, self._reader.current, ownship, tracks)
        if found.is_safe is self._is_called_safe or (found.is_safe and now - self._called_s < SAFE_AGAIN_S):
            return
        self._is_called_safe, self._called_s = found.is_safe, now
        tell = "handback safe" if found.is_safe else "handback unsafe"
        self._announcer.decide(
            DecisionKind.HANDBACK, found.text, tell=tell, mode=self._link.mission_mode, what=found.wrong
        )

"""Watch where a return to launch would lead from here, while the service flies."""

from __future__ import annotations

import math

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.messages.announcer import Announcer
from companion.flight.prediction.return_path import return_tracks, violations_of
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.flight.state.modes import Mode
from companion.flight.state.world_model import WorldModel
from companion.frames import FloatArray
from companion.link.missions.autopilot_link import AutopilotLink
from companion.types.mission import MissionItem
from companion.types.state import Ownship

LOOK_S = 1.0  # Period of the judgement; another list of items is judged at once.
UNSAFE_S = 3.0  # A return is called unsafe once it was so for this time.
NO_TRACK: FloatArray = np.empty((0, 3))
WATCHED = frozenset({Mode.DEPARTING, Mode.ACTIVE})


class ReturnWatch:
    """Informs the pilot when a return to launch would lead too near to something, and when not any more.

    A return is called safe again once it was safe for the time of a lap. Else each lap of a circle from one
    side of which it is unsafe would bring two texts.

    Parameters
    ----------
    flight : StateOwner
        Home, the autopilot's parameters and list, and the rules.
    world_model : WorldModel
        The aircraft.
    link : AutopilotLink
        The mission item being flown.
    announcer : Announcer
        Informs the pilot.

    Attributes
    ----------
    track_enu_m : ndarray, shape (K, 3)
        The most likely return path from here [m]; empty while none is predicted.
    is_safe : bool
        Whether a return keeps clear, as it was last announced.
    """

    def __init__(
        self, flight: StateOwner, world_model: WorldModel, link: AutopilotLink, announcer: Announcer
    ) -> None:
        self._flight, self._world_model, self._link = flight, world_model, link
        self._announcer = announcer
        self._next_s = -math.inf
        self._judged: tuple[MissionItem, ...] = ()
        self._since_s = -math.inf
        self._was_safe = self.is_safe = True
        self.track_enu_m: FloatArray = NO_TRACK

    def look(self, now_s: float) -> None:
        """Judge a return from here; call it twice a second."""
        state, ownship = self._flight.state, self._world_model.ownship.state(now_s)
        if state.mode not in WATCHED or not state.phase.is_airborne or ownship is None:
            self.is_safe = self._was_safe = True
            self.track_enu_m = NO_TRACK
            return
        stored = state.mission_list.stored
        if now_s < self._next_s and stored is self._judged:
            return
        self._next_s, self._judged = now_s + LOOK_S, stored
        near = self._violations(state, ownship)
        if bool(near) is self._was_safe:
            self._was_safe, self._since_s = not near, now_s
        lasts_s = _lap_s(state) if self._was_safe else UNSAFE_S
        if self._was_safe is self.is_safe or now_s - self._since_s < lasts_s:
            return
        self.is_safe = self._was_safe
        if self.is_safe:
            self._announcer.decide(DecisionKind.RETURN, "RTL from here is safe", tell="return safe")
        else:
            what = near[0].in_short
            text = f"RTL from here is NOT safe: {near[0].detail} {near[0].value:.0f}"
            self._announcer.decide(DecisionKind.RETURN, text, tell="return unsafe", what=what)

    def _violations(self, state: FlightState, ownship: Ownship) -> list[Violation]:
        """Predict a return from here, and return where it comes too near to something."""
        tracks = return_tracks(state, ownship, self._link.current) or []
        self.track_enu_m = tracks[0] if tracks else NO_TRACK
        return [entry for entry in violations_of(state, tracks) if entry.rule == "clearance"]


def _lap_s(state: FlightState) -> float:
    """Return the time of one lap of a circle, during which a return may be unsafe from one side alone [s]."""
    return 2.0 * math.pi * float(state.turn_radius_m) / float(state.rules.vehicle.airspeed_cruise_m_s)

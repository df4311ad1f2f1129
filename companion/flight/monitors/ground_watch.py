"""Compare the ground below the aircraft, as the autopilot stores or measures it, with the map.

The autopilot's stored heights may come from elsewhere than from the service. If they, a range finder or a
PX4's estimator differ from the map, one of them is wrong, and the pilot is informed.
"""

from __future__ import annotations

import math

import numpy as np

from companion.config.sections.terrain_map import served_heights_of
from companion.flight.construction.mission_simulation import followed_ground
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.world_model import WorldModel
from companion.types.events import Event, GroundReported
from companion.world.ground.autopilot_ground import stored_heights

LASTS_S = 3.0  # A difference counts after this time.
UNKNOWN_S = 10.0  # Stored heights may be missing for this time.
GAP_S = 5.0  # Reports farther apart do not belong to one stretch of time.
BANK_MAX_RAD = math.radians(15.0)  # In a steeper turn a range finder measures aslant.


class GroundWatch:
    """Compares reports of the ground with the map of the mission file, if it has one.

    Parameters
    ----------
    flight : StateOwner
        The mission file, and whether the aircraft flies.
    world_model : WorldModel
        The aircraft.
    announcer : Announcer
        Informs the pilot.
    """

    def __init__(self, flight: StateOwner, world_model: WorldModel, announcer: Announcer) -> None:
        self._flight, self._world_model, self._announcer = flight, world_model, announcer
        self._heights = served_heights_of(flight.state.mission)
        followed_ground(flight.state)  # It takes seconds over a large map, and is kept for the flight.
        self._since_s: dict[str, tuple[float, float]] = {}  # When what is wrong began, and was seen last.
        self._announced: set[str] = set()

    def observe(self, event: Event) -> None:
        """Take an event of the aircraft, and inform the pilot of a lasting difference."""
        terrain = self._flight.state.mission.terrain
        if not isinstance(event, GroundReported) or self._heights is None or terrain is None:
            return
        now_s = event.stamp_s
        if event.source == "autopilot" and event.spacing_m <= 0.0:
            is_needed = terrain.item_frame == "terrain" and self._flight.state.phase.is_airborne
            if self._lasts("unknown", now_s, UNKNOWN_S, is_wrong=is_needed):
                text = f"the autopilot has no ground here, {event.num_pending} heights pending"
                self._announcer.decide(DecisionKind.GROUND, text, tell="no ground")
            return
        self._lasts("unknown", now_s, UNKNOWN_S, is_wrong=False)
        heights = self._both(event, now_s)
        if heights is None:
            return
        theirs, ours = heights
        differs = abs(theirs - ours) > terrain.home_tolerance_m
        if self._lasts(event.source, now_s, LASTS_S, is_wrong=differs):
            text = f"ground by the {event.source} {theirs:.0f} m above the sea, by the map {ours:.0f} m"
            why = {
                "difference_m": round(theirs - ours, 1),
                "num_pending": event.num_pending,
                "num_loaded": event.num_loaded,
            }
            self._announcer.decide(
                DecisionKind.GROUND, text, why=why, tell="other ground", about=event.source,
                source=event.source, theirs=round(theirs), ours=round(ours),
            )  # fmt: skip

    def _lasts(self, what: str, now_s: float, lasts_s: float, *, is_wrong: bool) -> bool:
        """Return whether something has been wrong for a time, the first time only in this flight."""
        begun_s, seen_s = self._since_s.pop(what, (now_s, now_s))
        if not is_wrong:
            return False
        begun_s = now_s if now_s - seen_s > GAP_S else begun_s
        self._since_s[what] = begun_s, now_s
        is_new = now_s - begun_s >= lasts_s and what not in self._announced
        if is_new:
            self._announced.add(what)
        return is_new

    def _both(self, event: GroundReported, now_s: float) -> tuple[float, float] | None:
        """Return the reported and the map's altitude of the ground [m]; None if either is not known."""
        if self._heights is None:
            return None
        if event.place_deg is not None and event.altitude_amsl_m is not None:
            latitude, longitude = (np.array([degrees]) for degrees in event.place_deg)
            ours = float(stored_heights(self._heights, latitude, longitude, event.spacing_m)[0])
            return None if math.isnan(ours) else (event.altitude_amsl_m, ours)
        state, ownship = self._flight.state, self._world_model.ownship.state(now_s)
        if ownship is None or not state.phase.is_airborne or abs(ownship.bank_rad) > BANK_MAX_RAD:
            return None
        east, north, up = ownship.position_enu_m
        places = state.mission.frame.places_from_local(np.array([east]), np.array([north]))
        ours, theirs = float(self._heights(*places)[0]), event.altitude_amsl_m
        if theirs is None:
            distance = (event.distance_m or 0.0) * math.cos(ownship.bank_rad)
            theirs = up + float(state.mission.origin.altitude_amsl_m) - distance
        return None if math.isnan(ours) else (theirs, ours)

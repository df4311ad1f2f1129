"""Notice when the aircraft does not do what its plan says: no thrust, off its height, off its track, or slow.

The ground below it is compared with the map, and the pilot is informed of traffic, too.

The pilot is informed, and the next plan begins where the aircraft is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from companion.flight.construction.loiter_circles import end_circle
from companion.flight.messages.announcer import Announcer
from companion.flight.monitors.ground_watch import GroundWatch
from companion.flight.monitors.traffic_watch import TrafficWatch
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import SEARCH_ROWS, FlightState, StateOwner
from companion.flight.state.modes import Mode
from companion.flight.state.progress import OFF_HEIGHT_MAX_M
from companion.flight.state.world_model import WorldModel
from companion.mission.path_progress import progress_on
from companion.tracking.thrust import ThrustMonitor
from companion.types.events import Event, Motion
from companion.types.state import Ownship
from companion.types.threat import TrackState

OFF_TRACK_M = 60.0  # An aircraft with this lateral deviation does not follow its path.
# An aircraft is slow below this share of the path's speed over ground, less the wind's standard deviation.
SLOW_SHARE = 0.7
LASTS_S = 3.0  # A deviation counts after this time.
THRUST_AGAIN_S = 5.0  # Thrust is back once energy was gained for this time.
SINK_MIN_M_S = 0.3  # The time to the ground is announced if it sinks faster.


class PerformanceWatch:
    """Compares the aircraft with the flown path, and its energy with the throttle.

    Parameters
    ----------
    flight : StateOwner
        The flown path.
    world_model : WorldModel
        The aircraft.
    announcer : Announcer
        Informs the pilot.
    """

    def __init__(self, flight: StateOwner, world_model: WorldModel, announcer: Announcer) -> None:
        self._flight, self._world_model, self._announcer = flight, world_model, announcer
        self._thrust = ThrustMonitor()
        self._ground = GroundWatch(flight, world_model, announcer)
        self._traffic = TrafficWatch(announcer)
        self._deviation = ""
        self._since_s = self._thrust_s = -math.inf
        self._announced = ""
        self.has_thrust = True
        self._is_gliding = False

    def note_glide(self, *, is_gliding: bool) -> None:
        """Note whether the aircraft glides to a field, for which no path is followed exactly."""
        self._is_gliding = is_gliding

    def observe(self, event: Event) -> None:
        """Take an event of the aircraft."""
        self._thrust.observe(event)
        self._ground.observe(event)

    def look(self, now_s: float, tracks: Iterable[TrackState] = ()) -> bool:
        """Inform the pilot of what has changed.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        tracks : iterable of TrackState
            All vehicles that are tracked.

        Returns
        -------
        bool
            Whether the aircraft has begun to deviate, so that a plan is due.
        """
        state, ownship = self._flight.state, self._world_model.ownship.state(now_s)
        if not state.phase.is_airborne or ownship is None:
            self._thrust.forget()
            self._deviation, self._announced, self.has_thrust = "", "", True
            return False
        self._traffic.look(now_s, ownship, tracks, is_agreed=_flies_agreed(state))
        had_thrust = self.has_thrust
        self._look_at_thrust(state, ownship, now_s)
        is_judged = state.mode is Mode.ACTIVE and not self._is_gliding
        deviation, words = _deviation(state, ownship) if is_judged else ("", "")
        if deviation != self._deviation:
            self._deviation, self._since_s = deviation, now_s
        is_new = deviation != self._announced and (not deviation or now_s - self._since_s >= LASTS_S)
        if is_new:
            self._announced = deviation
            if deviation:
                self._announcer.decide(DecisionKind.OFF_PATH, words, tell="off path", what=words)
        return (is_new and bool(deviation)) or self.has_thrust is not had_thrust

    def _look_at_thrust(self, state: FlightState, ownship: Ownship, now_s: float) -> None:
        """Announce that the engine gives no thrust, and that it does again."""
        glide = state.mission.glide
        sink_m_s = None if glide is None else float(glide.airspeed_m_s) / float(glide.ratio)
        fault = self._thrust.fault(now_s, state.settings.throttle_max_share, sink_m_s)
        if fault or not self._thrust.gains(now_s):
            self._thrust_s = now_s
            if fault and self.has_thrust:
                self.has_thrust = False
                ends = _ground_in_words(state, ownship)
                self._announcer.decide(
                    DecisionKind.ENGINE, f"no thrust: {fault}", tell="no thrust", ends=ends
                )
        elif not self.has_thrust and now_s - self._thrust_s >= THRUST_AGAIN_S:
            self.has_thrust = True
            self._announcer.decide(DecisionKind.ENGINE, "thrust again", tell="thrust")


def _ground_in_words(state: FlightState, ownship: Ownship) -> str:
    """Return how high the aircraft is, and when it is on the ground if it sinks on as now."""
    height = ownship.position_enu_m[2] - (0.0 if state.home_enu_m is None else state.home_enu_m[2])
    sink = -ownship.climb_m_s
    down = f", down in {height / sink:.0f} s" if sink > SINK_MIN_M_S else ""
    return f"{height:.0f} m high{down}"


def _is_in_end_circle(state: FlightState, ownship: Ownship) -> bool:
    """Return whether the aircraft is in the circle in which the flown mission ends."""
    east_m, north_m, up_m = ownship.position_enu_m
    circle = end_circle(state, up_m)
    if circle is None:
        return False
    (east, north, up), radius_m = circle
    away_m = math.hypot(east_m - east, north_m - north)
    return away_m <= abs(radius_m) + OFF_TRACK_M and abs(up_m - up) <= OFF_HEIGHT_MAX_M


def _flies_agreed(state: FlightState) -> bool:
    """Return whether a mission of the service is flown, or what follows it: a team has agreed to that."""
    return state.motion is Motion.MISSION and state.mode in (Mode.ACTIVE, Mode.ARRIVED)


def _deviation(state: FlightState, ownship: Ownship) -> tuple[str, str]:
    """Return the kind of the aircraft's deviation from its path, and how it deviates; '' if it follows."""
    if state.flown is None or _is_in_end_circle(state, ownship):
        return "", ""
    path = state.flown.path
    progress = progress_on(path, ownship.position_enu_m, state.flown.row, SEARCH_ROWS)
    here = slice(progress.row, progress.row + 2)
    (begin, end), (begin_s, end_s) = path.positions_enu_m[here], path.times_s[here]
    east, north, up = np.subtract(ownship.position_enu_m, begin + progress.share * (end - begin))
    if state.mission.dimension == 3 and abs(up) > OFF_HEIGHT_MAX_M:
        side = "above" if up > 0.0 else "below"
        return side, f"{abs(up):.0f} m {side} its path"
    if math.hypot(east, north) > OFF_TRACK_M:
        return "beside", f"{math.hypot(east, north):.0f} m beside its path"
    expected = math.hypot(*(end - begin)[:2]) / max(float(end_s - begin_s), 1e-3)
    if ownship.ground_speed_m_s < SLOW_SHARE * expected - ownship.wind_std_m_s:
        return "slow", f"{ownship.ground_speed_m_s:.0f} m/s over ground, not {expected:.0f}"
    return "", ""

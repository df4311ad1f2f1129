"""Judge the flown path again whenever the world changes: if it has become worse, that is a surprise."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from companion.config.rules import Rules
from companion.flight.exchange.list_reader import ListReader
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.flight.state.progress import Start, as_of_now, violations_of_rest
from companion.flight.state.world_model import WorldModel
from companion.flight.takeover.start_prediction import begin
from companion.token_bucket import TokenBucket
from companion.types.path import Path
from companion.types.threat import TrackState

LEVEL_RISE_MIN = 0.15  # A smaller increase of the threat level is within the variation of the estimates.
# A path that a moving threat can reach for up to the first time is safe, for more than the second it is not.
SAFE_S, THREATENED_S = 0.5, 2.0
# Most judgements a second, and at once after a quiet time; each takes some milliseconds.
LOOKS_HZ, LOOKS_AT_ONCE = 3.0, 3.0
LATERAL_RADII = 1.5  # A vehicle predicted to pass at this many threat radii, and now within one, has turned.


class SurpriseWatch:
    """Compares the flown path in the present world with its last judgement.

    Every plan's world becomes the reference for the next surprise, whatever the plan decides (hysteresis).

    Parameters
    ----------
    flight : StateOwner
        The flown path and the rules.
    world_model : Situation
        The known world.
    reader : ListReader
        Knows the item being flown.

    Attributes
    ----------
    is_failing : bool
        Whether the rest of the flown path failed its last check.
    """

    def __init__(self, flight: StateOwner, world_model: WorldModel, reader: ListReader) -> None:
        self.is_failing = False
        self._flight, self._world_model, self._reader = flight, world_model, reader
        self._level = math.inf
        self._is_safe: bool | None = None
        self._known_tracks: dict[str, tuple[TrackState, ...]] = {}
        self._was_failing = True
        self._surprise = ""
        self._seen: tuple[float, int, tuple[object, ...]] | None = None
        self._rules: Rules | None = None
        self._looks = TokenBucket(LOOKS_HZ, LOOKS_AT_ONCE)

    def note_judgement(self, path: Path | None, *, is_failing: bool) -> None:
        """Note a judgement of the flown path, with which the next one is compared.

        Parameters
        ----------
        path : Path or None
            The rest of the flown path; None if there is none.
        is_failing : bool
            Whether the path fails the check; an emergency path may be above the threat limit.
        """
        self._level = math.inf if path is None else float(path.threat_levels.max())
        self.is_failing = self._was_failing = is_failing
        self._surprise, self._is_safe = "", None

    def note_known(self, tracks: Iterable[TrackState], *, is_answer: bool) -> None:
        """Note the vehicles' motion that a plan assumes: a vehicle that turns later is a surprise.

        Unless the plan answers a surprise, the motion that the plan before assumed is also remembered: a
        vehicle may turn so slowly that half of its turn was no surprise.

        Parameters
        ----------
        tracks : iterable of TrackState
            The tracks that the plan uses.
        is_answer : bool
            Whether the plan answers a surprise.
        """
        before = {} if is_answer else self._known_tracks
        self._known_tracks = {
            track.identity: (*before.get(track.identity, ())[-1:], track) for track in tracks
        }

    def look(self, now_s: float, *, at_once: bool = False) -> str:
        """Return how the flown path has become worse, in words; '' if it has not.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        at_once : bool
            Whether to judge again even if that was done often just before.
        """
        state, world_model = self._flight.state, self._world_model
        ownship = world_model.ownship.state(now_s)
        world = world_model.news
        if ownship is None or not state.may_act or not state.flies_to_goal:
            return ""
        is_same = world == self._seen and state.rules is self._rules
        if is_same or not (at_once or self._looks.takes(now_s)):
            return self._surprise
        self._seen, self._rules = world, state.rules
        start = begin(state, ownship, self._reader.current, is_urgent=True)
        snapshot = world_model.snapshot(now_s)
        state = self._flight.update_world(ownship, snapshot.picture)
        start = as_of_now(state, start, snapshot)
        self._surprise = self._worse(state, start)
        return self._surprise

    def _worse(self, state: FlightState, start: Start) -> str:
        """Return how the rest of the flown path has become worse, in words; '' if it has not."""
        rest, risk = start.rest, start.risk
        if rest is None or risk is None:
            return ""
        level, violations = float(rest.threat_levels.max()), violations_of_rest(state, rest)
        was_safe, self.is_failing = self._is_safe, bool(violations)
        if was_safe is None:
            self._is_safe = risk.total_s <= SAFE_S
        if violations and not self._was_failing:
            return f"flown path: {violations[0]}"
        if level > self._level + LEVEL_RISE_MIN:
            return f"threat on the flown path {self._level:.2f} -> {level:.2f}"
        if was_safe and risk.total_s > THREATENED_S:
            return f"a moving threat could reach the flown path, {risk.total_s:.0f} s of it"
        if turned := self._turned(rest, state):
            return f"{turned} turned towards the flown path"
        return ""

    def _turned(self, rest: Path, state: FlightState) -> str:
        """Return a vehicle that turned towards the flown path from a large lateral offset; '' without one."""
        ahead_s = float(state.mission.planning.sensing_horizon_m) / state.rules.vehicle.airspeed_cruise_m_s
        for track in state.picture.tracks:
            known = () if track.keeps_route else self._known_tracks.get(track.identity, ())
            if not known or passing_reaches(rest, track, ahead_s) >= 1.0:
                continue
            if any(passing_reaches(rest, then, ahead_s) > LATERAL_RADII for then in known):
                return track.identity
        return ""


def passing_reaches(path: Path, track: TrackState, ahead_s: float) -> float:
    """Return how close a vehicle that moves on as it does comes to the aircraft on a path, in threat radii.

    Parameters
    ----------
    path : Path
        The flown path.
    track : TrackState
        The vehicle and its motion.
    ahead_s : float
        Time to look ahead [s]: no vehicle keeps its course for longer.
    """
    begin_s = float(path.times_s[0])
    end_s = min(begin_s + ahead_s, float(path.times_s[-1]))
    times = np.append(path.times_s[path.times_s < end_s], end_s)
    at = np.column_stack([np.interp(times, path.times_s, path.positions_enu_m[:, axis]) for axis in (0, 1)])
    apart = at - track.places_enu_m(times)[:, :2]
    steps = np.diff(apart, axis=0)
    along = -(apart[:-1] * steps).sum(axis=1) / np.maximum((steps * steps).sum(axis=1), 1e-9)
    nearest = np.vstack([apart[-1], apart[:-1] + np.clip(along, 0.0, 1.0)[:, None] * steps])
    away = np.linalg.norm(nearest, axis=1) - track.circles_m(np.append(times[-1], times[1:]))
    return max(float(away.min()), 0.0) / track.max_threat_radius_m

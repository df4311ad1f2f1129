"""The known world: ownship, tracks and the snapshot, kept up to date by events."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from companion.config import MissionConfig
from companion.config.compose import world_of
from companion.config.rules import Rules
from companion.frames import direction_from_course
from companion.kernels.geometry.line_of_sight import sight_blocked
from companion.kernels.threat.fuzzy_threat import PASSES, point_threat
from companion.kernels.workspace import threat_scene
from companion.tracking.ownship import OwnshipEstimator, OwnshipSettings
from companion.tracking.tracker import Tracker
from companion.types.events import Event, TrackReport
from companion.types.state import Ownship
from companion.types.threat import TrackState
from companion.world.obstacles import packed_obstacles
from companion.world.snapshot import Snapshot

EYE_M = 2.0  # The eye of a ground vehicle is this high above the ground.


class TeamWatch(Protocol):
    """What is known of the members of a team."""

    @property
    def plans(self) -> tuple[object, ...]:
        """What the members announced."""

    def takes(self, identity: str, place_enu_m: tuple[float, float, float], stamp_s: float) -> bool:
        """Return whether a vehicle, at a place [m] at a time [s], is a member on its announced path."""

    def with_members(self, tracks: Iterable[TrackState], now_s: float) -> tuple[TrackState, ...]:
        """Return the tracks at a time [s] with the members on their announced paths."""


def _ownship_settings_of(mission: MissionConfig) -> OwnshipSettings:
    """Return the ages up to which telemetry is used, and how the aircraft turns, from a mission file."""
    use_by = mission.use_by
    return OwnshipSettings(
        position_max_age_s=use_by.position_s,
        attitude_max_age_s=use_by.attitude_s,
        airspeed_max_age_s=use_by.airspeed_s,
        wind_max_age_s=use_by.wind_s,
        jump_confirm_s=use_by.jump_confirm_s,
        coordination=mission.vehicle.coordination,
    )


class WorldModel:
    """Collects events and provides snapshots of the world.

    Parameters
    ----------
    rules : Rules
        The mission file in force, and the autopilot's fences.
    seed : int
        Seed of the particle filters.
    """

    def __init__(self, rules: Rules, seed: int) -> None:
        self._read(rules)
        mission = rules.mission
        self.ownship = OwnshipEstimator(mission.frame, _ownship_settings_of(mission))
        self.tracker = Tracker(mission.frame, mission.dynamic_threat_list, seed=seed)
        self._team: TeamWatch | None = None
        self.newest_track_s = -math.inf
        self.reports: Counter[str] = Counter()  # number of track reports by message

    def _read(self, rules: Rules) -> None:
        """Read the world and the threat model from a mission file."""
        mission = rules.mission
        self._rules = rules
        self._snapshot = world_of(mission)
        self._horizon_m = float(mission.planning.sensing_horizon_m)
        self._model = rules.settings.threat_model(rules.vehicle, float(mission.unit_m))
        self._fence()

    def _fence(self) -> None:
        """Make the autopilot's fences obstacles; they block neither sight nor moving threats."""
        packed = packed_obstacles(self._rules.obstacles, self._snapshot.bounds, self._snapshot.walls.ground)
        self._snapshot = replace(self._snapshot, obstacles=packed, obstacle_list=self._rules.obstacles)

    def follow_mission(self, rules: Rules) -> None:
        """Use another mission file from now on; radars that are the same stay sensed."""
        before, known = self._rules.mission.radars, self._snapshot.threats.known
        sensed = {radar for radar, is_known in zip(before, known, strict=True) if is_known}
        self._read(rules)
        self.ownship.set_settings(_ownship_settings_of(rules.mission))
        kept = np.array([radar in sensed for radar in rules.mission.radars], dtype=np.int64)
        self._snapshot = self._snapshot.with_known(np.maximum(self._snapshot.threats.known, kept))

    def follow_fences(self, rules: Rules) -> None:
        """Use other fences from now on."""
        self._rules = rules
        self._fence()

    def observe(self, event: Event, now_s: float) -> None:
        """Process one event."""
        if isinstance(event, TrackReport):
            if not self._rules.settings.strategies.minds_dts:
                return
            self.reports[event.source.partition(" ")[0]] += 1
            is_known = None if self._team is None else self._team.takes
            if self.tracker.observe(event, now_s, is_known):
                self.newest_track_s = now_s
        else:
            self.ownship.observe(event)

    def listen_to_team(self, team: TeamWatch) -> None:
        """Let members of a team fly their announced paths."""
        self._team = team

    def tracks(self, now_s: float) -> tuple[TrackState, ...]:
        """Return all vehicles as estimated at an instant; members of a team on their announced paths."""
        tracks = self.tracker.tracks(now_s)
        return tracks if self._team is None else self._team.with_members(tracks, now_s)

    @property
    def news(self) -> tuple[float, int, tuple[object, ...]]:
        """What differs once another vehicle, a radar or the path of a member has become known."""
        plans = () if self._team is None else self._team.plans
        return self.newest_track_s, self.num_known_threats, plans

    def snapshot(self, now_s: float) -> Snapshot:
        """Return the world now: sensed radars stay known, tracks are predicted to this instant."""
        state = self.ownship.state(now_s)
        snapshot = self._snapshot
        if state is not None:
            east, north, _ = state.position_enu_m
            self.tracker.note_ownship(east, north, state.velocity_m_s)
            snapshot = snapshot.with_known(snapshot.sensed(east, north, self._horizon_m))
            snapshot = replace(snapshot, wind_enu_m_s=state.wind_enu_m_s)
        self._snapshot = snapshot.with_tracks(now_s, self.tracks(now_s))
        return self._snapshot

    @property
    def num_known_threats(self) -> int:
        """Number of static threats that have been sensed."""
        return int(self._snapshot.threats.known.sum())

    def threat_at(self, state: Ownship, tracks: tuple[TrackState, ...]) -> float:
        """Return the threat level TI of the aircraft, from all radars of the mission and the tracked DTs."""
        x, y, z = state.position_enu_m
        is_plane, walls = self._snapshot.dimension == 2, self._snapshot.walls
        points, reach = np.zeros((max(len(tracks), 1), 4)), np.zeros(len(tracks))
        for row, radius, track in zip(points, range(len(tracks)), tracks, strict=False):
            row[:3] = track.position_enu_m
            if is_plane:
                row[2] = z
            reach[radius] = track.max_threat_radius_m
            row[3] = float(not sight_blocked(row[0], row[1], row[2] + EYE_M, x, y, z, walls))
            if track.flies_on:
                row[3] = PASSES * (abs(track.position_enu_m[2] - z) <= track.clear_up_m)
                row[2] = z
        everything = self._snapshot.threats._replace(known=np.ones_like(self._snapshot.threats.known))
        mu, nu = point_threat(
            x, y, z, direction_from_course(state.course_rad), state.flight_path_angle_rad,
            state.airspeed_m_s, 0.0, threat_scene(everything, points, reach, self._model),
        )  # fmt: skip
        return max(mu - nu, 0.0)

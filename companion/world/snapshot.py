"""The world at one instant: immutable and numbered, all that a plan depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.kernels.arrays import IntArray, Obstacles, Threats
from companion.types.threat import Obstacle, Radar, ThreatPicture, ThreatTree, TrackState
from companion.world.obstacles import packed_obstacles
from companion.world.threats import known_within, packed_threats


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What is known of the world.

    Parameters
    ----------
    number : int
        Counts up; plans name the snapshot they were made from.
    stamp_s : float
        Clock reading at which it is true.
    dimension : int
        2 or 3. In the plane, threats and DTs are taken to stand at the flight level.
    bounds : tuple of float
        East, north, up, each low and high [m].
    unit_m : float
        Metres in a planning unit.
    obstacles, walls : Obstacles
        What the aircraft keeps clear of, and what of that hides and stops moving threats: a fence does
        not.
    tracks : tuple of TrackState
        Moving threats as tracked.
    threat_trees : tuple of ThreatTree
        Their trees as the plan before left them.
    wind_enu_m_s : tuple of float
        Velocity of the air over the ground, east and north [m/s].
    """

    number: int
    stamp_s: float
    dimension: int
    unit_m: float
    bounds: tuple[float, float, float, float, float, float]
    obstacle_list: tuple[Obstacle, ...]
    radar_list: tuple[Radar, ...]
    obstacles: Obstacles
    walls: Obstacles
    threats: Threats
    tracks: tuple[TrackState, ...] = ()
    threat_trees: tuple[ThreatTree, ...] = ()
    wind_enu_m_s: tuple[float, float] = (0.0, 0.0)

    @property
    def picture(self) -> ThreatPicture:
        """What of it was sighted."""
        sensed = zip(self.radar_list, self.threats.known, strict=True)
        return ThreatPicture(tuple(radar for radar, is_known in sensed if is_known), self.tracks)

    @property
    def is_pursued(self) -> bool:
        """Whether anything is known that hunts."""
        return any(not track.flies_on for track in self.tracks)

    def with_tracks(self, stamp_s: float, tracks: Sequence[TrackState]) -> Snapshot:
        """The next snapshot, with new tracks."""
        return replace(self, number=self.number + 1, stamp_s=stamp_s, tracks=tuple(tracks))

    def with_threat_trees(self, trees: Sequence[ThreatTree]) -> Snapshot:
        """The same snapshot, with the trees a plan has grown."""
        return replace(self, threat_trees=tuple(trees))

    def with_known(self, known: IntArray) -> Snapshot:
        """The same snapshot, with the static threats known by now.

        Parameters
        ----------
        known : ndarray, shape (R,)
            1 for each radar that is known, else 0.
        """
        return replace(self, threats=self.threats._replace(known=np.ascontiguousarray(known)))

    def sensed(self, east_m: float, north_m: float, sensing_horizon_m: float) -> IntArray:
        """Which static threats are known from a position: those already known, and those in reach.

        Returns
        -------
        ndarray, shape (R,)
            1 for each radar that is known, else 0.
        """
        near: IntArray = known_within(self.threats, east_m, north_m, sensing_horizon_m)
        return np.maximum(self.threats.known, near)


def first_snapshot(
    *,
    dimension: int,
    unit_m: float,
    bounds: tuple[float, float, float, float, float, float],
    obstacles: Sequence[Obstacle],
    radars: Sequence[Radar],
    none_known: bool = True,
) -> Snapshot:
    """Build the fields once; by ``none_known`` static threats that are not listed are yet to be sensed."""
    packed = packed_obstacles(obstacles, bounds)
    threats = packed_threats(radars, packed, bounds)
    if none_known:
        threats = threats._replace(known=np.array([radar.is_listed for radar in radars], dtype=np.int64))
    return Snapshot(
        number=0,
        stamp_s=0.0,
        dimension=dimension,
        unit_m=unit_m,
        bounds=bounds,
        obstacle_list=tuple(obstacles),
        radar_list=tuple(radars),
        obstacles=packed,
        walls=packed,
        threats=threats,
    )

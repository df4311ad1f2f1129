"""The world at one instant: an immutable, numbered snapshot of everything that a plan depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.kernels.arrays import Ground, IntArray, Obstacles, Threats
from companion.types.threat import Obstacle, Radar, ThreatPicture, ThreatTree, TrackState
from companion.world.obstacles import packed_obstacles, packed_with
from companion.world.threats import known_within, packed_threats


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The known world at one instant.

    Parameters
    ----------
    number : int
        A serial number; a plan names the snapshot that it was made from.
    stamp_s : float
        The clock reading for which the snapshot holds [s].
    dimension : int
        2 or 3. In two dimensions threats and DTs are assumed to be at the flight level.
    unit_m : float
        The length of a planning unit [m].
    bounds : tuple of float
        East, north, up, each low and high [m].
    obstacles : Obstacles
        What the aircraft keeps clear of.
    walls : Obstacles
        The obstacles that block sight and moving threats. Fences are not among them.
    tracks : tuple of TrackState
        Moving threats as tracked.
    threat_trees : tuple of ThreatTree
        The threats' trees as the last plan left them.
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
        """The sighted threats: radars that are known, and all tracks."""
        sensed = zip(self.radar_list, self.threats.known, strict=True)
        return ThreatPicture(tuple(radar for radar, is_known in sensed if is_known), self.tracks)

    @property
    def is_pursued(self) -> bool:
        """Return whether any tracked vehicle is a pursuer."""
        return any(not track.flies_on for track in self.tracks)

    def with_tracks(self, stamp_s: float, tracks: Sequence[TrackState]) -> Snapshot:
        """Return the next snapshot, with new tracks."""
        return replace(self, number=self.number + 1, stamp_s=stamp_s, tracks=tuple(tracks))

    def with_threat_trees(self, trees: Sequence[ThreatTree]) -> Snapshot:
        """Return the same snapshot with the trees that a plan has grown."""
        return replace(self, threat_trees=tuple(trees))

    def with_prisms(self, prisms: Sequence[Obstacle]) -> Snapshot:
        """Return the same snapshot with more prisms that the aircraft keeps clear of; they block no sight."""
        return replace(self, obstacles=packed_with(self.obstacles, prisms, self.bounds))

    def with_known(self, known: IntArray) -> Snapshot:
        """Return the same snapshot with another set of known static threats.

        Parameters
        ----------
        known : ndarray, shape (R,)
            1 for each radar that is known, 0 for the others.
        """
        return replace(self, threats=self.threats._replace(known=np.ascontiguousarray(known)))

    def sensed(self, east_m: float, north_m: float, sensing_horizon_m: float) -> IntArray:
        """Return which static threats are known at a position: those already known, and those within range.

        Parameters
        ----------
        east_m, north_m : float
            The aircraft's position [m].
        sensing_horizon_m : float
            The range of the sensors [m].

        Returns
        -------
        ndarray, shape (R,)
            1 for each radar that is known, 0 for the others.
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
    ground: Ground | None = None,
    none_known: bool = True,
) -> Snapshot:
    """Build the obstacles and threats once; with ``none_known`` only listed radars are known at first."""
    packed = packed_obstacles(obstacles, bounds, ground)
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

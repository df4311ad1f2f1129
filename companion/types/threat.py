"""Obstacles and threats as the mission file or the link gives them, in the local frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An upright prism.

    Parameters
    ----------
    polygon_enu_m : ndarray, shape (N, 2)
        Simple polygon, east and north [m], not closed.
    base_m, top_m : float
        Up coordinates between which it stands [m].
    """

    name: str
    polygon_enu_m: FloatArray
    base_m: float
    top_m: float

    def __post_init__(self) -> None:
        polygon = np.ascontiguousarray(self.polygon_enu_m, dtype=np.float64)
        polygon.setflags(write=False)
        object.__setattr__(self, "polygon_enu_m", polygon)


@dataclass(frozen=True, slots=True)
class Radar:
    """A static threat (paper 3.1).

    Parameters
    ----------
    position_enu_m : tuple of float
        East, north, up [m].
    max_threat_radius_m : float
        R_max, slant [m].
    boundary_coefficient_per_m : float
        K_R of the detection boundary h_B = K_R·L² [1/m]; 0 in the plane.
    is_listed : bool
        Whether it is known before it is sensed.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    max_threat_radius_m: float
    boundary_coefficient_per_m: float = 0.0
    is_listed: bool = False


@dataclass(frozen=True, slots=True)
class DynamicThreat:
    """A moving threat as the mission file describes its kind.

    Parameters
    ----------
    position_enu_m : tuple of float
        East, north and up of its start [m]; up is the ground's height.
    speed_m_s : float
        v_D; 0 is a parked one.
    max_threat_radius_m : float
        RD_max [m].
    turn_radius_m : float
        Smallest turn radius [m].
    identity : str
        As it is reported, for instance ``icao:00ABCD``; '' where it is told by its place.
    system_id : int or None
        Who reports it; None: whoever does.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    speed_m_s: float
    max_threat_radius_m: float
    turn_radius_m: float = 15.0
    identity: str = ""
    system_id: int | None = None


@dataclass(frozen=True, slots=True)
class TrackState:
    """A moving threat as it is tracked: the particle cloud's moments and where it is going.

    Parameters
    ----------
    stamp_s : float
        Clock reading at which the estimate is true.
    position_enu_m, velocity_enu_m_s : tuple of float
        Mean, east, north, up; the up part is the reported one.
    covariance : ndarray, shape (4, 4)
        Covariance of [east, east speed, north, north speed], shape (4, 4) [m², m²/s, m²/s²].
    is_airborne : bool
        Ground vehicles are bound by obstacles, airborne ones are not.
    flies_on : bool
        Whether it hunts nobody, and is taken to fly on as it does.
    """

    stamp_s: float
    identity: str
    position_enu_m: tuple[float, float, float]
    velocity_enu_m_s: tuple[float, float, float]
    covariance: FloatArray
    speed_max_m_s: float
    max_threat_radius_m: float
    turn_radius_m: float
    is_airborne: bool
    observed_s: float
    flies_on: bool = False


@dataclass(frozen=True, slots=True)
class ThreatPicture:
    """What was sighted by now.

    Parameters
    ----------
    radars : tuple of Radar
        Static threats that were sensed.
    tracks : tuple of TrackState
        Moving ones.
    """

    radars: tuple[Radar, ...] = ()
    tracks: tuple[TrackState, ...] = ()


@dataclass(frozen=True, slots=True)
class ThreatTree:
    """The tree of ways that a plan's RS estimator grew for a moving threat, for the next plan to carry on.

    Parameters
    ----------
    position_enu_m : ndarray, shape (N, 3)
        Places; row 0 is the root [m].
    heading_rad : ndarray, shape (N,)
        Counter-clockwise from east on arrival [rad].
    parent : ndarray of int64, shape (N,)
        Parents come before their children; -1 at the root.
    time_s : ndarray, shape (N,)
        TS: earliest arrival, clock reading.
    """

    identity: str
    is_airborne: bool
    position_enu_m: FloatArray
    heading_rad: FloatArray
    parent: np.ndarray[tuple[int], np.dtype[np.int64]]
    time_s: FloatArray

    def __post_init__(self) -> None:
        for values in (self.position_enu_m, self.heading_rad, self.parent, self.time_s):
            values.setflags(write=False)

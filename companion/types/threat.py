"""Obstacles and threats from the mission file and from the link, in the local frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray

WELL_CLEAR_UP_M = 76.2  # Vertical separation of well clear: 250 ft, ASTM F3442.
HEIGHT_STD_M = 4.0  # Standard deviation of a reported height, where the report states none.
REPORTED_SPEED_MAX_M_S = 526.0  # The most that ADS-B says of a subsonic aircraft: 1,021.5 kt (RTCA DO-260B).
# An aircraft that turns or climbs is expected to do so for this time, and then to fly straight.
TURNS_S = 30.0


# Returns from which up coordinate on (N,) [m] a radar sees over places (N, 2), east and north [m]. It is
# minus infinity where nothing is hidden, plus infinity where everything is.
SightFloor = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An upright prism.

    Parameters
    ----------
    polygon_enu_m : ndarray, shape (N, 2)
        Simple polygon, east and north [m], not closed.
    base_m, top_m : float
        Up coordinates of bottom and top [m].
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
        R_max, a slant distance [m].
    boundary_coefficient_per_m : float
        K_R of the detection boundary h_B = K_R·L² [1/m]; 0 in two dimensions.
    is_listed : bool
        True if it is known before it is sensed.
    lowest_seen_m : SightFloor, optional
        What limits its sight besides range, boundary, obstacles and ground; by default nothing.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    max_threat_radius_m: float
    boundary_coefficient_per_m: float = 0.0
    is_listed: bool = False
    lowest_seen_m: SightFloor | None = None


@dataclass(frozen=True, slots=True)
class DynamicThreat:
    """A kind of moving threat from the mission file.

    Parameters
    ----------
    position_enu_m : tuple of float
        East, north and up of its start [m]; up is the height of the ground.
    speed_m_s : float
        v_D; 0 for a parked vehicle [m/s].
    max_threat_radius_m : float
        RD_max [m].
    turn_radius_m : float
        Smallest turn radius [m].
    identity : str
        Identity in reports, for instance ``icao:00ABCD``; '' if it is recognised by its position.
    system_id : int or None
        System that reports it; None for any.
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
    """A tracked vehicle: the moments of the particle cloud and its properties.

    Parameters
    ----------
    stamp_s : float
        Clock reading of the estimate [s].
    position_enu_m, velocity_enu_m_s : tuple of float
        Mean east, north, up; the up part is as reported [m, m/s].
    covariance : ndarray, shape (4, 4)
        Covariance of [east, east speed, north, north speed], shape (4, 4) [m², m²/s, m²/s²].
    is_airborne : bool
        True for an airborne vehicle; obstacles bound the motion of ground vehicles only.
    flies_on : bool
        True if it is no pursuer and is assumed to fly on as it does.
    turn_rate_rad_s : float
        How fast an aircraft that flies on turns, counter-clockwise [rad/s].
    clear_up_m : float
        Vertical separation that an aircraft that flies on must have [m]; the horizontal one is
        ``max_threat_radius_m``.
    height_std_m : float
        Standard deviation of the height [m].
    route : ndarray, shape (N, 4), or None
        Clock reading [s], east, north and up [m] of where it says that it will be, in the order of time. It
        goes on after the last row as it did before it.
    keeps_route : bool
        True if it flies its route for certain; otherwise it may also fly straight on from now.
    circle_m : float
        Radius of the circle that it flies about the last place of its route [m].
    circles_from_s : float
        Clock reading from which on it may be anywhere in that circle [s].
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
    turn_rate_rad_s: float = 0.0
    clear_up_m: float = WELL_CLEAR_UP_M
    height_std_m: float = HEIGHT_STD_M
    route: FloatArray | None = None
    keeps_route: bool = False
    circle_m: float = 0.0
    circles_from_s: float = math.inf

    def circles_m(self, times_s: FloatArray) -> FloatArray:
        """Return how far it may be from its place, as it flies a circle about it, (N,) [m].

        Parameters
        ----------
        times_s : ndarray, shape (N,)
            Clock readings [s].
        """
        return np.where(times_s >= self.circles_from_s, self.circle_m, 0.0)

    def places_enu_m(self, times_s: FloatArray) -> FloatArray:
        """Return where it will be, (N, 3) [m].

        It flies its route. Without one it turns and climbs on for :data:`TURNS_S`, and flies straight and
        level then.

        Parameters
        ----------
        times_s : ndarray, shape (N,)
            Clock readings [s].
        """
        if self.route is not None:
            return places_on_route(self.route, times_s)
        ahead = times_s - self.stamp_s
        turning = np.clip(ahead, 0.0, TURNS_S)
        east, north, up = self.velocity_enu_m_s
        turned, straight = self.turn_rate_rad_s * turning, ahead - turning
        # The arc's chord has half of the turn's direction, and sin(φ/2)/(φ/2) of the arc's length.
        chord = turning * np.sinc(0.5 * turned / np.pi)
        half = (east + 1j * north) * (chord * np.exp(0.5j * turned) + straight * np.exp(1j * turned))
        moved = np.column_stack([half.real, half.imag, up * np.minimum(ahead, TURNS_S)])
        return np.asarray(np.asarray(self.position_enu_m) + moved)


def places_on_route(route: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the places on a route.

    Parameters
    ----------
    route : ndarray, shape (M, 4)
        Clock reading [s], east, north, up [m], at least two rows. It goes on after the last as before it.
    times_s : ndarray, shape (N,)
        Clock readings [s].

    Returns
    -------
    ndarray, shape (N, 3)
        East, north, up [m].
    """
    row = np.searchsorted(route[1:-1, 0], times_s, side="right")
    begins, ends = route[row], route[row + 1]
    share = np.maximum(times_s - begins[:, 0], 0.0) / (ends[:, 0] - begins[:, 0])
    return np.asarray(begins[:, 1:] + share[:, None] * (ends[:, 1:] - begins[:, 1:]))


@dataclass(frozen=True, slots=True)
class ThreatPicture:
    """Threats sighted so far.

    Parameters
    ----------
    radars : tuple of Radar
        Static threats that were sensed.
    tracks : tuple of TrackState
        Moving threats.
    """

    radars: tuple[Radar, ...] = ()
    tracks: tuple[TrackState, ...] = ()


@dataclass(frozen=True, slots=True)
class ThreatTree:
    """The tree of motions that a plan's RS estimator grew for a moving threat; the next plan extends it.

    Parameters
    ----------
    position_enu_m : ndarray, shape (N, 3)
        Positions; row 0 is the root [m].
    heading_rad : ndarray, shape (N,)
        Heading on arrival, counter-clockwise from east [rad].
    parent : ndarray of int64, shape (N,)
        Row of the parent, which precedes its children; -1 at the root.
    time_s : ndarray, shape (N,)
        TS: clock reading of the earliest arrival [s].
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

"""The geometry of one flight and one threat over time."""

from __future__ import annotations

from dataclasses import dataclass

from companion.frames import FloatArray


@dataclass(frozen=True, slots=True)
class Closest:
    """The closest approach.

    Parameters
    ----------
    stamp_s : float
        Time of the closest approach [s].
    distance_m : float
        Slant distance [m].
    own_enu_m, other_enu_m : tuple of float
        East, north, up of the aircraft and of the threat [m].
    """

    stamp_s: float
    distance_m: float
    own_enu_m: tuple[float, float, float]
    other_enu_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Encounter:
    """One threat over a flight: its distances, and when the aircraft was in its reach and in its sight.

    Parameters
    ----------
    name : str
        Name of the threat.
    reach_m : float
        Slant distance up to which it is a threat: RD_max, or a radar's R_max [m].
    is_moving : bool
        True for a dynamic threat, false for a radar.
    times_s : ndarray, shape (N,)
        Instants between the first and the last that both paths share [s].
    distances_m : ndarray, shape (N,)
        Slant distances at these instants; NaN where a path has a gap [m].
    levels : ndarray, shape (S,)
        Membership (1) at the flown path's waypoints, one per second, and at ten points between each two. The
        instants are the same for all threats of a flight.
    in_reach_s, in_sight_s : ndarray, shape (K, 2)
        Start and end of the periods in reach, and of those in reach and in sight [s].
    closest : Closest or None
        None if the two paths share no time.
    """

    name: str
    reach_m: float
    is_moving: bool
    times_s: FloatArray
    distances_m: FloatArray
    levels: FloatArray
    in_reach_s: FloatArray
    in_sight_s: FloatArray
    closest: Closest | None

"""What an aircraft and one threat were to each other over a flight."""

from __future__ import annotations

from dataclasses import dataclass

from companion.frames import FloatArray


@dataclass(frozen=True, slots=True)
class Closest:
    """The closest approach.

    Parameters
    ----------
    stamp_s : float
        When it was [s].
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
    """One threat over a flight: how near it came, and when it had the aircraft in reach and in sight.

    Parameters
    ----------
    name : str
        The threat's.
    reach_m : float
        Slant distance up to which it is a threat: RD_max, or a radar's R_max [m].
    is_moving : bool
        Whether it is a dynamic threat, and no radar.
    times_s : ndarray, shape (N,)
        Instants between the first and the last that both paths share [s].
    distances_m : ndarray, shape (N,)
        Slant distances then; NaN where a path has a gap [m].
    levels : ndarray, shape (S,)
        Membership (1) at the flown path's waypoints, one a second, and at ten points between each two; the
        same instants for all threats of a flight.
    in_reach_s, in_sight_s : ndarray, shape (K, 2)
        Stretches of time, from and to: in reach, and in reach and in sight [s].
    closest : Closest or None
        None where the two share no time.
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

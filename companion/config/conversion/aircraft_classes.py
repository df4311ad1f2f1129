"""Classes of aircraft to begin with: speeds, turns and horizons of the shipped missions."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AircraftClass:
    """Performance of a class, as in the sections ``vehicle`` and ``planning`` of a mission file.

    Parameters
    ----------
    words : str
        Description for people.
    unit_m : float
        Metres in one planning unit.
    airspeeds_m_s : tuple of float
        Lowest, cruise and highest true airspeed [m/s].
    penetration_speed_m_s : float
        v_p of the non-membership function [m/s].
    turn_radius_min_m : float
        Radius of the tightest turn at cruise [m]; straight legs between turns are as long.
    sensing_horizon_m : float
        Distance within which unlisted radars are sensed [m].
    """

    words: str
    unit_m: float
    airspeeds_m_s: tuple[float, float, float]
    penetration_speed_m_s: float
    turn_radius_min_m: float
    sensing_horizon_m: float


DEFAULT_CLASS = "medium"
CLASSES = {
    "slow": AircraftClass("14 m/s, turns of 30 m", 14, (12.5, 14, 20), 18, 30, 350),
    "medium": AircraftClass("25 m/s, turns of 125 m", 25, (12.5, 25, 37.5), 30, 125, 825),
    "fast": AircraftClass("35 m/s, turns of 150 m", 35, (22, 35, 37.5), 36, 150, 1150),
}
_TIME_HORIZON_S, _TOTAL_PLANNING_TIME_S = 15, 250


def sections_text(aircraft: AircraftClass) -> str:
    """Return the sections ``vehicle`` and ``planning`` of a mission file for a class, with comments."""
    low, cruise, high = aircraft.airspeeds_m_s
    return f"""\
# The aircraft: change these to what yours flies. companion identify finds its noise in recorded flights.
vehicle:
  airspeed_min_m_s: {low:g}
  airspeed_max_m_s: {high:g}
  airspeed_cruise_m_s: {cruise:g}        # true airspeed that missions command
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: {aircraft.turn_radius_min_m:g}         # tightest turn at cruise without losing height
  straight_length_min_m: {aircraft.turn_radius_min_m:g}     # shortest straight flight between two turns
  penetration_speed_m_s: {aircraft.penetration_speed_m_s:g}      # a higher airspeed lowers radars' threat
planning:
  sensing_horizon_m: {aircraft.sensing_horizon_m:g}         # a larger value turns away from threats earlier
  time_horizon_s: {_TIME_HORIZON_S}             # longest time between two plans
  total_planning_time_s: {_TOTAL_PLANNING_TIME_S}
"""

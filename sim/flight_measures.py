"""Measures of a simulated flight from the true paths: what threatened it, how long and how much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.assurance.encounters import (
    Masks,
    ThreatHistory,
    aggregated_threat,
    encounter_with,
    merged_intervals,
    radar_threats,
    total_duration_s,
    total_threat,
)
from companion.types.encounter import Encounter
from companion.types.threat import DynamicThreat, Radar
from .truth import Truth

NEVER = math.inf

Measures = dict[str, float]


@dataclass(frozen=True, slots=True)
class FlightMeasures:
    """The encounters of a flight with its threats.

    Parameters
    ----------
    dynamic_threats, radars : tuple of Encounter
        One each, in the mission file's order.
    """

    dynamic_threats: tuple[Encounter, ...]
    radars: tuple[Encounter, ...]

    @property
    def num_threatening(self) -> int:
        """Number of dynamic threats that had the aircraft in reach and in sight."""
        return sum(len(entry.in_sight_s) > 0 for entry in self.dynamic_threats)

    def over_all(self) -> Measures:
        """Measures of all dynamic threats together, then of all radars."""
        return dynamic_threat_measures(self.dynamic_threats) | {
            "seconds_in_radar": total_duration_s(
                merged_intervals(*(entry.in_sight_s for entry in self.radars))
            ),
            "TTA": total_threat(self.radars),
            "ATP": aggregated_threat(self.radars),
        }

    def by_name(self) -> dict[str, Measures]:
        """Measures of each dynamic threat."""
        return {entry.name: dynamic_threat_measures([entry]) for entry in self.dynamic_threats}


def dynamic_threat_measures(encounters: Sequence[Encounter]) -> Measures:
    """The measures of one or several dynamic threats: seconds in which any of them, and the nearest approach.

    Values of events that never happened are infinite.
    """
    in_sight = merged_intervals(*(entry.in_sight_s for entry in encounters))
    known = [entry.closest for entry in encounters if entry.closest is not None]
    nearest = min(known, key=lambda closest: closest.distance_m, default=None)
    return {
        "seconds_in_reach": total_duration_s(merged_intervals(*(entry.in_reach_s for entry in encounters))),
        "seconds_in_reach_and_sight": total_duration_s(in_sight),
        "t_f_s": float(in_sight[0, 0]) if len(in_sight) else NEVER,
        "miss_distance_m": NEVER if nearest is None else nearest.distance_m,
        "miss_s": NEVER if nearest is None else nearest.stamp_s,
        "TDTA": total_threat(encounters),
        "ADTP": aggregated_threat(encounters),
    }


def measured(truth: Truth, threats: Sequence[DynamicThreat], radars: Sequence[Radar]) -> FlightMeasures:
    """Return the measures of a flight.

    Parameters
    ----------
    truth : Truth
        What really happened.
    threats : sequence of DynamicThreat
        The mission file's threats, found by their names, at their heights.
    radars : sequence of Radar
        The mission file's radars, whether or not they were sensed.
    """
    flown, masks = np.array(truth.path), Masks(truth.obstacles, truth.ground)
    moving = []
    for threat in threats:
        rows = np.array(truth.threat_paths[threat.name])
        height = np.full(len(rows), threat.position_enu_m[2])
        moving.append(ThreatHistory(threat.name, threat.max_threat_radius_m, np.column_stack([rows, height])))
    return FlightMeasures(
        tuple(encounter_with(threat, flown, masks) for threat in moving),
        tuple(encounter_with(radar, flown, masks) for radar in radar_threats(radars, flown)),
    )

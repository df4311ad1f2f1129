"""The moving threats of a mission file, set up at their starts."""

from __future__ import annotations

from collections.abc import Sequence

from companion.config import MissionConfig
from companion.config.models import DynamicThreatConfig
from .passing_aircraft import PassingAircraft
from .pursuer import CLEARANCE_M, Pursuer
from .roads import Roads

Pursuers = Sequence[tuple[str, Pursuer | PassingAircraft]]  # each with its name


def pursuers_of(mission: MissionConfig) -> Pursuers:
    """Each moving threat by its name, standing or ready to drive about the obstacles."""
    bounds = mission.bounds
    box = (bounds.east_m[0], bounds.north_m[0], bounds.east_m[1], bounds.north_m[1])
    moving = [
        entry for entry in mission.dynamic_threats if entry.speed_m_s > 0 and entry.behaviour != "stand"
    ]
    roads = Roads(mission.obstacle_list if moving else (), box, CLEARANCE_M)
    return [(entry.name, _driver_of(entry, roads)) for entry in mission.dynamic_threats]


def _driver_of(entry: DynamicThreatConfig, roads: Roads) -> Pursuer:
    driver = Pursuer(
        roads,
        (float(entry.east_m), float(entry.north_m)),
        0.0 if entry.behaviour == "stand" else float(entry.speed_m_s),
        float(entry.turn_radius_m),
    )
    if entry.behaviour == "drive":
        driver.follow(entry.route_enu_m)
    return driver

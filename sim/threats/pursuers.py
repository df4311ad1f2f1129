"""The moving threats of a mission file, set up at their starts."""

from __future__ import annotations

from companion.config import MissionConfig
from sim.threats.pursuer import CLEARANCE_M, Pursuer
from sim.threats.roads import Roads

Pursuers = list[tuple[str, Pursuer]]  # each with its name


def pursuers_of(mission: MissionConfig) -> Pursuers:
    """Each moving threat by its name, standing or ready to drive about the obstacles."""
    bounds = mission.bounds
    box = (bounds.east_m[0], bounds.north_m[0], bounds.east_m[1], bounds.north_m[1])
    moving = [
        entry for entry in mission.dynamic_threats if entry.speed_m_s > 0 and entry.behaviour == "pursue"
    ]
    roads = Roads(mission.obstacle_list if moving else (), box, CLEARANCE_M)
    return [
        (
            entry.name,
            Pursuer(
                roads,
                (float(entry.east_m), float(entry.north_m)),
                float(entry.speed_m_s) if entry.behaviour == "pursue" else 0.0,
                float(entry.turn_radius_m),
            ),
        )
        for entry in mission.dynamic_threats
    ]

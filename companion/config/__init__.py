"""Mission files: reading, validation, frozen settings, and the rules and summaries made of them.

This package composes the settings of every layer; it uses no running part of the service.

>>> from companion.config import load_mission
>>> load_mission("mission_configs/first-flight.yaml").vehicle.airspeed_cruise_m_s
25.0
"""

from companion.config.load import load_mission, mission_from_text, mission_text, require_goals
from companion.config.models import (
    Authority,
    Bounds,
    DynamicThreatConfig,
    Goal,
    LinkConfig,
    MissionConfig,
    ObstacleConfig,
    Origin,
    PlanningConfig,
    RadarConfig,
    SigningConfig,
    Start,
    Vehicle,
)
from companion.config.sections.simulation_section import Simulation

__all__ = [
    "Authority",
    "Bounds",
    "DynamicThreatConfig",
    "Goal",
    "LinkConfig",
    "MissionConfig",
    "ObstacleConfig",
    "Origin",
    "PlanningConfig",
    "RadarConfig",
    "SigningConfig",
    "Simulation",
    "Start",
    "Vehicle",
    "load_mission",
    "mission_from_text",
    "mission_text",
    "require_goals",
]

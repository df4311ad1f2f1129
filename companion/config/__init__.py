"""Mission files: read, checked, and handed out as frozen settings; the rules and summaries made of them.

Touches every layer's settings, which it composes, and no running part of the service.

>>> from companion.config import load_mission
>>> load_mission("mission_configs/first-flight.yaml").vehicle.airspeed_cruise_m_s
25.0
"""

from companion.config.load import load_mission, mission_from_text, mission_text
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
    Simulation,
    Start,
    Vehicle,
)

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
]

"""Mission files: reading, validation, frozen settings, and the rules and summaries made of them.

This package composes the settings of every layer; it uses no running part of the service.

>>> from companion.config import load_mission
>>> load_mission("mission_configs/first-flight.yaml").vehicle.airspeed_cruise_m_s
25.0
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from companion.config.compose import world_of
    from companion.config.load import (
        load_mission,
        mission_from_text,
        mission_text,
        require_goals,
        require_own_system,
    )
    from companion.config.models import (
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
    from companion.config.sections.authority_section import Authority
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
    "require_own_system",
    "world_of",
]
_MODULES = {
    "Authority": "sections.authority_section",
    "Simulation": "sections.simulation_section",
    "load_mission": "load",
    "mission_from_text": "load",
    "mission_text": "load",
    "require_goals": "load",
    "require_own_system": "load",
    "world_of": "compose",
}  # The other names are those of ``models``.


def __getattr__(name: str) -> object:
    """Import a name's module on first access: many commands read no mission file."""
    if name in __all__:
        return getattr(importlib.import_module(f"{__name__}.{_MODULES.get(name, 'models')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""Which changes of a mission file a running service takes up, and which need a restart."""

from __future__ import annotations

from pathlib import Path

from companion.config import MissionConfig, load_mission
from companion.errors import ConfigError

# What was opened, recorded or tracked under these cannot be changed under way: the link and its signing,
# the frame that everything is in, the flight's name and seed, and which vehicle a track is.
FIXED = (
    "name",
    "dimension",
    "unit_m",
    "origin",
    "link",
    "dynamic_threats",
    "goals_from_autopilot",
    "planning.seed",
)


def changed_mission(running: MissionConfig, file: Path) -> MissionConfig:
    """Read a mission file again, for a service that runs by it.

    Raises
    ------
    ConfigError
        For the first thing wrong with it, and for a change that needs a restart.
    """
    mission = load_mission(file)
    for key in FIXED:
        before, after = _value(running, key), _value(mission, key)
        if before != after:
            name = "goals" if key == "goals_from_autopilot" else key
            raise ConfigError(
                str(file), None, name, "a change", "what the service runs by; a restart takes it up"
            )
    return mission


def _value(mission: MissionConfig, key: str) -> object:
    value: object = mission
    for part in key.split("."):
        value = getattr(value, part)
    return value

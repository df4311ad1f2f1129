"""Reloading of the mission file: which changes a running service accepts, and which need a restart."""

from __future__ import annotations

from pathlib import Path

from companion.config import MissionConfig, mission_from_text, mission_text
from companion.config.compose import world_of
from companion.errors import ConfigError
from companion.types.threat import Obstacle
from companion.world.obstacles import packed_obstacles

# These keys cannot change during a flight: the link and its signing are open, positions refer to the frame,
# the recording has the name and seed, and tracks are assigned to the threats.
FIXED = (
    "name",
    "dimension",
    "unit_m",
    "origin",
    "link",
    "dynamic_threats",
    "goals_from_autopilot",
    "shares_goals",
    "planning.seed",
)


def changed_mission(running: MissionConfig, file: Path) -> tuple[MissionConfig, str]:
    """Read a mission file again for a running service; takes seconds for a large file.

    Returns
    -------
    MissionConfig
        The mission.
    str
        Text of the file.

    Raises
    ------
    ConfigError
        For the first error found, and for a change that needs a restart.
    """
    text = mission_text(file)
    mission = mission_from_text(text, str(file))
    check_change(running, mission, str(file))
    return mission, text


def prepared_mission(
    running: MissionConfig, file: Path, fences: tuple[Obstacle, ...]
) -> tuple[MissionConfig, str]:
    """Read a mission file again, and prepare its obstacles so that the flight finds them in the cache.

    Parameters
    ----------
    running : MissionConfig
        Mission that is flown.
    file : Path
        The mission file.
    fences : tuple of Obstacle
        Fences of the autopilot, which are obstacles, too.

    Returns
    -------
    MissionConfig
        The mission.
    str
        Text of the file.

    Raises
    ------
    ConfigError
        As for :func:`changed_mission`.
    """
    mission, text = changed_mission(running, file)
    packed_obstacles((*mission.obstacle_list, *fences), world_of(mission).bounds)
    return mission, text


def check_change(running: MissionConfig, mission: MissionConfig, file: str) -> None:
    """Check that a running service can change to a mission.

    Raises
    ------
    ConfigError
        For a change that needs a restart.
    """
    for key in (*FIXED, *(("goals",) if running.shares_goals else ())):
        before, after = _value(running, key), _value(mission, key)
        if before != after:
            name = {"goals_from_autopilot": "goals", "shares_goals": "team.share_goals"}.get(key, key)
            raise ConfigError(file, None, name, "a change", "what the service runs by; a restart takes it up")


def _value(mission: MissionConfig, key: str) -> object:
    value: object = mission
    for part in key.split("."):
        value = getattr(value, part)
    return value

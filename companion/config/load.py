"""Reads a mission file into settings, or raises an error that says what to change in which line."""

from __future__ import annotations

import json
from pathlib import Path

import yaml
from pydantic import ValidationError

from companion.config.checks import findings
from companion.config.explain import explained
from companion.config.models import MissionConfig
from companion.config.sections.geographic_places import local_document
from companion.config.source import SIZE_MAX, Document, parse
from companion.errors import ConfigError
from companion.safe_files import read_file

BYTES_MAX = 4 * SIZE_MAX  # A character takes at most four bytes.


def load_mission(path: str | Path) -> MissionConfig:
    """Read and validate a mission file.

    Parameters
    ----------
    path : str or Path
        YAML file, such as those in ``mission_configs``.

    Raises
    ------
    ConfigError
        For the first error found.
    """
    return mission_from_text(mission_text(path), str(path))


def mission_text(path: str | Path) -> str:
    """Return the text of a mission file; refuses files that are too large or not regular.

    Raises
    ------
    ConfigError
        If it cannot be read.
    """
    file = str(path)
    try:
        return read_file(Path(path), BYTES_MAX, follow=True).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(file, None, "file", "bytes that are not UTF-8", "a text file") from None
    except (OSError, ValueError) as error:  # A NUL character in the path raises ValueError.
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(file, None, "file", reason.lower(), "a mission file that can be read") from None


def mission_from_text(text: str, file: str) -> MissionConfig:
    """Read a mission from YAML text; ``file`` is its name in messages.

    Raises
    ------
    ConfigError
        For the first error found.
    """
    return mission_from_document(parse(text, file))


def mission_from_document(document: Document) -> MissionConfig:
    """Read a mission from a parsed file, whose values may have been changed.

    Raises
    ------
    ConfigError
        For the first error found.
    """
    document = local_document(document)
    try:
        config = MissionConfig.model_validate(document.data)
    except ValidationError as error:
        raise explained(document, error.errors(include_url=False)) from None
    config = _with_absolute_paths(config, document.file)
    for path, expected in findings(config):
        raise document.error(path, expected)
    return config


def faults_of(document: Document) -> tuple[MissionConfig | None, list[ConfigError]]:
    """Return a mission, None if it is wrong, and everything that is wrong with it, in the order of the file.

    The first error of :func:`mission_from_document` is among them. A place that cannot be converted hides the
    others, and a wrong value hides the relations between values.

    Parameters
    ----------
    document : Document
        The parsed mission file.
    """
    try:
        local = local_document(document)
        config = _with_absolute_paths(MissionConfig.model_validate(local.data), document.file)
    except ConfigError as error:
        return None, [error]
    except ValidationError as error:
        faults = [explained(local, [entry]) for entry in error.errors(include_url=False)]
        return None, sorted(faults, key=lambda entry: entry.line or 0)
    found = [local.error(path, expected) for path, expected in findings(config)]
    return None if found else config, found


def _with_absolute_paths(config: MissionConfig, file: str) -> MissionConfig:
    """Return a mission whose relative file names are resolved against the mission file's folder."""
    terrain = config.terrain
    if terrain is None or terrain.file is None:
        return config
    place = str((Path(file).parent / terrain.file).absolute())
    return config.model_copy(update={"terrain": terrain.model_copy(update={"file": place})})


def text_of(config: MissionConfig) -> str:
    """Return the text of a mission file for a mission that was not read from one."""
    return yaml.safe_dump(config.model_dump(mode="json", exclude_none=True), sort_keys=False)


def recorded_text(text: str, config: MissionConfig) -> str:
    """Return the text of a mission file for a recording, which lies elsewhere: its map has an absolute path.

    Parameters
    ----------
    text : str
        The mission file; empty if the mission was not read from one.
    config : MissionConfig
        The mission as it was read.
    """
    if not text:
        return text_of(config)
    terrain = config.terrain
    if terrain is None or terrain.file is None:
        return text
    _, begin, end = parse(text, "recording").places["terrain", "file"]
    return text[:begin] + json.dumps(terrain.file) + text[end:]


def require_goals(config: MissionConfig, file: str) -> None:
    """Check that a mission lists its goals, since no autopilot can be asked.

    Raises
    ------
    ConfigError
        If it leaves them to the autopilot.
    """
    if config.goals_from_autopilot:
        raise ConfigError(file, None, "goals", "from_autopilot", "a list of goals: no autopilot is asked")


def require_own_system(config: MissionConfig, file: str) -> None:
    """Check that a team's mission file names the own autopilot, since radios bring heartbeats of the others.

    Raises
    ------
    ConfigError
        If there is a team, and ``link.vehicle_system_id`` is none of its members.
    """
    members, own = config.team_members, config.link.vehicle_system_id
    if members and own not in members:
        listed = ", ".join(str(member) for member in members)
        found = "nothing" if own is None else str(own)
        expected = f"the own autopilot's of team.members, {listed}: those of others are received, too"
        raise ConfigError(file, None, "link.vehicle_system_id", found, expected)

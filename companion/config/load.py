"""From a mission file to settings, or to one error that says what to change where."""

from __future__ import annotations

from pathlib import Path

import yaml
from pydantic import ValidationError

from companion.config.checks import findings
from companion.config.explain import explained
from companion.config.models import MissionConfig
from companion.config.source import SIZE_MAX, Document, parse
from companion.errors import ConfigError
from companion.safe_files import read_file

BYTES_MAX = 4 * SIZE_MAX  # a character takes four at most


def load_mission(path: str | Path) -> MissionConfig:
    """Read and check a mission file.

    Parameters
    ----------
    path : str or Path
        A YAML file, as in ``mission_configs``.

    Raises
    ------
    ConfigError
        For the first thing wrong with it.
    """
    return mission_from_text(mission_text(path), str(path))


def mission_text(path: str | Path) -> str:
    """Text of a mission file, which is not read where it is too large, or no plain file.

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
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(file, None, "file", reason.lower(), "a mission file that can be read") from None


def mission_from_text(text: str, file: str) -> MissionConfig:
    """Read a mission from YAML text; ``file`` is the name that messages give it.

    Raises
    ------
    ConfigError
        For the first thing wrong with it.
    """
    return mission_from_document(parse(text, file))


def mission_from_document(document: Document) -> MissionConfig:
    """Read a mission from what stands in a file, or in one with some values changed.

    Raises
    ------
    ConfigError
        For the first thing wrong with it.
    """
    try:
        config = MissionConfig.model_validate(document.data)
    except ValidationError as error:
        raise explained(document, error.errors(include_url=False)) from None
    for path, expected in findings(config):
        raise document.error(path, expected)
    return config


def text_of(config: MissionConfig) -> str:
    """A mission file that means the same, for a mission that came from none."""
    return yaml.safe_dump(config.model_dump(mode="json", exclude_none=True), sort_keys=False)

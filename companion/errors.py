"""Errors the program raises on purpose.

::

    CompanionError
    ├── ConfigError        a mission file or option is wrong          exit 2
    ├── LinkError          no link, or the link failed                exit 3
    │   ├── NoAutopilotError   no heartbeat of an autopilot arrives
    │   └── TransferError      a mission transfer failed; the autopilot may hold a mix
    ├── RecordError        a recording cannot be read or written      exit 2
    └── PluginError        another package's code fails               exit 2
        ├── PlannerError       its planner
        └── ThreatModelError   its model of a static threat

Solvers do not raise for "no path": they return a status.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar


class CompanionError(Exception):
    """Root of the errors raised on purpose."""

    exit_code = 4


@dataclass
class ConfigError(CompanionError):
    """A value in a mission file that cannot be used.

    Parameters
    ----------
    file : str
        Name of the mission file.
    line : int or None
        Line of the key, counted from 1.
    key : str
        Dotted path of the key, for instance ``goals.0.east_m``.
    value : str
        Value as written.
    expected : str
        Description of an accepted value.
    """

    file: str
    line: int | None
    key: str
    value: str
    expected: str

    exit_code = 2

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return f"{place}: {self.key}: got {self.value}; expected {self.expected}"


class LinkError(CompanionError):
    """The link cannot be opened, or failed."""

    exit_code = 3


class NoAutopilotError(LinkError):
    """No heartbeat of an autopilot was received in time."""


@dataclass
class TransferError(LinkError):
    """A mission transfer ended without the agreed result.

    Parameters
    ----------
    operation : str
        ``upload``, ``download``, ``set_current`` or ``verify``.
    reason : str
        Reason given by the autopilot or the protocol library.
    """

    operation: str
    reason: str

    def __str__(self) -> str:
        return f"mission {self.operation}: {self.reason}"


class RecordError(CompanionError):
    """A recording cannot be read or written."""

    exit_code = 2


@dataclass
class PluginError(CompanionError):
    """Code of another package cannot be loaded, or fails.

    Parameters
    ----------
    origin : str
        Name of the planner or model, its distribution and its entry point.
    found : str
        Description of what the code is or did.
    expected : str
        Description of what the code must be or do.
    """

    origin: str
    found: str
    expected: str

    exit_code = 2
    kind: ClassVar[str] = "plug-in"

    def __str__(self) -> str:
        return f"{self.kind} {self.origin}: got {self.found}; expected {self.expected}"


class PlannerError(PluginError):
    """A planner of another package cannot be loaded, or fails."""

    kind = "planner"


class ThreatModelError(PluginError):
    """A model of static threats of another package cannot be loaded, or fails."""

    kind = "threat model"

"""Parameters that the pilot may change in the field, by the MAVLink parameter protocol.

A value set here overrides the mission file, survives restarts, and takes effect between two plans. It is
refused if the mission file would be refused with it.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from companion.config import MissionConfig, PlanningConfig
from companion.config.checks import findings
from companion.config.parameters.parameter_metadata import Parameter, documents
from companion.safe_files import StateFile, read_file, rename_damaged

Sender = tuple[int, int]  # System id and component id.

SIZE_MAX = 100_000  # Bytes of the file; a few parameters take a thousandth.
DIGITS = 6  # A 32-bit float carries this many decimal digits.

_log = logging.getLogger(__name__)


ENABLE = "SRRT_ENABLE"
TABLE = (
    Parameter(ENABLE, "", "Planner may replace missions", 0, 1.0),
    Parameter("SRRT_HORIZON", "time_horizon_s", "Time between two plans", 1, 1.0),
    Parameter("SRRT_SWAP_GAIN", "swap_gain", "Gain for which a path is replaced", 2, 0.01),
    Parameter("SRRT_SWAP_MARG", "swap_margin_s", "Reserve of time for a hand-over", 1, 0.5),
    Parameter("SRRT_THREAT_MAX", "threat_level_max", "Highest threat level of a path", 2, 0.05),
)
_BY_NAME = {entry.name: entry for entry in TABLE}


class Parameters:
    """Values of the parameters.

    Parameters
    ----------
    mission : MissionConfig
        Mission file, for the values that were not set.
    file : Path or None
        File of the values that were set; None keeps them in memory only.
    is_threaded : bool
        Whether the file is written in threads, as in a service.
    """

    def __init__(self, mission: MissionConfig, file: Path | None, *, is_threaded: bool = False) -> None:
        self._mission = mission
        self._file = None if file is None else StateFile(file, _note_failure, is_threaded=is_threaded)
        self._listeners: list[Callable[[str, Sender], None]] = []
        self._set: dict[str, float] = {}
        self._is_saved = True
        for name, value in self._read_file().items():
            reason = self._refusal(name, value)
            if reason:
                _log.warning("%s as kept in %s is not used: %s", name, file, reason)
            else:
                self._set[name] = value
                _log.warning("%s is %g, as it was set before; the mission file does not count", name, value)

    def listen(self, listener: Callable[[str, Sender], None]) -> None:
        """Call a function from now on with the name of each value that changes, and who set it."""
        self._listeners.append(listener)

    @property
    def names(self) -> tuple[str, ...]:
        """Names, in the order of their indices."""
        return tuple(_BY_NAME)

    @property
    def files(self) -> dict[str, bytes]:
        """Metadata files by path: units, ranges, and defaults from the mission file."""
        return documents(TABLE, self._mission)

    @property
    def values_set(self) -> dict[str, float]:
        """Values that were set, by name."""
        return dict(self._set)

    @property
    def is_replanning(self) -> bool:
        """Whether missions may be replaced."""
        return self.value(ENABLE) != 0.0

    def value(self, name: str) -> float:
        """Return the value in force.

        Raises
        ------
        KeyError
            If there is no such parameter.
        """
        key = _BY_NAME[name].key
        known = self._set.get(name)
        if known is not None:
            return known
        return float(getattr(self._mission.planning, key)) if key else 1.0

    def may_set(self, system_id: int) -> bool:
        """Return whether a system is listed in ``link.parameter_sources`` of the mission file."""
        return system_id in self._mission.link.parameter_sources

    def set(self, name: str, value: float, sender: Sender) -> str:
        """Set a value; returns the reason of a refusal, '' if it is accepted.

        Setting the value in force changes nothing. The next call of :meth:`keep` writes the value to the
        file.

        Parameters
        ----------
        name : str
            Name of the parameter.
        value : float
            New value.
        sender : tuple of int
            System and component that set it; the caller has asked :meth:`may_set`.
        """
        value = float(f"{value:.{DIGITS}g}") if math.isfinite(value) else value
        reason = self._refusal(name, value)
        if reason or value == self.value(name):
            return reason
        self._set[name] = value
        self._is_saved = False
        for listener in self._listeners:
            listener(name, sender)
        return ""

    def switch_off(self, sender: Sender) -> None:
        """Stop replanning, by setting :data:`ENABLE` to 0."""
        self.set(ENABLE, 0.0, sender)

    def set_mission(self, mission: MissionConfig) -> MissionConfig:
        """Take another mission file and return it with the set values; drops values that contradict it."""
        self._mission = mission
        for name, value in list(self._set.items()):
            reason = self._refusal(name, value)
            if reason:
                del self._set[name]
                _log.warning("%s is the mission file's again: %s", name, reason)
        return self.mission()

    def mission(self) -> MissionConfig:
        """Return the mission file with the set values."""
        return self._with(self._set)

    def _with(self, values: dict[str, float]) -> MissionConfig:
        keys = {_BY_NAME[name].key: value for name, value in values.items() if _BY_NAME[name].key}
        if not keys:
            return self._mission
        planning = PlanningConfig.model_validate(self._mission.planning.model_dump() | keys)
        return self._mission.model_copy(update={"planning": planning})

    def _refusal(self, name: str, value: float) -> str:
        if name not in _BY_NAME:
            return "no such parameter"
        if name == ENABLE:
            return "" if value in (0.0, 1.0) else "0 or 1"
        try:
            changed = self._with({**self._set, name: value})
        except ValidationError as error:
            return _bound(error)
        return next((expected for path, expected in findings(changed) if path[0] == "planning"), "")

    def _read_file(self) -> dict[str, float]:
        if self._file is None:
            return {}
        path = self._file.path
        try:
            kept = json.loads(read_file(path, SIZE_MAX))
            return {str(name): float(value) for name, value in kept.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            renamed = rename_damaged(path)
            found = "" if renamed is None else f", now {renamed}"
            _log.warning("parameters are the mission file's: %s%s: %s", path, found, error)
            return {}

    def keep(self) -> None:
        """Write the set values to the file if they changed."""
        if self._file is None or self._is_saved:
            return
        self._is_saved = True
        self._file.replace((json.dumps(self._set, indent=1) + "\n").encode("ascii"))

    def wait(self) -> None:
        """Wait until everything is written."""
        if self._file is not None:
            self._file.wait()


def _note_failure(error: OSError) -> None:
    """Log that the file cannot be written."""
    _log.error("parameters cannot be written: %s", error)


def _bound(error: ValidationError) -> str:
    """Return what is wrong in the few characters of a STATUSTEXT."""
    wrong = error.errors(include_url=False)[0]
    for key, words in (("ge", "at least"), ("gt", "more than"), ("le", "at most"), ("lt", "less than")):
        if key in wrong.get("ctx", {}):
            return f"{words} {wrong['ctx'][key]:g}"
    return str(wrong["msg"]).removeprefix("Input should be ")

"""What ground stations are told of the parameters: names, units and ranges, as two documents.

The mission file's models say what a value means and which are allowed; nothing is written twice.

References
----------
MAVLink guide, *Component Metadata Protocol*; its schemas for general and parameter metadata.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from companion import __version__
from companion.config import MissionConfig, PlanningConfig
from companion.config.reference import UNITS, meanings
from companion.link.messages.file_server import file_checksum

GENERAL, PARAMETERS = "/general.json", "/parameters.json"
_PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER
_SWITCH = (
    "0: nothing is planned or uploaded, in an emergency neither; the autopilot flies the mission it has."
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.

    Parameters
    ----------
    name : str
        At most 16 characters.
    key : str
        The key of ``planning`` that it stands for; empty for the switch, which no mission file has.
    title : str
        What it is, in a few words.
    decimals : int
        Decimal places that stations show.
    increment : float
        By how much they change it at a time.
    """

    name: str
    key: str
    title: str
    decimals: int
    increment: float


def documents(entries: Sequence[Parameter], mission: MissionConfig) -> dict[str, bytes]:
    """The general document and that of the parameters, as JSON by path.

    Parameters
    ----------
    entries : sequence of Parameter
        All there are.
    mission : MissionConfig
        The mission file, whose values are the defaults.
    """
    told = _json(
        {
            "version": 1,
            "uid": 1,
            "scope": "Firmware",
            "parameters": [_switch(entry) if not entry.key else _number(entry, mission) for entry in entries],
        }
    )
    of_parameters = {
        "type": _PARAMETER_TYPE,
        "uri": f"mftp://{PARAMETERS}",
        "fileCrc": file_checksum(told),
    }
    general = {
        "version": 1,
        "modelName": "Companion path planner",
        "firmwareVersion": ".".join(__version__.split(".")[:3]),
        "metadataTypes": [of_parameters],
    }
    return {GENERAL: _json(general), PARAMETERS: told}


def _json(document: Mapping[str, object]) -> bytes:
    return json.dumps(document, allow_nan=False, separators=(",", ":")).encode("ascii")


def _switch(entry: Parameter) -> dict[str, object]:
    values = [{"value": 0, "description": "Off"}, {"value": 1, "description": "On"}]
    return _entry(entry, _SWITCH) | {"min": 0, "max": 1, "default": 1, "values": values}


def _number(entry: Parameter, mission: MissionConfig) -> dict[str, object]:
    field = PlanningConfig.model_fields[entry.key]
    told = _entry(entry, meanings(PlanningConfig)[entry.key].replace("`", ""))
    told["units"] = next((unit for suffix, unit in UNITS.items() if entry.key.endswith(suffix)), "")
    step = 10.0**-entry.decimals
    for bound in field.metadata:
        if (least := getattr(bound, "ge", None)) is not None:
            told["min"] = least
        if (above := getattr(bound, "gt", None)) is not None:
            told["min"] = above + step  # the least that is shown and allowed
        if (most := getattr(bound, "le", None)) is not None:
            told["max"] = most
        if (below := getattr(bound, "lt", None)) is not None:
            told["max"] = below - step
    told["default"] = float(getattr(mission.planning, entry.key))
    return told


def _entry(entry: Parameter, words: str) -> dict[str, object]:
    return {
        "name": entry.name,
        "type": "Float",
        "shortDesc": entry.title,
        "longDesc": words,
        "group": "Path planner",
        "decimalPlaces": entry.decimals,
        "increment": entry.increment,
    }

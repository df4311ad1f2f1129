"""Metadata of the parameters for ground stations: names, units and ranges, as two JSON documents.

The meaning and range of a value come from the models of the mission file, so that nothing is written twice.

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
_PARAMETER_TYPE = 1  # COMP_METADATA_TYPE_PARAMETER.
_SWITCH = (
    "0: nothing is planned or uploaded, in an emergency neither; the autopilot flies the mission it has."
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.

    Parameters
    ----------
    name : str
        Name of at most 16 characters.
    key : str
        Key of ``planning`` that it sets; empty for the switch, which no mission file has.
    title : str
        Short description.
    decimals : int
        Number of decimal places that ground stations show.
    increment : float
        Step by which ground stations change it.
    """

    name: str
    key: str
    title: str
    decimals: int
    increment: float


def documents(entries: Sequence[Parameter], mission: MissionConfig) -> dict[str, bytes]:
    """Return the general document and the parameters' document, as JSON by path.

    Parameters
    ----------
    entries : sequence of Parameter
        All parameters.
    mission : MissionConfig
        Mission file, whose values are the defaults.
    """
    document = _json(
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
        "fileCrc": file_checksum(document),
    }
    general = {
        "version": 1,
        "modelName": "Companion path planner",
        "firmwareVersion": ".".join(__version__.split(".")[:3]),
        "metadataTypes": [of_parameters],
    }
    return {GENERAL: _json(general), PARAMETERS: document}


def _json(document: Mapping[str, object]) -> bytes:
    return json.dumps(document, allow_nan=False, separators=(",", ":")).encode("ascii")


def _switch(entry: Parameter) -> dict[str, object]:
    values = [{"value": 0, "description": "Off"}, {"value": 1, "description": "On"}]
    return _entry(entry, _SWITCH) | {"min": 0, "max": 1, "default": 1, "values": values}


def _number(entry: Parameter, mission: MissionConfig) -> dict[str, object]:
    field = PlanningConfig.model_fields[entry.key]
    document = _entry(entry, meanings(PlanningConfig)[entry.key].replace("`", ""))
    document["units"] = next((unit for suffix, unit in UNITS.items() if entry.key.endswith(suffix)), "")
    step = 10.0**-entry.decimals
    for bound in field.metadata:
        if (least := getattr(bound, "ge", None)) is not None:
            document["min"] = least
        if (above := getattr(bound, "gt", None)) is not None:
            document["min"] = above + step  # The smallest value that is shown and allowed.
        if (most := getattr(bound, "le", None)) is not None:
            document["max"] = most
        if (below := getattr(bound, "lt", None)) is not None:
            document["max"] = below - step
    document["default"] = float(getattr(mission.planning, entry.key))
    return document


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

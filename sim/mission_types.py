"""Kinds and results of both autopilots' mission lists, independent of the companion's types."""

from __future__ import annotations

from enum import IntEnum

_LAST_NAV_COMMAND = 95


class MissionKind(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class Verdict(IntEnum):
    """MAV_MISSION_RESULT, as far as it is used."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


def is_navigation(command: int) -> bool:
    """Return whether the item is flown to, rather than done in passing."""
    return command <= _LAST_NAV_COMMAND

"""Compare the mission that an autopilot stores with the one that was sent, apart from known roundings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.mission.operator import FIRST_WITHOUT_PLACE
from companion.types.mission import Command, MavFrame, MissionItem

ALTITUDE_TOLERANCE_M = 0.011  # ArduPlane truncates altitudes to whole centimetres.
SPEED_TOLERANCE_M_S = 0.06  # ArduPlane stores airspeeds in steps of 0.1 m/s.
# ArduPlane does not store these parameters (numbered from 0) of a command: they read back as 0.
DROPPED: dict[int, frozenset[int]] = {
    Command.NAV_WAYPOINT: frozenset({0, 3}),
    Command.NAV_LOITER_UNLIM: frozenset({0, 1, 3}),
    Command.NAV_LOITER_TURNS: frozenset({1, 3}),
    Command.NAV_LOITER_TIME: frozenset({1, 3}),
    Command.NAV_TAKEOFF: frozenset({1, 2, 3}),
    Command.NAV_LOITER_TO_ALT: frozenset(),
    Command.DO_CHANGE_SPEED: frozenset({3}),
    Command.DO_JUMP: frozenset(),
}
SAME_FRAME: dict[int, int] = {
    MavFrame.GLOBAL_INT: MavFrame.GLOBAL,
    MavFrame.GLOBAL_RELATIVE_ALT_INT: MavFrame.GLOBAL_RELATIVE_ALT,
    MavFrame.GLOBAL_TERRAIN_ALT_INT: MavFrame.GLOBAL_TERRAIN_ALT,
}


def difference(sent: Sequence[MissionItem], read: Sequence[MissionItem]) -> str:
    """Return the first difference in words, or '' if nothing differs that matters.

    ArduPlane's known roundings do not count: frames come back in their float form, altitudes truncated to
    centimetres, most parameters as whole numbers, a waypoint's hold time and yaw as 0. Item 0 is the home
    slot and is not compared. Parameters are not compared for commands whose storage is not known.
    """
    if len(sent) != len(read):
        return f"{len(read)} items instead of {len(sent)}"
    for ours, theirs in zip(sent[1:], read[1:], strict=True):
        where = f"item {ours.sequence}"
        if ours.command != theirs.command:
            return f"{where}: command {theirs.command} instead of {ours.command}"
        wrong = _wrong_parameter(ours, theirs)
        if wrong is not None:
            stored, sent_value = theirs.parameters[wrong] or 0.0, ours.parameters[wrong] or 0.0
            return f"{where}: parameter {wrong + 1} {stored:g} instead of {sent_value:g}"
        if ours.command >= FIRST_WITHOUT_PLACE:
            continue  # DO_ items have no position, and their frame is not stored.
        if SAME_FRAME.get(ours.frame, ours.frame) != theirs.frame and ours.frame != theirs.frame:
            return f"{where}: frame {theirs.frame} instead of {ours.frame}"
        if (ours.latitude_e7, ours.longitude_e7) != (theirs.latitude_e7, theirs.longitude_e7):
            return f"{where}: stands elsewhere"
        if not math.isclose(ours.altitude_m, theirs.altitude_m, abs_tol=ALTITUDE_TOLERANCE_M, rel_tol=1e-6):
            return f"{where}: altitude {theirs.altitude_m} m instead of {ours.altitude_m} m"
    return ""


def _wrong_parameter(ours: MissionItem, theirs: MissionItem) -> int | None:
    """Return the number, from 0, of the first parameter that is stored differently."""
    dropped = DROPPED.get(ours.command)
    if dropped is None:
        return None
    for index, (sent, stored) in enumerate(zip(ours.parameters, theirs.parameters, strict=True)):
        wanted, found = sent or 0.0, stored or 0.0
        if index in dropped:
            continue
        if ours.command == Command.DO_CHANGE_SPEED:
            if not abs(wanted - found) <= SPEED_TOLERANCE_M_S:
                return index
        elif not (math.isclose(wanted, found, rel_tol=1e-6, abs_tol=1e-6) or found == math.trunc(wanted)):
            return index
    return None

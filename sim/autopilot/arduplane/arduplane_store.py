"""Mission, fence and rally lists as ArduPlane keeps them: in place, and rounded.

What is uploaded is not what is read back (measured on ArduPlane 4.7-dev): altitudes are cut to
centimetres, most parameters to whole numbers, frames to those of the storage, and slot 0 is always
the home position.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.types.mission import Command, MavFrame, MissionItem
from ...mission_types import MissionKind, Verdict, is_navigation

MAX_ITEMS = 655
_ALTITUDE_MAX_M = 83_000.0


_LOITERS = frozenset({Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME})
NAV_COMMANDS = frozenset({*range(16, 23), 31, 82, 92, 93, 94})
# Do and condition commands of the library: stored, and those this aircraft cannot do are skipped.
_OTHER_COMMANDS = frozenset(
    {600, 601, 30, 112, 114, 115, 177, 178, 179, 181, 182, 183, 184, 187, 188, 189, 195, 197}
)
_CAMERA_COMMANDS = frozenset({201, 202, 203, 205, 206, 207, 208, 211, 212, 213, 214, 222, 530, 2000, 2001})
_MISSION_COMMANDS = NAV_COMMANDS | _OTHER_COMMANDS | _CAMERA_COMMANDS
_FENCE_COMMANDS = frozenset(range(5000, 5005))
_RALLY_COMMANDS = frozenset({5100})
_COMMANDS = {
    MissionKind.MISSION: _MISSION_COMMANDS,
    MissionKind.FENCE: _FENCE_COMMANDS,
    MissionKind.RALLY: _RALLY_COMMANDS,
}
_STORED_FRAMES = {0: 0, 2: 0, 3: 3, 5: 0, 6: 3, 10: 10, 11: 10}


def _integer(value: float | None) -> float:
    return float(int(value)) if value is not None and math.isfinite(value) else 0.0


def _stored_parameters(item: MissionItem) -> tuple[float, float, float, float]:
    """Parameters as the 15-byte record of a mission command keeps them."""
    p1, p2, p3, p4 = (_integer(value) for value in item.parameters)
    command = item.command
    if command == Command.NAV_WAYPOINT:
        return 0.0, max(0.0, min(p2, 255.0)), max(0.0, min(p3, 255.0)), 0.0
    if command == Command.NAV_LOITER_UNLIM:
        return 0.0, 0.0, p3, 0.0
    if command in _LOITERS:
        return p1, 0.0, p3, 1.0 if p4 > 0.0 else 0.0
    if command == Command.NAV_TAKEOFF:
        return p1, 0.0, 0.0, 0.0
    if command == Command.DO_CHANGE_SPEED:
        speed, throttle = item.parameters[1], item.parameters[2]
        return p1, speed or 0.0, throttle or 0.0, 0.0
    return p1, p2, p3, p4


def _stored_altitude_m(altitude_m: float) -> float:
    """Cut to whole centimetres in single precision, so that 80.13 may well become 80.12."""
    if not abs(altitude_m) <= _ALTITUDE_MAX_M:  # Only items without a position can have such a height.
        return 0.0
    return int(np.float32(altitude_m) * np.float32(100.0)) / 100.0


class MissionStore:
    """The three lists, and the rounding on the way in.

    Parameters
    ----------
    home : MissionItem
        Item that slot 0 of the mission always has.
    """

    def __init__(self, home: MissionItem) -> None:
        self._home = home
        self._lists: dict[MissionKind, list[MissionItem]] = {kind: [] for kind in MissionKind}
        self.revision = 0

    @property
    def mission(self) -> list[MissionItem]:
        """The mission's items as they are now; slot 0 is home."""
        return self._lists[MissionKind.MISSION]

    def items(self, kind: MissionKind) -> list[MissionItem]:
        """One list as it is now."""
        return self._lists[kind]

    def truncate(self, kind: MissionKind, count: int) -> None:
        """Cut a list to its first items."""
        del self._lists[kind][count:]
        self.revision += 1

    def put(self, kind: MissionKind, item: MissionItem) -> Verdict:
        """Overwrite the item's slot, or add the slot at the end; nothing is stored unless ACCEPTED."""
        verdict = self._checked(kind, item)
        items = self._lists[kind]
        if verdict is not Verdict.ACCEPTED:
            return verdict
        if item.sequence > len(items):
            return Verdict.ERROR
        stored = self._stored(kind, item)
        if item.sequence == len(items):
            items.append(stored)
        else:
            items[item.sequence] = stored
        self.revision += 1
        return Verdict.ACCEPTED

    def _stored(self, kind: MissionKind, item: MissionItem) -> MissionItem:
        if kind is MissionKind.MISSION and item.sequence == 0:
            return self._home
        parameters = _stored_parameters(item) if kind is MissionKind.MISSION else item.parameters
        return replace(
            item,
            frame=_STORED_FRAMES[item.frame] if item.frame in _STORED_FRAMES else int(MavFrame.GLOBAL),
            parameters=parameters,
            altitude_m=_stored_altitude_m(item.altitude_m),
            is_current=False,
            autocontinue=True,
        )

    @staticmethod
    def _checked(kind: MissionKind, item: MissionItem) -> Verdict:
        """Return whether the item can be stored at all."""
        if kind is MissionKind.MISSION and item.sequence == 0:
            return Verdict.ACCEPTED
        if item.command not in _COMMANDS[kind]:
            return Verdict.UNSUPPORTED
        if item.frame not in _STORED_FRAMES:
            return Verdict.UNSUPPORTED_FRAME
        if item.command == Command.DO_JUMP and not item.parameters[0]:
            return Verdict.ERROR
        for index, value in enumerate(item.parameters[:3]):
            if value is None:
                return Verdict(Verdict.INVALID_PARAM1 + index)
        has_place = kind is not MissionKind.MISSION or is_navigation(item.command)
        return _verdict_on_place(item) if has_place else Verdict.ACCEPTED


def _verdict_on_place(item: MissionItem) -> Verdict:
    """Return whether an item's place is one on earth."""
    if abs(item.latitude_e7) > 900_000_000:
        return Verdict.INVALID_PARAM5_X
    if abs(item.longitude_e7) > 1_800_000_000:
        return Verdict.INVALID_PARAM6_Y
    if not abs(item.altitude_m) <= _ALTITUDE_MAX_M:
        return Verdict.INVALID_PARAM7
    return Verdict.ACCEPTED

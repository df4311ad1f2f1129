"""Mission items and words of MAVSDK's in our terms, and what must hold of a list that is sent."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import Any

from companion.errors import TransferError
from companion.types.mission import MissionItem

_log = logging.getLogger(__name__)


def log_of_mavsdk(_level: int, message: str, _file: str | None, _line: int) -> bool:
    """Take MAVSDK's log, which it would print; what failed its callers are told as a result."""
    _log.debug("%s", message)
    return True


def check_upload(items: Sequence[MissionItem]) -> None:
    """See that a list can be sent.

    Raises
    ------
    TransferError
        If it is not numbered from 0, or not exactly one item is current.
    """
    if [item.sequence for item in items] != list(range(len(items))):
        raise TransferError("upload", "the items are not numbered from 0 in order")
    if sum(item.is_current for item in items) != 1:
        raise TransferError("upload", "not exactly one item is current")


def item_of(told: Any) -> MissionItem:  # noqa: ANN401
    """Mission item of MAVSDK's, or of a MISSION_ITEM_INT; NaN parameters become None."""
    one, two, three, four = (
        None if math.isnan(value) else float(value)
        for value in (told.param1, told.param2, told.param3, told.param4)
    )
    return MissionItem(
        sequence=told.seq,
        command=told.command,
        frame=told.frame,
        parameters=(one, two, three, four),
        latitude_e7=told.x,
        longitude_e7=told.y,
        altitude_m=float(told.z),
        is_current=bool(told.current),
        autocontinue=bool(told.autocontinue),
    )

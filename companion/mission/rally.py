"""The autopilot's rally points: places that it may return to instead of home.

References
----------
MAVLink mission protocol, MAV_MISSION_TYPE_RALLY: items of MAV_CMD_NAV_RALLY_POINT (5100), each a place.
"""

from __future__ import annotations

from collections.abc import Sequence

from companion.frames import LocalFrame
from companion.mission.operator import altitude_amsl_of
from companion.types.mission import Command, MissionItem

Place = tuple[float, float, float]


def rally_points_of(
    items: Sequence[MissionItem], frame: LocalFrame, home_amsl_m: float | None
) -> tuple[Place, ...]:
    """Return east, north, up of rally points [m], without those of unknown height, such as over terrain.

    Parameters
    ----------
    items : sequence of MissionItem
        The rally list as read.
    frame : LocalFrame
        The mission file's frame.
    home_amsl_m : float or None
        Height of home, from which relative altitudes count, if known [m].
    """
    placed = [
        (item, altitude_amsl_of(item, home_amsl_m))
        for item in items
        if item.command == Command.NAV_RALLY_POINT
    ]
    return tuple(
        frame.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, altitude)
        for item, altitude in placed
        if altitude is not None
    )

"""Mission items of ground stations as places: goals, the take-off, fences, rally points.

References
----------
MAVLink common.xml: MAV_CMD and MAV_FRAME.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from companion.config.conversion.found_places import Degrees, Importer, Kind
from companion.types.mavlink_enums import Command, MavFrame, name_of

_OVER_SEA = (MavFrame.GLOBAL, MavFrame.GLOBAL_INT)
_OVER_HOME = (MavFrame.GLOBAL_RELATIVE_ALT, MavFrame.GLOBAL_RELATIVE_ALT_INT)
_GOALS = (Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT)
_LOITERS = (
    Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME, Command.NAV_LOITER_TO_ALT
)  # fmt: skip
_TAKEOFFS = (Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF)
_CIRCLES = {Command.NAV_FENCE_CIRCLE_INCLUSION: Kind.FENCE, Command.NAV_FENCE_CIRCLE_EXCLUSION: Kind.NO_FLY}
_POLYGONS = {
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION: Kind.FENCE,
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION: Kind.NO_FLY,
}
_REASONS = {
    Command.NAV_LAND: "the landing is the autopilot's mission's",
    Command.NAV_RETURN_TO_LAUNCH: "the return is the autopilot's mission's",
    Command.DO_LAND_START: "the landing is the autopilot's mission's",
    Command.DO_CHANGE_SPEED: "airspeeds are those of the section vehicle",
    Command.DO_JUMP: "goals are reached once, in order",
    Command.NAV_FENCE_RETURN_POINT: "a mission file has no return point",
}


@dataclass(frozen=True, slots=True)
class Item:
    """An item as a file has it. Values that are not set are None; they are checked where they are needed."""

    label: str
    command: int
    frame: int
    parameters: Sequence[object]
    latitude: object
    longitude: object
    altitude: object


def take_items(importer: Importer, items: Sequence[Item]) -> None:
    """Take the places of a list of items.

    Raises
    ------
    ConfigError
        If a value is wrong, or a polygon is not whole.
    """
    following = iter(items)
    for item in following:
        if item.command in _POLYGONS:
            _take_polygon(importer, item, following)
        elif item.command in _CIRCLES:
            radius = importer.number(f"{item.label} radius", item.parameters[0], 0.1, 1e5)
            kind = _CIRCLES[Command(item.command)]
            importer.add(kind, [_place(importer, item)], "", {"radius_m": radius}, item.label)
        elif item.command == Command.NAV_RALLY_POINT:
            importer.add(Kind.FIELD, [_place(importer, item)], "", {}, item.label)
        elif item.command in (*_GOALS, *_LOITERS, *_TAKEOFFS):
            _take_point(importer, item)
        else:
            words = _REASONS.get(item.command, "a mission file has no such command")  # type: ignore[call-overload]
            importer.leave(title_of(item), item.label, words)


def title_of(item: Item) -> str:
    """Return the name and the number of an item's command."""
    name = name_of(Command, item.command)
    return f"command {item.command}" if name.startswith("result") else f"{name} ({item.command})"


def _take_polygon(importer: Importer, first: Item, following: Iterator[Item]) -> None:
    """Take a polygon whose vertices are items; each says how many there are."""
    count = int(importer.number(f"{first.label} vertices", first.parameters[0], 3, 10_000))
    corners = [_place(importer, first)]
    while len(corners) < count:
        item = next(following, None)
        if item is None or item.command != first.command:
            found = f"{len(corners)} of {count} vertices"
            raise importer.error(first.label, found, "all vertices of the polygon, one after the other")
        corners.append(_place(importer, item))
    importer.add(_POLYGONS[Command(first.command)], corners, "", {}, first.label)


def _place(importer: Importer, item: Item) -> Degrees:
    return importer.degrees(item.label, item.latitude, item.longitude)


def _take_point(importer: Importer, item: Item) -> None:
    """Take a waypoint, a loiter or a take-off, with its height."""
    if item.frame not in (*_OVER_SEA, *_OVER_HOME):
        reason = f"its height is in frame {item.frame}, over terrain; give it over home or the sea"
        importer.leave(title_of(item), item.label, reason)
        return
    key = "altitude_amsl_m" if item.frame in _OVER_SEA else "up_m"
    values: dict[str, object] = {
        key: importer.number(f"{item.label} altitude", item.altitude, -1_000.0, 20_000.0)
    }
    place = importer.degrees(item.label, item.latitude or 0.0, item.longitude or 0.0)
    if item.command in _TAKEOFFS:
        importer.add(Kind.TAKEOFF, [place], "", values, item.label)
    elif place == (0.0, 0.0):  # To an autopilot: where it is.
        importer.leave(title_of(item), item.label, "it has no place")
    else:
        importer.add(Kind.GOAL, [place], "", values | _goal_values(importer, item), item.label)


def _goal_values(importer: Importer, item: Item) -> dict[str, object]:
    """Return the acceptance radius of a waypoint; what a goal does not do is remarked."""
    if item.command in _LOITERS:
        importer.remark(
            f"{item.label} {title_of(item)}", "taken as a point to reach; the circling is not taken"
        )
        return {}
    hold, radius = (importer.number(item.label, item.parameters[n] or 0.0) for n in (0, 1))
    if hold > 0.0:
        importer.remark(item.label, f"the hold of {hold:g} s is not taken: fixed wings do not stop")
    return {"acceptance_radius_m": radius} if radius > 0.0 else {}

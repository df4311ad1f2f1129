"""QGroundControl's ``.plan``: home, mission, geofence and rally points, in JSON.

A plan that this program wrote also holds the mission's places as GeoJSON under a key of its own, with a
digest of the rest. While the digest fits, nothing was changed since, and the places are taken from there,
with the names, heights and radars that a plan has no room for.

References
----------
QGroundControl developer guide, "Plan file format".
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence

from companion.config.conversion.formats.foreign_file import json_document
from companion.config.conversion.formats.geojson_file import feature_collection, take_features
from companion.config.conversion.formats.item_places import Item, take_items
from companion.config.conversion.found_places import FoundPlace, Importer, Kind
from companion.config.conversion.path_lines import PathLine
from companion.types.mavlink_enums import Command, MavFrame

OWN_KEY = "safe_rrt_companion"
PLAN_VERSION, MISSION_VERSION, ZONES_VERSION = 1, 2, 2
_RALLY_VERSIONS = (1, 2)  # They differ in the name of a key that is not needed.
_ARDUPILOT, _FIXED_WING = 3, 1


def take_plan(importer: Importer, data: bytes) -> None:
    """Take the places of a plan.

    Raises
    ------
    ConfigError
        If it is broken, of another version, or a value in it is wrong.
    """
    document = _plan(importer, data)
    own = document.get(OWN_KEY)
    if isinstance(own, dict):
        if own.get("digest") == _digest(document) and isinstance(own.get("places"), dict):
            take_features(importer, own["places"])
            return
        words = "the plan was changed since; names, heights and radars in it are not taken"
        importer.remark(f"key {OWN_KEY}", words)
    mission = _section(importer, document, "mission")
    items = _mission_items(importer, mission)
    for key in ("cruiseSpeed", "hoverSpeed"):
        if mission.get(key):
            importer.leave(f"mission.{key} {mission[key]}", "", "airspeeds are those of the section vehicle")
    take_items(importer, items)
    if document.get("geoFence") is not None:
        _take_fence(importer, _section(importer, document, "geoFence"))
    if document.get("rallyPoints") is not None:
        _take_rally(importer, _section(importer, document, "rallyPoints"))


def items_of_plan(importer: Importer, data: bytes) -> Sequence[Item]:
    """Return the items of a plan; its home is taken as a place.

    Raises
    ------
    ConfigError
        If it is broken, of another version, or a value in it is wrong.
    """
    return _mission_items(importer, _section(importer, _plan(importer, data), "mission"))


def _plan(importer: Importer, data: bytes) -> dict[str, object]:
    document = json_document(importer, data)
    if document.get("fileType") != "Plan":
        raise importer.error("fileType", document.get("fileType"), "Plan, as QGroundControl writes it")
    _check_version(importer, "version", document, PLAN_VERSION)
    return document


def _mission_items(importer: Importer, mission: Mapping[str, object]) -> Sequence[Item]:
    _check_version(importer, "mission.version", mission, MISSION_VERSION)
    _take_home(importer, mission)
    return _items(importer, mission.get("items"), "mission.items", "item ")


def _check_version(importer: Importer, key: str, section: Mapping[str, object], version: int) -> None:
    found = section.get("version", "nothing")
    if found != version:
        expected = f"{version}; QGroundControl converts other versions: open the plan there and save it"
        raise importer.error(key, str(found), expected)


def _section(importer: Importer, document: Mapping[str, object], key: str) -> Mapping[str, object]:
    section = document.get(key)
    if not isinstance(section, dict):
        raise importer.error(key, section, "an object, in braces")
    return section


def _list(importer: Importer, value: object, key: str, size: int = 0) -> Sequence[object]:
    if not isinstance(value, list) or len(value) < size:
        raise importer.error(key, value, f"a list of at least {size} values" if size else "a list")
    return value


def _take_home(importer: Importer, mission: Mapping[str, object]) -> None:
    home = mission.get("plannedHomePosition")
    if home is None:
        return
    latitude, longitude, *rest = _list(importer, home, "mission.plannedHomePosition", 2)
    values = {"altitude_amsl_m": rest[0]} if rest and rest[0] is not None else {}
    place = importer.degrees("mission.plannedHomePosition", latitude, longitude)
    importer.add(Kind.ORIGIN, [place], "", values, "planned home")


def _items(importer: Importer, value: object, key: str, label: str) -> Sequence[Item]:
    """Return simple items, with those that a survey was expanded to."""
    found: list[Item] = []
    for index, item in enumerate(_list(importer, value, key)):
        where = f"{key}.{index}"
        if not isinstance(item, dict):
            raise importer.error(where, item, "an item, in braces")
        if item.get("type") == "SimpleItem":
            found.append(_simple(importer, item, where, f"{label}{index + 1}"))
        elif item.get("type") == "ComplexItem":
            found += _complex(importer, item, where, f"{label}{index + 1}")
        else:
            raise importer.error(f"{where}.type", item.get("type"), "SimpleItem or ComplexItem")
    return found


def _simple(importer: Importer, item: Mapping[str, object], where: str, label: str) -> Item:
    parameters = _list(importer, item.get("params"), f"{where}.params", 7)
    command, frame = (
        int(importer.number(f"{where}.{key}", item.get(key), 0, 65_535)) for key in ("command", "frame")
    )
    return Item(label, command, frame, parameters[:4], parameters[4], parameters[5], parameters[6])


def _complex(importer: Importer, item: Mapping[str, object], where: str, label: str) -> Sequence[Item]:
    """Return the transects of a survey or corridor; other complex items are not taken."""
    kind = str(item.get("complexItemType", "complex item"))
    transects = item.get("TransectStyleComplexItem")
    inner = transects.get("Items") if isinstance(transects, dict) else None
    if not isinstance(inner, list) or not inner:
        reason = (
            "the landing is the autopilot's mission's" if "landing" in kind.lower() else "it has no transects"
        )
        importer.leave(kind, label, reason)
        return ()
    importer.remark(f"{label} {kind}", f"taken as the {len(inner)} items of its transects")
    return _items(importer, inner, f"{where}.TransectStyleComplexItem.Items", f"{label}.")


def _take_fence(importer: Importer, fence: Mapping[str, object]) -> None:
    _check_version(importer, "geoFence.version", fence, ZONES_VERSION)
    for index, entry in enumerate(_list(importer, fence.get("polygons", []), "geoFence.polygons")):
        where = f"geoFence.polygons.{index}"
        corners = _list(importer, _entry(importer, entry, where).get("polygon"), f"{where}.polygon", 3)
        places = [importer.degrees(where, *_list(importer, corner, where, 2)[:2]) for corner in corners]
        importer.add(_zone(importer, entry, where), places, "", {}, f"fence polygon {index + 1}")
    for index, entry in enumerate(_list(importer, fence.get("circles", []), "geoFence.circles")):
        where = f"geoFence.circles.{index}"
        circle = _entry(importer, _entry(importer, entry, where).get("circle"), f"{where}.circle")
        centre = importer.degrees(
            where, *_list(importer, circle.get("center"), f"{where}.circle.center", 2)[:2]
        )
        values = {"radius_m": importer.number(f"{where}.circle.radius", circle.get("radius"), 0.1, 1e5)}
        importer.add(_zone(importer, entry, where), [centre], "", values, f"fence circle {index + 1}")
    if fence.get("breachReturn") is not None:
        importer.leave("geoFence.breachReturn", "", "a mission file has no return point")


def _entry(importer: Importer, value: object, where: str) -> Mapping[str, object]:
    if not isinstance(value, dict):
        raise importer.error(where, value, "an object, in braces")
    return value


def _zone(importer: Importer, entry: object, where: str) -> Kind:
    is_inclusion = _entry(importer, entry, where).get("inclusion")
    if not isinstance(is_inclusion, bool):
        raise importer.error(f"{where}.inclusion", is_inclusion, "true or false")
    return Kind.FENCE if is_inclusion else Kind.NO_FLY


def _take_rally(importer: Importer, rally: Mapping[str, object]) -> None:
    if rally.get("version") not in _RALLY_VERSIONS:
        raise importer.error("rallyPoints.version", rally.get("version"), "1 or 2")
    for index, entry in enumerate(_list(importer, rally.get("points", []), "rallyPoints.points")):
        where = f"rallyPoints.points.{index}"
        latitude, longitude, *_ = _list(importer, entry, where, 2)
        place = importer.degrees(where, latitude, longitude)
        importer.add(Kind.FIELD, [place], f"rally {index + 1}", {}, f"rally point {index + 1}")


def _digest(document: Mapping[str, object]) -> str:
    """Return a digest of what a ground station knows of a plan."""
    known = {key: document.get(key) for key in ("mission", "geoFence", "rallyPoints")}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def plan_document(places: Sequence[FoundPlace], line: PathLine | None = None) -> dict[str, object]:
    """Return a mission's places as a plan: bounds and obstacles are its fence.

    Parameters
    ----------
    places : sequence of FoundPlace
        All places of a mission, the origin among them.
    line : PathLine, optional
        Waypoints in place of the goals; the plan then is not the mission's, and does not bring it back.
    """
    (origin,) = (place for place in places if place.kind is Kind.ORIGIN)
    (start,) = (place for place in places if place.kind is Kind.START)
    goals = [place for place in places if place.kind is Kind.GOAL]
    if line is not None:
        ground_m = float(str(origin.values["altitude_amsl_m"]))
        goals = [
            FoundPlace(Kind.GOAL, ((latitude, longitude),), values={"up_m": round(height - ground_m, 3)})
            for longitude, latitude, height in line.coordinates()
        ]
    items = [_written(1, Command.NAV_TAKEOFF, start)]
    items += [_written(number, Command.NAV_WAYPOINT, goal) for number, goal in enumerate(goals, 2)]
    document: dict[str, object] = {
        "fileType": "Plan",
        "version": PLAN_VERSION,
        "groundStation": "QGroundControl",
        "mission": {
            "version": MISSION_VERSION,
            "firmwareType": _ARDUPILOT,
            "vehicleType": _FIXED_WING,
            "globalPlanAltitudeMode": 1,
            "cruiseSpeed": 0,
            "hoverSpeed": 0,
            "plannedHomePosition": [*_rounded(start), origin.values["altitude_amsl_m"]],
            "items": items,
        },
        "geoFence": {"version": ZONES_VERSION, "circles": [], "polygons": _zones(places)},
        "rallyPoints": {"version": ZONES_VERSION, "points": _rally(places)},
    }
    if line is not None:
        return document
    return document | {OWN_KEY: {"digest": _digest(document), "places": feature_collection(places)}}


def _rounded(place: FoundPlace) -> list[float]:
    latitude, longitude = place.corners[0]
    return [round(latitude, 9), round(longitude, 9)]


def _written(number: int, command: Command, place: FoundPlace) -> dict[str, object]:
    height = place.values["up_m"]
    radius = place.values.get("acceptance_radius_m", 0)
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": int(command),
        "doJumpId": number,
        "frame": int(MavFrame.GLOBAL_RELATIVE_ALT),
        "AltitudeMode": 1,
        "Altitude": height,
        "AMSLAltAboveTerrain": None,
        "params": [0, radius, 0, None, *_rounded(place), height],
    }


def _zones(places: Sequence[FoundPlace]) -> list[dict[str, object]]:
    zones = [place for place in places if place.kind in (Kind.BOUNDS, Kind.OBSTACLE)]
    return [
        {
            "version": 1,
            "inclusion": zone.kind is Kind.BOUNDS,
            "polygon": [[round(latitude, 9), round(longitude, 9)] for latitude, longitude in zone.corners],
        }
        for zone in zones
    ]


def _rally(places: Sequence[FoundPlace]) -> list[list[object]]:
    fields = [place for place in places if place.kind is Kind.FIELD]
    return [[*_rounded(place), place.values.get("up_m", 0.0)] for place in fields]

"""GeoJSON (RFC 7946): features with the property ``kind`` and those that the kind has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from companion.config.conversion.formats.foreign_file import json_document
from companion.config.conversion.found_places import AREAS, Degrees, FoundPlace, Importer, Kind, kind_named
from companion.config.conversion.path_lines import PathLine

_WGS84 = ("CRS84", "4326")
_DEPTH_MAX = 20
_PARTS = {"MultiPoint": "Point", "MultiLineString": "LineString", "MultiPolygon": "Polygon"}


def take_geojson(importer: Importer, data: bytes) -> None:
    """Take the features of a GeoJSON file.

    Raises
    ------
    ConfigError
        If it is broken, or a value in it is wrong.
    """
    take_features(importer, json_document(importer, data))


def take_features(importer: Importer, document: Mapping[str, object]) -> None:
    """Take the features of a GeoJSON object, as :func:`take_geojson` does those of a file."""
    crs = document.get("crs")
    if crs is not None and not any(name in str(crs) for name in _WGS84):
        raise importer.error(
            "crs", str(crs), "longitude and latitude in WGS84; other systems are not converted"
        )
    kind, features = document.get("type"), document.get("features")
    if kind == "Feature":
        features = [document]
    if kind not in ("FeatureCollection", "Feature") or not isinstance(features, list):
        raise importer.error("type", str(kind), "a FeatureCollection with its features, or a Feature")
    for number, feature in enumerate(features, 1):
        if not isinstance(feature, dict) or feature.get("type") != "Feature":
            raise importer.error(f"features.{number - 1}", feature, "a Feature")
        _take_feature(importer, feature, f"feature {number}")


def _take_feature(importer: Importer, feature: Mapping[str, object], label: str) -> None:
    properties = feature.get("properties") or {}
    if not isinstance(properties, dict):
        raise importer.error(f"{label} properties", properties, "an object, in braces")
    name = str(properties.get("name") or feature.get("id") or "")
    kind = _kind_of(importer, feature, properties, label, name)
    if kind is not None:
        rest = {key: value for key, value in properties.items() if key not in ("kind", "name", "building")}
        _take_geometry(importer, feature.get("geometry"), kind, (name, rest, label), 0)


def _kind_of(
    importer: Importer, feature: Mapping[str, object], properties: Mapping[str, object], label: str, name: str
) -> Kind | None:
    """Return the kind of a feature; one without is remarked, unless it is a building with a height."""
    written = properties.get("kind")
    if written is not None:
        kind = kind_named(str(written))
        if kind is None:
            importer.leave(f"kind {str(written)!r}", label, f"kinds are {', '.join(_offered())}")
        return kind
    geometry = feature.get("geometry")
    is_area = isinstance(geometry, dict) and str(geometry.get("type")).endswith("Polygon")
    if is_area and not {"building", "height", "height_m", "top_m", "top_amsl_m"}.isdisjoint(properties):
        return Kind.OBSTACLE
    if importer.default_kind is None:
        importer.leave(
            "no kind", f"{label} {name}".strip(), f"the property kind is one of {', '.join(_offered())}"
        )
    return importer.default_kind


def _offered() -> list[str]:
    return [kind.value for kind in Kind if kind is not Kind.TAKEOFF]


def _take_geometry(
    importer: Importer,
    geometry: object,
    kind: Kind,
    feature: tuple[str, Mapping[str, object], str],
    depth: int,
) -> None:
    """Take a geometry, and each part of one that has parts."""
    name, _, label = feature
    if geometry is None:
        importer.leave(kind.value, f"{label} {name}".strip(), "it has no geometry")
        return
    if not isinstance(geometry, dict) or depth > _DEPTH_MAX:
        raise importer.error(f"{label} geometry", geometry, "a geometry")
    form, coordinates = str(geometry.get("type")), geometry.get("coordinates")
    if form == "GeometryCollection":
        for part in _list(importer, geometry.get("geometries"), label):
            _take_geometry(importer, part, kind, feature, depth + 1)
    elif form in _PARTS:
        for part in _list(importer, coordinates, label):
            _take_geometry(importer, {"type": _PARTS[form], "coordinates": part}, kind, feature, depth + 1)
    elif form == "Polygon":
        _take_rings(importer, _list(importer, coordinates, label), kind, feature)
    elif form in ("Point", "LineString"):
        points = [coordinates] if form == "Point" else _list(importer, coordinates, label)
        _take_points(importer, [_place(importer, point, label) for point in points], kind, feature)
    else:
        raise importer.error(f"{label} geometry type", form, "Point, LineString, Polygon, or several of them")


def _take_rings(
    importer: Importer, rings: list[object], kind: Kind, feature: tuple[str, Mapping[str, object], str]
) -> None:
    """Take a polygon; a hole of a fence is closed, a hole of anything else is filled."""
    name, properties, label = feature
    if kind not in AREAS:
        importer.leave(kind.value, f"{label} {name}".strip(), "it is a point, and a polygon is given")
        return
    for number, ring in enumerate(rings):
        corners = [_place(importer, corner, label) for corner in _list(importer, ring, label)]
        if number == 0:
            importer.add(kind, corners, name, properties, label)
        elif kind is Kind.FENCE:
            importer.add(Kind.NO_FLY, corners, f"{name} hole {number}".strip(), {}, label)
        else:
            importer.leave(f"hole {number} of {name or kind.value}", label, "the area is taken as a whole")


def _take_points(
    importer: Importer, points: list[Degrees], kind: Kind, feature: tuple[str, Mapping[str, object], str]
) -> None:
    """Take points: one place each, or the middle of a circle, or a vehicle with its route."""
    name, properties, label = feature
    if kind is Kind.MOVING_THREAT and len(points) > 1:
        importer.add(kind, points, name, {"behaviour": "drive"} | dict(properties), label)
        return
    if kind in AREAS and len(points) > 1:
        importer.leave(
            kind.value, f"{label} {name}".strip(), "an area is a polygon, or a point with radius_m"
        )
        return
    for point in points:
        importer.add(kind, [point], name, properties, label)


def _list(importer: Importer, value: object, label: str) -> list[object]:
    if not isinstance(value, list):
        raise importer.error(f"{label} coordinates", value, "a list of coordinates")
    return value


def _place(importer: Importer, value: object, label: str) -> Degrees:
    """Return latitude and longitude of a position [deg]."""
    numbers = _list(importer, value, label)
    if len(numbers) not in (2, 3):
        raise importer.error(f"{label} coordinates", value, "longitude and latitude")
    if len(numbers) == 3:
        importer.remark(
            "third coordinates", "not taken: they count from the ellipsoid; give up_m or altitude_amsl_m"
        )
    return importer.degrees(label, numbers[1], numbers[0])


def feature_collection(places: Iterable[FoundPlace], lines: Iterable[PathLine] = ()) -> dict[str, object]:
    """Return places and lines as a GeoJSON object; a line's heights are above mean sea level.

    Parameters
    ----------
    places : iterable of FoundPlace
        The places.
    lines : iterable of PathLine
        Lines; ``coordTimes`` has their times, as converters from GPX write them.
    """
    features = [*map(_feature, places), *map(_line, lines)]
    return {"type": "FeatureCollection", "features": features}


def _line(line: PathLine) -> dict[str, object]:
    times = {"coordTimes": list(line.times)} if line.times else {}
    return {
        "type": "Feature",
        "properties": {"name": line.name, "heights": "above mean sea level"} | times,
        "geometry": {"type": "LineString", "coordinates": [list(place) for place in line.coordinates()]},
    }


def _feature(place: FoundPlace) -> dict[str, object]:
    corners = [[round(longitude, 9), round(latitude, 9)] for latitude, longitude in place.corners]
    coordinates: object = corners
    if place.kind in AREAS:
        form, coordinates = "Polygon", [[*corners, corners[0]]]
    elif len(corners) == 1:
        form, coordinates = "Point", corners[0]
    else:
        form = "LineString"
    properties = {"kind": place.kind.value} | ({"name": place.name} if place.name else {})
    return {
        "type": "Feature",
        "properties": properties | dict(place.values),
        "geometry": {"type": form, "coordinates": coordinates},
    }

"""GPX 1.0 and 1.1: routes and waypoints are goals; a recorded track is no plan."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from companion.config.conversion.formats.foreign_file import xml_root
from companion.config.conversion.found_places import AREAS, Importer, Kind, kind_named

_VERSIONS = ("1.0", "1.1")
_IGNORED = ("metadata", "name", "desc", "author", "email", "url", "urlname", "time", "keywords", "bounds")


def take_gpx(importer: Importer, data: bytes) -> None:
    """Take the places of a GPX file; heights are over mean sea level.

    Raises
    ------
    ConfigError
        If it is broken, of another version, or a value in it is wrong.
    """
    root = xml_root(importer, data)
    if root.tag != "gpx":
        raise importer.error("file", f"<{root.tag}>", "<gpx>")
    if root.get("version") not in _VERSIONS:
        raise importer.error("gpx version", root.get("version"), " or ".join(_VERSIONS))
    has_route = root.find("rte/rtept") is not None
    for child in root:
        if child.tag == "wpt":
            _take_point(importer, child, "waypoint", None if has_route else Kind.GOAL)
        elif child.tag == "rte":
            for number, point in enumerate(child.findall("rtept"), 1):
                _take_point(importer, point, f"route point {number}", Kind.GOAL)
        elif child.tag == "trk":
            importer.leave("track", child.findtext("name", ""), "it was flown, and is no plan")
        elif child.tag not in _IGNORED:
            importer.leave(f"<{child.tag}>", "", "it is no place")


def _take_point(importer: Importer, point: ET.Element, label: str, usual: Kind | None) -> None:
    """Take a point, by the kind that its type names, or the usual one."""
    name = " ".join(point.findtext("name", "").split())
    kind = kind_named(point.findtext("type", "")) or importer.default_kind or usual
    if kind is None:
        importer.leave(label, name, "the file has a route, whose points are the goals")
        return
    if kind in AREAS:
        importer.leave(f"{label} of type {kind.value}", name, "an area needs corners, and GPX has points")
        return
    height = point.findtext("ele", "").strip()
    values = {"altitude_amsl_m": height} if height else {}
    place = importer.degrees(f"{label} {name}".strip(), point.get("lat"), point.get("lon"))
    importer.add(kind, [place], name, values, label)

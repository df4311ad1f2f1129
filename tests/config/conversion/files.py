"""Small files of each format, written for these tests, and how they are taken."""

import copy
import json
from pathlib import Path

from companion.config.conversion.exchange_files import taken

EXAMPLES = Path(__file__).parents[3] / "docs" / "own-mission"
HOME = (-35.363261, 149.16523)

WAYPOINT = {
    "AMSLAltAboveTerrain": None, "Altitude": 80, "AltitudeMode": 1, "autoContinue": True, "command": 16,
    "doJumpId": 2, "frame": 3, "params": [0, 0, 0, None, -35.35, 149.18, 80], "type": "SimpleItem",
}  # fmt: skip
PLAN = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "QGroundControl",
    "mission": {
        "version": 2, "firmwareType": 3, "vehicleType": 1, "cruiseSpeed": 0, "hoverSpeed": 0,
        "plannedHomePosition": [*HOME, 584], "items": [WAYPOINT],
    },
    "geoFence": {"version": 2, "circles": [], "polygons": []},
    "rallyPoints": {"version": 2, "points": []},
}  # fmt: skip


def plan(**changes):
    """The plan with some of its mission's keys changed."""
    document = copy.deepcopy(PLAN)
    document["mission"] |= changes
    return document


def waypoint(*params, command=16, frame=3):
    return WAYPOINT | {"params": list(params), "command": command, "frame": frame}


def feature(kind, form, coordinates, **properties):
    geometry = {"type": form, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"kind": kind} | properties, "geometry": geometry}


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


def kml(*placemarks, folder=""):
    name = f"<name>{folder}</name>"
    inner = "".join(placemarks)
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{name}{inner}</Document></kml>'


def placemark(name, geometry, **data):
    entries = "".join(f'<Data name="{key}"><value>{value}</value></Data>' for key, value in data.items())
    extended = f"<ExtendedData>{entries}</ExtendedData>" if data else ""
    return f"<Placemark><name>{name}</name>{extended}{geometry}</Placemark>"


def written(folder, name, content):
    """A file with a content: bytes, text, or what becomes JSON."""
    path = folder / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def take(folder, name, content, kind=None):
    """What is taken of a file with a content."""
    return taken(written(folder, name, content), kind)

"""KML and KMZ: placemarks, whose kind a property, a folder's name or their own name says.

References
----------
OGC 12-007r2, KML 2.3.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree as ET

from companion.config.conversion.formats.foreign_file import BYTES_MAX, xml_root
from companion.config.conversion.found_places import AREAS, Degrees, FoundPlace, Importer, Kind, kind_named
from companion.config.conversion.path_lines import PathLine

_EXTENSIONS = "http://www.google.com/kml/ext/2.2"
_FOLDERS = ("Document", "Folder", "kml")
_GEOMETRIES = ("Point", "LineString", "LinearRing", "Polygon", "MultiGeometry")
_NOT_TAKEN = (
    "NetworkLink", "GroundOverlay", "ScreenOverlay", "PhotoOverlay", "Tour", "Track", "MultiTrack", "Model"
)  # fmt: skip
_BROKEN_ARCHIVE = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError)
_MEMBERS_MAX = 10_000
_HEIGHT_MODES = ("absolute", "relativeToGround")
_HEIGHTS = {"up_m", "altitude_amsl_m", "top_m", "top_amsl_m", "height_m", "height"}
_HINT = "no property kind, and no folder such as Obstacles, Fence, Radars or Goals, says what it is"


def take_kmz(importer: Importer, data: bytes) -> None:
    """Take the first KML document of a KMZ archive.

    Raises
    ------
    ConfigError
        If the archive is broken or too large, or has no KML document, or that is wrong.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            documents = [member for member in members if member.filename.lower().endswith(".kml")]
            if not documents or len(members) > _MEMBERS_MAX:
                raise importer.error("file", f"{len(members)} members", "an archive with a KML document")
            for member in documents[1:]:
                importer.leave("document", member.filename, "the first KML document of an archive counts")
            with archive.open(documents[0]) as member_file:
                content = member_file.read(BYTES_MAX + 1)
    except (*_BROKEN_ARCHIVE, OSError, ValueError) as error:  # An offset before its begin raises ValueError.
        raise importer.error("file", str(error), "a whole KMZ archive without a password") from None
    if len(content) > BYTES_MAX:
        raise importer.error("file", documents[0].filename, f"at most {BYTES_MAX} bytes")
    take_kml(importer, content)


def take_kml(importer: Importer, data: bytes) -> None:
    """Take the placemarks of a KML document.

    Raises
    ------
    ConfigError
        If it is broken, or a value in it is wrong.
    """
    root = xml_root(importer, data)
    if root.tag != "kml":
        raise importer.error("file", f"<{root.tag}>", "<kml>")
    _take_folder(importer, root, None)


def _take_folder(importer: Importer, folder: ET.Element, kind: Kind | None) -> None:
    """Take a folder; its name may say the kind of all that it holds."""
    kind = kind_named(folder.findtext("name", "")) or kind
    for child in folder:
        if child.tag in _FOLDERS:
            _take_folder(importer, child, kind)
        elif child.tag == "Placemark":
            _take_placemark(importer, child, kind)
        elif child.tag in _NOT_TAKEN:
            importer.leave(f"<{child.tag}>", child.findtext("name", ""), "it is no place")


def _take_placemark(importer: Importer, placemark: ET.Element, folder_kind: Kind | None) -> None:
    name = " ".join(placemark.findtext("name", "").split())
    properties = _properties(placemark)
    written = properties.pop("kind", None)
    if written is None:
        kind = folder_kind or _by_first_word(name)
    else:
        kind = kind_named(written)
        name = "" if name == written else name  # Export gives this name to a place without one.
        if kind is None:
            importer.leave(f"placemark of kind {written!r}", name, "a mission file has no such kind")
            return
    parts = [child for child in placemark if child.tag in (*_GEOMETRIES, *_NOT_TAKEN)]
    if not parts:
        importer.leave("placemark", name, "it has no geometry")
    label = f"placemark {placemark.get('id', '')}".strip()
    for part in parts:
        _take_geometry(importer, part, kind, (name, properties, label))


def _properties(placemark: ET.Element) -> dict[str, str]:
    """Return a placemark's own data; what is shown in a balloon is not data."""
    data = {
        str(entry.get("name")): entry.findtext("value", "").strip()
        for entry in placemark.findall("ExtendedData/Data")
    }
    for entry in placemark.findall("ExtendedData/SchemaData/SimpleData"):
        data[str(entry.get("name"))] = (entry.text or "").strip()
    return data


def _by_first_word(name: str) -> Kind | None:
    """Return the kind that the first word of a name says, as in ``Radar 2``."""
    words = name.replace("_", " ").split()
    return kind_named(words[0]) if words else None


def _take_geometry(
    importer: Importer, geometry: ET.Element, kind: Kind | None, placemark: tuple[str, Mapping[str, str], str]
) -> None:
    """Take a geometry, or each part of one that has parts."""
    name = placemark[0]
    if geometry.tag == "MultiGeometry":
        for part in geometry:
            _take_geometry(importer, part, kind, placemark)
    elif geometry.tag not in _GEOMETRIES:
        importer.leave(f"<{geometry.tag}>", name, "it is no place")
    else:
        _take_shape(importer, geometry, kind, placemark)


def _take_shape(
    importer: Importer, geometry: ET.Element, kind: Kind | None, placemark: tuple[str, Mapping[str, str], str]
) -> None:
    """Take a point, a line or a polygon."""
    name, properties, label = placemark
    corners, heights = _coordinates(importer, geometry, f"{label} {name}".strip())
    mode = geometry.findtext("altitudeMode", "clampToGround")
    # A polygon at a height is a building, as one draws it: a roof.
    is_roof = geometry.tag == "Polygon" and bool(heights) and mode in _HEIGHT_MODES
    kind = kind or (Kind.OBSTACLE if is_roof else importer.default_kind)
    if kind is None:
        importer.leave(geometry.tag, name, _HINT)
        return
    values = _height(importer, kind, mode, heights) if _HEIGHTS.isdisjoint(properties) else {}
    values |= properties
    if kind in AREAS or kind is Kind.MOVING_THREAT or len(corners) == 1:
        _take_whole(importer, geometry, kind, corners, (name, values, label))
    elif geometry.tag == "Polygon":
        importer.leave(kind.value, name, "it is a point, and a polygon is given")
    else:
        for number, corner in enumerate(corners, 1):
            importer.add(kind, [corner], f"{name} {number}".strip(), values, label)


def _take_whole(
    importer: Importer,
    geometry: ET.Element,
    kind: Kind,
    corners: Sequence[Degrees],
    placemark: tuple[str, Mapping[str, object], str],
) -> None:
    """Take an area, a point, or a vehicle with its route."""
    name, values, label = placemark
    if kind is Kind.MOVING_THREAT and len(corners) > 1:
        values = {"behaviour": "drive"} | dict(values)
    importer.add(kind, corners, name, values, label)
    for number, hole in enumerate(geometry.findall("innerBoundaryIs/LinearRing"), 1):
        inner, _ = _coordinates(importer, hole, f"{label} {name}".strip())
        if kind is Kind.FENCE:
            importer.add(Kind.NO_FLY, inner, f"{name} hole {number}".strip(), {}, label)
        else:
            importer.leave(f"hole {number}", name, "the area is taken as a whole")


def _height(importer: Importer, kind: Kind, mode: str, heights_m: Sequence[float]) -> dict[str, object]:
    """Return the properties that heights in the coordinates stand for; on the ground they mean nothing."""
    if mode not in _HEIGHT_MODES or not heights_m or (kind in AREAS and kind is not Kind.OBSTACLE):
        return {}
    keys = ("top_amsl_m", "height_m") if kind is Kind.OBSTACLE else ("altitude_amsl_m", "up_m")
    if mode == "absolute":
        return {keys[0]: max(heights_m)}
    importer.remark("heights relative to ground", "taken as heights over home")
    return {keys[1]: max(heights_m)}


def _coordinates(importer: Importer, geometry: ET.Element, label: str) -> tuple[list[Degrees], list[float]]:
    """Return the places of a geometry [deg], without those of holes, and the heights that are written [m]."""
    found = "outerBoundaryIs/LinearRing/coordinates" if geometry.tag == "Polygon" else "coordinates"
    text = geometry.findtext(found, "")
    corners, heights = [], []
    for group in text.split():
        numbers = group.split(",")
        if len(numbers) not in (2, 3):
            raise importer.error(
                f"{label} coordinates", group, "longitude,latitude or longitude,latitude,height"
            )
        corners.append(importer.degrees(label, numbers[1], numbers[0]))
        if len(numbers) == 3:
            heights.append(importer.number(f"{label} height", numbers[2]))
    if not corners:
        raise importer.error(f"{label} coordinates", text.strip(), "at least one place")
    return corners, heights


def kml_bytes(places: Iterable[FoundPlace], name: str, lines: Iterable[PathLine] = ()) -> bytes:
    """Return places and lines as a KML document; each placemark of a place has its properties as data.

    Parameters
    ----------
    places : iterable of FoundPlace
        The places, the origin among them.
    name : str
        Name of the document.
    lines : iterable of PathLine
        Lines; those with times become tracks.
    """
    root = ET.Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2", "xmlns:gx": _EXTENSIONS})
    document = ET.SubElement(root, "Document")
    _text(document, "name", name)
    everything = tuple(places)
    ground = next(place.values["altitude_amsl_m"] for place in everything if place.kind is Kind.ORIGIN)
    for place in everything:
        _add_placemark(document, place, float(str(ground)))
    for line in lines:
        _add_line(document, line)
    ET.indent(root, " ")
    text: str = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _text(parent: ET.Element, tag: str, text: str) -> None:
    child = ET.SubElement(parent, tag)
    child.text = text  # The element is made here.


def _add_line(document: ET.Element, line: PathLine) -> None:
    placemark = ET.SubElement(document, "Placemark")
    _text(placemark, "name", line.name)
    geometry = ET.SubElement(placemark, "gx:Track" if line.times else "LineString")
    _text(geometry, "altitudeMode", "absolute")
    for stamp in line.times:
        _text(geometry, "when", stamp)
    places = [(f"{x:.9f}", f"{y:.9f}", f"{up:.3f}") for x, y, up in line.coordinates()]
    if line.times:
        for place in places:
            _text(geometry, "gx:coord", " ".join(place))
    else:
        _text(geometry, "coordinates", " ".join(map(",".join, places)))


def _add_placemark(document: ET.Element, place: FoundPlace, ground_amsl_m: float) -> None:
    placemark = ET.SubElement(document, "Placemark")
    _text(placemark, "name", place.name or place.kind.value)
    data = ET.SubElement(placemark, "ExtendedData")
    for key, value in {"kind": place.kind.value, **place.values}.items():
        entry = ET.SubElement(data, "Data", {"name": key})
        _text(entry, "value", str(value).lower() if isinstance(value, bool) else str(value))
    is_area = place.kind in AREAS
    form = "Polygon" if is_area else "Point" if len(place.corners) == 1 else "LineString"
    geometry = ET.SubElement(placemark, form)
    height = place.values.get("top_m", place.values.get("up_m"))
    suffix = ""
    if height is not None:
        if is_area:
            _text(geometry, "extrude", "1")
        _text(geometry, "altitudeMode", "absolute")
        suffix = f",{float(str(height)) + ground_amsl_m:.3f}"
    corners = (*place.corners, place.corners[0]) if is_area else place.corners
    ring = geometry
    if is_area:
        ring = ET.SubElement(ET.SubElement(geometry, "outerBoundaryIs"), "LinearRing")
    text = " ".join(f"{longitude:.9f},{latitude:.9f}{suffix}" for latitude, longitude in corners)
    _text(ring, "coordinates", text)

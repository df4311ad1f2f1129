"""KML and KMZ: what a placemark is, its height, and XML that means harm."""

import io
import zipfile

import pytest

from companion.config.conversion.found_places import Kind
from companion.errors import ConfigError
from tests.config.conversion.files import EXAMPLES, kml, placemark, take

RING = "149.1,-35.4,{0} 149.2,-35.4,{0} 149.2,-35.3,{0} 149.1,-35.4,{0}"
POINT = "<Point><coordinates>149.18,-35.35</coordinates></Point>"


def polygon(height=0, mode="", hole=""):
    mode = f"<altitudeMode>{mode}</altitudeMode>" if mode else ""
    ring = f"<LinearRing><coordinates>{RING.format(height)}</coordinates></LinearRing>"
    return f"<Polygon>{mode}<outerBoundaryIs>{ring}</outerBoundaryIs>{hole}</Polygon>"


def kinds(importer):
    return [place.kind for place in importer.places]


def test_a_property_a_folder_or_the_first_word_says_what_it_is(tmp_path):
    said = placemark("A", POINT, kind="radar", radius_m=400)
    by_name = placemark("Goal North", POINT)
    folder = f"<Folder><name>Geofence</name>{placemark('edge', polygon())}</Folder>"
    nothing = placemark("Car park", POINT)
    importer = take(tmp_path, "a.kml", kml(said, by_name, folder, nothing))
    assert kinds(importer) == [Kind.RADAR, Kind.GOAL, Kind.FENCE]
    assert importer.places[0].values == {"max_threat_radius_m": 400.0}
    (remark,) = importer.remarks
    assert remark.startswith("a.kml: Point Car park: not taken: no property kind")


def test_heights_by_their_mode(tmp_path):
    over_ground = placemark("Hall", polygon(25, "relativeToGround"))
    over_sea = placemark("Mast", polygon(640, "absolute"))
    importer = take(tmp_path, "a.kml", kml(over_ground, over_sea))
    assert [place.values for place in importer.places] == [{"height_m": 25.0}, {"top_amsl_m": 640.0}]
    assert kinds(importer) == [Kind.OBSTACLE] * 2
    assert importer.places[0].corners == ((-35.4, 149.1), (-35.4, 149.2), (-35.3, 149.2))
    assert any("heights relative to ground: taken as heights over home" in each for each in importer.remarks)


def test_parts_routes_and_holes(tmp_path):
    line = "<LineString><coordinates>149.1,-35.4 149.2,-35.3</coordinates></LineString>"
    inner = "<LinearRing><coordinates>149.12,-35.38 149.14,-35.38 149.14,-35.36</coordinates></LinearRing>"
    hole = f"<innerBoundaryIs>{inner}</innerBoundaryIs>"
    many = f"<MultiGeometry>{polygon(hole=hole)}{POINT}</MultiGeometry>"
    car = placemark("car", line, kind="vehicle", radius_m=200, speed_m_s=15)
    importer = take(
        tmp_path,
        "a.kml",
        kml(placemark("way", line, kind="goal"), car, placemark("edge", many, kind="fence")),
    )
    assert kinds(importer)[:4] == [Kind.GOAL, Kind.GOAL, Kind.MOVING_THREAT, Kind.FENCE]
    assert importer.places[2].values["behaviour"] == "drive"
    assert importer.places[4].kind is Kind.NO_FLY  # The hole of a fence is closed.
    assert any(
        "fence edge placemark: not taken: an area has three corners" in each for each in importer.remarks
    )


def test_what_is_no_place_is_named(tmp_path):
    link = "<NetworkLink><name>weather</name><Link><href>http://example.org</href></Link></NetworkLink>"
    track = placemark("flown", '<gx:Track xmlns:gx="http://www.google.com/kml/ext/2.2"/>')
    importer = take(
        tmp_path, "a.kml", kml(link, track, placemark("empty", ""), placemark("odd", POINT, kind="x"))
    )
    said = "\n".join(importer.remarks)
    for words in ("<NetworkLink> weather: not taken", "<Track> flown", "placemark empty", "of kind 'x' odd"):
        assert words in said, words


def test_a_kmz_is_its_first_document(tmp_path):
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("images/icon.png", b"png")
        archive.writestr("doc.kml", kml(placemark("Goal", POINT)))
        archive.writestr("more.kml", kml())
    importer = take(tmp_path, "a.kmz", target.getvalue())
    assert kinds(importer) == [Kind.GOAL]
    assert any("document more.kml: not taken" in remark for remark in importer.remarks)


def test_a_kmz_that_grows_is_refused(tmp_path):
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b" " * 30_000_000)
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.kmz", target.getvalue())
    assert "at most 20000000 bytes" in str(caught.value)


BOMB = '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><kml>&b;</kml>'
THIEF = '<!DOCTYPE kml [<!ENTITY x SYSTEM "file:///etc/hostname">]><kml><name>&x;</name></kml>'
BROKEN = {
    "empty": ("", "file", "nothing"),
    "truncated": (kml(placemark("a", POINT))[:120], "syntax", None),
    "not XML": ("Hello", "syntax", "syntax error"),
    "not KML": ("<gpx/>", "file", "<gpx>"),
    "a bomb": (BOMB, "file", "a document type (DOCTYPE)"),
    "a thief": (THIEF, "file", "a document type (DOCTYPE)"),
    "an entity": ("<kml>&b;</kml>", "syntax", "undefined entity"),
    "deep": ("<kml>" + "<Folder>" * 2_000, "file", "more elements"),
    "NaN": (kml(placemark("Goal", POINT.replace("-35.35", "nan"))), "placemark Goal latitude", "nan"),
    "latitude": (kml(placemark("Goal", POINT.replace("-35.35", "95"))), "placemark Goal latitude", "95"),
    "one number": (kml(placemark("Goal", POINT.replace(",-35.35", ""))), "placemark Goal coordinates", None),
    "a radius": (kml(placemark("A", POINT, kind="radar", radius_m="wide")), "placemark radius_m", "wide"),
    "a truth": (
        kml(placemark("A", POINT, kind="radar", known_beforehand="perhaps")),
        "placemark known_beforehand", "perhaps",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_gives_one_error(case, tmp_path):
    content, key, value = BROKEN[case]
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.kml", content)
    assert caught.value.key == key
    assert value is None or caught.value.value == value


@pytest.mark.parametrize("content", [b"PK", b"no archive at all", b"PK\x05\x06" + bytes(18)])
def test_a_broken_archive_gives_one_error(content, tmp_path):
    with pytest.raises(ConfigError):
        take(tmp_path, "a.kmz", content)


def test_the_example_has_three_buildings(tmp_path):
    importer = take(tmp_path, "buildings.kml", (EXAMPLES / "buildings.kml").read_text(encoding="utf-8"))
    assert [(place.kind, place.name) for place in importer.places] == [
        (Kind.OBSTACLE, "Hall"), (Kind.OBSTACLE, "Grain silo"), (Kind.OBSTACLE, "Büro 1"),
    ]  # fmt: skip
    assert [place.values["height_m"] for place in importer.places] == [130.0, 160.0, 140.0]

"""GeoJSON: features by their kind, buildings by their height; what is wrong in one error."""

import json

import pytest

from companion.config.conversion.formats.geojson_file import feature_collection
from companion.config.conversion.found_places import Kind
from companion.errors import ConfigError
from tests.config.conversion.files import collection, feature, take

RING = [[149.1, -35.4], [149.2, -35.4], [149.2, -35.3], [149.1, -35.4]]
PLACE = [149.18, -35.35]


def kinds(importer):
    return [place.kind for place in importer.places]


def test_each_kind(tmp_path):
    document = collection(
        feature("home", "Point", PLACE, altitude_amsl_m=584),
        feature("Start", "Point", PLACE, up_m=100, course_deg=45),
        feature("goal", "MultiPoint", [PLACE, [149.19, -35.35]], up_m=90),
        feature("obstacle", "Polygon", [RING], name="hall", height=30),
        feature("fence", "Polygon", [RING]),
        feature("no_fly", "Point", PLACE, radius_m=200),
        feature("radar", "Point", PLACE, name="west", radius_m=500, known_beforehand=False),
        feature(
            "moving_threat", "LineString", [PLACE, [149.2, -35.3]], speed_m_s=12, max_threat_radius_m=150
        ),
        feature("people", "MultiPolygon", [[RING], [RING]], name="village"),
    )
    importer = take(tmp_path, "a.geojson", document)
    assert kinds(importer) == [
        Kind.ORIGIN, Kind.START, Kind.GOAL, Kind.GOAL, Kind.OBSTACLE, Kind.FENCE, Kind.NO_FLY, Kind.RADAR,
        Kind.MOVING_THREAT, Kind.PEOPLE, Kind.PEOPLE,
    ]  # fmt: skip
    assert importer.places[4].values == {"height_m": 30.0}
    assert importer.places[4].corners == ((-35.4, 149.1), (-35.4, 149.2), (-35.3, 149.2))
    assert importer.places[7].values == {"max_threat_radius_m": 500.0, "known_beforehand": False}
    assert importer.places[8].values["behaviour"] == "drive"


def test_a_building_is_an_obstacle_and_its_other_properties_are_counted(tmp_path):
    building = {
        "type": "Feature", "id": "way/7", "geometry": {"type": "Polygon", "coordinates": [RING]},
        "properties": {"building": "yes", "height": "12.5", "addr:street": "Main Street"},
    }  # fmt: skip
    importer = take(tmp_path, "a.geojson", collection(building, building))
    assert [(place.kind, place.name, place.values) for place in importer.places] == [
        (Kind.OBSTACLE, "way/7", {"height_m": 12.5})
    ] * 2
    assert importer.remarks == (
        "a.geojson: property 'addr:street' of 2 feature(s): not taken: a mission file has no such key",
    )


def test_what_has_no_kind_is_named_unless_a_default_is_given(tmp_path):
    plain = {"type": "Feature", "properties": None, "geometry": {"type": "Polygon", "coordinates": [RING]}}
    importer = take(tmp_path, "a.json", collection(plain, feature("lake", "Polygon", [RING])))
    assert kinds(importer) == []
    assert "no kind feature 1: not taken: the property kind is one of" in importer.remarks[1]
    assert "kind 'lake' feature 2: not taken" in importer.remarks[2]
    assert importer.remarks[0] == "a.json: file: nothing of it is taken"
    assert kinds(take(tmp_path, "a.json", collection(plain), Kind.FENCE)) == [Kind.FENCE]


def test_holes_lines_and_heights_that_are_not_taken(tmp_path):
    hole = [[149.12, -35.38], [149.14, -35.38], [149.14, -35.36], [149.12, -35.38]]
    document = collection(
        feature("obstacle", "Polygon", [RING, hole], name="court", top_m=30),
        feature("fence", "Polygon", [RING, hole]),
        feature("fence", "LineString", [PLACE, PLACE]),
        feature("goal", "Polygon", [RING]),
        feature("goal", "Point", [*PLACE, 700.0]),
        {"type": "Feature", "properties": {"kind": "goal"}, "geometry": None},
    )
    importer = take(tmp_path, "a.geojson", document)
    assert kinds(importer) == [Kind.OBSTACLE, Kind.FENCE, Kind.NO_FLY, Kind.GOAL]
    said = "\n".join(importer.remarks)
    for words in (
        "hole 1 of court feature 1: not taken",
        "fence feature 3: not taken",
        "goal feature 4: not taken",
        "third coordinates: not taken: they count from the ellipsoid",
        "goal feature 6: not taken: it has no geometry",
    ):
        assert words in said, words


BROKEN = {
    "empty": ("\n", "file", "nothing"),
    "truncated": (json.dumps(collection(feature("goal", "Point", PLACE)))[:-9], "syntax", None),
    "NaN": ('{"type": "FeatureCollection", "features": [NaN]}', "file", "NaN"),
    "type": ({"type": "Topology"}, "type", "Topology"),
    "no features": ({"type": "FeatureCollection"}, "type", "FeatureCollection"),
    "no feature": (collection(3), "features.0", "3"),
    "latitude": (collection(feature("goal", "Point", [149.0, 95.0])), "feature 1 latitude", "95.0"),
    "coordinates": (collection(feature("goal", "Point", [149.0])), "feature 1 coordinates", "[149.0]"),
    "a truth": (collection(feature("goal", "Point", [True, 5])), "feature 1 longitude", "True"),
    "geometry": (collection(feature("goal", "Circle", PLACE)), "feature 1 geometry type", "Circle"),
    "number": (collection(feature("goal", "Point", PLACE, up_m="high")), "feature 1 up_m", "high"),
    "properties": ({"type": "Feature", "properties": [1], "geometry": None}, "feature 1 properties", "[1]"),
    "another system": (collection() | {"crs": {"properties": {"name": "EPSG:2056"}}}, "crs", None),
    "a large radius": (
        collection(feature("no_fly", "Point", PLACE, radius_m=1e6)), "feature 1 radius_m", "1000000.0",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_gives_one_error(case, tmp_path):
    content, key, value = BROKEN[case]
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.geojson", content)
    assert caught.value.key == key
    assert value is None or caught.value.value == value


def test_what_is_written_is_what_was_taken(tmp_path):
    document = collection(
        feature("radar", "Point", PLACE, name="west", max_threat_radius_m=500.0),
        feature("fence", "Polygon", [RING]),
        feature("moving_threat", "LineString", [PLACE, [149.2, -35.3]], name="car", behaviour="drive"),
    )
    importer = take(tmp_path, "a.geojson", document)
    assert feature_collection(importer.places) == document

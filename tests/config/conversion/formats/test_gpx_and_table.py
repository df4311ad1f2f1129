"""GPX routes and waypoints; tables of radars."""

import pytest

from companion.config.conversion.found_places import Kind
from companion.errors import ConfigError
from tests.config.conversion.files import EXAMPLES, take


def gpx(inner, version="1.1"):
    return f'<gpx version="{version}" xmlns="http://www.topografix.com/GPX/1/1">{inner}</gpx>'


ROUTE = (
    '<rte><rtept lat="-35.35" lon="149.18"><ele>684</ele><name>A</name></rtept>'
    '<rtept lat="-35.34" lon="149.19"/></rte>'
)
TYPED = '<wpt lat="-35.36" lon="149.16"><ele>584</ele><name>H</name><type>home</type></wpt>'
PLAIN = '<wpt lat="-35.36" lon="149.17"><name>P</name></wpt>'


def kinds(importer):
    return [place.kind for place in importer.places]


def test_a_routes_points_are_goals_and_types_say_the_rest(tmp_path):
    importer = take(tmp_path, "a.gpx", gpx(TYPED + PLAIN + ROUTE + "<trk><name>flown</name></trk>"))
    assert kinds(importer) == [Kind.ORIGIN, Kind.GOAL, Kind.GOAL]
    assert importer.places[1].values == {"altitude_amsl_m": 684.0}
    assert importer.places[1].corners == ((-35.35, 149.18),)
    assert importer.remarks == (
        "a.gpx: waypoint P: not taken: the file has a route, whose points are the goals",
        "a.gpx: track flown: not taken: it was flown, and is no plan",
    )


def test_without_a_route_waypoints_are_goals(tmp_path):
    assert kinds(take(tmp_path, "a.gpx", gpx(PLAIN, "1.0"))) == [Kind.GOAL]


BROKEN_GPX = {
    "version": (gpx(PLAIN, "2.0"), "gpx version", "2.0"),
    "no latitude": (gpx('<wpt lon="5"/>'), "waypoint latitude", "nothing"),
    "latitude": (gpx(PLAIN.replace("-35.36", "95")), "waypoint P latitude", "95"),
    "height": (gpx(TYPED.replace("584", "nan")), "waypoint altitude_amsl_m", "nan"),
    "truncated": (gpx(PLAIN)[:-9], "syntax", None),
    "kml": ("<kml/>", "file", "<kml>"),
}


@pytest.mark.parametrize("case", BROKEN_GPX)
def test_a_broken_gpx_gives_one_error(case, tmp_path):
    content, key, value = BROKEN_GPX[case]
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.gpx", content)
    assert caught.value.key == key
    assert value is None or caught.value.value == value


def test_the_example_table(tmp_path):
    importer = take(tmp_path, "radars.csv", (EXAMPLES / "radars.csv").read_text(encoding="utf-8"))
    assert [(place.kind, place.name) for place in importer.places] == [
        (Kind.RADAR, "West"),
        (Kind.RADAR, "East"),
    ]
    assert importer.places[0].values == {"max_threat_radius_m": 500.0, "altitude_amsl_m": 590.0}
    assert importer.remarks == ()


def test_a_table_of_another_spreadsheet(tmp_path):
    """Semicolons part the columns, commas the decimals; one column is not known, one row is empty."""
    text = "Lat;Lon;Range m;Operator;known_beforehand\r\n-35,35;149,18;500,5;Navy;no\r\n;;;;\r\n"
    importer = take(tmp_path, "a.csv", text.encode("utf-8-sig"))
    (radar,) = importer.places
    assert (radar.name, radar.corners) == ("radar 1", ((-35.35, 149.18),))
    assert radar.values == {"max_threat_radius_m": 500.5, "known_beforehand": False}
    assert importer.remarks == ("a.csv: column 'Operator': not taken: a radar has no such property",)


BROKEN_CSV = {
    "empty": ("", "file", "nothing"),
    "no radius": ("lat,lon\n1,2\n", "columns", "lat, lon"),
    "twice": ("lat,latitude,lon,radius\n", "column 'latitude'", "a second one"),
    "cells": ("lat,lon,radius\n1,2\n", "row 2", "2 cells"),
    "latitude": ("lat,lon,radius\n95,2,3\n", "row 2 latitude", "95"),
    "NaN": ("lat,lon,radius\n5,2,nan\n", "row 2 max_threat_radius_m", "nan"),
    "no value": ("lat,lon,radius\n5,2,\n", "row 2 radius", "nothing"),
    "text": ("lat,lon,radius\nnorth,2,3\n", "row 2 latitude", "north"),
    "a quote": ('lat,lon,radius\n"5,2,3\n', "table", "unexpected end of data"),
    "a NUL": (b"lat,lon,radius\n\x005,2,3\n", "row 2 latitude", None),
}


@pytest.mark.parametrize("case", BROKEN_CSV)
def test_a_broken_table_gives_one_error(case, tmp_path):
    content, key, value = BROKEN_CSV[case]
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.csv", content)
    assert caught.value.key == key
    assert value is None or caught.value.value == value


@pytest.mark.parametrize("name", ["a.yaml", "a"])
def test_an_unknown_ending_is_refused(name, tmp_path):
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, name, "x")
    assert ".plan, .waypoints, .txt, .kml" in caught.value.expected


def test_a_folder_and_a_missing_file_are_refused(tmp_path):
    (tmp_path / "a.kml").mkdir()
    from companion.config.conversion.exchange_files import taken  # noqa: PLC0415

    for name, words in (("a.kml", "is a directory"), ("b.kml", "no such file")):
        with pytest.raises(ConfigError, match=words):
            taken(tmp_path / name)

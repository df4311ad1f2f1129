"""Planned and flown paths in KML, GeoJSON and plans: places, heights, times, and what an import takes."""

import json
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from companion.cli_options import Targets
from companion.config import load_mission
from companion.config.conversion.exchange_files import taken
from companion.config.conversion.found_places import Kind
from companion.config.conversion.mission_commands import export_flight, export_plan
from companion.config.conversion.path_lines import waypoints_of_plan
from companion.errors import ConfigError
from companion.types.record import FlightRecord, UploadedMission
from tests.sim.client import CONFIGS
from tests.support.paths import path_of

GX = "{http://www.google.com/kml/ext/2.2}"
KML = "{http://www.opengis.net/kml/2.2}"
MISSION = load_mission(CONFIGS / "first-flight.yaml")
PLACES = np.array([[0.0, 0.0, 100.0], [400.0, 0.0, 100.0], [400.0, 300.0, 130.0]])
EPOCH_S = 1_795_860_000.0  # 2026-11-28 10:00:00 UTC.


def record(**changes):
    rows = np.zeros((4, 7))
    rows[:, 0] = (10.0, 11.0, 12.0, 13.5)
    rows[:3, 1:4], rows[3, 1:4] = PLACES, np.nan  # The last row has no place.
    missions = (
        UploadedMission(10.0, PLACES[:1], "one waypoint is no line"),
        UploadedMission(10.5, PLACES[:2], "first plan"),
        UploadedMission(12.0, PLACES[1:], "better"),
    )
    whole = FlightRecord(rows, (), (), missions, (), np.empty((0, 2)), (), {}, epoch_s=EPOCH_S)
    return replace(whole, **changes)


def places_of(coordinates):
    """East, north, up of longitudes, latitudes [°] and heights above the sea [m]."""
    return np.array([MISSION.frame.local_from_global(y, x, up) for x, y, up in coordinates])


@pytest.fixture
def targets(tmp_path):
    return Targets(tmp_path / "a.plan", tmp_path / "a.kml", tmp_path / "a.geojson")


def test_a_flight_in_geojson_has_its_path_with_times_and_each_mission(targets):
    said = export_flight(MISSION, record(), targets)
    assert "all places, flown path and 2 missions" in said
    features = json.loads(targets.geojson.read_text(encoding="utf-8"))["features"]
    lines = [entry for entry in features if entry["properties"].get("heights") == "above mean sea level"]
    assert [line["properties"]["name"] for line in lines] == [
        "flown path", "mission 2: first plan", "mission 3: better",
    ]  # fmt: skip
    assert places_of(lines[0]["geometry"]["coordinates"]) == pytest.approx(PLACES, abs=0.01)
    assert lines[0]["properties"]["coordTimes"] == [
        f"2026-11-28T10:00:{second}.000+00:00" for second in (10, 11, 12)
    ]
    assert places_of(lines[2]["geometry"]["coordinates"]) == pytest.approx(PLACES[1:], abs=0.01)


def test_a_flight_in_kml_is_a_track_whose_places_have_times(targets):
    export_flight(MISSION, record(), targets)
    (track,) = ET.parse(targets.kml).iter(f"{GX}Track")
    assert [entry.text for entry in track.iter(f"{KML}altitudeMode")] == ["absolute"]
    assert len(list(track.iter(f"{KML}when"))) == 3
    coordinates = [tuple(map(float, entry.text.split())) for entry in track.iter(f"{GX}coord")]
    assert places_of(coordinates) == pytest.approx(PLACES, abs=0.01)


def test_without_a_time_of_day_the_flown_path_is_a_line(targets):
    export_flight(MISSION, record(epoch_s=None), targets)
    assert not list(ET.parse(targets.kml).iter(f"{GX}Track"))
    assert "flown path" in targets.kml.read_text(encoding="utf-8")


def test_the_plan_of_a_flight_has_the_waypoints_of_its_last_mission(targets):
    export_flight(MISSION, record(), targets)
    goals = [place for place in taken(targets.plan).places if place.kind is Kind.GOAL]
    assert len(goals) == 2
    for place, expected in zip(goals, PLACES[1:], strict=True):
        east, north, _ = MISSION.frame.local_from_global(*place.corners[0], 0.0)
        assert (east, north, place.values["up_m"]) == pytest.approx(expected, abs=0.01)


def test_a_flight_without_a_mission_has_no_plan_and_nothing_is_written(targets):
    with pytest.raises(ConfigError, match="no mission of the service"):
        export_flight(MISSION, record(missions=()), targets)
    assert not targets.kml.exists()
    export_flight(MISSION, record(missions=()), replace(targets, plan=None))
    assert targets.kml.exists()


@pytest.mark.parametrize("name", ["kml", "geojson"])
def test_lines_are_not_taken_for_places_by_an_import(targets, name):
    """A flown path between the goals would else be flown to by the next flight."""
    export_flight(MISSION, record(), targets)
    importer = taken(getattr(targets, name))
    kinds = [place.kind for place in importer.places]
    assert kinds.count(Kind.GOAL) == len(MISSION.goals)
    remarks = " ".join(importer.remarks)
    assert "flown path" in remarks
    assert "mission 3: better" in remarks


def test_a_plan_is_a_line_and_as_few_waypoints_as_follow_it(targets):
    straight = np.column_stack([np.linspace(0.0, 500.0, 51), np.zeros(51), np.full(51, 100.0)])
    path = path_of(np.arange(51.0), straight, np.full(51, 0.5 * np.pi))
    assert waypoints_of_plan(path) == pytest.approx(straight[[0, -1]])
    said = export_plan(MISSION, path, targets)
    assert "waypoints of the path" in said
    features = json.loads(targets.geojson.read_text(encoding="utf-8"))["features"]
    assert len(features[-1]["geometry"]["coordinates"]) == 51
    assert sum(place.kind is Kind.GOAL for place in taken(targets.plan).places) == 2


def test_waypoints_follow_the_heights_of_a_path_that_is_straight_on_the_map():
    """Over a hill, two waypoints at its feet would lead into it."""
    east = np.linspace(0.0, 1000.0, 101)
    up = 100.0 + 80.0 * np.exp(-(((east - 500.0) / 150.0) ** 2))
    path = path_of(np.arange(101.0), np.column_stack([east, np.zeros(101), up]), np.full(101, 0.5 * np.pi))
    found = waypoints_of_plan(path)
    assert 4 < len(found) < 30
    assert np.abs(np.interp(east, found[:, 0], found[:, 2]) - up).max() <= 2.0

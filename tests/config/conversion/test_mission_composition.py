"""How a mission is composed of places: heights, bounds, fences, names; and what is missing."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import load_mission, mission_from_text
from companion.config.conversion.exchange_files import imported
from companion.config.conversion.fence_walls import common_area, walls_about
from companion.config.conversion.found_places import circle
from companion.config.conversion.mission_composition import Wishes
from companion.errors import ConfigError
from companion.frames import LocalFrame
from tests.config.conversion.files import (
    EXAMPLES,
    collection,
    feature,
    kml,
    placemark,
    plan,
    waypoint,
    written,
)
from tests.sim.client import CONFIGS

FRAME = LocalFrame(-35.363261, 149.16523, 584.0)
HOME = feature("home", "Point", [149.16523, -35.363261], altitude_amsl_m=584)


def at(east, north):
    """Longitude and latitude, as in GeoJSON."""
    latitude, longitude, _ = FRAME.global_from_local(east, north, 0.0)
    return [longitude, latitude]


def ring(*corners):
    return [[at(*corner) for corner in (*corners, corners[0])]]


GOAL = feature("goal", "Point", at(2_000.0, 0.0), up_m=100)


def mission_of(folder, *features, **wishes):
    file = written(folder, "a.geojson", collection(*features))
    text = imported([file], Wishes("mine", **wishes))
    return mission_from_text(text, "mine.yaml"), text


def fault(folder, *features, **wishes):
    with pytest.raises(ConfigError) as caught:
        mission_of(folder, *features, **wishes)
    return caught.value


def test_home_and_a_goal_are_a_mission(tmp_path):
    """The start is above home, its course is that to the goal; the bounds reach 500 m beyond both."""
    mission, _ = mission_of(tmp_path, HOME, GOAL)
    start, (goal,) = mission.start, mission.goals
    assert (start.east_m, start.north_m, start.up_m, start.course_deg) == pytest.approx(
        (0, 0, 100, 90), abs=0.1
    )
    assert (goal.east_m, goal.north_m, goal.up_m) == pytest.approx((2_000, 0, 100), abs=1e-3)
    assert (mission.dimension, mission.bounds.up_m) == (2, (60, 160))
    assert mission.bounds.east_m == pytest.approx((-500, 2_500), abs=1.1)
    assert mission.bounds.north_m == pytest.approx((-500, 500), abs=1.1)


@pytest.mark.parametrize("name", ["7", "2026-11-28", "on", "1e3", "field-7"])
def test_a_file_may_be_called_by_a_number_or_a_word_of_yaml(name, tmp_path):
    text = imported([written(tmp_path, "a.geojson", collection(HOME, GOAL))], Wishes(name))
    assert mission_from_text(text, "mine.yaml").name == name


def test_heights_over_the_sea_count_from_homes_altitude(tmp_path):
    high = feature("goal", "Point", at(2_000.0, 0.0), altitude_amsl_m=734)
    mast = feature(
        "obstacle", "Polygon", ring((900, 90), (950, 90), (950, 140)), base_amsl_m=580, top_amsl_m=700
    )
    mission, _ = mission_of(tmp_path, HOME, high, GOAL, mast)
    assert [goal.up_m for goal in mission.goals] == [150, 100]
    assert (mission.obstacles[0].base_m, mission.obstacles[0].top_m) == (-4, 116)
    assert mission.dimension == 3
    assert mission.start.up_m == 150


def test_heights_of_a_plan_count_from_its_own_home(tmp_path):
    """Two plans with homes of 584 and 600 m: 80 m above the second one is 96 m above the first."""
    one = written(tmp_path, "one.plan", plan(items=[waypoint(0, 0, 0, None, -35.35, 149.18, 96)]))
    home = [-35.363261, 149.16523, 600]
    two = plan(items=[waypoint(0, 0, 0, None, -35.35, 149.19, 80)], plannedHomePosition=home)
    text = imported([one, written(tmp_path, "two.plan", two)], Wishes("mine"))
    mission = mission_from_text(text, "mine.yaml")
    assert [goal.up_m for goal in mission.goals] == [96, 96]
    assert mission.origin.altitude_amsl_m == 584
    assert "two.plan: planned home: not taken: it is 0 m from the home that counts, +16 m" in text


def test_a_fence_becomes_bounds_and_walls(tmp_path):
    """A triangle's box, and walls over the rest of it and beyond, but not within the triangle."""
    fence = feature("fence", "Polygon", ring((-400, -400), (3_000, -400), (-400, 3_000)))
    mission, _ = mission_of(tmp_path, HOME, GOAL, fence)
    assert mission.bounds.east_m == pytest.approx((-400, 3_000), abs=0.5)
    walls = shapely.union_all([shapely.Polygon(wall.polygon_enu_m) for wall in mission.obstacles])
    assert all(wall.top_m > 160 and wall.base_m < 60 for wall in mission.obstacles)
    for inside in ((-390, -390), (2_900, -390), (1_000, 1_000), (-390, 2_900)):
        assert not walls.covers(shapely.Point(inside)), inside
    for outside in ((1_400, 1_400), (2_900, 2_900), (-420, 0), (0, -420)):
        assert walls.covers(shapely.Point(outside)), outside


@settings(max_examples=80, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 900), st.integers(0, 900)), min_size=3, max_size=12, unique=True),
    st.data(),
)
def test_walls_cover_all_of_the_box_but_the_fence(points, data):
    corners = np.array(shapely.MultiPoint(points).convex_hull.buffer(5.0).exterior.coords)[:-1]
    notch = shapely.box(*(data.draw(st.integers(0, 400)) for _ in range(2)), 500, 500)
    shape = shapely.Polygon(corners).difference(notch)
    part = max(shapely.get_parts(shape), key=lambda part: part.area) if not shape.is_empty else None
    if part is None or part.interiors or part.area < 10.0:
        return
    inside = common_area([np.array(part.exterior.coords)[:-1]])
    west, south, east, north = inside.bounds
    walls = [shapely.Polygon(wall) for wall in walls_about(inside, (west, east, south, north))]
    assert all(wall.is_valid for wall in walls)
    together = shapely.union_all(walls)
    assert together.intersection(inside).area < 1e-6 * inside.area + 1e-3
    box = shapely.box(west, south, east, north)
    assert box.difference(inside).difference(together).area < 5.0  # Pieces below a square metre are left out.


def test_fences_without_room_in_common_are_refused(tmp_path):
    west = feature("fence", "Polygon", ring((-900, -400), (-600, -400), (-600, 0)), name="west")
    east = feature("fence", "Polygon", ring((600, -400), (900, -400), (900, 0)), name="east")
    error = fault(tmp_path, HOME, GOAL, west, east)
    assert (error.key, error.value) == ("fence", "no common area")
    assert "'west'" in error.file
    crossed = feature("fence", "Polygon", ring((-900, -400), (900, 400), (900, -400), (-900, 400)))
    assert fault(tmp_path, HOME, GOAL, crossed).key == "fence"


def test_a_fence_that_the_start_is_outside_of_is_refused(tmp_path):
    fence = feature("fence", "Polygon", ring((600, -400), (2_900, -400), (2_900, 400), (600, 400)))
    error = fault(tmp_path, HOME, GOAL, fence)
    assert (error.file, error.key) == ("a.geojson", "start.east_m")


def test_circles_hold_what_they_are_for():
    """Around an obstacle no point of the circle is outside; within a fence none of the polygon is."""
    frame = LocalFrame(45.0, 7.0, 0.0)
    for is_inside, check in ((False, min), (True, max)):
        corners = circle((45.0, 7.0), 300.0, is_inside=is_inside)
        local = np.array([frame.local_from_global(*corner, 0.0)[:2] for corner in corners])
        edges = [shapely.LineString(pair) for pair in zip(local, np.roll(local, 1, axis=0), strict=True)]
        nearest = min(edge.distance(shapely.Point(0, 0)) for edge in edges)
        assert check(nearest if check is min else np.hypot(*local.T).max(), 300.0) == pytest.approx(
            300.0, abs=1e-3
        )


def test_an_obstacle_without_a_height_is_closed_at_all_heights(tmp_path):
    shed = feature("obstacle", "Polygon", ring((900, 90), (950, 90), (950, 140)), name="shed")
    mission, text = mission_of(tmp_path, HOME, GOAL, shed)
    assert (mission.obstacles[0].base_m, mission.obstacles[0].top_m) == (-40, 260)
    assert "# - a.geojson: feature 3 'shed': no height: closed at all heights" in text


def test_names_are_made_fit_and_apart_and_that_is_said(tmp_path):
    spots = [
        feature("radar", "Point", at(500.0, 400.0), name=name, radius_m=100)
        for name in ("Süd #1", "Süd #1", "")
    ]
    mission, text = mission_of(tmp_path, HOME, GOAL, *spots)
    assert [radar.name for radar in mission.radars] == ["Sud _1", "Sud _1_2", "radar"]
    assert "'Süd #1': named 'Sud _1' here" in text


def test_lines_in_names_do_not_become_lines_of_the_file(tmp_path):
    spots = [feature("goal", "Point", at(500.0, 400.0), name="x\nvehicle: {}", up_m=100)]
    mission, text = mission_of(tmp_path, HOME, *spots)
    assert "\nvehicle: {}" not in text
    assert len(mission.goals) == 1


MISSING = {
    "home": ([GOAL], "home", "--home LAT,LON,ALTITUDE"),
    "goals": ([HOME], "goals", "--goals-from-autopilot"),
    "radius": (
        [HOME, GOAL, feature("radar", "Point", at(5, 5), name="r")],
        "max_threat_radius_m",
        "a radar needs it",
    ),
    "speed": (
        [HOME, GOAL, feature("moving_threat", "Point", at(5, 5), radius_m=50)],
        "speed_m_s",
        "a moving_threat needs it",
    ),
    "one height": (
        [HOME, feature("goal", "Point", at(5, 5), up_m=5, altitude_amsl_m=9)],
        "altitude_amsl_m",
        "up_m",
    ),
    "one top": (
        [HOME, GOAL, feature("obstacle", "Polygon", ring((5, 5), (9, 5), (9, 9)), top_m=5, height_m=5)],
        "top",
        "top_amsl_m",
    ),
    "an obstacle at the start": (
        [HOME, GOAL, feature("obstacle", "Polygon", ring((-50, -50), (50, -50), (0, 90)), height_m=200)],
        "start",
        "outside the obstacle",
    ),
}


@pytest.mark.parametrize("case", MISSING)
def test_what_is_missing_is_said_with_what_to_add(case, tmp_path):
    features, key, expected = MISSING[case]
    error = fault(tmp_path, *features)
    assert error.key == key
    assert expected in error.expected
    assert "a.geojson" in error.file


def test_home_from_the_command_line_and_goals_in_the_autopilot(tmp_path):
    mission, text = mission_of(
        tmp_path, GOAL, home=(-35.363261, 149.16523, 584.0), goals_from_autopilot=True, aircraft="slow"
    )
    assert mission.goals_from_autopilot
    assert mission.vehicle.airspeed_cruise_m_s == 14
    assert "not taken: goals are the autopilot's" in text


def test_like_gives_what_the_files_do_not_have(tmp_path):
    like = load_mission(CONFIGS / "first-flight.yaml")
    radar = feature("radar", "Point", at(700.0, 1_200.0), name="new", radius_m=150)
    mission, _ = mission_of(tmp_path, radar, like=like)
    assert [entry.name for entry in mission.radars] == ["new"]
    assert mission.obstacles[0].name == "wall"
    assert mission.start.east_m == pytest.approx(150.0, abs=1e-3)
    assert (mission.planning, mission.vehicle, mission.simulation) == (
        like.planning,
        like.vehicle,
        like.simulation,
    )


def test_fields_and_people_need_a_glide(tmp_path):
    field = feature("rally", "Point", at(300.0, 300.0), name="meadow", radius_m=80)
    mission, text = mission_of(tmp_path, HOME, GOAL, field)
    assert mission.glide is None
    assert "'meadow': not taken: it needs a section glide, from --like" in text
    document = load_mission(CONFIGS / "first-flight.yaml").model_dump(mode="json", exclude_none=True)
    like = mission_from_text(str(document | {"glide": {"ratio": 9.0, "airspeed_m_s": 20.0}}), "like.yaml")
    goal = feature("goal", "Point", at(1_900.0, 200.0), up_m=100)
    mission, _ = mission_of(tmp_path, HOME, goal, field, like=like)
    (place,) = mission.glide.fields
    assert (place.name, place.radius_m, place.up_m) == ("meadow", 80, 0)
    assert mission.glide.ratio == 9


def test_the_example_of_the_page(tmp_path):
    """A plan with a fence, three buildings, two radars: all there, and each thing left out named."""
    files = [EXAMPLES / name for name in ("field.plan", "buildings.kml", "radars.csv")]
    text = imported(files, Wishes("mine"))
    mission = mission_from_text(text, "mine.yaml")
    assert [entry.name for entry in mission.radars] == ["West", "East"]
    assert [radar.up_m for radar in mission.radars] == [6, 4]
    assert [(entry.name, entry.top_m) for entry in mission.obstacles[:3]] == [
        ("Hall", 130),
        ("Grain silo", 160),
        ("Buro 1", 140),
    ]
    assert (mission.start.up_m, len(mission.goals), mission.dimension) == (100, 2, 2)
    assert sum(line.startswith("# - ") for line in text.splitlines()) == 9


def test_a_kml_alone_with_a_home(tmp_path):
    point = "<Point><coordinates>149.18,-35.36</coordinates></Point>"
    place = "<coordinates>149.16523,-35.363261,584</coordinates>"
    home = f"<Point><altitudeMode>absolute</altitudeMode>{place}</Point>"
    file = written(tmp_path, "a.kml", kml(placemark("Home", home), placemark("Target", point)))
    text = imported([file], Wishes("mine", height_m=70.0))
    mission = mission_from_text(text, "mine.yaml")
    assert mission.origin.altitude_amsl_m == 584
    assert (mission.start.up_m, mission.goals[0].up_m) == (70, 70)
    assert "no height: taken at 70 m, as the start" in text


def test_a_take_off_without_a_place_gives_its_height(tmp_path):
    items = [waypoint(15, 0, 0, None, 0, 0, 60, command=22), waypoint(0, 0, 0, None, -35.35, 149.18, 60)]
    text = imported([written(tmp_path, "a.plan", plan(items=items))], Wishes("mine"))
    assert mission_from_text(text, "mine.yaml").start.up_m == 60


def test_homes_that_do_not_count_are_named(tmp_path):
    flat = feature("home", "Point", at(0.0, 0.0), name="flat")
    features = (flat, HOME, GOAL)
    _, text = mission_of(tmp_path, *features, home=(-35.363261, 149.17623, 600.0))
    assert "# - a.geojson: feature 1 'flat': not taken: it has no altitude" in text
    assert "# - a.geojson: feature 2: not taken: it is 1000 m from the home that counts, -16 m" in text


def test_the_height_of_a_take_off_gives_way_to_that_of_the_start(tmp_path):
    items = [waypoint(15, 0, 0, None, 0, 0, 60, command=22), waypoint(0, 0, 0, None, -35.35, 149.18, 60)]
    flown = written(tmp_path, "a.plan", plan(items=items))
    start = written(tmp_path, "b.geojson", collection(feature("start", "Point", at(9.0, 9.0), up_m=80)))
    text = imported([flown, start], Wishes("mine"))
    assert mission_from_text(text, "mine.yaml").start.up_m == 80
    assert "# - a.plan: item 1: not taken: the start has a height" in text

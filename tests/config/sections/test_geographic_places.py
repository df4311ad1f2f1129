"""Places in degrees and UTM: the same mission as in metres, and one clear error for what is wrong."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import load_mission, mission_from_text
from companion.errors import ConfigError
from companion.frames import LocalFrame

CONFIGS = Path(__file__).parents[3] / "mission_configs"
GOOD = (CONFIGS / "first-flight.yaml").read_text(encoding="utf-8")
GOAL = "{east_m: 1750, north_m: 750, up_m: 100, acceptance_radius_m: 60}"
WALL = "polygon_enu_m: [[1000, 1050], [1300, 1050], [1300, 1100], [1000, 1100]]"


def with_goal(text):
    return GOOD.replace(GOAL, text)


def mission(text):
    return mission_from_text(text, "m.yaml")


def fault(text):
    with pytest.raises(ConfigError) as caught:
        mission(text)
    return caught.value


def test_metres_of_a_degree_are_those_of_the_ellipsoid():
    """At 45 degrees a degree of latitude is 111,132 m, and one of longitude 78,847 m (WGS84)."""
    text = GOOD.replace(
        "latitude_deg: -35.363261, longitude_deg: 149.165230", "latitude_deg: 45, longitude_deg: 7"
    )
    text = text.replace(GOAL, "{latitude_deg: 45.006748, longitude_deg: 7.022195, up_m: 100}")
    (goal,) = mission(text).goals
    assert goal.north_m == pytest.approx(0.006748 * 111_132, abs=0.5)
    assert goal.east_m == pytest.approx(0.022195 * 78_847, abs=0.5)


def test_utm_is_that_of_the_zone():
    """The central meridian of zone 32 is at 9 degrees east, where the easting is 500 km; on the equator
    the northing is 0, and on the meridian 1,000 m of northing are 1,000 m / 0.9996 on the ground."""
    text = GOOD.replace(
        "latitude_deg: -35.363261, longitude_deg: 149.165230", "latitude_deg: 0, longitude_deg: 9"
    )
    text = text.replace(GOAL, "{utm: {zone: 32N, easting_m: 500000, northing_m: 1000}, up_m: 100}")
    (goal,) = mission(text.replace("bounds: {east_m: [0,", "bounds: {east_m: [-10,")).goals
    assert goal.east_m == pytest.approx(0.0, abs=1e-3)
    assert goal.north_m == pytest.approx(1000.0 / 0.9996, abs=0.01)


def test_a_file_may_mix_the_three_ways():
    plain = mission(GOOD)
    text = with_goal("{utm: {zone: 55H, easting_m: 698485.376, northing_m: 6085231.184}, up_m: 100}")
    start = plain.frame.global_from_local(150.0, 750.0, 0.0)
    text = text.replace(
        "start: {east_m: 150, north_m: 750", f"start: {{latitude_deg: {start[0]}, longitude_deg: {start[1]}"
    )
    mixed = mission(text)
    assert (mixed.start.east_m, mixed.start.north_m) == pytest.approx((150.0, 750.0), abs=1e-5)
    assert (mixed.goals[0].east_m, mixed.goals[0].north_m) == pytest.approx((1750.0, 750.0), abs=0.01)
    assert mixed.radars == plain.radars


def in_degrees(text, frame):
    """A mission file with every place and line in degrees, by its text."""

    def degrees(east, north):
        latitude, longitude, _ = frame.global_from_local(float(east), float(north), 0.0)
        return latitude, longitude

    def point(match):
        return "latitude_deg: {}, longitude_deg: {}".format(*degrees(*match.groups()))

    def line(match):
        corners = re.findall(r"\[(-?[\d.]+), (-?[\d.]+)\]", match[2])
        written = ", ".join("[{}, {}]".format(*degrees(*corner)) for corner in corners)
        return f"{match[1]}_lat_lon_deg: [{written}]"

    text = re.sub(r"east_m: (-?[\d.]+), north_m: (-?[\d.]+)", point, text)
    return re.sub(r"(polygon|route)_enu_m: (\[(?:\[[^]]*\],? ?)+\])", line, text)


@pytest.mark.parametrize(
    "name", ["first-flight", "slow-aircraft", "search-area", "convoy", "valley", "paper-3d"]
)
def test_a_shipped_mission_in_degrees_is_the_same_mission(name):
    plain = load_mission(CONFIGS / f"{name}.yaml")
    text = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8")
    written = in_degrees(text, plain.frame)
    assert written.count("_deg: ") > text.count("_deg: ")
    changed = mission_from_text(written, str(CONFIGS / f"{name}.yaml"))

    def flat(value):
        if isinstance(value, dict):
            return {key: flat(entry) for key, entry in value.items()}
        if isinstance(value, list | tuple):
            return [flat(entry) for entry in value]
        return round(value, 4) + 0.0 if isinstance(value, float) else value

    assert flat(changed.model_dump()) == flat(plain.model_dump())


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-80.0, 80.0), st.floats(-180.0, 180.0),
    st.floats(-40_000.0, 40_000.0), st.floats(-40_000.0, 40_000.0),
)  # fmt: skip
def test_degrees_and_metres_are_one_place_anywhere(latitude, longitude, east, north):
    frame = LocalFrame(latitude, longitude, 0.0)
    text = GOOD.replace("latitude_deg: -35.363261, longitude_deg: 149.165230",
                        f"latitude_deg: {latitude!r}, longitude_deg: {longitude!r}")  # fmt: skip
    text = text.replace(
        "east_m: [0, 2000], north_m: [0, 1500]", "east_m: [-40010, 40010], north_m: [-40010, 40010]"
    )
    lat, lon, _ = frame.global_from_local(east, north, 0.0)
    text = text.replace(
        "radars:\n",
        f"radars:\n  - {{name: r, latitude_deg: {lat!r}, longitude_deg: {lon!r}, max_threat_radius_m: 5}}\n",
    )
    radar = mission(text).radars[0]
    assert math.hypot(radar.east_m - east, radar.north_m - north) < 1e-3


FAULTS = {
    "both ways": (
        "{east_m: 1750, north_m: 750, latitude_deg: -35.3565, longitude_deg: 149.1845, up_m: 100}",
        "goals.0.latitude_deg", "-35.3565", "left out, since east_m is given: a place is written in one way",
    ),
    "two other ways": (
        "{utm: {zone: 55H, easting_m: 698485, northing_m: 6085231}, latitude_deg: -35, up_m: 100}",
        "goals.0.utm", None, "left out, since latitude_deg is given: a place is written in one way",
    ),
    "half": (
        "{latitude_deg: -35.3565, up_m: 100}",
        "goals.0.longitude_deg", "nothing", "a value in degrees, since latitude_deg is given",
    ),
    "half and metres": ("{east_m: 5, latitude_deg: -35.3565, up_m: 100}", "goals.0.latitude_deg", None, None),
    "latitude": (
        "{latitude_deg: 95, longitude_deg: 149.1845, up_m: 100}",
        "goals.0.latitude_deg", "95", "a number from -90 to 90 (degrees of latitude)",
    ),
    "longitude": (
        "{latitude_deg: 45, longitude_deg: -180.5, up_m: 100}",
        "goals.0.longitude_deg", "-180.5", "a number from -180 to 180 (degrees of longitude)",
    ),
    "text": ('{latitude_deg: "45", longitude_deg: 7, up_m: 100}', "goals.0.latitude_deg", '"45"', None),
    "truth": ("{latitude_deg: true, longitude_deg: 7, up_m: 100}", "goals.0.latitude_deg", "true", None),
    "not a number": ("{latitude_deg: .nan, longitude_deg: 7, up_m: 9}", "goals.0.latitude_deg", ".nan", None),
    "sign": (
        "{latitude_deg: 35.3565, longitude_deg: 149.1845, up_m: 100}",
        "goals.0.latitude_deg", "35.3565, 149.1845, which is 7829 km from it",
        "a place within 200 km of the origin, -35.363261, 149.16523",
    ),
    "out of bounds": (
        "{latitude_deg: -35.3565, longitude_deg: 149.20, up_m: 100}",
        "goals.0.east_m", "3160.3, from latitude_deg -35.3565, longitude_deg 149.2",
        "within bounds.east_m, 0 to 2000",
    ),
    "the wrong band": (
        "{utm: {zone: 55S, easting_m: 698485, northing_m: 6085231}, up_m: 100}",
        "goals.0.utm.zone", "55S", "the letter of the band that the place lies in; its latitude is 54.875",
    ),
    "no zone": (
        "{utm: {zone: 61H, easting_m: 698485, northing_m: 6085231}, up_m: 100}",
        "goals.0.utm.zone", "61H", "a zone from 1 to 60 and the letter of its band, C to X, such as 55H",
    ),
    "easting": (
        "{utm: {zone: 55H, easting_m: 6085231, northing_m: 698485}, up_m: 100}",
        "goals.0.utm.easting_m", "6085231", "a number from 100000 to 900000 (metres)",
    ),
    "half of UTM": (
        "{utm: {zone: 55H, easting_m: 698485}, up_m: 100}",
        "goals.0.utm", None, "the keys zone, easting_m and northing_m, such as zone: 55H",
    ),
    "UTM as text": ("{utm: 55H 698485 6085231, up_m: 100}", "goals.0.utm", "55H 698485 6085231", None),
    "misspelt twice": (
        "{lattitude_deg: -35.3, longitud_deg: 149.2, up_m: 100}",
        "goals.0.lattitude_deg", "a key that is not known", "latitude_deg (degrees)",
    ),
    "misspelt": (
        "{lattitude_deg: -35.3, longitude_deg: 149.2, up_m: 100}",
        "goals.0.latitude_deg", "nothing", "a value in degrees, since longitude_deg is given",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_what_is_wrong_with_a_place_is_said(case):
    text, key, value, expected = FAULTS[case]
    error = fault(with_goal(text))
    assert error.file == "m.yaml"
    assert error.line == 1 + GOOD[: GOOD.index(GOAL)].count("\n")
    if key is not None:
        assert error.key == key
    if value is not None:
        assert error.value == value
    if expected is not None:
        assert error.expected == expected


CORNERS = {
    "a single number": ("polygon_lat_lon_deg: [1, 2, 3]", "obstacles.0.polygon_lat_lon_deg.0"),
    "no list": ("polygon_lat_lon_deg: here", "obstacles.0.polygon_lat_lon_deg"),
    "latitude": ("polygon_lat_lon_deg: [[95, 149], [-35, 149]]", "obstacles.0.polygon_lat_lon_deg.0.0"),
    "turned round": (
        "polygon_lat_lon_deg: [[149.17, -35.35], [149.18, -35.35]]", "obstacles.0.polygon_lat_lon_deg.0.0",
    ),
    "both": (f"polygon_lat_lon_deg: [[-35, 149]], {WALL}", "obstacles.0.polygon_lat_lon_deg"),
    "too few": ("polygon_lat_lon_deg: [[-35.36, 149.17], [-35.36, 149.18]]", "obstacles.0.polygon_enu_m"),
}  # fmt: skip


@pytest.mark.parametrize("case", CORNERS)
def test_what_is_wrong_with_a_corner_is_said(case):
    text, key = CORNERS[case]
    error = fault(GOOD.replace(WALL, text))
    assert (error.key, error.line) == (key, 1 + GOOD[: GOOD.index(WALL)].count("\n"))


def test_the_origin_is_checked_before_places_are_measured_from_it():
    degrees = "{latitude_deg: -35.3565, longitude_deg: 149.1845, up_m: 100}"
    origin = "origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}"
    assert fault(with_goal(degrees).replace(origin, "")).key == "origin"
    error = fault(with_goal(degrees).replace("latitude_deg: -35.363261", "latitude_deg: -95"))
    assert (error.key, error.expected) == ("origin.latitude_deg", "a number of at least -90 (degrees)")


def test_places_belong_where_metres_do():
    error = fault(GOOD.replace("vehicle:\n", "vehicle:\n  latitude_deg: 5\n"))
    assert (error.key, error.value) == ("vehicle.latitude_deg", "a key that is not known")


def test_bounds_in_degrees_are_the_largest_box_within():
    frame = mission(GOOD).frame
    south, west, _ = frame.global_from_local(-100.0, -100.0, 0.0)
    north, east, _ = frame.global_from_local(3_000.0, 2_000.0, 0.0)
    written = f"bounds: {{latitude_deg: [{south}, {north}], longitude_deg: [{west}, {east}]"
    bounds = mission(GOOD.replace("bounds: {east_m: [0, 2000], north_m: [0, 1500]", written)).bounds
    assert bounds.east_m == pytest.approx((-100.0, 3_000.0), abs=2.0)
    assert bounds.north_m == pytest.approx((-100.0, 2_000.0), abs=2.0)
    for corner_east in bounds.east_m:
        for corner_north in bounds.north_m:
            latitude, longitude, _ = frame.global_from_local(corner_east, corner_north, 0.0)
            assert south - 1e-9 <= latitude <= north + 1e-9
            assert west - 1e-9 <= longitude <= east + 1e-9
    error = fault(
        GOOD.replace("bounds: {east_m: [0, 2000]", "bounds: {latitude_deg: [1, 2], east_m: [0, 2000]")
    )
    assert error.key == "bounds.latitude_deg"

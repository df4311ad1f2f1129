"""Scenarios in DAIDALUS' format: read with their units, and placed about a flight of our own."""

import math

import numpy as np
import pytest

from companion.errors import ConfigError
from companion.research.encounters.daa_scenario import Scenario, scenario_from_text
from companion.research.encounters.encounter_model import EncounterModel
from companion.research.encounters.passing import passing_from_text
from tests.research.encounters.made_model import text

HEAD = "# made\nNAME lat lon alt trk gs vs time\n[none] [deg] [deg] [ft] [deg] [knot] [fpm] [s]\n"
DEGREE_M = 110_574.0  # of latitude at the equator


def rows(*, own_m_s=50.0, other_m_s=100.0, aside_m=200.0, above_m=30.0, seconds=61):
    """The own aircraft flies north; the other comes south, to its right, higher; they meet after 30 s."""
    lines = []
    for second in range(seconds):
        own, other = (speed * (second - 30.0) / DEGREE_M for speed in (own_m_s, -other_m_s))
        east, up = aside_m / 111_319.5, 1000.0 + above_m / 0.3048
        lines += [
            f"Own, {own:.9f}, 0.0, 1000.0, 0.0, {own_m_s / 0.514444:.3f}, 0.0, {second}",
            f"Other, {other:.9f}, {east:.9f}, {up:.4f}, 180.0, 1, 0, {second}",
        ]
    return "\n".join(lines)


def straight(course=(1.0, 0.0), speed=25.0, seconds=101):
    times = np.arange(float(seconds))
    return np.column_stack([times, speed * course[0] * times, speed * course[1] * times, 0.0 * times + 250.0])


def test_a_scenario_is_read_relative_to_the_own_aircraft():
    scenario = scenario_from_text(HEAD + rows(), "made.daa")
    (away,) = scenario.away.values()
    assert list(scenario.away) == ["Other"]
    assert (away[0, 0], away[-1, 0]) == (-30.0, 30.0)
    assert away[0, 1:] == pytest.approx([150.0 * 30.0, -200.0, 30.0], abs=1.0)  # ahead, to the right, above
    assert away[30, 1:] == pytest.approx([0.0, -200.0, 30.0], abs=1.0)


def test_it_is_turned_to_the_flights_course_and_moves_on_beyond_its_ends():
    scenario = scenario_from_text(HEAD + rows(), "made.daa")
    half = math.sqrt(0.5)
    track = scenario.tracks(straight((half, half)), 60.0)["Other"]
    assert track[:, 0].tolist() == list(range(101))
    right = 200.0 * np.array([half, -half])
    assert track[60, 1:4] == pytest.approx([*(60.0 * 25.0 * half + right), 280.0], abs=1.5)
    # It closes at 150 m/s; over the ground it flies at 125 m/s all the time.
    for second in (0, 60, 100):
        assert track[second, 4:6] == pytest.approx([-125.0 * half, -125.0 * half], abs=0.5)


def test_an_aircraft_of_a_scenario_stays_above_the_ground():
    scenario = scenario_from_text(HEAD + rows(above_m=-300.0), "made.daa")
    assert scenario.tracks(straight(), 60.0)["Other"][:, 3].tolist() == [30.0] * 101


@pytest.mark.parametrize(
    ("content", "key", "value"),
    [
        ("", "file", "0 lines"),
        (HEAD, "file", "2 lines"),
        (HEAD.replace("alt", "height") + rows(), "columns", "name, lat, lon, height, trk, gs, vs, time"),
        (HEAD.replace("[ft]", "[furlong]") + rows(), "alt", "[furlong]"),
        (HEAD.replace(" [s]", "") + rows(), "units", "7"),
        (HEAD + rows().replace("Other, ", "Other, x", 1), "lat", None),
        (HEAD + rows() + "\nOwn, 1.0", "lon", "nothing"),
        (HEAD + "\n".join(line for line in rows().splitlines() if "Own" in line), "aircraft", "Own"),
        (HEAD + rows() + "\n" + rows(), "time", "not rising"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(content, key, value):
    with pytest.raises(ConfigError) as caught:
        scenario_from_text(content, "made.daa")
    assert caught.value.file == "made.daa"
    assert caught.value.key == key
    assert value is None or caught.value.value == value


def test_the_files_name_says_what_it_is():
    assert isinstance(passing_from_text(HEAD + rows(), "made.daa"), Scenario)
    assert isinstance(passing_from_text(text(), "made.txt"), EncounterModel)

"""Mission files: what is read, and the one error shown for a file that is wrong."""

import contextlib
import os
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from companion.config import load_mission, mission_from_text, source
from companion.config.load import text_of
from companion.errors import ConfigError

CONFIGS = Path(__file__).parents[2] / "mission_configs"
GOOD = (CONFIGS / "first-flight.yaml").read_text(encoding="utf-8")


def fault(text: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        mission_from_text(text, "m.yaml")
    return caught.value


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, 1)


def line_of(text: str, part: str) -> int:
    return next(number for number, line in enumerate(text.splitlines(), start=1) if part in line)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_mission_loads(path):
    assert load_mission(path).name == path.stem


def test_defaults_of_keys_left_out():
    config = mission_from_text(GOOD, "m.yaml")
    assert config.planning.method == "safe-rrt"
    assert config.planning.certainty == "shifted"
    assert config.planning.max_iterations == 60_000
    assert config.vehicle.climb_angle_max_deg == 10.0
    assert config.vehicle.initial_position_std_m == 2.0
    assert config.dynamic_threats[0].behaviour == "pursue"
    assert config.dynamic_threats[0].turn_radius_m == 15.0
    assert config.link.track_sources is None
    assert config.authority.resume == "auto"
    assert not config.authority.allow_rtl


def test_the_papers_noise_is_three_times_the_usual_but_for_what_is_written():
    usual = mission_from_text(GOOD, "m.yaml").vehicle
    text = changed("vehicle:\n", "vehicle:\n  noise: paper\n  altitude_std_m: 4.5\n")
    paper = mission_from_text(text, "m.yaml").vehicle
    noise = [key for key in type(usual).model_fields if "_std_" in key]
    assert len(noise) == 8
    assert paper.altitude_std_m == 4.5
    for key in noise:
        if key != "altitude_std_m":
            assert getattr(paper, key) == pytest.approx(3.0 * getattr(usual, key)), key
    again = mission_from_text(text_of(mission_from_text(text, "m.yaml")), "m.yaml")
    assert again.vehicle == paper
    error = fault(changed("vehicle:\n", "vehicle:\n  noise: large\n"))
    assert (error.key, error.value, error.expected) == ("vehicle.noise", "large", "'usual' or 'paper'")


def test_optional_sections_are_read():
    text = GOOD + "link: {track_sources: [200, 42], stream_rate_hz: 5}\nauthority: {resume: never}\n"
    config = mission_from_text(text, "m.yaml")
    assert config.link.track_sources == (200, 42)
    assert config.link.stream_rate_hz == 5
    assert config.authority.resume == "never"


def test_core_types():
    config = load_mission(CONFIGS / "paper-3d.yaml")
    assert config.frame.local_from_global(-35.363261, 149.165230, 584.0) == pytest.approx((0, 0, 0), abs=1e-6)
    tower = next(entry for entry in config.obstacle_list if entry.name == "tower_1")
    np.testing.assert_array_equal(
        tower.polygon_enu_m, [[4300, 1300], [4600, 1300], [4600, 1600], [4300, 1600]]
    )
    assert (tower.base_m, tower.top_m) == (0.0, 800.0)
    assert config.radar_list[0].position_enu_m == (3200.0, 1650.0, 0.0)
    assert config.radar_list[0].boundary_coefficient_per_m == 0.0006
    threat = config.dynamic_threat_list[0]
    assert (threat.name, threat.speed_m_s, threat.max_threat_radius_m) == ("pursuer_1", 25.0, 500.0)


def test_settings_never_change():
    config = mission_from_text(GOOD, "m.yaml")
    with pytest.raises(ValidationError, match="frozen"):
        config.vehicle.turn_radius_min_m = 1.0


def test_message_names_file_line_key_value_and_expectation():
    text = changed("airspeed_cruise_m_s: 25", 'airspeed_cruise_m_s: "25 m/s"')
    line = line_of(text, "25 m/s")
    assert str(fault(text)) == (
        f'm.yaml:{line}: vehicle.airspeed_cruise_m_s: got "25 m/s"; '
        "expected a number (metres per second), written without quotes and without a unit"
    )


@pytest.mark.parametrize(
    ("old", "new", "key", "expected"),
    [
        ("course_deg: 90", "start_course_deg: 90", "start.start_course_deg", "course_deg (degrees)"),
        ("speed_m_s: 0,", "speed_kmh: 0,", "dynamic_threats.0.speed_kmh", "speed_m_s (metres per second)"),
        ("{east_m: 1750", "{east_km: 1.75", "goals.0.east_km", "east_m (metres)"),
        ("max_threat_radius_m: 500", "radius_ft: 9", "radars.0.radius_ft", "max_threat_radius_m (metres)"),
        ("start: {", "start_course_deg: 9\nstart: {", "start_course_deg", "course_deg (degrees), in start"),
        ("goals:", "goal:", "goal", "goals"),
        ("start: {", "start: {path: 1, ", "start.path", "one of east_m, north_m"),
        ("dimension: 2", "zzz: 2", "zzz", "one of name, description, dimension"),
    ],
)
def test_unknown_key_suggests_the_nearest_with_its_unit(old, new, key, expected):
    error = fault(changed(old, new))
    assert (error.key, error.value) == (key, "a key that is not known")
    assert error.expected.startswith(expected)
    assert error.line == line_of(changed(old, new), new.splitlines()[0])


@pytest.mark.parametrize(
    ("old", "new", "key", "expected"),
    [
        ("unit_m: 25", "unit_m: .nan", "unit_m", "a finite number"),
        ("unit_m: 25", "unit_m: .inf", "unit_m", "a finite number"),
        ("unit_m: 25", "unit_m: 025", "unit_m", "a plain decimal number"),
        ("unit_m: 25", "unit_m: 1:30", "unit_m", "a plain decimal number"),
        ("unit_m: 25", "unit_m: true", "unit_m", "a number (metres)"),
        ("unit_m: 25", "unit_m: 0", "unit_m", "a number greater than 0 (metres)"),
        ("unit_m: 25", "unit_m:", "unit_m", "a number (metres)"),
        ("dimension: 2", "dimension: 4", "dimension", "2 or 3"),
        ("name: first-flight", "name: first flight", "name", "a name of letters"),
        ("name: first-flight", "name: 12", "name", "text"),
        ("turbulence: light", "turbulence: heavy", "simulation.turbulence", "'none', 'light' or"),
        ("course_deg: 90", "course_deg: 400", "start.course_deg", "a number of at most 360 (degrees)"),
        ("latitude_deg: -35.363261", "latitude_deg: 95", "origin.latitude_deg", "a number of at most 90"),
        ("east_m: [0, 2000]", "east_m: 2000", "bounds.east_m", "a list"),
        ("east_m: [0, 2000]", "east_m: [0]", "bounds.east_m.1", "a number (metres) in this place"),
        ("east_m: [0, 2000]", "east_m: [0, 1, 2]", "bounds.east_m", "at most 2 entries"),
        ("[1000, 1100]]", "[1000, 1100, 5]]", "obstacles.0.polygon_enu_m.3", "at most 2 entries"),
        ("radars:\n", "radars:\n  - 3\n", "radars.0", "keys and values"),
        ("time_horizon_s: 15", "time_horizon_s: 15\n  seed: 1.5", "planning.seed", "a whole number"),
        ("name: wall,", f"name: {'w' * 70},", "obstacles.0.name", "text of at most 64 characters"),
    ],
)
def test_wrong_values(old, new, key, expected):
    error = fault(changed(old, new))
    assert error.key == key
    assert error.expected.startswith(expected)
    assert error.line is not None


@pytest.mark.parametrize(
    ("old", "new", "key", "expected"),
    [
        ("east_m: [0, 2000]", "east_m: [2000, 0]", "bounds.east_m", "the lowest value, then a higher"),
        (
            "north_m: 750, up_m: 100, course",
            "north_m: 9999, up_m: 100, course",
            "start.north_m",
            "within bounds",
        ),
        ("{east_m: 1750", "{east_m: -1", "goals.0.east_m", "within bounds.east_m, 0 to 2000"),
        ("planning:\n", "planning:\n  method: a-star\n", "planning.method", "one of edbm, nfz-ddrrt"),
        ("up_m: 100, acc", "up_m: 101, acc", "goals.0.up_m", "the start's up_m, 100"),
        (
            "{east_m: 1750, north_m: 750",
            "{east_m: 1100, north_m: 1060",
            "goals.0",
            "a point outside the obst",
        ),
        (
            "{east_m: 150, north_m: 750",
            "{east_m: 1100, north_m: 1060",
            "start",
            "a point outside the obstacle",
        ),
        (
            "airspeed_min_m_s: 12.5",
            "airspeed_min_m_s: 50",
            "vehicle.airspeed_min_m_s",
            "at most airspeed_max",
        ),
        ("cruise_m_s: 25", "cruise_m_s: 40", "vehicle.airspeed_cruise_m_s", "between airspeed_min_m_s and"),
        ("tion_speed_m_s: 30", "tion_speed_m_s: 9", "vehicle.penetration_speed_m_s", "between airspeed_min"),
        ("turn_radius_min_m: 125", "turn_radius_min_m: 20", "vehicle.turn_radius_min_m", "at least 36.8"),
        ("horizon_m: 825", "horizon_m: 250", "planning.sensing_horizon_m", "more than twice vehicle.turn_"),
        ("time_s: 80", "time_s: 8", "planning.total_planning_time_s", "at least time_horizon_s, 15"),
        ("time_horizon_s: 15", "time_horizon_s: 2", "planning.time_horizon_s", "planning_budget_s and swap"),
        ("{name: wall,", "{name: radar_1,", None, None),
        ("base_m: 0", "base_m: 300", "obstacles.0.base_m", "below top_m, 300"),
        (
            "[1300, 1050], [1300, 1100]",
            "[1300, 1100], [1300, 1050]",
            "obstacles.0.polygon_enu_m",
            "edges that",
        ),
        ("[1300, 1100], [1000, 1100]]", "[1600, 1050]]", "obstacles.0.polygon_enu_m", "corners that enclose"),
        ("[1000, 1100]]", "[1000, 1050]]", "obstacles.0.polygon_enu_m", "each corner once"),
        ("[1300, 1100], [1000, 1100]]", "]", "obstacles.0.polygon_enu_m", "at least 3 entries"),
        (
            "wind_speed_m_s: 3",
            "wind_speed_m_s: 30",
            "simulation.wind_speed_m_s",
            "less than vehicle.airspeed",
        ),
    ],
)
def test_contradictions(old, new, key, expected):
    text = changed(old, new)
    if key is None:  # names need to be unique among their kind only
        assert mission_from_text(text, "m.yaml").obstacles[0].name == "radar_1"
        return
    error = fault(text)
    assert error.key == key
    assert error.expected.startswith(expected)


THROUGH = "[[950, 900], [1150, 1200]]"


@pytest.mark.parametrize(
    ("behaviour", "expected"),
    [
        ("behaviour: drive", "at least one place, since behaviour is drive"),
        ("route_enu_m: [[950, 900]]", "left out, since behaviour is pursue"),
        (
            "behaviour: drive, route_enu_m: [[950, 900], [1150, 1200]]",
            "straight legs clear of the obstacle 'wall'",
        ),
    ],
)
def test_routes(behaviour, expected):
    """The last one drives north, and then through the wall."""
    error = fault(changed("speed_m_s: 0,", f"speed_m_s: 9, {behaviour},"))
    assert (error.key, error.expected) == ("dynamic_threats.0.route_enu_m", expected)


def test_duplicate_names_name_the_first():
    text = GOOD.replace(
        "obstacles:\n",
        "obstacles:\n  - {name: wall, polygon_enu_m: [[0, 0], [9, 0], [9, 9]], base_m: 0, top_m: 9}\n",
    )
    error = fault(text)
    assert (error.key, error.expected) == ("obstacles.1.name", "a name of its own; obstacles.0 has this one")


def test_missing_key_is_placed_at_its_section():
    text = changed("  airspeed_cruise_m_s: 25\n", "")
    error = fault(text)
    assert (error.key, error.value) == ("vehicle.airspeed_cruise_m_s", "nothing")
    assert error.line == line_of(text, "vehicle:")


def test_unknown_key_is_shown_before_the_missing_one_it_stands_for():
    error = fault(changed("airspeed_cruise_m_s: 25", "airspeed_cruse_m_s: 25"))
    assert error.key == "vehicle.airspeed_cruse_m_s"


@pytest.mark.parametrize(
    ("text", "line", "value"),
    [
        ("", None, "nothing"),
        ("# only a comment\n", None, "nothing"),
        ("- a\n", 1, "a list"),
        ("a\n", 1, "a bare value"),
        ("name: a\nname: b\n", 2, "a second entry (the first is in line 1)"),
        ("name: [a\n", 2, "did not find expected ',' or ']'"),
        ("name: a\n\tb: c\n", 2, "found a tab character that violates indentation"),
        ("name: &a b\ndescription: *a\n", 2, "the alias *a"),
        ("1: a\n", 1, "the key '1'"),
        ("name: a\n---\nname: b\n", 2, "another document"),
        ("name: " + "[" * 30 + "]" * 30, 1, "deep nesting"),
        ("name: " + "[" * 5000, 1, "deep nesting"),
        ("name: a\x01b\n", None, "unacceptable character #x0001: control characters are not allowed"),
    ],
)
def test_broken_yaml(text, line, value):
    error = fault(text)
    assert (error.line, error.value) == (line, value)


STRANGE = {
    "a date that is none": "2026-13-45",
    "a date": "2026-11-22",
    "a time": "2026-11-22T10:00:00Z",
    "5,000 digits": "9" * 5_000,
    "5,000 digits behind the point": "0." + "1" * 5_000,
    "a large exponent": "1e99999999999",
    "a timestamp by its tag": "!!timestamp foo",
    "a number by its tag": "!!int foo",
    "a float by its tag": "!!float 1_2",
    "bytes": "!!binary aGFsbG8=",
    "no bytes": "!!binary ===",
    "a set": "!!set {a, b}",
    "an ordered mapping": "!!omap [a: 1]",
    "pairs": "!!pairs [a: 1]",
    "code": "!!python/object/apply:os.system [ls]",
    "a private tag": "!mine 5",
    "no tag in particular": "! 5",
    "text by its tag": "!!str 25",
    "a truth by its tag": "!!bool maybe",
    "nothing by its tag": "!!null ''",
    "a merge": "<<",
    "an equals sign": "=",
    "a mapping with a list for a key": "{[1]: 2}",
    "a mapping merged": "{<<: {a: 1}}",
    "half a pair": '"\\ud800"',
}


@pytest.mark.parametrize("value", STRANGE.values(), ids=STRANGE)
@pytest.mark.parametrize("key", ["unit_m", "name", "vehicle"])
def test_whatever_stands_at_a_key_is_refused_with_its_place(key, value):
    text = f"{key}: {value}\n" + re.sub(rf"^{key}:.*\n(  .*\n)*", "", GOOD, flags=re.MULTILINE)
    error = fault(text)
    assert (error.line, error.exit_code) == (1, 2)
    assert error.key.partition(".")[0] in (key, "syntax")
    assert len(str(error)) < 400


def test_text_that_no_file_can_hold():
    assert fault("name: \ud800").key == "syntax"


def test_a_file_is_not_read_before_its_size_is_known(tmp_path):
    large = tmp_path / "large.yaml"
    with large.open("wb") as file:
        file.truncate(2**40)  # a terabyte of nothing
    with pytest.raises(ConfigError, match="more than 4000000 bytes"):
        load_mission(large)
    os.mkfifo(tmp_path / "pipe.yaml")
    for path in (tmp_path / "pipe.yaml", Path("/dev/zero")):
        with pytest.raises(ConfigError, match="not a plain file"):
            load_mission(path)
    (tmp_path / "link.yaml").symlink_to(CONFIGS / "first-flight.yaml")
    assert load_mission(tmp_path / "link.yaml").name == "first-flight"


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML was built without it")
@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_both_parsers_say_the_same(path, monkeypatch):
    text = path.read_text(encoding="utf-8")
    by_c = source.parse(text, "m.yaml")
    monkeypatch.setattr(source, "_Loader", yaml.SafeLoader)
    assert source.parse(text, "m.yaml") == by_c


def test_numbers_with_an_exponent_are_numbers():
    assert mission_from_text(changed("unit_m: 25", "unit_m: 2.5e1"), "m.yaml").unit_m == 25.0
    assert mission_from_text(changed("unit_m: 25", "unit_m: 2e1"), "m.yaml").unit_m == 20.0


def test_a_huge_file_is_refused():
    assert fault("#" * 5_000_000).expected == "at most 1000000"


def test_file_errors(tmp_path):
    for path, value in (
        (tmp_path / "none.yaml", "no such file or directory"),
        (tmp_path, "is a directory"),
        ("bad\0name", "embedded null"),  # Pythons put it differently
    ):
        with pytest.raises(ConfigError, match="a mission file that can be read") as caught:
            load_mission(path)
        assert value in caught.value.value
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"name: \xff\xfe\n")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_mission(binary)


@given(st.text(max_size=200))
def test_any_text_gives_a_config_error(text):
    fault(text)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_any_damage_gives_a_mission_or_a_config_error(data):
    start = data.draw(st.integers(0, len(GOOD)))
    length = data.draw(st.integers(0, 30))
    insert = data.draw(st.text(max_size=10))
    with contextlib.suppress(ConfigError):
        mission_from_text(GOOD[:start] + insert + GOOD[start + length :], "m.yaml")


def test_the_comments_of_the_example_show_the_defaults():
    shown = "\n".join(
        re.sub(r"^( *)# ", r"\1", line) if re.match(r" *# +[a-z0-9_]+: |# (link|authority):", line) else line
        for line in GOOD.splitlines()
    )
    examples = "behaviour|track_sources|systems|signing|key_file|timestamp_file|link_id|allow_[um].*"
    shown = re.sub(rf"^ *({examples}): .*\n", "", shown, flags=re.MULTILINE)
    config = mission_from_text(shown, "m.yaml")
    assert config.authority.model_fields_set == {"resume", "allow_rtl"}
    assert config.link.model_fields_set == {"stream_rate_hz", "source_rate_max_hz"}
    assert len(config.vehicle.model_fields_set) == len(type(config.vehicle).model_fields)
    assert len(config.planning.model_fields_set) == len(type(config.planning).model_fields)
    assert config == mission_from_text(GOOD, "m.yaml")


def test_goals_may_be_left_to_the_autopilot():
    text = re.sub(r"goals:\n(  - .*\n)+", "goals: from_autopilot\n", GOOD)
    config = mission_from_text(text, "m.yaml")
    assert config.goals_from_autopilot
    assert config.goals == ()
    assert not mission_from_text(GOOD, "m.yaml").goals_from_autopilot


@pytest.mark.parametrize("goals", ["[]", "from_nowhere", "{}"])
def test_what_are_no_goals(goals):
    text = re.sub(r"goals:\n(  - .*\n)+", f"goals: {goals}\n", GOOD)
    with pytest.raises(ConfigError) as caught:
        mission_from_text(text, "m.yaml")
    assert caught.value.key == "goals"

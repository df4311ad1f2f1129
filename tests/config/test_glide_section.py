"""The section ``glide``: what is refused, and what is expected instead."""

import pytest

from companion.config import mission_from_text
from companion.config.compose import glide_model_of
from companion.errors import ConfigError
from tests.mission.glide.worlds_for_glides import FIELDS, WALL, glide_mission_of, glide_text
from tests.sim.client import PLAIN

FIELD = "{{name: {0}, east_m: {1}, north_m: 0, up_m: 0, radius_m: 80}}"
PEOPLE = "people: [{name: village, polygon_enu_m: [[900, -100], [1100, -100], [1100, 100], [900, 100]]}]"


def fault(text):
    with pytest.raises(ConfigError) as caught:
        mission_from_text(text, "m.yaml")
    return caught.value


@pytest.mark.parametrize(
    ("text", "key", "expected"),
    [
        (glide_text(keys="ratio: 0.5, airspeed_m_s: 20"), "glide.ratio", "at least 1"),
        (glide_text(keys="ratio: .nan, airspeed_m_s: 20"), "glide.ratio", "finite"),
        (glide_text(keys="ratio: 10"), "glide.airspeed_m_s", "a value for this key (metres per second)"),
        (glide_text(keys="ratio: 10, airspeed_m_s: 40"), "glide.airspeed_m_s", "airspeed_cruise_m_s"),
        (glide_text(keys="ratio: 10, airspeed_m_s: 5"), "glide.airspeed_m_s", "airspeed_min_m_s"),
        (glide_text(keys="ratio: 10, airspeed: 20"), "glide.airspeed", "airspeed_m_s"),
        (
            glide_text(f"fields: [{FIELD.format('a', 0)}, {FIELD.format('a', 900)}]"),
            "glide.fields.1.name",
            "a name of its own; glide.fields.0 has this one",
        ),
        (glide_text(FIELDS.replace("80", "0")), "glide.fields.0.radius_m", "greater than 0 (metres)"),
        (glide_text(f"{FIELDS}\n  {PEOPLE}"), "glide.fields.0", "a circle wholly outside of people"),
        (
            glide_text(f"{FIELDS}\n  {PEOPLE.replace('[1100, 100], ', '')}".replace("[1100, -100], ", "")),
            "glide.people.0.polygon_enu_m",
            "3",
        ),
        (
            glide_text(f"fields: [{FIELD.format('a', 420)}]", WALL),
            "glide.fields.0",
            "a point outside the obstacle 'wall'",
        ),
        (f"{PLAIN}authority: {{glide: true}}\n", "authority.glide", "a section glide as well"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_what_is_expected(text, key, expected):
    error = fault(text)
    assert str(error.key) == key
    assert expected in error.expected


def test_turns_of_the_glide_have_the_bank_of_the_tightest_turn():
    mission = glide_mission_of()
    share = 20.0 / mission.vehicle.airspeed_cruise_m_s
    model = glide_model_of(mission)
    assert model.turn_radius_m == pytest.approx(mission.vehicle.turn_radius_min_m * share**2)
    assert model.sink_m_s == pytest.approx(2.0)


def test_without_the_section_there_is_no_glide():
    assert glide_model_of(mission_from_text(PLAIN, "m.yaml")) is None

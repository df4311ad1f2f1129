"""The stretches without a field, second by second, worked out by hand."""

import math

import numpy as np
import pytest

from companion.config.mission_summary import mission_coverage, mission_summary
from companion.mission.glide.glide_coverage import Coverage, clock, coverage_of_legs, coverage_of_path
from companion.types.path import straight_path
from tests.mission.glide.worlds_for_glides import glide_mission_of, options_of


def test_words_name_each_stretch():
    fields = ("a",) * 80 + (None,) * 25 + ("b", None)
    found = Coverage(fields)
    assert found.without_s == 26
    assert found.stretches == ((80, 105), (106, 107))
    assert found.words == "no field within glide from 1:20 to 1:45, from 1:46 to 1:47"
    assert Coverage(("a",)).words == "a field is within glide all the way"
    assert clock(3_601) == "60:01"


def test_along_a_straight_line_away_from_the_field_it_is_lost_at_the_second_worked_out():
    """From 1000 m east on, eastwards at 25 m/s and 150 m up: the way back is a turn by π and the way flown.

    Radius 60·(20/25)² = 38.4 m. It is missed from the first second of which one of the next 2 to 7 misses it.
    """
    options = options_of(keys="ratio: 10, airspeed_m_s: 20")
    model = options.model
    times = np.arange(0.0, 61.0)
    path = straight_path(
        times, 100.0, np.array([1_000.0, 0.0, 150.0]), 0.5 * math.pi, 25.0, covariance_m2=np.eye(3),
        threat_level=0.0, wind_enu_m_s=(0.0, 0.0),
    )  # fmt: skip
    found = coverage_of_path(options, path, (0.0, 0.0))
    ((begin, end),) = [stretch for stretch in found.stretches if stretch[1] > 50]
    assert end == 61

    def spare(second):
        away, radius = 25.0 * second, model.turn_radius_m
        # A turn to the one side until the field is ahead, by the right triangle of centre, field and tangent.
        straight = math.sqrt(away**2)
        turn = 2.0 * math.pi - 2.0 * math.atan2(straight, radius) if straight else 2.0 * math.pi
        return 150.0 - turn * radius / 20.0 * model.turn_sink_m_s - straight / 10.0

    first = next(second for second in range(10, 61) if spare(second) < 20.0)
    assert begin == first - 7


def test_legs_are_as_long_as_the_flight_along_them():
    options = options_of()
    found = coverage_of_legs(
        options, [(0.0, 0.0, 150.0), (500.0, 0.0, 150.0), (500.0, 500.0, 150.0)], 25.0, (0.0, 0.0)
    )
    assert len(found.fields) == 41
    assert set(found.fields) == {"meadow"}


def test_check_names_the_stretches():
    mission = glide_mission_of()
    told = mission_summary(mission)["glide"]
    assert told["without_s"] == sum(name is None for name in told["fields"])
    assert told["stretches_s"] == [list(stretch) for stretch in mission_coverage(mission).stretches]
    assert told["fields"][0] == "home"  # The aircraft begins over it.


def test_without_the_section_nothing_is_named():
    mission = glide_mission_of().model_copy(update={"glide": None})
    assert mission_coverage(mission) is None
    assert "glide" not in mission_summary(mission)


@pytest.mark.parametrize("height", [60.0, 120.0, 240.0])
def test_from_higher_no_second_is_lost(height):
    options = options_of()
    low, high = (
        coverage_of_legs(options, [(-800.0, 300.0, up), (2_500.0, 300.0, up)], 25.0, (3.0, -2.0)).fields
        for up in (height, height + 60.0)
    )
    assert all(there is not None for here, there in zip(low, high, strict=True) if here is not None)

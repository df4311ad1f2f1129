"""The wrong side of an aircraft that passes, by geometry worked by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.world.right_of_way import wrong_side
from tests.support.worlds import track

HERE, NORTH = np.array([0.0, 0.0]), np.array([0.0, 25.0])


def aircraft(place, velocity, **changes):
    seen = track(*place, velocity=velocity, airborne=True, up=100.0, radius=610.0)
    return replace(seen, flies_on=True, **changes)


def meets(course_deg, speed, aside_m=0.0, after_s=60.0):
    """An aircraft that would meet the own one, which flies north, or pass so far to its east."""
    velocity = speed * np.array([math.sin(math.radians(course_deg)), math.cos(math.radians(course_deg))])
    return aircraft(NORTH * after_s - velocity * after_s + [aside_m, 0.0], tuple(velocity))


@pytest.mark.parametrize(
    ("course_deg", "speed", "expected"),
    [
        # It flies south, towards the own aircraft: to be passed to its east, so that it stays on the left.
        (180.0, 50.0, (-1.0, 0.0)),
        # It flies north, slower: overtaken on its right, as 14 CFR 91.113 (f) asks.
        (0.0, 10.0, (-1.0, 0.0)),
        # From the right, to the west at the own speed: the own aircraft passes behind it, to the south-east.
        (270.0, 25.0, (-math.sqrt(0.5), math.sqrt(0.5))),
        # From the left, to the east: behind it is to the south-west.
        (90.0, 25.0, (math.sqrt(0.5), math.sqrt(0.5))),
    ],
    ids=["head-on", "overtaken", "from the right", "from the left"],
)
def test_the_wrong_side_by_the_rules_of_the_air(course_deg, speed, expected):
    assert wrong_side(meets(course_deg, speed), HERE, NORTH) == pytest.approx(expected, abs=1e-9)


def test_between_the_rules_for_head_on_and_from_the_left_there_is_no_wrong_side():
    """They meet at 45° to the opposite course."""
    assert wrong_side(meets(135.0, 50.0), HERE, NORTH) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    "other",
    [
        meets(180.0, 50.0, aside_m=611.0),  # 610 m are well clear.
        aircraft((0.0, -1000.0), (0.0, -50.0)),  # It has passed.
        aircraft((300.0, 0.0), (0.0, 0.0)),  # It stands.
        replace(meets(180.0, 50.0), flies_on=False),
        replace(meets(180.0, 50.0), keeps_route=True),  # Members of a team agree by themselves.
    ],
    ids=["far aside", "passed", "stands", "pursuer", "member"],
)
def test_who_does_not_come_near_or_does_not_fly_on_has_no_wrong_side(other):
    assert wrong_side(other, HERE, NORTH) == (0.0, 0.0)


@given(st.floats(0.0, 360.0), st.floats(5.0, 100.0), st.floats(-500.0, 500.0), st.floats(0.0, 360.0))
def test_it_turns_with_the_map(course_deg, speed, aside_m, turn_deg):
    other, turn = meets(course_deg, speed, aside_m), math.radians(turn_deg)
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    place, velocity = (
        turned @ np.asarray(value[:2]) for value in (other.position_enu_m, other.velocity_enu_m_s)
    )
    found = wrong_side(aircraft(place, tuple(velocity)), HERE, turned @ NORTH)
    assert found == pytest.approx(tuple(turned @ wrong_side(other, HERE, NORTH)), abs=1e-6)
    assert math.hypot(*found) <= 1.0 + 1e-9

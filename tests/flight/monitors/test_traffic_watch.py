"""What the pilot is told of aircraft that pass: which, when, where."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.flight.monitors.traffic_watch import TrafficWatch
from companion.types.pilot_texts import pilot_message
from companion.types.state import Ownship
from tests.support.worlds import track

OWN = Ownship(100.0, (1000.0, 1000.0, 250.0), 0.5 * math.pi, 0.0, 25.0, 25.0)  # It flies east at 25 m/s.
HEAD_ON = replace(
    track(4000.0, 1000.0, velocity=(-50.0, 0.0), airborne=True, up=290.0, stamp=100.0), flies_on=True,
    max_threat_radius_m=610.0, identity="icao:00ABCD",
)  # fmt: skip


class Told:
    """Keeps the texts that the pilot would receive."""

    def __init__(self):
        self.texts = []

    def decide(self, kind, _text, *, tell, about, **values):
        assert kind.value == "traffic"
        assert about == "icao:00ABCD"
        self.texts.append(pilot_message(tell, about, **values).text)


@pytest.fixture
def told():
    return Told()


def test_head_on_by_hand(told):
    """3000 m at 75 m/s: nearest after 40 s."""
    TrafficWatch(told).look(100.0, OWN, [HEAD_ON])
    assert told.texts == ["Traffic 12 o'clock, 3.0 km, 40 m above, 40 s"]


@pytest.mark.parametrize(
    ("place", "velocity", "words"),
    [
        ((1000.0, -500.0, 255.0), (25.0, 40.0, 0.0), "Traffic 3 o'clock, 1.5 km, same height, 38 s"),
        ((1000.0, 2480.0, 200.0), (25.0, -40.0, 0.0), "Traffic 9 o'clock, 1.5 km, 50 m below, 37 s"),
        ((0.0, 1000.0, 250.0), (60.0, 0.0, 0.0), "Traffic 6 o'clock, 1.0 km, same height, 29 s"),
    ],
)
def test_from_all_sides(place, velocity, words, told):
    TrafficWatch(told).look(100.0, OWN, [replace(HEAD_ON, position_enu_m=place, velocity_enu_m_s=velocity)])
    assert told.texts == [words]


@pytest.mark.parametrize(
    "other",
    [
        replace(HEAD_ON, flies_on=False),  # A pursuer is planned for, and told of otherwise.
        replace(HEAD_ON, position_enu_m=(4000.0, 1000.0, 330.0)),  # 80 m above
        replace(HEAD_ON, position_enu_m=(4000.0, 1650.0, 250.0)),  # 650 m beside
        replace(HEAD_ON, position_enu_m=(8000.0, 1000.0, 250.0)),  # in 85 s
        replace(HEAD_ON, velocity_enu_m_s=(50.0, 0.0, 0.0)),
    ],
)
def test_what_does_not_come_near_is_not_told(other, told):
    TrafficWatch(told).look(100.0, OWN, [other])
    assert told.texts == []


def member(east, *, circle_m=0.0):
    """A member of a team that stays at the own height, ``east`` metres east on the own course."""
    rows = np.array([[100.0 + second, 1000.0 + east, 1000.0, 250.0] for second in range(3)])
    return replace(
        HEAD_ON, position_enu_m=(1000.0 + east, 1000.0, 250.0), max_threat_radius_m=165.0, clear_up_m=40.0,
        route=rows, keeps_route=True, circle_m=circle_m, circles_from_s=100.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("other", "is_agreed", "is_told"),
    [
        (member(800.0), False, True),  # 800 m at 25 m/s: 32 s
        (member(800.0), True, False),  # Both fly what the team has agreed to.
        (member(1400.0), False, False),  # 45 s bring it to 275 m
        (member(1400.0, circle_m=120.0), False, True),  # from the centre of a circle.
        (HEAD_ON, True, True),  # It is no member.
    ],
)
def test_a_member_of_the_team_is_told_where_nothing_was_agreed(other, is_agreed, is_told, told):
    TrafficWatch(told).look(100.0, OWN, [other], is_agreed=is_agreed)
    assert bool(told.texts) is is_told


def test_a_turn_or_a_climb_that_leads_near_is_told(told):
    watch = TrafficWatch(told)
    beside = replace(HEAD_ON, position_enu_m=(3000.0, 1900.0, 250.0), velocity_enu_m_s=(-50.0, 0.0, 0.0))
    watch.look(100.0, OWN, [beside])
    assert told.texts == []
    watch.look(100.0, OWN, [replace(beside, turn_rate_rad_s=math.radians(2.0))])
    assert len(told.texts) == 1


def test_it_is_told_again_after_half_a_minute(told):
    watch = TrafficWatch(told)
    for now_s in (100.0, 101.0, 129.0, 131.0):
        watch.look(now_s, replace(OWN, stamp_s=now_s), [replace(HEAD_ON, stamp_s=now_s)])
    assert len(told.texts) == 2

"""Plans past aircraft that only pass: on which side, and how fast; beside plans without the rule."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.planning import explore
from companion.planning.comparators import METHODS
from companion.planning.least_objective import least_route, short_cuts
from companion.planning.solver import solve
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled
WIDE = (-1000.0, 6000.0, -3000.0, 3000.0, 0.0, 300.0)
LEAVES_AT_M = 3000.0  # The two are to meet so far east of the start.
CRUISE_M_S = 25.0


def meeting(course_deg, speed, aside_m=0.0):
    """An aircraft that would meet a straight flight to the east, or pass so far to its north."""
    course, wait_s = math.radians(course_deg), 0.5 * LEAVES_AT_M / CRUISE_M_S
    velocity = speed * np.array([math.sin(course), math.cos(course)])
    place = np.array([0.5 * LEAVES_AT_M, aside_m]) - wait_s * velocity
    seen = track(*place, velocity=tuple(velocity), airborne=True, up=150.0, radius=610.0, speed=speed)
    return replace(seen, flies_on=True, covariance=np.diag([60.0, 1.0, 60.0, 1.0]))


def planned(other, **changes):
    asked = problem(
        tracks=[other], start=(0.0, 0.0, 150.0), direction=0.0, goal=(LEAVES_AT_M, 0.0, 150.0), bounds=WIDE,
        sensing_horizon_m=4000.0, **changes,
    )  # fmt: skip
    return solve(asked).path


def passage(path, other):
    """How near the path comes to the aircraft [m], and whether that stays on the left."""
    away = other.places_enu_m(path.times_s)[:, :2] - path.positions_enu_m[:, :2]
    flat = np.hypot(*away.T)
    sight = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return flat.min(), bool(sight[-1] > sight[0])


@pytest.mark.parametrize(
    ("course_deg", "aside_m", "stays_left"),
    [
        (270.0, 0.0, True), (270.0, 100.0, True), (270.0, -100.0, True), (315.0, 0.0, True), (0.0, 0.0, True),
        (180.0, 0.0, False), (180.0, 100.0, False), (180.0, -100.0, False),
    ],
    ids=[
        "head-on", "a little left", "a little right", "oblique", "from the right", "from the left", "early",
        "late",
    ],
)  # fmt: skip
def test_it_is_passed_on_the_side_that_the_rules_ask_for(course_deg, aside_m, stays_left):
    other = meeting(course_deg, 50.0 if course_deg == 270.0 else 30.0, aside_m)
    nearest, is_left = passage(planned(other), other)
    assert nearest > 610.0
    assert is_left is stays_left


def test_without_the_rule_the_shorter_way_is_flown(monkeypatch):
    """It comes a little to the right of the own path, so that the way on its left is the shorter one."""
    other = meeting(270.0, 50.0, -100.0)
    monkeypatch.setattr(explore, "with_wrong_sides", lambda pursuers, *_: pursuers)
    assert passage(planned(other), other)[1] is False


def test_far_on_the_wrong_side_the_rule_asks_for_no_detour():
    """It passes 900 m to the right: nearer than the margin that is wider on its wrong side would reach."""
    other = meeting(270.0, 50.0, -900.0)
    path = planned(other)
    assert np.abs(path.positions_enu_m[:, 1]).max() < 5.0


def test_an_aircraft_that_is_hardly_slower_is_overtaken_above_cruise():
    """At cruise it is in the way up to the goal, so that the path waits in circles."""
    other = replace(meeting(90.0, 12.5), covariance=np.diag([240.0, 4.0, 240.0, 4.0]))
    path = planned(other)
    at_cruise = planned(other, strategies=METHODS["safe-rrt-cruise"])
    assert min(passage(path, other)[0], passage(at_cruise, other)[0]) > 610.0
    assert path.speeds_m_s.max() > CRUISE_M_S + 1.0
    assert at_cruise.speeds_m_s.max() == pytest.approx(CRUISE_M_S)
    assert path.times_s[-1] < 0.6 * at_cruise.times_s[-1]


def test_detours_find_cheaper_ways_past_a_fast_aircraft(monkeypatch):
    """It flies 384 m/s and is met in 22 s: the cells of V, 180 m wide, say little of so short a time."""
    seen = track(
        10_062.0, 520.0, velocity=(-384.0, -26.0), airborne=True, up=239.0, radius=610.0, speed=384.0
    )
    spread = np.diag([240.0, 18.0, 264.0, 18.0])
    other = replace(seen, flies_on=True, covariance=spread, clear_up_m=76.2, height_std_m=8.0)
    asked = problem(
        tracks=[other], dimension=3, start=(1262.0, 0.0, 250.0), direction=0.0, goal=(3000.0, 0.0, 250.0),
        bounds=(-3000.0, 6000.0, -3500.0, 3500.0, 40.0, 500.0), sensing_horizon_m=11_000.0,
    )  # fmt: skip
    every = [replace(asked, seed=seed) for seed in range(4)]
    ours = [solve(each).objective_s for each in every]
    monkeypatch.setattr(short_cuts, "loses_well_clear", lambda *_: False)
    without = [solve(each).objective_s for each in every]
    assert np.mean(ours) < np.mean(without) - 5.0


def test_a_path_does_not_sink_to_the_goals_centre_through_a_well_clear_volume(monkeypatch):
    """A slow aircraft flies 55 m below the last part of the way. Above it is room up to within the radius."""
    seen = track(2200.0, 0.0, velocity=(0.5, 0.0), airborne=True, up=195.0, radius=610.0, speed=1.0)
    spread = np.diag([20.0, 0.1, 20.0, 0.1])
    other = replace(seen, flies_on=True, covariance=spread, clear_up_m=76.2, height_std_m=8.0)
    asked = problem(
        tracks=[other], dimension=3, start=(0.0, 0.0, 250.0), direction=0.0, goal=(3000.0, 0.0, 250.0),
        bounds=(-1000.0, 6000.0, -3500.0, 3500.0, 40.0, 500.0), sensing_horizon_m=11_000.0,
    )  # fmt: skip
    ours_s = solve(asked).objective_s
    monkeypatch.setattr(least_route, "FINISHING_S", math.inf)
    assert ours_s < solve(asked).objective_s - 20.0

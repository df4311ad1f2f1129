"""Which point of the sensing horizon becomes the sub goal (paper 4.2)."""

import math

import numpy as np
import pytest

from companion.planning.comparators import Strategies, SubGoalRule
from companion.planning.explore import Exploration
from companion.planning.sub_goal import caught_on_the_rest, choose_sub_goal, horizon_points
from companion.types.threat import Radar
from tests.support.paths import box
from tests.support.worlds import problem, track

HORIZON = 600.0


def chosen(
    obstacles=(), radars=(), *, start=(400.0, 400.0, 150.0), goal=(1350.0, 1350.0, 150.0), used=(), **changes
):
    exploration = Exploration(
        problem(obstacles, radars, start=start, goal=goal, **changes), np.random.default_rng(1)
    )
    asked = exploration.problem
    return choose_sub_goal(
        end=exploration.tree.state[0].copy(), goal=np.array(goal), stamp_s=0.0, elapsed_s=0.0,
        scene=exploration.scene(), settings=asked.settings,
        home=exploration.guide_home(np.array(goal)), used=[np.array(point) for point in used],
    )  # fmt: skip


def test_the_goal_itself_where_it_lies_inside_the_horizon():
    assert chosen(goal=(800.0, 800.0, 150.0)).position_enu_m.tolist() == [800.0, 800.0, 150.0]


def test_straight_at_the_goal_where_nothing_is_in_the_way():
    found = chosen().position_enu_m
    assert np.linalg.norm(found - (400.0, 400.0, 150.0)) == pytest.approx(HORIZON)
    assert math.atan2(found[1] - 400.0, found[0] - 400.0) == pytest.approx(
        math.pi / 4.0, abs=math.radians(3.1)
    )


def test_never_in_an_obstacle_and_never_without_the_margin():
    wall = box("w", 700.0, 700.0, 950.0, 950.0)
    found = chosen([wall]).position_enu_m
    gap = max(700.0 - found[0], found[0] - 950.0, 0.0), max(700.0 - found[1], found[1] - 950.0, 0.0)
    assert math.hypot(*gap) >= 15.0


def test_not_deeper_into_a_dead_end():
    # A pocket open to the west: the goal is due east of its floor, so by the straight line of (6) the
    # points inside are the nearest to it. The way out of it leads west first.
    pocket = [
        box("floor", 1100.0, 300.0, 1140.0, 1200.0),
        box("south", 500.0, 260.0, 1140.0, 300.0),
        box("north", 500.0, 1200.0, 1140.0, 1240.0),
    ]
    start, goal = (700.0, 750.0, 150.0), (1400.0, 750.0, 150.0)
    found = chosen(pocket, start=start, goal=goal).position_enu_m
    inside = 500.0 < found[0] < 1140.0 and 260.0 < found[1] < 1240.0
    assert not inside


def test_points_used_before_come_last():
    first = chosen().position_enu_m
    second = chosen(used=[first]).position_enu_m
    assert np.linalg.norm(second - first) >= 0.25 * HORIZON - 1e-6


def test_where_every_point_is_at_high_risk_the_cheapest_free_one_and_a_note():
    radar = Radar("r", (400.0, 400.0, 150.0), 5000.0)
    found = chosen(radars=[radar], sub_goal_level_max=0.01)
    assert found.note == "every sub goal is at high risk"
    assert np.linalg.norm(found.position_enu_m - (400.0, 400.0, 150.0)) == pytest.approx(HORIZON)


def test_edbm_looks_at_distances_only():
    # A radar whose area the straight line crosses: (5) pays for it, the Euclidean rule does not.
    radar = Radar("r", (900.0, 820.0, 150.0), 120.0)
    plain = chosen(radars=[radar], strategies=Strategies(sub_goal=SubGoalRule.EUCLIDEAN))
    assert plain.position_enu_m == pytest.approx(
        chosen(strategies=Strategies(sub_goal=SubGoalRule.EUCLIDEAN)).position_enu_m
    )
    assert not np.allclose(plain.position_enu_m, chosen(radars=[radar]).position_enu_m)


@pytest.mark.parametrize("dimension", [2, 3])
def test_candidates_lie_on_the_horizon_within_the_altitudes(dimension):
    limits = Exploration(problem(dimension=dimension), np.random.default_rng(1)).limits
    centre = np.array([400.0, 400.0, 150.0])
    points = horizon_points(centre, HORIZON, 60, limits)
    assert np.linalg.norm(points - centre, axis=1) == pytest.approx(np.full(60, HORIZON))
    assert points[:, 2].min() >= 50.0
    assert points[:, 2].max() <= 250.0
    assert (np.ptp(points[:, 2]) > 100.0) == (dimension == 3)


def test_seconds_that_a_vehicle_could_threaten_after_a_sub_goal():
    """It stands on the way, 1200 m long, and reaches 150 m: a row each 100 m, at 25 m/s.

    Who passes 200 m, 550 m before it, at 60 m has climbed 58 m more there, tan 6 degrees: two rows, 50 m
    before and behind it, are 130 m away; the next ones, 150 m aside, are not. Who is at 200 m stays above.
    """
    asked = problem(tracks=[track(750.0, 750.0, speed=0.0, radius=150.0)], dimension=3)
    exploration = Exploration(asked, np.random.default_rng(1))
    low, high, within = (200.0, 750.0, 60.0), (200.0, 750.0, 200.0), (700.0, 750.0, 60.0)
    at_once, seconds = caught_on_the_rest(
        np.array([low, high, within]), np.array([100.0, 750.0, 60.0, 0.0, 0.0, 25.0]),
        np.array([1400.0, 750.0, 60.0]), 0.0, exploration.scene(),
    )  # fmt: skip
    assert seconds[:2] == pytest.approx([8.0, 0.0])
    assert at_once.tolist() == [False, False, True]


def test_who_has_to_be_high_begins_to_climb_in_time():
    # Where it stands it reaches the way to the goal below 190 m.
    standing = track(1050.0, 1050.0, speed=0.0, radius=190.0)
    asked = {
        "tracks": [standing], "start": (400.0, 400.0, 100.0), "goal": (1350.0, 1350.0, 100.0), "dimension": 3
    }  # fmt: skip
    heights = [chosen(**asked, weight_sub_goal_caught=w).position_enu_m[2] for w in (0.0, 1.0)]
    assert heights[0] < 100.0
    assert heights[1] > 190.0

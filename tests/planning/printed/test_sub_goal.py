"""Which point of the sensing horizon becomes the sub goal (paper 4.2)."""

import math

import numpy as np
import pytest

from companion.planning.comparators import Strategies, SubGoalRule
from companion.planning.explore import Exploration
from companion.planning.printed.sub_goal import choose_sub_goal, horizon_points
from companion.planning.printed.sub_tasks import SubTasks
from companion.types.threat import Radar
from tests.support.paths import box
from tests.support.worlds import problem

HORIZON = 600.0


def chosen(
    obstacles=(), radars=(), *, start=(400.0, 400.0, 150.0), goal=(1350.0, 1350.0, 150.0), used=(), **changes
):
    exploration = Exploration(
        problem(obstacles, radars, start=start, goal=goal, **changes), np.random.default_rng(1)
    )
    asked = exploration.problem
    return choose_sub_goal(
        end=exploration.tree.state[0].copy(), goal=np.array(goal), elapsed_s=0.0,
        scene=exploration.scene(), settings=asked.settings,
        home=SubTasks(exploration).goal_distances(np.array(goal)), used=[np.array(point) for point in used],
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

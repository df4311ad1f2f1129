"""What goals cost, one after another, with numbers that can be added in the head."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.mission.energy_budget import budget_of

START, EAST, FAR = (0.0, 0.0, 100.0), (1_000.0, 0.0, 100.0), (4_000.0, 0.0, 100.0)


def cost_j(begin, end):
    """3.6 J a metre: a watt-hour is a kilometre."""
    return 3.6 * math.dist(begin, end)


def budget(places, on_board_wh=10.0, reserve_wh=2.0):
    return budget_of(places, cost_j, on_board_wh=on_board_wh, reserve_wh=reserve_wh)


def test_energy_is_used_leg_by_leg_and_each_goal_has_its_way_back():
    found = budget((START, EAST, FAR))
    rows = [(goal.used_wh, goal.left_wh, goal.left_after_return_wh) for goal in found.goals]
    assert rows == [pytest.approx((1.0, 9.0, 8.0)), pytest.approx((4.0, 6.0, 2.0))]
    assert (found.margin_at_goal_wh, found.margin_after_return_wh) == pytest.approx((4.0, 0.0), abs=1e-9)


def test_the_worst_way_back_counts_not_the_last():
    found = budget((START, FAR, EAST), on_board_wh=9.5)
    assert found.margin_at_goal_wh == pytest.approx(0.5)
    assert found.margin_after_return_wh == pytest.approx(-0.5)
    found = budget((START, FAR, START), reserve_wh=0.0, on_board_wh=7.0)
    assert found.margin_after_return_wh == found.margin_at_goal_wh == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("on_board_wh", "words"),
    [
        (10.5, "6.5 Wh left at the last goal, the reserve of 2 Wh reached by 4.5 Wh; "
               "with the flight back from goal 2 reached by 0.5 Wh"),
        (9.0, "5.0 Wh left at the last goal, the reserve of 2 Wh reached by 3.0 Wh; "
              "with the flight back from goal 2 missed by 1.0 Wh"),
        (3.0, "-1.0 Wh left at the last goal, the reserve of 2 Wh missed by 3.0 Wh; "
              "with the flight back from goal 2 missed by 7.0 Wh"),
    ],
)  # fmt: skip
def test_the_verdict_says_by_how_much(on_board_wh, words):
    assert budget((START, EAST, FAR), on_board_wh).verdict == words


@given(st.lists(st.tuples(*[st.floats(-1e4, 1e4)] * 3), min_size=2, max_size=8), st.floats(0.0, 1e4))
def test_nothing_is_lost_or_found_on_the_way(places, on_board_wh):
    found = budget(places, on_board_wh)
    assert len(found.goals) == len(places) - 1
    used = [goal.used_wh for goal in found.goals]
    assert used == sorted(used)
    for goal in found.goals:
        assert goal.used_wh + goal.left_wh == pytest.approx(on_board_wh, abs=1e-6)
        assert goal.left_after_return_wh <= goal.left_wh + 1e-9
    assert found.margin_after_return_wh <= found.margin_at_goal_wh + 1e-9

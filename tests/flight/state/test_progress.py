"""Goals on the way, by hand: a path straight north at 25 m/s, a row each second."""

import pytest

from companion.flight.state.progress import missed_goal
from companion.planning.problem import GoalRegion
from tests.support.paths import straight_path

PATH = straight_path(num=11)  # rows at north 0, 25, …, 250 m


@pytest.mark.parametrize(
    ("goals", "missed"),
    [
        ([], None),
        ([((0.0, 100.0, 100.0), 5.0)], None),
        ([((40.0, 100.0, 100.0), 40.0)], None),
        ([((50.0, 100.0, 100.0), 40.0)], (4, 50.0)),
        ([((0.0, 100.0, 100.0), 5.0), ((0.0, 200.0, 100.0), 5.0)], None),
        # In the other order the second one lies behind: its nearest row after the first is the first's.
        ([((0.0, 200.0, 100.0), 5.0), ((0.0, 100.0, 100.0), 5.0)], (8, 100.0)),
        ([((0.0, 100.0, 160.0), 40.0)], (4, 60.0)),
    ],
)
def test_a_goal_that_the_path_misses_is_named_by_its_nearest_row(goals, missed):
    found = missed_goal(PATH, [GoalRegion(*goal) for goal in goals])
    assert [(entry.row, pytest.approx(entry.value)) for entry in found] == ([missed] if missed else [])

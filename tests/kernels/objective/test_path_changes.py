"""Changes of a path: what a draw makes of it, and which one lowers J."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.objective.path_changes import (
    DRAWS,
    GOAL,
    changed,
    next_gain,
    passed_elsewhere,
    passes,
)
from companion.kernels.objective.row_costs import Objective, Prices, rows_cost
from companion.kernels.search.path_edit import join
from companion.kernels.workspace import PathRows, empty_rows
from companion.planning.problem import GoalRegion, goals_on_the_way
from companion.planning.route import visits_goals
from companion.types.threat import Radar
from companion.world.pursuer_trees import threat_trees
from companion.world.pursuit import pursuit_game
from companion.world.threats import packed_threats
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.worlds import packed

BOUNDS = (-5000.0, 5000.0, -5000.0, 5000.0, 0.0, 500.0)
NO_GOALS = goals_on_the_way([])
ROOM = 200
NARROW, WHOLE = (0.1, 0.9, 0.0), (1.0, 0.0, 0.99)  # Width, first row and number of rows of a short cut.


def objective(dimension=3, radars=(), seen=0.0):
    nothing = packed([])
    return Objective(
        prices=Prices(seen=seen, pursued=0.0, near=0.0, energy=0.0, collision=0.0, wanted=0.0, cruise=25.0),
        obstacles=nothing,
        threats=packed_threats(radars, nothing, BOUNDS),
        game=pursuit_game((), nothing, None, BOUNDS, 3.0),
        pursuers=threat_trees((), nothing, None, BOUNDS, ()),
        limits=VehicleModel().limits(dimension, BOUNDS, 15.0, 1.0),
        deviations=np.array([2.0]),
        start=0.0,
    )


def path_over(*places):
    """A path of Dubins edges from (0, 0) over places, all of it towards east at 200 m."""
    rows, n = empty_rows(ROOM), 1
    rows.states[0], rows.times[0], rows.rates[0] = (0.0, 0.0, 200.0, 0.0, 0.0, 25.0), 10.0, 0.0
    for east, north in places:
        _, n = join(rows, n, np.array([east, north, 200.0, 0.0, 0.0, 25.0]), objective().limits)
    return rows, n


def drawn(*numbers):
    """A draw whose other columns are 0."""
    return np.array([*numbers, *np.zeros(DRAWS - len(numbers))])


def test_the_first_draw_that_lowers_j_is_found():
    """A detour over (500, 100) becomes 1,000 m straight on: 40 s at 25 m/s. Nothing is left to cut then."""
    rows, n = path_over((500.0, 100.0), (1000.0, 0.0))
    draws, out = np.array([drawn(*NARROW), drawn(*WHOLE), drawn(*WHOLE)]), empty_rows(ROOM)
    assert next_gain(rows, n, draws, NO_GOALS, objective(), out) == (1, 41)
    assert out.times[40] == pytest.approx(50.0)
    straight, num = path_over((1000.0, 0.0))
    assert next_gain(straight, num, draws, NO_GOALS, objective(), out) == (3, 0)


def test_a_short_cut_past_a_goal_is_not_one():
    rows, n = path_over((500.0, 100.0), (1000.0, 0.0))
    draws, out = np.array([drawn(*WHOLE)]), empty_rows(ROOM)
    for radius, found in ((90.0, (1, 0)), (110.0, (0, 41))):
        goal = np.array([[500.0, 100.0, 200.0, radius]])
        assert next_gain(rows, n, draws, goal, objective(), out) == found


def test_a_shorter_path_that_costs_more_is_not_taken():
    """The straight path leads over a radar's middle; the price of being seen decides."""
    rows, n = path_over((500.0, 400.0), (1000.0, 0.0))
    draws, out = np.array([drawn(*WHOLE)]), empty_rows(ROOM)
    radar = Radar("one", (500.0, 0.0, 0.0), 350.0)
    assert next_gain(rows, n, draws, NO_GOALS, objective(radars=[radar], seen=0.0), out)[0] == 0
    assert next_gain(rows, n, draws, NO_GOALS, objective(radars=[radar], seen=20.0), out)[0] == 1


@pytest.mark.parametrize(
    ("dimension", "vertical", "side", "place"),
    [
        (3, 0.6, 0.1, (600.0, -150.0, 200.0)),
        (3, 0.6, 0.9, (600.0, 150.0, 200.0)),
        (2, 0.1, 0.1, (600.0, -150.0, 200.0)),
        (2, 0.1, 0.9, (600.0, 150.0, 200.0)),
        (3, 0.1, 0.1, (600.0, 0.0, 200.0 + 300.0 * math.tan(math.radians(10.0)))),
        (3, 0.1, 0.9, (600.0, 0.0, 200.0 - 300.0 * math.tan(math.radians(10.0)))),
    ],
)
def test_a_detour_by_hand(dimension, vertical, side, place):
    """It leads past row 24 of a straight path, 600 m on. Half of that is its reach, half of the reach aside.

    A draw of 0.25 for the distance is a half: the distance is distributed over an area.
    """
    rows, n = path_over((1200.0, 0.0))
    assert n == 49
    # First and last row are 0 and 48: 23/47 of the rows between are passed before row 24.
    draw = np.array([-1.0, 0.0, 0.99, 0.5, 23.5 / 47.0, 0.25, vertical, side])
    out = empty_rows(ROOM)
    first, m = changed(rows, n, draw, objective(dimension), out)
    assert first == 0
    assert m > 0
    assert np.linalg.norm(out.states[:m, :3] - np.array(place), axis=1).min() == pytest.approx(0.0, abs=1e-6)
    assert out.states[m - 1] == pytest.approx(rows.states[48])


def test_detours_begin_near_the_start():
    """Row 20 of the draw, at a half squared, is row 5."""
    rows, n = path_over((1200.0, 0.0))
    draw = np.array([-1.0, 20.5 / 46.0, 0.99, 0.5, 0.5, 0.1, 0.6, 0.0])
    assert changed(rows, n, draw, objective(), empty_rows(ROOM))[0] == 5


def test_another_way_past_a_goal_by_hand():
    """The path turns from east to north on a quarter circle; its goal of 60 m is in the middle of the turn.

    The change begins 20 of 60 rows before the one before the row that is nearest to the goal's centre. It
    leads past a place in the north-west (3/8 of a turn from east), half of the radius from the centre (the
    root of 1/4), on a course that is 9° (a tenth of 90°) to the left. That cuts the corner.
    """
    rows, n = path_over((600.0, 0.0))
    for north in (125.0, 600.0):
        _, n = join(rows, n, np.array([725.0, north, 200.0, math.pi / 2, 0.0, 25.0]), objective().limits)
    middle = np.array([600.0 + 125.0 * math.sin(math.pi / 4), 125.0 - 125.0 * math.cos(math.pi / 4), 200.0])
    apart = np.linalg.norm(rows.states[:n, :3] - middle, axis=1)
    nearest = apart.argmin()
    draw, out = drawn(GOAL, 0.0, 20.5 / 60.0, 0.2, 0.0, 0.25, 0.375, 0.55), empty_rows(ROOM)
    goal = np.array([[*middle, 60.0]])
    first, m = passed_elsewhere(rows, n, draw, goal[0], objective(), out)
    assert first == nearest - 1 - 20
    assert out.states[m - 1] == pytest.approx(rows.states[n - 1])
    place = middle + np.array([-30.0 * math.sqrt(0.5), 30.0 * math.sqrt(0.5), 0.0])
    away = np.linalg.norm(out.states[:m, :3] - place, axis=1)
    assert away.min() == pytest.approx(0.0, abs=1e-6)
    assert out.states[away.argmin(), 3] == pytest.approx(rows.states[nearest, 3] + math.radians(9.0))
    j = objective()
    assert next_gain(rows, n, np.array([draw]), goal, j, empty_rows(ROOM)) == (0, m)
    assert rows_cost(out, 1, m, j) < rows_cost(rows, 1, n, j)


UNIFORM = st.floats(0.0, 1.0, exclude_max=True)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.floats(-1.0, 1.0), *[UNIFORM] * 7), min_size=1, max_size=6), st.integers(4, 49))
def test_what_is_found_costs_less_and_ends_where_the_path_did(draws, n):
    """Any draw, on a path with a bend, cut off anywhere."""
    rows, num = path_over((400.0, 250.0), (900.0, 0.0), (1200.0, 0.0))
    n = min(n, num)
    j, out = objective(), empty_rows(ROOM)
    at, m = next_gain(rows, n, np.array(draws), NO_GOALS, j, out)
    if m == 0:
        assert at == len(draws)
        return
    assert at < len(draws)
    assert rows_cost(out, 1, m, j) < rows_cost(rows, 1, n, j)
    assert np.array_equal(out.states[0], rows.states[0])
    assert out.states[m - 1] == pytest.approx(rows.states[n - 1])


PLACE = st.tuples(*[st.integers(0, 3).map(float)] * 3)


@settings(max_examples=300, deadline=None)
@given(st.lists(PLACE, min_size=1, max_size=8), st.lists(st.tuples(PLACE, st.floats(0.1, 2.0)), max_size=3))
def test_goals_on_the_way_are_passed_in_order(places, on_the_way):
    """The kernel and the function of numpy agree; one row may pass several goals."""
    goals = [GoalRegion(place, radius) for place, radius in [*on_the_way, ((9.0, 9.0, 9.0), 0.1)]]
    states = np.zeros((len(places), 6))
    states[:, :3] = places
    rows = PathRows(states, np.zeros(len(places)), np.zeros((len(places), 2)))
    assert passes(rows, len(places), goals_on_the_way(goals)) == visits_goals(states, goals)

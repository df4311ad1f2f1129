"""Races on the lattice of poses, judged by plain Python."""

import heapq
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from companion.kernels.geometry.distance_field import fill_distances
from companion.kernels.search.state_lattice import UNFINISHED, num_cells, race, race_from
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.types.threat import Obstacle, Radar
from companion.world.pursuit import Pursuit
from tests.support.worlds import problem, track

WALL = Obstacle("wall", np.array([(700.0, 0.0), (760.0, 0.0), (760.0, 1000.0), (700.0, 1000.0)]), 0.0, 300.0)


def run(exploration, goal, home, burst=10**6):
    """Rows of a race from the root, and how many."""
    rows, field = empty_rows(2048), race_from(exploration.tree, 0, np.zeros(num_cells(exploration.limits)))
    while True:
        n = race(field, goal, 45.0, home, exploration.scene(), rows, burst, exploration.work)
        if n != UNFINISHED:
            return rows, n


def raced(asked, burst=10**6):
    """Rows of the race to the only goal (N, 6), their times (N,), and the exploration."""
    exploration = Exploration(asked, np.random.default_rng(1))
    goal = np.array(asked.goals[0].position_enu_m)
    rows, n = run(exploration, goal, exploration.guide_home(goal), burst)
    return rows.states[:n], rows.times[:n], exploration


def turns_of(states):
    return np.diff(np.unwrap(states[:, 3]))


def test_in_the_open_it_flies_nearly_straight():
    _, times, _ = raced(problem())
    straight_s = (math.hypot(1250.0, 1250.0) - 45.0) / 25.0
    assert straight_s - 0.01 <= times[-1] <= straight_s + 3.0


def test_it_keeps_the_turn_radius_the_straight_rule_and_the_margin():
    states, _, exploration = raced(problem([WALL]))
    turns, steps = turns_of(states), np.hypot(*np.diff(states[:, :2], axis=0).T)
    assert len(states) > 40
    arc = np.abs(turns) > 1e-9
    chords = 2.0 * exploration.limits.r_min * np.sin(0.5 * np.abs(turns[arc]))
    assert steps[arc] == pytest.approx(chords, rel=1e-6)
    since = math.inf
    last = 0.0
    for turn, step in zip(turns, steps, strict=True):
        if abs(turn) > 1e-9:
            assert math.copysign(1.0, turn) == last or since >= exploration.limits.straight_min - 1e-6
            last, since = math.copysign(1.0, turn), 0.0
        else:
            last, since = 0.0, since + step
    inside = (states[:, 0] > 700.0 - 15.0) & (states[:, 0] < 775.0) & (states[:, 1] < 1015.0)
    assert not (inside & (np.hypot(states[:, 0] - 760.0, states[:, 1] - 1000.0) > 15.0)).any()


def test_a_race_in_bursts_is_the_same_race():
    asked = problem([WALL], tracks=[track(725.0, 725.0, speed=4.0, radius=200.0)])
    at_once, in_bursts = raced(asked), raced(asked, burst=7)
    assert np.array_equal(at_once[0], in_bursts[0])
    assert at_once[2].stats[0] == in_bursts[2].stats[0]


def test_a_dt_that_could_bar_the_way_is_gone_round_and_outrun():
    slow = problem(tracks=[track(725.0, 725.0, speed=4.0, radius=200.0)])
    states, times, exploration = raced(slow)
    assert len(states)
    game = exploration.chase.game
    away = np.hypot(states[:, 0] - 725.0, states[:, 1] - 725.0)
    assert (away - 200.0 > 4.0 * (times + game.slack)).all()  # whatever it does
    weighed, _, _ = raced(replace(slow, settings=replace(slow.settings, strategies=replace(
        slow.settings.strategies, plays_game=False))))  # fmt: skip
    assert (np.hypot(weighed[:, 0] - 725.0, weighed[:, 1] - 725.0) < 200.0).any()


def test_where_a_dt_bars_all_ways_there_is_none():
    states, _, exploration = raced(problem(tracks=[track(1300.0, 1300.0, speed=20.0, radius=200.0)]))
    assert not len(states)
    assert exploration.chase.pursuit is Pursuit.AVOIDED
    speeds = []
    while exploration.chase.pursuit is Pursuit.AVOIDED:
        exploration.give_in(lambda: False)
        speeds.append(exploration.chase.game.hunters[0, 4])
    assert speeds == pytest.approx([20.0, 20.0])
    assert exploration.chase.pursuit is Pursuit.WEIGHED
    assert exploration.chase.is_raced
    exploration.give_in(lambda: False)
    assert not exploration.chase.may_give_in
    _, _, late = raced(problem(tracks=[track(1300.0, 1300.0, speed=20.0, radius=200.0)]))
    late.give_in(lambda: True)  # no time is left: weighed at once
    assert late.chase.pursuit is Pursuit.WEIGHED


def weighed_by_grid(asked, dear):
    """Seconds, those under threat ``dear`` times more, of the cheapest way over a grid of 50 m.

    Eight neighbours: no way of an aircraft that need not turn is longer by more than a twelfth.
    """
    exploration, goal = Exploration(asked, np.random.default_rng(1)), asked.goals[0].position_enu_m
    while exploration.chase.is_avoided:
        exploration.give_in(lambda: False)
    waiting, done = [(0.0, 0.0, 2, 2)], set()
    while waiting:
        cost, time, i, j = heapq.heappop(waiting)
        if math.hypot(50.0 * i - goal[0], 50.0 * j - goal[1]) <= 45.0:
            return cost
        if (i, j) in done:
            continue
        done.add((i, j))
        for u, w in itertools.product((-1, 0, 1), repeat=2):
            a, b = i + u, j + w
            if (u or w) and 0 <= a <= 30 and 0 <= b <= 30 and (a, b) not in done:
                step_s = 50.0 * math.hypot(u, w) / 25.0
                caught = exploration.chase.is_caught((50.0 * a, 50.0 * b, 150.0), time + step_s)
                heapq.heappush(waiting, (cost + step_s * (1 + dear * caught), time + step_s, a, b))
    return math.inf


@pytest.mark.parametrize("east", [900.0, 1100.0, 1300.0])
def test_where_threats_are_weighed_no_way_over_a_grid_is_cheaper(east):
    asked = problem(tracks=[track(east, 1300.0, speed=14.0, radius=200.0)])
    exploration = Exploration(asked, np.random.default_rng(1))
    while exploration.chase.is_avoided:
        exploration.give_in(lambda: False)
    goal = np.array(asked.goals[0].position_enu_m)
    rows, n = run(exploration, goal, exploration.guide_home(goal))
    caught = np.array([
        exploration.chase.is_caught(place[:3], time)
        for place, time in zip(rows.states[1:n], rows.times[1:n], strict=True)
    ])  # fmt: skip
    dear = asked.settings.times_as_dear(25.0, 25.0) - 1.0
    assert dear == pytest.approx(4.0)  # 2 a second; straight flight costs 0.5 in that time
    cost = rows.times[n - 1] + dear * float(np.diff(rows.times[:n])[caught].sum())
    assert caught.any()
    assert cost <= weighed_by_grid(asked, dear) + 1.0


def test_where_threats_are_weighed_room_has_its_price_and_where_they_are_avoided_none():
    """The way round the wall's end, 15 m off it or 60."""

    def nearest(wanted, is_weighed):
        asked = problem(
            [WALL], tracks=[track(1300.0, 100.0, speed=2.0, radius=100.0)], clearance_wanted_m=wanted
        )
        exploration = Exploration(asked, np.random.default_rng(1))
        while is_weighed and exploration.chase.is_avoided:
            exploration.give_in(lambda: False)
        goal = np.array((1350.0, 600.0, 150.0))
        rows, n = run(exploration, goal, exploration.guide_home(goal))
        east, north = rows.states[:n, 0], rows.states[:n, 1]
        gaps = np.hypot(np.clip(700.0 - east, 0.0, None) + np.clip(east - 760.0, 0.0, None),
                        np.clip(north - 1000.0, 0.0, None))  # fmt: skip
        return n, gaps.min()

    ways = {pair: nearest(*pair) for pair in itertools.product((0.0, 60.0), (False, True))}
    assert all(n > 0 for n, _ in ways.values())
    assert ways[0.0, True][1] < 30.0
    assert ways[60.0, True][1] > 50.0
    assert ways[60.0, False] == ways[0.0, False]


def test_threat_levels_above_the_limit_are_not_entered():
    radar = Radar("radar", (725.0, 725.0, 150.0), 300.0)
    far = replace(problem(radars=[radar], threat_level_max=0.3), seed=2)
    known = far.snapshot.with_known(np.ones(1, dtype=np.int64))
    states, _, _ = raced(replace(far, snapshot=known))
    through, _, _ = raced(replace(problem(radars=[radar]), snapshot=known))
    nearest = [np.hypot(rows[:, 0] - 725.0, rows[:, 1] - 725.0).min() for rows in (states, through)]
    assert nearest[0] > nearest[1]
    assert nearest[0] > 150.0


def test_without_a_way_home_nothing_is_found():
    exploration = Exploration(problem(), np.random.default_rng(1))
    goal = np.array([1350.0, 1350.0, 150.0])
    home = exploration.guide_home(goal)
    fill_distances(goal, home, np.zeros(home.field.shape))
    assert run(exploration, goal, home)[1] == 0

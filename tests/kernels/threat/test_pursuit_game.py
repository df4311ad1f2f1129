"""Earliest arrivals and C(q): worked by hand, and beside the oracle of the games."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import mission_from_text
from companion.config.compose import world_of
from companion.kernels.threat import pursuit_game as k
from companion.planning.settings import PlannerSettings
from companion.types.threat import Obstacle
from companion.world.pursuit import DEVIATIONS, pursuit_game
from tests.games.generator import random_game
from tests.games.oracle import game_of, threatened_at
from tests.support.worlds import packed, track

BOUNDS = (0.0, 2000.0, 0.0, 2000.0, 0.0, 300.0)
CELL_M = 2000.0 / 256
NEARER_M = DEVIATIONS + 0.5 * CELL_M  # of a track with a deviation of 1 m, and of the grid
WALL = Obstacle(
    "wall", np.array([(1000.0, 0.0), (1050.0, 0.0), (1050.0, 1200.0), (1000.0, 1200.0)]), 0.0, 100.0
)


def game(*tracks, obstacles=(), plane_up=100.0, slack=0.0):
    return pursuit_game(tracks, packed(obstacles, BOUNDS), plane_up, BOUNDS, slack)


def arrival(made, x, y, d=0):
    return made.arrival[d, round(x / CELL_M), round(y / CELL_M)]


def latest(made, x, y, z=100.0):
    return k.threatened_from(made, x, y, z, -math.inf, math.inf)


def test_in_the_open_a_dt_drives_straight_and_is_taken_to_be_nearer():
    made = game(track(500.0, 500.0, speed=20.0))
    for x, y in ((1500.0, 500.0), (1500.0, 1500.0), (200.0, 1900.0)):
        exact = (math.hypot(x - 500.0, y - 500.0) - NEARER_M) / 20.0
        assert exact * 0.97 - 0.4 <= arrival(made, x, y) <= exact + 0.4


def test_round_a_wall_it_comes_by_the_corners():
    made = game(track(500.0, 500.0, speed=20.0), obstacles=[WALL])
    way = math.hypot(500.0, 700.0) + 50.0 + math.hypot(150.0, 700.0)
    assert arrival(made, 1200.0, 500.0) == pytest.approx((way - NEARER_M) / 20.0, rel=0.03)
    assert arrival(made, 1025.0, 500.0) == math.inf


def test_a_place_in_the_open_is_threatened_from_its_circle_on():
    made = game(track(500.0, 500.0, speed=20.0, radius=200.0))
    assert latest(made, 1500.0, 500.0) == pytest.approx((800.0 - NEARER_M) / 20.0, abs=1.5)
    assert latest(made, 650.0, 500.0) == 0.0


def test_a_wall_hides_what_is_behind_it():
    """200 m behind the middle of the wall a DT has to come round the corner, to where it sees the place."""
    made = game(track(900.0, 600.0, speed=20.0, radius=250.0), obstacles=[WALL])
    beside, behind = latest(made, 950.0, 600.0), latest(made, 1120.0, 600.0)
    assert beside == 0.0
    way = math.hypot(100.0, 600.0) + 50.0 + math.hypot(70.0, 600.0) - 250.0
    assert behind == pytest.approx((way - NEARER_M) / 20.0, rel=0.08)


@pytest.mark.parametrize(("up", "is_hidden"), [(185.0, True), (215.0, False)])
def test_in_space_a_low_wall_hides_what_is_low(up, is_hidden):
    """A standing DT 100 m before a wall 100 m high: over its near edge it sees 200 m high 200 m away."""
    made = game(track(900.0, 600.0, speed=0.0, radius=500.0), obstacles=[WALL], plane_up=None)
    assert math.isinf(latest(made, 1100.0, 600.0, up)) is is_hidden


def test_slant_range_counts_in_space():
    made = game(track(900.0, 600.0, speed=0.0, radius=200.0), plane_up=None)
    assert latest(made, 1050.0, 600.0, 120.0) == 0.0  # 192 m
    assert latest(made, 1050.0, 600.0, 160.0) == math.inf  # 219 m


def test_what_flies_minds_no_wall_and_what_passes_by_hunts_nobody():
    made = game(track(500.0, 600.0, speed=20.0, airborne=True, up=100.0), obstacles=[WALL])
    assert latest(made, 1200.0, 600.0) == pytest.approx((500.0 - NEARER_M) / 20.0)
    assert latest(game(replace(track(500.0, 600.0), flies_on=True)), 520.0, 600.0) == math.inf


def test_of_two_the_sooner_counts_and_slack_is_taken_off():
    made = game(track(500.0, 500.0), track(1500.0, 1500.0), slack=3.0)
    alone = game(track(1500.0, 1500.0))
    assert latest(made, 1500.0, 1100.0) == latest(alone, 1500.0, 1100.0)
    moment = latest(made, 1500.0, 1100.0)
    assert k.is_threatened(made, 1500.0, 1100.0, 100.0, moment - 2.9)
    assert not k.is_threatened(made, 1500.0, 1100.0, 100.0, moment - 3.1)


@pytest.mark.compiled
@pytest.mark.parametrize("seed", range(12))
def test_c_is_within_the_slack_of_the_oracles(seed):
    mission = mission_from_text(random_game(seed, "route"), "game.yaml")
    world, exact = world_of(mission), game_of(mission)
    (threat,) = mission.dynamic_threat_list
    seen = track(*threat.position_enu_m[:2], speed=threat.speed_m_s, radius=threat.max_threat_radius_m)
    made = pursuit_game([seen], world.walls, 100.0, world.bounds, 0.0)
    rng = np.random.default_rng(seed)
    b = world.bounds
    places = np.column_stack([rng.uniform(b[0], b[1], 500), rng.uniform(b[2], b[3], 500)])
    places = places[shapely.distance(exact.walls, shapely.points(places)) > 30.0]
    ours = np.array([latest(made, x, y) for x, y in places])
    theirs = np.asarray(threatened_at(exact, places))
    both = np.isfinite(ours) & np.isfinite(theirs)
    late = ours[both] - theirs[both]
    assert (np.isfinite(ours) == np.isfinite(theirs)).mean() > 0.99
    assert late.max() < PlannerSettings().pursuit_slack_s  # what the grid rounds away, the slack makes good
    assert -3.0 < np.median(late) < 0.5
    assert np.quantile(late, 0.05) > -6.0  # a wall's cells may leave a slit that is none


@pytest.mark.compiled
@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_whoever_comes_sooner_is_no_more_threatened(seed):
    rng = np.random.default_rng(seed)
    made = game(track(*rng.uniform(200.0, 1800.0, 2), speed=rng.uniform(5.0, 30.0)), obstacles=[WALL])
    states = np.zeros((40, 6))
    states[:, :2], states[:, 2] = rng.uniform(0.0, 2000.0, (40, 2)), 100.0
    times = np.sort(rng.uniform(0.0, 200.0, 40))
    later = k.threatened_rows(states, times, 0, 40, made)
    first = [is_in for is_in in range(40) if k.is_threatened(made, *states[is_in, :3], times[is_in])]
    assert later[0] == (times[first[0]] if first else math.inf)
    sooner = sum(k.is_threatened(made, *row[:3], time - 5.0) for row, time in zip(states, times, strict=True))
    assert sooner <= len(first)


@pytest.mark.compiled
@given(st.integers(0, 10_000), st.booleans())
@settings(max_examples=60, deadline=None)
def test_no_line_of_sight_that_counts_is_left_out(seed, in_space):
    rng = np.random.default_rng(seed)
    tracks = [
        track(*rng.uniform(0.0, 2000.0, 2), speed=rng.uniform(0.0, 30.0), radius=rng.uniform(50.0, 600.0))
        for _ in range(rng.integers(1, 4))
    ]
    made = game(*tracks, obstacles=[WALL], plane_up=None if in_space else 100.0)
    all_lines = made._replace(least=np.full_like(made.least, -math.inf), lowest=-math.inf)
    for x, y, up, time in rng.uniform(0.0, (2000.0, 2000.0, 150.0, 90.0), (100, 4)):
        z = up if in_space else 100.0
        assert k.is_threatened(made, x, y, z, time) == k.is_threatened(all_lines, x, y, z, time)


def test_lines_of_sight_lead_where_a_dt_can_be_in_time():
    made = game(track(500.0, 1000.0, speed=10.0))
    # Within 310 m of where it was, so under bearings of 180 degrees and up to asin(310 / 500) = 38 aside.
    first, wide = k._bearings_to(made, 0, 1000.0, 1000.0, 450.0, 30.0)
    assert 180.0 - 60.0 < math.degrees(first % (2.0 * math.pi)) < 180.0 - 38.0
    assert 2.0 * 38.0 < math.degrees(wide) < 2.0 * 60.0
    assert k._bearings_to(made, 0, 1000.0, 1000.0, 150.0, 30.0)[1] < 0.0
    assert k._bearings_to(made, 0, 1000.0, 1000.0, 450.0, 60.0)[1] >= 2.0 * math.pi


def test_the_heap_gives_back_the_least_first():
    rng = np.random.default_rng(1)
    keys, values, size = np.empty(200), np.empty(200, dtype=np.int64), 0
    given_keys = rng.random(150)
    for number, key in enumerate(given_keys):
        size = k.push(keys, values, size, key, number)
    taken = []
    while size:
        taken.append(values[0])
        size = k.pop_least(keys, values, size)
    assert taken == list(np.argsort(given_keys))

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import mission_from_text
from tests.games.generator import CLEAR_M, KINDS, random_game
from tests.games.hunt import hunted_s, is_game
from tests.games.oracle import (
    FINE_M,
    SLACK_S,
    SPACING_M,
    Game,
    arrival,
    first_threatened_s,
    game_of,
    seconds_under_threat,
    solve,
    threatened_at,
    threatened_from,
)

pytestmark = pytest.mark.compiled

WALL = np.array([(1000.0, 0.0), (1050.0, 0.0), (1050.0, 1200.0), (1000.0, 1200.0)])
LATE_S = 0.05  # C is found by steps down to a metre of a pursuer of 20 m/s
SEEDS = st.integers(0, 100_000)


def game(*polygons, pursuer=(500.0, 500.0), speed=20.0, reach=250.0, **changes):
    """Two kilometres square; from the south west to the north east."""
    values = {"start": (1500.0, 300.0, 0.0), "goal": (1500.0, 1700.0, 60.0)} | changes
    return Game((0.0, 2000.0, 0.0, 2000.0), polygons=polygons, pursuer=pursuer, pursuer_m_s=speed,
                reach_m=reach, **values)  # fmt: skip


def walked(*points, speed=20.0):
    """Seconds along a polyline."""
    return sum(map(math.dist, points[:-1], points[1:])) / speed


@pytest.fixture(scope="module")
def walled():
    return game(WALL)


def test_in_the_open_the_pursuer_drives_straight():
    field = arrival(game())
    for place in ((500.0, 500.0), (0.0, 0.0), (1975.0, 25.0), (900.0, 2000.0)):
        assert field.nearest(*place) == pytest.approx(math.dist(place, (500.0, 500.0)) / 20.0, rel=0.02)


def test_behind_a_wall_it_comes_by_the_corners(walled):
    field = arrival(walled)
    assert field.nearest(500.0, 1800.0) == pytest.approx(1300.0 / 20.0)
    by_both = walked((500.0, 500.0), (1000.0, 1200.0), (1050.0, 1200.0), (1200.0, 500.0))
    assert field.nearest(1200.0, 500.0) == pytest.approx(by_both, abs=1e-3)
    by_one = walked((500.0, 500.0), (1000.0, 1200.0), (1200.0, 1300.0))
    assert field.nearest(1200.0, 1300.0) == pytest.approx(by_one, abs=1e-3)


def test_no_way_leads_through_a_wall_or_past_its_end_on_the_bounds(walled):
    assert arrival(walled).nearest(1025.0, 600.0) == math.inf
    assert arrival(walled).nearest(1200.0, 0.0) > 1200.0 / 20.0


def test_walls_that_touch_leave_no_gap():
    upper = WALL + np.array((0.0, 800.0))
    assert arrival(game(WALL, upper)).nearest(1500.0, 1200.0) == math.inf


def test_in_the_open_it_threatens_from_as_far_as_it_reaches():
    open_field = game()
    places = np.array([(500.0, 1500.0), (1503.0, 507.0), (600.0, 600.0)])
    worked = np.maximum(np.hypot(*(places - 500.0).T) - 250.0, 0.0) / 20.0
    caught = threatened_at(open_field, places)
    assert np.all(caught >= worked - 1e-9)
    assert np.all(caught <= worked + LATE_S)
    assert threatened_from(open_field).nearest(500.0, 1500.0) == caught[0]


def test_a_wall_masks(walled):
    behind, beside = (1100.0, 500.0), (1100.0, 1250.0)
    caught = threatened_at(walled, np.array([behind, beside]))
    # Behind the wall it comes round both corners and straight on, until it is in reach.
    corners = [(500.0, 500.0), (1000.0, 1200.0), (1050.0, 1200.0)]
    assert caught[0] == pytest.approx(walked(*corners, behind) - 250.0 / 20.0, abs=LATE_S)
    assert caught[0] > threatened_at(game(), np.array([behind]))[0] + 40.0
    # The other place is seen past the near corner from a line of slope 1 : 2, in reach on its last 250 m.
    on_the_line = np.array(beside) - 250.0 * np.array([2.0, 1.0]) / math.sqrt(5.0)
    assert caught[1] == pytest.approx(walked((500.0, 500.0), on_the_line), abs=LATE_S)


def test_the_grid_of_C_is_C(walled):
    field = threatened_from(walled)
    places = [(0.0, 0.0), (1975.0, 2000.0), (1150.0, 600.0)]
    assert [field.nearest(*place) for place in places] == list(threatened_at(walled, np.array(places)))
    assert field.spacing_m == SPACING_M
    assert field.values.shape == (81, 81)


def turn_radii(rows):
    """Radii of the circles through three places in a row."""
    one, two, three = rows[:-2, 1:], rows[1:-1, 1:], rows[2:, 1:]
    sides = [np.hypot(*(a - b).T) for a, b in ((one, two), (two, three), (three, one))]
    ahead, aside = two - one, three - one
    area = np.abs(ahead[:, 0] * aside[:, 1] - ahead[:, 1] * aside[:, 0]) / 2.0
    return np.prod(sides, axis=0) / np.maximum(4.0 * area, 1e-9)


def check_way(rows, played, speed):
    """What every way keeps to."""
    lengths = np.hypot(*np.diff(rows[:, 1:], axis=0).T)
    mid = np.diff(rows[:, 0]) * speed
    assert np.all(lengths <= mid + 1e-6) or speed > played.cruise_m_s
    assert turn_radii(rows).min() >= played.turn_radius_m - 1e-3
    first = rows[1, 1:] - rows[0, 1:]
    off = math.remainder(math.atan2(*first) - played.start[2], 2.0 * math.pi)
    assert abs(off) <= math.radians(15.0)
    assert tuple(rows[0]) == (0.0, *played.start[:2])
    assert math.dist(rows[-1, 1:], played.goal[:2]) <= played.goal[2]
    assert played.walls.distance(shapely.LineString(rows[:, 1:])) >= 30.0 - 0.2  # between places
    late = rows + np.array((SLACK_S, 0.0, 0.0))
    assert first_threatened_s(late, played) == math.inf


def test_the_aircraft_goes_round_by_the_other_side():
    # An island on the way, the pursuer west of it; eastward it masks long enough.
    island = np.array([(1350.0, 800.0), (1650.0, 800.0), (1650.0, 1200.0), (1350.0, 1200.0)])
    played = game(island, pursuer=(600.0, 1000.0), speed=12.0, start=(1450.0, 200.0, 0.0),
                  goal=(1450.0, 1800.0, 60.0))  # fmt: skip
    shortest = played.shortest
    assert shortest[:, 1].min() < 1350.0
    assert first_threatened_s(shortest, played) < math.inf
    rows = solve(played, 25.0)
    check_way(rows, played, 25.0)
    assert rows[:, 1].max() > 1650.0
    assert rows[-1, 0] >= shortest[-1, 0]


def test_a_faster_flight_gathers_speed():
    rows = solve(game(pursuer=(50.0, 50.0)), 33.75)
    speeds = np.hypot(*np.diff(rows[:, 1:], axis=0).T) / np.diff(rows[:, 0])
    middle_s = (rows[:-1, 0] + rows[1:, 0]) / 2.0
    assert speeds == pytest.approx(np.minimum(25.0 + 0.5 * middle_s, 33.75), rel=2e-3)


def test_where_it_is_everywhere_before_nothing_wins():
    assert solve(game(pursuer=(1500.0, 1000.0), speed=25.0), 25.0) is None
    assert solve(game(pursuer=(1500.0, 1000.0), speed=25.0), 25.0, slack_s=-math.inf) is not None


@pytest.mark.parametrize(
    ("kind", "seed", "speed"), [("route", 29, 25.0), pytest.param("speed", 20, 33.75, marks=pytest.mark.slow)]
)
def test_the_simulators_pursuer_catches_the_shortest_way_only(kind, seed, speed):
    mission = mission_from_text(random_game(seed, kind), "game.yaml")
    made = game_of(mission)
    assert is_game(kind, mission)
    assert hunted_s(solve(made, speed), mission) == 0.0


def test_when_a_flight_is_caught_first():
    # Flown south to north, 1 km beside a pursuer that is in reach after (1000 - 250) / 20 s = 37.5 s.
    times = np.arange(0.0, 80.0, 0.1)
    rows = np.column_stack([times, np.full(len(times), 1500.0), 500.0 + 0.001 * times])
    assert first_threatened_s(rows, game()) == pytest.approx(37.5, abs=LATE_S + 0.1)
    assert first_threatened_s(rows[:370], game()) == math.inf


def test_seconds_under_threat_by_hand():
    # At 10 m/s past a pursuer that stands 60 m aside: in reach of 100 m for 2 * 80 m.
    times = np.arange(0.0, 60.0, 0.1)
    path = np.column_stack([times, 10.0 * times, np.full(len(times), 60.0), np.full(len(times), 900.0)])
    threat = [(0.0, 300.0, 0.0), (60.0, 300.0, 0.0)]
    assert seconds_under_threat(path, threat, (), 100.0) == pytest.approx(16.0, abs=0.11)
    # A wall hides what is west of the pursuer, as seen past its end 30 m north of it.
    wall = [(290.0, -10.0), (300.0 - 1e-6, -10.0), (300.0 - 1e-6, 200.0), (290.0, 200.0)]
    assert seconds_under_threat(path, threat, (wall,), 100.0) == pytest.approx(8.0, abs=0.21)


@settings(max_examples=12)
@given(seed=SEEDS, kind=st.sampled_from(KINDS))
def test_generated_games_are_fair(seed, kind):
    text = random_game(seed, kind)
    assert text == random_game(seed, kind)
    mission = mission_from_text(text, "game.yaml")
    made = game_of(mission)
    shapes = [shapely.Polygon(corners) for corners in made.polygons]
    assert all(shape.is_valid and shape.area > 0.0 for shape in shapes)
    west, east, south, north = made.bounds_m
    assert all(shapely.box(west, south, east, north).covers(shape) for shape in shapes)
    x, y, course = made.start
    ahead = (x + 300.0 * math.sin(course), y + 300.0 * math.cos(course))
    assert made.walls.distance(shapely.LineString([(x, y), ahead])) >= CLEAR_M
    assert made.walls.distance(shapely.Point(made.goal[:2])) >= CLEAR_M
    assert made.walls.distance(shapely.Point(made.pursuer)) > 0.0
    assert threatened_at(made, np.array([made.start[:2]]))[0] > 0.0


@settings(max_examples=15)
@given(seed=SEEDS, places=st.lists(st.tuples(st.floats(0, 3000), st.floats(0, 3000)), min_size=1, max_size=8))
def test_C_agrees_with_shapely(seed, places):
    """Of each place C is the T of a place in reach and in sight, and none such has a lower one."""
    made = game_of(mission_from_text(random_game(seed % 7, "route"), "game.yaml"))
    fine = made.fine_arrival
    columns, rows = np.meshgrid(*(FINE_M * np.arange(size) for size in fine.values.shape), indexing="ij")
    for place, caught in zip(places, threatened_at(made, np.array(places)), strict=True):
        is_near = np.hypot(columns - place[0], rows - place[1]) <= made.reach_m
        seen_from = np.column_stack([columns[is_near], rows[is_near]])
        lines = shapely.linestrings(np.stack([seen_from, np.broadcast_to(place, seen_from.shape)], axis=1))
        is_clear = ~shapely.intersects(made.walls, lines)
        least = fine.values[is_near][is_clear].min(initial=math.inf)
        assert caught <= least
        # Corners and the start, of which the grid has none, may see it earlier.
        assert caught >= least - 3.0 or least == math.inf

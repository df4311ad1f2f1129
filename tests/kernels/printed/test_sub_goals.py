"""Sub-goal costs (4)–(6) by hand, and the distance field against Dijkstra."""

import math

import numpy as np
import pytest
from scipy.sparse import lil_matrix
from scipy.sparse.csgraph import dijkstra

from companion.kernels.arrays import DistanceField, Threats, empty_pursuers
from companion.kernels.geometry.distance_field import fill_distance_field
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.printed import sub_goals as sg
from companion.types.threat import Radar
from companion.world.threats import packed_threats
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.paths import box
from tests.support.worlds import packed, scene_of

BOUNDS = (-1000.0, 1000.0, -1000.0, 1000.0, 0.0, 300.0)
LIMITS = VehicleModel().limits(2, BOUNDS, 15.0, 1.0)
SPACE = VehicleModel().limits(3, BOUNDS, 15.0, 1.0)
END = np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0])
GOAL = np.array([900.0, 0.0, 100.0])
GAMMA, WEIGHTS = np.array([0.3, 0.2, 0.3, 0.2]), np.array([0.7, 0.0, 0.3])
EMPTY = packed([], BOUNDS)
NO_RADARS = packed_threats([], EMPTY, BOUNDS)
CIRCLE = [(500.0 * math.cos(a), 500.0 * math.sin(a), 100.0) for a in np.radians([0.0, 90.0, 180.0, 270.0])]


def scored(points, *, obstacles=EMPTY, threats=NO_RADARS, dts=(), elapsed=0.0, limits=LIMITS, level_max=0.5,
           weights=WEIGHTS, goal=GOAL, end=END):  # fmt: skip
    points = np.array(points, dtype=float)
    candidates = sg.Candidates(points, np.empty(len(points)), np.empty(len(points), dtype=np.int64))
    movers = np.array(dts, dtype=float).reshape(-1, 5)  # x y z, speed, RD_max
    models = np.column_stack([movers[:, 3:], np.zeros((len(movers), 3))])
    pursuers = empty_pursuers(1, models, np.array(BOUNDS))
    pursuers.position[:, 0] = movers[:, :3]
    scene = scene_of(limits, obstacles=obstacles, threats=threats, pursuers=pursuers)
    sg.score(candidates, end, goal, elapsed, sg.SubGoalWeights(GAMMA, weights, level_max), scene)
    return candidates.costs, candidates.reasons


def test_costs_by_hand_without_anything_in_the_way():
    # East: 0.3·0.7·500/25 + 0.2·0.7·400/25 = 4.2 + 2.24. North: 4.2 + 0.14·√(500² + 900²)/25.
    costs, reasons = scored(CIRCLE)
    assert costs[0] == pytest.approx(6.44)
    assert costs[1] == pytest.approx(4.2 + 0.14 * math.hypot(500.0, 900.0) / 25.0)
    assert costs[2] == pytest.approx(4.2 + 0.14 * 1400.0 / 25.0)
    assert (reasons == sg.FREE).all()


def test_a_box_in_the_way_costs_its_width():
    # 40 m wide across the line to the east point, 120 m high: 0.3·(0.7·500 + 0.3·40)/25 more.
    world = packed([box("b", 200.0, -20.0, 210.0, 20.0, 0.0, 120.0)], BOUNDS)
    costs, _ = scored(CIRCLE, obstacles=world)
    assert costs[0] == pytest.approx(6.44 + 0.3 * 0.3 * 40.0 / 25.0)
    heights = np.array([0.7, 0.15, 0.15])
    costs, _ = scored(CIRCLE, obstacles=world, weights=heights)
    assert costs[0] == pytest.approx(6.44 + 0.3 * (0.15 * 120.0 + 0.15 * 40.0) / 25.0)


def test_radars_crossed_cost_their_mean_radius():
    # Two radars reach the line to the east, of 200 and 300 m, one of 100 m does not: 0.3·(200 + 300)/25/2.
    radars = [
        Radar("a", (250.0, 150.0, 0.0), 200.0),
        Radar("b", (400.0, -250.0, 0.0), 300.0),
        Radar("c", (250.0, 400.0, 0.0), 100.0),
    ]
    threats = packed_threats(radars, EMPTY, BOUNDS)
    costs, _ = scored(CIRCLE, threats=threats)
    assert costs[0] == pytest.approx(6.44 + 0.3 * (200.0 + 300.0) / 25.0 / 2.0)
    unknown: Threats = threats._replace(known=np.array([1, 0, 1]))
    assert scored(CIRCLE, threats=unknown)[0][0] == pytest.approx(6.44 + 0.3 * 200.0 / 25.0)


def test_a_moving_threat_costs_by_how_far_it_gets():
    # 20 m/s over 30 s flown and 500/25 s to fly: √(20·50/25) = √40; weight 0.2. The farthest counts.
    near, slower = (250.0, 100.0, 0.0, 20.0, 150.0), (250.0, -100.0, 0.0, 5.0, 150.0)
    costs, _ = scored(CIRCLE, dts=[near, slower], elapsed=30.0)
    assert costs[0] == pytest.approx(6.44 + 0.2 * math.sqrt(40.0))
    away = (250.0, 151.0, 0.0, 20.0, 150.0)
    assert scored(CIRCLE, dts=[away], elapsed=30.0)[0][0] == pytest.approx(6.44)


def test_why_points_are_removed():
    walls = packed([box("b", 490.0, -20.0, 520.0, 20.0), box("n", -200.0, 250.0, 200.0, 260.0)], BOUNDS)
    _, reasons = scored(CIRCLE, obstacles=walls)
    assert reasons[0] == sg.OCCUPIED
    assert list(reasons[2:]) == [sg.FREE, sg.FREE]
    narrow = LIMITS._replace(bounds=np.array([-1000.0, 1000.0, -400.0, 1000.0, 0.0, 300.0]))
    assert list(scored(CIRCLE, limits=narrow)[1]) == [sg.FREE, sg.FREE, sg.FREE, sg.CONSTRAINED]


def test_a_point_behind_a_closed_wall_is_removed():
    # From north −600 to 600 there is no way inside the horizon of 500 m to its eastern point.
    closed = packed([box("w", 200.0, -600.0, 220.0, 600.0)], BOUNDS)
    _, reasons = scored(CIRCLE, obstacles=closed)
    assert list(reasons) == [sg.CONSTRAINED, sg.FREE, sg.FREE, sg.FREE]


def test_a_point_at_high_risk_is_removed_with_that_reason():
    # 50 m beside a radar: μ ≈ 1, CF = 1 − 1/1.7 = 0.41; flown at the cruise speed of 25 m/s, towards it.
    threats = packed_threats([Radar("a", (550.0, 0.0, 100.0), 400.0)], EMPTY, BOUNDS)
    assert scored(CIRCLE, threats=threats, level_max=0.35)[1][0] == sg.HIGH_RISK
    assert scored(CIRCLE, threats=threats, level_max=0.5)[1][0] == sg.FREE


def test_climb_angles_to_and_from_a_point():
    # 500 m away: 10° is 88 m (flat 492.4 m, up 86.8 m). Goal at 100 m: from the point it has to be within
    # 0.8·tan... of the climb angle (8°).
    points = [(math.sqrt(500.0**2 - up**2), 0.0, 100.0 + up) for up in (0.0, 80.0, 90.0, -80.0, -90.0)]
    _, reasons = scored(points, limits=SPACE)
    assert list(reasons) == [sg.FREE, sg.CONSTRAINED, sg.CONSTRAINED, sg.CONSTRAINED, sg.CONSTRAINED]
    far = np.array([1900.0, 0.0, 100.0])
    _, reasons = scored(points, limits=SPACE, goal=far)
    assert list(reasons) == [sg.FREE, sg.FREE, sg.CONSTRAINED, sg.FREE, sg.CONSTRAINED]


@pytest.mark.parametrize(
    ("above", "flat", "fine"),
    [
        (0.0, 10.0, True),
        (70.0, 500.0, True),
        (71.0, 500.0, False),
        (-70.0, 500.0, True),
        (-71.0, 500.0, False),
    ],
)
def test_on_the_way_by_hand(above, flat, fine):
    # 500·tan(8°) = 70.27 m.
    assert sg.is_on_the_way(above, flat, SPACE) is fine
    assert sg.is_on_the_way(above, flat, LIMITS) is True


def test_the_distance_field_agrees_with_dijkstra():
    world = packed([box("a", 100.0, -250.0, 140.0, 300.0), box("b", -300.0, 120.0, 60.0, 150.0)], BOUNDS)
    n, radius, margin = 33, 400.0, 15.0
    cell = 2.0 * radius / (n - 1)
    distances = DistanceField(np.empty((n, n)), np.array([-radius, -radius]), cell, 0.0, 0.0)
    fill_distance_field(np.array([0.0, 0.0, 100.0]), radius, margin, np.array(BOUNDS), world, distances)
    field = distances.field
    centre = np.arange(n) * cell - radius
    free = np.array(
        [
            [
                math.hypot(x, y) <= radius + cell and clearance(x, y, 100.0, world, 1e4) >= margin
                for y in centre
            ]
            for x in centre
        ]
    )
    graph = lil_matrix((n * n, n * n))
    for i, j in zip(*np.nonzero(free), strict=True):
        for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
            a, b = i + di, j + dj
            if 0 <= a < n and 0 <= b < n and free[a, b]:
                graph[i * n + j, a * n + b] = cell * math.hypot(di, dj)
    expected = dijkstra(graph.tocsr(), directed=False, indices=(n // 2) * n + n // 2).reshape(n, n)
    assert field == pytest.approx(expected)
    assert np.isinf(field[free == 0]).all()
    assert field[np.isfinite(field)].max() > 1.3 * radius  # there was something to go round

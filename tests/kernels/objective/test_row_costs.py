"""The objective J, term by term, worked by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.kernels.arrays import Ground
from companion.kernels.objective.row_costs import (
    Objective,
    Prices,
    exposure,
    pursuit_danger,
    row_cost,
    rows_cost,
)
from companion.kernels.workspace import PathRows
from companion.types.threat import Obstacle, Radar
from companion.world.obstacles import packed_obstacles
from companion.world.pursuer_trees import threat_trees
from companion.world.pursuit import pursuit_game
from companion.world.threats import packed_threats
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.worlds import track

BOUNDS = (0.0, 2000.0, 0.0, 2000.0, 0.0, 300.0)
FREE = {
    "seen": 0.0,
    "pursued": 0.0,
    "near": 0.0,
    "energy": 0.0,
    "collision": 0.0,
    "wanted": 0.0,
    "cruise": 25.0,
}
BOX = Obstacle(
    "box", np.array([[900.0, 900.0], [1100.0, 900.0], [1100.0, 1100.0], [900.0, 1100.0]]), 0.0, 300.0
)
RADARS = [Radar("one", (1000.0, 500.0, 0.0), 400.0), Radar("two", (1200.0, 500.0, 0.0), 400.0)]


def objective(*, obstacles=(), radars=(), tracks=(), slack=3.0, deviation=2.0, **prices):
    packed = packed_obstacles(obstacles, BOUNDS)
    return Objective(
        prices=Prices(**FREE | prices),
        obstacles=packed,
        threats=packed_threats(radars, packed, BOUNDS),
        game=pursuit_game(tracks, packed, None, BOUNDS, slack),
        pursuers=threat_trees(tracks, packed, None, BOUNDS, ()),
        limits=VehicleModel().limits(3, BOUNDS, 15.0, 1.0),
        deviations=np.array([deviation]),
        start=0.0,
    )


def state(east, north, *, up=100.0, v=25.0):
    return np.array([east, north, up, 0.0, 0.0, v])


def test_a_second_costs_a_second_where_nothing_is_wrong():
    assert row_cost(state(100.0, 100.0), 5.0, 1.5, 0.0, objective(seen=3.0, near=3.0, energy=1.0)) == 1.5


def test_two_radars_are_one_less_the_product_of_what_each_leaves():
    """(1): μ = exp(-(R/400)^4) at the slant ranges to both, 100 m up between them."""
    slant = math.hypot(100.0, 100.0)
    mu = math.exp(-((slant / 400.0) ** 4))
    there = objective(radars=RADARS, seen=3.0)
    assert exposure(1100.0, 500.0, 100.0, there.threats) == pytest.approx(1.0 - (1.0 - mu) ** 2, rel=1e-12)
    expected = 2.0 * (1.0 + 3.0 * (1.0 - (1.0 - mu) ** 2))
    assert row_cost(state(1100.0, 500.0), 0.0, 2.0, 0.0, there) == pytest.approx(expected, rel=1e-12)


def test_a_radar_that_is_not_known_or_that_is_hidden_counts_for_nothing():
    there = objective(obstacles=[BOX], radars=RADARS[:1])
    assert exposure(1000.0, 800.0, 100.0, there.threats) > 0.5
    assert exposure(1000.0, 880.0, 100.0, there.threats) > 0.3
    assert (
        exposure(1000.0, 1150.0, 100.0, objective(radars=[Radar("far", (1000.0, 500.0, 0.0), 900.0)]).threats)
        > 0.5
    )
    hidden = objective(obstacles=[BOX], radars=[Radar("far", (1000.0, 500.0, 0.0), 900.0)])
    assert exposure(1000.0, 1150.0, 100.0, hidden.threats) == 0.0
    unknown = there.threats._replace(known=np.zeros(1, dtype=np.int64))
    assert exposure(1000.0, 800.0, 100.0, unknown) == 0.0


def test_just_below_a_radar_s_sight_a_tenth_counts():
    """(1): 500 m away the boundary is 0.0001 · 500² = 25 m up; heights are held within 5 m."""
    radar = Radar("low", (1000.0, 500.0, 0.0), 900.0, boundary_coefficient_per_m=0.0001)
    threats = objective(radars=[radar]).threats

    def mu(up):
        return math.exp(-((math.hypot(500.0, up) / 900.0) ** 4))

    for up, expected in ((26.0, mu(26.0)), (22.0, 0.1 * mu(22.0)), (19.0, 0.0)):
        assert exposure(1000.0, 1000.0, up, threats) == pytest.approx(expected, rel=1e-12)


def test_what_of_the_wanted_clearance_is_lacking_is_paid_for():
    """30 m from the box with 60 m wanted: half is lacking."""
    there = objective(obstacles=[BOX], near=3.0, wanted=60.0)
    assert row_cost(state(870.0, 1000.0), 0.0, 1.0, 0.0, there) == pytest.approx(2.5)
    assert row_cost(state(840.0, 1000.0), 0.0, 1.0, 0.0, there) == pytest.approx(1.0)


def test_height_over_ground_is_lacking_below_the_wanted_height_and_no_clearance_is():
    """60 m over the ground are the least, 80 m are wanted: at 70 m half of the 20 m is lacking."""
    level = np.array([[200.0]], dtype=np.float32)
    ground = Ground(level, level, np.array([0.0, 0.0, 2000.0]), 60.0, 80.0, 500.0, 1.0)
    over = packed_obstacles([BOX], BOUNDS)._replace(ground=ground)
    there = objective(near=3.0, wanted=60.0)._replace(obstacles=over)
    for up, lacking in ((280.0, 0.0), (270.0, 0.5), (260.0, 1.0)):
        assert row_cost(state(100.0, 100.0, up=up), 0.0, 1.0, 0.0, there) == pytest.approx(
            1.0 + 3.0 * lacking
        )
    # 30 m from the box half of the clearance is lacking, too: the larger of both counts.
    assert row_cost(state(870.0, 1000.0, up=270.0), 0.0, 1.0, 0.0, there) == pytest.approx(2.5)
    assert row_cost(state(870.0, 1000.0, up=260.0), 0.0, 1.0, 0.0, there) == pytest.approx(4.0)


def test_power_grows_with_the_cube_of_the_airspeed():
    there = objective(energy=1.0)
    assert row_cost(state(0.0, 0.0, v=50.0), 0.0, 1.0, 0.0, there) == pytest.approx(1.0 + 8.0 - 1.0)
    assert row_cost(state(0.0, 0.0, v=20.0), 0.0, 1.0, 0.0, there) == 1.0


def test_a_row_pays_for_its_probability_of_a_collision():
    """In space p_c = erf(c/√2) − c·√(2/π)·exp(−c²/2), at two deviations 0.7385."""
    there = objective(obstacles=[BOX], collision=20.0, deviation=10.0)
    p_c = math.erf(math.sqrt(2.0)) - 2.0 * math.sqrt(2.0 / math.pi) * math.exp(-2.0)
    expected = 1.0 - 20.0 * math.log(p_c)
    assert row_cost(state(880.0, 1000.0), 0.0, 1.0, 0.0, there) == pytest.approx(expected, rel=1e-9)


def test_danger_rises_as_the_slack_before_a_pursuer_runs_out():
    """It drives 20 m/s and reaches 200 m: 800 m away the point is threatened from 30 s on, a cell sooner."""
    there = objective(tracks=[track(200.0, 1000.0, speed=20.0, radius=200.0)], pursued=3.0)
    assert pursuit_danger(1000.0, 1000.0, 0.0, 20.0, there) == 0.0
    assert 0.0 < pursuit_danger(1000.0, 1000.0, 0.0, 28.0, there) < 1.0
    assert pursuit_danger(1000.0, 1000.0, 0.0, 31.0, there) == 1.0
    assert row_cost(state(1000.0, 1000.0, up=0.0), 31.0, 1.0, 0.5, there) == pytest.approx(2.5)


def test_a_path_costs_what_its_rows_cost():
    there = objective(radars=RADARS, seen=3.0)
    states = np.array([state(900.0 + 25.0 * k, 500.0) for k in range(9)])
    rows = PathRows(states, np.arange(9.0), np.zeros((9, 2)))
    each = sum(row_cost(states[k], float(k), 1.0, 0.0, there) for k in range(1, 9))
    assert rows_cost(rows, 0, 9, there) == pytest.approx(each, rel=1e-12)
    assert rows_cost(rows, 1, 5, there) + rows_cost(rows, 5, 9, there) == pytest.approx(each, rel=1e-12)


def test_well_clear_of_an_aircraft_that_flies_on_by_hand():
    """It flies north at 50 m/s, known to 10 m and 1 m/s: after 20 s it is 1000 m on, to 22.4 m."""
    passing = replace(
        track(1000.0, 0.0, velocity=(0.0, 50.0), airborne=True, up=100.0), flies_on=True,
        max_threat_radius_m=600.0, covariance=np.diag([100.0, 1.0, 100.0, 1.0]),
    )  # fmt: skip
    there = objective(tracks=[passing])

    def danger(beside, above=0.0, at=20.0):
        return pursuit_danger(1000.0 + beside, 50.0 * at, 100.0 + above, at, there)

    spread = math.hypot(10.0, 20.0)
    assert danger(0.0) == 7.0
    assert danger(600.0 + spread + 0.1) == pytest.approx(1.0, abs=1e-3)
    assert danger(600.0 + spread - 0.1) == pytest.approx(3.0, abs=1e-3)
    assert danger(0.5 * (600.0 + spread)) == pytest.approx(5.0)
    assert danger(0.0, 0.75 * 80.2) == pytest.approx(4.0)
    assert danger(600.0 + spread + 75.0) == pytest.approx(0.5)  # of a margin of 150 m
    assert danger(600.0 + spread + 151.0) == 0.0
    assert danger(600.0 + spread, at=1.0) < 1.0  # it is surer of what comes sooner,
    farthest = 600.0 + math.hypot(10.0, 30.0)  # and no less sure after 30 s.
    assert danger(farthest + 0.1, at=39.0) == pytest.approx(1.0, abs=1e-3)
    assert danger(0.0, 76.2 + 4.01) == pytest.approx(1.0, abs=1e-3)  # 250 ft, and the height's 4 m
    assert danger(0.0, 76.2 + 4.0 + 7.5) == pytest.approx(0.5)  # of a margin of 15 m
    assert danger(0.0, -100.0) == 0.0


def test_an_aircraft_that_climbs_may_level_off_and_one_that_turns_may_fly_straight():
    climbs = replace(track(1000.0, 0.0, velocity=(0.0, 50.0), airborne=True, up=100.0), flies_on=True)
    climbs = replace(climbs, velocity_enu_m_s=(0.0, 50.0, 4.0))  # 80 m in 20 s, 20 m of them unsure
    there = objective(tracks=[climbs])
    above = 180.0 + 76.2 + math.hypot(4.0, 20.0)
    assert pursuit_danger(1000.0, 1000.0, above + 0.01, 20.0, there) == pytest.approx(1.0, abs=1e-3)
    assert pursuit_danger(1000.0, 1000.0, above + 16.0, 20.0, there) == 0.0
    turns = replace(climbs, velocity_enu_m_s=(0.0, 50.0, 0.0), turn_rate_rad_s=-math.radians(3.0))
    there = objective(tracks=[turns])
    east, north, _ = turns.places_enu_m(np.array([20.0]))[0]
    assert math.hypot(east - 1000.0, north - 1000.0) > 500.0
    assert pursuit_danger(east, north, 100.0, 20.0, there) == pytest.approx(7.0)
    assert pursuit_danger(1000.0, 1000.0, 100.0, 20.0, there) > 6.5


def test_an_aircraft_that_says_where_it_flies_next_may_fly_straight_unless_it_keeps_its_route():
    """North at 50 m/s; its route leads east. After 20 s it is 1000 m north or east of where it was."""
    route = np.array([[0.0, 1000.0, 0.0, 100.0], [20.0, 2000.0, 0.0, 100.0], [21.0, 2050.0, 0.0, 100.0]])
    says = replace(
        track(1000.0, 0.0, velocity=(0.0, 50.0), airborne=True, up=100.0), flies_on=True,
        max_threat_radius_m=600.0, covariance=np.diag([100.0, 1.0, 100.0, 1.0]), route=route,
    )  # fmt: skip
    there = objective(tracks=[says])
    assert pursuit_danger(2000.0, 0.0, 100.0, 20.0, there) == 7.0
    assert pursuit_danger(1000.0, 1000.0, 100.0, 20.0, there) == 7.0
    there = objective(tracks=[replace(says, keeps_route=True, clear_up_m=30.0, height_std_m=5.0)])
    assert pursuit_danger(2000.0, 0.0, 100.0, 20.0, there) == 100.0  # no search passes through it
    assert pursuit_danger(1000.0, 1000.0, 100.0, 20.0, there) == 0.0
    just_above = pursuit_danger(2000.0, 0.0, 100.0 + 35.01, 20.0, there)  # 30 m and 5 m
    assert just_above == pytest.approx(1.0, abs=1e-3)
    assert pursuit_danger(2000.0, 0.0, 100.0 + 56.0, 20.0, there) == 0.0


def test_the_lists_of_aircraft_near_a_cell_leave_nobody_out():
    """Beside the same trees with one cell that lists everybody; places inside the world and beyond it."""
    rng = np.random.default_rng(4)
    endangered = 0
    for _ in range(20):
        flying = []
        for number in range(3):
            places = rng.uniform((0.0, 0.0, 50.0), (3000.0, 3000.0, 250.0), (4, 3))
            route = np.column_stack([np.cumsum(rng.uniform(5.0, 40.0, 4)), places])
            route = np.vstack([route, route[-1] + (1.0, 0.0, 0.0, 0.0)])
            begins = track(*places[0, :2], airborne=True, up=places[0, 2], stamp=float(route[0, 0]))
            passes = replace(begins, flies_on=True, max_threat_radius_m=150.0, clear_up_m=30.0)
            circles = {"circle_m": 100.0, "circles_from_s": float(route[-2, 0])}
            flying.append(replace(passes, route=route, keeps_route=number < 2, **circles))
        listed = objective(tracks=flying)
        everybody = listed.pursuers.near._replace(
            columns=1, rows=1, bins=1, ends=np.array([0, 3]), listed=np.arange(3)
        )
        all_of_them = listed._replace(pursuers=listed.pursuers._replace(near=everybody))
        assert len(listed.pursuers.near.ends) > 100
        around = np.vstack([one.route[:, 1:] for one in flying])
        points = around[rng.integers(0, len(around), 200)]
        points = points + rng.uniform(-1.0, 1.0, (200, 3)) * (400.0, 400.0, 100.0)
        for (x, y, z), time in zip(points, rng.uniform(0.0, 250.0, 200), strict=True):
            danger = pursuit_danger(x, y, z, time, listed)
            assert danger == pursuit_danger(x, y, z, time, all_of_them)
            endangered += danger > 0.0
    assert endangered > 200


def test_an_aircraft_in_a_circle_may_be_anywhere_in_it():
    """It waits at (1000, 1000) in a circle of 100 m from 20 s on, and 150 m have to be kept from it."""
    route = np.array([[0.0, 1000.0, 1000.0, 100.0], [1.0, 1000.0, 1000.0, 100.0]])
    waits = replace(
        track(1000.0, 1000.0, velocity=(0.0, 0.0), airborne=True, up=100.0), flies_on=True, route=route,
        keeps_route=True, max_threat_radius_m=150.0, clear_up_m=30.0, height_std_m=0.0,
        covariance=np.zeros((4, 4)), circle_m=100.0, circles_from_s=20.0,
    )  # fmt: skip
    there = objective(tracks=[waits])
    assert pursuit_danger(1000.0, 1200.0, 100.0, 19.0, there) == pytest.approx(1.0 - 50.0 / 150.0)
    assert pursuit_danger(1000.0, 1250.1, 100.0, 21.0, there) == pytest.approx(1.0, abs=1e-3)
    assert pursuit_danger(1000.0, 1400.0, 100.0, 21.0, there) == 0.0

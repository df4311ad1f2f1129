"""Measures of a moving threat, by hand."""

import math

import numpy as np
import pytest

from companion.research.campaign.measures import pursuit_measures
from companion.types.plan import Measures, Plan, PlanStatus, SearchTrace
from companion.world.snapshot import first_snapshot
from tests.support.paths import box, path_of
from tests.support.worlds import track

BOUNDS = (-1000.0, 1000.0, -1000.0, 1000.0, 0.0, 300.0)


def measured(dt, seen, *, obstacles=(), circles=0):
    """Two waypoints 100 m apart along the north, 4 s; RD_max 200 m."""
    world = first_snapshot(dimension=2, unit_m=25.0, bounds=BOUNDS, obstacles=obstacles, radars=())
    world = world.with_tracks(0.0, [seen])
    path = path_of([0.0, 4.0], [(0.0, 0.0, 100.0), (0.0, 100.0, 100.0)], [0.0, 0.0])
    plan = Plan(
        PlanStatus.EXACT, path, Measures(), 1, "safe-rrt", 1,
        trace=SearchTrace(reach_circles_enu_m=np.zeros((circles, 3))),
    )  # fmt: skip
    return pursuit_measures(plan, path, world, 0, np.array(dt))


def test_a_threat_that_stands_by_hand():
    # 100 m east of the first waypoint, √2·100 m from the second: μ = exp(−(r/200)⁴) = exp(−1/16) = 0.93941
    # and exp(−4/16) = 0.77880. IFWA with weights ½: 1 − √(0.06059·0.22120) = 0.88424.
    seen = track(100.0, 0.0, speed=0.0, radius=200.0)
    made = measured([(0.0, 100.0, 0.0)], seen, circles=7)
    assert made.aggregated_threat == pytest.approx(0.88424, abs=1e-5)
    # Along the line at north 100·k/11: r² = 100² + north².
    total = sum(math.exp(-((1e4 + (100.0 * k / 11.0) ** 2) ** 2) / 200.0**4) for k in range(12))
    assert made.total_threat == pytest.approx(total)
    # It was expected where it stood.
    assert made.estimated_total_threat == pytest.approx(total)
    assert made.first_pursued_share == 0.0
    assert made.num_reachable == 7


def test_a_wall_hides_the_aircraft():
    seen = track(100.0, 0.0, speed=0.0, radius=200.0)
    made = measured([(0.0, 100.0, 0.0)], seen, obstacles=(box("wall", 40.0, -200.0, 60.0, 200.0),))
    assert (made.aggregated_threat, made.total_threat, made.estimated_total_threat) == (0.0, 0.0, 0.0)
    assert made.first_pursued_share == 1.0


def test_an_estimate_that_expects_the_worst_of_a_threat_that_drives_away():
    # It comes from 500 m east at 50 m/s: within 200 m of the first point after 6 s, of the second as well;
    # the path takes 4 s. From 350 m it needs 3 s for the point abreast of it.
    far = measured(
        [(0.0, 500.0, 0.0), (4.0, 700.0, 0.0)], track(500.0, 0.0, speed=50.0, velocity=(-50.0, 0.0))
    )
    assert far.estimated_total_threat == 0.0
    near = measured(
        [(0.0, 350.0, 0.0), (4.0, 550.0, 0.0)], track(350.0, 0.0, speed=50.0, velocity=(-50.0, 0.0))
    )
    assert near.total_threat == 0.0
    assert near.estimated_total_threat > 0.0
    assert 0.0 < near.first_pursued_share <= 1.0


def test_a_track_is_followed_in_time():
    # Passing from east to west at 100 m/s it is right below the aircraft (in the plane: at it) after 2 s.
    moved = measured([(0.0, 200.0, 50.0), (4.0, -200.0, 50.0)], track(200.0, 50.0, speed=100.0))
    expected = sum(
        math.exp(-(((100.0 * (2.0 - 4.0 * k / 11.0)) ** 2 + (50.0 - 100.0 * k / 11.0) ** 2) ** 2) / 200.0**4)
        for k in range(12)
        if math.hypot(100.0 * (2.0 - 4.0 * k / 11.0), 50.0 - 100.0 * k / 11.0) <= 200.0
    )
    assert moved.total_threat == pytest.approx(expected)

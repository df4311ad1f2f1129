"""The trees that are carried from plan to plan."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.types.threat import ThreatTree
from companion.world.pursuer_trees import grown_trees, restore_tree, threat_trees
from tests.support.paths import box
from tests.support.worlds import packed, track

BOUNDS = (-1000.0, 1000.0, -1000.0, 1000.0, 0.0, 300.0)
WALLS = packed([box("wall", 100.0, -50.0, 120.0, 50.0)], BOUNDS)


def test_a_vehicle_that_drove_and_stands_now_is_where_it_is():
    """Its speed is 0: the ways that were grown for it take for ever."""
    driving = track(0.0, 0.0, speed=20.0, velocity=(20.0, 0.0))
    grown = grown_trees(threat_trees([driving], WALLS, 100.0, BOUNDS), [driving])
    assert len(grown[0].time_s) > 2
    standing = replace(driving, speed_max_m_s=0.0, velocity_enu_m_s=(0.0, 0.0, 0.0), stamp_s=1.0)
    trees = threat_trees([standing], WALLS, 100.0, BOUNDS, grown)
    assert trees.count.tolist() == [1]
    assert trees.position[0, 0].tolist() == [0.0, 0.0, 100.0]
    again = replace(driving, stamp_s=2.0)
    trees = threat_trees([again], WALLS, 100.0, BOUNDS, grown_trees(trees, [standing]))
    assert trees.count[0] > 2


def test_of_a_tree_that_is_carried_the_earliest_half_of_what_has_room_comes_back():
    # A chain of 1000 nodes, a second apart, stored from its end to its root; there is room for 1500.
    driving = track(0.0, 0.0, speed=20.0)
    later = np.arange(1000.0)[::-1]
    chain = ThreatTree(
        driving.identity, driving.is_airborne, np.column_stack([later, 0.0 * later, 0.0 * later]),
        0.0 * later, np.append(np.arange(1, 1000), -1), later,
    )  # fmt: skip
    trees = threat_trees([driving], WALLS, 100.0, BOUNDS)
    restore_tree(trees, 0, chain)
    assert trees.count[0] == 750
    assert trees.time[0, :750].tolist() == later[250:].tolist()
    assert trees.position[0, :750, 0].tolist() == later[250:].tolist()
    assert trees.parent[0, :750].tolist() == [*range(1, 750), -1]


def test_an_aircraft_that_flies_on_is_foreseen_by_its_own_velocity():
    passing = replace(
        track(0.0, 0.0, velocity=(50.0, 10.0), airborne=True, up=150.0, stamp=5.0), flies_on=True,
        covariance=np.diag([9.0, 4.0, 16.0, 1.0]),
    )  # fmt: skip
    trees = threat_trees([passing], WALLS, 100.0, BOUNDS)
    assert trees.position[0, :2].tolist() == [[0.0, 0.0, 150.0], [50.0, 10.0, 150.0]]
    assert trees.time[0, :2].tolist() == [5.0, 6.0]
    assert trees.model[0, :10].tolist() == [20.0, 200.0, 4.0, 2.0, 2.0, 76.2, 4.0, 0.0, math.inf, 0.0]


def test_an_aircraft_that_turns_is_foreseen_to_turn_for_half_a_minute():
    """3°/s to the left at 50 m/s from north: after 30 s it flies west, 955 m (v/ω) further west and north."""
    rate = math.radians(3.0)
    turns = replace(
        track(0.0, 0.0, velocity=(0.0, 50.0), airborne=True, up=150.0, stamp=5.0), flies_on=True,
        turn_rate_rad_s=rate,
    )  # fmt: skip
    radius = 50.0 / rate
    expected = [[0.0, 0.0], [-radius, radius], [-radius - 500.0, radius]]
    assert turns.places_enu_m(np.array([5.0, 35.0, 45.0]))[:, :2] == pytest.approx(np.array(expected))
    trees = threat_trees([turns], WALLS, 100.0, BOUNDS)
    assert trees.count[0] == 32
    steps = np.diff(trees.position[0, :32], axis=0)
    assert np.hypot(*steps[:, :2].T) == pytest.approx(50.0, abs=0.02)  # The chord of a second is shorter.
    courses = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.diff(courses)[:-1] == pytest.approx(rate)
    assert courses[-1] == pytest.approx(math.pi)
    assert trees.position[0, :32, 2].tolist() == [150.0] * 32


def test_an_aircraft_on_a_route_is_foreseen_along_it_and_goes_on_as_at_its_end():
    """100 m east in 10 s and 60 m north in 3 s; the rows are a second apart."""
    route = np.array([[5.0, 0.0, 0.0, 150.0], [15.0, 100.0, 0.0, 150.0], [18.0, 100.0, 60.0, 180.0]])
    flies = replace(
        track(0.0, 0.0, velocity=(10.0, 0.0), airborne=True, up=150.0, stamp=5.0), flies_on=True, route=route
    )
    expected = [[0.0, 0.0, 150.0], [50.0, 0.0, 150.0], [100.0, 20.0, 160.0], [100.0, 100.0, 200.0]]
    assert flies.places_enu_m(np.array([4.0, 10.0, 16.0, 20.0])).tolist() == expected
    trees = threat_trees([flies], WALLS, 100.0, BOUNDS)
    assert trees.count[0] == 12
    assert trees.position[0, :12] == pytest.approx(flies.places_enu_m(5.0 + np.arange(12.0)))
    circles = replace(flies, route=np.vstack([route, [60.0, 100.0, 60.0, 180.0]]), keeps_route=True)
    assert circles.places_enu_m(np.array([1e4])).tolist() == [[100.0, 60.0, 180.0]]
    model = threat_trees([circles], WALLS, 100.0, BOUNDS).model[0]
    assert model[7:10].tolist() == [1.0, math.inf, 0.0]
    waits = replace(circles, circle_m=80.0, circles_from_s=18.0)
    assert threat_trees([waits], WALLS, 100.0, BOUNDS).model[0, 8:10].tolist() == [18.0, 80.0]

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.compose import world_of
from companion.kernels.geometry.radar_shadow import is_hidden
from companion.kernels.threat.fuzzy_threat import membership
from companion.world.threat_field import flight_height, sight_floor, threat_field
from tests.ui.reports.flights import mission, snapshot_of

ROOT = Path(__file__).parents[2]


def at(field, east_m, north_m):
    east, north, level = field
    return level[np.argmin(abs(north - north_m)), np.argmin(abs(east - east_m))]


def test_membership_by_hand_and_masking_by_the_wall():
    # Radar on the ground at (1400, 750), range 800 m; 120 m up, 400 m away: R = 417.6 m.
    field = threat_field(snapshot_of(mission()), 120.0, num_nodes=200)
    expected = math.exp(-((400.0**2 + 120.0**2) ** 2) / 800.0**4)
    assert at(field, 1400.0, 1150.0) == pytest.approx(expected, abs=0.01)
    assert at(field, 850.0, 750.0) == 0.0, "behind the wall, 300 m high"
    assert at(field, 500.0, 750.0) == 0.0, "out of range"


def test_two_radars_join_as_one_minus_the_product():
    config = mission()
    twice = config.model_copy(update={"radars": config.radars * 2})
    one, two = (at(threat_field(snapshot_of(c), 120.0, 50), 1400.0, 1150.0) for c in (config, twice))
    assert two == pytest.approx(1.0 - (1.0 - one) ** 2)


def test_the_shape_follows_the_bounds():
    east, north, level = threat_field(snapshot_of(mission(radars=False)), 120.0, num_nodes=40)
    assert level.shape == (len(north), len(east)) == (30, 40)
    assert not level.any()


def test_the_height_is_the_median_inside_the_bounds():
    world = snapshot_of(mission())
    assert flight_height(world, np.array([100.0, 110.0, 300.0]), 0.0) == 110.0
    assert flight_height(world, np.array([np.nan, 900.0]), 0.0) == 350.0
    assert flight_height(world, np.empty(0), 120.0) == 120.0


def test_it_is_what_the_planners_kernels_say():
    for name in ("paper-3d", "paper-2d"):
        world = world_of(load_mission(ROOT / "mission_configs" / f"{name}.yaml"), none_known=False)
        threats, height = world.threats, 0.5 * (world.bounds[4] + world.bounds[5])
        east, north, level = threat_field(world, height, 40)
        assert level.max() > 0.1
        for row, column in np.ndindex(level.shape):
            free, place = 1.0, (east[column], north[row], height)
            for radar, shadow in zip(threats.radars, threats.shadows, strict=True):
                away, above = math.dist(place[:2], radar[:2]), height - radar[2]
                if not is_hidden(*place, shadow, threats.grid):
                    free *= 1.0 - membership(math.hypot(away, above), above, away, radar[3], radar[4])
            assert level[row, column] == pytest.approx(1.0 - free, abs=1e-12)


def floor_at(found, east_m, north_m):
    floor, (west, south, side) = found
    return floor[int((north_m - south) // side), int((east_m - west) // side)]


def test_a_floor_is_where_the_line_over_the_wall_is():
    """From (1400, 750) on the ground over the wall's near edge, 400 m away and 300 m high."""
    found = sight_floor(snapshot_of(mission()), 0)
    assert floor_at(found, 800.0, 750.0) == pytest.approx(300.0 / 400.0 * 600.0, abs=10.0)
    assert floor_at(found, 800.0, 750.0) <= 300.0 / 400.0 * 610.0
    assert floor_at(found, 1400.0, 1150.0) == -math.inf
    assert math.isnan(floor_at(found, 500.0, 750.0)), "out of range"


def test_above_its_floor_a_radar_sees_and_below_it_does_not():
    """The field of the planner's own rule, at several heights; cells are smaller than those of a floor."""
    for name in ("ridge", "paper-3d", "first-flight"):
        world = world_of(load_mission(ROOT / "mission_configs" / f"{name}.yaml"), none_known=False)
        one = replace(world, radar_list=world.radar_list[:1], threats=_first_of(world.threats))
        found = sight_floor(one, 0)
        for height in np.linspace(world.bounds[4], world.bounds[5], 5):
            east, north, level = threat_field(one, float(height), 60)
            floors = np.array([[floor_at(found, x, y) for x in east] for y in north])
            assert not (level > 0.0)[~(height >= floors)].any(), (name, height)
        assert np.isfinite(found[0]).any()


def _first_of(threats):
    return threats._replace(radars=threats.radars[:1], known=threats.known[:1], shadows=threats.shadows[:1])


def test_the_boundary_is_a_floor_too():
    """h_B = K_R L², 400 m away with 0.001 a metre: 160 m up."""
    config = mission()
    (radar,) = config.radars
    bounded = config.model_copy(
        update={"radars": (radar.model_copy(update={"boundary_coefficient_per_m": 1e-3}),)}
    )
    assert floor_at(sight_floor(snapshot_of(bounded), 0), 1400.0, 1150.0) == pytest.approx(160.0, abs=16.0)

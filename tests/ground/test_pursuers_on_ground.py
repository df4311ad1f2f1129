"""Pursuers on ground: what hides the aircraft from them, what they see from, and where they do not drive."""

import math

import numpy as np
import pytest

from companion.kernels.threat.pursuit_game import threatened_from
from companion.world.ground.ground_cells import ground_cells
from companion.world.obstacles import packed_obstacles
from companion.world.pursuit import pursuit_game
from tests.ground.maps import BOUNDS, posts_over
from tests.support.worlds import track

FIELD = (*BOUNDS, 0.0, 400.0)
HERE_S = 0.0


def earliest(height, place, *, speed=0.0, east=200.0, north=400.0, drivable=10.0):
    """When a vehicle could threaten a place over ground whose height is a function of east and north [s]."""
    ground = ground_cells(
        posts_over(height, spacing=20.0),
        BOUNDS,
        least_m=0.0,
        wanted_m=0.0,
        most_m=math.inf,
        drivable=drivable,
    )
    walls = packed_obstacles((), FIELD, ground)
    seen = track(east, north, speed=speed, radius=500.0)
    game = pursuit_game((seen,), walls, None, FIELD, 0.0)
    return threatened_from(game, *place, -math.inf, math.inf)


def wall(east, north):
    """A ridge 150 m high from north to south, 400 m east."""
    return 150.0 * (np.abs(east - 400.0) < 45.0)


def plateau(east, north):
    """The ridge, and high ground west of it, with its edge where the vehicle stands."""
    return np.where(east < 215.0, 200.0, wall(east, north))


def flat(east, north):
    return 0.0 * east


def test_on_flat_ground_it_threatens_what_is_within_reach():
    assert earliest(flat, (600.0, 400.0, 60.0)) == HERE_S
    assert earliest(flat, (800.0, 400.0, 60.0)) == math.inf


def test_a_ridge_hides_what_flies_low_behind_it_and_not_what_flies_high():
    assert earliest(wall, (600.0, 400.0, 60.0)) == math.inf
    assert earliest(wall, (500.0, 400.0, 390.0)) == HERE_S  # 492 m away; 201 m up over the ridge's edge


def test_from_high_ground_it_sees_over_what_hid_it_below():
    """It stands 200 m high; the line of sight passes the ridge's far edge 163 m up."""
    assert earliest(wall, (600.0, 400.0, 140.0)) == math.inf
    assert earliest(plateau, (600.0, 400.0, 140.0)) == HERE_S


def test_it_drives_over_a_ridge_unless_that_is_too_steep():
    place = (900.0, 400.0, 60.0)
    over = earliest(wall, place, speed=20.0)
    assert HERE_S < over < math.inf
    assert earliest(wall, place, speed=20.0, drivable=0.5) == math.inf


@pytest.mark.parametrize("up", [30.0, 120.0, 330.0])
def test_flat_ground_is_as_no_ground(up):
    walls = packed_obstacles((), FIELD)
    seen = track(200.0, 400.0, speed=15.0, radius=500.0)
    bare = pursuit_game((seen,), walls, None, FIELD, 0.0)
    for east in (300.0, 650.0, 850.0):
        place = (east, 300.0, up)
        expected = threatened_from(bare, *place, -math.inf, math.inf)
        assert earliest(flat, place, speed=15.0) == pytest.approx(expected, abs=0.5)

"""What the aircraft must keep clear of, and what stops and hides a moving threat, are two things."""

from dataclasses import replace

import numpy as np
import pytest

from companion.planning.solver import solve
from companion.types.threat import Obstacle
from companion.world.obstacles import packed_obstacles
from tests.support.worlds import BOUNDS, problem, track

RING = Obstacle(
    "fence", np.array([[600.0, 500.0], [900.0, 500.0], [900.0, 800.0], [600.0, 800.0]]), 0.0, 300.0
)


def planned(*, is_wall):
    """A plan past a vehicle that stands in the middle of a block."""
    made = problem(tracks=[track(750.0, 650.0)])
    packed = packed_obstacles([RING], BOUNDS)
    walls = packed if is_wall else made.snapshot.walls
    snapshot = replace(made.snapshot, obstacles=packed, walls=walls, obstacle_list=(RING,))
    return solve(replace(made, snapshot=snapshot))


@pytest.mark.parametrize(("is_wall", "drives_out"), [(False, True), (True, False)])
def test_a_vehicle_drives_out_of_a_fence_and_not_through_a_wall(is_wall, drives_out):
    plan = planned(is_wall=is_wall)
    (tree,) = plan.threat_trees
    east, north = tree.position_enu_m[:, 0], tree.position_enu_m[:, 1]
    outside = (east < 590.0) | (east > 910.0) | (north < 490.0) | (north > 810.0)
    assert bool(outside.any()) is drives_out


def test_a_vehicle_behind_a_fence_sees_the_aircraft():
    fenced, walled = planned(is_wall=False), planned(is_wall=True)
    assert fenced.path is not None
    assert walled.path is not None
    assert fenced.path.threat_levels.max() > walled.path.threat_levels.max()
    # The fence itself is kept clear of.
    inside = (np.abs(fenced.path.positions_enu_m[:, 0] - 750.0) < 150.0) & (
        np.abs(fenced.path.positions_enu_m[:, 1] - 650.0) < 150.0
    )
    assert not inside.any()

"""The world in kernel form."""

import numpy as np
import pytest

from companion.types.threat import Radar
from companion.world.obstacles import FIELD_NODES, packed_obstacles, packed_with
from companion.world.snapshot import first_snapshot
from companion.world.threats import SHADOW_NODES, known_within, packed_threats
from tests.support.paths import box, prism_distance
from tests.support.worlds import BOUNDS, track

OBSTACLES = (box("a", 100.0, 100.0, 200.0, 300.0), box("b", 900.0, 900.0, 950.0, 1300.0, 20.0, 90.0))
RADARS = (Radar("near", (300.0, 200.0, 0.0), 250.0), Radar("far", (1400.0, 1400.0, 0.0), 100.0))


def snapshot(**changes):
    values = {"dimension": 3, "unit_m": 5.0, "bounds": BOUNDS, "obstacles": OBSTACLES, "radars": RADARS}
    return first_snapshot(**{**values, **changes})


def test_obstacles_are_laid_out_edge_by_edge():
    packed = packed_obstacles(OBSTACLES, BOUNDS)
    assert list(packed.offsets) == [0, 4, 8]
    assert packed.heights.tolist() == [[0.0, 300.0], [20.0, 90.0]]
    assert packed.boxes.tolist() == [[100.0, 100.0, 200.0, 300.0], [900.0, 900.0, 950.0, 1300.0]]
    for o in range(2):
        edges = packed.edges[packed.offsets[o] : packed.offsets[o + 1]]
        assert np.array_equal(edges[:, 2:], np.roll(edges[:, :2], -1, axis=0))


@pytest.mark.parametrize("num_known", range(len(OBSTACLES) + 1))
def test_prisms_that_come_later_are_packed_as_those_that_were_there(num_known):
    known = packed_obstacles(OBSTACLES[:num_known], BOUNDS)
    later, at_once = packed_with(known, OBSTACLES[num_known:], BOUNDS), packed_obstacles(OBSTACLES, BOUNDS)
    for found, expected in zip(later, at_once, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_prisms_that_come_later_block_no_sight():
    before = snapshot(obstacles=OBSTACLES[:1])
    after = before.with_prisms(OBSTACLES[1:])
    assert len(after.obstacles.heights) == 2
    assert after.walls is before.walls
    assert after.obstacle_list is before.obstacle_list


def test_the_field_holds_distances_at_its_nodes():
    packed = packed_obstacles(OBSTACLES, BOUNDS)
    assert packed.field.shape == FIELD_NODES
    rng = np.random.default_rng(2)
    for i, j, k in rng.integers(0, FIELD_NODES, (50, 3)):
        point = packed.grid[:3] + np.array([i, j, k]) * packed.grid[3:]
        assert packed.field[i, j, k] == pytest.approx(
            min(prism_distance(point, o) for o in OBSTACLES), abs=1e-9
        )


def test_the_field_covers_all_of_the_bounds():
    for bounds in (BOUNDS, (0.0, 7.3, 0.0, 1234.5, 0.0, 1.0), (0.0, 100.0, 0.0, 100.0, 50.0, 50.0)):
        packed = packed_obstacles(OBSTACLES, bounds)
        last = packed.grid[:3] + (np.array(packed.field.shape) - 1) * packed.grid[3:]
        assert (last + packed.grid[3:] >= np.array(bounds[1::2]) - 1e-6).all()


def test_a_world_without_obstacles_or_radars():
    empty = snapshot(obstacles=(), radars=())
    assert empty.obstacles.field.size == 0
    assert empty.threats.radars.shape == (0, 5)
    assert empty.sensed(0.0, 0.0, 1e6).size == 0


def test_radars_are_known_once_their_area_reaches_into_the_horizon():
    threats = packed_threats(RADARS, packed_obstacles(OBSTACLES, BOUNDS), BOUNDS)
    # The first is 360.6 m from the origin with a radius of 250 m: seen from a horizon of 110.6 m on.
    assert list(known_within(threats, 0.0, 0.0, 110.0)) == [0, 0]
    assert list(known_within(threats, 0.0, 0.0, 111.0)) == [1, 0]
    first = snapshot()
    assert list(first.threats.known) == [0, 0]
    seen = first.with_known(first.sensed(0.0, 0.0, 111.0))
    assert list(seen.threats.known) == [1, 0]
    assert list(seen.sensed(1400.0, 1400.0, 1.0)) == [1, 1]  # what is known stays known
    assert list(snapshot(none_known=False).threats.known) == [1, 1]


def test_the_shadow_grid_covers_the_bounds():
    threats = packed_threats(RADARS, packed_obstacles(OBSTACLES, BOUNDS), BOUNDS)
    assert threats.shadows.shape == (2, SHADOW_NODES, SHADOW_NODES)
    assert threats.grid[2] * (SHADOW_NODES - 1) == pytest.approx(1500.0)


def test_new_tracks_make_the_next_snapshot_and_leave_the_old_one_alone():
    first = snapshot()
    second = first.with_tracks(4.0, [track(1.0, 2.0)])
    assert (first.number, first.stamp_s, first.tracks) == (0, 0.0, ())
    assert (second.number, second.stamp_s, len(second.tracks)) == (1, 4.0, 1)
    assert second.obstacles is first.obstacles

"""A path of an earlier plan in another world: by the solver's own figures, and by what must follow."""

from dataclasses import replace

import numpy as np
import pytest

from companion.planning.route import reassessed
from companion.planning.solver import solve
from companion.types.threat import Radar
from tests.support.worlds import problem, track


def planned(**changes):
    asked = problem([], [], [], dimension=2, seed=3, **changes)
    return asked, solve(asked).path


def test_in_the_world_it_was_planned_in_a_path_is_as_it_was():
    asked, path = planned()
    found, _ = reassessed(asked, path)
    np.testing.assert_allclose(found.collision_free, path.collision_free, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(found.position_covariances_m2, path.position_covariances_m2, atol=1e-9)
    np.testing.assert_array_equal(found.threat_levels, 0.0)
    np.testing.assert_array_equal(found.positions_enu_m, path.positions_enu_m)
    np.testing.assert_array_equal(found.times_s, path.times_s)


def test_a_radar_that_is_known_now_threatens_what_it_reaches():
    _, path = planned()
    middle = path.positions_enu_m[len(path) // 2]
    with_radar = problem([], [Radar("r", (*middle[:2], 0.0), 300.0)], [], dimension=2, seed=3)
    known, unknown = (with_radar.snapshot.with_known(np.array([value])) for value in (1, 0))
    found, _ = reassessed(replace(with_radar, snapshot=known), path)
    away = np.linalg.norm(path.positions_enu_m[:, :2] - middle[:2], axis=1)
    assert found.threat_levels[away < 100.0].min() > 0.1
    np.testing.assert_array_equal(found.threat_levels[away > 330.0], 0.0)
    blind, _ = reassessed(replace(with_radar, snapshot=unknown), path)
    np.testing.assert_array_equal(blind.threat_levels, 0.0)


@pytest.mark.parametrize(("near", "is_threat"), [(150.0, True), (5_000.0, False)])
def test_a_vehicle_threatens_what_it_can_be_near_to_in_time(near, is_threat):
    asked, path = planned()
    east, north, _ = path.positions_enu_m[len(path) // 2]
    snapshot = asked.snapshot.with_tracks(0.0, [track(east, north - near, radius=200.0)])
    found, _ = reassessed(replace(asked, snapshot=snapshot), path)
    assert bool(found.threat_levels.max() > 0.05) is is_threat


def test_nothing_of_the_path_given_is_changed():
    asked, path = planned()
    before = path.threat_levels.copy(), path.collision_free.copy()
    snapshot = asked.snapshot.with_tracks(0.0, [track(*path.positions_enu_m[10][:2], radius=200.0)])
    reassessed(replace(asked, snapshot=snapshot), path)
    np.testing.assert_array_equal(path.threat_levels, before[0])
    np.testing.assert_array_equal(path.collision_free, before[1])

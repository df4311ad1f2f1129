"""The check's own reading of the ground, by hand and beside the simulator's."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.config import mission_from_text
from companion.flight.takeover.capability import shortfalls
from companion.types.state import AutopilotSettings
from sim.vehicle.true_ground import TrueGround
from tests.ground.maps import bilinear, hill, posts_over, rough
from tests.sim.client import PLAIN
from tests.support.paths import check_limits, straight_path

EAST, NORTH = st.floats(1.0, 999.0), st.floats(1.0, 799.0)
EASTWARDS = 0.5 * math.pi


@given(EAST, NORTH, st.integers(0, 3))
def test_both_readings_are_bilinear(east, north, seed):
    posts = posts_over(rough(seed))
    expected = bilinear(posts, east, north)
    place = np.array([[east, north]])
    assert GroundHeights(posts, 50.0, math.inf).up_m(place)[0] == pytest.approx(expected, abs=0.01)
    assert TrueGround(posts).up_m(east, north) == pytest.approx(expected, abs=0.01)


@given(st.tuples(EAST, NORTH, st.floats(0.0, 300.0)), st.tuples(EAST, NORTH, st.floats(0.0, 300.0)))
def test_both_readings_agree_on_lines_of_sight_that_are_not_close(begin, end):
    posts = posts_over(hill)
    eyes, places = np.array([begin]), np.array([end])
    at = np.array(begin) + np.linspace(0.0, 1.0, 500)[:, None] * (np.array(end) - np.array(begin))
    over = min(place[2] - bilinear(posts, *place[:2]) for place in at)
    if abs(over) > 2.0 and over > -40.0:
        expected = over > 0.0
        sights = GroundHeights(posts, 50.0, math.inf), TrueGround(posts)
        middle = at[len(at) // 2]
        is_under_an_end = np.linalg.norm(middle - at[0]) < 20.0
        for sight in sights:
            assert is_under_an_end or sight.is_free(eyes, places)[0] == expected or not expected


def test_a_profile_runs_over_the_corners_of_a_line():
    """The ground rises 1 m in 10 m to the east; the line leads 300 m east, 400 m north, 100 m up on each."""
    ground = GroundHeights(posts_over(lambda east, north: 0.1 * east + 0.0 * north), 50.0, math.inf)
    along, up, below = ground.profile(
        np.array([[100.0, 100.0, 200.0], [400.0, 100.0, 300.0], [400.0, 500.0, 400.0]])
    ).T
    assert along[0] == 0.0
    assert along[-1] == pytest.approx(700.0)
    assert np.diff(along).min() >= 0.0
    assert np.diff(along).max() <= 12.6  # A quarter of the distance of posts.
    assert np.interp([0.0, 150.0, 300.0, 700.0], along, up) == pytest.approx([200.0, 250.0, 300.0, 400.0])
    assert np.interp([0.0, 150.0, 300.0, 700.0], along, below) == pytest.approx(
        [10.0, 25.0, 40.0, 40.0], abs=0.1
    )


def test_a_path_over_the_hill_is_refused_by_its_height_over_ground():
    """It is 100 m high; the hill is 300 m high at 500 m east, 400 m north."""
    ground = GroundHeights(posts_over(hill), 50.0, 120.0)
    checker = Checker([], check_limits(), None, ground)
    far = straight_path(num=11, speed=25.0, start=(100.0, 50.0, 100.0), course=EASTWARDS)
    assert checker.check_path(far) == ()
    into = straight_path(num=33, speed=25.0, start=(100.0, 400.0, 100.0), course=EASTWARDS)
    found = [entry for entry in checker.check_path(into) if entry.rule == "clearance"]
    assert found
    assert found[0].in_short.endswith("from the ground")
    assert found[0].row == pytest.approx(7, abs=2)  # The ground is 53 m high 198 m before the top.
    high = straight_path(
        num=11, speed=25.0, start=(100.0, 50.0, 130.0), course=EASTWARDS
    )  # no tolerance here
    assert {entry.rule for entry in checker.check_path(high)} == {"bounds"}


def test_a_track_keeps_the_margin_and_may_climb_away():
    ground = GroundHeights(posts_over(lambda east, north: 0.0 * east), 50.0, 120.0)
    checker = Checker([], check_limits(margin_m=10.0), None, ground)
    low = np.array([[100.0 + 10.0 * n, 100.0, 20.0] for n in range(20)])
    assert checker.check_track(low, 10.0) == ()
    assert checker.check_track(low - [0.0, 0.0, 12.0], 10.0)[0].rule == "clearance"
    climbs = np.array([[100.0 + 10.0 * n, 100.0, 5.0 + 3.0 * n] for n in range(20)])
    assert checker.check_track(climbs, 10.0) == ()


def test_a_track_may_have_to_keep_the_lowest_height_as_closely_as_the_clearance():
    """50 m over ground count as 20 m of clearance, which are twice the margin: 43 m are left as 13 m."""
    ground = GroundHeights(posts_over(lambda east, north: 0.0 * east), 50.0, math.inf)
    checker = Checker([], check_limits(margin_m=10.0), None, ground)
    track = np.array([[100.0, 400.0, 80.0], [300.0, 400.0, 43.0], [500.0, 400.0, 80.0]])
    assert checker.check_track(track, 15.0) == ()
    assert checker.check_track(track, 10.0, keeps_height=True) == ()
    found = checker.check_track(track, 15.0, keeps_height=True)
    assert {entry.rule for entry in found} == {"clearance"}
    assert min(entry.value for entry in found) == pytest.approx(13.0, abs=0.1)
    assert all(entry.limit == pytest.approx(15.0) for entry in found)


def test_a_track_over_ground_keeps_both_limits_once_it_has_kept_them():
    """Ground that rises by a tenth; limits 50 and 120 m, of which the lower may be passed by 1 m."""
    ground = GroundHeights(posts_over(lambda east, north: 0.1 * east), 50.0, 120.0)
    track = np.array([[100.0 + 20.0 * n, 100.0, 70.0 + 2.0 * n] for n in range(20)])  # 60 m over ground
    assert ground.track_violations(track, 0.0) == ()
    for down, is_kept in ((10.8, True), (11.2, False)):
        dipped = track.copy()
        dipped[7, 2] -= down
        assert (ground.track_violations(dipped, 0.0) == ()) is is_kept
    lower, higher, begins_low = track.copy(), track.copy(), track.copy()
    lower[7, 2] -= 20.0
    higher[7, 2] += 70.0
    begins_low[:3, 2] -= 40.0
    assert [(entry.rule, entry.row) for entry in ground.track_violations(lower, 0.0)] == [
        ("clearance", 7), ("clearance", 8),
    ]  # fmt: skip
    assert min(entry.value for entry in ground.track_violations(lower, 0.0)) == pytest.approx(40.0, abs=0.1)
    assert [entry.rule for entry in ground.track_violations(higher, 0.0)] == ["bounds", "bounds"]
    assert ground.track_violations(higher, 20.0) == ()
    assert ground.track_violations(begins_low, 0.0) == ()


@pytest.mark.parametrize(("home_m", "words"), [(0.0, ()), (30.0, ("home at 614 m AMSL, map 584",))])
def test_a_home_at_another_height_than_the_map_is_named_with_both(home_m, words):
    mission = mission_from_text(
        PLAIN.replace("dimension: 2", "dimension: 3")
        + "terrain: {generated: {kind: hills, relief_m: 1.0}, home_tolerance_m: 20}\n",
        "hills.yaml",
    )
    found = shortfalls(mission, AutopilotSettings(), (100.0, 100.0, home_m))
    assert tuple(word.replace("585", "584") for word in found) == words

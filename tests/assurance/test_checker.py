"""The independent checker: each rule by hand, and unsafe paths that try to get past it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.assurance.violation import Violation
from tests.support.paths import box, check_limits, flown, path_of, prism_distance, straight_path


def rules(violations):
    return {violation.rule for violation in violations}


def free_checker(**changes):
    return Checker([], check_limits(**changes))


def test_a_straight_level_path_passes():
    assert free_checker().check_path(straight_path()) == ()


def test_a_violation_is_written_as_a_sentence():
    violation = Violation("speed", 3, 40.0, 37.5, "airspeed [m/s]")
    assert str(violation) == "row 3: airspeed [m/s]: 40, limit 37.5 (speed)"


@pytest.mark.parametrize("num", [0, 1])
def test_a_path_needs_two_rows(num):
    path = path_of([0.0] * num, [(0.0, 0.0, 100.0)] * num, [0.0] * num)
    assert rules(free_checker().check_path(path)) == {"rows"}


def test_columns_of_different_length_are_refused():
    path = replace(straight_path(), courses_rad=np.zeros(3))
    assert rules(free_checker().check_path(path)) == {"rows"}


@pytest.mark.parametrize(
    "column", ["times_s", "courses_rad", "climb_angles_rad", "speeds_m_s", "positions_enu_m"]
)
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_numbers_that_are_none_are_refused_and_the_rest_is_still_checked(column, number):
    path = straight_path(start=(0.0, 0.0, -50.0))
    values = getattr(path, column).copy()
    values[4] = number
    found = free_checker().check_path(replace(path, **{column: values}))
    assert ("finite", 4) in {(v.rule, v.row) for v in found}
    assert {v.row for v in found if v.rule == "bounds"} == set(range(11)) - {4}


@pytest.mark.parametrize("times", [[0.0, 1.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0]])
def test_time_has_to_go_on(times):
    path = replace(straight_path(4), times_s=np.array(times))
    assert [v.row for v in free_checker().check_path(path) if v.rule == "time"] == [2]


def test_speed_limits():
    # 25 m in 1 s: the geometry fits 25 m/s only, so "pace" is broken by other speeds as well.
    assert rules(free_checker().check_path(straight_path(speed=38.0))) == {"speed"}
    assert rules(free_checker().check_path(straight_path(speed=12.0))) == {"speed"}
    assert free_checker().check_path(straight_path(speed=37.5)) == ()


@pytest.mark.parametrize(
    ("gained", "broken"), [(0.5, False), (0.62, False), (0.7, True), (-1.1, False), (-1.3, True)]
)
def test_speed_changes_no_faster_than_it_can(gained, broken):
    # 0.5 m/s² over 25 m from 25 m/s: sqrt(625 + 25) = 25.495, and 0.15 to spare; 1 m/s² down: 23.979 - 0.15.
    speeds = np.full(11, 25.0)
    speeds[5:] += gained
    steps = 25.0 / (0.5 * (speeds[1:] + speeds[:-1]))
    path = replace(straight_path(), speeds_m_s=speeds, times_s=np.append(0.0, np.cumsum(steps)))
    found = free_checker().check_path(path)
    assert [(entry.rule, entry.row) for entry in found] == ([("acceleration", 5)] if broken else [])
    assert free_checker(acceleration_max_m_s2=5.0).check_path(path) == ()


@pytest.mark.parametrize(("stated", "broken"), [(25.0, False), (24.6, False), (23.5, True), (27.0, True)])
def test_distance_fits_speed_and_time(stated, broken):
    # 25 m in 1 s; tolerance 2 % and 0.2 m: 24.6 m/s allows 24.6·1.02 + 0.2 = 25.29 m, 23.5 m/s 24.17 m.
    path = replace(straight_path(), speeds_m_s=np.full(11, stated))
    assert ("pace" in rules(free_checker().check_path(path))) is broken


def test_a_circle_hidden_between_two_rows_is_found():
    # After 31.4 s at 25 m/s on a circle of 125 m one is back at the start: 785 m flown, 0 m apart.
    times = [0.0, 2.0 * math.pi * 125.0 / 25.0]
    path = path_of(times, [(0.0, 0.0, 100.0), (0.0, 1e-3, 100.0)], [0.0, 0.0])
    assert "pace" in rules(free_checker().check_path(path))


@pytest.mark.parametrize(("radius", "broken"), [(125.0, False), (123.0, False), (121.0, True), (60.0, True)])
@pytest.mark.parametrize("side", [1, -1])
def test_turn_radius(radius, broken, side):
    # Tolerance 2 %: 125·0.98 = 122.5 m.
    path, _ = flown([(300.0, radius, side)])
    assert ("turn_radius" in rules(free_checker().check_path(path))) is broken


def test_courses_that_hide_a_turn_are_found():
    # The positions turn with 60 m radius while every course says north.
    path, _ = flown([(300.0, 60.0, 1)])
    assert "course" in rules(free_checker().check_path(replace(path, courses_rad=np.zeros(len(path)))))


@pytest.mark.parametrize(("between", "broken"), [(130.0, False), (126.0, False), (90.0, True), (0.0, True)])
@pytest.mark.parametrize("second", [1, -1])
def test_straight_flight_between_turns(between, broken, second):
    # 101 m are asked for. Rows stand at most 25 m apart wherever the turns end, so S metres show at least
    # S - 50 m as whole straight edges, and one edge of 25 m at most is granted for the two parts: 126 m
    # always count as 101 m or more; 90 m never do.
    path, _ = flown([(125.0, 125.0, 1), (between, 0.0, 0), (150.0, 125.0, second)])
    found = rules(free_checker(straight_length_min_m=101.0).check_path(path))
    if between == 0.0 and second == 1:
        assert found == set()  # one turn that goes on
    else:
        assert ("straight" in found) is broken


def test_straight_flight_of_whole_edges_is_measured_exactly():
    # Rows fall on the turns' ends: 4 whole edges, 100 m, and the turning edges have nothing to spare.
    path, _ = flown([(125.0, 125.0, 1), (100.0, 0.0, 0), (125.0, 125.0, -1)])
    found = [v for v in free_checker().check_path(path) if v.rule == "straight"]
    assert [(v.row, round(v.value, 6)) for v in found] == [(10, 100.0)]
    path, _ = flown([(125.0, 125.0, 1), (125.0, 0.0, 0), (125.0, 125.0, -1)])
    assert free_checker().check_path(path) == ()


def test_rows_already_flown_are_not_judged_but_remembered():
    path, _ = flown([(125.0, 125.0, 1), (50.0, 0.0, 0), (125.0, 125.0, -1), (200.0, 0.0, 0)])
    checker = free_checker()
    assert rules(checker.check_path(path)) == {"straight"}
    assert rules(checker.check_path(path, from_row=6)) == {"straight"}  # the second turn is still ahead
    assert checker.check_path(path, from_row=8) == ()  # it has begun
    assert checker.check_path(path, from_row=10_000) == ()


@pytest.mark.parametrize(("climb_deg", "broken"), [(9.9, False), (-9.9, False), (10.5, True), (-10.5, True)])
def test_climb_stated_and_by_geometry(climb_deg, broken):
    path = straight_path(climb=math.radians(climb_deg), start=(0.0, 0.0, 250.0))
    checker = free_checker()
    assert bool(checker.check_path(path)) is broken
    if broken:
        found = checker.check_path(path)
        assert rules(found) == {"climb"}
        assert len([v for v in found if "stated" in v.detail]) == 11
        assert len([v for v in found if "between" in v.detail]) == 10
        lied = checker.check_path(replace(path, climb_angles_rad=np.zeros(11)))
        assert rules(lied) == {"climb"}
        assert len(lied) == 10


def test_climb_and_descent_have_their_own_limits():
    path = straight_path(climb=math.radians(-8.0), start=(0.0, 0.0, 250.0))
    assert free_checker(climb_angle_max_rad=math.radians(5.0)).check_path(path) == ()
    assert rules(free_checker(descent_angle_max_rad=math.radians(5.0)).check_path(path)) == {"climb"}


@pytest.mark.parametrize(
    ("axis", "bounds"),
    [
        ("east", (1.0, 9.0, -500.0, 500.0, 0.0, 500.0)),
        ("east", (-9.0, -1.0, -500.0, 500.0, 0.0, 500.0)),
        ("north", (-9.0, 9.0, 1.0, 500.0, 0.0, 500.0)),
        ("north", (-9.0, 9.0, -500.0, 249.0, 0.0, 500.0)),
        ("up", (-9.0, 9.0, -500.0, 500.0, 101.0, 500.0)),
        ("up", (-9.0, 9.0, -500.0, 500.0, 0.0, 99.0)),
    ],
)
def test_bounds_on_every_side(axis, bounds):
    found = free_checker(bounds=bounds).check_path(straight_path())
    assert rules(found) == {"bounds"}
    assert all(v.detail.startswith(axis) for v in found)


def test_the_altitude_band_is_widened_for_aircraft_in_flight_the_sides_are_not():
    low = (-9.0, 9.0, -500.0, 500.0, 105.0, 500.0)
    assert free_checker(bounds=low, altitude_tolerance_m=5.0).check_path(straight_path()) == ()
    assert free_checker(bounds=low, altitude_tolerance_m=4.9).check_path(straight_path()) != ()
    west = (5.0, 9.0, -500.0, 500.0, 0.0, 500.0)
    assert free_checker(bounds=west, altitude_tolerance_m=50.0).check_path(straight_path()) != ()


@pytest.mark.parametrize("side", [1, -1])
def test_an_arc_that_bulges_out_of_bounds_between_rows_is_found(side):
    # A quarter circle of 125 m in one edge that begins and ends at the same east: it leaves its chord by
    # r·(1 − cos 45°) = 36.6 m, to the west where it turns right.
    path, curve = flown([(125.0 * math.pi / 2.0, 125.0, side)], step_s=10.0, course=-side * math.pi / 4.0)
    assert len(path) == 2
    assert np.abs(curve[:, 0]).max() == pytest.approx(125.0 * (1.0 - math.cos(math.pi / 4.0)), abs=0.01)
    wide, narrow = (-37.0, 37.0), (-34.0, 34.0)  # 2 m are tolerated
    assert free_checker(bounds=(*wide, -500.0, 500.0, 0.0, 500.0)).check_path(path) == ()
    found = free_checker(bounds=(*narrow, -500.0, 500.0, 0.0, 500.0)).check_path(path)
    assert [(v.rule, v.row) for v in found] == [("bounds", 1)]
    assert found[0].value == pytest.approx(-side * 36.6, abs=0.05)


@pytest.mark.parametrize("level", [-0.1, 0.61, 1.2, math.nan])
def test_threat_levels(level):
    path = straight_path()
    path.threat_levels[5] = level
    found = free_checker(threat_level_max=0.6).check_path(path)
    assert [(v.rule, v.row) for v in found] == [("threat", 5)]
    path.threat_levels[5] = 0.6
    assert free_checker(threat_level_max=0.6).check_path(path) == ()


def test_quality_is_the_product_of_p_c():
    # 0.9³ = 0.729 over the three rows that are not 1.
    path = straight_path()
    path.collision_free[[2, 5, 7]] = 0.9
    assert free_checker(quality_min=0.728).check_path(path) == ()
    assert [v.value for v in free_checker(quality_min=0.73).check_path(path)] == [pytest.approx(0.729)]
    assert free_checker(quality_min=0.73).check_path(path, from_row=3) == ()  # 0.9² = 0.81


@pytest.mark.parametrize("value", [math.nan, -0.1, 1.1])
def test_p_c_has_to_be_a_probability(value):
    path = straight_path()
    path.collision_free[3] = value
    assert ("quality", 3) in {(v.rule, v.row) for v in free_checker().check_path(path)}


def test_the_goal_has_to_be_reached():
    # The path ends at (0, 250, 100); the goal is 50 m away: 30² + 40² = 50².
    goal = (30.0, 250.0, 140.0)
    assert free_checker().check_path(straight_path(), goal_enu_m=goal, acceptance_radius_m=50.0) == ()
    found = free_checker().check_path(straight_path(), goal_enu_m=goal, acceptance_radius_m=49.9)
    assert [(v.rule, v.row, v.value) for v in found] == [("goal", 10, pytest.approx(50.0))]
    assert rules(free_checker().check_path(straight_path(), goal_enu_m=(math.nan, 0.0, 0.0))) == {"goal"}


@pytest.mark.parametrize(
    "covariance",
    [np.full((3, 3), math.nan), -np.eye(3), np.array([[4.0, 3.0, 0], [-3.0, 4.0, 0], [0, 0, 4.0]])],
)
def test_covariances_have_to_be_covariances(covariance):
    path = straight_path()
    path.position_covariances_m2[6] = covariance
    assert ("covariance", 6) in {(v.rule, v.row) for v in free_checker().check_path(path)}


def test_the_margin_grows_with_the_covariance():
    # A wall 20 m east of the path; deviation 2 m at all rows but one, where its largest is 7 m.
    checker = Checker([box("wall", 20.0, -500.0, 30.0, 500.0)], check_limits(margin_m=10.0, deviations=2.0))
    path = straight_path()
    assert checker.check_path(path) == ()  # 10 + 2·2 = 14 < 20
    path.position_covariances_m2[4] = np.diag([1.0, 49.0, 1.0])  # 10 + 2·7 = 24 > 20
    found = checker.check_path(path)
    assert [(v.rule, v.row) for v in found] == [("clearance", 4), ("clearance", 5)]
    assert found[0].value == pytest.approx(20.0)
    assert found[0].limit == pytest.approx(24.0)
    assert "wall" in str(found[0])


@pytest.mark.parametrize(
    ("base", "top", "broken"),
    [(0.0, 84.0, False), (0.0, 86.0, True), (116.0, 200.0, False), (114.0, 200.0, True), (95.0, 105.0, True)],
)
def test_heights_of_prisms(base, top, broken):
    # The path is at 100 m, straight over (or under) the prism, margin 15 m.
    checker = Checker([box("b", -20.0, 100.0, 20.0, 110.0, base, top)], check_limits())
    assert ("clearance" in rules(checker.check_path(straight_path()))) is broken


def test_a_thin_obstacle_between_two_rows_is_found():
    mast = box("mast", -0.05, 112.0, 0.05, 112.1)
    checker = Checker([mast], check_limits(margin_m=0.0))
    assert [(v.rule, v.row) for v in checker.check_path(straight_path())] == [("clearance", 5)]


def test_without_a_margin_only_touching_counts():
    limits = check_limits(margin_m=0.0)
    assert Checker([box("b", 0.01, 0.0, 9.0, 250.0)], limits).check_path(straight_path()) == ()
    assert rules(Checker([box("b", -1.0, 0.0, 9.0, 250.0)], limits).check_path(straight_path())) == {
        "clearance"
    }
    above = box("b", -1.0, 0.0, 9.0, 250.0, 150.0, 200.0)
    assert Checker([above], limits).check_path(straight_path()) == ()


def test_a_polygon_that_crosses_itself_is_taken_as_its_hull():
    # Its hull is the square from north 50 to 150; as a bow tie only a point of it lies on the path.
    corners = np.array([[-50.0, 50.0], [50.0, 150.0], [50.0, 50.0], [-50.0, 150.0]])
    bow = replace(box("bow", 0, 0, 1, 1), polygon_enu_m=corners, top_m=300.0)
    path = straight_path(start=(20.0, 0.0, 100.0))
    found = Checker([bow], check_limits(margin_m=0.0)).check_path(path)
    assert {v.row for v in found} == {2, 3, 4, 5, 6, 7}


@pytest.mark.parametrize("polygon", [[[0.0, 0.0], [1.0, 1.0]], [[0.0, 0.0], [1.0, math.nan], [2.0, 0.0]]])
def test_an_obstacle_that_is_none_is_refused_at_once(polygon):
    with pytest.raises(ValueError, match="odd"):
        Checker([replace(box("odd", 0, 0, 1, 1), polygon_enu_m=np.array(polygon))], check_limits())


LENGTHS = st.floats(30.0, 400.0)
TURNS = st.tuples(LENGTHS, st.floats(125.0, 400.0), st.sampled_from([-1, 1]))
STRAIGHTS = st.tuples(st.floats(10.0, 300.0), st.just(0.0), st.just(0))
SEGMENTS = st.lists(st.one_of(TURNS, STRAIGHTS), min_size=1, max_size=4)
BOXES = st.tuples(
    st.floats(-400, 400), st.floats(-400, 400), st.floats(1.0, 150.0), st.floats(1.0, 150.0),
    st.floats(0.0, 120.0), st.floats(1.0, 100.0),
)  # fmt: skip


def one_way(segments):
    """Segments whose turns inside one edge of 25 m do not cancel: a straight piece between opposite turns."""
    out = []
    for segment in segments:
        if out and out[-1][1] and segment[1] and out[-1][2] != segment[2]:
            out.append((30.0, 0.0, 0))
        out.append(segment)
    return out


@settings(max_examples=150, deadline=None)
@given(SEGMENTS, st.lists(BOXES, min_size=1, max_size=3), st.floats(-0.15, 0.15), st.floats(0.0, 20.0))
@example([(6.25, 0.0, 0), (12.5, 125.0, 1), (6.25, 0.0, 0)], [(0.0, 12.0, 5.0, 5.0, 0.0, 100.0)], 0.0, 0.0)
@example([(200.0, 0.0, 0)], [(10.0, 50.0, 5.0, 5.0, 90.0, 5.0)], 0.15, 15.0)
def test_no_unsafe_path_gets_past_the_clearance_rule(segments, boxes, climb, margin):
    obstacles = [
        box(str(n), x, y, x + w, y + h, base, base + height)
        for n, (x, y, w, h, base, height) in enumerate(boxes)
    ]
    path, curve = flown(one_way(segments), climb=climb, fine=10)
    nearest = min(prism_distance(point, obstacle) for point in curve for obstacle in obstacles)
    found = "clearance" in rules(Checker(obstacles, check_limits(margin_m=margin)).check_path(path))
    if nearest < margin - 0.2 or nearest == 0.0:
        assert found
    # Dense points are 2.5 m apart, and the chord with its bulge is a bound: 1.5 m covers both.
    if nearest > margin + 3.0:
        assert not found


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=40, max_size=40), st.integers(-3, 9))
def test_no_numbers_make_it_raise(numbers, from_row):
    values = np.array(numbers).reshape(5, 8)
    path = path_of(values[:, 0], values[:, 1:4], values[:, 4], values[:, 5], 25.0)
    path.speeds_m_s[:] = values[:, 6]
    path.threat_levels[:] = values[:, 7]
    path.position_covariances_m2[:, 0, 0] = values[:, 7]
    checker = Checker([box("b", -20.0, 100.0, 20.0, 110.0)], check_limits())
    with np.errstate(all="ignore"):
        found = checker.check_path(path, goal_enu_m=values[0, :3], from_row=from_row)
    assert all(str(violation) for violation in found)


@settings(max_examples=100, deadline=None)
@given(SEGMENTS, st.integers(1, 10), st.floats(3.0, 300.0), st.floats(0.0, 2.0 * math.pi))
@example([(125.0, 125.0, 1)], 1, 3.0, 1.75)
def test_moving_one_row_off_a_good_path_is_found(segments, row, metres, bearing):
    path, _ = flown(one_way(segments), fine=1)
    row = min(row, len(path) - 1)
    moved = path.positions_enu_m.copy()
    moved[row] += metres * np.array([math.sin(bearing), math.cos(bearing), 0.0])
    found = rules(free_checker(straight_length_min_m=0.0).check_path(replace(path, positions_enu_m=moved)))
    # The most that is tolerated: 25 m at R = 250 m, 0.05·(1 - 125/250) + 0.022 = 0.047 rad or 1.2 m across,
    # and 0.7 m along. A place moved along a curve's chord keeps course and pace within these, not the radius.
    assert found & {"course", "pace", "turn_radius"}


def test_the_distance_of_a_long_climbing_edge_is_exact():
    # 1 km north, climbing 100 m. The roof's top is at 120 m from north 500 on, where the path is at 150 m:
    # 30 m above the south edge, which is nearest at right angles to the path: 30·cos(atan 0.1) = 29.85 m.
    path = path_of([0.0, 40.2], [(0, 0, 100), (0, 1000, 200)], [0.0, 0.0], [0.0997, 0.0997], 25.0)
    roof = box("roof", -50.0, 500.0, 50.0, 510.0, 0.0, 120.0)
    found = Checker([roof], check_limits(margin_m=40.0)).check_path(path)
    assert [v.rule for v in found] == ["clearance"]
    assert found[0].value == pytest.approx(30.0 * math.cos(math.atan(0.1)), abs=0.05)


@pytest.mark.parametrize(
    "segments",
    [[(200.0, 125.0, 1)], [(60.0, 0.0, 0), (80.0, 125.0, 1), (60.0, 0.0, 0)]],
    ids=["arc", "corner"],
)
def test_what_stands_between_an_arc_and_its_chord_is_found(segments):
    # One edge of 200 m turning right; a post where the curve is farthest from the chord.
    path, curve = flown(segments, step_s=10.0)
    start, end = curve[0, :2], curve[-1, :2]
    along = (end - start) / np.linalg.norm(end - start)
    aside = np.abs((curve[:, :2] - start) @ np.array([-along[1], along[0]]))
    east, north = curve[np.argmax(aside), :2]
    assert len(path) == 2
    assert aside.max() > 15.0
    post = box("post", east - 0.5, north - 0.5, east + 0.5, north + 0.5)
    assert rules(Checker([post], check_limits(margin_m=0.0)).check_path(path)) == {"clearance"}


@pytest.mark.parametrize(("turn_m", "tolerated_rad"), [(25.0, 0.022), (12.5, 0.022 + 0.025), (0.0, 0.022)])
@pytest.mark.parametrize("side", [1, -1])
def test_a_chord_leaves_its_courses_by_no_more_than_the_smallest_radius_explains(turn_m, tolerated_rad, side):
    # One edge of 25 m that turns by s/125. Turned at once, then straight, its chord leaves the mean course by
    # half the turn less a share s/25 of that: 0.1·0 = 0, 0.05·0.5 = 0.025, 0. Tolerated: 0.02 + 0.05 m/25 m.
    turn = side * turn_m / 125.0
    for offset, broken in ((tolerated_rad - 0.003, False), (tolerated_rad + 0.003, True)):
        for sign in (1.0, -1.0):
            chord = 0.5 * turn + sign * offset
            end = (25.0 * math.sin(chord), 25.0 * math.cos(chord), 100.0)
            path = path_of([0.0, 1.0], [(0.0, 0.0, 100.0), end], [0.0, turn], [0.0, 0.0], 25.0)
            assert ("course" in rules(free_checker().check_path(path))) is broken


def test_courses_that_lag_behind_a_turn_are_found():
    # Edges of 25 m turn by 0.2 rad: a chord lies 0.1 rad from both courses; 0.02 rad are tolerated.
    path, _ = flown([(250.0, 125.0, 1)])
    checker = free_checker()
    assert checker.check_path(replace(path, courses_rad=path.courses_rad + 0.015)) == ()
    assert rules(checker.check_path(replace(path, courses_rad=path.courses_rad + 0.15))) == {"course"}


def test_a_thin_floor_between_the_heights_of_two_rows_is_found():
    # The edge climbs from 100 m to 104 m; the floor is 0.2 m thick and 1.9 m from both.
    path = straight_path(2, climb=math.atan(4.0 / 25.0))
    floor = box("floor", -50.0, -50.0, 50.0, 50.0, 101.9, 102.1)
    assert rules(Checker([floor], check_limits(margin_m=0.0)).check_path(path)) == {"clearance"}


# --- tracks flown from where the aircraft is


def eastwards(north=0.0, slope=0.0, length=400.0):
    east = np.arange(0.0, length + 1.0, 10.0)
    return np.column_stack([east, north + slope * east, np.full(len(east), 100.0)])


def test_a_track_keeps_its_margin_and_the_bounds():
    checker = Checker([box("wall", -500.0, 20.0, 500.0, 60.0)], check_limits())
    assert checker.check_track(eastwards(), 19.0) == ()
    assert rules(checker.check_track(eastwards(), 21.0)) == {"clearance"}
    far = checker.limits.bounds[1] - 100.0
    assert rules(checker.check_track(eastwards() + np.array([far, 0.0, 0.0]), 1.0)) == {"bounds"}


@pytest.mark.parametrize(("slope", "broken"), [(-0.2, set()), (0.0, {"clearance"}), (0.2, {"clearance"})])
def test_who_begins_within_the_margin_has_to_come_away(slope, broken):
    checker = Checker([box("wall", -500.0, 5.0, 500.0, 60.0)], check_limits())
    assert rules(checker.check_track(eastwards(slope=slope), 20.0)) == broken


def test_who_begins_out_of_bounds_may_come_back():
    checker = free_checker()
    low = checker.limits.bounds[2]
    assert checker.check_track(eastwards(north=low - 8.0, slope=0.1), 5.0) == ()
    assert rules(checker.check_track(eastwards(north=low - 8.0, slope=-0.1), 5.0)) == {"bounds"}


def test_no_track_is_no_proof():
    assert rules(free_checker().check_track(eastwards()[:1], 5.0)) == {"finite"}
    assert rules(free_checker().check_track(eastwards(north=math.nan), 5.0)) == {"finite"}


def blown(path, wind):
    """The same rows with the time stamps of a wind, worked out in small steps."""
    steps = [0.0]
    for k in range(1, len(path)):
        courses = np.linspace(path.courses_rad[k - 1], path.courses_rad[k], 101)
        along = wind[0] * np.sin(courses) + wind[1] * np.cos(courses)
        across = wind[0] * np.cos(courses) - wind[1] * np.sin(courses)
        slowness = 25.0 / (along + np.sqrt(625.0 - across**2))
        steps.append((path.times_s[k] - path.times_s[k - 1]) * slowness.mean())
    return replace(path, times_s=path.times_s[0] + np.cumsum(steps))


@pytest.mark.parametrize("wind", [(10.0, 0.0), (-7.0, 7.0), (0.0, -14.0), (3.0, -1.0)])
def test_time_stamps_have_to_be_those_of_the_wind(wind):
    path, _ = flown([(200.0, 0.0, 0), (300.0, 200.0, 1), (200.0, 0.0, 0)], course=0.4)
    checker = free_checker()
    windy = blown(path, wind)
    assert checker.check_path(windy, wind_enu_m_s=wind) == ()
    assert rules(checker.check_path(path, wind_enu_m_s=wind)) == {"pace"}
    assert rules(checker.check_path(windy)) == {"pace"}
    assert "pace" in rules(checker.check_path(windy, wind_enu_m_s=(-wind[0], -wind[1])))
    sure, unsure = 0.2, 2.5
    other = (wind[0] + 1.0, wind[1] - 1.0)
    assert "pace" in rules(checker.check_path(windy, wind_enu_m_s=other, wind_std_m_s=sure))
    assert checker.check_path(windy, wind_enu_m_s=other, wind_std_m_s=unsure) == ()


def test_turns_downwind_are_wider():
    # A turn of 140 m through north, 14 m/s of wind from the south: 39²/(9.80665·tan 40°) = 184.8 m is needed.
    wind = (0.0, 14.0)
    for radius, tight in ((140.0, True), (190.0, False)):
        path, _ = flown([(200.0, radius, 1)], course=-0.7)
        found = rules(free_checker().check_path(blown(path, wind), wind_enu_m_s=wind))
        assert found == ({"turn_radius"} if tight else set())
    path, _ = flown([(200.0, 140.0, 1)], course=math.pi - 0.7)  # against the wind it may be tight
    assert free_checker().check_path(blown(path, wind), wind_enu_m_s=wind) == ()


def test_a_climb_downwind_is_flatter_over_the_ground():
    # 25·sin 10° over 25·cos 10° + 10 m/s: 7.15 degrees.
    wind = (0.0, 10.0)
    for angle, steep in ((7.0, False), (7.5, True)):
        path, _ = flown([(250.0, 0.0, 0)], climb=math.radians(angle))
        assert (rules(free_checker().check_path(blown(path, wind), wind_enu_m_s=wind)) == {"climb"}) is steep
    path, _ = flown([(250.0, 0.0, 0)], climb=math.radians(-7.5))
    assert rules(free_checker().check_path(blown(path, wind), wind_enu_m_s=wind)) == {"climb"}


@pytest.mark.parametrize(("std_m_s", "possible"), [(0.0, False), (0.2, False), (1.0, True)])
def test_an_uncertain_wind_allows_what_is_possible_within_its_deviation(std_m_s, possible):
    """With 1 m/s less: 38²/(9.80665·tan 40°) = 175.5 m; 25·sin 10° over 25·cos 10° + 9 m/s: 7.36 degrees.

    Once a flown path was unsafe because the estimated wind had risen by half a metre per second.
    """
    turning, _ = flown([(200.0, 178.0, 1)], course=-0.7)
    climbing, _ = flown([(250.0, 0.0, 0)], climb=math.radians(7.33))
    for path, speed, rule in ((turning, 14.0, "turn_radius"), (climbing, 10.0, "climb")):
        wind = (0.0, speed)
        found = free_checker().check_path(blown(path, wind), wind_enu_m_s=wind, wind_std_m_s=std_m_s)
        assert rules(found) == (set() if possible else {rule})

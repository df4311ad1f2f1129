"""Room of a path's rows, and paths laid where there is more of it, beside shapely and brute force."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.frames import course_from_direction
from companion.kernels.search import lay_aside as kernels
from companion.kernels.search import path_edit
from companion.kernels.workspace import PathRows, empty_rows
from companion.vehicle.vehicle_model import VehicleModel
from tests.support.paths import box, check_limits, path_of
from tests.support.worlds import packed

pytestmark = pytest.mark.compiled

BOUNDS = (-5000.0, 5000.0, -5000.0, 5000.0, 0.0, 500.0)
LIMITS = VehicleModel().limits(2, BOUNDS, 15.0, 1.0)
SEARCH = kernels.Aside(np.array([6, 10, 16, 24]), np.array([0.0, 0.2, -0.2]), 60.0, 1.25, 10.0)
BLOCKS = [box("west", -400.0, -300.0, -200.0, 300.0), box("low", 0.0, -80.0, 120.0, 80.0, top=90.0)]


def rooms_at(places, obstacles, most=60.0):
    rooms = np.full((len(places), 3), np.nan)
    kernels.fill_rooms(np.array(places, dtype=float), packed(obstacles), most, rooms)
    return rooms


def straight(length=60):
    """A level flight east at 25 m/s, a row a second."""
    rows = empty_rows(length)
    rows.states[:], rows.rates[:] = 0.0, 0.0
    rows.states[:, 0], rows.states[:, 2], rows.states[:, 5] = 25.0 * np.arange(length), 100.0, 25.0
    rows.times[:] = 5.0 + np.arange(length)
    return rows


def laid(obstacles, aside, k=30, *, search=SEARCH, rows=None, limits=LIMITS):
    path = straight() if rows is None else rows
    trial, best = empty_rows(len(path.times) + 96), empty_rows(len(path.times) + 96)
    n, first, last, at = kernels.lay_aside(
        path, k, np.array(aside), search, limits, packed(obstacles, BOUNDS), trial, best
    )
    return PathRows(*(array[:n] for array in best)), first, last, at


def test_rooms_by_hand():
    """20 m east of the one, 30 m above the other, 5 m over its edge, far from both."""
    rooms = rooms_at(
        [(-180.0, 0.0, 150.0), (60.0, 0.0, 120.0), (125.0, 0.0, 50.0), (700.0, 0.0, 50.0)], BLOCKS
    )
    assert rooms == pytest.approx(
        np.array([[20.0, 1.0, 0.0], [30.0, 0.0, 0.0], [5.0, 1.0, 0.0], [60.0, 0.0, 0.0]]), abs=1e-9
    )


@given(st.floats(-500.0, 300.0), st.floats(-400.0, 400.0))
def test_rooms_are_those_of_shapely_and_their_way_leads_to_more(east, north):
    here = rooms_at([(east, north, 50.0)], BLOCKS)[0]
    shapes = shapely.MultiPolygon([shapely.Polygon(block.polygon_enu_m) for block in BLOCKS])
    assert here[0] == pytest.approx(min(60.0, shapes.distance(shapely.Point(east, north))), abs=1e-6)
    assert math.hypot(here[1], here[2]) == pytest.approx(1.0) or not here[1:].any()
    if here[1:].any() and here[0] > kernels.ASIDE_M:
        assert rooms_at([(east + 0.5 * here[1], north + 0.5 * here[2], 50.0)], BLOCKS)[0, 0] > here[0]


def test_what_is_lacking_by_hand():
    """Three rows 20, 40 and 80 m from a wall: 40 + 20 + 0."""
    wall = box("wall", -1000.0, -100.0, 1000.0, 0.0)
    states = np.array([[0.0, 20.0, 100.0], [25.0, 40.0, 100.0], [50.0, 80.0, 100.0]])
    assert kernels.lack_of_room(states, 0, 2, packed([wall], BOUNDS), 60.0) == 60.0
    assert kernels.lack_of_room(states, 2, 2, packed([wall], BOUNDS), 60.0) == 0.0


def test_a_corner_is_passed_with_the_room_that_is_wanted():
    """A tower 15 m beside the middle of a straight flight of 59 s: 45 m are lacking, and there is room."""
    tower = box("tower", 740.0, -35.0, 760.0, -15.0)
    path, first, last, at = laid([tower], (0.0, 45.0))
    old = straight()
    assert 0 <= first < 30 < last < 60
    assert np.array_equal(path.states[: first + 1], old.states[: first + 1])
    assert path.states[at:] == pytest.approx(old.states[last:], abs=1e-6)
    assert np.diff(path.times[at:]) == pytest.approx(1.0)
    least = rooms_at(path.states, [tower])[:, 0].min()
    assert rooms_at(old.states, [tower])[:, 0].min() == 15.0
    assert 55.0 <= least <= 60.0
    assert path_edit.is_flyable(path, len(path.times), 1, LIMITS)
    assert 0.0 < path.times[-1] - old.times[-1] < 2.0


def test_it_is_the_best_of_all_that_can_be_flown():
    """Beside each way round tried alone."""
    tower, old = box("tower", 740.0, -35.0, 760.0, -15.0), straight()

    def worth(path, first, last, at):
        if len(path.times) == 0:
            return 0.0
        lacks = [
            kernels.lack_of_room(states, first + 1, end, packed([tower], BOUNDS), 60.0)
            for states, end in ((old.states, last), (path.states, at))
        ]
        return 1.25 * (lacks[0] - lacks[1]) - 25.0 * (path.times[-1] - old.times[-1])

    singles = [
        worth(
            *laid(
                [tower], (0.0, 45.0), search=SEARCH._replace(leads=np.array([lead]), turns=np.array([turn]))
            )
        )
        for lead in SEARCH.leads
        for turn in SEARCH.turns
    ]
    best = worth(*laid([tower], (0.0, 45.0)))
    assert best >= max(singles) - 1e-9
    assert best > 0.0


@pytest.mark.parametrize(
    ("obstacles", "search"),
    [
        ([box("tower", 740.0, -35.0, 760.0, -15.0)], SEARCH._replace(worth=1e-3)),  # too dear
        ([box("tower", 740.0, -35.0, 760.0, -15.0)], SEARCH._replace(least=1e5)),  # too little
        (
            [box("tower", 740.0, -35.0, 760.0, -15.0), box("wall", 700.0, 16.0, 800.0, 400.0)],
            SEARCH,
        ),  # no room
        (
            [box("tower", 740.0, -35.0, 760.0, -15.0)],
            SEARCH._replace(leads=np.array([2])),
        ),  # no turn so tight
        ([], SEARCH),  # nothing there
    ],
)
def test_nothing_is_laid_that_is_not_worth_it_or_cannot_be_flown(obstacles, search):
    path, *_ = laid(obstacles, (0.0, 45.0), search=search)
    assert len(path.times) == 0


@given(st.integers(8, 51), st.floats(-60.0, 60.0), st.floats(5.0, 60.0))
def test_whatever_is_laid_is_flyable_clear_and_back_where_it_was(k, aside, beside):
    tower, old = box("tower", 740.0, -beside - 40.0, 790.0, -beside), straight()
    if beside < LIMITS.margin:
        return
    path, _, last, at = laid([tower], (0.0, aside), k)
    if len(path.times) == 0:
        return
    assert path_edit.is_flyable(path, len(path.times), 1, LIMITS)
    assert path_edit.is_clear(path, 1, len(path.times), packed([tower], BOUNDS), LIMITS)
    assert path.states[at, :3] == pytest.approx(old.states[last, :3], abs=1e-6)
    assert len(path.times) - at == len(old.times) - last


@given(st.integers(8, 40), st.floats(5.0, 60.0), st.floats(24.0, 30.0), st.floats(20.0, 37.0))
def test_whatever_is_laid_while_it_gets_faster_passes_the_independent_check(k, aside, begins, target):
    """A flight east that settles at an airspeed; the check knows how fast each row may be: v² = u² + 2as."""
    limits = LIMITS._replace(v_cruise=target)
    rows = straight()
    gone = np.arange(60.0)
    gain = math.copysign(0.5, target - begins)
    settled = abs(target - begins) / 0.5
    held = np.minimum(gone, settled)
    rows.states[:, 5] = begins + gain * held
    rows.states[:, 0] = begins * held + 0.5 * gain * held**2 + target * (gone - held)
    tower = box("tower", rows.states[k, 0] - 10.0, -60.0, rows.states[k, 0] + 10.0, -20.0)
    path, _, last, at = laid([tower], (0.0, aside), k, rows=rows, limits=limits)
    if len(path.times) == 0:
        return
    assert path.states[at] == pytest.approx(rows.states[last], abs=0.02)
    courses = [course_from_direction(theta) for theta in path.states[:, 3]]
    as_path = path_of(path.times, path.states[:, :3], courses, path.states[:, 4], path.states[:, 5])
    checker = Checker([tower], check_limits(bounds=BOUNDS, turn_radius_min_m=125.0))
    assert not [entry for entry in checker.check_path(as_path) if entry.rule != "bounds"]

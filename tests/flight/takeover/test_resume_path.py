"""Where no plan may begin, the shortest way out comes first: of bounds, a margin, a fence."""

from dataclasses import replace

import numpy as np
import pytest

from companion.assurance.checker import Checker
from companion.config import mission_from_text
from companion.planning import solver
from companion.types.events import Dialect
from companion.types.plan import PlanStatus
from tests.flight.replanning.test_surprise import CHANGED_S, LONG
from tests.flight.test_app import at, both, switch
from tests.flight.test_geofences import BOTH, CIRCLE_OUT, fence
from tests.planning.test_solver import random_problem
from tests.sim.client import PLAIN
from tests.support.paths import box, check_limits, flown
from tests.support.sitl_harness import SitlHarness
from tests.support.worlds import packed

SMALL = PLAIN.replace("north_m: [-6000, 6000]", "north_m: [-300, 2000]")


def begun_at(asked, east, north, direction, obstacles=None):
    start = replace(asked.start, position_enu_m=(east, north, asked.start.position_enu_m[2]),
                    direction_rad=direction)  # fmt: skip
    snapshot = asked.snapshot
    if obstacles is not None:
        snapshot = replace(
            snapshot, obstacle_list=tuple(obstacles), obstacles=packed(obstacles, snapshot.bounds)
        )
    return replace(asked, start=start, snapshot=snapshot)


def judged(asked, plan):
    limits = check_limits(
        bounds=asked.snapshot.bounds, margin_m=0.5 * asked.settings.clearance_min_m, deviations=1.0
    )
    return Checker(asked.snapshot.obstacle_list, limits).check_path(plan.path, may_come_back=True)


@pytest.mark.parametrize(
    ("place", "direction"),
    [((-200.0, 700.0), 0.0), ((-120.0, 700.0), np.pi), ((700.0, -90.0), -0.5 * np.pi)],
    ids=["coming back", "flying out", "flying out southwards"],
)
def test_out_of_bounds_the_way_back_is_checked_and_then_the_plan(place, direction):
    asked = begun_at(random_problem(3, 2), *place, direction, obstacles=[])
    plan = solver.solve(asked)
    assert plan.status is PlanStatus.EXACT
    assert judged(asked, plan) == ()
    assert plan.path.positions_enu_m[0, :2] == pytest.approx(place)
    low, high = np.array(asked.snapshot.bounds).reshape(3, 2).T
    inside = ((plan.path.positions_enu_m >= low) & (plan.path.positions_enu_m <= high)).all(axis=1)
    assert inside[np.argmax(inside) :].all()  # once


def test_beside_a_wall_and_in_a_fence_too():
    asked = random_problem(3, 2)
    wall = box("wall", 300.0, 205.0, 900.0, 230.0)
    beside = begun_at(asked, 500.0, 196.0, -0.1, obstacles=[wall])  # 9 m off, where 15 are kept
    within = begun_at(asked, 500.0, 300.0, 0.7, obstacles=[box("fence", 300.0, 100.0, 700.0, 500.0)])
    for problem in (beside, within):
        plan = solver.solve(problem)
        assert plan.status is PlanStatus.EXACT, plan.notes
        assert judged(problem, plan) == ()
        assert "the way out" in plan.notes[0]


def test_what_is_forgiven_is_the_way_back_and_no_more():
    # East at 25 m a row; the bounds begin at 100 m, and a wall of 10 m stands at 400 m.
    path, _ = flown([(600.0, 0.0, 0)], course=0.5 * np.pi)
    bounds = (100.0, 5000.0, -500.0, 500.0, 0.0, 500.0)
    assert Checker([], check_limits(bounds=bounds)).check_path(path, may_come_back=True) == ()
    assert {entry.rule for entry in Checker([], check_limits(bounds=bounds)).check_path(path)} == {"bounds"}
    through = Checker([box("wall", 400.0, -50.0, 410.0, 50.0)], check_limits(bounds=bounds))
    assert {entry.rule for entry in through.check_path(path, may_come_back=True)} == {"clearance"}
    out_again = Checker([], check_limits(bounds=(100.0, 300.0, -500.0, 500.0, 0.0, 500.0)))
    assert {entry.rule for entry in out_again.check_path(path, may_come_back=True)} == {"bounds"}
    farther = Checker([], check_limits(bounds=(-5000.0, -100.0, -500.0, 500.0, 0.0, 500.0)))
    assert {entry.rule for entry in farther.check_path(path, may_come_back=True)} == {"bounds"}
    near = Checker([box("wall", -20.0, 10.0, 40.0, 20.0)], check_limits())  # 10 m aside, of 15
    assert near.check_path(path, may_come_back=True) == ()
    nearer = Checker(
        [box("wall", -20.0, 10.0, 40.0, 20.0), box("next", 50.0, 4.0, 90.0, 9.0)], check_limits()
    )
    assert {entry.detail for entry in nearer.check_path(path, may_come_back=True)} == {"distance to next [m]"}


@BOTH
def test_a_fence_drawn_about_the_aircraft_is_left_by_the_shortest_way(dialect, monkeypatch):
    def flies(until_s=CHANGED_S + 40.0):
        harness, places = SitlHarness(mission_from_text(LONG, "fenced.yaml"), dialect=dialect), []

        def about(harness):
            if harness.now_s >= CHANGED_S and not places:
                east, north = harness.simulator.truth.path[-1][1:3]
                places.append((east - 100.0, north))
                fence(harness, (CIRCLE_OUT, 220.0, *places[0]))

        harness.fly(until_s, about)
        rows = np.array(harness.simulator.truth.path)
        rows = rows[rows[:, 0] > CHANGED_S]
        inside = np.hypot(*(rows[:, 1:3] - places[0]).T) < 220.0
        swaps = [e.text for e in harness.recorder.decisions if e.kind == "swap" and e.stamp_s > CHANGED_S]
        return 0.1 * inside.sum(), swaps

    inside_s, swaps = flies()
    assert inside_s < 15.0
    assert any(not text.startswith("emergency") for text in swaps)  # a plan to the goal
    monkeypatch.setattr(solver, "recovery_path", lambda *arguments: None)
    _, without = flies(CHANGED_S + 4.0)
    assert all(text.startswith("emergency") for text in without)


def test_an_aircraft_beyond_its_bounds_comes_back_and_arrives():
    """The pilot has flown it out of bounds, and hands back."""
    harness = SitlHarness(mission_from_text(SMALL, "small.yaml"), dialect=Dialect.ARDUPILOT)

    def away(harness):
        harness.simulator.set_mode("GUIDED")
        harness.simulator.autopilot._go_to((900.0, -650.0, 100.0), 130.0)

    harness.fly(170.0, both(at(12.0, away), switch(60.0, "AUTO")))
    rows = np.array(harness.simulator.truth.path)
    assert rows[:, 2].min() < -400.0
    assert harness.app.mode.value == "arrived"

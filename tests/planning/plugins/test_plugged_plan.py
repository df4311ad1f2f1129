"""What a foreign planner returns is measured by us, and refused where it is no path."""

import math

import numpy as np
import pytest

from companion.config import load_mission
from companion.errors import PlannerError
from companion.planning.solver import solve, solve_in_flight
from companion.research.campaign.runs import plan_runs, result_of, results_table
from companion.types.plan import PlanStatus
from tests.research.campaign.test_runs import text_of
from tests.sim.client import CONFIGS
from tests.support.paths import box
from tests.support.worlds import problem

pytestmark = pytest.mark.compiled
HEAD = "import numpy as np\n\n\ndef find(problem, should_stop):\n"
STEPS = 12


def level_rows(asked, steps=STEPS):
    """Straight and level flight from a problem's start."""
    rows = np.repeat([[*asked.start.position_enu_m, asked.start.direction_rad, 0.0, 25.0]], steps + 1, axis=0)
    ahead = 25.0 * np.arange(steps + 1)
    rows[:, 0] += ahead * math.cos(asked.start.direction_rad)
    rows[:, 1] += ahead * math.sin(asked.start.direction_rad)
    return rows


def answer_of(packages, monkeypatch, rows):
    """The problem of a planner that returns these rows."""
    packages.install(
        "told-one", {"told": "told:find"}, {"told": HEAD + "    return ANSWER\n\n\nANSWER = None\n"}
    )
    asked = problem(method="told")
    import told  # noqa: PLC0415

    monkeypatch.setattr(told, "ANSWER", rows(asked))
    return asked


def test_times_costs_and_uncertainty_are_computed_here(packages, monkeypatch):
    asked = answer_of(packages, monkeypatch, level_rows)
    plan = solve(asked)
    assert plan.status is PlanStatus.APPROXIMATE
    assert re_notes(plan) == "ends 1468 m from the last goal after 13 nodes"
    np.testing.assert_allclose(plan.path.times_s, np.arange(STEPS + 1.0))
    assert plan.path.position_covariances_m2[-1, 0, 0] > 0.0
    assert plan.objective_s == pytest.approx(STEPS, rel=1e-6)
    assert plan.cost == plan.objective_s
    assert plan.gap is None


def re_notes(plan):
    return "; ".join(plan.notes)


def test_an_arc_is_as_long_as_an_arc(packages, monkeypatch):
    radius, turn = 125.0, 0.2

    def quarter(asked):
        rows = level_rows(asked, 8)
        rows[:, 3] = asked.start.direction_rad + turn * np.arange(9)
        rows[:, 0] = 100.0 + radius * (np.sin(rows[:, 3]) - math.sin(rows[0, 3]))
        rows[:, 1] = 100.0 - radius * (np.cos(rows[:, 3]) - math.cos(rows[0, 3]))
        return rows

    plan = solve(answer_of(packages, monkeypatch, quarter))
    np.testing.assert_allclose(plan.path.times_s, np.arange(9.0), atol=1e-9)


def changed(row, column, value):
    def rows(asked):
        made = level_rows(asked)
        made[row, column] = value
        return made

    return rows


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (lambda asked: "north", "got str; expected an array of numbers, or None"),
        (lambda asked: [[1.0, 2.0], [1.0]], "got list; expected an array of numbers"),
        (lambda asked: level_rows(asked)[:, :5], r"got an array of shape \(13, 5\); expected shape \(N, 6\)"),
        (lambda asked: level_rows(asked)[:0], r"got an array of shape \(0, 6\)"),
        (changed(3, 0, math.nan), "finite"),
        (changed(3, 5, 0.0), "airspeed"),
        (changed(0, 1, 103.0), r"got a first row .*; expected the start"),
        (changed(4, 0, 900.0), r"m from row 3 to the next; expected 0\.001 to 37\.5 m"),
        (changed(4, 3, 2.5), "got a turn of 1.71 rad after row 3; expected at most 1.0 rad"),
        (lambda asked: np.repeat(level_rows(asked), 2, axis=0), "got 0.000 m from row 0 to the next"),
    ],
)
def test_what_is_no_path_is_refused_with_the_package_named(packages, monkeypatch, rows, told):
    asked = answer_of(packages, monkeypatch, rows)
    with pytest.raises(PlannerError, match=told) as caught:
        solve(asked)
    assert "'told' of told-one 1.0 (told:find)" in str(caught.value)
    plan = solve_in_flight(asked, lambda: False)
    assert (plan.status, plan.path, plan.notes) == (PlanStatus.APPROXIMATE, None, (str(caught.value),))


def test_a_planner_that_fails_is_an_error_offline_and_no_path_in_flight(packages):
    packages.install("failing", {"failing": "failing:find"}, {"failing": HEAD + "    return problem['x']\n"})
    asked = problem(method="failing")
    with pytest.raises(PlannerError, match=r"failing 1\.0 .*got TypeError: .*; expected a path or None"):
        solve(asked)
    plan = solve_in_flight(asked, lambda: False)
    assert not plan.reaches_goal
    assert "failing 1.0" in plan.notes[0]


OWN = "class Own(Exception):\n    pass\n\n\n" + HEAD.split("\n\n\n", 1)[1]


@pytest.mark.parametrize(
    ("fault", "told"), [("Own('of mine')", "Own: of mine"), ("SystemExit(7)", "SystemExit: 7")]
)
def test_no_error_of_a_planner_leaves_it_as_it_is(packages, fault, told):
    packages.install("failing", {"failing": "failing:find"}, {"failing": f"{OWN}    raise {fault}\n"})
    plan = solve_in_flight(problem(method="failing"), lambda: False)
    assert (plan.status, plan.path) == (PlanStatus.APPROXIMATE, None)
    assert f"failing 1.0 (failing:find): got {told}; expected a path or None" in plan.notes[0]


def test_a_planner_that_finds_nothing_says_so(packages):
    packages.install("finder", {"finds-nothing": "finder:find"}, {"finder": HEAD + "    return None\n"})
    plan = solve(problem(method="finds-nothing"))
    assert (plan.status, plan.path, plan.notes) == (
        PlanStatus.APPROXIMATE, None, ("the planner found no path",),
    )  # fmt: skip


def test_from_within_a_margin_the_way_out_is_ours_and_the_rest_the_planners(packages):
    packages.install_example()
    wall = box("wall", 80.0, 115.0, 300.0, 200.0)
    plan = solve(problem((wall,), start=(100.0, 104.0, 150.0), direction=0.0, method="beeline"))
    assert plan.notes[0].startswith("the way out")
    assert plan.method == "beeline"


@pytest.mark.parametrize(
    ("name", "rule"), [("first-flight", "threat"), ("paper-2d", "clearance"), ("hills", "")]
)
def test_offline_the_check_refuses_what_it_would_refuse_in_flight(packages, name, rule):
    packages.install_example()
    mission = load_mission(CONFIGS / f"{name}.yaml")
    _, (plan,) = plan_runs(mission, method="beeline", first_seed=1, runs=1, time_limit_s=None)
    told = result_of(plan, mission)
    assert told["success"] is (rule == "")
    assert told["status"] == ("refused" if rule else "exact")
    table = text_of(results_table(mission.name, mission.dimension, [plan]))
    assert (f"({rule})" in table) is bool(rule)
    assert ("the check refuses the path" in table) is bool(rule)

"""Offline plans: the problem a file states, the measures reported, and that a seed is a plan."""

import json
import math

import numpy as np
import pytest
from rich.console import Console

from companion.config import mission_from_text
from companion.config.mission_summary import mission_summary, summary_table
from companion.config.offline_problem import offline_problem, offline_world
from companion.errors import ConfigError
from companion.research.campaign.runs import plan_runs, result_of, results_table
from companion.types.plan import Measures, Plan, PlanStatus
from tests.mission.made import path_along
from tests.support.sitl_harness import FIRST_FLIGHT

MISSION = mission_from_text(FIRST_FLIGHT, "first-flight.yaml")


def text_of(table):
    console = Console(width=160)
    with console.capture() as captured:
        console.print(table)
    return captured.get()


def test_the_problem_is_that_of_the_file():
    world = offline_world(MISSION)
    problem = offline_problem(MISSION, world, None, 9)
    assert problem.start.position_enu_m == (150.0, 750.0, 100.0)
    assert problem.start.direction_rad == pytest.approx(0.0)  # course 90 degrees
    assert problem.start.airspeed_m_s == 25.0
    assert problem.start.error_covariance[0, 0] == 4.0  # initial_position_std_m: 2
    assert [goal.position_enu_m for goal in problem.goals] == [(1750.0, 750.0, 100.0)]
    assert (problem.settings.method, problem.seed) == ("safe-rrt", 9)


def test_a_method_by_its_name_and_none_by_another():
    world = offline_world(MISSION)
    assert offline_problem(MISSION, world, "rrt", 1).settings.method == "rrt"
    with pytest.raises(ConfigError, match=r"method: got teleport; expected one of .*safe-rrt"):
        offline_problem(MISSION, world, "teleport", 1)


def test_consecutive_seeds_each_with_its_plan():
    _, plans = plan_runs(MISSION, method=None, first_seed=4, runs=3, time_limit_s=None)
    assert [plan.seed for plan in plans] == [4, 5, 6]
    _, again = plan_runs(MISSION, method=None, first_seed=5, runs=1, time_limit_s=None)
    assert result_of(plans[1])["path"] == result_of(again[0])["path"]
    assert result_of(plans[0])["path"] != result_of(plans[1])["path"]


MEASURES = Measures(
    path_search_time_s=0.25, num_collision_checks=1000, num_tree_nodes=400, path_cost=30.5, quality=0.75,
    total_threat_amount=1.5, aggregated_threat=0.25, num_high_threat_waypoints=2, penetration_success=0.5,
)  # fmt: skip


def plan(status=PlanStatus.EXACT, path=None, measures=MEASURES, **changes):
    return Plan(status, path, measures, 7, "safe-rrt", 1, **changes)


def test_measures_by_their_names_in_the_paper():
    made = plan(path=path_along((50.0, 2), course=0.5 * math.pi), objective_s=60.0, bound_s=50.0, seen_s=5.0)
    found = result_of(made)
    path = found.pop("path")
    assert found == {
        "seed": 7, "method": "safe-rrt", "success": True, "status": "exact", "PST": 0.25, "NCDC": 1000,
        "NTN": 400, "ESR": 0.4, "TSI": 0.00025, "PC": 30.5, "Q": 0.75, "TTA": 1.5, "ATP": 0.25, "NHTW": 2,
        "PSR": 0.5, "J": 60.0, "gap": 0.2, "seen_s": 5.0,
    }  # fmt: skip
    expected = [[t, 25.0 * t, 0.0, 100.0, 0.5 * math.pi, 0.0, 25.0] for t in range(3)]
    np.testing.assert_allclose(path, expected, atol=1e-6)


def test_no_plan_is_fit_for_json_too():
    found = result_of(plan(PlanStatus.INVALID_START, measures=Measures()))
    assert (found["success"], found["status"]) == (False, "invalid_start")
    assert (found["J"], found["gap"], found["seen_s"]) == (None, None, 0.0)
    assert (found["PC"], found["ESR"], found["TSI"], found["path"]) == (None, 0.0, 0.0, [])
    json.dumps(found, allow_nan=False)


def test_the_table_counts_who_reaches_the_goal():
    line = path_along((500.0, 20))
    plans = [plan(path=line), plan(path=line), plan(PlanStatus.APPROXIMATE, path=line)]
    text = text_of(results_table("m", 2, plans))
    assert "2 of 3 reach the goal" in text
    assert "500" in next(row for row in text.splitlines() if "length" in row)
    assert next(row for row in text.splitlines() if "FR" in row).split("│")[2].strip() == "0.333"
    assert "paper" not in text


def test_a_table_without_any_success_has_the_failure_rate_alone():
    table = results_table("m", 2, [plan(PlanStatus.APPROXIMATE)])
    assert "0 of 1" in str(table.title)
    assert table.row_count == 1


def test_the_paper_stands_beside_what_it_measured():
    # Its Table 1: NTN = 0.5441·1213 = 660, which is what its Table 2 prints.
    line = path_along((500.0, 20))
    text = text_of(results_table("paper-3d", 3, [plan(path=line)]))
    last = {
        row.split("│")[1].split(",")[0].strip(): row.split("│")[-2].strip() for row in text.splitlines()[4:-1]
    }
    assert (last["FR"], last["NTN"], last["Q"], last["PC"]) == ("0.013", "660", "0.3571", "1565")
    assert "paper" not in text_of(results_table("first-flight", 2, [plan(path=line)]))


def test_what_was_understood_is_fit_for_json_and_a_table():
    told = json.loads(json.dumps(mission_summary(MISSION), allow_nan=False))
    assert told["radars"][0]["position_enu_m"] == [1100, 1350, 100]
    assert told["start_course_deg"] == 90
    assert summary_table(MISSION).row_count == 10

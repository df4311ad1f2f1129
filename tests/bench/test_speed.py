"""What must be fast, measured on this computer; loose limits only, since computers differ."""

import time

import numpy as np
import pytest

from companion.assurance.checker import Checker
from companion.config import load_mission
from companion.config.compose import check_limits_of
from companion.config.offline_problem import offline_problem, offline_world
from companion.flight.construction.mission_construction import construct
from companion.flight.state.flight_state import first_state
from companion.planning.solver import solve
from sim.simulator import Simulator
from tests.sim.client import CONFIGS

pytestmark = pytest.mark.bench

MAPS = ("paper-2d", "paper-3d")
RUNS = 10


@pytest.fixture(scope="module", params=MAPS)
def planned(request):
    """The map's name and mission, its plans, and what each took [s]; compiled beforehand."""
    mission = load_mission(CONFIGS / f"{request.param}.yaml")
    world = offline_world(mission)
    solve(offline_problem(mission, world, None, 0))
    plans, took = [], []
    for seed in range(1, RUNS + 1):
        problem = offline_problem(mission, world, None, seed)
        began = time.perf_counter()
        plans.append(solve(problem))
        took.append(time.perf_counter() - began)
    return request.param, mission, plans, np.array(took)


def test_full_plan(planned, tell):
    name, _, plans, took = planned
    reached = sum(plan.reaches_goal for plan in plans)
    tell(f"{name}, plan, median of {RUNS}", 1e3 * float(np.median(took)), "ms")
    tell(f"{name}, plan, slowest", 1e3 * float(took.max()), "ms")
    tell(f"{name}, plans that reach the goal", reached, f"of {RUNS}")
    assert reached >= 1
    assert np.median(took) < 30.0


def test_tree_node(planned, tell):
    name, _, plans, _ = planned
    searched = sum(plan.measures.path_search_time_s for plan in plans)
    nodes = sum(plan.measures.num_tree_nodes for plan in plans)
    microseconds = 1e6 * searched / nodes
    tell(f"{name}, search, a tree node", microseconds, "µs")
    assert 0.1 < microseconds < 10_000.0


def test_search_share(planned, tell):
    name, _, plans, took = planned
    share = sum(plan.measures.path_search_time_s for plan in plans) / took.sum()
    tell(f"{name}, search, share of the plan's time", 100.0 * float(share), "%")
    assert 0.0 < share <= 1.0


def test_check(planned, tell):
    name, mission, plans, _ = planned
    plan = next(plan for plan in plans if plan.reaches_goal)
    checker = Checker(mission.obstacle_list, check_limits_of(mission))
    took = []
    for _ in range(20):
        began = time.perf_counter()
        checker.check_path(plan.path)
        took.append(time.perf_counter() - began)
    tell(f"{name}, check of a path of {len(plan.path)} rows", 1e3 * float(np.median(took)), "ms")
    state = first_state(mission, 0.0)
    began = time.perf_counter()
    waypoints = construct(state, plan.path, 58).waypoints
    spent = time.perf_counter() - began
    tell(f"{name}, mission of {len(waypoints.positions_enu_m)} waypoints with its check", 1e3 * spent, "ms")
    assert np.median(took) < 1.0


@pytest.mark.parametrize("name", MAPS)
def test_simulator(name, tell):
    simulated_s = 30.0
    simulator = Simulator(load_mission(CONFIGS / f"{name}.yaml"), seed=1)
    simulator.step(1.0)
    began = time.perf_counter()
    for _ in range(round(simulated_s / 0.02)):
        simulator.step(0.02)
        simulator.take_outgoing()
    factor = simulated_s / (time.perf_counter() - began)
    tell(f"{name}, simulator", factor, "times real time")
    assert factor > 1.0

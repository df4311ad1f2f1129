"""Others' planners on our maps: edges are judged as our own paths are, and what is found is flyable."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from companion.planning.route import cost_between, route_along, route_from_path
from companion.planning.solver import solve
from companion.research.campaign.campaign_spec import Run, load_campaign
from tests.sim.client import CONFIGS

base = pytest.importorskip("ompl.base")

from sim.comparison.anytime_runs import OURS, AnytimeRunner, _exploration  # noqa: E402
from sim.comparison.ompl_edges import Edges  # noqa: E402
from sim.comparison.ompl_planners import searched  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.compiled]
SPEC = f"""\
name: beside
kind: anytime
missions: [{CONFIGS / "paper-2d.yaml"}, {CONFIGS / "paper-3d.yaml"}]
methods: [rrt-star, ompl-rrt, ompl-bit-star]
seeds: 1
"""


@pytest.fixture(scope="module")
def runner(tmp_path_factory):
    file = tmp_path_factory.mktemp("beside") / "spec.yaml"
    file.write_text(SPEC, encoding="utf-8")
    return AnytimeRunner(load_campaign(file), {})


def judge_of(runner, mission):
    return _exploration(runner._problem(Run(0, mission, "default", OURS, 1), OURS))


def test_a_straight_edge_costs_its_length_where_no_radar_reaches_and_none_through_a_wall(runner):
    judge = judge_of(runner, "paper-2d")
    edges = Edges(judge)
    a, b = (2400.0, 1200.0, 100.0, 0.5 * math.pi), (2400.0, 1260.0, 100.0, 0.5 * math.pi)
    assert edges.is_free(a, b)
    assert edges.cost(a, b) >= 0.5 * 60.0 / 25.0  # D_γ1 of (9), 25 m a unit; radars cost besides
    through = (2400.0, 1050.0, 100.0, 0.5 * math.pi), (2400.0, 1200.0, 100.0, 0.5 * math.pi)
    assert not edges.is_free(*through)  # wall_a_east
    assert not edges.is_free((2480.0, 1300.0, 100.0, 0.0), (2520.0, 1300.0, 100.0, 0.0))  # out of bounds


def test_a_climb_that_is_too_steep_is_no_edge(runner):
    judge = judge_of(runner, "paper-3d")
    edges, start = Edges(judge), judge.problem.start
    here = (*start.position_enu_m, start.direction_rad)
    ahead = (here[0] + 50.0 * math.cos(here[3]), here[1] + 50.0 * math.sin(here[3]), here[2], here[3])
    assert edges.is_free(here, ahead)
    steep = 60.0 * math.tan(judge.limits.climb_max)
    assert not edges.is_free(here, (*ahead[:2], here[2] + steep, here[3]))


def test_lengths_are_those_of_ompls_own_dubins_paths(runner):
    judge = judge_of(runner, "paper-2d")
    edges, space = Edges(judge), base.DubinsStateSpace(judge.limits.r_min)
    rng = np.random.default_rng(4)
    for _ in range(50):
        (x0, x1), (y0, y1), (t0, t1) = (
            rng.uniform(low, high, 2) for low, high in ((0, 2500), (0, 2500), (-3, 3))
        )
        one, other = space.allocState(), space.allocState()
        for state, values in ((one, (x0, y0, t0)), (other, (x1, y1, t1))):
            state.setX(values[0])
            state.setY(values[1])
            state.setYaw(values[2])
        rows = edges.states_along([(x0, y0, 100.0, t0), (x1, y1, 100.0, t1)])
        chords = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1).sum()
        assert 0.99 * space.distance(one, other) <= chords <= space.distance(one, other) + 1e-6


def test_ours_is_costed_as_its_plan_says(runner):
    problem = runner._problem(Run(0, "paper-2d", "default", OURS, 1), OURS)
    few = replace(problem.settings, optimise_iterations=80, max_iterations=60_000)
    plan = solve(replace(problem, settings=few))
    judge = judge_of(runner, "paper-2d")
    assert cost_between(judge, route_from_path(judge, plan.path)) == pytest.approx(plan.measures.path_cost)


@pytest.mark.parametrize("mission", ["paper-2d", "paper-3d"])
def test_what_is_found_keeps_the_margin_and_ends_at_the_goal(runner, mission):
    judge = judge_of(runner, mission)
    found = searched(judge, "ompl-rrt", 1, (20.0,))
    poses, edges = found.poses[20.0], Edges(judge)
    assert found.first_s is not None
    assert all(edges.is_free(a, b) for a, b in itertools.pairwise(poses))
    assert found.asked.edges > 10
    goal = judge.problem.goals[0]
    assert math.dist(poses[-1][:3], goal.position_enu_m) <= goal.acceptance_radius_m
    assert poses[0][:3] == pytest.approx(judge.problem.start.position_enu_m)
    route = route_along(judge, edges.states_along(poses))
    assert math.isfinite(cost_between(judge, route))

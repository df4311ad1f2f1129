"""Our planner and others on the same maps: time of the first path, and its cost over time.

Moving threats are left out and all radars are known from the start, because other planners know neither
pursuers nor sensing horizons. Formula (9) gives the cost of all paths, in steps of τ.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from companion.config.offline_problem import judged_plan, offline_problem, offline_world
from companion.planning.comparators import ANYTIME_METHODS
from companion.planning.explore import Exploration
from companion.planning.problem import Problem
from companion.planning.route import cost_between, route_along, route_from_path
from companion.planning.solver import solve
from companion.research.campaign.campaign_spec import Campaign, Run, Scalar
from companion.research.campaign.engines.runners import Outcome
from .ompl_edges import Edges, Pose
from .ompl_planners import searched

MARKS_S = (0.1, 1.0, 10.0)
ENDLESS = 10_000_000  # Number of iterations that the clock ends first.
OURS = "rrt-star"  # Method whose weights and limits judge the others: (9) alone.


class AnytimeRunner:
    """Makes the runs of an anytime campaign.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    known : dict
        Places of code; none is needed.
    """

    def __init__(self, campaign: Campaign, known: dict[str, str]) -> None:
        del known
        self._campaign = campaign

    def warm_up(self) -> None:
        """Compile what judges edges, and the planner."""
        run = self._campaign.runs[0]
        problem = self._problem(run, OURS)
        solve(problem)
        here = (*problem.start.position_enu_m, problem.start.direction_rad)
        edges = Edges(_exploration(problem))
        edges.is_free(here, here)
        edges.cost(here, here)

    def outcome(self, run: Run) -> Outcome:
        """Search, and compute the cost of the paths found."""
        if run.method in ANYTIME_METHODS:
            return self._by_others(run)
        measures: dict[str, Scalar | None] = {}
        first_s = None
        judge = _exploration(self._problem(run, OURS))
        problem = self._problem(run, run.method)
        solve(problem, lambda: True)  # A method's first plan loads its other parts.
        for mark_s in MARKS_S:
            end_s = time.perf_counter() + mark_s
            plan = solve(problem, lambda end=end_s: time.perf_counter() >= end)  # type: ignore[misc]
            plan = judged_plan(self._campaign.mission(run.mission, run.setting), problem, plan)
            reached = plan.path is not None and plan.reaches_goal
            cost = None
            if plan.path is not None and reached:
                cost = cost_between(judge, route_from_path(judge, plan.path))
            measures[f"cost_{mark_s:g}_s"] = cost
            if reached:
                first_s = plan.measures.path_search_time_s
        return Outcome({}, measures | {"success": first_s is not None, "first_s": first_s})

    def _by_others(self, run: Run) -> Outcome:
        judge = _exploration(self._problem(run, OURS))
        found = searched(judge, run.method, run.seed, MARKS_S)
        edges = Edges(judge)
        measures: dict[str, Scalar | None] = {
            f"cost_{mark_s:g}_s": None if poses is None else _cost(judge, edges, poses)
            for mark_s, poses in found.poses.items()
        }
        asked = found.asked
        measures |= {"asked": asked.edges + asked.costs, "asked_s": asked.edges_s + asked.costs_s}
        return Outcome({}, measures | {"success": found.first_s is not None, "first_s": found.first_s})

    def _problem(self, run: Run, method: str) -> Problem:
        mission = self._campaign.mission(run.mission, run.setting)
        mission = mission.model_copy(update={"dynamic_threats": ()})
        world = offline_world(mission)
        world = world.with_known(np.ones_like(world.threats.known))
        problem = offline_problem(mission, world, method, run.seed)
        endless = replace(problem.settings, max_iterations=ENDLESS, optimise_iterations=ENDLESS)
        return replace(problem, settings=endless)


def _exploration(problem: Problem) -> Exploration:
    """Return the world and weights of a problem; it is not searched."""
    return Exploration(problem, np.random.default_rng(problem.seed))


def _cost(judge: Exploration, edges: Edges, poses: list[Pose]) -> float:
    """Cost by (9) of edges that meet at poses."""
    return cost_between(judge, route_along(judge, edges.states_along(poses)))

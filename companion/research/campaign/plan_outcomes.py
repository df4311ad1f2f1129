"""Offline plans as runs of a campaign, each with every measure of the paper's tables."""

from __future__ import annotations

import functools
import math
import pkgutil
import time
from collections.abc import Callable
from typing import cast

from companion.config import MissionConfig
from companion.config.offline_problem import judged_plan, offline_problem, offline_world
from companion.frames import FloatArray
from companion.planning.problem import Problem
from companion.planning.solver import never, solve
from companion.research.campaign.campaign_spec import Campaign, Run, Scalar
from companion.research.campaign.engines.runners import Outcome
from companion.research.campaign.measures import pursuit_measures
from companion.research.campaign.runs import result_of
from companion.run_places import PURSUERS
from companion.types.path import Path
from companion.types.plan import Plan
from companion.world.snapshot import Snapshot

TIMED = ("PST", "TSI")
_NAMED = ("seed", "method")  # The run itself has these.
_DIGITS = 9

Drives = Callable[[MissionConfig, Path], list[FloatArray]]


class PlanRunner:
    """Makes a campaign's plans.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    known : dict
        Places of code; with ``pursuers`` the moving threats drive against each plan.
    """

    def __init__(self, campaign: Campaign, known: dict[str, str]) -> None:
        self._campaign = campaign
        place = known.get(PURSUERS)
        self._drives: Drives | None = None if place is None else pkgutil.resolve_name(place)
        self._world = functools.cache(self._world_of)
        self._warm: set[tuple[str, str]] = set()

    def warm_up(self) -> None:
        """Make the first run's plan, so that one process compiles the kernels once."""
        run = self._campaign.runs[0]
        mission, world = self._world(run.mission, run.setting)
        self._warm_up(run, offline_problem(mission, world, run.method, run.seed))

    def outcome(self, run: Run) -> Outcome:
        """Plan, and measure the plan."""
        mission, world = self._world(run.mission, run.setting)
        problem = offline_problem(mission, world, run.method, run.seed)
        self._warm_up(run, problem)
        budget_s = self._campaign.config.budget_s
        end_s = math.inf if budget_s is None else time.perf_counter() + budget_s
        plan = solve(problem, never if budget_s is None else lambda: time.perf_counter() >= end_s)
        plan = judged_plan(mission, problem, plan)
        values = cast("dict[str, Scalar | None]", result_of(plan))
        path = cast("object", values.pop("path"))
        for name in _NAMED:
            del values[name]
        timings = {name: values.pop(name) for name in TIMED}
        return Outcome(values | self._path_measures(mission, world, plan), timings, {"path": path})

    def _world_of(self, mission: str, setting: str) -> tuple[MissionConfig, Snapshot]:
        config = self._campaign.mission(mission, setting)
        return config, offline_world(config)

    def _warm_up(self, run: Run, problem: Problem) -> None:
        """Plan once without measuring: a method's first plan in a process loads its parts."""
        key = run.mission, run.method
        if key not in self._warm:
            self._warm.add(key)
            solve(problem)

    def _path_measures(self, mission: MissionConfig, world: Snapshot, plan: Plan) -> dict[str, Scalar | None]:
        """Length and duration, and the moving threats' measures if they are driven."""
        path = plan.path
        if path is None:
            return {}
        values: dict[str, Scalar | None] = {
            "length_m": round(path.length_m, 3), "duration_s": round(path.duration_s, 3),
        }  # fmt: skip
        if self._drives is None or not plan.reaches_goal or not mission.dynamic_threats:
            return values
        every = [
            pursuit_measures(plan, path, world, which, track)
            for which, track in enumerate(self._drives(mission, path))
        ]
        actual = sum(one.total_threat for one in every)
        expected = sum(one.estimated_total_threat for one in every)
        share = expected / actual if actual > 0.0 else None
        kept = math.prod(1.0 - one.aggregated_threat for one in every)
        return values | {
            "ADTP": round(1.0 - kept, _DIGITS),
            "TDTA": round(actual, _DIGITS),
            "ETDTA": round(expected, _DIGITS),
            "ETDTA/TDTA": None if share is None else round(share, _DIGITS),
            "TFP/PD": round(min(one.first_pursued_share for one in every), _DIGITS),
            "RRS": every[0].num_reachable,  # of all trees together
        }

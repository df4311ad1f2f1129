"""Offline plans of a mission file: one or many."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from companion.config import MissionConfig
from companion.config.mission_summary import mission_coverage
from companion.config.offline_problem import judged_plan, offline_problem, offline_world
from companion.kernels.native.ready import make_ready
from companion.planning.solver import solve
from companion.research.campaign.paper import PaperRow, paper_row
from companion.types.plan import Plan, PlanStatus
from companion.world.snapshot import Snapshot


def plan_runs(
    mission: MissionConfig, *, method: str | None, first_seed: int, runs: int, time_limit_s: float | None,
    get_ready: Callable[[], None] = make_ready,
) -> tuple[Snapshot, list[Plan]]:  # fmt: skip
    """Plans with consecutive seeds, and the world they were made in.

    ``get_ready`` is called before the first plan, if the request is valid.
    """
    snapshot = offline_world(mission)
    problems = [offline_problem(mission, snapshot, method, first_seed + k) for k in range(runs)]
    get_ready()
    plans = []
    for problem in problems:
        deadline = math.inf if time_limit_s is None else time.perf_counter() + time_limit_s
        plan = solve(problem, lambda end=deadline: time.perf_counter() >= end)  # type: ignore[misc]
        plans.append(judged_plan(mission, problem, plan))
    return snapshot, plans


def result_of(plan: Plan, mission: MissionConfig | None = None) -> dict[str, object]:
    """One object of ``plan --json``: the measures of the paper's tables, and the path.

    With a mission that has a section ``glide``, it also names the fields within glide along the path.
    """
    m = plan.measures
    coverage = None if mission is None or plan.path is None else mission_coverage(mission, plan.path)
    glide = {} if coverage is None else {"glide": coverage.document()}
    return glide | {
        "seed": plan.seed,
        "method": plan.method,
        "success": plan.reaches_goal,
        "status": plan.status.value,
        "PST": round(m.path_search_time_s, 6),
        "NCDC": m.num_collision_checks,
        "NTN": m.num_tree_nodes,
        "ESR": round(m.extension_success_rate, 6),
        "TSI": round(m.search_iteration_time_s, 9),
        "PC": round(m.path_cost, 6) if math.isfinite(m.path_cost) else None,
        "Q": round(m.quality, 9),
        "TTA": round(m.total_threat_amount, 6),
        "ATP": round(m.aggregated_threat, 6),
        "NHTW": m.num_high_threat_waypoints,
        "PSR": round(m.penetration_success, 9),
        "J": round(plan.objective_s, 6) if math.isfinite(plan.objective_s) else None,
        "gap": None if plan.gap is None else round(plan.gap, 6),
        "seen_s": round(plan.seen_s, 6),
        "path": [] if plan.path is None else plan.path.rows(),
    }


@dataclass(frozen=True, slots=True)
class _Row:
    """A measure of the table: its name, its value for a plan, and the paper's value if there is one."""

    name: str
    of_plan: Callable[[Plan], float | None]
    of_paper: Callable[[PaperRow], float | None] = lambda _: None


_ROWS = (
    _Row(
        "PST, path search, ms",
        lambda plan: 1e3 * plan.measures.path_search_time_s,
        lambda paper: 1e3 * paper.path_search_time_s,
    ),
    _Row(
        "NCDC, collision checks",
        lambda plan: float(plan.measures.num_collision_checks),
        lambda paper: float(paper.num_collision_checks),
    ),
    _Row(
        "NTN, tree nodes",
        lambda plan: float(plan.measures.num_tree_nodes),
        lambda paper: paper.extension_success_rate * paper.num_collision_checks,
    ),
    _Row(
        "ESR",
        lambda plan: plan.measures.extension_success_rate,
        lambda paper: paper.extension_success_rate,
    ),
    _Row(
        "TSI, time a check, ms",
        lambda plan: 1e3 * plan.measures.search_iteration_time_s,
        lambda paper: 1e3 * paper.search_iteration_time_s,
    ),
    _Row("PC, path cost", lambda plan: plan.measures.path_cost, lambda paper: paper.path_cost),
    _Row("Q, path quality", lambda plan: plan.measures.quality, lambda paper: paper.quality),
    _Row("TTA, radar threat", lambda plan: plan.measures.total_threat_amount),
    _Row("NHTW, waypoints above 0.5", lambda plan: float(plan.measures.num_high_threat_waypoints)),
    _Row("length, m", lambda plan: None if plan.path is None else plan.path.length_m),
    _Row("duration, s", lambda plan: None if plan.path is None else plan.path.duration_s),
)


def results_table(name: str, dimension: int, plans: Sequence[Plan]) -> Table:
    """Medians of the runs for the terminal, and the paper's values where it has them."""
    reached = [plan for plan in plans if plan.reaches_goal]
    paper = paper_row(name, dimension, plans[0].method)
    table = Table(title=f"{name}: {plans[0].method}, {len(reached)} of {len(plans)} reach the goal")
    for column in ("measure", "median", "min", "max") + (("paper",) if paper else ()):
        table.add_column(column, justify="left" if column == "measure" else "right")
    rate = f"{1.0 - len(reached) / len(plans):.3g}"
    table.add_row("FR, failure rate", rate, "", "", *((f"{paper.failure_rate:.3g}",) if paper else ()))
    for row in _ROWS:
        values = [value for plan in reached if (value := row.of_plan(plan)) is not None]
        if values:
            figures = (f"{value:.4g}" for value in (np.median(values), min(values), max(values)))
            table.add_row(row.name, *figures, *_printed_cell(row, paper))
    table.caption = _first_refusal(plans)
    return table


def _first_refusal(plans: Sequence[Plan]) -> str | None:
    """Return why the independent check refused the first path that it refused; None if it refused none."""
    return next((plan.notes[-1] for plan in plans if plan.status is PlanStatus.REFUSED), None)


def _printed_cell(row: _Row, paper: PaperRow | None) -> tuple[str, ...]:
    """Return the paper's column of a row; empty if the paper has no such plans."""
    if paper is None:
        return ()
    printed = row.of_paper(paper)
    return ("" if printed is None else f"{printed:.4g}",)

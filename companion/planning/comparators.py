"""Methods by name: Safe-RRT and the comparators, each one composition of strategies (paper 5)."""

from __future__ import annotations

from dataclasses import replace

from companion.planning.settings import (
    Certainty,
    Estimator,
    Optimiser,
    PlannerSettings,
    Strategies,
    SubGoalRule,
)

_PRINTED = Strategies(
    plays_game=False, keeps_room=False
)  # the paper's: DTs are kept away from by threat levels alone

# What is no comparator's subject it shares with Safe-RRT: samples that follow the distance field, the
# connection to the goal and restarts. Their budgets are larger: a race's collision checks are of no
# iteration, so that Safe-RRT has some 130,000 more of these, and a tree in whose cost threats are higher
# takes more samples. One that gives in step by step has a budget for each try.
SUB_TASK_ITERATIONS, STALL_ITERATIONS = 3_000, 1_200
ITERATIONS_SHARE = 4
STAR_ITERATIONS = 800  # of RRT* where it is the whole method: its gain has levelled off by then

_TADDRRT = replace(
    _PRINTED, use_uncertainty=False, use_goal_zoom=False, use_k_near=False, optimiser=Optimiser.NONE
)

_RRT_STAR = replace(
    _PRINTED,
    use_dynamic_domain=False,
    use_uncertainty=False,
    use_goal_zoom=False,
    use_safety_adjustment=False,
)

METHODS: dict[str, Strategies] = {
    "safe-rrt": Strategies(),
    # Ablations: blind to DTs, at cruise whatever pursues, without the game of 2.3, without uncertainty, and
    # without anything that improves a path which reaches the goal.
    "safe-rrt-blind": Strategies(minds_dts=False),
    "safe-rrt-cruise": Strategies(may_hurry=False),
    "safe-rrt-rs": _PRINTED,
    "safe-rrt-certain": Strategies(use_uncertainty=False, keeps_room=False),
    "safe-rrt-first": Strategies(optimiser=Optimiser.NONE),
    "safe-rrt-printed": replace(_PRINTED, follow_field=False, connect_straight=False),  # and its samplers
    "taddrrt": _TADDRRT,
    # DTs are no-fly, by the RS of ours.
    "nfz-ddrrt": replace(_TADDRRT, plays_game=True, races=False, may_hurry=False),
    "nfz-ddrrt-printed": replace(_TADDRRT, dts_are_no_fly=True),  # by the threat trees, however fast DTs are
    "rrt-star": _RRT_STAR,  # what is dear by (9) alone
    "edbm": replace(_PRINTED, sub_goal=SubGoalRule.EUCLIDEAN),
    "probabilistic": replace(_PRINTED, certainty=Certainty.PROBABILISTIC),
    "rrt-reach": replace(_PRINTED, estimator=Estimator.RRT_REACH),
    "rrt": replace(_PRINTED, estimator=Estimator.RRT),
}


def settings_for(
    method: str,
    *,
    certainty: Certainty,
    clearance_min_m: float,
    sensing_horizon_m: float,
    max_iterations: int,
    threat_level_max: float = 1.0,
    quality_min: float = 0.0,
    cost_hurry: float = 0.2,
    clearance_wanted_m: float = 0.0,
) -> PlannerSettings:
    """Settings of a method.

    Raises
    ------
    KeyError
        If there is no such method.
    """
    strategies = METHODS[method]
    if strategies.certainty is not Certainty.PROBABILISTIC:
        strategies = replace(strategies, certainty=certainty)
    chosen = PlannerSettings(
        strategies=strategies,
        method=method,
        clearance_min_m=clearance_min_m,
        sensing_horizon_m=sensing_horizon_m,
        max_iterations=max_iterations,
        threat_level_max=threat_level_max,
        quality_min=quality_min,
        cost_hurry=cost_hurry,
        clearance_wanted_m=clearance_wanted_m,
    )
    is_ours = strategies.plays_game and strategies.races
    return chosen if is_ours else _as_comparator(chosen)


def _as_comparator(chosen: PlannerSettings) -> PlannerSettings:
    """The settings with the budgets of comparators."""
    star = STAR_ITERATIONS if chosen.method == "rrt-star" else chosen.optimise_iterations
    share = 1 if chosen.strategies.plays_game else ITERATIONS_SHARE
    return replace(
        chosen,
        sub_task_iterations=SUB_TASK_ITERATIONS,
        stall_iterations=STALL_ITERATIONS,
        max_iterations=share * chosen.max_iterations,
        optimise_iterations=star,
    )

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

_PRINTED = Strategies(plays_game=False)  # the paper's: DTs are kept away from by threat levels alone

_TADDRRT = Strategies(
    plays_game=False,
    use_uncertainty=False,
    use_goal_zoom=False,
    follow_field=False,
    connect_straight=False,
    use_k_near=False,
    use_safety_adjustment=True,
    optimiser=Optimiser.NONE,
)

METHODS: dict[str, Strategies] = {
    "safe-rrt": Strategies(),
    "safe-rrt-cruise": Strategies(may_hurry=False),  # an ablation: at cruise, whatever pursues
    "safe-rrt-rs": _PRINTED,  # an ablation: without the game of 2.3
    "safe-rrt-printed": replace(_PRINTED, follow_field=False, connect_straight=False),  # and its samplers
    "taddrrt": _TADDRRT,
    "nfz-ddrrt": replace(_TADDRRT, dts_are_no_fly=True),
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
    return PlannerSettings(
        strategies=strategies,
        method=method,
        clearance_min_m=clearance_min_m,
        sensing_horizon_m=sensing_horizon_m,
        max_iterations=max_iterations,
        threat_level_max=threat_level_max,
        quality_min=quality_min,
    )
